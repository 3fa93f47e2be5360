//! Levels of detail and variants: rays see the first, the others copy its light.

use glam::{DVec3, Quat, Vec3};
use lumel::{Bake, Quality, Settings};
use lumel_tests::geometry::{Geometry, cuboid, grid, icosphere};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use lumel_tests::levels::{Family, Size, level as generated};
use serde_json::json;

use crate::common::{Seen, at, bake, lumels_of, mean};

/// How levels are marked.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Told {
    Not,
    Name,
    /// Names of nodes that have other parents.
    NameOfParents,
    Lod,
    Variant,
    Msft,
}

const BY_ALL: [Told; 5] = [
    Told::Name,
    Told::NameOfParents,
    Told::Lod,
    Told::Variant,
    Told::Msft,
];

/// A floor of 4 m, a sun of 2 lux straight down, and `levels` of one object, all of this
/// reflectance.
fn level(levels: &[Geometry], told: Told, reflectance: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [reflectance; 3]));
    let floor = Vec3::new(-2.0, 0.0, 2.0);
    let floor = grid(floor, Vec3::X * 4.0, Vec3::Z * -4.0, [1, 1]).bare();
    let mesh = b.mesh("floor", &[(&floor, grey)]);
    b.node(Node::of_mesh("floor", mesh));
    let mut first = None;
    for (k, g) in levels.iter().enumerate() {
        let mesh = b.mesh(&format!("mesh{k}"), &[(g, grey)]);
        let mut node = Node::of_mesh(&format!("thing{k}"), mesh);
        let parted =
            |key: &str, number: &str| json!({"lumel": {key: {"group": "thing", number: k}}});
        match told {
            Told::Not | Told::Msft | Told::NameOfParents => {}
            Told::Name => node.name = format!("Thing_LOD{k}"),
            Told::Lod => node.extras = Some(parted("lod", "level")),
            Told::Variant => node.extras = Some(parted("variant", "index")),
        }
        match (told, first) {
            (Told::Msft, Some(_)) => drop(b.child(node)),
            (Told::NameOfParents, _) => {
                let child = b.child(node);
                b.node(Node {
                    name: format!("Thing_lod{k}"),
                    children: vec![child],
                    ..Node::default()
                });
            }
            _ => first = first.or(Some(b.node(node))),
        }
    }
    if let (Told::Msft, Some(first)) = (told, first) {
        let ids: Vec<usize> = (1..levels.len()).map(|k| first + k).collect();
        b.node_json(first)["extensions"] = json!({"MSFT_lod": {"ids": ids}});
    }
    let sun = b.light("sun", Light::Directional([2.0; 3]));
    b.node(Node {
        name: "sun".into(),
        rotation: Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2),
        light: Some(sun),
        ..Node::default()
    });
    b.finish()
}

fn name(told: Told, k: usize) -> String {
    match told {
        Told::Name => format!("Thing_LOD{k}"),
        _ => format!("thing{k}"),
    }
}

/// Boxes of 1 m, 0.94 m and 1.06 m, 0.3 m over the floor.
fn boxes() -> Vec<Geometry> {
    [0.0f32, -0.03, 0.03]
        .into_iter()
        .map(|grow| {
            let half = Vec3::splat(0.5 + grow);
            let middle = Vec3::Y * 0.8;
            cuboid(middle - half, middle + half, 1).bare()
        })
        .collect()
}

/// The lumels that face up.
fn tops(bake: &Bake, node: &str) -> Vec<Seen> {
    let mut seen = lumels_of(bake, node);
    seen.retain(|l| l.normal.y > 0.9);
    assert!(seen.len() > 30, "{node}: {}", seen.len());
    seen
}

#[test]
fn every_level_has_the_light_of_the_first_however_it_is_told() {
    for told in BY_ALL {
        let out = bake(&level(&boxes(), told, 0.0), &at(8.0));
        let groups = &out.report.ingest.lods;
        assert_eq!(groups.len(), 1, "{told:?}");
        assert_eq!(groups[0].levels, [0, 1, 2], "{told:?}");
        assert_eq!(groups[0].stand_ins.len(), 2);
        for k in 0..3 {
            // Nothing is sampled, so only half float rounds (2⁻¹¹).
            for l in tops(&out, &name(told, k)) {
                assert!((l.red() - 2.0).abs() < 1e-3, "{told:?} {k}: {}", l.red());
            }
        }
        // Only the first casts a shadow, half a metre in each direction, even if another level is
        // larger.
        let (mut lit, mut dark) = (0, 0);
        for l in lumels_of(&out, "floor") {
            let within = |p: DVec3, s: f64| p.x.abs() < s && p.z.abs() < s;
            if l.all(|p| within(p, 0.4999)) {
                assert_eq!(l.red(), 0.0);
                dark += 1;
            } else if l.all(|p| !within(p, 0.5001)) {
                assert!((l.red() - 2.0).abs() < 1e-3, "{}", l.red());
                lit += 1;
            }
        }
        assert!(lit > 500 && dark > 30, "{lit} {dark}");
    }
}

