//! Files, URIs, versions, extensions.

use mesh_ingest::{Digest, Error, LoadOptions, load};
use serde_json::json;

use super::build::{Doc, UNIT, load_bytes, paths};

fn options() -> LoadOptions {
    LoadOptions::default()
}

#[test]
fn buffers_may_have_awkward_names() {
    let folder = tempfile::tempdir().unwrap();
    let doc = Doc::with_triangles(&UNIT);
    for (name, uri) in [
        ("plain.bin", "plain.bin"),
        ("with space.bin", "with%20space.bin"),
        ("with space.bin", "with space.bin"),
        ("ünïcode❤.bin", "ünïcode❤.bin"),
        ("ünïcode❤.bin", "%C3%BCn%C3%AFcode%E2%9D%A4.bin"),
        ("100%25.bin", "100%25.bin"),
    ] {
        let mut json = doc.json.clone();
        json["buffers"][0] = json!({"byteLength": doc.bin.len(), "uri": uri});
        std::fs::write(folder.path().join(name), &doc.bin).unwrap();
        let file = folder.path().join("scene.gltf");
        std::fs::write(&file, json.to_string()).unwrap();
        let loaded = load(&file, &options()).unwrap_or_else(|e| panic!("{uri}: {e}"));
        let inputs = loaded.document.inputs();
        let files: Vec<_> = inputs.iter().map(|i| i.file.clone()).collect();
        assert_eq!(files, [file.clone(), folder.path().join(name)]);
        assert_eq!(inputs[1].digest, Some(Digest::of(&doc.bin)));
        assert_eq!(loaded.report.files, [uri]);
        assert!(!loaded.document.is_binary());
        std::fs::remove_file(folder.path().join(name)).unwrap();
        assert!(
            matches!(load(&file, &options()), Err(Error::Io { .. })),
            "{uri}"
        );
    }
}

