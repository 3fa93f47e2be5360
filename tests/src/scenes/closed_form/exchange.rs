//! Plates, boxes and spheres that exchange light.

use std::f64::consts::PI;

use glam::Vec3;

use crate::geometry::{Geometry, box_faces, grid, icosphere, quad};
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};

/// Adds a node with one geometry of one material.
fn part(b: &mut GltfBuilder, name: &str, g: &Geometry, material: usize) {
    let mesh = b.mesh(name, &[(g, material)]);
    b.node(Node::of_mesh(name, mesh));
}

/// Two `a` × `b` rectangles (x, z) that face each other across `gap`, centred on the y axis: `lamp`
/// above emits `radiance` and reflects `rho[0]`, `plate` below reflects `rho[1]`.
///
/// If both are black, the mean of E on `plate` is πL × [`form_factor_opposed`]. If the gap is much
/// smaller than the sides, they are infinite plates away from the rim: E = πL/(1 − ρ₁ρ₂) on `plate`
/// and ρ₂ times that on `lamp`.
pub fn opposed_plates(radiance: f32, [a, b]: [f32; 2], gap: f32, rho: [f32; 2]) -> Vec<u8> {
    let mut out = GltfBuilder::new();
    let lamp = out.material(&Material::emitter("lamp", [radiance; 3], [rho[0]; 3]));
    let grey = out.material(&Material::diffuse("grey", [rho[1]; 3]));
    let corner = Vec3::new(-0.5 * a, 0.0, 0.5 * b);
    let up = grid(corner, Vec3::X * a, -Vec3::Z * b, [1, 1]).bare();
    let down = up.clone().flipped().moved(Vec3::Y * gap);
    part(&mut out, "plate", &up, grey);
    part(&mut out, "lamp", &down, lamp);
    out.finish()
}

/// F of opposed a × b rectangles at distance c (Howell, *A catalog of radiation heat transfer
/// configuration factors*, C-11): 2/(πXY) {½ ln[(1+X²)(1+Y²)/(1+X²+Y²)] + X√(1+Y²)
/// atan(X/√(1+Y²)) + Y√(1+X²) atan(Y/√(1+X²)) − X atan X − Y atan Y}.
pub fn form_factor_opposed(a: f64, b: f64, c: f64) -> f64 {
    let (x, y) = (a / c, b / c);
    let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let log = (p * q / (1.0 + x * x + y * y).sqrt()).ln();
    2.0 / (PI * x * y)
        * (log + x * q * (x / q).atan() + y * p * (y / p).atan() - x * x.atan() - y * y.atan())
}

/// A black floor `plate`, `width` deep and 1 m wide, with a wall `lamp` of `height` × 1 m along its
/// edge that emits `radiance`.
///
/// Mean of E on `plate` = πL × [`form_factor_perpendicular`].
pub fn perpendicular_plates(radiance: f32, width: f32, height: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let lamp = b.material(&Material::emitter("lamp", [radiance; 3], [0.0; 3]));
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let floor = grid(Vec3::ZERO, Vec3::Z, Vec3::X * width, [1, 1]).bare();
    let wall = grid(Vec3::ZERO, Vec3::Y * height, Vec3::Z, [1, 1]).bare();
    part(&mut b, "plate", &floor, black);
    part(&mut b, "lamp", &wall, lamp);
    b.finish()
}

/// F from a w × 1 rectangle to an h × 1 rectangle at right angles along the common edge 1 (Howell,
/// C-14).
pub fn form_factor_perpendicular(w: f64, h: f64) -> f64 {
    let (w2, h2) = (w * w, h * h);
    let s = w2 + h2;
    let log = ((1.0 + w2) * (1.0 + h2) / (1.0 + s)).ln()
        + w2 * (w2 * (1.0 + s) / ((1.0 + w2) * s)).ln()
        + h2 * (h2 * (1.0 + s) / ((1.0 + h2) * s)).ln();
    let atan = |x: f64| x * (1.0 / x).atan();
    (atan(w) + atan(h) - atan(s.sqrt()) + 0.25 * log) / (PI * w)
}

/// The inside of a black 1 m cube whose ceiling emits: nodes `ceiling`, `floor` (mean E = 0.199825
/// πL), `walls` (0.200044 πL).
pub fn lit_cube(radiance: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let lamp = b.material(&Material::emitter("lamp", [radiance; 3], [0.0; 3]));
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let [left, right, floor, ceiling, back, front] =
        box_faces(Vec3::ZERO, Vec3::ONE, 1).map(|g| g.flipped().bare());
    part(&mut b, "ceiling", &ceiling, lamp);
    part(&mut b, "floor", &floor, black);
    let walls = Geometry::union(&[left, right, back, front]);
    part(&mut b, "walls", &walls, black);
    b.finish()
}

