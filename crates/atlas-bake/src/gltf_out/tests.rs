//! Whole documents through both writers.

use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::path::PathBuf;

use gather::{SplitPrimitive, VertexLight};
use glam::Vec2;
use mesh_ingest::{LoadOptions, Loaded, Scene, load};
use serde_json::{Value, json};

use super::nodes::by_node;
use super::*;
use crate::manifest::ValueKind;
use atlas::{Layout, MeshAtlas, Placement, PrimitiveAtlas, Rect};

mod moz;
mod vertex;

/// A folder with documents in it.
struct Fixture(tempfile::TempDir);

impl Fixture {
    fn new() -> Fixture {
        Fixture(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn load(&self, json: &Value, bin: &[u8]) -> Loaded {
        let path = self.path("in.glb");
        std::fs::write(
            &path,
            glb::assemble(json.as_object().unwrap(), bin).unwrap(),
        )
        .unwrap();
        load(&path, &LoadOptions::default()).unwrap()
    }

    fn reload(&self, glb: &[u8]) -> Loaded {
        let path = self.path("out.glb");
        std::fs::write(&path, glb).unwrap();
        load(&path, &LoadOptions::default()).unwrap()
    }
}

/// Packs accessors one after another.
#[derive(Default)]
struct Builder {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Builder {
    fn raw(
        &mut self,
        bytes: &[u8],
        component: u32,
        kind: &str,
        count: usize,
        extra: Value,
    ) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views
            .push(json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()}));
        self.bin.extend_from_slice(bytes);
        let mut accessor = json!({"bufferView": self.views.len() - 1, "componentType": component, "count": count, "type": kind});
        for (k, v) in extra.as_object().into_iter().flatten() {
            accessor[k] = v.clone();
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values
            .as_flattened()
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let mut extra = json!({});
        if N == 3 {
            let fold = |f: fn(f32, f32) -> f32| -> Vec<f32> {
                (0..N)
                    .map(|c| values.iter().map(|v| v[c]).reduce(f).unwrap())
                    .collect()
            };
            extra = json!({"min": fold(f32::min), "max": fold(f32::max)});
        }
        self.raw(
            &bytes,
            5126,
            ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1],
            values.len(),
            extra,
        )
    }

    fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.raw(&bytes, 5123, "SCALAR", values.len(), json!({}))
    }

    fn finish(self, mut json: Value) -> (Value, Vec<u8>) {
        json["asset"] = json!({"version": "2.0", "generator": "test"});
        json["accessors"] = self.accessors.into();
        json["bufferViews"] = self.views.into();
        json["buffers"] = json!([{"byteLength": self.bin.len(), "name": "all"}]);
        (json, self.bin)
    }
}

const QUAD: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];
const UV0: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
const UV1: [[f32; 2]; 4] = [[0.25, 0.75], [0.75, 0.75], [0.75, 0.25], [0.25, 0.25]];

/// A layout in which every triangle is a separate chart with separate corners. Instances are side
/// by side.
fn torn(scene: &Scene) -> Layout {
    let meshes: Vec<MeshAtlas> = scene
        .meshes
        .iter()
        .map(|mesh| {
            let side = (mesh
                .primitives
                .iter()
                .map(|p| p.triangles.len())
                .sum::<usize>() as f32)
                .sqrt()
                .ceil() as u32;
            let mut cell = 0;
            let primitives: Vec<_> = mesh
                .primitives
                .iter()
                .map(|p| {
                    let mut atlas = PrimitiveAtlas::default();
                    for t in &p.triangles {
                        let first = atlas.xref.len() as u32;
                        let corner = Vec2::new((cell % side) as f32, (cell / side) as f32) * 4.0;
                        atlas.xref.extend(t);
                        atlas.uv.extend(
                            [[1.0, 1.0], [3.0, 1.0], [1.0, 3.0]].map(|p| corner + Vec2::from(p)),
                        );
                        atlas.triangles.push([first, first + 1, first + 2]);
                        atlas.chart.push(cell);
                        cell += 1;
                    }
                    atlas
                })
                .collect();
            MeshAtlas {
                size: [side * 4; 2],
                primitives,
                charts: cell,
                ..MeshAtlas::default()
            }
        })
        .collect();
    side_by_side(scene, meshes)
}

