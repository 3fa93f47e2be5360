//! Rays among the patches of an enclosure, in double precision: a bounding volume hierarchy split
//! at the median.
//!
//! Deliberately separate from the baker's tree, as a second, simpler implementation of the same
//! queries.

use glam::DVec3;

use crate::Enclosure;

/// A ray's hit on a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index of the patch.
    pub patch: usize,
    /// Distance in units of the direction's length.
    pub t: f64,
    /// Whether its front was hit.
    pub front: bool,
}

#[derive(Debug, Clone)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// First entry of `order`, or, if `count` is 0, the right child (the left one follows the
    /// node).
    first: u32,
    count: u32,
}

/// Traces rays among the patches of one enclosure. Patches block from both sides.
///
/// Edges are tested in a frame sheared along the ray (Woop, Benthin, Wald, *Watertight ray/triangle
/// intersection*, 2013) on whole convex polygons: two patches that share an edge with the same
/// corners leave no gap. T-junctions may.
#[derive(Debug, Clone)]
pub struct Visibility {
    corners: Vec<Vec<DVec3>>,
    normals: Vec<DVec3>,
    nodes: Vec<Node>,
    order: Vec<u32>,
    /// Closer hits are on the origin's own plane, metres.
    near: f64,
}

/// A prepared ray: axes are permuted so that z is the direction's longest component, and sheared so
/// that it is the only one.
struct Sheared {
    origin: DVec3,
    inverse: DVec3,
    axes: [usize; 3],
    shear: [f64; 2],
    direction: DVec3,
    length: f64,
}

impl Sheared {
    fn new(origin: DVec3, direction: DVec3) -> Self {
        let a = direction.abs();
        let z = if a.x >= a.y && a.x >= a.z {
            0
        } else if a.y >= a.z {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        Sheared {
            origin,
            // Finite instead of 1/0, because 0 · ∞ is NaN. Boxes are widened, so an origin in a
            // face's plane is inside.
            inverse: DVec3::from_array(
                direction
                    .to_array()
                    .map(|d| if d == 0.0 { 1e200 } else { 1.0 / d }),
            ),
            axes: [x, y, z],
            shear: [direction[x] / direction[z], direction[y] / direction[z]],
            direction,
            length: direction.length(),
        }
    }
}

/// Patches per leaf: few, because a polygon test costs about as much as two box tests.
const LEAF: usize = 4;
/// Sine below which a ray is in a patch's plane: normals and directions have several rounding
/// errors of 1e-16.
const EDGE_ON: f64 = 1e-14;
/// Distances this close are equal: an edge of two patches, computed from each.
const SAME: f64 = 1e-12;
/// Widening of box distances: three roundings on each of the two products (Ize, *Robust BVH ray
/// traversal*, 2013).
const WIDEN: f64 = 1.0 + 6.0 * f64::EPSILON;

impl Visibility {
    /// Builds the tree over all patches. Patches with fewer than three corners are never hit.
    pub fn new(enclosure: &Enclosure) -> Self {
        let corners: Vec<Vec<DVec3>> = enclosure
            .patches
            .iter()
            .map(|p| p.corners.clone())
            .collect();
        let mut v = Visibility {
            normals: enclosure
                .patches
                .iter()
                .map(|p| {
                    if p.corners.len() < 3 {
                        DVec3::ZERO
                    } else {
                        p.normal()
                    }
                })
                .collect(),
            order: (0..corners.len() as u32).collect(),
            corners,
            nodes: Vec::new(),
            near: 0.0,
        };
        if !v.order.is_empty() {
            let mut order = std::mem::take(&mut v.order);
            v.build(&mut order, 0);
            v.order = order;
            let root = &v.nodes[0];
            // The rounding of a point's position is 1e-16 of its size; nothing in a scene is
            // separated by 1e-12 of the whole.
            let size = root.low.abs().max(root.high.abs()).max_element();
            v.near = 1e-13 * size;
            for n in &mut v.nodes {
                n.low -= v.near;
                n.high += v.near;
            }
        }
        v
    }

