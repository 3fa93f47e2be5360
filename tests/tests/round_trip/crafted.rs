//! Documents with many features for the round trip.

use std::path::Path;

use serde_json::{Value, json};

/// A document under construction.
#[derive(Default)]
pub struct Doc {
    pub bin: Vec<u8>,
    pub views: Vec<Value>,
    pub accessors: Vec<Value>,
}

pub const QUAD: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];

impl Doc {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views
            .push(json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()}));
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn raw(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.accessors.push(
            json!({"bufferView": view, "componentType": component, "count": count, "type": kind}),
        );
        self.accessors.len() - 1
    }

    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values
            .as_flattened()
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let kind = match N {
            16 => "MAT4",
            n => ["SCALAR", "VEC2", "VEC3", "VEC4"][n - 1],
        };
        let at = self.raw(&bytes, 5126, kind, values.len());
        let fold = |f: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..N)
                .map(|c| values.iter().map(|v| v[c]).reduce(f).unwrap())
                .collect()
        };
        if N != 16 {
            self.accessors[at]["min"] = json!(fold(f32::min));
            self.accessors[at]["max"] = json!(fold(f32::max));
        }
        at
    }

    pub fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.raw(&bytes, 5123, "SCALAR", values.len())
    }

    /// Writes `name` into `dir`, with one buffer: beside it for a .gltf, inside for a .glb.
    pub fn write(self, mut json: Value, dir: &Path, name: &str) -> std::path::PathBuf {
        json["asset"]["version"] = json!("2.0");
        json["accessors"] = self.accessors.into();
        json["bufferViews"] = self.views.into();
        let mut buffer = json["buffers"][0].take();
        if !buffer.is_object() {
            buffer = json!({});
        }
        buffer["byteLength"] = json!(self.bin.len());
        let path = dir.join(name);
        if name.ends_with(".glb") {
            json["buffers"] = json!([buffer]);
            let mut text = serde_json::to_vec(&json).unwrap();
            text.resize(text.len().next_multiple_of(4), b' ');
            let mut bin = self.bin;
            bin.resize(bin.len().next_multiple_of(4), 0);
            let mut out = b"glTF".to_vec();
            out.extend(2u32.to_le_bytes());
            out.extend((28 + text.len() as u32 + bin.len() as u32).to_le_bytes());
            out.extend((text.len() as u32).to_le_bytes());
            out.extend(b"JSON");
            out.extend(&text);
            out.extend((bin.len() as u32).to_le_bytes());
            out.extend(b"BIN\0");
            out.extend(&bin);
            std::fs::write(&path, out).unwrap();
        } else {
            buffer["uri"] = json!("data.bin");
            json["buffers"] = json!([buffer]);
            std::fs::write(dir.join("data.bin"), &self.bin).unwrap();
            std::fs::write(&path, serde_json::to_vec_pretty(&json).unwrap()).unwrap();
        }
        path
    }
}

/// A 2 × 2 PNG.
fn png() -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(2, 2, image::Rgb([200, 100, 50]))
        .write_to(&mut out, image::ImageFormat::Png)
        .unwrap();
    out.into_inner()
}

/// The same, bent over its diagonal: two charts.
const BENT: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 0.5, 1.0],
    [0.0, 1.0, 0.0],
];

/// Vertices with every kind of attribute, including integers and sparse ones.
fn attributes(doc: &mut Doc) -> Value {
    let mut a = json!({
        "POSITION": doc.floats(&QUAD),
        "NORMAL": doc.floats(&[[0.0, 0.0, 1.0]; 4]),
        "TANGENT": doc.floats(&[[1.0, 0.0, 0.0, 1.0]; 4]),
        "TEXCOORD_0": doc.floats(&[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]),
        "TEXCOORD_1": doc.floats(&[[0.0, 3.0], [3.0, 3.0], [3.0, 0.0], [0.0, 0.0]]),
        "COLOR_0": doc.raw(&[10, 20, 30, 255, 40, 50, 60, 255, 70, 80, 90, 255, 100, 110, 120, 255], 5121, "VEC4", 4),
        "_ID": doc.floats(&[[0.5], [1.5], [2.5], [3.5]]),
    });
    let paint = a["COLOR_0"].as_u64().unwrap() as usize;
    doc.accessors[paint]["normalized"] = json!(true);
    doc.accessors[paint]["name"] = json!("paint");
    doc.accessors[paint]["extras"] = json!({"layer": 1});
    // Sparse: the second of four differs from the view below.
    let (at, values) = (doc.view(&[1, 0]), doc.view(&7.25f32.to_le_bytes()));
    let sparse = doc.floats(&[[0.0], [0.0], [0.0], [0.0]]);
    doc.accessors[sparse]["sparse"] = json!({"count": 1, "indices": {"bufferView": at, "componentType": 5123},
        "values": {"bufferView": values}, "extras": {"why": "sparse"}});
    for bound in ["min", "max"] {
        doc.accessors[sparse].as_object_mut().unwrap().remove(bound);
    }
    a["_SPARSE"] = json!(sparse);
    a
}

