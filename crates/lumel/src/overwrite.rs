//! Protects files that do not belong to the bake from being replaced.

use std::path::{Path, PathBuf};

use mesh_ingest::{Document, ImageSource};

use crate::error::Error;
use crate::record::{self, Provenance, RecordedInput};
use crate::settings::Settings;

/// Identity of a file on disk, independent of path, links and spelling.
#[derive(PartialEq, Eq)]
struct Identity {
    /// Device and inode, the only way to recognise hard links.
    #[cfg(unix)]
    inode: (u64, u64),
    #[cfg(not(unix))]
    path: PathBuf,
}

impl Identity {
    /// `None` if the file does not exist, so that nothing could be replaced.
    fn of(path: &Path) -> Option<Identity> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let m = std::fs::metadata(path).ok()?;
            Some(Identity {
                inode: (m.dev(), m.ino()),
            })
        }
        #[cfg(not(unix))]
        {
            path.canonicalize().ok().map(|path| Identity { path })
        }
    }
}

/// Fails if one of `outputs` is the same file as one of `inputs`, also through links.
///
/// # Errors
/// [`Error::Overwrite`].
pub(crate) fn refuse_inputs(outputs: &[PathBuf], inputs: &[PathBuf]) -> Result<(), Error> {
    let known: Vec<_> = inputs
        .iter()
        .filter_map(|path| Some((path, Identity::of(path)?)))
        .collect();
    for output in outputs {
        let Some(identity) = Identity::of(output) else {
            continue;
        };
        if let Some((input, _)) = known.iter().find(|(_, i)| *i == identity) {
            let same = if *input == output {
                String::new()
            } else {
                format!(", which is the same file as {}", input.display())
            };
            return Err(Error::Overwrite {
                file: output.clone(),
                why: format!("the bake reads it{same}"),
            });
        }
    }
    Ok(())
}

/// Every file on disk that the document or the settings name, whether it has been read yet or not:
/// writers copy images that light does not need.
pub(crate) fn all_inputs(
    document: &Document,
    options: &[RecordedInput],
    settings: &Settings,
    provenance: &Provenance,
) -> Vec<PathBuf> {
    let mut all = document.inputs_on_disk();
    let on_disk = !document.base_dir().as_os_str().is_empty() || !all.is_empty();
    let images = document.json()["images"].as_array().map_or(0, Vec::len);
    for i in (0..images).filter(|_| on_disk) {
        if let Ok(ImageSource::File(file)) = document.image_source(i) {
            all.push(file);
        }
    }
    let locate = |i| record::locate(document.file(), settings, provenance, i);
    all.extend(options.iter().filter_map(locate));
    all
}

/// Files in `dir` that a bake of `scene` may replace or delete: `names`, and further pages of those
/// that exist.
///
/// # Errors
/// [`Error::Overwrite`] if the scene is in `dir` itself, and a .glb there has a result's name but
/// is not in the report of an earlier bake: it may be the user's asset.
pub fn outputs_in(dir: &Path, scene: &Path, names: &[String]) -> Result<Vec<PathBuf>, Error> {
    let mut all: Vec<PathBuf> = names.iter().map(|name| dir.join(name)).collect();
    let folder = match scene.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let beside = Identity::of(dir).is_some_and(|d| Identity::of(folder) == Some(d));
    if beside && let Some(report) = names.last() {
        let made = record::outputs_of(&dir.join(report));
        let foreign = |name: &&String| {
            name.ends_with(".glb") && !made.contains(name) && dir.join(name).exists()
        };
        if let Some(name) = names.iter().find(foreign) {
            return Err(Error::Overwrite {
                file: dir.join(name),
                why: "it is in the scene's folder and was not written by an earlier bake".into(),
            });
        }
    }
    let pages: Vec<_> = names
        .iter()
        .filter_map(|name| name.rsplit_once('.'))
        .filter(|(_, end)| ["exr", "ktx2", "png"].contains(end))
        .collect();
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let further = name.to_str().and_then(|name| {
            let (rest, end) = name.rsplit_once('.')?;
            let (start, number) = rest.rsplit_once('.')?;
            number.parse::<u32>().ok()?;
            pages.contains(&(start, end)).then_some(())
        });
        if further.is_some() {
            all.push(entry.path());
        }
    }
    Ok(all)
}
