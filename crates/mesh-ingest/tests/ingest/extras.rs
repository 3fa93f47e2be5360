//! `extras.lumel` of nodes, materials, scenes and the root.

use glam::{Vec3, Vec4};
use image::{Rgba, RgbaImage};
use mesh_ingest::{Error, LeftOutReason, Loaded, Soup};
use serde_json::{Value, json};

use super::build::{Doc, QUAD, UNIT};
use super::materials::textured;

/// A lit triangle whose material has these extras.
fn with_extras(lumel: Value) -> Doc {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    doc.json["materials"] = json!([{"emissiveFactor": [1, 0.5, 0], "extras": {"lumel": lumel}}]);
    doc
}

fn warnings(loaded: &Loaded) -> Vec<(&str, &str)> {
    let list = loaded.report.warnings.iter();
    list.map(|w| (w.path.as_str(), w.message.as_str()))
        .collect()
}

#[test]
fn values_that_cannot_be_used_are_named_and_ignored() {
    let material = |key: &str, value: Value| {
        let doc = with_extras(json!({key: value}));
        (doc, format!("materials[0].extras.lumel.{key}"))
    };
    let node = |key: &str, value: Value| {
        let mut doc = with_extras(json!({}));
        doc.json["nodes"][0]["extras"] = json!({"lumel": {key: value}});
        (doc, format!("nodes[0].extras.lumel.{key}"))
    };
    let scene = |key: &str, value: Value| {
        let mut doc = with_extras(json!({}));
        doc.json["scenes"][0]["extras"] = json!({"lumel": {key: value}});
        (doc, format!("scenes[0].extras.lumel.{key}"))
    };
    let root = |key: &str, value: Value| {
        let mut doc = with_extras(json!({}));
        doc.json["extras"] = json!({"lumel": {key: value}});
        (doc, format!("extras.lumel.{key}"))
    };
    let boolean = "expected true or false; ignored";
    let scale = "expected a number of at least 0; ignored";
    let limit = "expected a number from 0 to 1; ignored";
    let unknown = "unknown key; known keys are";
    for ((doc, path), message) in [
        (material("exclude", json!("yes")), boolean),
        (material("exclude", json!(1)), boolean),
        (material("occluder", json!(null)), boolean),
        (material("emitScale", json!(-1)), scale),
        (material("emitScale", json!("2")), scale),
        (material("emitScale", json!(1e300)), scale),
        (material("emitScale", json!([2])), scale),
        (material("maxReflectance", json!(1.01)), limit),
        (material("maxReflectance", json!(-0.1)), limit),
        (material("maxReflectance", json!(true)), limit),
        (material("emitscale", json!(2)), unknown),
        (material("radius", json!(2)), unknown),
        (node("exclude", json!("true")), boolean),
        (node("bake", json!(1)), boolean),
        (node("occluder", json!({})), boolean),
        (node("emitScale", json!(2)), unknown),
        (node("ocluder", json!(true)), unknown),
        (scene("maxReflectance", json!(2)), limit),
        (scene("bake", json!(true)), unknown),
        (root("emitScale", json!(false)), scale),
        (root("maxreflectance", json!(0.5)), unknown),
    ] {
        let loaded = doc.load().unwrap();
        let warned = warnings(&loaded);
        assert!(
            warned.len() == 1 && warned[0].0 == path && warned[0].1.contains(message),
            "{path}: {warned:?}"
        );
        let key = if message == unknown {
            "extras.unknown_keys"
        } else {
            "extras.ignored"
        };
        assert_eq!(loaded.report.counts[key], 1, "{path}");
        let m = &loaded.scene.materials[0];
        assert_eq!(
            (m.emissive, m.max_reflectance, m.occluder_only),
            (Vec3::new(1.0, 0.5, 0.0), 1.0, false),
            "{path}"
        );
        assert!(!loaded.scene.instances[0].occluder, "{path}");
    }
}

