//! Splits triangles over which light is not linear.
//!
//! Longest-edge bisection (after Rivara, *Algorithms for refining triangular grids suitable for
//! adaptive and multigrid techniques*, 1984): before an edge is split, the longest edge of both its
//! triangles is split too. So there are no T-junctions, and angles stay above half of the smallest
//! original one. Edges are identified by positions, so that vertices duplicated at texture seams,
//! hard edges or primitives are split alike.

use std::collections::{HashMap, HashSet};

use glam::Vec3;
use radiosity::luminance;

use super::fit::fit;
use super::moments::{LEAST_TEXELS, Moments};
use super::sheet::{Sheet, Tri, Vertex};

/// An edge: its two places, the lower first.
type Edge = (u32, u32);

/// Triangles with a smaller visible fraction are not split for their own sake: hidden lumels count
/// 1e-3, and a single visible one of twenty is a rim that its neighbours have too.
const LEAST_SEEN: f64 = 0.05;

/// Most rounds of splitting. Each halves triangles, so this many reduce any triangle to a lumel's
/// size (2²⁴ lumels are a page of 4096²).
const MOST_ROUNDS: usize = 24;

/// Criteria for splitting.
#[derive(Debug, Clone, Copy)]
pub(super) struct SplitOptions {
    /// Root mean square error over a triangle, relative to its mean light.
    pub error: f64,
    /// 1 % of the scene's mean luminance, so that errors in the dark count less.
    pub floor: f64,
    /// Most added vertices of one instance.
    pub most: usize,
}

/// Result of a round of splitting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Round {
    /// No triangle exceeds the error.
    Done,
    /// Some were split; their moments must be computed ([`Tri::moments`] is empty).
    Split,
    /// Some exceed the error, but the maximum number of vertices is reached.
    Full,
}

/// Splits triangles and fits `values` to the parts, until they are accurate, too small to be split,
/// or too many; returns whether they are too many. `measure` computes the moments of parts.
pub(super) fn refine(
    sheet: &mut Sheet,
    values: &mut Vec<Vec3>,
    gathered: &mut Vec<Vec3>,
    options: &SplitOptions,
    measure: impl Fn(&mut Sheet),
) -> bool {
    for _ in 0..MOST_ROUNDS {
        match split(sheet, values, gathered, options) {
            Round::Done => break,
            Round::Full => return true,
            Round::Split => {}
        }
        measure(sheet);
        *values = fit(sheet, gathered);
    }
    false
}

/// Splits the triangles for which interpolating `values` is too inaccurate. `values` and `gathered`
/// get entries for new points.
fn split(
    sheet: &mut Sheet,
    values: &mut Vec<Vec3>,
    gathered: &mut Vec<Vec3>,
    options: &SplitOptions,
) -> Round {
    let mut bad: Vec<(f64, u32)> = (sheet.tris.iter().enumerate())
        .filter_map(|(t, tri)| Some((error(sheet, tri, values, options)?, t as u32)))
        .filter(|(error, _)| *error > options.error)
        .collect();
    if bad.is_empty() {
        return Round::Done;
    }
    // The worst first, in case not all fit.
    bad.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let room = options.most.saturating_sub(sheet.parents.len());
    let edges = mark(sheet, &bad, room);
    if edges.is_empty() {
        return Round::Full;
    }
    let mut cutter = Cutter {
        edges: &edges,
        vertices: HashMap::new(),
        places: HashMap::new(),
        points: HashMap::new(),
        sheet,
        values,
        gathered,
    };
    cutter.cut_all();
    Round::Split
}

/// Relative error of a triangle; `None` if it cannot be split further.
fn error(sheet: &Sheet, tri: &Tri, values: &[Vec3], options: &SplitOptions) -> Option<f64> {
    let m = &tri.moments;
    // The accuracy inside a wall does not matter.
    let seen = m.weight > LEAST_SEEN * tri.area;
    if !m.measured() || !seen || tri.texels() < 2.0 * LEAST_TEXELS {
        return None;
    }
    let corners = (sheet.points_of(tri)).map(|p| f64::from(luminance(values[p])));
    // The part explained by the lumels' own noise is not an error.
    let square = (m.residual(corners) - m.noise).max(0.0) / m.weight;
    Some(square.sqrt() / (m.mean() + options.floor).max(f64::MIN_POSITIVE))
}

