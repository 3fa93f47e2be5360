//! The Cornell box.
//!
//! Geometry, spectra and camera: Cornell University Program of Computer Graphics, *Cornell Box
//! Data* (<https://www.graphics.cornell.edu/online/box/data.html>), measured in millimetres; first
//! described by Goral, Torrance, Greenberg and Battaile, *Modeling the Interaction of Light Between
//! Diffuse Surfaces*, 1984.

use glam::{Quat, Vec3};

use crate::geometry::{Geometry, quad};
use crate::gltf::{GltfBuilder, Material, Node};

/// One published unit (a millimetre) is a centimetre here, so the box is a room 5.5 m wide, for
/// which typical lightmap densities make sense. Irradiance does not change with scale.
const METRES_PER_UNIT: f32 = 0.01;

/// Lamp emission at 400, 500, 600 and 700 nm, as published (relative units; here W/(m² sr)).
const LAMP: [f64; 4] = [0.0, 8.0, 15.6, 18.4];

/// Reflectance of the white paint, 400 to 700 nm in steps of 4 nm, as published.
#[rustfmt::skip]
const WHITE: [f64; 76] = [
    0.343, 0.445, 0.551, 0.624, 0.665, 0.687, 0.708, 0.723, 0.715, 0.710, 0.745, 0.758, 0.739, 0.767, 0.777, 0.765,
    0.751, 0.745, 0.748, 0.729, 0.745, 0.757, 0.753, 0.750, 0.746, 0.747, 0.735, 0.732, 0.739, 0.734, 0.725, 0.721,
    0.733, 0.725, 0.732, 0.743, 0.744, 0.748, 0.728, 0.716, 0.733, 0.726, 0.713, 0.740, 0.754, 0.764, 0.752, 0.736,
    0.734, 0.741, 0.740, 0.732, 0.745, 0.755, 0.751, 0.744, 0.731, 0.733, 0.744, 0.731, 0.712, 0.708, 0.729, 0.730,
    0.727, 0.707, 0.703, 0.729, 0.750, 0.760, 0.751, 0.739, 0.724, 0.730, 0.740, 0.737,
];

/// Reflectance of the green paint, as [`WHITE`].
#[rustfmt::skip]
const GREEN: [f64; 76] = [
    0.092, 0.096, 0.098, 0.097, 0.098, 0.095, 0.095, 0.097, 0.095, 0.094, 0.097, 0.098, 0.096, 0.101, 0.103, 0.104,
    0.107, 0.109, 0.112, 0.115, 0.125, 0.140, 0.160, 0.187, 0.229, 0.285, 0.343, 0.390, 0.435, 0.464, 0.472, 0.476,
    0.481, 0.462, 0.447, 0.441, 0.426, 0.406, 0.373, 0.347, 0.337, 0.314, 0.285, 0.277, 0.266, 0.250, 0.230, 0.207,
    0.186, 0.171, 0.160, 0.148, 0.141, 0.136, 0.130, 0.126, 0.123, 0.121, 0.122, 0.119, 0.114, 0.115, 0.117, 0.117,
    0.118, 0.120, 0.122, 0.128, 0.132, 0.139, 0.144, 0.146, 0.150, 0.152, 0.157, 0.159,
];

/// Reflectance of the red paint, as [`WHITE`].
#[rustfmt::skip]
const RED: [f64; 76] = [
    0.040, 0.046, 0.048, 0.053, 0.049, 0.050, 0.053, 0.055, 0.057, 0.056, 0.059, 0.057, 0.061, 0.061, 0.060, 0.062,
    0.062, 0.062, 0.061, 0.062, 0.060, 0.059, 0.057, 0.058, 0.058, 0.058, 0.056, 0.055, 0.056, 0.059, 0.057, 0.055,
    0.059, 0.059, 0.058, 0.059, 0.061, 0.061, 0.063, 0.063, 0.067, 0.068, 0.072, 0.080, 0.090, 0.099, 0.124, 0.154,
    0.192, 0.255, 0.287, 0.349, 0.402, 0.443, 0.487, 0.513, 0.558, 0.584, 0.620, 0.606, 0.609, 0.651, 0.612, 0.610,
    0.650, 0.638, 0.627, 0.620, 0.630, 0.628, 0.642, 0.639, 0.657, 0.639, 0.635, 0.642,
];

