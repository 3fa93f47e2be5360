//! The written glTF files, read like an engine does: JSON, accessors, extras; none of Lumel's own
//! types.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;

use crate::common::{at, bake};
use glam::{DVec2, DVec3, Quat, Vec3};
use lumel::atlas_bake::{ExrImage, read_exr};
use lumel::{Quality, Settings, ValueKind};
use lumel_tests::geometry::{Geometry, cuboid, grid};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use lumel_tests::scenes::{self, closed_form};
use serde_json::Value;

/// A GLB's JSON and binary chunk.
struct Glb {
    doc: Value,
    bin: Vec<u8>,
}

impl Glb {
    fn parse(bytes: &[u8]) -> Glb {
        let word =
            |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4")) as usize;
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!(word(8), bytes.len(), "the length in the header");
        let end = 20 + word(12);
        Glb {
            doc: serde_json::from_slice(&bytes[20..end]).expect("JSON"),
            bin: bytes.get(end + 8..).unwrap_or_default().to_vec(),
        }
    }

    fn open(path: &Path) -> Glb {
        Glb::parse(&std::fs::read(path).expect("a GLB"))
    }

    fn list(&self, key: &str) -> &[Value] {
        self.doc[key].as_array().map_or(&[], Vec::as_slice)
    }

    /// An accessor's elements: floats, normalised u16, or indices.
    fn read(&self, accessor: &Value) -> Vec<Vec<f64>> {
        let a = &self.doc["accessors"][accessor.as_u64().expect("an accessor") as usize];
        let view = &self.doc["bufferViews"][a["bufferView"].as_u64().expect("a view") as usize];
        let parts = match a["type"].as_str().expect("a type") {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => panic!("{other}"),
        };
        let (size, scale) = match a["componentType"].as_u64() {
            Some(5126) => (4, 1.0),
            Some(5125) => (4, 1.0),
            Some(5123) if a["normalized"] == true => (2, 1.0 / 65535.0),
            Some(5123) => (2, 1.0),
            other => panic!("component type {other:?}"),
        };
        let number = |v: &Value| v.as_u64().unwrap_or(0) as usize;
        let base = number(&view["byteOffset"]) + number(&a["byteOffset"]);
        let stride = match number(&view["byteStride"]) {
            0 => size * parts,
            s => s,
        };
        (0..number(&a["count"]))
            .map(|i| {
                (0..parts)
                    .map(|k| {
                        let at = base + i * stride + k * size;
                        let b = &self.bin[at..at + size];
                        match a["componentType"].as_u64() {
                            Some(5126) => {
                                f64::from(f32::from_le_bytes(b.try_into().expect("4 bytes")))
                            }
                            Some(5125) => {
                                f64::from(u32::from_le_bytes(b.try_into().expect("4 bytes")))
                            }
                            _ => {
                                f64::from(u16::from_le_bytes(b.try_into().expect("2 bytes")))
                                    * scale
                            }
                        }
                    })
                    .collect()
            })
            .collect()
    }
}

/// Bilinear, row 0 at v = 0, texel centres at half numbers, as every engine samples.
fn sample(page: &ExrImage, uv: DVec2) -> f64 {
    let r = page.channel("R").expect("R");
    let (w, h) = (page.width as i64, page.height as i64);
    let p = uv * DVec2::new(w as f64, h as f64) - 0.5;
    let (c, f) = (p.floor(), p - p.floor());
    let at = |dx: i64, dy: i64| {
        let x = (c.x as i64 + dx).clamp(0, w - 1);
        let y = (c.y as i64 + dy).clamp(0, h - 1);
        f64::from(r[(y * w + x) as usize])
    };
    let row = |dy| at(0, dy) * (1.0 - f.x) + at(1, dy) * f.x;
    row(0) * (1.0 - f.y) + row(1) * f.y
}

/// Three instances of one floor, one of them rotated, each with a lamp off its middle, so that no
/// symmetry hides a flip or a swap.
fn three_floors() -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let g = grid(Vec3::new(-1.0, 0.0, 0.5), Vec3::X * 2.0, -Vec3::Z, [2, 1]).bare();
    let mesh = b.mesh("floor", &[(&g, black)]);
    for (i, turn) in [0.0, 1.1, 0.0].into_iter().enumerate() {
        b.node(Node {
            name: format!("floor{i}"),
            translation: Vec3::X * 8.0 * i as f32,
            rotation: Quat::from_rotation_y(turn),
            mesh: Some(mesh),
            ..Node::default()
        });
    }
    let lamp = b.light("lamp", Light::Point([4.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: Vec3::new(0.6, 1.0, 0.2),
        light: Some(lamp),
        ..Node::default()
    });
    b.finish()
}

