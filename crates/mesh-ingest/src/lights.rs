//! `KHR_lights_punctual` with its extensions in `extras.lumel`, `EXT_lights_ies`, and
//! `EXT_lights_area`.

mod area;
mod cookie;
mod extras;
mod measured;

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DVec3, Vec3};

use self::cookie::Cookies;
use self::measured::Profiles;
use crate::document::Document;
use crate::error::{Fault, Faults, Outcome};
use crate::json::Item;
use crate::nodes::{Graph, Placed};
use crate::options::MAX_COORDINATE;
use crate::report::IngestReport;
use crate::scene::{LampMode, Light, LightKind, Scene};

/// Reads all lights of the chosen scene: `KHR_lights_punctual` in scene-graph order, then
/// `EXT_lights_ies`, then `EXT_lights_area`, whose lights become surfaces.
pub(crate) fn read_all(
    document: &mut Document,
    graph: &Graph,
    scene: &mut Scene,
    faults: &mut Faults,
    report: &mut IngestReport,
) {
    let mut profiles = Profiles::default();
    let mut cookies = Cookies::new(document);
    for placed in &graph.lights {
        let light = read(
            document,
            placed,
            scene.origin,
            &mut profiles,
            &mut cookies,
            report,
        );
        scene.lights.extend(faults.take(light).flatten());
        let mode = mode_of(document, placed, "KHR_lights_punctual", report);
        (scene.lamp_modes).extend(faults.take(mode).flatten().map(|m| (placed.node, m)));
    }
    for placed in &graph.measured_lights {
        let light = measured::read(document, placed, scene.origin, &mut profiles, report);
        scene.lights.extend(faults.take(light).flatten());
        let mode = mode_of(document, placed, "EXT_lights_ies", report);
        (scene.lamp_modes).extend(faults.take(mode).flatten().map(|m| (placed.node, m)));
    }
    for placed in &graph.area_lights {
        let added = area::add(document, placed, scene, report);
        faults.take(added);
    }
    scene.profiles = profiles.finish(document);
    scene.cookies = cookies.finish(document);
}

/// `extras.lumel.mode` of the light at `placed`, or of its node, which takes precedence.
fn mode_of(
    document: &Document,
    placed: &Placed,
    extension: &str,
    report: &mut IngestReport,
) -> Outcome<Option<LampMode>> {
    let root = document.root();
    let Some(ext) = root.extension(extension)? else {
        return Ok(None);
    };
    let item = ext.element("lights", placed.index)?;
    let node = root.element("nodes", placed.node)?;
    Ok(extras::mode([&node, &item], report))
}