/// The longest edge of a triangle, by length and then by place, so that both triangles of an edge
/// decide alike.
fn longest(sheet: &Sheet, tri: &Tri) -> usize {
    let edges = edges_of(sheet, tri);
    let length = |(a, b): Edge| {
        let [a, b] = [a, b].map(|p| sheet.places[p as usize].as_dvec3());
        a.distance_squared(b)
    };
    let longer = |a: usize, b: usize| {
        length(edges[b])
            .total_cmp(&length(edges[a]))
            .then(edges[b].cmp(&edges[a]))
            .is_gt()
    };
    let mut best = 0;
    for k in 1..3 {
        if longer(best, k) {
            best = k;
        }
    }
    best
}

/// Edge k is opposite corner k: between corners k + 1 and k + 2.
fn edges_of(sheet: &Sheet, tri: &Tri) -> [Edge; 3] {
    let place = |k: usize| sheet.vertices[tri.corners[k % 3] as usize].place;
    [0, 1, 2].map(|k| {
        let (a, b) = (place(k + 1), place(k + 2));
        (a.min(b), a.max(b))
    })
}

/// The edges to split: the longest of each triangle in `bad` and those that must be split with it,
/// while there is `room` for their vertices. One of each triangle at an edge is reckoned with: hard
/// and textured edges need two, and any number of triangles may share an edge.
fn mark(sheet: &Sheet, bad: &[(f64, u32)], room: usize) -> HashSet<Edge> {
    let mut at: Vec<(Edge, u32)> = (sheet.tris.iter().enumerate())
        .flat_map(|(t, tri)| edges_of(sheet, tri).map(|e| (e, t as u32)))
        .collect();
    at.sort_unstable();
    let mut marked: HashSet<Edge> = HashSet::new();
    let mut queue: Vec<u32> = Vec::new();
    let mut chain: Vec<Edge> = Vec::new();
    let mut vertices = 0;
    for &(_, t) in bad {
        if vertices >= room {
            break;
        }
        queue.push(t);
        chain.clear();
        let mut first = true;
        while let Some(t) = queue.pop() {
            let tri = &sheet.tris[t as usize];
            let edges = edges_of(sheet, tri);
            let edge = edges[longest(sheet, tri)];
            let wanted = std::mem::take(&mut first) || edges.iter().any(|e| marked.contains(e));
            if wanted && marked.insert(edge) {
                let start = at.partition_point(|a| a.0 < edge);
                let users = at[start..].iter().take_while(|a| a.0 == edge);
                let before = queue.len();
                queue.extend(users.map(|a| a.1));
                vertices += queue.len() - before;
                chain.push(edge);
            }
        }
        if vertices > room {
            // Half a chain would leave T-junctions.
            for edge in &chain {
                marked.remove(edge);
            }
            break;
        }
    }
    marked
}

struct Cutter<'s> {
    edges: &'s HashSet<Edge>,
    /// New vertices by the two vertices whose midpoint they are.
    vertices: HashMap<[u32; 2], u32>,
    places: HashMap<[u32; 2], u32>,
    points: HashMap<[u32; 2], u32>,
    sheet: &'s mut Sheet,
    values: &'s mut Vec<Vec3>,
    gathered: &'s mut Vec<Vec3>,
}

