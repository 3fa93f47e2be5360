//! Edges of shadows on flat surfaces are sharp at any density.

use std::f32::consts::PI;

use glam::{DVec2, Quat, Vec3};
use lumel::{Bake, Quality, Settings, SkySource};
use lumel_tests::geometry::{Geometry, cuboid, grid};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node, look_along};

use crate::common::{Seen, at, bake, lumels_of};
use crate::smooth::lookups;
use crate::surfaces::edited;

const LUX: f32 = 3.0;

const TO_SUN: Vec3 = Vec3::new(-0.4, 1.0, -0.3);

/// Above a ground of 8 × 8 m hangs a board of 3 × 2 m, turned by 25°, under a sun of this angular
/// diameter in degrees. Nothing reflects, so the shade is black.
fn board(angle: f32) -> Vec<u8> {
    boxes_over(8.0, &[hanging()], 25.0, angle)
}

/// The board's corners.
fn hanging() -> [Vec3; 2] {
    [Vec3::new(-1.5, 1.0, -1.0), Vec3::new(1.5, 1.05, 1.0)]
}

/// Likewise, with a ground of this width from x = −4 m on, and boxes with these corners, turned by
/// `turn` degrees.
fn boxes_over(width: f32, boxes: &[[Vec3; 2]], turn: f32, angle: f32) -> Vec<u8> {
    boxes_on(&ground(width, 1), boxes, turn, angle)
}

/// A ground of this width, of `n` × `n` squares.
fn ground(width: f32, n: u32) -> Geometry {
    let corner = Vec3::new(-4.0, 0.0, -4.0);
    grid(corner, Vec3::Z * 8.0, Vec3::X * width, [n, n])
}

fn boxes_on(ground: &Geometry, boxes: &[[Vec3; 2]], turn: f32, angle: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let mesh = b.mesh("ground", &[(ground, black)]);
    b.node(Node::of_mesh("ground", mesh));
    for &[low, high] in boxes {
        let mesh = b.mesh("box", &[(&cuboid(low, high, 1), black)]);
        b.node(Node {
            rotation: Quat::from_rotation_y(turn.to_radians()),
            ..Node::of_mesh("box", mesh)
        });
    }
    let sun = b.light("sun", Light::Directional([LUX; 3]));
    b.light_json(sun)["extras"] = serde_json::json!({ "lumel": { "angle": angle } });
    b.node(Node {
        light: Some(sun),
        rotation: look_along(-TO_SUN, Vec3::Y),
        ..Node::default()
    });
    b.finish()
}

/// The board of [`hanging`], turned, over a ground of 8 × 8 m, 2 m below a lamp: a point, or a cube
/// with this edge, of the same power.
fn under_a_lamp(edge: Option<f32>) -> Vec<u8> {
    const CANDELA: f32 = 30.0;
    let at = Vec3::Y * 3.0;
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let mesh = b.mesh("ground", &[(&ground(8.0, 1), black)]);
    b.node(Node::of_mesh("ground", mesh));
    let [low, high] = hanging();
    let mesh = b.mesh("box", &[(&cuboid(low, high, 1), black)]);
    b.node(Node {
        rotation: Quat::from_rotation_y(25f32.to_radians()),
        ..Node::of_mesh("box", mesh)
    });
    match edge {
        None => {
            let lamp = b.light("lamp", Light::Point([CANDELA; 3]));
            b.node(Node {
                light: Some(lamp),
                translation: at,
                ..Node::default()
            });
        }
        Some(edge) => {
            let glow = b.material(&Material {
                emission: [CANDELA / (edge * edge); 3],
                ..Material::diffuse("bulb", [0.0; 3])
            });
            let corners = [-0.5, 0.5].map(|k| at + k * edge * Vec3::ONE);
            let mesh = b.mesh("bulb", &[(&cuboid(corners[0], corners[1], 1), glow)]);
            b.node(Node::of_mesh("bulb", mesh));
        }
    }
    b.finish()
}

