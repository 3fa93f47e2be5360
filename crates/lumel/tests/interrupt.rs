//! The real binary, stopped halfway: Ctrl-C, SIGTERM and SIGKILL.

#![cfg(unix)]

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{asset, bake, cheap, comparable, files, names, outputs, parse, temp, write};
use serde_json::Value;
use tempfile::TempDir;

/// Bakes the small scene, then starts a long bake of a scene with the same name into the same
/// folder.
struct Victim {
    folder: TempDir,
    before: std::collections::BTreeMap<String, Vec<u8>>,
    child: Child,
    log: BufReader<std::process::ChildStderr>,
}

impl Victim {
    fn start() -> Victim {
        let folder = temp();
        let out = folder.path().join("out");
        for (name, source) in [("small", "cornell_box.glb"), ("large", "demo_level.glb")] {
            fs::create_dir(folder.path().join(name)).expect("created");
            let copy = folder.path().join(name).join("level.glb");
            fs::copy(asset(source), copy).expect("copied");
        }
        bake(&folder.path().join("small/level.glb"), &out, "").ok();
        let before = files(&out);
        assert_eq!(names(&out), outputs("level"));
        let mut child = crate::common::command()
            .arg("bake")
            .arg(folder.path().join("large/level.glb"))
            .arg("-o")
            .arg(&out)
            .args(["--quality", "production"])
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary starts");
        let log = BufReader::new(child.stderr.take().expect("it is piped"));
        Victim {
            folder,
            before,
            child,
            log,
        }
    }

    /// Waits for the log line of `phase`, which is written when the phase ends.
    fn wait_for(&mut self, phase: &str) {
        let mut line = String::new();
        while !line.trim_start().starts_with(phase) {
            line.clear();
            let n = self.log.read_line(&mut line).expect("UTF-8");
            assert!(n > 0, "the bake ended before {phase} did");
        }
    }

    fn signal(&self, name: &str) {
        let status = Command::new("kill")
            .args(["-s", name, &self.child.id().to_string()])
            .status();
        assert!(status.expect("kill is installed").success());
    }

    /// Sends the signal and asserts exit code 75 within a second and intact old files.
    fn stops_on(mut self, signal: &str) {
        let asked = Instant::now();
        self.signal(signal);
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("it is our child") {
                break status;
            }
            assert!(asked.elapsed() < Duration::from_secs(10), "still running");
            std::thread::sleep(Duration::from_millis(5));
        };
        let took = asked.elapsed();
        assert_eq!(status.code(), Some(75));
        // The contract is one second; the extra half is for machines that run other tests on every
        // core.
        assert!(took < Duration::from_millis(1500), "stopped after {took:?}");
        let mut rest = String::new();
        self.log.read_to_string(&mut rest).expect("UTF-8");
        let errors: Vec<_> = rest.lines().filter(|l| l.starts_with("error: ")).collect();
        assert_eq!(errors.len(), 1, "{rest}");
        assert!(errors[0].contains("cancelled"), "{rest}");
        self.nothing_changed();
    }

    fn nothing_changed(&self) {
        let after = files(&self.folder.path().join("out"));
        assert_eq!(
            after.keys().collect::<Vec<_>>(),
            self.before.keys().collect::<Vec<_>>()
        );
        assert!(after == self.before, "an earlier output was changed");
    }
}

impl Drop for Victim {
    /// Stops the bake if an assertion fails.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn ctrl_c_at_the_start_stops_within_a_second() {
    let mut victim = Victim::start();
    victim.wait_for("ingest");
    victim.stops_on("INT");
}

#[test]
fn ctrl_c_while_light_is_computed_stops_within_a_second() {
    let mut victim = Victim::start();
    victim.wait_for("solve");
    std::thread::sleep(Duration::from_millis(300));
    victim.stops_on("INT");
}

#[test]
fn sigterm_is_like_ctrl_c() {
    let mut victim = Victim::start();
    victim.wait_for("atlas");
    victim.stops_on("TERM");
}