/// Some writers do not distinguish integers. The validator accepts `1.0`, and writers of the
/// document must see an index.
#[test]
fn integers_may_be_written_as_floats() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["nodes"][0]["translation"] = json!([1.0, 2.0, 3.0]);
    doc.json["nodes"][0]["extras"] = json!({"count": 2.0});
    doc.root(json!({"children": [2]}));
    doc.node(json!({"mesh": 0}));
    doc.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
    let plain = doc.load().expect("it loads");

    // Turns all integers of the document, except in extras, into floats.
    fn float(value: &mut serde_json::Value) {
        match value {
            serde_json::Value::Number(n) => *value = json!(n.as_f64()),
            serde_json::Value::Array(list) => list.iter_mut().for_each(float),
            serde_json::Value::Object(members) => members.values_mut().for_each(float),
            _ => {}
        }
    }
    float(&mut doc.json);
    assert!(doc.json.to_string().contains(r#""children":[2.0]"#));
    let loaded = doc.load().expect("it loads");
    assert_eq!(loaded.document.json(), plain.document.json());
    assert_eq!(loaded.scene.instances.len(), 2);
    for bad in [json!([2.5]), json!([-1.0]), json!([1e300]), json!(["2"])] {
        doc.json["nodes"][1]["children"] = bad;
        assert_eq!(paths(doc.load()), ["nodes[1].children[0]"]);
    }
}

#[test]
fn data_uris_need_no_files() {
    // The 36 bytes of the unit triangle, with and without padding.
    let text = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let doc = Doc::with_triangles(&UNIT);
    for uri in [
        format!("data:application/octet-stream;base64,{text}"),
        format!("DATA:;base64,{text}AA%3D%3D"),
        format!("data:application/gltf-buffer;base64,{}%41", &text[..47]),
    ] {
        let mut json = doc.json.clone();
        json["buffers"][0] = json!({"byteLength": 36, "uri": uri});
        let loaded = load_bytes(json.to_string().as_bytes(), &options())
            .unwrap_or_else(|e| panic!("{uri}: {e}"));
        assert_eq!(loaded.document.buffer(0), doc.bin);
    }
    let mut json = doc.json.clone();
    json["buffers"][0] = json!({"byteLength": 36, "uri": "data:;base64,A*"});
    assert_eq!(
        paths(load_bytes(json.to_string().as_bytes(), &options())),
        ["buffers[0].uri"]
    );
    json["buffers"][0]["uri"] = json!("https://example.invalid/a.bin");
    assert_eq!(
        load_bytes(json.to_string().as_bytes(), &options())
            .unwrap_err()
            .exit_code(),
        4
    );
}

#[test]
fn what_is_not_gltf_2_is_told_apart() {
    for (bytes, code) in [
        (&b""[..], 3),
        (b"PNG", 3),
        (b"{", 3),
        (b"[]", 3),
        (b"{}", 3),
        (b"\xef\xbb\xbf{}", 3),
        (br#"{"asset":{"version":"1.0"}}"#, 4),
        (br#"{"meshes":{},"accessors":{}}"#, 4),
        (br#"{"asset":{"version":"3.0"}}"#, 4),
        (br#"{"asset":{"version":"two"}}"#, 3),
        (br#"{"asset":{"version":"2.0"}}"#, 3),
        (b"glTF\x01\0\0\0\x0c\0\0\0", 4),
        (b"glTF\x02\0\0\0\x05\0\0\0", 3),
        (b"glTF\x02\0\0\0\x0c\0\0\0", 3),
        (b"glTF", 3),
    ] {
        let error = load_bytes(bytes, &options()).unwrap_err();
        assert_eq!(
            error.exit_code(),
            code,
            "{:?}: {error}",
            String::from_utf8_lossy(bytes)
        );
    }
    assert_eq!(
        load("no/such/file.glb".as_ref(), &options())
            .unwrap_err()
            .exit_code(),
        2
    );
    assert_eq!(
        load(std::env::temp_dir().as_path(), &options())
            .unwrap_err()
            .exit_code(),
        2
    );
}

#[test]
fn unknown_chunks_are_skipped() {
    let mut bytes = Doc::with_triangles(&UNIT).glb();
    bytes.extend([4, 0, 0, 0]);
    bytes.extend(b"XTRAdata");
    let length = (bytes.len() as u32).to_le_bytes();
    bytes[8..12].copy_from_slice(&length);
    assert!(load_bytes(&bytes, &options()).is_ok());
}

#[test]
fn required_extensions_are_judged() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["extensionsRequired"] = json!([
        "KHR_texture_transform",
        "KHR_materials_sheen",
        "KHR_xmp_json_ld"
    ]);
    assert_eq!(doc.load().unwrap().report.warnings.len(), 2);
    doc.json["extensionsRequired"] = json!(["ACME_bent_space"]);
    let error = doc.load().unwrap_err();
    assert_eq!(error.exit_code(), 4);
    assert!(error.to_string().contains("ACME_bent_space"), "{error}");
}

#[test]
fn compressed_views_without_data_name_their_buffer() {
    let mut doc = Doc::with_triangles(&UNIT);
    let placeholder = doc.push("buffers", json!({"byteLength": 36}));
    doc.json["bufferViews"][0] = json!({"buffer": placeholder, "byteLength": 36});
    assert_eq!(paths(doc.load()), [format!("buffers[{placeholder}]")]);
}

/// A document could exfiltrate any file that the process can read, because the output contains its
/// bytes.
#[test]
fn uris_stay_in_the_documents_folder_unless_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("level");
    std::fs::create_dir_all(inner.join("sub")).unwrap();
    let doc = Doc::with_triangles(&UNIT);
    let secret = folder.path().join("secret.bin");
    for file in [&secret, &inner.join("a.bin"), &inner.join("..b")] {
        std::fs::write(file, &doc.bin).unwrap();
    }
    let file = inner.join("scene.gltf");
    let load_uri = |uri: &str, allow_outside| {
        let mut json = doc.json.clone();
        json["buffers"][0] = json!({"byteLength": doc.bin.len(), "uri": uri});
        std::fs::write(&file, json.to_string()).unwrap();
        let options = LoadOptions {
            allow_outside,
            ..LoadOptions::default()
        };
        load(&file, &options).map(drop).map_err(|e| e.to_string())
    };
    for uri in ["a.bin", "./a.bin", "sub/../a.bin", "..b", "sub/.././a.bin"] {
        assert_eq!(load_uri(uri, false), Ok(()), "{uri}");
    }
    let absolute = secret.to_str().unwrap();
    let encoded = absolute.replacen('/', "%2F", 1);
    let mut out = vec!["../secret.bin", "sub/../../secret.bin", "%2e%2e/secret.bin"];
    if cfg!(unix) {
        std::os::unix::fs::symlink("../secret.bin", inner.join("link.bin")).unwrap();
        std::os::unix::fs::symlink("..", inner.join("up")).unwrap();
        out.extend(["link.bin", "up/secret.bin"]);
        std::os::unix::fs::symlink("a.bin", inner.join("near.bin")).unwrap();
        assert_eq!(load_uri("near.bin", false), Ok(()));
    }
    for uri in &out {
        let error = load_uri(uri, false).expect_err(uri);
        assert!(error.contains("--allow-outside"), "{uri}: {error}");
        assert_eq!(load_uri(uri, true), Ok(()), "{uri}");
    }
    // The error must not reveal whether the file exists.
    assert!(
        load_uri("../none.bin", false)
            .unwrap_err()
            .contains("--allow-outside")
    );
    for uri in [absolute, &encoded] {
        for allowed in [false, true] {
            let error = load_uri(uri, allowed).expect_err(uri);
            assert!(error.contains("absolute"), "{uri}: {error}");
        }
    }
    for uri in [
        "file:a.bin",
        "FILE:///a.bin",
        "c:a.bin",
        "x-y+z.1:a.bin",
        "http:a.bin",
    ] {
        let error = load_uri(uri, true).expect_err(uri);
        assert!(
            error.contains("relative path or a data URI"),
            "{uri}: {error}"
        );
    }
}

/// Only writers read them.
#[test]
fn pictures_that_light_does_not_need_stay_in_the_folder_too() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.glb");
    for (uri, place) in [
        ("../p.png", true),
        ("/p.png", true),
        ("https://a.invalid/p.png", false),
    ] {
        let mut doc = Doc::with_triangles(&UNIT);
        doc.json["images"] = json!([{"uri": uri}]);
        std::fs::write(&file, doc.glb()).unwrap();
        let loaded = load(&file, &options());
        if place {
            assert_eq!(paths(loaded), ["images[0].uri"], "{uri}");
        } else {
            let loaded = loaded.expect("it is left as it is");
            assert_eq!(loaded.report.warnings.len(), 1);
        }
    }
}
