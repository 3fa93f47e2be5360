//! `lumel inspect`: what a bake would do, and every problem found.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use atlas::{LayoutReport, MeshReport, Severity, UvOrigin};
use atlas_bake::Paint;
use mesh_ingest::{IngestReport, LightKind, LodGroup, Soup, printable_within};
use radiosity::{Monitor, Sky, World, WorldOptions};
use serde::Serialize;

use crate::check::check;
use crate::cull;
use crate::early;
use crate::error::Error;
use crate::files::NamedFile;
use crate::named::some_of;
use crate::open::Changes;
use crate::page_groups;
use crate::pictures::Drawn;
use crate::plan::plan_layout;
use crate::report::clamped_warning;
use crate::scene_input::SceneInput;
use crate::settings::Settings;
use crate::sources::{Source, SourceKind, Sources};
use crate::warnings;

/// What is known about a scene before it is baked.
///
/// [`Baker::inspect`](crate::Baker::inspect) has an example.
#[derive(Debug, Clone, Serialize)]
pub struct Inspection {
    /// File name.
    pub scene: String,
    /// What was read, dropped, clamped and left out.
    pub ingest: IngestReport,
    /// Triangles left out in world space: of zero area, duplicates.
    pub dropped_triangles: [u64; 2],
    /// Size of the scene, metres.
    pub extent: [f32; 3],
    /// Surface area of the scene, m².
    pub area: f64,
    /// Emissive triangles.
    pub emissive_triangles: u64,
    /// Materials in use whose reflectance exceeds the settings' limit or their own.
    pub clamped_materials: u64,
    /// Descriptions of the lights.
    pub lights: Vec<String>,
    /// All light sources, by the names that options take.
    pub sources: Vec<Source>,
    /// Description of the scene's own sky.
    pub environment: Option<String>,
    /// Charts and pages that a bake with these settings would have.
    pub layout: LayoutReport,
    /// Warnings that a bake would give: overlapping nodes, missing light.
    pub warnings: Vec<String>,
}

