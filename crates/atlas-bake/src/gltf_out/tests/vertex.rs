//! Vertex colours.

use super::*;

/// E of each instance: constant over a primitive, π × (instance + 1).
pub(super) fn graded(scene: &Scene) -> VertexLight {
    let instances = scene.instances.iter().enumerate().map(|(i, instance)| {
        let primitives = scene.meshes[instance.mesh].primitives.iter();
        primitives
            .map(|p| vec![[PI * (i + 1) as f32; 3]; p.positions.len()])
            .collect()
    });
    VertexLight {
        instances: instances.collect(),
        ..VertexLight::default()
    }
}

#[test]
fn vertex_colours_times_material_times_scale_are_the_outgoing_radiance() {
    let fixture = Fixture::new();
    let (json, bin) = instanced();
    let loaded = fixture.load(&json, &bin);
    let (glb, stats) =
        write_vertex_glb(&loaded.document, &loaded.scene, &graded(&loaded.scene)).unwrap();
    // The brightest instance has R = 4.
    assert_eq!(
        (
            stats.scale,
            stats.vertices,
            stats.clamped,
            stats.meshes_copied,
            stats.nodes_added
        ),
        (4.0, 16, 0, 3, 3)
    );
    let back = fixture.reload(&glb);
    let out = back.document.json();
    assert_eq!(out["asset"]["extras"]["vertexLight"]["scale"], 4.0);
    assert_eq!(out["extensionsUsed"], json!(["KHR_materials_unlit"]));
    assert!(out.get("extensionsRequired").is_none());
    assert_eq!(out["nodes"][0]["children"].as_array().unwrap().len(), 3);
    assert!(out["nodes"][0].get("mesh").is_none());
    assert_eq!(back.scene.instances.len(), 4);
    // Order in the graph: the row's children, then the other node. Their transforms are those of
    // the copies.
    for (i, instance) in back.scene.instances.iter().enumerate() {
        let before = loaded.scene.instances[i].transform;
        // Bytes of 90/127 are a unit quaternion to 0.3 %, and ingest normalises it as well.
        assert!(
            instance.transform.abs_diff_eq(before, 1e-6),
            "{i}: {} for {before}",
            instance.transform
        );
        let mesh = &back.scene.meshes[instance.mesh];
        let raw = back.document.primitive_raw(mesh.gltf_mesh, 0).unwrap();
        let colors = raw.attribute("COLOR_0").unwrap().to_floats::<4>(1.0);
        // The tolerance is half a 16-bit step.
        let want = (i + 1) as f32 / 4.0;
        assert!(
            colors
                .iter()
                .all(|c| (c[0] - want).abs() <= 0.5 / 65535.0 && c[3] == 1.0),
            "{colors:?}"
        );
        let e = raw.attribute("_IRRADIANCE").unwrap().to_floats::<3>(0.0);
        assert!(e.iter().all(|e| *e == [PI * (i + 1) as f32; 3]));
        assert_eq!(
            out["nodes"][instance.node]["extras"]["vertexLight"]["scale"],
            4.0
        );
    }
    let material = &out["materials"][0];
    assert_eq!(
        material["pbrMetallicRoughness"],
        json!({"baseColorFactor": [0.5, 0.25, 1.0, 0.5]})
    );
    assert_eq!(
        (&material["alphaMode"], &material["extensions"]),
        (&json!("BLEND"), &json!({"KHR_materials_unlit": {}}))
    );
}

#[test]
fn meshes_that_deform_are_not_split() {
    let fixture = Fixture::new();
    let (json, bin) = rich();
    let split = |loaded: &Loaded| {
        let mut light = graded(&loaded.scene);
        for of in &mut light.instances {
            of[0].push([1.0; 3]);
        }
        let part = SplitPrimitive {
            parents: vec![[0, 2]],
            triangles: vec![
                (0, [0, 1, 4]),
                (0, [4, 1, 2]),
                (1, [0, 4, 3]),
                (1, [4, 2, 3]),
            ],
        };
        light.split = vec![vec![part]; light.instances.len()];
        let (glb, stats) = write_vertex_glb(&loaded.document, &loaded.scene, &light).unwrap();
        let back = fixture.reload(&glb);
        (
            back.document.primitive_raw(0, 0).unwrap().vertex_count,
            stats.vertices_added,
        )
    };
    let loaded = fixture.load(&json, &bin);
    assert_eq!(split(&loaded), (4, 0));
    // The same mesh without skin and morph targets is split.
    let mut rigid = json.clone();
    let primitive = rigid["meshes"][0]["primitives"][0].as_object_mut().unwrap();
    primitive.remove("targets");
    let attributes = primitive["attributes"].as_object_mut().unwrap();
    attributes.remove("JOINTS_0");
    attributes.remove("WEIGHTS_0");
    rigid["meshes"][0]
        .as_object_mut()
        .unwrap()
        .remove("weights");
    let loaded = fixture.load(&rigid, &bin);
    assert_eq!(split(&loaded), (5, 2));
}