/// A black sphere `inner` of radius `r` < 1 that emits `radiance`, in a sphere `outer` of radius 1
/// that reflects `rho`; facets as in [`icosphere`] level 3.
///
/// With a = A₁/A₂ (returned, for the facets): F₁₂ = 1, F₂₁ = a, F₂₂ = 1 − a, so E₂ = a πL/(1 − ρ(1
/// − a)) and E₁ = ρE₂.
pub fn concentric_spheres(radiance: f32, r: f32, rho: f32) -> (Vec<u8>, f64) {
    let inner = icosphere(Vec3::ZERO, r, 3);
    let outer = icosphere(Vec3::ZERO, 1.0, 3).flipped();
    let share = inner.area() / outer.area();
    let mut b = GltfBuilder::new();
    let lamp = b.material(&Material::emitter("lamp", [radiance; 3], [0.0; 3]));
    let grey = b.material(&Material::diffuse("grey", [rho; 3]));
    part(&mut b, "inner", &inner, lamp);
    part(&mut b, "outer", &outer, grey);
    (b.finish(), share)
}

/// CIE 171:2006, test case 5.8 (internal reflected component, diffuse surfaces): a closed cube of 4
/// m, reflectance `rho`, with an isotropic point source of 10,000 lm in its middle. Node `room`.
///
/// All of Φ is absorbed: mean E = Φ/(96 (1 − ρ)), of which Φρ/(96 (1 − ρ)) is reflected light (the
/// report's table 20).
pub fn cie_171_5_8(rho: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [rho; 3]));
    let room = Geometry::union(&box_faces(Vec3::ZERO, Vec3::splat(4.0), 1))
        .flipped()
        .bare();
    part(&mut b, "room", &room, grey);
    let lamp = b.light("lamp", Light::Point([(10_000.0 / (4.0 * PI)) as f32; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: Vec3::splat(2.0),
        light: Some(lamp),
        ..Node::default()
    });
    b.finish()
}

/// After CIE 171:2006, test case 5.7 (diffuse reflection with internal obstruction), with our own
/// dimensions: the report's figure is not available, and its table 19 is wrong (Ashdown, *CIE
/// 171:2006 – Errata*, 2016, who recommends the form factor to the unobstructed part of the
/// reflecting surface, as here).
///
/// A floor `s2` (0 ≤ x ≤ 4, |z| ≤ 2, reflectance `rho`) under vertical sunlight of `lux`; a wall
/// `s1_v` (x = 4, up to y = 3) and a canopy `s1_hz` (−3 ≤ x ≤ 0, y = 3, front down), both black and
/// out of the sun; and a black screen across the floor (x = 2, up to y = `screen`; no screen if
/// that is 0), which the sun passes edge on. E on wall and canopy is ρ·lux·F to the part of the
/// floor that they see: [`cie_171_5_7_seen`].
pub fn cie_171_5_7(lux: f32, rho: f32, screen: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [rho; 3]));
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let both = b.material(&Material {
        double_sided: true,
        ..Material::diffuse("screen", [0.0; 3])
    });
    let z = Vec3::Z * 4.0;
    let at = |x: f32, y: f32| Vec3::new(x, y, -2.0);
    let floor = grid(at(0.0, 0.0), z, Vec3::X * 4.0, [1, 1]).bare();
    let wall = grid(at(4.0, 0.0), z, Vec3::Y * 3.0, [1, 1]).bare();
    let canopy = grid(at(-3.0, 3.0), Vec3::X * 3.0, z, [1, 1]).bare();
    part(&mut b, "s2", &floor, grey);
    part(&mut b, "s1_v", &wall, black);
    part(&mut b, "s1_hz", &canopy, black);
    if screen > 0.0 {
        let g = grid(at(2.0, 0.0), z, Vec3::Y * screen, [1, 1]).bare();
        part(&mut b, "screen", &g, both);
    }
    let sun = b.light("sun", Light::Directional([lux; 3]));
    b.node(Node {
        name: "sun".into(),
        rotation: look_along(Vec3::NEG_Y, Vec3::Y),
        light: Some(sun),
        ..Node::default()
    });
    b.finish()
}

/// The part of the floor that the point (`x`, `y`, ·) of [`cie_171_5_7`] sees: intervals of the
/// floor's x. The screen hides a strip behind it, all along z, because lines between points within
/// |z| ≤ 2 stay within.
pub fn cie_171_5_7_seen(screen: f64, x: f64, y: f64) -> Vec<[f64; 2]> {
    if screen <= 0.0 {
        return vec![[0.0, 4.0]];
    }
    // Where the line from the point over the screen's edge meets the floor.
    let foot = if y > screen {
        x + (2.0 - x) * y / (y - screen)
    } else if x > 2.0 {
        f64::NEG_INFINITY
    } else {
        f64::INFINITY
    };
    let parts = if x > 2.0 {
        [[2.0, 4.0], [0.0, foot]]
    } else {
        [[0.0, 2.0], [foot, 4.0]]
    };
    parts.into_iter().filter(|[a, b]| b > a).collect()
}