#[test]
fn a_stopped_bake_leaves_no_folder() {
    let t = temp();
    let out = t.path().join("out");
    let mut child = crate::common::command()
        .arg("bake")
        .arg(asset("demo_level.glb"))
        .arg("-o")
        .arg(&out)
        .args(["--quality", "production"])
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let mut log = BufReader::new(child.stderr.take().expect("it is piped"));
    // The first line comes after the first step, so the handler is installed.
    log.read_line(&mut String::new()).expect("UTF-8");
    let sent = Command::new("kill")
        .args(["-s", "INT", &child.id().to_string()])
        .status();
    assert!(sent.expect("kill is installed").success());
    assert_eq!(child.wait().expect("it is our child").code(), Some(75));
    assert!(!out.exists());
}

#[test]
fn after_sigkill_old_files_are_whole_and_the_next_bake_works() {
    let mut victim = Victim::start();
    victim.wait_for("solve");
    victim.signal("KILL");
    let status = victim.child.wait().expect("it is our child");
    assert_eq!(status.signal(), Some(9));
    victim.nothing_changed();
    let out = victim.folder.path().join("out");
    bake(&victim.folder.path().join("small/level.glb"), &out, "").ok();
    // The same scene and settings give the same bytes, except for times in the report.
    let mut after = files(&out);
    let report = after.remove("level.report.json").expect("written");
    assert_eq!(
        comparable(report),
        comparable(&victim.before["level.report.json"])
    );
    assert_eq!(names(&out), outputs("level"));
    for (name, bytes) in &after {
        assert!(*bytes == victim.before[name], "{name} differs");
    }
}

/// Each file is old or new, never partial, and the next bake deletes left-over temporary files.
#[test]
fn sigkill_while_writing_tears_no_file() {
    let t = temp();
    let scene = asset("cornell_box.glb");
    let out = t.path().join("out");
    let same = |a: &[u8], b: &[u8]| match (
        serde_json::from_slice::<Value>(a),
        serde_json::from_slice::<Value>(b),
    ) {
        (Ok(_), Ok(_)) => a == b || comparable_if_report(a) == comparable_if_report(b),
        _ => a == b,
    };
    bake(&scene, &out, "--sky 1").ok();
    let new = files(&out);
    bake(&scene, &out, "").ok();
    let old = files(&out);
    let mut child = cheap(&scene, &out)
        .args(["-q", "--sky", "1"])
        .spawn()
        .expect("the binary starts");
    // Temporary files exist only for a few fsyncs. If the loop misses them, the bake ends normally.
    while child.try_wait().expect("it is our child").is_none() {
        let entries = fs::read_dir(&out).expect("it exists").flatten();
        let mut written = entries.map(|e| e.file_name());
        if written.any(|n| n.to_string_lossy().starts_with(".lumel-tmp-")) {
            let _ = child.kill();
        }
    }
    let torn = files(&out);
    for name in outputs("cornell_box") {
        let whole = same(&torn[&name], &old[&name]) || same(&torn[&name], &new[&name]);
        assert!(whole, "{name} is neither the old one nor the new one");
    }
    // One more left-over file, so that the test does not depend on the race above.
    write(out.join(".lumel-tmp-left"), "half a file");
    bake(&scene, &out, "").ok();
    assert_eq!(names(&out), outputs("cornell_box"));
}

fn comparable_if_report(bytes: &[u8]) -> Value {
    let mut v = parse(bytes);
    if let Some(o) = v.as_object_mut() {
        o.shift_remove("measured");
    }
    v
}

/// The state after a kill between two renames.
#[test]
fn files_of_two_bakes_in_a_folder_are_told_apart() {
    let folder = temp();
    let out = folder.path().join("out");
    bake(&asset("cornell_box.glb"), &out, "").ok();
    let old = files(&out);
    let report = || crate::common::lumel(["report".as_ref(), out.as_os_str()]).ok();
    assert!(!report().stderr.contains("warning"));
    bake(&asset("cornell_box.glb"), &out, "--sky 1").ok();
    let (exr, json) = ("cornell_box.lightmap.exr", "cornell_box.report.json");
    assert!(!report().stderr.contains("warning"));
    write(out.join(json), &old[json]);
    let told = report().stderr;
    assert!(
        told.contains("warning: these files do not match") && told.contains(exr),
        "{told}"
    );
    let page = fs::read_to_string(out.join("cornell_box.report.html")).expect("written");
    assert!(page.contains("these files do not match"));
    // A report that was changed is not trusted.
    let mut bytes = old[json].clone();
    bytes.push(b' ');
    write(out.join(json), bytes);
    let told = report().stderr;
    assert!(
        told.contains("cornell_box.report.json was changed after the bake"),
        "{told}"
    );
}
