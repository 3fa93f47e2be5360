//! Seeds: small valid inputs of every kind.

use std::fmt::Write;
use std::io::Cursor;

use image::{ImageFormat, RgbImage};
use serde_json::{Value, json};

/// A document and its binary buffer.
#[derive(Clone)]
pub struct Level {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Level {
    pub fn glb(&self) -> Vec<u8> {
        let mut text = self.json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend((28 + text.len() as u32 + bin.len() as u32).to_le_bytes());
        for (kind, part) in [(b"JSON", &text), (b"BIN\0", &bin)] {
            out.extend((part.len() as u32).to_le_bytes());
            out.extend(kind);
            out.extend(part);
        }
        out
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        let at = self.bin.len();
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        self.push(
            "bufferViews",
            json!({"buffer": 0, "byteOffset": at, "byteLength": bytes.len()}),
        )
    }

    fn push(&mut self, key: &str, value: Value) -> usize {
        if self.json[key].is_null() {
            self.json[key] = json!([]);
        }
        let list = self.json[key].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    fn floats<const N: usize>(&mut self, rows: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = rows
            .iter()
            .flatten()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let view = self.view(&bytes);
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        // The format demands bounds of positions and times.
        let bound = |pick: fn(f32, f32) -> f32| {
            let of = |k: usize| rows.iter().map(|row| row[k]).reduce(pick);
            (0..N).map(of).collect::<Option<Vec<f32>>>()
        };
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5126, "count": rows.len(), "type": kind,
                "min": bound(f32::min), "max": bound(f32::max)}),
        )
    }
}

