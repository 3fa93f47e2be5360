//! The stages of a bake, each timed on inputs made once: form factors, solve, gather, and a whole
//! bake from file to files in memory.
//!
//!     cargo bench --bench light                    all of them
//!     cargo bench --bench light -- solve           one
//!
//! For rays alone: `cargo bench --bench traversal`. The scenes are those in `assets/`, at densities
//! that keep a run within seconds.
#![allow(missing_docs, reason = "benches are not an interface")]

use std::path::{Path, PathBuf};

use divan::{Bencher, black_box, counter::ItemsCount};
use glam::{DVec3, Vec3};
use lumel::atlas::{Layout, LayoutOptions, layout};
use lumel::atlas_bake::{self, BakeOptions, Hidden, ValueKind};
use lumel::gather::{GatherOptions, Interpolation};
use lumel::mesh_ingest::{self, LoadOptions, Soup};
use lumel::radiosity::{
    DirectOptions, Emitters, Sky, SolveOptions, World, WorldOptions, form_factor_polygon, solve,
};
use lumel::{Quality, Settings, Silent};

fn main() {
    divan::main();
}

/// Scenes with their sky radiance and lumels per metre.
const SCENES: [(&str, [f32; 3], f32); 2] = [
    ("cornell_box", [0.0; 3], 8.0),
    ("demo_level", [0.25, 0.35, 0.5], 2.0),
];

fn names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|s| s.0)
}

fn settings_of(name: &str) -> ([f32; 3], f32) {
    let found = SCENES.iter().find(|s| s.0 == name).expect("of the table");
    (found.1, found.2)
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../assets/{name}.glb"))
}

/// Calls `with` with a world that borrows the loaded scene.
fn with_world(name: &str, with: impl FnOnce(&World, &Emitters, &Layout)) {
    let loaded =
        mesh_ingest::load(&file(name), &LoadOptions::default()).expect("an asset of the project");
    let soup = Soup::build(&loaded.scene);
    let (sky, density) = settings_of(name);
    let options = LayoutOptions {
        texels_per_unit: Some(density),
        ..LayoutOptions::default()
    };
    let (layout, _) =
        layout(&loaded.scene, &soup, &options, &|_| true).expect("the assets have an atlas");
    let options = WorldOptions {
        sky: Sky::Constant(Vec3::from_array(sky)),
        ..WorldOptions::default()
    };
    let world = World::build(&loaded.scene, &soup, options).expect("the assets are finite");
    with(&world, &Emitters::collect(&world), &layout);
}

fn solve_options() -> SolveOptions {
    let mut options = SolveOptions {
        rays: 64,
        ..SolveOptions::default()
    };
    options.cut.patches = 3_000;
    options
}

/// Polygons with one to eight corners below the horizon of a thousand receivers.
#[divan::bench(args = [3, 4, 8])]
fn form_factor(bencher: Bencher, corners: usize) {
    const RECEIVERS: usize = 1000;
    let turn = |k: usize, n: usize| std::f64::consts::TAU * k as f64 / n as f64;
    let polygon: Vec<DVec3> = (0..corners)
        .map(|k| DVec3::new(turn(k, corners).cos(), turn(k, corners).sin(), 1.0))
        .collect();
    let receivers: Vec<(DVec3, DVec3)> = (0..RECEIVERS)
        .map(|k| {
            let a = turn(k, RECEIVERS);
            let tilt = 1.4 * (k % 17) as f64 / 16.0;
            let normal = DVec3::new(tilt.sin() * a.cos(), tilt.sin() * a.sin(), tilt.cos());
            (DVec3::new(2.0 * a.cos(), 2.0 * a.sin(), 0.0), normal)
        })
        .collect();
    bencher.counter(ItemsCount::new(RECEIVERS)).bench(|| {
        let all = receivers.iter();
        all.map(|(p, n)| form_factor_polygon(*p, *n, black_box(&polygon)))
            .sum::<f64>()
    });
}

/// Patches, links and relaxation, as `draft` does them.
#[divan::bench(args = names(), sample_count = 3)]
fn solve_draft(bencher: Bencher, name: &str) {
    with_world(name, |world, emitters, _| {
        bencher.bench_local(|| solve(world, emitters, &solve_options(), &Silent));
    });
}

/// Lumels and vertices from a finished solution, as `draft` does them.
#[divan::bench(args = names(), sample_count = 3)]
fn gather_draft(bencher: Bencher, name: &str) {
    with_world(name, |world, emitters, layout| {
        let solution = solve(world, emitters, &solve_options(), &Silent);
        let lumels = GatherOptions {
            rays: 16,
            points: 4,
            edge_points: 16,
            most_rays: 16,
            error: 1.0,
            direct: DirectOptions {
                base: 4,
                penumbra: 16,
                scouts: 2,
            },
            contacts: false,
            follow: 0,
            interpolation: Interpolation::Wide,
            calm: 0.03,
            near: 0.25,
            lit: 0,
            open_only: false,
            tile: gather::TILE,
        };
        let options = BakeOptions {
            lumels,
            vertices: Some(GatherOptions {
                rays: 16,
                edge_points: 0,
                most_rays: 16,
                lit: 0,
                open_only: true,
                ..lumels
            }),
            layers: Vec::new(),
            padding: 2,
            value: ValueKind::Radiance,
            directional: None,
            ao_distance: None,
            hidden: Hidden::Fill,
            stitch: true,
            error: None,
            vertex_error: None,
            ambient_floor: [0.0; 3],
            ao_multiply: 0.0,
        };
        let count = atlas_bake::bake(world, emitters, &solution, layout, &options, &Silent)
            .expect("nobody cancels")
            .report
            .light
            .lumels;
        bencher.counter(ItemsCount::new(count)).bench_local(|| {
            atlas_bake::bake(world, emitters, &solution, layout, &options, &Silent)
        });
    });
}

/// A whole bake without writing.
#[divan::bench(args = names(), sample_count = 3)]
fn whole_bake(bencher: Bencher, name: &str) {
    let (sky, density) = settings_of(name);
    let settings = Settings {
        quality: Quality::Draft,
        texels_per_unit: Some(density),
        sky: lumel::SkySource::Color(sky),
        ..Settings::default()
    };
    bencher.bench_local(|| {
        lumel::bake(&file(name), &settings, &Silent).expect("an asset of the project")
    });
}
