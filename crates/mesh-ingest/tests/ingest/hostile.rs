//! Documents with false claims.

use mesh_ingest::{Error, Limits, LoadOptions, load};
use serde_json::json;

use super::build::{Doc, UNIT, load_bytes, paths};
use super::materials::textured;

#[test]
fn counts_that_nothing_backs_are_refused_unallocated() {
    // Four billion zeros.
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["accessors"][0] =
        json!({"componentType": 5126, "count": 4_000_000_000u64, "type": "VEC3"});
    let error = doc.load().unwrap_err();
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    assert_eq!(error.exit_code(), 3);

    // The same from a view of 36 bytes, and with a count that overflows.
    for count in [4_000_000_000u64, u64::MAX / 8, u64::MAX] {
        let mut doc = Doc::with_triangles(&UNIT);
        doc.json["accessors"][0]["count"] = json!(count);
        assert_eq!(paths(doc.load()), ["accessors[0]"], "{count}");
    }

    // Many accessors, each just below the limit.
    let mut doc = Doc::with_triangles(&UNIT);
    for _ in 0..100 {
        doc.push(
            "accessors",
            json!({"componentType": 5126, "count": 20_000_000, "type": "VEC3"}),
        );
    }
    assert_eq!(paths(doc.load()), ["accessors"]);

    // Offsets near the end of the address space.
    for key in ["byteOffset", "byteLength"] {
        let mut doc = Doc::with_triangles(&UNIT);
        doc.json["bufferViews"][0][key] = json!(u64::MAX);
        assert!(!paths(doc.load()).is_empty(), "{key}");
    }
}

#[test]
fn instancing_bombs_are_refused() {
    let mut doc = Doc::with_triangles(&UNIT);
    let zeros = doc.push(
        "accessors",
        json!({"componentType": 5126, "count": 20_000_000, "type": "VEC3"}),
    );
    doc.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({"TRANSLATION": zeros});
    assert!(matches!(doc.load(), Err(Error::Limit { .. })));

    let doc = Doc::with_triangles(&UNIT);
    let options = LoadOptions {
        limits: Limits {
            triangles: 0,
            ..Limits::default()
        },
        ..LoadOptions::default()
    };
    assert!(matches!(
        load_bytes(&doc.glb(), &options),
        Err(Error::Limit { .. })
    ));
}

#[test]
fn every_truncation_and_flip_ends_in_an_answer() {
    // Deterministic damage all over a file with most features; asserts only that nothing panics.
    let mut doc = Doc::with_triangles(&UNIT);
    let indices = doc.indices(&[0, 1, 2]);
    doc.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    doc.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    doc.json["materials"] = json!([{"emissiveFactor": [1, 2, 3], "alphaMode": "MASK"}]);
    doc.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([{"type": "spot"}]);
    doc.root(json!({"extensions": {"KHR_lights_punctual": {"light": 0}}}));
    let whole = doc.glb();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.glb");
    let outcome = |bytes: &[u8]| {
        std::fs::write(&file, bytes).unwrap();
        load(&file, &LoadOptions::default())
    };
    assert!(outcome(&whole).is_ok());
    for end in 0..whole.len() {
        assert!(outcome(&whole[..end]).is_err(), "cut at {end}");
    }
    for at in 0..whole.len() {
        for byte in [0xff, b'9'] {
            let mut damaged = whole.clone();
            damaged[at] = byte;
            let _ = outcome(&damaged);
        }
    }
}

#[test]
fn wrong_types_are_named_and_collected() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["accessors"][0]["count"] = json!("three");
    doc.json["bufferViews"][0]["byteLength"] = json!(-1);
    assert_eq!(
        paths(doc.load()),
        ["bufferViews[0].byteLength", "accessors[0].count"]
    );

    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["nodes"][0]["translation"] = json!([0, "1", 0]);
    assert_eq!(paths(doc.load()), ["nodes[0].translation[1]"]);
    doc.json["nodes"][0]["translation"] = json!([0, 1e300, 0]);
    assert_eq!(paths(doc.load()), ["nodes[0].translation[1]"]);
    // Parts that light does not need may be anything.
    doc.json["nodes"][0]["translation"] = json!([0, 1, 0]);
    doc.json["cameras"] = json!("none");
    doc.json["nodes"][0]["name"] = json!(7);
    assert!(doc.load().is_ok());
}

