//! Layout of the whole lightmap: densities, charts by mesh, rectangles by instance, pages.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::Vec2;
use mesh_ingest::{Instance, Mesh, Primitive, Scene, Soup};
use rayon::prelude::*;
use serde::Serialize;
use thiserror::Error;

use crate::atlas::{Layout, MeshAtlas, Placement, PrimitiveAtlas, Rect, UvOrigin};
use crate::density::{Adjusted, DensityPlan, MeshDensity, plan, shape_in_lumels};
use crate::pack::pack_pages;
use crate::unwrap::{
    Cancel, KeptCharts, UnwrapError, UnwrapInput, UnwrapOptions, UnwrappedMesh, Unwrapper,
    UnwrapperChoice, kept, measure, unwrap_with_fallback,
};
use crate::uv_check::{OwnUvs, Severity, UvFault, UvMode, check_uvs};

/// A requested density that gives more lumels than this is warned about, because the bake takes
/// minutes. The default budget is a twentieth of it.
const MANY_LUMELS: f64 = 4e6;

/// Options of a layout.
#[derive(Debug, Clone, PartialEq)]
pub struct LayoutOptions {
    /// Lumels per metre on every mesh, multiplied by its node's density factor; `None` derives it
    /// from the budget.
    pub texels_per_unit: Option<f32>,
    /// Target number of lumels if no density is given.
    pub lumel_budget: u64,
    /// Longest side of a page in texels, ≥ 8.
    pub max_page: u32,
    /// Texels between charts, see [`UnwrapOptions::padding`].
    pub padding: u32,
    /// Rectangles and pages are aligned to blocks of this many texels, see
    /// [`UnwrapOptions::block`].
    pub block: u32,
    /// Whether charts are aligned to blocks too, see [`UnwrapOptions::block_charts`].
    pub block_charts: bool,
    /// Whether to use the asset's own coordinates.
    pub uv_mode: UvMode,
    /// The unwrapper for new coordinates.
    pub unwrapper: UnwrapperChoice,
}

impl Default for LayoutOptions {
    fn default() -> Self {
        LayoutOptions {
            texels_per_unit: None,
            lumel_budget: 200_000,
            max_page: 2048,
            padding: 2,
            block: 4,
            block_charts: false,
            uv_mode: UvMode::Auto,
            unwrapper: UnwrapperChoice::Auto,
        }
    }
}

/// Progress of a layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayoutProgress {
    /// Triangles of finished meshes.
    pub done: usize,
    /// Triangles of all meshes.
    pub total: usize,
}

/// Why a layout failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// The progress callback asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// An option is out of range.
    #[error("{option} must be {requirement}")]
    Option {
        /// The field of [`LayoutOptions`].
        option: &'static str,
        /// Its valid range.
        requirement: &'static str,
    },
    /// Every surface is an occluder or has density 0.
    #[error("no surface gets lumels: every one is an occluder or has density 0")]
    NothingReceives,
    /// A mesh could not be unwrapped.
    #[error("mesh {mesh} \"{name}\" cannot be unwrapped: {source}")]
    Unwrap {
        /// Index of the glTF mesh.
        mesh: usize,
        /// Its name.
        name: String,
        /// Error of the last unwrapper.
        source: UnwrapError,
    },
}

/// Report on a layout. Deterministic: it contains no times.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct LayoutReport {
    /// Lumels per metre of the scene.
    pub texels_per_unit: f32,
    /// Meshes of the scene that receive light.
    pub meshes: Vec<MeshReport>,
    /// Number of placed instances.
    pub instances: usize,
    /// Sizes of the pages in texels.
    pub pages: Vec<[u32; 2]>,
    /// Group name of each page, empty for pages without a group; absent if no page has a group.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub page_groups: Vec<String>,
    /// Number of texels covered by charts, over all instances (by area).
    pub lumels: f64,
    /// `lumels` divided by the pages' texels.
    pub coverage: f64,
    /// Number of charts; those of a mesh count once.
    pub charts: u64,
    /// Mean L² stretch of the meshes, weighted by the area of their instances; 1 means none.
    pub stretch: f64,
    /// Minimum, median and maximum lumels per metre over all surfaces, weighted by area; from a
    /// histogram with bins of 1 %.
    pub density: [f64; 3],
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

