//! Rays against triangles in double precision: a textbook test and a tree split at the median.

use glam::DVec3;

use super::scene::Triangle;

/// Most triangles per leaf. Speed hardly matters; the tree only has to be correct.
const LEAF: usize = 4;

/// A segment of a line.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start, metres.
    pub origin: DVec3,
    /// Direction; `t` is in units of its length.
    pub direction: DVec3,
    /// Hits at or beyond this `t` do not count.
    pub t_max: f64,
    /// Triangles that the ray passes through: the one that it starts on, and the one that it is
    /// aimed at.
    pub skip: [usize; 2],
}

/// Where a ray hits a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance in lengths of the direction.
    pub t: f64,
    /// Index of the triangle.
    pub triangle: usize,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    min: DVec3,
    max: DVec3,
    /// First child, the second follows its subtree at `right`; or the first item of a leaf.
    first: usize,
    right: usize,
    /// Items of a leaf; 0 in an inner node.
    count: usize,
}

/// Triangles in a box hierarchy.
#[derive(Debug, Clone)]
pub struct Tree {
    triangles: Vec<Triangle>,
    order: Vec<usize>,
    nodes: Vec<Node>,
    /// Faces within this distance of each other, in metres, are in the same place.
    same: f64,
}

impl Tree {
    /// A tree over `triangles`, which must be finite.
    pub fn new(triangles: Vec<Triangle>) -> Tree {
        let corners = || triangles.iter().flat_map(|t| t.corners);
        let (min, max) = corners().fold((DVec3::MAX, DVec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
        let size = if triangles.is_empty() {
            0.0
        } else {
            (max - min).length()
        };
        let mut tree = Tree {
            order: (0..triangles.len()).collect(),
            nodes: Vec::new(),
            same: size * SAME,
            triangles,
        };
        if !tree.triangles.is_empty() {
            tree.split(0, tree.triangles.len(), size * SAME);
        }
        tree
    }

    /// The triangles.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// Adds the node over `order[from..to]` and its subtree; `pad` widens boxes beyond rounding
    /// errors.
    fn split(&mut self, from: usize, to: usize, pad: f64) {
        let me = self.nodes.len();
        let (mut min, mut max) = (DVec3::MAX, DVec3::MIN);
        for &i in &self.order[from..to] {
            for p in self.triangles[i].corners {
                (min, max) = (min.min(p), max.max(p));
            }
        }
        self.nodes.push(Node {
            min: min - pad,
            max: max + pad,
            first: from,
            right: 0,
            count: to - from,
        });
        if to - from <= LEAF {
            return;
        }
        let d = max - min;
        let axis = (0..3).max_by(|&a, &b| d[a].total_cmp(&d[b])).unwrap_or(0);
        let triangles = &self.triangles;
        let key = |i: &usize| -> f64 { triangles[*i].corners.iter().map(|p| p[axis]).sum() };
        // Ties are decided by index, so that the tree is the same everywhere.
        self.order[from..to].sort_by(|a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        let middle = usize::midpoint(from, to);
        self.nodes[me].count = 0;
        self.split(from, middle, pad);
        self.nodes[me].right = self.nodes.len();
        self.split(middle, to, pad);
    }

    /// The nearest hit, or none.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.search(ray, false)
    }

    /// Whether anything is on the segment.
    pub fn blocked(&self, ray: &Ray) -> bool {
        self.search(ray, true).is_some()
    }

    fn search(&self, ray: &Ray, any: bool) -> Option<Hit> {
        let inverse = ray.direction.recip();
        let mut best: Option<Hit> = None;
        let mut t_max = ray.t_max;
        // The tree halves its items, so 64 levels would need more items than fit in memory.
        let mut stack = [0usize; 64];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let at = stack[depth];
            let node = &self.nodes[at];
            if !meets_box(node, ray.origin, inverse, t_max) {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.right;
                stack[depth + 1] = at + 1;
                depth += 2;
                continue;
            }
            for &i in &self.order[node.first..node.first + node.count] {
                if ray.skip.contains(&i) {
                    continue;
                }
                if let Some(t) = meets_triangle(&self.triangles[i], ray, self.same)
                    && self.comes_first(ray, Hit { t, triangle: i }, best)
                {
                    t_max = t;
                    best = Some(Hit { t, triangle: i });
                    if any {
                        return best;
                    }
                }
            }
        }
        best
    }

    /// Whether `hit` comes before the nearest one so far. Of two in the same place it is the one that
    /// shows its front, as of the faces of a wall without thickness, else the earlier one in the
    /// file, as in Lumel.
    fn comes_first(&self, ray: &Ray, hit: Hit, best: Option<Hit>) -> bool {
        let Some(best) = best else {
            return hit.t < ray.t_max;
        };
        let [facing, of_best] =
            [hit, best].map(|h| self.triangles[h.triangle].normal().dot(ray.direction));
        // By the steeper of both: a face that the ray grazes is near to all of it.
        if (hit.t - best.t).abs() * facing.abs().max(of_best.abs()) > self.same {
            return hit.t < best.t;
        }
        match (facing < 0.0) == (of_best < 0.0) {
            true => hit.triangle < best.triangle,
            false => facing < 0.0,
        }
    }

    /// [`closest`](Tree::closest) by testing every triangle: the tree must agree with it.
    pub fn closest_of_all(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (i, triangle) in self.triangles.iter().enumerate() {
            if ray.skip.contains(&i) {
                continue;
            }
            if let Some(t) = meets_triangle(triangle, ray, self.same)
                && self.comes_first(ray, Hit { t, triangle: i }, best)
            {
                best = Some(Hit { t, triangle: i });
            }
        }
        best
    }
}

/// Faces closer together than this fraction of the scene's size are in the same place: about a
/// rounding of f32, the precision of a file's corners. Where a bed's headboard is flush with a wall,
/// the sign of that rounding would decide which of the two is seen.
const SAME: f64 = 1e-7;

fn meets_box(node: &Node, origin: DVec3, inverse: DVec3, t_max: f64) -> bool {
    let (a, b) = ((node.min - origin) * inverse, (node.max - origin) * inverse);
    a.min(b).max_element() <= a.max(b).min_element().min(t_max) && a.max(b).min_element() >= 0.0
}

/// Möller and Trumbore, *Fast, Minimum Storage Ray/Triangle Intersection*, 1997; no culling. Faces
/// within `same` of the origin do not count: it is on them.
///
/// Rays that pass between two triangles through the rounding error of their shared edge are lost,
/// about 1e-16 of all rays.
fn meets_triangle(triangle: &Triangle, ray: &Ray, same: f64) -> Option<f64> {
    let [a, b, c] = triangle.corners;
    let (e1, e2) = (b - a, c - a);
    let p = ray.direction.cross(e2);
    let det = e1.dot(p);
    if det == 0.0 {
        return None;
    }
    let (s, normal) = (ray.origin - a, e1.cross(e2));
    if s.dot(normal).abs() <= same * normal.length() {
        return None;
    }
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = ray.direction.dot(q) / det;
    let t = e2.dot(q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}
