//! The tree over emitters, and the importance of a node to a receiver.

use glam::Vec3;

use super::Emitter;
use crate::divide::lower_part;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    /// Centre and radius of a bounding sphere of its emitters.
    pub centre: Vec3,
    pub radius: f32,
    /// Mean origin of its light.
    pub origin: Vec3,
    /// Σ luminance × area.
    pub power: f32,
    /// All fronts face within an angle of this axis whose cosine is `cos_spread`; −1 if a side may
    /// face anywhere.
    pub axis: Vec3,
    pub cos_spread: f32,
    /// Mean normal by power, not a unit vector; those of both sides of a face cancel out.
    pub mean: Vec3,
    /// Emitters `[start, end)`.
    pub start: u32,
    pub end: u32,
    /// The second child; the first one follows its parent. 0 for a leaf, which has one emitter.
    pub second: u32,
}

impl Node {
    /// Whether power alone is a good enough weight for its emitters, as seen from `p`.
    pub(crate) fn looks_alike(&self, p: Vec3) -> bool {
        let d2 = self.centre.distance_squared(p);
        self.cos_spread > ALIKE && self.radius * self.radius < SMALL * SMALL * d2
    }

    /// Approximate irradiance (luminance × π) from its emitters at a receiver; 0 only if they
    /// cannot contribute.
    ///
    /// power × cosθ cosθ'/d² (after Conty Estevez & Kulla, *Importance sampling of many lights with
    /// adaptive tree splitting*, 2018), where cosθ is an upper bound over all points of the node,
    /// and cosθ' about the mean over its faces. A sphere of angular radius asin s increases a
    /// positive cosine by at most s; if an upper bound is not positive, the whole node is hidden.
    /// `scale` is the size of the receiver in metres. A receiver with a zero normal receives from
    /// all directions.
    #[inline]
    pub(crate) fn importance(&self, p: Vec3, normal: Vec3, scale: f32) -> f32 {
        let d2 = self.origin.distance_squared(p);
        let reach = self.radius + scale;
        // Relative to the node's centre, which the sphere surrounds.
        let middle = self.centre - p;
        let m2 = middle.length_squared();
        let limit = d2.max(0.25 * reach * reach).max(1e-30);
        if m2 <= reach * reach {
            return self.power / limit;
        }
        let inverse = 1.0 / m2.sqrt();
        let wider = reach * inverse + ROUNDING;
        let receives = if normal == Vec3::ZERO {
            1.0
        } else {
            middle.dot(normal) * inverse + wider
        };
        if receives <= 0.0 {
            return 0.0;
        }
        let mut most = 1f32;
        if self.cos_spread > -1.0 {
            let cos = -middle.dot(self.axis) * inverse;
            if cos < self.cos_spread {
                // The smallest angle to a face: the spread of the faces is subtracted.
                let sine = (1.0 - cos * cos).max(0.0).sqrt();
                let spread = (1.0 - self.cos_spread * self.cos_spread).max(0.0).sqrt();
                most = (cos * self.cos_spread + sine * spread + wider).min(1.0);
                if most <= 0.0 {
                    return 0.0;
                }
            }
        }
        // What faces around this mean send, if their other directions are spread evenly: exact for
        // faces of one direction, and for those of a box or a sphere on average.
        let mean = -middle.dot(self.mean) * inverse;
        let expected = if self.cos_spread > ALIKE {
            mean
        } else {
            let varied = 0.25 * (1.0 - self.mean.length_squared()).max(0.0);
            0.5 * (mean + (mean * mean + varied).sqrt())
        };
        let sends = most.min(expected.max(PARTLY * most));
        self.power * receives.min(1.0) * sends / limit
    }
}

/// Allows for rounding (a thousandth of a right angle), and keeps every probability large enough to
/// divide by.
const ROUNDING: f32 = 1e-3;

/// Least share of the upper bound that a node is given: the expected value knows neither its size
/// nor how few of its faces may be seen.
const PARTLY: f32 = 0.1;

/// A node is small if its angular size (radius over distance) is below this: 1/d² then varies by
/// ±10 %.
const SMALL: f32 = 0.05;

/// Cosine of the angle (18°) within which faces count as parallel.
pub(super) const ALIKE: f32 = 0.95;

/// Sorts `emitters` and builds their tree, which is empty without emitters. O(n log n).
pub(super) fn build(emitters: &mut [Emitter]) -> Vec<Node> {
    let mut nodes = Vec::with_capacity(2 * emitters.len());
    if !emitters.is_empty() {
        let n = emitters.len();
        split(emitters, 0, n, &mut nodes);
    }
    nodes
}

