//! Folders written by `lumel bake`, as `lumel view` and `lumel report` read them.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mesh_ingest::read_regular;
use serde::Deserialize;
use serde_json::Value;

use crate::error::Error;
use crate::record;

/// Ending of a manifest's file name.
const MANIFEST: &str = ".lightmap.json";

/// Longest manifest or report that is read, bytes: twice that of a million instances.
pub(crate) const MAX_JSON: u64 = 512 << 20;

/// The newest manifest version that this program supports ([`atlas_bake::Manifest::version`]).
const MANIFEST_VERSION: u64 = 1;

/// A folder with one or more finished bakes.
///
/// ```no_run
/// let folder = lumel::BakeFolder::open("out".as_ref())?;
/// for stem in folder.bakes() {
///     std::fs::write(format!("{stem}.html"), lumel::report_page(&folder, &stem)?)?;
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct BakeFolder {
    /// The canonical path of the folder; nothing outside of it is read.
    dir: PathBuf,
    /// The stem of the bake, if a single one was requested.
    only: Option<String>,
}

/// The fields of `level.lightmap.json` that viewers need. Fields added by later versions are
/// ignored.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct FinishedManifest {
    /// The glTF file next to the manifest.
    pub scene: String,
    /// Quantity in the pages: `radiance`, `irradiance` or `radiosity`.
    pub value: String,
    /// Pages.
    pub pages: Vec<FinishedPage>,
    /// Channels in addition to R, G and B.
    #[serde(default)]
    pub channels: Vec<String>,
    /// Light groups.
    #[serde(default)]
    pub groups: Vec<FinishedGroup>,
}

/// A page file.
#[derive(Debug, Clone, Deserialize)]
pub struct FinishedPage {
    /// File name, next to the manifest.
    pub uri: String,
}

/// A light group.
#[derive(Debug, Clone, Deserialize)]
pub struct FinishedGroup {
    /// Its name.
    pub name: String,
    /// Page files.
    pub pages: Vec<String>,
}

impl BakeFolder {
    /// Opens a folder written by `lumel bake`, or the one bake that a `*.lightmap.json` describes.
    ///
    /// # Errors
    /// [`Error::Folder`] if it cannot be read or contains no bake.
    pub fn open(path: &Path) -> Result<BakeFolder, Error> {
        let failed = |e: std::io::Error| folder_error(path, e.to_string(), true);
        let path_is_file = std::fs::metadata(path).map_err(failed)?.is_file();
        let folder = if path_is_file {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let Some(stem) = name.strip_suffix(MANIFEST) else {
                let message = format!(
                    "found another file, expected a folder written by `lumel bake` or its *{MANIFEST}"
                );
                return Err(folder_error(path, message, false));
            };
            let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
            BakeFolder {
                dir: parent
                    .unwrap_or(Path::new("."))
                    .canonicalize()
                    .map_err(failed)?,
                only: Some(stem.to_owned()),
            }
        } else {
            BakeFolder {
                dir: path.canonicalize().map_err(failed)?,
                only: None,
            }
        };
        if folder.bakes().is_empty() {
            let message = format!(
                "found no bake, expected a *{MANIFEST} as written by `lumel bake SCENE -o {}`",
                path.display()
            );
            return Err(folder_error(path, message, false));
        }
        Ok(folder)
    }

    /// Stems of the bakes currently in the folder (`level` for `level.lightmap.json`), sorted.
    pub fn bakes(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.dir).into_iter().flatten().flatten();
        let mut stems: Vec<String> = entries
            .filter_map(|e| Some(e.file_name().to_str()?.strip_suffix(MANIFEST)?.to_owned()))
            .filter(|stem| !stem.is_empty() && self.only.as_ref().is_none_or(|only| only == stem))
            .collect();
        stems.sort();
        stems
    }

    /// Reads a bake's manifest.
    ///
    /// # Errors
    /// [`Error::Folder`] if it does not exist, is not a manifest, or has a newer version.
    pub fn manifest(&self, stem: &str) -> Result<FinishedManifest, Error> {
        let name = format!("{stem}{MANIFEST}");
        let value = self.json(&name)?;
        let bad = |message: String| folder_error(&self.dir.join(&name), message, false);
        let version = value.get("version").and_then(Value::as_u64);
        if version != Some(MANIFEST_VERSION) {
            let found = value.get("version").map_or("none".into(), Value::to_string);
            return Err(bad(format!(
                "found manifest version {found}, expected at most {MANIFEST_VERSION}"
            )));
        }
        FinishedManifest::deserialize(&value).map_err(|e| bad(e.to_string()))
    }

    /// Reads a bake's report as JSON, because its fields vary between versions.
    ///
    /// # Errors
    /// [`Error::Folder`] if it does not exist or is not JSON.
    pub fn report(&self, stem: &str) -> Result<Value, Error> {
        self.json(&format!("{stem}.report.json"))
    }

    /// Describes files that do not match the hashes in the bake's report. This happens after a bake
    /// was killed between two renames, and when a result was edited.
    pub fn disagreement(&self, stem: &str) -> Option<String> {
        let report = self.file(&format!("{stem}.report.json"))?;
        let Some(strangers) = record::strangers(&self.dir, &report) else {
            return Some(format!("{stem}.report.json was changed after the bake"));
        };
        (!strangers.is_empty()).then(|| {
            format!(
                "these files do not match {stem}.report.json, because they were changed or belong to another bake: {}; bake again",
                strangers.join(", ")
            )
        })
    }

    /// The file called `name` in the folder; `None` if it does not exist or if the name or a link
    /// leads out of the folder.
    pub fn file(&self, name: &str) -> Option<PathBuf> {
        if !is_plain(name) {
            return None;
        }
        let path = self.dir.join(name).canonicalize().ok()?;
        (path.parent() == Some(self.dir.as_path()) && path.is_file()).then_some(path)
    }

    /// [`file`](Self::file), or the error that names the missing file.
    ///
    /// # Errors
    /// [`Error::Folder`].
    pub fn expect_file(&self, name: &str) -> Result<PathBuf, Error> {
        self.file(name).ok_or_else(|| {
            let message = "found no such file, but the bake references it".into();
            folder_error(&self.dir.join(name), message, false)
        })
    }

    /// The folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Reads a JSON file in the folder.
    pub(crate) fn json(&self, name: &str) -> Result<Value, Error> {
        let path = self.expect_file(name)?;
        let bytes = read_regular(&path, MAX_JSON).map_err(|e| {
            let io = e.kind() != ErrorKind::FileTooLarge;
            folder_error(&path, e.to_string(), io)
        })?;
        serde_json::from_slice(&bytes).map_err(|e| folder_error(&path, e.to_string(), false))
    }
}

