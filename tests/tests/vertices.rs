//! Light at vertices: its accuracy, sharing between faces, and where triangles are split.

use std::collections::BTreeMap;

use crate::common::{at, bake};
use glam::{DVec3, Vec3};
use lumel::mesh_ingest::{LoadOptions, Loaded, load};
use lumel::{Bake, Hidden, Quality, Settings};
use lumel_tests::geometry::{Geometry, box_faces, grid};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use lumel_tests::scenes::closed_form::point_irradiance;

/// A mesh of these black primitives under a lamp of 4 candela at `lamp`.
fn lit(primitives: &[&Geometry], lamp: Vec3) -> Vec<u8> {
    painted(primitives, 0.0, lamp)
}

/// A mesh of these grey primitives under that lamp.
fn painted(primitives: &[&Geometry], reflectance: f32, lamp: Vec3) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let parts: Vec<_> = primitives
        .iter()
        .map(|g| {
            let paint = Material::diffuse("paint", [reflectance; 3]);
            (*g, b.material(&paint))
        })
        .collect();
    let mesh = b.mesh("mesh", &parts);
    b.node(Node::of_mesh("node", mesh));
    let light = b.light("lamp", Light::Point([4.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: lamp,
        light: Some(light),
        ..Node::default()
    });
    b.finish()
}

/// A floor of 2 m around the origin, with `n` cells per edge.
fn floor(n: u32) -> Geometry {
    let corner = Vec3::new(-1.0, 0.0, 1.0);
    grid(corner, Vec3::X * 2.0, Vec3::Z * -2.0, [n, n])
}

/// Every triangle with its own vertices.
fn torn(g: &Geometry) -> Geometry {
    let corners: Vec<usize> = g.triangles.iter().flatten().map(|v| *v as usize).collect();
    Geometry {
        positions: corners.iter().map(|v| g.positions[*v]).collect(),
        normals: corners.iter().map(|v| g.normals[*v]).collect(),
        triangles: (0..g.triangles.len() as u32)
            .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
            .collect(),
        ..Geometry::default()
    }
}

#[test]
fn vertices_of_one_place_and_normal_have_one_light_and_hard_edges_have_two() {
    // A floor in two primitives, with separate triangles, and a wall at its edge. At 8 lumels per
    // metre its triangles have some lumels each, at 1 less than one: fitted and gathered.
    for density in [8.0, 1.0] {
        let whole = torn(&floor(4));
        let half = |part: usize| {
            let mut g = whole.clone();
            g.triangles = whole.triangles.chunks(16).nth(part).unwrap().to_vec();
            g
        };
        let wall = grid(
            Vec3::new(-1.0, 0.0, -1.0),
            Vec3::X * 2.0,
            Vec3::Y * 2.0,
            [4, 4],
        );
        let mut parts = [half(0), half(1), torn(&wall)];
        for g in &mut parts[..2] {
            g.uv.clear();
        }
        let b = bake(
            &lit(&[&parts[0], &parts[1], &parts[2]], Vec3::new(0.3, 0.8, 0.2)),
            &at(density),
        );
        let mut by_place: BTreeMap<([u32; 3], bool), Vec<[f32; 3]>> = BTreeMap::new();
        let light = &b.baked.vertices.instances[0];
        for (p, g) in parts.iter().enumerate() {
            for t in &g.triangles {
                for &v in t {
                    let v = v as usize;
                    let place = (g.positions[v] + Vec3::ZERO).to_array().map(f32::to_bits);
                    by_place
                        .entry((place, p == 2))
                        .or_default()
                        .push(light[p][v]);
                }
            }
        }
        let mut shared = 0;
        for lights in by_place.values() {
            assert!(lights.iter().all(|l| l == &lights[0]), "{lights:?}");
            shared += usize::from(lights.len() > 1);
        }
        assert!(shared >= 40, "{shared}");
        // At the common edge, floor and wall differ: the lamp is nearer to one of them, and shines
        // at another angle.
        let mut edges = 0;
        for ((place, of_wall), lights) in &by_place {
            if !of_wall && let Some(other) = by_place.get(&(*place, true)) {
                assert!((lights[0][0] / other[0][0] - 1.0).abs() > 0.05);
                edges += 1;
            }
        }
        assert_eq!(edges, 5);
    }
}