#[test]
fn an_engine_that_follows_extras_and_texcoord_1_sees_the_right_light() {
    let dir = tempfile::tempdir().expect("a folder");
    for (value, unit) in [(ValueKind::Radiance, PI), (ValueKind::Irradiance, 1.0)] {
        let settings = Settings { value, ..at(24.0) };
        bake(&three_floors(), &settings)
            .write(dir.path())
            .expect("written");
        let glb = Glb::open(&dir.path().join("scene.glb"));
        let mut compared = 0;
        for node in glb.list("nodes") {
            let Some(mesh) = node["mesh"].as_u64() else {
                continue;
            };
            let map = &node["extras"]["lightmap"];
            assert_eq!(map["texCoord"], 1);
            let to_irradiance = map["scaleToIrradiance"].as_f64().expect("a factor");
            assert!((to_irradiance - unit).abs() < 1e-12);
            let pair = |key: &str| {
                DVec2::new(
                    map[key][0].as_f64().expect("a number"),
                    map[key][1].as_f64().expect("a number"),
                )
            };
            let (offset, scale) = (pair("offset"), pair("scale"));
            let page =
                read_exr(&dir.path().join(map["uri"].as_str().expect("a uri"))).expect("EXR");
            let q: Vec<f32> = match node["rotation"].as_array() {
                Some(r) => r
                    .iter()
                    .map(|x| x.as_f64().expect("a number") as f32)
                    .collect(),
                None => vec![0.0, 0.0, 0.0, 1.0],
            };
            let turn = Quat::from_slice(&q).as_dquat();
            let shift = node["translation"][0].as_f64().unwrap_or(0.0);
            let primitive = &glb.doc["meshes"][mesh as usize]["primitives"][0];
            let positions = glb.read(&primitive["attributes"]["POSITION"]);
            let uvs = glb.read(&primitive["attributes"]["TEXCOORD_1"]);
            assert_eq!(positions.len(), uvs.len());
            let indices: Vec<usize> = glb
                .read(&primitive["indices"])
                .iter()
                .map(|i| i[0] as usize)
                .collect();
            for t in indices.chunks(3) {
                for (u, v) in [(0.2, 0.2), (0.6, 0.2), (0.2, 0.6), (0.34, 0.33)] {
                    let mix = |of: &dyn Fn(usize) -> DVec3| {
                        of(t[0]) * (1.0 - u - v) + of(t[1]) * u + of(t[2]) * v
                    };
                    let p = turn * mix(&|i| DVec3::from_slice(&positions[i])) + DVec3::X * shift;
                    let uv = mix(&|i| DVec3::new(uvs[i][0], uvs[i][1], 0.0)).truncate();
                    let got = sample(&page, uv * scale + offset) * to_irradiance;
                    let exact =
                        closed_form::point_irradiance(4.0, 1.0, (p.x - 0.6).hypot(p.z - 0.2));
                    // Bilinear interpolation over texels of h = 4 cm of a function that bends at 1
                    // m: h²/8·E'' = 2e-4·3 E at most; means over lumels as much again; 16 points
                    // per lumel 3e-3 (closed_forms.rs); half floats 5e-4. The far floors are dim,
                    // but not less exact.
                    assert!((got / exact - 1.0).abs() < 6e-3, "{p}: {got} {exact}");
                    compared += 1;
                }
            }
        }
        assert_eq!(compared, 3 * 4 * 4);
    }
}

