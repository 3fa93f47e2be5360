//! `lumel watch`: the real binary, a level that is saved again and again, and the page.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use crate::common::browser::Browser;
use crate::common::quads::{ALBEDO, R, points, scene, shown, sun};
use crate::common::{command, files, lumel, names, outputs, parse, temp, write};
use lumel::atlas_bake::read_exr;
use serde_json::json;
use tempfile::TempDir;

/// Longest wait for anything. What is awaited takes seconds; test machines can be slow.
const PATIENCE: Duration = Duration::from_secs(120);

/// `lumel watch` on the squares, ended when dropped.
struct Watch {
    folder: TempDir,
    child: Child,
    log: Receiver<String>,
    url: Receiver<String>,
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Lines of a pipe, from a thread.
fn lines(pipe: impl std::io::Read + Send + 'static) -> Receiver<String> {
    let (send, receive) = channel();
    std::thread::spawn(move || {
        for line in BufReader::new(pipe).lines().map_while(Result::ok) {
            if send.send(line).is_err() {
                break;
            }
        }
    });
    receive
}

impl Watch {
    fn start(options: &str) -> Watch {
        let folder = temp();
        let level = write(folder.path().join("level.gltf"), scene());
        let more = format!("--no-stitch --sun {} {options}", sun());
        let mut child = command()
            .arg("watch")
            .arg(&level)
            .arg("-o")
            .arg(folder.path().join("out"))
            .args(more.split_whitespace())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary starts");
        let log = lines(child.stderr.take().expect("a pipe"));
        let url = lines(child.stdout.take().expect("a pipe"));
        Watch {
            folder,
            child,
            log,
            url,
        }
    }