/// ∫ over the floor's triangles of `f(position, φ of the corners)`, by the midpoints of `n`² parts
/// of each.
fn integrate(g: &Geometry, n: u32, mut f: impl FnMut(&[u32; 3], DVec3, [f64; 3], f64)) {
    for t in &g.triangles {
        let [a, b, c] = t.map(|v| g.positions[v as usize].as_dvec3());
        let area = 0.5 * (b - a).cross(c - a).length() / f64::from(n * n);
        let mut put = |u: f64, v: f64| {
            let phi = [1.0 - u - v, u, v];
            f(t, a * phi[0] + b * phi[1] + c * phi[2], phi, area);
        };
        for i in 0..n {
            for j in 0..n - i {
                let (x, y, h) = (f64::from(i), f64::from(j), f64::from(n));
                put((x + 1.0 / 3.0) / h, (y + 1.0 / 3.0) / h);
                if i + j + 1 < n {
                    put((x + 2.0 / 3.0) / h, (y + 2.0 / 3.0) / h);
                }
            }
        }
    }
}

#[test]
fn fitted_light_is_nearer_to_the_truth_than_means_are() {
    // A lamp 0.5 m above cells of 0.5 m: interpolated means of the light around each vertex would
    // be too flat.
    let (g, lamp) = (floor(4), DVec3::new(0.1, 0.5, 0.2));
    let truth = |p: DVec3| point_irradiance(4.0, lamp.y, (p.x - lamp.x).hypot(p.z - lamp.z));
    let b = bake(&lit(&[&g], lamp.as_vec3()), &at(32.0));
    let mut sums = vec![(0.0, 0.0); g.positions.len()];
    integrate(&g, 32, |t, p, phi, area| {
        for (v, phi) in t.iter().zip(phi) {
            sums[*v as usize].0 += area * phi * truth(p);
            sums[*v as usize].1 += area * phi;
        }
    });
    let means: Vec<f64> = sums.iter().map(|(e, w)| e / w).collect();
    let fitted: Vec<f64> = b.baked.vertices.instances[0][0]
        .iter()
        .map(|e| f64::from(e[0]))
        .collect();
    let error = |values: &[f64]| {
        let (mut errors, mut squares) = (0.0, 0.0);
        integrate(&g, 32, |t, p, phi, area| {
            let there: f64 = t
                .iter()
                .zip(phi)
                .map(|(v, phi)| values[*v as usize] * phi)
                .sum();
            errors += area * (there - truth(p)).powi(2);
            squares += area * truth(p).powi(2);
        });
        (errors / squares).sqrt()
    };
    let (means, fitted) = (error(&means), error(&fitted));
    assert!(fitted < 0.65 * means, "{fitted} {means}");
    // The report gives that error, except that lumels' means are a little flatter than the truth:
    // h²/24 E'' of 3 cm under 0.5 m is some 1e-3 of the light, a tenth of the error.
    let reported = b
        .report
        .gather
        .vertices
        .expect("vertices were baked")
        .difference
        .relative_rms;
    assert!((reported / fitted - 1.0).abs() < 0.1, "{reported} {fitted}");
    assert_eq!(
        b.report
            .gather
            .vertices
            .expect("vertices were baked")
            .points,
        25
    );
    assert_eq!(
        b.report
            .gather
            .vertices
            .expect("vertices were baked")
            .gathered,
        0
    );
}

/// A room of 2 m whose faces are separate primitives without shared vertices, and a lamp off its
/// middle.
fn room() -> Vec<u8> {
    let faces = box_faces(Vec3::ZERO, Vec3::splat(2.0), 1).map(Geometry::flipped);
    let refs: Vec<&Geometry> = faces.iter().collect();
    lit(&refs, Vec3::new(0.7, 1.4, 1.1))
}

fn with_splits(error: Option<f32>) -> Bake {
    let settings = Settings {
        vertex_error: error,
        quality: Quality::Draft,
        ..at(24.0)
    };
    bake(&room(), &settings)
}

/// The written scene with vertex colours, read back.
fn vertex_scene(b: &Bake, dir: &std::path::Path) -> Loaded {
    b.write(dir).expect("written");
    load(&dir.join("scene.vertex.glb"), &LoadOptions::default()).expect("it loads")
}

