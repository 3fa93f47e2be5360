//! Materials, textures and shading.

use glam::{Affine2, Vec2, Vec3, Vec4};
use image::{ImageFormat, RgbaImage};
use mesh_ingest::{AlphaMode, Soup};
use serde_json::{Value, json};

use super::build::{Doc, QUAD, UNIT};

/// A unit quad with UVs equal to x and y and one material.
pub fn textured(material: Value, image: Option<&RgbaImage>) -> Doc {
    let mut doc = Doc::with_triangles(&QUAD);
    let indices = doc.indices(&[0, 1, 2, 1, 3, 2]);
    let uv = doc.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
    doc.json["meshes"][0]["primitives"][0] =
        json!({"attributes": {"POSITION": 0, "TEXCOORD_0": uv}, "indices": indices, "material": 0});
    doc.json["materials"] = json!([material]);
    if let Some(image) = image {
        let mut png = std::io::Cursor::new(Vec::new());
        image.write_to(&mut png, ImageFormat::Png).unwrap();
        let view = doc.view(png.get_ref());
        doc.push(
            "images",
            json!({"bufferView": view, "mimeType": "image/png"}),
        );
        doc.push("textures", json!({"source": 0, "sampler": 0}));
        doc.push("samplers", json!({}));
    }
    doc
}

/// 2 × 1 pixels: black transparent, white opaque.
fn black_white() -> RgbaImage {
    RgbaImage::from_raw(2, 1, vec![0, 0, 0, 0, 255, 255, 255, 255]).unwrap()
}

#[test]
fn factor_texture_and_vertex_colour_multiply() {
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1], "baseColorTexture": {"index": 0}}});
    let grey = RgbaImage::from_pixel(4, 4, image::Rgba([188, 188, 188, 255]));
    let mut doc = textured(material, Some(&grey));
    let colors = doc.floats(&[
        [1.0, 0.5, 1.0],
        [1.0, 0.5, 1.0],
        [1.0, 0.5, 1.0],
        [1.0, 0.5, 1.0],
    ]);
    doc.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    let scene = doc.load().unwrap().scene;
    let soup = Soup::build(&scene);
    // ((188/255 + 0.055) / 1.055)^2.4 = 0.5028865
    let linear = 0.502_886_5;
    let expected = Vec4::new(0.5 * linear, 0.5 * linear, linear, 1.0);
    assert!((scene.base_color(&soup, 0, 0.3, 0.3) - expected).length() < 1e-6);
    assert!((scene.mean_base_color(&soup, 1, 64) - expected).length() < 1e-6);
}

#[test]
fn filtering_and_wrapping_follow_the_sampler() {
    let at = |sampler: Value, u: f32| {
        let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
        let mut doc = textured(material, Some(&black_white()));
        doc.json["samplers"][0] = sampler;
        // Along the lower edge of the first triangle u is the texture's s; stretched over −1..=2.
        doc.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"] =
            json!({"offset": [-1, 0], "scale": [3, 1]});
        let scene = doc.load().unwrap().scene;
        let soup = Soup::build(&scene);
        scene.base_color(&soup, 0, (u + 1.0) / 3.0, 0.0).x
    };
    // Texel centres are at 0.25 and 0.75.
    let linear = json!({});
    for (u, expected) in [
        (0.25, 0.0),
        (0.75, 1.0),
        (0.5, 0.5),
        (0.0, 0.5),
        (-0.25, 1.0),
        (1.25, 0.0),
    ] {
        assert!(
            (at(linear.clone(), u) - expected).abs() < 1e-5,
            "repeat at {u}"
        );
    }
    let clamp = json!({"wrapS": 33071});
    for (u, expected) in [(-0.7, 0.0), (0.1, 0.0), (0.9, 1.0), (1.9, 1.0)] {
        assert!(
            (at(clamp.clone(), u) - expected).abs() < 1e-5,
            "clamp at {u}"
        );
    }
    let mirror = json!({"wrapS": 33648});
    for (u, expected) in [
        (-0.25, 0.0),
        (-0.75, 1.0),
        (1.25, 1.0),
        (1.75, 0.0),
        (1.0, 1.0),
        (0.0, 0.0),
    ] {
        assert!(
            (at(mirror.clone(), u) - expected).abs() < 1e-5,
            "mirror at {u}"
        );
    }
    let nearest = json!({"magFilter": 9728});
    for (u, expected) in [(0.49, 0.0), (0.51, 1.0), (-0.01, 1.0), (1.01, 0.0)] {
        assert!(
            (at(nearest.clone(), u) - expected).abs() < 1e-5,
            "nearest at {u}"
        );
    }
}