#[test]
fn lamps_and_bulbs_cast_sharp_shadows() {
    for lamp in [None, Some(0.05)] {
        let glb = under_a_lamp(lamp);
        // Around the shadow, the lamp brings 0.8 to 2.2 lx.
        let half = |cut| {
            let lumels = lumels_of(&bake(&glb, &settings(cut)), "ground");
            let near = |l: &&Seen| l.middle().x.abs() < 2.9 && l.middle().z.abs() < 2.5;
            let near: Vec<f64> = lumels.iter().filter(near).map(|l| l.red()).collect();
            let half = near.iter().filter(|l| (0.02..0.7).contains(*l)).count();
            half as f64 / near.len() as f64
        };
        let [whole, cut] = [false, true].map(half);
        assert!(whole > 0.01, "{whole}");
        assert!(cut < 0.1 * whole, "{cut} of {whole}");
    }
}

fn settings(cut_charts: bool) -> Settings {
    Settings {
        quality: Quality::Draft,
        cut_charts,
        ..at(5.0)
    }
}

/// The share of the ground's lumels that are neither lit nor shaded, but for 1 %.
fn mixed(bake: &Bake) -> f64 {
    between(bake, "ground", 0.01, 0.99)
}

/// The share of a node's lumels with more and less than these fractions of the light.
fn between(bake: &Bake, node: &str, low: f64, high: f64) -> f64 {
    let lumels = lumels_of(bake, node);
    let lit = lumels.iter().map(|l| l.red()).fold(0.0, f64::max);
    let between = lumels
        .iter()
        .filter(|l| (low..high).contains(&(l.red() / lit)));
    between.count() as f64 / lumels.len() as f64
}

/// The sky gives half of the light, so that the difference is just noticed: a board whose shadow is
/// four by three lumels.
#[test]
fn short_edges_of_grey_shadows_are_cut() {
    let small = [Vec3::new(-0.4, 1.0, -0.3), Vec3::new(0.4, 1.02, 0.3)];
    let glb = boxes_over(8.0, &[small], 25.0, 0.0);
    let noon = LUX * TO_SUN.normalize().y;
    let [whole, cut] = [false, true].map(|cut| {
        let settings = Settings {
            sky: SkySource::Color([noon / PI; 3]),
            ..settings(cut)
        };
        let bake = bake(&glb, &settings);
        // The board takes a sixth of the sky from what it hovers over.
        between(&bake, "ground", 0.6, 0.9)
    });
    assert!(whole > 0.002, "{whole}");
    assert_eq!(cut, 0.0);
}

#[test]
fn no_lumel_is_half_in_the_sun() {
    let glb = board(0.0);
    let [whole, cut] = [false, true].map(|cut| bake(&glb, &settings(cut)));
    // Stitching is on; the lines go on to the border or to each other, where light does not jump.
    assert!(mixed(&whole) > 0.01, "{}", mixed(&whole));
    assert!(mixed(&cut) < 0.002, "{}", mixed(&cut));
    // The shadow is where it was.
    let shade = |bake: &Bake| -> DVec2 {
        let lumels = lumels_of(bake, "ground");
        let dark = |l: &f64| 1.0 - l / (LUX as f64);
        let weights = lumels
            .iter()
            .map(|l| (dark(&l.red()) * l.points.len() as f64, l.middle()));
        let (sum, at) = weights.fold((0.0, DVec2::ZERO), |(sum, at), (w, p)| {
            (sum + w, at + DVec2::new(p.x, p.z) * w)
        });
        at / sum
    };
    assert!(
        (shade(&whole) - shade(&cut)).length() < 0.05,
        "{} {}",
        shade(&whole),
        shade(&cut)
    );
}

#[test]
fn what_has_no_material_is_cut_as_well() {
    let glb = edited(&board(0.0), |json| {
        for mesh in json["meshes"].as_array_mut().into_iter().flatten() {
            let of_first = mesh["primitives"][0].as_object_mut();
            assert!(of_first.is_some_and(|p| p.remove("material").is_some()));
        }
        let root = json.as_object_mut();
        assert!(root.is_some_and(|r| r.remove("materials").is_some()));
    });
    let notes = bake(&glb, &settings(true)).report.notes;
    assert!(
        notes.iter().any(|n| n.contains("charts end along")),
        "{notes:?}"
    );
}