/// A layout without splits that uses `uv` of each vertex times 64 texels.
fn whole(scene: &Scene, uv: impl Fn(usize) -> Vec2) -> Layout {
    let atlas = |p: &mesh_ingest::Primitive| PrimitiveAtlas {
        xref: (0..p.positions.len() as u32).collect(),
        uv: (0..p.positions.len()).map(|v| uv(v) * 64.0).collect(),
        triangles: p.triangles.clone(),
        chart: vec![0; p.triangles.len()],
        ..PrimitiveAtlas::default()
    };
    let mesh = |m: &mesh_ingest::Mesh| MeshAtlas {
        size: [64; 2],
        primitives: m.primitives.iter().map(atlas).collect(),
        charts: 1,
        ..MeshAtlas::default()
    };
    side_by_side(scene, scene.meshes.iter().map(mesh).collect())
}

fn side_by_side(scene: &Scene, meshes: Vec<MeshAtlas>) -> Layout {
    let (mut placements, mut x, mut height) = (Vec::new(), 0, 0);
    for i in &scene.instances {
        let [w, h] = meshes[i.mesh].size;
        placements.push(Placement {
            page: 0,
            rect: Rect { x, y: 0, w, h },
        });
        x += w;
        height = height.max(h);
    }
    Layout {
        meshes,
        placements,
        pages: vec![[x.max(1), height.max(1)]],
        texels_per_unit: 4.0,
        ..Layout::default()
    }
}

fn uris() -> Vec<String> {
    vec!["in.lightmap.exr".into()]
}

fn write(loaded: &Loaded, layout: &Layout) -> (Vec<u8>, GltfStats) {
    write_lightmapped_glb(
        &loaded.document,
        &loaded.scene,
        layout,
        &uris(),
        ValueKind::Radiance,
    )
    .unwrap()
}

/// A quad with every kind of attribute and a morph target, indexed, two nodes, an animation, a
/// skin, a camera and unusual extras.
fn rich() -> (Value, Vec<u8>) {
    let mut b = Builder::default();
    let position = b.floats(&QUAD);
    let attributes = json!({
        "POSITION": position,
        "NORMAL": b.floats(&[[0.0, 0.0, 1.0]; 4]),
        "TANGENT": b.floats(&[[1.0, 0.0, 0.0, 1.0]; 4]),
        "TEXCOORD_0": b.floats(&UV0),
        "TEXCOORD_1": b.floats(&UV1),
        "COLOR_0": b.raw(&[10, 20, 30, 0, 40, 50, 60, 0, 70, 80, 90, 0, 100, 110, 120, 0], 5121, "VEC4", 4, json!({"normalized": true, "name": "paint"})),
        "JOINTS_0": b.raw(&(0..16).collect::<Vec<u8>>(), 5121, "VEC4", 4, json!({})),
        "WEIGHTS_0": b.floats(&[[1.0, 0.0, 0.0, 0.0]; 4]),
        "_FOO": b.floats(&[[0.5], [1.5], [2.5], [3.5]]),
    });
    let target = b.floats(&[
        [0.0, 0.0, 0.1],
        [0.0, 0.0, 0.2],
        [0.0, 0.0, 0.3],
        [0.0, 0.0, 0.4],
    ]);
    // The third triangle has zero area; the fourth is the first with reversed winding.
    let indices = b.indices(&[0, 1, 2, 0, 2, 3, 0, 0, 1, 1, 2, 0]);
    let times = b.floats(&[[0.0], [1.0]]);
    let moves = b.floats(&[[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]);
    let unused = b.floats(&[[7.0]; 100]);
    let textured = json!({
        "name": "wall", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "occlusionTexture": {"index": 0, "texCoord": 1}, "extras": {"n": 1},
    });
    let primitive = json!({"attributes": attributes, "indices": indices, "material": 0, "targets": [{"POSITION": target}], "extras": [1]});
    let points = json!({"attributes": {"POSITION": position, "TEXCOORD_0": attributes["TEXCOORD_0"], "TEXCOORD_1": attributes["TEXCOORD_1"]},
        "mode": 0, "material": 0});
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(2, 2, image::Rgb([255, 255, 255]))
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    use base64_of_png as encode;
    let json = json!({
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2, 3], "name": "main"}],
        "nodes": [
            {"name": "a", "mesh": 0, "extras": {"keep": [1, 2], "lightmap": "old"}},
            {"name": "b", "mesh": 0, "translation": [2.0, 0.0, 0.0], "extras": "text"},
            {"name": "mover", "camera": 0},
            {"name": "unbaked"},
        ],
        "meshes": [{"name": "m", "primitives": [primitive, points], "weights": [0.0], "extras": {"targetNames": ["t"]}}],
        "materials": [textured],
        "textures": [{"source": 0}],
        "images": [{"uri": encode(&png.into_inner()), "name": "white"}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 2, "path": "translation"}}],
            "samplers": [{"input": times, "output": moves}]}],
        "extras": {"unused accessor": unused},
    });
    b.finish(json)
}

