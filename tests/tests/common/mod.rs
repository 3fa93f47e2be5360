//! Bakes a scene held in memory and reads its lumels.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec3, Vec3};
use lumel::atlas::Lumels;
use lumel::atlas_bake::read_exr;
use lumel::gather::{Footprint, LumelFootprint};
use lumel::mesh_ingest::Soup;
use lumel::radiosity::{World, WorldOptions};
use lumel::{Bake, Settings, Silent};

/// Bakes `glb` as `scene.glb`.
pub fn bake(glb: &[u8], settings: &Settings) -> Bake {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("scene.glb");
    std::fs::write(&path, glb).expect("written");
    lumel::bake(&path, settings, &Silent).expect("the scene bakes")
}

/// Settings with a density.
pub fn at(texels_per_unit: f32) -> Settings {
    Settings {
        texels_per_unit: Some(texels_per_unit),
        ..Settings::default()
    }
}

/// `settings` with reflectances of up to 0.999, more than real surfaces have and the default
/// allows.
pub fn bright(settings: Settings) -> Settings {
    Settings {
        max_reflectance: 0.999,
        ..settings
    }
}

/// One lumel: points spread over its footprint (world space, metres), normal, irradiance.
pub struct Seen {
    pub points: Vec<DVec3>,
    pub normal: DVec3,
    pub irradiance: [f64; 3],
    pub coverage: f32,
    /// The page's other channels at this texel, as stored.
    pub layers: BTreeMap<String, f64>,
}

impl Seen {
    /// Mean of `f` over the footprint: the value that the lumel should have.
    pub fn mean(&self, f: impl Fn(DVec3) -> f64) -> f64 {
        self.points.iter().map(|p| f(*p)).sum::<f64>() / self.points.len() as f64
    }

    /// Whether `f` is true all over the footprint.
    pub fn all(&self, f: impl Fn(DVec3) -> bool) -> bool {
        self.points.iter().all(|p| f(*p))
    }

    pub fn red(&self) -> f64 {
        self.irradiance[0]
    }

    /// The value of another channel, in the file's unit.
    #[track_caller]
    pub fn layer(&self, name: &str) -> f64 {
        match self.layers.get(name) {
            Some(v) => *v,
            None => panic!("no channel {name}, there are {:?}", self.layers.keys()),
        }
    }

    /// Middle of the footprint.
    pub fn middle(&self) -> DVec3 {
        self.points.iter().sum::<DVec3>() / self.points.len() as f64
    }
}

/// The lumels of the instances whose node has this name, read from the written EXR.
pub fn lumels_of(bake: &Bake, node: &str) -> Vec<Seen> {
    let dir = tempfile::tempdir().expect("a temporary folder");
    bake.write(dir.path()).expect("written");
    lumels_in(bake, dir.path(), node)
}

/// The same from files that are already written.
pub fn lumels_in(bake: &Bake, dir: &Path, node: &str) -> Vec<Seen> {
    lumels_in_files(bake, dir, &bake.page_names(), node)
}

/// The same from other files with the same layout, such as those of a light group.
pub fn lumels_in_files(bake: &Bake, dir: &Path, files: &[String], node: &str) -> Vec<Seen> {
    let pages: Vec<_> = files
        .iter()
        .map(|name| read_exr(&dir.join(name)).expect("an EXR"))
        .collect();
    let scene = &bake.loaded.scene;
    let soup = Soup::build(scene);
    let world = World::build(scene, &soup, WorldOptions::default()).expect("a tree");
    let lumels = Lumels::find(scene, &soup, &bake.layout);
    let mut out = Vec::new();
    for (i, l) in lumels.lumels.iter().enumerate() {
        if scene.instances[l.instance as usize].name != node {
            continue;
        }
        let footprint = LumelFootprint::new(&world, &lumels, *l, i as u32);
        let mut points: Vec<_> = (0..256).filter_map(|k| footprint.candidate(k)).collect();
        points.truncate(64);
        if points.is_empty() {
            points.push(footprint.fallback());
        }
        let page = &pages[l.page as usize];
        let texel = (l.texel[1] * page.width + l.texel[0]) as usize;
        let channel = |name: &str| {
            let values = page.channel(name).expect("a colour channel");
            f64::from(values[texel]) * std::f64::consts::PI
        };
        let normal: Vec3 = points[0].normal;
        out.push(Seen {
            points: points
                .iter()
                .map(|p| p.position.as_dvec3() + scene.origin)
                .collect(),
            normal: normal.as_dvec3(),
            irradiance: ["R", "G", "B"].map(channel),
            coverage: l.coverage,
            layers: (page.channels.iter())
                .filter(|(name, _)| !["R", "G", "B"].contains(&name.as_str()))
                .map(|(name, values)| (name.clone(), f64::from(values[texel])))
                .collect(),
        });
    }
    assert!(!out.is_empty(), "no lumel of node {node:?}");
    out
}

/// Largest relative deviation of the lumels from `exact`, over lumels for which it is at least
/// `floor`.
pub fn worst(lumels: &[Seen], floor: f64, exact: impl Fn(&Seen) -> f64) -> f64 {
    let mut worst: f64 = 0.0;
    let mut n = 0;
    for l in lumels {
        let e = exact(l);
        if e >= floor {
            n += 1;
            assert!(l.red().is_finite());
            worst = worst.max((l.red() / e - 1.0).abs());
        }
    }
    assert!(n > 0, "nothing to compare");
    worst
}

/// Mean irradiance (red) over the surface that the lumels cover.
pub fn mean(lumels: &[Seen]) -> f64 {
    let (mut sum, mut area) = (0.0, 0.0);
    for l in lumels {
        let a = f64::from(l.coverage);
        assert!(l.irradiance.iter().all(|e| e.is_finite()));
        sum += l.red() * a;
        area += a;
    }
    sum / area
}
