//! Surfaces whose vertex normals describe a rounder shape than their triangles.
//!
//! A hemisphere around an interpolated normal, with rays that start on the flat face, sees the face
//! itself and its neighbours, which the intended surface would not. Light from between the two
//! horizons is lost and the facets show, most of all at the terminator. Rays from such points
//! therefore start on the surface that the normals describe, clear of its facets.
//!
//! Based on: Hanika, *Hacking the Shadow Terminator*, Ray Tracing Gems II, 2021, ch. 4 (mean of the
//! point's projections to those tangent planes of the corners that are above it); Boubekeur, Alexa,
//! *Phong Tessellation*, 2008 (the same surface, drawn). That surface is twice as far out as a
//! sphere through the corners with these normals. This is harmless for a shadow ray but shifts near
//! lights and contacts. The height used here is exact for spheres and cylinders: see [`height`].

use glam::Vec3;
use mesh_ingest::{Scene, Soup};
use rayon::prelude::*;

/// Cosine of the tilt (0.5°) from which a corner's normal counts as bent. Eight-bit normals of a
/// flat face are off by up to √2/254 rad = 0.32°. Below the threshold, (1 − cos)/2 = 2e-5 of a
/// sky's light is lost, and the sun has a step of 0.9 % at the terminator.
const BENT: f32 = 0.999_962;

/// Cosine of the tilt (40°) from which a vertex counts as a hard edge that was smoothed by mistake.
/// Spheres down to the icosahedron stay below it (37.4°), and so do cylinders of five sides (36°).
/// A normal shared by both sides of a right angle is at least 45° from one of them, and that of a
/// cube's corner is 54.7° from all three.
const HARD: f32 = 0.766_044;

/// Triangles whose normals describe a curved surface.
#[derive(Debug, Default)]
pub(crate) struct Curved {
    /// Per triangle; empty if there are none.
    faces: Vec<bool>,
}

impl Curved {
    /// Finds them in O(triangles). Triangles without vertex normals are skipped.
    ///
    /// A triangle is curved if a corner's normal is tilted against the face normal and no corner is
    /// *hard*. A vertex is hard if its normal is far from that of any adjacent face. The cap of a
    /// cylinder whose rim has shared normals is therefore flat, however little its own normals are
    /// tilted.
    pub(crate) fn find(scene: &Scene, soup: &Soup) -> Curved {
        let mut faces = Vec::new();
        let mut first = 0;
        while first < soup.len() {
            let source = soup.sources[first];
            let same = |t: usize| {
                let s = soup.sources[t];
                (s.instance, s.primitive) == (source.instance, source.primitive)
            };
            // The soup is sorted by instance and primitive.
            let [_, last] = soup.instance_ranges[source.instance as usize];
            let count = (first..last as usize).take_while(|&t| same(t)).count();
            let part = first..first + count.max(1);
            first = part.end;
            let mesh = &scene.meshes[scene.instances[source.instance as usize].mesh];
            let primitive = &mesh.primitives[source.primitive as usize];
            if primitive.normals.is_empty() {
                continue;
            }
            let bent: Vec<(usize, [f32; 3])> = part
                .into_par_iter()
                .map(|t| {
                    let normals = corner_normals(scene, soup, t as u32);
                    (
                        t,
                        normals.map_or([0.0; 3], |n| n.map(|n| n.dot(soup.normals[t]))),
                    )
                })
                .filter(|(_, cosines)| cosines.iter().any(|&c| c < BENT))
                .collect();
            if bent.is_empty() {
                continue;
            }
            let mut hard = vec![false; primitive.normals.len()];
            for (t, cosines) in &bent {
                for (i, c) in corners_of(scene, soup, *t as u32).into_iter().zip(cosines) {
                    hard[i as usize] |= *c < HARD;
                }
            }
            for (t, _) in bent {
                let corners = corners_of(scene, soup, t as u32);
                if corners.iter().all(|&i| !hard[i as usize]) {
                    if faces.is_empty() {
                        faces = vec![false; soup.len()];
                    }
                    faces[t] = true;
                }
            }
        }
        Curved { faces }
    }

    /// Whether `triangle` is curved.
    #[inline]
    pub(crate) fn is(&self, triangle: u32) -> bool {
        self.faces.get(triangle as usize).is_some_and(|c| *c)
    }
}

/// Vertices of a triangle of the soup, in the triangle's original order.
fn corners_of(scene: &Scene, soup: &Soup, triangle: u32) -> [u32; 3] {
    let source = soup.sources[triangle as usize];
    let mesh = &scene.meshes[scene.instances[source.instance as usize].mesh];
    let primitive = &mesh.primitives[source.primitive as usize];
    let [a, b, c] = primitive.triangles[source.triangle as usize];
    if source.mirrored {
        [a, c, b]
    } else {
        [a, b, c]
    }
}

/// Unit normals of a triangle's corners in world space, on the side given by the document; `None`
/// without normals or if the transform degenerates one.
fn corner_normals(scene: &Scene, soup: &Soup, triangle: u32) -> Option<[Vec3; 3]> {
    let source = soup.sources[triangle as usize];
    let instance = &scene.instances[source.instance as usize];
    let normals = &scene.meshes[instance.mesh].primitives[source.primitive as usize].normals;
    if normals.is_empty() {
        return None;
    }
    let m = &instance.transform.matrix3;
    // Rows of cofactors: the inverse transpose times the determinant, whose sign handles mirroring.
    let cofactors = [
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    ];
    let sign = if source.mirrored { -1.0 } else { 1.0 };
    let mut out = [Vec3::ZERO; 3];
    for (n, i) in out.iter_mut().zip(corners_of(scene, soup, triangle)) {
        let local = normals[i as usize].as_dvec3();
        let world = cofactors[0] * local.x + cofactors[1] * local.y + cofactors[2] * local.z;
        *n = (world * sign).try_normalize()?.as_vec3();
    }
    Some(out)
}

/// Height of the surface described by the corner normals above the flat face, in metres; 0 where it
/// is below. `weights` are barycentrics, `side` is −1 for the back of the face.
///
/// h = Σ bᵢ max(0, (Vᵢ − P)·nᵢ) / (1 + |Σ bᵢ nᵢ|), along the interpolated normal. On a sphere of
/// radius R, |Σ bᵢ nᵢ| = |P|/R =: r/R and the sum is (R² − r²)/R, so h = R − r for any triangle. On
/// a cylinder, the same holds in the cross-section. For any other surface, it is the quadratic
/// part. The height is at most half the triangle's smallest altitude: a long strip whose ends are
/// tilted along it is not an arch.
pub(crate) fn height(
    scene: &Scene,
    soup: &Soup,
    triangle: u32,
    position: Vec3,
    weights: [f32; 3],
    side: f32,
) -> f32 {
    let Some(normals) = corner_normals(scene, soup, triangle) else {
        return 0.0;
    };
    let corners = soup.triangles[triangle as usize];
    let (mut sum, mut mean) = (0.0, Vec3::ZERO);
    for ((v, n), b) in corners.into_iter().zip(normals).zip(weights) {
        sum += b * (side * n.dot(v - position)).max(0.0);
        mean += n * b;
    }
    let edge = |i: usize, j: usize| (corners[i] - corners[j]).length();
    let longest = edge(0, 1).max(edge(1, 2)).max(edge(2, 0));
    let altitude = 2.0 * soup.areas[triangle as usize] / longest;
    (sum / (1.0 + mean.length())).min(0.5 * altitude)
}

#[cfg(test)]
mod tests;
