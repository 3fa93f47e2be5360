//! Occluders have no place in the lightmap and are written unchanged.

use atlas::{Layout, LayoutError, LayoutOptions, LayoutReport, layout};
use atlas_bake::{Manifest, ValueKind, write_lightmapped_glb, write_vertex_glb};
use gather::VertexLight;
use mesh_ingest::{LoadOptions, Loaded, Soup, load};
use serde_json::{Value, json};

/// Nodes: `both` (mesh 0: a wall and an occluder), `blocker` (mesh 0, an occluder by its node),
/// `screen` (mesh 1, all occluders).
fn level() -> Value {
    // 0,0,0 1,0,0 0,1,0 as floats.
    let corners: Vec<u8> = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let hex: String = corners.iter().map(|b| format!("%{b:02X}")).collect();
    let position = |material: u32| json!({"attributes": {"POSITION": 0}, "material": material});
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [
            {"name": "both", "mesh": 0},
            {"name": "blocker", "mesh": 0, "translation": [3, 0, 0], "extras": {"lumel": {"occluder": true}, "mine": 1}},
            {"name": "screen", "mesh": 1, "translation": [6, 0, 0]},
        ],
        "meshes": [{"primitives": [position(0), position(1)]}, {"primitives": [position(1)]}],
        "materials": [
            {"name": "wall"},
            {"name": "shadow", "extras": {"lumel": {"occluder": true}}, "emissiveFactor": [1, 1, 1]},
        ],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": format!("data:application/octet-stream,{hex}")}],
    })
}

fn open(level: &Value) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("level.gltf");
    std::fs::write(&file, level.to_string()).unwrap();
    load(&file, &LoadOptions::default()).unwrap()
}

fn lay_out(loaded: &Loaded) -> Result<(Layout, LayoutReport), LayoutError> {
    let soup = Soup::build(&loaded.scene);
    layout(&loaded.scene, &soup, &LayoutOptions::default(), &|_| true)
}

/// The JSON chunk of a .glb.
fn json_of(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

#[test]
fn only_what_receives_has_a_place() {
    let loaded = open(&level());
    let scene = &loaded.scene;
    let flags = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0)].map(|(i, p)| scene.receives(i, p));
    assert_eq!(flags, [true, false, false, false, false]);
    let (layout, report) = lay_out(&loaded).unwrap();
    let charted: Vec<Vec<usize>> = layout
        .meshes
        .iter()
        .map(|m| m.primitives.iter().map(|p| p.triangles.len()).collect())
        .collect();
    assert_eq!(charted, [vec![1, 0], vec![0]]);
    let widths: Vec<u32> = layout.placements.iter().map(|p| p.rect.w).collect();
    assert_eq!((widths[0] > 0, widths[1], widths[2]), (true, 0, 0));
    assert_eq!(layout.meshes[1].size, [0, 0]);
    assert_eq!((report.instances, report.meshes.len()), (1, 1));
    // The page is as large as without occluders.
    let mut alone = level();
    alone["scenes"][0]["nodes"] = json!([0]);
    alone["meshes"][0]["primitives"]
        .as_array_mut()
        .unwrap()
        .pop();
    let (lone, lone_report) = lay_out(&open(&alone)).unwrap();
    assert_eq!(lone.pages, layout.pages);
    assert_eq!(lone_report.texels_per_unit, report.texels_per_unit);
    let uris = ["level.lightmap.exr".to_string()];
    let manifest = Manifest::new(scene, &layout, "a.glb", &uris, ValueKind::Radiance).unwrap();
    let nodes: Vec<usize> = manifest.nodes.iter().map(|n| n.node).collect();
    assert_eq!(nodes, [0]);
}

#[test]
fn written_documents_keep_them_as_they_were() {
    let level = level();
    let loaded = open(&level);
    let (layout, _) = lay_out(&loaded).unwrap();
    let uris = ["level.lightmap.exr".to_string()];
    let (glb, stats) = write_lightmapped_glb(
        &loaded.document,
        &loaded.scene,
        &layout,
        &uris,
        ValueKind::Radiance,
    )
    .unwrap();
    let written = json_of(&glb);
    assert_eq!(stats.vertices_before, 3);
    assert_eq!(
        written["nodes"][0]["extras"]["lightmap"]["uri"],
        "level.lightmap.exr"
    );
    assert_eq!(written["nodes"][1], level["nodes"][1]);
    assert_eq!(written["nodes"][2], level["nodes"][2]);
    let wall = &written["meshes"][0]["primitives"][0]["attributes"];
    assert!(wall.get("TEXCOORD_1").is_some(), "{wall}");
    assert_eq!(
        written["meshes"][0]["primitives"][1],
        level["meshes"][0]["primitives"][1]
    );
    assert_eq!(written["meshes"][1], level["meshes"][1]);

    // Only receivers need light.
    let light = VertexLight {
        instances: vec![
            vec![vec![[1.0, 2.0, 3.0]; 3], Vec::new()],
            Vec::new(),
            vec![vec![[9.0; 3]; 3]],
        ],
        ..VertexLight::default()
    };
    let (glb, stats) = write_vertex_glb(&loaded.document, &loaded.scene, &light).unwrap();
    let written = json_of(&glb);
    assert_eq!(stats.vertices, 3);
    // Light on occluders is ignored, so 3/π is the largest.
    assert!((stats.scale - 3.0 / std::f32::consts::PI).abs() < 1e-6);
    // The wall shares its mesh with an occluder, so the wall's is a copy.
    let lit = written["nodes"][0]["mesh"].as_u64().unwrap() as usize;
    assert_ne!(lit, 0);
    assert_eq!(
        (&written["nodes"][1], &written["nodes"][2]),
        (&level["nodes"][1], &level["nodes"][2])
    );
    for mesh in 0..2 {
        assert_eq!(written["meshes"][mesh], level["meshes"][mesh]);
    }
    let primitives = &written["meshes"][lit]["primitives"];
    assert!(primitives[0]["attributes"].get("COLOR_0").is_some());
    assert_eq!(primitives[1], level["meshes"][0]["primitives"][1]);
    for material in 0..2 {
        assert_eq!(written["materials"][material], level["materials"][material]);
    }
}

#[test]
fn a_level_of_nothing_but_occluders_is_refused() {
    let mut level = level();
    level["extras"] = json!({"lumel": {"occluder": true}});
    assert!(matches!(
        lay_out(&open(&level)),
        Err(LayoutError::NothingReceives)
    ));
}
