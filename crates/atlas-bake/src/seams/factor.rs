//! LDLᵀ of sparse symmetric matrices, four at once that differ in nothing but their diagonals.
//!
//! Texels along seams make matrices that are narrow bands, joined here and there: factors hold twelve numbers a row in Sponza, and are found as
//! quickly as a few dozen products with the matrix. Four channels share the search for where those numbers are. Plain arithmetic in an order that the
//! matrix alone decides, hence the same bits for any number of threads and on any processor; that is why this is not left to the crate that orders the rows.
//!
//! Based on: Davis, *Algorithm 849: a concise sparse Cholesky factorization package*, 2005 (rows of L by the elimination tree);
//! Amestoy, Davis, Duff, *An approximate minimum degree ordering algorithm*, 1996 (by the crate `amd`).

use glam::DVec4;

/// No row.
const NONE: u32 = u32::MAX;

/// Where a matrix has entries, and in what order its rows are eliminated.
pub(super) struct Pattern {
    /// Row of the matrix by row of the factor.
    rows: Vec<u32>,
    /// Entries before the diagonal by row of the factor: which of `entries` each row has.
    starts: Vec<usize>,
    /// Column of the factor, and number of the entry of the matrix.
    entries: Vec<(u32, u32)>,
    /// Next row of the factor that has an entry in this column.
    parent: Vec<u32>,
    /// Where columns of L begin.
    columns: Vec<usize>,
}

/// L and D of four matrices, and room to find others in.
pub(super) struct Factor {
    below: Vec<u32>,
    l: Vec<DVec4>,
    inverse_d: Vec<DVec4>,
    found: Vec<usize>,
    row: Vec<DVec4>,
}

impl Pattern {
    /// Of a matrix with `n` rows and these columns of the triangle below its diagonal: where each begins, and the rows of its entries, ascending.
    pub(super) fn new(n: usize, columns: &[usize], below: &[u32]) -> Self {
        let rows = order(n, columns, below);
        let mut places = vec![0u32; n];
        for (k, &i) in rows.iter().enumerate() {
            places[i as usize] = k as u32;
        }
        let mut starts = vec![0usize; n + 1];
        let pairs = || (0..n).flat_map(|j| (columns[j]..columns[j + 1]).map(move |e| (j, e)));
        let ends = |j: usize, e: usize| {
            let (a, b) = (places[j], places[below[e] as usize]);
            (a.min(b), a.max(b))
        };
        for (j, e) in pairs() {
            starts[ends(j, e).1 as usize + 1] += 1;
        }
        for k in 0..n {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); below.len()];
        for (j, e) in pairs() {
            let (column, row) = ends(j, e);
            entries[next[row as usize]] = (column, e as u32);
            next[row as usize] += 1;
        }
        let mut parent = vec![NONE; n];
        let mut counts = vec![0usize; n];
        let mut seen = vec![NONE; n];
        for k in 0..n {
            seen[k] = k as u32;
            for &(i, _) in &entries[starts[k]..starts[k + 1]] {
                let mut i = i as usize;
                while seen[i] != k as u32 {
                    if parent[i] == NONE {
                        parent[i] = k as u32;
                    }
                    counts[i] += 1;
                    seen[i] = k as u32;
                    i = parent[i] as usize;
                }
            }
        }
        let mut columns = vec![0; n + 1];
        for k in 0..n {
            columns[k + 1] = columns[k] + counts[k];
        }
        Pattern {
            rows,
            starts,
            entries,
            parent,
            columns,
        }
    }

    /// Room for factors.
    pub(super) fn room(&self) -> Factor {
        let n = self.rows.len();
        let entries = self.columns[n];
        Factor {
            below: vec![0; entries],
            l: vec![DVec4::ZERO; entries],
            inverse_d: vec![DVec4::ZERO; n],
            found: vec![0; n],
            row: vec![DVec4::ZERO; n],
        }
    }

    /// Factors the matrices with these entries below their diagonals, in the order of [`new`](Self::new). What rounding left without a positive
    /// pivot stays 0 in solutions.
    pub(super) fn factor(&self, below: &[f64], diagonal: &[DVec4], out: &mut Factor) {
        let n = self.rows.len();
        let mut seen = vec![NONE; n];
        let mut reached = vec![0u32; n];
        let mut path = vec![0u32; n];
        out.found.copy_from_slice(&self.columns[..n]);
        for k in 0..n {
            // Columns in which row k of L has entries: the ways from those of the matrix up the tree.
            let mut top = n;
            seen[k] = k as u32;
            for &(i, e) in &self.entries[self.starts[k]..self.starts[k + 1]] {
                out.row[i as usize] += DVec4::splat(below[e as usize]);
                let (mut i, mut length) = (i as usize, 0);
                while seen[i] != k as u32 {
                    path[length] = i as u32;
                    length += 1;
                    seen[i] = k as u32;
                    i = self.parent[i] as usize;
                }
                top -= length;
                reached[top..top + length].copy_from_slice(&path[..length]);
            }
            let mut d = diagonal[self.rows[k] as usize];
            for &i in &reached[top..] {
                let i = i as usize;
                let y = std::mem::take(&mut out.row[i]);
                let (from, to) = (self.columns[i], out.found[i]);
                for (&r, l) in out.below[from..to].iter().zip(&out.l[from..to]) {
                    out.row[r as usize] -= *l * y;
                }
                let l = y * out.inverse_d[i];
                d -= l * y;
                out.below[to] = k as u32;
                out.l[to] = l;
                out.found[i] += 1;
            }
            out.inverse_d[k] = DVec4::select(d.cmpgt(DVec4::ZERO), d.recip(), DVec4::ZERO);
        }
    }

    /// Solves for this right-hand side.
    pub(super) fn solve(&self, factor: &mut Factor, right: &[DVec4], out: &mut [DVec4]) {
        let n = self.rows.len();
        let x = &mut factor.row;
        for (x, &i) in x.iter_mut().zip(&self.rows) {
            *x = right[i as usize];
        }
        for j in 0..n {
            let y = x[j];
            let range = self.columns[j]..self.columns[j + 1];
            for (&r, l) in factor.below[range.clone()].iter().zip(&factor.l[range]) {
                x[r as usize] -= *l * y;
            }
        }
        for j in (0..n).rev() {
            let mut y = x[j] * factor.inverse_d[j];
            let range = self.columns[j]..self.columns[j + 1];
            for (&r, l) in factor.below[range.clone()].iter().zip(&factor.l[range]) {
                y -= *l * x[r as usize];
            }
            x[j] = y;
            out[self.rows[j] as usize] = y;
        }
        // The next factor begins with an empty row.
        x.fill(DVec4::ZERO);
    }
}