/// Reads the punctual light at `placed`; `None` if it emits nothing. `origin` is [`Scene::origin`].
fn read(
    document: &Document,
    placed: &Placed,
    origin: DVec3,
    profiles: &mut Profiles,
    cookies: &mut Cookies,
    report: &mut IngestReport,
) -> Outcome<Option<Light>> {
    let root = document.root();
    let Some(ext) = root.extension("KHR_lights_punctual")? else {
        return Ok(None);
    };
    let item = ext.element("lights", placed.index)?;
    let kind = item.opt_str("type")?;
    let intensity = intensity_of(&item, "intensity", 1.0, report)?;
    let node = root.element("nodes", placed.node)?;
    let name = name_of(&item, &node);
    let places = [&node, &item];

    let position = placed.transform.translation - origin;
    // A light shines along −Z of its node; of the scale only the sign matters.
    let direction = placed
        .transform
        .transform_vector3(DVec3::NEG_Z)
        .try_normalize();
    let placeable = position.is_finite() && position.abs().max_element() <= MAX_COORDINATE;
    let range = || -> Outcome<Option<f32>> {
        Ok(item
            .opt_number("range")?
            .filter(|&r| r > 0.0)
            .map(|r| r as f32)
            .filter(|&r| r > 0.0))
    };
    let kind = match (kind, direction) {
        (Some("point"), _) if placeable => LightKind::Point {
            position: position.as_vec3(),
            range: range()?,
            radius: extras::radius(places, report),
        },
        (Some("directional"), Some(d)) => LightKind::Directional {
            direction: d.as_vec3(),
            angle: extras::half_angle(places, report),
        },
        (Some("spot"), Some(d)) if placeable => {
            let (inner, outer) = cone_of(&item, report)?;
            LightKind::Spot {
                position: position.as_vec3(),
                direction: d.as_vec3(),
                range: range()?,
                radius: extras::radius(places, report),
                inner,
                outer,
            }
        }
        (Some("point" | "directional" | "spot"), _) => {
            report.count("lights.unplaceable", 1);
            report.warn(
                node.path,
                "its transform gives the light no position or direction; the light is dropped",
            );
            return Ok(None);
        }
        (Some(other), _) => {
            report.count("lights.unknown_type", 1);
            report.warn(
                item.path_of("type"),
                format!("\"{other}\" is not a known light type; the light is dropped"),
            );
            return Ok(None);
        }
        (None, _) => {
            return Err(Fault::invalid(
                item.path_of("type"),
                "nothing",
                "point, spot or directional",
            ));
        }
    };
    let profile = match kind {
        LightKind::Directional { .. } => {
            extras::refuse(places, &["radius", "ies"], "directional light", report);
            None
        }
        LightKind::Point { .. } | LightKind::Spot { .. } => {
            extras::refuse(places, &["angle"], "point or spot light", report);
            extras::profile(document, places, placed, profiles, report)?
        }
    };
    let cookie = match kind {
        LightKind::Point { .. } => {
            let keys = ["cookie", "cookieSize"];
            extras::refuse(places, &keys, "point light", report);
            None
        }
        LightKind::Spot { .. } => {
            extras::refuse(places, &["cookieSize"], "spot light", report);
            cookie::read(document, places, placed, &kind, origin, cookies, report)?
        }
        LightKind::Directional { .. } => {
            cookie::read(document, places, placed, &kind, origin, cookies, report)?
        }
    };
    Ok(Some(Light {
        name,
        node: Some(placed.node),
        intensity,
        kind,
        profile,
        cookie,
    }))
}

/// The light's own name, else its node's.
fn name_of(item: &Item<'_>, node: &Item<'_>) -> String {
    Some(item.name())
        .filter(|n| !n.is_empty())
        .unwrap_or_else(|| node.name())
}

/// `color` × the member `key`, which are 1 and `default` if absent.
fn intensity_of(
    item: &Item<'_>,
    key: &str,
    default: f64,
    report: &mut IngestReport,
) -> Outcome<Vec3> {
    let color = item.opt_numbers::<3>("color")?.unwrap_or([1.0; 3]);
    let intensity = item.opt_number(key)?.unwrap_or(default);
    let asked = color.map(|c| c * intensity);
    let given = asked.map(|x| x.clamp(0.0, f64::from(f32::MAX)));
    if given != asked {
        report.count("lights.clamped", 1);
        report.warn(
            &item.path,
            format!("{color:?} × {intensity} is clamped to an intensity ≥ 0"),
        );
    }
    Ok(Vec3::from_array(given.map(|x| x as f32)))
}

/// Inner and outer half-angle: 0 ≤ inner < outer ≤ π/2, as the extension requires.
fn cone_of(item: &Item<'_>, report: &mut IngestReport) -> Outcome<(f32, f32)> {
    /// A cone without a penumbra would divide by zero in the extension's falloff formula.
    const MIN_PENUMBRA: f64 = 1e-4;
    let spot = item.opt_object("spot")?;
    let angle = |key: &str, default: f64| match &spot {
        Some(spot) => spot.opt_number(key).map(|x| x.unwrap_or(default)),
        None => Ok(default),
    };
    let asked = (
        angle("innerConeAngle", 0.0)?,
        angle("outerConeAngle", FRAC_PI_4)?,
    );
    let outer = asked.1.clamp(MIN_PENUMBRA, FRAC_PI_2);
    let inner = asked.0.clamp(0.0, outer - MIN_PENUMBRA);
    if (inner, outer) != asked {
        report.count("lights.cone_clamped", 1);
        report.warn(
            item.path_of("spot"),
            format!("cone angles {asked:?} are clamped to {inner}, {outer}"),
        );
    }
    Ok((inner as f32, outer as f32))
}
