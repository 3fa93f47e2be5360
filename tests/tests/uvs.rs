//! Density of nodes and stable coordinates through the whole pipeline, checked in the written
//! files.

use std::path::Path;

use crate::common::{at, bake};
use glam::{Quat, Vec3};
use lumel::atlas::{LayoutOptions, layout, separate_unlike};
use lumel::mesh_ingest::{LoadOptions, Soup};
use lumel::{Bake, Quality, Settings};
use lumel_tests::geometry::{Geometry, cuboid, grid};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use serde_json::{Value, json};

fn draft(texels_per_unit: f32) -> Settings {
    Settings {
        quality: Quality::Draft,
        ..at(texels_per_unit)
    }
}

/// JSON and binary chunk of a GLB.
fn parse(bytes: &[u8]) -> (Value, Vec<u8>) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4")) as usize;
    let end = 20 + word(12);
    let json = serde_json::from_slice(&bytes[20..end]).expect("JSON");
    (json, bytes.get(end + 8..).unwrap_or_default().to_vec())
}

/// The written files: lightmapped scene, vertex-lit scene, manifest.
fn written(bake: &Bake) -> ((Value, Vec<u8>), Value, Value) {
    let dir = tempfile::tempdir().expect("a folder");
    bake.write(dir.path()).expect("written");
    let read = |name: &str| std::fs::read(dir.path().join(Path::new(name))).expect("a file");
    let manifest = serde_json::from_slice(&read("scene.lightmap.json")).expect("JSON");
    (
        parse(&read("scene.glb")),
        parse(&read("scene.vertex.glb")).0,
        manifest,
    )
}

/// Bytes of a vertex attribute of the first primitive of the mesh that `node` has.
fn attribute((doc, bin): &(Value, Vec<u8>), node: &str, name: &str) -> Vec<u8> {
    let nodes = doc["nodes"].as_array().expect("nodes");
    let node = nodes.iter().find(|n| n["name"] == node).expect("the node");
    let mesh = &doc["meshes"][node["mesh"].as_u64().expect("a mesh") as usize];
    let index = |v: &Value| v.as_u64().unwrap_or(0) as usize;
    let accessor = &doc["accessors"][index(&mesh["primitives"][0]["attributes"][name])];
    let view = &doc["bufferViews"][index(&accessor["bufferView"])];
    assert_eq!(
        (&accessor["type"], &accessor["componentType"]),
        (&json!("VEC2"), &json!(5126))
    );
    assert!(view["byteStride"].as_u64().is_none_or(|s| s == 8), "{view}");
    let first = index(&view["byteOffset"]) + index(&accessor["byteOffset"]);
    bin[first..first + 8 * index(&accessor["count"])].to_vec()
}

fn node_of<'a>(doc: &'a Value, name: &str) -> &'a Value {
    let nodes = doc["nodes"].as_array().expect("nodes");
    nodes.iter().find(|n| n["name"] == name).expect("the node")
}

/// A level of pads and a lamp; each pad is (name, extras, children by the same rule).
fn pads(extras: Value, build: impl FnOnce(&mut GltfBuilder, usize)) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.5; 3]));
    let g = grid(Vec3::ZERO, Vec3::X * 2.0, -Vec3::Z * 2.0, [1, 1]).bare();
    let mesh = b.mesh("pad", &[(&g, white)]);
    build(&mut b, mesh);
    let lamp = b.light("lamp", Light::Point([4.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: Vec3::new(3.0, 3.0, -1.0),
        light: Some(lamp),
        ..Node::default()
    });
    with_scene_extras(b.finish(), extras)
}

