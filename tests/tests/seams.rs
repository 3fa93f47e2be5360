//! Lookups on both sides of chart borders agree, within a mesh, between meshes and between
//! instances.
//!
//! Errors are those of [`SeamReport`]: differences relative to the local light + 1 % of the mean.
//! The project promises 1 % for 99 % of all seams. The error before stitching, which is several
//! times that in every scene here, shows that stitching achieves it.

#![allow(
    clippy::print_stderr,
    reason = "figures for lab/seams.md, with --nocapture"
)]

use glam::Vec3;
use lumel::atlas_bake::{Layer, SeamReport};
use lumel::{Bake, LightGroup, Settings, SkySource};
use lumel_tests::geometry::{Geometry, cuboid, grid, quad};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use lumel_tests::scenes::smooth::{averaged, lit, tube, uv_sphere};
use serde_json::json;

use crate::common::{bake, lumels_of};
use crate::surfaces::edited;

/// The promised agreement.
const AGREED: f64 = 0.01;

fn lamp(x: f32, y: f32, z: f32) -> (Light, Vec3) {
    (Light::Point([3.0, 2.0, 1.0]), Vec3::new(x, y, z))
}

/// A piece of floor: corners by (x, z), clockwise as seen from above on a map with z down.
fn floor(corners: [[f32; 2]; 4]) -> Geometry {
    quad(corners.map(|[x, z]| Vec3::new(x, 0.0, z)))
}

/// A density, and stitching.
fn at(texels_per_unit: f32) -> Settings {
    Settings {
        stitch: true,
        ..crate::common::at(texels_per_unit)
    }
}

fn off(settings: &Settings) -> Settings {
    Settings {
        stitch: false,
        ..settings.clone()
    }
}

fn seams(name: &str, glb: &[u8], settings: &Settings) -> SeamReport {
    let report = bake(glb, settings).report.gather.seams;
    eprintln!("{name}: {report:?}");
    report
}

#[track_caller]
fn agrees(name: &str, glb: &[u8], settings: &Settings) -> SeamReport {
    let found = seams(name, glb, settings);
    assert!(found.samples > 50, "{name}: {found:?}");
    assert!(found.before.p99 > 3.0 * AGREED, "{name}: {found:?}");
    assert!(found.after.p99 <= AGREED, "{name}: {found:?}");
    assert!(found.moved_elsewhere < 0.01, "{name}: {found:?}");
    // Measured, but not changed.
    let not = seams(name, glb, &off(settings));
    assert_eq!((not.before, not.after), (found.before, found.before));
    assert_eq!((not.moved_near, not.moved_elsewhere), (0.0, 0.0));
    found
}

/// A rectangle and a slanted piece beside it, whose charts are at an angle to each other, under a
/// low lamp.
fn two_meshes() -> Vec<u8> {
    let left = floor([[-2.0, -1.0], [-2.0, 1.0], [0.0, 1.0], [0.0, -1.0]]);
    let right = floor([[0.0, -1.0], [0.0, 1.0], [1.1, 1.9], [1.6, 0.3]]);
    lit(
        &[("left", &left), ("right", &right)],
        0.5,
        &[lamp(0.4, 0.6, 0.2)],
    )
}

#[test]
fn two_meshes_that_meet_agree() {
    let found = agrees("two meshes", &two_meshes(), &at(8.0));
    assert!((found.metres - 2.0).abs() < 0.02, "{found:?}");
}

#[test]
fn curved_surfaces_agree() {
    let settings = Settings {
        sky: SkySource::Color([0.2; 3]),
        ..at(8.0)
    };
    let tube = tube(1.0, 1.0, 12, 1);
    let glb = lit(&[("tube", &tube)], 0.5, &[lamp(1.0, 0.5, 1.0)]);
    let found = seams("tube", &glb, &settings);
    assert!(found.samples > 20 && found.after.p99 <= AGREED, "{found:?}");
    // A sphere's charts are slit open; slits narrower than two texels stay as they are.
    let sphere = uv_sphere(1.0, [16, 12]);
    let glb = lit(&[("sphere", &sphere)], 0.5, &[lamp(1.0, 1.5, 1.0)]);
    let found = seams("sphere", &glb, &settings);
    assert!(found.samples > 50, "{found:?}");
    assert!(found.after.p99 <= 0.25 * found.before.p99, "{found:?}");
}

