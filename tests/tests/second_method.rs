//! Compares bakes with an independent path tracer on scenes without closed-form light.
//!
//! The bake's own files are read back: geometry, lightmap coordinates and node extras from the
//! glTF, values and claimed errors from the EXR. A fixed seed chooses lumels, their footprints are
//! traced, and [`Comparison::objections`] lists discrepancies. All random numbers are fixed, so the
//! tests are deterministic. Other tests show that they can fail.

use std::sync::LazyLock;

use crate::common::bake;
use glam::DVec3;
use lumel::atlas_bake::{ExrImage, read_exr};
use lumel::{Hidden, Layer, Quality, Settings, SkySource};
use lumel_tests::path_tracer::{
    Comparison, Effort, Estimate, Footprint, Pair, PathTracer, Scene, choose, footprints, luminance,
};
use lumel_tests::scenes::{cornell_box, second_method as scenes};

/// Largest bias of `production`, as the project claims for it.
const BIAS: f64 = 0.001;

/// Lumels with less coverage are not chosen: a chart's edge cuts through them, and fewer than eight
/// of the bake's sample points would fall on them.
const LEAST_COVERAGE: f64 = 1.0 / 16.0;

/// Root mean square rounding error of half floats, relative: at most 2⁻¹¹, evenly spread.
const HALF: f64 = 1.0 / 2048.0 / 1.732;

fn production(texels_per_unit: f32, sky: SkySource) -> Settings {
    Settings {
        quality: Quality::Production,
        texels_per_unit: Some(texels_per_unit),
        layers: vec![Layer::Error],
        sky,
        // The path tracer averages over the whole lumel, including hidden parts.
        hidden: Hidden::Mean,
        // Stitching trades accuracy for agreement at chart borders. In the doorway of the two
        // rooms, whose sides differ by a tenth over a lumel, it changes a lumel by 6 %. Its own
        // tests bound that.
        stitch: false,
        ..Settings::default()
    }
}

/// A bake read back from its files, ready to be traced.
struct Written {
    pages: Vec<ExrImage>,
    tracer: PathTracer,
    /// Every lumel that [`LEAST_COVERAGE`] leaves.
    lumels: Vec<Footprint>,
}

impl Written {
    fn new(glb: &[u8], settings: &Settings) -> Written {
        let baked = bake(glb, settings);
        let dir = tempfile::tempdir().expect("a temporary folder");
        baked.write(dir.path()).expect("written");
        let glb = std::fs::read(dir.path().join("scene.glb")).expect("the lightmapped scene");
        let mut scene = Scene::from_glb(&glb).expect("a scene that the path tracer models");
        if let SkySource::Color(sky) = settings.sky {
            scene.sky = DVec3::from_array(sky.map(f64::from));
        }
        let names = baked.page_names();
        let read = |name: &String| read_exr(&dir.path().join(name)).expect("an EXR");
        let pages: Vec<_> = names.iter().map(read).collect();
        let sizes: Vec<_> = pages.iter().map(|p| [p.width, p.height]).collect();
        let mut lumels = footprints(&scene, &sizes);
        lumels.retain(|f| f.coverage >= LEAST_COVERAGE);
        Written {
            pages,
            lumels,
            tracer: PathTracer::new(scene),
        }
    }

    /// `count` lumels by a fixed seed.
    fn some(&self, count: usize) -> Vec<Footprint> {
        choose(self.lumels.clone(), count, 0x5eed)
    }

    fn compare(&self, lumels: &[Footprint], effort: Effort) -> Comparison {
        let scene = self.tracer.scene();
        let traced = self.tracer.irradiance(lumels, effort);
        let pair = |(f, traced): (&Footprint, Estimate)| {
            let page = &self.pages[f.page];
            let texel = (f.texel[1] * page.width + f.texel[0]) as usize;
            let channel = |name: &str| {
                let values = page.channel(name).expect("a channel");
                f64::from(values[texel]) * std::f64::consts::PI
            };
            let judged = DVec3::from_array(["R", "G", "B"].map(channel));
            Pair {
                label: scene.nodes[scene.triangles[f.triangle()].node].clone(),
                position: f.centre(scene),
                judged,
                claimed: channel("error.Y").hypot(HALF * luminance(judged)),
                traced,
            }
        };
        Comparison {
            pairs: lumels.iter().zip(traced).map(pair).collect(),
        }
    }
}

/// The Cornell box, which two tests use.
static CORNELL: LazyLock<Written> =
    LazyLock::new(|| Written::new(&cornell_box(), &production(6.0, SkySource::None)));

/// Fails with the whole table if anything speaks against the bake.
fn agree(name: &str, c: &Comparison) {
    let objections = c.objections(BIAS);
    assert!(objections.is_empty(), "{name}: {objections:#?}\n{c}");
}

#[test]
fn a_cornell_box() {
    let written = &*CORNELL;
    let some = written.some(120);
    let c = &written.compare(&some, Effort::new(16_000, 1));
    agree("Cornell box", c);
    // The method of most engines, with only a few bounces, is rejected.
    let cut = Effort {
        bounces: Some(3),
        ..Effort::new(4_000, 2)
    };
    let cut = written.compare(&some, cut);
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
    let c = written.compare(&written.some(120), Effort::new(16_000, 1));
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
    let c = written.compare(&written.some(120), Effort::new(12_000, 1));
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
    let c = written.compare(&written.some(160), Effort::new(12_000, 1));
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

/// All lumels, as a record:
/// `[QUALITY=draft|preview] cargo test -p lumel-tests second_method:: -- --ignored --nocapture`.
#[test]
#[ignore = "minutes; for the record"]
#[allow(clippy::print_stdout, reason = "its table is what it is for")]
fn a_long_look() {
    let sky = SkySource::Color(scenes::SKY);
    let none = SkySource::None;
    let quality = match std::env::var("QUALITY").as_deref() {
        Ok("draft") => Quality::Draft,
        Ok("preview") => Quality::Preview,
        _ => Quality::Production,
    };
    for (name, glb, settings) in [
        ("Cornell box", cornell_box(), production(8.0, none.clone())),
        ("skylit room", scenes::skylit_room(), production(10.0, sky)),
        (
            "coloured room",
            scenes::coloured_room(),
            production(10.0, none.clone()),
        ),
        (
            "two rooms with a door",
            scenes::two_rooms_with_a_door(),
            production(10.0, none),
        ),
    ] {
        let settings = Settings {
            quality,
            ..settings
        };
        let written = Written::new(&glb, &settings);
        let c = written.compare(&written.lumels, Effort::new(2_000, 3));
        let table = c.to_string();
        let head: Vec<&str> = table.lines().take(24).collect();
        println!(
            "== {name}, {quality:?}\n{}\n{:#?}",
            head.join("\n"),
            c.objections(BIAS)
        );
    }
}
