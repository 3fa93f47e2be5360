//! Lumels and vertices of a whole scene, gathered and put into pages.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::Vec3;
use radiosity::{Cancelled, DirectLight, Emitters, Monitor, Phase, Solution, World};
use rayon::prelude::*;
use serde::Serialize;

use crate::atlas::{Layout, Page};
use crate::certainty::Certainty;
use crate::gather::{Edge, GatherOptions, Gatherer, Received};
use crate::gltf_out::VertexLight;
use crate::lumels::{Lumels, TexelIndex};
use crate::manifest::ValueKind;
use crate::pages::Pages;
use crate::planes::{Plane, Wanted};
use crate::reach::{mean_light, mean_square, reach, relative_errors};
use crate::recall::{Recall, Tape};
use crate::refine::{add_rays, follow_edges};
use crate::seams::SeamReport;
use crate::smooth::smooth_indirect;
use crate::sparse::Sparse;
use crate::vertex_light::{LumelLight, LumelPlace, VertexBake, VertexReport};
use crate::walls::{Barriers, fill_hidden};

/// Extra channels of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Layer {
    /// `direct.R/G/B`: light straight from lamps and emitters.
    Direct,
    /// `indirect.R/G/B`: the rest.
    Indirect,
    /// `radiosity.R/G/B`: what the lumel sends on, ρE/π.
    Radiosity,
    /// `error.Y`: estimated standard error of the value's luminance.
    Error,
    /// `coverage.Y`: share of the texel that lies on the surface.
    Coverage,
    /// `ao.Y`: ambient occlusion, as openness: the cosine-weighted share of rays that meet nothing within [`BakeOptions::ao_distance`].
    Ao,
    /// `sun_mask.Y`: share of the light of directional lights that gets through, 0..=1; 0 on faces turned away.
    SunMask,
}

/// What a lightmap keeps of the directions that light comes from, so that engines can light normal maps. Directions are in the axes of
/// the glTF's world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Directional {
    /// Spherical harmonics of first order: `L0.R/G/B`, `L1x.…`, `L1y.…`, `L1z.…`, scaled so that a surface with normal n gets
    /// L0 + L1x nx + L1y ny + L1z nz, in the unit of R, G, B.
    Sh1,
    /// `dominant.X/Y/Z`: the mean direction of light, weighted by luminance. Its length is 1 where all light comes from one side and
    /// less where it does not.
    Dominant,
}

/// How a scene is baked.
#[derive(Debug, Clone)]
pub struct BakeOptions {
    /// Light at lumels.
    pub lumels: GatherOptions,
    /// Light at vertices; `None` leaves it out: no ray is cast for it, and [`Baked::vertices`] is empty.
    pub vertices: Option<GatherOptions>,
    /// Extra channels, in the order in which they are to be written.
    pub layers: Vec<Layer>,
    /// Texels around charts that take their neighbours' value.
    pub padding: u32,
    /// What R, G, B (and the light layers) hold.
    pub value: ValueKind,
    /// Keep the directions of light.
    pub directional: Option<Directional>,
    /// How far [`Layer::Ao`] looks, metres; `None` for a tenth of the scene's diagonal.
    pub ao_distance: Option<f32>,
    /// What lumels hold of which a part lies inside or behind something.
    pub hidden: Hidden,
    /// Make bilinear lookups on both sides of chart borders agree.
    pub stitch: bool,
    /// Gather on until [`BakeReport::estimated_error`] is at most this; `None` stops where [`lumels`](Self::lumels) says.
    pub error: Option<f32>,
    /// Split edges for vertex light until its relative error is about this; `None` keeps the mesh as it is.
    pub vertex_error: Option<f32>,
}

/// What lumels hold of which a part lies inside or behind something, or beyond a wall.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hidden {
    /// The light of the part that can be seen; lumels of which nothing can be seen take their neighbours'.
    #[default]
    Fill,
    /// The mean over all of it, hidden parts being dark: what an area average over the texel says, for measuring.
    Mean,
}