#[test]
fn extras_of_others_are_none_of_our_business() {
    let mut doc = with_extras(json!({"emitScale": 4}));
    doc.json["nodes"][0]["extras"] =
        json!({"lumel": {"radius": 0.1, "angle": 0.5, "density": 2}, "exclude": true});
    doc.json["scenes"][0]["extras"] = json!("text");
    doc.json["extras"] = json!([{"lumel": 1}]);
    doc.json["meshes"][0]["extras"] = json!({"targetNames": []});
    assert_eq!(warnings(&doc.load().unwrap()), []);
    doc.json["extras"] = json!({"lumel": "off"});
    let loaded = doc.load().unwrap();
    assert_eq!(
        warnings(&loaded),
        [("extras.lumel", "found \"off\", expected an object; ignored")]
    );
    // Places where exporters put a mesh's properties, which are ignored.
    doc.json["extras"] = json!(null);
    doc.json["meshes"][0]["extras"] = json!({"lumel": {"exclude": true}});
    let loaded = doc.load().unwrap();
    assert_eq!(warnings(&loaded)[0].0, "meshes[0].extras.lumel");
}

#[test]
fn the_material_overrides_the_scene_and_the_scene_the_root() {
    let mut doc = with_extras(json!({}));
    let read = |doc: &Doc| {
        let m = doc.load().unwrap().scene.materials[0].clone();
        (m.emissive.x, m.max_reflectance)
    };
    assert_eq!(read(&doc), (1.0, 1.0));
    doc.json["extras"]["lumel"] = json!({"emitScale": 2, "maxReflectance": 0.9});
    assert_eq!(read(&doc), (2.0, 0.9));
    doc.json["scenes"][0]["extras"]["lumel"] = json!({"emitScale": 3});
    // Extras of another scene do not count.
    doc.push(
        "scenes",
        json!({"nodes": [0], "extras": {"lumel": {"emitScale": 100}}}),
    );
    assert_eq!(read(&doc), (3.0, 0.9));
    doc.json["materials"][0]["extras"]["lumel"] = json!({"emitScale": 0, "maxReflectance": 0.25});
    assert_eq!(read(&doc), (0.0, 0.25));
    // The glTF default material follows the scene too.
    let m = doc.load().unwrap().scene.materials[1].clone();
    assert_eq!((m.gltf_material, m.max_reflectance), (None, 0.9));
}

#[test]
fn a_word_for_all_has_exceptions() {
    let mut doc = with_extras(json!({"occluder": false}));
    doc.push("materials", json!({"emissiveFactor": [1, 1, 1]}));
    doc.json["extras"]["lumel"] = json!({"occluder": true});
    let scene = doc.load().unwrap().scene;
    let flags: Vec<bool> = scene.materials.iter().map(|m| m.occluder_only).collect();
    assert_eq!(flags, [false, true, true]);
    assert_eq!(scene.materials[1].emissive, Vec3::ZERO);
}

#[test]
fn primitives_of_excluded_materials_are_left_out_and_counted() {
    let mut doc = with_extras(json!({"exclude": true}));
    let kept = doc.push("materials", json!({}));
    let position = doc.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].clone();
    let mesh = doc.mesh(json!([
        {"attributes": {"POSITION": position}, "material": 0},
        {"attributes": {"POSITION": position}, "material": kept},
    ]));
    doc.root(json!({"mesh": mesh, "translation": [0, 0, 2]}));
    let loaded = doc.load().unwrap();
    assert_eq!(loaded.report.counts["primitives.excluded"], 2);
    assert_eq!(loaded.report.counts["instances.empty"], 1);
    assert_eq!(loaded.scene.instances.len(), 1);
    // The remaining primitive knows its index in the document.
    assert_eq!(loaded.scene.meshes[0].primitives[0].gltf_primitive, 1);
    doc.json["materials"][1]["extras"]["lumel"]["exclude"] = json!(true);
    assert!(matches!(doc.load(), Err(Error::NoTriangles { .. })));
}

#[test]
fn emission_scales_and_stays_finite() {
    let read = |scale: f64| {
        let loaded = with_extras(json!({"emitScale": scale})).load().unwrap();
        (loaded.scene.materials[0].emissive, loaded.report)
    };
    assert_eq!(read(2.5).0, Vec3::new(2.5, 1.25, 0.0));
    let (emissive, report) = read(3e38);
    assert!(
        emissive.is_finite() && report.counts.is_empty(),
        "{emissive}"
    );
    let mut doc = with_extras(json!({"emitScale": 3e38}));
    doc.json["materials"][0]["extensions"]["KHR_materials_emissive_strength"] =
        json!({"emissiveStrength": 100});
    let loaded = doc.load().unwrap();
    assert_eq!(loaded.scene.materials[0].emissive.x, f32::MAX);
    assert_eq!(loaded.report.counts["materials.emission_clamped"], 1);
}

