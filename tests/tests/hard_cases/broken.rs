//! Files with broken numbers: dropped and counted, or refused with a reason; the rest is baked
//! correctly.

use glam::{Vec2, Vec3, Vec4};
use lumel::{Bake, Error, Settings, Silent};
use lumel_tests::geometry::{Geometry, grid};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node, look_along};
use serde_json::Value;

use crate::common::{at, lumels_of};

/// A floor of 4 × 4 cells with all attributes, under a sun of 2 lux straight down.
fn floor(extra: &[[u32; 3]]) -> Vec<u8> {
    let mut g: Geometry = grid(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0, [4, 4]);
    let n = g.positions.len();
    g.uv = (0..n)
        .map(|i| Vec2::new(i as f32 / n as f32, 0.5))
        .collect();
    g.colors = vec![Vec4::ONE; n];
    g.triangles.extend_from_slice(extra);
    sunlit(&g)
}

/// A mesh named floor under that sun.
fn sunlit(floor: &Geometry) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let mesh = b.mesh("floor", &[(floor, black)]);
    b.node(Node::of_mesh("floor", mesh));
    let sun = b.light("sun", Light::Directional([2.0; 3]));
    b.node(Node {
        name: "sun".into(),
        rotation: look_along(Vec3::NEG_Y, Vec3::Y),
        light: Some(sun),
        ..Node::default()
    });
    b.finish()
}

/// Position of an accessor's data in the file.
fn accessor_at(glb: &[u8], pick: impl Fn(&Value) -> u64) -> usize {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let doc: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let accessor = &doc["accessors"][pick(&doc["meshes"][0]["primitives"][0]) as usize];
    let view = &doc["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
    20 + length + 8 + view["byteOffset"].as_u64().unwrap_or(0) as usize
}

fn try_bake(glb: &[u8]) -> Result<Bake, Error> {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("scene.glb");
    std::fs::write(&path, glb).expect("written");
    let settings: Settings = at(8.0);
    lumel::bake(&path, &settings, &Silent)
}

/// Every number of the bake is finite, and lumels whose whole footprint is at x > `from` hold 2
/// lux.
fn sound(b: &Bake, from: f64) {
    let pages = b.baked.pages.iter().flat_map(|p| p.value.iter().flatten());
    assert!(pages.into_iter().all(|x| x.is_finite()));
    let vertices = b.baked.vertices.instances.iter().flatten().flatten();
    assert!(vertices.into_iter().flatten().all(|x| x.is_finite()));
    let audit = &b.report.solve.audit;
    assert!(audit.imbalance.is_finite() && audit.bound.is_finite());
    let mut n = 0;
    for l in lumels_of(b, "floor") {
        if l.all(|p| p.x > from) {
            // Half float twice; nothing is sampled.
            assert!(
                (l.red() / 2.0 - 1.0).abs() < 1e-3,
                "{} at {}",
                l.red(),
                l.points[0]
            );
            n += 1;
        }
    }
    assert!(n > 50, "{n}");
}

#[test]
fn nan_and_infinity_in_every_accessor() {
    let clean = floor(&[]);
    sound(&try_bake(&clean).expect("sound"), -1.0);
    for attribute in ["POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0"] {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for component in [0, 1] {
                let mut glb = clean.clone();
                let at = accessor_at(&glb, |p| p["attributes"][attribute].as_u64().expect("it"));
                // Vertex 0, a corner at the origin, which only one cell uses.
                let at = at + 4 * component;
                glb[at..at + 4].copy_from_slice(&bad.to_le_bytes());
                match try_bake(&glb) {
                    Ok(b) => {
                        sound(&b, 0.51);
                        let counts = &b.report.ingest.counts;
                        assert!(!counts.is_empty(), "{attribute} {bad}: not a word of it");
                    }
                    Err(e) => panic!("{attribute} {bad}: {e}"),
                }
            }
        }
    }
}

#[test]
fn nan_in_all_positions_is_refused_with_a_reason() {
    let mut glb = floor(&[]);
    let at = accessor_at(&glb, |p| p["attributes"]["POSITION"].as_u64().expect("it"));
    for k in 0..75 {
        glb[at + 4 * k..at + 4 * k + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    }
    match try_bake(&glb) {
        // Nothing is left to bake.
        Ok(b) => panic!("{:?}", b.report.ingest.counts),
        Err(e) => assert!(!e.to_string().is_empty()),
    }
}

#[test]
fn indices_out_of_range_are_dropped_and_counted_or_refused() {
    let mut glb = floor(&[]);
    let at = accessor_at(&glb, |p| p["indices"].as_u64().expect("it"));
    // The first triangle's first corner, of 25.
    glb[at..at + 2].copy_from_slice(&60_000u16.to_le_bytes());
    match try_bake(&glb) {
        Ok(b) => {
            assert!(b.report.ingest.counts.values().sum::<u64>() >= 1);
            sound(&b, 0.51);
        }
        Err(e) => assert!(
            e.to_string().contains("60000") || e.to_string().contains("index"),
            "{e}"
        ),
    }
}

#[test]
fn faces_without_area_are_dropped_and_counted() {
    // A repeated corner, three corners in a line, and all three in one place.
    let b = try_bake(&floor(&[[0, 0, 6], [0, 1, 2], [3, 3, 3]])).expect("sound");
    let counts = &b.report.ingest.counts;
    let dropped: u64 = counts.values().sum::<u64>() + b.report.dropped_triangles[0];
    assert!(dropped >= 3, "{counts:?}");
    sound(&b, -1.0);
}

#[test]
fn a_strip_a_micrometre_wide_is_a_surface() {
    // A ten thousandth, a millionth and a ten millionth of its length of 2 m.
    for width in [2e-4, 2e-6, 2e-7] {
        let mut g: Geometry = grid(Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0, [4, 4]);
        g.append(&grid(
            Vec3::new(1.0, 0.3, 0.0),
            Vec3::Z * 2.0,
            Vec3::X * width,
            [1, 1],
        ));
        sound(&try_bake(&sunlit(&g)).expect("sound"), 1.3);
    }
}

#[test]
fn a_scene_of_nothing_but_faces_without_area_is_refused_or_empty() {
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.5; 3]));
    let line = Geometry {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0],
        triangles: vec![[0, 1, 2]],
        ..Geometry::default()
    };
    let mesh = b.mesh("line", &[(&line, white)]);
    b.node(Node::of_mesh("line", mesh));
    match try_bake(&b.finish()) {
        Ok(b) => assert!(!b.report.warnings.is_empty(), "{:?}", b.report.ingest),
        Err(e) => assert!(!e.to_string().is_empty()),
    }
}