impl BakeOptions {
    /// What lumels are to keep beside their irradiance.
    pub(crate) fn wanted(&self, world: &World) -> Wanted {
        Wanted {
            groups: world.groups.as_ref().map_or(0, |g| g.count),
            moments: self.directional.is_some(),
            openness: (self.layers.contains(&Layer::Ao))
                .then(|| self.ao_distance.unwrap_or_else(|| 0.1 * diagonal(world))),
            sun: self.layers.contains(&Layer::SunMask),
        }
    }
}

/// Of the box about the scene, metres.
fn diagonal(world: &World) -> f32 {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for p in world.soup.seen_triangles().iter().flatten() {
        (low, high) = (low.min(*p), high.max(*p));
    }
    if world.soup.is_empty() {
        0.0
    } else {
        (high - low).length()
    }
}

/// What was gathered.
#[derive(Debug, Clone, Default, Serialize)]
pub struct BakeReport {
    /// Texels with a surface.
    pub lumels: u64,
    /// Lumels that lie wholly inside or right behind something single-sided: nearly all rays from there meet back faces.
    pub hidden_lumels: u64,
    /// The nodes that most of them are of.
    pub hidden: Vec<HiddenIn>,
    /// Lumels of which a part does; their value is the mean over all of it.
    pub partly_hidden_lumels: u64,
    /// Lumels at a contact, which were gathered at many points.
    pub edge_lumels: u64,
    /// Lumels in or beside the edge of a shadow.
    pub shadow_edge_lumels: u64,
    /// Gathering and shadow rays, lumels.
    pub lumel_rays: u64,
    /// Light at vertices; `None` where it was left out.
    pub vertices: Option<VertexReport>,
    /// Mean of R over lumels, weighted by coverage (linear RGB).
    pub mean: [f64; 3],
    /// Estimated relative error: root mean square over lit lumels of standard error / (value + 1 % of the mean). Within a factor 1.5 of the true one
    /// on the scenes of docs/error.md.
    pub estimated_error: f64,
    /// Median over lit lumels of the same: what most of the map has; the root mean square is ruled by the worst corners.
    pub median_error: f64,
    /// Whether that is as small as [`BakeOptions::error`] asked for; `None` where nothing was asked.
    pub error_reached: Option<bool>,
    /// Times that lumels were looked at again for it.
    pub rounds: u32,
    /// Lumels that have as many samples as they can and still too large an error.
    pub exhausted_lumels: u64,
    /// Seams between charts: how far lookups on their two sides differ.
    pub seams: SeamReport,
    /// Memory of pages and lumel lists, bytes.
    pub bytes: u64,
}

/// Hidden lumels of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct HiddenIn {
    /// Index into [`Scene::instances`](mesh_ingest::Scene::instances).
    pub instance: usize,
    /// Its lumels.
    pub lumels: u64,
    /// Those of them that lie wholly inside or right behind something.
    pub hidden: u64,
}

/// Pages and vertex light of a scene.
#[derive(Debug, Default)]
pub struct Baked {
    /// Lightmap pages.
    pub pages: Vec<Page>,
    /// Pages of each group of light, without extra channels; they sum to `pages`. Empty where groups are not kept apart.
    pub groups: Vec<Vec<Page>>,
    /// Irradiance per instance, primitive and vertex of the primitive; empty where [`BakeOptions::vertices`] leaves it out.
    pub vertices: VertexLight,
    /// What was done.
    pub report: BakeReport,
}

/// Footprints gathered between two looks at the monitor.
const BLOCK: usize = 64;

/// Gathers light at all lumels and vertices.
///
/// Deterministic for any number of threads: every footprint is computed by itself, with random numbers that hang on its place.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
pub fn bake(
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    layout: &Layout,
    options: &BakeOptions,
    monitor: &dyn Monitor,
) -> Result<Baked, Cancelled> {
    bake_recalling(world, emitters, solution, layout, options, None, monitor)
}