#[test]
fn instances_share_their_mesh_and_the_manifest_says_what_the_extras_say() {
    let input = scenes::demo_level();
    let settings = Settings {
        quality: Quality::Draft,
        max_page: 128,
        // A node that is cut gets a mesh of its own.
        cut_charts: false,
        ..at(2.0)
    };
    let dir = tempfile::tempdir().expect("a folder");
    let b = bake(&input, &settings);
    b.write(dir.path()).expect("written");
    assert!(b.layout.pages.len() > 1, "one page would test little");
    let before = Glb::parse(&input);
    let after = Glb::open(&dir.path().join("scene.glb"));
    // The same scene graph: names, meshes, cameras, lights.
    assert_eq!(before.list("nodes").len(), after.list("nodes").len());
    for (x, y) in before.list("nodes").iter().zip(after.list("nodes")) {
        for key in [
            "name",
            "mesh",
            "camera",
            "translation",
            "rotation",
            "scale",
            "children",
            "extensions",
        ] {
            assert_eq!(x[key], y[key], "{key} of {}", x["name"]);
        }
    }
    assert_eq!(before.list("meshes").len(), after.list("meshes").len());
    assert_eq!(before.doc["cameras"], after.doc["cameras"]);
    assert_eq!(before.doc["extensions"], after.doc["extensions"]);
    // The manifest, by node.
    let text = std::fs::read(dir.path().join("scene.lightmap.json")).expect("a manifest");
    let manifest: Value = serde_json::from_slice(&text).expect("JSON");
    let pages = manifest["pages"].as_array().expect("pages");
    assert_eq!(pages.len(), b.layout.pages.len());
    let by_node: BTreeMap<u64, &Value> = manifest["nodes"]
        .as_array()
        .expect("nodes")
        .iter()
        .map(|n| (n["node"].as_u64().expect("an index"), n))
        .collect();
    let mut used: Vec<Vec<bool>> = b
        .layout
        .pages
        .iter()
        .map(|[w, h]| vec![false; (w * h) as usize])
        .collect();
    let mut users = BTreeMap::new();
    for (i, node) in after.list("nodes").iter().enumerate() {
        let Some(mesh) = node["mesh"].as_u64() else {
            assert!(node["extras"]["lightmap"].is_null());
            continue;
        };
        *users.entry(mesh).or_insert(0) += 1;
        let (extra, entry) = (&node["extras"]["lightmap"], by_node[&(i as u64)]);
        for key in ["page", "offset", "scale"] {
            assert_eq!(extra[key], entry[key], "{key} of node {i}");
        }
        let page = extra["page"].as_u64().expect("a page") as usize;
        assert_eq!(extra["uri"], pages[page]["uri"]);
        assert!(
            dir.path()
                .join(extra["uri"].as_str().expect("a name"))
                .is_file()
        );
        // The rectangle matches offset and scale, is on the page, and belongs to this node alone.
        let [w, h] = b.layout.pages[page];
        let r = ["x", "y", "w", "h"].map(|k| entry["rect"][k].as_u64().expect("a number") as u32);
        assert!(r[0] + r[2] <= w && r[1] + r[3] <= h, "{r:?} on {w} x {h}");
        assert_eq!(
            entry["scale"][0].as_f64(),
            Some(f64::from(r[2]) / f64::from(w))
        );
        assert_eq!(
            entry["offset"][1].as_f64(),
            Some(f64::from(r[1]) / f64::from(h))
        );
        for y in r[1]..r[1] + r[3] {
            for x in r[0]..r[0] + r[2] {
                let slot = &mut used[page][(y * w + x) as usize];
                assert!(
                    !std::mem::replace(slot, true),
                    "two nodes share texel {x}, {y}"
                );
            }
        }
    }
    assert_eq!(by_node.len(), users.values().sum::<usize>());
    assert!(
        users.values().any(|n| *n > 4),
        "no mesh is shared: {users:?}"
    );
    for mesh in after.list("meshes") {
        for primitive in mesh["primitives"].as_array().expect("primitives") {
            let at = &primitive["attributes"];
            assert!(!at["TEXCOORD_0"].is_null(), "sets are consecutive");
            let uv = after.read(&at["TEXCOORD_1"]);
            assert_eq!(uv.len(), after.read(&at["POSITION"]).len());
            assert!(
                uv.iter().flatten().all(|x| (0.0..=1.0).contains(x)),
                "{}",
                mesh["name"]
            );
        }
    }
}

#[test]
fn vertex_colours_are_normalised_and_irradiance_is_there() {
    let dir = tempfile::tempdir().expect("a folder");
    // One lux straight down on a reflectance of 0.8.
    bake(&closed_form::one_triangle(), &at(8.0))
        .write(dir.path())
        .expect("written");
    let glb = Glb::open(&dir.path().join("scene.vertex.glb"));
    let scale = glb.doc["asset"]["extras"]["vertexLight"]["scale"]
        .as_f64()
        .expect("a scale");
    let primitive = &glb.list("meshes")[0]["primitives"][0];
    let color = &primitive["attributes"]["COLOR_0"];
    let accessor = &glb.doc["accessors"][color.as_u64().expect("an accessor") as usize];
    assert_eq!(accessor["componentType"], 5123);
    assert_eq!(accessor["normalized"], true);
    let irradiance = glb.read(&primitive["attributes"]["_IRRADIANCE"]);
    assert_eq!(irradiance.len(), 3);
    for (c, e) in glb.read(color).iter().zip(&irradiance) {
        for k in 0..3 {
            assert!((e[k] - 1.0).abs() < 1e-5, "{e:?}"); // no sampling in it: f32
            // COLOR_0 × base colour × scale is the radiance ρE/π; a step of u16 is 1.5e-5 of the
            // scale.
            assert!(
                (c[k] * scale - 1.0 / PI).abs() < 2e-5 * scale,
                "{c:?} × {scale}"
            );
        }
    }
    let material = &glb.list("materials")[primitive["material"].as_u64().expect("one") as usize];
    assert!(!material["extensions"]["KHR_materials_unlit"].is_null());
}

