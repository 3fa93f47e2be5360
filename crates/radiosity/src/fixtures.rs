//! Hand-made scenes for the tests of this crate.

use glam::{DAffine3, DVec3, Vec3, Vec4};
use mesh_ingest::{AlphaMode, Instance, Light, Material, Mesh, Primitive, Scene};

/// A grey, single-sided material.
pub(crate) fn material(reflectance: f32, emissive: Vec3) -> Material {
    Material {
        name: String::new(),
        gltf_material: None,
        base_color: Vec4::new(reflectance, reflectance, reflectance, 1.0),
        base_texture: None,
        emissive,
        emissive_texture: None,
        alpha: AlphaMode::Opaque,
        double_sided: false,
        ..Material::default()
    }
}

/// Adds a one-primitive mesh with one instance; positions are world positions.
pub(crate) fn add_triangles(
    scene: &mut Scene,
    material: Material,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
) {
    scene.materials.push(material);
    scene.instances.push(Instance {
        node: scene.instances.len(),
        name: String::new(),
        copy: None,
        mesh: scene.meshes.len(),
        transform: DAffine3::IDENTITY,
        occluder: false,
        density: 1.0,
        stands_in: None,
        extras: None,
    });
    scene.meshes.push(Mesh {
        gltf_mesh: scene.meshes.len(),
        name: String::new(),
        primitives: vec![Primitive {
            positions,
            source_triangles: (0..triangles.len() as u32).collect(),
            triangles,
            material: scene.materials.len() - 1,
            ..Primitive::default()
        }],
    });
}

/// Adds the parallelogram `corner`, `corner + x`, `corner + x + y`, `corner + y` as two triangles;
/// its front is `x × y`.
pub(crate) fn add_quad(scene: &mut Scene, material: Material, corner: Vec3, x: Vec3, y: Vec3) {
    add_triangles(
        scene,
        material,
        vec![corner, corner + x, corner + x + y, corner + y],
        vec![[0, 1, 2], [0, 2, 3]],
    );
}

/// A floor and four grey walls around it, seen from inside, with these edges.
pub(crate) fn without_ceiling(x: f32, y: f32, z: f32) -> Scene {
    let mut scene = Scene::default();
    let (x, y, z) = (x * Vec3::X, y * Vec3::Y, z * Vec3::Z);
    let mut add = |corner, a, b| add_quad(&mut scene, material(0.5, Vec3::ZERO), corner, a, b);
    add(Vec3::ZERO, z, x);
    add(Vec3::ZERO, x, y);
    add(z, y, x);
    add(Vec3::ZERO, y, z);
    add(x, z, y);
    scene
}

/// The unit cube [0, 1]³ seen from inside, with one material and twelve triangles that share their
/// corners.
pub(crate) fn cube(reflectance: f32, emissive: Vec3) -> Scene {
    let mut scene = Scene {
        origin: DVec3::ZERO,
        ..Scene::default()
    };
    let corners = (0..8u32)
        .map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32))
        .collect();
    // Counter-clockwise from inside.
    let faces: [[u32; 4]; 6] = [
        [0, 2, 6, 4],
        [1, 5, 7, 3],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 1, 3, 2],
        [4, 6, 7, 5],
    ];
    let triangles = faces
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    add_triangles(
        &mut scene,
        material(reflectance, emissive),
        corners,
        triangles,
    );
    scene
}

/// A white punctual light.
pub(crate) fn light(intensity: f32, kind: mesh_ingest::LightKind) -> Light {
    Light {
        name: String::new(),
        node: None,
        intensity: Vec3::splat(intensity),
        kind,
        profile: None,
        cookie: None,
    }
}

/// A lamp in the unit cube, away from its centre.
pub(crate) fn lamp() -> Light {
    let kind = mesh_ingest::LightKind::Point {
        position: Vec3::new(0.4, 0.5, 0.7),
        range: None,
        radius: 0.0,
    };
    light(3.0, kind)
}

/// A sphere around the origin: an octahedron whose faces are split `level` times, with 8·4^level
/// facets and fronts inside or outside.
pub(crate) fn add_sphere(
    scene: &mut Scene,
    material: Material,
    radius: f32,
    level: u32,
    inside: bool,
) {
    let n = 1 << level;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    // The face of each octant is a triangular grid of directions, projected onto the sphere.
    for octant in 0..8u32 {
        let sign = |k: u32| if octant >> k & 1 == 0 { 1.0 } else { -1.0 };
        let axes = [Vec3::X * sign(0), Vec3::Y * sign(1), Vec3::Z * sign(2)];
        let flipped = (octant.count_ones() % 2 == 1) != inside;
        let base = positions.len() as u32;
        let row = |j: u32| base + j * (n + 1) - j * j.saturating_sub(1) / 2;
        for j in 0..=n {
            for i in 0..=n - j {
                let p = axes[0] * (n - i - j) as f32 + axes[1] * i as f32 + axes[2] * j as f32;
                positions.push(p.normalize() * radius);
            }
        }
        let mut add = |[a, b, c]: [u32; 3]| {
            triangles.push(if flipped { [a, c, b] } else { [a, b, c] });
        };
        for j in 0..n {
            for i in 0..n - j {
                add([row(j) + i, row(j) + i + 1, row(j + 1) + i]);
                if i + j + 1 < n {
                    add([row(j) + i + 1, row(j + 1) + i + 1, row(j + 1) + i]);
                }
            }
        }
    }
    add_triangles(scene, material, positions, triangles);
}
