//! Bodies whose interior nobody sees, such as walls, crates and pillars.
//!
//! A floor that continues under a wall has a part inside the wall. Nobody sees it, so it should not
//! be lit. Whether a point is in such a place is a purely geometric question: a ray from a point
//! inside a closed surface leaves that surface once more often than it enters it.
//!
//! A *body* is a connected piece of one instance in which every edge is shared by as many triangles
//! in one direction as in the other, and whose fronts face outwards. The following are not bodies:
//! - closed surfaces that transmit light, that contain a lamp or most of an emitter, or that glow
//!   around the level (a sky dome), because their interior is meant to be seen;
//! - shells whose fronts face inwards, which are rooms, whether double-sided or not.
//!
//! A hollow body (a house with thick walls) is one closed surface inside another of the same
//! instance: the inner volume is subtracted from the outer one.
//!
//! Open shells (a crate without a bottom) are not found here; only rays can tell what they hide.
//!
//! Source: the parity of crossings is the winding number of a closed surface (A. Jacobson, L.
//! Kavan, O. Sorkine-Hornung, *Robust inside-outside segmentation using generalized winding
//! numbers*, 2013, §3).

use std::cell::RefCell;

use glam::{DVec3, Vec3};
use mesh_ingest::{LightKind, Scene, Soup};
use visibility::{BuildError, BuildOptions, Bvh, HitFilter, Ray};

use crate::sampling::cosine_hemisphere;

/// Mean thickness below which a closed surface is two sheets on top of each other, as volume over
/// area and length. It is far above rounding.
const THINNEST: f64 = 1e-6;

/// A body that contains more than this share of an emissive piece is lit inside. A bulb may stand
/// in a room's floor, and a panel may be recessed into a ceiling up to its face.
const MOST_OF_IT: f32 = 0.75;

/// A surface that glows on both sides is a sky dome if it spans this share of the scene. Others are
/// bulbs and panels, whose inside nobody sees.
const DOME: f32 = 0.5;

/// Directions in which crossings are counted, in the square that [`cosine_hemisphere`] maps. Two
/// agreeing directions decide, because a ray through an edge may count it twice. They are away from
/// the horizon, so that they leave the plane of the point.
const DIRECTIONS: [[f32; 2]; 3] = [[0.137, 0.271], [0.293, 0.618], [0.071, 0.829]];

/// The closed bodies of a scene.
pub(crate) struct Solids {
    tree: Bvh,
    /// The body of each triangle of the tree.
    faces: Vec<u32>,
    /// Front normals, by triangle of the tree.
    normals: Vec<Vec3>,
    /// By body: whether its interior is meant to be seen.
    inhabited: Vec<bool>,
    /// Diagonals of the boxes around the others: most points are in none of them, and need no ray.
    boxes: Bvh,
}

/// A connected piece of an instance.
struct Piece {
    /// Its triangles.
    triangles: Vec<[Vec3; 3]>,
    instance: u32,
    /// Signed volume in m³; positive if fronts face outwards.
    volume: f64,
    /// Whether it is closed and opaque and has volume.
    closed: bool,
    /// Whether it emits light inwards too.
    glows_inside: bool,
    /// Centres of its emissive triangles, just above their fronts, and their areas.
    emits: Vec<(Vec3, f32)>,
}

