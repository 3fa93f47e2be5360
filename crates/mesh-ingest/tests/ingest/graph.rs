//! Nodes, instances, lights.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use mesh_ingest::{Cut, Error, LeftOutReason, LightKind, LoadOptions, Scene, Soup};
use serde_json::json;

use super::build::{Doc, UNIT, load_bytes, paths};

#[test]
fn transforms_compose_and_mirror() {
    let mut doc = Doc::with_triangles(&UNIT);
    let child = doc.node(json!({"mesh": 0, "scale": [-2, 1, 1]}));
    // A quarter turn about Z, then a translation.
    let half = 0.5f64.sqrt();
    doc.json["nodes"][0] =
        json!({"children": [child], "rotation": [0, 0, half, half], "translation": [10, 0, 0]});
    let scene = doc.load().unwrap().scene;
    let soup = Soup::build(&scene);
    // Local corners (0,0), (−2,0), (0,1) rotate to (0,0), (0,−2), (−1,0); mirrored, so the last two
    // are swapped.
    let world: Vec<DVec3> = soup.triangles[0]
        .iter()
        .map(|p| p.as_dvec3() + scene.origin)
        .collect();
    for (got, expected) in world
        .iter()
        .zip([[10.0, 0.0, 0.0], [9.0, 0.0, 0.0], [10.0, -2.0, 0.0]])
    {
        // The tolerance is for f32 corners about a metre from the origin.
        assert!(
            (*got - DVec3::from(expected)).length() < 1e-6,
            "{got} for {expected:?}"
        );
    }
    assert!(soup.sources[0].mirrored);
    assert!(
        (soup.normals[0] - Vec3::Z).length() < 1e-6,
        "the front stays the front: {}",
        soup.normals[0]
    );
    // Twice the double rounding of the square root of a half.
    assert!((scene.origin - DVec3::new(9.5, -1.0, 0.0)).length() < 1e-14);
}

#[test]
fn recentring_keeps_small_triangles_far_away() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["nodes"][0]["translation"] = json!([1e6, -1e6, 1e6]);
    doc.json["nodes"][0]["scale"] = json!([1e-3, 1e-3, 1e-3]);
    let soup = Soup::build(&doc.load().unwrap().scene);
    // 1e6 in f64 leaves 1e-10 m; the triangle's area is 5e-7 m².
    assert!(
        (soup.areas[0] / 5e-7 - 1.0).abs() < 1e-5,
        "{}",
        soup.areas[0]
    );
}