/// A rectangle `a` × `b` (x, z) of radiance `radiance` at `height` over the middle of a black floor
/// of 4 m.
pub fn panel_over_floor(radiance: f32, a: f32, b: f32, height: f32) -> Vec<u8> {
    let (x, z) = (0.5 * a, 0.5 * b);
    let corners = [(-x, -z), (x, -z), (x, z), (-x, z)].map(|(x, z)| Vec3::new(x, height, z));
    over_floor(radiance, &quad(corners).bare())
}

/// A disc of radius `r` (as a regular polygon of `n` sides and the disc's area) at `height` over
/// the middle of a black floor of 4 m: E = [`disc_irradiance`].
pub fn disc_over_floor(radiance: f32, r: f32, height: f32, n: u32) -> Vec<u8> {
    let step = 2.0 * PI / f64::from(n);
    let r = f64::from(r) * (step / step.sin()).sqrt();
    let mut g = Geometry {
        positions: vec![Vec3::new(0.0, height, 0.0)],
        ..Geometry::default()
    };
    for k in 0..n {
        let (s, c) = (f64::from(k) * step).sin_cos();
        g.positions
            .push(Vec3::new((r * c) as f32, height, (r * s) as f32));
        // From +x towards +z is clockwise seen from above: the front looks down.
        g.triangles.push([0, k + 1, (k + 1) % n + 1]);
    }
    over_floor(radiance, &g)
}

fn over_floor(radiance: f32, lamp: &Geometry) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let floor = grid(
        Vec3::new(-2.0, 0.0, 2.0),
        Vec3::X * 4.0,
        Vec3::Z * -4.0,
        [1, 1],
    );
    part(&mut b, "floor", &floor.bare(), black);
    let glow = b.material(&Material::emitter("lamp", [radiance; 3], [0.0; 3]));
    part(&mut b, "lamp", lamp, glow);
    b.finish()
}

/// E at distance `a` from the axis of a disc of radius `r` and radiance L at height `h`, in a plane
/// parallel to it: πL/2 (1 − (a² + h² − r²)/√((a² + h² + r²)² − 4a²r²)) (Howell, B-12).
pub fn disc_irradiance(radiance: f64, r: f64, h: f64, a: f64) -> f64 {
    let (a2, h2, r2) = (a * a, h * h, r * r);
    let s = a2 + h2 + r2;
    0.5 * PI * radiance * (1.0 - (a2 + h2 - r2) / (s * s - 4.0 * a2 * r2).sqrt())
}

/// A black wall (`wall`, 1 m × 1 m, free on both z sides) on the middle of a black floor of `size`
/// metres, for a uniform sky: on the wall, E = πL/2 minus the light from below the floor's rim
/// (less than `2/size` of it); on a floor without a wall, E = πL.
pub fn wall_on_floor(size: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let h = 0.5 * size;
    let floor = grid(
        Vec3::new(-h, 0.0, h),
        Vec3::X * size,
        Vec3::Z * -size,
        [1, 1],
    );
    part(&mut b, "floor", &floor.bare(), black);
    let wall = grid(Vec3::new(-0.5, 0.0, 0.0), Vec3::X, Vec3::Y, [1, 1]);
    part(&mut b, "wall", &wall.bare(), black);
    b.finish()
}

/// A single black floor of 1 m, for a uniform sky: E = πL.
pub fn lone_floor() -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let floor = grid(Vec3::ZERO, Vec3::Z, Vec3::X, [1, 1]);
    part(&mut b, "floor", &floor.bare(), black);
    b.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn catalogue_values_that_everyone_quotes() {
        // To the published digits.
        assert!((form_factor_opposed(1.0, 1.0, 1.0) - 0.199_825).abs() < 5e-7);
        assert!((form_factor_perpendicular(1.0, 1.0) - 0.200_044).abs() < 5e-7);
        assert!((disc_irradiance(1.0, 1.0, 1.0, 0.0) - PI / 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_screen_hides_what_is_behind_it() {
        // From the wall's top (4, 3) over a screen of 1: the line meets the floor at 4 − 2·3/2 = 1.
        assert_eq!(cie_171_5_7_seen(1.0, 4.0, 3.0), [[2.0, 4.0], [0.0, 1.0]]);
        // From below the screen's edge, nothing beyond it is visible.
        assert_eq!(cie_171_5_7_seen(1.0, 4.0, 0.5), [[2.0, 4.0]]);
        // From the canopy (−1, 3): −1 + 3·3/2 = 3.5.
        assert_eq!(cie_171_5_7_seen(1.0, -1.0, 3.0), [[0.0, 2.0], [3.5, 4.0]]);
    }
}
