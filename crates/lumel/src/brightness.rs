//! Light beyond the range of numbers: refused before the bake, or warned about after it.

use atlas_bake::Page;
use glam::Vec3;
use mesh_ingest::Scene;
use radiosity::Sky;

use crate::error::Error;

/// The brightest light that is baked, in any channel: candela, lux or radiance. The sun's disc has
/// 1.6e9 nit and searchlights 1e9 candela. The squares that error estimates need, of values a
/// thousand times larger, are still far within the range of `f32`.
pub(crate) const BRIGHTEST: f32 = 1e12;

/// The largest half float, which is the limit of EXR pages.
const HALF: f32 = 65504.0;

/// Fraction of clamped lumels that gives a warning. A lamp at a wall clamps a few lumels, which
/// would look white anyway.
const WORTH_TELLING: f64 = 0.01;

/// Refuses sources brighter than [`BRIGHTEST`].
///
/// # Errors
/// [`Error::TooBright`], for the first of them.
pub(crate) fn check(scene: &Scene, sky: &Sky) -> Result<(), Error> {
    let sky = match sky {
        Sky::Constant(c) => *c,
        Sky::Map { pixels, .. } => pixels.iter().fold(Vec3::ZERO, |m, p| m.max(*p)),
        Sky::Black => Vec3::ZERO,
    };
    let named = |kind: &str, name: &str| match name {
        "" => format!("a {kind} without a name"),
        name => format!("the {kind} {name:?}"),
    };
    let lights = (scene.lights.iter()).map(|l| (named("light", &l.name), l.intensity));
    let materials = (scene.materials.iter()).map(|m| (named("material", &m.name), m.emissive));
    for (what, light) in lights.chain(materials).chain([("the sky".into(), sky)]) {
        if !light.is_finite() || light.max_element() > BRIGHTEST {
            return Err(Error::TooBright {
                what,
                value: light.max_element(),
            });
        }
    }
    Ok(())
}

/// The warning about pages with values beyond the half float range.
pub(crate) fn clamped_warning(pages: &[Page]) -> Option<String> {
    let (mut lit, mut clamped, mut brightest) = (0u64, 0u64, 0f32);
    let covered = pages
        .iter()
        .flat_map(|page| page.value.iter().zip(&page.coverage));
    for (value, _) in covered.filter(|(_, coverage)| **coverage > 0.0) {
        // NaN comes from overflow, so it counts as too bright.
        let beyond = value.iter().any(|x| x.is_nan() || *x > HALF);
        let most = value.iter().copied().fold(0.0, f32::max);
        lit += u64::from(beyond || most > 0.0);
        clamped += u64::from(beyond);
        brightest = brightest.max(most);
    }
    if clamped as f64 <= WORTH_TELLING * lit as f64 {
        return None;
    }
    Some(format!(
        "{clamped} of {lit} lit lumels exceed {HALF}, the largest half float, and are clamped to it; the brightest is {brightest:.3e}: scale all light by less than {:.1e} (--light '*=X', --sky-intensity)",
        HALF / brightest
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(values: &[f32]) -> Page {
        Page {
            width: values.len() as u32,
            height: 1,
            value: values.iter().map(|x| [*x, 0.0, 0.0]).collect(),
            coverage: vec![1.0; values.len()],
            layers: Vec::new(),
        }
    }

    #[test]
    fn clamped_lumels_are_told_of_where_they_are_many() {
        let mut values = vec![1.0; 200];
        assert_eq!(clamped_warning(&[page(&values)]), None);
        values[..2].fill(7e4);
        assert_eq!(clamped_warning(&[page(&values)]), None);
        values[..3].fill(655_040.0);
        let told = clamped_warning(&[page(&values)]).expect("three of 200");
        assert!(told.starts_with("3 of 200 lit lumels"), "{told}");
        assert!(
            told.contains("6.550e5") && told.contains("1.0e-1"),
            "{told}"
        );
        assert!(clamped_warning(&[page(&[f32::NAN, 0.0])]).is_some());
        assert_eq!(clamped_warning(&[page(&[0.0])]), None);
    }

    #[test]
    fn a_sky_is_judged_by_its_brightest_pixel() {
        let scene = Scene::default();
        let map = |x: f32| Sky::from((2, 1, vec![Vec3::ONE, Vec3::new(0.0, x, 0.0)]));
        assert!(check(&scene, &map(BRIGHTEST)).is_ok());
        for bad in [2.0 * BRIGHTEST, f32::NAN, f32::INFINITY] {
            let error = check(&scene, &Sky::Constant(Vec3::splat(bad))).expect_err("too bright");
            assert_eq!(error.exit_code(), 3);
        }
        assert!(check(&scene, &map(2.0 * BRIGHTEST)).is_err());
    }
}
