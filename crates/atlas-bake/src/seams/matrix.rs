//! All equations as one symmetric matrix.

use rayon::prelude::*;

use crate::seams::rows::Row;

/// A of ½ xᵀA x − bᵀx, by texel. Unknowns and A are the same for every channel.
pub(super) struct Matrix {
    /// Start of each texel's entries, plus the end of the last.
    starts: Vec<usize>,
    /// Texels of the entries, including the diagonal, in ascending order, with their values.
    entries: Vec<(u32, f32)>,
}

/// Fewest texels per thread.
pub(super) const TOGETHER: usize = 1024;

impl Matrix {
    /// Sums up the rows, the weights on single texels, and the weights between neighbours. Memory
    /// and time are linear in their number.
    pub(super) fn new(rows: &[Row], hold: &[f32], even: &[(u32, u32, f32)]) -> Self {
        let each = |found: &mut dyn FnMut(u32, u32, f32)| {
            for (i, &hold) in hold.iter().enumerate() {
                found(i as u32, i as u32, hold);
            }
            for &(i, j, weight) in even {
                found(i, i, weight);
                found(j, j, weight);
                found(i, j, -weight);
                found(j, i, -weight);
            }
            // Nearby samples read the same texels.
            for rows in rows.chunk_by(|x, y| x.texels == y.texels) {
                for (a, &i) in rows[0].texels.iter().enumerate() {
                    for (b, &j) in rows[0].texels.iter().enumerate() {
                        let product = |row: &Row| row.agree * row.weights[a] * row.weights[b];
                        let sum: f32 = rows.iter().map(product).sum();
                        if sum != 0.0 {
                            found(i, j, sum);
                        }
                    }
                }
            }
        };
        let n = hold.len();
        let mut starts = vec![0; n + 1];
        each(&mut |i, _, _| starts[i as usize + 1] += 1);
        for i in 0..n {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0.0); starts[n]];
        each(&mut |i, j, value| {
            let at = &mut next[i as usize];
            entries[*at] = (j, value);
            *at += 1;
        });
        drop(next);
        // Terms between the same two texels are summed to one entry, in the order of the equations,
        // in the memory of the terms.
        let (mut from, mut end) = (0, 0);
        for start in &mut starts[1..] {
            let to = std::mem::replace(start, 0);
            entries[from..to].sort_by_key(|e: &(u32, f32)| e.0);
            while from < to {
                let column = entries[from].0;
                let more = entries[from..to].iter().take_while(|e| e.0 == column);
                let (count, sum) = more.fold((0, 0.0), |(n, sum), e| (n + 1, sum + e.1));
                entries[end] = (column, sum);
                from += count;
                end += 1;
            }
            *start = end;
        }
        entries.truncate(end);
        entries.shrink_to_fit();
        Matrix { starts, entries }
    }

    /// The entries of a texel: the other texel and the value.
    pub(super) fn entries(&self, texel: usize) -> impl Iterator<Item = (usize, f32)> {
        let own = &self.entries[self.starts[texel]..self.starts[texel + 1]];
        own.iter().map(|&(texel, value)| (texel as usize, value))
    }

    /// 1 / Σ |a_ij| of each texel i. A gradient step of this length never overshoots, because
    /// `diag(Σ |a_ij|) − A` is diagonally dominant. 0 for texels without entries.
    pub(super) fn steps(&self) -> Vec<f32> {
        (0..self.starts.len() - 1)
            .into_par_iter()
            .with_min_len(TOGETHER)
            .map(|i| self.entries(i).map(|e| e.1.abs()).sum::<f32>().recip())
            .map(|step| if step.is_finite() { step } else { 0.0 })
            .collect()
    }
}
