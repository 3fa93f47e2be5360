//! Input of an unwrapper: one mesh, welded, in world scale, with marked hard edges.

use glam::{DMat3, DVec3, Vec3};
use mesh_ingest::Mesh;
use rayon::slice::ParallelSliceMut;

/// Edges sharper than this, in degrees, are chart borders if the shading is hard too (normals
/// differ, or there are none).
///
/// Irradiance is discontinuous across a crease, and bilinear filtering inside one chart would blur
/// it.
pub const CREASE_DEGREES: f64 = 40.0;

/// So are flatter ones, down to this angle, between facets of [`FACET_LUMELS`]. Facets of rocks and
/// barrels would be drawn round.
const FACET_DEGREES: f64 = SMOOTH_NORMAL_DEGREES;

/// Area in lumels from which a facet is worth borders of its own. A sphere of such facets needs
/// twice the texels of a smooth one. Smaller ones share a chart with each other, or with one of
/// these, but never join two of them: the rims of a pillar's drums would draw its sides round.
const FACET_LUMELS: f64 = 2.0;

/// Edges sharper than this, in degrees, are always chart borders, whatever the normals are.
pub const SHARP_DEGREES: f64 = 65.0;

/// Corner normals that differ by less than this count as smooth shading, degrees.
const SMOOTH_NORMAL_DEGREES: f64 = 8.0;

/// "No triangle" in [`UnwrapInput::neighbors`].
pub const NONE: u32 = u32::MAX;

/// One mesh ready to be unwrapped: all primitives together, with vertices welded if their positions
/// are exactly equal.
#[derive(Debug, Clone, Default)]
pub struct UnwrapInput {
    /// Welded positions, in lumels.
    pub positions: Vec<Vec3>,
    /// Welded vertex indices: primitives in order, triangles in order.
    pub triangles: Vec<[u32; 3]>,
    /// Index of the primitive that each triangle belongs to. Charts never span two.
    pub primitive: Vec<u32>,
    /// `[t][k]`: the edge from corner k to corner k+1 of triangle t must be a chart border.
    pub seams: Vec<[bool; 3]>,
    /// `[t][k]`: the triangle across the edge from corner k to k+1, or `u32::MAX`. At a
    /// non-manifold edge the pairs with the smoothest continuation are neighbours.
    pub neighbors: Vec<[u32; 3]>,
}

