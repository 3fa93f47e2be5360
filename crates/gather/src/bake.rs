//! Light at all lumels and vertices of a scene: the passes of a bake, in order.

use atlas::{Layout, Lumels};
use radiosity::{Cancelled, Monitor};
use serde::Serialize;

use crate::barriers::Barriers;
use crate::first::gather_first;
use crate::gatherer::Gatherer;
use crate::hidden::fill_hidden;
use crate::map::LumelMap;
use crate::options::{LightOptions, VertexOptions};
use crate::planes::Wanted;
use crate::reach::{mean_square, reach, relative_errors, settle};
use crate::received::{Edge, Received};
use crate::refine::{add_rays, follow_edges};
use crate::vertex_light::{LumelLight, LumelPlace, VertexBake, VertexLight, VertexReport};
use crate::work::{Records, Shard, Work};

/// Report on gathering at lumels.
#[derive(Debug, Clone, Default, Serialize)]
pub struct LightReport {
    /// Number of texels with a surface.
    pub lumels: u64,
    /// Lumels that are completely inside or right behind something single-sided: nearly all of
    /// their rays hit backfaces.
    pub hidden_lumels: u64,
    /// The nodes that most of them belong to.
    pub hidden: Vec<HiddenIn>,
    /// Lumels that are partly inside or behind something; their value is the mean over the whole
    /// lumel.
    pub partly_hidden_lumels: u64,
    /// Lumels at contacts, which were gathered at many points.
    pub edge_lumels: u64,
    /// Lumels at or next to a shadow edge.
    pub shadow_edge_lumels: u64,
    /// Gathering and shadow rays of lumels.
    pub lumel_rays: u64,
    /// Mean of R over lumels, weighted by coverage (linear RGB).
    pub mean: [f64; 3],
    /// Estimated relative error: root mean square over lit lumels of standard error / (value + 1 %
    /// of the mean). Within a factor of 1.5 of the true one on the scenes of lab/error.md. NaN
    /// (null in JSON) if no lumel is lit, because nothing was measured.
    pub estimated_error: f64,
    /// Median of the same over lit lumels, i.e. the error of a typical lumel; the root mean square
    /// is dominated by the worst corners. NaN like [`estimated_error`](Self::estimated_error).
    pub median_error: f64,
    /// Whether the error is as small as [`LightOptions::error`] requests; `None` without a request.
    pub error_reached: Option<bool>,
    /// Number of further rounds to reach it.
    pub rounds: u32,
    /// Lumels with the maximum number of samples whose error is still too large.
    pub exhausted_lumels: u64,
}

/// Gathers light at all lumels of a layout: the passes of a bake, in order.
///
/// Deterministic for any number of threads: every footprint is computed independently, with random
/// numbers that depend on its place.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn bake_light(
    gatherer: &Gatherer,
    layout: &Layout,
    options: LightOptions,
    monitor: &dyn Monitor,
) -> Result<(LumelMap, LightReport), Cancelled> {
    let rule = gatherer.options.interpolation;
    let map = LumelMap::new(gatherer.world(), layout, rule);
    bake_with(gatherer, map, options, monitor, None)
}

/// As [`bake_light`], of the lumels of these instances only (in rising order), so that a part of a
/// level is baked anew. The light is that of the whole level.
///
/// Noise is judged among these lumels alone. So their light differs from that of a whole bake by
/// less than its error, and has the same bytes if they are all lumels.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn bake_part(
    gatherer: &Gatherer,
    layout: &Layout,
    instances: &[usize],
    options: LightOptions,
    monitor: &dyn Monitor,
) -> Result<(LumelMap, LightReport), Cancelled> {
    let (world, rule) = (gatherer.world(), gatherer.options.interpolation);
    let map = LumelMap::of(world, layout, rule, instances.iter().copied());
    bake_with(gatherer, map, options, monitor, None)
}

/// As [`bake_light`], reusing the light that [`gather_shard`] put into `records`. The result does
/// not depend on which records exist.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn merge_light(
    gatherer: &Gatherer,
    layout: &Layout,
    options: LightOptions,
    records: &dyn Records,
    monitor: &dyn Monitor,
) -> Result<(LumelMap, LightReport), Cancelled> {
    let rule = gatherer.options.interpolation;
    let map = LumelMap::new(gatherer.world(), layout, rule);
    bake_with(gatherer, map, options, monitor, Some(records))
}

/// Gathers the light of a shard into `records`, with the passes of [`bake_light`] that do not need
/// all lumels.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn gather_shard(
    gatherer: &Gatherer,
    layout: &Layout,
    shard: &Shard,
    records: &dyn Records,
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let careful = &gatherer.options;
    let (instances, base) = shard.instances();
    let mut map = LumelMap::of(gatherer.world(), layout, careful.interpolation, instances);
    let mut work = Work::whole(monitor, careful.follow).shard(shard, base, records);
    gather_passes(gatherer, &mut map, &mut work)
}

