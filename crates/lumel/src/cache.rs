//! `--cache`: what one bake leaves for the next, by content.
//!
//! A file of records is named by a hash of all that decides where rays go: the program, surfaces, materials, charts and settings. Lamps are not
//! among it, nor a sky that is the same everywhere: they decide what rays bring, and whose shadow rays are asked for.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

use atlas_bake::unwrap::KeptCharts;
use atlas_bake::{BakeOptions, GatherOptions, Layer, Layout, Recall, RecallReport};
use mesh_ingest::{Image, Light, Material, Mesh, Primitive, Scene};
use radiosity::{LightGroups, Sky};
use serde::Serialize;

use crate::record::PROGRAM;
use crate::settings::Settings;

/// A folder where bakes keep what the next ones can use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    /// The folder; it is made when it is needed.
    pub folder: PathBuf,
    /// When all of it is larger than so many bytes, what was used least recently goes.
    pub limit: u64,
}

impl Cache {
    /// [`Cache::limit`] unless another is asked for: 8 GiB.
    pub const LIMIT: u64 = 8 << 30;
}

/// What a cache did for a bake.
#[derive(Debug, Clone, Serialize)]
pub struct CacheReport {
    /// Records of rays.
    #[serde(flatten)]
    pub records: RecallReport,
    /// Meshes whose charts were found, and those whose charts were kept for the next bake.
    pub charts: [u64; 2],
    /// Older files that were removed, since the folder was larger than its limit.
    pub removed: u64,
}

/// Ends the names of a cache's files of records.
const SUFFIX: &str = "lumelrays";

/// And of those of charts.
const CHARTS: &str = "lumelcharts";

/// Charts of meshes, a file each.
pub(crate) struct Charts<'a> {
    cache: &'a Cache,
    found: AtomicU64,
    kept: AtomicU64,
}

impl<'a> Charts<'a> {
    pub(crate) fn new(cache: &'a Cache) -> Self {
        Charts {
            cache,
            found: AtomicU64::new(0),
            kept: AtomicU64::new(0),
        }
    }

    /// Another program may flatten otherwise.
    fn path(&self, key: &[u8; 32]) -> PathBuf {
        let mut h = blake3::Hasher::new();
        h.update(PROGRAM.as_bytes());
        h.update(key);
        let hex = h.finalize().to_hex();
        self.cache.folder.join(format!("{}.{CHARTS}", &hex[..32]))
    }

    /// Written beside its place and renamed, so that nobody sees half of it.
    fn write(&self, path: &Path, bytes: &[u8]) -> std::io::Result<()> {
        std::fs::create_dir_all(&self.cache.folder)?;
        let mut file = tempfile::Builder::new()
            .prefix(".lumel-")
            .suffix(".part")
            .tempfile_in(&self.cache.folder)?;
        file.write_all(bytes)?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    }
}

