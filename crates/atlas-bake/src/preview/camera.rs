//! Chooses a camera: the document's, or one that shows much of the level.

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use mesh_ingest::{Document, Scene, Soup};
use rayon::prelude::*;
use serde_json::Value;

use super::seen::{LitScene, Seen};
use crate::exposure::luminance;

/// Vertical field of view of chosen cameras, radians (60°).
const FIELD: f32 = std::f32::consts::FRAC_PI_3;

/// Resolution of the pictures by which views are judged.
const SKETCH: [u32; 2] = [32, 18];

/// A pinhole camera in recentred world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The eye.
    pub position: Vec3,
    /// Unit view direction.
    pub forward: Vec3,
    /// Unit direction up in the picture, perpendicular to `forward`.
    pub up: Vec3,
    /// Vertical field of view, radians.
    pub yfov: f32,
}

/// Directions through the pixels of a picture.
pub(super) struct Rays {
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    size: [f32; 2],
}

impl Rays {
    /// Unit direction through `(x, y)` in pixels, y down.
    pub fn direction(&self, x: f32, y: f32) -> Vec3 {
        let (x, y) = (2.0 * x / self.size[0] - 1.0, 1.0 - 2.0 * y / self.size[1]);
        (self.forward + self.right * x + self.up * y).normalize_or(self.forward)
    }
}

impl Camera {
    /// An upright camera at `position`, looking at `target`.
    pub fn look_at(position: Vec3, target: Vec3) -> Camera {
        let forward = (target - position).normalize_or(-Vec3::Z);
        let right = forward.cross(Vec3::Y).normalize_or(Vec3::X);
        Camera {
            position,
            forward,
            up: right.cross(forward),
            yfov: FIELD,
        }
    }

    pub(super) fn rays(&self, size: [u32; 2]) -> Rays {
        let size = size.map(|s| s.max(1) as f32);
        let half = (self.yfov * 0.5).clamp(1e-3, 1.5).tan();
        let right = self.forward.cross(self.up);
        Rays {
            forward: self.forward,
            right: right * half * size[0] / size[1],
            up: self.up * half,
            size,
        }
    }
}