impl Solids {
    /// Finds the bodies of a scene. O(n log n) in triangles.
    ///
    /// # Errors
    /// Those of [`Bvh::build`]: never for a [`Soup`] from [`Soup::build`].
    pub(crate) fn find(
        scene: &Scene,
        soup: &Soup,
        tree: &BuildOptions,
        offset: impl Fn(Vec3) -> f32,
    ) -> Result<Solids, BuildError> {
        let pieces = pieces(scene, soup, offset);
        let all: Vec<&Piece> = pieces.iter().filter(|p| p.closed).collect();
        // First each piece separately, to find which pieces contain which.
        let apart: Vec<u32> = (0..all.len() as u32).collect();
        let first = Solids::of(&all, &apart, tree)?;
        let body_of = |(k, piece): (usize, &&Piece)| -> Option<u32> {
            if piece.volume > 0.0 {
                return Some(k as u32);
            }
            // The smallest of those around it.
            let volume = |b: u32| all[b as usize].volume;
            let around = first.around(piece.triangles[0][0], Vec3::Y).into_iter();
            let hollow = around
                .filter(|&b| volume(b) > 0.0 && all[b as usize].instance == piece.instance)
                .min_by(|a, b| volume(*a).total_cmp(&volume(*b)));
            // As seen from the body, the fronts of a cavity face outwards.
            hollow
        };
        let (kept, bodies): (Vec<&Piece>, Vec<u32>) = (all.iter().enumerate())
            .filter_map(|x| Some((*x.1, body_of(x)?)))
            .unzip();
        let mut solids = Solids::of(&kept, &bodies, tree)?;
        solids.find_inhabited(scene, &pieces);
        let whole = span(&soup.triangles);
        for (piece, body) in kept.iter().zip(&bodies) {
            if piece.glows_inside && span(&piece.triangles) >= DOME * whole {
                solids.inhabited[*body as usize] = true;
            }
        }
        let mut corners = vec![(Vec3::INFINITY, Vec3::NEG_INFINITY); solids.inhabited.len()];
        for (piece, body) in kept.iter().zip(bodies) {
            let (low, high) = &mut corners[body as usize];
            for corner in piece.triangles.iter().flatten() {
                (*low, *high) = (low.min(*corner), high.max(*corner));
            }
        }
        let diagonals: Vec<[Vec3; 3]> = (corners.iter().zip(&solids.inhabited))
            .filter(|((low, _), inhabited)| !**inhabited && low.is_finite())
            .map(|(&(low, high), _)| [low, high, high])
            .collect();
        solids.boxes = Bvh::build(&diagonals, |_| false, tree)?;
        Ok(solids)
    }

    /// The tree of some pieces, with the body of each.
    fn of(pieces: &[&Piece], bodies: &[u32], tree: &BuildOptions) -> Result<Solids, BuildError> {
        let (mut triangles, mut faces) = (Vec::new(), Vec::new());
        for (piece, body) in pieces.iter().zip(bodies) {
            triangles.extend_from_slice(&piece.triangles);
            faces.resize(triangles.len(), *body);
        }
        let normals = triangles.iter().map(|[a, b, c]| (b - a).cross(c - a));
        Ok(Solids {
            normals: normals.collect(),
            tree: Bvh::build(&triangles, |_| true, tree)?,
            inhabited: vec![false; bodies.iter().map(|b| b + 1).max().unwrap_or(0) as usize],
            boxes: Bvh::build(&[], |_| false, tree)?,
            faces,
        })
    }

    /// Marks the bodies that contain a lamp, or most of an emissive piece.
    fn find_inhabited(&mut self, scene: &Scene, pieces: &[Piece]) {
        if self.faces.is_empty() {
            return;
        }
        for light in &scene.lights {
            let at = match light.kind {
                LightKind::Point { position, .. } | LightKind::Spot { position, .. } => position,
                _ => continue,
            };
            for body in self.around(at, Vec3::Y) {
                self.inhabited[body as usize] = true;
            }
        }
        for piece in pieces.iter().filter(|p| !p.emits.is_empty()) {
            let all: f32 = piece.emits.iter().map(|e| e.1).sum();
            let mut held: Vec<(u32, f32)> = Vec::new();
            for (at, area) in &piece.emits {
                for body in self.around(*at, Vec3::Y) {
                    match held.iter_mut().find(|h| h.0 == body) {
                        Some(h) => h.1 += area,
                        None => held.push((body, *area)),
                    }
                }
            }
            for (body, _) in held.into_iter().filter(|h| h.1 > MOST_OF_IT * all) {
                self.inhabited[body as usize] = true;
            }
        }
    }

    /// Whether a point is inside a body. `up` is a unit vector away from the surface that the point
    /// is on.
    pub(crate) fn hide(&self, point: Vec3, up: Vec3) -> bool {
        let Some(room) = self.boxes_around(point) else {
            return false;
        };
        let inside = |d: &[f32; 2]| {
            let direction = cosine_hemisphere(up, d[0], d[1]);
            let found = self.crossings(point, direction, way_out(point, direction, room));
            (found.iter()).any(|&(body, n)| n > 0 && !self.inhabited[body as usize])
        };
        let [a, b, c] = &DIRECTIONS;
        let first = inside(a);
        if inside(b) == first { first } else { inside(c) }
    }

