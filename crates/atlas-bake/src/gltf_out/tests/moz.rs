//! `MOZ_lightmap`.

use super::*;
use crate::gltf_out::moz::Picture;
use crate::page::Page;

fn page(width: u32, height: u32) -> Page {
    let n = (width * height) as usize;
    Page {
        width,
        height,
        value: (0..n)
            .map(|i| [0.001 * i as f32, 8.0 - 0.01 * i as f32, 0.3])
            .collect(),
        coverage: vec![1.0; n],
        layers: Vec::new(),
    }
}

fn write_moz(loaded: &Loaded, layout: &Layout) -> (Vec<u8>, GltfStats) {
    let pages: Vec<Page> = layout.pages.iter().map(|[w, h]| page(*w, *h)).collect();
    let options = GlbOptions {
        moz: Some(&pages),
        ..GlbOptions::default()
    };
    write_lightmapped_glb_with(&loaded.document, &loaded.scene, layout, &uris(), &options).unwrap()
}

#[test]
fn copies_of_an_instanced_node_are_left_out_and_keep_their_mesh() {
    let fixture = Fixture::new();
    let (json, bin) = instanced();
    let loaded = fixture.load(&json, &bin);
    let (glb, stats) = write_moz(&loaded, &torn(&loaded.scene));
    assert_eq!((stats.moz_meshes, stats.moz_left_out), (1, 3));
    let back = fixture.reload(&glb);
    let j = back.document.json();
    assert_eq!(
        (&j["nodes"][0]["mesh"], &j["nodes"][1]["mesh"]),
        (&json!(0), &json!(1))
    );
    let material = |mesh: usize| {
        let m = &j["meshes"][mesh]["primitives"][0]["material"];
        &j["materials"][m.as_u64().unwrap() as usize]["extensions"]
    };
    assert_eq!(
        (
            material(0).get("MOZ_lightmap"),
            material(1)["MOZ_lightmap"]["texCoord"].as_u64()
        ),
        (None, Some(1))
    );
    // With page coordinates the rectangle is the whole page; otherwise it is unchanged.
    assert_eq!(
        j["nodes"][0]["extras"]["lightmap"][1]["offset"],
        json!([0.25, 0.0])
    );
    let own = &j["nodes"][1]["extras"]["lightmap"];
    assert_eq!(
        (&own["offset"], &own["scale"]),
        (&json!([0.0, 0.0]), &json!([1.0, 1.0]))
    );
}

#[test]
fn coordinates_lie_on_the_page_and_all_materials_of_a_primitive_are_copied() {
    let fixture = Fixture::new();
    let mut b = Builder::default();
    let attributes = json!({"POSITION": b.floats(&QUAD), "TEXCOORD_0": b.floats(&UV0)});
    let indices = b.indices(&[0, 1, 2, 0, 2, 3]);
    let variants = json!({"KHR_materials_variants": {"mappings": [{"material": 0, "variants": [0]}, {"material": 1, "variants": [1]}]}});
    // The first primitive has no material but variants; the second is plain.
    let (json, bin) = b.finish(json!({"scenes": [{"nodes": [0, 1]}],
        "extensionsUsed": ["KHR_materials_variants"],
        "extensions": {"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}},
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [3.0, 0.0, 0.0]}],
        "materials": [{"name": "a"}, {"name": "b"}],
        "meshes": [{"primitives": [
            {"attributes": attributes, "indices": indices, "extensions": variants},
            {"attributes": attributes, "indices": indices, "material": 1}]}]}));
    let loaded = fixture.load(&json, &bin);
    let uv = |v: usize| Vec2::from(UV1[v]);
    let (glb, stats) = write_moz(&loaded, &whole(&loaded.scene, uv));
    // Default, a and b. The second node shares them, and one of the two nodes uses the original
    // mesh.
    assert_eq!((stats.moz_meshes, stats.moz_materials), (1, 3));
    let back = fixture.reload(&glb);
    let j = back.document.json();
    for (node, shift) in [(0, 0.0), (1, 0.5)] {
        let mesh = j["nodes"][node]["mesh"].as_u64().unwrap() as usize;
        let primitive = &j["meshes"][mesh]["primitives"][0];
        let mappings = &primitive["extensions"]["KHR_materials_variants"]["mappings"];
        for (slot, name) in [
            (primitive, None),
            (&mappings[0], Some("a")),
            (&mappings[1], Some("b")),
        ] {
            let m = &j["materials"][slot["material"].as_u64().unwrap() as usize];
            assert_eq!(m["name"].as_str(), name);
            assert!(
                m["extensions"]["MOZ_lightmap"]["intensity"].is_number(),
                "{m}"
            );
        }
        // Two rectangles of 64 texels side by side on a page of 128, so each is half as wide.
        let raw = back.document.primitive_raw(mesh, 0).unwrap();
        let found = raw.attribute("TEXCOORD_1").unwrap().to_floats::<2>(0.0);
        let want = UV1.map(|[u, v]| [shift + 0.5 * u, v]);
        assert_eq!(found, want);
    }
    // Its own coordinates are unchanged.
    assert_eq!(
        (&j["materials"][0], &j["materials"][1]),
        (&json!({"name": "a"}), &json!({"name": "b"}))
    );
}