#[test]
fn sharp_folds_are_none_whatever_their_normals() {
    // Exporters average normals at hard edges. Each face has its own horizon, so light is
    // discontinuous and lookups may differ.
    let cube = averaged(&cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 1));
    let glb = lit(&[("cube", &cube)], 0.5, &[lamp(1.0, 1.5, 1.0)]);
    assert_eq!(seams("cube", &glb, &at(8.0)).samples, 0);
}

#[test]
fn what_goes_on_below_ground_is_none() {
    // A slope in two pieces, the lower one under the ground.
    let slope = |from: f32, to: f32| {
        quad([
            Vec3::new(from, 0.3 * from, -1.0),
            Vec3::new(from, 0.3 * from, 1.0),
            Vec3::new(to, 0.3 * to, 1.0),
            Vec3::new(to, 0.3 * to, -1.0),
        ])
    };
    let (lower, upper) = (slope(-1.0, 0.0), slope(0.0, 1.0));
    let ground = floor([[-3.0, -3.0], [-3.0, 3.0], [3.0, 3.0], [3.0, -3.0]]);
    let lights = [lamp(0.4, 0.6, 0.2)];
    let open = lit(&[("lower", &lower), ("upper", &upper)], 0.5, &lights);
    assert!(seams("open slope", &open, &at(8.0)).samples > 50);
    let parts = [("lower", &lower), ("upper", &upper), ("ground", &ground)];
    // The slope's shadow would cut the ground, which has seams then.
    let settings = Settings {
        cut_charts: false,
        ..at(8.0)
    };
    let buried = seams("buried slope", &lit(&parts, 0.5, &lights), &settings);
    assert_eq!(buried.samples, 0, "{buried:?}");
}

#[test]
fn instances_of_a_kit_agree_and_long_edges_meet_short_ones() {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let tile = grid(Vec3::ZERO, Vec3::Z, Vec3::X, [1, 1]);
    let tile = b.mesh("tile", &[(&tile, grey)]);
    let long = grid(Vec3::ZERO, Vec3::Z * 1.3, Vec3::X * 3.0, [1, 1]);
    let long = b.mesh("long", &[(&long, grey)]);
    for x in 0..3 {
        b.node(Node {
            translation: Vec3::new(x as f32, 0.0, -1.0),
            ..Node::of_mesh("tile", tile)
        });
    }
    b.node(Node::of_mesh("long", long));
    let light = b.light("lamp", Light::Point([1.0; 3]));
    b.node(Node {
        translation: Vec3::new(1.2, 0.5, -0.2),
        light: Some(light),
        ..Node::default()
    });
    // Not a whole number of texels per tile, so that no two tiles are cut alike.
    let found = agrees("kit", &b.finish(), &at(7.3));
    // Two seams between three tiles, and three of them along the long one.
    assert!((found.metres - 5.0).abs() < 0.05, "{found:?}");
}

/// Two floor tiles that meet at x = 0, a lamp over the left one, and a wall without thickness on
/// the joint.
fn tiles(wall: bool) -> Vec<u8> {
    let left = floor([[-1.0, -1.0], [-1.0, 1.0], [0.0, 1.0], [0.0, -1.0]]);
    let right = floor([[0.0, -1.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]]);
    let side = quad([
        Vec3::new(0.0, 0.0, 1.0),
        Vec3::new(0.0, 0.0, -1.0),
        Vec3::new(0.0, 3.0, -1.0),
        Vec3::new(0.0, 3.0, 1.0),
    ]);
    let mut parts = vec![("left", &left), ("right", &right)];
    if wall {
        parts.push(("wall", &side));
    }
    lit(&parts, 0.0, &[lamp(-0.7, 1.0, 0.0)])
}

/// The largest value of a node's rectangle, including dilated texels.
fn most_of(bake: &Bake, node: &str) -> f32 {
    let scene = &bake.loaded.scene;
    let i = (scene.instances.iter())
        .position(|i| i.name == node)
        .expect("the node");
    let place = bake.layout.placements[i];
    let page = &bake.baked.pages[place.page as usize];
    let r = place.rect;
    (r.y..r.y + r.h)
        .flat_map(|y| (r.x..r.x + r.w).map(move |x| (y * page.width + x) as usize))
        .flat_map(|at| page.value[at])
        .fold(0.0, f32::max)
}

