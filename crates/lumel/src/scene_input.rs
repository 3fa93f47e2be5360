//! Input of a bake: a file, or a document in memory.

use std::path::{Path, PathBuf};

use mesh_ingest::{LoadOptions, Loaded, MemoryDocument};

use crate::error::Error;
use crate::open::Changes;
use crate::settings::Settings;

/// A glTF scene to bake: a file's path, or a document in memory. Functions with this argument
/// accept a `&str`, a `&Path` or a `&MemoryDocument`.
///
/// ```
/// use lumel::SceneInput;
///
/// let input = SceneInput::from("level.glb");
/// assert!(input.path().ends_with("level.glb"));
/// ```
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum SceneInput<'a> {
    /// A .gltf or .glb.
    File(&'a Path),
    /// A document in memory.
    Memory(&'a MemoryDocument),
}

impl<'a> SceneInput<'a> {
    /// The file, or the name that stands for one.
    pub fn path(self) -> &'a Path {
        match self {
            SceneInput::File(path) => path,
            SceneInput::Memory(document) => document.name(),
        }
    }

    /// Reads the scene that the settings choose, with these changes.
    pub(crate) fn load(self, settings: &Settings, changes: &Changes) -> Result<Loaded, Error> {
        let options = LoadOptions {
            split_sides: changes.split.clone(),
            cuts: changes.cuts.clone(),
            scene: settings.scene,
            ignore_lod_names: !settings.lods,
            allow_outside: settings.bounds.allow_outside,
            limits: settings.bounds.limits(),
        };
        let loaded = match self {
            SceneInput::File(path) => mesh_ingest::load(path, &options),
            SceneInput::Memory(document) => mesh_ingest::load_memory(document, &options),
        };
        loaded.map_err(|source| match settings.bounds.allowed() {
            Some(allowed) if matches!(source, mesh_ingest::Error::Limit { .. }) => {
                Error::TooLarge { source, allowed }
            }
            _ => source.into(),
        })
    }
}

impl<'a> From<&'a MemoryDocument> for SceneInput<'a> {
    fn from(document: &'a MemoryDocument) -> Self {
        SceneInput::Memory(document)
    }
}

impl<'a> From<&'a Path> for SceneInput<'a> {
    fn from(path: &'a Path) -> Self {
        SceneInput::File(path)
    }
}

impl<'a> From<&'a PathBuf> for SceneInput<'a> {
    fn from(path: &'a PathBuf) -> Self {
        SceneInput::File(path)
    }
}

impl<'a> From<&'a str> for SceneInput<'a> {
    fn from(path: &'a str) -> Self {
        SceneInput::File(Path::new(path))
    }
}

impl<'a> From<&'a String> for SceneInput<'a> {
    fn from(path: &'a String) -> Self {
        SceneInput::File(Path::new(path))
    }
}