impl LayoutReport {
    /// Each page's size and group, for people: `512 x 256 (kitchen)`.
    pub fn describe_pages(&self) -> Vec<String> {
        let group = |i: usize| self.page_groups.get(i).filter(|g| !g.is_empty());
        (self.pages.iter().enumerate())
            .map(|(i, [w, h])| match group(i) {
                Some(group) => format!("{w} x {h} ({group})"),
                None => format!("{w} x {h}"),
            })
            .collect()
    }
}

/// Report on one mesh's charts.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MeshReport {
    /// Index of the glTF mesh.
    pub gltf_mesh: usize,
    /// Its name.
    pub name: String,
    /// Its first node with lumels.
    pub node: usize,
    /// That node's name.
    pub node_name: String,
    /// Number of instances that have lumels.
    pub instances: usize,
    /// Origin of its coordinates.
    pub origin: UvOrigin,
    /// The unwrapper that made them; absent if they were kept.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unwrapper: Option<&'static str>,
    /// Size of its rectangle in texels.
    pub size: [u32; 2],
    /// Number of charts.
    pub charts: u32,
    /// Chart area relative to the rectangle's.
    pub utilisation: f64,
    /// L² stretch; 1 means none.
    pub stretch: f64,
    /// Minimum, median and maximum lumels per metre on the instance that needs the most lumels.
    pub density: [f64; 3],
    /// That instance's density factor (`extras.lumel.density`).
    pub factor: f32,
    /// Length of smooth edges in lumels, see
    /// [`ChartMeasure::slits`](crate::unwrap::ChartMeasure::slits).
    pub slits: [f64; 4],
    /// Triangles that are mirrored in the chart (0 unless the coordinates were kept).
    pub flipped: u64,
    /// Triangles too thin to have any lightmap area.
    pub collapsed: u64,
    /// Why its density differs from the scene's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adjusted: Option<Adjusted>,
    /// Faults of the asset's own `TEXCOORD_1`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub uv_faults: Vec<UvFault>,
}

impl MeshReport {
    /// The mesh and its first node, for messages.
    pub fn label(&self) -> String {
        format!(
            "mesh {} \"{}\" (node {} \"{}\")",
            self.gltf_mesh, self.name, self.node, self.node_name
        )
    }
}

/// Plans the lightmap of `scene`.
///
/// `progress` is called from several threads, occasionally without any progress; returning `false`
/// stops the work within about a second. The result depends only on the scene and the options. A
/// mesh's coordinates depend only on the mesh, its density, and the scale and density factor of the
/// instance that needs the most lumels. Instances that differ too much to share charts should have
/// their own meshes ([`separate_unlike`](crate::separate_unlike)).
///
/// # Errors
/// [`LayoutError`].
pub fn layout(
    scene: &Scene,
    soup: &Soup,
    options: &LayoutOptions,
    progress: &(dyn Fn(LayoutProgress) -> bool + Sync),
) -> Result<(Layout, LayoutReport), LayoutError> {
    layout_kept(scene, soup, options, None, progress)
}

/// As [`layout`], with a store of charts: those of earlier layouts are reused, and new ones are
/// saved. The result is the same.
///
/// # Errors
/// [`LayoutError`].
pub fn layout_kept(
    scene: &Scene,
    soup: &Soup,
    options: &LayoutOptions,
    kept: Option<&dyn KeptCharts>,
    progress: &(dyn Fn(LayoutProgress) -> bool + Sync),
) -> Result<(Layout, LayoutReport), LayoutError> {
    validate(options)?;
    if !(0..scene.instances.len()).any(|i| scene.has_lumels(i)) {
        return Err(LayoutError::NothingReceives);
    }
    let plan = plan(scene, soup, options.texels_per_unit, options.lumel_budget);
    let total = scene.meshes.iter().map(triangle_count).sum();
    let done = AtomicUsize::new(0);
    let cancel = || {
        !progress(LayoutProgress {
            done: done.load(Ordering::Relaxed),
            total,
        })
    };
    let mut first_node = vec![None; scene.meshes.len()];
    for (i, instance) in scene.instances.iter().enumerate() {
        if scene.has_lumels(i) {
            first_node[instance.mesh].get_or_insert(instance);
        }
    }
    let results: Vec<Result<Option<LaidOut>, LayoutError>> = scene
        .meshes
        .par_iter()
        .zip(&plan.meshes)
        .enumerate()
        .map(|(i, (mesh, density))| {
            let task = Task {
                mesh,
                density,
                options,
                kept,
                node: first_node[i],
            };
            let result = lay_out_seen(scene, i, task, &cancel);
            done.fetch_add(triangle_count(mesh), Ordering::Relaxed);
            if cancel() {
                return Err(LayoutError::Cancelled);
            }
            result
        })
        .collect();
    let mut layout = Layout {
        texels_per_unit: plan.texels_per_unit,
        ..Layout::default()
    };
    let mut report = LayoutReport {
        texels_per_unit: plan.texels_per_unit,
        instances: plan.meshes.iter().map(|m| m.instances).sum(),
        ..LayoutReport::default()
    };
    for (result, mesh) in results.into_iter().zip(&scene.meshes) {
        let Some((atlas, mesh, warnings)) = result? else {
            layout.meshes.push(MeshAtlas {
                primitives: vec![PrimitiveAtlas::default(); mesh.primitives.len()],
                ..MeshAtlas::default()
            });
            continue;
        };
        layout.meshes.push(atlas);
        report.meshes.push(mesh);
        report.warnings.extend(warnings);
    }
    place_instances(scene, options, &mut layout);
    if cancel() {
        return Err(LayoutError::Cancelled);
    }
    summarise(&plan, &layout, options, &mut report);
    report.density = densities(scene, soup, &layout);
    Ok((layout, report))
}