    fn level(&self) -> PathBuf {
        self.folder.path().join("level.gltf")
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// Saves a settings file that dims the sun.
    fn dim(&self, factor: f64) {
        let text = format!("[[light]]\nname = \"sun\"\nfactor = {factor}\n");
        write(self.folder.path().join("level.lumel.toml"), text);
    }

    /// Waits for a line, and returns all up to it.
    #[track_caller]
    fn wait_for(&self, text: &str) -> Vec<String> {
        let (start, mut seen) = (Instant::now(), Vec::new());
        while start.elapsed() < PATIENCE {
            if let Ok(line) = self.log.recv_timeout(Duration::from_millis(100)) {
                seen.push(line);
                if seen[seen.len() - 1].contains(text) {
                    return seen;
                }
            }
        }
        panic!("{text} was not said: {seen:#?}");
    }
}

/// The largest green value of the lightmap.
fn brightest(out: &Path) -> f64 {
    let page = read_exr(&out.join("level.lightmap.exr")).expect("it is written");
    let green = page.channel("G").expect("a channel").iter();
    f64::from(green.copied().fold(0.0f32, f32::max))
}

fn quality(out: &Path) -> serde_json::Value {
    parse(&files(out)["level.report.json"])["settings"]["quality"].clone()
}

/// Options that keep a bake of the squares at a tenth of a second.
const CHEAP: &str = "--quality quick --texels-per-unit 8";

const READY: &str = "waiting for the next save";

#[test]
fn saving_bakes_coarse_first_and_faults_keep_the_last_good_bake() {
    let w = Watch::start(CHEAP);
    let out = w.out();
    let said = w.wait_for("up to date");
    // Twice: the draft, then what was asked for.
    let baked = said
        .iter()
        .filter(|l| l.starts_with("baked level.gltf"))
        .count();
    assert_eq!(baked, 2, "{said:#?}");
    assert_eq!(
        (names(&out), quality(&out)),
        (outputs("level"), json!("quick"))
    );
    assert!((brightest(&out) - R).abs() < 0.01 * R);

    // A settings file is created.
    w.dim(0.5);
    w.wait_for("up to date");
    assert!((brightest(&out) - 0.5 * R).abs() < 0.005 * R);

    // Half of the level is saved, as an interrupted exporter would.
    let good = files(&out);
    let text = scene();
    write(w.level(), &text[..text.len() / 2]);
    let said = w.wait_for(READY);
    assert!(
        said.iter()
            .any(|l| l.starts_with("error: ") && l.contains("level.gltf")),
        "{said:#?}"
    );
    assert!(files(&out) == good, "a fault changed the last good bake");
    // Its own output in a file beside the level does not repair it.
    write(w.folder.path().join("watch.log"), "error");
    assert!(w.log.recv_timeout(Duration::from_secs(1)).is_err());
    write(w.level(), &text);
    let said = w.wait_for(READY);
    // The good level again: the results in the folder are still current.
    assert!(!said.iter().any(|l| l.starts_with("baked")), "{said:#?}");
    assert!(files(&out) == good);

    // A new time stamp alone does not start a bake.
    let file = fs::File::options()
        .write(true)
        .open(w.level())
        .expect("it is there");
    file.set_modified(std::time::SystemTime::now())
        .expect("it can be touched");
    assert!(w.log.recv_timeout(Duration::from_secs(1)).is_err());
}

#[test]
fn a_new_save_ends_the_bake_of_the_old_one() {
    let w = Watch::start("--quality production --texels-per-unit 64");
    // The draft is finished and the long bake begins.
    w.wait_for("baked level.gltf");
    w.wait_for("solve");
    let asked = Instant::now();
    w.dim(0.25);
    w.wait_for("saved again");
    assert!(
        asked.elapsed() < Duration::from_secs(5),
        "{:?}",
        asked.elapsed()
    );
    w.wait_for("baked level.gltf");
    assert!((brightest(&w.out()) - 0.25 * R).abs() < 0.0025 * R);
}

#[test]
fn options_of_single_bakes_are_refused() {
    let level = crate::common::asset("cornell_box.glb");
    for option in [
        "--dry-run",
        "--skip-if-unchanged",
        "--json",
        "--depfile=x.d",
    ] {
        let mut a = vec!["watch".into(), level.clone().into_os_string()];
        a.extend(["-o", "/nowhere", "-q", option].map(Into::into));
        let name = option.split('=').next().expect("a name");
        lumel(a).fails(1, &[name, "leave it out"]);
    }
}

#[test]
#[cfg(unix)]
fn ctrl_c_is_how_it_ends() {
    let mut w = Watch::start(CHEAP);
    w.wait_for("up to date");
    let kill = std::process::Command::new("kill")
        .args(["-s", "INT", &w.child.id().to_string()])
        .status();
    assert!(kill.expect("kill is installed").success());
    let asked = Instant::now();
    let status = w.child.wait().expect("it is ours");
    assert_eq!(status.code(), Some(0));
    assert!(
        asked.elapsed() < Duration::from_secs(2),
        "{:?}",
        asked.elapsed()
    );
    assert_eq!(names(&w.out()), outputs("level"));
}

#[test]
fn the_page_shows_new_light_as_it_comes_in() {
    let Some(mut b) = Browser::start("lumel watch", [640, 480]) else {
        return;
    };
    let w = Watch::start(CHEAP);
    let url = w.url.recv_timeout(PATIENCE).expect("an address");
    w.wait_for("up to date");
    b.open(&format!("{url}#tone=values&panel=0&cam=0,9,0.01,0,0,0,60"));
    let see = |b: &mut Browser, r: f64| {
        b.wait("document.body?.dataset.state === 'ready' && !lumel.stage.dirty && !lumel.busy()");
        let [(at, ..), ..] = points()[..] else {
            panic!()
        };
        let place = b.eval(&format!("lumel.project({}, {}, {})", at[0], at[1], at[2]));
        let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number") as u32);
        let found = b.screenshot().get_pixel(x, y).0;
        let want = ALBEDO.map(|a| shown(a * r));
        let near = found
            .iter()
            .zip(want)
            .all(|(f, w)| (f64::from(*f) - w).abs() <= 1.0);
        assert!(near, "{found:?} is not {want:?}");
    };
    see(&mut b, R);
    let before = b.eval("lumel.opened()").as_f64().expect("a number");
    w.dim(0.5);
    w.wait_for("up to date");
    b.wait(&format!(
        "lumel.opened() > {before} && document.getElementById('status').hidden"
    ));
    // The last look may still be under way.
    std::thread::sleep(Duration::from_millis(1500));
    see(&mut b, 0.5 * R);

    write(w.level(), "{");
    w.wait_for(READY);
    b.wait(
        "document.querySelector('#status.fault:not([hidden])')?.textContent.includes('level.gltf')",
    );
    see(&mut b, 0.5 * R);
    assert_eq!(b.errors, [""; 0]);
}
