//! The geometry of cuts: triangles and lines in, triangles on either side out.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use glam::{DVec3, Vec3};

use crate::blend::Between;

/// A plane that cuts the flat piece of surface around a triangle.
pub(super) struct Line {
    pub triangle: u32,
    pub normal: DVec3,
    pub offset: f64,
    /// The ends of its line; `None` if it cuts all of the piece. Earlier lines divide the piece
    /// into cells, and a line cuts those that it enters, from border to border.
    pub ends: Option<[DVec3; 2]>,
}

/// Triangles belong to a flat piece if their normals are within 1° of the first one's.
const FLAT: f64 = 0.999_85;

/// Pieces whose bend has this cosine at least may share a chart: 45°.
const JOINED: f64 = 0.7;

/// Vertices closer to a line than this fraction of the piece's size are on it, so that no slivers
/// arise.
const ON_LINE: f64 = 1e-4;

/// The bits of a position. Vertices at the same position are the same corner, whatever their other
/// attributes.
type Place = [u32; 3];

fn place(p: [f32; 3]) -> Place {
    // Positive and negative zero are the same position.
    p.map(|x| (x + 0.0).to_bits())
}

/// An edge of an original triangle, by the places of its ends in ascending order.
type Edge = [Place; 2];

/// The length of an edge with its ends.
fn length(edge: &Edge) -> f64 {
    let [from, to] = edge.map(|p| Vec3::from(p.map(f32::from_bits)).as_dvec3());
    from.distance(to)
}

/// New vertices on original edges: how far each is from the edge's first end, and where.
#[derive(Debug, Default)]
pub(super) struct Edges {
    points: BTreeMap<Edge, Vec<(f64, [f32; 3])>>,
    /// Lines of two pieces that end this close to each other on their common edge meet there.
    /// Otherwise a sliver of the one piece would join the lit chart of the other with its shaded
    /// one.
    meet: f64,
}

impl Edges {
    /// None yet.
    pub fn new(meet: f64) -> Edges {
        Edges {
            points: BTreeMap::new(),
            meet,
        }
    }

    /// The vertex that meets one at this fraction of an edge, with its own fraction.
    fn near(&self, edge: &Edge, at: f64) -> Option<(f64, [f32; 3])> {
        let points = self.points.get(edge)?.iter().copied();
        let apart = |p: &(f64, [f32; 3])| (p.0 - at).abs();
        points
            .filter(|p| apart(p) * length(edge) < self.meet)
            .min_by(|a, b| apart(a).total_cmp(&apart(b)))
    }

    fn add(&mut self, edge: Edge, at: f64, position: [f32; 3]) {
        let points = self.points.entry(edge).or_default();
        if points.iter().all(|(_, p)| place(*p) != place(position)) {
            points.push((at, position));
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
    }
}

/// A primitive's triangles, divided.
#[derive(Debug)]
pub(super) struct Divided {
    /// Of original and new vertices.
    positions: Vec<[f32; 3]>,
    /// By vertex, the original edge that a new one is on, and how far along.
    on: Vec<Option<(Edge, f64)>>,
    /// New vertices.
    added: Vec<Between>,
    /// Triangles with the cell that each is of.
    triangles: Vec<([u32; 3], u32)>,
    /// By cell, the number of the flat piece that it is a part of.
    cells: Vec<usize>,
    original: usize,
}

impl Divided {
    /// Divides the pieces of surface that `lines` name, and enters new vertices on their edges in
    /// `edges`. O(triangles × lines of their piece).
    pub fn new(
        positions: Vec<[f32; 3]>,
        triangles: &[[u32; 3]],
        lines: &[Line],
        edges: &mut Edges,
    ) -> Divided {
        let mut out = Divided {
            on: vec![None; positions.len()],
            original: positions.len(),
            positions,
            added: Vec::new(),
            triangles: triangles.iter().map(|t| (*t, 0)).collect(),
            cells: vec![0],
        };
        if lines.is_empty() {
            return out;
        }
        // Pieces with their lines, and the piece of each triangle. On a slightly curved surface
        // pieces could overlap: a triangle belongs to the first that reaches it.
        let mut pieces: Vec<(Vec<u32>, Vec<&Line>)> = Vec::new();
        let mut piece_of: Vec<Option<usize>> = vec![None; triangles.len()];
        let neighbours = Neighbours::new(&out.positions, triangles);
        let lines = lines.iter().map(|line| (line.triangle, Some(line)));
        let others = (0..triangles.len() as u32).map(|t| (t, None));
        for (seed, line) in lines.chain(others) {
            let piece = match piece_of.get(seed as usize) {
                None => continue,
                Some(Some(known)) => *known,
                Some(None) => {
                    let free = |t: u32| piece_of[t as usize].is_none();
                    let piece = out.piece(triangles, seed, &neighbours, &free);
                    for &t in &piece {
                        piece_of[t as usize] = Some(pieces.len());
                    }
                    pieces.push((piece, Vec::new()));
                    pieces.len() - 1
                }
            };
            pieces[piece].1.extend(line);
        }
        out.triangles.clear();
        out.cells.clear();
        for (number, (piece, lines)) in pieces.iter().enumerate() {
            let known = out.positions.len();
            let (parts, cells) = out.cut(triangles, piece, lines, edges);
            for (on, position) in out.on.iter().zip(&out.positions).skip(known) {
                if let Some((edge, at)) = on {
                    edges.add(*edge, *at, *position);
                }
            }
            let first = out.cells.len() as u32;
            let parts = parts.into_iter().map(|(t, cell)| (t, first + cell));
            out.triangles.extend(parts);
            out.cells.extend(vec![number; cells as usize]);
        }
        out
    }