/// Puts extras on scene 0.
fn with_scene_extras(glb: Vec<u8>, extras: Value) -> Vec<u8> {
    let (mut doc, bin) = parse(&glb);
    doc["scenes"][0]["extras"] = extras;
    let mut text = serde_json::to_vec(&doc).expect("JSON");
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + bin.len();
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((total as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

#[test]
fn density_is_a_factor_that_children_inherit_until_one_says_otherwise() {
    let pad = |name: &str, x: f32, mesh, density: Option<f64>, children| Node {
        name: name.into(),
        translation: Vec3::X * x,
        mesh: Some(mesh),
        extras: density.map(|d| json!({"lumel": {"density": d}})),
        children,
        ..Node::default()
    };
    let glb = pads(json!({"lumel": {"density": 0.5}}), |b, mesh| {
        let own = b.child(pad("own", 3.0, mesh, Some(4.0), vec![]));
        let heir = b.child(pad("heir", 6.0, mesh, None, vec![]));
        b.node(pad("parent", 0.0, mesh, Some(2.0), vec![own, heir]));
        b.node(pad("plain", 12.0, mesh, None, vec![]));
        b.node(pad("none", 15.0, mesh, Some(0.0), vec![]));
    });
    let baked = bake(&glb, &draft(8.0));
    assert_eq!(baked.report.warnings, [""; 0]);
    let width = |name: &str| {
        let instances = &baked.loaded.scene.instances;
        let i = instances
            .iter()
            .position(|i| i.name == name)
            .expect("the node");
        let rect = baked.layout.placements[i].rect;
        assert_eq!(rect.w, rect.h, "{name}");
        rect.w
    };
    // Two metres at 8 per metre times the factor, and a texel on both sides; rectangles are whole
    // blocks of 4 texels.
    let widths = ["plain", "parent", "heir", "own", "none"].map(width);
    assert_eq!(
        widths,
        [8 + 2, 32 + 2, 32 + 2, 64 + 2, 0].map(|w: u32| w.next_multiple_of(4))
    );

    let (scene, vertex, manifest) = written(&baked);
    let listed: Vec<&Value> = manifest["nodes"]
        .as_array()
        .expect("nodes")
        .iter()
        .collect();
    assert_eq!(listed.len(), 4, "{listed:?}");
    assert!(listed.iter().all(|n| n["name"] != "none"));
    assert_eq!(node_of(&scene.0, "none")["extras"].get("lightmap"), None);
    assert!(node_of(&scene.0, "plain")["extras"]["lightmap"]["page"].is_u64());
    // It has light in the vertex-coloured file.
    let mesh = node_of(&vertex, "none")["mesh"].as_u64().expect("a mesh") as usize;
    let lit = &vertex["meshes"][mesh]["primitives"][0]["attributes"]["COLOR_0"];
    assert!(lit.is_u64(), "{vertex}");
    // A mesh for each density: 16, 64 and 128 lumels need different padding in the unit square.
    assert_eq!(scene.0["meshes"].as_array().map(Vec::len), Some(3));
    let same =
        |a: &str, b: &str| attribute(&scene, a, "TEXCOORD_1") == attribute(&scene, b, "TEXCOORD_1");
    assert!(same("parent", "heir") && !same("parent", "plain") && !same("own", "plain"));
}

#[test]
fn a_level_with_density_0_everywhere_is_refused() {
    let glb = pads(json!({"lumel": {"density": 0}}), |b, mesh| {
        b.node(Node::of_mesh("pad", mesh));
    });
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("scene.glb");
    std::fs::write(&path, glb).expect("written");
    let refused = lumel::bake(&path, &draft(8.0), &lumel::Silent).err();
    let message = refused.map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("density 0"), "{message}");
}

/// The objects of a level (crates, a table-like prop, a floor), in this order.
fn level(order: &[&str]) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.5; 3]));
    let crate_of = cuboid(Vec3::ZERO, Vec3::new(1.0, 1.3, 0.7), 2).bare();
    let prop = Geometry::union(
        &[0.0, 1.1].map(|x| cuboid(Vec3::X * x, Vec3::new(x + 0.2, 1.0, 0.2), 1).bare()),
    );
    let floor = grid(
        Vec3::new(-5.0, -0.01, 5.0),
        Vec3::X * 10.0,
        -Vec3::Z * 10.0,
        [3, 3],
    )
    .bare();
    let mut meshes = std::collections::BTreeMap::new();
    for (i, &name) in order.iter().enumerate() {
        let kind = name.trim_end_matches(char::is_numeric);
        let mesh = *meshes.entry(kind).or_insert_with(|| {
            let g = match kind {
                "crate" => &crate_of,
                "prop" => &prop,
                _ => &floor,
            };
            b.mesh(kind, &[(g, white)])
        });
        b.node(Node {
            name: name.into(),
            translation: Vec3::new(2.0 * i as f32, 0.0, 0.0),
            rotation: Quat::from_rotation_y(0.4 * i as f32),
            mesh: Some(mesh),
            ..Node::default()
        });
    }
    let lamp = b.light("lamp", Light::Point([4.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: Vec3::new(0.6, 3.0, 0.2),
        light: Some(lamp),
        ..Node::default()
    });
    b.finish()
}

#[test]
fn a_mesh_has_the_same_bytes_of_coordinates_in_any_company() {
    // Charts that end at shadows depend on what casts them.
    let settings = Settings {
        cut_charts: false,
        ..draft(6.0)
    };
    let alone = |name: &str| {
        let (scene, ..) = written(&bake(&level(&[name]), &settings));
        attribute(&scene, name, "TEXCOORD_1")
    };
    let (of_crate, of_prop) = (alone("crate1"), alone("prop1"));
    assert_ne!(of_crate, of_prop);
    for order in [
        ["floor", "crate1", "prop1", "crate2"],
        ["prop1", "crate2", "floor", "crate1"],
    ] {
        let (scene, ..) = written(&bake(&level(&order), &settings));
        assert_eq!(
            scene.0["meshes"].as_array().map(Vec::len),
            Some(3),
            "shared"
        );
        for name in ["crate1", "crate2"] {
            assert!(
                attribute(&scene, name, "TEXCOORD_1") == of_crate,
                "{name} in {order:?}"
            );
        }
        assert!(
            attribute(&scene, "prop1", "TEXCOORD_1") == of_prop,
            "{order:?}"
        );
    }
}

#[test]
fn one_prop_more_leaves_the_automatic_density_and_so_all_coordinates() {
    // The pipeline only up to the charts, because 200,000 lumels would take long.
    let of = |order: &[&str]| {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("scene.glb");
        std::fs::write(&path, level(order)).expect("written");
        let mut loaded = lumel::mesh_ingest::load(&path, &LoadOptions::default()).expect("a scene");
        separate_unlike(&mut loaded.scene);
        let soup = Soup::build(&loaded.scene);
        let options = LayoutOptions::default();
        let (layout, report) = layout(&loaded.scene, &soup, &options, &|_| true).expect("a layout");
        let crates = loaded.scene.meshes.iter().position(|m| m.name == "crate");
        let atlas = &layout.meshes[crates.expect("the crate")];
        (
            report.texels_per_unit,
            format!("{:?} {:?}", atlas.size, atlas.primitives),
        )
    };
    // The prop adds 1.4 % to the level's surface; a step of the density is 26 % of it.
    let before = of(&["floor", "crate1", "prop1"]);
    assert!(before == of(&["floor", "crate1", "prop1", "prop2"]));
    assert!(before == of(&["floor", "crate1"]));
}
