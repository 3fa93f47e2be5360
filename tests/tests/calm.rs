//! Wide open surfaces, where nine lumels of a cell of 8 × 8 tell the light of the others.

use glam::Vec3;
use lumel::{Quality, Settings, SkySource};
use lumel_tests::geometry::{cuboid, grid};
use lumel_tests::gltf::{GltfBuilder, Material, Node};

use crate::common::{at, bake, lumels_of};

/// Places along x of strips that hover above the ground. Samples a metre apart miss at least one.
const STRIPS: [f32; 3] = [7.6, 12.0, 16.35];

/// A black ground of 40 m under the sky, with a black box of a metre on it and black strips above.
pub fn ground() -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let corner = Vec3::new(-20.0, 0.0, 20.0);
    let shapes = [
        (
            "ground",
            grid(corner, Vec3::X * 40.0, Vec3::Z * -40.0, [1, 1]),
        ),
        (
            "box",
            cuboid(Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 1.0, 0.5), 1),
        ),
    ];
    let strip = |x: f32| {
        cuboid(
            Vec3::new(x - 0.025, 0.2, -6.0),
            Vec3::new(x + 0.025, 0.21, 6.0),
            1,
        )
    };
    let strips = STRIPS.map(|x| ("strip", strip(x)));
    for (name, shape) in shapes.into_iter().chain(strips) {
        let mesh = b.mesh(name, &[(&shape.bare(), black)]);
        b.node(Node::of_mesh(name, mesh));
    }
    b.finish()
}

#[test]
fn open_ground_needs_few_rays_and_keeps_its_shadows() {
    let settings = Settings {
        quality: Quality::Quick,
        sky: SkySource::Color([1.0; 3]),
        vertex_colors: false,
        ..at(4.0)
    };
    let bake = bake(&ground(), &settings);
    let report = &bake.report.gather.light;
    // Every second lumel in either direction, with 64 rays, were 16 rays a lumel.
    assert!(report.lumels > 25_000);
    let rays = report.lumel_rays as f64 / report.lumels as f64;
    assert!(rays < 12.0, "{rays} rays a lumel");
    let (mut far, mut beside, mut under) = ((0.0, 0.0f64), (0.0, 0.0), (0.0, 0.0f64));
    for l in lumels_of(&bake, "ground") {
        let p = l.middle();
        let light = l.red() / std::f64::consts::PI;
        let [x, z] = [p.x.abs(), p.z.abs()];
        let is_under = |strip: &f32| (p.x - f64::from(*strip)).abs() < 0.13;
        if x.max(z) > 6.0 && p.x < 6.5 {
            // From there the box covers less than a five hundredth of the sky's light.
            far = (far.0 + 1.0, far.1.max((light - 1.0).abs()));
        } else if (0.5..0.75).contains(&x) && z < 0.5 {
            beside = (beside.0 + 1.0, beside.1 + light);
        } else if z < 5.0 && STRIPS.iter().any(is_under) {
            under = (under.0 + 1.0, under.1.max(light));
        }
    }
    // `quick` aims at 5 %, and smoothing and cells take noise off.
    assert!(far.0 > 10_000.0 && far.1 < 0.02, "{far:?}");
    // A wall twice as high as wide, from an eighth of its height, hides 0.42.
    let beside = beside.1 / beside.0;
    assert!((0.53..0.65).contains(&beside), "{beside}");
    // A strip of 5 cm hides 0.07 of the light of a lumel of 25 cm that is 20 cm below its side. Half
    // of that is left for noise.
    assert!(under.0 > 100.0 && under.1 < 0.965, "{under:?}");
}