    /// The connected `free` triangles around `seed` that lie in its plane, ascending.
    fn piece(
        &self,
        triangles: &[[u32; 3]],
        seed: u32,
        neighbours: &Neighbours,
        free: &dyn Fn(u32) -> bool,
    ) -> Vec<u32> {
        let normal = |t: u32| self.normal(triangles[t as usize]);
        let own = normal(seed);
        let mut found = BTreeSet::from([seed]);
        let mut stack = vec![seed];
        while let Some(t) = stack.pop() {
            for m in neighbours.of(triangles[t as usize], &self.positions) {
                if free(m) && normal(m).dot(own) >= FLAT && found.insert(m) {
                    stack.push(m);
                }
            }
        }
        found.into_iter().collect()
    }

    fn at(&self, v: u32) -> DVec3 {
        Vec3::from(self.positions[v as usize]).as_dvec3()
    }

    fn normal(&self, [a, b, c]: [u32; 3]) -> DVec3 {
        let [a, b, c] = [a, b, c].map(|v| self.at(v));
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// The parts of a piece with their cells, and the number of these.
    fn cut(
        &mut self,
        triangles: &[[u32; 3]],
        piece: &[u32],
        lines: &[&Line],
        edges: &Edges,
    ) -> (Vec<([u32; 3], u32)>, u32) {
        let corners = || piece.iter().flat_map(|&t| triangles[t as usize]);
        let (low, high) = corners().fold((DVec3::MAX, DVec3::MIN), |(low, high), v| {
            (low.min(self.at(v)), high.max(self.at(v)))
        });
        let near = ON_LINE * (high - low).length();
        let up = piece
            .first()
            .map_or(DVec3::Z, |&t| self.normal(triangles[t as usize]));
        let mut parts: Vec<([u32; 3], u32)> = (piece.iter())
            .map(|&t| (triangles[t as usize], 0))
            .collect();
        let mut cells = 1;
        for line in lines {
            self.cut_along(line, (near, up), edges, &mut parts, &mut cells);
        }
        (parts, cells)
    }

    /// Divides the cells that a line enters.
    fn cut_along(
        &mut self,
        line: &Line,
        (near, up): (f64, DVec3),
        edges: &Edges,
        parts: &mut Vec<([u32; 3], u32)>,
        cells: &mut u32,
    ) {
        let length = line.normal.length();
        let height = |p: DVec3| {
            let h = (line.normal.dot(p) - line.offset) / length;
            if h.abs() <= near { 0.0 } else { h }
        };
        let heights = |d: &Divided, t: &[u32; 3]| t.map(|v| height(d.at(v)));
        let along = line.normal.cross(up);
        let range = line.ends.map(|ends| {
            let [a, b] = ends.map(|p| along.dot(p));
            // One that ends at another is not to enter the cell beyond by rounding.
            [a.min(b) + near * length, a.max(b) - near * length]
        });
        let mut entered: BTreeMap<u32, u32> = BTreeMap::new();
        for (t, cell) in parts.iter() {
            let h = heights(self, t);
            if crosses(h) && range.is_none_or(|r| self.meets(*t, h, along, r)) {
                entered.insert(*cell, 0);
            }
        }
        // What is above the line becomes a cell of its own.
        for above in entered.values_mut() {
            *above = *cells;
            *cells += 1;
        }
        let mut made = BTreeMap::new();
        let mut next = Vec::with_capacity(parts.len() + 8);
        let mut others = Vec::new();
        for (t, cell) in parts.iter() {
            match entered.get(cell) {
                Some(&above) => {
                    let h = heights(self, t);
                    self.halve(*t, h, [*cell, above], edges, &mut made, &mut next);
                }
                None => others.push((*t, *cell)),
            }
        }
        // Triangles of other cells get the new vertices on their edges too.
        let divided: BTreeSet<Edge> = (made.keys())
            .map(|ends: &[u32; 2]| self.places(*ends))
            .collect();
        while let Some((t, cell)) = others.pop() {
            let h = heights(self, &t);
            let split = (0..3).find(|&k| {
                let ends = [t[k], t[(k + 1) % 3]];
                h[k] * h[(k + 1) % 3] < 0.0 && divided.contains(&self.places(ends))
            });
            let Some(k) = split else {
                next.push((t, cell));
                continue;
            };
            let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
            let m = self.between([a, b], [h[k], h[(k + 1) % 3]], edges, &mut made);
            others.push(([m, b, c], cell));
            others.push(([a, m, c], cell));
        }
        *parts = next;
    }

    /// Divides a triangle whose corners have these heights above a line, and pushes what is below
    /// and above it with these cells.
    fn halve(
        &mut self,
        t: [u32; 3],
        h: [f64; 3],
        [below, above]: [u32; 2],
        edges: &Edges,
        made: &mut BTreeMap<[u32; 2], u32>,
        out: &mut Vec<([u32; 3], u32)>,
    ) {
        if !crosses(h) {
            let is_above = h.iter().any(|h| *h > 0.0);
            out.push((t, if is_above { above } else { below }));
            return;
        }
        // Corner `k` is alone on its side; either of the others may be on the line.
        let alone = |k: usize| {
            let [own, a, b] = [h[k], h[(k + 1) % 3], h[(k + 2) % 3]];
            own != 0.0 && own * a <= 0.0 && own * b <= 0.0
        };
        let k = (0..3).find(|&k| alone(k)).unwrap_or(0);
        let [p, a, b] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
        let [ha, hb] = [h[(k + 1) % 3], h[(k + 2) % 3]];
        let [own, other] = match h[k] > 0.0 {
            true => [above, below],
            false => [below, above],
        };
        let mut meet = |v: u32, hv: f64| match hv == 0.0 {
            true => v,
            false => self.between([p, v], [h[k], hv], edges, made),
        };
        let (m, n) = (meet(a, ha), meet(b, hb));
        out.push(([p, m, n], own));
        if m != a {
            out.push(([m, a, b], other));
        }
        if n != b {
            out.push(([m, b, n], other));
        }
    }

    /// Whether the line that a triangle's corners have these heights above meets it within a range
    /// along it.
    fn meets(&self, t: [u32; 3], h: [f64; 3], along: DVec3, range: [f64; 2]) -> bool {
        let mut least = f64::INFINITY;
        let mut most = f64::NEG_INFINITY;
        let mut add = |x: f64| (least, most) = (least.min(x), most.max(x));
        for k in 0..3 {
            let (a, b) = (k, (k + 1) % 3);
            if h[a] == 0.0 {
                add(along.dot(self.at(t[a])));
            }
            if h[a] * h[b] < 0.0 {
                let p = self.at(t[a]).lerp(self.at(t[b]), h[a] / (h[a] - h[b]));
                add(along.dot(p));
            }
        }
        most > range[0] && least < range[1]
    }

    /// A colour for each cell, other than those of its neighbours on the same piece: two if the
    /// lines go through, and hardly more than four. From piece to piece colours go on, as charts
    /// do, so that one that is not to be on both sides of a line gets no piece of the other side
    /// either.
    fn colours(&self) -> Vec<u32> {
        let mut of_edge: BTreeMap<Edge, Vec<(u32, DVec3)>> = BTreeMap::new();
        let mut beside: Vec<BTreeSet<u32>> = vec![BTreeSet::new(); self.cells.len()];
        let mut joined: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); self.cells.len()];
        for (t, cell) in &self.triangles {
            let normal = self.normal(*t);
            for edge in edges_of(*t, &self.positions) {
                let sides = of_edge.entry(edge).or_default();
                for (other, beyond) in sides.iter() {
                    let [a, b] = [*cell, *other].map(|c| c as usize);
                    if a != b && self.cells[a] == self.cells[b] {
                        beside[a].insert(*other);
                        beside[b].insert(*cell);
                    } else if a != b && normal.dot(*beyond) >= JOINED {
                        *joined[a].entry(*other).or_default() += length(&edge);
                        *joined[b].entry(*cell).or_default() += length(&edge);
                    }
                }
                sides.push((*cell, normal));
            }
        }
        const NONE: u32 = u32::MAX;
        let mut colours = vec![NONE; self.cells.len()];
        for start in 0..self.cells.len() as u32 {
            // From neighbour to neighbour, so that a chessboard gets two colours.
            let mut queue = VecDeque::from([start]);
            while let Some(cell) = queue.pop_front() {
                let cell = cell as usize;
                if colours[cell] != NONE {
                    continue;
                }
                let taken: BTreeSet<u32> = (beside[cell].iter())
                    .map(|&n| colours[n as usize])
                    .collect();
                let mut liked: BTreeMap<u32, f64> = BTreeMap::new();
                for (&n, length) in &joined[cell] {
                    *liked.entry(colours[n as usize]).or_default() += length;
                }
                let free = |c: &u32| *c != NONE && !taken.contains(c);
                let most =
                    (liked.iter().filter(|(c, _)| free(c))).max_by(|a, b| a.1.total_cmp(b.1));
                let lowest = || (0..).find(free).unwrap_or(0);
                colours[cell] = most.map_or_else(lowest, |(c, _)| *c);
                beside[cell].iter().for_each(|n| queue.push_front(*n));
                queue.extend(joined[cell].keys());
            }
        }
        colours
    }

