//! Records what a bake read and wrote, and decides whether another bake would do the same.
//!
//! The report contains the record. It does not depend on the clock or on file locations: inputs are
//! named as in the document, and outputs by file name.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mesh_ingest::{Digest, Input, open_regular, read_regular};
use serde::Serialize;
use serde_json::Value;

use crate::folder::MAX_JSON;
use crate::level_record::LevelRecord;
use crate::origin::Origin;
use crate::settings::{ProbeSource, Settings, SkySource};

/// Identifies the program that made a result: its version, and a hash of its sources for builds
/// between releases.
pub(crate) const PROGRAM: &str = concat!(env!("CARGO_PKG_VERSION"), "+", env!("LUMEL_SOURCES"));

/// Inputs and outputs of a bake, by content.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Record {
    /// Hash of everything that the results depend on: program, settings, names, and contents of all
    /// inputs. Empty until files are made.
    pub key: String,
    /// Every file that was read.
    pub inputs: Vec<RecordedInput>,
    /// Every file that was written, except the report itself.
    pub outputs: Vec<RecordedOutput>,
    /// The level's geometry and places.
    pub level: LevelRecord,
}

/// A file that a bake read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RecordedInput {
    /// The file's role.
    pub kind: InputKind,
    /// The scene's file name, or the name by which the scene references the file; empty for files
    /// that options name.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub uri: String,
    /// Hash of its contents; null if it did not exist.
    pub digest: Option<Digest>,
}

/// The role of a file in a bake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum InputKind {
    /// The glTF.
    Scene,
    /// A file that the glTF references: buffer, image, IES profile.
    Linked,
    /// The sky image.
    Sky,
    /// The list of probe positions.
    Probes,
    /// The settings file.
    Config,
}

/// A file that a bake wrote.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RecordedOutput {
    /// Its name in the output folder; [`PREVIEW`] for the preview picture, which may be anywhere.
    pub file: String,
    /// Hash of its contents.
    pub digest: Digest,
}

/// Represents the picture of `--preview` among outputs; file names cannot contain `/`.
pub const PREVIEW: &str = "/preview";

/// Origins of settings. They are part of the report, so two bakes with equal settings from
/// different origins have different reports.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Provenance {
    /// The settings file, if there was one, and its hash.
    pub config: Option<(PathBuf, Digest)>,
    /// Settings that are not defaults, and their origins.
    pub origins: BTreeMap<String, Origin>,
}

/// Hash of a file's current contents; `None` if it cannot be read.
pub(crate) fn hash_file(path: &Path) -> Option<Digest> {
    Digest::of_reader(open_regular(path).ok()?).ok()
}

/// Files that the settings name, hashed now.
pub(crate) fn option_inputs(settings: &Settings, provenance: &Provenance) -> Vec<RecordedInput> {
    let mut out = Vec::new();
    let mut add = |kind, digest| {
        out.push(RecordedInput {
            kind,
            uri: String::new(),
            digest,
        })
    };
    if let SkySource::File(path) = &settings.sky {
        add(InputKind::Sky, hash_file(path));
    }
    if let Some(ProbeSource::File(path)) = &settings.probes {
        add(InputKind::Probes, hash_file(path));
    }
    if let Some((_, digest)) = &provenance.config {
        add(InputKind::Config, Some(*digest));
    }
    out
}

/// Files that the document references.
pub(crate) fn document_inputs(scene: &str, inputs: Vec<Input>) -> Vec<RecordedInput> {
    let inputs = inputs.into_iter().enumerate();
    inputs
        .map(|(i, input)| RecordedInput {
            kind: if i == 0 {
                InputKind::Scene
            } else {
                InputKind::Linked
            },
            uri: if i == 0 { scene.into() } else { input.uri },
            digest: input.digest,
        })
        .collect()
}

/// [`Record::key`].
pub(crate) fn key(
    settings: &Settings,
    origins: &BTreeMap<String, Origin>,
    inputs: &[RecordedInput],
) -> String {
    // JSON separates the parts unambiguously, whatever names contain.
    let parts = serde_json::json!(["lumel bake", PROGRAM, settings, origins, inputs]);
    Digest::of(parts.to_string().as_bytes()).to_string()
}

/// [`Record::key`] of results that come from several bakes, because parts were baked anew. Those of
/// a whole bake never have it.
pub(crate) fn mixed_key(level: &LevelRecord) -> String {
    let of = |i: &crate::level_record::InstanceRecord| level.bakes[i.bake].as_str();
    let keys: Vec<&str> = level.instances.iter().map(of).collect();
    let parts = serde_json::json!(["lumel bake --only", keys]);
    Digest::of(parts.to_string().as_bytes()).to_string()
}

/// Names of the output files listed in the report at `path`; empty if it is not a report or was
/// changed.
pub(crate) fn outputs_of(path: &Path) -> Vec<String> {
    let report = read_regular(path, MAX_JSON).unwrap_or_default();
    let v = crate::report::parse_sealed(&report);
    let outputs = v.and_then(|v| read_outputs(&v["content"]["outputs"]));
    outputs.into_iter().flatten().map(|o| o.file).collect()
}

/// Files in `dir` that its report lists but that are missing or have different contents; `None` if
/// there is no report or it was changed.
pub(crate) fn strangers(dir: &Path, report: &Path) -> Option<Vec<String>> {
    let report = read_regular(report, MAX_JSON).ok()?;
    let outputs = read_outputs(&crate::report::parse_sealed(&report)?["content"]["outputs"])?;
    let plain = |o: &RecordedOutput| Path::new(&o.file).file_name() == Some(o.file.as_ref());
    let changed = |o: &RecordedOutput| hash_file(&dir.join(&o.file)) != Some(o.digest);
    Some(
        (outputs.into_iter().filter(plain).filter(changed))
            .map(|o| o.file)
            .collect(),
    )
}

