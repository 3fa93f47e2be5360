//! The bake against a path tracer that shares nothing with it, on scenes whose light has no closed form.
//!
//! The bake's own files are read back: geometry, lightmap coordinates and node extras from the glTF, values and claimed errors from the EXR. Some lumels
//! are drawn by a fixed seed, their footprints are traced, and [`Comparison::objections`] says what does not fit. All random numbers
//! are fixed, so the tests are deterministic; that they can fail is tested too.

mod common;

use common::bake;
use glam::DVec3;
use lumel::atlas_bake::read_exr;
use lumel::{Layer, Quality, Settings, SkySource};
use lumel_tests::path_tracer::{
    Comparison, Effort, Pair, PathTracer, Scene, choose, footprints, luminance,
};
use lumel_tests::scenes::{cornell_box, second_method as scenes};

/// Bias that `production` may have: the project's own claim for it (issue 3, "bias ≤ 0.1 %").
const BIAS: f64 = 0.001;

/// Lumels with less surface than this are not drawn: a chart's edge cuts through them, and the bake's sixteen points come from a stream of 128
/// over the whole texel, of which fewer than eight would be left.
const LEAST_COVERAGE: f64 = 1.0 / 16.0;

/// Root mean square rounding error of half floats, relative: at most 2⁻¹¹, evenly spread.
const HALF: f64 = 1.0 / 2048.0 / 1.732;

fn production(texels_per_unit: f32, sky: SkySource) -> Settings {
    Settings {
        quality: Quality::Production,
        texels_per_unit: Some(texels_per_unit),
        layers: vec![Layer::Error],
        sky,
        ..Settings::default()
    }
}

/// Bakes `glb` and traces `lumels` of its lumels with each of `efforts`; one comparison per effort.
fn compare(glb: &[u8], settings: &Settings, lumels: usize, efforts: &[Effort]) -> Vec<Comparison> {
    let baked = bake(glb, settings);
    let dir = tempfile::tempdir().expect("a temporary folder");
    baked.write(dir.path()).expect("written");
    let glb = std::fs::read(dir.path().join("scene.glb")).expect("the lightmapped scene");
    let mut scene = Scene::from_glb(&glb).expect("a scene that the path tracer models");
    if let SkySource::Color(sky) = settings.sky {
        scene.sky = DVec3::from_array(sky.map(f64::from));
    }
    let pages: Vec<_> = baked
        .page_names()
        .iter()
        .map(|name| read_exr(&dir.path().join(name)).expect("an EXR"))
        .collect();
    let sizes: Vec<_> = pages.iter().map(|p| [p.width, p.height]).collect();
    let mut all = footprints(&scene, &sizes);
    all.retain(|f| f.coverage >= LEAST_COVERAGE);
    let chosen = choose(all, lumels, 0x5eed);
    let tracer = PathTracer::new(scene);
    let scene = tracer.scene();
    let one = |effort: &Effort| {
        let traced = tracer.irradiance(&chosen, *effort);
        let pairs = chosen.iter().zip(traced).map(|(f, traced)| {
            let page = &pages[f.page];
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
        });
        Comparison {
            pairs: pairs.collect(),
        }
    };
    efforts.iter().map(one).collect()
}

/// Fails with the whole table where anything speaks against the bake.
fn agree(name: &str, c: &Comparison) {
    let objections = c.objections(BIAS);
    assert!(objections.is_empty(), "{name}: {objections:#?}\n{c}");
}

#[test]
fn a_cornell_box() {
    let settings = production(6.0, SkySource::None);
    let cut = Effort {
        bounces: Some(3),
        ..Effort::new(4_000, 2)
    };
    let efforts = [Effort::new(16_000, 1), cut];
    let all = compare(&cornell_box(), &settings, 120, &efforts);
    agree("Cornell box", &all[0]);
    // The method that most engines ship, a few bounces and no more, is caught.
    let objections = all[1].objections(BIAS);
    assert!(
        objections.iter().any(|o| o.starts_with("red")),
        "{}",
        all[1]
    );

    // And so is a bake that is wrong in one way each.
    let c = &all[0];
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
    let all = compare(
        &scenes::skylit_room(),
        &settings,
        120,
        &[Effort::new(16_000, 1)],
    );
    agree("skylit room", &all[0]);
    // A difference in one place only is seen by the label.
    let mut c = all[0].clone();
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
    let all = compare(
        &scenes::coloured_room(),
        &settings,
        120,
        &[Effort::new(12_000, 1)],
    );
    agree("coloured room", &all[0]);
    // Light does come off the coloured walls: white lumels are far from grey somewhere.
    let spread =
        |p: &&Pair| p.label == "white" && p.judged.max_element() > 1.3 * p.judged.min_element();
    assert!(all[0].pairs.iter().any(|p| spread(&p)), "{}", all[0]);
}

#[test]
fn a_door_to_a_second_room_and_a_sealed_one() {
    let settings = production(8.0, SkySource::None);
    let glb = scenes::two_rooms_with_a_door();
    let all = compare(&glb, &settings, 160, &[Effort::new(12_000, 1)]);
    agree("two rooms with a door", &all[0]);
    let sealed: Vec<_> = all[0]
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

/// All lumels, for the record in docs/second_method.md:
/// `[QUALITY=draft|preview] cargo test -p lumel-tests --test second_method -- --ignored --nocapture`.
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
        let c = &compare(&glb, &settings, usize::MAX, &[Effort::new(2_000, 3)])[0];
        let table = c.to_string();
        let head: Vec<&str> = table.lines().take(24).collect();
        println!(
            "== {name}, {quality:?}\n{}\n{:#?}",
            head.join("\n"),
            c.objections(BIAS)
        );
    }
}