/// Weights of linear Rec.709 R, G and B at `nm`: the CIE 1931 observer in the multi-lobe fit of
/// Wyman, Sloan and Shirley, *Simple Analytic Approximations to the CIE XYZ Color Matching
/// Functions*, JCGT 2(2), 2013, times the sRGB matrix.
fn rgb_weights(nm: f64) -> [f64; 3] {
    let lobe = |mean: f64, below: f64, above: f64| {
        let t = (nm - mean) / if nm < mean { below } else { above };
        (-0.5 * t * t).exp()
    };
    let x = 1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7)
        - 0.065 * lobe(501.1, 20.4, 26.2);
    let y = 0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1);
    let z = 1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8);
    [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ]
}

/// A spectrum at 400, 404, … 700 nm as linear RGB, relative to the equal-energy spectrum (which
/// becomes 1, 1, 1).
///
/// Rounded to three decimals, so that the last bit of the platform's `exp` does not reach the
/// asset.
fn to_rgb(spectrum: &[f64; 76]) -> [f32; 3] {
    let (mut sum, mut unit) = ([0.0; 3], [0.0; 3]);
    for (i, s) in spectrum.iter().enumerate() {
        for (k, w) in rgb_weights(400.0 + 4.0 * i as f64).into_iter().enumerate() {
            sum[k] += w * s;
            unit[k] += w;
        }
    }
    std::array::from_fn(|k| ((sum[k] / unit[k]).max(0.0) * 1000.0).round() as f32 / 1000.0)
}

/// Published reflectances in linear RGB: white, red, green.
pub fn reflectances() -> [[f32; 3]; 3] {
    [to_rgb(&WHITE), to_rgb(&RED), to_rgb(&GREEN)]
}

/// Published lamp emission in linear RGB, used as radiance in W/(m² sr).
pub fn lamp_radiance() -> [f32; 3] {
    to_rgb(&std::array::from_fn(|i| {
        let t = i as f64 * 4.0 / 100.0;
        let k = (t as usize).min(2);
        LAMP[k] + (LAMP[k + 1] - LAMP[k]) * (t - k as f64)
    }))
}

fn p(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(x, y, z) * METRES_PER_UNIT
}

