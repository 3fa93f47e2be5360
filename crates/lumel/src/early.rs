//! Checks and warnings before a bake begins.

use mesh_ingest::{Scene, Soup};
use radiosity::Sky;
use serde_json::Value;

use crate::error::Error;
use crate::settings::{BakeMode, Settings};
use crate::units::plain_blender;

/// Most lumels of a bake. Their pages alone (three halves per texel) take 6 GiB, and a bake needs
/// some hundred bytes per lumel.
const MOST_LUMELS: f64 = (1_u64 << 30) as f64;

/// Warns if the scene is black: no lamp, no emissive material in use, no sky.
pub(crate) fn no_light(scene: &Scene, soup: &Soup, sky: &Sky, document: &Value) -> Option<String> {
    let lamp = scene.lights.iter().any(|l| l.intensity.max_element() > 0.0);
    let glows = |m: &u32| {
        let material = &scene.materials[*m as usize];
        material.emissive.max_element() > 0.0 && !material.occluder_only
    };
    if lamp || !sky.is_black() || soup.materials[..soup.seen()].iter().any(glows) {
        return None;
    }
    let how = if plain_blender(document) {
        "tick Include > Data > Punctual Lights in Blender's exporter, which omits lamps by default, or"
    } else {
        "export lamps or"
    };
    Some(format!(
        "the lightmap will be black: the scene has no lamp, emissive material or sky; {how} pass --sky 0.5 or --sun"
    ))
}

/// Warns about a Blender file without lamps: the exporter omits them by default.
pub(crate) fn no_lamps(document: &Value) -> Option<String> {
    let used = document["extensionsUsed"].as_array();
    let lamps = used.is_some_and(|all| all.iter().any(|e| e == "KHR_lights_punctual"));
    (plain_blender(document) && !lamps).then(|| {
        "the file has no lamps: if the level has some in Blender, tick Include > Data > Punctual Lights in the exporter"
            .into()
    })
}

/// Settings that need another one, which is not set. A settings file may hold them for other bakes.
pub(crate) fn without_effect(settings: &Settings) -> Vec<String> {
    let marked = !settings.mixed.is_empty() || !settings.realtime.is_empty();
    let lamps = (marked && settings.mode == BakeMode::Full).then_some(
        "--mixed and --realtime have no effect without --mode: all light is in the lightmap",
    );
    let walkable = (!settings.walkable.is_empty() && !settings.cull_unseen)
        .then_some("--walkable has no effect without --cull-unseen");
    lamps
        .into_iter()
        .chain(walkable)
        .map(String::from)
        .collect()
}

/// Refuses a density that would give more than [`MOST_LUMELS`].
///
/// # Errors
/// [`Error::Setting`] with the largest possible density.
pub(crate) fn density(soup: &Soup, settings: &Settings) -> Result<(), Error> {
    let Some(wanted) = settings.texels_per_unit else {
        return Ok(());
    };
    let area: f64 = soup.areas.iter().map(|a| f64::from(*a)).sum();
    let lumels = area * f64::from(wanted).powi(2);
    if lumels <= MOST_LUMELS {
        return Ok(());
    }
    let most = (MOST_LUMELS / area).sqrt();
    Err(Error::Setting(format!(
        "--texels-per-unit {wanted}: found {lumels:.1e} lumels for the level's {area:.1} m², expected at most {MOST_LUMELS:.1e}, i.e. {most:.0} texels per unit"
    )))
}

/// Warns about an instance that does not fit a page at the requested density.
pub(crate) fn too_dense(scene: &Scene, soup: &Soup, settings: &Settings) -> Option<String> {
    let wanted = f64::from(settings.texels_per_unit?);
    let page = f64::from(settings.max_page).powi(2);
    let areas = soup.instance_ranges.iter().map(|[first, end]| {
        let areas = &soup.areas[*first as usize..*end as usize];
        areas.iter().map(|a| f64::from(*a)).sum::<f64>()
    });
    let (largest, area) = areas.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    if area * wanted * wanted <= page {
        return None;
    }
    Some(format!(
        "{:?} has {area:.1} m² and does not fit a page of {} texels at {wanted} texels per unit; its density will be reduced to below {:.1}; --max-page allows larger pages",
        scene.instances[largest].name,
        settings.max_page,
        (page / area).sqrt(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use serde_json::json;

    fn level() -> (Scene, Soup) {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb");
        let loaded = mesh_ingest::load(file.as_ref(), &Default::default()).expect("an asset");
        let soup = Soup::build(&loaded.scene);
        (loaded.scene, soup)
    }

    fn blender() -> Value {
        json!({"asset": {"generator": "Khronos glTF Blender I/O v5.0.21"}})
    }

    #[test]
    fn darkness_is_foretold_and_names_the_switch() {
        let (mut scene, soup) = level();
        let foretold = |scene: &Scene, sky: &Sky, doc: &Value| no_light(scene, &soup, sky, doc);
        assert_eq!(foretold(&scene, &Sky::Black, &Value::Null), None);
        for m in &mut scene.materials {
            m.emissive = Vec3::ZERO;
        }
        assert_eq!(
            foretold(&scene, &Sky::Constant(Vec3::ONE), &blender()),
            None
        );
        let said = foretold(&scene, &Sky::Black, &blender()).expect("black");
        assert!(said.contains("Punctual Lights"), "{said}");
        assert!(
            foretold(&scene, &Sky::Black, &Value::Null).is_some_and(|s| !s.contains("Blender"))
        );
    }

    #[test]
    fn a_level_from_blender_without_lamps_is_told() {
        assert!(no_lamps(&blender()).is_some());
        let mut with = blender();
        with["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        assert_eq!(no_lamps(&with), None);
        assert_eq!(no_lamps(&Value::Null), None);
    }

    #[test]
    fn options_without_effect_are_told() {
        let mut settings = Settings {
            mixed: vec!["sun".into()],
            walkable: vec!["floor".into()],
            ..Settings::default()
        };
        let said = without_effect(&settings);
        assert!(said[0].contains("--mode") && said[1].contains("--cull-unseen"));
        settings.mode = BakeMode::Indirect;
        settings.cull_unseen = true;
        assert!(without_effect(&settings).is_empty());
        assert!(without_effect(&Settings::default()).is_empty());
    }

    #[test]
    fn densities_that_cannot_be_had_are_told_before() {
        let (scene, soup) = level();
        let at = |x| Settings {
            texels_per_unit: Some(x),
            ..Settings::default()
        };
        assert!(density(&soup, &Settings::default()).is_ok() && density(&soup, &at(30.0)).is_ok());
        let error = density(&soup, &at(1e9)).expect_err("absurd").to_string();
        assert!(error.contains("expected at most"), "{error}");
        assert_eq!(too_dense(&scene, &soup, &at(30.0)), None);
        assert!(too_dense(&scene, &soup, &at(3000.0)).is_some());
    }
}
