//! Reflection captures: cube maps at marked points.

use glam::{DVec2, DVec3, Vec3};
use lumel::{Bake, Quality, Settings};
use lumel_tests::gltf::{Material, Node};
use lumel_tests::scenes::closed_form::Stage;
use serde_json::{Value, json};

use crate::common::{at, bake};

/// Marks a point for a capture.
fn capture(s: &mut Stage, name: &str, at: Vec3) {
    s.builder.node(Node {
        name: name.into(),
        translation: at,
        extras: Some(json!({"lumel": {"reflection": true}})),
        ..Node::default()
    });
}

fn draft(texels_per_unit: f32) -> Settings {
    Settings {
        quality: Quality::Draft,
        ..at(texels_per_unit)
    }
}

fn written(bake: &Bake, name: &str) -> Vec<u8> {
    let (files, _) = bake.files().expect("files");
    let found = files.into_iter().find(|f| f.0 == name);
    found.unwrap_or_else(|| panic!("no {name}")).1
}

#[test]
fn a_furnace_reflects_the_same_everywhere_at_every_roughness() {
    let mut s = Stage::new();
    let wall = Material::emitter("wall", [1.0, 0.5, 0.25], [0.5; 3]);
    let wall = s.builder.material(&wall);
    s.room(Vec3::splat(-1.0), Vec3::ONE, wall);
    capture(&mut s, "middle", Vec3::ZERO);
    capture(&mut s, "corner", Vec3::splat(0.9));
    let b = bake(&s.finish(), &draft(4.0));
    assert_eq!(b.reflections.len(), 2);
    for cube in &b.reflections {
        // 64, 32, 16, 8, 4.
        assert_eq!(cube.levels.len(), 5);
        for light in cube.levels.iter().flatten() {
            // L = Le / (1 − ρ). The bound on a furnace's light; see `enclosures`.
            let off = (*light / Vec3::new(2.0, 1.0, 0.5) - 1.0)
                .abs()
                .max_element();
            assert!(off < 0.01, "{light}");
        }
    }
    let file = written(&b, "scene.reflection.ktx2");
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes"));
    // VK_FORMAT_E5B9G9R9_UFLOAT_PACK32, size, faces, levels.
    assert_eq!([12, 20, 24, 36, 40].map(word), [123, 64, 64, 6, 5]);
    let manifest: Value =
        serde_json::from_slice(&written(&b, "scene.lightmap.json")).expect("JSON");
    let listed = &manifest["reflections"];
    assert_eq!(listed[0]["uri"], json!("scene.reflection.ktx2"));
    assert_eq!(listed[1]["uri"], json!("scene.reflection.1.ktx2"));
    assert_eq!(listed[1]["name"], json!("corner"));
    let place = listed[1]["position"].as_array().expect("a position");
    assert!((place[2].as_f64().expect("a number") - 0.9).abs() < 1e-6);
    let glb = written(&b, "scene.glb");
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let document: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let extras = |node: usize| &document["nodes"][node]["extras"]["lightmapReflection"]["uri"];
    assert_eq!(extras(6), &json!("scene.reflection.ktx2"));
}

/// The radiance of the wall that a ray from `at` hits in a room from −1 to 1.
fn wall_seen(at: DVec3, d: DVec3) -> usize {
    let reach = |i: usize| (d[i].signum() - at[i]) / d[i];
    let axis = [0, 1, 2]
        .into_iter()
        .filter(|i| d[*i] != 0.0)
        .min_by(|a, b| reach(*a).total_cmp(&reach(*b)))
        .expect("a direction");
    2 * axis + usize::from(d[axis] < 0.0)
}

#[test]
fn every_texel_shows_the_wall_that_it_looks_at() {
    let mut s = Stage::new();
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let low = Vec3::splat(-1.0);
    // +x, −x, +y, −y, +z, −z, each in another colour, with its front inwards.
    let panels = [
        [low + x, z, y],
        [low, y, z],
        [low + y, x, z],
        [low, z, x],
        [low + z, y, x],
        [low, x, y],
    ];
    let colours: [Vec3; 6] = [
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
        Vec3::new(2.0, 2.0, 0.0),
        Vec3::new(0.0, 2.0, 2.0),
        Vec3::new(4.0, 0.0, 4.0),
    ];
    for (i, (panel, colour)) in panels.into_iter().zip(colours).enumerate() {
        let wall = Material::emitter(&format!("{i}"), colour.to_array(), [0.0; 3]);
        let wall = s.builder.material(&wall);
        s.panel(&format!("{i}"), panel, wall);
    }
    // Off the middle, so that turned and mirrored faces differ.
    let place = DVec3::new(0.3, -0.4, 0.2);
    capture(&mut s, "here", place.as_vec3());
    let b = bake(&s.finish(), &draft(4.0));
    let cube = &b.reflections[0];
    let n = cube.size as usize;
    let mut compared = 0;
    for (i, light) in cube.levels[0].iter().enumerate() {
        // The left-handed table of KTX2 and Vulkan; glTF's z is negated, as Bevy samples.
        let direction = |within: DVec2| {
            let corner = DVec2::new((i % n) as f64, (i / n % n) as f64);
            let p = (corner + within) * (2.0 / n as f64) - 1.0;
            let (sc, tc) = (p.x, p.y);
            let c = match i / (n * n) {
                0 => DVec3::new(1.0, -tc, -sc),
                1 => DVec3::new(-1.0, -tc, sc),
                2 => DVec3::new(sc, 1.0, tc),
                3 => DVec3::new(sc, -1.0, -tc),
                4 => DVec3::new(sc, -tc, 1.0),
                _ => DVec3::new(-sc, -tc, -1.0),
            };
            DVec3::new(c.x, c.y, -c.z)
        };
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let walls = corners.map(|c| wall_seen(place, direction(DVec2::from(c) * 0.98 + 0.01)));
        if walls.iter().any(|w| *w != walls[0]) {
            continue;
        }
        compared += 1;
        let off = (*light - colours[walls[0]]).abs().max_element();
        assert!(off < 1e-4, "texel {i}: {light}, not {}", colours[walls[0]]);
    }
    assert!(compared > 5 * n * n, "{compared} texels");
}
