//! Tests `lumel view` and the three.js loader in a real browser: known pixel values, switches, keys
//! and an empty console.
//!
//! Skipped with a message if Chromium is not installed.

#![allow(clippy::print_stderr, reason = "says what it skips")]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use crate::common::browser::Browser;
use crate::common::quads::{ALBEDO, OTHER, R, points, scene, shown, sun};
use crate::common::site::Site;
use crate::common::{bake, command, parse, temp, write};
use image::RgbImage;
use serde_json::json;
use tempfile::TempDir;

/// `lumel view` on a folder; ends when dropped.
struct Server(Child, String);

impl Server {
    fn start(dir: &Path) -> Server {
        let mut child = command()
            .arg("view")
            .arg(dir)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary starts");
        let mut line = String::new();
        let output = child.stdout.take().expect("a pipe");
        BufReader::new(output)
            .read_line(&mut line)
            .expect("it says where it is");
        Server(child, line.trim().to_owned())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Bakes the squares with `options`.
fn squares(options: &str) -> (TempDir, PathBuf) {
    let t = temp();
    // The shadow's edge coincides with the border of two primitives, which stitching would smooth
    // as a seam.
    let options = format!("--no-stitch {options}");
    // This name needs percent-encoding in a URL.
    let file = write(t.path().join("four squares #1.gltf"), scene());
    let out = t.path().join("out");
    bake(&file, &out, &format!("--sun {} {options}", sun())).ok();
    (t, out)
}

/// From high above; the view axis must not be exactly the camera's up vector.
const ABOVE: &str = "0,9,0.01,0,0,0,60";
/// From here the floor under the plate is visible.
const BESIDE: &str = "3,0.6,3,0,0,0,60";

/// Waits until the page has drawn everything.
fn settle(b: &mut Browser) {
    b.wait("document.body?.dataset.state === 'ready' && !lumel.stage.dirty && !lumel.busy()");
}

/// The pixel at a point of the scene.
fn pixel(b: &mut Browser, picture: &RgbImage, at: [f64; 3]) -> [u8; 3] {
    let place = b.eval(&format!("lumel.project({}, {}, {})", at[0], at[1], at[2]));
    let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
    picture.get_pixel(x as u32, y as u32).0
}

/// Within one 8-bit step: half a step for rounding, the rest for the half float (2^-11) and the
/// GPU.
#[track_caller]
fn assert_pixel(found: [u8; 3], linear: [f64; 3], what: &str) {
    let want = linear.map(shown);
    let near = found
        .iter()
        .zip(want)
        .all(|(f, w)| (f64::from(*f) - w).abs() <= 1.0);
    assert!(near, "{what}: {found:?} is not {want:.2?}");
}

fn times(albedo: [f64; 3], r: f64) -> [f64; 3] {
    albedo.map(|a| a * r)
}

#[test]
fn the_viewer_shows_closed_form_pixels_and_its_switches_work() {
    let Some(mut b) = Browser::start("lumel view in a browser", [1280, 720]) else {
        return;
    };
    let (_t, out) = squares("--layers direct,indirect,error,coverage --group day=sun");
    let server = Server::start(&out);
    b.open(&format!("{}#tone=values&cam={ABOVE}", server.1));
    settle(&mut b);
    let picture = b.screenshot();
    for (at, albedo, r) in points().into_iter().take(5) {
        let found = pixel(&mut b, &picture, at);
        assert_pixel(found, times(albedo, r), &format!("{at:?}"));
    }

    // Clicks the button of each view and light.
    let press = |b: &mut Browser, name: &str| {
        b.eval(&format!(
            "document.querySelector('#panel [data-name={name}]').click()"
        ));
        settle(b);
        b.screenshot()
    };
    let [(at, ..), _, _, _, (green, ..), _] = points()[..] else {
        panic!()
    };
    let shot = press(&mut b, "albedo");
    assert_pixel(pixel(&mut b, &shot, at), ALBEDO, "albedo");
    assert_pixel(
        pixel(&mut b, &shot, green),
        OTHER,
        "albedo of the other primitive",
    );
    let shot = press(&mut b, "light");
    assert_pixel(pixel(&mut b, &shot, at), [R; 3], "light alone");
    let shot = press(&mut b, "indirect");
    assert_pixel(pixel(&mut b, &shot, at), [0.0; 3], "no indirect light");
    let shot = press(&mut b, "direct");
    assert_pixel(pixel(&mut b, &shot, at), [R; 3], "direct light");
    let shot = press(&mut b, "coverage");
    assert_pixel(pixel(&mut b, &shot, at), [1.0; 3], "covered");
    // The error is 0, which is the lower end of the scale.
    let shot = press(&mut b, "error");
    assert_pixel(pixel(&mut b, &shot, at), [0.0; 3], "no error");
    assert_eq!(
        b.eval("document.getElementById('legend').hidden"),
        json!(false)
    );
    // The error view does not depend on the light; choosing a light switches to the level view.
    let shot = press(&mut b, "all");
    assert_pixel(
        pixel(&mut b, &shot, at),
        times(ALBEDO, R),
        "the level again",
    );
    press(&mut b, "groups");
    // Figures must end where the buttons above them do.
    let inside = "document.getElementById('views').getBoundingClientRect().right + 0.5";
    let figures = format!(
        "[...document.querySelectorAll('#groups output')].every((o) => o.getBoundingClientRect().right <= {inside})"
    );
    assert_eq!(b.eval(&figures), json!(true));
    b.eval("{ const s = document.querySelector('#groups input'); s.value = '0.5'; s.dispatchEvent(new Event('input')); }");
    settle(&mut b);
    let shot = b.screenshot();
    assert_pixel(
        pixel(&mut b, &shot, at),
        times(ALBEDO, 0.5 * R),
        "half of the group",
    );
    press(&mut b, "all");

    // Missing layers are greyed out and say how to get them.
    let ao = "document.querySelector('#views [data-name=ao]')";
    assert_eq!(
        b.eval(&format!(
            "{ao}.disabled && {ao}.title.includes('--layers ao')"
        )),
        json!(true)
    );
    let missing = b.eval("document.getElementById('missing').innerText");
    assert!(
        missing
            .as_str()
            .is_some_and(|m| m.contains("ao") && !m.contains("error")),
        "{missing}"
    );
    let report = b.eval("document.getElementById('report').innerText");
    assert!(
        report.as_str().is_some_and(|m| m.contains("draft")),
        "{report}"
    );

    // A click shows the figures of the point.
    let place = b.eval(&format!("lumel.project({}, 0, {})", at[0], at[2]));
    b.click(place[0].as_f64().expect("x"), place[1].as_f64().expect("y"));
    b.wait("!document.getElementById('readout').hidden && document.getElementById('readout').innerText.includes('R = E/π')");
    let text = b.eval("document.getElementById('readout').innerText");
    let text = text.as_str().expect("text");
    assert!(
        text.contains("flat") && text.contains("tan") && text.contains("0.6"),
        "{text}"
    );

    // Keys: exposure doubles, the grid darkens every other texel, and W walks.
    let key = |b: &mut Browser, key: &str, code: &str| {
        b.key(key, code, true);
        b.key(key, code, false);
        settle(b);
    };
    for _ in 0..2 {
        key(&mut b, "-", "Minus");
    }
    let shot = b.screenshot();
    assert_pixel(
        pixel(&mut b, &shot, at),
        times(ALBEDO, 0.5 * R),
        "one stop darker",
    );
    key(&mut b, "g", "KeyG");
    assert_ne!(b.screenshot(), shot, "the grid is seen");
    key(&mut b, "f", "KeyF");
    let height = b.eval("lumel.stage.camera.position.y");
    b.key("w", "KeyW", true);
    b.wait(&format!("lumel.stage.camera.position.y < {height} - 0.05"));
    b.key("w", "KeyW", false);
    assert_eq!(
        b.eval("new URLSearchParams(location.hash.slice(1)).get('bake')"),
        json!("four squares #1")
    );
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn light_is_right_way_up_under_the_plate_and_small_windows_hold_the_page() {
    let Some(mut b) = Browser::start("lumel view in small windows", [1280, 720]) else {
        return;
    };
    let (_t, out) = squares("");
    let server = Server::start(&out);
    b.open(&format!("{}#tone=values&cam={BESIDE}", server.1));
    settle(&mut b);
    let picture = b.screenshot();
    for (at, albedo, r) in points().into_iter().skip(2) {
        let found = pixel(&mut b, &picture, at);
        assert_pixel(found, times(albedo, r), &format!("{at:?}"));
    }
    for size in [[1280, 720], [800, 600], [480, 360], [320, 480]] {
        b.resize(size);
        b.wait(&format!(
            "innerWidth === {} && innerHeight === {}",
            size[0], size[1]
        ));
        settle(&mut b);
        let fits = b.eval(
            "[document.documentElement.scrollWidth <= innerWidth, document.documentElement.scrollHeight <= innerHeight, \
             document.getElementById('panel').getBoundingClientRect().right <= innerWidth, \
             document.getElementById('stage').getBoundingClientRect().height === innerHeight, \
             document.getElementById('panel').scrollWidth <= document.getElementById('panel').clientWidth]",
        );
        assert_eq!(fits, json!([true, true, true, true, true]), "{size:?}");
        b.eval("document.getElementById('hide-panel').click()");
        settle(&mut b);
        assert_eq!(
            b.eval("getComputedStyle(document.getElementById('panel')).display"),
            json!("none")
        );
        b.eval("document.getElementById('show-panel').click()");
        settle(&mut b);
    }
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn a_closed_level_without_cameras_is_shown_from_within() {
    let Some(mut b) = Browser::start("lumel view of a closed room", [640, 480]) else {
        return;
    };
    let t = temp();
    let out = t.path().join("out");
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    bake(&assets.join("furnace_cube_50.glb"), &out, "").ok();
    let server = Server::start(&out);
    b.open(&server.1);
    settle(&mut b);
    let within =
        |b: &mut Browser| b.eval("lumel.stage.box.containsPoint(lumel.stage.camera.position)");
    let names = "[...document.querySelectorAll('#cameras option')].map((o) => o.textContent)";
    assert_eq!(b.eval(names), json!(["inside", "outside"]));
    assert_eq!(within(&mut b), json!(true));
    // From outside all corners must be on the canvas.
    b.eval("{ const c = document.getElementById('cameras'); c.value = '-1'; c.dispatchEvent(new Event('change')); }");
    settle(&mut b);
    assert_eq!(within(&mut b), json!(false));
    let corners = "(() => { const { min, max } = lumel.stage.box; const c = lumel.stage.canvas.getBoundingClientRect(); \
         return [0, 1, 2, 3, 4, 5, 6, 7].every((i) => { const [x, y] = lumel.project(i & 1 ? min.x : max.x, i & 2 ? min.y : max.y, i & 4 ? min.z : max.z); \
         return x >= c.left && x <= c.right && y >= c.top && y <= c.bottom; }); })()";
    assert_eq!(b.eval(corners), json!(true));
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn a_bake_made_anew_is_shown_without_a_reload() {
    let Some(mut b) = Browser::start("lumel view of a new bake", [640, 480]) else {
        return;
    };
    let (t, out) = squares("");
    let server = Server::start(&out);
    b.open(&format!("{}#tone=values&panel=0&cam={ABOVE}", server.1));
    settle(&mut b);
    bake(
        &t.path().join("four squares #1.gltf"),
        &out,
        &format!("--no-stitch --sun {} --light sun=0.5", sun()),
    )
    .ok();
    let at = points()[0].0;
    b.wait("lumel.opened() === 2");
    settle(&mut b);
    let picture = b.screenshot();
    assert_pixel(
        pixel(&mut b, &picture, at),
        times(ALBEDO, 0.5 * R),
        "half the sun",
    );
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn the_viewer_starts_with_the_exposure_that_the_bake_suggests() {
    let Some(mut b) = Browser::start("lumel view's exposure", [640, 480]) else {
        return;
    };
    let (_t, out) = squares("--light sun=40000");
    let manifest = std::fs::read(out.join("four squares #1.lightmap.json")).expect("it is written");
    let exposure = parse(manifest)["exposure"].as_f64().expect("a number");
    let server = Server::start(&out);
    // The same pixels as in engines, which tests/engines.rs holds against the same numbers.
    b.open(&format!("{}#tone=linear&panel=0&cam={ABOVE}", server.1));
    settle(&mut b);
    let picture = b.screenshot();
    for (at, albedo, r) in points().into_iter().take(5) {
        let found = pixel(&mut b, &picture, at);
        assert_pixel(found, times(albedo, 4e4 * r * exposure), &format!("{at:?}"));
    }
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn three_js_shows_closed_form_pixels_through_the_loader() {
    let Some(mut b) = Browser::start("three.js with tools/engines/three", [640, 480]) else {
        return;
    };
    let (_t, out) = squares("");
    let site = Site::start(&out);
    // Lambertian materials are exact. The file's own MeshStandardMaterial turns part of the light
    // into a specular lobe: docs/engines/three.md.
    for options in ["diffuse=1", "diffuse=1&manifest=1", "diffuse=1&plugin=1"] {
        for (cam, range) in [(ABOVE, 0..5), (BESIDE, 2..6)] {
            b.open("about:blank");
            b.open(&format!(
                "{}/engines/index.html?glb={}&exposure=1&cam={cam}&{options}",
                site.url, "/bake/four%2520squares%2520%25231.glb"
            ));
            b.wait("document.body?.dataset.state");
            assert_eq!(
                b.eval("document.body.dataset.state"),
                json!("ready"),
                "{}",
                b.eval("document.body.innerText")
            );
            let picture = b.screenshot();
            for (at, albedo, r) in points().into_iter().take(range.end).skip(range.start) {
                let found = pixel(&mut b, &picture, at);
                assert_pixel(found, times(albedo, r), &format!("{options} {at:?}"));
            }
        }
    }
    assert_eq!(b.errors, [""; 0]);
}