#[test]
fn a_wall_on_the_joint_keeps_the_dark_side_dark() {
    let settings = at(8.0);
    let open = seams("no wall", &tiles(false), &settings);
    assert!(open.samples > 0 && open.moved_near > 0.0, "{open:?}");
    let (stitched, not) = (
        bake(&tiles(true), &settings),
        bake(&tiles(true), &off(&settings)),
    );
    assert_eq!(stitched.report.gather.seams.samples, 0);
    assert_eq!(most_of(&stitched, "right"), 0.0);
    assert!(most_of(&stitched, "left") > 0.1);
    assert_eq!(stitched.baked.pages[0].value, not.baked.pages[0].value);
}

/// A plate over the left one of two tiles, and light from straight above: E is 0 left of the seam
/// and 1 right of it.
fn shadow_on_a_seam(light: (Light, Vec3)) -> Vec<u8> {
    let left = floor([[-2.0, -1.0], [-2.0, 1.0], [0.0, 1.0], [0.0, -1.0]]);
    let right = floor([[0.0, -1.0], [0.0, 1.0], [2.0, 1.0], [2.0, -1.0]]);
    let mut plate = floor([[-3.0, -3.0], [-3.0, 3.0], [0.0, 3.0], [0.0, -3.0]]);
    plate.positions.iter_mut().for_each(|p| p.y = 1.0);
    let parts = [("left", &left), ("right", &right), ("plate", &plate)];
    lit(&parts, 0.0, &[light])
}

#[test]
fn a_suns_shadow_that_ends_on_a_seam_is_sharp() {
    let glb = shadow_on_a_seam((Light::Directional([1.0; 3]), Vec3::Y));
    for density in [8.0, 7.3] {
        let stitched = bake(&glb, &at(density));
        assert_eq!(stitched.report.gather.seams.samples, 0);
        for (name, exact) in [("left", 0.0), ("right", 1.0)] {
            for lumel in lumels_of(&stitched, name) {
                let red = lumel.red();
                assert!((red - exact).abs() < 1e-3, "{density} {name}: {red}");
            }
        }
    }
}

#[test]
fn a_lamps_shadow_that_ends_on_a_seam_is_sharp() {
    let far = (Light::Point([1e4; 3]), Vec3::Y * 100.0);
    check_shadow_on_a_seam(&shadow_on_a_seam(far), 0.0);
}

/// A sun with a picture, which is white: such lights have edges of their own, so only what is baked
/// tells that light jumps at the seam.
#[test]
fn a_jump_of_light_stays() {
    const WHITE: &str = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mP4DwABAQEAHLCMmQAAAABJRU5ErkJggg==";
    let plain = shadow_on_a_seam((Light::Directional([1.0; 3]), Vec3::Y));
    let glb = edited(&plain, |json| {
        json["images"] = json!([{ "uri": WHITE }]);
        json["textures"] = json!([{ "source": 0 }]);
        let sun = &mut json["extensions"]["KHR_lights_punctual"]["lights"][0];
        sun["extras"] = json!({ "lumel": { "cookie": 0 } });
    });
    check_shadow_on_a_seam(&glb, 2.0);
}

/// Stitching changes nothing, and finds jumps of this length, metres.
#[track_caller]
fn check_shadow_on_a_seam(glb: &[u8], jumps: f64) {
    // Whole lumels up to the seam, and some that it cuts.
    for density in [8.0, 7.3] {
        let settings = Settings {
            sky: SkySource::Color([0.01; 3]),
            ..at(density)
        };
        let [stitched, plain] = [settings.clone(), off(&settings)].map(|s| bake(glb, &s));
        let found = stitched.report.gather.seams;
        assert!(
            found.samples == 0 && (found.jumps - jumps).abs() < 1e-6,
            "{found:?}"
        );
        assert_eq!(
            stitched.baked.pages[0].value, plain.baked.pages[0].value,
            "{density}"
        );
        for (name, lamp) in [("left", 0.0), ("right", 1.0)] {
            for lumel in lumels_of(&stitched, name) {
                // The sky adds π/100 at most.
                let red = lumel.red() - lamp;
                assert!((-2e-3..0.032).contains(&red), "{density} {name}: {red}");
            }
        }
    }
}

