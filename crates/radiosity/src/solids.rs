//! Bodies whose inside nobody sees: walls, crates, pillars.
//!
//! A floor that runs on under a wall has a part inside the wall. No one looks at it, and no light
//! belongs there. Whether a point is in such a place is a question of geometry, so it is answered
//! without light: a ray from a point inside a closed surface leaves it once more often than it
//! enters it, whatever else is in the way.
//!
//! A *body* is a connected piece of one instance whose every edge is shared by as many triangles in
//! one direction as in the other, and whose fronts face outwards. Not bodies are
//! - closed surfaces that let light through, or that hold a lamp or most of an emitter: someone is
//!   meant to look at what is inside them,
//! - shells whose fronts face inwards, which are rooms, double-sided or not.
//!
//! A hollow body (a house with thick walls) is one closed surface inside another of the same
//! instance: the inner one is taken out of the outer.
//!
//! Open shells (a crate without a bottom) are not found here; only rays tell what they hide.
//!
//! Source: the parity of crossings is the winding number of a closed surface (A. Jacobson, L.
//! Kavan, O. Sorkine-Hornung, *Robust inside-outside segmentation using generalized winding
//! numbers*, 2013, §3).

use std::cell::RefCell;

use glam::{DVec3, Vec3};
use mesh_ingest::{LightKind, Scene, Soup};
use visibility::{BuildError, BuildOptions, Bvh, HitFilter, Ray};

use crate::sampling::cosine_hemisphere;

/// Mean thickness below which a closed surface is two sheets glued together: volume over area and
/// length, far above the rounding of either.
const THINNEST: f64 = 1e-6;

/// A body that holds more than this share of a piece that emits is lit inside: a bulb may stand in
/// a room's floor, and a panel be sunk in a ceiling up to its face.
const MOST_OF_IT: f32 = 0.75;

/// Directions in which crossings are counted, in the square that [`cosine_hemisphere`] maps: two
/// that agree decide, since a ray through an edge may count it twice. Away from the horizon, so
/// that they leave the plane that the point lies in.
const DIRECTIONS: [[f32; 2]; 3] = [[0.137, 0.271], [0.293, 0.618], [0.071, 0.829]];

/// The closed bodies of a scene.
pub(crate) struct Solids {
    tree: Bvh,
    /// By triangle of the tree: its body.
    faces: Vec<u32>,
    /// Fronts' normals, by triangle of the tree.
    normals: Vec<Vec3>,
    /// By body: someone is meant to see its inside.
    inhabited: Vec<bool>,
}

/// A connected piece of an instance.
struct Piece {
    /// Its triangles.
    triangles: Vec<[Vec3; 3]>,
    instance: u32,
    /// Signed, m³: positive where fronts face outwards.
    volume: f64,
    /// It is closed, opaque and has volume.
    closed: bool,
    /// Middles of its emissive triangles, just above their fronts, and their areas.
    emits: Vec<(Vec3, f32)>,
}

impl Solids {
    /// Finds the bodies of a scene. O(n log n) in triangles.
    ///
    /// # Errors
    /// What [`Bvh::build`] reports: never for a [`Soup`] of [`Soup::build`].
    pub(crate) fn find(
        scene: &Scene,
        soup: &Soup,
        tree: &BuildOptions,
        offset: impl Fn(Vec3) -> f32,
    ) -> Result<Solids, BuildError> {
        let pieces = pieces(scene, soup, offset);
        let all: Vec<&Piece> = pieces.iter().filter(|p| p.closed).collect();
        // First each by itself, to find out which are in which.
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
            // As seen from the body, a cavity's fronts face outwards.
            hollow
        };
        let (kept, bodies): (Vec<&Piece>, Vec<u32>) = (all.iter().enumerate())
            .filter_map(|x| Some((*x.1, body_of(x)?)))
            .unzip();
        let mut solids = Solids::of(&kept, &bodies, tree)?;
        solids.find_inhabited(scene, &pieces);
        Ok(solids)
    }

    /// The tree of some pieces, with each one's body.
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
            faces,
        })
    }

    /// Marks the bodies that hold a lamp, or all of a piece that emits.
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

    /// Whether a point is inside a body. `up` is a unit vector that leads away from the surface
    /// that the point lies on.
    pub(crate) fn hide(&self, point: Vec3, up: Vec3) -> bool {
        let Some((low, high)) = self.tree.bounds() else {
            return false;
        };
        if point.cmplt(low).any() || point.cmpgt(high).any() {
            return false;
        }
        let inside = |d: &[f32; 2]| {
            let found = self.crossings(point, cosine_hemisphere(up, d[0], d[1]));
            (found.iter()).any(|&(body, n)| n > 0 && !self.inhabited[body as usize])
        };
        let [a, b, c] = &DIRECTIONS;
        let first = inside(a);
        if inside(b) == first { first } else { inside(c) }
    }

    /// The bodies around a point, ascending.
    fn around(&self, point: Vec3, up: Vec3) -> Vec<u32> {
        let found = DIRECTIONS.map(|d| self.crossings(point, cosine_hemisphere(up, d[0], d[1])));
        let mut out: Vec<u32> = found[0].iter().chain(&found[1]).map(|f| f.0).collect();
        out.sort_unstable();
        out.dedup();
        let holds = |f: &Vec<(u32, i32)>, b: u32| f.iter().any(|&(body, n)| body == b && n > 0);
        out.retain(|&b| found.iter().filter(|f| holds(f, b)).count() >= 2);
        out
    }

    /// How many times more often a ray leaves each body that it meets than it enters it.
    fn crossings(&self, origin: Vec3, direction: Vec3) -> Vec<(u32, i32)> {
        let count = Crossings {
            solids: self,
            found: RefCell::default(),
        };
        let ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        self.tree.occluded(&ray, &count);
        count.found.into_inner()
    }
}

/// Counts what a ray passes, and lets it pass.
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

/// The connected pieces of every instance. Triangles that others take the place of are among them:
/// without them, crates that touch would be open.
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

/// World corners of a face, in its own order.
fn corners_of(soup: &Soup, face: u32) -> [Vec3; 3] {
    match soup.duplicate(face) {
        None => soup.triangles[face as usize],
        Some(d) => d
            .corners
            .map(|c| soup.triangles[d.kept as usize][c as usize]),
    }
}

fn bits(p: Vec3) -> [u32; 3] {
    // Both zeros are one place.
    (p + 0.0).to_array().map(f32::to_bits)
}

/// Numbers of triangles by the connected piece that they belong to; corners in one place connect.
fn connected(corners: &[[Vec3; 3]]) -> Vec<Vec<usize>> {
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
    // A root is the first of its piece, so that pieces come in order.
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

/// Whether every edge is run along as often in one direction as in the other.
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

/// Signed volume, m³, and the least that is not a sheet's.
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