#[test]
fn texture_transforms_rotate_as_the_extension_says() {
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 3, "extensions": {
        "KHR_texture_transform": {"rotation": std::f64::consts::FRAC_PI_2, "offset": [0, 1], "texCoord": 0}}}}});
    let scene = textured(material, Some(&black_white()))
        .load()
        .unwrap()
        .scene;
    let texture = scene.materials[0].base_texture.as_ref().unwrap();
    assert_eq!(texture.tex_coord, 0);
    // The extension's example: 90° about the origin, then down by one, maps (0, 0) to (0, 1) and
    // (1, 0) to (0, 0).
    let map = |x, y| texture.transform.transform_point2(Vec2::new(x, y));
    assert!((map(0.0, 0.0) - Vec2::new(0.0, 1.0)).length() < 1e-6);
    assert!((map(1.0, 0.0) - Vec2::new(0.0, 0.0)).length() < 1e-6);
    assert!((map(0.0, 1.0) - Vec2::new(1.0, 1.0)).length() < 1e-6);
    assert_ne!(texture.transform, Affine2::IDENTITY);
}

#[test]
fn masks_cut_and_blends_thin() {
    let material = |mode: &str| json!({"alphaMode": mode, "alphaCutoff": 0.6, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let scene = textured(material("MASK"), Some(&black_white()))
        .load()
        .unwrap()
        .scene;
    let soup = Soup::build(&scene);
    assert!(scene.needs_alpha(0));
    assert_eq!(scene.presence(&soup, 0, 0.25, 0.0), 0.0);
    assert_eq!(scene.presence(&soup, 0, 0.75, 0.0), 1.0);
    assert_eq!(scene.transmittance(&soup, 0, 0.5, 0.0), Vec3::ONE);
    let scene = textured(material("BLEND"), Some(&black_white()))
        .load()
        .unwrap()
        .scene;
    assert!(
        (scene.transmittance(&soup, 0, 0.5, 0.0) - 0.5)
            .abs()
            .max_element()
            < 1e-6
    );
    assert!((scene.presence(&soup, 0, 0.5, 0.0) - 0.5).abs() < 1e-6);
    // Nothing passes if the lowest alpha is above the cutoff, or is one.
    let half = RgbaImage::from_pixel(2, 2, image::Rgba([9, 9, 9, 200]));
    for (mode, image, opaque) in [
        ("MASK", &half, true),
        ("BLEND", &half, false),
        ("MASK", &black_white(), false),
    ] {
        let scene = textured(material(mode), Some(image)).load().unwrap().scene;
        assert_eq!(!scene.needs_alpha(0), opaque, "{mode}");
    }
    let scene = textured(material("OPAQUE"), Some(&black_white()))
        .load()
        .unwrap()
        .scene;
    assert!(!scene.needs_alpha(0));
    assert_eq!(scene.transmittance(&soup, 0, 0.25, 0.0), Vec3::ZERO);
}

#[test]
fn emission_is_factor_times_strength_times_texture() {
    let material = json!({"emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 0},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10}}});
    let scene = textured(material, Some(&black_white()))
        .load()
        .unwrap()
        .scene;
    let soup = Soup::build(&scene);
    let full = Vec3::new(10.0, 5.0, 0.0);
    assert!((scene.emission(&soup, 0, 0.75, 0.0) - full).length() < 1e-5);
    assert!((scene.emission(&soup, 0, 0.5, 0.0) - full * 0.5).length() < 1e-5);
    // Half of the quad is emissive; bilinear filtering with wrap-around preserves the mean.
    let mean = (scene.mean_emission(&soup, 0, 4096) + scene.mean_emission(&soup, 1, 4096)) * 0.5;
    assert!(
        (mean - full * 0.5).length() < 0.05 * full.length(),
        "{mean}"
    );
}

#[test]
fn images_are_decoded_only_if_light_needs_them() {
    // A broken image of a normal map, or of an emissive texture whose factor is zero, does not
    // matter.
    let material = json!({"normalTexture": {"index": 0}, "emissiveTexture": {"index": 0}});
    let mut doc = textured(material, Some(&black_white()));
    let junk = doc.view(b"not an image");
    doc.json["images"][0] = json!({"bufferView": junk, "mimeType": "image/png"});
    let loaded = doc.load().unwrap();
    assert!(loaded.scene.images[0].is_none());
    doc.json["materials"][0]["emissiveFactor"] = json!([1, 1, 1]);
    let error = doc.load().unwrap_err();
    assert_eq!(
        (error.exit_code(), error.problems()[0].path.as_str()),
        (3, "images[0]")
    );
    // A missing file is an input failure.
    doc.json["images"][0] = json!({"uri": "missing.png"});
    assert_eq!(doc.load().unwrap_err().exit_code(), 2);
}

/// 16 × 8 pixels: (200, 100, 40), then (30, 60, 180) with alpha 64, in its lower right corner a
/// block (20, 160, 50). Written by ktx2-encoder 0.6 (npm), which is Binomial's own encoder.
const KTX2: [(&str, &[u8]); 3] = [
    ("ETC1S", include_bytes!("ktx2/etc1s.ktx2")),
    ("UASTC", include_bytes!("ktx2/uastc.ktx2")),
    ("UASTC, Zstandard", include_bytes!("ktx2/uastc_zstd.ktx2")),
];

/// A quad whose colour is a KTX2 picture, with a PNG as images[0] that no texture names.
fn with_ktx2(bytes: &[u8]) -> Doc {
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let mut doc = textured(material, Some(&black_white()));
    let ktx = doc.view(bytes);
    doc.push(
        "images",
        json!({"bufferView": ktx, "mimeType": "image/ktx2"}),
    );
    doc.json["textures"][0] = json!({"extensions": {"KHR_texture_basisu": {"source": 1}}});
    doc.json["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    doc.json["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    doc
}

#[test]
fn ktx2_textures_are_read_without_a_fallback() {
    for (name, bytes) in KTX2 {
        let loaded = with_ktx2(bytes).load().unwrap();
        assert!(
            loaded.report.warnings.is_empty(),
            "{:?}",
            loaded.report.warnings
        );
        let image = loaded.scene.images[1].as_ref().unwrap();
        assert_eq!((image.width, image.height), (16, 8));
        for (at, colour) in [
            ((0, 0), [200, 100, 40, 255]),
            ((8, 7), [30, 60, 180, 64]),
            ((15, 7), [20, 160, 50, 255]),
        ] {
            let found = image.pixels[at.1 * 16 + at.0];
            // ETC1S stores five bits of a colour: steps of 8.
            let off = (0..4).map(|c| found[c].abs_diff(colour[c])).max();
            assert!(
                off <= Some(8),
                "{name} at {at:?}: {found:?}, not {colour:?}"
            );
        }
    }
}

#[test]
fn a_fallback_is_preferred_to_ktx2() {
    let mut doc = with_ktx2(b"\xabKTX 20\xbb\r\n\x1a\n");
    doc.json["textures"][0]["source"] = json!(0);
    assert!(doc.load().unwrap().scene.images[0].is_some());
}

#[test]
fn broken_ktx2_is_one_error() {
    for (name, bytes) in KTX2 {
        let mut wide = bytes.to_vec();
        wide[20..24].copy_from_slice(&u32::MAX.to_le_bytes());
        // What the first level takes when it is inflated.
        let mut inflated = bytes.to_vec();
        inflated[96..104].copy_from_slice(&(1u64 << 50).to_le_bytes());
        let mut afar = bytes.to_vec();
        afar[80..88].copy_from_slice(&u64::MAX.to_le_bytes());
        let mut layers = bytes.to_vec();
        layers[32] = 9;
        // VK_FORMAT_R8G8B8A8_SRGB
        let mut plain = bytes.to_vec();
        plain[12] = 43;
        let cut = bytes[..bytes.len() - 40].to_vec();
        for (what, bytes, code) in [
            ("wide", wide, 3),
            ("inflated", inflated, 3),
            ("afar", afar, 3),
            ("layers", layers, 4),
            ("plain", plain, 4),
            ("cut", cut, 3),
            ("empty", bytes[..12].to_vec(), 3),
        ] {
            let error = with_ktx2(&bytes).load().unwrap_err();
            let paths: Vec<_> = error.problems().iter().map(|p| p.path.as_str()).collect();
            assert_eq!(
                (error.exit_code(), &paths[..]),
                (code, &["images[1]"][..]),
                "{name}, {what}"
            );
            assert_eq!(
                error.to_string().contains("ktxdecompress"),
                what == "plain",
                "{error}"
            );
        }
    }
}

#[test]
fn avif_names_a_way_out() {
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let mut doc = textured(material, Some(&black_white()));
    doc.json["textures"][0] = json!({"extensions": {"EXT_texture_avif": {"source": 0}}});
    let error = doc.load().unwrap_err();
    assert_eq!(error.exit_code(), 4);
    assert!(error.to_string().contains("gltf-transform"), "{error}");
}

#[test]
fn out_of_range_factors_are_clamped_and_counted() {
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [1.5, -1, 0.5, 0.25]}, "emissiveFactor": [-1, 0, 2],
        "alphaMode": "MASK", "doubleSided": true});
    let loaded = textured(material, None).load().unwrap();
    let material = &loaded.scene.materials[0];
    assert_eq!(material.base_color, Vec4::new(1.0, 0.0, 0.5, 0.25));
    assert_eq!(material.emissive, Vec3::new(0.0, 0.0, 2.0));
    assert_eq!(material.alpha, AlphaMode::Mask { cutoff: 0.5 });
    assert!(material.double_sided);
    assert_eq!(loaded.report.counts["materials.reflectance_clamped"], 1);
    assert_eq!(loaded.report.counts["materials.emission_clamped"], 1);
}

#[test]
fn specular_glossiness_gives_its_diffuse_colour() {
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]},
        "extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 1, 0, 1]}}});
    assert_eq!(
        textured(material, None).load().unwrap().scene.materials[0].base_color,
        Vec4::new(0.0, 1.0, 0.0, 1.0)
    );
}