impl KeptCharts for Charts<'_> {
    fn load(&self, key: &[u8; 32]) -> Option<Vec<u8>> {
        let path = self.path(key);
        let bytes = std::fs::read(&path).ok()?;
        touch(&path);
        Some(bytes)
    }

    fn used(&self) {
        self.found.fetch_add(1, Ordering::Relaxed);
    }

    fn save(&self, key: &[u8; 32], bytes: &[u8]) {
        // A folder that cannot be written is told by the records.
        if self.write(&self.path(key), bytes).is_ok() {
            self.kept.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// Marks a file as used now, for those that trim the folder; a file system that cannot is no fault.
fn touch(path: &Path) {
    if let Ok(file) = std::fs::File::options().append(true).open(path) {
        let _ = file.set_modified(SystemTime::now());
    }
}

/// What rays hang on beside the settings.
pub(crate) struct Surfaces<'a> {
    pub scene: &'a Scene,
    pub layout: &'a Layout,
    pub sky: &'a Sky,
    pub groups: Option<&'a LightGroups>,
}

/// Opens the records of a bake.
pub(crate) fn open(
    cache: &Cache,
    surfaces: &Surfaces,
    settings: &Settings,
    options: &BakeOptions,
) -> Recall {
    let exact = options.layers.contains(&Layer::Ao);
    let key_with = |vertices| key(surfaces, settings, options, vertices, exact);
    let mut key = key_with(options.vertices);
    if options.vertices.is_none() {
        // Records that hold more than this bake asks for serve it as well.
        let more = key_with(Some(settings.vertex_options()));
        if path(cache, &more).exists() {
            key = more;
        }
    }
    let lamps: Vec<_> = (surfaces.scene.lights.iter())
        .map(|light| lamp(surfaces.scene, light))
        .collect();
    Recall::open(&path(cache, &key), key.as_bytes(), &lamps, exact)
}

fn path(cache: &Cache, key: &blake3::Hash) -> PathBuf {
    let hex = key.to_hex();
    cache.folder.join(format!("{}.{SUFFIX}", &hex[..32]))
}

/// Ends a bake's records, and keeps the folder within its limit.
pub(crate) fn close(cache: &Cache, recall: Recall, charts: Option<&Charts>) -> CacheReport {
    let path = recall.path().to_owned();
    let mut records = recall.finish();
    let removed = match trim(&cache.folder, cache.limit, &path) {
        Ok(removed) => removed,
        // There is no folder where nothing could be kept, which the records say.
        Err(_) if records.bytes == 0 => 0,
        Err(e) => {
            let text = format!("{}: old records stay: {e}", cache.folder.display());
            records.notes.push(text);
            0
        }
    };
    let count = |of: fn(&'_ Charts) -> u64| charts.map_or(0, of);
    CacheReport {
        records,
        charts: [
            count(|c| c.found.load(Ordering::Relaxed)),
            count(|c| c.kept.load(Ordering::Relaxed)),
        ],
        removed,
    }
}

/// Removes files of records, the least recently used first, until all of them are within `limit`. What `now` names counts as used now.
fn trim(folder: &Path, limit: u64, now: &Path) -> std::io::Result<u64> {
    touch(now);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        if path.extension().is_some_and(|e| e == SUFFIX || e == CHARTS)
            && let Ok(m) = entry.metadata()
        {
            let used = m.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            files.push((path != now, used, path, m.len()));
        }
    }
    // The one in use last.
    files.sort_by(|a, b| (!a.0, a.1, &a.2).cmp(&(!b.0, b.1, &b.2)));
    let mut all: u64 = files.iter().map(|f| f.3).sum();
    let mut removed = 0;
    for (.., path, size) in files {
        if all <= limit {
            break;
        }
        std::fs::remove_file(&path)?;
        all -= size;
        removed += 1;
    }
    Ok(removed)
}

/// Hashes what has a `Debug` form; every number of it is written in as many digits as tell it from others.
struct Hashed(blake3::Hasher);

impl std::fmt::Write for Hashed {
    fn write_str(&mut self, s: &str) -> std::fmt::Result {
        self.0.update(s.as_bytes());
        Ok(())
    }
}

impl Hashed {
    fn debug(&mut self, what: &impl std::fmt::Debug) {
        // Writing into a hash does not fail.
        let _ = write!(self, "{what:?};");
    }

    fn floats(&mut self, n: usize, numbers: impl Iterator<Item = f32>) {
        self.0.update(&(n as u64).to_le_bytes());
        let mut buffer = Vec::with_capacity(1 << 16);
        for x in numbers {
            buffer.extend_from_slice(&x.to_bits().to_le_bytes());
            if buffer.len() >= 1 << 16 {
                self.0.update(&buffer);
                buffer.clear();
            }
        }
        self.0.update(&buffer);
    }

    fn mesh(&mut self, mesh: &Mesh) {
        let Mesh {
            gltf_mesh: _,
            name: _,
            primitives,
        } = mesh;
        self.debug(&primitives.len());
        for p in primitives {
            let Primitive {
                gltf_primitive: _,
                positions,
                normals,
                tex_coords,
                colors,
                triangles,
                source_triangles: _,
                material,
            } = p;
            self.debug(&(material, tex_coords.len()));
            self.floats(positions.len(), positions.iter().flat_map(|v| v.to_array()));
            self.floats(normals.len(), normals.iter().flat_map(|v| v.to_array()));
            for set in tex_coords {
                self.floats(set.len(), set.iter().flat_map(|v| v.to_array()));
            }
            self.floats(colors.len(), colors.iter().flat_map(|v| v.to_array()));
            let corners = triangles.iter().flatten().map(|i| f32::from_bits(*i));
            self.floats(triangles.len(), corners);
        }
    }

    fn image(&mut self, image: Option<&Image>) {
        let size = image.map(|i| (i.width, i.height));
        self.debug(&size);
        if let Some(image) = image {
            self.0.update(image.pixels.as_flattened());
        }
    }
}

/// Hash of all that decides where rays go and which of them have records.
fn key(
    surfaces: &Surfaces,
    settings: &Settings,
    options: &BakeOptions,
    vertices: Option<GatherOptions>,
    exact: bool,
) -> blake3::Hash {
    let Surfaces {
        scene,
        layout,
        sky,
        groups,
    } = surfaces;
    // Lamps have hashes of their own; a measured lamp's diagram is in its hash, and the environment in the sky.
    let Scene {
        meshes,
        instances,
        materials,
        images,
        lights: _,
        profiles: _,
        environment: _,
        origin,
        firsts,
    } = scene;
    let mut h = Hashed(blake3::Hasher::new());
    h.debug(&(
        "lumel rays",
        PROGRAM,
        origin,
        meshes.len(),
        images.len(),
        exact,
        firsts,
    ));
    meshes.iter().for_each(|m| h.mesh(m));
    for i in instances {
        h.debug(&(i.mesh, i.transform, i.occluder, i.density, i.stands_in));
    }
    for m in materials {
        // Names and places in the document do not matter, nor does a node more or less.
        h.debug(&Material {
            name: String::new(),
            gltf_material: None,
            ..m.clone()
        });
    }
    images.iter().for_each(|i| h.image(i.as_ref()));
    h.debug(&(&layout.pages, &layout.placements, layout.meshes.len()));
    for mesh in &layout.meshes {
        h.debug(&(mesh.size, mesh.primitives.len()));
        for p in &mesh.primitives {
            h.floats(p.uv.len(), p.uv.iter().flat_map(|v| v.to_array()));
            let corners = p.triangles.iter().flatten().map(|i| f32::from_bits(*i));
            h.floats(p.triangles.len(), corners);
        }
    }
    // The same sky from everywhere is no light that has shadow rays.
    match sky {
        Sky::Black | Sky::Constant(_) => h.debug(&"even"),
        Sky::Map {
            width,
            height,
            pixels,
        } => {
            h.debug(&(width, height));
            h.floats(pixels.len(), pixels.iter().flat_map(|p| p.to_array()));
        }
    }
    h.debug(&groups.map(|g| (g.count, &g.materials, g.sky)));
    let mut solve = settings.solve_options();
    solve.relax = Default::default();
    h.debug(&solve);
    // How many rays there are at most decides how many are asked for, not which.
    let asked = |o: GatherOptions| GatherOptions {
        error: 0.0,
        most_rays: 0,
        ..o
    };
    let wanted = (asked(options.lumels), vertices.map(asked));
    h.debug(&(wanted, options.hidden));
    h.0.finalize()
}

/// Hashes of a lamp: of where it is and how it shines, and of that with its intensity.
fn lamp(scene: &Scene, light: &Light) -> [[u8; 32]; 2] {
    let profile = (light.profile.as_ref()).map(|p| (&scene.profiles[p.profile], p.from_world));
    let mut shape = Hashed(blake3::Hasher::new());
    shape.debug(&(&light.kind, profile));
    let mut all = Hashed(shape.0.clone());
    all.debug(&light.intensity);
    [*shape.0.finalize().as_bytes(), *all.0.finalize().as_bytes()]
}
