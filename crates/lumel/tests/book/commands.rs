//! The book's commands run.
#![cfg(unix)]

use std::f64::consts::FRAC_1_SQRT_2;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::json;
use tempfile::TempDir;

use super::pages::{Page, documents};
use crate::common::{lumel, parse, quads, temp, write};

/// Settings that keep bakes short if a command sets nothing else.
const CHEAP: &str = "quality = \"draft\"\ntexels-per-unit = 2\n";

/// Squares under lamps with the names of the demo level's lamps.
fn level() -> String {
    let mut document = parse(quads::scene());
    let nodes = document["nodes"].as_array_mut().expect("nodes");
    let lamps = ["pendant_1", "spot", "sun"].map(|name| (name, nodes.len()));
    let mut roots = Vec::new();
    for (light, (name, first)) in lamps.into_iter().enumerate() {
        roots.push(json!(first + light));
        nodes.push(json!({
            "name": name,
            "translation": [0, 3, 0],
            "rotation": [-FRAC_1_SQRT_2, 0, 0, FRAC_1_SQRT_2],
            "extensions": {"KHR_lights_punctual": {"light": light}},
        }));
    }
    document["scenes"][0]["nodes"]
        .as_array_mut()
        .expect("roots")
        .extend(roots);
    document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    document["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 5}, {"type": "spot", "spot": {}, "intensity": 5},
        {"type": "directional", "intensity": 2},
    ]}});
    document.to_string()
}

/// A folder with the files that the commands read.
fn folder() -> TempDir {
    let t = temp();
    let at = |name: &str| t.path().join(name);
    fs::create_dir(at("assets")).expect("a folder");
    for stem in ["level", "assets/demo_level"] {
        write(at(&format!("{stem}.glb")), level());
        write(at(&format!("{stem}.lumel.toml")), CHEAP);
    }
    write(at("level.gltf"), level());
    write(at("points.json"), r#"{"points": [[0, 1, 0]]}"#);
    lumel([
        "bake".as_ref(),
        at("level.glb").as_os_str(),
        "-o".as_ref(),
        at("out").as_os_str(),
    ])
    .ok();
    t
}

/// A command with `lumel` at the front of the path.
fn shell(line: &str, folder: &Path) -> Command {
    let binary = Path::new(env!("CARGO_BIN_EXE_lumel"));
    let path = std::env::var("PATH").unwrap_or_default();
    let own = binary.parent().expect("it lies in a folder").display();
    let mut c = Command::new("sh");
    c.args(["-c", &format!("exec {line}")]).current_dir(folder);
    c.env("PATH", format!("{own}:{path}")).stdin(Stdio::null());
    c
}

/// Starts a viewer and waits for its address.
fn answers(line: &str, folder: &Path) -> Result<(), String> {
    let line = line.replace(" --open", "");
    let mut child = (shell(&line, folder).stdout(Stdio::piped()).spawn()).expect("it starts");
    let mut said = String::new();
    let output = child.stdout.take().expect("a pipe");
    BufReader::new(output).read_line(&mut said).expect("text");
    child.kill().expect("it can be stopped");
    child.wait().expect("it ends");
    if said.contains("http://127.0.0.1:") {
        Ok(())
    } else {
        Err(said)
    }
}

fn runs(line: &str, folder: &Path) -> Result<(), String> {
    if line.starts_with("lumel view") || line.starts_with("lumel watch") {
        return answers(line, folder);
    }
    let out = shell(line, folder).output().expect("a shell");
    if out.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&out.stderr).into_owned())
    }
}

/// Lines of a page that call `lumel`.
fn calls(page: &Page) -> impl Iterator<Item = String> {
    let shell = page.blocks.iter().filter(|(language, _)| language == "sh");
    (shell.flat_map(|(_, text)| text.lines()))
        .map(|line| line.replacen("cargo run --release -p lumel --", "lumel", 1))
        .filter(|line| line.starts_with("lumel "))
}

#[test]
fn the_books_commands_run() {
    let mut faults = Vec::new();
    let mut count = 0;
    for page in documents() {
        let lines: Vec<String> = calls(&page).collect();
        if lines.is_empty() {
            continue;
        }
        let t = folder();
        count += lines.len();
        for line in lines {
            if let Err(said) = runs(&line, t.path()) {
                faults.push(format!("{}: {line}: {said}", page.name));
            }
        }
    }
    super::none(&faults);
    assert!(count > 20, "only {count} commands were found");
}