/// The leaf node of emitter `start`.
#[inline]
pub(super) fn leaf(e: &Emitter, start: u32) -> Node {
    let [a, b, c] = e.corners;
    let origin = (a + b + c) / 3.0;
    let distance = |p: Vec3| p.distance_squared(origin);
    Node {
        centre: origin,
        radius: distance(a).max(distance(b)).max(distance(c)).sqrt(),
        origin,
        power: e.power() as f32,
        axis: e.normal,
        cos_spread: if e.two_sided { -1.0 } else { 1.0 },
        mean: if e.two_sided { Vec3::ZERO } else { e.normal },
        start,
        end: start + 1,
        second: 0,
    }
}

/// Centre, radius and size of the bounding box.
fn ball(part: &[Emitter]) -> (Vec3, f32, Vec3) {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for c in part.iter().flat_map(|e| e.corners) {
        low = low.min(c);
        high = high.max(c);
    }
    let centre = (low + high) * 0.5;
    let radius = (part.iter().flat_map(|e| e.corners))
        .map(|c| c.distance_squared(centre))
        .fold(0.0, f32::max)
        .sqrt();
    (centre, radius, high - low)
}

/// Sorts `emitters[start..end]` and appends their subtree to `nodes`. The depth is O(log n).
fn split(emitters: &mut [Emitter], start: usize, end: usize, nodes: &mut Vec<Node>) -> usize {
    let part = &mut emitters[start..end];
    let id = nodes.len();
    if let [e] = part {
        nodes.push(leaf(e, start as u32));
        return id;
    }
    let (centre, radius, size) = ball(part);
    let axis = size.max_position();
    let key = |e: &Emitter| e.corners[0][axis] + e.corners[1][axis] + e.corners[2][axis];
    let middle = lower_part(part.iter().map(key));
    part.select_nth_unstable_by(middle, |a, b| {
        // Parts of one triangle may share a key and a triangle, but never the first corner and all
        // other corners.
        (key(a).total_cmp(&key(b)))
            .then(a.triangle.cmp(&b.triangle))
            .then_with(|| order(&a.corners, &b.corners))
    });
    nodes.push(Node {
        centre,
        radius,
        origin: centre,
        power: 0.0,
        axis: Vec3::ZERO,
        cos_spread: -1.0,
        mean: Vec3::ZERO,
        start: start as u32,
        end: end as u32,
        second: 0,
    });
    let first = split(emitters, start, start + middle, nodes);
    let second = split(emitters, start + middle, end, nodes);
    let (a, b) = (nodes[first], nodes[second]);
    let power = a.power + b.power;
    let (axis, cos_spread) = join(&a, &b);
    let node = &mut nodes[id];
    node.second = second as u32;
    node.power = power;
    if power > 0.0 {
        node.origin = a.origin.lerp(b.origin, b.power / power);
        node.mean = a.mean.lerp(b.mean, b.power / power);
    }
    (node.axis, node.cos_spread) = (axis, cos_spread);
    id
}

/// By position, corner after corner.
fn order(a: &[Vec3; 3], b: &[Vec3; 3]) -> std::cmp::Ordering {
    let flat = |t: &[Vec3; 3]| t.map(|c| c.to_array());
    let (a, b) = (flat(a), flat(b));
    (a.iter().flatten().zip(b.iter().flatten()))
        .map(|(x, y)| x.total_cmp(y))
        .find(|o| o.is_ne())
        .unwrap_or(std::cmp::Ordering::Equal)
}

/// A cone that contains the directions of both nodes.
fn join(a: &Node, b: &Node) -> (Vec3, f32) {
    let everywhere = (Vec3::ZERO, -1.0);
    if a.cos_spread <= -1.0 || b.cos_spread <= -1.0 {
        return everywhere;
    }
    let angle = |cos: f32| libm::acosf(cos.clamp(-1.0, 1.0));
    let (wide, narrow) = if a.cos_spread <= b.cos_spread {
        (a, b)
    } else {
        (b, a)
    };
    let between = angle(wide.axis.dot(narrow.axis));
    let (w, n) = (angle(wide.cos_spread), angle(narrow.cos_spread));
    if between + n <= w {
        return (wide.axis, wide.cos_spread);
    }
    let spread = 0.5 * (w + between + n);
    if spread >= std::f32::consts::PI {
        return everywhere;
    }
    let across = (narrow.axis - wide.axis * wide.axis.dot(narrow.axis)).normalize_or_zero();
    if across == Vec3::ZERO {
        return everywhere; // opposite directions: the cone would span half a turn or more anyway
    }
    let turn = spread - w;
    let axis = wide.axis * libm::cosf(turn) + across * libm::sinf(turn);
    // The cosine of a sum of rounded angles, on the safe side.
    (axis, libm::cosf((spread + 1e-3).min(std::f32::consts::PI)))
}
