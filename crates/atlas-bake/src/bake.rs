//! Bakes a whole scene: light at lumels and vertices, and pages.

use std::f32::consts::PI;

use atlas::{Layout, Lumels};
use gather::{
    Gatherer, LightOptions, LightReport, LumelMap, Received, Records, Shard, VertexLight,
    VertexOptions, VertexReport, bake_light, bake_part, bake_vertices, merge_light,
};
use radiosity::{Cancelled, Emitters, Monitor, Solution, World};
use serde::Serialize;

use crate::earlier::Earlier;
use crate::options::BakeOptions;
use crate::page::Page;
use crate::pages::{Made, Pages};
use crate::seams::SeamReport;

/// Report of a bake.
#[derive(Debug, Clone, Default, Serialize)]
pub struct BakeReport {
    /// Light at lumels.
    #[serde(flatten)]
    pub light: LightReport,
    /// Light at vertices; `None` if it was left out.
    pub vertices: Option<VertexReport>,
    /// Seams between charts: differences between lookups on the two sides.
    pub seams: SeamReport,
    /// Memory of pages and lumel lists, bytes.
    pub bytes: u64,
}

/// Pages and vertex light of a scene.
#[derive(Debug, Default)]
pub struct Baked {
    /// Lightmap pages.
    pub pages: Vec<Page>,
    /// Pages of each light group, without extra channels; they sum to `pages`. Empty without
    /// groups.
    pub groups: Vec<Vec<Page>>,
    /// Shadow masks of the lamps of [`radiosity::LampRoles`], page by page: R, G and B, and the layer
    /// `A`. Empty without masks.
    pub masks: Vec<Page>,
    /// Irradiance by instance, primitive and vertex of the primitive; empty if
    /// [`BakeOptions::vertices`] is `None`.
    pub vertices: VertexLight,
    /// Report of the bake.
    pub report: BakeReport,
}

/// Bakes a scene: gathers light at lumels, writes it to pages, and gathers light at vertices.
///
/// Deterministic for any number of threads, see [`bake_light`].
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn bake(
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    layout: &Layout,
    options: &BakeOptions,
    monitor: &dyn Monitor,
) -> Result<Baked, Cancelled> {
    let solved = (world, emitters, solution);
    bake_with(solved, layout, options, How::Whole, monitor)
}

/// As [`bake`], reusing the light that [`gather_shard`](gather_shard()) put into `records`. The
/// result is the same.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn merge(
    (world, emitters, solution): (&World, &Emitters, &Solution),
    layout: &Layout,
    options: &BakeOptions,
    records: &dyn Records,
    monitor: &dyn Monitor,
) -> Result<Baked, Cancelled> {
    let solved = (world, emitters, solution);
    bake_with(solved, layout, options, How::Merge(records), monitor)
}

/// Bakes a part of a scene anew, into the pages of an earlier bake in the same layout.
///
/// Texels of other instances keep their values. Where charts of the part meet others, only those
/// of the part are stitched.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn rebake(
    (world, emitters, solution): (&World, &Emitters, &Solution),
    layout: &Layout,
    options: &BakeOptions,
    earlier: &Earlier,
    monitor: &dyn Monitor,
) -> Result<Baked, Cancelled> {
    let solved = (world, emitters, solution);
    bake_with(solved, layout, options, How::Part(earlier), monitor)
}

/// How much of a scene is baked here.
enum How<'h> {
    Whole,
    /// What shards have left.
    Merge(&'h dyn Records),
    /// What an earlier bake does not keep.
    Part(&'h Earlier),
}

impl How<'_> {
    /// Light at lumels.
    fn gather(
        &self,
        gatherer: &Gatherer,
        layout: &Layout,
        options: LightOptions,
        monitor: &dyn Monitor,
    ) -> Result<(LumelMap, LightReport), Cancelled> {
        match self {
            How::Whole => bake_light(gatherer, layout, options, monitor),
            How::Merge(records) => merge_light(gatherer, layout, options, *records, monitor),
            How::Part(earlier) => bake_part(gatherer, layout, &earlier.anew, options, monitor),
        }
    }
}

/// The lumels of a whole layout, and the light of those that were baked, in this order.
fn lumels_of<'m>(
    world: &World,
    layout: &Layout,
    map: &'m LumelMap,
    earlier: Option<&Earlier>,
) -> (Option<Lumels>, Vec<Option<&'m Received>>) {
    let mut light = map.received().iter();
    let Some(earlier) = earlier else {
        return (None, light.map(Some).collect());
    };
    let mut all = Lumels::find(world.scene, world.soup, layout);
    all.turn_like(map.lumels());
    let anew = |instance: u32| earlier.anew.binary_search(&(instance as usize)).is_ok();
    let received = (all.lumels.iter())
        .map(|l| anew(l.instance).then(|| light.next()).flatten())
        .collect();
    (Some(all), received)
}

/// Gathers the light of a shard into `records`.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn gather_shard(
    (world, emitters, solution): (&World, &Emitters, &Solution),
    layout: &Layout,
    options: &BakeOptions,
    (shard, records): (&Shard, &dyn Records),
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let gatherer = options.gatherer(world, emitters, solution);
    gather::gather_shard(&gatherer, layout, shard, records, monitor)
}

fn bake_with(
    (world, emitters, solution): (&World, &Emitters, &Solution),
    layout: &Layout,
    options: &BakeOptions,
    how: How<'_>,
    monitor: &dyn Monitor,
) -> Result<Baked, Cancelled> {
    let gatherer = options.gatherer(world, emitters, solution);
    let (map, light) = how.gather(&gatherer, layout, options.light(), monitor)?;
    let earlier = match how {
        How::Part(earlier) => Some(earlier),
        How::Whole | How::Merge(_) => None,
    };
    let (all, received) = lumels_of(world, layout, &map, earlier);
    let pages = Pages {
        world,
        layout,
        lumels: all.as_ref().unwrap_or(map.lumels()),
        received: &received,
        earlier,
        options,
        wanted: gatherer.wanted,
    };
    let Made {
        pages,
        masks,
        groups,
        seams,
    } = pages.make();
    drop((received, all));
    let all_pages = pages.iter().chain(&masks).chain(groups.iter().flatten());
    let bytes = map.bytes() + gatherer.bytes() + all_pages.map(Page::bytes).sum::<u64>();
    let (mut vertices, mut at_vertices) = (VertexLight::default(), None);
    if let Some(gather) = options.vertices {
        let error = options.vertex_error;
        let ambient_floor = options.ambient_floor;
        let options = VertexOptions { gather, error };
        let (lit, report) = bake_vertices(&gatherer, layout, map, options, monitor)?;
        (vertices, at_vertices) = (lit, Some(report));
        raise(&mut vertices, ambient_floor);
        if let Some(earlier) = earlier {
            earlier.restore_vertices(&mut vertices);
        }
    }
    Ok(Baked {
        pages,
        masks,
        groups,
        vertices,
        report: BakeReport {
            light,
            vertices: at_vertices,
            seams,
            bytes,
        },
    })
}

/// Raises the irradiance of all vertices to π × `floor`.
fn raise(light: &mut VertexLight, floor: [f32; 3]) {
    if floor == [0.0; 3] {
        return;
    }
    let least = floor.map(|x| x * PI);
    for e in light.instances.iter_mut().flatten().flatten() {
        *e = std::array::from_fn(|c| e[c].max(least[c]));
    }
}
