//! Bakes a whole scene: light at lumels and vertices, and pages.

use std::f32::consts::PI;

use atlas::Layout;
use gather::{
    LightReport, Records, Shard, VertexLight, VertexOptions, VertexReport, bake_light,
    bake_vertices, merge_light,
};
use radiosity::{Cancelled, Emitters, Monitor, Solution, World};
use serde::Serialize;

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
    bake_with((world, emitters, solution), layout, options, None, monitor)
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
    bake_with(solved, layout, options, Some(records), monitor)
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
    records: Option<&dyn Records>,
    monitor: &dyn Monitor,
) -> Result<Baked, Cancelled> {
    let gatherer = options.gatherer(world, emitters, solution);
    let (map, light) = match records {
        None => bake_light(&gatherer, layout, options.light(), monitor)?,
        Some(records) => merge_light(&gatherer, layout, options.light(), records, monitor)?,
    };
    let pages = Pages {
        world,
        layout,
        lumels: map.lumels(),
        received: map.received(),
        options,
        wanted: gatherer.wanted,
    };
    let Made {
        pages,
        masks,
        groups,
        seams,
    } = pages.make();
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