fn base64_of_png(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::from("data:image/png;base64,");
    for chunk in bytes.chunks(3) {
        let word =
            chunk.iter().fold(0u32, |w, &b| w << 8 | u32::from(b)) << (8 * (3 - chunk.len()));
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k) & 63) as usize] as char;
            text.push(if k <= chunk.len() { digit } else { '=' });
        }
    }
    text
}

/// The value of each attribute at each corner of each triangle, which must survive re-indexing.
fn corners(
    loaded: &Loaded,
    mesh: usize,
    primitive: usize,
    skip: &[&str],
) -> Vec<(String, Vec<Vec<u8>>)> {
    let raw = loaded.document.primitive_raw(mesh, primitive).unwrap();
    let of = |name: String, a: &mesh_ingest::RawAccessor<'_>| {
        (
            name,
            raw.triangles
                .iter()
                .flatten()
                .map(|&v| a.element(v as usize).to_vec())
                .collect(),
        )
    };
    let own = raw.attributes.iter().map(|(n, a)| of(n.clone(), a));
    let targets = raw
        .targets
        .iter()
        .enumerate()
        .flat_map(|(i, t)| t.iter().map(move |(n, a)| (format!("{i}.{n}"), a)));
    own.chain(targets.map(|(n, a)| of(n, a)))
        .filter(|(n, _)| !skip.contains(&n.as_str()))
        .collect()
}

#[test]
fn every_attribute_and_every_triangle_survives_the_split() {
    let fixture = Fixture::new();
    let (json, bin) = rich();
    let loaded = fixture.load(&json, &bin);
    let (glb, stats) = write(&loaded, &torn(&loaded.scene));
    // Two triangles of three corners each. The zero-area one uses a copy of 0 and gets one of 1 at
    // the same point; the duplicate uses all corners of the first.
    assert_eq!(
        (
            stats.primitives_rewritten,
            stats.vertices_before,
            stats.vertices_after
        ),
        (1, 4, 7)
    );
    let back = fixture.reload(&glb);
    assert_eq!(
        back.document.primitive_raw(0, 0).unwrap().triangles,
        [[0, 1, 2], [3, 4, 5], [0, 0, 6], [1, 2, 0]]
    );
    let before = corners(&loaded, 0, 0, &["TEXCOORD_1"]);
    let after = corners(&back, 0, 0, &["TEXCOORD_1", "TEXCOORD_2"]);
    assert_eq!(before, after);
    assert_eq!(
        before
            .iter()
            .map(|(n, _)| n.as_str())
            .collect::<Vec<_>>()
            .len(),
        9
    );
    // The old set 1 moved to 2, because the material's occlusion texture reads it.
    let old = corners(&loaded, 0, 0, &[])
        .into_iter()
        .find(|(n, _)| n == "TEXCOORD_1")
        .unwrap()
        .1;
    let moved = corners(&back, 0, 0, &[])
        .into_iter()
        .find(|(n, _)| n == "TEXCOORD_2")
        .unwrap()
        .1;
    assert_eq!(old, moved);
    let accessor = |name: &str| {
        let j = back.document.json();
        j["accessors"][j["meshes"][0]["primitives"][0]["attributes"][name]
            .as_u64()
            .unwrap() as usize]
            .clone()
    };
    assert_eq!(
        (
            &accessor("COLOR_0")["name"],
            &accessor("COLOR_0")["normalized"]
        ),
        (&json!("paint"), &json!(true))
    );
    assert_eq!(
        (
            accessor("POSITION")["min"].clone(),
            accessor("POSITION")["max"].clone()
        ),
        (json!([0.0, 0.0, 0.0]), json!([1.0, 1.0, 0.0]))
    );
    let uv = back
        .document
        .primitive_raw(0, 0)
        .unwrap()
        .attribute("TEXCOORD_1")
        .unwrap()
        .to_floats::<2>(0.0);
    assert_eq!(uv[..3], [[0.125, 0.125], [0.375, 0.125], [0.125, 0.375]]);
}