#[test]
fn reports_are_equal_but_for_what_is_measured() {
    let glb = scenes::cornell_box();
    let settings = Settings {
        quality: Quality::Draft,
        ..at(6.0)
    };
    let files = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| {
            let (mut files, _) = bake(&glb, &settings).files().expect("files");
            let report = files.last_mut().expect("the report");
            let mut json: Value = serde_json::from_slice(&report.1).expect("JSON");
            json.as_object_mut().expect("an object").remove("measured");
            report.1 = json.to_string().into_bytes();
            files
        })
    };
    let reference = files(1);
    let names: Vec<&str> = reference.iter().map(|f| f.0.as_str()).collect();
    assert_eq!(
        names,
        [
            "scene.lightmap.exr",
            "scene.glb",
            "scene.vertex.glb",
            "scene.lightmap.json",
            "scene.report.json"
        ]
    );
    for threads in [1, 2, 2, 3] {
        for (a, b) in reference.iter().zip(files(threads)) {
            assert!(*a == b, "{} differs with {threads} threads", a.0);
        }
    }
}

/// An L of a floor and a wall with a step on it, which is not its own mirror image.
fn corner() -> Geometry {
    let floor = grid(Vec3::ZERO, Vec3::Z, Vec3::X * 2.0, [1, 1]);
    let wall = grid(Vec3::ZERO, Vec3::Y, Vec3::Z, [1, 1]);
    let step = cuboid(Vec3::new(0.5, 0.0, 0.3), Vec3::new(1.0, 0.4, 0.6), 1);
    Geometry::union(&[floor, wall, step]).bare()
}

#[test]
fn a_mirrored_instance_is_lit_as_its_original_is() {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let mesh = b.mesh("corner", &[(&corner(), grey)]);
    for (name, x) in [("plain", 1.0), ("mirrored", -1.0)] {
        b.node(Node {
            name: name.into(),
            translation: Vec3::X * 4.0 * x,
            scale: Vec3::new(x, 1.0, 1.0),
            mesh: Some(mesh),
            ..Node::default()
        });
    }
    let lamp = b.light("lamp", Light::Point([20.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: Vec3::new(0.0, 3.0, 2.0),
        light: Some(lamp),
        ..Node::default()
    });
    for x in [6.0, -6.0] {
        // One more on each side, where it lights the inside of the corner.
        b.node(Node {
            name: "side".into(),
            translation: Vec3::new(x, 1.5, 0.8),
            light: Some(lamp),
            ..Node::default()
        });
    }
    let bake = bake(&b.finish(), &at(16.0));
    let page = &bake.baked.pages[0];
    let [a, m] = [0, 1].map(|i| bake.layout.placements[i]);
    assert_eq!((a.page, m.page), (0, 0));
    assert_eq!((a.rect.w, a.rect.h), (m.rect.w, m.rect.h));
    let (mut difference, mut sum, mut largest) = (0.0, 0.0, 0f64);
    for y in 0..a.rect.h {
        for x in 0..a.rect.w {
            let at = |r: lumel::atlas::Rect| ((r.y + y) * page.width + r.x + x) as usize;
            let (i, j) = (at(a.rect), at(m.rect));
            assert!((page.coverage[i] - page.coverage[j]).abs() < 1e-3);
            let weight = f64::from(page.coverage[i]);
            let (p, q) = (f64::from(page.value[i][0]), f64::from(page.value[j][0]));
            difference += weight * (p - q).abs();
            sum += weight * p;
            largest = largest.max(weight * p);
        }
    }
    // Different random points on the two sides: preview's noise is about 1 % of lumels in the open,
    // more at shadow edges.
    assert!(difference < 0.01 * sum, "{}", difference / sum);
    assert!(largest > 0.5, "it is lit: {largest}");
}