/// A floor, a wall, lamps and an emissive square, partly textured, masked, instanced, animated,
/// morphed and skinned. A spot and the sun project pictures, two area lights shine, a lamp is mixed,
/// one node has a page of its own and one captures reflections.
pub fn level() -> Level {
    let mut level = Level {
        json: json!({
            "asset": {"version": "2.0"}, "scene": 0, "buffers": [{}],
            "extensionsUsed": ["KHR_lights_punctual", "EXT_mesh_gpu_instancing",
                "KHR_texture_transform", "EXT_lights_area"],
            "extensions": {"KHR_lights_punctual": {"lights": [
                {"type": "point", "intensity": 5, "name": "lamp"},
                {"type": "spot", "intensity": 5, "spot": {"outerConeAngle": 1},
                    "extras": {"lumel": {"cookie": 0, "mode": "mixed"}}},
                {"type": "directional", "intensity": 2,
                    "extras": {"lumel": {"angle": 1, "cookie": 0, "cookieSize": 2}}}]},
                "EXT_lights_area": {"lights": [
                {"type": "rect", "intensity": 3, "size": 0.5, "rect": {"aspect": 2}, "name": "panel"},
                {"type": "disk", "intensity": 3, "size": 0.3}]}},
            "scenes": [{"nodes": [0, 1, 2, 3, 4, 8, 9, 10, 11], "extras": {"lumel": {"density": 1}}}],
        }),
        bin: Vec::new(),
    };
    let square = [[0f32, 0., 0.], [2., 0., 0.], [2., 0., -2.], [0., 0., -2.]];
    let position = level.floats(&square);
    let normal = level.floats(&[[0f32, 1., 0.]; 4]);
    let uv = level.floats(&[[0f32, 0.], [1., 0.], [1., 1.], [0., 1.]]);
    let color = level.floats(&[[1f32, 0.5, 0.2, 1.0]; 4]);
    let moved = level.floats(&[[0f32, 0.1, 0.]; 4]);
    let ones = [
        1f32, 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.,
    ]
    .map(f32::to_le_bytes);
    let view = level.view(&[ones, ones].concat().concat());
    let bind = level.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5126, "count": 2, "type": "MAT4"}),
    );
    let view = level.view(&[0, 1, 0, 0].repeat(4));
    let joints = level.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5121, "count": 4, "type": "VEC4"}),
    );
    let copies = level.floats(&[[0f32, 0.5, 0.], [0.5, 1.0, 0.2]]);
    let corners: Vec<u8> = [0u16, 1, 2, 0, 2, 3]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let view = level.view(&corners);
    let indices = level.push(
        "accessors",
        json!({"bufferView": view, "componentType": 5123, "count": 6, "type": "SCALAR"}),
    );
    let picture = level.view(&picture(ImageFormat::Png));
    level.push(
        "images",
        json!({"bufferView": picture, "mimeType": "image/png"}),
    );
    level.push("samplers", json!({"wrapS": 33071, "magFilter": 9728}));
    level.push("textures", json!({"source": 0, "sampler": 0}));
    level.json["materials"] = json!([
        {"name": "floor", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0,
            "extensions": {"KHR_texture_transform": {"scale": [2, 2], "offset": [0.1, 0]}}}}},
        {"name": "glow", "emissiveFactor": [1, 0.5, 0.2], "doubleSided": true},
        {"name": "leaf", "alphaMode": "MASK", "alphaCutoff": 0.5,
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    let whole = json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv, "COLOR_0": color});
    level.json["meshes"] = json!([
        {"primitives": [{"attributes": whole, "indices": indices, "material": 0,
            "targets": [{"POSITION": moved}]}], "weights": [0], "name": "square"},
        {"primitives": [{"attributes": {"POSITION": position}, "indices": indices, "material": 1}]},
        {"primitives": [{"attributes": {"POSITION": position, "TEXCOORD_0": uv},
            "indices": indices, "material": 2}]},
        {"primitives": [{"attributes": {"POSITION": position, "JOINTS_0": joints,
            "WEIGHTS_0": color}, "indices": indices}]}]);
    let light = |k: usize| json!({"KHR_lights_punctual": {"light": k}});
    let area = |k: usize| json!({"EXT_lights_area": {"light": k}});
    level.json["nodes"] = json!([
        {"mesh": 0, "name": "floor"},
        {"children": [5, 6], "rotation": [0.6, 0, 0, 0.8]},
        {"mesh": 1, "scale": [0.2, 0.2, 0.2], "translation": [1, 1.5, -1]},
        {"extensions": light(0), "translation": [1, 1, -1]},
        {"mesh": 2, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": copies}}}},
        {"mesh": 0, "extras": {"lumel": {"density": 0.5}}},
        {"extensions": light(2), "children": [7]},
        {"extensions": light(1), "translation": [1, 1.2, -0.5]},
        {"extensions": area(0), "translation": [0.5, 1.8, -0.5], "rotation": [-0.7, 0, 0, 0.7]},
        {"extensions": area(1), "translation": [1.5, 1.8, -0.5], "scale": [1, 2, 1]},
        {"translation": [1, 0.5, -1], "extras": {"lumel": {"reflection": true}}},
        {"mesh": 3, "skin": 0, "translation": [0, 0.3, 0],
            "extras": {"lumel": {"bake": true, "page": "own"}}}]);
    level.json["skins"] = json!([{"joints": [10, 9], "inverseBindMatrices": bind}]);
    let times = level.floats(&[[0f32], [1.0]]);
    let places = level.floats(&[[0f32, 0., 0.], [0., 1., 0.]]);
    level.json["animations"] = json!([{"samplers": [{"input": times, "output": places}],
        "channels": [{"sampler": 0, "target": {"node": 7, "path": "translation"}}]}]);
    level
}

/// [`level`]s without a capture of reflections, which takes longer than all else of a bake; with one;
/// and with levels of detail, variants, a volume to walk in, materials that let light pass, and
/// several scenes.
pub fn levels() -> [Level; 4] {
    let capturing = level();
    let mut plain = level();
    plain.json["nodes"][10]["extras"] = json!(null);
    let mut lods = plain.clone();
    let member = |kind: &str, group: &str, n: &str, k: usize| json!({"lumel": {kind: {"group": group, n: k}}});
    let nodes = &mut lods.json["nodes"];
    nodes[0]["name"] = json!("floor_LOD0");
    nodes[5]["name"] = json!("floor_LOD1");
    nodes[2]["extras"] = member("lod", "glow", "level", 0);
    nodes[4]["extras"] = member("lod", "glow", "level", 1);
    nodes[11]["extras"] = json!({"lumel": {"variant": {"group": "v", "index": 1}, "bake": true}});
    nodes[10] =
        json!({"translation": [1, 0.5, -1], "mesh": 1, "extras": {"lumel": {"walkable": true}}});
    nodes[6]["extensions"]["MSFT_lod"] = json!({"ids": [5, 2]});
    lods.json["scenes"] = json!([lods.json["scenes"][0], {"nodes": [1]}]);
    lods.json["materials"][0]["alphaMode"] = json!("BLEND");
    lods.json["materials"][0]["extras"] = json!({"lumel": {"maxReflectance": 0.5}});
    lods.json["materials"][1]["extras"] = json!({"lumel": {"emitScale": 2}});
    lods.json["materials"][2]["extensions"] =
        json!({"KHR_materials_transmission": {"transmissionFactor": 0.5}});
    [plain.clone(), plain, lods, capturing]
}

