//! Surfaces without thickness: each side shows its own light, and light from outside does not leak
//! in.

use std::f64::consts::PI;

use crate::common::{at, bake, lumels_of};
use glam::Vec3;
use lumel::{Bake, Quality, Settings, SkySource};
use lumel_tests::geometry::{Geometry, cuboid, grid, room};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};

/// A wall across x = 0, facing −x.
fn partition() -> Geometry {
    grid(Vec3::ZERO, Vec3::Z * 2.0, Vec3::Y * 2.0, [1, 1]).bare()
}

/// Two rooms of 2 m, without walls where they meet at x = 0.
fn rooms() -> [Geometry; 2] {
    [-2.0, 0.0].map(|x| {
        let mut g = room(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 2.0, 2.0, 2.0), 1).bare();
        let positions = g.positions.clone();
        (g.triangles).retain(|t| t.iter().any(|&i| positions[i as usize].x != 0.0));
        g
    })
}

fn settings() -> Settings {
    Settings {
        quality: Quality::Draft,
        ..at(8.0)
    }
}

/// Mean irradiance of a node's lumels that face along `normal`.
fn mean_facing(bake: &Bake, node: &str, normal: glam::DVec3) -> f64 {
    let lumels = lumels_of(bake, node);
    let facing: Vec<f64> = (lumels.iter())
        .filter(|l| l.normal.dot(normal) > 0.9)
        .map(|l| l.red())
        .collect();
    assert!(!facing.is_empty(), "{node} has no lumel facing {normal}");
    facing.iter().sum::<f64>() / facing.len() as f64
}

#[test]
fn faces_back_to_back_are_each_seen_from_their_own_side() {
    // Two furnaces share a wall of two single-sided faces. Every point of a furnace receives π L /
    // (1 − ρ), whatever its shape, without noise. A ray that hit the back of the other room's face
    // would find it black.
    let radiance = [1.0, 3.0];
    for first in [0, 1] {
        let mut b = GltfBuilder::new();
        let glow = radiance.map(|l| b.material(&Material::emitter("glow", [l; 3], [0.5; 3])));
        for (i, g) in rooms().iter().enumerate() {
            let name = format!("room_{i}");
            let mesh = b.mesh(&name, &[(g, glow[i])]);
            b.node(Node::of_mesh(&name, mesh));
        }
        // In either order, because the tree reports the face that comes first.
        for i in [first, 1 - first] {
            let wall = if i == 0 {
                partition()
            } else {
                partition().flipped()
            };
            let mesh = b.mesh("wall", &[(&wall, glow[i])]);
            b.node(Node::of_mesh(&format!("wall_{i}"), mesh));
        }
        let baked = bake(&b.finish(), &settings());
        for (i, l) in radiance.into_iter().enumerate() {
            let exact = PI * l as f64 / 0.5;
            for node in [format!("room_{i}"), format!("wall_{i}")] {
                for lumel in lumels_of(&baked, &node) {
                    // Draft's relaxation stops at 1 %; see the furnaces of the closed forms.
                    let e = lumel.red();
                    assert!((e / exact - 1.0).abs() < 0.01, "{node}: {e}, not {exact}");
                }
            }
        }
    }
}

/// Two rooms with a lamp each, and a double-sided wall between them.
fn wall_without_thickness(candela: [f32; 2]) -> Vec<u8> {
    wall_and_furniture(candela, None)
}

/// The same with something else in them.
fn wall_and_furniture(candela: [f32; 2], furniture: Option<&Geometry>) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.5; 3]));
    let sheet = b.material(&Material {
        double_sided: true,
        ..Material::diffuse("sheet", [0.5; 3])
    });
    let [left, right] = rooms();
    for (name, g, m) in [
        ("left", &left, white),
        ("right", &right, white),
        ("wall", &partition(), sheet),
    ] {
        let mesh = b.mesh(name, &[(g, m)]);
        b.node(Node::of_mesh(name, mesh));
    }
    if let Some(g) = furniture {
        let mesh = b.mesh("furniture", &[(g, white)]);
        b.node(Node::of_mesh("furniture", mesh));
    }
    for (x, intensity) in [-1.0, 1.0].into_iter().zip(candela) {
        let light = b.light("lamp", Light::Point([intensity; 3]));
        b.node(Node {
            name: "lamp".into(),
            translation: Vec3::new(x, 1.5, 1.0),
            light: Some(light),
            ..Node::default()
        });
    }
    b.finish()
}

