//! Triangles that share an edge, by position.

use glam::Vec3;
use rayon::prelude::*;

/// For each triangle corner `c` (the edge from `c` to the next corner), the triangles across that
/// edge, in compressed rows.
///
/// Vertices are identified by exact position, because files split vertices at normals and texture
/// seams. An edge shared by three or more triangles connects all of them.
pub(crate) struct Adjacency {
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Adjacency {
    /// O(n log n) in triangles. Only triangles with equal `key` become neighbours.
    pub(crate) fn build(triangles: &[[Vec3; 3]], key: impl Fn(usize) -> u32 + Sync) -> Self {
        let vertex = weld(triangles);
        // Edges as (low vertex, high vertex, triangle); sorting groups equal edges.
        let mut edges: Vec<(u32, u32, u32)> = (0..triangles.len() as u32)
            .into_par_iter()
            .flat_map_iter(|t| {
                let v = &vertex[3 * t as usize..3 * t as usize + 3];
                let e = |a: u32, b: u32| (a.min(b), a.max(b), t);
                [e(v[0], v[1]), e(v[1], v[2]), e(v[2], v[0])]
            })
            .collect();
        edges.par_sort_unstable();
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(edges.len());
        for run in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            // A chain instead of all pairs has the same connectivity, and keeps a fan of thousands
            // of triangles on one edge linear.
            for w in run.windows(2) {
                if key(w[0].2 as usize) == key(w[1].2 as usize) && w[0].2 != w[1].2 {
                    pairs.push((w[0].2, w[1].2));
                    pairs.push((w[1].2, w[0].2));
                }
            }
        }
        pairs.par_sort_unstable();
        let mut starts = vec![0u32; triangles.len() + 1];
        for p in &pairs {
            starts[p.0 as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        Adjacency {
            starts,
            neighbours: pairs.into_iter().map(|p| p.1).collect(),
        }
    }

    pub(crate) fn of(&self, triangle: u32) -> &[u32] {
        let t = triangle as usize;
        &self.neighbours[self.starts[t] as usize..self.starts[t + 1] as usize]
    }
}

/// A number for every corner, equal for corners with exactly the same position (−0 equals +0).
fn weld(triangles: &[[Vec3; 3]]) -> Vec<u32> {
    let mut corners: Vec<([u32; 3], u32)> = triangles
        .par_iter()
        .enumerate()
        .flat_map_iter(|(t, tri)| {
            (0..3).map(move |k| {
                let p = tri[k] + Vec3::ZERO; // −0 + 0 = +0
                (
                    [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()],
                    (3 * t + k) as u32,
                )
            })
        })
        .collect();
    corners.par_sort_unstable();
    let mut ids = vec![0u32; corners.len()];
    let mut id = 0;
    for i in 0..corners.len() {
        if i > 0 && corners[i].0 != corners[i - 1].0 {
            id += 1;
        }
        ids[corners[i].1 as usize] = id;
    }
    ids
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quad_of_two_triangles_is_connected_and_a_key_separates() {
        let (a, b, c, d) = (Vec3::ZERO, Vec3::X, Vec3::new(1., 1., 0.), Vec3::Y);
        let tris = [[a, b, c], [a, c, d]];
        let adj = Adjacency::build(&tris, |_| 0);
        assert_eq!(adj.of(0), &[1]);
        assert_eq!(adj.of(1), &[0]);
        let adj = Adjacency::build(&tris, |t| t as u32);
        assert!(adj.of(0).is_empty());
    }

    #[test]
    fn an_edge_of_many_triangles_joins_them_all_with_linear_links() {
        let n = 1000;
        let tris: Vec<_> = (0..n)
            .map(|i| {
                let a = i as f32;
                [Vec3::ZERO, Vec3::Z, Vec3::new(a.cos(), a.sin(), 0.)]
            })
            .collect();
        let adj = Adjacency::build(&tris, |_| 0);
        let links: usize = (0..n).map(|t| adj.of(t).len()).sum();
        assert_eq!(links as u32, 2 * (n - 1));
    }
}
