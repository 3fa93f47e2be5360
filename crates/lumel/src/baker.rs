//! Bakes with chained options, a progress closure and a cancellation token.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use atlas::{UnwrapperChoice, UvMode};
use atlas_bake::{Directional, Hidden, Ktx2Format, Layer, PngFormat, ValueKind};

use crate::beside::{Beside, FirstPicture};
use crate::cache::Cache;
use crate::error::Error;
use crate::estimate::{Estimate, estimate};
use crate::inspect::{Inspection, inspect};
use crate::not_physical::NotPhysical;
use crate::pipeline::{Bake, bake_scene};
use crate::record::{Current, Provenance, find_current};
use crate::scene_input::SceneInput;
use crate::settings::{
    BakeMode, GltfExt, LightGroup, LightScale, ProbeSource, Quality, Settings, SkySource, Sun,
    Units,
};
use crate::watch::{CancelToken, Progress, Watch, Watcher};

/// Most worker threads that can be requested.
const MAX_THREADS: usize = 1024;

/// Bakes scenes: options, a progress watcher and the number of threads.
///
/// One baker can bake any number of scenes. Options have the same names and meanings as on the
/// command line. They are checked when a bake starts.
///
/// ```
/// use lumel::{Baker, Quality};
///
/// let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
/// let bake = Baker::new().quality(Quality::Draft).texels_per_unit(2.0).bake(scene)?;
/// // Every wall emits L = 1 and reflects half, so the radiance is L/(1 − 0.5) = 2.
/// let page = &bake.pages()[0];
/// let covered = page.value.iter().zip(&page.coverage).filter(|(_, c)| **c > 0.0);
/// for (value, _) in covered {
///     assert!((value[0] - 2.0).abs() < 0.02);
/// }
/// # Ok::<(), lumel::Error>(())
/// ```
#[derive(Default)]
pub struct Baker<'a> {
    settings: Settings,
    watcher: Option<Watcher<'a>>,
    token: Option<CancelToken>,
    threads: Option<usize>,
    cache: Option<Cache>,
    first_picture: Option<([u32; 2], Box<Show<'a>>)>,
}

/// Receives the first picture.
type Show<'a> = dyn Fn(Vec<u8>) -> Result<(), Error> + Send + Sync + 'a;

impl fmt::Debug for Baker<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Baker")
            .field("settings", &self.settings)
            .field("threads", &self.threads)
            .finish_non_exhaustive()
    }
}

impl From<Settings> for Baker<'_> {
    fn from(settings: Settings) -> Self {
        Baker {
            settings,
            ..Baker::default()
        }
    }
}