/// Reads the scene and plans its lightmap; writes nothing.
///
/// # Errors
/// As [`bake`](crate::bake).
pub fn inspect(
    file: &Path,
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<Inspection, Error> {
    inspect_and_draw(file, settings, None, monitor).map(|(inspection, ..)| inspection)
}

/// As [`inspect`], and draws the charts as PNG files if `paint` is given. Also returns how many
/// pages and meshes were skipped because there are too many.
///
/// # Errors
/// As [`bake`](crate::bake).
pub fn inspect_and_draw(
    file: &Path,
    settings: &Settings,
    paint: Option<Paint>,
    monitor: &dyn Monitor,
) -> Result<(Inspection, Vec<NamedFile>, usize), Error> {
    check(settings)?;
    let mut loaded = SceneInput::File(file).load(settings, &Changes::default())?;
    let clamped_materials = loaded.scene.limit_reflectance(settings.max_reflectance);
    page_groups::assign(&mut loaded.scene, loaded.document.json(), settings)?;
    atlas::separate_unlike(&mut loaded.scene);
    let soup = Soup::build(&loaded.scene);
    cull::apply(&mut loaded.scene, &soup, settings)?;
    let scene = &loaded.scene;
    let (plan, layout) = plan_layout(file, scene, &soup, settings, None, monitor)?;
    let mut low = glam::Vec3::INFINITY;
    let mut high = glam::Vec3::NEG_INFINITY;
    for p in soup.triangles.iter().flatten() {
        low = low.min(*p);
        high = high.max(*p);
    }
    let glows = |t: usize| scene.materials[soup.materials[t] as usize].emissive != glam::Vec3::ZERO;
    let (pictures, left) = match paint {
        Some(paint) => {
            let drawn = Drawn {
                scene,
                soup: &soup,
                layout: &plan,
                report: &layout,
                paint,
            };
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            drawn.pictures(&stem, || monitor.cancelled())?
        }
        None => (Vec::new(), 0),
    };
    let world = World::build(scene, &soup, WorldOptions::default())
        .map_err(|e| Error::Internal(format!("cannot build the tree: {e}")))?;
    let mut warnings = warnings::of_geometry(&world, settings);
    if scene.environment.is_none() {
        let document = loaded.document.json();
        warnings.extend(early::no_light(scene, &soup, &Sky::Black, document));
    }
    let inspection = Inspection {
        warnings,
        scene: file
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        dropped_triangles: [soup.dropped_zero_area, soup.dropped_duplicate],
        extent: (high - low).max(glam::Vec3::ZERO).to_array(),
        area: soup.areas.iter().map(|&a| a as f64).sum(),
        emissive_triangles: (0..soup.triangles.len()).filter(|&t| glows(t)).count() as u64,
        clamped_materials,
        lights: scene.lights.iter().map(describe).collect(),
        sources: Sources::find(scene, loaded.document.json(), false).list(),
        environment: scene.environment.as_ref().map(describe_sky),
        ingest: loaded.report.clone(),
        layout,
    };
    Ok((inspection, pictures, left))
}

/// Describes levels of detail and variants in a line; `None` if there are none.
pub fn describe_lods(groups: &[LodGroup]) -> Option<String> {
    let plural = if groups.len() == 1 { "" } else { "s" };
    (!groups.is_empty()).then(|| {
        format!(
            "{} group{plural} of levels of detail or variants: {}; the first of each casts shadows and is lit, the others copy its light",
            groups.len(),
            some_of(groups.iter().map(LodGroup::describe))
        )
    })
}

fn describe(light: &mesh_ingest::Light) -> String {
    let i = light.intensity.max_element();
    let (mut kind, radius) = match light.kind {
        LightKind::Directional { angle, .. } => {
            let mut kind = format!("directional, {i} lx");
            if angle > 0.0 {
                kind += &format!(", disc of {:.2} degrees", 2.0 * angle.to_degrees());
            }
            (kind, 0.0)
        }
        LightKind::Point { radius, .. } => (format!("point, {i} cd"), radius),
        LightKind::Spot { outer, radius, .. } => {
            let degrees = 2.0 * outer.to_degrees();
            (format!("spot, {i} cd, {degrees:.0} degrees"), radius)
        }
    };
    if radius > 0.0 {
        kind += &format!(", radius {radius} m");
    }
    if light.profile.is_some() {
        kind += ", measured profile";
    }
    if light.cookie.is_some() {
        kind += ", cookie";
    }
    if light.name.is_empty() {
        kind
    } else {
        format!("{}: {kind}", light.name)
    }
}

/// Every name that options take, in alphabetical order, with its sources.
fn named(sources: &[Source]) -> BTreeMap<&str, Vec<String>> {
    let mut names: BTreeMap<&str, [usize; 3]> = BTreeMap::new();
    for s in sources {
        for name in [Some(&s.name), s.node.as_ref()].into_iter().flatten() {
            names.entry(name).or_default()[s.kind as usize] += 1;
        }
    }
    let kinds = [SourceKind::Light, SourceKind::Material, SourceKind::Sky];
    let words = |count: [usize; 3]| -> Vec<String> {
        let there = kinds.into_iter().filter(|k| count[*k as usize] > 0);
        there
            .map(|k| match (k, count[k as usize]) {
                (SourceKind::Light, 1) => "light".into(),
                (SourceKind::Light, n) => format!("{n} lights"),
                (SourceKind::Material, 1) => "material".into(),
                (SourceKind::Material, n) => format!("{n} materials"),
                (SourceKind::Sky, _) => "sky".into(),
            })
            .collect()
    };
    names.into_iter().map(|(n, c)| (n, words(c))).collect()
}

fn describe_sky(sky: &mesh_ingest::Environment) -> String {
    let size = format!("map of {} x {} pixels", sky.width, sky.height);
    if sky.name.is_empty() {
        size
    } else {
        format!("{}: {size}", sky.name)
    }
}

/// Collects text for people. Each call of `writeln!` gives exactly one line, whatever names
/// contain.
#[derive(Default)]
struct Lines(String);

impl Lines {
    fn write_fmt(&mut self, line: std::fmt::Arguments<'_>) -> std::fmt::Result {
        // Only `--json` has names in full.
        let line = line.to_string();
        let line = printable_within(line.strip_suffix('\n').unwrap_or(&line), 500);
        writeln!(self.0, "{line}")
    }
}

impl Inspection {
    /// The inspection as text for people.
    pub fn to_text(&self) -> String {
        let mut s = Lines::default();
        // Writing to a String cannot fail.
        let _ = self.write_text(&mut s);
        s.0
    }

    fn write_text(&self, s: &mut Lines) -> std::fmt::Result {
        let t = &self.ingest.totals;
        let [x, y, z] = self.extent;
        writeln!(s, "{}", self.scene)?;
        writeln!(
            s,
            "  size        {x:.3} x {y:.3} x {z:.3} m, surface {:.2} m2",
            self.area
        )?;
        writeln!(
            s,
            "  geometry    meshes {}, primitives {}, instances {}, triangles {} ({} unique)",
            t.meshes, t.primitives, t.instances, t.triangles_instanced, t.triangles
        )?;
        writeln!(s, "  materials   {}, images {}", t.materials, t.images)?;
        writeln!(
            s,
            "  light       emissive triangles {}, lamps {}",
            self.emissive_triangles,
            self.lights.len()
        )?;
        for light in &self.lights {
            writeln!(s, "              {light}")?;
        }
        for (k, (name, kinds)) in named(&self.sources).iter().enumerate() {
            let head = if k == 0 { "names" } else { "" };
            writeln!(s, "  {head:<11} {name} ({})", kinds.join(", "))?;
        }
        if let Some(sky) = &self.environment {
            writeln!(s, "  sky         {sky}")?;
        }
        if !self.ingest.extensions_used.is_empty() {
            writeln!(
                s,
                "  extensions  {}",
                self.ingest.extensions_used.join(", ")
            )?;
        }
        if let Some(lods) = describe_lods(&self.ingest.lods) {
            writeln!(s, "  lods        {lods}")?;
        }
        let pages = self.layout.describe_pages();
        writeln!(
            s,
            "  lightmap    {:.4} texels per metre, about {:.0} lumels, pages {} ({:.0} % used)",
            self.layout.texels_per_unit,
            self.layout.lumels,
            pages.join(", "),
            100.0 * self.layout.coverage
        )?;
        let [least, median, most] = self.layout.density;
        writeln!(
            s,
            "              {} charts, stretch {:.3}, lumels per metre {least:.3} to {most:.3}, median {median:.3}",
            self.layout.charts, self.layout.stretch
        )?;
        let kept = self
            .layout
            .meshes
            .iter()
            .filter(|m| m.origin == UvOrigin::Kept)
            .count();
        writeln!(
            s,
            "  uv          {kept} meshes keep their TEXCOORD_1, {} get new charts",
            self.layout.meshes.len() - kept
        )?;
        for m in &self.layout.meshes {
            write_faults(s, m)?;
        }
        write_charts(s, &self.layout.meshes)?;
        let mut problems: Vec<String> = Vec::new();
        for (what, n) in &self.ingest.counts {
            problems.push(format!("{what}: {n}"));
        }
        if self.dropped_triangles[0] > 0 {
            problems.push(format!(
                "zero-area world triangles: {}",
                self.dropped_triangles[0]
            ));
        }
        for w in &self.ingest.warnings {
            problems.push(format!("{}: {}", w.path, w.message));
        }
        for l in &self.ingest.left_out {
            problems.push(
                format!("nodes[{}] {:?} is left out: {:?}", l.node, l.name, l.reason)
                    .to_lowercase(),
            );
        }
        problems.extend(clamped_warning(self.clamped_materials));
        problems.extend(self.layout.warnings.iter().cloned());
        problems.extend(self.warnings.iter().cloned());
        if problems.is_empty() {
            writeln!(s, "  problems    none")?;
        } else {
            writeln!(s, "  problems    {}", problems.len())?;
            for p in problems {
                writeln!(s, "    - {p}")?;
            }
        }
        Ok(())
    }
}

/// Lists the faults of a mesh's own coordinates.
fn write_faults(s: &mut Lines, m: &MeshReport) -> std::fmt::Result {
    if m.uv_faults.is_empty() {
        return Ok(());
    }
    let fate = match m.origin {
        UvOrigin::Kept => "kept",
        UvOrigin::Generated | UvOrigin::Replaced { .. } => "replaced",
    };
    writeln!(s, "              {}: TEXCOORD_1 {fate}", m.label())?;
    for fault in &m.uv_faults {
        let word = match fault.severity {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Bad => "bad",
            Severity::Unusable => "unusable",
        };
        writeln!(s, "                {word}: {}", fault.message)?;
    }
    Ok(())
}

/// A table of the meshes with the most lumels.
fn write_charts(s: &mut Lines, meshes: &[MeshReport]) -> std::fmt::Result {
    /// Most lines that are worth reading; `--json` has all of them.
    const LINES: usize = 20;
    let lumels = |m: &MeshReport| {
        let texels = f64::from(m.size[0]) * f64::from(m.size[1]);
        texels * m.utilisation * m.instances as f64
    };
    let mut order: Vec<&MeshReport> = meshes.iter().collect();
    order.sort_by(|a, b| lumels(b).total_cmp(&lumels(a)));
    writeln!(
        s,
        "  charts      {:>9} {:>9} {:>6} {:>5} {:>7} {:>7}  {:<26}  mesh",
        "lumels", "texels", "charts", "used", "stretch", "factor", "lumels/m least median most"
    )?;
    for m in order.iter().take(LINES) {
        let [least, median, most] = m.density;
        let copies = if m.instances > 1 {
            format!(", {} times", m.instances)
        } else {
            String::new()
        };
        writeln!(
            s,
            "              {:>9.0} {:>9} {:>6} {:>4.0}% {:>7.3} {:>7}  {least:>8.3} {median:>8.3} {most:>8.3}  {} {:?}{copies}",
            lumels(m),
            format!("{}x{}", m.size[0], m.size[1]),
            m.charts,
            100.0 * m.utilisation,
            m.stretch,
            m.factor,
            m.gltf_mesh,
            m.name,
        )?;
    }
    if order.len() > LINES {
        writeln!(s, "              and {} more", order.len() - LINES)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};
    use mesh_ingest::{Environment, Light, PlacedProfile};

    use super::*;

    #[test]
    fn lights_are_told_with_their_sizes() {
        let light = |name: &str, kind, profile| Light {
            name: name.into(),
            node: None,
            intensity: Vec3::new(1.0, 5.0, 2.0),
            kind,
            profile,
            cookie: None,
        };
        let point = |radius| LightKind::Point {
            position: Vec3::ZERO,
            range: None,
            radius,
        };
        let sun = |angle| LightKind::Directional {
            direction: Vec3::NEG_Y,
            angle,
        };
        let worn = Some(PlacedProfile {
            profile: 0,
            from_world: Mat3::IDENTITY,
        });
        for (light, expected) in [
            (light("", point(0.0), None), "point, 5 cd"),
            (light("a", point(0.5), None), "a: point, 5 cd, radius 0.5 m"),
            (
                light("b", point(0.0), worn),
                "b: point, 5 cd, measured profile",
            ),
            (light("", sun(0.0), None), "directional, 5 lx"),
            (
                light("", sun(0.5f32.to_radians()), None),
                "directional, 5 lx, disc of 1.00 degrees",
            ),
        ] {
            assert_eq!(describe(&light), expected);
        }
        let sky = Environment {
            name: "dusk".into(),
            width: 2,
            height: 1,
            pixels: vec![Vec3::ONE; 2],
        };
        assert_eq!(describe_sky(&sky), "dusk: map of 2 x 1 pixels");
    }
}
