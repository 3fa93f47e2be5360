//! `EXT_lights_area`: rectangles and discs that emit from one side.
//!
//! Each becomes an emissive polygon, since light from a surface is what the bake knows best: the
//! closed form of a polygon times what shadow rays see. The polygon lets other light pass, because
//! area lights of tools and engines do not block light, and gets no lumels.
//!
//! Based on: KhronosGroup/glTF pull request 2525, draft of September 2025.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec2, DVec3, Vec3, Vec4};

use super::{extras, intensity_of, name_of};
use crate::document::Document;
use crate::error::{Fault, Outcome};
use crate::nodes::Placed;
use crate::options::MAX_COORDINATE;
use crate::report::IngestReport;
use crate::scene::{AlphaMode, Instance, Material, Mesh, Primitive, Scene};

/// The extension.
pub(super) const NAME: &str = "EXT_lights_area";

/// Corners of the polygon that stands for a disc, and has its area. From a quarter of the diameter
/// away, irradiance is within 0.02 % of a disc's; from a tenth, within 0.8 %. More corners would make
/// more triangles than are computed in closed form, and noise of 3 %.
const DISC_CORNERS: u32 = 16;

/// Alpha of the polygon: the share of other light that it absorbs. A fully transparent surface
/// would not emit. The radiance is divided by it.
const CLEAR: f32 = 0.01;

/// Distance of the polygon in front of the node, as a fraction of its size, so that a panel
/// modelled at the same place does not cover it.
const IN_FRONT: f64 = 1e-3;

/// An area light in its own plane.
struct Shape {
    /// Corners in metres of the world, counter-clockwise seen from the side that is lit.
    corners: Vec<DVec2>,
    size: f64,
}

/// Adds the surface of the area light at `placed` to the scene, which is recentred already.
pub(super) fn add(
    document: &Document,
    placed: &Placed,
    scene: &mut Scene,
    report: &mut IngestReport,
) -> Outcome<()> {
    let root = document.root();
    let Some(ext) = root.extension(NAME)? else {
        return Ok(());
    };
    let item = ext.element("lights", placed.index)?;
    let node = root.element("nodes", placed.node)?;
    let radiance = intensity_of(&item, "intensity", 1000.0, report)?;
    extras::refuse(
        [&node, &item],
        &["radius", "angle", "ies", "mode"],
        "area light",
        report,
    );
    let matrix = placed.transform.matrix3;
    let scale = (0..3).fold(0.0, |most, k| f64::max(most, matrix.col(k).length()));
    let size = item.opt_number("size")?.unwrap_or(1.0) * scale;
    let aspect = match item.opt_object("rect")? {
        Some(rect) => rect.opt_number("aspect")?.unwrap_or(1.0),
        None => 1.0,
    };
    let shape = match item.opt_str("type")? {
        Some("rect") => rectangle(size, aspect),
        Some("disk") => disc(size),
        Some(other) => {
            report.count("lights.unknown_type", 1);
            report.warn(
                item.path_of("type"),
                format!("\"{other}\" is not a known area light; the light is dropped"),
            );
            return Ok(());
        }
        None => {
            return Err(Fault::invalid(
                item.path_of("type"),
                "nothing",
                "rect or disk",
            ));
        }
    };
    let forward = matrix.mul_vec3(DVec3::NEG_Z).try_normalize();
    let sideways = forward.and_then(|d| matrix.col(0).reject_from_normalized(d).try_normalize());
    let position = placed.transform.translation - scene.origin;
    let near = position.is_finite() && position.abs().max_element() <= MAX_COORDINATE;
    let (Some(forward), Some(sideways), Some(shape), true) = (forward, sideways, shape, near)
    else {
        report.count("lights.unplaceable", 1);
        report.warn(
            node.path,
            "its transform, or the light's size, gives the light no place or no area; the light is dropped",
        );
        return Ok(());
    };
    let upwards = forward.cross(sideways);
    let corners = (shape.corners.iter())
        .map(|c| (sideways * c.x + upwards * c.y).as_vec3())
        .collect();
    let name = name_of(&item, &node);
    let surface = surface(corners, forward.as_vec3(), scene.materials.len());
    scene.materials.push(Material {
        name: name.clone(),
        base_color: Vec4::new(0.0, 0.0, 0.0, CLEAR),
        emissive: radiance / CLEAR,
        alpha: AlphaMode::Blend,
        ..Material::default()
    });
    scene.meshes.push(Mesh {
        gltf_mesh: Mesh::NOT_IN_DOCUMENT,
        name: name.clone(),
        primitives: vec![surface],
    });
    scene.instances.push(Instance {
        node: placed.node,
        name: node.name(),
        copy: None,
        mesh: scene.meshes.len() - 1,
        transform: DAffine3::from_translation(position + forward * (IN_FRONT * shape.size)),
        occluder: false,
        density: 0.0,
        stands_in: None,
        extras: None,
    });
    report.count("lights.area", 1);
    Ok(())
}

/// A fan of triangles around the first corner.
fn surface(corners: Vec<Vec3>, normal: Vec3, material: usize) -> Primitive {
    let count = corners.len() as u32;
    Primitive {
        normals: vec![normal; corners.len()],
        positions: corners,
        triangles: (1..count - 1).map(|i| [0, i, i + 1]).collect(),
        source_triangles: (0..count - 2).collect(),
        material,
        ..Primitive::default()
    }
}

/// Whether a length of the world can be used.
fn is_length(x: f64) -> bool {
    x > 0.0 && x <= MAX_COORDINATE && (x as f32) > 0.0
}

fn rectangle(height: f64, aspect: f64) -> Option<Shape> {
    let half = 0.5 * DVec2::new(height * aspect, height);
    let signs = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    (is_length(2.0 * half.x) && is_length(2.0 * half.y)).then(|| Shape {
        corners: signs
            .iter()
            .map(|(x, y)| half * DVec2::new(*x, *y))
            .collect(),
        size: 2.0 * half.min_element(),
    })
}

fn disc(diameter: f64) -> Option<Shape> {
    let step = TAU / f64::from(DISC_CORNERS);
    // n/2 r² sin(2π/n) = π (d/2)².
    let radius = 0.5 * diameter * (step / libm::sin(step)).sqrt();
    is_length(diameter).then(|| Shape {
        corners: (0..DISC_CORNERS)
            .map(|i| {
                let (sin, cos) = libm::sincos(step * f64::from(i));
                DVec2::new(cos, sin) * radius
            })
            .collect(),
        size: diameter,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(shape: &Shape) -> f64 {
        let c = &shape.corners;
        let twice: f64 = (0..c.len())
            .map(|i| c[i].perp_dot(c[(i + 1) % c.len()]))
            .sum();
        0.5 * twice
    }

    #[test]
    fn shapes_have_the_areas_of_the_extension() {
        // In f64, only rounding remains.
        let rectangle = rectangle(1.5, 2.0).expect("a rectangle");
        assert!((area(&rectangle) - 4.5).abs() < 1e-12);
        let disc = disc(1.2).expect("a disc");
        assert!((area(&disc) - 0.25 * std::f64::consts::PI * 1.44).abs() < 1e-12);
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-60] {
            assert!(
                super::disc(bad).is_none() && super::rectangle(1.0, bad).is_none(),
                "{bad}"
            );
        }
    }
}