#[test]
fn own_colours_multiply_and_keep_their_alpha() {
    let fixture = Fixture::new();
    let (json, bin) = rich();
    let loaded = fixture.load(&json, &bin);
    let (glb, stats) =
        write_vertex_glb(&loaded.document, &loaded.scene, &graded(&loaded.scene)).unwrap();
    let back = fixture.reload(&glb);
    let raw = back.document.primitive_raw(0, 0).unwrap();
    let colors = raw.attribute("COLOR_0").unwrap().to_floats::<4>(1.0);
    // Vertex 3 of the first instance: R = 1, c = (100, 110, 120)/255, alpha 0.
    let want = [100.0, 110.0, 120.0].map(|c| c / 255.0 / stats.scale);
    for c in 0..3 {
        assert!(
            (colors[3][c] - want[c]).abs() <= 0.5 / 65535.0 + 1e-7,
            "{:?}",
            colors[3]
        );
    }
    assert_eq!(colors[3][3], 0.0);
    // The points are not baked and share the material, which therefore stays lit for them.
    let out = back.document.json();
    assert_eq!(out["materials"][0], json["materials"][0]);
    assert_eq!(out["meshes"][0]["primitives"][0]["material"], 1);
    assert!(
        out["materials"][1]["extensions"]
            .get("KHR_materials_unlit")
            .is_some()
    );
}

#[test]
fn glowing_surfaces_show_their_glow() {
    let fixture = Fixture::new();
    let mut b = Builder::default();
    let position = b.floats(&QUAD);
    let json = json!({"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1.0]}, "emissiveFactor": [1.0, 0.5, 0.0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}}}],
        "extensionsUsed": ["KHR_materials_emissive_strength"],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position}, "indices": b.indices(&[0, 1, 2, 0, 2, 3]), "material": 0}]}]});
    let (json, bin) = b.finish(json);
    let loaded = fixture.load(&json, &bin);
    let (glb, stats) =
        write_vertex_glb(&loaded.document, &loaded.scene, &graded(&loaded.scene)).unwrap();
    // ρR + L_e = 0.5 + (4, 2, 0).
    assert_eq!((stats.scale, stats.clamped), (4.5, 0));
    let back = fixture.reload(&glb);
    let color = back
        .document
        .primitive_raw(0, 0)
        .unwrap()
        .attribute("COLOR_0")
        .unwrap()
        .to_floats::<3>(0.0)[0];
    for (got, want) in color.iter().zip([4.5, 2.5, 0.5]) {
        assert!(
            (got * 4.5 - want).abs() <= 4.5 * 0.5 / 65535.0 + 1e-6,
            "{color:?}"
        );
    }
    let out = back.document.json();
    assert_eq!(
        out["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"],
        json!([1.0, 1.0, 1.0, 1.0])
    );
    assert!(out["materials"][0].get("emissiveFactor").is_none());
    assert_eq!(out["extensionsUsed"], json!(["KHR_materials_unlit"]));
}

#[test]
fn hot_spots_are_clamped_and_unusable_light_is_black() {
    let fixture = Fixture::new();
    let (json, bin) = instanced();
    let loaded = fixture.load(&json, &bin);
    let mut light = graded(&loaded.scene);
    for p in light.instances.iter_mut().flatten() {
        p.fill([PI; 3]);
    }
    light.instances[0][0][0] = [PI * 1e6; 3];
    light.instances[0][0][1] = [f32::NAN, 1.0, 1.0];
    light.instances[0][0][2] = [-1.0, PI, PI];
    let (glb, stats) = write_vertex_glb(&loaded.document, &loaded.scene, &light).unwrap();
    assert_eq!((stats.scale, stats.clamped, stats.unusable), (16.0, 1, 2));
    let back = fixture.reload(&glb);
    let raw = back.document.primitive_raw(0, 0).unwrap();
    let colors = raw.attribute("COLOR_0").unwrap().to_floats::<3>(0.0);
    assert_eq!(
        (colors[0], colors[1], colors[2][0]),
        ([1.0; 3], [0.0; 3], 0.0)
    );
    assert_eq!(
        raw.attribute("_IRRADIANCE").unwrap().to_floats::<3>(1.0)[1],
        [0.0; 3]
    );
    let dark = VertexLight {
        instances: light
            .instances
            .iter()
            .map(|i| i.iter().map(|p| vec![[0.0; 3]; p.len()]).collect())
            .collect(),
        ..VertexLight::default()
    };
    assert_eq!(
        write_vertex_glb(&loaded.document, &loaded.scene, &dark)
            .unwrap()
            .1
            .scale,
        1.0
    );
}
