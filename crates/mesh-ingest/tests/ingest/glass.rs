//! Light that passes through: `KHR_materials_transmission`, `MASK`, `BLEND`, sides.

use glam::Vec3;
use image::{ImageFormat, Rgba, RgbaImage};
use mesh_ingest::{AlphaMode, Scene, Soup};
use serde_json::{Value, json};

use super::build::{Doc, paths};
use super::materials::textured;

fn glass(extension: Value) -> Doc {
    textured(
        json!({"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.4, 0, 0.25]},
            "extensions": {"KHR_materials_transmission": extension}}),
        None,
    )
}

/// Adds an image as texture 1 (or 0) and returns its index.
fn add_texture(doc: &mut Doc, image: &RgbaImage) -> usize {
    let mut png = std::io::Cursor::new(Vec::new());
    image.write_to(&mut png, ImageFormat::Png).unwrap();
    let view = doc.view(png.get_ref());
    let source = doc.push(
        "images",
        json!({"bufferView": view, "mimeType": "image/png"}),
    );
    doc.push("textures", json!({"source": source}))
}

fn close(a: Vec3, b: Vec3) -> bool {
    // A few roundings of numbers up to 1.
    (a - b).abs().max_element() < 1e-6
}

#[test]
fn coloured_glass_passes_its_colour_and_reflects_the_rest() {
    let c = Vec3::new(0.8, 0.4, 0.0);
    for (mode, alpha) in [("OPAQUE", 1.0), ("BLEND", 0.25), ("MASK", 0.0)] {
        for tau in [0.0f32, 0.5, 1.0] {
            let mut doc = glass(json!({"transmissionFactor": tau}));
            doc.json["materials"][0]["alphaMode"] = json!(mode);
            let scene = doc.load().unwrap().scene;
            let soup = Soup::build(&scene);
            let passes = Vec3::splat(1.0 - alpha) + alpha * tau * c;
            let got = scene.transmittance(&soup, 0, 0.2, 0.3);
            assert!(close(got, passes), "{mode} τ {tau}: {got} for {passes}");
            let presence = scene.presence(&soup, 0, 0.2, 0.3);
            let exact = alpha * (1.0 - tau);
            assert!(
                (presence - exact).abs() < 1e-6,
                "{mode} τ {tau}: {presence}"
            );
            assert_eq!(scene.needs_alpha(0), mode != "OPAQUE" || tau > 0.0);
        }
    }
    // The reflectance limit does not apply to transmitted light.
    let mut scene = glass(json!({"transmissionFactor": 1}))
        .load()
        .unwrap()
        .scene;
    scene.limit_reflectance(0.1);
    let soup = Soup::build(&scene);
    assert!(close(scene.transmittance(&soup, 0, 0.2, 0.3), c));
    assert!(close(
        scene.base_color(&soup, 0, 0.2, 0.3).truncate(),
        c.min(Vec3::splat(0.1))
    ));
}

#[test]
fn the_transmission_texture_is_its_red_channel_and_linear() {
    let mut doc = glass(json!({"transmissionFactor": 0.5}));
    let texture = add_texture(
        &mut doc,
        &RgbaImage::from_pixel(2, 2, Rgba([128, 255, 255, 255])),
    );
    doc.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionTexture"] =
        json!({"index": texture});
    let scene = doc.load().unwrap().scene;
    assert!(scene.images[0].is_some());
    let soup = Soup::build(&scene);
    let tau = 0.5 * 128.0 / 255.0;
    let got = scene.transmittance(&soup, 0, 0.2, 0.3);
    assert!(close(got, Vec3::new(0.8, 0.4, 0.0) * tau), "{got}");
    // Missing coordinates are reported like any other's.
    doc.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionTexture"] =
        json!({"index": texture, "texCoord": 3});
    let report = doc.load().unwrap().report;
    assert_eq!(report.counts["primitives.missing_tex_coords"], 1);
}

#[test]
fn glass_that_passes_nothing_is_opaque() {
    let opaque = |doc: &Doc| {
        let loaded = doc.load().unwrap();
        let counted = loaded.report.counts.get("materials.opaque_in_effect");
        (!loaded.scene.needs_alpha(0), counted == Some(&1))
    };
    // The material did not claim transparency, so nothing is counted.
    assert_eq!(opaque(&glass(json!({}))), (true, false));
    assert_eq!(
        opaque(&glass(json!({"transmissionFactor": 0.1}))),
        (false, false)
    );
    // A black texture, and black glass.
    for (red, expected) in [(0, (true, true)), (1, (false, false))] {
        let mut doc = glass(json!({"transmissionFactor": 1}));
        let texture = add_texture(
            &mut doc,
            &RgbaImage::from_pixel(2, 2, Rgba([red, 255, 255, 255])),
        );
        doc.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionTexture"] =
            json!({"index": texture});
        assert_eq!(opaque(&doc), expected, "red {red}");
    }
    let mut doc = glass(json!({"transmissionFactor": 1}));
    doc.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0, 0, 0, 1]);
    assert_eq!(opaque(&doc), (true, true));
    // Opaque glass remains, whatever its alpha does.
    doc.json["materials"][0]["alphaMode"] = json!("BLEND");
    assert_eq!(opaque(&doc), (true, true));
    doc.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0, 0, 0, 0.5]);
    assert_eq!(opaque(&doc), (false, false));
}