/// The first perspective camera in the document's scene (depth first), if any.
pub fn scene_camera(document: &Document, scene: &Scene) -> Option<Camera> {
    let json = document.json();
    let nodes = json.get("nodes")?.as_array()?;
    let indices = |v: Option<&Value>| -> Vec<usize> {
        v.and_then(Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(|i| Some(i.as_u64()? as usize))
            .rev()
            .collect()
    };
    let chosen = json.get("scene").and_then(Value::as_u64).unwrap_or(0) as usize;
    let roots = json
        .get("scenes")
        .and_then(|s| s.get(chosen))
        .map(|s| indices(s.get("nodes")));
    let mut stack: Vec<(usize, DAffine3)> = match roots {
        Some(roots) => roots.into_iter().map(|i| (i, DAffine3::IDENTITY)).collect(),
        None => (0..nodes.len())
            .rev()
            .map(|i| (i, DAffine3::IDENTITY))
            .collect(),
    };
    // Each node is in a scene at most once; the bound guards against documents that violate this.
    for _ in 0..=nodes.len() {
        let (i, parent) = stack.pop()?;
        let Some(node) = nodes.get(i) else { continue };
        let world = parent * local_transform(node);
        let camera = node
            .get("camera")
            .and_then(Value::as_u64)
            .and_then(|c| json.get("cameras")?.get(c as usize));
        let yfov = camera.and_then(|c| c.get("perspective")?.get("yfov")?.as_f64());
        if let Some(yfov) = yfov {
            let forward = world.transform_vector3(-DVec3::Z).try_normalize()?;
            let right = forward
                .cross(world.transform_vector3(DVec3::Y))
                .try_normalize()?;
            return Some(Camera {
                position: (world.translation - scene.origin).as_vec3(),
                forward: forward.as_vec3(),
                up: right.cross(forward).as_vec3(),
                yfov: (yfov as f32).clamp(0.05, 2.6),
            });
        }
        stack.extend(
            indices(node.get("children"))
                .into_iter()
                .map(|c| (c, world)),
        );
    }
    None
}

fn local_transform(node: &Value) -> DAffine3 {
    fn numbers<const N: usize>(node: &Value, key: &str) -> Option<[f64; N]> {
        let array = node.get(key)?.as_array()?;
        let values: Vec<f64> = array.iter().filter_map(Value::as_f64).collect();
        values.try_into().ok()
    }
    if let Some(m) = numbers::<16>(node, "matrix") {
        return DAffine3::from_mat4(DMat4::from_cols_array(&m));
    }
    let translation = numbers(node, "translation").map_or(DVec3::ZERO, DVec3::from_array);
    let rotation = numbers(node, "rotation")
        .map_or(DQuat::IDENTITY, DQuat::from_array)
        .normalize();
    let scale = numbers(node, "scale").map_or(DVec3::ONE, DVec3::from_array);
    DAffine3::from_scale_rotation_translation(scale, rotation, translation)
}

/// A camera that shows much of the level.
///
/// Candidates are on a grid within the level, where no wall is near and few backfaces are visible,
/// and on a ring around it. Each is scored by viewpoint entropy (after Vázquez et al., "Viewpoint
/// Selection using Viewpoint Entropy", 2001), both of surfaces, by their fraction of the picture,
/// and of their brightness.
pub fn choose_camera(lit: &LitScene<'_>) -> Camera {
    let Some((low, high)) = bulk(lit.soup) else {
        return Camera::look_at(Vec3::Z, Vec3::ZERO);
    };
    let (centre, size) = ((low + high) * 0.5, high - low);
    let length = size.length().max(f32::MIN_POSITIVE);
    let mut candidates = Vec::new();
    for k in 0..16 {
        let (sin, cos) = (k as f32 * std::f32::consts::TAU / 8.0 + 0.4).sin_cos();
        let rise = if k < 8 { 0.35 } else { 0.8 };
        let position = centre + Vec3::new(cos, rise, sin) * length * 0.75;
        candidates.push(Camera::look_at(position, centre));
    }
    const GRID: [usize; 3] = [7, 4, 7];
    for k in 0..GRID.iter().product::<usize>() {
        let cell = [k % GRID[0], k / GRID[0] % GRID[1], k / GRID[0] / GRID[1]];
        let share = Vec3::from(std::array::from_fn(|a| {
            (cell[a] as f32 + 0.5) / GRID[a] as f32
        }));
        let position = low + size * share;
        if !is_open(lit, position, length) {
            continue;
        }
        for yaw in 0..12 {
            let (sin, cos) = (yaw as f32 * std::f32::consts::TAU / 12.0).sin_cos();
            // Slightly downwards, as people look at rooms.
            candidates.push(Camera::look_at(
                position,
                position + Vec3::new(cos, -0.2, sin),
            ));
        }
    }
    let scores: Vec<f32> = candidates
        .par_iter()
        .map(|c| score(lit, c, length))
        .collect();
    // The first of equal scores, for determinism.
    let best = (0..scores.len()).fold(0, |best, i| if scores[i] > scores[best] { i } else { best });
    candidates[best]
}

/// The box that contains most of the detail: the 1st to 99th percentile of vertices on each axis,
/// so that a huge ground plane does not count.
fn bulk(soup: &Soup) -> Option<(Vec3, Vec3)> {
    const AT_MOST: usize = 100_000;
    let step = soup.seen().div_ceil(AT_MOST).max(1);
    let mut bounds = [Vec3::ZERO; 2];
    for axis in 0..3 {
        let mut x: Vec<f32> = soup
            .seen_triangles()
            .iter()
            .step_by(step)
            .flatten()
            .map(|p| p[axis])
            .collect();
        x.sort_unstable_by(f32::total_cmp);
        let last = x.len().checked_sub(1)?;
        bounds[0][axis] = x[last / 100];
        bounds[1][axis] = x[last - last / 100];
    }
    Some((bounds[0], bounds[1]))
}

/// Whether a viewer could stand there: not too near anything and not inside anything.
fn is_open(lit: &LitScene<'_>, position: Vec3, length: f32) -> bool {
    let mut backs = 0;
    for k in 0..26 {
        let k = if k >= 13 { k + 1 } else { k };
        let direction = Vec3::new(
            (k % 3) as f32 - 1.0,
            (k / 3 % 3) as f32 - 1.0,
            (k / 9) as f32 - 1.0,
        )
        .normalize();
        let ray = visibility::Ray {
            origin: position,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        let Some(hit) = lit.bvh.closest_hit(&ray, &visibility::AcceptAll) else {
            continue;
        };
        if hit.t < 0.015 * length {
            return false;
        }
        backs += u32::from(hit.back);
    }
    backs <= 6
}

/// Score of a view.
fn score(lit: &LitScene<'_>, camera: &Camera, length: f32) -> f32 {
    let rays = camera.rays(SKETCH);
    let seen: Vec<Seen> = (0..SKETCH[0] * SKETCH[1])
        .map(|i| {
            let (x, y) = (i % SKETCH[0], i / SKETCH[0]);
            lit.look(
                camera.position,
                rays.direction(x as f32 + 0.5, y as f32 + 0.5),
                i,
            )
        })
        .collect();
    let hits: Vec<&Seen> = seen.iter().filter(|s| s.distance.is_finite()).collect();
    if hits.is_empty() {
        return 0.0;
    }
    // Faces are grouped by primitive and by the axis that they face most.
    let things = hits.iter().map(|s| {
        let source = lit.soup.sources[s.triangle as usize];
        let n = lit.soup.normals[s.triangle as usize];
        let axis = n.abs().max_position() as u32;
        [
            source.instance,
            source.primitive,
            axis * 2 + u32::from(n[axis as usize] < 0.0),
        ]
    });
    let brightest = hits
        .iter()
        .map(|s| luminance(s.color))
        .fold(0.0, f32::max)
        .max(f32::MIN_POSITIVE);
    // Stops below the brightest; everything beyond twelve counts as black.
    let stops = hits.iter().map(|s| {
        [
            ((brightest / luminance(s.color).max(brightest * 2.5e-4)).log2()) as u32,
            0,
            0,
        ]
    });
    let share = hits.len() as f32 / seen.len() as f32;
    let near =
        hits.iter().filter(|s| s.distance < 0.04 * length).count() as f32 / seen.len() as f32;
    (entropy(things.collect()) + entropy(stops.collect())) * share * (1.0 - near).powi(2)
}

/// Σ −p log₂ p over the fractions of equal entries.
fn entropy(mut keys: Vec<[u32; 3]>) -> f32 {
    keys.sort_unstable();
    let n = keys.len() as f32;
    keys.chunk_by(|a, b| a == b)
        .map(|c| c.len() as f32 / n)
        .map(|p| -p * p.log2())
        .sum()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_documents_camera_is_found_through_the_hierarchy() {
        let positions: Vec<u8> = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let document = json!({
            "asset": {"version": "2.0"}, "scene": 1,
            "scenes": [{"nodes": [3]}, {"nodes": [0, 4]}],
            "nodes": [
                {"translation": [10.0, 0.0, 0.0], "rotation": [0.0, (0.5f64).sqrt(), 0.0, (0.5f64).sqrt()], "children": [1, 2]},
                {"camera": 0},
                {"camera": 1, "translation": [0.0, 0.0, 1.0], "scale": [2.0, 2.0, 2.0]},
                {"camera": 1},
                {"mesh": 0}
            ],
            "cameras": [{"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}},
                {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "buffers": [{"byteLength": 36, "uri": "t.bin"}]
        });
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("t.bin"), positions).unwrap();
        std::fs::write(dir.path().join("t.gltf"), document.to_string()).unwrap();
        let loaded = mesh_ingest::load(
            &dir.path().join("t.gltf"),
            &mesh_ingest::LoadOptions::default(),
        )
        .unwrap();
        let camera = scene_camera(&loaded.document, &loaded.scene).unwrap();
        // A quarter turn about y takes the child's +z to +x, and the view's −z to −x.
        let position = (DVec3::new(11.0, 0.0, 0.0) - loaded.scene.origin).as_vec3();
        assert!((camera.position - position).length() < 1e-5, "{camera:?}");
        assert!(
            (camera.forward + Vec3::X).length() < 1e-6 && (camera.up - Vec3::Y).length() < 1e-6
        );
        assert_eq!(camera.yfov, 0.8);
    }

    #[test]
    fn entropy_is_that_of_shannon() {
        assert_eq!(entropy(vec![[1; 3]; 8]), 0.0);
        assert_eq!(entropy((0..8).map(|i| [i, 0, 0]).collect()), 3.0);
        assert_eq!(entropy(Vec::new()), 0.0);
    }
}