#[test]
fn extreme_coordinates_do_not_reach_the_scene() {
    let mut doc = Doc::with_triangles(&[[0.0, 0.0, 0.0], [3e38, 0.0, 0.0], [0.0, 3e38, 0.0]]);
    assert!(matches!(doc.load(), Err(Error::NoTriangles { .. })));
    doc = Doc::with_triangles(&UNIT);
    doc.json["nodes"][0]["translation"] = json!([1e30, 0, 0]);
    let Err(Error::NoTriangles { why, .. }) = doc.load() else {
        panic!("loaded")
    };
    assert!(why.contains("out_of_range"), "{why}");
    for scale in [json!([0, 1, 1]), json!([1e-30, 1e-30, 1e-30])] {
        doc.json["nodes"][0] = json!({"mesh": 0, "scale": scale});
        match doc.load() {
            Err(Error::NoTriangles { .. }) => {}
            // Invertible, but in world space no triangle is distinguishable from zero in f32.
            Ok(loaded) => assert_eq!(mesh_ingest::Soup::build(&loaded.scene).dropped_zero_area, 1),
            Err(e) => panic!("{e}"),
        }
    }
}

#[test]
fn meshopt_lies_are_refused() {
    let mut doc = Doc::with_triangles(&UNIT);
    let junk = doc.view(&[0xa0; 64]);
    let offset = doc.json["bufferViews"][junk]["byteOffset"].clone();
    for (count, stride, mode) in [
        (3, 12, "ATTRIBUTES"),
        (4_000_000_000u64, 256, "ATTRIBUTES"),
        (9, 4, "TRIANGLES"),
        (9, 7, "INDICES"),
    ] {
        doc.json["bufferViews"][0]["byteLength"] = json!(count * stride);
        doc.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"] = json!({
            "buffer": 0, "byteOffset": offset, "byteLength": 64, "byteStride": stride, "count": count, "mode": mode
        });
        let error = doc.load().unwrap_err();
        assert_eq!(error.exit_code(), 3, "{error}");
    }
}

/// Light needs none of these, but writers copy them; they used to fail after the bake.
#[test]
fn what_only_writers_read_is_checked_too() {
    // Two joints for three vertices.
    let mut doc = Doc::with_triangles(&UNIT);
    let view = doc.view(&[0; 8]);
    let joints = doc.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5121, "count": 2, "type": "VEC4"}),
    );
    doc.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
    let attribute = "meshes[0].primitives[0].attributes";
    assert_eq!(paths(doc.load()), [format!("{attribute}.JOINTS_0")]);

    // A custom attribute with another length.
    let mut doc = Doc::with_triangles(&UNIT);
    let floats = doc.floats(&[[0.0; 3]; 4]);
    doc.json["meshes"][0]["primitives"][0]["attributes"]["_WIND"] = json!(floats);
    let error = doc.load().expect_err("four of three");
    assert_eq!(error.exit_code(), 3);
    assert_eq!(paths(Err(error)), [format!("{attribute}._WIND")]);

    // A morph target that does not exist.
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 99}]);
    let target = "meshes[0].primitives[0].targets[0].POSITION";
    assert_eq!(paths(doc.load()), [target]);

    // Compressed animation times that do not decode.
    let mut doc = Doc::with_triangles(&UNIT);
    doc.view(&[0; 12]);
    doc.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"] = json!({"buffer": 0,
        "byteOffset": 36, "byteLength": 3, "byteStride": 4, "mode": "ATTRIBUTES", "count": 3});
    let times = doc.push(
        "accessors",
        json!({"bufferView": 1, "componentType": 5126, "count": 3, "type": "SCALAR"}),
    );
    doc.json["animations"] =
        json!([{"channels": [], "samplers": [{"input": times, "output": times}]}]);
    let error = doc.load().expect_err("it does not decode");
    assert_eq!(error.exit_code(), 3);
    assert!(paths(Err(error))[0].starts_with("bufferViews[1]"));
}

