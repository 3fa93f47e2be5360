//! Bakes a whole scene: light at lumels and vertices, and pages.

use std::f32::consts::PI;

use atlas::{Layout, Lumels};
use gather::{
    LightBake, LightReport, Records, Shard, VertexLight, VertexLights, VertexOptions, VertexReport,
    bake_light, tiles,
};
use radiosity::{Cancelled, Emitters, Monitor, Solution, World};
use serde::Serialize;

use crate::earlier::Earlier;
use crate::options::BakeOptions;
use crate::page::Page;
use crate::pages::{Given, Made, Pages};
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
    let all: Vec<usize> = (0..world.scene.instances.len()).collect();
    let (earlier, records) = match how {
        How::Whole => (None, None),
        How::Merge(records) => (None, Some(records)),
        How::Part(earlier) => (Some(earlier), None),
    };
    let mut pages = Pages::new(Given {
        world,
        layout,
        earlier,
        options,
        wanted: gatherer.wanted,
    });
    let gather = LightBake {
        instances: earlier.map_or(&all, |earlier| &earlier.anew),
        options: options.light(),
        records,
    };
    let mut vertices = VertexLights::new(world.scene);
    let mut lists = 0;
    let light = bake_light(&gatherer, layout, gather, monitor, &mut |map, monitor| {
        pages.put(map.lumels(), Some(map.received()));
        lists = lists.max(map.bytes());
        let Some(gather) = options.vertices else {
            return Ok(());
        };
        let error = options.vertex_error;
        let options = VertexOptions { gather, error };
        vertices.add(&gatherer, layout, map, options, monitor)
    })?;
    if let Some(earlier) = earlier {
        let others = |i: &usize| earlier.anew.binary_search(i).is_err();
        let others: Vec<usize> = all.into_iter().filter(others).collect();
        for tile in tiles(layout, &others, gatherer.options.tile) {
            let own = others[tile].iter().copied();
            pages.put(&Lumels::find_of(world.scene, world.soup, layout, own), None);
        }
    }
    // Seams need as much memory as what only gathering needs.
    lists += gatherer.bytes();
    drop(gatherer);
    let (mut vertices, at_vertices) = match options.vertices {
        None => (VertexLight::default(), None),
        Some(_) => {
            let (mut light, report) = vertices.finish();
            raise(&mut light, options.ambient_floor);
            (light, Some(report))
        }
    };
    let Made {
        pages,
        masks,
        groups,
        seams,
    } = pages.finish();
    let all_pages = pages.iter().chain(&masks).chain(groups.iter().flatten());
    let bytes = lists + all_pages.map(Page::bytes).sum::<u64>();
    if let (Some(earlier), Some(_)) = (earlier, options.vertices) {
        earlier.restore_vertices(&mut vertices);
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
