//! The last resort: projects nearly planar groups of faces on their plane and packs them as
//! rectangles.

use glam::{DVec2, DVec3};

use super::charts::Charts;
use super::finish::finish;
use super::input::{NONE, UnwrapInput};
use super::unroll::find_overlap;
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};

/// Faces join a group up to this angle from its first face (degrees); stretch stays below 1/cos.
const GROUP_DEGREES: f64 = 30.0;

/// Projects each connected, nearly planar group of faces onto the plane of its first face. There is
/// no optimisation, so it can only fail for lack of space. Groups that would overlap themselves are
/// split into single triangles.
#[derive(Debug, Clone, Copy, Default)]
pub struct BoxProjection;

impl Unwrapper for BoxProjection {
    fn name(&self) -> &'static str {
        "box"
    }

    fn unwrap(
        &self,
        mesh: &UnwrapInput,
        options: &UnwrapOptions,
        cancel: Cancel<'_>,
    ) -> Result<UnwrappedMesh, UnwrapError> {
        let normals = mesh.face_normals();
        let lumel = 1.0 / f64::from(options.texels_per_unit);
        let mut groups = group_faces(mesh, &normals);
        if cancel() {
            return Err(UnwrapError::Cancelled);
        }
        let mut flat = vec![[DVec2::ZERO; 3]; mesh.triangles.len()];
        let mut single = Vec::new();
        groups.retain(|group| {
            project(mesh, group, normals[group[0] as usize], &mut flat);
            let corners: Vec<[DVec2; 3]> = group.iter().map(|&t| flat[t as usize]).collect();
            let keep = group.len() == 1 || find_overlap(&corners, lumel).is_none();
            if !keep {
                single.extend(group.iter().map(|&t| vec![t]));
            }
            keep
        });
        for group in &single {
            project(mesh, group, normals[group[0] as usize], &mut flat);
        }
        groups.append(&mut single);
        if cancel() {
            return Err(UnwrapError::Cancelled);
        }
        let mut charts = Charts {
            corners: flat,
            chart: vec![0; mesh.triangles.len()],
            count: groups.len() as u32,
        };
        for (number, group) in groups.iter().enumerate() {
            for &t in group {
                charts.chart[t as usize] = number as u32;
            }
        }
        charts.renumber();
        finish(mesh, charts, options, cancel)
    }
}

/// Connected faces whose normals are within [`GROUP_DEGREES`] of the group's first face.
fn group_faces(mesh: &UnwrapInput, normals: &[DVec3]) -> Vec<Vec<u32>> {
    let limit = libm::cos(GROUP_DEGREES.to_radians());
    let mut taken = vec![false; normals.len()];
    let mut groups = Vec::new();
    for seed in 0..normals.len() {
        if taken[seed] {
            continue;
        }
        taken[seed] = true;
        let mut group = vec![seed as u32];
        let mut next = 0;
        while let Some(&t) = group.get(next) {
            next += 1;
            for k in 0..3 {
                let u = mesh.neighbors[t as usize][k];
                if u != NONE
                    && !taken[u as usize]
                    && !mesh.seams[t as usize][k]
                    && normals[u as usize].dot(normals[seed]) >= limit
                {
                    taken[u as usize] = true;
                    group.push(u);
                }
            }
        }
        groups.push(group);
    }
    groups
}

/// Projects a group along `normal` (metres, minimum at the origin); counter-clockwise faces get a
/// positive signed area.
fn project(mesh: &UnwrapInput, group: &[u32], normal: DVec3, flat: &mut [[DVec2; 3]]) {
    // Axes close to those of space, so that walls stay upright.
    let a = normal.abs();
    let reference = if a.y > a.x && a.y > a.z {
        DVec3::X
    } else {
        DVec3::Y
    };
    let v = (reference - normal * reference.dot(normal)).normalize_or(DVec3::X);
    let u = v.cross(normal).normalize_or(DVec3::Y);
    let mut low = DVec2::INFINITY;
    for &t in group {
        let corners = mesh.triangles[t as usize].map(|i| mesh.positions[i as usize].as_dvec3());
        flat[t as usize] = corners.map(|p| DVec2::new(p.dot(u), p.dot(v)));
        for p in flat[t as usize] {
            low = low.min(p);
        }
    }
    for &t in group {
        for p in &mut flat[t as usize] {
            *p -= low;
        }
    }
}
