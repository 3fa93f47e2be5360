//! Separates instances of one mesh that differ too much to share lumels.
//!
//! All instances of a mesh share its charts and the size of its rectangle. This works for copies,
//! and for rocks of slightly different sizes. But if a level is built from one cube, the sides of a
//! floor are one texel wide, and a crate with the same charts would have no lumels on its sides.
//! Such instances get a copy of the mesh with its own charts.

use glam::{DMat3, DVec3};
use mesh_ingest::{Mesh, Scene};

use crate::density::shape_of;

/// Along every direction of its surface, an instance has at least this fraction of its requested
/// lumels per metre …
const MIN_RATIO: f64 = 0.5;

/// … and, while copies are available, at most this multiple. Excess lumels are only wasteful, so
/// this is weighed against another mesh in the written file.
const MAX_RATIO: f64 = 8.0;

/// Most copies of one mesh per density factor, including the first. Beyond this, the most similar
/// instances share a mesh.
const COPIES: usize = 8;

/// Number of triangles, evenly distributed over the mesh's list, whose edges are the tested
/// directions.
const SAMPLES: usize = 64;

/// Instances that must share a mesh: one, or the copies of one node (`EXT_mesh_gpu_instancing`).
struct Group {
    instances: Vec<usize>,
    /// Shape and density factor of the instance that needs the most lumels.
    shape: DMat3,
    factor: f32,
    demand: f64,
}

/// Groups that share a mesh, represented by the first of them.
struct Class {
    shape: DMat3,
    factor: f32,
    mesh: usize,
}

/// Appends copies of meshes to `scene`, so that instances that share a mesh are similar (see this
/// module's constants). Returns the number of copies.
///
/// Instances with different density factors never share a mesh. The result depends only on the
/// instances' shapes and density factors. Instances without lumels keep their mesh.
pub fn separate_unlike(scene: &mut Scene) -> usize {
    let mut by_mesh: Vec<Vec<usize>> = vec![Vec::new(); scene.meshes.len()];
    for i in (0..scene.instances.len()).filter(|&i| scene.has_lumels(i)) {
        by_mesh[scene.instances[i].mesh].push(i);
    }
    let before = scene.meshes.len();
    for (mesh, instances) in by_mesh.into_iter().enumerate() {
        if instances.len() < 2 {
            continue;
        }
        let edges = edges(scene, &scene.meshes[mesh]);
        let mut groups = groups(scene, &instances, &edges);
        // Stable, so of equal groups the first in the scene leads.
        groups.sort_by(|a, b| b.demand.total_cmp(&a.demand));
        let mut classes: Vec<Class> = Vec::new();
        for group in groups {
            let index = choose(&classes, &group, &edges).unwrap_or_else(|| {
                let index = if classes.is_empty() {
                    mesh
                } else {
                    scene.meshes.push(scene.meshes[mesh].clone());
                    scene.meshes.len() - 1
                };
                classes.push(Class {
                    shape: group.shape,
                    factor: group.factor,
                    mesh: index,
                });
                index
            });
            for i in group.instances {
                scene.instances[i].mesh = index;
            }
        }
    }
    scene.meshes.len() - before
}

/// The mesh that a group may share; `None` if it needs its own.
fn choose(classes: &[Class], group: &Group, edges: &[DVec3]) -> Option<usize> {
    let mut best: Option<(f64, usize)> = None;
    let mut count = 0;
    for class in classes.iter().filter(|c| c.factor == group.factor) {
        count += 1;
        // How far the worst direction exceeds the bounds.
        let excess = edges.iter().fold(1.0f64, |worst, &e| {
            let given = (class.shape * e).length() / (group.shape * e).length();
            worst.max(MIN_RATIO / given).max(given / MAX_RATIO)
        });
        if excess <= 1.0 {
            return Some(class.mesh);
        }
        if best.is_none_or(|(b, _)| excess < b) {
            best = Some((excess, class.mesh));
        }
    }
    best.filter(|_| count >= COPIES).map(|(_, mesh)| mesh)
}

fn groups(scene: &Scene, instances: &[usize], edges: &[DVec3]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for &i in instances {
        let instance = &scene.instances[i];
        let shape = shape_of(&instance.transform);
        let lumels = shape * f64::from(instance.density);
        let demand = edges.iter().map(|&e| (lumels * e).length_squared()).sum();
        // Copies of a node are consecutive.
        let before = groups.last_mut().filter(|g| {
            instance.copy.is_some() && scene.instances[g.instances[0]].node == instance.node
        });
        match before {
            Some(group) => {
                group.instances.push(i);
                if demand > group.demand {
                    (group.shape, group.demand) = (shape, demand);
                    group.factor = instance.density;
                }
            }
            None => groups.push(Group {
                instances: vec![i],
                shape,
                factor: instance.density,
                demand,
            }),
        }
    }
    groups
}

/// Edges of triangles that receive light, scaled to the square root of the triangle's area in the
/// mesh.
fn edges(scene: &Scene, mesh: &Mesh) -> Vec<DVec3> {
    let receiving = || {
        let primitives = mesh.primitives.iter();
        primitives
            .filter(|p| !scene.materials[p.material].occluder_only)
            .flat_map(|p| p.triangles.iter().map(move |t| (p, t)))
    };
    let step = receiving().count().div_ceil(SAMPLES).max(1);
    let mut out = Vec::new();
    for (p, t) in receiving().step_by(step) {
        let [a, b, c] = t.map(|v| p.positions[v as usize].as_dvec3());
        let size = (b - a).cross(c - a).length().sqrt();
        let sides = [b - a, c - b, a - c].map(DVec3::normalize_or_zero);
        out.extend(
            sides
                .map(|e| e * size)
                .into_iter()
                .filter(|e| *e != DVec3::ZERO),
        );
    }
    out
}