    fn build(&mut self, order: &mut [u32], start: u32) {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &k in order.iter() {
            for c in &self.corners[k as usize] {
                (low, high) = (low.min(*c), high.max(*c));
            }
        }
        let node = self.nodes.len();
        self.nodes.push(Node {
            low,
            high,
            first: start,
            count: order.len() as u32,
        });
        if order.len() <= LEAF {
            return;
        }
        let size = high - low;
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let key = |k: &u32| {
            let c = &self.corners[*k as usize];
            c.iter().map(|c| c[axis]).sum::<f64>() / c.len() as f64
        };
        order.sort_by(|a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        let half = order.len() / 2;
        let (left, right) = order.split_at_mut(half);
        self.build(left, start);
        self.nodes[node].first = self.nodes.len() as u32;
        self.nodes[node].count = 0;
        self.build(right, start + half as u32);
    }

    /// Distance to patch `k` along the ray, if it is hit.
    #[inline]
    fn intersect(&self, k: usize, ray: &Sheared) -> Option<f64> {
        let normal = self.normals[k];
        let slope = normal.dot(ray.direction);
        // A ray in a patch's plane does not hit it; rounding would give it a random distance.
        if slope.abs() <= EDGE_ON * ray.length {
            return None;
        }
        let corners = &self.corners[k];
        let [x, y, z] = ray.axes;
        let flat = |c: DVec3| {
            let p = c - ray.origin;
            (p[x] - ray.shear[0] * p[z], p[y] - ray.shear[1] * p[z])
        };
        let mut a = flat(corners[corners.len() - 1]);
        let (mut positive, mut negative) = (false, false);
        for c in corners {
            let b = flat(*c);
            // The same edge from its other end gives exactly the negated number.
            let e = a.0 * b.1 - a.1 * b.0;
            positive |= e > 0.0;
            negative |= e < 0.0;
            a = b;
        }
        if positive && negative {
            return None;
        }
        Some(normal.dot(corners[0] - ray.origin) / slope)
    }

    /// Visits the patches hit at a distance in (`from`, `to`); `visit` returns the new `to`.
    fn walk(
        &self,
        ray: &Sheared,
        from: f64,
        mut to: f64,
        mut visit: impl FnMut(usize, f64) -> f64,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let mut stack = [0u32; 64];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let at = stack[depth] as usize;
            let node = &self.nodes[at];
            let a = (node.low - ray.origin) * ray.inverse;
            let b = (node.high - ray.origin) * ray.inverse;
            let near = a.x.min(b.x).max(a.y.min(b.y)).max(a.z.min(b.z));
            let far = a.x.max(b.x).min(a.y.max(b.y)).min(a.z.max(b.z)) * WIDEN;
            if near > far || far < from || near > to {
                continue;
            }
            if node.count > 0 {
                for &k in &self.order[node.first as usize..(node.first + node.count) as usize] {
                    if let Some(t) = self.intersect(k as usize, ray)
                        && t > from
                        && t < to
                    {
                        to = visit(k as usize, t);
                    }
                }
            } else {
                // Visits the half that the ray enters first.
                let (left, right) = (at + 1, node.first as usize);
                let middle = |n: &Node| (n.low + n.high).dot(ray.direction);
                let nearer_left = middle(&self.nodes[left]) <= middle(&self.nodes[right]);
                let (first, second) = if nearer_left {
                    (left, right)
                } else {
                    (right, left)
                };
                stack[depth] = second as u32;
                stack[depth + 1] = first as u32;
                depth += 2;
            }
        }
    }

