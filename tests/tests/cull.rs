//! `--cull-unseen`: surfaces that players cannot see have no lumels, and the others do not change.

use glam::Vec3;
use lumel::{Bake, Error, Settings, Silent};
use lumel_tests::geometry::{cuboid, room};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use serde_json::{Value, json};

use crate::common::{at, bake, lumels_of};

/// A house: walls 0.2 m thick as one mesh, inside and outside; a crate inside it, one outside, and
/// a closed box with an object in it. A lamp hangs inside.
fn house(walkable: Option<Value>, camera: bool) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let mut walls = room(Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 2.5, 2.0), 1);
    let outside = cuboid(Vec3::new(-2.2, -0.2, -2.2), Vec3::new(2.2, 2.7, 2.2), 1);
    walls.append(&outside);
    let mut place = |name: &str, g: lumel_tests::geometry::Geometry| {
        let mesh = b.mesh(name, &[(&g.bare(), grey)]);
        b.node(Node::of_mesh(name, mesh));
    };
    place("walls", walls);
    place(
        "inside",
        cuboid(Vec3::new(0.5, 0.3, 0.5), Vec3::new(1.0, 0.8, 1.0), 1),
    );
    place(
        "outside",
        cuboid(Vec3::new(4.0, 0.0, 4.0), Vec3::new(5.0, 1.0, 5.0), 1),
    );
    if let Some(extras) = walkable {
        b.node(Node {
            name: "walk".into(),
            translation: Vec3::new(0.0, 1.6, 0.0),
            scale: Vec3::new(1.5, 0.1, 1.5),
            extras: Some(extras),
            ..Node::default()
        });
    }
    if camera {
        let camera = b.camera("eye", 1.0, 1.0);
        b.node(Node {
            translation: Vec3::new(-1.0, 1.6, 0.0),
            camera: Some(camera),
            ..Node::default()
        });
    }
    let lamp = b.light("lamp", Light::Point([5.0; 3]));
    b.node(Node {
        translation: Vec3::new(0.0, 2.0, 0.0),
        light: Some(lamp),
        ..Node::default()
    });
    b.finish()
}

fn settings(cull: bool) -> Settings {
    Settings {
        cull_unseen: cull,
        ..at(6.0)
    }
}

fn walkable() -> Option<Value> {
    Some(json!({"lumel": {"walkable": true}}))
}

/// Lumels on the outside of the walls, and on the inside.
fn sides(b: &Bake) -> [usize; 2] {
    let lumels = lumels_of(b, "walls");
    let out = |p: glam::DVec3| p.x.abs() > 2.1 || p.z.abs() > 2.1 || p.y < -0.1 || p.y > 2.6;
    let outside = lumels.iter().filter(|l| out(l.middle())).count();
    [outside, lumels.len() - outside]
}

#[test]
fn outsides_and_hidden_things_lose_their_lumels() {
    let plain = bake(&house(walkable(), false), &settings(false));
    let culled = bake(&house(walkable(), false), &settings(true));
    let ([out, within], [none, same]) = (sides(&plain), sides(&culled));
    assert!(out > within, "an outside is larger: {out} {within}");
    assert_eq!(none, 0);
    // Charts of the inside are cut and placed again, so their texels may differ.
    assert!(same.abs_diff(within) * 10 < within, "{same} {within}");
    let report = culled.report.culled.as_ref().expect("a report");
    assert_eq!(report.from, "walkable");
    assert_eq!(report.nodes.len(), 1, "{report:?}");
    assert!(report.nodes[0].contains("outside"), "{report:?}");
    // The outside, the crate there, and the underside of the crate inside.
    assert!(report.area > 0.5 && report.triangles == 26, "{report:?}");
    // Visible surfaces keep their light: the crate's lumels see the same room.
    let mean = |b: &Bake| {
        let mut lumels = lumels_of(b, "inside");
        lumels.retain(|l| l.middle().y > 0.31);
        crate::common::mean(&lumels)
    };
    let (a, b) = (mean(&plain), mean(&culled));
    assert!((a / b - 1.0).abs() < 0.02, "{a} {b}");
    // The files keep everything: no vertex and no triangle is lost.
    let dir = tempfile::tempdir().expect("a folder");
    culled.write(dir.path()).expect("written");
    let again = lumel::mesh_ingest::load(&dir.path().join("scene.glb"), &Default::default());
    let again = again.expect("the .glb");
    let triangles = |s: &lumel::mesh_ingest::Scene| -> usize {
        let all = s.meshes.iter().flat_map(|m| &m.primitives);
        all.map(|p| p.triangles.len()).sum()
    };
    assert_eq!(triangles(&again.scene), triangles(&plain.loaded.scene));
}

#[test]
fn cameras_flood_the_room_that_they_are_in() {
    let b = bake(&house(None, true), &settings(true));
    assert_eq!(sides(&b)[0], 0);
    assert_eq!(b.report.culled.expect("a report").from, "cameras");
}

#[test]
fn without_a_place_to_walk_it_is_an_error() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("level.glb");
    std::fs::write(&path, house(None, false)).expect("written");
    let e = lumel::bake(&path, &settings(true), &Silent).expect_err("nowhere");
    assert!(matches!(e, Error::Setting(_)) && e.to_string().contains("walkable"));
    let named = Settings {
        walkable: vec!["inside".into()],
        ..settings(true)
    };
    lumel::bake(&path, &named, &Silent).expect("the box of a node");
}
