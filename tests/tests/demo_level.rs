//! The demo level contains what users expect, within a size that keeps the repository small.

use serde_json::Value;

/// The JSON chunk of a GLB that `GltfBuilder` wrote.
fn document(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    serde_json::from_slice(&glb[20..20 + length]).expect("valid JSON")
}

fn list<'a>(doc: &'a Value, key: &str) -> &'a [Value] {
    doc[key].as_array().map_or(&[], Vec::as_slice)
}

#[test]
fn it_has_rooms_instances_textures_a_grate_and_every_kind_of_light() {
    let glb = lumel_tests::scenes::demo_level();
    let doc = document(&glb);
    assert!(glb.len() < 1_000_000, "{} bytes", glb.len());
    let names: Vec<&str> = list(&doc, "nodes")
        .iter()
        .filter_map(|n| n["name"].as_str())
        .collect();
    for room in [
        "hall",
        "courtyard",
        "corridor",
        "grate_room",
        "gallery",
        "store",
        "doorways",
        "outside",
    ] {
        assert!(names.contains(&room), "{room} is missing");
    }
    let mut uses = vec![0u64; list(&doc, "meshes").len()];
    for node in list(&doc, "nodes") {
        if let Some(mesh) = node["mesh"].as_u64() {
            uses[mesh as usize] += 1;
        }
    }
    let shared: u64 = uses.iter().filter(|&&n| n > 1).sum();
    assert!(shared >= 30, "{shared} instances of shared meshes");
    let masked = list(&doc, "materials")
        .iter()
        .filter(|m| m["alphaMode"] == "MASK")
        .count();
    assert_eq!(masked, 1);
    let emissive = list(&doc, "materials")
        .iter()
        .filter(|m| !m["emissiveFactor"].is_null())
        .count();
    assert!(emissive >= 3, "{emissive} emissive materials");
    assert!(list(&doc, "images").len() >= 5);
    let lights = &doc["extensions"]["KHR_lights_punctual"];
    for kind in ["point", "spot", "directional"] {
        assert!(
            list(lights, "lights").iter().any(|l| l["type"] == kind),
            "no {kind} light"
        );
    }
    let count = |mesh: &Value| -> u64 {
        list(mesh, "primitives")
            .iter()
            .map(|p| {
                doc["accessors"][p["indices"].as_u64().expect("indexed") as usize]["count"]
                    .as_u64()
                    .expect("a count")
                    / 3
            })
            .sum()
    };
    let triangles: u64 = list(&doc, "meshes")
        .iter()
        .zip(&uses)
        .map(|(m, n)| count(m) * n)
        .sum();
    assert!(
        (5_000..=20_000).contains(&triangles),
        "{triangles} triangles"
    );
    assert_eq!(list(&doc, "cameras").len(), 6);
}

#[test]
fn reflectances_leave_room_for_light() {
    let doc = document(&lumel_tests::scenes::demo_level());
    for m in list(&doc, "materials") {
        let pbr = &m["pbrMetallicRoughness"];
        // A textured material takes its reflectance from the picture.
        if pbr["baseColorTexture"].is_null() {
            let rgb = list(pbr, "baseColorFactor")[..3]
                .iter()
                .filter_map(Value::as_f64);
            assert!(rgb.fold(0.0, f64::max) <= 0.8, "{m}");
        }
    }
}