#[test]
fn occluders_block_and_do_nothing_else() {
    for by_node in [false, true] {
        let mut doc = with_extras(json!({"occluder": !by_node}));
        if by_node {
            let child = doc.node(json!({"mesh": 0}));
            let spared = doc.node(
                json!({"mesh": 0, "translation": [3, 0, 0], "extras": {"lumel": {"occluder": false}}}),
            );
            doc.json["nodes"][0] =
                json!({"children": [child, spared], "extras": {"lumel": {"occluder": true}}});
        }
        let scene = doc.load().unwrap().scene;
        let soup = Soup::build(&scene);
        assert!(scene.only_occludes(&soup, 0));
        assert!(!scene.receives(0, 0) && !scene.has_lightmap(0));
        assert_eq!(scene.base_color(&soup, 0, 0.2, 0.2), Vec4::W);
        assert_eq!(scene.mean_base_color(&soup, 0, 64).truncate(), Vec3::ZERO);
        assert_eq!(scene.emission(&soup, 0, 0.2, 0.2), Vec3::ZERO);
        assert_eq!(scene.mean_emission(&soup, 0, 64), Vec3::ZERO);
        assert_eq!(scene.transmittance(&soup, 0, 0.2, 0.2), Vec3::ZERO);
        if by_node {
            assert!(scene.receives(1, 0) && scene.has_lightmap(1));
            assert_eq!(scene.base_color(&soup, 1, 0.2, 0.2), Vec4::ONE);
            assert_eq!(scene.emission(&soup, 1, 0.2, 0.2), Vec3::new(1.0, 0.5, 0.0));
        }
    }
}

#[test]
fn what_does_not_shine_needs_no_emissive_image() {
    let mut doc = with_extras(json!({"emitScale": 0}));
    doc.json["materials"][0]["emissiveTexture"] = json!({"index": 0});
    let junk = doc.view(b"not an image");
    doc.push(
        "images",
        json!({"bufferView": junk, "mimeType": "image/png"}),
    );
    doc.push("textures", json!({"source": 0}));
    assert!(doc.load().unwrap().scene.images[0].is_none());
    doc.json["materials"][0]["extras"]["lumel"] = json!({"occluder": true});
    assert!(doc.load().unwrap().scene.images[0].is_none());
    doc.json["materials"][0]["extras"]["lumel"] = json!({"emitScale": 0.1});
    assert_eq!(doc.load().unwrap_err().exit_code(), 3);
}

#[test]
fn an_excluded_node_is_no_occluder() {
    let mut doc = with_extras(json!({}));
    doc.root(
        json!({"mesh": 0, "extras": {"lumel": {"occluder": true, "exclude": true}}, "translation": [2, 0, 0]}),
    );
    let loaded = doc.load().unwrap();
    assert_eq!(loaded.report.left_out[0].reason, LeftOutReason::Excluded);
    assert_eq!(loaded.scene.instances.len(), 1);
}

#[test]
fn an_occluder_does_not_take_the_place_of_what_it_lies_on() {
    // The occluder comes first with the same winding: a plain duplicate rule would keep it and
    // leave the wall black.
    let mut doc = with_extras(json!({"occluder": true}));
    doc.push("materials", json!({}));
    let wall = doc.mesh(json!([{"attributes": {"POSITION": 0}, "material": 1}]));
    doc.root(json!({"mesh": wall}));
    let scene = doc.load().unwrap().scene;
    let soup = Soup::build(&scene);
    assert_eq!((soup.len(), soup.dropped_duplicate), (1, 1));
    assert!(!scene.only_occludes(&soup, 0));
}

