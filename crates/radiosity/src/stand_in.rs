//! Takes the light of stand-ins at the nearest surface of the object they stand in for.
//!
//! A coarser level of detail is a few centimetres inside or outside the finest one. Inside, it
//! would be dark; outside, it would miss the shadows of the finest level's own parts. Both levels
//! should show the same light, so a point of a stand-in is replaced by the nearest point of the
//! finest level that faces the same way.

use glam::Vec3;
use mesh_ingest::{Scene, Soup};
use visibility::{BuildError, BuildOptions, Bvh, closest_point};

/// Cosine of the largest angle (60°) at which a surface still faces the same way: a box and the
/// sphere in it differ by 55° at the box's corners.
const SAME_WAY: f32 = 0.5;

/// A surface turned by 90° or more counts as this many times farther away. A point that faces
/// upwards, a tenth of the thickness above the underside of a table top, is then assigned to the
/// top. The factor is finite, so that the search is bounded.
const TURNED: f32 = 16.0;

/// The objects that instances stand in for, by group.
pub(crate) struct StandIns {
    groups: Vec<Shown>,
}

/// The visible surfaces of a group.
struct Shown {
    tree: Bvh,
    /// Index in the soup of each triangle of the tree.
    faces: Vec<u32>,
    /// The square root of the mean triangle area, in metres: the first search radius.
    step: f32,
}

/// A point on a triangle that rays see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub triangle: u32,
    /// Barycentrics of world corners 1 and 2.
    pub u: f32,
    pub v: f32,
    pub back: bool,
}

impl StandIns {
    /// Collects the groups of a scene.
    ///
    /// # Errors
    /// Those of [`Bvh::build`]: never for a [`Soup`] from [`Soup::build`].
    pub(crate) fn find(
        scene: &Scene,
        soup: &Soup,
        tree: &BuildOptions,
    ) -> Result<StandIns, BuildError> {
        let shown = |instances: &Vec<usize>| {
            let ranges = instances.iter().map(|i| soup.instance_ranges[*i]);
            let faces: Vec<u32> = ranges.flat_map(|[first, end]| first..end).collect();
            let corners = faces.iter().map(|f| soup.triangles[*f as usize]);
            let area: f64 = faces
                .iter()
                .map(|f| f64::from(soup.areas[*f as usize]))
                .sum();
            Ok(Shown {
                tree: Bvh::build(&corners.collect::<Vec<_>>(), |_| true, tree)?,
                step: (area / faces.len().max(1) as f64).sqrt() as f32,
                faces,
            })
        };
        let groups = scene.firsts.iter().map(shown);
        Ok(StandIns {
            groups: groups.collect::<Result<_, _>>()?,
        })
    }

    /// The point of `group` that replaces a point facing `normal`; `None` if the group has no
    /// surfaces.
    pub(crate) fn place(
        &self,
        group: usize,
        soup: &Soup,
        two_sided: impl Fn(u32) -> bool,
        point: Vec3,
        normal: Vec3,
    ) -> Option<Place> {
        let shown = &self.groups[group];
        let (low, high) = shown.tree.bounds()?;
        // Of the surfaces that the point is on, the one that faces the same way.
        let least = 1e-3 * shown.step;
        let mut reach = shown.step;
        loop {
            let mut best: Option<(f32, Place)> = None;
            let (from, to) = (point - reach, point + reach);
            shown.tree.any_near(from, to, |t, corners| {
                let triangle = shown.faces[t as usize];
                let (q, u, v) = closest_point(corners, point);
                let cosine = soup.normals[triangle as usize].dot(normal);
                let back = cosine < 0.0 && two_sided(triangle);
                let cosine = if back { -cosine } else { cosine };
                let turned = (1.0 - cosine / SAME_WAY).clamp(0.0, 1.0);
                let score = (q.distance(point) + least) * (1.0 + (TURNED - 1.0) * turned);
                let nearer = |(s, p): (f32, Place)| (score, triangle) < (s, p.triangle);
                if best.is_none_or(nearer) {
                    let place = Place {
                        triangle,
                        u,
                        v,
                        back,
                    };
                    best = Some((score, place));
                }
                false
            });
            // Anything outside the box is farther away than its half-width.
            let all = from.cmple(low).all() && to.cmpge(high).all();
            match best {
                Some((score, place)) if all || score <= reach => return Some(place),
                _ if all => return None,
                _ => reach *= 2.0,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{add_quad, material};

    /// A table top 3 cm thick, and points inside it, below it and far beside it.
    #[test]
    fn a_stand_in_takes_the_side_that_faces_its_way() {
        let mut scene = Scene::default();
        let grey = || material(0.5, Vec3::ZERO);
        let (x, z) = (Vec3::X, Vec3::Z);
        add_quad(&mut scene, grey(), Vec3::Y * 0.03, z, x);
        add_quad(&mut scene, grey(), Vec3::ZERO, x, z);
        scene.firsts = vec![vec![0, 1]];
        let soup = Soup::build(&scene);
        let all = StandIns::find(&scene, &soup, &BuildOptions::default()).unwrap();
        let place = |p: Vec3, n: Vec3| {
            let place = all.place(0, &soup, |_| false, p, n).unwrap();
            let [a, b, c] = soup.triangles[place.triangle as usize];
            (a + (b - a) * place.u + (c - a) * place.v, place.back)
        };
        for y in [-0.05, 0.003, 0.015, 0.027, 0.06] {
            let p = Vec3::new(0.3, y, 0.4);
            for (n, expected) in [(Vec3::Y, 0.03), (Vec3::NEG_Y, 0.0)] {
                let (q, back) = place(p, n);
                assert!(
                    q.distance(Vec3::new(0.3, expected, 0.4)) < 1e-6,
                    "{p} {n}: {q}"
                );
                assert!(!back);
            }
        }
        // Beside the edge: the nearest point of the rim.
        let (q, _) = place(Vec3::new(7.0, 0.05, 0.5), Vec3::Y);
        assert!(q.distance(Vec3::new(1.0, 0.03, 0.5)) < 1e-5, "{q}");
        // A card that shines on both sides serves both.
        let card = all.place(0, &soup, |_| true, Vec3::new(0.3, 0.031, 0.4), Vec3::NEG_Y);
        assert!(card.unwrap().back);
    }
}