    /// The box around all boxes of bodies that a point is in.
    fn boxes_around(&self, point: Vec3) -> Option<(Vec3, Vec3)> {
        let mut around: Option<(Vec3, Vec3)> = None;
        self.boxes.any_near(point, point, |_, [low, high, _]| {
            if low.cmple(point).all() && high.cmpge(point).all() {
                let (from, to) = around.unwrap_or((low, high));
                around = Some((from.min(low), to.max(high)));
            }
            false
        });
        around
    }

    /// The bodies around a point, in ascending order.
    fn around(&self, point: Vec3, up: Vec3) -> Vec<u32> {
        let found = DIRECTIONS
            .map(|d| self.crossings(point, cosine_hemisphere(up, d[0], d[1]), f32::INFINITY));
        let mut out: Vec<u32> = found[0].iter().chain(&found[1]).map(|f| f.0).collect();
        out.sort_unstable();
        out.dedup();
        let holds = |f: &Vec<(u32, i32)>, b: u32| f.iter().any(|&(body, n)| body == b && n > 0);
        out.retain(|&b| found.iter().filter(|f| holds(f, b)).count() >= 2);
        out
    }

    /// For each body that a ray of this length hits, the number of exits minus the number of
    /// entries.
    fn crossings(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Vec<(u32, i32)> {
        let count = Crossings {
            solids: self,
            found: RefCell::default(),
        };
        let ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max,
        };
        self.tree.occluded(&ray, &count);
        count.found.into_inner()
    }
}

/// Distance along a unit direction at which a ray has left the box that its origin is in, with all
/// surfaces on the box's sides.
fn way_out(origin: Vec3, direction: Vec3, (low, high): (Vec3, Vec3)) -> f32 {
    let ahead = Vec3::select(direction.cmpgt(Vec3::ZERO), high - origin, origin - low);
    let slack = 1e-3 * (high - low).max_element();
    (ahead / direction.abs().max(Vec3::splat(1e-30))).min_element() + slack
}

/// Counts the surfaces that a ray crosses, and lets it pass.
struct Crossings<'s> {
    solids: &'s Solids,
    found: RefCell<Vec<(u32, i32)>>,
}

impl HitFilter for Crossings<'_> {
    fn accept(&self, triangle: u32, _: f32, _: f32, ray: &Ray) -> bool {
        let body = self.solids.faces[triangle as usize];
        let leaves = self.solids.normals[triangle as usize].dot(ray.direction) > 0.0;
        let step = if leaves { 1 } else { -1 };
        let mut found = self.found.borrow_mut();
        match found.iter_mut().find(|f| f.0 == body) {
            Some(f) => f.1 += step,
            None => found.push((body, step)),
        }
        false
    }
}

/// The connected pieces of every instance. They include triangles replaced by duplicates: without
/// them, touching crates would be open.
fn pieces(scene: &Scene, soup: &Soup, offset: impl Fn(Vec3) -> f32) -> Vec<Piece> {
    let mut out = Vec::new();
    let own = soup.len() as u32;
    let seen = |i: &usize| scene.instances[*i].stands_in.is_none();
    for instance in (0..soup.instance_ranges.len()).filter(seen) {
        let [start, end] = soup.instance_ranges[instance];
        let [first, last] = soup.duplicate_ranges[instance];
        let faces: Vec<u32> = (start..end).chain(own + first..own + last).collect();
        let corners: Vec<[Vec3; 3]> = faces.iter().map(|&f| corners_of(soup, f)).collect();
        for members in connected(&corners) {
            let mut piece = Piece {
                triangles: members.iter().map(|&m| corners[m]).collect(),
                instance: instance as u32,
                volume: 0.0,
                closed: true,
                glows_inside: false,
                emits: Vec::new(),
            };
            for &m in &members {
                let material = &scene.materials[soup.material(faces[m]) as usize];
                piece.closed &= !material.lets_light_through();
                if material.emissive != Vec3::ZERO && !material.occluder_only {
                    let [a, b, c] = corners[m];
                    let cross = (b - a).cross(c - a);
                    let middle = (a + b + c) / 3.0;
                    let above = middle + cross.normalize_or_zero() * offset(middle);
                    piece.emits.push((above, 0.5 * cross.length()));
                    piece.glows_inside |= material.double_sided;
                }
            }
            piece.closed = piece.closed && is_closed(&piece.triangles);
            if piece.closed {
                let (volume, least) = volume(&piece.triangles);
                piece.volume = volume;
                piece.closed = volume.abs() > least;
            }
            if piece.closed || !piece.emits.is_empty() {
                out.push(piece);
            }
        }
    }
    out
}

