//! The library as a program uses it: input and output in memory, threads, tokens, typed errors.

use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};

use lumel::{
    Bake, Baker, CancelToken, Error, MemoryDocument, Phase, Quality, SceneBuilder, Sun, Surface,
};
use serde_json::Value;

/// A floor under a lamp.
fn scene() -> SceneBuilder {
    let mut scene = SceneBuilder::new();
    let grey = scene.material(
        "grey",
        Surface {
            reflectance: [0.5; 3],
            ..Surface::default()
        },
    );
    let corners = [
        [-1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, -1.0],
        [-1.0, 0.0, -1.0],
    ];
    let square = scene.mesh("square", &corners, &[[0, 1, 2], [0, 2, 3]], grey);
    scene.place("floor", square, [0.0; 3]);
    scene.point_light("lamp", [0.0, 1.0, 0.0], [3.0; 3]);
    scene
}

fn baker<'a>() -> Baker<'a> {
    Baker::new().quality(Quality::Draft).texels_per_unit(8.0)
}

/// All files of a bake except the report, whose times differ; its record of contents stands for it.
fn files(bake: &Bake) -> (Vec<(String, Vec<u8>)>, String) {
    let (mut files, report) = bake.files().expect("files");
    files.pop();
    (files, report.content.key)
}

/// The .glb as a .gltf with a separate buffer whose name contains a space.
fn taken_apart(glb: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let word =
        |at: usize| u32::from_le_bytes([glb[at], glb[at + 1], glb[at + 2], glb[at + 3]]) as usize;
    let json = &glb[20..20 + word(12)];
    let bin = &glb[28 + json.len()..];
    let mut v: Value = serde_json::from_slice(json).expect("JSON");
    v["buffers"][0]["uri"] = "its%20data.bin".into();
    (v.to_string().into_bytes(), bin.to_vec())
}

#[test]
fn memory_and_disk_give_the_same_bytes() {
    let dir = tempfile::tempdir().expect("a folder");
    let glb = scene().glb();
    let path = dir.path().join("level.glb");
    std::fs::write(&path, &glb).expect("written");
    let from_disk = files(&baker().bake(&path).expect("baked"));
    let document = MemoryDocument::new("level.glb", glb.clone());
    let bake = baker().bake(&document).expect("baked");
    assert_eq!(files(&bake), from_disk);
    // Nothing was read from disk, so there is nothing to depend on.
    assert!(
        bake.input_paths(&Default::default(), &Default::default())
            .is_empty()
    );

    // The single results equal those of `files`.
    let (files, _) = &from_disk;
    let named = |end: &str| {
        &files
            .iter()
            .find(|(name, _)| name.ends_with(end))
            .expect(end)
            .1
    };
    assert_eq!(&bake.lightmapped_glb().expect("glb"), named("level.glb"));
    assert_eq!(&bake.vertex_glb().expect("glb"), named("vertex.glb"));
    assert_eq!(
        &bake.manifest().expect("manifest").to_json(),
        named("lightmap.json")
    );
}

#[test]
fn linked_files_come_from_a_folder_or_a_resolver() {
    let dir = tempfile::tempdir().expect("a folder");
    let (gltf, bin) = taken_apart(&scene().glb());
    let path = dir.path().join("level.gltf");
    std::fs::write(&path, &gltf).expect("written");
    std::fs::write(dir.path().join("its data.bin"), &bin).expect("written");
    let from_disk = files(&baker().bake(&path).expect("baked"));

    let document = || MemoryDocument::new("level.gltf", gltf.clone());
    let beside = document().beside(dir.path());
    let bake = baker().bake(&beside).expect("baked");
    assert_eq!(files(&bake), from_disk);
    let read = bake.input_paths(&Default::default(), &Default::default());
    assert_eq!(read, [dir.path().join("its data.bin")]);

    let resolved = document().resolve_with(move |name| match name {
        "its data.bin" => Ok(bin.clone()),
        other => Err(io::Error::new(io::ErrorKind::NotFound, other.to_owned())),
    });
    assert_eq!(files(&baker().bake(&resolved).expect("baked")), from_disk);

    // Without either, the error names the file and who references it.
    let error = baker().bake(&document()).expect_err("no buffer");
    assert_eq!(error.exit_code(), 2);
    let text = error.to_string();
    assert!(
        text.contains("its data.bin") && text.contains("buffers[0].uri"),
        "{text}"
    );
    assert!(text.contains("no folder or resolver"), "{text}");
}

