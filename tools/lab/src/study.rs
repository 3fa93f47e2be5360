//! `lumel-lab studies`: the rooms as files, and the baseline's answer for each.

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use glam::{DVec3, Vec3};
use lumel_tests::geometry::Geometry;
use lumel_tests::gltf::{GltfBuilder, Material, Node, look_along};
use method_lab::study::{
    Case, Detail, Room, barycentre_matrix, cases, gather_times, largest_eigenvalue, row_sums,
    vertex_radiosity,
};
use method_lab::{Enclosure, Matrix};
use serde_json::{Value, json};

/// Position of the camera: in front of the room, whose front wall is seen from behind and is
/// therefore invisible.
const EYE: Vec3 = Vec3::new(1.75, 1.125, 7.9);
const TARGET: Vec3 = Vec3::new(1.75, 1.125, 0.0);
/// Vertical field of view, degrees, and width over height: the front opening, 3.5 × 2.25 m at 4.4
/// m, fills the picture.
const FIELD: f32 = 28.68;
const ASPECT: f32 = 14.0 / 9.0;

/// The case for which the baseline also runs with occlusion, to isolate its effect.
const OCCLUDED_CASE: &str = "ceiling40";

/// One mesh with its matrices.
struct Mesh {
    room: Room,
    area: Vec<f64>,
    /// With and without occlusion.
    open: Matrix,
    occluded: Matrix,
    facts: Value,
}

/// Writes `study.json`, and for each case NAME.glb and NAME.PATCHES.VARIANT.csv, into `out`.
pub fn run(out: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(out)?;
    let all = cases();
    let meshes = [Detail::Coarse, Detail::Fine].map(|d| mesh(d, &all[0]));
    let mut list = Vec::new();
    for case in &all {
        let glb = format!("{}.glb", case.name);
        std::fs::write(out.join(&glb), scene(case, &meshes[0].room))?;
        let mut runs = Vec::new();
        for m in &meshes {
            let enclosure = case.enclosure(&m.room);
            let mut write = |variant: &str, matrix: &Matrix, b: &[DVec3], facts: Value| {
                let file = format!("{}.{}.{variant}.csv", case.name, m.area.len());
                let text = table(&m.room, &enclosure, matrix, b);
                let mut entry = json!({"patches": m.area.len(), "file": file});
                if let (Some(e), Some(f)) = (entry.as_object_mut(), facts.as_object()) {
                    e.extend(f.clone());
                }
                runs.push(entry);
                std::fs::write(out.join(file), text)
            };
            let start = Instant::now();
            let results = gather_times(&m.open, &enclosure, &case.iterations);
            let seconds = start.elapsed().as_secs_f64();
            for (k, b) in case.iterations.iter().zip(&results) {
                let facts = json!({"iterations": k, "occlusion": false, "seconds": seconds * f64::from(*k) / f64::from(case.iterations.last().copied().unwrap_or(1).max(1))});
                write(&format!("i{k}"), &m.open, b, facts)?;
            }
            if case.name == OCCLUDED_CASE {
                for b in gather_times(&m.occluded, &enclosure, &case.iterations) {
                    let facts = json!({"iterations": case.iterations[0], "occlusion": true});
                    write("occluded", &m.occluded, &b, facts)?;
                }
            }
        }
        list.push(json!({"name": case.name, "title": case.title, "glb": glb, "runs": runs}));
    }
    let camera =
        json!({"eye": EYE.to_array(), "target": TARGET.to_array(), "fov": FIELD, "aspect": ASPECT});
    let doc = json!({"camera": camera, "meshes": meshes.iter().map(|m| &m.facts).collect::<Vec<_>>(), "cases": list});
    std::fs::write(out.join("study.json"), serde_json::to_string_pretty(&doc)?)?;
    Ok(())
}

/// Cuts the room and computes both matrices, which depend on nothing else.
fn mesh(detail: Detail, any: &Case) -> Mesh {
    let room = Room::new(detail);
    let patches = any.enclosure(&room).patches;
    let area: Vec<f64> = patches.iter().map(|p| p.area()).collect();
    let start = Instant::now();
    let open = barycentre_matrix(&patches, |_, _| true);
    let open_seconds = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let occluded = barycentre_matrix(&patches, |a, b| room.sees(a, b));
    let occluded_seconds = start.elapsed().as_secs_f64();
    let of = |m: &Matrix, seconds: f64| {
        let sums = row_sums(m, &area);
        json!({
            "row_sum": sums.map(|s| json!({"min": s.min, "mean": s.mean, "max": s.max})),
            // Thirty steps: the third digit is stable.
            "eigenvalue": largest_eigenvalue(m, &area, 30),
            "seconds": seconds,
        })
    };
    let facts = json!({"patches": area.len(), "open": of(&open, open_seconds), "occluded": of(&occluded, occluded_seconds)});
    Mesh {
        room,
        area,
        open,
        occluded,
        facts,
    }
}