fn validate(options: &LayoutOptions) -> Result<(), LayoutError> {
    let wrong = |option, requirement| {
        Err(LayoutError::Option {
            option,
            requirement,
        })
    };
    if options
        .texels_per_unit
        .is_some_and(|t| !(t.is_finite() && t > 0.0))
    {
        return wrong("texels_per_unit", "finite and above 0");
    }
    if !(8..=16384).contains(&options.max_page) {
        return wrong("max_page", "8 to 16384");
    }
    if options.padding > options.max_page / 4 {
        return wrong("padding", "at most a quarter of max_page");
    }
    if options.lumel_budget == 0 {
        return wrong("lumel_budget", "above 0");
    }
    Ok(())
}

fn triangle_count(mesh: &Mesh) -> usize {
    mesh.primitives.iter().map(|p| p.triangles.len()).sum()
}

/// Charts of a mesh, its report, and its warnings.
type LaidOut = (MeshAtlas, MeshReport, Vec<String>);

/// A mesh to be laid out.
#[derive(Clone, Copy)]
struct Task<'a> {
    mesh: &'a Mesh,
    density: &'a MeshDensity,
    options: &'a LayoutOptions,
    kept: Option<&'a dyn KeptCharts>,
    /// First instance with lumels.
    node: Option<&'a Instance>,
}

/// As [`lay_out_receiving`], without charts for triangles that nobody sees ([`Scene::unseen`]). An
/// asset's own coordinates are kept whole.
fn lay_out_seen(
    scene: &Scene,
    mesh: usize,
    task: Task<'_>,
    cancel: Cancel<'_>,
) -> Result<Option<LaidOut>, LayoutError> {
    let unseen = scene.unseen.get(mesh).map_or(&[][..], Vec::as_slice);
    let any = |flag: bool| unseen.iter().flatten().any(|u| *u == flag);
    if !any(true) || !any(false) {
        return lay_out_receiving(scene, task, cancel);
    }
    let mut own = task.mesh.clone();
    for (primitive, unseen) in own.primitives.iter_mut().zip(unseen) {
        keep(&mut primitive.triangles, unseen);
        keep(&mut primitive.source_triangles, unseen);
    }
    let charted =
        |p: &Primitive| !p.triangles.is_empty() && !scene.materials[p.material].occluder_only;
    let charted: Vec<bool> = own.primitives.iter().map(charted).collect();
    let mut flags = charted.iter();
    (own.primitives).retain(|_| flags.next().copied().unwrap_or(false));
    if own.primitives.is_empty() {
        return lay_out_receiving(scene, task, cancel);
    }
    let (mut atlas, report, warnings) = lay_out_mesh(Task { mesh: &own, ..task }, cancel)?;
    if atlas.origin == UvOrigin::Kept {
        return lay_out_receiving(scene, task, cancel);
    }
    let mut parts = std::mem::take(&mut atlas.primitives).into_iter();
    let point = parts
        .as_slice()
        .iter()
        .find_map(|p| Some((*p.uv.first()?, *p.chart.first()?)));
    let point = point.unwrap_or_default();
    atlas.primitives = (task.mesh.primitives.iter().enumerate())
        .map(|(k, primitive)| {
            let own = if charted[k] { parts.next() } else { None };
            if scene.materials[primitive.material].occluder_only {
                return PrimitiveAtlas::default();
            }
            with_culled(primitive, own.unwrap_or_default(), &unseen[k], point)
        })
        .collect();
    Ok(Some((atlas, report, warnings)))
}