#[test]
fn threads_and_watchers_change_no_byte() {
    let document = scene().finish("level.glb");
    let expected = files(&baker().bake(&document).expect("baked"));
    let calls = AtomicUsize::new(0);
    for threads in [1, 3] {
        let watched = baker().threads(threads).on_progress(|_| {
            calls.fetch_add(1, Ordering::Relaxed);
        });
        assert_eq!(files(&watched.bake(&document).expect("baked")), expected);
    }
    assert!(calls.load(Ordering::Relaxed) > 10);
    for threads in [0, 1025] {
        let error = baker()
            .threads(threads)
            .bake(&document)
            .expect_err("too few or many");
        assert!(
            matches!(error, Error::Setting(_)) && error.exit_code() == 1,
            "{error}"
        );
    }
}

#[test]
fn progress_counts_to_its_end() {
    let document = scene().finish("level.glb");
    let mut last = None;
    let (mut shares, mut residuals) = (0, 0);
    let baker = baker().threads(1).on_progress(|p| {
        residuals += usize::from(p.residual.is_some());
        if let Some(share) = p.share() {
            assert!(p.done <= p.total && (0.0..=1.0).contains(&share), "{p:?}");
            shares += 1;
        }
        if p.phase == Phase::Gather {
            last = Some(p);
        }
    });
    baker.bake(&document).expect("baked");
    drop(baker);
    assert!(shares > 0 && residuals > 0);
    // A single thread counts in order, so the last report of a phase says that it is done.
    assert_eq!(last.and_then(|p| p.share()), Some(1.0), "{last:?}");
}

#[test]
fn a_token_stops_all_bakes_that_have_it() {
    let document = scene().finish("level.glb");
    let token = CancelToken::new();
    let other = CancelToken::new();
    // Cancelled from within, at the first report of the solve.
    let from_within = baker().cancel_token(&token).on_progress(|p| {
        if p.phase == Phase::Solve {
            token.cancel();
        }
    });
    for baker in [&from_within, &baker().cancel_token(&token)] {
        let error = baker.bake(&document).expect_err("stopped");
        assert!(matches!(error, Error::Cancelled) && error.exit_code() == 75);
    }
    assert!(baker().cancel_token(&other).bake(&document).is_ok());
}

#[test]
fn a_baker_knows_what_it_has_baked() {
    let dir = tempfile::tempdir().expect("a folder");
    let (path, out) = (dir.path().join("level.glb"), dir.path().join("out"));
    std::fs::write(&path, scene().glb()).expect("written");
    assert!(baker().find_current(&path, &out).is_err());
    let written = baker()
        .bake(&path)
        .expect("baked")
        .write(&out)
        .expect("written");
    let current = baker().find_current(&path, &out).expect("it is current");
    assert_eq!(current.inputs, std::slice::from_ref(&path));
    assert_eq!(current.outputs, written);
    let brighter = baker().light("lamp", 2.0);
    let why = brighter
        .find_current(&path, &out)
        .expect_err("other settings");
    assert!(why.contains("settings"), "{why}");
}

