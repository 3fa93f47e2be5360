//! All equations as one symmetric matrix.

use rayon::prelude::*;

use crate::seams::rows::Row;

/// A of ½ xᵀA x − bᵀx, by texels. Unknowns are the same for every channel, and so is A.
pub(super) struct Matrix {
    /// Where each texel's entries begin; one more than there are texels.
    starts: Vec<usize>,
    /// Texels that entries tie it to, itself too, in ascending order.
    columns: Vec<u32>,
    values: Vec<f32>,
}

/// Texels that a thread takes at a time, at least.
pub(super) const TOGETHER: usize = 1024;

impl Matrix {
    /// Sums up rows, what holds single texels, and what ties neighbours. Memory and time are linear
    /// in their number.
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
            // Samples that lie near to each other read the same texels.
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
        // What ties the same two texels becomes one entry. The order of sums is that of the
        // equations.
        let (mut columns, mut values) = (Vec::new(), Vec::new());
        let mut from = 0;
        for i in 0..n {
            let own = &mut entries[from..starts[i + 1]];
            from = starts[i + 1];
            own.sort_by_key(|e| e.0);
            for same in own.chunk_by(|x, y| x.0 == y.0) {
                columns.push(same[0].0);
                values.push(same.iter().map(|e| e.1).sum());
            }
            starts[i + 1] = columns.len();
        }
        Matrix {
            starts,
            columns,
            values,
        }
    }

    /// What a texel's entries are: the other's number, the value.
    pub(super) fn entries(&self, texel: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = self.starts[texel]..self.starts[texel + 1];
        let columns = self.columns[range.clone()].iter().map(|&c| c as usize);
        columns.zip(self.values[range].iter().copied())
    }

    /// 1 / Σ |a_ij| of each texel i: a step so long down the slope never overshoots, since
    /// diag(Σ |a_ij|) − A is diagonally dominant. 0 where nothing is known.
    pub(super) fn steps(&self) -> Vec<f32> {
        (0..self.starts.len() - 1)
            .into_par_iter()
            .with_min_len(TOGETHER)
            .map(|i| self.entries(i).map(|e| e.1.abs()).sum::<f32>().recip())
            .map(|step| if step.is_finite() { step } else { 0.0 })
            .collect()
    }
}
