//! Levels of detail and variants: which nodes stand in for others.

use mesh_ingest::{LoadOptions, Loaded, LodSource, Soup};
use serde_json::{Value, json};

use super::build::{Doc, UNIT, load_bytes, paths};

/// Nodes with one triangle each, at the root and in the same place unless specified otherwise.
fn nodes(nodes: &[Value]) -> Doc {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["nodes"] = json!([]);
    doc.json["scenes"][0]["nodes"] = json!([]);
    for node in nodes {
        let mut node = node.clone();
        node["mesh"] = json!(0);
        doc.root(node);
    }
    doc
}

fn named(name: &str, x: f64) -> Value {
    json!({"name": name, "translation": [x, 0, 0]})
}

/// For each instance in the order of nodes, the nodes that it stands in for.
fn stand_ins(loaded: &Loaded) -> Vec<Option<Vec<usize>>> {
    let scene = &loaded.scene;
    let mut out = vec![None; scene.instances.len()];
    for i in &scene.instances {
        let firsts = i.stands_in.map(|g| &scene.firsts[g]);
        let nodes = firsts.map(|f| f.iter().map(|k| scene.instances[*k].node).collect());
        out[i.node] = nodes;
    }
    out
}

fn check(doc: &Doc, expected: &[Option<&[usize]>]) -> Loaded {
    let loaded = doc.load().expect("it loads");
    let found = stand_ins(&loaded);
    let found: Vec<Option<&[usize]>> = found.iter().map(|f| f.as_deref()).collect();
    assert_eq!(found, expected, "{}", doc.json["nodes"]);
    let soup = Soup::build(&loaded.scene);
    assert_eq!(soup.unseen, expected.iter().flatten().count());
    for (i, instance) in loaded.scene.instances.iter().enumerate() {
        let [first, end] = soup.instance_ranges[i].map(|t| t as usize);
        let unseen = first >= soup.seen() && end > first;
        assert_eq!(unseen, instance.stands_in.is_some());
        assert!((first..end).all(|t| soup.sources[t].instance as usize == i));
    }
    loaded
}

#[test]
fn names_tell_levels_among_siblings_in_one_place() {
    let at = |name| named(name, 0.0);
    let first: Option<&[usize]> = Some(&[1]);
    // Nodes in any order; levels may be missing.
    let three = [at("a_LOD2"), at("a_lod0"), at("A_LOD1"), at("other")];
    check(&nodes(&three), &[first, None, first, None]);
    let later = [at("x"), at("a_LOD3"), at("a_LOD7")];
    check(&nodes(&later), &[None, None, first]);
    // Levels of other objects, in other places, single ones, and Blender's names of copies.
    check(
        &nodes(&[at("a_LOD0"), at("b_LOD1"), at("a_LOD")]),
        &[None; 3],
    );
    let shown = nodes(&[named("a_LOD0", 0.0), named("a_LOD1", 2.0)]);
    let loaded = check(&shown, &[None; 2]);
    assert_eq!(loaded.report.counts["lods.elsewhere"], 1);
    let copies = [
        named("a_LOD0", 0.0),
        named("a_LOD1", 0.0),
        named("a_LOD0.001", 5.0),
        named("a_LOD1.001", 5.0),
    ];
    check(&nodes(&copies), &[None, Some(&[0]), None, Some(&[2])]);
    let off = LoadOptions {
        ignore_lod_names: true,
        ..LoadOptions::default()
    };
    let loaded = load_bytes(&nodes(&three).glb(), &off).expect("it loads");
    assert_eq!(stand_ins(&loaded), vec![None; 4]);
    assert!(loaded.report.lods.is_empty());
}

#[test]
fn a_level_is_all_that_is_below_its_node() {
    let mut doc = nodes(&[
        json!({"name": "trunk"}),
        json!({"name": "leaves_LOD1"}),
        json!({"name": "coarse"}),
    ]);
    doc.json["scenes"][0]["nodes"] = json!([]);
    // A mark on an ancestor takes precedence over names below it.
    doc.root(json!({"name": "tree_LOD0", "children": [0, 1]}));
    doc.root(json!({"name": "tree_LOD1", "children": [2]}));
    let loaded = doc.load().expect("it loads");
    let found: Vec<(usize, Option<usize>)> = (loaded.scene.instances.iter())
        .map(|i| (i.node, i.stands_in))
        .collect();
    assert_eq!(found, [(0, None), (1, None), (2, Some(0))]);
    assert_eq!(loaded.scene.firsts, [vec![0, 1]]);
    let group = &loaded.report.lods[0];
    assert_eq!((group.by, group.name.as_str()), (LodSource::Name, "tree"));
    assert_eq!(
        (&group.levels[..], &group.stand_ins[..]),
        (&[0, 1][..], &[2][..])
    );
}