/// A level with everything in the core specification and all extensions that Lumel supports. Its
/// numbers need all their digits.
pub fn everything() -> (Doc, Value) {
    let mut doc = Doc::default();
    let attributes = attributes(&mut doc);
    let target = doc.floats(&[[0.0, 0.0, 0.25]; 4]);
    let target2 = doc.floats(&[[0.0, 0.5, 0.0]; 4]);
    // The third triangle has no area; the fourth repeats the first with other winding.
    let indices = doc.indices(&[0, 1, 2, 0, 2, 3, 0, 0, 1, 1, 2, 0]);
    let strip = doc.indices(&[0, 1, 3, 2]);
    let joints = doc.raw(&[0; 16], 5121, "VEC4", 4);
    let weights = doc.floats(&[[1.0, 0.0, 0.0, 0.0]; 4]);
    let mut identity = [0.0; 16];
    for i in [0, 5, 10, 15] {
        identity[i] = 1.0;
    }
    let matrices = doc.floats(&[identity]);
    let times = doc.floats(&[[0.0], [1.0]]);
    let moves = doc.floats(&[[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]);
    let cubic = doc.floats(&[[0.0]; 12]);
    let copies = doc.floats(&[[5.0, 0.0, 0.0], [7.0, 0.0, 0.0], [9.0, 0.0, 0.0]]);
    let turns = doc.raw(&[0, 0, 0, 127, 0, 127, 0, 0, 0, 0, 90, 90], 5120, "VEC4", 3);
    doc.accessors[turns]["normalized"] = json!(true);
    let position = attributes["POSITION"].clone();
    let bare = json!({"POSITION": position, "NORMAL": attributes["NORMAL"]});
    let bent = json!({"POSITION": doc.floats(&BENT)});
    let mut skinned = attributes.clone();
    skinned["JOINTS_0"] = joints.into();
    skinned["WEIGHTS_0"] = weights.into();
    let image = doc.view(&png());
    let json = json!({
        "asset": {"version": "2.0", "generator": "hand", "copyright": "nobody", "extras": {"rev": 3}},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2, 3, 5, 6, 7, 8], "name": "main", "extras": {"fog": 0.1}}, {"nodes": [4], "name": "other"}],
        "nodes": [
            {"name": "quad", "mesh": 0, "extras": {"keep": [1, 2], "lightmap": "old", "digits": 3.0415926535897933}},
            {"name": "again", "mesh": 0, "translation": [2.123456789012345, 0.0, 0.1], "extras": "text"},
            {"name": "camera", "camera": 0, "rotation": [0.0, 0.5000000000000001, 0.0, 0.8660254037844386]},
            {"name": "person", "mesh": 1, "skin": 0, "children": [4], "weights": [0.5]},
            {"name": "bone", "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.1, 0.2, 0.3, 1]},
            {"name": "strip", "mesh": 2, "scale": [1.0, -1.0, 1.0], "translation": [0.0, 5.0, 0.0], "extras": 7},
            {"name": "grass", "mesh": 3, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": copies, "ROTATION": turns}}}},
            {"name": "lamp", "extensions": {"KHR_lights_punctual": {"light": 0}}, "extras": null},
            {"name": "morphing but baked", "mesh": 1, "translation": [0.0, 9.0, 0.0], "extras": {"lumel": {"bake": true}}},
        ],
        "meshes": [
            {"name": "m", "extras": {"targetNames": ["a"]}, "primitives": [
                {"attributes": attributes, "indices": indices, "material": 0, "extras": [1],
                    "extensions": {"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [0], "extras": {"m": 1}}, {"material": 2, "variants": [1]}]}}},
                {"attributes": bare.clone(), "mode": 0, "material": 0, "extras": "points"},
                {"attributes": {"POSITION": position, "TEXCOORD_0": attributes["TEXCOORD_0"]}, "indices": strip, "mode": 3},
            ]},
            {"name": "body", "weights": [0.25], "primitives": [
                {"attributes": skinned, "indices": indices, "material": 1, "targets": [{"POSITION": target}, {"POSITION": target2}], "extras": {"p": 0}},
            ]},
            {"primitives": [{"attributes": bent, "indices": strip, "mode": 5, "material": 2}, {"attributes": bare.clone(), "mode": 6}]},
            {"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]},
            {"name": "unused", "primitives": [{"attributes": bare, "indices": strip, "mode": 5, "material": 0}]},
        ],
        "materials": [
            {"name": "reads set 1", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.25},
                "occlusionTexture": {"index": 1, "texCoord": 1, "strength": 0.5, "extras": {"texCoord": 1}}, "extras": {"n": 1},
                "extensions": {"KHR_materials_sheen": {"sheenColorTexture": {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1, "scale": [2, 2]}}}}}},
            {"name": "glows", "emissiveFactor": [0.5, 0.25, 1.0], "doubleSided": true, "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2.5}},
                "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.75], "extras": 1}, "extras": {"deep": {"er": [null, true]}}},
            {"name": "mask", "alphaMode": "MASK", "alphaCutoff": 0.3, "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0]}, "normalTexture": {"index": 1, "scale": 0.7}},
            {"name": "nobody wears it", "emissiveFactor": [1, 1, 1]},
        ],
        "textures": [{"source": 0, "sampler": 0, "name": "t", "extras": {"t": 1}}, {"source": 1}],
        "samplers": [{"magFilter": 9728, "wrapS": 33071, "extras": {"s": 1}}],
        "images": [{"bufferView": image, "mimeType": "image/png", "name": "in", "extras": {"i": 1}}, {"uri": "side%20file.png", "extras": [2]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0471975511965976, "znear": 0.1, "extras": {"c": 1}}, "name": "eye", "extras": 0}],
        "skins": [{"joints": [4], "inverseBindMatrices": matrices, "skeleton": 4, "name": "s", "extras": {"k": 1}}],
        "animations": [
            {"name": "walk", "extras": {"a": 1}, "channels": [{"sampler": 0, "target": {"node": 4, "path": "translation", "extras": 1}, "extras": 2},
                {"sampler": 1, "target": {"node": 3, "path": "weights"}}],
                "samplers": [{"input": times, "output": moves, "interpolation": "STEP", "extras": {"s": 0}}, {"input": times, "output": cubic, "interpolation": "CUBICSPLINE"}]},
        ],
        "extensionsUsed": ["KHR_materials_variants", "EXT_mesh_gpu_instancing", "KHR_lights_punctual", "KHR_materials_sheen", "KHR_texture_transform", "KHR_materials_emissive_strength"],
        "extensions": {"KHR_materials_variants": {"variants": [{"name": "one"}, {"name": "two"}]},
            "KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 40.0, "name": "l", "extras": {"lit": 1}}]}},
        "buffers": [{"name": "all", "extras": {"b": 1}}],
        "extras": {"root": [1.5, {"e": 1e-300}], "big": 9007199254740993u64},
    });
    (doc, json)
}

/// Puts an unknown extension on every object that may have one.
pub fn with_unknown_extensions(doc: &mut Doc, json: &mut Value) {
    let unused = doc.floats(&[[7.0]; 5]);
    fn put(object: &mut Value, what: Value) {
        if object.is_object() {
            object["extensions"]["ACME_thing"] = what;
        }
    }
    let mark =
        |at: &str| json!({"at": at, "accessor": unused, "bufferView": 0, "texture": {"index": 0}});
    let lists = [
        "scenes",
        "nodes",
        "meshes",
        "materials",
        "textures",
        "samplers",
        "images",
        "cameras",
        "skins",
        "animations",
    ];
    for key in lists {
        for (i, item) in json[key].as_array_mut().unwrap().iter_mut().enumerate() {
            put(item, mark(&format!("{key}[{i}]")));
        }
    }
    for (key, inner) in [
        ("meshes", "primitives"),
        ("animations", "channels"),
        ("animations", "samplers"),
    ] {
        for item in json[key].as_array_mut().unwrap() {
            for (i, part) in item[inner].as_array_mut().unwrap().iter_mut().enumerate() {
                put(part, mark(&format!("{inner}[{i}]")));
                if inner == "channels" {
                    put(&mut part["target"], mark("target"));
                }
            }
        }
    }
    for list in [&mut doc.accessors, &mut doc.views] {
        for item in list {
            put(item, mark("data"));
            item["extras"] = json!({"mine": true});
        }
    }
    put(&mut json["asset"], mark("asset"));
    put(&mut json["buffers"][0], mark("buffer"));
    put(&mut json["cameras"][0]["perspective"], mark("perspective"));
    json["extensions"]["ACME_thing"] = mark("root");
    json["materials"][0]["occlusionTexture"]["extensions"]["ACME_thing"] = mark("textureInfo");
    json["extensionsUsed"]
        .as_array_mut()
        .unwrap()
        .push(json!("ACME_thing"));
    json["ACME_member"] = json!({"of": "no specification"});
}

/// Writes the files that a document references.
pub fn write_side_files(dir: &Path) {
    std::fs::write(dir.join("side file.png"), png()).unwrap();
}