#[test]
fn what_nobody_told_is_three_things() {
    let out = bake(&level(&boxes(), Told::Not, 0.0), &at(8.0));
    assert!(out.report.ingest.lods.is_empty());
    // Only the outermost is lit.
    assert!(mean(&tops(&out, "thing2")) > 1.9);
    // Its shadow is 1.06 m wide: 71.9 lumels. Charts end at its edge.
    let dark = (lumels_of(&out, "floor").iter())
        .filter(|l| l.red() < 1e-3)
        .map(|l| l.coverage)
        .sum::<f32>();
    assert!((dark - 71.9).abs() < 1.0, "{dark}");
    let settings = Settings {
        lods: false,
        ..at(8.0)
    };
    let out = bake(&level(&boxes(), Told::Name, 0.0), &settings);
    assert!(out.report.ingest.lods.is_empty());
    let out = bake(&level(&boxes(), Told::Lod, 0.0), &settings);
    assert_eq!(out.report.ingest.lods.len(), 1);
}

/// Light bounces between balls of ever fewer triangles; a coarse ball is up to 6 % of its radius
/// inside the fine one.
#[test]
fn reflected_light_is_that_of_the_first_level_and_the_floor_has_no_other() {
    let balls: Vec<Geometry> = (0..3)
        .map(|k| icosphere(Vec3::Y * 0.7, 0.5, 3 - k))
        .collect();
    let settings = Settings {
        quality: Quality::Quick,
        ..at(10.0)
    };
    let all = bake(&level(&balls, Told::Name, 0.6), &settings);
    let alone = bake(&level(&balls[..1], Told::Name, 0.6), &settings);
    let claimed =
        all.report.gather.light.estimated_error + alone.report.gather.light.estimated_error;
    let first = mean(&lumels_of(&all, "Thing_LOD0"));
    let below = |k: usize| {
        let mut seen = lumels_of(&all, &name(Told::Name, k));
        seen.retain(|l| l.normal.y < -0.3);
        mean(&seen)
    };
    for k in 1..3 {
        let level = mean(&lumels_of(&all, &name(Told::Name, k)));
        // The lumels of another triangulation are distributed differently over the ball: with some
        // 25 across it, and half of it in the dark, the means differ by about a fiftieth.
        assert!((level / first - 1.0).abs() < 0.03, "{k}: {level}, {first}");
        let (own, fine) = (below(k), below(0));
        assert!((own / fine - 1.0).abs() < 0.05, "{k}: {own}, {fine}");
    }
    let [with, without] = [&all, &alone].map(|b| mean(&lumels_of(b, "floor")));
    // Only noise, and a mean has less of it than its lumels.
    assert!(
        (with / without - 1.0).abs() < claimed.min(0.01),
        "{with} {without}"
    );
}

/// Rocks and pedestals in lit rooms, with coarser levels inside, outside or across the finest.
#[test]
fn generated_levels_of_detail_are_lit_alike() {
    let settings = Settings {
        quality: Quality::Draft,
        ..at(12.0)
    };
    for seed in [1, 2] {
        let made = generated(Family::Lods, seed, Size::Small);
        let out = bake(&made.glb, &settings);
        assert!(!out.report.ingest.lods.is_empty(), "seed {seed}");
        for group in &out.report.ingest.lods {
            let of = |k: u32| mean(&lumels_of(&out, &format!("{}_LOD{k}", group.name)));
            let first = of(0);
            for k in [1, 2] {
                let level = of(k);
                // Coarse triangulations distribute their lumels differently over light that varies:
                // up to 4 % of the mean. In each other's shadow, two of three would be black.
                let off = level / first - 1.0;
                assert!(off.abs() < 0.06, "{seed} {} {k}: {off}", group.name);
            }
        }
    }
}