/// Whether a name denotes a file in the same folder on every system.
fn is_plain(name: &str) -> bool {
    !name.is_empty() && name != "." && name != ".." && !name.contains(['/', '\\', ':', '\0'])
}

fn folder_error(path: &Path, message: String, io: bool) -> Error {
    Error::Folder {
        path: path.to_owned(),
        message,
        io,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EMPTY: &str = r#"{"version":1,"scene":"a.glb","value":"radiance","pages":[]}"#;

    #[test]
    fn bakes_are_found_by_their_manifests() {
        let t = tempfile::tempdir().unwrap();
        let e = BakeFolder::open(t.path()).unwrap_err();
        assert_eq!(e.exit_code(), 3);
        assert!(e.to_string().contains("no bake"), "{e}");
        for name in [
            "b.lightmap.json",
            "a.lightmap.json",
            ".lightmap.json",
            "c.json",
        ] {
            std::fs::write(t.path().join(name), EMPTY).unwrap();
        }
        assert_eq!(BakeFolder::open(t.path()).unwrap().bakes(), ["a", "b"]);
        let one = BakeFolder::open(&t.path().join("b.lightmap.json")).unwrap();
        assert_eq!(one.bakes(), ["b"]);
        assert_eq!(
            BakeFolder::open(&t.path().join("c.json"))
                .unwrap_err()
                .exit_code(),
            3
        );
        assert_eq!(
            BakeFolder::open(&t.path().join("none"))
                .unwrap_err()
                .exit_code(),
            2
        );
    }

    #[test]
    fn manifests_of_later_versions_are_refused_and_further_fields_ignored() {
        let t = tempfile::tempdir().unwrap();
        let write = |text: &str| std::fs::write(t.path().join("a.lightmap.json"), text).unwrap();
        write(&EMPTY.replace("\"pages\"", "\"new\":{},\"pages\""));
        let folder = BakeFolder::open(t.path()).unwrap();
        assert_eq!(folder.manifest("a").unwrap().scene, "a.glb");
        for bad in [EMPTY.replace(":1", ":2"), "{}".into(), "[".into()] {
            write(&bad);
            assert_eq!(folder.manifest("a").unwrap_err().exit_code(), 3, "{bad}");
        }
        assert_eq!(folder.report("a").unwrap_err().exit_code(), 3);
    }

    #[test]
    fn no_name_leads_out_of_the_folder() {
        let t = tempfile::tempdir().unwrap();
        let inner = t.path().join("inner");
        std::fs::create_dir(&inner).unwrap();
        std::fs::write(t.path().join("secret"), "x").unwrap();
        std::fs::write(inner.join("a.lightmap.json"), EMPTY).unwrap();
        std::fs::write(inner.join("..a"), "x").unwrap();
        let folder = BakeFolder::open(&inner).unwrap();
        assert!(folder.file("a.lightmap.json").is_some() && folder.file("..a").is_some());
        let absolute = t.path().join("secret");
        for name in [
            "",
            ".",
            "..",
            "../secret",
            "..\\secret",
            "a.lightmap.json/",
            absolute.to_str().unwrap(),
            "c:secret",
            "a\0",
        ] {
            assert!(folder.file(name).is_none(), "{name:?}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&absolute, inner.join("link")).unwrap();
            assert!(folder.file("link").is_none());
        }
    }
}
