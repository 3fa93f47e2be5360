//! A bake that is read back from its files, lumel by lumel, beside the path tracer.

use glam::DVec3;
use lumel::atlas_bake::{ExrImage, read_exr};
use lumel::{Hidden, Layer, Quality, Settings, Silent, SkySource};
use lumel_tests::path_tracer::{
    Comparison, Effort, Estimate, Footprint, Pair, PathTracer, Scene, footprints, luminance,
};

/// Largest bias of `production`, as the project claims for it.
pub const BIAS: f64 = 0.001;

/// Lumels with less coverage are not chosen: a chart's edge cuts through them, and fewer than eight
/// of the bake's sample points would fall on them.
const LEAST_COVERAGE: f64 = 1.0 / 16.0;

/// Root mean square rounding error of half floats, relative: at most 2⁻¹¹, evenly spread.
const HALF: f64 = 1.0 / 2048.0 / 1.732;

/// Settings that make a bake comparable to the path tracer.
pub fn production(texels_per_unit: f32, sky: SkySource) -> Settings {
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
pub struct Written {
    pages: Vec<ExrImage>,
    /// Of the scene as it was written.
    pub tracer: PathTracer,
    /// Every lumel that [`LEAST_COVERAGE`] leaves.
    pub lumels: Vec<Footprint>,
}

impl Written {
    /// Bakes `glb` as `scene.glb` and reads what that writes.
    pub fn new(glb: &[u8], settings: &Settings) -> Written {
        // A bake does not write over what it reads.
        let [input, dir] = [(); 2].map(|()| tempfile::tempdir().expect("a temporary folder"));
        let level = input.path().join("scene.glb");
        std::fs::write(&level, glb).expect("written");
        let baked = lumel::bake(&level, settings, &Silent).expect("the scene bakes");
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

    /// These lumels, traced.
    pub fn compare(&self, lumels: &[Footprint], effort: Effort) -> Comparison {
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