/// An input file of a bake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadFile {
    /// Path on disk.
    pub path: PathBuf,
    /// Hash of its contents when it was read; `None` if it was missing.
    pub digest: Option<Digest>,
}

/// A finished bake that a new bake would repeat.
#[derive(Debug)]
pub struct Current {
    /// The report file in the output folder.
    pub report: Vec<u8>,
    /// The report's warnings.
    pub warnings: Vec<String>,
    /// Every existing file that the bake read.
    pub inputs: Vec<PathBuf>,
    /// Every file that the bake wrote into its folder.
    pub outputs: Vec<PathBuf>,
}

/// Whether the results in `dir` are what baking `scene` would give, by content. Reads only the
/// report there and the files that it names.
///
/// `preview` is the path of the preview picture, if one is wanted.
///
/// # Errors
/// The reason to bake again, as a short text for people.
pub fn find_current(
    scene: &Path,
    settings: &Settings,
    provenance: &Provenance,
    dir: &Path,
    preview: Option<&Path>,
) -> Result<Current, String> {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    let report_path = dir.join(format!("{stem}.report.json"));
    let report = read_regular(&report_path, MAX_JSON)
        .map_err(|_| "there is no readable report".to_owned())?;
    let broken = || format!("{} was changed after the bake", report_path.display());
    let v = crate::report::parse_sealed(&report).ok_or_else(broken)?;
    let recorded = read_inputs(&v["content"]["inputs"]).ok_or_else(broken)?;
    let outputs = read_outputs(&v["content"]["outputs"]).ok_or_else(broken)?;
    let expected = key(settings, &provenance.origins, &recorded);
    if v["content"]["key"] != expected.as_str() {
        return Err("the settings or the program version changed".into());
    }
    let mut inputs = Vec::new();
    let mut options = Vec::new();
    for input in &recorded {
        let file = locate(scene, settings, provenance, input).ok_or_else(broken)?;
        let now = match (input.kind, &provenance.config) {
            (InputKind::Config, Some((_, digest))) => Some(*digest),
            _ => hash_file(&file),
        };
        if now != input.digest {
            return Err(format!("{} changed", file.display()));
        }
        if !matches!(input.kind, InputKind::Scene | InputKind::Linked) {
            options.push(input.kind);
        }
        inputs.extend(now.map(|_| file));
    }
    // A new option changes the settings, but a new settings file may not.
    if provenance.config.is_some() != options.contains(&InputKind::Config) {
        return Err("a settings file was added or removed".into());
    }
    let mut written = Vec::new();
    for output in &outputs {
        let file = match (output.file == PREVIEW, preview) {
            (false, _) => dir.join(&output.file),
            (true, Some(path)) => path.to_owned(),
            (true, None) => continue,
        };
        if hash_file(&file) != Some(output.digest) {
            return Err(format!("{} was changed after the bake", file.display()));
        }
        if output.file != PREVIEW {
            written.push(file);
        }
    }
    // Last, in the order in which a bake writes files.
    written.push(report_path.clone());
    if preview.is_some() && !outputs.iter().any(|o| o.file == PREVIEW) {
        return Err("there is no preview".into());
    }
    let warnings = v["warnings"].as_array().ok_or_else(broken)?;
    Ok(Current {
        warnings: (warnings.iter().filter_map(Value::as_str).map(str::to_owned)).collect(),
        report,
        inputs,
        outputs: written,
    })
}

/// Current path of a recorded input; `None` if the record is invalid.
pub(crate) fn locate(
    scene: &Path,
    settings: &Settings,
    provenance: &Provenance,
    input: &RecordedInput,
) -> Option<PathBuf> {
    match (input.kind, &settings.sky, &settings.probes) {
        (InputKind::Scene, ..) => {
            let name = scene.file_name()?.to_string_lossy();
            (name == input.uri).then(|| scene.to_owned())
        }
        (InputKind::Linked, ..) => {
            let base = scene.parent().unwrap_or(Path::new(""));
            Input::locate(base, &input.uri)
        }
        (InputKind::Sky, SkySource::File(path), _) => Some(path.clone()),
        (InputKind::Probes, _, Some(ProbeSource::File(path))) => Some(path.clone()),
        (InputKind::Config, ..) => provenance.config.as_ref().map(|(path, _)| path.clone()),
        _ => None,
    }
}

pub(crate) fn read_inputs(v: &Value) -> Option<Vec<RecordedInput>> {
    let one = |v: &Value| {
        Some(RecordedInput {
            kind: match v["kind"].as_str()? {
                "scene" => InputKind::Scene,
                "linked" => InputKind::Linked,
                "sky" => InputKind::Sky,
                "probes" => InputKind::Probes,
                "config" => InputKind::Config,
                _ => return None,
            },
            uri: v["uri"].as_str().unwrap_or_default().to_owned(),
            digest: match &v["digest"] {
                Value::Null => None,
                digest => Some(digest.as_str()?.parse().ok()?),
            },
        })
    };
    v.as_array()?.iter().map(one).collect()
}

fn read_outputs(v: &Value) -> Option<Vec<RecordedOutput>> {
    let one = |v: &Value| {
        Some(RecordedOutput {
            file: v["file"].as_str()?.to_owned(),
            digest: v["digest"].as_str()?.parse().ok()?,
        })
    };
    v.as_array()?.iter().map(one).collect()
}