impl UnwrapInput {
    /// Welds `mesh` after multiplying its positions by `linear`, which gives lumels (see
    /// [`crate::density::shape_of`]).
    ///
    /// Two vertices are the same if their local positions are bit-equal (−0 and 0 are equal).
    pub fn from_mesh(mesh: &Mesh, linear: DMat3) -> UnwrapInput {
        let total: usize = mesh.primitives.iter().map(|p| p.triangles.len()).sum();
        let mut input = UnwrapInput {
            triangles: Vec::with_capacity(total),
            primitive: Vec::with_capacity(total),
            ..UnwrapInput::default()
        };
        let welded = weld(mesh, linear, &mut input.positions);
        let mut normals = Vec::with_capacity(total);
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            for triangle in &primitive.triangles {
                input
                    .triangles
                    .push(triangle.map(|v| welded[number][v as usize]));
                input.primitive.push(number as u32);
                normals.push(if primitive.normals.len() == primitive.positions.len() {
                    Some(triangle.map(|v| primitive.normals[v as usize].as_dvec3()))
                } else {
                    None
                });
            }
        }
        let faces = input.face_normals();
        let creases = input.connect(&faces, &normals);
        input.part_facets(&creases, &faces);
        input
    }

    /// Area of each triangle, m².
    pub fn areas(&self) -> Vec<f64> {
        self.triangles
            .iter()
            .map(|t| 0.5 * self.cross(t).length())
            .collect()
    }

    /// Unit normal of each triangle in the scaled space; zero if it has no area.
    pub fn face_normals(&self) -> Vec<DVec3> {
        self.triangles
            .iter()
            .map(|t| self.cross(t).normalize_or_zero())
            .collect()
    }

    fn cross(&self, t: &[u32; 3]) -> DVec3 {
        let [a, b, c] = t.map(|v| self.positions[v as usize].as_dvec3());
        (b - a).cross(c - a)
    }

    /// Fills `neighbors` and `seams`. `faces` are unit face normals, `normals` the corners' shading
    /// normals. Returns the creases between facets, as edges (triangle, corner) of both sides.
    fn connect(
        &mut self,
        faces: &[DVec3],
        normals: &[Option<[DVec3; 3]>],
    ) -> Vec<[(usize, usize); 2]> {
        let mut creases = Vec::new();
        let count = self.triangles.len();
        self.neighbors = vec![[NONE; 3]; count];
        self.seams = vec![[false; 3]; count];
        let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(count * 3);
        for (t, corners) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if a != b {
                    edges.push((a.min(b), a.max(b), (t * 3 + k) as u32));
                }
            }
        }
        edges.par_sort_unstable();
        let mut pairs = Vec::new();
        for fan in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            pair_fan(fan, &self.triangles, &self.primitive, faces, &mut pairs);
            for &(e, f) in &pairs {
                let (t, k) = ((e / 3) as usize, (e % 3) as usize);
                let (u, l) = ((f / 3) as usize, (f % 3) as usize);
                self.neighbors[t][k] = u as u32;
                self.neighbors[u][l] = t as u32;
                let fold = fold(
                    faces[t],
                    faces[u],
                    normals[t].map(|n| [n[k], n[(k + 1) % 3]]),
                    normals[u].map(|n| [n[(l + 1) % 3], n[l]]),
                );
                self.seams[t][k] = fold == Fold::Seam;
                self.seams[u][l] = fold == Fold::Seam;
                if fold == Fold::Crease {
                    creases.push([(t, k), (u, l)]);
                }
            }
        }
        creases
    }

    /// Makes creases chart borders so that no two facets of [`FACET_LUMELS`] are connected across
    /// them. Smaller facets go to a neighbour across their flattest crease first.
    fn part_facets(&mut self, creases: &[[(usize, usize); 2]], faces: &[DVec3]) {
        if creases.is_empty() {
            return;
        }
        for &(t, k) in creases.iter().flatten() {
            self.seams[t][k] = true;
        }
        let (facet, count) = self.components(|t, k| !self.seams[t][k]);
        let mut areas = vec![0.0; count as usize];
        for (area, &facet) in self.areas().iter().zip(&facet) {
            areas[facet as usize] += area;
        }
        let mut groups = Groups {
            parent: (0..count).collect(),
            large: areas.iter().map(|&a| a >= FACET_LUMELS).collect(),
        };
        let mut order: Vec<u32> = (0..creases.len() as u32).collect();
        let cosine = |c: u32| {
            let [(t, _), (u, _)] = creases[c as usize];
            faces[t].dot(faces[u])
        };
        order.par_sort_unstable_by(|&a, &b| cosine(b).total_cmp(&cosine(a)).then(a.cmp(&b)));
        for &c in &order {
            let [a, b] = creases[c as usize].map(|(t, _)| facet[t]);
            groups.join(a, b);
        }
        for sides in creases {
            let [a, b] = sides.map(|(t, _)| groups.of(facet[t]));
            for &(t, k) in sides {
                self.seams[t][k] = a != b;
            }
        }
    }

    /// Numbers the sets of triangles connected across the edges that `open` admits, in order of
    /// their first triangle.
    pub fn components(&self, open: impl Fn(usize, usize) -> bool) -> (Vec<u32>, u32) {
        let mut label = vec![NONE; self.triangles.len()];
        let (mut next, mut stack) = (0, Vec::new());
        for seed in 0..label.len() {
            if label[seed] != NONE {
                continue;
            }
            label[seed] = next;
            stack.push(seed);
            while let Some(t) = stack.pop() {
                for k in 0..3 {
                    let u = self.neighbors[t][k];
                    if u != NONE && label[u as usize] == NONE && open(t, k) {
                        label[u as usize] = next;
                        stack.push(u as usize);
                    }
                }
            }
            next += 1;
        }
        (label, next)
    }
}

/// Facets that may share a chart: disjoint sets, of which two with a large facet are never joined.
struct Groups {
    /// Another facet of the same set; the set's first facet has itself.
    parent: Vec<u32>,
    /// Of a set's first facet: whether one of the set is large.
    large: Vec<bool>,
}

impl Groups {
    /// The first facet of the set that `facet` is in.
    fn of(&mut self, mut facet: u32) -> u32 {
        while self.parent[facet as usize] != facet {
            let above = self.parent[self.parent[facet as usize] as usize];
            self.parent[facet as usize] = above;
            facet = above;
        }
        facet
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.of(a), self.of(b));
        let (first, other) = (a.min(b), a.max(b));
        if first == other || (self.large[first as usize] && self.large[other as usize]) {
            return;
        }
        self.parent[other as usize] = first;
        self.large[first as usize] |= self.large[other as usize];
    }
}

