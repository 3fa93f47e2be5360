//! Lumels and vertices of a whole scene, gathered and put into pages.

use glam::Vec3;
use radiosity::{Cancelled, DirectLight, Emitters, Monitor, Solution, World};
use serde::Serialize;

use crate::barriers::Barriers;
use crate::first::gather_first;
use crate::gather::Gatherer;
use crate::gltf_out::VertexLight;
use crate::hidden::fill_hidden;
use crate::manifest::ValueKind;
use crate::map::LumelMap;
use crate::options::GatherOptions;
use crate::page::Page;
use crate::pages::Pages;
use crate::planes::{Plane, Wanted};
use crate::reach::{mean_square, reach, relative_errors, settle};
use crate::received::Edge;
use crate::refine::{add_rays, follow_edges};
use crate::seams::SeamReport;
use crate::vertex_light::{LumelLight, LumelPlace, VertexBake, VertexReport};
use atlas::Layout;

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
    /// Gathers at lumels as these options say.
    pub(crate) fn gatherer<'w, 'a>(
        &self,
        world: &'w World<'a>,
        emitters: &'w Emitters,
        solution: &'w Solution,
    ) -> Gatherer<'w, 'a> {
        let options = GatherOptions {
            open_only: self.hidden == Hidden::Fill,
            ..self.lumels
        };
        let direct = DirectLight::new(world, emitters);
        Gatherer::new(world, solution, direct, options, self.wanted(world))
    }

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
    for p in world.soup.triangles.iter().flatten() {
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

/// Gathers light at all lumels and vertices: the passes of a bake, in their order.
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
    let mut out = Baked::default();
    let gatherer = options.gatherer(world, emitters, solution);
    let mut map = LumelMap::new(world, layout, options.lumels.interpolation);
    gather_first(&gatherer, &mut map, monitor)?;
    follow_edges(&gatherer, &mut map, monitor)?;
    let fill = options.hidden == Hidden::Fill;
    if fill {
        map.barriers = Barriers::find(world, &map.lumels, &map.index, &map.received);
    }
    add_rays(&gatherer, &mut map, monitor)?;
    // What is hidden takes its neighbours' light.
    let finish = |map: &mut LumelMap| {
        if fill {
            fill_hidden(world, map, options.padding + 1);
        }
    };
    if let Some(wanted) = options.error {
        let reached = reach(&gatherer, &mut map, wanted, &finish, monitor)?;
        out.report.rounds = reached.rounds;
        out.report.exhausted_lumels = reached.exhausted;
    }
    let wanted = gatherer.wanted;
    let asked = options.error.is_some();
    settle(&mut map, options.lumels.rays, wanted.groups, asked);
    finish(&mut map);
    summarise(&map, &mut out.report);
    let reached = |x| out.report.estimated_error <= f64::from(x);
    out.report.error_reached = options.error.map(reached);
    let pages = Pages {
        world,
        layout,
        lumels: &map.lumels,
        received: &map.received,
        options,
        wanted,
    };
    (out.pages, out.groups, out.report.seams) = pages.make();
    out.report.bytes = map.lumels.bytes()
        + gatherer.tracer.lit.bytes()
        + (map.len() * wanted.planes() * size_of::<Plane>()) as u64
        + (out.pages.iter().chain(out.groups.iter().flatten()))
            .map(|p| (p.value.len() * (16 + 4 * p.layers.len())) as u64)
            .sum::<u64>();
    if let Some(at_vertices) = options.vertices {
        // A mean over what a wall parts is for measuring, not for reading.
        let places = fill.then(|| LumelPlace::find(&map));
        let light: Vec<LumelLight> = map.received.iter().map(LumelLight::of).collect();
        map.received = Vec::new();
        let vertices = VertexBake {
            world,
            layout,
            map: &map,
            light: &light,
            places: places.as_deref(),
            error: options.vertex_error,
        };
        // Vertices hold one colour.
        let gatherer = Gatherer {
            options: at_vertices,
            wanted: Wanted::default(),
            ..gatherer
        };
        let (lit, report) = vertices.run(&gatherer, monitor)?;
        out.vertices = lit;
        out.report.vertices = Some(report);
    }
    Ok(out)
}

fn summarise(map: &LumelMap, report: &mut BakeReport) {
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
    report.mean = sum.map(|s| s / weight.max(1e-300));
    let mut errors = relative_errors(lumels, received);
    report.estimated_error = mean_square(&errors).sqrt();
    let middle = errors.len() / 2;
    if !errors.is_empty() {
        report.median_error = *errors.select_nth_unstable_by(middle, f64::total_cmp).1;
    }
}