    /// The places of two vertices, in ascending order.
    fn places(&self, ends: [u32; 2]) -> Edge {
        let mut edge = ends.map(|v| place(self.positions[v as usize]));
        edge.sort_unstable();
        edge
    }

    /// The vertex where a line crosses an edge whose ends have these heights.
    fn between(
        &mut self,
        [a, b]: [u32; 2],
        [ha, hb]: [f64; 2],
        edges: &Edges,
        made: &mut BTreeMap<[u32; 2], u32>,
    ) -> u32 {
        // The same order for all triangles, also for vertices that differ only in attributes.
        let order = |v: u32| (place(self.positions[v as usize]), v);
        let ([a, b], [ha, hb]) = match order(a) <= order(b) {
            true => ([a, b], [ha, hb]),
            false => ([b, a], [hb, ha]),
        };
        if let Some(&v) = made.get(&[a, b]) {
            return v;
        }
        let at = ha / (ha - hb);
        let (at, position) = self.met([a, b], at, edges).unwrap_or_else(|| {
            let p = self.at(a).lerp(self.at(b), at);
            (at, p.as_vec3().to_array())
        });
        let v = self.add([a, b], at, position);
        made.insert([a, b], v);
        v
    }

    /// The vertex of another piece that meets one at this fraction of an edge, with its own
    /// fraction.
    fn met(&self, [a, b]: [u32; 2], at: f64, edges: &Edges) -> Option<(f64, [f32; 3])> {
        let edge = self.edge_of([a, b])?;
        let [from, to] = [a, b].map(|v| self.along(v, &edge));
        let (own, position) = edges.near(&edge, from + at * (to - from))?;
        let at = (own - from) / (to - from);
        let ends = [a, b].map(|v| place(self.positions[v as usize]));
        (at > 0.0 && at < 1.0 && !ends.contains(&place(position))).then_some((at, position))
    }