    /// The nearest patch on the ray except `skip`; of two at the same distance the one with the
    /// lower index. A front takes precedence over a back at the same distance, because a ray along
    /// the edge of a solid hits both there.
    pub fn closest(&self, origin: DVec3, direction: DVec3, skip: usize) -> Option<Hit> {
        let ray = Sheared::new(origin, direction);
        let from = self.near / ray.length;
        let mut best: Option<(usize, f64, f64)> = None;
        self.walk(&ray, from, f64::INFINITY, |k, t| {
            let key = t * self.handicap(k, direction);
            if k != skip && best.is_none_or(|(p, _, s)| key < s || (key == s && k < p)) {
                best = Some((k, t, key));
            }
            // Slightly beyond the best, so that an equal distance is still tested.
            best.map_or(f64::INFINITY, |(_, _, s)| s * (1.0 + 2.0 * SAME))
        });
        best.map(|(patch, t, _)| Hit {
            patch,
            t,
            front: self.normals[patch].dot(direction) < 0.0,
        })
    }

    fn handicap(&self, patch: usize, direction: DVec3) -> f64 {
        if self.normals[patch].dot(direction) < 0.0 {
            1.0
        } else {
            1.0 + SAME
        }
    }

    /// Whether nothing is between point `a` on patch `i` and point `b` on patch `j`; the two
    /// patches themselves do not count.
    pub fn visible(&self, a: DVec3, i: usize, b: DVec3, j: usize) -> bool {
        let direction = b - a;
        let near = self.near / direction.length();
        let ray = Sheared::new(a, direction);
        let mut free = true;
        self.walk(&ray, near, 1.0 - near, |k, _| {
            if k != i && k != j {
                free = false;
                // Any hit suffices.
                return f64::NEG_INFINITY;
            }
            if free { 1.0 - near } else { f64::NEG_INFINITY }
        });
        free
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::enclosures::{cube, room_with_box};
    use glam::dvec3;
    use radiosity::{cosine_hemisphere, sample_4d};

    #[test]
    fn the_tree_answers_as_all_patches_one_by_one() {
        let e = room_with_box(2);
        let v = Visibility::new(&e);
        for k in 0..2000 {
            let [a, b, c, d] = sample_4d(k, 0, 5).map(f64::from);
            let origin = dvec3(0.1 + 2.8 * a, 0.1 + 0.8 * b, 0.1 + 1.8 * c);
            let direction = cosine_hemisphere(glam::Vec3::Z, d as f32, a as f32).as_dvec3()
                * if k % 2 == 0 { 1.0 } else { -1.0 };
            let ray = Sheared::new(origin, direction);
            let brute = (0..e.patches.len())
                .filter_map(|p| {
                    v.intersect(p, &ray)
                        .filter(|t| *t > v.near)
                        .map(|t| (p, t, t * v.handicap(p, direction)))
                })
                .min_by(|x, y| x.2.total_cmp(&y.2).then(x.0.cmp(&y.0)))
                .map(|(p, t, _)| (p, t));
            let hit = v.closest(origin, direction, usize::MAX);
            assert_eq!(hit.map(|h| (h.patch, h.t)), brute);
            assert!(hit.is_some_and(|h| h.front), "{origin} {direction}");
        }
    }

    #[test]
    fn no_ray_leaves_a_cube_aimed_at_its_corners_and_edges() {
        let e = cube(4);
        let v = Visibility::new(&e);
        let origin = dvec3(0.3, 0.4, 0.55);
        for p in &e.patches {
            for (k, c) in p.corners.iter().enumerate() {
                let along = p.corners[(k + 1) % p.corners.len()];
                for s in 0..8 {
                    let target = *c + (along - *c) * (s as f64 / 8.0);
                    assert!(v.closest(origin, target - origin, usize::MAX).is_some());
                }
            }
        }
    }

    #[test]
    fn a_box_hides_what_is_behind_it() {
        let e = room_with_box(1);
        let v = Visibility::new(&e);
        let (left, right) = (dvec3(0.0, 1.5, 0.4), dvec3(3.0, 1.5, 0.4));
        let above = dvec3(3.0, 1.5, 1.4);
        let (i, j) = (usize::MAX, usize::MAX);
        assert!(!v.visible(left, i, right, j));
        assert!(v.visible(dvec3(0.0, 1.5, 1.4), i, above, j));
    }
}