#[test]
fn a_wall_without_thickness_shows_the_light_of_both_rooms() {
    let glb = wall_without_thickness([5.0, 1.0]);
    let baked = bake(&glb, &settings());
    let [left, right] = [-1.0, 1.0].map(|x| mean_facing(&baked, "wall", glam::DVec3::X * x));
    // The rooms are mirror images, so only noise makes the ratio differ from that of the lamps: 64
    // lumels per side, whose errors of some 5 % each are partly correlated.
    assert!((left / right / 5.0 - 1.0).abs() < 0.03, "{left} {right}");
    // The written file has a single-sided face for each side.
    let json = baked.loaded.document.json();
    let mesh = &json["meshes"][2]["primitives"];
    assert_eq!(mesh.as_array().map(Vec::len), Some(2));
    for primitive in mesh.as_array().expect("primitives") {
        let material = primitive["material"].as_u64().expect("an index") as usize;
        assert_eq!(json["materials"][material]["doubleSided"], false);
    }
    assert!(baked.report.notes.iter().any(|n| n.contains("\"wall\"")));
    let shared = bake(
        &glb,
        &Settings {
            split_sides: false,
            ..settings()
        },
    );
    let json = shared.loaded.document.json();
    assert_eq!(
        json["meshes"][2]["primitives"].as_array().map(Vec::len),
        Some(1)
    );
    assert!(
        shared
            .report
            .warnings
            .iter()
            .any(|w| w.contains("\"wall\""))
    );
}

#[test]
fn a_wardrobe_against_a_wall_of_a_dark_room_leaves_it_two_sides() {
    // A centimetre off, before four fifths of the wall, and flush with half of it.
    for (from, to) in [
        (Vec3::new(0.01, 0.0, 0.1), Vec3::new(0.6, 1.8, 1.9)),
        (Vec3::new(0.0, 0.0, 0.4), Vec3::new(0.6, 1.6, 1.6)),
    ] {
        let wardrobe = cuboid(from, to, 1).bare();
        let baked = bake(
            &wall_and_furniture([5.0, 0.01], Some(&wardrobe)),
            &settings(),
        );
        let [left, right] = [-1.0, 1.0].map(|x| mean_facing(&baked, "wall", glam::DVec3::X * x));
        assert!(left > 100.0 * right, "{left} {right}");
    }
}

#[test]
fn a_wall_without_thickness_between_equal_rooms_stays_as_it_is() {
    let baked = bake(&wall_without_thickness([2.0, 2.0]), &settings());
    let json = baked.loaded.document.json();
    assert_eq!(
        json["meshes"][2]["primitives"].as_array().map(Vec::len),
        Some(1)
    );
}