    /// How far along an original edge a vertex on it is.
    fn along(&self, v: u32, edge: &Edge) -> f64 {
        match self.on[v as usize] {
            Some((_, at)) => at,
            None if place(self.positions[v as usize]) == edge[0] => 0.0,
            None => 1.0,
        }
    }

    fn add(&mut self, parents: [u32; 2], at: f64, position: [f32; 3]) -> u32 {
        let on = self.edge_of(parents).map(|edge| {
            let from = Vec3::from(edge[0].map(f32::from_bits)).as_dvec3();
            let along = from.distance(Vec3::from(position).as_dvec3());
            (edge, along / length(&edge).max(f64::MIN_POSITIVE))
        });
        self.on.push(on);
        self.positions.push(position);
        self.added.push(Between { parents, at });
        self.positions.len() as u32 - 1
    }

    /// The original edge that contains both vertices.
    fn edge_of(&self, ends: [u32; 2]) -> Option<Edge> {
        let place_of = |v: u32| place(self.positions[v as usize]);
        match ends.map(|v| self.on[v as usize]) {
            // Original vertices are joined by original edges only.
            [None, None] if ends.iter().all(|v| (*v as usize) < self.original) => {
                Some(self.places(ends))
            }
            [Some((e, _)), Some((f, _))] => (e == f).then_some(e),
            [Some((e, _)), None] => e.contains(&place_of(ends[1])).then_some(e),
            [None, Some((e, _))] => e.contains(&place_of(ends[0])).then_some(e),
            [None, None] => None,
        }
    }

