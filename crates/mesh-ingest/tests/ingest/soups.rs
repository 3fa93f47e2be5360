//! The soup: duplicates, order, determinism.

use mesh_ingest::Soup;
use serde_json::json;

use super::build::{Doc, UNIT};

#[test]
fn coincident_triangles_keep_one_per_acting_side() {
    // Nodes 1..: the same triangle again, mirrored in Z, and both with a double-sided mesh.
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["materials"] = json!([{"doubleSided": true}]);
    let two_sided = doc.mesh(json!([{"attributes": {"POSITION": 0}, "material": 0}]));
    let count = |doc: &Doc| {
        let soup = Soup::build(&doc.load().unwrap().scene);
        (soup.len(), soup.dropped_duplicate)
    };
    doc.root(json!({"mesh": 0}));
    assert_eq!(count(&doc), (1, 1), "same facing");
    doc.root(json!({"mesh": 0, "scale": [1, 1, -1]}));
    assert_eq!(count(&doc), (2, 1), "the other facing adds a side");
    doc.root(json!({"mesh": two_sided}));
    assert_eq!(count(&doc), (2, 2), "both sides are taken");

    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["materials"] = json!([{"doubleSided": true}]);
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    doc.root(json!({"mesh": 0, "scale": [1, 1, -1]}));
    assert_eq!(count(&doc), (1, 1), "two-sided, facing does not matter");
}

#[test]
fn duplicates_say_where_they_lie() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["materials"] = json!([{"doubleSided": true}]);
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let single = doc.mesh(json!([{"attributes": {"POSITION": 0}}]));
    doc.root(json!({"mesh": single, "scale": [1, 1, -1]}));
    doc.root(json!({"mesh": single}));
    let scene = doc.load().unwrap().scene;
    let soup = Soup::build(&scene);
    assert_eq!((soup.len(), soup.duplicates.len()), (1, 2));
    assert_eq!(soup.duplicate_ranges.len(), soup.instance_ranges.len());
    for (i, d) in soup.duplicates.iter().enumerate() {
        let face = (soup.len() + i) as u32;
        assert_eq!(soup.duplicate(face), Some(d));
        assert_eq!(
            (soup.source(face), soup.material(face)),
            (d.source, d.material)
        );
        let [first, end] = soup.duplicate_ranges[d.source.instance as usize];
        assert!((first..end).contains(&(i as u32)));
        // Its own corners, as ingest would place them, are those of the kept one in the stated
        // order.
        let instance = &scene.instances[d.source.instance as usize];
        let primitive = &scene.meshes[instance.mesh].primitives[d.source.primitive as usize];
        let [a, b, c] = primitive.triangles[d.source.triangle as usize];
        let order = if d.source.mirrored {
            [a, c, b]
        } else {
            [a, b, c]
        };
        for (v, place) in order.into_iter().zip(d.corners) {
            let local = primitive.positions[v as usize].as_dvec3();
            let world = (instance.transform.transform_point3(local) - scene.origin).as_vec3();
            assert_eq!(world, soup.triangles[d.kept as usize][usize::from(place)]);
        }
    }
    assert_eq!(soup.duplicate(0), None);
    let turned: Vec<bool> = soup.duplicates.iter().map(|d| d.turned).collect();
    assert_eq!(turned, [true, false]);
}

#[test]
fn many_coincident_triangles_are_not_quadratic() {
    // 200,000 copies of one triangle; quadratic work would take minutes.
    let mut doc = Doc::with_triangles(&UNIT.repeat(200_000));
    doc.root(json!({"mesh": 0, "translation": [0, 0, 1]}));
    let scene = doc.load().unwrap().scene;
    let start = std::time::Instant::now();
    let soup = Soup::build(&scene);
    assert_eq!(soup.len(), 2);
    assert_eq!(soup.instance_ranges, [[0, 1], [1, 2]]);
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

#[test]
fn thin_and_tiny_worlds_lose_only_what_has_no_area() {
    let mut doc = Doc::with_triangles(&UNIT);
    // Beyond f32: at 1e9 m from the other, a metre is below a unit in the last place.
    doc.root(json!({"mesh": 0, "translation": [2e9, 0, 0]}));
    let scene = doc.load().unwrap().scene;
    let soup = Soup::build(&scene);
    assert_eq!(soup.len() as u64 + soup.dropped_zero_area, 2);
    assert!(soup.areas.iter().all(|a| a.is_finite() && *a > 0.0));
    assert!(soup.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-6));
}