#[test]
fn extras_tell_levels_and_variants_wherever_they_are() {
    let lod = |level: u32| json!({"extras": {"lumel": {"lod": {"group": "g", "level": level}}}});
    let variant = |index: u32, name: &str| json!({"name": name, "translation": [9, 0, 0], "extras": {"lumel": {"variant": {"group": "g", "index": index}}}});
    let first: Option<&[usize]> = Some(&[0]);
    let loaded = check(&nodes(&[lod(1), lod(2), lod(2)]), &[None, first, first]);
    assert_eq!(loaded.report.lods[0].by, LodSource::Extras);
    // A level of a later variant copies the light of the first variant's finest level.
    let both = [
        variant(0, "a_LOD0"),
        variant(0, "a_LOD1"),
        variant(1, "b_LOD0"),
        variant(1, "b_LOD1"),
    ];
    let loaded = check(&nodes(&both), &[None, first, first, first]);
    let by: Vec<LodSource> = loaded.report.lods.iter().map(|g| g.by).collect();
    assert_eq!(by, [LodSource::Variant, LodSource::Name, LodSource::Name]);
    for (bad, key) in [
        (json!({"lod": 1}), "lod"),
        (json!({"lod": {"group": "g"}}), "lod"),
        (json!({"lod": {"group": 3, "level": 0}}), "lod"),
        (json!({"lod": {"group": "g", "level": -1}}), "lod"),
        (json!({"lod": {"group": "g", "level": 0.5}}), "lod"),
        (json!({"variant": {"group": "g", "level": 1}}), "variant"),
    ] {
        let loaded = check(&nodes(&[json!({"extras": {"lumel": bad}})]), &[None]);
        let warning = &loaded.report.warnings[0];
        assert_eq!(warning.path, format!("nodes[0].extras.lumel.{key}"));
        assert!(warning.message.contains("a whole number from 0 to 999"));
    }
}

#[test]
fn levels_of_msft_lod_need_no_place_in_the_scene() {
    let msft =
        |ids: &[usize]| json!({"extensions": {"MSFT_lod": {"ids": ids}}, "scale": [2, 2, 2]});
    let mut doc = nodes(&[msft(&[1, 2]), json!({}), json!({})]);
    let first: Option<&[usize]> = Some(&[0]);
    // In the scene graph, and then not.
    check(&doc, &[None, first, first]);
    doc.json["scenes"][0]["nodes"] = json!([0]);
    let loaded = check(&doc, &[None, first, first]);
    assert_eq!(loaded.report.lods[0].by, LodSource::MsftLod);
    // They take the place of the first: below its parent.
    doc.json["scenes"][0]["nodes"] = json!([]);
    doc.root(json!({"children": [0], "translation": [0, 7, 0]}));
    let loaded = check(&doc, &[None, first, first]);
    let heights = loaded.scene.instances.iter();
    assert!(heights.clone().all(|i| i.transform.translation.y == 7.0));
    assert_eq!(
        heights
            .filter(|i| i.transform.matrix3.x_axis.x == 2.0)
            .count(),
        1
    );
}

#[test]
fn levels_that_name_each_other_or_nobody_end_well() {
    let msft = |ids: Value| json!({"extensions": {"MSFT_lod": {"ids": ids}}});
    // In a ring, and of itself: each node is read once.
    let ring = nodes(&[msft(json!([1])), msft(json!([0]))]);
    let loaded = ring.load().expect("it loads");
    assert_eq!(loaded.scene.instances.len(), 2);
    let mut own = nodes(&[msft(json!([0, 0]))]);
    assert_eq!(own.load().expect("it loads").scene.instances.len(), 1);
    own.json["nodes"][0] = json!({"mesh": 0, "extensions": {"MSFT_lod": {"ids": [7]}}});
    assert_eq!(paths(own.load()), ["nodes[0].extensions.MSFT_lod.ids[0]"]);
    own.json["nodes"][0] = json!({"mesh": 0, "extensions": {"MSFT_lod": {"ids": "x"}}});
    assert_eq!(paths(own.load()), ["nodes[0].extensions.MSFT_lod.ids"]);
}
