//! Runs the real binary in temporary folders.

#[allow(clippy::print_stderr, reason = "says what it skips")]
pub mod browser;
pub mod quads;
pub mod site;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;

/// Result of a run of the binary.
#[derive(Debug)]
pub struct Run {
    /// Exit code; `None` after a signal.
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    /// Runs `command` to its end.
    pub fn of(command: &mut Command) -> Run {
        let out = command.output().expect("the binary starts");
        Run {
            code: out.status.code(),
            stdout: String::from_utf8(out.stdout).expect("stdout is UTF-8"),
            stderr: String::from_utf8(out.stderr).expect("stderr is UTF-8"),
        }
    }

    /// Asserts success.
    #[track_caller]
    pub fn ok(self) -> Run {
        assert_eq!(self.code, Some(0), "stderr: {}", self.stderr);
        self
    }

    /// Asserts a failure with `code`, empty stdout, and one message that contains each of `words`.
    /// For runs with `-q` or of commands without progress, which print nothing else on stderr.
    #[track_caller]
    pub fn fails(&self, code: i32, words: &[&str]) {
        assert_eq!(self.code, Some(code), "stderr: {}", self.stderr);
        assert_eq!(self.stdout, "");
        assert!(self.stderr.starts_with("error: "), "{}", self.stderr);
        let messages = self.stderr.lines().filter(|l| l.starts_with("error: "));
        assert_eq!(messages.count(), 1, "{}", self.stderr);
        for word in words {
            assert!(
                self.stderr.contains(word),
                "{word} is not in: {}",
                self.stderr
            );
        }
    }
}

/// The command, not yet started.
pub fn command() -> Command {
    let mut c = Command::new(env!("CARGO_BIN_EXE_lumel"));
    c.stdin(Stdio::null());
    c
}

/// Runs the binary with `arguments`.
pub fn lumel<I: IntoIterator<Item = S>, S: AsRef<OsStr>>(arguments: I) -> Run {
    Run::of(command().args(arguments))
}

/// `lumel bake SCENE -o OUT` with the cheapest settings and further `options` (separated by
/// spaces).
pub fn bake(scene: &Path, out: &Path, options: &str) -> Run {
    Run::of(cheap(scene, out).args(options.split_whitespace()))
}

/// The command of [`bake`] without options, not yet started.
pub fn cheap(scene: &Path, out: &Path) -> Command {
    let mut c = command();
    c.arg("bake").arg(scene).arg("-o").arg(out).args(CHEAP);
    c
}

/// With these options, a bake of the Cornell box takes a tenth of a second.
const CHEAP: [&str; 4] = ["--quality", "draft", "--texels-per-unit", "4"];

/// A scene of `assets/`.
pub fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../assets")
        .join(name)
}

/// Names and contents of the files in a folder, including hidden ones.
pub fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(dir).expect("the folder exists");
    entries
        .map(|e| {
            let path = e.expect("the folder can be listed").path();
            let name = path.file_name().expect("it has a name").to_string_lossy();
            let bytes = std::fs::read(&path).expect("only files are in the folder");
            (name.into_owned(), bytes)
        })
        .collect()
}

/// Names of the files in a folder, sorted.
pub fn names(dir: &Path) -> Vec<String> {
    files(dir).into_keys().collect()
}

/// The five files that a bake of `stem.glb` with one page writes, sorted.
pub fn outputs(stem: &str) -> Vec<String> {
    [
        "glb",
        "lightmap.exr",
        "lightmap.json",
        "report.json",
        "vertex.glb",
    ]
    .map(|ending| format!("{stem}.{ending}"))
    .to_vec()
}

/// A temporary folder.
pub fn temp() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Writes a file and returns its path.
pub fn write(path: PathBuf, bytes: impl AsRef<[u8]>) -> PathBuf {
    std::fs::write(&path, bytes).expect("temporary folders can be written to");
    path
}

/// Parses JSON.
#[track_caller]
pub fn parse(bytes: impl AsRef<[u8]>) -> Value {
    serde_json::from_slice(bytes.as_ref()).expect("JSON")
}

/// A report without the values that differ between runs.
pub fn comparable(report: impl AsRef<[u8]>) -> Value {
    let mut v = parse(report);
    let gone = v.as_object_mut().and_then(|o| o.shift_remove("measured"));
    assert!(gone.is_some(), "the report says what it measured");
    v
}