/// The passes that a shard can run.
fn gather_passes(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    work: &mut Work,
) -> Result<(), Cancelled> {
    gather_first(gatherer, map, work)?;
    follow_edges(gatherer, map, work)?;
    if gatherer.options.open_only {
        map.barriers = Barriers::find(gatherer.world(), &map.lumels, &map.index, &map.received);
        work.see_walls(map);
    }
    add_rays(gatherer, map, work)
}

fn bake_with(
    gatherer: &Gatherer,
    mut map: LumelMap,
    options: LightOptions,
    monitor: &dyn Monitor,
    records: Option<&dyn Records>,
) -> Result<(LumelMap, LightReport), Cancelled> {
    let (world, careful) = (gatherer.world(), &gatherer.options);
    let mut report = LightReport::default();
    let work = Work::whole(monitor, careful.follow);
    let mut work = match records {
        None => work,
        Some(records) => work.rest(records),
    };
    gather_passes(gatherer, &mut map, &mut work)?;
    let fill = careful.open_only;
    // Hidden lumels take their neighbours' light.
    let finish = |map: &mut LumelMap| {
        if fill {
            fill_hidden(world, map, options.rings);
        }
    };
    if let Some(wanted) = options.error {
        let reached = reach(gatherer, &mut map, wanted, &finish, monitor)?;
        report.rounds = reached.rounds;
        report.exhausted_lumels = reached.exhausted;
    }
    let asked = options.error.is_some();
    settle(&mut map, careful.rays, gatherer.wanted.groups, asked);
    finish(&mut map);
    summarise(&map, &mut report);
    let reached = |x| report.estimated_error <= f64::from(x);
    let estimated = report.estimated_error.is_finite();
    report.error_reached = options.error.filter(|_| estimated).map(reached);
    Ok((map, report))
}

/// Light at vertices, from the lumels of `map`, and gathered separately where lumels are too large.
/// Instances whose lumels the map lacks get none.
/// `gatherer` is the one for lumels.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn bake_vertices(
    gatherer: &Gatherer,
    layout: &Layout,
    mut map: LumelMap,
    options: VertexOptions,
    monitor: &dyn Monitor,
) -> Result<(VertexLight, VertexReport), Cancelled> {
    // Means over lumels that a wall cuts are for measurements; vertices must not read them.
    let places = (gatherer.options.open_only).then(|| LumelPlace::find(&map));
    let light: Vec<LumelLight> = map.received.iter().map(LumelLight::of).collect();
    map.received = Vec::new();
    let vertices = VertexBake {
        world: gatherer.world(),
        layout,
        map: &map,
        light: &light,
        places: places.as_deref(),
        error: options.error,
    };
    // Vertices store a single colour.
    let gatherer = Gatherer {
        wanted: Wanted::default(),
        ..gatherer.with(options.gather)
    };
    vertices.run(&gatherer, monitor)
}

fn summarise(map: &LumelMap, report: &mut LightReport) {
    let (lumels, received) = (&map.lumels, &map.received);
    report.lumels = map.len() as u64;
    let (mut sum, mut weight) = ([0f64; 3], 0f64);
    for (l, r) in lumels.lumels.iter().zip(received) {
        report.lumel_rays += r.rays;
        report.edge_lumels += (r.edge == Edge::Contact) as u64;
        report.shadow_edge_lumels += (r.edge == Edge::Shadow) as u64;
        report.hidden_lumels += (r.open == 0.0) as u64;
        report.partly_hidden_lumels += (r.open > 0.0 && r.open < 1.0) as u64;
        let w = l.coverage as f64;
        let value = r.light() * std::f32::consts::FRAC_1_PI;
        for (s, v) in sum.iter_mut().zip(value.to_array()) {
            *s += v as f64 * w;
        }
        weight += w;
    }
    report.hidden = hidden_in(lumels, received);
    report.mean = sum.map(|s| s / weight.max(1e-300));
    let mut errors = relative_errors(lumels, received);
    if errors.is_empty() {
        (report.estimated_error, report.median_error) = (f64::NAN, f64::NAN);
        return;
    }
    report.estimated_error = mean_square(&errors).sqrt();
    let middle = errors.len() / 2;
    report.median_error = *errors.select_nth_unstable_by(middle, f64::total_cmp).1;
}

/// Hidden lumels of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct HiddenIn {
    /// Index into [`Scene::instances`](mesh_ingest::Scene::instances).
    pub instance: usize,
    /// Number of its lumels.
    pub lumels: u64,
    /// Number of those that are completely inside or right behind something.
    pub hidden: u64,
}

/// Most instances that are listed, starting with the most hidden lumels.
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