/// Keeps the items that are seen.
fn keep<T>(items: &mut Vec<T>, unseen: &[bool]) {
    let mut flags = unseen.iter();
    items.retain(|_| !flags.next().copied().unwrap_or(false));
}

/// The charts of the visible triangles of `primitive`, with the others collapsed to a point.
fn with_culled(
    primitive: &Primitive,
    seen: PrimitiveAtlas,
    unseen: &[bool],
    (at, chart): (Vec2, u32),
) -> PrimitiveAtlas {
    let mut out = PrimitiveAtlas {
        xref: seen.xref,
        uv: seen.uv,
        culled: unseen.to_vec(),
        ..PrimitiveAtlas::default()
    };
    let mut rest = seen.triangles.into_iter().zip(seen.chart);
    let mut copies: BTreeMap<u32, u32> = BTreeMap::new();
    for (triangle, unseen) in primitive.triangles.iter().zip(unseen) {
        let kept = if *unseen { None } else { rest.next() };
        let (corners, chart) = kept.unwrap_or_else(|| {
            let corners = triangle.map(|v| {
                *copies.entry(v).or_insert_with(|| {
                    out.xref.push(v);
                    out.uv.push(at);
                    out.xref.len() as u32 - 1
                })
            });
            (corners, chart)
        });
        out.triangles.push(corners);
        out.chart.push(chart);
    }
    out
}

/// Lays out the primitives of a mesh that receive light; `None` if there are none, or if no
/// instance receives light.
fn lay_out_receiving(
    scene: &Scene,
    task: Task<'_>,
    cancel: Cancel<'_>,
) -> Result<Option<LaidOut>, LayoutError> {
    if task.density.instances == 0 {
        return Ok(None);
    }
    let receives: Vec<bool> = (task.mesh)
        .primitives
        .iter()
        .map(|p| !scene.materials[p.material].occluder_only)
        .collect();
    if receives.iter().all(|&r| r) {
        return lay_out_mesh(task, cancel).map(Some);
    }
    // This is rare, so a copy of the mesh is simpler than a separate list of primitives everywhere.
    let mut own = task.mesh.clone();
    let mut kept = receives.iter();
    own.primitives
        .retain(|_| kept.next().copied().unwrap_or(true));
    let (mut atlas, report, warnings) = lay_out_mesh(Task { mesh: &own, ..task }, cancel)?;
    let mut charted = std::mem::take(&mut atlas.primitives).into_iter();
    atlas.primitives = receives
        .iter()
        .map(|&r| {
            let own = if r { charted.next() } else { None };
            own.unwrap_or_default()
        })
        .collect();
    Ok(Some((atlas, report, warnings)))
}

