//! Coarse meshes with the normals of the round shapes that they approximate.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::geometry::Geometry;
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};

/// A sphere around the origin with `n[0]` meridians and `n[1]` bands, fronts outside. Vertices are
/// on the sphere, shared, and have its normals.
pub fn uv_sphere(radius: f32, n: [u32; 2]) -> Geometry {
    let [meridians, bands] = n;
    let mut out = Geometry::default();
    let mut vertex = |polar: f32, azimuth: f32| {
        let d = Vec3::new(
            polar.sin() * azimuth.cos(),
            polar.cos(),
            polar.sin() * azimuth.sin(),
        );
        out.positions.push(d * radius);
        out.normals.push(d);
    };
    vertex(0.0, 0.0);
    for j in 1..bands {
        for i in 0..meridians {
            let (s, t) = (i as f32 / meridians as f32, j as f32 / bands as f32);
            vertex(PI * t, TAU * s);
        }
    }
    vertex(PI, 0.0);
    let south = out.positions.len() as u32 - 1;
    let at = |i: u32, j: u32| match j {
        0 => 0,
        j if j == bands => south,
        j => 1 + (j - 1) * meridians + i % meridians,
    };
    for j in 0..bands {
        for i in 0..meridians {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if j > 0 {
                out.triangles.push([a, b, c]);
            }
            if j + 1 < bands {
                out.triangles.push([a, c, d]);
            }
        }
    }
    out
}

/// The side of an upright prism with `n` faces around the y axis, from y = −`half` to `half`, in
/// `rows` rows, fronts outside, with the normals of the cylinder through its edges.
pub fn tube(radius: f32, half: f32, n: u32, rows: u32) -> Geometry {
    let mut out = Geometry::default();
    for j in 0..=rows {
        for i in 0..n {
            let d = Vec2::from_angle(TAU * i as f32 / n as f32);
            let y = half * (2.0 * j as f32 / rows as f32 - 1.0);
            out.positions.push(Vec3::new(d.x * radius, y, d.y * radius));
            out.normals.push(Vec3::new(d.x, 0.0, d.y));
        }
    }
    for j in 0..rows {
        for i in 0..n {
            let (a, b) = (j * n + i, j * n + (i + 1) % n);
            out.triangles.push([a, b + n, b]);
            out.triangles.push([a, a + n, b + n]);
        }
    }
    out
}

/// `g` with every vertex shared by its faces and with the mean of their normals (by area), as some
/// exporters write hard edges.
pub fn averaged(g: &Geometry) -> Geometry {
    let mut out = Geometry::default();
    let index = |p: Vec3, out: &mut Geometry| {
        let found = out.positions.iter().position(|q| *q == p);
        found.unwrap_or_else(|| {
            out.positions.push(p);
            out.normals.push(Vec3::ZERO);
            out.positions.len() - 1
        }) as u32
    };
    for t in &g.triangles {
        let corners = t.map(|i| g.positions[i as usize]);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let triangle = corners.map(|p| index(p, &mut out));
        for i in triangle {
            out.normals[i as usize] += normal;
        }
        out.triangles.push(triangle);
    }
    for n in &mut out.normals {
        *n = n.normalize();
    }
    out
}

/// One node whose surface emits `radiance` and reflects `rho`.
pub fn glowing(name: &str, g: &Geometry, radiance: f32, rho: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let material = b.material(&Material::emitter("glow", [radiance; 3], [rho; 3]));
    let mesh = b.mesh(name, &[(g, material)]);
    b.node(Node::of_mesh(name, mesh));
    b.finish()
}

/// Nodes of one part each, with reflectance `rho`, and `lights` at their places; a sun shines from
/// its place towards the origin.
pub fn lit(parts: &[(&str, &Geometry)], rho: f32, lights: &[(Light, Vec3)]) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [rho; 3]));
    for (name, g) in parts {
        let mesh = b.mesh(name, &[(g, grey)]);
        b.node(Node::of_mesh(name, mesh));
    }
    for (k, (light, at)) in lights.iter().enumerate() {
        let name = format!("light {k}");
        let light = b.light(&name, *light);
        b.node(Node {
            name,
            translation: *at,
            rotation: look_along((-*at).try_normalize().unwrap_or(Vec3::NEG_Y), Vec3::Y),
            light: Some(light),
            ..Node::default()
        });
    }
    b.finish()
}