/// Generates setters of single fields of [`Settings`].
macro_rules! options {
    ($($(#[$doc:meta])* $name:ident($($value:ident: $type:ty),+) => |$s:ident| $set:expr;)+) => {
        impl Baker<'_> {
            $(
                $(#[$doc])*
                #[must_use]
                pub fn $name(mut self, $($value: $type),+) -> Self {
                    let $s = &mut self.settings;
                    $set;
                    self
                }
            )+
        }
    };
}

options! {
    /// Trades bake time for accuracy; [`Quality::Preview`] by default.
    quality(quality: Quality) => |s| s.quality = quality;
    /// Bakes this scene of the document instead of its default scene.
    scene(index: usize) => |s| s.scene = Some(index);
    /// Lumels per metre; by default derived from the scene's size.
    texels_per_unit(density: f32) => |s| s.texels_per_unit = Some(density);
    /// Longest side of a page, texels, 8 to 16384; 2048 by default.
    max_page(texels: u32) => |s| s.max_page = texels;
    /// Whether node names that end in `_LOD0`, `_LOD1`, … mark levels of detail; true by default.
    lods(yes: bool) => |s| s.lods = yes;
    /// Texels between charts, at most 64; 2 by default.
    padding(texels: u32) => |s| s.padding = texels;
    /// Aligns pages and instance rectangles to blocks of this many texels, 1 to 64; 4 by default,
    /// as BC formats require.
    block_align(texels: u32) => |s| s.block = texels;
    /// Whether charts are aligned to blocks too.
    block_charts(yes: bool) => |s| s.block_charts = yes;
    /// Gives meshes separate pages by names of nodes and materials: see [`Settings::page_by`].
    page_by(pattern: impl Into<String>) => |s| s.page_by.push(pattern.into());
    /// Whether surfaces that nobody sees from where players walk get no lumels.
    cull_unseen(yes: bool) => |s| s.cull_unseen = yes;
    /// Declares the boxes of nodes as walkable, by name with wildcards.
    walkable(name: impl Into<String>) => |s| s.walkable.push(name.into());
    /// Whether to use the asset's own `TEXCOORD_1` or new charts.
    uv(mode: UvMode) => |s| s.uv = mode;
    /// The unwrapper that makes new charts.
    unwrapper(choice: UnwrapperChoice) => |s| s.unwrapper = choice;
    /// A sky with the same radiance in all directions: linear Rec.709, in the unit of the scene's
    /// lights (nit, or W/(m² sr)).
    sky(radiance: [f32; 3]) => |s| s.sky = SkySource::Color(radiance);
    /// A sky from a latitude-longitude image, Radiance HDR or EXR.
    sky_file(file: impl Into<PathBuf>) => |s| s.sky = SkySource::File(file.into());
    /// Units of the file's lamps.
    units(units: Units) => |s| s.units = units;
    /// Scales the sky, including the scene's own; at least 0.
    sky_intensity(factor: f32) => |s| s.sky_intensity = factor;
    /// Rotates the sky about +Y, degrees, counter-clockwise seen from above.
    sky_rotation(degrees: f32) => |s| s.sky_rotation = degrees;
    /// Adds a sun to the scene's own lights.
    sun(sun: Sun) => |s| s.suns.push(sun);
    /// Scales the light of the sources called `name` (with wildcards `*` and `?`) by `factor` ≥ 0;
    /// the last match wins. [`LightScale::name`] explains the names of sources.
    light(name: impl Into<String>, factor: f32) => |s| s.lights.push(LightScale { name: name.into(), factor });
    /// Leaves out the sources called `name`.
    exclude_light(name: impl Into<String>) => |s| s.lights.push(LightScale { name: name.into(), factor: 0.0 });
    /// Whether the direct light of lamps that the engine adds is left out.
    mode(mode: BakeMode) => |s| s.mode = mode;
    /// Marks lamps as mixed, by name with wildcards.
    mixed(name: impl Into<String>) => |s| s.mixed.push(name.into());
    /// Marks lamps as realtime, by name with wildcards.
    realtime(name: impl Into<String>) => |s| s.realtime.push(name.into());
    /// Quantity stored in the lightmap; [`ValueKind::Radiance`] by default.
    value(kind: ValueKind) => |s| s.value = kind;
    /// Adds channels to the pages.
    layers(layers: impl IntoIterator<Item = Layer>) => |s| s.layers.extend(layers);
    /// Stores the light's directionality, for normal maps.
    directional(kind: Directional) => |s| s.directional = Some(kind);
    /// Distance beyond which surfaces no longer occlude each other in [`Layer::Ao`], metres.
    ao_distance(metres: f32) => |s| s.ao_distance = Some(metres);
    /// Bakes light probes on a grid over the scene with this spacing, metres.
    probe_spacing(metres: f32) => |s| s.probes = Some(ProbeSource::Spacing(metres));
    /// Bakes light probes at the points of a JSON file, `{"points": [[x, y, z], …]}`.
    probe_file(file: impl Into<PathBuf>) => |s| s.probes = Some(ProbeSource::File(file.into()));
    /// Whether a grid of probes is also written as a volume texture.
    probe_volume(yes: bool) => |s| s.probe_volume = yes;
    /// Estimated relative error to reach, instead of the quality's fixed ray count: 0.01 for 1 %.
    error(relative: f32) => |s| s.error = Some(relative);
    /// Clamps reflectances to this, above 0 and at most 1; 0.98 by default.
    max_reflectance(limit: f32) => |s| s.max_reflectance = limit;
    /// Departures from physics.
    not_physical(knobs: NotPhysical) => |s| s.not_physical = knobs;
    /// Value of lumels that are partly inside or behind something.
    hidden(kind: Hidden) => |s| s.hidden = kind;
    /// Whether sheets with different light on their two sides get separate faces for each side;
    /// true by default.
    split_sides(yes: bool) => |s| s.split_sides = yes;
    /// Whether charts end under thin walls with different light on their two sides; true by
    /// default.
    cut_charts(yes: bool) => |s| s.cut_charts = yes;
    /// Whether chart borders are stitched, so that lookups on both sides agree; true by default.
    stitch(yes: bool) => |s| s.stitch = yes;
    /// Also writes every page as KTX2 in this format.
    ktx2(format: Ktx2Format) => |s| s.ktx2 = Some(format);
    /// Also writes every page as PNG with 8 bits per channel.
    png(format: PngFormat) => |s| s.png = Some(format);
    /// Additional conventions for referencing the lightmap in the glTF.
    ext(conventions: impl IntoIterator<Item = GltfExt>) => |s| s.ext.extend(conventions);
    /// Whether the scene with vertex colours is baked too; true by default. If false, no light is
    /// computed for vertices.
    vertex_colors(yes: bool) => |s| s.vertex_colors = yes;
    /// Allows `..` and links in documents to lead out of their folders.
    allow_outside(yes: bool) => |s| s.bounds.allow_outside = yes;
    /// Most bytes of decoded images, for the scene's together and for the sky's; 1 GiB by default.
    max_image(bytes: u64) => |s| s.bounds.max_image = bytes;
    /// Most bytes of memory that a bake may need by its estimate. Beyond that, it ends with
    /// [`Error::Memory`] before light is computed. Three quarters of the machine's by default.
    memory(bytes: u64) => |s| s.bounds.memory = Some(bytes);
    /// See [`Settings::patches`].
    #[doc(hidden)]
    patches(count: u32) => |s| s.patches = Some(count);
    /// Splits edges of the scene with vertex colours until its relative error is about this.
    vertex_error(relative: f32) => |s| s.vertex_error = Some(relative);
}

impl<'a> Baker<'a> {
    /// The defaults of [`Settings`], no watcher, all threads of the current rayon pool.
    pub fn new() -> Baker<'a> {
        Baker::default()
    }

    /// Bakes these sources into separate pages ([`Bake::groups`]); sources in no group go to a last
    /// one, `rest`. Names are as in [`light`](Self::light).
    #[must_use]
    pub fn group<S: Into<String>>(
        mut self,
        name: impl Into<String>,
        sources: impl IntoIterator<Item = S>,
    ) -> Self {
        self.settings.groups.push(LightGroup {
            name: name.into(),
            sources: sources.into_iter().map(Into::into).collect(),
        });
        self
    }

    /// Calls `watcher` with the progress at the start of every phase, and up to some hundred times
    /// a second.
    ///
    /// The calls come from worker threads, one at a time. Work waits while a call runs, so it
    /// should be short. The closure must not bake with this baker.
    #[must_use]
    pub fn on_progress(mut self, watcher: impl FnMut(Progress) + Send + 'a) -> Self {
        self.watcher = Some(Mutex::new(Box::new(watcher)));
        self
    }

    /// Lets `token` cancel bakes.
    #[must_use]
    pub fn cancel_token(mut self, token: &CancelToken) -> Self {
        self.token = Some(token.clone());
        self
    }

    /// Works with this many threads, 1 to 1024, instead of those of the current rayon pool. The
    /// result is the same, byte for byte.
    #[must_use]
    pub fn threads(mut self, threads: usize) -> Self {
        self.threads = Some(threads);
        self
    }

    /// Caches the charts of large meshes in a folder and reuses those of earlier bakes.
    #[must_use]
    pub fn cache(mut self, cache: Cache) -> Self {
        self.cache = Some(cache);
        self
    }

    /// Passes a PNG of the level, `size` pixels wide and high, to `show` as soon as the solve is
    /// done. The picture is coarse, but available long before the bake. The bake waits while `show`
    /// runs; if `show` fails, so does the bake.
    #[must_use]
    pub fn on_first_picture(
        mut self,
        size: [u32; 2],
        show: impl Fn(Vec<u8>) -> Result<(), Error> + Send + Sync + 'a,
    ) -> Self {
        self.first_picture = Some((size, Box::new(show)));
        self
    }

    /// The current settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Bakes a scene given as a path or a [`MemoryDocument`](crate::MemoryDocument). Nothing is
    /// written; the result is in memory.
    ///
    /// # Errors
    /// [`Error`] by fault, with the exit code that the command line would return
    /// ([`Error::exit_code`]):
    ///
    /// ```
    /// use lumel::{Baker, Error};
    ///
    /// let error = Baker::new().bake("no such level.glb").unwrap_err();
    /// assert!(matches!(error, Error::Ingest(_)));
    /// assert_eq!(error.exit_code(), 2);
    /// let error = Baker::new().texels_per_unit(-1.0).bake("level.glb").unwrap_err();
    /// assert_eq!(error.to_string(), "texels per unit is -1, expected a number above 0");
    /// ```
    pub fn bake<'s>(&self, scene: impl Into<SceneInput<'s>>) -> Result<Bake, Error> {
        let scene = scene.into();
        let provenance = Provenance::default();
        let beside = Beside {
            cache: self.cache.as_ref(),
            first_picture: self
                .first_picture
                .as_ref()
                .map(|(size, show)| FirstPicture {
                    size: *size,
                    show: &**show,
                }),
            in_turn: false,
            outputs: &[],
            tell: None,
        };
        self.work(|watch| bake_scene(scene, &self.settings, &provenance, &beside, watch))
    }

    /// Plans charts and pages and estimates the cost of a bake, without baking.
    ///
    /// ```
    /// use lumel::{Baker, Quality};
    ///
    /// let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
    /// let plan = Baker::new().quality(Quality::Draft).texels_per_unit(2.0).estimate(scene)?;
    /// assert_eq!(plan.layout.pages.len(), 1);
    /// println!("about {:.1} s and {:.0} MB", plan.seconds, plan.bytes / 1e6);
    /// # Ok::<(), lumel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`bake`](Self::bake).
    pub fn estimate(&self, file: impl AsRef<Path>) -> Result<Estimate, Error> {
        let file = file.as_ref();
        self.work(|watch| estimate(file, &self.settings, watch))
    }

    /// Lists what would be baked and every problem found, without baking.
    ///
    /// ```
    /// use lumel::Baker;
    ///
    /// let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb");
    /// let inspection = Baker::new().inspect(scene)?;
    /// for source in &inspection.sources {
    ///     println!("light source {:?}", source.name);
    /// }
    /// assert!(inspection.warnings.is_empty());
    /// # Ok::<(), lumel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`bake`](Self::bake).
    pub fn inspect(&self, file: impl AsRef<Path>) -> Result<Inspection, Error> {
        let file = file.as_ref();
        self.work(|watch| inspect(file, &self.settings, watch))
    }

    /// Whether `dir` already contains what baking `file` would write there. Compares contents of
    /// inputs, settings and program; only reads.
    ///
    /// ```no_run
    /// let baker = lumel::Baker::new();
    /// match baker.find_current("level.glb", "out") {
    ///     Ok(current) => println!("nothing to do: {} files", current.outputs.len()),
    ///     Err(why) => {
    ///         println!("baking, because {why}");
    ///         baker.bake("level.glb")?.write("out")?;
    ///     }
    /// }
    /// # Ok::<(), lumel::Error>(())
    /// ```
    ///
    /// # Errors
    /// The reason to bake again, as a short text for people.
    pub fn find_current(
        &self,
        file: impl AsRef<Path>,
        dir: impl AsRef<Path>,
    ) -> Result<Current, String> {
        let provenance = Provenance::default();
        let (file, dir) = (file.as_ref(), dir.as_ref());
        find_current(file, &self.settings, &provenance, dir, None)
    }

    fn work<T: Send>(
        &self,
        work: impl FnOnce(&Watch<'_, 'a>) -> Result<T, Error> + Send,
    ) -> Result<T, Error> {
        let watch = Watch {
            watcher: self.watcher.as_ref(),
            token: self.token.as_ref(),
        };
        let Some(threads) = self.threads else {
            return work(&watch);
        };
        if !(1..=MAX_THREADS).contains(&threads) {
            return Err(Error::Setting(format!(
                "found {threads} threads, expected 1 to {MAX_THREADS}"
            )));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Error::Internal(format!("cannot start threads: {e}")))?;
        pool.install(|| work(&watch))
    }
}
