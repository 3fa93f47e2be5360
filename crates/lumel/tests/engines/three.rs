//! three.js in Chromium: its own page, React Three Fiber, and the types of the npm package.

use std::path::{Path, PathBuf};
use std::process::Command;

use lumel::atlas_bake::read_exr;
use serde_json::json;

use super::balls::{
    BALL, BALL_CAMERA, MIRROR, NORMALS, assert_mirror, cornell_with_capture, cornell_with_probes,
    mirror_camera, probe_diffuse,
};
use super::{
    STEM, VIEWS, assert_pixel, bake_scene, has_bc6h, installed, look, look_exposed, scene_with_sun,
    squares, squares_times, squares_with_mask, srgb,
};
use crate::common::browser::Browser;
use crate::common::quads::{ALBEDO, R};
use crate::common::site::{Site, npm_modules};
use crate::common::{temp, write};

#[test]
fn three_js_shows_ktx2_pages() {
    for (options, share) in [
        // Half a step of rgb9e5 is 2^-9 of the largest channel. For BC6H it is relative to the
        // block, and all blocks but those at the shadow are uniform.
        ("--ktx2 rgb9e5", 1.0 / 512.0),
        ("--ktx2 bc6h --block-charts", 1.0 / 512.0),
    ] {
        let Some(mut b) = Browser::start("three.js with KTX2", [640, 480]) else {
            return;
        };
        let (_t, out) = squares(options);
        let site = Site::start(&out);
        if options.contains("bc6h") && !has_bc6h(&mut b, &site, "three.js") {
            return;
        }
        look(
            &mut b,
            &site,
            "/engines/index.html",
            "diffuse=1&ktx2=1",
            &srgb(share),
        );
        assert_eq!(b.errors, [""; 0]);
    }
}

#[test]
fn three_js_adds_mixed_lamps_through_shadow_masks() {
    for (options, query) in [("", "diffuse=1"), ("--ktx2 rgb9e5", "diffuse=1&ktx2=1")] {
        let Some(mut b) = Browser::start("three.js with shadow masks", [640, 480]) else {
            return;
        };
        let (_t, out) = squares_with_mask(options);
        // Without the sun's direct light, the page has no light here.
        let page = read_exr(&out.join(format!("{STEM}.lightmap.exr"))).expect("a page");
        let all = ["R", "G", "B"].map(|c| page.channel(c).expect("a channel").to_vec());
        let most = all.into_iter().flatten().fold(0.0, f32::max);
        assert!(most < 0.05 * R as f32, "{most}");
        let site = Site::start(&out);
        // Bounces between the squares are below a step of 255; the mask is exact away from edges.
        look(
            &mut b,
            &site,
            "/engines/index.html",
            query,
            &srgb(1.0 / 128.0),
        );
        assert_eq!(b.errors, [""; 0]);
    }
}

/// A mixed spot projects its picture: on the floor under it, each quarter has the colour of its
/// quarter of the picture, with +Y of the node at the top.
#[test]
fn three_js_projects_cookies_of_mixed_spots() {
    let Some(mut b) = Browser::start("three.js with cookies", [640, 480]) else {
        return;
    };
    let quarters: [[u8; 3]; 4] = [[255, 60, 60], [60, 255, 60], [60, 60, 255], [255, 255, 60]];
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_fn(64, 64, |x, y| {
        image::Rgb(quarters[usize::from(x >= 32) + 2 * usize::from(y >= 32)])
    })
    .write_to(&mut png, image::ImageFormat::Png)
    .expect("a picture");
    use base64::Engine;
    let png = base64::engine::general_purpose::STANDARD.encode(png.into_inner());
    let mut scene = scene_with_sun();
    scene["images"] = json!([{"uri": format!("data:image/png;base64,{png}")}]);
    scene["textures"] = json!([{"source": 0}]);
    // Over the square at x = -4, looking down; +Y of the node is −X of the world.
    let (height, candela) = (2.0, 4.0);
    scene["nodes"][4]["translation"] = json!([-4.0, height, 0.0]);
    scene["nodes"][4]["rotation"] = json!([-0.5, 0.5, 0.5, 0.5]);
    scene["extensions"]["KHR_lights_punctual"]["lights"] = json!([{
        "type": "spot", "intensity": candela,
        "spot": {"innerConeAngle": 0.6, "outerConeAngle": 0.7},
        "extras": {"lumel": {"cookie": 0}},
    }]);
    for mode in ["", "--mode shadowmask"] {
        let (_t, out) = bake_scene(&scene, mode);
        let site = Site::start(&out);
        b.open("about:blank");
        b.open(&format!(
            "{}/engines/index.html?glb=/bake/four%2520squares%2520%25231.glb&cam={}&diffuse=1&exposure=1",
            site.url, VIEWS[0].0
        ));
        b.wait("document.body?.dataset.state");
        let picture = b.screenshot();
        // The picture's right is +X of the node, −Z of the world; its top −X.
        for (i, quarter) in quarters.into_iter().enumerate() {
            let right = if i % 2 == 1 { -0.4 } else { 0.4 };
            let down = if i >= 2 { 0.4 } else { -0.4 };
            let at = [-4.0 + down, 0.0, right];
            let square: f64 = height * height + 0.32;
            let r = candela * height / square.powf(1.5) / std::f64::consts::PI;
            let linear: [f64; 3] = std::array::from_fn(|c| {
                let v = f64::from(quarter[c]) / 255.0;
                let v = if v <= 0.04045 {
                    v / 12.92
                } else {
                    ((v + 0.055) / 1.055).powf(2.4)
                };
                ALBEDO[c] * r * v
            });
            let place = b.eval(&format!("lumel.project({}, {}, {})", at[0], at[1], at[2]));
            let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
            let found = picture.get_pixel(x as u32, y as u32).0;
            // A pixel is 3 cm wide, of which the light changes by up to 1 %.
            assert_pixel(found, linear, &srgb(0.02), &format!("{mode} {i}"));
        }
    }
    assert_eq!(b.errors, [""; 0]);
}