#[test]
fn an_estimate_is_near_the_bake() {
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb");
    let baker = || Baker::new().quality(Quality::Draft).texels_per_unit(20.0);
    let estimate = baker().estimate(scene).expect("estimated");
    let bake = baker().bake(scene).expect("baked");
    let report = &bake.report;
    // Charts are cut at the edges of shadows, which a coarse solve finds as well.
    assert!(estimate.planned_twice);
    assert_eq!(estimate.layout.charts, report.layout.charts);
    assert_eq!(estimate.layout.pages, report.layout.pages);
    assert_eq!(
        estimate.files,
        bake.files()
            .expect("files")
            .0
            .iter()
            .map(|f| f.0.clone())
            .collect::<Vec<_>>()
    );
    let rays = report.solve.link_rays
        + report.solve.shadow_rays
        + report.gather.light.lumel_rays
        + report.gather.vertices.expect("vertices were baked").rays;
    // The accuracy promised for --dry-run. Time depends on the machine's load, the number of rays
    // does not.
    let ratio = rays as f64 / estimate.rays;
    let within = 1.0 / lumel::ESTIMATE_FACTOR..lumel::ESTIMATE_FACTOR;
    assert!(
        within.contains(&ratio),
        "{rays} rays, {} estimated",
        estimate.rays
    );
    assert!(estimate.seconds > 0.0 && estimate.seconds.is_finite());
}

#[test]
fn vertex_colours_are_there_for_all_that_receives_light() {
    // A sun of 2 lx straight down: E = 2 everywhere on an open floor, in lumels and vertices.
    let mut empty = SceneBuilder::new();
    let material = empty.material(
        "black",
        Surface {
            reflectance: [0.0; 3],
            ..Surface::default()
        },
    );
    let corners = [
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0],
    ];
    let normals = [[0.0, 1.0, 0.0]; 4];
    let mesh = empty.smooth_mesh(
        "tile",
        &corners,
        &normals,
        &[[0, 1, 2], [0, 2, 3]],
        material,
    );
    empty.place("left", mesh, [0.0; 3]);
    let mut right = [0.0f32; 16];
    for (i, x) in [(0, 1.0), (5, 1.0), (10, 1.0), (12, 5.0), (15, 1.0)] {
        right[i] = x;
    }
    empty.place_matrix("right", mesh, right);
    let bake = baker()
        .sun(Sun::new([0.0, -1.0, 0.0], 2.0))
        .bake(&empty.finish("tiles.glb"))
        .expect("baked");
    let lit: Vec<_> = bake.vertex_colors().collect();
    assert_eq!(
        lit.iter().map(|l| l.name).collect::<Vec<_>>(),
        ["left", "right"]
    );
    for l in &lit {
        assert_eq!((l.mesh, l.primitive, l.irradiance.len()), (0, 0, 4));
        // The sun is exact up to the f32 rounding of the fit.
        assert!(
            l.irradiance
                .iter()
                .flatten()
                .all(|e| (e - 2.0).abs() < 1e-4),
            "{l:?}"
        );
    }
    assert_eq!(bake.groups().count(), 0);
    assert!(bake.pages()[0].channel("direct.R").is_none());
}

#[test]
fn what_is_wrong_with_a_scene_in_code_is_told_when_it_is_baked() {
    let wrong = |positions: [[f32; 3]; 3], triangle| {
        let mut scene = SceneBuilder::new();
        let white = scene.material("white", Surface::default());
        let mesh = scene.mesh("broken", &positions, &[triangle], white);
        scene.place("broken", mesh, [0.0; 3]);
        baker().bake(&scene.finish("broken.glb")).err()
    };
    let sound = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert!(wrong(sound, [0, 1, 2]).is_none());
    for (positions, triangle) in [(sound, [0, 1, 3]), ([[f32::NAN; 3]; 3], [0, 1, 2])] {
        let error = wrong(positions, triangle).expect("broken");
        assert_eq!(error.exit_code(), 3, "{error}");
        assert!(error.to_string().contains("broken.glb"), "{error}");
    }
    let empty = baker().bake(&SceneBuilder::new().finish("empty.glb")).err();
    assert_eq!(empty.map(|e| e.exit_code()), Some(3));
}