#[test]
fn gpu_instancing_places_copies() {
    let mut doc = Doc::with_triangles(&UNIT);
    let translations = doc.floats(&[[0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [1.0, 0.0, 0.0]]);
    let scales = doc.floats(&[[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [0.0, 0.0, 0.0]]);
    doc.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({"TRANSLATION": translations, "SCALE": scales});
    let loaded = doc.load().unwrap();
    let copies: Vec<_> = loaded.scene.instances.iter().map(|i| i.copy).collect();
    assert_eq!(copies, [Some(0), Some(1)]);
    assert_eq!(loaded.report.counts["instances.singular"], 1);
    assert_eq!(
        loaded.scene.instances[1].transform.translation,
        DVec3::new(0.0, 0.0, 3.0)
    );
    assert_eq!(Soup::build(&loaded.scene).instance_ranges, [[0, 1], [1, 2]]);
}

#[test]
fn loops_and_second_parents_are_refused() {
    let mut doc = Doc::with_triangles(&UNIT);
    let a = doc.node(json!({}));
    let b = doc.node(json!({"children": [a]}));
    doc.json["nodes"][a]["children"] = json!([b]);
    assert_eq!(paths(doc.load()), ["nodes[1]"]);
    doc.json["nodes"][a]["children"] = json!([]);
    doc.json["nodes"][0]["children"] = json!([a, b]);
    assert_eq!(paths(doc.load()), ["nodes[2].children[0]"]);
    doc.json["nodes"][b]["children"] = json!([b + 1]);
    assert_eq!(paths(doc.load()), ["nodes[2].children[0]"]);
    // A root of the scene that is also another node's child.
    doc.json["nodes"][b]["children"] = json!([]);
    doc.json["scenes"][0]["nodes"] = json!([0, b]);
    assert_eq!(paths(doc.load()), ["scenes[0].nodes[1]"]);
}

/// An engine's own examples contain such parents; the validator reports an error.
#[test]
fn parents_outside_of_the_scene_are_not_parents() {
    let mut doc = Doc::with_triangles(&UNIT);
    let leaf = doc.node(json!({"mesh": 0}));
    let unused = doc.node(json!({"children": [0, leaf], "translation": [9, 9, 9]}));
    doc.json["nodes"][0]["children"] = json!([leaf]);
    let loaded = doc.load().expect("unused nodes do no harm");
    assert_eq!(loaded.scene.instances.len(), 2);
    let warned: Vec<_> = loaded.report.warnings.iter().map(|w| &w.path).collect();
    let places = [0, 1].map(|k| format!("nodes[{unused}].children[{k}]"));
    assert_eq!(warned, places.iter().collect::<Vec<_>>());
    let other = doc.node(json!({"children": [unused]}));
    doc.json["nodes"][unused]["children"] = json!([other]);
    assert_eq!(paths(doc.load()), [format!("nodes[{unused}]")]);
}

/// Each of these made the walk run forever or exhaust memory.
#[test]
fn hierarchies_that_are_no_forest_are_refused_at_once() {
    let load = |nodes: Vec<serde_json::Value>| {
        let mut doc = Doc::with_triangles(&UNIT);
        doc.json["nodes"] = json!(nodes);
        let error = doc.load().expect_err("no forest");
        assert_eq!(error.exit_code(), 3);
        error
            .problems()
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
    };
    let leaf = json!({"mesh": 0});
    assert_eq!(
        load(vec![json!({"children": [1]}), json!({"children": [1]})]),
        ["nodes[1].children[0]: found node 1 itself, expected a hierarchy without loops"]
    );
    assert_eq!(
        load(vec![json!({"children": [0, 0]})]),
        [
            "nodes[0].children[0]: found node 0 itself, expected a hierarchy without loops",
            "nodes[0].children[1]: found node 0 itself, expected a hierarchy without loops"
        ]
    );
    // A loop with a second parent outside: none of its nodes is without a parent.
    assert_eq!(
        load(vec![
            json!({"children": [1]}),
            json!({"children": [2]}),
            json!({"children": [1]})
        ]),
        [
            "nodes[2].children[0]: found node 1, already a child of node 0, expected a node with one parent"
        ]
    );
    // A diamond.
    assert_eq!(
        load(vec![
            json!({"children": [1, 2]}),
            json!({"children": [3]}),
            json!({"children": [3]}),
            leaf.clone()
        ]),
        [
            "nodes[2].children[0]: found node 3, already a child of node 1, expected a node with one parent"
        ]
    );
    // 2^60 paths lead to the last node.
    let mut doubling: Vec<_> = (1..=60).map(|i| json!({"children": [i, i]})).collect();
    doubling.push(leaf);
    let problems = load(doubling);
    assert_eq!(problems.len(), 60);
    assert_eq!(
        problems[0],
        "nodes[0].children[1]: found node 1 twice, expected each child once"
    );
}

#[test]
fn deep_hierarchies_do_not_recurse() {
    let mut doc = Doc::with_triangles(&UNIT);
    let depth = 200_000;
    let nodes: Vec<_> = (0..depth)
        .map(|i| json!({"children": [i + 1]}))
        .chain([json!({"mesh": 0})])
        .collect();
    doc.json["nodes"] = json!(nodes);
    assert_eq!(doc.load().unwrap().scene.instances[0].node, depth);
}

#[test]
fn moving_things_are_left_out_and_listed() {
    let mut doc = Doc::with_triangles(&UNIT);
    let moved = doc.root(json!({"name": "door", "children": [2]}));
    doc.node(json!({"name": "handle", "mesh": 0}));
    doc.root(json!({"mesh": 0, "skin": 0, "name": "hero"}));
    doc.root(json!({"mesh": 0, "extras": {"lumel": {"exclude": true}}}));
    doc.root(json!({"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": false}}}));
    doc.root(json!({"mesh": 0, "skin": 0, "extras": {"lumel": {"bake": true}, "other": 1}}));
    doc.push("skins", json!({"joints": [0]}));
    doc.push(
        "animations",
        json!({"channels": [{"target": {"node": moved, "path": "rotation"}, "sampler": 0}]}),
    );
    let loaded = doc.load().unwrap();
    let left: Vec<_> = loaded
        .report
        .left_out
        .iter()
        .map(|l| (l.node, l.name.as_str(), l.reason))
        .collect();
    assert_eq!(
        left,
        [
            (2, "handle", LeftOutReason::Animated),
            (3, "hero", LeftOutReason::Skinned),
            (4, "", LeftOutReason::Excluded),
            (5, "", LeftOutReason::Hidden),
        ]
    );
    let kept: Vec<_> = loaded.scene.instances.iter().map(|i| i.node).collect();
    assert_eq!(kept, [0, 6]);
    assert_eq!(
        loaded.scene.instances[1].extras,
        Some(json!({"lumel": {"bake": true}}))
    );
}

