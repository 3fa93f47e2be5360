//! Light at all lumels and vertices of a scene: the passes of a bake, in their order.

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

/// What was gathered at lumels.
#[derive(Debug, Clone, Default, Serialize)]
pub struct LightReport {
    /// Texels with a surface.
    pub lumels: u64,
    /// Lumels that lie wholly inside or right behind something single-sided: nearly all rays from
    /// there meet back faces.
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
    /// Mean of R over lumels, weighted by coverage (linear RGB).
    pub mean: [f64; 3],
    /// Estimated relative error: root mean square over lit lumels of standard error / (value + 1 %
    /// of the mean). Within a factor 1.5 of the true one on the scenes of lab/error.md. NaN (in
    /// JSON null) where no lumel is lit: nothing was measured.
    pub estimated_error: f64,
    /// Median over lit lumels of the same: what most of the map has; the root mean square is ruled
    /// by the worst corners. NaN as [`estimated_error`](Self::estimated_error) is.
    pub median_error: f64,
    /// Whether that is as small as [`LightOptions::error`] asked for; `None` where nothing was
    /// asked.
    pub error_reached: Option<bool>,
    /// Times that lumels were looked at again for it.
    pub rounds: u32,
    /// Lumels that have as many samples as they can and still too large an error.
    pub exhausted_lumels: u64,
}

/// Gathers light at all lumels of a layout: the passes of a bake, in their order.
///
/// Deterministic for any number of threads: every footprint is computed by itself, with random
/// numbers that hang on its place.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
pub fn bake_light(
    gatherer: &Gatherer,
    layout: &Layout,
    options: LightOptions,
    monitor: &dyn Monitor,
) -> Result<(LumelMap, LightReport), Cancelled> {
    let (world, careful) = (gatherer.world(), &gatherer.options);
    let mut report = LightReport::default();
    let mut map = LumelMap::new(world, layout, careful.interpolation);
    gather_first(gatherer, &mut map, monitor)?;
    follow_edges(gatherer, &mut map, monitor)?;
    let fill = careful.open_only;
    if fill {
        map.barriers = Barriers::find(world, &map.lumels, &map.index, &map.received);
    }
    add_rays(gatherer, &mut map, monitor)?;
    // What is hidden takes its neighbours' light.
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

/// Light at vertices, from the lumels of `map` and from footprints of their own where lumels are
/// too wide. `gatherer` is the one that lumels were gathered with.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
pub fn bake_vertices(
    gatherer: &Gatherer,
    layout: &Layout,
    mut map: LumelMap,
    options: VertexOptions,
    monitor: &dyn Monitor,
) -> Result<(VertexLight, VertexReport), Cancelled> {
    // A mean over what a wall parts is for measuring, not for reading.
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
    // Vertices hold one colour.
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
    /// Its lumels.
    pub lumels: u64,
    /// Those of them that lie wholly inside or right behind something.
    pub hidden: u64,
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
