//! Surfaces that modelling tools and exporters produce: slivers, duplicates, overlaps, flipped
//! faces, near contact.

use std::f64::consts::PI;

use crate::common::{Seen, at, bake, lumels_of};
use glam::Vec3;
use lumel::{Bake, Hidden, Quality, Settings, SkySource};
use lumel_tests::geometry::{Geometry, cuboid, grid, quad, room};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use lumel_tests::scenes::closed_form;

/// A floor of 2 m around the origin, front up.
fn floor() -> Geometry {
    grid(
        Vec3::new(-1.0, 0.0, 1.0),
        Vec3::X * 2.0,
        Vec3::Z * -2.0,
        [1, 1],
    )
    .bare()
}

/// Bakes `parts` (a node each) with reflectance 0 under a sun of 2 lux straight down, at 8 lumels
/// per metre.
fn under_the_sun(parts: &[(&str, &Geometry)]) -> Bake {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    for (name, g) in parts {
        let mesh = b.mesh(name, &[(g, black)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let sun = b.light("sun", Light::Directional([2.0; 3]));
    b.node(Node {
        name: "sun".into(),
        rotation: glam::Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2),
        light: Some(sun),
        ..Node::default()
    });
    // Some of these lumels see only backs of single-sided faces; this tests their own values,
    // without filling.
    let settings = Settings {
        hidden: Hidden::Mean,
        ..at(8.0)
    };
    let out = bake(&b.finish(), &settings);
    let finite = |p: &lumel::atlas_bake::Page| p.value.iter().flatten().all(|x| x.is_finite());
    assert!(out.baked.pages.iter().all(finite));
    let vertices = out.baked.vertices.instances.iter().flatten().flatten();
    assert!(vertices.into_iter().flatten().all(|v| v.is_finite()));
    out
}

/// All of these lumels hold `e`. Nothing is sampled, so only half floats round (2⁻¹¹).
fn all_hold(lumels: &[Seen], e: f64) {
    for l in lumels {
        assert!(
            (l.red() - e).abs() <= 5e-4 * e,
            "{} at {}",
            l.red(),
            l.points[0]
        );
    }
}

#[test]
fn a_face_given_twice_is_lit_once_and_counted() {
    let twice = Geometry::union(&[floor(), floor()]);
    let b = under_the_sun(&[("floor", &twice)]);
    let dropped = b.report.dropped_triangles[1]
        + b.report
            .ingest
            .counts
            .iter()
            .filter(|(k, _)| k.contains("duplicate"))
            .map(|(_, n)| n)
            .sum::<u64>();
    assert_eq!(dropped, 2, "{:?}", b.report.ingest.counts);
    all_hold(&lumels_of(&b, "floor"), 2.0);
}

#[test]
fn the_same_face_in_two_nodes_does_not_shadow_itself() {
    let b = under_the_sun(&[("floor", &floor()), ("copy", &floor())]);
    assert_eq!(b.report.dropped_triangles[1], 2);
    all_hold(&lumels_of(&b, "floor"), 2.0);
}

#[test]
fn coplanar_faces_that_overlap_are_both_lit() {
    // Other triangles in the same plane, moved by a third of a metre: z-fighting.
    let over = floor().moved(Vec3::new(0.37, 0.0, 0.21));
    let b = under_the_sun(&[("floor", &floor()), ("over", &over)]);
    all_hold(&lumels_of(&b, "floor"), 2.0);
    all_hold(&lumels_of(&b, "over"), 2.0);
}

#[test]
fn a_flipped_face_in_the_same_place_takes_no_light_from_the_right_one() {
    let b = under_the_sun(&[("floor", &floor()), ("flipped", &floor().flipped())]);
    all_hold(&lumels_of(&b, "floor"), 2.0);
    all_hold(&lumels_of(&b, "flipped"), 0.0);
}

#[test]
fn crossing_faces_shade_each_other_where_they_should() {
    // A plate tilted through the floor, above it for x > 0. It is single-sided and faces up; its
    // shadow falls on x > 0.
    let s = 0.5;
    let plate = quad([
        Vec3::new(-s, -0.3, s),
        Vec3::new(s, 0.3, s),
        Vec3::new(s, 0.3, -s),
        Vec3::new(-s, -0.3, -s),
    ])
    .bare();
    let b = under_the_sun(&[("floor", &floor()), ("plate", &plate)]);
    let (mut dark, mut bright) = (0, 0);
    for l in lumels_of(&b, "floor") {
        // Rays start some 1e-6 m above the surface, so 1e-4 from the edges is enough.
        if l.all(|p| p.x > 1e-4 && p.x < 0.4999 && p.z.abs() < 0.4999) {
            assert_eq!(l.red(), 0.0, "{}", l.points[0]);
            dark += 1;
        } else if l.all(|p| p.x < -1e-4 || p.x > 0.5001 || p.z.abs() > 0.5001) {
            all_hold(&[l], 2.0);
            bright += 1;
        }
    }
    assert!(dark > 10 && bright > 100, "{dark} {bright}");
    // The part of the plate above the floor is lit, the part below is not.
    let cos = 1.0 / 1.0f64.hypot(0.6);
    for l in lumels_of(&b, "plate") {
        if l.all(|p| p.y > 1e-4) {
            all_hold(&[l], 2.0 * cos);
        } else if l.all(|p| p.y < -1e-4) {
            assert_eq!(l.red(), 0.0);
        }
    }
}

#[test]
fn slivers_of_aspect_a_million_harm_nobody() {
    // A fan whose last corner is 1e-6 off an edge of 2 m, T-junctions on both sides, and a single
    // needle over the floor.
    let mut g = Geometry {
        positions: vec![
            Vec3::new(-1.0, 0.0, 1.0),
            Vec3::new(1.0, 0.0, 1.0),
            Vec3::new(1.0, 0.0, -1.0),
            Vec3::new(-1.0, 0.0, -1.0),
            Vec3::new(0.0, 0.0, 1.0 - 1e-6),
        ],
        triangles: vec![[0, 1, 4], [0, 4, 3], [4, 1, 2], [4, 2, 3]],
        ..Geometry::default()
    };
    let wide = under_the_sun(&[("floor", &g)]);
    let lumels = lumels_of(&wide, "floor");
    // 2 m × 2 m at 8 per metre, whatever the charts: at least the inner ones.
    assert!(lumels.len() >= 200, "{}", lumels.len());
    all_hold(&lumels, 2.0);
    g.append(&Geometry {
        positions: vec![
            Vec3::new(-0.9, 0.5, 0.0),
            Vec3::new(0.9, 0.5, 0.0),
            Vec3::new(0.9, 0.5, -2e-6),
        ],
        triangles: vec![[0, 1, 2]],
        ..Geometry::default()
    });
    let b = under_the_sun(&[("floor", &g)]);
    let floor: Vec<Seen> = lumels_of(&b, "floor")
        .into_iter()
        .filter(|l| l.points[0].y < 0.1)
        .collect();
    // The needle's shadow is 2 µm wide: one of 16 points in a lumel of 12.5 cm hits it by chance
    // once in ten thousand.
    all_hold(&floor, 2.0);
}

#[test]
fn plates_a_tenth_of_a_millimetre_apart_exchange_light_as_infinite_ones_do() {
    // A lamp (M_e = πL, ρ₁) over a plate (ρ₂): on the plate E₂ = B₁ = πL/(1 − ρ₁ρ₂), on the lamp E₁
    // = ρ₂ E₂.
    let (r1, r2, gap) = (0.6, 0.5, 1e-4);
    let mut b = GltfBuilder::new();
    let lamp = b.material(&Material::emitter("lamp", [1.0; 3], [r1; 3]));
    let grey = b.material(&Material::diffuse("grey", [r2; 3]));
    let down = floor().flipped().moved(Vec3::Y * gap);
    for (name, g, m) in [("plate", &floor(), grey), ("lamp", &down, lamp)] {
        let mesh = b.mesh(name, &[(g, m)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let bake = bake(&b.finish(), &at(8.0));
    let e2 = PI / (1.0 - f64::from(r1 * r2));
    for (name, exact) in [("plate", e2), ("lamp", e2 * f64::from(r2))] {
        for l in lumels_of(&bake, name) {
            if l.all(|p| p.x.abs() < 0.9 && p.z.abs() < 0.9) {
                // A thousand gaps from the edge nothing escapes, but light returns from patches of
                // 0.1 m, the outermost of which lose up to half of their outermost gap's width:
                // below 1e-3. Grazing rays: 2 %.
                assert!(
                    (l.red() / exact - 1.0).abs() < 0.02,
                    "{name}: {} {exact}",
                    l.red()
                );
            }
        }
    }
}

#[test]
fn brighter_lamps_scale_every_lumel_alike() {
    let settings = Settings {
        quality: Quality::Draft,
        ..at(6.0)
    };
    let page = |radiance: f32| {
        let (glb, _) = closed_form::sphere_interior(radiance, 0.7, 0.5, 2);
        bake(&glb, &settings).baked.pages.remove(0).value
    };
    let one = page(1.0);
    for radiance in [1e-3f32, 1e6] {
        for (x, y) in one.iter().zip(page(radiance)) {
            // Draft takes the same samples. f32 sums of some 500 terms, and smoothing weights that
            // depend on rounding: 1e-3 is ample for both and small compared with noise.
            let d = (y[0] / radiance - x[0]).abs();
            assert!(d <= 1e-3 * x[0], "{radiance}: {} {}", x[0], y[0] / radiance);
        }
    }
}

#[test]
fn a_face_that_coincides_with_another_is_no_blacker_than_that() {
    let b = under_the_sun(&[("floor", &floor()), ("copy", &floor())]);
    for instance in &b.baked.vertices.instances {
        assert!(instance.iter().flatten().all(|e| (e[0] - 2.0).abs() < 1e-4));
    }
    all_hold(&lumels_of(&b, "copy"), 2.0);
}

#[test]
fn a_duplicate_turned_over_gets_the_light_of_its_own_side() {
    // A two-sided floor occupies both sides in the list of triangles. Its copy, single-sided and
    // facing down, is lit from below if the sun shines up; the floor is not, because its lightmap
    // is that of the front.
    for (up, expected) in [(true, [0.0, 2.0]), (false, [2.0, 0.0])] {
        let mut b = GltfBuilder::new();
        let two_sided = b.material(&Material {
            double_sided: true,
            ..Material::diffuse("two-sided", [0.0; 3])
        });
        let black = b.material(&Material::diffuse("black", [0.0; 3]));
        // Corners rotated by one as well, so that they are in another order.
        let mut turned = floor().flipped();
        for t in &mut turned.triangles {
            t.rotate_left(1);
        }
        for (name, g, m) in [("floor", &floor(), two_sided), ("under", &turned, black)] {
            let mesh = b.mesh(name, &[(g, m)]);
            b.node(Node::of_mesh(name, mesh));
        }
        let sun = b.light("sun", Light::Directional([2.0; 3]));
        let angle = std::f32::consts::FRAC_PI_2 * if up { 1.0 } else { -1.0 };
        b.node(Node {
            name: "sun".into(),
            rotation: glam::Quat::from_rotation_x(angle),
            light: Some(sun),
            ..Node::default()
        });
        let baked = bake(&b.finish(), &at(8.0));
        assert_eq!(baked.report.dropped_triangles[1], 2);
        for (i, (name, e)) in ["floor", "under"].into_iter().zip(expected).enumerate() {
            let lumels = lumels_of(&baked, name);
            assert_eq!(lumels.len(), 256, "{name}");
            all_hold(&lumels, e);
            let vertices = baked.baked.vertices.instances[i].iter().flatten();
            assert!(
                vertices
                    .into_iter()
                    .all(|v| (f64::from(v[0]) - e).abs() < 1e-4)
            );
        }
    }
}

#[test]
fn a_decal_in_the_plane_of_a_floor_and_another_tessellation_are_lit_like_it() {
    // Tilted and off the origin, so that rounding puts each sometimes above and sometimes below the
    // others, by up to 2e-7 m in the file's f32 coordinates of 2 to 4 m. Rays start 1.2e-6 m above
    // a surface there.
    let place = |g: Geometry| {
        g.transformed(glam::Affine3A::from_rotation_translation(
            glam::Quat::from_rotation_z(0.3) * glam::Quat::from_rotation_x(0.2),
            Vec3::new(2.7, 1.3, -2.1),
        ))
    };
    let fine = grid(
        Vec3::new(-1.0, 0.0, 1.0),
        Vec3::X * 2.0,
        Vec3::Z * -2.0,
        [3, 5],
    );
    let decal = grid(
        Vec3::new(-0.4, 0.0, 0.3),
        Vec3::X * 0.7,
        Vec3::Z * -0.6,
        [1, 1],
    );
    let b = under_the_sun(&[
        ("floor", &place(floor())),
        ("fine", &place(fine.bare())),
        ("decal", &place(decal.bare())),
    ]);
    assert_eq!(b.report.dropped_triangles[1], 0);
    let cosine = f64::from(0.3f32.cos() * 0.2f32.cos());
    for name in ["floor", "fine", "decal"] {
        all_hold(&lumels_of(&b, name), 2.0 * cosine);
    }
}

/// `glb` with its JSON changed.
pub(crate) fn edited(glb: &[u8], edit: impl FnOnce(&mut serde_json::Value)) -> Vec<u8> {
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
    let end = 20 + word(12);
    let mut json = serde_json::from_slice(&glb[20..end]).unwrap();
    edit(&mut json);
    let mut text = serde_json::to_vec(&json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = glb[..8].to_vec();
    out.extend((20 + text.len() as u32 + (glb.len() - end) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(&glb[16..20]);
    out.extend(text);
    out.extend(&glb[end..]);
    out
}

#[test]
fn occluders_cast_their_shadow_and_nothing_else() {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let white = b.material(&Material::emitter("white", [5.0; 3], [0.9; 3]));
    let floor = b.mesh("floor", &[(&floor(), grey)]);
    b.node(Node::of_mesh("floor", floor));
    // Over the half of the floor where x > 0, and beyond its rim on the other sides.
    let roof = grid(
        Vec3::new(0.0, 0.5, 2.0),
        Vec3::X * 2.0,
        Vec3::Z * -4.0,
        [1, 1],
    );
    let roof = b.mesh("roof", &[(&roof.bare(), white)]);
    b.node(Node::of_mesh("roof", roof));
    let sun = b.light("sun", Light::Directional([2.0; 3]));
    b.node(Node {
        name: "sun".into(),
        rotation: glam::Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2),
        light: Some(sun),
        ..Node::default()
    });
    let glb = b.finish();
    let bake_as = |list: &str, index: usize| {
        let glb = edited(&glb, |json| {
            json["materials"][white]["doubleSided"] = true.into();
            json[list][index]["extras"]["lumel"]["occluder"] = true.into();
        });
        bake(&glb, &at(8.0))
    };
    for (list, index) in [("materials", white), ("nodes", 1)] {
        let baked = bake_as(list, index);
        let lumels = lumels_of(&baked, "floor");
        assert_eq!(lumels.len(), 256, "{list}");
        let (lit, dark): (Vec<_>, Vec<_>) = lumels.into_iter().partition(|l| l.all(|p| p.x < 0.0));
        assert_eq!((lit.len(), dark.len()), (128, 128), "{list}");
        // If the roof glowed or reflected, it would light both halves.
        all_hold(&lit, 2.0);
        all_hold(&dark, 0.0);
        assert_eq!(baked.layout.placements[1].rect.w, 0, "{list}");
        assert_eq!(baked.report.gather.light.lumels, 256, "{list}");
    }
}

/// A double-sided floor with its front towards the ground, under a sun of 2 lux straight down.
fn upside_down(sky: f32) -> Bake {
    let mut b = GltfBuilder::new();
    let paper = b.material(&Material {
        double_sided: true,
        ..Material::diffuse("paper", [0.0; 3])
    });
    let mesh = b.mesh("floor", &[(&floor(), paper)]);
    b.node(Node {
        rotation: glam::Quat::from_rotation_x(std::f32::consts::PI),
        ..Node::of_mesh("floor", mesh)
    });
    let sun = b.light("sun", Light::Directional([2.0; 3]));
    b.node(Node {
        name: "sun".into(),
        rotation: glam::Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2),
        light: Some(sun),
        ..Node::default()
    });
    let settings = Settings {
        sky: SkySource::Color([sky; 3]),
        ..at(8.0)
    };
    bake(&b.finish(), &settings)
}

#[test]
fn a_sheet_whose_front_nobody_sees_holds_the_light_of_its_back() {
    // The front faces the void.
    all_hold(&lumels_of(&upside_down(0.0), "floor"), 2.0);
    // The front sees a sky, so it counts: π times its radiance.
    let baked = upside_down(0.1);
    all_hold(&lumels_of(&baked, "floor"), 0.1 * PI);
    // The back has 2.0 more, which cannot be shown.
    let said = "different light on their two sides: \"floor\" (7 times brighter at the back)";
    let warnings = &baked.report.warnings;
    assert!(warnings.iter().any(|w| w.contains(said)), "{warnings:?}");
}

#[test]
fn a_lamp_that_stands_out_by_a_millimetre_draws_no_dots() {
    // A luminous box, sunk into the ceiling of a grey room. Its sides light a hairline beside it.
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let glow = b.material(&Material::emitter("glow", [90.0; 3], [0.4; 3]));
    let walls = room(Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 3.0, 2.0), 1);
    let [low, high] = [Vec3::new(0.03, 2.999, -1.5), Vec3::new(0.11, 3.04, 1.5)];
    for (name, g, m) in [("room", walls, grey), ("lamp", cuboid(low, high, 1), glow)] {
        let mesh = b.mesh(name, &[(&g.bare(), m)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let settings = Settings {
        quality: Quality::Quick,
        vertex_colors: false,
        ..at(10.0)
    };
    let baked = bake(&b.finish(), &settings);
    let lumels = lumels_of(&baked, "room");
    let ceiling = lumels.iter().filter(|l| l.normal.y < -0.9);
    let along = ceiling.filter(|l| l.middle().z.abs() < 1.4);
    let beside = |l: &&Seen| !l.all(|p| (0.01..0.09).contains(&p.x)) && l.middle().x.abs() < 0.25;
    let light: Vec<f64> = along.filter(beside).map(|l| l.red()).collect();
    let mean = light.iter().sum::<f64>() / light.len() as f64;
    let most = light.iter().fold(0.0, |a: f64, b| a.max(*b));
    // Measured 1.7: lumels of which the lamp leaves 3 cm free have few points. With light from any
    // distance it is 21.
    assert!(light.len() > 100 && most < 3.0 * mean, "{most}, {mean}");
}