#[test]
fn split_triangles_fit_together_and_come_close_to_the_lightmap() {
    let dir = tempfile::tempdir().expect("a folder");
    let whole = with_splits(None);
    let before = whole.report.gather.vertices.expect("vertices were baked");
    assert_eq!((before.added, before.full), (0, 0));
    let mut last = before.difference.relative_rms;
    for error in [0.2, 0.05] {
        let b = with_splits(Some(error));
        let report = b.report.gather.vertices.expect("vertices were baked");
        assert!(report.added > 0 && report.difference.relative_rms < last);
        last = report.difference.relative_rms;
        // No triangle exceeds the requested error, so neither does the whole.
        assert!(last < f64::from(error), "{last}");
        let back = vertex_scene(&b, dir.path());
        let mesh = &back.scene.meshes[0];
        // On a closed surface every edge, by positions, has a triangle on either side. A corner on
        // another's edge would leave an edge with only one.
        let mut edges: BTreeMap<[[u32; 3]; 2], [u32; 2]> = BTreeMap::new();
        let (mut area, mut vertices) = (0.0, 0);
        for p in &mesh.primitives {
            vertices += p.positions.len();
            for t in &p.triangles {
                let at = t.map(|v| p.positions[v as usize]);
                area += f64::from(0.5 * (at[1] - at[0]).cross(at[2] - at[0]).length());
                for k in 0..3 {
                    let ends = [at[k], at[(k + 1) % 3]];
                    let key = ends.map(|e| (e + Vec3::ZERO).to_array().map(f32::to_bits));
                    let (sorted, side) = if key[0] < key[1] {
                        (key, 0)
                    } else {
                        ([key[1], key[0]], 1)
                    };
                    edges.entry(sorted).or_default()[side] += 1;
                }
            }
            // A plane face: anything linear in the position stays linear.
            let (p0, uv) = (&p.positions, &p.tex_coords[0]);
            let normal = p.normals[0];
            for (v, n) in p.normals.iter().enumerate() {
                assert!(n.dot(normal) > 0.99999);
                assert!((p0[v] - p0[0]).dot(normal).abs() < 1e-5);
                // Metres along both edges (see `grid`): distances on the texture are those in
                // space.
                let (a, b) = (p0[v].distance(p0[0]), uv[v].distance(uv[0]));
                assert!((a - b).abs() < 1e-5, "{a} {b}");
            }
        }
        assert!(edges.values().all(|uses| *uses == [1, 1]), "error {error}");
        assert!((area - 24.0).abs() < 1e-4, "{area}");
        assert_eq!(vertices as u64, 24 + report.added);
        // Corners that faces share in space are split alike, and have a colour on each face.
        let own = &back.document.json()["meshes"][0]["primitives"][0]["attributes"];
        assert!(own["COLOR_0"].is_u64() && own["_IRRADIANCE"].is_u64());
    }
}

#[test]
fn splitting_is_the_same_for_any_number_of_threads() {
    let bytes = |threads: usize| {
        let pool = rayon_pool(threads);
        pool.install(|| {
            let b = with_splits(Some(0.1));
            let (files, _) = b.files().expect("files");
            let of = |end: &str| {
                let file = files.iter().find(|(name, _)| name.ends_with(end));
                file.expect("written").1.clone()
            };
            of(".vertex.glb")
        })
    };
    assert!(bytes(1) == bytes(3));
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool")
}

/// Light of the vertices of a primitive of the one node.
fn light_of(b: &Bake, primitive: usize) -> Vec<f64> {
    let light = &b.baked.vertices.instances[0][primitive];
    light.iter().map(|e| f64::from(e[0])).collect()
}

#[test]
fn vertices_closer_than_lumels_read_them() {
    // Four cells per lumel. At 8 lumels per metre, light would change by 3/2h · √2 d = 53 % from
    // tap to tap where it falls fastest, more than is trusted; here by 27 %.
    let (g, lamp) = (floor(64), DVec3::new(0.1, 0.5, 0.2));
    let b = bake(&lit(&[&g], lamp.as_vec3()), &at(16.0));
    let report = b.report.gather.vertices.expect("vertices were baked");
    assert_eq!(report.points, 65 * 65);
    // Neither lumels cut by the border nor lookups half a lumel beyond the last whole one are read:
    // four rings of vertices at most.
    assert_eq!(report.read + report.gathered, report.points);
    assert!(report.read >= 57 * 57, "{report:?}");
    let truth = |p: Vec3| {
        let p = p.as_dvec3();
        point_irradiance(4.0, lamp.y, (p.x - lamp.x).hypot(p.z - lamp.z))
    };
    // Right under the lamp E'' is 3 E/h² along either axis. A lumel of d = 0.0625 m has the mean,
    // d²/24 of both too low together, and lines between lumels are d²/8 of both too low at worst:
    // (1/24 + 1/8) · 6 d²/h² = 1.6 % of the light there. The noise of lumels' own samples of a lamp
    // is negligible.
    let most = truth(Vec3::new(0.1, 0.0, 0.2));
    for (v, e) in light_of(&b, 0).into_iter().enumerate() {
        let expected = truth(g.positions[v]);
        assert!(
            (e - expected).abs() < 0.02 * most,
            "{} {e} {expected}",
            g.positions[v]
        );
    }
}