/// A white ball in the Cornell box: each of its points shows R = E/π of the probes, and the walls
/// show their lightmap only.
#[test]
fn three_js_lights_moving_objects_by_probes() {
    let Some(mut b) = Browser::start("three.js with probes", [640, 480]) else {
        return;
    };
    let (_t, out, grid) = cornell_with_probes("");
    let site = Site::start(&out);
    let (ball, radius) = BALL;
    let nearest = (0..grid.file["probes"].as_array().expect("probes").len())
        .min_by(|i, j| {
            let far = |k: &usize| -> f64 {
                let at = &grid.file["probes"][*k]["position"];
                (0..3)
                    .map(|i| (at[i].as_f64().expect("a number") - ball[i]).powi(2))
                    .sum()
            };
            far(i).total_cmp(&far(j))
        })
        .expect("a probe");
    let nearest = std::array::from_fn(|k| {
        [0, 1, 2].map(|c| {
            grid.file["probes"][nearest]["sh"][k][c]
                .as_f64()
                .expect("a number")
        })
    });
    let spacing = grid.numbers("spacing");
    let exposure = 0.5;
    let mut walls = Vec::new();
    for probes in ["one", "grid", "none"] {
        let place = if probes == "none" {
            String::new()
        } else {
            format!(
                "&ball={},{},{},{radius}&probes={probes}",
                ball[0], ball[1], ball[2]
            )
        };
        let cam = BALL_CAMERA;
        b.open("about:blank");
        b.open(&format!(
            "{}/engines/index.html?glb=/bake/cornell_box.glb&diffuse=1&exposure={exposure}&cam={cam}{place}",
            site.url
        ));
        b.wait("document.body?.dataset.state");
        let said = b.eval("document.body.innerText");
        assert_eq!(
            b.eval("document.body.dataset.state"),
            json!("ready"),
            "{said} {:?}",
            b.errors
        );
        let picture = b.screenshot();
        let mut pixel = |at: [f64; 3]| {
            let place = b.eval(&format!("lumel.project({}, {}, {})", at[0], at[1], at[2]));
            let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
            picture.get_pixel(x as u32, y as u32).0
        };
        walls.push([[0.02, 4.0, 2.8], [5.52, 4.0, 2.8], [2.8, 4.6, 5.59]].map(&mut pixel));
        if probes == "none" {
            continue;
        }
        for n in NORMALS {
            let on: [f64; 3] = std::array::from_fn(|i| ball[i] + radius * n[i]);
            // three.js reads half a cell in front of the surface.
            let before = std::array::from_fn(|i| on[i] + 0.5 * spacing[i] * n[i]);
            let sh = if probes == "one" {
                nearest
            } else {
                grid.around(before)
            };
            let shown = probe_diffuse(&sh, n).map(|r| r * exposure);
            // Harmonics are halves; a pixel's normal is up to 1 degree from n.
            assert_pixel(pixel(on), shown, &srgb(0.02), &format!("{probes} {n:?}"));
        }
    }
    assert_eq!(walls[0], walls[2]);
    assert_eq!(walls[1], walls[2]);
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn three_js_shows_reflection_captures() {
    let Some(mut b) = Browser::start("three.js with reflections", [640, 480]) else {
        return;
    };
    let (_t, out, cube) = cornell_with_capture();
    let site = Site::start(&out);
    let ([x, y, z], radius) = MIRROR;
    b.open(&format!(
        "{}/engines/index.html?glb=/bake/box.glb&exposure=1&metal=0&ball={x},{y},{z},{radius}&cam={}",
        site.url,
        mirror_camera()
    ));
    b.wait("document.body?.dataset.state");
    let said = b.eval("document.body.innerText");
    assert_eq!(
        b.eval("document.body.dataset.state"),
        json!("ready"),
        "{said} {:?}",
        b.errors
    );
    let picture = b.screenshot();
    assert_mirror(&cube, |on| {
        let place = b.eval(&format!("lumel.project({}, {}, {})", on[0], on[1], on[2]));
        let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
        picture.get_pixel(x as u32, y as u32).0
    });
    assert_eq!(b.errors, [""; 0]);
}

/// The React Three Fiber example, bundled as its package.json says, with packages of `LUMEL_NPM`.
/// Prints a message if that is impossible.
fn react_example() -> Option<PathBuf> {
    let packages = [
        "esbuild",
        "react",
        "react-dom",
        "@react-three/fiber",
        "three",
    ];
    if !installed("React Three Fiber", &packages) {
        return None;
    }
    let bundle = temp().keep();
    let folder =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/engines/three/react-example");
    let page = std::fs::read(folder.join("index.html")).expect("it is there");
    write(bundle.join("index.html"), page);
    let run = Command::new(npm_modules().join(".bin/esbuild"))
        .arg(folder.join("main.jsx"))
        .args([
            "--bundle",
            "--format=esm",
            "--jsx=automatic",
            "--log-level=error",
        ])
        .arg(format!(
            "--alias:lumel-three/react={}",
            folder.join("../lumel-react.js").display()
        ))
        .arg(format!("--outfile={}", bundle.join("bundle.js").display()))
        .env("NODE_PATH", npm_modules())
        .status()
        .expect("esbuild starts");
    assert!(run.success());
    Some(bundle)
}

#[test]
fn react_three_fiber_shows_closed_form_pixels() {
    let Some(mut b) = Browser::start("React Three Fiber", [640, 480]) else {
        return;
    };
    let Some(example) = react_example() else {
        return;
    };
    let (_t, out) = squares("");
    let site = Site::start_with(&out, Some(("/react/", &example)));
    look(&mut b, &site, "/react/index.html", "diffuse=1", &srgb(0.0));
    let (_t, out, exposure) = squares_times(4e4, "");
    let site = Site::start_with(&out, Some(("/react/", &example)));
    let (page, light) = ("/react/index.html", 4e4 * exposure);
    look_exposed(&mut b, &site, page, "diffuse=1", &srgb(1.0 / 512.0), light);
    // React Three Fiber 9.8 itself uses what three.js r187 deprecates.
    b.errors.retain(|e| !e.contains("THREE.Clock"));
    assert_eq!(b.errors, [""; 0]);
    let _ = std::fs::remove_dir_all(example);
}

/// Checks the types of the npm package against those of three.js and React.
#[test]
fn types_of_the_npm_package_hold() {
    let packages = [
        "typescript",
        "@types/three",
        "@types/react",
        "@react-three/fiber",
    ];
    if !installed("types of lumel-three", &packages) {
        return;
    }
    let t = temp();
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/engines/three");
    for name in ["lumel-lightmap.d.ts", "lumel-react.d.ts"] {
        std::fs::copy(package.join(name), t.path().join(name)).expect("copied");
    }
    let user = "import { useLumelLevel, LumelLevel } from './lumel-react.js';
        import { attachLightmaps } from './lumel-lightmap.js';
        const exposure: number = useLumelLevel('a.glb', { ktx2: true }).userData.lumel.exposure;
        attachLightmaps(useLumelLevel('a.glb'), { exposure }).then((a) => a.exposure.toFixed());
        useLumelLevel.preload('a.glb');
        export const level = <LumelLevel url='a.glb' diffuse position={[0, 1, 0]} />;";
    let file = write(t.path().join("user.tsx"), user);
    let bad = write(
        t.path().join("bad.tsx"),
        "import { LumelLevel } from './lumel-react.js'; export const level = <LumelLevel url={3} />;",
    );
    std::os::unix::fs::symlink(npm_modules(), t.path().join("node_modules")).expect("linked");
    let check = |file: &Path| {
        Command::new(npm_modules().join(".bin/tsc"))
            .args([
                "--noEmit",
                "--strict",
                "--skipLibCheck",
                "--jsx",
                "react-jsx",
            ])
            .args([
                "--module",
                "esnext",
                "--moduleResolution",
                "bundler",
                "--target",
                "es2022",
            ])
            .arg(file)
            .current_dir(t.path())
            .output()
            .expect("tsc starts")
    };
    let run = check(&file);
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stdout)
    );
    assert!(!check(&bad).status.success());
}

#[test]
fn three_js_shows_moz_lightmap() {
    let Some(mut b) = Browser::start("three.js with MOZ_lightmap", [640, 480]) else {
        return;
    };
    let (_t, out) = squares("--ext moz");
    let site = Site::start(&out);
    // PNG is off by half a step of 255 of the page's largest value, which these squares have; RGBE
    // is more accurate.
    for query in ["diffuse=1&moz=1", "diffuse=1&moz=png", "diffuse=1"] {
        look(
            &mut b,
            &site,
            "/engines/index.html",
            query,
            &srgb(1.0 / 255.0),
        );
    }
    assert_eq!(b.errors, [""; 0]);
}