    /// Divides triangles whose edges have vertices of neighbours on them.
    pub fn join(&mut self, edges: &Edges) {
        if edges.points.is_empty() {
            return;
        }
        let mut todo = std::mem::take(&mut self.triangles);
        todo.reverse();
        let mut made = BTreeMap::new();
        while let Some((t, cell)) = todo.pop() {
            match (0..3).find_map(|k| self.point_on([t[k], t[(k + 1) % 3]], edges, &mut made)) {
                None => self.triangles.push((t, cell)),
                Some((k, m)) => {
                    let k = t.iter().position(|v| *v == k).unwrap_or(0);
                    let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
                    todo.push(([m, b, c], cell));
                    todo.push(([a, m, c], cell));
                }
            }
        }
    }

    /// The first vertex of `edges` strictly inside this edge; returns the edge's first end with it.
    fn point_on(
        &mut self,
        [a, b]: [u32; 2],
        edges: &Edges,
        made: &mut BTreeMap<([u32; 2], Place), u32>,
    ) -> Option<(u32, u32)> {
        let edge = self.edge_of([a, b])?;
        let (from, to) = (self.along(a, &edge), self.along(b, &edge));
        let (low, high) = (from.min(to), from.max(to));
        let ends = [a, b].map(|v| place(self.positions[v as usize]));
        let inside =
            |(at, p): &&(f64, [f32; 3])| *at > low && *at < high && !ends.contains(&place(*p));
        let &(at, position) = edges.points.get(&edge)?.iter().find(inside)?;
        let key = ([a.min(b), a.max(b)], place(position));
        let v = match made.get(&key) {
            Some(&v) => v,
            None => {
                let share = (at - from) / (to - from);
                let v = self.add([a, b], share, position);
                made.insert(key, v);
                v
            }
        };
        Some((a, v))
    }

    /// Whether there is nothing to write.
    pub fn is_unchanged(&self) -> bool {
        let parted = self.cells.windows(2).any(|pair| pair[0] == pair[1]);
        self.added.is_empty() && !parted
    }

    /// New vertices, whose parents come before them.
    pub fn added(&self) -> impl Iterator<Item = Between> {
        self.added.iter().copied()
    }

