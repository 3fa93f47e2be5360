//! `EXT_lights_image_based`: light from the surroundings.

mod cube;
mod harmonics;

use std::collections::BTreeSet;

use glam::{DQuat, DVec3};

use self::cube::Cube;
use crate::document::Document;
use crate::error::{Fault, Kind, Outcome};
use crate::images;
use crate::json::{Item, show};
use crate::report::IngestReport;
use crate::scene::{Environment, Image};
use crate::{hierarchy, nodes};

const NAME: &str = "EXT_lights_image_based";

/// The environment of the chosen scene, if any. `decoded` contains the images that materials need,
/// by index; others are decoded here and not kept. `projected` is the number of pixels of other
/// decoded pictures.
///
/// Missing or broken images are not an error: the irradiance coefficients, which every such light
/// has, replace them with a warning.
pub(crate) fn read(
    document: &mut Document,
    scene: Option<usize>,
    decoded: &[Option<Image>],
    projected: u64,
    report: &mut IngestReport,
) -> Outcome<Option<Environment>> {
    let root = document.root();
    let Some(chosen) = hierarchy::chosen_scene(&root, scene)? else {
        return Ok(None);
    };
    let Some(reference) = root.element("scenes", chosen)?.extension(NAME)? else {
        return Ok(None);
    };
    let ext = root.extension(NAME)?;
    let lights = match &ext {
        Some(ext) => ext.len_of("lights")?,
        None => 0,
    };
    let array = format!("extensions.{NAME}.lights");
    let (Some(ext), Some(index)) = (ext, reference.opt_index("light", &array, lights)?) else {
        return Ok(None);
    };
    let item = ext.element("lights", index)?;
    let name = item.name();
    let path = item.path.clone();
    let intensity = intensity_of(&item, report)?;
    let rotation = item
        .opt_numbers::<4>("rotation")?
        .unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let rotation = nodes::unit_quaternion(rotation).unwrap_or_else(|| {
        report.warn(
            item.path_of("rotation"),
            "a quaternion of length 0 is treated as no rotation",
        );
        DQuat::IDENTITY
    });
    let coefficients = coefficients_of(&item)?;
    let faces = faces_of(&item, root.len_of("images")?)?;

    let cube = match faces {
        None => Err("it has no specularImages".to_string()),
        Some(faces) => cube_of(document, faces, decoded, projected)?,
    };
    let (width, height, mut pixels) = match (cube, coefficients) {
        (Ok(cube), _) => {
            let (width, height) = cube.map_size();
            let pixels = cube.to_map(width, height, rotation);
            (width, height, pixels)
        }
        (Err(why), Some(coefficients)) => {
            report.count("environment.from_irradiance", 1);
            report.warn(
                &path,
                format!("{why}; its irradianceCoefficients give a blurred sky instead"),
            );
            let (map, clamped) = harmonics::to_map(&coefficients, rotation);
            if clamped > 0 {
                report.count("environment.clamped", clamped);
                report.warn(
                    &path,
                    "its irradianceCoefficients give a negative radiance in places, which is clamped to 0",
                );
            }
            (harmonics::WIDTH, harmonics::HEIGHT, map)
        }
        (Err(why), None) => {
            report.count("environment.dropped", 1);
            report.warn(
                &path,
                format!("{why}, and it has no irradianceCoefficients; its light is missing from the bake"),
            );
            return Ok(None);
        }
    };
    for pixel in &mut pixels {
        *pixel *= intensity;
    }
    Ok(Some(Environment {
        name,
        width,
        height,
        pixels,
    }))
}

fn intensity_of(item: &Item<'_>, report: &mut IngestReport) -> Outcome<f32> {
    let asked = item.opt_number("intensity")?.unwrap_or(1.0);
    // The largest decoded value is 255, so no product exceeds the range of f32.
    let given = asked.clamp(0.0, f64::from(f32::MAX) / 256.0);
    if given != asked {
        report.count("lights.clamped", 1);
        report.warn(
            item.path_of("intensity"),
            format!("{asked} is clamped to {given:e}"),
        );
    }
    Ok(given as f32)
}

/// Nine coefficients, one colour each.
fn coefficients_of(item: &Item<'_>) -> Outcome<Option<[DVec3; 9]>> {
    let Some(rows) = item.get("irradianceCoefficients") else {
        return Ok(None);
    };
    let wrong = || {
        Fault::invalid(
            rows.path.clone(),
            show(rows.value),
            "9 arrays of 3 numbers each",
        )
    };
    let list = rows.value.as_array().filter(|a| a.len() == 9);
    let mut out = [DVec3::ZERO; 9];
    for (row, out) in list.ok_or_else(wrong)?.iter().zip(&mut out) {
        let row = row.as_array().filter(|a| a.len() == 3).ok_or_else(wrong)?;
        for (c, value) in row.iter().enumerate() {
            out[c] = value
                .as_f64()
                .filter(|x| x.abs() <= f64::from(f32::MAX))
                .ok_or_else(wrong)?;
        }
    }
    Ok(Some(out))
}

/// The images of the sharpest level, +X, −X, +Y, −Y, +Z, −Z; `None` if there are none.
fn faces_of(item: &Item<'_>, images: usize) -> Outcome<Option<[usize; 6]>> {
    let Some(levels) = item.get("specularImages") else {
        return Ok(None);
    };
    let wrong = |found: String| {
        let expected = format!("arrays of 6 indices below {images}, the number of images");
        Fault::invalid(levels.path.clone(), found, expected)
    };
    let list = levels.value.as_array();
    let list = list.ok_or_else(|| wrong(show(levels.value)))?;
    let Some(first) = list.first() else {
        return Ok(None);
    };
    let indices: Option<Vec<usize>> = first.as_array().and_then(|a| {
        a.iter()
            .map(|v| usize::try_from(v.as_u64()?).ok().filter(|&i| i < images))
            .collect()
    });
    match indices.and_then(|i| <[usize; 6]>::try_from(i).ok()) {
        Some(faces) => Ok(Some(faces)),
        None => Err(wrong(show(first))),
    }
}

/// The cube of these images, or the reason why there is none.
///
/// # Errors
/// Only if a limit is exceeded.
fn cube_of(
    document: &mut Document,
    faces: [usize; 6],
    decoded: &[Option<Image>],
    projected: u64,
) -> Outcome<Result<Cube, String>> {
    let known = |i: usize| decoded.get(i).and_then(Option::as_ref);
    let missing: BTreeSet<usize> = faces.into_iter().filter(|&i| known(i).is_none()).collect();
    let spent = projected
        + decoded
            .iter()
            .flatten()
            .map(|i| i.pixels.len() as u64)
            .sum::<u64>();
    let own = match images::decode_all(document, &missing, spent) {
        Ok(own) => own,
        Err(fault) if matches!(fault.kind, Kind::Limit) => return Err(fault),
        Err(fault) => return Ok(Err(fault.problem.to_string())),
    };
    Ok(Cube::new(faces.map(|i| {
        // Each image is in one of the two lists.
        known(i).unwrap_or_else(|| &own[&i])
    })))
}
