//! Seeds: meshes that meshopt compressed, and charts in the cache.

use serde_json::json;

use super::seeds::Level;

/// Vertices on a side of the grid.
const SIDE: usize = 6;

/// A bumpy grid of `side` × `side` vertices: positions and triangles.
pub fn grid(side: usize) -> (Vec<[f32; 3]>, Vec<u32>) {
    let at = |i: usize| {
        let (x, z) = ((i % side) as f32, (i / side) as f32);
        [x, 0.1 * ((i * i) % 7) as f32, z]
    };
    let corner = |i: usize| {
        let n = (i / 6 / (side - 1)) * side + i / 6 % (side - 1);
        [n, n + side, n + 1, n + 1, n + side, n + side + 1][i % 6] as u32
    };
    let points = (0..side * side).map(at).collect();
    (
        points,
        (0..6 * (side - 1) * (side - 1)).map(corner).collect(),
    )
}

/// A document with the grid, whose primitive and buffer views are to be completed.
fn level(bin: Vec<u8>, extension: &str) -> Level {
    let (points, corners) = grid(SIDE);
    let json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "extensionsUsed": [extension], "extensionsRequired": [extension],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"componentType": 5126, "count": points.len(), "type": "VEC3"},
            {"componentType": 5125, "count": corners.len(), "type": "SCALAR"}],
        "buffers": [{"byteLength": bin.len()}],
    });
    Level { json, bin }
}

/// The grid as meshopt streams: vertices and triangles.
pub fn meshopt_streams() -> [Vec<u8>; 2] {
    let (points, corners) = grid(SIDE);
    let vertices = meshopt::encode_vertex_buffer(&points).expect("sound vertices");
    let triangles = meshopt::encode_index_buffer(&corners, points.len()).expect("sound triangles");
    [vertices, triangles]
}

/// A document with these meshopt streams, of `filter`.
pub fn with_meshopt([vertices, triangles]: &[Vec<u8>; 2], filter: &str) -> Level {
    let mut level = level(
        [&vertices[..], triangles].concat(),
        "EXT_meshopt_compression",
    );
    let (points, corners) = grid(SIDE);
    let view = |at: usize, stream: &[u8], stride: usize, count: usize, mode: &str| {
        json!({"buffer": 0, "byteLength": stride * count, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteOffset": at, "byteLength": stream.len(), "byteStride": stride,
            "count": count, "mode": mode}}})
    };
    let mut views = json!([
        view(0, vertices, 12, points.len(), "ATTRIBUTES"),
        view(vertices.len(), triangles, 4, corners.len(), "TRIANGLES")
    ]);
    views[0]["byteStride"] = json!(12);
    views[0]["extensions"]["EXT_meshopt_compression"]["filter"] = json!(filter);
    level.json["bufferViews"] = views;
    for k in 0..2 {
        level.json["accessors"][k]["bufferView"] = json!(k);
    }
    level
}

/// A grid with as many triangles as are cached, uncompressed.
pub fn flat_grid() -> Level {
    let (points, corners) = grid(24);
    let points: Vec<u8> = points
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let corners: Vec<u8> = corners.iter().flat_map(|x| x.to_le_bytes()).collect();
    let json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": points.len() / 12, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": corners.len() / 4, "type": "SCALAR"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": points.len()},
            {"buffer": 0, "byteOffset": points.len(), "byteLength": corners.len()}],
        "buffers": [{"byteLength": points.len() + corners.len()}],
    });
    Level {
        json,
        bin: [points, corners].concat(),
    }
}