#[test]
fn surfaces_that_coincide_by_the_hundred_are_not_stitched_each_to_each() {
    // 200 tiles on the left and 200 on the right, 0.04 mm above each other, so close that their
    // seams count as one place.
    const LAYERS: usize = 200;
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let tile = grid(Vec3::ZERO, Vec3::Z, Vec3::X, [1, 1]);
    let tile = b.mesh("tile", &[(&tile, grey)]);
    for i in 0..2 * LAYERS {
        b.node(Node {
            translation: Vec3::new((i % 2) as f32, 4e-5 * (i / 2) as f32, 0.0),
            ..Node::of_mesh("tile", tile)
        });
    }
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("scene.glb");
    std::fs::write(&path, b.finish()).expect("written");
    let found = lumel::estimate(&path, &at(4.0), &lumel::Silent).expect("an estimate");
    eprintln!("layers: {}", found.seam_samples);
    // Tiles of 4 texels, with 8 samples per texel. Each of the 400 meets at most four others; all
    // pairs would have 1.3 million.
    let most = 2 * LAYERS * 4 * 4 * 8;
    assert!(
        (1..=most).contains(&found.seam_samples),
        "{}",
        found.seam_samples
    );
}

#[test]
fn creases_are_no_seams() {
    let floor = floor([[-1.0, -1.0], [-1.0, 1.0], [0.0, 1.0], [0.0, -1.0]]);
    // Tilted by ten degrees, more than the eight up to which surfaces continue.
    let (s, c) = 10f32.to_radians().sin_cos();
    let ramp = quad([
        Vec3::new(0.0, 0.0, -1.0),
        Vec3::new(0.0, 0.0, 1.0),
        Vec3::new(c, s, 1.0),
        Vec3::new(c, s, -1.0),
    ]);
    let glb = lit(
        &[("floor", &floor), ("ramp", &ramp)],
        0.5,
        &[lamp(0.2, 1.0, 0.0)],
    );
    assert_eq!(seams("crease", &glb, &at(8.0)).samples, 0);
}

#[test]
fn parts_go_on_summing_to_the_light() {
    let left = floor([[-2.0, -1.0], [-2.0, 1.0], [0.0, 1.0], [0.0, -1.0]]);
    let right = floor([[0.0, -1.0], [0.0, 1.0], [1.1, 1.9], [1.6, 0.3]]);
    let post = quad([
        Vec3::new(-0.5, 0.0, 0.3),
        Vec3::new(0.5, 0.0, 0.3),
        Vec3::new(0.5, 0.8, 0.3),
        Vec3::new(-0.5, 0.8, 0.3),
    ]);
    let glb = lit(
        &[("left", &left), ("right", &right), ("post", &post)],
        0.7,
        &[lamp(0.4, 0.6, 0.9), lamp(-0.5, 0.7, -0.6)],
    );
    let settings = Settings {
        sky: SkySource::Color([0.1, 0.2, 0.3]),
        layers: vec![Layer::Direct, Layer::Indirect],
        groups: vec![LightGroup {
            name: "first".into(),
            sources: vec!["light 0".into()],
        }],
        ..at(8.0)
    };
    let bake = bake(&glb, &settings);
    let found = bake.report.gather.seams;
    assert!(found.moved_near > 0.01, "{found:?}");
    let baked = &bake.baked;
    assert_eq!(baked.groups.len(), 2);
    let page = &baked.pages[0];
    let mean = bake.report.gather.light.mean[0] as f32;
    for (i, value) in page.value.iter().enumerate() {
        for (c, &value) in value.iter().enumerate() {
            let layers = page.layers[c].1[i] + page.layers[3 + c].1[i];
            let groups: f32 = baked.groups.iter().map(|g| g[0].value[i][c]).sum();
            // A few roundings. Without stitching, groups are sums with other roundings, of light
            // that is partly larger.
            for sum in [layers, groups] {
                let apart = (sum - value).abs();
                assert!(apart <= 1e-6 * (value + mean), "{i} {c}: {sum} {value}");
            }
        }
    }
}

#[test]
fn the_same_bytes_for_one_and_two_threads() {
    let glb = two_meshes();
    let values = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| {
            let bake = bake(&glb, &at(8.0));
            let values: Vec<u32> = (bake.baked.pages.iter().flat_map(|p| &p.value))
                .flat_map(|v| v.map(f32::to_bits))
                .collect();
            (values, bake.report.gather.seams)
        })
    };
    assert!(values(1) == values(2));
}