#[test]
fn both_of_two_coincident_panels_are_cut() {
    // Rays that look for the ground meet either.
    let glb = edited(&board(0.0), |json| {
        let nodes = json["nodes"].as_array_mut().expect("nodes");
        let mut panel = nodes[0].clone();
        panel["name"] = "panel".into();
        panel["translation"] = serde_json::json!([0.7, 0.0, 0.4]);
        nodes.push(panel);
        let last = nodes.len() - 1;
        let roots = json["scenes"][0]["nodes"].as_array_mut();
        roots.expect("roots").push(last.into());
    });
    let [whole, cut] = [false, true].map(|cut| bake(&glb, &settings(cut)));
    for node in ["ground", "panel"] {
        let [whole, cut] = [&whole, &cut].map(|bake| between(bake, node, 0.01, 0.99));
        assert!(whole > 0.01 && cut < 0.002, "{node}: {whole}, {cut}");
    }
}

#[test]
fn a_strip_of_sun_is_narrower_than_a_lumel() {
    // The shadow ends at x = 1.92 m, and the ground three quarters of a lumel beyond.
    let glb = boxes_over(4.0 + 1.92 + 0.15, &[hanging()], 0.0, 0.0);
    let [whole, cut] = [false, true].map(|cut| mixed(&bake(&glb, &settings(cut))));
    assert!(whole > 0.01, "{whole}");
    // With the strip left whole it is 0.0023.
    assert!(cut < 0.001, "{cut}");
}

/// The frame of a window stands in its reveal, one lumel deep, with a third of a lumel before it and
/// beyond it. Opposite is a wall, as a strip that nobody sees is not worth a chart.
#[test]
fn a_strip_before_a_frame_has_no_light_from_beyond_it() {
    let reveal = grid(
        Vec3::new(-2.0, 0.0, -0.2),
        Vec3::Z * 0.2,
        Vec3::X * 4.0,
        [1, 1],
    );
    let frame = [Vec3::new(-2.0, 0.0, -0.14), Vec3::new(2.0, 0.5, -0.07)];
    let wall = [Vec3::new(-3.0, 0.0, 1.0), Vec3::new(3.0, 4.0, 1.1)];
    let glb = boxes_on(&reveal, &[frame, wall], 0.0, 0.0);
    let brightest = |cut| {
        let lookups = lookups(&glb, &settings(cut)).into_iter();
        // The sun shines around the frame's ends.
        let in_strip = lookups
            .filter(|(p, ..)| p.y.abs() < 1e-3 && (-0.06..1e-3).contains(&p.z) && p.x.abs() < 1.5);
        in_strip.map(|(_, seen, _)| seen).fold(0.0, f64::max) / f64::from(LUX)
    };
    let [whole, cut] = [false, true].map(brightest);
    assert!(whole > 0.1, "{whole}");
    assert!(cut < 1e-3, "{cut}");
}

/// Facets of a metre, bent by 1.5 to 12 degrees at their edges, shaded flat or as one smooth hill.
/// Patches take them for one surface.
#[test]
fn a_shadow_on_rough_ground_is_sharp_on_each_facet() {
    let mut rough = ground(8.0, 8);
    for (k, p) in (0u16..).zip(&mut rough.positions) {
        p.y = f32::from(7 * k * k % 11) / 110.0;
    }
    let mut normals = vec![Vec3::ZERO; rough.positions.len()];
    for corners in &rough.triangles {
        let [a, b, c] = corners.map(|k| rough.positions[k as usize]);
        for k in corners {
            normals[*k as usize] += (b - a).cross(c - a);
        }
    }
    let facets = rough.clone().bare();
    rough.normals = normals.iter().map(|n| n.normalize()).collect();
    for ground in [facets, rough] {
        let glb = boxes_on(&ground, &[hanging()], 25.0, 0.0);
        // The sun's cosine on the facets is 0.8 or more.
        let mixed = |cut| {
            let bake = bake(&glb, &settings(cut));
            let lumels = lumels_of(&bake, "ground");
            let mixed = (lumels.iter())
                .filter(|l| (0.01..0.75).contains(&(l.red() / f64::from(LUX))))
                .count();
            mixed as f64 / lumels.len() as f64
        };
        let [whole, cut] = [false, true].map(mixed);
        assert!(whole > 0.01, "{whole}");
        assert!(cut < 0.1 * whole, "{cut} of {whole}");
    }
}

