//! Page groups: rooms on separate pages.

use std::collections::BTreeSet;

use glam::Vec3;
use lumel::{Error, Quality, Settings, Silent};
use lumel_tests::geometry::cuboid;
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use serde_json::{Value, json};

use crate::common::{at, bake};

/// Two rooms of two cubes each and a loose one; the first room's group is in extras.
fn level() -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let moss = b.material(&Material::diffuse("moss", [0.2, 0.5, 0.1]));
    let cube = cuboid(Vec3::ZERO, Vec3::ONE, 1).bare();
    let plain = b.mesh("cube", &[(&cube, grey)]);
    let mossy = b.mesh("mossy", &[(&cube, moss)]);
    let mut x = 0.0;
    let mut place = |b: &mut GltfBuilder, name: &str, mesh, page: Option<&str>| {
        x += 3.0;
        let mut node = Node::of_mesh(name, mesh);
        node.translation = Vec3::X * x;
        node.extras = page.map(|p| json!({"lumel": {"page": p}}));
        b.child(node)
    };
    for (room, page) in [("room_1", Some("cellar")), ("room_2", None)] {
        let a = place(&mut b, &format!("{room} a"), plain, None);
        let other = (room == "room_1").then_some("attic");
        let c = place(&mut b, &format!("{room} b"), mossy, other);
        b.node(Node {
            name: room.into(),
            children: vec![a, c],
            extras: page.map(|p| json!({"lumel": {"page": p}})),
            ..Node::default()
        });
    }
    let loose = place(&mut b, "loose", mossy, None);
    b.node(Node {
        name: "yard".into(),
        children: vec![loose],
        ..Node::default()
    });
    let sun = b.light("sun", Light::Directional([1.0; 3]));
    b.node(Node {
        light: Some(sun),
        ..Node::default()
    });
    b.finish()
}

fn settings(page_by: &[&str]) -> Settings {
    Settings {
        quality: Quality::Draft,
        page_by: page_by.iter().map(|p| (*p).into()).collect(),
        ..at(4.0)
    }
}

/// (node, group) by the manifest, and the pages' groups in order.
fn groups(page_by: &[&str]) -> (BTreeSet<(String, String)>, Vec<String>) {
    let b = bake(&level(), &settings(page_by));
    let (files, report) = b.files().expect("written");
    let (_, json) = (files.iter())
        .find(|(name, _)| name.ends_with(".lightmap.json"))
        .expect("a manifest");
    let v: Value = serde_json::from_slice(json).expect("JSON");
    let pages: Vec<String> = (v["pages"].as_array().expect("pages").iter())
        .map(|p| p["group"].as_str().unwrap_or("-").to_string())
        .collect();
    let said: Vec<String> = (report.layout.page_groups.iter())
        .map(|g| if g.is_empty() { "-".into() } else { g.clone() })
        .collect();
    assert_eq!(pages, said);
    let nodes = v["nodes"].as_array().expect("nodes").iter().map(|n| {
        let page = n["page"].as_u64().expect("a page") as usize;
        let name = n["name"].as_str().expect("a name");
        (name.to_string(), pages[page].clone())
    });
    (nodes.collect(), pages)
}

fn pairs(expected: &[(&str, &str)]) -> BTreeSet<(String, String)> {
    let own = |(a, b): &(&str, &str)| (a.to_string(), b.to_string());
    expected.iter().map(own).collect()
}

#[test]
fn extras_name_groups_and_children_inherit_them() {
    let (nodes, pages) = groups(&[]);
    let expected = [
        ("loose", "-"),
        ("room_1 a", "cellar"),
        ("room_1 b", "attic"),
        ("room_2 a", "-"),
        ("room_2 b", "-"),
    ];
    assert_eq!(nodes, pairs(&expected));
    assert_eq!(pages, ["-", "attic", "cellar"]);
}

#[test]
fn patterns_name_groups_by_node_and_then_by_material() {
    let (nodes, pages) = groups(&["room_?", "moss"]);
    let expected = [
        ("loose", "moss"),
        ("room_1 a", "cellar"),
        ("room_1 b", "attic"),
        ("room_2 a", "room_2"),
        ("room_2 b", "room_2"),
    ];
    assert_eq!(nodes, pairs(&expected));
    assert_eq!(pages, ["attic", "cellar", "moss", "room_2"]);
}

#[test]
fn charts_do_not_depend_on_groups() {
    let lumels = |page_by: &[&str]| {
        let b = bake(&level(), &settings(page_by));
        crate::common::lumels_of(&b, "room_2 a").len()
    };
    assert_eq!(lumels(&[]), lumels(&["room_2"]));
}

#[test]
fn a_pattern_without_a_match_is_an_error_that_lists_names() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("level.glb");
    std::fs::write(&path, level()).expect("written");
    let e = lumel::bake(&path, &settings(&["room_*", "kitchen"]), &Silent).expect_err("no kitchen");
    assert!(matches!(e, Error::Setting(_)));
    let text = e.to_string();
    assert!(
        text.contains("\"kitchen\"") && text.contains("\"moss\""),
        "{text}"
    );
}