#[test]
fn barycentrics_refer_to_world_corners_also_when_mirrored() {
    for scale in [1.0, -1.0] {
        let mut doc = Doc::with_triangles(&UNIT);
        let colors = doc.floats(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        doc.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
        doc.json["nodes"][0]["scale"] = json!([scale, 1, 1]);
        let scene = doc.load().unwrap().scene;
        let soup = Soup::build(&scene);
        // The corner at local +Y is blue, wherever it is in the world's order.
        let top = soup.triangles[0].iter().position(|p| p.y > 0.0).unwrap();
        let [u, v] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]][top];
        assert_eq!(
            scene.base_color(&soup, 0, u, v).truncate(),
            Vec3::Z,
            "scale {scale}"
        );
    }
}

#[test]
fn shading_normals_turn_with_the_inverse_transpose() {
    for mirror in [1.0, -1.0] {
        let mut doc = Doc::with_triangles(&UNIT);
        let tilted = Vec3::new(1.0, 0.0, 1.0).normalize().to_array();
        let normals = doc.floats(&[tilted; 3]);
        doc.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
        doc.json["nodes"][0]["scale"] = json!([2.0 * mirror, 1, 1]);
        let scene = doc.load().unwrap().scene;
        let soup = Soup::build(&scene);
        // Stretching x by two halves the normal's x before normalisation.
        let expected = Vec3::new(0.5 * mirror as f32, 0.0, 1.0).normalize();
        let got = scene.shading_normal(&soup, 0, 0.3, 0.3);
        assert!((got - expected).length() < 1e-6, "{got} for {expected}");
    }
    // Normals that point to the back are flipped; without normals the face's is used.
    let mut doc = Doc::with_triangles(&UNIT);
    let normals = doc.floats(&[[0.0, 0.0, -1.0]; 3]);
    doc.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    let scene = doc.load().unwrap().scene;
    assert_eq!(
        scene.shading_normal(&Soup::build(&scene), 0, 0.2, 0.2),
        Vec3::Z
    );
    let scene = Doc::with_triangles(&UNIT).load().unwrap().scene;
    assert_eq!(
        scene.shading_normal(&Soup::build(&scene), 0, 0.2, 0.2),
        Vec3::Z
    );
}