/// Rows in the order in which to eliminate them, so that few entries are added; as they are where there is no telling.
fn order(n: usize, columns: &[usize], below: &[u32]) -> Vec<u32> {
    // The crate wants the diagonal, too.
    let mut starts = Vec::with_capacity(n + 1);
    let mut entries = Vec::with_capacity(n + below.len());
    for j in 0..n {
        starts.push(entries.len());
        entries.push(j);
        let rows = &below[columns[j]..columns[j + 1]];
        entries.extend(rows.iter().map(|&i| i as usize));
    }
    starts.push(entries.len());
    match amd::order(n, &starts, &entries, &amd::Control::default()) {
        Ok((order, _, _)) => order.into_iter().map(|i| i as u32).collect(),
        Err(_) => (0..n as u32).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of 12 × 9 texels, each tied to its eight neighbours by weights from 1 to 1e8, and to its place by 0.01.
    #[test]
    fn what_was_solved_solves_even_where_ties_differ_a_lot() {
        let (w, h) = (12usize, 9usize);
        let n = w * h;
        let mut columns = vec![0];
        let mut below = Vec::new();
        let mut values = Vec::new();
        let mut diagonal = vec![DVec4::new(0.01, 0.1, 1.0, 1e9); n];
        let mut seed = 1u32;
        for j in 0..n {
            for (dx, dy) in [(1i32, 0i32), (-1, 1), (0, 1), (1, 1)] {
                let (x, y) = ((j % w) as i32 + dx, (j / w) as i32 + dy);
                if x < 0 || x >= w as i32 || y >= h as i32 {
                    continue;
                }
                let i = y as usize * w + x as usize;
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let tie = 10f64.powi((seed >> 24) as i32 % 9);
                below.push(i as u32);
                values.push(-tie);
                diagonal[i] += DVec4::splat(tie);
                diagonal[j] += DVec4::splat(tie);
            }
            columns.push(below.len());
        }
        let pattern = Pattern::new(n, &columns, &below);
        let mut factor = pattern.room();
        let truth: Vec<DVec4> = (0..n)
            .map(|i| DVec4::new(i as f64, 1.0, (i as f64).sin(), 0.5 * i as f64))
            .collect();
        let mut right: Vec<DVec4> = truth.iter().zip(&diagonal).map(|(x, d)| x * d).collect();
        for j in 0..n {
            for e in columns[j]..columns[j + 1] {
                let i = below[e] as usize;
                right[i] += truth[j] * values[e];
                right[j] += truth[i] * values[e];
            }
        }
        let mut found = vec![DVec4::ZERO; n];
        // Twice: what one leaves must not disturb the next.
        for _ in 0..2 {
            pattern.factor(&values, &diagonal, &mut factor);
            pattern.solve(&mut factor, &right, &mut found);
            for (found, truth) in found.iter().zip(&truth) {
                // Double precision times a condition of 1e10.
                assert!(
                    (found - truth).abs().max_element() < 1e-4,
                    "{found} {truth}"
                );
            }
        }
    }
}