    /// Positions of original and new vertices.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// The triangles of each colour.
    pub fn by_colour(&self) -> Vec<Vec<[u32; 3]>> {
        let colours = self.colours();
        let count = colours.iter().map(|c| c + 1).max().unwrap_or(0);
        let mut out = vec![Vec::new(); count as usize];
        for (t, cell) in &self.triangles {
            out[colours[*cell as usize] as usize].push(*t);
        }
        out
    }
}

/// Whether a line passes between corners with these heights above it.
fn crosses(h: [f64; 3]) -> bool {
    h.iter().any(|h| *h > 0.0) && h.iter().any(|h| *h < 0.0)
}

/// Triangles by edge.
struct Neighbours(BTreeMap<Edge, Vec<u32>>);

impl Neighbours {
    fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Neighbours {
        let mut of_edge: BTreeMap<Edge, Vec<u32>> = BTreeMap::new();
        for (t, corners) in triangles.iter().enumerate() {
            for edge in edges_of(*corners, positions) {
                of_edge.entry(edge).or_default().push(t as u32);
            }
        }
        Neighbours(of_edge)
    }

    /// Triangles that share an edge with this one, itself included.
    fn of(&self, corners: [u32; 3], positions: &[[f32; 3]]) -> impl Iterator<Item = u32> {
        edges_of(corners, positions)
            .into_iter()
            .filter_map(|edge| self.0.get(&edge))
            .flatten()
            .copied()
    }
}