/// Nobody here reads joints, skins and animations, but other programs index memory by them.
#[test]
fn what_deforms_meshes_is_checked_though_nobody_reads_it() {
    let skinned = |component: u32, kind: &str, skin: serde_json::Value| {
        let mut doc = Doc::with_triangles(&UNIT);
        let view = doc.view(&[0; 192]);
        let accessor =
            json!({"bufferView": view, "componentType": component, "count": 3, "type": kind});
        let joints = doc.push("accessors", accessor);
        doc.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
        let matrices =
            json!({"bufferView": view, "componentType": 5126, "count": 1, "type": "MAT4"});
        doc.push("accessors", matrices);
        doc.json["skins"] = json!([skin]);
        doc.json["nodes"][0] = json!({"mesh": 0, "skin": 0, "extras": {"lumel": {"bake": true}}});
        doc
    };
    let sound = json!({"joints": [0], "inverseBindMatrices": 2});
    skinned(5121, "VEC4", sound.clone())
        .load()
        .expect("a sound skin");
    skinned(5123, "VEC4", json!({"joints": [0]}))
        .load()
        .expect("matrices are optional");

    let joints = "meshes[0].primitives[0].attributes.JOINTS_0";
    let skin = "skins[0].inverseBindMatrices";
    for (component, kind, given, place) in [
        (5126, "VEC4", sound.clone(), joints),
        (5121, "VEC3", sound, joints),
        (
            5121,
            "VEC4",
            json!({"joints": [0], "inverseBindMatrices": 3}),
            skin,
        ),
        (
            5121,
            "VEC4",
            json!({"joints": [0], "inverseBindMatrices": 0}),
            skin,
        ),
        (
            5121,
            "VEC4",
            json!({"joints": [0, 1]}),
            "skins[0].joints[1]",
        ),
        (
            5121,
            "VEC4",
            json!({"joints": [0], "skeleton": 1}),
            "skins[0].skeleton",
        ),
    ] {
        let mut doc = skinned(component, kind, given);
        let error = doc.load().expect_err(place);
        assert_eq!(error.exit_code(), 3);
        assert_eq!(paths(Err(error)), [place]);
        // Also if only another mesh is baked.
        let primitive = json!({"attributes": {"POSITION": 0}});
        let mesh = doc.push("meshes", json!({"primitives": [primitive]}));
        doc.json["nodes"][0] = json!({"mesh": mesh});
        assert_eq!(paths(doc.load()), [place]);
    }

    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["animations"] = json!([{"channels": [], "samplers": [{"input": 0, "output": 9}]}]);
    assert_eq!(paths(doc.load()), ["animations[0].samplers[0].output"]);
}

/// Names and types from documents used to reach the terminal with their control characters.
#[test]
fn messages_hold_nothing_that_a_terminal_obeys_and_end() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["accessors"][0]["type"] =
        json!("\u{1b}[31mEVIL\u{1b}[0m\n\nerror: fake \u{9b}\u{202e}");
    let text = doc.load().expect_err("no such type").to_string();
    assert!(
        !text.contains(|c: char| c.is_control() || c == '\u{202e}'),
        "{text:?}"
    );
    assert!(text.contains("EVIL"), "{text}");

    doc.json["accessors"][0]["type"] = json!("x".repeat(3_000_000));
    let text = doc.load().expect_err("no such type").to_string();
    assert!(text.len() < 2000, "{} bytes", text.len());
}

