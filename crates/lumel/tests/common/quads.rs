//! A scene with known pixels: white or coloured squares under a sun, none of which sees another's
//! front.

use serde_json::{Value, json};

/// R of a square that faces the sun: the sun's illuminance over π.
pub const R: f64 = 0.6;

/// Linear albedo of the squares.
pub const ALBEDO: [f64; 3] = [0.8, 0.5, 0.2];

/// Linear albedo of the right half of the shadowed floor, which is a separate primitive.
pub const OTHER: [f64; 3] = [0.1, 0.9, 0.4];

/// The `--sun` that gives [`R`]: straight down.
pub fn sun() -> String {
    format!("0,-1,0,{}", R * std::f64::consts::PI)
}

/// Test points: position, albedo, R.
pub fn points() -> Vec<([f64; 3], [f64; 3], f64)> {
    vec![
        // `flat` faces the sun; `tilted` is the same mesh at 60° to it.
        ([-4.0, 0.0, 0.3], ALBEDO, R),
        ([4.0, 0.0, 0.0], ALBEDO, R * 0.5),
        // A plate shadows the quarter x > 0, z > 0 of `floor`, which has two primitives. From
        // above, the plate hides that quarter, so the points there are in the other quarters; the
        // point under the plate is visible from the side.
        ([-0.5, 0.0, -0.5], ALBEDO, R),
        ([-0.5, 0.0, 0.5], ALBEDO, R),
        ([0.5, 0.0, -0.5], OTHER, R),
        ([0.5, 0.0, 0.5], OTHER, 0.0),
    ]
}

/// The scene as .gltf.
pub fn scene() -> String {
    // A square of 2 m in the plane y = 0, facing up; then its left and right halves by index.
    let positions: [[f32; 3]; 6] = [
        [-1.0, 0.0, -1.0],
        [-1.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.0, -1.0],
        [1.0, 0.0, 1.0],
    ];
    let normals = [[0.0f32, 1.0, 0.0]; 6];
    let left: [u16; 6] = [0, 1, 2, 2, 1, 3];
    let right: [u16; 6] = [2, 3, 4, 4, 3, 5];
    let mut bytes: Vec<u8> = Vec::new();
    for f in positions
        .as_flattened()
        .iter()
        .chain(normals.as_flattened())
    {
        bytes.extend(f.to_le_bytes());
    }
    for i in left.iter().chain(&right) {
        bytes.extend(i.to_le_bytes());
    }
    use base64::Engine;
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let material = |name: &str, c: [f64; 3]| json!({"name": name, "pbrMetallicRoughness": {"baseColorFactor": [c[0], c[1], c[2], 1.0], "metallicFactor": 0.0}});
    let part = |indices: u32, material: u32| json!({"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": indices, "material": material});
    // 60° about z, facing away from the others.
    let (s, c) = (-(30f64.to_radians().sin()), 30f64.to_radians().cos());
    let scene: Value = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2, 3]}],
        "nodes": [
            {"name": "flat", "mesh": 0, "translation": [-4.0, 0.0, 0.0]},
            {"name": "tilted", "mesh": 0, "translation": [4.0, 0.0, 0.0], "rotation": [0.0, 0.0, s, c]},
            {"name": "floor", "mesh": 1},
            // Its child must not inherit a lightmap.
            {"name": "plate", "mesh": 2, "translation": [0.5, 0.75, 0.5], "scale": [0.5, 1.0, 0.5]},
        ],
        "meshes": [
            {"name": "square", "primitives": [part(4, 0)]},
            {"name": "halves", "primitives": [part(2, 0), part(3, 1)]},
            {"name": "plate", "primitives": [part(4, 0)]},
        ],
        "materials": [material("tan", ALBEDO), material("green", OTHER)],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1]},
            {"bufferView": 1, "componentType": 5126, "count": 6, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "byteOffset": 12, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 72},
            {"buffer": 0, "byteOffset": 72, "byteLength": 72},
            {"buffer": 0, "byteOffset": 144, "byteLength": 24},
        ],
        "buffers": [{"byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}")}],
    });
    scene.to_string()
}

/// The sRGB byte of a linear value (IEC 61966-2-1).
pub fn shown(linear: f64) -> f64 {
    let x = linear.clamp(0.0, 1.0);
    255.0
        * if x <= 0.0031308 {
            12.92 * x
        } else {
            1.055 * x.powf(1.0 / 2.4) - 0.055
        }
}