/// The box as GLB: one mesh and node with primitives white, red, green and lamp, open at the front
/// (−Z) as published.
///
/// The lamp is in the ceiling's plane, and the ceiling is cut out around it, so that no surface is
/// hidden behind it. Everything else is as published, including the floor under the blocks (its
/// hidden lumels get exactly no light). Fronts face the room and the outside of the blocks. Node
/// names: `cornell_box`, `camera`.
pub fn cornell_box() -> Vec<u8> {
    let floor = quad([
        p(552.8, 0.0, 0.0),
        p(0.0, 0.0, 0.0),
        p(0.0, 0.0, 559.2),
        p(549.6, 0.0, 559.2),
    ]);
    let back = quad([
        p(549.6, 0.0, 559.2),
        p(0.0, 0.0, 559.2),
        p(0.0, 548.8, 559.2),
        p(556.0, 548.8, 559.2),
    ]);
    let right = quad([
        p(0.0, 0.0, 559.2),
        p(0.0, 0.0, 0.0),
        p(0.0, 548.8, 0.0),
        p(0.0, 548.8, 559.2),
    ]);
    let left = quad([
        p(552.8, 0.0, 0.0),
        p(549.6, 0.0, 559.2),
        p(556.0, 548.8, 559.2),
        p(556.0, 548.8, 0.0),
    ]);
    let ceiling = [
        p(556.0, 548.8, 0.0),
        p(556.0, 548.8, 559.2),
        p(0.0, 548.8, 559.2),
        p(0.0, 548.8, 0.0),
    ];
    let lamp = [
        p(343.0, 548.8, 227.0),
        p(343.0, 548.8, 332.0),
        p(213.0, 548.8, 332.0),
        p(213.0, 548.8, 227.0),
    ];
    // Four trapezoids between the ceiling's outline and the lamp's. They share corners, so there is
    // no T-junction.
    let rim = |i: usize| {
        let j = (i + 1) % 4;
        Geometry {
            positions: vec![ceiling[i], ceiling[j], lamp[j], lamp[i]],
            normals: vec![Vec3::NEG_Y; 4],
            uv: [ceiling[i], ceiling[j], lamp[j], lamp[i]]
                .iter()
                .map(|q| glam::Vec2::new(q.x, q.z))
                .collect(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Geometry::default()
        }
    };
    let mut white = Geometry::union(&[floor, back, rim(0), rim(1), rim(2), rim(3)]);
    white.append(&block(
        [(130.0, 65.0), (82.0, 225.0), (240.0, 272.0), (290.0, 114.0)],
        165.0,
    ));
    white.append(&block(
        [
            (423.0, 247.0),
            (265.0, 296.0),
            (314.0, 456.0),
            (472.0, 406.0),
        ],
        330.0,
    ));
    let [white_rgb, red_rgb, green_rgb] = reflectances();
    let mut b = GltfBuilder::new();
    let white_m = b.material(&Material::diffuse("white", white_rgb));
    let red_m = b.material(&Material::diffuse("red", red_rgb));
    let green_m = b.material(&Material::diffuse("green", green_rgb));
    // The lamp's own reflectance is published as 0.78.
    let lamp_m = b.material(&Material::emitter("lamp", lamp_radiance(), [0.78; 3]));
    let lamp = quad(lamp);
    let mesh = b.mesh(
        "cornell_box",
        &[
            (&white, white_m),
            (&left, red_m),
            (&right, green_m),
            (&lamp, lamp_m),
        ],
    );
    b.node(Node::of_mesh("cornell_box", mesh));
    // Published: at (278, 273, -800) looking along +z, focal length 0.035, film 0.025 × 0.025.
    let camera = b.camera("camera", 2.0 * (0.0125f32 / 0.035).atan(), 1.0);
    b.node(Node {
        name: "camera".into(),
        translation: p(278.0, 273.0, -800.0),
        rotation: Quat::from_xyzw(0.0, 1.0, 0.0, 0.0),
        camera: Some(camera),
        ..Node::default()
    });
    b.finish()
}

/// Top and four sides of a block whose top's corners (x, z) run as published.
fn block(top: [(f32, f32); 4], height: f32) -> Geometry {
    let at = |i: usize, y: f32| p(top[i % 4].0, y, top[i % 4].1);
    let mut out = quad([at(0, height), at(1, height), at(2, height), at(3, height)]);
    for i in 0..4 {
        out.append(&quad([
            at(i + 1, 0.0),
            at(i + 1, height),
            at(i, height),
            at(i, 0.0),
        ]));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_that_others_derive_from_the_same_spectra() {
        let [white, red, green] = reflectances();
        // Means of the published curves over each channel's band; 0.03 covers the width of the sRGB
        // primaries.
        for (got, want) in [
            (white, [0.74, 0.74, 0.73]),
            (red, [0.48, 0.05, 0.05]),
            (green, [0.09, 0.40, 0.08]),
        ] {
            for k in 0..3 {
                assert!((got[k] - want[k]).abs() < 0.03, "{got:?} {want:?}");
            }
        }
        let [r, g, b] = lamp_radiance();
        assert!(
            r > g && g > b && (15.0..20.0).contains(&r) && (2.0..4.0).contains(&b),
            "{r} {g} {b}"
        );
    }

    #[test]
    fn blocks_face_outside() {
        let b = block(
            [(130.0, 65.0), (82.0, 225.0), (240.0, 272.0), (290.0, 114.0)],
            165.0,
        );
        let centre = p(186.0, 82.5, 169.0);
        for t in &b.triangles {
            let [a, q, c] = t.map(|i| b.positions[i as usize]);
            assert!((q - a).cross(c - a).dot(a - centre) > 0.0);
        }
    }
}