/// A decoder fills in missing JPEG data: 4 GB of grey.
#[test]
fn jpegs_that_cannot_hold_their_pixels_are_refused_undecoded() {
    let picture = image::RgbImage::from_pixel(16, 16, image::Rgb([200, 10, 10]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, image::ImageFormat::Jpeg)
        .expect("memory takes all");
    let mut bytes = bytes.into_inner();
    let load = |bytes: &[u8]| {
        let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
        let mut doc = textured(material, None);
        let view = doc.view(bytes);
        doc.push(
            "images",
            json!({"bufferView": view, "mimeType": "image/jpeg"}),
        );
        doc.push("textures", json!({"source": 0}));
        doc.load()
    };
    load(&bytes).expect("it holds 16 × 16");
    // Start of frame: marker, length, precision, height, width.
    let frame = bytes
        .windows(2)
        .position(|w| w == [0xff, 0xc0])
        .expect("a baseline JPEG");
    bytes[frame + 5..frame + 9].copy_from_slice(&[0x4e, 0x20, 0x4e, 0x20]);
    let error = load(&bytes).expect_err("a few hundred bytes hold no 20,000²");
    assert_eq!(error.exit_code(), 3);
    assert!(
        error.to_string().contains("20000 × 20000 pixels in"),
        "{error}"
    );
}

/// Decoders allocate memory for all pixels first.
#[test]
fn pngs_that_cannot_hold_their_pixels_are_refused_undecoded() {
    let load = |side: [u32; 2]| {
        let picture = image::GrayImage::from_pixel(64, 64, image::Luma([9]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        let png = image::ImageFormat::Png;
        picture.write_to(&mut bytes, png).expect("memory takes all");
        let mut bytes = bytes.into_inner();
        for (k, side) in side.iter().enumerate() {
            bytes[16 + 4 * k..][..4].copy_from_slice(&side.to_be_bytes());
        }
        let sum = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
        let mut doc = textured(material, None);
        let view = doc.view(&bytes);
        doc.push("images", json!({"bufferView": view}));
        doc.push("textures", json!({"source": 0}));
        doc.load()
    };
    load([64, 64]).expect("it holds 64 × 64");
    for (side, words) in [
        ([8192, 8192], "8192 × 8192 pixels in"),
        ([65535, 65535], "65535 × 65535 pixels"),
    ] {
        let error = load(side).expect_err("it does not hold that");
        assert_eq!(error.exit_code(), 3);
        assert!(error.to_string().contains(words), "{error}");
    }
}

/// The checksum of PNG chunks, bit by bit (PNG specification, annex D).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |s, _| {
            (s >> 1) ^ (0xedb8_8320 & (s & 1).wrapping_neg())
        })
    })
}

#[test]
fn images_share_one_budget_by_their_headers() {
    let picture = image::GrayImage::from_pixel(64, 64, image::Luma([9]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("memory takes all");
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "emissiveTexture": {"index": 1}, "emissiveFactor": [1, 1, 1]});
    let mut doc = textured(material, None);
    for _ in 0..2 {
        let view = doc.view(bytes.get_ref());
        let image = doc.push("images", json!({"bufferView": view}));
        doc.push("textures", json!({"source": image}));
    }
    let with = |image_bytes| {
        let limits = Limits {
            image_bytes,
            ..Limits::default()
        };
        let options = LoadOptions {
            limits,
            ..LoadOptions::default()
        };
        load_bytes(&doc.glb(), &options).map(drop)
    };
    with(2 * 4 * 64 * 64).expect("as much as they take");
    let error = with(2 * 4 * 64 * 64 - 1).expect_err("a byte less");
    assert!(error.to_string().contains("--max-image"), "{error}");
}

/// They are narrowed after they are decoded.
#[test]
fn images_of_16_bits_take_eight_bytes_per_pixel() {
    let picture = image::DynamicImage::new_rgba16(64, 64);
    let mut bytes = std::io::Cursor::new(Vec::new());
    let png = image::ImageFormat::Png;
    picture.write_to(&mut bytes, png).expect("memory takes all");
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let mut doc = textured(material, None);
    let view = doc.view(bytes.get_ref());
    doc.push("images", json!({"bufferView": view}));
    doc.push("textures", json!({"source": 0}));
    for (image_bytes, fits) in [(8 * 64 * 64, true), (8 * 64 * 64 - 1, false)] {
        let limits = Limits {
            image_bytes,
            ..Limits::default()
        };
        let options = LoadOptions {
            limits,
            ..LoadOptions::default()
        };
        assert_eq!(
            load_bytes(&doc.glb(), &options).is_ok(),
            fits,
            "{image_bytes}"
        );
    }
}