/// Diagonal of the box around triangles.
fn span(triangles: &[[Vec3; 3]]) -> f32 {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for p in triangles.iter().flatten() {
        (low, high) = (low.min(*p), high.max(*p));
    }
    (high - low).length()
}

/// World corners of a face, in the face's original order.
fn corners_of(soup: &Soup, face: u32) -> [Vec3; 3] {
    match soup.duplicate(face) {
        None => soup.triangles[face as usize],
        Some(d) => d
            .corners
            .map(|c| soup.triangles[d.kept as usize][c as usize]),
    }
}

fn bits(p: Vec3) -> [u32; 3] {
    // Both zeros are the same position.
    (p + 0.0).to_array().map(f32::to_bits)
}

/// Indices of triangles by connected piece; triangles with a corner in the same position are
/// connected.
pub(crate) fn connected(corners: &[[Vec3; 3]]) -> Vec<Vec<usize>> {
    let mut places: Vec<([u32; 3], u32)> = (corners.iter().enumerate())
        .flat_map(|(t, c)| c.map(|p| (bits(p), t as u32)))
        .collect();
    places.sort_unstable();
    let mut parent: Vec<u32> = (0..corners.len() as u32).collect();
    fn root(parent: &mut [u32], mut x: u32) -> u32 {
        while parent[x as usize] != x {
            parent[x as usize] = parent[parent[x as usize] as usize];
            x = parent[x as usize];
        }
        x
    }
    for pair in places.windows(2).filter(|w| w[0].0 == w[1].0) {
        let (a, b) = (root(&mut parent, pair[0].1), root(&mut parent, pair[1].1));
        let (low, high) = (a.min(b), a.max(b));
        parent[high as usize] = low;
    }
    // The root of a piece is its first triangle, so pieces come in order.
    let mut slot = vec![usize::MAX; corners.len()];
    let mut out: Vec<Vec<usize>> = Vec::new();
    for t in 0..corners.len() {
        let r = root(&mut parent, t as u32) as usize;
        if slot[r] == usize::MAX {
            slot[r] = out.len();
            out.push(Vec::new());
        }
        out[slot[r]].push(t);
    }
    out
}

/// Whether every edge occurs equally often in both directions.
fn is_closed(triangles: &[[Vec3; 3]]) -> bool {
    let mut edges: Vec<([u32; 3], [u32; 3], i32)> = Vec::with_capacity(3 * triangles.len());
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (bits(t[k]), bits(t[(k + 1) % 3]));
            edges.push(if a < b { (a, b, 1) } else { (b, a, -1) });
        }
    }
    edges.sort_unstable();
    (edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)))
        .all(|edge| edge.iter().map(|e| e.2).sum::<i32>() == 0)
}

/// Signed volume in m³, and the smallest volume that is not a thin sheet's.
fn volume(triangles: &[[Vec3; 3]]) -> (f64, f64) {
    let from = triangles[0][0].as_dvec3();
    let (mut sum, mut area) = (0.0, 0.0);
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for t in triangles {
        let [a, b, c] = t.map(|p| p.as_dvec3() - from);
        sum += a.dot(b.cross(c)) / 6.0;
        area += (b - a).cross(c - a).length() / 2.0;
        for p in [a, b, c] {
            (low, high) = (low.min(p), high.max(p));
        }
    }
    (sum, THINNEST * area * (high - low).length())
}

#[cfg(test)]
mod tests;