#[test]
fn all_that_is_not_light_is_left_as_it_was() {
    let fixture = Fixture::new();
    let (json, bin) = rich();
    let loaded = fixture.load(&json, &bin);
    let (glb, stats) = write(&loaded, &torn(&loaded.scene));
    let back = fixture.reload(&glb);
    let out = back.document.json();
    for key in ["scene", "scenes", "cameras", "textures", "asset"] {
        assert_eq!(out[key], json[key], "{key}");
    }
    let place = |x: f64| {
        json!({"uri": "in.lightmap.exr", "page": 0, "texCoord": 1, "offset": [x, 0.0], "scale": [0.5, 1.0],
            "scaleToIrradiance": std::f64::consts::PI})
    };
    let mut nodes = json["nodes"].clone();
    nodes[0]["extras"]["lightmap"] = place(0.0);
    nodes[1]["extras"] = json!({"original": "text", "lightmap": place(0.5)});
    assert_eq!(out["nodes"], nodes);
    // Accessors are re-indexed, but the animation's data and structure must be the same.
    assert_eq!(
        out["animations"][0]["channels"],
        json["animations"][0]["channels"]
    );
    for key in ["input", "output"] {
        let of = |l: &Loaded| {
            let at = l.document.json()["animations"][0]["samplers"][0][key]
                .as_u64()
                .unwrap() as usize;
            l.document.accessor_raw(at).unwrap().into_owned().bytes
        };
        assert_eq!(of(&back), of(&loaded));
    }
    let primitive = &out["meshes"][0]["primitives"];
    assert_eq!(
        (&out["meshes"][0]["extras"], &out["meshes"][0]["name"]),
        (&json["meshes"][0]["extras"], &json!("m"))
    );
    assert_eq!(
        (
            &primitive[0]["extras"],
            &primitive[1]["mode"],
            &primitive[1]["material"]
        ),
        (&json!([1]), &json!(0), &json!(0))
    );
    // The points still read set 1 with the old material; the quad has a copy that reads set 2.
    assert_eq!((stats.sets_moved, stats.materials_copied), (1, 1));
    assert_eq!(
        (&out["materials"][0], &primitive[0]["material"]),
        (&json["materials"][0], &json!(1))
    );
    let mut copy = json["materials"][0].clone();
    copy["occlusionTexture"]["texCoord"] = json!(2);
    assert_eq!(out["materials"][1], copy);
    assert_eq!(
        (&out["images"][0]["mimeType"], &out["images"][0]["name"]),
        (&json!("image/png"), &json!("white"))
    );
    assert!(out["images"][0].get("uri").is_none());
    assert_eq!(
        back.document.image_bytes(0).unwrap(),
        loaded.document.image_bytes(0).unwrap()
    );
    // The 100 unused scalars are gone.
    let counts: Vec<_> = out["accessors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|a| a["count"].as_u64().unwrap())
        .collect();
    assert!(!counts.contains(&100), "{counts:?}");
    assert_eq!(out["buffers"].as_array().unwrap().len(), 1);
    assert_eq!(out["buffers"][0]["name"], "all");
}

#[test]
fn an_unsplit_primitive_keeps_its_accessors_and_only_gains_coordinates() {
    let fixture = Fixture::new();
    let (json, bin) = rich();
    let loaded = fixture.load(&json, &bin);
    // With the asset's own set 1, nothing changes.
    let (glb, stats) = write(&loaded, &whole(&loaded.scene, |v| Vec2::from(UV1[v])));
    assert_eq!(
        (
            stats.primitives_rewritten,
            stats.sets_moved,
            stats.sets_replaced
        ),
        (0, 0, 0)
    );
    let back = fixture.reload(&glb);
    let names = |l: &Loaded| {
        l.document
            .primitive_raw(0, 0)
            .unwrap()
            .attributes
            .iter()
            .map(|(n, _)| n.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&back), names(&loaded));
    assert_eq!(corners(&back, 0, 0, &[]), corners(&loaded, 0, 0, &[]));
    assert_eq!(back.document.json()["materials"], json["materials"]);
    // Other coordinates add one accessor.
    let (glb, stats) = write(&loaded, &whole(&loaded.scene, |v| Vec2::from(UV0[v])));
    assert_eq!((stats.primitives_rewritten, stats.sets_moved), (0, 1));
    let back = fixture.reload(&glb);
    assert_eq!(
        corners(&back, 0, 0, &["TEXCOORD_1", "TEXCOORD_2"]),
        corners(&loaded, 0, 0, &["TEXCOORD_1"])
    );
}

#[test]
fn a_mesh_without_coordinates_gets_both_sets_and_a_strip_becomes_a_list() {
    let fixture = Fixture::new();
    let mut b = Builder::default();
    let strip = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
    ];
    let position = b.floats(&strip);
    let json = json!({"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position}, "mode": 5}]}]});
    let (json, bin) = b.finish(json);
    let loaded = fixture.load(&json, &bin);
    let (glb, _) = write(&loaded, &torn(&loaded.scene));
    let back = fixture.reload(&glb);
    let p = &back.document.json()["meshes"][0]["primitives"][0];
    assert!(p.get("mode").is_none());
    assert_eq!(p["attributes"]["TEXCOORD_0"], p["attributes"]["TEXCOORD_1"]);
    assert_eq!(
        corners(&back, 0, 0, &["TEXCOORD_0", "TEXCOORD_1"]),
        corners(&loaded, 0, 0, &[])
    );
}

#[test]
fn quantised_vertices_stay_quantised_and_aligned() {
    let fixture = Fixture::new();
    let mut b = Builder::default();
    // i16 positions of 6 bytes in a view with stride 8; u8 coordinates of 2 bytes with stride 4.
    let places: [[i16; 3]; 4] = [[-5, 0, 0], [5, 0, 0], [5, 7, 0], [-5, 7, 0]];
    let bytes: Vec<u8> = places
        .iter()
        .flat_map(|p| [p[0], p[1], p[2], 0])
        .flat_map(i16::to_le_bytes)
        .collect();
    let position = b.raw(
        &bytes,
        5122,
        "VEC3",
        4,
        json!({"min": [-5, 0, 0], "max": [5, 7, 0]}),
    );
    b.views[0]["byteStride"] = json!(8);
    let uv = b.raw(
        &[0, 255, 0, 0, 255, 255, 0, 0, 255, 0, 0, 0, 0, 0, 0, 0],
        5121,
        "VEC2",
        4,
        json!({"normalized": true}),
    );
    b.views[1]["byteStride"] = json!(4);
    let indices = b.indices(&[0, 1, 2, 0, 2, 3]);
    let json = json!({"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "indices": indices}]}]});
    let (json, bin) = b.finish(json);
    let loaded = fixture.load(&json, &bin);
    let (glb, _) = write(&loaded, &torn(&loaded.scene));
    let back = fixture.reload(&glb);
    assert_eq!(
        corners(&back, 0, 0, &["TEXCOORD_1"]),
        corners(&loaded, 0, 0, &[])
    );
    let out = back.document.json();
    let index = |v: &Value| v.as_u64().unwrap() as usize;
    let accessor = |name: &str| {
        &out["accessors"][index(&out["meshes"][0]["primitives"][0]["attributes"][name])]
    };
    let position = accessor("POSITION");
    assert_eq!(
        (&position["min"], &position["max"]),
        (&json!([-5, 0, 0]), &json!([5, 7, 0]))
    );
    let stride =
        |name: &str| &out["bufferViews"][index(&accessor(name)["bufferView"])]["byteStride"];
    assert_eq!(
        ["POSITION", "TEXCOORD_0", "TEXCOORD_1"].map(stride),
        [&json!(8), &json!(4), &json!(8)]
    );
    assert_eq!(out["extensionsRequired"], json!(["KHR_mesh_quantization"]));
    for view in out["bufferViews"].as_array().unwrap() {
        assert_eq!(
            view.get("byteOffset").and_then(Value::as_u64).unwrap_or(0) % 4,
            0
        );
    }
}

#[test]
fn an_unknown_extension_stops_re_indexing_but_not_the_bake() {
    let fixture = Fixture::new();
    let (mut json, bin) = rich();
    json["extensionsUsed"] = json!(["ACME_audio"]);
    json["extensions"] = json!({"ACME_audio": {"accessor": 13}});
    let loaded = fixture.load(&json, &bin);
    let (glb, _) = write(&loaded, &torn(&loaded.scene));
    let back = fixture.reload(&glb);
    let out = back.document.json();
    let n = json["accessors"].as_array().unwrap().len();
    assert_eq!(
        (&out["extensions"], &out["extensionsUsed"]),
        (&json["extensions"], &json["extensionsUsed"])
    );
    assert_eq!(
        out["accessors"].as_array().unwrap()[..n],
        json["accessors"].as_array().unwrap()[..]
    );
    for i in 0..n {
        assert_eq!(
            back.document.accessor_raw(i).unwrap().bytes,
            loaded.document.accessor_raw(i).unwrap().bytes,
            "{i}"
        );
    }
}

fn instanced() -> (Value, Vec<u8>) {
    let mut b = Builder::default();
    let position = b.floats(&QUAD);
    let indices = b.indices(&[0, 1, 2, 0, 2, 3]);
    let at = b.floats(&[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0]]);
    // A quarter turn about z as normalised bytes, which is not exactly unit.
    let turns = b.raw(
        &[0, 0, 0, 127, 0, 0, 90, 90, 0, 0, 0, 127],
        5120,
        "VEC4",
        3,
        json!({"normalized": true}),
    );
    let copies =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": at, "ROTATION": turns}}});
    let json = json!({"scenes": [{"nodes": [0, 1]}],
        "extensionsUsed": ["EXT_mesh_gpu_instancing"], "extensionsRequired": ["EXT_mesh_gpu_instancing"],
        "nodes": [{"mesh": 0, "name": "row", "extensions": copies}, {"mesh": 0, "translation": [0.0, 5.0, 0.0]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1.0, 0.5]}, "alphaMode": "BLEND"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position}, "indices": indices, "material": 0}]}]});
    b.finish(json)
}

