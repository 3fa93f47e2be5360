//! Compares bakes with an independent path tracer on scenes without closed-form light.
//!
//! The bake's own files are read back: geometry, lightmap coordinates and node extras from the
//! glTF, values and claimed errors from the EXR. A fixed seed chooses lumels, their footprints are
//! traced, and [`Comparison::objections`] lists discrepancies. All random numbers are fixed, so the
//! tests are deterministic. Other tests show that they can fail.

mod written;

use std::sync::LazyLock;

use glam::DVec3;
use lumel::SkySource;
use lumel_tests::path_tracer::{Comparison, Effort, Footprint, Pair, Scene, choose, luminance};
use lumel_tests::scenes::{cornell_box, second_method as scenes};

use written::{BIAS, Written, production};

/// The Cornell box, which two tests use.
static CORNELL: LazyLock<Written> =
    LazyLock::new(|| Written::new(&cornell_box(), &production(6.0, SkySource::None)));

/// `count` lumels by a fixed seed.
fn some(written: &Written, count: usize) -> Vec<Footprint> {
    choose(written.lumels.clone(), count, 0x5eed)
}

/// Fails with the whole table if anything speaks against the bake.
fn agree(name: &str, c: &Comparison) {
    let objections = c.objections(BIAS);
    assert!(objections.is_empty(), "{name}: {objections:#?}\n{c}");
}

#[test]
fn a_cornell_box() {
    let written = &*CORNELL;
    let chosen = some(written, 120);
    let c = &written.compare(&chosen, Effort::new(16_000, 1));
    agree("Cornell box", c);
    // The method of most engines, with only a few bounces, is rejected.
    let cut = Effort {
        bounces: Some(3),
        ..Effort::new(4_000, 2)
    };
    let cut = written.compare(&chosen, cut);
    let objections = cut.objections(BIAS);
    assert!(objections.iter().any(|o| o.starts_with("red")), "{cut}");

    // So is a bake with any one of these faults.
    let changed = |f: &dyn Fn(usize, &mut Pair)| {
        let mut c = c.clone();
        for (i, p) in c.pairs.iter_mut().enumerate() {
            f(i, p);
        }
        c.objections(BIAS).len()
    };
    assert!(changed(&|_, p| p.judged *= 1.01) > 0);
    assert!(changed(&|_, p| p.judged *= 0.99) > 0);
    assert!(changed(&|_, p| p.judged.y *= 1.01) > 0);
    let noise = |i: usize| if i.is_multiple_of(2) { 1.05 } else { 0.95 };
    assert!(changed(&|i, p| p.judged *= noise(i)) > 0);
    assert!(
        changed(&|i, p| if i == 60 {
            p.judged *= 1.2
        }) > 0
    );
}

#[test]
fn a_room_under_a_sky_with_a_lamp() {
    let settings = production(8.0, SkySource::Color(scenes::SKY));
    let written = Written::new(&scenes::skylit_room(), &settings);
    let c = written.compare(&some(&written, 120), Effort::new(16_000, 1));
    agree("skylit room", &c);
    // A difference in one place only shows in the sum of its label.
    let mut c = c;
    for p in c.pairs.iter_mut().filter(|p| p.label == "room ceiling") {
        p.judged *= 1.05;
    }
    assert!(
        c.objections(BIAS)
            .iter()
            .any(|o| o.starts_with("room ceiling")),
        "{c}"
    );
}

#[test]
fn colours_that_bleed() {
    let settings = production(9.0, SkySource::None);
    let written = Written::new(&scenes::coloured_room(), &settings);
    let c = written.compare(&some(&written, 120), Effort::new(12_000, 1));
    agree("coloured room", &c);
    // Light does bounce off the coloured walls: white lumels are far from grey somewhere.
    let spread =
        |p: &&Pair| p.label == "white" && p.judged.max_element() > 1.3 * p.judged.min_element();
    assert!(c.pairs.iter().any(|p| spread(&p)), "{}", c);
}

#[test]
fn a_door_to_a_second_room_and_a_sealed_one() {
    let settings = production(8.0, SkySource::None);
    let glb = scenes::two_rooms_with_a_door();
    let written = Written::new(&glb, &settings);
    let c = written.compare(&some(&written, 160), Effort::new(12_000, 1));
    agree("two rooms with a door", &c);
    let sealed: Vec<_> = c
        .pairs
        .iter()
        .filter(|p| p.label.starts_with("sealed"))
        .collect();
    assert!(sealed.len() > 10, "{} sealed lumels", sealed.len());
    for p in sealed {
        assert!(
            p.judged == DVec3::ZERO && p.traced.mean == DVec3::ZERO,
            "{p:?}"
        );
    }
}

/// Lumels of the floor that are partly under a block. The bake's sixteen points determine their
/// visible fraction only to about 1/16.
///
/// Their values may differ from the truth by twice that fraction of the visible part's light (plus
/// 4 s.e. of the path tracer). Their claimed errors are not tested: if all points are buried, the
/// bake claims no error, which is wrong.
#[test]
fn lumels_at_the_foot_of_a_block() {
    let written = &*CORNELL;
    let scene = written.tracer.scene();
    let with_share = |f: &Footprint| (f.clone(), open_share(f, scene));
    let on_the_floor = |f: &&Footprint| f.centre(scene).y.abs() < 1e-6;
    let cut: Vec<_> = (written.lumels.iter().filter(on_the_floor).map(with_share))
        .filter(|(_, share)| (0.02..1.0).contains(share))
        .collect();
    assert!(cut.len() > 60, "{} lumels", cut.len());
    let lumels: Vec<_> = cut.iter().map(|c| c.0.clone()).collect();
    let c = written.compare(&lumels, Effort::new(4_000, 5));
    for (p, (_, share)) in c.pairs.iter().zip(&cut) {
        let open = luminance(p.traced.mean) / share;
        let bound = 2.0 / 16.0 * open + 4.0 * p.traced.luminance_error;
        assert!(p.difference().abs() < bound, "open {share}: {p:?}");
    }
}

/// Share of a square lumel of the Cornell box's floor outside the blocks, by 32² points.
fn open_share(f: &Footprint, scene: &Scene) -> f64 {
    // Centimetres (x, z), as in the scene's source.
    const BLOCKS: [[(f64, f64); 4]; 2] = [
        [(130.0, 65.0), (82.0, 225.0), (240.0, 272.0), (290.0, 114.0)],
        [
            (423.0, 247.0),
            (265.0, 296.0),
            (314.0, 456.0),
            (472.0, 406.0),
        ],
    ];
    let inside = |block: &[(f64, f64); 4], x: f64, z: f64| {
        let left = |i: usize| {
            let ((px, pz), (qx, qz)) = (block[i], block[(i + 1) % 4]);
            (qx - px) * (z - pz) > (qz - pz) * (x - px)
        };
        (0..4).all(left) || (0..4).all(|i| !left(i))
    };
    let (centre, half) = (100.0 * f.centre(scene), 50.0 * f.area.sqrt());
    let at = |k: u32| half * ((f64::from(k) + 0.5) / 16.0 - 1.0);
    let open = |k: &u32| {
        let (x, z) = (centre.x + at(k % 32), centre.z + at(k / 32));
        !BLOCKS.iter().any(|b| inside(b, x, z))
    };
    (0..1024).filter(open).count() as f64 / 1024.0
}