#[test]
fn morphed_meshes_are_left_out_only_if_they_deform() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
    assert!(doc.load().unwrap().report.left_out.is_empty());
    doc.json["meshes"][0]["weights"] = json!([0.5]);
    let Err(Error::NoTriangles { why, .. }) = doc.load() else {
        panic!("not left out")
    };
    assert!(
        why.contains("Morphed") && why.contains("extras.lumel.bake: true"),
        "{why}"
    );
    doc.json["nodes"][0]["weights"] = json!([0]);
    assert!(doc.load().unwrap().report.left_out.is_empty());
}

#[test]
fn the_scene_can_be_chosen() {
    let mut doc = Doc::with_triangles(&UNIT);
    let other = doc.node(json!({"mesh": 0, "name": "other"}));
    doc.push("scenes", json!({"nodes": [other]}));
    let choose = |scene| {
        load_bytes(
            &doc.glb(),
            &LoadOptions {
                scene,
                ..LoadOptions::default()
            },
        )
    };
    assert_eq!(choose(None).unwrap().scene.instances[0].node, 0);
    assert_eq!(choose(Some(1)).unwrap().scene.instances[0].name, "other");
    assert_eq!(choose(Some(2)).unwrap_err().exit_code(), 3);
    // Without scenes, every root counts.
    doc.json.as_object_mut().unwrap().remove("scenes");
    doc.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(doc.load().unwrap().scene.instances.len(), 2);
}

#[test]
fn lights_stand_where_their_nodes_do() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([
        {"type": "point", "intensity": 3, "color": [1, 0.5, 0], "range": 7},
        {"type": "spot", "spot": {"innerConeAngle": 1.0, "outerConeAngle": 0.5}, "name": "lamp"},
        {"type": "directional", "intensity": -1},
        {"type": "laser"}
    ]);
    // A quarter turn about X takes −Z to +Y; scale must not affect the light.
    let half = 0.5f64.sqrt();
    for light in 0..4 {
        doc.root(
            json!({"translation": [1, 2, 3], "rotation": [half, 0, 0, half], "scale": [5, 5, 5],
            "extensions": {"KHR_lights_punctual": {"light": light}}}),
        );
    }
    let loaded = doc.load().unwrap();
    let origin = loaded.scene.origin.as_vec3();
    let [point, spot, sun] = &loaded.scene.lights[..] else {
        panic!("{:?}", loaded.scene.lights)
    };
    assert_eq!(point.intensity, Vec3::new(3.0, 1.5, 0.0));
    let LightKind::Point {
        position, range, ..
    } = point.kind
    else {
        panic!("{point:?}")
    };
    assert!((position + origin - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-6);
    assert_eq!(range, Some(7.0));
    let LightKind::Spot {
        direction,
        inner,
        outer,
        ..
    } = spot.kind
    else {
        panic!("{spot:?}")
    };
    assert!((direction - Vec3::Y).length() < 1e-6, "{direction}");
    assert!(inner < outer && outer == 0.5, "{inner} {outer}");
    assert_eq!(spot.name, "lamp");
    assert_eq!(sun.intensity, Vec3::ZERO);
    for key in [
        "lights.clamped",
        "lights.cone_clamped",
        "lights.unknown_type",
    ] {
        assert_eq!(loaded.report.counts[key], 1, "{key}");
    }
}

