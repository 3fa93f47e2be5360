//! A tiny glTF builder: JSON plus one buffer.

use std::path::PathBuf;

use mesh_ingest::{Error, LoadOptions, Loaded, load};
use serde_json::{Value, json};

/// A document under construction. Accessors and views are appended; everything else is plain JSON.
pub struct Doc {
    pub json: Value,
    pub bin: Vec<u8>,
}

pub const UNIT: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
pub const QUAD: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [1.0, 1.0, 0.0],
];

impl Doc {
    pub fn new() -> Doc {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}], "materials": []
        });
        Doc {
            json,
            bin: Vec::new(),
        }
    }

    /// One node with one unindexed mesh of these vertices.
    pub fn with_triangles(positions: &[[f32; 3]]) -> Doc {
        let mut doc = Doc::new();
        let positions = doc.floats(positions);
        let mesh = doc.mesh(json!([{"attributes": {"POSITION": positions}}]));
        doc.root(json!({"mesh": mesh}));
        doc
    }

    pub fn push(&mut self, key: &str, value: Value) -> usize {
        if self.json.get(key).is_none() {
            self.json[key] = json!([]);
        }
        let list = self.json[key].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.push(
            "bufferViews",
            json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}),
        )
    }

    pub fn floats<const N: usize>(&mut self, rows: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = rows
            .iter()
            .flatten()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let view = self.view(&bytes);
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5126, "count": rows.len(), "type": kind}),
        )
    }

    pub fn indices(&mut self, list: &[u16]) -> usize {
        let bytes: Vec<u8> = list.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        self.push("accessors", json!({"bufferView": view, "componentType": 5123, "count": list.len(), "type": "SCALAR"}))
    }

    pub fn mesh(&mut self, primitives: Value) -> usize {
        self.push("meshes", json!({"primitives": primitives}))
    }

    pub fn node(&mut self, node: Value) -> usize {
        self.push("nodes", node)
    }

    pub fn root(&mut self, node: Value) -> usize {
        let index = self.node(node);
        self.json["scenes"][0]["nodes"]
            .as_array_mut()
            .unwrap()
            .push(json!(index));
        index
    }

    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"][0]["byteLength"] = json!(self.bin.len());
        if self.bin.is_empty() {
            json.as_object_mut().unwrap().remove("buffers");
        }
        let mut text = serde_json::to_vec(&json).unwrap();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend((28 + text.len() as u32 + self.bin.len() as u32).to_le_bytes());
        out.extend((text.len() as u32).to_le_bytes());
        out.extend(b"JSON");
        out.extend(text);
        out.extend((self.bin.len() as u32).to_le_bytes());
        out.extend(b"BIN\0");
        out.extend(&self.bin);
        out
    }

    pub fn load(&self) -> Result<Loaded, Error> {
        load_bytes(&self.glb(), &LoadOptions::default())
    }
}

pub fn load_bytes(bytes: &[u8], options: &LoadOptions) -> Result<Loaded, Error> {
    let folder = tempfile::tempdir().unwrap();
    let file: PathBuf = folder.path().join("scene.glb");
    std::fs::write(&file, bytes).unwrap();
    load(&file, options)
}

/// The paths of an error's problems.
pub fn paths(result: Result<Loaded, Error>) -> Vec<String> {
    result
        .unwrap_err()
        .problems()
        .iter()
        .map(|p| p.path.clone())
        .collect()
}