/// A square whose texture has these bytes, and a lamp with this IES profile.
pub fn with_files(picture: &[u8], ies: &[u8]) -> Level {
    let mut level = level();
    let view = level.view(picture);
    level.json["images"][0] = json!({"bufferView": view});
    let view = level.view(ies);
    level.json["extensions"]["EXT_lights_ies"]["lights"] = json!([{"bufferView": view}]);
    level.json["nodes"][6]["extensions"] = json!({"EXT_lights_ies": {"light": 0}});
    level
}

/// 16 × 8 pixels in ETC1S, UASTC and compressed UASTC.
pub const KTX2: [&[u8]; 3] = [
    include_bytes!("../../../mesh-ingest/tests/ingest/ktx2/etc1s.ktx2"),
    include_bytes!("../../../mesh-ingest/tests/ingest/ktx2/uastc.ktx2"),
    include_bytes!("../../../mesh-ingest/tests/ingest/ktx2/uastc_zstd.ktx2"),
];

/// A 4 × 4 image.
pub fn picture(format: ImageFormat) -> Vec<u8> {
    let picture = RgbImage::from_fn(4, 4, |x, y| image::Rgb([60 * x as u8, 60 * y as u8, 128]));
    let mut out = Cursor::new(Vec::new());
    picture
        .write_to(&mut out, format)
        .expect("memory takes all");
    out.into_inner()
}

/// An IES profile (LM-63).
pub fn ies() -> Vec<u8> {
    let mut s = String::from(
        "IESNA:LM-63-2002\n[TEST] none\nTILT=NONE\n1 1000 2.0 5 3 1 2 0.1 0.1 0\n1.0 1.0 50\n",
    );
    s.push_str("0 22.5 45 67.5 90\n0 45 90\n");
    for _ in 0..3 {
        // Writing to a String cannot fail.
        let _ = writeln!(s, "100 90 70 40 0");
    }
    s.into_bytes()
}

/// A 4 × 2 sky, Radiance HDR without run-length encoding.
pub fn hdr() -> Vec<u8> {
    let mut out = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.0\n\n-Y 2 +X 4\n".to_vec();
    out.extend((0..8u8).flat_map(|k| [100 + k, 90, 80, 128]));
    out
}

/// Probe positions.
pub fn points() -> Vec<u8> {
    br#"{"points": [[0, 1, 0], [1.5e0, -2, 3], [1, 1, 1]], "name": "p"}"#.to_vec()
}

/// A settings file.
pub fn settings() -> Vec<u8> {
    b"quality = \"draft\"\ntexels-per-unit = 2.0\nsky = [0.1, 0.2, 0.3]\nlayers = [\"ao\", \"direct\"]\n\
      light = [{ name = \"lamp*\", factor = 0.5 }]\nsun = [{ direction = [0, -1, 0], lux = 10 }]\n\
      group = [{ name = \"g\", sources = [\"a\", \"b*\"] }]\nprobes = 1.0\nstrict = false\n"
        .to_vec()
}

/// Requests to the viewer.
pub fn requests() -> Vec<Vec<u8>> {
    [
        "GET / HTTP/1.1\r\nHost: localhost\r\nAccept-Encoding: gzip\r\n\r\n",
        "GET /files/level.glb HTTP/1.1\r\nHost: 127.0.0.1:1\r\nRange: bytes=2-90\r\n\r\n",
        "GET /api/plane?bake=level&page=0&layer=direct HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "HEAD /api/report?bake=level HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET /files/..%2flevel.glb HTTP/1.1\r\nHost: localhost\r\nCookie: a=b\r\n\r\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .to_vec()
}