/// [`bake`], with records of an earlier bake or for a later one. The result is the same.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
pub fn bake_recalling(
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    layout: &Layout,
    options: &BakeOptions,
    recall: Option<&Recall>,
    monitor: &dyn Monitor,
) -> Result<Baked, Cancelled> {
    let mut out = Baked::default();
    let lumels = Lumels::find(world.scene, world.soup, layout);
    let mut gatherer = Gatherer::new(
        world,
        solution,
        DirectLight::new(world, emitters).with_records(recall.and_then(Recall::recalled)),
        GatherOptions {
            open_only: options.hidden == Hidden::Fill,
            ..options.lumels
        },
        options.wanted(world),
    );
    gatherer.recall = recall;
    let mut sparse = if world.is_dark() {
        Sparse::none(lumels.lumels.len())
    } else {
        Sparse::find(world, &lumels, layout, options.lumels.interpolation, recall)
    };
    let mut received = sparse.gather(&gatherer, &lumels, layout, monitor)?;
    follow_edges(&gatherer, &lumels, layout, &mut received, monitor)?;
    let fill = options.hidden == Hidden::Fill;
    let mut barriers = Barriers::default();
    if fill {
        let index = TexelIndex::build(&lumels.lumels, layout);
        barriers = Barriers::find(world, &lumels, &index, &received);
    }
    let times = add_rays(
        &gatherer,
        &lumels,
        layout,
        &mut received,
        &barriers,
        &sparse,
        monitor,
    )?;
    // What is hidden takes its neighbours' light.
    let finish = |received: &mut [Received]| {
        if fill {
            fill_hidden(
                world,
                &lumels,
                layout,
                received,
                &barriers,
                options.padding + 1,
            );
        }
    };
    let mut sure = Vec::new();
    if let Some(wanted) = options.error {
        let reached = reach(
            &mut gatherer,
            &lumels,
            layout,
            &mut received,
            &barriers,
            &sparse,
            wanted,
            &times,
            &finish,
            monitor,
        )?;
        out.report.rounds = reached.rounds;
        out.report.exhausted_lumels = reached.exhausted;
        sure = reached.sure;
    }
    sparse.interpolate(&mut received);
    let mean = mean_light(&lumels, &received);
    let certainty = Certainty::measure(&received, |i| !sparse.is(i), options.lumels.rays, mean);
    let groups = gatherer.wanted.groups;
    smooth_indirect(
        &lumels,
        layout,
        &mut received,
        &barriers,
        &sparse,
        groups,
        &certainty,
        &|i| sure.get(i) == Some(&true),
    );
    finish(&mut received);
    summarise(&lumels, &received, &mut out.report);
    let reached = |x| out.report.estimated_error <= f64::from(x);
    out.report.error_reached = options.error.map(reached);
    let wanted = gatherer.wanted;
    let pages = Pages {
        world,
        layout,
        lumels: &lumels,
        received: &received,
        options,
        wanted,
    };
    (out.pages, out.groups, out.report.seams) = pages.make();
    out.report.bytes = lumels.bytes()
        + gatherer.lit.bytes()
        + (received.len() * wanted.planes() * size_of::<Plane>()) as u64
        + (out.pages.iter().chain(out.groups.iter().flatten()))
            .map(|p| (p.value.len() * (16 + 4 * p.layers.len())) as u64)
            .sum::<u64>();
    let Some(at_vertices) = options.vertices else {
        return Ok(out);
    };
    let light: Vec<LumelLight> = received.iter().map(LumelLight::of).collect();
    // A mean over what a wall parts is for measuring, not for reading.
    let places = fill.then(|| LumelPlace::find(&lumels, &received, &barriers));
    drop(received);
    let vertices = VertexBake {
        world,
        layout,
        lumels: &lumels,
        light: &light,
        places: places.as_deref(),
        error: options.vertex_error,
    };
    let (lit, report) = vertices.run(gatherer, at_vertices, monitor)?;
    out.vertices = lit;
    out.report.vertices = Some(report);
    Ok(out)
}