/// A slit of 3 lumels between two boards, and a bar across it, half a lumel wide.
#[test]
fn the_shadow_of_a_bar_is_as_long_as_its_window_is_high() {
    let board = |x: [f32; 2], z: f32| [Vec3::new(x[0], 1.0, -z), Vec3::new(x[1], 1.01, z)];
    let boards = [board([-1.5, -0.3], 1.0), board([0.3, 1.5], 1.0)];
    let bar = board([-0.3, 0.3], 0.05);
    let glb = boxes_over(8.0, &[boards[0], boards[1], bar], 25.0, 0.0);
    let [whole, cut] = [false, true].map(|cut| mixed(&bake(&glb, &settings(cut))));
    assert!(whole > 0.01, "{whole}");
    // Without the edges of the bar it is 0.0016.
    assert!(cut < 0.001, "{cut}");
}

/// A wall stands on the ground. Along the shadows of its upright edges, penumbras grow from nothing
/// to 12 cm, which is less than a lumel.
#[test]
fn a_chart_of_shade_ends_where_a_growing_penumbra_does() {
    // Of the lumels in whose middle no part of the sun is seen, the share that get some of it: a
    // room would be outshone. Below the wall nobody sees any.
    let sunny = |cut: bool| {
        let (mut all, mut sunny) = (0.0, 0.0);
        for x in [0.8, 0.9, 1.0, 1.1, 1.2] {
            let wall = [Vec3::new(-x, 0.0, -0.05), Vec3::new(x, 3.0, 0.05)];
            let bake = bake(&boxes_over(8.0, &[wall], 0.0, 2.0), &settings(cut));
            let in_umbra = |p: Vec3| rim(TO_SUN, 1.0).all(|toward| meets(wall, p, toward));
            for l in lumels_of(&bake, "ground") {
                let p = l.middle().as_vec3();
                if in_umbra(p) && !meets(wall, p, Vec3::Y) {
                    all += 1.0;
                    sunny += f64::from(l.red() > 0.01 * f64::from(LUX));
                }
            }
        }
        sunny / all
    };
    let [whole, cut] = [false, true].map(sunny);
    assert!(whole > 0.05, "{whole}");
    assert_eq!(cut, 0.0);
}

/// Directions to the rim of a disc of this angular radius, degrees, around one.
fn rim(middle: Vec3, radius: f32) -> impl Iterator<Item = Vec3> {
    let middle = middle.normalize();
    let (x, y) = middle.any_orthonormal_pair();
    let wide = radius.to_radians().tan();
    let turns = (0..64u8).map(|k| f32::from(k) / 64.0 * std::f32::consts::TAU);
    turns.map(move |a| middle + (x * a.cos() + y * a.sin()) * wide)
}

/// Whether a ray meets a box.
fn meets([low, high]: [Vec3; 2], from: Vec3, toward: Vec3) -> bool {
    let [a, b] = [low, high].map(|side| (side - from) / toward);
    let (enter, leave) = (a.min(b), a.max(b));
    enter.max_element().max(0.0) < leave.min_element()
}

/// Vertices on the outline have a value for each side of it.
#[test]
fn vertices_are_in_the_sun_or_not() {
    let bake = bake(&board(0.0), &settings(true));
    let ground = (bake.loaded.scene.instances.iter())
        .position(|i| i.name == "ground")
        .expect("the ground");
    let light = &bake.baked.vertices.instances[ground];
    let red: Vec<f32> = light.iter().flatten().map(|e| e[0]).collect();
    let lit = red.iter().copied().fold(0.0, f32::max);
    let dark = red.iter().filter(|e| **e < 0.01 * lit).count();
    let bright = red.iter().filter(|e| **e > 0.99 * lit).count();
    assert!(dark >= 4 && bright >= 8, "{red:?}");
    assert_eq!(dark + bright, red.len(), "{red:?}");
}

#[test]
fn soft_shadows_cut_no_charts() {
    // At a distance of 1 m, 30° are a penumbra of 53 cm, 2.7 lumels.
    let [sharp, soft] = [0.5, 30.0].map(|angle| {
        let bake = bake(&board(angle), &settings(true));
        (bake.loaded.scene.meshes.iter())
            .map(|m| m.primitives.len())
            .sum::<usize>()
    });
    assert_eq!(soft, 2, "the ground and the board");
    assert!(sharp > soft, "{sharp}");
}
