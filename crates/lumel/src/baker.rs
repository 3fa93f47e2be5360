//! Bakes with options chained, progress by closure, and a token to stop them.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use atlas::{UnwrapperChoice, UvMode};
use atlas_bake::{Directional, Hidden, Ktx2Format, Layer, ValueKind};

use crate::cache::Cache;
use crate::error::Error;
use crate::estimate::{Estimate, estimate};
use crate::inspect::{Inspection, inspect};
use crate::pipeline::{Bake, Beside, FirstPicture, bake_scene};
use crate::record::{Current, Provenance, find_current};
use crate::scene_input::SceneInput;
use crate::settings::{
    GltfExt, LightGroup, LightScale, ProbeSource, Quality, Settings, SkySource, Sun, Units,
};
use crate::watch::{CancelToken, Progress, Watch, Watcher};

/// Most worker threads that can be asked for.
const MAX_THREADS: usize = 1024;

/// Bakes scenes: options, who watches, and how many threads may work.
///
/// One baker bakes any number of scenes. Options have the names that the command line gives them
/// and mean the same; they are checked when a bake starts.
///
/// ```
/// use lumel::{Baker, Quality};
///
/// let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
/// let bake = Baker::new().quality(Quality::Draft).texels_per_unit(2.0).bake(scene)?;
/// // Every wall emits L = 1 and reflects half: the light there is L/(1 − 0.5) = 2.
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

/// Who gets the first picture.
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

/// Setters of one field of [`Settings`].
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
    /// How much work a bake is worth; [`Quality::Preview`] if nothing is said.
    quality(quality: Quality) => |s| s.quality = quality;
    /// Which scene of a document is baked, instead of its default one.
    scene(index: usize) => |s| s.scene = Some(index);
    /// Lumels per metre, instead of what the scene's size suggests.
    texels_per_unit(density: f32) => |s| s.texels_per_unit = Some(density);
    /// Longest side of a page, texels, 8 to 16384; 2048 if nothing is said.
    max_page(texels: u32) => |s| s.max_page = texels;
    /// Whether names of nodes that end in `_LOD0`, `_LOD1`, … tell levels of detail; they do if
    /// nothing is said.
    lods(yes: bool) => |s| s.lods = yes;
    /// Texels between charts, at most 64; 2 if nothing is said.
    padding(texels: u32) => |s| s.padding = texels;
    /// Pages and instances' rectangles keep to blocks of so many texels, 1 to 64; 4 if nothing is
    /// said, as BC formats want it.
    block_align(texels: u32) => |s| s.block = texels;
    /// Whether charts keep to blocks too.
    block_charts(yes: bool) => |s| s.block_charts = yes;
    /// The asset's own `TEXCOORD_1`, or new charts.
    uv(mode: UvMode) => |s| s.uv = mode;
    /// What makes new charts.
    unwrapper(choice: UnwrapperChoice) => |s| s.unwrapper = choice;
    /// A sky that sends the same radiance from everywhere: linear Rec.709, in the unit of the
    /// scene's lights (nit, or W/(m² sr)).
    sky(radiance: [f32; 3]) => |s| s.sky = SkySource::Color(radiance);
    /// A sky from a latitude-longitude picture, Radiance HDR or EXR.
    sky_file(file: impl Into<PathBuf>) => |s| s.sky = SkySource::File(file.into());
    /// Units of the file's lamps.
    units(units: Units) => |s| s.units = units;
    /// Multiplies the sky, the scene's own too; at least 0.
    sky_intensity(factor: f32) => |s| s.sky_intensity = factor;
    /// Turns the sky about +Y, degrees, counter-clockwise seen from above.
    sky_rotation(degrees: f32) => |s| s.sky_rotation = degrees;
    /// Adds a sun beside the scene's own lights.
    sun(sun: Sun) => |s| s.suns.push(sun);
    /// Multiplies what the sources called `name` (`*` and `?` are wild) give by `factor` ≥ 0; of
    /// several that name one source the last counts. See [`LightScale::name`] for what sources are
    /// called.
    light(name: impl Into<String>, factor: f32) => |s| s.lights.push(LightScale { name: name.into(), factor });
    /// Leaves the sources called `name` out.
    exclude_light(name: impl Into<String>) => |s| s.lights.push(LightScale { name: name.into(), factor: 0.0 });
    /// What the lightmap holds; [`ValueKind::Radiance`] if nothing is said.
    value(kind: ValueKind) => |s| s.value = kind;
    /// Adds channels to pages.
    layers(layers: impl IntoIterator<Item = Layer>) => |s| s.layers.extend(layers);
    /// Keeps what normal maps need of the directions that light comes from.
    directional(kind: Directional) => |s| s.directional = Some(kind);
    /// Distance beyond which surfaces do not occlude each other in [`Layer::Ao`], metres.
    ao_distance(metres: f32) => |s| s.ao_distance = Some(metres);
    /// Light probes on a grid over the scene, so many metres apart.
    probe_spacing(metres: f32) => |s| s.probes = Some(ProbeSource::Spacing(metres));
    /// Light probes at the points of a JSON file, `{"points": [[x, y, z], …]}`.
    probe_file(file: impl Into<PathBuf>) => |s| s.probes = Some(ProbeSource::File(file.into()));
    /// Estimated relative error to reach, instead of the quality's: 0.01 for 1 %.
    error(relative: f32) => |s| s.error = Some(relative);
    /// Reflectances above this count as this, above 0 and at most 1; 0.98 if nothing is said.
    max_reflectance(limit: f32) => |s| s.max_reflectance = limit;
    /// What lumels hold of which a part lies inside or behind something.
    hidden(kind: Hidden) => |s| s.hidden = kind;
    /// Whether lookups on both sides of charts' borders are made to agree; they are if nothing is
    /// said.
    stitch(yes: bool) => |s| s.stitch = yes;
    /// Also writes every page as KTX2, in this format.
    ktx2(format: Ktx2Format) => |s| s.ktx2 = Some(format);
    /// Further conventions for the lightmap's place in the glTF.
    ext(conventions: impl IntoIterator<Item = GltfExt>) => |s| s.ext.extend(conventions);
    /// Whether the scene with vertex colours is baked too; it is if nothing is said. Without it no
    /// light is computed for vertices.
    vertex_colors(yes: bool) => |s| s.vertex_colors = yes;
    /// Lets `..` and links in documents lead out of their folders.
    allow_outside(yes: bool) => |s| s.bounds.allow_outside = yes;
    /// Bytes that decoded pictures may take: the scene's together, and the sky's; 1 GiB if nothing
    /// is said.
    max_image(bytes: u64) => |s| s.bounds.max_image = bytes;
    /// Bytes that a bake may need by its estimate; it ends with [`Error::Memory`] before light is
    /// computed where that is more.
    memory(bytes: u64) => |s| s.bounds.memory = Some(bytes);
    /// Splits edges of the scene with vertex colours until its relative error is about this.
    vertex_error(relative: f32) => |s| s.vertex_error = Some(relative);
}

