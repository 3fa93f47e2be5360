use atlas::{Layout, MeshAtlas, Placement, PrimitiveAtlas, Rect};
use glam::{DAffine3, Vec2, Vec4};
use mesh_ingest::{AlphaMode, Instance, Material, Mesh, Primitive, Scene, Soup};
use visibility::{BuildOptions, Bvh};

use super::*;
use crate::manifest::ValueKind;

/// A 2 × 2 wall at z = 0 that faces +z. The left half of its lightmap is 1, the right half 3, and
/// its base colour is (1, 0.5, 0).
fn wall() -> (Scene, Layout, Vec<Page>) {
    let positions = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[x, y]: [f32; 2]| Vec3::new(x, y, 0.0));
    let uv = positions.map(|p| Vec2::new((p.x + 1.0) * 4.0, (1.0 - p.y) * 4.0));
    let triangles = vec![[0, 1, 2], [0, 2, 3]];
    let primitive = Primitive {
        positions: positions.to_vec(),
        triangles: triangles.clone(),
        source_triangles: vec![0, 1],
        ..Primitive::default()
    };
    let material = Material {
        name: String::new(),
        gltf_material: None,
        base_color: Vec4::new(1.0, 0.5, 0.0, 1.0),
        base_texture: None,
        emissive: Vec3::ZERO,
        emissive_texture: None,
        alpha: AlphaMode::Opaque,
        double_sided: false,
        ..Material::default()
    };
    let scene = Scene {
        meshes: vec![Mesh {
            primitives: vec![primitive],
            ..Mesh::default()
        }],
        instances: vec![Instance {
            node: 0,
            name: String::new(),
            copy: None,
            mesh: 0,
            transform: DAffine3::IDENTITY,
            occluder: false,
            density: 1.0,
            stands_in: None,
            extras: None,
        }],
        materials: vec![material],
        ..Scene::default()
    };
    let atlas = PrimitiveAtlas {
        xref: vec![0, 1, 2, 3],
        uv: uv.to_vec(),
        triangles,
        chart: vec![0, 0],
        ..PrimitiveAtlas::default()
    };
    let rect = Rect {
        x: 2,
        y: 1,
        w: 8,
        h: 8,
    };
    let layout = Layout {
        meshes: vec![MeshAtlas {
            size: [8, 8],
            primitives: vec![atlas],
            charts: 1,
            ..MeshAtlas::default()
        }],
        placements: vec![Placement { page: 0, rect }],
        pages: vec![[16, 16]],
        texels_per_unit: 4.0,
        ..Layout::default()
    };
    let value = (0..256)
        .map(|i| if i % 16 < 6 { [1.0; 3] } else { [3.0; 3] })
        .collect();
    let page = Page {
        width: 16,
        height: 16,
        value,
        coverage: vec![1.0; 256],
        ..Page::default()
    };
    (scene, layout, vec![page])
}

#[test]
fn rays_read_the_lightmap_as_an_engine_does() {
    let (scene, layout, pages) = wall();
    let soup = Soup::build(&scene);
    let bvh = Bvh::build(&soup.triangles, |_| false, &BuildOptions::default()).unwrap();
    let lit = LitScene {
        scene: &scene,
        soup: &soup,
        bvh: &bvh,
        light: PictureLight::Pages {
            layout: &layout,
            pages: &pages,
            value: ValueKind::Radiance,
        },
    };
    let at = |x: f32| lit.look(Vec3::new(x, 0.1, 5.0), -Vec3::Z, 0).color;
    assert!((at(-0.5) - Vec3::new(1.0, 0.5, 0.0)).abs().max_element() < 1e-5);
    assert!((at(0.5) - Vec3::new(3.0, 1.5, 0.0)).abs().max_element() < 1e-5);
    // Texel centres next to the step are at ∓1/8, so x = 0 is half-way between.
    assert!((at(0.0) - Vec3::new(2.0, 1.0, 0.0)).abs().max_element() < 1e-5);
    // From behind, a single-sided wall is invisible.
    assert_eq!(lit.look(Vec3::new(0.5, 0.1, -5.0), Vec3::Z, 0).alpha, 0.0);
    let irradiance = LitScene {
        light: PictureLight::Pages {
            layout: &layout,
            pages: &pages,
            value: ValueKind::Irradiance,
        },
        ..lit
    };
    let e = irradiance
        .look(Vec3::new(0.5, 0.1, 5.0), -Vec3::Z, 0)
        .color
        .x;
    assert!((e - 3.0 / std::f32::consts::PI).abs() < 1e-5);
}

#[test]
fn the_chosen_camera_sees_the_front_and_the_picture_is_the_same_for_any_number_of_threads() {
    let (scene, layout, pages) = wall();
    let soup = Soup::build(&scene);
    let bvh = Bvh::build(&soup.triangles, |_| false, &BuildOptions::default()).unwrap();
    let lit = LitScene {
        scene: &scene,
        soup: &soup,
        bvh: &bvh,
        light: PictureLight::Pages {
            layout: &layout,
            pages: &pages,
            value: ValueKind::Radiance,
        },
    };
    let picture = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let camera = choose_camera(&lit);
            assert!(
                camera.position.z > 0.0 && camera.forward.z < 0.0,
                "{camera:?}"
            );
            render_preview(&lit, &camera, [64, 36]).unwrap()
        })
    };
    let one = picture(1);
    assert!(one == picture(3));
    let image = image::load_from_memory(&one).unwrap().to_rgb8();
    assert_eq!(image.dimensions(), (64, 36));
    // The wall has no blue, the background does.
    assert!(image.pixels().any(|p| p.0[2] == 0 && p.0[0] > 60));
}

#[test]
fn pages_and_channels_become_pictures() {
    let (_, _, pages) = wall();
    let image = image::load_from_memory(&lightmap_png(&pages[0]).unwrap())
        .unwrap()
        .to_rgb8();
    assert!(image.get_pixel(0, 0).0[0] < image.get_pixel(10, 0).0[0]);
    let image =
        image::load_from_memory(&heat_png(&pages[0], &pages[0].coverage, [0.0, 1.0]).unwrap())
            .unwrap();
    assert_eq!(image.to_rgb8().get_pixel(0, 0).0, [255; 3]);
    assert!(heat_png(&pages[0], &[0.0], [0.0, 1.0]).is_err());
}
