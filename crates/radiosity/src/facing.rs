//! Walls that are faces back to back.

use glam::Vec3;
use mesh_ingest::{Scene, Soup};
use rayon::prelude::*;
use visibility::{Bvh, Hit, Ray};

use crate::world::offset;

/// For so many triangles around one, [`backed`] looks whether they are in its plane. With more, it
/// says yes, which costs time at hits and no accuracy.
const MOST_NEAR: usize = 4096;

/// Cosine of the angle up to which two faces count as one wall's. Others meet in a line.
const ONE_WALL: f32 = 0.5;

/// For each triangle that rays see, whether it is single-sided and another one may show itself
/// where a ray meets its back. `radius` is the largest coordinate of the scene.
pub(crate) fn backed(scene: &Scene, soup: &Soup, bvh: &Bvh, radius: f32) -> Vec<bool> {
    let double_sided =
        |triangle: u32| scene.materials[soup.materials[triangle as usize] as usize].double_sided;
    let may_show = |triangle: u32| {
        let own = soup.triangles[triangle as usize];
        let normal = soup.normals[triangle as usize];
        let low = own[0].min(own[1]).min(own[2]);
        let high = own[0].max(own[1]).max(own[2]);
        // Twice the distance of `shown_at`, for the rounding of both planes.
        let reach = 4.0 * offset(low.abs().max(high.abs()), radius);
        let mut near = 0;
        bvh.any_near(low - reach, high + reach, |other, corners| {
            near += 1;
            let opposite = -normal.dot(soup.normals[other as usize]);
            let shows = match double_sided(other) {
                true => opposite.abs(),
                false => opposite,
            };
            let one_wall = other != triangle && shows >= ONE_WALL;
            near > MOST_NEAR || one_wall && overlap(own, corners, normal, reach)
        })
    };
    (0..soup.seen() as u32)
        .into_par_iter()
        .with_min_len(256)
        .map(|triangle| {
            !double_sided(triangle) && (soup.twin(triangle).is_some() || may_show(triangle))
        })
        .collect()
}

/// Whether triangle `b` comes within `reach` of the plane of `a`, whose normal is `normal`, and
/// covers a part of `a` there. Triangles that only share an edge do not.
fn overlap(a: [Vec3; 3], b: [Vec3; 3], normal: Vec3, reach: f32) -> bool {
    let range = |points: [Vec3; 3], axis: Vec3| {
        let [x, y, z] = points.map(|p| axis.dot(p - a[0]));
        (x.min(y).min(z), x.max(y).max(z))
    };
    let (lowest, highest) = range(b, normal);
    // Two triangles in a plane are apart if one of their edges parts them.
    let apart = |[p, q]: [Vec3; 2]| {
        let Some(across) = normal.cross(q - p).try_normalize() else {
            return false;
        };
        let (of_a, of_b) = (range(a, across), range(b, across));
        of_a.0.max(of_b.0) + reach > of_a.1.min(of_b.1)
    };
    let edges = |[p, q, r]: [Vec3; 3]| [[p, q], [q, r], [r, p]];
    let part = edges(a).into_iter().chain(edges(b)).any(apart);
    lowest <= reach && highest >= -reach && !part
}

/// A hit on the back of a single-sided triangle, moved to the surface that shows itself to the ray
/// in the same place, if there is one: both are at the same distance, and the tree reports either.
/// Walls are often built so, with a face for each side.
pub fn facing(scene: &Scene, soup: &Soup, bvh: &Bvh, ray: &Ray, hit: Hit) -> Hit {
    let Some(twin) = soup.twin(hit.triangle) else {
        return shown_at(scene, soup, bvh, ray, &hit).unwrap_or(hit);
    };
    let [u, v] = twin.weights(hit.u, hit.v);
    Hit {
        triangle: twin.triangle,
        t: hit.t,
        u,
        v,
        back: false,
    }
}

/// The surface that shows itself to the ray where it hits the back of one: that of a wall whose
/// faces are divided into different triangles. Of several, the one with the lowest number.
#[cold]
fn shown_at(scene: &Scene, soup: &Soup, bvh: &Bvh, ray: &Ray, hit: &Hit) -> Option<Hit> {
    let q = ray.origin + ray.direction * hit.t;
    let reach = 2.0 * offset(q, ray.origin.abs().max(q.abs()).max_element());
    let mut shown: Option<Hit> = None;
    bvh.any_near(q - reach, q + reach, |triangle, [a, b, c]| {
        let normal = soup.normals[triangle as usize];
        let back = normal.dot(ray.direction) > 0.0;
        let material = &scene.materials[soup.materials[triangle as usize] as usize];
        if back && !material.double_sided || normal.dot(q - a).abs() > reach {
            return false;
        }
        let double = normal.dot((b - a).cross(c - a));
        let u = normal.dot((q - a).cross(c - a)) / double;
        let v = normal.dot((b - a).cross(q - a)) / double;
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
        let first = shown.is_none_or(|other| triangle < other.triangle);
        if inside && first && scene.presence(soup, triangle, u, v) >= 1.0 {
            let t = hit.t;
            shown = Some(Hit {
                triangle,
                t,
                u,
                v,
                back,
            });
        }
        false
    });
    shown
}

#[cfg(test)]
mod tests;