impl<'a> Baker<'a> {
    /// The defaults of [`Settings`], nobody watching, all threads of the current rayon pool.
    pub fn new() -> Baker<'a> {
        Baker::default()
    }

    /// Keeps the sources called so apart from the others, in pages of their own ([`Bake::groups`]);
    /// what no group names is in a last one, `rest`. Names are as in [`light`](Self::light).
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

    /// Calls `watcher` with where the bake is: at the start of every phase, and up to some hundred
    /// times a second.
    ///
    /// The calls come from worker threads, one at a time; work waits while one runs, so it should
    /// be short. It must not bake with this baker itself.
    #[must_use]
    pub fn on_progress(mut self, watcher: impl FnMut(Progress) + Send + 'a) -> Self {
        self.watcher = Some(Mutex::new(Box::new(watcher)));
        self
    }

    /// Stops when `token` says so.
    #[must_use]
    pub fn cancel_token(mut self, token: &CancelToken) -> Self {
        self.token = Some(token.clone());
        self
    }

    /// Works with so many threads, 1 to 1024, instead of those of the current rayon pool. The
    /// result is the same, byte for byte.
    #[must_use]
    pub fn threads(mut self, threads: usize) -> Self {
        self.threads = Some(threads);
        self
    }

    /// Keeps charts of large meshes there, and takes those of an earlier bake.
    #[must_use]
    pub fn cache(mut self, cache: Cache) -> Self {
        self.cache = Some(cache);
        self
    }

    /// Gives `show` a picture of the level as PNG, `size` pixels wide and high, as soon as its
    /// light is solved: coarse, and there long before the bake. The bake waits while `show` runs,
    /// and ends with its error.
    #[must_use]
    pub fn on_first_picture(
        mut self,
        size: [u32; 2],
        show: impl Fn(Vec<u8>) -> Result<(), Error> + Send + Sync + 'a,
    ) -> Self {
        self.first_picture = Some((size, Box::new(show)));
        self
    }

    /// All options as they are now.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Bakes a scene: a path, or a [`MemoryDocument`](crate::MemoryDocument). Nothing is written;
    /// the result is in memory.
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

    /// Charts, pages and cost of a bake without baking.
    ///
    /// # Errors
    /// As [`bake`](Self::bake).
    pub fn estimate(&self, file: impl AsRef<Path>) -> Result<Estimate, Error> {
        let file = file.as_ref();
        self.work(|watch| estimate(file, &self.settings, watch))
    }

    /// What would be baked and every problem found, without baking.
    ///
    /// # Errors
    /// As [`bake`](Self::bake).
    pub fn inspect(&self, file: impl AsRef<Path>) -> Result<Inspection, Error> {
        let file = file.as_ref();
        self.work(|watch| inspect(file, &self.settings, watch))
    }

    /// Whether `dir` holds what baking `file` would write there, by content of inputs, settings and
    /// program; only reads.
    ///
    /// # Errors
    /// Why not, in a few words for people.
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
                "{threads} threads were asked for, expected 1 to {MAX_THREADS}"
            )));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Error::Internal(format!("no threads can be started: {e}")))?;
        pool.install(|| work(&watch))
    }
}
