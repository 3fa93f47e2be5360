//! Accessors and primitives.

use glam::{Vec2, Vec3, Vec4};
use mesh_ingest::Soup;
use serde_json::json;

use super::build::{Doc, QUAD, UNIT, paths};

fn first_triangles(doc: &Doc) -> Vec<[u32; 3]> {
    doc.load().unwrap().scene.meshes[0].primitives[0]
        .triangles
        .clone()
}

#[test]
fn strips_and_fans_unroll_counter_clockwise() {
    for (mode, expected) in [(5, [[0, 1, 2], [1, 3, 2]]), (6, [[1, 2, 0], [2, 3, 0]])] {
        let mut doc = Doc::with_triangles(&QUAD);
        doc.json["meshes"][0]["primitives"][0]["mode"] = json!(mode);
        assert_eq!(first_triangles(&doc), expected, "mode {mode}");
    }
    // The strip's quad is flat and faces +Z throughout.
    let mut doc = Doc::with_triangles(&QUAD);
    doc.json["meshes"][0]["primitives"][0]["mode"] = json!(5);
    let soup = Soup::build(&doc.load().unwrap().scene);
    assert_eq!(soup.normals, [Vec3::Z, Vec3::Z]);
    assert_eq!(soup.areas, [0.5, 0.5]);
}

#[test]
fn points_and_lines_are_skipped_and_counted() {
    let mut doc = Doc::with_triangles(&UNIT);
    for mode in 0..4 {
        doc.push("unused", json!(0));
        doc.json["meshes"][0]["primitives"]
            .as_array_mut()
            .unwrap()
            .push(json!({"attributes": {"POSITION": 0}, "mode": mode}));
    }
    let loaded = doc.load().unwrap();
    assert_eq!(loaded.scene.meshes[0].primitives.len(), 1);
    assert_eq!(loaded.report.counts["primitives.points"], 1);
    assert_eq!(loaded.report.counts["primitives.lines"], 3);
}

#[test]
fn sparse_values_replace_base_and_zeros() {
    let mut doc = Doc::with_triangles(&UNIT);
    let at = doc.view(&[2, 0]);
    let values: Vec<u8> = [0.0f32, 5.0, 0.0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let values = doc.view(&values);
    doc.json["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": {"bufferView": at, "componentType": 5123}, "values": {"bufferView": values}
    });
    let loaded = doc.load().unwrap();
    assert_eq!(
        loaded.scene.meshes[0].primitives[0].positions,
        [Vec3::ZERO, Vec3::X, 5.0 * Vec3::Y]
    );
    // Without a view the base is zero, and the triangle has no area.
    doc.json["accessors"][0]
        .as_object_mut()
        .unwrap()
        .remove("bufferView");
    assert!(matches!(
        doc.load(),
        Err(mesh_ingest::Error::NoTriangles { .. })
    ));
    // A substituted index beyond the count.
    doc.bin[36] = 3;
    assert_eq!(paths(doc.load()), ["accessors[0].sparse.indices"]);
}

#[test]
fn interleaved_attributes_are_gathered() {
    let mut doc = Doc::new();
    let mut bytes = Vec::new();
    for (p, uv) in UNIT.iter().zip([[0.0f32, 0.25], [0.5, 0.75], [1.0, 1.0]]) {
        bytes.extend(p.iter().chain(&uv).flat_map(|x| x.to_le_bytes()));
    }
    let view = doc.view(&bytes);
    doc.json["bufferViews"][view]["byteStride"] = json!(20);
    doc.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"}),
    );
    doc.push("accessors", json!({"bufferView": view, "byteOffset": 12, "componentType": 5126, "count": 3, "type": "VEC2"}));
    doc.mesh(json!([{"attributes": {"POSITION": 0, "TEXCOORD_1": 1}}]));
    doc.root(json!({"mesh": 0}));
    let loaded = doc.load().unwrap();
    let primitive = &loaded.scene.meshes[0].primitives[0];
    assert_eq!(primitive.positions[1], Vec3::X);
    assert_eq!(
        primitive.tex_coords,
        [
            vec![],
            vec![Vec2::new(0.0, 0.25), Vec2::new(0.5, 0.75), Vec2::ONE]
        ]
    );
    // One element more does not fit.
    doc.json["accessors"][1]["count"] = json!(4);
    assert_eq!(paths(doc.load()), ["accessors[1]"]);
}