#[test]
fn copies_of_an_instanced_node_get_a_list_in_their_order() {
    let fixture = Fixture::new();
    let (json, bin) = instanced();
    let loaded = fixture.load(&json, &bin);
    assert_eq!(loaded.scene.instances.len(), 4);
    let (glb, _) = write(&loaded, &torn(&loaded.scene));
    let back = fixture.reload(&glb);
    let nodes = &back.document.json()["nodes"];
    let list = nodes[0]["extras"]["lightmap"].as_array().unwrap();
    assert_eq!(
        list.iter()
            .map(|l| l["offset"][0].as_f64().unwrap())
            .collect::<Vec<_>>(),
        [0.0, 0.25, 0.5]
    );
    assert_eq!(nodes[1]["extras"]["lightmap"]["offset"], json!([0.75, 0.0]));
    // One mesh still serves all four.
    assert_eq!(back.document.json()["meshes"].as_array().unwrap().len(), 1);
}

#[test]
fn a_missing_copy_leaves_a_null() {
    let nodes = by_node(
        [
            (3, Some(2), json!("c")),
            (3, Some(0), json!("a")),
            (1, None, json!("x")),
        ]
        .into_iter(),
    );
    assert_eq!(
        nodes,
        BTreeMap::from([(1, json!("x")), (3, json!(["a", null, "c"]))])
    );
}

#[test]
fn parts_that_do_not_fit_are_errors() {
    let fixture = Fixture::new();
    let (json, bin) = rich();
    let loaded = fixture.load(&json, &bin);
    let good = torn(&loaded.scene);
    let mut broken = vec![good.clone(); 6];
    broken[0].meshes[0].primitives[0].xref[0] = 9;
    broken[1].meshes[0].primitives[0].triangles[0][0] = 99;
    broken[2].meshes[0].primitives[0].uv.pop();
    broken[3].placements[0].page = 1;
    broken[4].meshes[0].primitives.clear();
    broken[5].meshes[0].primitives[0].triangles.pop();
    for (i, layout) in broken.iter().enumerate() {
        let result = write_lightmapped_glb(
            &loaded.document,
            &loaded.scene,
            layout,
            &uris(),
            ValueKind::Radiance,
        );
        assert!(
            matches!(result, Err(crate::Error::Inconsistent { .. })),
            "{i}"
        );
    }
    let mut light = vertex::graded(&loaded.scene);
    light.instances[1][0].pop();
    assert!(write_vertex_glb(&loaded.document, &loaded.scene, &light).is_err());
}
