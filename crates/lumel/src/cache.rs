//! `--cache`: what one bake leaves for the next, by content.
//!
//! A file of records is named by a hash of all that decides where rays go: the program, surfaces, materials, charts and settings. Lamps are not
//! among it, nor a sky that is the same everywhere: they decide what rays bring, and whose shadow rays are asked for.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

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
    /// Older files that were removed, since the folder was larger than its limit.
    pub removed: u64,
}

/// Ends the names of a cache's files.
const SUFFIX: &str = "lumelrays";

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
    let key = key(surfaces, settings, options, exact);
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
pub(crate) fn close(cache: &Cache, recall: Recall) -> CacheReport {
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
    CacheReport { records, removed }
}

/// Removes files of records, the least recently used first, until all of them are within `limit`. What `now` names counts as used now.
fn trim(folder: &Path, limit: u64, now: &Path) -> std::io::Result<u64> {
    if let Ok(file) = std::fs::File::options().append(true).open(now) {
        // For those of other bakes to see; a file system that cannot is no fault.
        let _ = file.set_modified(SystemTime::now());
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        if path.extension().is_some_and(|e| e == SUFFIX)
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
    } = scene;
    let mut h = Hashed(blake3::Hasher::new());
    h.debug(&(
        "lumel rays",
        PROGRAM,
        origin,
        meshes.len(),
        images.len(),
        exact,
    ));
    meshes.iter().for_each(|m| h.mesh(m));
    for i in instances {
        h.debug(&(i.mesh, i.transform, i.occluder, i.density));
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
    let wanted = (asked(options.lumels), asked(options.vertices));
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
