//! Outputs that would replace what is not the bake's to replace.

use std::path::{Path, PathBuf};

use mesh_ingest::{Document, ImageSource};

use crate::error::Error;
use crate::record::{self, Provenance, RecordedInput};
use crate::settings::Settings;

/// A file on disk, whatever path, link or spelling leads to it.
#[derive(PartialEq, Eq)]
struct Identity {
    /// Device and number; nothing else tells two names of one file.
    #[cfg(unix)]
    inode: (u64, u64),
    #[cfg(not(unix))]
    path: PathBuf,
}

impl Identity {
    /// `None` where there is no such file: nothing could be replaced then.
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

/// Fails if one of `outputs` is the same file as one of `inputs`, through links too.
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

/// Every file on disk that the document names or that settings do, whether it was read yet or not:
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

/// Files in `dir` that a bake of `scene` may replace or remove: `names`, and further pages of those
/// that are there.
///
/// # Errors
/// [`Error::Overwrite`] where the scene lies in `dir` itself, and a .glb there has the name of a
/// result, but the report of no earlier bake says that it is one: an asset of the user's then.
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
                why: "it lies beside the scene and no earlier bake made it".into(),
            });
        }
    }
    let pages: Vec<_> = names
        .iter()
        .filter_map(|name| name.rsplit_once('.'))
        .filter(|(_, end)| ["exr", "ktx2"].contains(end))
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