/// Where a stage's records are.
pub(crate) struct Recorded<'r> {
    pub recall: Option<&'r Recall>,
    pub stage: u8,
    /// What records call the stage's footprints; ascending.
    pub item: &'r (dyn Fn(usize) -> u32 + Sync),
    /// What identifies them.
    pub guard: &'r (dyn Fn(usize) -> u64 + Sync),
}

/// Computes `0..n` in parallel blocks, in order, looking at the monitor between blocks.
pub(crate) fn in_blocks(
    n: usize,
    phase: Phase,
    monitor: &dyn Monitor,
    recorded: Recorded,
    gather: impl Fn(usize, &mut Tape) -> Received + Sync,
) -> Result<Vec<Received>, Cancelled> {
    let mut received = Vec::new();
    received.resize_with(n, Received::default);
    let done = AtomicU64::new(0);
    received
        .par_chunks_mut(BLOCK)
        .enumerate()
        .for_each(|(b, out)| {
            if monitor.cancelled() {
                return;
            }
            let mut records = recorded.recall.map(|r| r.block(recorded.stage));
            for (k, r) in out.iter_mut().enumerate() {
                let k = b * BLOCK + k;
                *r = match &mut records {
                    None => gather(k, &mut Tape::off()),
                    Some(records) => {
                        let guard = || (recorded.guard)(k);
                        records.with((recorded.item)(k), guard, |tape| gather(k, tape))
                    }
                };
            }
            let now = done.fetch_add(out.len() as u64, Ordering::Relaxed) + out.len() as u64;
            monitor.progress(phase, now, n as u64);
        });
    if done.load(Ordering::Relaxed) < n as u64 {
        return Err(Cancelled);
    }
    Ok(received)
}

fn summarise(lumels: &Lumels, received: &[Received], report: &mut BakeReport) {
    report.lumels = lumels.lumels.len() as u64;
    let (mut sum, mut weight) = ([0f64; 3], 0f64);
    for (l, r) in lumels.lumels.iter().zip(received) {
        report.lumel_rays += r.rays;
        report.edge_lumels += (r.edge == Edge::Contact) as u64;
        report.shadow_edge_lumels += (r.edge == Edge::Shadow) as u64;
        report.hidden_lumels += (r.open == 0.0) as u64;
        report.partly_hidden_lumels += (r.open > 0.0 && r.open < 1.0) as u64;
        let w = l.coverage as f64;
        let value = (r.direct + r.indirect) * std::f32::consts::FRAC_1_PI;
        for (s, v) in sum.iter_mut().zip(value.to_array()) {
            *s += v as f64 * w;
        }
        weight += w;
    }
    report.hidden = hidden_in(lumels, received);
    report.mean = sum.map(|s| s / weight.max(1e-300));
    let mut errors = relative_errors(lumels, received);
    report.estimated_error = mean_square(&errors).sqrt();
    let middle = errors.len() / 2;
    if !errors.is_empty() {
        report.median_error = *errors.select_nth_unstable_by(middle, f64::total_cmp).1;
    }
}

/// So many instances are named that have hidden lumels, those with most first.
const NAMED: usize = 100;

fn hidden_in(lumels: &Lumels, received: &[Received]) -> Vec<HiddenIn> {
    let mut all: Vec<HiddenIn> = Vec::new();
    // Lumels are sorted by instance.
    for (l, r) in lumels.lumels.iter().zip(received) {
        let instance = l.instance as usize;
        if all.last().is_none_or(|h| h.instance != instance) {
            all.push(HiddenIn {
                instance,
                lumels: 0,
                hidden: 0,
            });
        }
        if let Some(h) = all.last_mut() {
            h.lumels += 1;
            h.hidden += u64::from(r.open == 0.0);
        }
    }
    all.retain(|h| h.hidden > 0);
    all.sort_by_key(|h| std::cmp::Reverse(h.hidden));
    all.truncate(NAMED);
    all
}