#[test]
fn a_rug_sunk_into_a_floor_without_thickness_shows_nothing_of_the_sky_below() {
    // A furnace whose walls have no thickness, under a sky that is ten times as bright. The rug's
    // sides are half a lumel high, two thirds of that below the floor.
    let mut b = GltfBuilder::new();
    let glow = b.material(&Material {
        double_sided: true,
        ..Material::emitter("glow", [1.0; 3], [0.5; 3])
    });
    let shell = room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), 1).bare();
    let rug = cuboid(Vec3::new(1.0, -0.02, 1.0), Vec3::new(2.0, 0.01, 2.0), 1).bare();
    for (name, g) in [("shell", &shell), ("rug", &rug)] {
        let mesh = b.mesh(name, &[(g, glow)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let settings = Settings {
        sky: SkySource::Color([20.0; 3]),
        ..Settings {
            quality: Quality::Draft,
            ..at(16.0)
        }
    };
    let baked = bake(&b.finish(), &settings);
    let exact = PI / 0.5;
    let mut sides = 0;
    for l in lumels_of(&baked, "rug") {
        if l.normal.y.abs() < 0.5 {
            sides += 1;
            // As above.
            assert!((l.red() / exact - 1.0).abs() < 0.02, "{}", l.red() / exact);
        }
    }
    assert!(sides >= 4 * 16, "{sides}");
}

#[test]
fn the_inside_of_a_double_sided_pillar_around_a_wall_gets_no_light_of_its_own() {
    // As kits are built: a pillar around a wall's end, both closed. Rays inside of the pillar meet
    // fronts, those of the wall, but nobody can be there. A shade on the pillar, open below, has an
    // inside that is seen, but is a small part of all.
    let mut b = GltfBuilder::new();
    let sheet = b.material(&Material {
        double_sided: true,
        ..Material::diffuse("sheet", [0.5; 3])
    });
    let shell = room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), 1).bare();
    let wall = cuboid(Vec3::new(0.0, 0.0, 1.35), Vec3::new(1.5, 2.0, 1.65), 1).bare();
    let pillar = Geometry::union([
        &cuboid(Vec3::new(1.2, 0.0, 1.3), Vec3::new(1.6, 2.0, 1.7), 1).bare(),
        &hollow(Vec3::new(1.62, 1.2, 1.4), Vec3::new(1.82, 1.4, 1.6)),
    ]);
    for (name, g) in [("shell", &shell), ("wall", &wall), ("pillar", &pillar)] {
        let mesh = b.mesh(name, &[(g, sheet)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let light = b.light("lamp", Light::Point([5.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: Vec3::new(2.3, 1.5, 1.0),
        light: Some(light),
        ..Node::default()
    });
    // Charts would end at the lamp's shadows.
    let settings = Settings {
        cut_charts: false,
        ..settings()
    };
    let baked = bake(&b.finish(), &settings);
    let json = baked.loaded.document.json();
    for mesh in json["meshes"].as_array().expect("meshes") {
        let primitives = mesh["primitives"].as_array().map(Vec::len);
        assert_eq!(primitives, Some(1), "{}", mesh["name"]);
    }
    // The insides of wall and pillar are 11.6 of the 108 m² of all sides.
    let elements = u64::from(baked.report.solve.subdivision.elements);
    let buried = baked.report.solve.buried_elements;
    assert!(buried > elements / 10, "{buried} of {elements}");
}

/// A box without a bottom, whose faces are double-sided.
fn hollow(low: Vec3, high: Vec3) -> Geometry {
    let mut g = cuboid(low, high, 1).bare();
    let positions = g.positions.clone();
    (g.triangles).retain(|t| t.iter().any(|&i| positions[i as usize].y != low.y));
    g
}

#[test]
fn the_hollow_of_a_wall_does_not_darken_the_corner_of_a_room() {
    // Walls 0.25 m thick stand on a floor that reaches under them, and overlap in the corners,
    // in the middle of a lumel. What is inside of them is dark, but sees more than backs.
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.5; 3]));
    let sheet = b.material(&Material {
        double_sided: true,
        ..Material::diffuse("sheet", [0.5; 3])
    });
    let floor = grid(Vec3::ZERO, Vec3::Z * 3.0, Vec3::X * 3.0, [1, 1]).bare();
    let mesh = b.mesh("floor", &[(&floor, white)]);
    b.node(Node::of_mesh("floor", mesh));
    for (name, low, high) in [
        ("west", [0.0, 0.0, 0.0], [0.25, 0.6, 3.0]),
        ("east", [2.75, 0.0, 0.0], [3.0, 0.6, 3.0]),
        ("south", [0.0, 0.0, 0.0], [3.0, 0.6, 0.25]),
        ("north", [0.0, 0.0, 2.75], [3.0, 0.6, 3.0]),
    ] {
        let g = hollow(Vec3::from_array(low), Vec3::from_array(high));
        let mesh = b.mesh(name, &[(&g, sheet)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let light = b.light("lamp", Light::Point([1.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: Vec3::new(1.5, 2.0, 1.5),
        light: Some(light),
        ..Node::default()
    });
    let baked = bake(
        &b.finish(),
        &Settings {
            quality: Quality::Preview,
            ..at(10.0)
        },
    );
    let lumels: Vec<_> = (lumels_of(&baked, "west").into_iter())
        .filter(|l| l.normal.x > 0.9)
        .collect();
    let row = |z: f64| -> Vec<f64> {
        let near = lumels.iter().filter(|l| (l.mean(|p| p.z) - z).abs() < 0.05);
        near.map(|l| l.red()).collect()
    };
    let inner = row(0.45);
    let inner = inner.iter().sum::<f64>() / inner.len() as f64;
    let corner = row(0.25);
    assert!(!corner.is_empty());
    for e in corner {
        // Light on the wall falls by a fifth towards the corner; in the hollow there is none.
        assert!(e > 0.5 * inner, "{e} beside {inner}");
    }
}

/// Bakes a rug `height` metres above a floor. Its edges must not darken the lumels, `side` metres
/// wide, that lookups beside it read.
fn draws_no_line_on_the_floor(height: f32, side: f32) {
    // A furnace with a single-sided rug, whose edges cross lumels at all fractions. Its back is
    // black, so it is dark below the rug.
    let mut b = GltfBuilder::new();
    let glow = b.material(&Material::emitter("glow", [1.0; 3], [0.5; 3]));
    let shell = room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), 1).bare();
    let (u, v) = (Vec3::new(0.1, 0.0, 1.2), Vec3::new(1.2, 0.0, -0.1));
    let rug = grid(Vec3::new(0.8, height, 0.9), u, v, [1, 1]).bare();
    for (name, g) in [("shell", &shell), ("rug", &rug)] {
        let mesh = b.mesh(name, &[(g, glow)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let glb = b.finish();
    for quality in [Quality::Draft, Quality::Quick] {
        let settings = Settings {
            quality,
            ..at(1.0 / side)
        };
        let baked = bake(&glb, &settings);
        let exact = PI / 0.5;
        let (mut beside, mut sum) = (0, 0.0);
        for l in lumels_of(&baked, "shell") {
            if l.normal.y < 0.5 {
                continue;
            }
            // How far the lumel's middle is beyond the rug's edges, in lumels.
            let from = l.middle() - glam::DVec3::new(0.8, 0.0, 0.9);
            let beyond = [u, v].map(|edge| {
                let edge = edge.as_dvec3();
                let along = from.dot(edge) / edge.length();
                (-along).max(along - edge.length())
            });
            let beyond = beyond[0].max(beyond[1]) / f64::from(side);
            // Lookups beside the rug read lumels whose middle is up to one lumel below it.
            if beyond > -0.9 {
                let e = l.red() / exact;
                // Of the few rays of a sliver, half may find the rug's back.
                assert!(e > 0.4, "{e} at {}, {beyond} lumels", l.middle());
                if -0.25 < beyond && beyond < 1.0 {
                    beside += 1;
                    sum += e;
                }
            }
        }
        // A point `d` beside the rug's edge sees its back in (1 - d/sqrt(d² + height²)) / 2 of its
        // half space: together half the height's light. The rest is the solve's residual.
        let mean = sum / f64::from(beside);
        let back = 0.5 * f64::from(height / side);
        assert!(1.0 - mean < back + 0.012, "{mean}");
        assert!(mean - 1.0 < 0.02, "{mean}");
        assert!(f64::from(beside) > 4.0 / f64::from(side), "{beside}");
    }
}

#[test]
fn a_rug_that_hovers_by_a_millimetre_draws_no_line_on_the_floor() {
    draws_no_line_on_the_floor(0.001, 1.0 / 16.0);
}

#[test]
fn a_plate_a_centimetre_off_draws_no_line() {
    // A picture hangs like this. Its gap is a tenth of a lumel.
    draws_no_line_on_the_floor(0.01, 0.1);
}
