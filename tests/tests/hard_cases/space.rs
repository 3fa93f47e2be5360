//! Size, position, brightness, and nearly empty scenes.

use crate::common::{at, bake, lumels_of};
use glam::{Mat4, Vec3};
use lumel::{Quality, Settings};
use lumel_tests::scenes::{self, closed_form};
use serde_json::Value;

/// Puts every root node under a new one with this transform.
fn moved(glb: &[u8], transform: Mat4) -> Vec<u8> {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let mut doc: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let roots = doc["scenes"][0]["nodes"].clone();
    let nodes = doc["nodes"].as_array_mut().expect("nodes");
    nodes.push(serde_json::json!({"matrix": transform.to_cols_array(), "children": roots}));
    let last = nodes.len() - 1;
    doc["scenes"][0]["nodes"] = serde_json::json!([last]);
    let mut json = serde_json::to_vec(&doc).expect("JSON");
    json.resize(json.len().next_multiple_of(4), b' ');
    let rest = &glb[20 + length..];
    let mut out = Vec::new();
    out.extend_from_slice(b"glTF");
    out.extend_from_slice(&2u32.to_le_bytes());
    out.extend_from_slice(&((20 + json.len() + rest.len()) as u32).to_le_bytes());
    out.extend_from_slice(&(json.len() as u32).to_le_bytes());
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&json);
    out.extend_from_slice(rest);
    out
}

/// The Cornell box, lit by a panel: radiances do not change with scale. Mean relative difference
/// over the lightmap.
///
/// Both bakes keep the coordinates that a first one made: an unwrapper may turn or swap equal
/// charts when rounding changes.
fn difference(transform: Mat4, scale: f32) -> f64 {
    let first = bake(&scenes::cornell_box(), &at(6.0));
    let (files, _) = first.files().expect("files");
    let (_, glb) = files
        .into_iter()
        .find(|f| f.0 == "scene.glb")
        .expect("the lightmapped scene");
    let settings = |density: f32| Settings {
        quality: Quality::Draft,
        ..at(density)
    };
    let here = bake(&glb, &settings(6.0));
    let there = bake(&moved(&glb, transform), &settings(6.0 / scale));
    assert_eq!(here.layout.pages, there.layout.pages, "the same atlas");
    let (a, b) = (&here.baked.pages[0].value, &there.baked.pages[0].value);
    let (mut d, mut sum) = (0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        assert!(y.iter().all(|v| v.is_finite()));
        d += f64::from((x[0] - y[0]).abs());
        sum += f64::from(x[0]);
    }
    d / sum
}

#[test]
fn a_scene_scaled_by_a_thousand_bakes_the_same() {
    for scale in [1e-3f32, 1e3] {
        let d = difference(Mat4::from_scale(Vec3::splat(scale)), scale);
        // The same rays up to rounding; a few pass an edge on the other side. The required bound is
        // 1e-3.
        assert!(d < 1e-3, "scale {scale}: {d}");
    }
}

#[test]
fn a_scene_moved_by_a_million_metres_bakes_the_same() {
    // The file's own numbers are small and the node's translation is large: recentring in f64
    // removes it.
    let d = difference(Mat4::from_translation(Vec3::new(1e6, -1e6, 1e6)), 1.0);
    assert!(d < 1e-3, "{d}");
}

#[test]
fn light_is_linear_over_nine_decades() {
    let mean = |radiance: f32| {
        let b = bake(
            &closed_form::rectangle_over_floor(radiance, 1.0, 1.0),
            &at(4.0),
        );
        b.report.gather.light.mean[0] / f64::from(radiance)
    };
    let one = mean(1.0);
    for radiance in [1e-3, 1e6] {
        // f32 arithmetic: 1e-7 an operation, some hundred operations.
        assert!((mean(radiance) / one - 1.0).abs() < 1e-5, "{radiance}");
    }
}

#[test]
fn one_triangle_is_lit_evenly() {
    let b = bake(&closed_form::one_triangle(), &at(8.0));
    // E = 1 lx; half float.
    let lumels = lumels_of(&b, "triangle");
    assert!(crate::common::worst(&lumels, 0.0, |_| 1.0) < 1e-3);
}

#[test]
fn a_scene_without_light_is_black_and_says_so() {
    // Without the sky for which it is made.
    let b = bake(&closed_form::sky_over_open_box(1.0, 1.0), &at(8.0));
    assert!(
        b.baked
            .pages
            .iter()
            .all(|p| p.value.iter().all(|v| *v == [0.0; 3]))
    );
    assert!(
        b.report
            .warnings
            .iter()
            .any(|w| w.contains("lightmap will be black")),
        "{:?}",
        b.report.warnings
    );
}

#[test]
fn the_same_bytes_for_one_thread_and_two() {
    let glb = scenes::demo_level();
    let settings = Settings {
        quality: Quality::Draft,
        ..at(3.0)
    };
    let files = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| {
            let (mut files, _) = bake(&glb, &settings).files().expect("files");
            files.pop(); // the report has times in it
            files
        })
    };
    let reference = files(1);
    assert_eq!(reference.len(), 4);
    for threads in [1, 2, 2] {
        for (a, b) in reference.iter().zip(files(threads)) {
            assert_eq!(a.0, b.0);
            assert!(a.1 == b.1, "{} differs with {threads} threads", a.0);
        }
    }
}

#[test]
fn a_million_triangles_make_no_million_patches() {
    let b = bake(&closed_form::many_triangles(708), &at(4.0));
    assert!(b.report.ingest.totals.triangles >= 1_000_000);
    assert!(
        b.report.solve.subdivision.patches < 100_000,
        "{}",
        b.report.solve.subdivision.patches
    );
}
