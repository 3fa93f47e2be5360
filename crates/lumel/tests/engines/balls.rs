//! Balls in the Cornell box that engines draw with the bake's probes and reflection captures: a
//! white one, whose light is known by formula, and a mirror.

use std::path::PathBuf;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::document;
use crate::common::quads::shown;
use crate::common::{asset, lumel, parse, temp, write};

/// The radiance of a white diffuse surface with the normal `n`, as docs/probes.md writes it.
pub(super) fn probe_diffuse(sh: &[[f64; 3]; 9], n: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = n;
    [0, 1, 2].map(|c| {
        let s = |k: usize| sh[k][c];
        (0.282095 * s(0)
            + 0.325735 * (s(1) * y + s(2) * z + s(3) * x)
            + 0.273137 * (s(4) * x * y + s(5) * y * z + s(7) * x * z)
            + 0.078848 * s(6) * (3.0 * z * z - 1.0)
            + 0.136569 * s(8) * (x * x - y * y))
            .max(0.0)
    })
}

/// The harmonics of a grid of probes.
pub(super) struct ProbeGrid {
    pub(super) file: Value,
}

impl ProbeGrid {
    pub(super) fn numbers(&self, key: &str) -> [f64; 3] {
        [0, 1, 2].map(|i| self.file["grid"][key][i].as_f64().expect("a number"))
    }

    fn probe(&self, index: [f64; 3]) -> [[f64; 3]; 9] {
        let [nx, ny, _] = self.numbers("dims");
        let at = (index[0] + nx * (index[1] + ny * index[2])) as usize;
        let sh = &self.file["probes"][at]["sh"];
        std::array::from_fn(|k| [0, 1, 2].map(|c| sh[k][c].as_f64().expect("a number")))
    }

    /// Trilinear between the eight probes around `at`.
    pub(super) fn around(&self, at: [f64; 3]) -> [[f64; 3]; 9] {
        let [origin, spacing, dims] = ["origin", "spacing", "dims"].map(|k| self.numbers(k));
        let place: [f64; 3] =
            std::array::from_fn(|i| ((at[i] - origin[i]) / spacing[i]).clamp(0.0, dims[i] - 1.0));
        let mut sum = [[0.0; 3]; 9];
        for corner in 0..8 {
            let far = [0, 1, 2].map(|i| f64::from((corner >> i) & 1));
            let index: [f64; 3] =
                std::array::from_fn(|i| (place[i].floor() + far[i]).min(dims[i] - 1.0));
            let weight: f64 = (0..3)
                .map(|i| 1.0 - (place[i] - place[i].floor() - far[i]).abs())
                .product();
            for (to, from) in sum
                .as_flattened_mut()
                .iter_mut()
                .zip(self.probe(index).as_flattened())
            {
                *to += weight * from;
            }
        }
        sum
    }
}

/// The Cornell box with probes at every metre.
pub(super) fn cornell_with_probes(options: &str) -> (TempDir, PathBuf, ProbeGrid) {
    let t = temp();
    let out = t.path().join("out");
    let file = asset("cornell_box.glb");
    let paths = [&file, &out].map(|p| p.to_str().expect("UTF-8"));
    let options = format!("--quality draft --texels-per-unit 16 --probes 1 {options}");
    let a = ["bake", paths[0], "-o", paths[1]];
    lumel(a.into_iter().chain(options.split_whitespace())).ok();
    let json = std::fs::read(out.join("cornell_box.probes.json")).expect("it is written");
    (t, out, ProbeGrid { file: parse(json) })
}

/// Place and radius of a white ball in the Cornell box, and normals that its camera sees.
pub(super) const BALL: ([f64; 3], f64) = ([2.9, 2.5, 2.6], 0.45);
pub(super) const BALL_CAMERA: &str = "2.78,2.73,-8,2.78,2.73,0,39";
pub(super) const NORMALS: [[f64; 3]; 5] = [
    [0.0, 0.0, -1.0],
    [0.6, 0.0, -0.8],
    [-0.6, 0.0, -0.8],
    [0.0, 0.6, -0.8],
    [0.0, -0.6, -0.8],
];

/// The radiance at a glTF direction of a cube map as the bake writes it: rgb9e5, left-handed, z
/// negated.
fn captured(file: &[u8], [x, y, z]: [f64; 3]) -> [f64; 3] {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes"));
    let (size, offset) = (word(20) as usize, word(80) as usize);
    let c = [x, y, -z];
    let most = c.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let [cx, cy, cz] = c;
    // Vulkan 1.3, table of cube map coordinates: face, s and t.
    let (face, s, t) = if cx.abs() == most {
        (usize::from(cx < 0.0), -cx.signum() * cz, -cy)
    } else if cy.abs() == most {
        (2 + usize::from(cy < 0.0), cx, cy.signum() * cz)
    } else {
        (4 + usize::from(cz < 0.0), cz.signum() * cx, -cy)
    };
    let texel = |v: f64| (((v / most + 1.0) * 0.5 * size as f64) as usize).min(size - 1);
    let packed = word(offset + 4 * ((face * size + texel(t)) * size + texel(s)));
    let scale = 2f64.powi((packed >> 27) as i32 - 24);
    [0, 9, 18].map(|shift| f64::from((packed >> shift) & 511) * scale)
}