/// One line per patch: its kind, and the baseline's results for it and its corners. Lengths in
/// metres, M, B and V in W/m².
fn table(room: &Room, enclosure: &Enclosure, matrix: &Matrix, b: &[DVec3]) -> String {
    let mut text = String::from("surface,nx,ny,nz");
    for corner in 0..4 {
        let _ = write!(text, ",x{corner},y{corner},z{corner}");
    }
    text += ",M_r,M_g,M_b,rho_r,rho_g,rho_b,B_r,B_g,B_b";
    for corner in 0..4 {
        let _ = write!(text, ",V{corner}_r,V{corner}_g,V{corner}_b");
    }
    text += ",row_sum\n";
    let vertices = vertex_radiosity(room, enclosure, b);
    for (i, p) in room.patches.iter().enumerate() {
        text += p.surface.name();
        let own = &enclosure.patches[i];
        let triples = [p.normal]
            .into_iter()
            .chain(p.corners)
            .chain([own.exitance, own.reflectance, b[i]])
            .chain(vertices[i]);
        for v in triples {
            let _ = write!(text, ",{},{},{}", v.x, v.y, v.z);
        }
        let _ = writeln!(text, ",{}", matrix.row(i).iter().sum::<f64>());
    }
    text
}

/// The case as a glTF: the coarse patches with shared vertices, a primitive per surface and lamp,
/// and the camera.
fn scene(case: &Case, room: &Room) -> Vec<u8> {
    let enclosure = case.enclosure(room);
    // In order of first appearance; patches that look alike are in one primitive.
    let mut parts: Vec<(String, Material, Geometry)> = Vec::new();
    for (p, q) in room.patches.iter().zip(&enclosure.patches) {
        let rho = q.reflectance.as_vec3().to_array();
        // A Lambertian emitter's radiance is M / π.
        let emission = (q.exitance / std::f64::consts::PI).as_vec3().to_array();
        let lit = emission != [0.0; 3];
        let name = if lit {
            format!("lamp_{:?}", q.exitance.to_array())
        } else {
            p.surface.name().to_owned()
        };
        let k = match parts.iter().position(|(n, _, _)| *n == name) {
            Some(k) => k,
            None => {
                let shown = if lit {
                    format!("lamp_{}", parts.len())
                } else {
                    name.clone()
                };
                let material = Material::emitter(&shown, emission, rho);
                parts.push((name, material, Geometry::default()));
                parts.len() - 1
            }
        };
        let g = &mut parts[k].2;
        let ids = p.corners.map(|c| {
            let c = c.as_vec3();
            g.positions
                .iter()
                .zip(&g.normals)
                .position(|(q, n)| *q == c && *n == p.normal.as_vec3())
                .unwrap_or_else(|| {
                    g.positions.push(c);
                    g.normals.push(p.normal.as_vec3());
                    g.positions.len() - 1
                }) as u32
        });
        g.triangles.push([ids[0], ids[1], ids[2]]);
        g.triangles.push([ids[0], ids[2], ids[3]]);
    }
    let mut b = GltfBuilder::new();
    let primitives: Vec<(&Geometry, usize)> = parts
        .iter()
        .map(|(_, material, g)| (g, b.material(material)))
        .collect();
    let mesh = b.mesh("room", &primitives);
    b.node(Node::of_mesh("room", mesh));
    let camera = b.camera("camera", FIELD.to_radians(), ASPECT);
    b.node(Node {
        name: "camera".into(),
        translation: EYE,
        rotation: look_along(TARGET - EYE, Vec3::Y),
        camera: Some(camera),
        ..Node::default()
    });
    b.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(glb: &[u8]) -> Value {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        serde_json::from_slice(&glb[20..20 + length]).unwrap()
    }

    #[test]
    fn a_scene_holds_every_patch_and_its_light() {
        let room = Room::new(Detail::Coarse);
        for case in cases() {
            let doc = document(&scene(&case, &room));
            let primitives = doc["meshes"][0]["primitives"].as_array().unwrap();
            let indices: u64 = primitives
                .iter()
                .map(|p| {
                    let accessor = p["indices"].as_u64().unwrap() as usize;
                    doc["accessors"][accessor]["count"].as_u64().unwrap()
                })
                .sum();
            assert_eq!(indices, 6 * 1000, "{}", case.name);
            let lamps: Vec<&Value> = doc["materials"]
                .as_array()
                .unwrap()
                .iter()
                .filter(|m| m["name"].as_str().unwrap().starts_with("lamp"))
                .collect();
            assert_eq!(lamps.len(), case.lamps.len(), "{}", case.name);
            for (lamp, m) in case.lamps.iter().zip(lamps) {
                let strength =
                    &m["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"];
                for k in 0..3 {
                    let radiance =
                        m["emissiveFactor"][k].as_f64().unwrap() * strength.as_f64().unwrap_or(1.0);
                    // glTF holds f32, and factor times strength rounds twice.
                    let want = lamp.exitance[k] / std::f64::consts::PI;
                    assert!((radiance - want).abs() <= 3e-7 * want, "{}", case.name);
                }
            }
        }
    }

    #[test]
    fn the_table_has_a_line_per_patch() {
        let room = Room::new(Detail::Coarse);
        let case = &cases()[1];
        let enclosure = case.enclosure(&room);
        let matrix = barycentre_matrix(&enclosure.patches, |_, _| true);
        let b = gather_times(&matrix, &enclosure, &[2]).remove(0);
        let text = table(&room, &enclosure, &matrix, &b);
        let lines: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
        assert_eq!(lines.len(), 1001);
        assert!(lines.iter().all(|l| l.len() == 38));
        assert_eq!((lines[0][37], lines[0][22]), ("row_sum", "B_r"));
        // The written values read back exactly.
        let read: Vec<f64> = lines[1..].iter().map(|l| l[22].parse().unwrap()).collect();
        assert!(read.iter().zip(&b).all(|(x, b)| *x == b.x));
    }
}