#[test]
fn both_pictures_hold_the_page_over_its_largest_value() {
    let mut p = page(24, 3);
    p.value[5] = [f32::NAN, -1.0, 1e9];
    p.value[6] = [1e-6, 0.0, 2e-7];
    let picture = Picture::new(&p).unwrap();
    // As in the EXR, halves end at 65504.
    assert_eq!(picture.largest, 65504.0);
    p.value[5] = [0.0; 3];
    let picture = Picture::new(&p).unwrap();
    assert_eq!(picture.largest, 8.0);
    let png = image::load_from_memory(&picture.png).unwrap().to_rgb8();
    for (found, want) in png.pixels().zip(&p.value) {
        assert_eq!(found.0, want.map(|x| (255.0 * x / 8.0).round() as u8));
    }
    // As three.js decodes it: m / 255 × 2^(e − 128). The largest channel's mantissa is at least
    // 128.
    let decoder = image::codecs::hdr::HdrDecoder::new(std::io::Cursor::new(&picture.rgbe)).unwrap();
    let mut exact = vec![0u8; 24 * 3 * 12];
    image::ImageDecoder::read_image(decoder, &mut exact).unwrap();
    for (bytes, want) in exact.chunks_exact(12).zip(&p.value) {
        // The crate decodes m / 256 × 2^(e − 128).
        let found: Vec<f32> = bytes
            .chunks_exact(4)
            .map(|b| f32::from_ne_bytes(b.try_into().unwrap()) * 256.0 / 255.0)
            .collect();
        let largest = want.iter().copied().fold(0.0, f32::max) / 8.0;
        for (f, w) in found.iter().zip(want) {
            assert!(
                (f - w / 8.0).abs() <= largest / 255.0,
                "{found:?} for {want:?} / 8"
            );
        }
    }
    let black = Page {
        value: vec![[0.0; 3]; 72],
        ..p
    };
    let picture = Picture::new(&black).unwrap();
    assert_eq!(picture.largest, 1.0);
}

#[test]
fn pages_that_do_not_fit_and_radiosity_are_errors() {
    let fixture = Fixture::new();
    let (json, bin) = instanced();
    let loaded = fixture.load(&json, &bin);
    let layout = torn(&loaded.scene);
    let pages = [page(4, 4)];
    let write = |options: &GlbOptions| {
        write_lightmapped_glb_with(&loaded.document, &loaded.scene, &layout, &uris(), options)
    };
    let none = GlbOptions {
        moz: Some(&[]),
        ..GlbOptions::default()
    };
    let radiosity = GlbOptions {
        value: ValueKind::Radiosity,
        moz: Some(&pages),
        ..GlbOptions::default()
    };
    for options in [none, radiosity] {
        assert!(matches!(
            write(&options),
            Err(crate::error::Error::Inconsistent { .. })
        ));
    }
}