/// A cut of the first triangle at x = 0.25.
fn at_a_quarter(node: Option<usize>) -> Cut {
    Cut {
        mesh: 0,
        node,
        primitive: 0,
        triangle: 0,
        normal: [1.0, 0.0, 0.0],
        offset: 0.25,
        ends: None,
        meet: 0.0,
    }
}

/// Of two nodes with one mesh, the second is cut: it gets a copy with two primitives.
#[test]
fn a_node_that_shares_its_mesh_is_cut_alone() {
    let mut doc = Doc::with_triangles(&UNIT);
    let material = doc.push("materials", json!({}));
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(material);
    let other = doc.root(json!({"mesh": 0, "translation": [5, 0, 0]}));
    let cut = at_a_quarter(Some(other));
    let with = |cuts| LoadOptions {
        cuts,
        ..LoadOptions::default()
    };
    let loaded = load_bytes(&doc.glb(), &with(vec![cut])).unwrap();
    let json = loaded.document.json();
    assert_eq!(json["nodes"][other]["mesh"], json!(1));
    assert_eq!(json["nodes"][0]["mesh"], json!(0));
    let primitives = |mesh: usize| json["meshes"][mesh]["primitives"].as_array().unwrap().len();
    assert_eq!([primitives(0), primitives(1)], [1, 2]);
    // The parts are the whole.
    let areas = |scene| -> f32 { Soup::build(scene).areas.iter().sum() };
    let plain = doc.load().unwrap().scene;
    assert!((areas(&loaded.scene) - areas(&plain)).abs() < 1e-6);

    // Of another mesh, or a node that is not there, nothing is cut.
    for node in [other + 1, 99] {
        let elsewhere = Cut {
            node: Some(node),
            ..cut
        };
        let loaded = load_bytes(&doc.glb(), &with(vec![elsewhere])).unwrap();
        let meshes = loaded.document.json()["meshes"].as_array().map(Vec::len);
        assert_eq!(meshes, Some(1));
    }
}

/// A sheet whose sides are separate is cut on both: each becomes two primitives, of half the area.
#[test]
fn both_sides_of_a_split_sheet_are_cut() {
    let mut doc = Doc::with_triangles(&UNIT);
    let material = doc.push("materials", json!({"doubleSided": true}));
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(material);
    let cut = at_a_quarter(None);
    let with = |split: &[(usize, usize)], cuts| {
        let options = LoadOptions {
            split_sides: split.iter().copied().collect(),
            cuts,
            ..LoadOptions::default()
        };
        load_bytes(&doc.glb(), &options).unwrap().scene
    };
    let areas = |scene: &Scene| -> Vec<f32> {
        let soup = Soup::build(scene);
        let mut of_primitives = BTreeMap::new();
        for (source, area) in soup.sources.iter().zip(&soup.areas) {
            *of_primitives.entry(source.primitive).or_insert(0.0) += area;
        }
        of_primitives.into_values().collect()
    };
    let one_side = areas(&with(&[], vec![cut]));
    let [both, whole] = [vec![cut], Vec::new()].map(|cuts| areas(&with(&[(0, 0)], cuts)));
    assert_eq!([one_side.len(), both.len(), whole.len()], [2, 4, 2]);
    let mut pairs = [one_side.clone(), one_side].concat();
    let mut found = both;
    for list in [&mut pairs, &mut found] {
        list.sort_by(f32::total_cmp);
    }
    assert!(
        (pairs.iter().zip(&found)).all(|(a, b)| (a - b).abs() < 1e-6),
        "{found:?}"
    );
}