#[test]
fn reflectance_is_limited_where_it_exceeds_and_counted_where_it_is_worn() {
    let base = |c: f32, texture: bool| {
        let mut pbr = json!({"baseColorFactor": [c, c, c, 1]});
        if texture {
            pbr["baseColorTexture"] = json!({"index": 0});
        }
        json!({"pbrMetallicRoughness": pbr})
    };
    let grey = RgbaImage::from_fn(4, 4, |x, _| {
        Rgba(
            [if x == 3 { 188 } else { 20 }; 3]
                .iter()
                .chain(&[255])
                .copied()
                .collect::<Vec<u8>>()
                .try_into()
                .unwrap(),
        )
    });
    // 188 is 0.503 in linear light.
    for (factor, texture, color, limit, touched) in [
        (1.0, false, None, 0.98, 1),
        (0.98, false, None, 0.98, 0),
        (1.0, true, None, 0.98, 0),
        (1.0, true, None, 0.5, 1),
        (0.9, true, None, 0.5, 0),
        (1.0, false, Some(0.5), 0.98, 0),
        (1.0, false, Some(0.5), 0.4, 1),
    ] {
        let mut doc = textured(base(factor, texture), Some(&grey));
        if let Some(c) = color {
            let colors = doc.floats(&[[c; 3]; 4]);
            doc.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
        }
        // Unused, so not counted: neither this nor the white default.
        doc.push("materials", json!({}));
        let mut scene = doc.load().unwrap().scene;
        let before = scene.materials[0].base_color;
        let case = format!("{factor} {texture} {color:?} {limit}");
        assert_eq!(scene.limit_reflectance(limit), touched, "{case}");
        assert_eq!(scene.materials[0].base_color, before, "{case}");
        let soup = Soup::build(&scene);
        for t in 0..soup.len() as u32 {
            for (u, v) in [(0.1, 0.1), (0.8, 0.1), (0.1, 0.8)] {
                let c = scene.base_color(&soup, t, u, v).truncate();
                assert!(c.max_element() <= limit, "{case}: {c}");
            }
        }
    }
    // Texels below the limit keep their value: the factor is not lowered.
    let mut scene = textured(base(1.0, true), Some(&grey)).load().unwrap().scene;
    let soup = Soup::build(&scene);
    let dark = scene.base_color(&soup, 0, 0.3, 0.3);
    assert_eq!(scene.limit_reflectance(0.5), 1);
    assert_eq!(scene.base_color(&soup, 0, 0.3, 0.3), dark);
    // A material's own limit stays if it is lower, and occluders reflect nothing that could exceed.
    let mut doc = Doc::with_triangles(&QUAD[..3]);
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    doc.json["materials"] = json!([{"extras": {"lumel": {"maxReflectance": 0.3}}}]);
    let mut scene = doc.load().unwrap().scene;
    assert_eq!(scene.limit_reflectance(0.98), 1);
    assert_eq!(scene.materials[0].max_reflectance, 0.3);
    doc.json["materials"][0]["extras"]["lumel"]["occluder"] = json!(true);
    assert_eq!(doc.load().unwrap().scene.limit_reflectance(0.1), 0);
}

#[test]
fn density_is_inherited_from_the_nearest_node_the_scene_or_the_root() {
    let density = |doc: &Doc| {
        let loaded = doc.load().unwrap();
        (loaded.scene.instances[0].density, warnings(&loaded).len())
    };
    let mut doc = with_extras(json!({}));
    assert_eq!(density(&doc), (1.0, 0));
    doc.json["extras"] = json!({"lumel": {"density": 3}});
    assert_eq!(density(&doc), (3.0, 0));
    doc.json["scenes"][0]["extras"] = json!({"lumel": {"density": 0.5}});
    assert_eq!(density(&doc), (0.5, 0));
    doc.json["nodes"][0]["extras"] = json!({"lumel": {"density": 0}});
    assert_eq!(density(&doc), (0.0, 0));
    let loaded = doc.load().unwrap();
    assert!(loaded.scene.has_lightmap(0) && !loaded.scene.has_lumels(0));
    for bad in [json!(-1), json!(1001), json!("2"), json!(true)] {
        doc.json["nodes"][0]["extras"] = json!({"lumel": {"density": bad}});
        assert_eq!(density(&doc), (0.5, 1), "{bad}");
    }
}