impl Cutter<'_> {
    fn cut_all(&mut self) {
        let tris = std::mem::take(&mut self.sheet.tris);
        let mut out = Vec::with_capacity(tris.len() + 2 * self.edges.len());
        for tri in tris {
            self.cut(&tri, &mut out);
        }
        self.sheet.tris = out;
    }

    fn cut(&mut self, tri: &Tri, out: &mut Vec<Tri>) {
        let edges = edges_of(self.sheet, tri).map(|e| self.edges.contains(&e));
        if edges == [false; 3] {
            out.push(*tri);
            return;
        }
        // Rotated so that the longest edge is opposite corner 0.
        let k = longest(self.sheet, tri);
        let turned = Tri {
            corners: [0, 1, 2].map(|i| tri.corners[(k + i) % 3]),
            page: [0, 1, 2].map(|i| tri.page[(k + i) % 3]),
            ..*tri
        };
        let middle = self.middle(turned.corners[1], turned.corners[2]);
        // Two halves that share the line from corner 0 to the midpoint; each has one more edge that
        // may be split.
        let on_page = (turned.page[1] + turned.page[2]) * 0.5;
        let half = |replaced: usize| {
            let mut part = Tri {
                area: 0.5 * turned.area,
                moments: Moments::default(),
                ..turned
            };
            part.corners[replaced] = middle;
            part.page[replaced] = on_page;
            part
        };
        let (first, second) = (half(2), half(1));
        // In the first half the midpoint is corner 2, opposite the outer edge 0–1; in the second it
        // is corner 1.
        for (part, opposite, cut) in [
            (first, 2, edges[(k + 2) % 3]),
            (second, 1, edges[(k + 1) % 3]),
        ] {
            if !cut {
                out.push(part);
                continue;
            }
            let (i, j) = ((opposite + 1) % 3, (opposite + 2) % 3);
            let m = self.middle(part.corners[i], part.corners[j]);
            let page = (part.page[i] + part.page[j]) * 0.5;
            for keep in [i, j] {
                let mut piece = part;
                let moved = if keep == i { j } else { i };
                piece.corners[moved] = m;
                piece.page[moved] = page;
                piece.area *= 0.5;
                out.push(piece);
            }
        }
    }

    /// The vertex at the midpoint of two vertices of one primitive.
    fn middle(&mut self, a: u32, b: u32) -> u32 {
        let pair = [a.min(b), a.max(b)];
        if let Some(&v) = self.vertices.get(&pair) {
            return v;
        }
        let [p, q] = pair.map(|v| self.sheet.vertices[v as usize]);
        let sorted = |a: u32, b: u32| [a.min(b), a.max(b)];
        let sheet = &mut *self.sheet;
        let place = *(self.places.entry(sorted(p.place, q.place))).or_insert_with(|| {
            let [a, b] = [p.place, q.place].map(|i| sheet.places[i as usize]);
            sheet.places.push((a + b) * 0.5);
            sheet.places.len() as u32 - 1
        });
        let point = *(self.points.entry(sorted(p.point, q.point))).or_insert_with(|| {
            for list in [&mut *self.values, &mut *self.gathered] {
                let [a, b] = [p.point, q.point].map(|i| list[i as usize]);
                list.push((a + b) * 0.5);
            }
            sheet.points += 1;
            sheet.points as u32 - 1
        });
        let count = &mut sheet.counts[p.primitive as usize];
        let v = sheet.vertices.len() as u32;
        sheet.vertices.push(Vertex {
            primitive: p.primitive,
            index: *count,
            place,
            point,
        });
        *count += 1;
        sheet.parents.push(pair);
        self.vertices.insert(pair, v);
        v
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use glam::{DVec2, DVec3};

    use super::*;

    /// Light with which no interpolation agrees.
    fn noisy(area: f64) -> Moments {
        Moments {
            weight: area,
            light: [DVec3::splat(area / 3.0); 3],
            mass: [2.0, 1.0, 1.0, 2.0, 1.0, 2.0].map(|m| m * area / 12.0),
            square: 100.0 * area,
            noise: 0.0,
            range: [Vec3::ONE; 2],
        }
    }

    /// Triangles with vertices of their own at `places`, with all the texels that they want.
    fn sheet(places: Vec<Vec3>, triangles: &[[u32; 3]]) -> Sheet {
        let corners = triangles.iter().flatten();
        let vertices: Vec<Vertex> = (corners.zip(0u32..))
            .map(|(&place, index)| Vertex {
                primitive: 0,
                index,
                place,
                point: place,
            })
            .collect();
        let tris = (triangles.iter().zip(0u32..)).map(|(at, face)| {
            let p = at.map(|p| places[p as usize].as_dvec3());
            let area = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).length();
            Tri {
                face,
                corners: [0, 1, 2].map(|k| 3 * face + k),
                page: [DVec2::ZERO, DVec2::X * 1e6, DVec2::Y * 1e6],
                area,
                moments: noisy(area),
            }
        });
        Sheet {
            instance: 0,
            tris: tris.collect(),
            parents: Vec::new(),
            counts: vec![vertices.len() as u32],
            points: places.len(),
            vertices,
            places,
        }
    }

    /// Refines until a limit, and returns whether it is the one of vertices, and the rounds.
    fn refined(
        sheet: &mut Sheet,
        most: usize,
        accurate: impl Fn(&Sheet, &Tri) -> bool,
    ) -> (bool, u32) {
        let mut values = vec![Vec3::ONE; sheet.points];
        let mut gathered = values.clone();
        let rounds = Cell::new(0);
        let options = SplitOptions {
            error: 1e-6,
            floor: 0.0,
            most,
        };
        let full = refine(sheet, &mut values, &mut gathered, &options, |sheet| {
            rounds.set(rounds.get() + 1);
            for t in 0..sheet.tris.len() {
                let tri = sheet.tris[t];
                let accurate = accurate(sheet, &tri);
                sheet.tris[t].moments = Moments {
                    square: if accurate { 0.0 } else { 100.0 * tri.area },
                    ..noisy(tri.area)
                };
            }
        });
        (full, rounds.get())
    }

    /// No place lies within an edge of a triangle, where a crack would show.
    fn has_no_t_junctions(sheet: &Sheet) -> bool {
        let used = (sheet.tris.iter())
            .flat_map(|tri| edges_of(sheet, tri))
            .collect::<HashSet<Edge>>();
        (sheet.parents.iter()).all(|pair| {
            let [a, b] = pair.map(|v| sheet.vertices[v as usize].place);
            !used.contains(&(a.min(b), a.max(b)))
        })
    }

    /// A square of `n` × `n` cells of two triangles, all of which have longest edges of one length.
    fn grid(n: u32) -> Sheet {
        let place = |k: u32| Vec3::new((k % (n + 1)) as f32, (k / (n + 1)) as f32, 0.0);
        let triangles: Vec<[u32; 3]> = (0..n * n)
            .flat_map(|k| {
                let a = k / n * (n + 1) + k % n;
                [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
            })
            .collect();
        sheet((0..(n + 1) * (n + 1)).map(place).collect(), &triangles)
    }

    #[test]
    fn an_error_out_of_reach_ends_with_the_most_vertices() {
        for most in [1_000, 20_000] {
            let mut sheet = grid(20);
            let (full, rounds) = refined(&mut sheet, most, |_, _| false);
            assert!(full && rounds <= 24, "{rounds}");
            let added = sheet.parents.len();
            assert!((9 * most / 10..=most).contains(&added), "{added} of {most}");
            assert!(has_no_t_junctions(&sheet));
        }
    }

    #[test]
    fn an_edge_of_many_triangles_does_not_exceed_the_limit() {
        // Each triangle adds a vertex of its own at the middle of one edge.
        let mut places = vec![Vec3::ZERO, Vec3::X * 4.0];
        places.extend((0..3000).map(|k| Vec3::new(2.0, 1.0, k as f32 * 1e-4)));
        let fan: Vec<[u32; 3]> = (2..3002).map(|apex| [0, 1, apex]).collect();
        let mut sheet = sheet(places, &fan);
        assert!(refined(&mut sheet, 1000, |_, _| false).0);
        assert!(sheet.parents.len() <= 1000, "{}", sheet.parents.len());
        let (full, rounds) = refined(&mut sheet, 5000, |_, _| false);
        assert!(full && rounds <= 24);
        assert!((3000..=5000).contains(&sheet.parents.len()));
        assert!(has_no_t_junctions(&sheet));
    }

    #[test]
    fn a_spike_that_stays_ends_after_its_rounds() {
        let mut sheet = grid(1);
        let (full, rounds) = refined(&mut sheet, 200_000, |sheet, tri| {
            tri.corners
                .iter()
                .all(|&v| sheet.vertices[v as usize].place != 0)
        });
        assert!(!full);
        assert_eq!(rounds as usize, MOST_ROUNDS);
        assert!(
            sheet.parents.len() < 10 * MOST_ROUNDS,
            "{}",
            sheet.parents.len()
        );
    }
}