fn lay_out_mesh(task: Task<'_>, cancel: Cancel<'_>) -> Result<LaidOut, LayoutError> {
    let Task {
        mesh,
        density,
        options,
        kept,
        node,
    } = task;
    if cancel() {
        return Err(LayoutError::Cancelled);
    }
    let wanted = density.texels_per_unit;
    // In units of lumels, so that the same mesh in other units, with matching density, gives the
    // same numbers.
    let input = Arc::new(UnwrapInput::from_mesh(
        mesh,
        shape_in_lumels(density.linear, wanted),
    ));
    let mut report = MeshReport {
        gltf_mesh: mesh.gltf_mesh,
        name: mesh.name.clone(),
        node: node.map_or(0, |i| i.node),
        node_name: node.map_or(String::new(), |i| i.name.clone()),
        instances: density.instances,
        factor: density.factor,
        adjusted: density.adjusted,
        ..MeshReport::default()
    };
    let label = report.label();
    let mut warnings = Vec::new();
    let mut origin = UvOrigin::Generated;
    let own = match options.uv_mode {
        UvMode::Generate => None,
        UvMode::Auto | UvMode::Keep => check_uvs(mesh, &input, options.max_page),
    };
    match own {
        Some(own) => {
            let verdict = judge(&own, options.uv_mode, &label, &mut warnings);
            report.uv_faults = own.faults;
            match (verdict, own.atlas) {
                (UvOrigin::Kept, Some(atlas)) => {
                    fill_report(&mut report, &input, &flat_view(&atlas), wanted);
                    report.origin = UvOrigin::Kept;
                    warn_density(&mut warnings, &label, wanted, wanted * own.reached);
                    return Ok((atlas, report, warnings));
                }
                (verdict, _) => origin = verdict,
            }
        }
        None if options.uv_mode == UvMode::Keep => {
            warnings.push(format!("{label}: found no TEXCOORD_1 to keep, made one"));
        }
        None => {}
    }
    let unwrap_options = UnwrapOptions {
        texels_per_unit: 1.0,
        padding: options.padding,
        block: options.block,
        block_charts: options.block_charts,
        max_size: options.max_page,
    };
    let unwrappers = options.unwrapper.candidates();
    let (flat, unwrapper, failures) = flatten(&unwrappers, &input, &unwrap_options, kept, cancel)
        .map_err(|source| match source {
        UnwrapError::Cancelled => LayoutError::Cancelled,
        source => LayoutError::Unwrap {
            mesh: mesh.gltf_mesh,
            name: mesh.name.clone(),
            source,
        },
    })?;
    warnings.extend(
        failures
            .iter()
            .map(|f| format!("{label}: {f}; {unwrapper} used")),
    );
    warn_density(&mut warnings, &label, wanted, wanted * flat.texels_per_unit);
    fill_report(&mut report, &input, &flat, wanted);
    report.origin = origin.clone();
    report.unwrapper = Some(unwrapper);
    Ok((assemble(mesh, &flat, origin), report, warnings))
}