#[test]
fn vertices_beside_a_wall_do_not_read_the_light_beyond() {
    // A dense floor under a wall of 2 cm, with lumels of 12.5 cm, and a sheet 1 mm below it that
    // faces down. Without cuts, because vertices are looked up in their order.
    let ground = floor(64);
    let below = {
        let mut g = floor(64).flipped();
        g.positions.iter_mut().for_each(|p| p.y -= 1e-3);
        g
    };
    let wall = box_faces(
        Vec3::new(-0.01, -0.0005, -4.0),
        Vec3::new(0.01, 8.0, 4.0),
        1,
    );
    let lamp = Vec3::new(0.4, 0.5, 0.2);
    let mut parts = vec![&ground, &below];
    parts.extend(&wall);
    let settings = Settings {
        cut_charts: false,
        ..at(8.0)
    };
    let glb = lit(&parts, lamp);
    let b = bake(&glb, &settings);
    let report = b.report.gather.vertices.expect("vertices were baked");
    assert!(report.read > report.gathered, "{report:?}");
    let light = light_of(&b, 0);
    let most = light.iter().copied().fold(0.0, f64::max);
    let (mut dark, mut lit) = (0, 0);
    for (p, e) in ground.positions.iter().zip(&light) {
        // Nothing there is lit or reflects: any light came through the wall.
        if p.x < -0.02 {
            assert!(*e < 1e-6 * most, "{p} {e} of {most}");
            dark += 1;
        }
        // The floor right beside the wall is as bright as without one, except for lumels that the
        // wall cuts.
        if p.x > 0.02 && p.x < 0.1 {
            let r = f64::from(p.x - lamp.x).hypot(f64::from(p.z - lamp.z));
            let expected = point_irradiance(4.0, 0.5, r);
            assert!((e / expected - 1.0).abs() < 0.25, "{p} {e} {expected}");
            lit += 1;
        }
    }
    assert!(dark > 31 * 65 && lit == 3 * 65, "{dark} {lit}");
    assert!(light_of(&b, 1).iter().all(|e| *e < 1e-6 * most));

    // The same with cuts, by the vertices' places.
    let b = bake(&glb, &at(8.0));
    let primitives = &b.loaded.scene.meshes[b.loaded.scene.instances[0].mesh].primitives;
    assert!(primitives.len() > parts.len());
    let mut dark = 0;
    for (k, primitive) in primitives.iter().enumerate() {
        for (p, e) in primitive.positions.iter().zip(light_of(&b, k)) {
            if p.y == 0.0 && p.x < -0.02 {
                assert!(e < 1e-6 * most, "{p} {e} of {most}");
                dark += 1;
            }
        }
    }
    assert!(dark > 31 * 65, "{dark}");
}

#[test]
fn gathered_light_is_smoothed_but_not_through_a_wall() {
    // One dense floor through two closed white rooms, one of which has a lamp. Nothing is read from
    // lumels, because they hold the mean including hidden parts. Without cuts, because vertices are
    // looked up in their order.
    let (low, high) = (Vec3::new(-1.0, 0.0, -1.0), Vec3::new(1.0, 1.0, 1.0));
    let mut room = box_faces(low, high, 1).map(Geometry::flipped);
    room[2] = floor(32);
    let (thick, out) = (Vec3::new(0.01, 1.01, 1.01), Vec3::new(0.01, 0.01, 1.01));
    let wall = box_faces(-out, thick, 1);
    let parts: Vec<&Geometry> = room.iter().chain(&wall).collect();
    let settings = Settings {
        hidden: Hidden::Mean,
        quality: Quality::Draft,
        cut_charts: false,
        ..at(8.0)
    };
    let b = bake(&painted(&parts, 0.8, Vec3::new(0.5, 0.6, 0.2)), &settings);
    let report = b.report.gather.vertices.expect("vertices were baked");
    assert_eq!(report.read, 0);
    let light = light_of(&b, 2);
    let most = light.iter().copied().fold(0.0, f64::max);
    let mut dark = 0;
    for (p, e) in room[2].positions.iter().zip(&light) {
        if p.x < -0.02 {
            assert!(*e < 1e-6 * most, "{p} {e} of {most}");
            dark += 1;
        } else if p.x > 0.02 {
            assert!(*e > 0.05 * most, "{p} {e} of {most}");
        }
    }
    assert_eq!(dark, 16 * 33);
    // Variation from vertex to vertex is noise: fourth differences keep (h/0.6 m)⁴ of smooth light,
    // and √70 of the noise's standard deviation.
    let at = |x: usize, z: usize| light[z * 33 + x];
    let (mut squares, mut count) = (0.0, 0.0);
    for (x, z) in (18..31).flat_map(|x| (4..29).map(move |z| (x, z))) {
        let bent =
            at(x, z - 2) - 4.0 * at(x, z - 1) + 6.0 * at(x, z) - 4.0 * at(x, z + 1) + at(x, z + 2);
        squares += (bent / at(x, z)).powi(2) / 70.0;
        count += 1.0;
    }
    let noise = f64::sqrt(squares / count);
    // 2.5 % as gathered, 1.2 % smoothed; the limit is the geometric mean.
    assert!(noise < 0.017, "{noise}");
}