#[test]
fn images_are_read_only_if_transmission_needs_them() {
    let mut doc = glass(json!({"transmissionFactor": 0, "transmissionTexture": {"index": 0}}));
    let junk = doc.view(b"not an image");
    doc.push(
        "images",
        json!({"bufferView": junk, "mimeType": "image/png"}),
    );
    doc.push("textures", json!({"source": 0}));
    assert!(doc.load().unwrap().scene.images[0].is_none());
    doc.json["materials"][0]["extensions"]["KHR_materials_transmission"]["transmissionFactor"] =
        json!(0.5);
    assert_eq!(paths(doc.load()), ["images[0]"]);
}

#[test]
fn wrong_transmission_is_refused_or_clamped() {
    let at = "materials[0].extensions.KHR_materials_transmission";
    for (extension, path) in [
        (json!({"transmissionFactor": "1"}), ".transmissionFactor"),
        (json!({"transmissionFactor": null}), ".transmissionFactor"),
        (
            json!({"transmissionFactor": 1, "transmissionTexture": 0}),
            ".transmissionTexture",
        ),
        (
            json!({"transmissionFactor": 1, "transmissionTexture": {}}),
            ".transmissionTexture.index",
        ),
        (
            json!({"transmissionFactor": 1, "transmissionTexture": {"index": 9}}),
            ".transmissionTexture.index",
        ),
        (json!([]), ""),
    ] {
        let found = paths(glass(extension.clone()).load());
        assert_eq!(found, [format!("{at}{path}")], "{extension}");
    }
    for (given, read) in [(1.5, 1.0), (-0.5, 0.0)] {
        let loaded = glass(json!({"transmissionFactor": given})).load().unwrap();
        assert_eq!(loaded.scene.materials[0].transmission, read);
        assert_eq!(loaded.report.counts["materials.transmission_clamped"], 1);
        assert_eq!(
            loaded.report.warnings[0].path,
            format!("{at}.transmissionFactor")
        );
    }
}

#[test]
fn masks_are_there_or_not_and_blends_partly() {
    let image = RgbaImage::from_fn(4, 1, |x, _| {
        Rgba([255, 255, 255, [0, 102, 153, 255][x as usize]])
    });
    let scene_of = |mode: &str| -> (Scene, Soup) {
        let mut doc = textured(
            json!({"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}),
            Some(&image),
        );
        doc.json["samplers"][0] = json!({"magFilter": 9728});
        let scene = doc.load().unwrap().scene;
        let soup = Soup::build(&scene);
        (scene, soup)
    };
    let (mask, soup) = scene_of("MASK");
    assert_eq!(mask.materials[0].alpha, AlphaMode::Mask { cutoff: 0.5 });
    let (blend, _) = scene_of("BLEND");
    for (x, covered, alpha) in [
        (0.1, 0.0, 0.0),
        (0.3, 0.0, 0.4),
        (0.6, 1.0, 0.6),
        (0.9, 1.0, 1.0),
    ] {
        assert_eq!(mask.presence(&soup, 0, x, 0.05), covered, "{x}");
        assert_eq!(
            mask.transmittance(&soup, 0, x, 0.05),
            Vec3::splat(1.0 - covered)
        );
        assert!(
            (blend.presence(&soup, 0, x, 0.05) - alpha).abs() < 1e-6,
            "{x}"
        );
        assert!(
            close(
                blend.transmittance(&soup, 0, x, 0.05),
                Vec3::splat(1.0 - alpha)
            ),
            "{x}"
        );
    }
}

#[test]
fn sides_change_nothing_of_what_passes() {
    for double_sided in [false, true] {
        let mut doc = glass(json!({"transmissionFactor": 0.5}));
        doc.json["materials"][0]["doubleSided"] = json!(double_sided);
        let scene = doc.load().unwrap().scene;
        assert_eq!(scene.materials[0].double_sided, double_sided);
        let soup = Soup::build(&scene);
        let got = scene.transmittance(&soup, 1, 0.2, 0.3);
        assert!(close(got, Vec3::new(0.4, 0.2, 0.0)), "{got}");
    }
}
