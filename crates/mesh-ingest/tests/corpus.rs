//! Every collected scene, valid or broken: no panic, no hang, and valid ones load.

use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use mesh_ingest::{Error, LoadOptions, Soup, load};

/// Most time for a load, as promised for hostile files.
const PATIENCE: Duration = Duration::from_secs(10);

fn collect(at: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(at).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
            files.push(path);
        }
    }
}

#[test]
#[allow(
    clippy::print_stdout,
    reason = "tells a reader of the log that nothing was tested"
)]
fn corpus() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes");
    let Ok(manifest) = std::fs::read_to_string(scenes.join("bad/MANIFEST.tsv")) else {
        println!("skipped: no shared scenes");
        return;
    };
    let invalid: Vec<PathBuf> = manifest
        .lines()
        .skip(1)
        .filter_map(|line| {
            let mut fields = line.split('\t');
            let name = fields.next()?;
            (fields.nth(1)? != "valid").then(|| scenes.join("bad").join(name))
        })
        .collect();
    let mut files = Vec::new();
    collect(&scenes, &mut files);
    assert!(files.len() > 300, "only {} scenes found", files.len());
    for file in files {
        let (sender, receiver) = mpsc::channel();
        let path = file.clone();
        let worker = std::thread::spawn(move || {
            let outcome = load(&path, &LoadOptions::default()).map(|loaded| check(&path, &loaded));
            let _ = sender.send(outcome);
        });
        match receiver.recv_timeout(PATIENCE) {
            Ok(Ok(())) => {}
            Ok(Err(Error::Unsupported { .. } | Error::NoTriangles { .. })) => {}
            Ok(Err(error)) => assert!(
                // Inputs that once broke the loader must give an error in time; some of them are
                // valid.
                invalid.contains(&file) || file.starts_with(scenes.join("reproducers")),
                "{} is valid but: {error}",
                file.display()
            ),
            Err(mpsc::RecvTimeoutError::Timeout) => {
                panic!("{} takes more than {PATIENCE:?}", file.display())
            }
            Err(mpsc::RecvTimeoutError::Disconnected) => panic!("{} panics", file.display()),
        }
        worker.join().unwrap();
    }
}

/// Checks the guarantees of [`mesh_ingest::Scene`], and reads everything that a writer needs.
fn check(file: &Path, loaded: &mesh_ingest::Loaded) {
    let name = file.display();
    let scene = &loaded.scene;
    for mesh in &scene.meshes {
        assert!(!mesh.primitives.is_empty(), "{name}");
        for p in &mesh.primitives {
            let vertices = p.positions.len();
            assert!(
                !p.triangles.is_empty() && p.triangles.len() == p.source_triangles.len(),
                "{name}"
            );
            assert!(
                p.triangles
                    .iter()
                    .flatten()
                    .all(|&i| (i as usize) < vertices),
                "{name}"
            );
            assert!(p.positions.iter().all(|x| x.is_finite()), "{name}");
            assert!(
                p.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5),
                "{name}"
            );
            assert!(
                p.normals.is_empty() || p.normals.len() == vertices,
                "{name}"
            );
            assert!(p.colors.is_empty() || p.colors.len() == vertices, "{name}");
            assert!(
                p.tex_coords
                    .iter()
                    .all(|set| set.is_empty() || set.len() == vertices),
                "{name}"
            );
            assert!(p.material < scene.materials.len(), "{name}");
            let raw = loaded
                .document
                .primitive_raw(mesh.gltf_mesh, p.gltf_primitive)
                .unwrap();
            assert_eq!(raw.vertex_count, vertices, "{name}");
            for (t, &source) in p.triangles.iter().zip(&p.source_triangles) {
                assert_eq!(*t, raw.triangles[source as usize], "{name}");
            }
        }
    }
    let soup = Soup::build(scene);
    assert_eq!(soup.instance_ranges.len(), scene.instances.len(), "{name}");
    assert_eq!(
        soup.instance_ranges.last().map(|r| r[1] as usize),
        Some(soup.len()),
        "{name}"
    );
    for tri in 0..soup.len() as u32 {
        let i = tri as usize;
        assert!(soup.areas[i] > 0.0 && soup.areas[i].is_finite(), "{name}");
        assert!((soup.normals[i].length() - 1.0).abs() < 1e-5, "{name}");
        let color = scene.base_color(&soup, tri, 0.3, 0.3);
        assert!(
            color.min_element() >= 0.0 && color.max_element() <= 1.0,
            "{name}: {color}"
        );
        assert!(
            scene.emission(&soup, tri, 0.3, 0.3).min_element() >= 0.0,
            "{name}"
        );
        assert!(
            scene
                .shading_normal(&soup, tri, 0.3, 0.3)
                .dot(soup.normals[i])
                >= 0.0,
            "{name}"
        );
    }
}
