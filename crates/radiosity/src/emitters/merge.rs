//! Merges many small triangles of equal emission into few large ones.
//!
//! A luminous ceiling may consist of ten thousand triangles because of tessellation or the
//! modeller's grid. It is still one polygon, and the closed form of its light is the same however
//! it is triangulated. Its outline needs few triangles; a rectangle needs two.

use std::cmp::Ordering;

use glam::{DVec2, DVec3, Vec3};

use super::Emitter;

/// A union replaces its parts if it has at most this share of their triangles. Otherwise, a fan or
/// a strip is as good as the ear-clipped outline.
const WORTHWHILE: f64 = 0.5;

/// Relative tolerance on the area before and after. Each triangle's area is accurate to 1e-7
/// (`f32`), and corners on a straight edge may be off by 1e-6 of the scene's size. A larger
/// difference means overlaps or a misidentified hole, and the triangles stay as they are.
const SAME_AREA: f64 = 1e-4;

/// Replaces edge-connected, coplanar triangles of one kind by a triangulation of their outline, in
/// place. O(n log n).
///
/// Triangles with equal `kind` (the same light, the same sides) may be merged. `slack` is the
/// tolerance in metres for a corner's distance from a plane or line. It must not exceed the
/// distance at which shadow rays end in front of an emitter, because they must not hit the emitter
/// itself.
pub(super) fn merge_coplanar(
    emitters: &mut Vec<Emitter>,
    kind: impl Fn(&Emitter) -> u32,
    slack: impl Fn(Vec3) -> f32,
) {
    let links = Links::find(emitters, &kind);
    let n = emitters.len();
    let mut seen = vec![false; n];
    let mut gone = vec![false; n];
    let mut merged = Vec::new();
    let mut clipper = earcut::Earcut::new();
    for seed in 0..n {
        if seen[seed] {
            continue;
        }
        let region = grow(emitters, &links, seed, &slack, &mut seen);
        if region.len() < 3 {
            continue;
        }
        let Some(triangles) = retriangulate(emitters, &links, &region, &slack, &mut clipper) else {
            continue;
        };
        for &k in &region {
            gone[k as usize] = true;
        }
        merged.extend(triangles);
    }
    let mut k = 0;
    emitters.retain(|_| {
        k += 1;
        !gone[k - 1]
    });
    emitters.extend(merged);
}

const NONE: u32 = u32::MAX;

/// For each triangle and each of its edges (corner *i* to *i* + 1), the neighbour across it.
struct Links(Vec<[u32; 3]>);

impl Links {
    /// Two triangles are neighbours if an edge of one is bitwise the reversed edge of the other and
    /// no third triangle has that edge.
    fn find(emitters: &[Emitter], kind: &impl Fn(&Emitter) -> u32) -> Self {
        // (smaller corner, larger corner, kind), then the owner and the direction.
        let mut edges: Vec<([u32; 6], u32, u32, u8, bool)> = Vec::with_capacity(3 * emitters.len());
        for (k, e) in emitters.iter().enumerate() {
            for i in 0..3 {
                let (a, b) = (bits(e.corners[i]), bits(e.corners[(i + 1) % 3]));
                let (low, high) = (a.min(b), a.max(b));
                let key = [low[0], low[1], low[2], high[0], high[1], high[2]];
                edges.push((key, kind(e), k as u32, i as u8, a < b));
            }
        }
        edges.sort_unstable();
        let mut links = vec![[NONE; 3]; emitters.len()];
        for run in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            if let [a, b] = run
                && a.4 != b.4
            {
                links[a.2 as usize][a.3 as usize] = b.2;
                links[b.2 as usize][b.3 as usize] = a.2;
            }
        }
        Links(links)
    }
}