fn edges_of(corners: [u32; 3], positions: &[[f32; 3]]) -> [Edge; 3] {
    [0, 1, 2].map(|k| {
        let mut edge = [corners[k], corners[(k + 1) % 3]].map(|v| place(positions[v as usize]));
        edge.sort_unstable();
        edge
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 2 × 2 m in z = 0, and a wall on its edge y = 0.
    fn square_and_wall() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let p = |x: f32, y: f32, z: f32| [x, y, z];
        let positions = vec![
            p(0.0, 0.0, 0.0),
            p(2.0, 0.0, 0.0),
            p(2.0, 2.0, 0.0),
            p(0.0, 2.0, 0.0),
            p(0.0, 0.0, 1.0),
            p(2.0, 0.0, 1.0),
        ];
        (positions, vec![[0, 1, 2], [0, 2, 3], [1, 0, 4], [1, 4, 5]])
    }

    fn line(normal: [f64; 3], offset: f64) -> Line {
        Line {
            triangle: 0,
            normal: normal.into(),
            offset,
            ends: None,
        }
    }

    fn two_colours(d: &Divided) -> [Vec<[u32; 3]>; 2] {
        d.by_colour().try_into().expect("two colours")
    }

    fn area(d: &Divided, triangles: &[[u32; 3]]) -> f64 {
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| d.at(v));
            0.5 * (b - a).cross(c - a).length()
        };
        triangles.iter().map(of).sum()
    }

    #[test]
    fn a_line_parts_the_piece_and_neighbours_get_its_ends() {
        let (positions, triangles) = square_and_wall();
        let mut edges = Edges::default();
        let lines = [line([1.0, 0.0, 0.0], 0.5)];
        let mut d = Divided::new(positions, &triangles, &lines, &mut edges);
        d.join(&edges);
        let [near, far] = two_colours(&d);
        // The wall of 2 m² stays with the first side, where x < 0.5.
        assert!((area(&d, &near) - 3.0).abs() < 1e-6, "{}", area(&d, &near));
        assert!((area(&d, &far) - 3.0).abs() < 1e-6, "{}", area(&d, &far));
        let right = far.iter().flatten().all(|v| d.at(*v).x >= 0.5);
        assert!(right, "the far side is beyond the line");
        // No edge of the wall passes the new vertex at (0.5, 0, 0).
        let end = place([0.5, 0.0, 0.0]);
        let at_the_wall = near.iter().filter(|t| t.iter().any(|v| d.at(*v).z > 0.0));
        let touches = |t: &&[u32; 3]| t.iter().any(|v| place(d.positions[*v as usize]) == end);
        assert_eq!(at_the_wall.filter(touches).count(), 2);
    }

    #[test]
    fn lines_make_a_chessboard() {
        let (positions, triangles) = square_and_wall();
        let mut edges = Edges::default();
        let lines = [line([1.0, 0.0, 0.0], 1.0), line([0.0, 2.0, 0.0], 2.0)];
        let mut d = Divided::new(positions, &triangles, &lines, &mut edges);
        d.join(&edges);
        let [_, odd] = two_colours(&d);
        assert!((area(&d, &odd) - 2.0).abs() < 1e-6);
        for t in &odd {
            let c = t.map(|v| d.at(v)).into_iter().sum::<DVec3>() / 3.0;
            assert!((c.x > 1.0) != (c.y > 1.0), "{c}");
        }
    }

    #[test]
    fn a_line_with_ends_cuts_only_the_cells_it_enters() {
        let (positions, triangles) = square_and_wall();
        let mut edges = Edges::default();
        let ended = |normal, offset, ends: [[f64; 3]; 2]| Line {
            ends: Some(ends.map(DVec3::from)),
            ..line(normal, offset)
        };
        // x = 1 from border to border; then y = 1 and y = 0.5, right and left of it.
        let lines = [
            line([1.0, 0.0, 0.0], 1.0),
            ended([0.0, 1.0, 0.0], 1.0, [[1.2, 1.0, 0.0], [1.7, 1.0, 0.0]]),
            ended([0.0, 1.0, 0.0], 0.5, [[0.8, 0.5, 0.0], [0.2, 0.5, 0.0]]),
        ];
        let mut d = Divided::new(positions, &triangles, &lines, &mut edges);
        d.join(&edges);
        let parts = d.by_colour();
        let sum: f64 = parts.iter().map(|part| area(&d, part)).sum();
        assert!((sum - 6.0).abs() < 1e-6, "{sum}");
        let mut sides: BTreeMap<Edge, Vec<(usize, [u32; 3])>> = BTreeMap::new();
        for (colour, part) in parts.iter().enumerate() {
            for t in part {
                for edge in edges_of(*t, d.positions()) {
                    sides.entry(edge).or_default().push((colour, *t));
                }
            }
        }
        let ends = |edge: &Edge| edge.map(|p| Vec3::from(p.map(f32::from_bits)));
        let is_border = |a: Vec3, b: Vec3| {
            let both = |x: f32, at: fn(Vec3) -> f32| at(a) == x && at(b) == x;
            both(0.0, |p| p.x) || both(2.0, |p| p.x) || both(2.0, |p| p.y) || both(1.0, |p| p.z)
        };
        for (edge, of) in &sides {
            let [a, b] = ends(edge);
            // No gaps: the corner where y = 1 meets x = 1 is one of the left side, too.
            assert_eq!(of.len(), 2 - usize::from(is_border(a, b)), "{a} {b}");
            let on_line = (a.x == 1.0 && b.x == 1.0 && a.z + b.z == 0.0)
                || (a.y == 1.0 && b.y == 1.0 && a.x.min(b.x) >= 1.0)
                || (a.y == 0.5 && b.y == 0.5 && a.x.max(b.x) <= 1.0);
            let flat = a.z == 0.0 && b.z == 0.0 && a.y + b.y > 0.0;
            if of.len() == 2 && flat {
                assert_eq!(of[0].0 != of[1].0, on_line, "{a} {b}");
            }
        }
    }

    #[test]
    fn pieces_of_a_curved_surface_do_not_overlap() {
        // Strips of 1 m, each bent by 0.8° from the one before: a piece is three strips wide.
        let (mut at, mut positions) = ([0.0f32, 0.0], Vec::new());
        for k in 0..9 {
            positions.extend([[at[0], 0.0, at[1]], [at[0], 2.0, at[1]]]);
            let (sin, cos) = libm::sincosf((0.8 * k as f32).to_radians());
            at = [at[0] + cos, at[1] + sin];
        }
        let strip = |k: u32| {
            [
                [2 * k, 2 * k + 2, 2 * k + 1],
                [2 * k + 1, 2 * k + 2, 2 * k + 3],
            ]
        };
        let triangles: Vec<[u32; 3]> = (0..8).flat_map(strip).collect();
        let lines: Vec<Line> = (0..16)
            .map(|triangle| Line {
                triangle,
                ..line([0.0, 1.0, 0.0], 0.5 + 0.05 * f64::from(triangle))
            })
            .collect();
        let mut edges = Edges::default();
        let mut d = Divided::new(positions, &triangles, &lines, &mut edges);
        d.join(&edges);
        let [near, far] = two_colours(&d);
        let sum = area(&d, &near) + area(&d, &far);
        // Eight strips of 2 m²; positions are f32.
        assert!((sum - 16.0).abs() < 1e-4, "{sum}");
    }

    #[test]
    fn colours_go_on_where_a_surface_bends_a_little() {
        // Strips of 1 × 2 m, each bent by 10° from the one before; x = 0.5 cuts all but the last.
        let (mut at, mut positions) = ([0.0f32, 0.0], Vec::new());
        for k in 0..5 {
            let [y, z] = at;
            positions.extend([[0.0, y, z], [2.0, y, z]]);
            let (sin, cos) = libm::sincosf((10.0 * k as f32).to_radians());
            at = [y + cos, z + sin];
        }
        let strip = |k: u32| [[2 * k, 2 * k + 1, 2 * k + 3], [2 * k, 2 * k + 3, 2 * k + 2]];
        let triangles: Vec<[u32; 3]> = (0..4).flat_map(strip).collect();
        let cut = |triangle, side: f64| Line {
            triangle,
            ..line([side, 0.0, 0.0], 0.5 * side)
        };
        // What is above a line of one strip is below that of the next.
        let lines = [cut(0, 1.0), cut(2, -1.0), cut(4, 1.0)];
        let mut edges = Edges::default();
        let mut d = Divided::new(positions, &triangles, &lines, &mut edges);
        d.join(&edges);
        for (part, right) in two_colours(&d).iter().zip([false, true]) {
            for t in part {
                let middle = t.map(|v| d.at(v)).into_iter().sum::<DVec3>() / 3.0;
                // The last strip goes with the wider parts.
                let is_last = t.iter().all(|v| d.at(*v).y > 2.9);
                assert_eq!(middle.x > 0.5 || is_last, right, "{middle}");
            }
        }
    }

    #[test]
    fn lines_of_two_pieces_meet_on_their_edge() {
        // A square in z = 0 and one that rises from its edge y = 2.
        let (mut positions, mut triangles) = square_and_wall();
        positions.truncate(4);
        positions.extend([[2.0, 4.0, 0.5], [0.0, 4.0, 0.5]]);
        triangles.truncate(2);
        triangles.extend([[3, 2, 4], [3, 4, 5]]);
        let beside = Line {
            triangle: 2,
            ..line([1.0, 0.0, 0.0], 0.501)
        };
        let lines = [line([1.0, 0.0, 0.0], 0.5), beside];
        let divided = |meet| {
            let mut edges = Edges::new(meet);
            let mut d = Divided::new(positions.clone(), &triangles, &lines, &mut edges);
            d.join(&edges);
            d
        };
        let on_the_edge = |d: &Divided| {
            let new = (d.positions.iter().skip(d.original)).filter(|p| p[1] == 2.0);
            new.map(|p| place(*p)).collect::<BTreeSet<_>>()
        };
        let d = divided(2e-3);
        for t in two_colours(&d).iter().flatten() {
            assert!(area(&d, &[*t]) > 0.1, "{t:?}");
        }
        assert_eq!(on_the_edge(&d), [place([0.5, 2.0, 0.0])].into());
        // Too far from each other to meet.
        assert_eq!(on_the_edge(&divided(5e-4)).len(), 2);
    }

    #[test]
    fn a_line_along_an_edge_or_outside_changes_nothing() {
        let (positions, triangles) = square_and_wall();
        for offset in [0.0, 1e-5, 3.0] {
            let mut edges = Edges::default();
            let lines = [line([-1.0, 0.0, 0.0], -offset)];
            let d = Divided::new(positions.clone(), &triangles, &lines, &mut edges);
            assert!(d.added.is_empty(), "{offset}");
        }
    }
}
