//! The scenes, in the baker's own data structures.

use glam::{DAffine3, Vec3, Vec4};
use mesh_ingest::{AlphaMode, Instance, Material, Mesh, Primitive, Scene};

/// Adds the parallelogram `corner`, `corner + x`, `corner + x + y`, `corner + y`, front along
/// `x × y`.
fn add_quad(scene: &mut Scene, reflectance: f32, radiance: f32, [corner, x, y]: [Vec3; 3]) {
    scene.materials.push(Material {
        name: String::new(),
        gltf_material: None,
        base_color: Vec4::new(reflectance, reflectance, reflectance, 1.0),
        base_texture: None,
        emissive: Vec3::splat(radiance),
        emissive_texture: None,
        alpha: AlphaMode::Opaque,
        double_sided: false,
        ..Material::default()
    });
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
            positions: vec![corner, corner + x, corner + x + y, corner + y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            source_triangles: vec![0, 1],
            material: scene.materials.len() - 1,
            ..Primitive::default()
        }],
    });
}

/// The unit cube seen from inside, every face of reflectance `reflectance`; the ceiling z = 1
/// shines with exitance 1, so radiance 1/π.
pub(super) fn lit_cube(reflectance: f32) -> Scene {
    let mut scene = Scene::default();
    let (o, x, y, z) = (Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z);
    for (k, quad) in [
        [z, y, x],
        [o, x, y],
        [o, y, z],
        [x, z, y],
        [o, z, x],
        [y, x, z],
    ]
    .into_iter()
    .enumerate()
    {
        let radiance = if k == 0 {
            std::f32::consts::FRAC_1_PI
        } else {
            0.0
        };
        add_quad(&mut scene, reflectance, radiance, quad);
    }
    scene
}

/// Corners of the lamp of [`half_hidden_lamp`], seen from below.
pub(super) const LAMP: [Vec3; 4] = [
    Vec3::new(-0.5, -0.5, 1.0),
    Vec3::new(-0.5, 0.5, 1.0),
    Vec3::new(0.5, 0.5, 1.0),
    Vec3::new(0.5, -0.5, 1.0),
];
/// Height of the occluder's edge.
pub(super) const EDGE_HEIGHT: f32 = 0.5;
/// Direction of the occluder's edge, oblique to both axes: along a side of the lamp, stratified
/// points would do too well.
pub(super) const EDGE: Vec3 = Vec3::new(0.8, 0.6, 0.0);
/// From the edge to the side that the occluder leaves open.
pub(super) const OPEN: Vec3 = Vec3::new(-0.6, 0.8, 0.0);

/// Floor z = 0, a square lamp of 1 m² and exitance 1 above it, and between them a half-plane on the
/// far side of an oblique edge through (0, 0, ½).
pub(super) fn half_hidden_lamp() -> Scene {
    let mut scene = Scene::default();
    let quad = |c: Vec3, x: Vec3, y: Vec3| [c, x, y];
    add_quad(
        &mut scene,
        0.5,
        0.0,
        quad(Vec3::new(-4.0, -4.0, 0.0), Vec3::X * 8.0, Vec3::Y * 8.0),
    );
    add_quad(
        &mut scene,
        0.5,
        std::f32::consts::FRAC_1_PI,
        quad(LAMP[0], LAMP[1] - LAMP[0], LAMP[3] - LAMP[0]),
    );
    add_quad(
        &mut scene,
        0.0,
        0.0,
        quad(Vec3::Z * EDGE_HEIGHT - EDGE * 4.0, EDGE * 8.0, OPEN * -4.0),
    );
    scene
}