/// Place and radius of a mirror ball in the Cornell box, and the eye that looks at it.
pub(super) const MIRROR: ([f64; 3], f64) = ([2.9, 2.5, 2.6], 0.6);
const MIRROR_EYE: [f64; 3] = [2.78, 2.73, -3.0];

pub(super) fn mirror_camera() -> String {
    let ([x, y, z], [ex, ey, ez]) = (MIRROR.0, MIRROR_EYE);
    format!("{ex},{ey},{ez},{x},{y},{z},39")
}

/// The Cornell box with a reflection capture at the mirror ball, as box.glb, and its cube map.
pub(super) fn cornell_with_capture() -> (TempDir, PathBuf, Vec<u8>) {
    let t = temp();
    let out = t.path().join("out");
    // A node with the mark, put into the .glb's JSON.
    let glb = std::fs::read(asset("cornell_box.glb")).expect("it is there");
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let mut json = document(&glb);
    let nodes = json["nodes"].as_array_mut().expect("nodes");
    let mark = nodes.len();
    nodes.push(json!({
        "name": "here", "translation": MIRROR.0, "extras": {"lumel": {"reflection": true}},
    }));
    let roots = json["scenes"][0]["nodes"].as_array_mut().expect("roots");
    roots.push(json!(mark));
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut marked = glb[..8].to_vec();
    let total = glb.len() - length + text.len();
    marked.extend((total as u32).to_le_bytes());
    marked.extend((text.len() as u32).to_le_bytes());
    marked.extend(&glb[16..20]);
    marked.extend(text);
    marked.extend(&glb[20 + length..]);
    let file = write(t.path().join("box.glb"), marked);
    let paths = [&file, &out].map(|p| p.to_str().expect("UTF-8"));
    let options = "--quality quick --texels-per-unit 8";
    let a = ["bake", paths[0], "-o", paths[1]];
    lumel(a.into_iter().chain(options.split(' '))).ok();
    let cube = std::fs::read(out.join("box.reflection.ktx2")).expect("it is written");
    (t, out, cube)
}

/// The mirror ball shows what the bake captured there; `pixel` gives the colour that the picture
/// has at a point.
#[track_caller]
pub(super) fn assert_mirror(cube: &[u8], mut pixel: impl FnMut([f64; 3]) -> [u8; 3]) {
    let (ball, radius) = MIRROR;
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let unit = |a: [f64; 3]| a.map(|v| v / dot(a, a).sqrt());
    // Normals that reflect the eye's rays onto the red and green walls, floor, ceiling and back.
    let mut seen = Vec::new();
    for n in [
        [0.6, 0.1, -0.8],
        [-0.6, 0.1, -0.8],
        [0.0, 0.7, -0.7],
        [0.1, -0.66, -0.75],
    ] {
        let n = unit(n);
        let on: [f64; 3] = std::array::from_fn(|i| ball[i] + radius * n[i]);
        let ray = unit(std::array::from_fn(|i| on[i] - MIRROR_EYE[i]));
        let reflected: [f64; 3] = std::array::from_fn(|i| ray[i] - 2.0 * dot(ray, n) * n[i]);
        // Engines filter texels, and the pixel's centre is not the point: what is captured within
        // two texels around gives the least and the most light there.
        let around = (0..27).map(|i| {
            let step = [i / 9, i / 3 % 3, i % 3].map(|s| (f64::from(s) - 1.0) * 0.03);
            captured(cube, unit(std::array::from_fn(|k| reflected[k] + step[k])))
        });
        let around: Vec<[f64; 3]> = around.map(|c| c.map(shown)).collect();
        let found = pixel(on);
        for (i, f) in found.into_iter().enumerate() {
            let all = around.iter().map(|c| c[i]);
            let (least, most) = all.fold((255.0, 0.0), |(a, b), x| (x.min(a), x.max(b)));
            let off = 3.0; // steps of rgb9e5, half floats and the picture's own
            assert!(
                (least - off..=most + off).contains(&f64::from(f)),
                "{n:?}: {found:?} is not within {least:.1} and {most:.1}"
            );
        }
        seen.push(found);
    }
    // The mirror shows the red wall on one side and the green one on the other.
    let redness = |p: [u8; 3]| i32::from(p[0]) - i32::from(p[1]);
    assert!(redness(seen[0]) * redness(seen[1]) < 0, "{seen:?}");
}