/// A position as integers that are equal exactly if the position is.
fn bits(p: Vec3) -> [u32; 3] {
    // −0 is 0.
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// A plane fitted to triangles. Its accuracy grows with each one: the normal of a single small
/// triangle is off by the rounding of its corners over its size.
struct Plane {
    /// Σ area × normal, and Σ area × centre.
    normal: DVec3,
    centre: DVec3,
    area: f64,
}

impl Plane {
    fn add(&mut self, e: &Emitter) {
        let [a, b, c] = e.corners.map(|c| c.as_dvec3());
        let normal = (b - a).cross(c - a) * 0.5;
        let area = normal.length();
        self.normal += normal;
        self.centre += (a + b + c) * (area / 3.0);
        self.area += area;
    }

    /// Whether all of `e` is within `slack` of the plane and faces the same way.
    fn holds(&self, e: &Emitter, slack: &impl Fn(Vec3) -> f32) -> bool {
        let normal = self.normal.normalize_or_zero();
        let origin = self.centre / self.area.max(1e-300);
        // A triangle that faces the other way is another side, however thin the sheet.
        normal.dot(e.normal.as_dvec3()) > 0.9
            && e.corners
                .iter()
                .all(|c| normal.dot(c.as_dvec3() - origin).abs() <= slack(*c) as f64)
    }
}

/// The coplanar triangles that are edge-connected to `seed`.
fn grow(
    emitters: &[Emitter],
    links: &Links,
    seed: usize,
    slack: &impl Fn(Vec3) -> f32,
    seen: &mut [bool],
) -> Vec<u32> {
    let mut plane = Plane {
        normal: DVec3::ZERO,
        centre: DVec3::ZERO,
        area: 0.0,
    };
    plane.add(&emitters[seed]);
    let mut region = vec![seed as u32];
    seen[seed] = true;
    let mut next = 0;
    while next < region.len() {
        for neighbour in links.0[region[next] as usize] {
            if neighbour == NONE || seen[neighbour as usize] {
                continue;
            }
            let e = &emitters[neighbour as usize];
            if plane.holds(e, slack) {
                plane.add(e);
                seen[neighbour as usize] = true;
                region.push(neighbour);
            }
        }
        next += 1;
    }
    // A gently curved surface is followed along its curvature.
    if !region
        .iter()
        .all(|&k| plane.holds(&emitters[k as usize], slack))
    {
        return Vec::new();
    }
    region.sort_unstable();
    region
}

/// Triangulates the outline of the region; `None` if that is not worthwhile or the outline is not a
/// simple polygon with holes.
fn retriangulate(
    emitters: &[Emitter],
    links: &Links,
    region: &[u32],
    slack: &impl Fn(Vec3) -> f32,
    clipper: &mut earcut::Earcut<f64>,
) -> Option<Vec<Emitter>> {
    let mut first = emitters[region[0] as usize];
    let mut loops = outline(emitters, links, region)?;
    for corners in &mut loops {
        *corners = straighten(corners, slack);
    }
    let corners: usize = loops.iter().map(Vec::len).sum();
    let expected = corners + 2 * loops.len() - 4;
    if loops.iter().any(|l| l.len() < 3) || expected as f64 > WORTHWHILE * region.len() as f64 {
        return None;
    }
    let normal: DVec3 = (region.iter())
        .map(|&k| {
            let e = &emitters[k as usize];
            e.normal.as_dvec3() * e.area as f64
        })
        .sum();
    first.normal = normal.try_normalize().map_or(first.normal, |n| n.as_vec3());
    // In the plane and relative to a corner: the scene's size must not reduce the region's
    // precision.
    let (x, y) = first.normal.as_dvec3().any_orthonormal_pair();
    let origin = first.corners[0].as_dvec3();
    let flat = |p: &Vec3| -> DVec2 {
        let d = p.as_dvec3() - origin;
        DVec2::new(x.dot(d), y.dot(d))
    };
    // The outer loop runs the opposite way to holes; a connected region has exactly one.
    let area = |l: &Vec<Vec3>| -> f64 {
        (0..l.len())
            .map(|i| flat(&l[i]).perp_dot(flat(&l[(i + 1) % l.len()])))
            .sum::<f64>()
            * 0.5
    };
    let outer: Vec<usize> = (0..loops.len())
        .filter(|&i| area(&loops[i]) > 0.0)
        .collect();
    let [outer] = outer[..] else {
        return None;
    };
    loops.swap(0, outer);
    let mut points = Vec::with_capacity(corners);
    let mut holes: Vec<u32> = Vec::new();
    for (i, l) in loops.iter().enumerate() {
        if i > 0 {
            holes.push(points.len() as u32);
        }
        points.extend_from_slice(l);
    }
    let mut indices: Vec<u32> = Vec::new();
    clipper.earcut(
        points.iter().map(|p| flat(p).to_array()),
        &holes,
        &mut indices,
    );
    let mut out = Vec::with_capacity(indices.len() / 3);
    for &[a, b, c] in indices.as_chunks::<3>().0 {
        let mut corners = [a, b, c].map(|i| points[i as usize]);
        let [p, q, r] = corners.map(|p| p.as_dvec3());
        let normal: DVec3 = (q - p).cross(r - p);
        if normal.dot(first.normal.as_dvec3()) < 0.0 {
            corners.swap(1, 2);
        }
        let area = 0.5 * normal.length();
        if area > 0.0 {
            out.push(Emitter {
                corners,
                area: area as f32,
                ..first
            });
        }
    }
    let before: f64 = region
        .iter()
        .map(|&k| emitters[k as usize].area as f64)
        .sum();
    let after: f64 = out.iter().map(|e| e.area as f64).sum();
    ((after / before - 1.0).abs() <= SAME_AREA).then_some(out)
}

/// The loops of edges without a neighbour in the region, counter-clockwise around it; `None` if
/// several loops meet at a point.
fn outline(emitters: &[Emitter], links: &Links, region: &[u32]) -> Option<Vec<Vec<Vec3>>> {
    let within = |k: u32| k != NONE && region.binary_search(&k).is_ok();
    let mut edges: Vec<([u32; 3], Vec3, Vec3)> = Vec::new();
    for &k in region {
        let e = &emitters[k as usize];
        for (i, &neighbour) in links.0[k as usize].iter().enumerate() {
            if !within(neighbour) {
                edges.push((bits(e.corners[i]), e.corners[i], e.corners[(i + 1) % 3]));
            }
        }
    }
    edges.sort_unstable_by_key(|e| e.0);
    if edges.windows(2).any(|w| w[0].0 == w[1].0) {
        return None;
    }
    let mut used = vec![false; edges.len()];
    let mut loops = Vec::new();
    for start in 0..edges.len() {
        let mut corners = Vec::new();
        let mut at = start;
        while !used[at] {
            used[at] = true;
            corners.push(edges[at].1);
            at = edges
                .binary_search_by_key(&bits(edges[at].2), |e| e.0)
                .ok()?;
        }
        if !corners.is_empty() {
            loops.push(corners);
        }
    }
    Some(loops)
}

/// Removes corners that are collinear with others (Douglas and Peucker, 1973). No corner is then
/// farther than `slack` from the line.
fn straighten(corners: &[Vec3], slack: &impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    let n = corners.len();
    // Two corners that certainly stay: the first by position, and the farthest from it.
    let order = |a: &usize, b: &usize| -> Ordering {
        let (p, q) = (corners[*a].to_array(), corners[*b].to_array());
        p.iter()
            .zip(q)
            .map(|(p, q)| p.total_cmp(&q))
            .find(|o| o.is_ne())
            .unwrap_or(Ordering::Equal)
    };
    let Some(first) = (0..n).min_by(order) else {
        return Vec::new();
    };
    let distance = |k: &usize| corners[*k].distance_squared(corners[first]);
    let far = (0..n)
        .max_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(first);
    let mut keep = vec![false; n];
    (keep[first], keep[far]) = (true, true);
    let at = |k: usize| corners[k % n];
    let second = if far > first { far } else { far + n };
    let mut todo = vec![(first, second), (second, first + n)];
    while let Some((from, to)) = todo.pop() {
        let (a, b) = (at(from).as_dvec3(), at(to).as_dvec3());
        let (ab, length2) = (b - a, (b - a).length_squared().max(1e-300));
        // The farthest of all, whatever the slack at each; otherwise a corner could lose to its
        // neighbour.
        let (mut worst, mut strays) = ((0.0, 0), false);
        for k in from + 1..to {
            let d = at(k).as_dvec3() - a;
            let off = (d - ab * (d.dot(ab) / length2).clamp(0.0, 1.0)).length();
            strays |= off > slack(at(k)) as f64;
            if off > worst.0 {
                worst = (off, k);
            }
        }
        if strays {
            keep[worst.1 % n] = true;
            todo.push((from, worst.1));
            todo.push((worst.1, to));
        }
    }
    (0..n).filter(|&k| keep[k]).map(|k| corners[k]).collect()
}