#[test]
fn quantised_attributes_are_scaled() {
    let mut doc = Doc::new();
    doc.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let positions: Vec<u8> = [[0i16, 0, 0, 0], [32767, 0, 0, 0], [0, -32768, 0, 0]]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let view = doc.view(&positions);
    doc.json["bufferViews"][view]["byteStride"] = json!(8);
    doc.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5122, "normalized": true, "count": 3, "type": "VEC3"}),
    );
    let colors = doc.view(&[255, 0, 51, 255, 255, 255, 0, 0, 0]);
    doc.push("accessors", json!({"bufferView": colors, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC3"}));
    let normals = doc.view(&[0, 0, 127, 0, 0, 127, 0, 0, 0]);
    doc.push("accessors", json!({"bufferView": normals, "componentType": 5120, "normalized": true, "count": 3, "type": "VEC3"}));
    doc.mesh(json!([{"attributes": {"POSITION": 0, "COLOR_0": 1, "NORMAL": 2}}]));
    doc.root(json!({"mesh": 0}));
    let loaded = doc.load().unwrap();
    let primitive = &loaded.scene.meshes[0].primitives[0];
    // −32768 and −32767 both mean −1.
    assert_eq!(primitive.positions, [Vec3::ZERO, Vec3::X, Vec3::NEG_Y]);
    assert_eq!(primitive.colors[0], Vec4::new(1.0, 0.0, 0.2, 1.0));
    // The third normal is zero: replaced by the face's, which points to −Z.
    assert_eq!(primitive.normals, [Vec3::Z, Vec3::Z, Vec3::NEG_Z]);
    assert_eq!(loaded.report.counts["normals.replaced"], 1);
}

#[test]
fn unsound_triangles_are_dropped_and_counted() {
    let mut corners = QUAD.to_vec();
    corners.extend([
        [f32::NAN, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [f32::INFINITY, 0.0, 1.0],
    ]);
    let mut doc = Doc::with_triangles(&corners);
    let list = [
        0, 1, 2, /* repeated vertex */ 0, 0, 1, /* NaN */ 0, 1, 4,
        /* collinear */ 0, 1, 5, /* infinite */ 6, 1, 2,
        /* the first again, rotated */ 1, 2, 0, /* its back: kept */ 0, 2, 1,
        /* sound */ 1, 3, 2,
    ];
    let indices = doc.indices(&list);
    doc.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let loaded = doc.load().unwrap();
    let primitive = &loaded.scene.meshes[0].primitives[0];
    assert_eq!(primitive.source_triangles, [0, 6, 7]);
    assert_eq!(primitive.triangles, [[0, 1, 2], [0, 2, 1], [1, 3, 2]]);
    assert!(primitive.positions.iter().all(|p| p.is_finite()));
    for (key, n) in [
        ("triangles.repeated_vertex", 1),
        ("triangles.non_finite", 2),
        ("triangles.zero_area", 1),
        ("triangles.duplicate", 1),
        ("vertices.non_finite", 2),
    ] {
        assert_eq!(loaded.report.counts.get(key), Some(&n), "{key}");
    }
    // Two-sided, the back adds nothing.
    doc.json["materials"] = json!([{"doubleSided": true}]);
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    assert_eq!(
        doc.load().unwrap().scene.meshes[0].primitives[0].source_triangles,
        [0, 7]
    );
    // The document's own list keeps all of them.
    assert_eq!(
        loaded.document.primitive_raw(0, 0).unwrap().triangles.len(),
        list.len() / 3
    );
}

#[test]
fn slivers_of_aspect_a_million_stay() {
    for scale in [1e-3f32, 1.0, 1e3] {
        let doc = Doc::with_triangles(&[
            [0.0, 0.0, 0.0],
            [scale, 0.0, 0.0],
            [0.5 * scale, 1e-6 * scale, 0.0],
        ]);
        assert_eq!(
            Soup::build(&doc.load().unwrap().scene).len(),
            1,
            "scale {scale}"
        );
    }
}

#[test]
fn non_finite_attributes_are_replaced() {
    let nan = f32::NAN;
    let mut doc = Doc::with_triangles(&UNIT);
    let normals = doc.floats(&[[nan, 0.0, 0.0], [0.0, 0.0, 5.0], [0.0, f32::INFINITY, 0.0]]);
    let uv = doc.floats(&[[nan, 0.0], [0.5, 0.5], [0.0, f32::NEG_INFINITY]]);
    let colors = doc.floats(&[
        [nan, 0.0, 0.0, 1.0],
        [2.0, -1.0, 0.5, 1.0],
        [0.5, 0.5, 0.5, 0.5],
    ]);
    let attributes = json!({"POSITION": 0, "NORMAL": normals, "TEXCOORD_0": uv, "COLOR_0": colors});
    doc.json["meshes"][0]["primitives"][0]["attributes"] = attributes;
    let loaded = doc.load().unwrap();
    let primitive = &loaded.scene.meshes[0].primitives[0];
    assert_eq!(primitive.normals, [Vec3::Z; 3]);
    assert_eq!(
        primitive.tex_coords[0],
        [Vec2::ZERO, Vec2::splat(0.5), Vec2::ZERO]
    );
    assert_eq!(
        primitive.colors,
        [Vec4::ONE, Vec4::new(1.0, 0.0, 0.5, 1.0), Vec4::splat(0.5)]
    );
    for (key, n) in [
        ("normals.replaced", 2),
        ("normals.normalised", 1),
        ("tex_coords.replaced", 2),
        ("colors.replaced", 1),
        ("colors.clamped", 1),
    ] {
        assert_eq!(loaded.report.counts.get(key), Some(&n), "{key}");
    }
}

#[test]
fn raw_primitives_keep_every_attribute_and_target() {
    let mut doc = Doc::with_triangles(&UNIT);
    let custom = doc.floats(&[[1.0], [2.0], [3.0]]);
    let joints = doc.view(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
    let joints = doc.push(
        "accessors",
        json!({"bufferView": joints, "componentType": 5121, "count": 3, "type": "VEC4"}),
    );
    let target = doc.floats(&UNIT);
    doc.json["meshes"][0]["primitives"][0] = json!({"attributes": {"_HEAT": custom, "POSITION": 0, "JOINTS_0": joints}, "targets": [{"POSITION": target}]});
    let loaded = doc.load().unwrap();
    let raw = loaded.document.primitive_raw(0, 0).unwrap();
    let names: Vec<&str> = raw
        .attributes
        .iter()
        .map(|(name, _)| name.as_str())
        .collect();
    assert_eq!(names, ["_HEAT", "POSITION", "JOINTS_0"]);
    assert_eq!(raw.attribute("JOINTS_0").unwrap().element(1), [5, 6, 7, 8]);
    assert_eq!(raw.targets[0][0].1.count, 3);
    assert_eq!(raw.vertex_count, 3);
    assert!(loaded.document.primitive_raw(0, 1).is_err());
}

#[test]
fn broken_references_name_their_place() {
    let mut doc = Doc::with_triangles(&UNIT);
    let indices = doc.indices(&[0, 1, 3]);
    doc.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let error = doc.load().unwrap_err();
    assert_eq!(error.exit_code(), 3);
    assert_eq!(error.problems()[0].path, "meshes[0].primitives[0].indices");
    assert!(
        error.to_string().contains("index 3") && error.to_string().contains("below 3"),
        "{error}"
    );

    let mut doc = Doc::with_triangles(&UNIT);
    let normals = doc.floats(&UNIT[..2]);
    doc.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(9);
    assert_eq!(paths(doc.load()), ["meshes[0].primitives[0].material"]);
    doc.json["meshes"][0]["primitives"][0]
        .as_object_mut()
        .unwrap()
        .remove("material");
    assert_eq!(
        paths(doc.load()),
        ["meshes[0].primitives[0].attributes.NORMAL"]
    );
    doc.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(77);
    assert_eq!(
        paths(doc.load()),
        ["meshes[0].primitives[0].attributes.NORMAL"]
    );
}
