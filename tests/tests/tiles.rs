//! Tiles: a level that is gathered in parts has the same light.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;

use glam::Vec3;
use lumel::Silent;
use lumel::atlas::{Layout, LayoutOptions, Lumels, layout};
use lumel::atlas_bake::{self, BakeOptions, Baked, Hidden, ValueKind};
use lumel::gather::{GatherOptions, Interpolation, Pass, Received, Records, Shard, TILE, tiles};
use lumel::mesh_ingest::{LoadOptions, Soup, load};
use lumel::radiosity::{
    DirectOptions, Emitters, Sky, Solution, SolveOptions, World, WorldOptions, solve,
};

/// Few enough texels for several tiles of the demo level, whose floor alone is one.
const SMALL: u64 = 600;

/// With errors to reach, shadow edges to follow, and vertices.
fn options(tile: u64) -> BakeOptions {
    let lumels = GatherOptions {
        rays: 32,
        points: 16,
        edge_points: 64,
        most_rays: 64,
        error: 0.05,
        direct: DirectOptions {
            base: 8,
            penumbra: 32,
            scouts: 2,
        },
        contacts: true,
        follow: 1,
        interpolation: Interpolation::Wide,
        calm: 0.03,
        near: 0.25,
        lit: 1,
        open_only: false,
        tile,
    };
    BakeOptions {
        lumels,
        vertices: Some(GatherOptions {
            edge_points: 0,
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
    }
}

fn with_level(with: impl FnOnce((&World, &Emitters, &Solution), &Layout)) {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/demo_level.glb");
    with_file(file.as_ref(), with);
}

fn with_file(file: &Path, with: impl FnOnce((&World, &Emitters, &Solution), &Layout)) {
    let loaded = load(file, &LoadOptions::default()).expect("a level");
    let soup = Soup::build(&loaded.scene);
    let density = LayoutOptions {
        texels_per_unit: Some(2.0),
        ..LayoutOptions::default()
    };
    let (layout, _) = layout(&loaded.scene, &soup, &density, &|_| true).expect("charts");
    let sky = WorldOptions {
        sky: Sky::Constant(Vec3::new(0.25, 0.35, 0.5)),
        ..WorldOptions::default()
    };
    let world = World::build(&loaded.scene, &soup, sky).expect("a tree");
    let emitters = Emitters::collect(&world);
    let mut options = SolveOptions {
        rays: 64,
        ..SolveOptions::default()
    };
    options.cut.patches = 3_000;
    let solution = solve(&world, &emitters, &options, &Silent);
    with((&world, &emitters, &solution), &layout);
}

fn whole(lit: (&World, &Emitters, &Solution), layout: &Layout, tile: u64) -> Baked {
    atlas_bake::bake(lit.0, lit.1, lit.2, layout, &options(tile), &Silent).expect("nobody cancels")
}

/// Root mean square of the luminance of differences relative to that of the light.
fn difference(a: &Baked, b: &Baked) -> f64 {
    let (mut squares, mut of_light) = (0.0, 0.0);
    for (a, b) in a.pages.iter().zip(&b.pages) {
        assert_eq!(a.coverage, b.coverage);
        for (a, b) in a.value.iter().zip(&b.value) {
            let [a, b] = [a, b].map(|v| f64::from(v[0] + v[1] + v[2]));
            squares += (a - b).powi(2);
            of_light += b.powi(2);
        }
    }
    (squares / of_light).sqrt()
}

#[test]
fn tiles_change_light_by_less_than_its_error() {
    with_level(|lit, layout| {
        let all: Vec<usize> = (0..layout.placements.len()).collect();
        assert!(tiles(layout, &all, SMALL).len() > 3);
        assert_eq!(tiles(layout, &all, TILE).len(), 1);
        let [one, many] = [TILE, SMALL].map(|tile| whole(lit, layout, tile));
        assert_eq!(one.report.light.lumels, many.report.light.lumels);
        assert_eq!(one.report.light.lumel_rays, many.report.light.lumel_rays);
        // Rays are the same. What smoothing judges differs: how noisy rays are, by which a lumel
        // may keep its own value instead of a fit.
        let off = difference(&many, &one);
        let claimed = one.report.light.estimated_error;
        assert!(
            off < 0.5 * claimed,
            "{off:.4} where {claimed:.4} is claimed"
        );
        let ratio = many.report.light.estimated_error / claimed;
        assert!((0.8..1.25).contains(&ratio), "claims {ratio} times as much");
        // Vertices of every instance.
        let (a, b) = (&one.vertices.instances, &many.vertices.instances);
        for (a, b) in a
            .iter()
            .flatten()
            .flatten()
            .zip(b.iter().flatten().flatten())
        {
            assert_eq!(*a == [0.0; 3], *b == [0.0; 3]);
        }
    });
}

/// Records in memory.
#[derive(Default)]
struct Kept(Mutex<BTreeMap<Pass, Vec<(u32, Received)>>>);

impl Records for Kept {
    fn put(&self, pass: Pass, lumels: &[u32], light: &[Received]) {
        let mut all = self.0.lock().expect("no panic");
        let pairs = lumels.iter().copied().zip(light.iter().cloned());
        all.entry(pass).or_default().extend(pairs);
    }

    fn take(&self, pass: Pass, lumels: Range<u32>, to: &mut dyn FnMut(u32, Received)) {
        let all = self.0.lock().expect("no panic");
        for (lumel, light) in all.get(&pass).into_iter().flatten() {
            if lumels.contains(lumel) {
                to(*lumel, light.clone());
            }
        }
    }
}

#[test]
fn shards_of_tiles_give_the_same_bits() {
    with_level(|lit, layout| shards_give_the_same_bits(lit, layout, (Pass::First, 1000)));
}

#[test]
fn shards_of_open_ground_give_the_same_bits() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let file = dir.path().join("ground.glb");
    std::fs::write(&file, crate::calm::ground()).expect("written");
    with_file(&file, |lit, layout| {
        shards_give_the_same_bits(lit, layout, (Pass::Cells, 200));
    });
}

/// Three shards, merged, against one bake. Shards must have recorded that many lumels of
/// this pass.
fn shards_give_the_same_bits(
    lit: (&World, &Emitters, &Solution),
    layout: &Layout,
    (pass, least): (Pass, usize),
) {
    let (world, options) = (lit.0, options(SMALL));
    let counts = Lumels::count(world.scene, world.soup, layout);
    let records = Kept::default();
    for number in [2, 0, 1] {
        let shard = Shard {
            counts: &counts,
            number,
            of: 3,
        };
        atlas_bake::gather_shard(lit, layout, &options, (&shard, &records), &Silent)
            .expect("nobody cancels");
    }
    let merged = atlas_bake::merge(lit, layout, &options, &records, &Silent);
    let merged = merged.expect("nobody cancels");
    let plain = whole(lit, layout, SMALL);
    for (a, b) in merged.pages.iter().zip(&plain.pages) {
        assert!(a.value == b.value, "pages differ");
    }
    assert!(merged.vertices == plain.vertices, "vertices differ");
    let stored = records.0.lock().expect("no panic")[&pass].len();
    assert!(stored > least, "{stored} records only");
}