/// The charts of `input` (stored ones if there are any), the unwrapper that made them, and why
/// others failed.
fn flatten(
    unwrappers: &[&'static dyn Unwrapper],
    input: &Arc<UnwrapInput>,
    options: &UnwrapOptions,
    kept: Option<&dyn KeptCharts>,
    cancel: Cancel<'_>,
) -> Result<(UnwrappedMesh, &'static str, Vec<String>), UnwrapError> {
    let store = kept
        .filter(|_| input.triangles.len() >= kept::LEAST_TRIANGLES)
        .map(|store| (store, kept::key(input, options, unwrappers)));
    if let Some((store, key)) = &store
        && let Some(bytes) = store.load(key)
        && let Some((flat, by)) = kept::from_bytes(&bytes, input, options)
        && let Some(unwrapper) = unwrappers.get(by)
    {
        store.used();
        return Ok((flat, unwrapper.name(), Vec::new()));
    }
    let result = unwrap_with_fallback(unwrappers, input, options, cancel)?;
    let (flat, unwrapper, failures) = &result;
    // Stored charts come without the warnings of unwrappers that failed.
    if let Some((store, key)) = store
        && failures.is_empty()
        && let Some(by) = unwrappers.iter().position(|u| u.name() == *unwrapper)
    {
        store.save(&key, &kept::to_bytes(flat, by));
    }
    Ok(result)
}

/// Whether the asset's own coordinates are kept; adds warnings for the user.
fn judge(own: &OwnUvs, mode: UvMode, label: &str, warnings: &mut Vec<String>) -> UvOrigin {
    let limit = match mode {
        UvMode::Keep => Severity::Unusable,
        UvMode::Auto | UvMode::Generate => Severity::Bad,
    };
    match own.worst().filter(|f| f.severity >= limit) {
        Some(fault) => {
            warnings.push(format!("{label}: TEXCOORD_1 replaced: {}", fault.message));
            UvOrigin::Replaced {
                why: fault.message.clone(),
            }
        }
        None => {
            let worth_saying = own.faults.iter().filter(|f| f.severity > Severity::Note);
            warnings.extend(
                worth_saying.map(|f| format!("{label}: TEXCOORD_1 kept, but {}", f.message)),
            );
            UvOrigin::Kept
        }
    }
}

fn warn_density(warnings: &mut Vec<String>, label: &str, wanted: f32, reached: f32) {
    if reached < wanted * 0.999 {
        warnings.push(format!(
            "{label}: density lowered from {wanted:.4} to {reached:.4} lumels per metre to fit the page"
        ));
    }
}

/// `texels_per_unit`: lumels per metre by which `input` was scaled.
fn fill_report(
    report: &mut MeshReport,
    input: &UnwrapInput,
    flat: &UnwrappedMesh,
    texels_per_unit: f32,
) {
    let measured = measure(input, flat);
    report.size = flat.size;
    report.charts = measured.charts;
    report.utilisation = measured.utilisation;
    report.stretch = measured.stretch;
    report.density = measured.density.map(|d| d * f64::from(texels_per_unit));
    report.slits = measured.slits;
    report.flipped = measured.flipped;
    report.collapsed = measured.collapsed;
}

/// A kept atlas in the form of an unwrapper's result.
fn flat_view(atlas: &MeshAtlas) -> UnwrappedMesh {
    let mut flat = UnwrappedMesh {
        size: atlas.size,
        charts: atlas.charts,
        ..UnwrappedMesh::default()
    };
    for p in &atlas.primitives {
        let corners = p.triangles.iter().map(|t| t.map(|v| p.uv[v as usize]));
        flat.corners.extend(corners);
        flat.chart.extend(&p.chart);
    }
    flat
}

/// Splits each primitive's vertices at chart borders: one new vertex per (vertex, chart, position),
/// in that order.
fn assemble(mesh: &Mesh, flat: &UnwrappedMesh, origin: UvOrigin) -> MeshAtlas {
    let mut first = 0;
    let primitives = mesh
        .primitives
        .iter()
        .map(|primitive| {
            let count = primitive.triangles.len();
            let corners = &flat.corners[first..first + count];
            let chart = &flat.chart[first..first + count];
            first += count;
            let mut keys: Vec<(u32, u32, [u32; 2], u32)> = Vec::with_capacity(count * 3);
            for (t, triangle) in primitive.triangles.iter().enumerate() {
                for k in 0..3 {
                    let bits = corners[t][k].to_array().map(f32::to_bits);
                    keys.push((triangle[k], chart[t], bits, (t * 3 + k) as u32));
                }
            }
            keys.par_sort_unstable();
            let mut atlas = PrimitiveAtlas {
                triangles: vec![[0; 3]; count],
                chart: chart.to_vec(),
                ..PrimitiveAtlas::default()
            };
            for run in keys.chunk_by(|x, y| (x.0, x.1, x.2) == (y.0, y.1, y.2)) {
                let new = atlas.xref.len() as u32;
                let (vertex, _, bits, _) = run[0];
                atlas.xref.push(vertex);
                atlas.uv.push(Vec2::from(bits.map(f32::from_bits)));
                for &(.., corner) in run {
                    atlas.triangles[corner as usize / 3][corner as usize % 3] = new;
                }
            }
            atlas
        })
        .collect();
    MeshAtlas {
        size: flat.size,
        primitives,
        charts: flat.charts,
        origin,
    }
}

/// Gives every instance that receives light a rectangle of its mesh's size. Page groups share no
/// page: pages without a group come first, then those of each group, by name.
fn place_instances(scene: &Scene, options: &LayoutOptions, layout: &mut Layout) {
    let mut groups: BTreeMap<Option<&str>, Vec<usize>> = BTreeMap::new();
    for i in (0..scene.instances.len()).filter(|&i| scene.has_lumels(i)) {
        groups.entry(scene.page_group(i)).or_default().push(i);
    }
    let nowhere = Rect {
        x: 0,
        y: 0,
        w: 0,
        h: 0,
    };
    layout.placements = vec![
        Placement {
            page: 0,
            rect: nowhere
        };
        scene.instances.len()
    ];
    let named = groups.keys().any(Option::is_some);
    for (name, receiving) in &groups {
        place_group(scene, options, receiving, layout);
        if named {
            let name = name.unwrap_or_default().to_string();
            layout.page_groups.resize(layout.pages.len(), name);
        }
    }
}

/// Appends pages for these instances.
fn place_group(scene: &Scene, options: &LayoutOptions, receiving: &[usize], layout: &mut Layout) {
    let lone = receiving.len() == 1;
    // Generated charts keep their distance from the rectangle's border; an asset's own may touch
    // it.
    let border = |mesh: usize| match layout.meshes[mesh].origin {
        UvOrigin::Kept if !lone => options.padding.div_ceil(2),
        _ => 0,
    };
    let max = options.max_page;
    let mesh_of = |i: usize| scene.instances[i].mesh;
    let sizes: Vec<[u32; 2]> = receiving
        .iter()
        .map(|&i| {
            let b = border(mesh_of(i));
            layout.meshes[mesh_of(i)].size.map(|s| (s + 2 * b).min(max))
        })
        .collect();
    let packed = pack_pages(&sizes, max, options.block).unwrap_or_default();
    let before = layout.pages.len() as u32;
    for ((&i, &(page, [x, y])), outer) in receiving.iter().zip(&packed.places).zip(&sizes) {
        let [w, h] = layout.meshes[mesh_of(i)].size;
        layout.placements[i] = Placement {
            page: before + page,
            rect: Rect {
                x: x + (outer[0] - w) / 2,
                y: y + (outer[1] - h) / 2,
                w,
                h,
            },
        };
    }
    layout.pages.extend(packed.pages);
}

fn summarise(
    plan: &DensityPlan,
    layout: &Layout,
    options: &LayoutOptions,
    report: &mut LayoutReport,
) {
    report.pages.clone_from(&layout.pages);
    report.page_groups.clone_from(&layout.page_groups);
    let receiving = plan.meshes.iter().filter(|m| m.instances > 0);
    let (mut area, mut greediest) = (0.0, (0.0, String::new()));
    for (mesh, density) in report.meshes.iter().zip(receiving) {
        let texels = f64::from(mesh.size[0]) * f64::from(mesh.size[1]);
        let lumels = mesh.utilisation * texels * density.instances as f64;
        let own_area = density.area * density.instances as f64;
        report.lumels += lumels;
        report.charts += u64::from(mesh.charts);
        report.stretch += own_area * mesh.stretch;
        area += own_area;
        if lumels > greediest.0 {
            greediest = (lumels, mesh.label());
        }
        if let Some(Adjusted::Huge) = density.adjusted {
            report.warnings.push(format!(
                "{} is huge ({:.0} m2) and gets {:.4} lumels per metre instead of {:.4}",
                mesh.label(),
                density.area,
                density.texels_per_unit,
                plan.texels_per_unit * density.factor
            ));
        }
    }
    report.stretch /= f64::max(area, f64::MIN_POSITIVE);
    let texels: f64 = layout
        .pages
        .iter()
        .map(|p| f64::from(p[0]) * f64::from(p[1]))
        .sum();
    report.coverage = report.lumels / texels.max(1.0);
    if let (Some(asked), true) = (options.texels_per_unit, report.lumels > MANY_LUMELS) {
        let (lumels, label) = greediest;
        report.warnings.push(format!(
            "{asked} lumels per metre give {:.1} million lumels, {:.1} million of them on {label}; unlike the automatic density, a requested one is not lowered on huge meshes (set extras.lumel.density on the node)",
            report.lumels * 1e-6,
            lumels * 1e-6
        ));
    }
}

/// Minimum, median and maximum lumels per metre over all surfaces with lumels, weighted by area.
fn densities(scene: &Scene, soup: &Soup, layout: &Layout) -> [f64; 3] {
    /// Bins per factor of e: 1 % each.
    const BINS: f64 = 100.0;
    /// Range of the histogram: ln(1e9) on either side of 1.
    const RANGE: f64 = 20.7;
    let mut area = vec![0.0f64; (2.0 * RANGE * BINS) as usize + 1];
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for (t, source) in soup.sources.iter().enumerate() {
        let instance = source.instance as usize;
        let mesh = scene.instances[instance].mesh;
        let primitive = &layout.meshes[mesh].primitives[source.primitive as usize];
        let corners = primitive.triangles.get(source.triangle as usize);
        let Some(corners) = corners.filter(|_| layout.placements[instance].rect.w > 0) else {
            continue;
        };
        let [a, b, c] = corners.map(|v| primitive.uv[v as usize].as_dvec2());
        let texels = 0.5 * (b - a).perp_dot(c - a).abs();
        let metres = f64::from(soup.areas[t]);
        let density = (texels / metres).sqrt();
        let at = (libm::log(density) + RANGE) * BINS;
        if at >= 0.0 && at < area.len() as f64 {
            area[at as usize] += metres;
            least = least.min(density);
            most = most.max(density);
        }
    }
    let half = 0.5 * area.iter().sum::<f64>();
    let mut seen = 0.0;
    let middle = area.iter().position(|a| {
        seen += a;
        seen >= half && seen > 0.0
    });
    match middle {
        Some(bin) => {
            let median = libm::exp((bin as f64 + 0.5) / BINS - RANGE);
            [least, median.clamp(least, most), most]
        }
        None => [0.0; 3],
    }
}