/// Welds bit-equal positions over all primitives, numbered in order of appearance; returns each
/// vertex's number.
fn weld(mesh: &Mesh, linear: DMat3, positions: &mut Vec<Vec3>) -> Vec<Vec<u32>> {
    // Adding 0.0 turns −0 into 0.
    let key = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
    let total: usize = mesh.primitives.iter().map(|p| p.positions.len()).sum();
    let mut order: Vec<([u32; 3], u32)> = Vec::with_capacity(total);
    let all = mesh.primitives.iter().flat_map(|p| &p.positions);
    order.extend(all.clone().enumerate().map(|(i, &p)| (key(p), i as u32)));
    order.par_sort_unstable();
    let mut first = vec![0u32; total];
    for run in order.chunk_by(|x, y| x.0 == y.0) {
        for &(_, i) in run {
            first[i as usize] = run[0].1;
        }
    }
    let mut number = vec![NONE; total];
    for (i, &p) in all.enumerate() {
        if first[i] as usize == i {
            number[i] = positions.len() as u32;
            positions.push((linear * p.as_dvec3()).as_vec3());
        } else {
            number[i] = number[first[i] as usize];
        }
    }
    let mut rest = number.as_slice();
    mesh.primitives
        .iter()
        .map(|p| {
            let (head, tail) = rest.split_at(p.positions.len());
            rest = tail;
            head.to_vec()
        })
        .collect()
}

/// Pairs the half-edges of one edge: same primitive, opposite directions, smoothest continuation
/// first.
fn pair_fan(
    fan: &[(u32, u32, u32)],
    triangles: &[[u32; 3]],
    primitive: &[u32],
    faces: &[DVec3],
    pairs: &mut Vec<(u32, u32)>,
) {
    pairs.clear();
    let forward = |e: u32| {
        let t = triangles[(e / 3) as usize];
        t[(e % 3) as usize] < t[(e as usize % 3 + 1) % 3]
    };
    let fits = |e: u32, f: u32| {
        let (t, u) = ((e / 3) as usize, (f / 3) as usize);
        t != u && primitive[t] == primitive[u] && forward(e) != forward(f)
    };
    if let [x, y] = fan {
        if fits(x.2, y.2) {
            pairs.push((x.2, y.2));
        }
        return;
    }
    // Long fans (a thousand triangles on one edge) are left open: pairing them would be quadratic
    // and arbitrary.
    if fan.len() < 2 || fan.len() > 16 {
        return;
    }
    let mut candidates = Vec::new();
    for (i, x) in fan.iter().enumerate() {
        for y in &fan[i + 1..] {
            if fits(x.2, y.2) {
                let cos = faces[(x.2 / 3) as usize].dot(faces[(y.2 / 3) as usize]);
                candidates.push((cos, x.2, y.2));
            }
        }
    }
    candidates.sort_by(|x, y| y.0.total_cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let mut used = Vec::new();
    for (_, e, f) in candidates {
        if !used.contains(&e) && !used.contains(&f) {
            used.extend([e, f]);
            pairs.push((e, f));
        }
    }
}

/// What an edge between two faces is to charts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fold {
    /// One chart may have both.
    Smooth,
    /// A border if it parts facets.
    Crease,
    /// A border.
    Seam,
}

/// What the edge between two faces is; `n`, `m` are the shading normals at its two ends.
fn fold(face: DVec3, other: DVec3, n: Option<[DVec3; 2]>, m: Option<[DVec3; 2]>) -> Fold {
    let cosine = |degrees: f64| libm::cos(degrees.to_radians());
    let cos = face.dot(other);
    if face == DVec3::ZERO || other == DVec3::ZERO {
        return Fold::Smooth;
    }
    if cos < cosine(SHARP_DEGREES) {
        return Fold::Seam;
    }
    if cos >= cosine(FACET_DEGREES) {
        return Fold::Smooth;
    }
    let hard = match (n, m) {
        (Some(n), Some(m)) => {
            let limit = cosine(SMOOTH_NORMAL_DEGREES);
            n[0].dot(m[0]) < limit || n[1].dot(m[1]) < limit
        }
        _ => true,
    };
    match hard {
        false => Fold::Smooth,
        true if cos < cosine(CREASE_DEGREES) => Fold::Seam,
        true => Fold::Crease,
    }
}
