//! What hangs together through seams is solved together, everything else by itself.
//!
//! An island is a set of texels that no equation ties to others: as a rule some charts with all their neighbours across seams. Islands are solved in
//! parallel. One with very many texels is cut into blocks that are solved one after the other, each against what those before it have become.

use std::ops::Range;

use glam::{DVec4, Vec4};
use rayon::prelude::*;

use crate::seams::factor::Pattern;
use crate::seams::interior::{Matrix, Wanted, least};
use crate::seams::rows::Row;

/// Texels that are solved at once, at most. Factors hold 12 to 20 numbers of four channels for each, 55 if a million of them are a solid field of seams; with
/// what else the search keeps that is 1 to 2.5 kB for each, or 0.6 to 1.3 GB. The largest island of the scenes measured has 21,000.
pub(super) const MOST_TOGETHER: usize = 1 << 19;

/// Times that the blocks of one island are solved, each against what the others have become.
const SWEEPS: usize = 2;

/// Equations of all texels.
pub(super) struct Equations<'a> {
    pub rows: &'a [Row],
    /// What keeping a texel as it is counts.
    pub hold: &'a [f32],
    /// Neighbours, and what it counts that they change alike.
    pub even: &'a [(u32, u32, f32)],
    /// Whether a texel must not change. What only such ones tie together is not.
    pub still: &'a [bool],
}

/// No block: that of what must not change.
const NONE: u32 = u32::MAX;

/// A part of the texels with the equations that they take part in.
struct Block {
    texels: Vec<u32>,
    rows: Vec<u32>,
    /// Ties to texels of other blocks: own place in the block, the other's number, what it counts.
    ties: Vec<(u32, u32, f32)>,
    matrix: Matrix,
}

/// All texels by blocks.
pub(super) struct Islands<'a> {
    of: Equations<'a>,
    blocks: Vec<Block>,
    /// Which blocks are one island's.
    islands: Vec<Range<usize>>,
    /// Block of each texel and its place therein.
    places: Vec<(u32, u32)>,
}

impl<'a> Islands<'a> {
    /// Sorts the equations; at most `most` texels to a block.
    pub(super) fn new(of: Equations<'a>, most: usize) -> Self {
        let n = of.hold.len();
        let mut places = vec![(NONE, 0); n];
        let mut lists: Vec<Vec<u32>> = Vec::new();
        let mut islands = Vec::new();
        for island in of.islands(most) {
            let first = lists.len();
            for texels in island.chunks(most) {
                for (k, &t) in texels.iter().enumerate() {
                    places[t as usize] = (lists.len() as u32, k as u32);
                }
                lists.push(texels.to_vec());
            }
            islands.push(first..lists.len());
        }
        let mut rows = vec![Vec::new(); lists.len()];
        for (r, row) in of
            .rows
            .iter()
            .enumerate()
            .filter(|(_, row)| row.agree > 0.0)
        {
            let mut of_row: Vec<u32> = row.terms().map(|(t, _)| places[t].0).collect();
            of_row.retain(|&block| block != NONE);
            of_row.sort_unstable();
            of_row.dedup();
            for block in of_row {
                rows[block as usize].push(r as u32);
            }
        }
        let mut even = vec![Vec::new(); lists.len()];
        for &(i, j, weight) in of.even {
            let (a, b) = (places[i as usize].0, places[j as usize].0);
            if a != NONE {
                even[a as usize].push((i, j, weight));
            }
            if b != NONE && a != b {
                even[b as usize].push((j, i, weight));
            }
        }
        let parts: Vec<_> = lists.into_iter().zip(rows).zip(even).collect();
        let blocks = (parts.into_par_iter())
            .map(|((texels, rows), even)| Block::new(&of, &places, texels, rows, even))
            .collect();
        Islands {
            of,
            blocks,
            islands,
            places,
        }
    }

    /// Changes of four channels with these values, between bounds, that make the sum least; and the steps that the slowest block took.
    pub(super) fn solve(&self, values: &[Vec4], bounds: &[Vec<Vec4>; 2]) -> (Vec<Vec4>, u64) {
        let solved: Vec<(Vec<DVec4>, u64)> = (self.islands.par_iter())
            .flat_map_iter(|blocks| {
                let own = &self.blocks[blocks.clone()];
                let mut done: Vec<(Vec<DVec4>, u64)> = vec![Default::default(); own.len()];
                let sweeps = if own.len() > 1 { SWEEPS } else { 1 };
                for (k, block) in (0..sweeps).flat_map(|_| own.iter().enumerate()) {
                    let changed = |t: usize| {
                        let (b, k) = self.places[t];
                        if b == NONE {
                            return DVec4::ZERO;
                        }
                        let of = &done[b as usize - blocks.start].0;
                        of.get(k as usize).copied().unwrap_or_default()
                    };
                    let wanted = block.wanted(self, values, bounds, &changed);
                    done[k] = least(&block.matrix, &wanted);
                }
                done
            })
            .collect();
        let most = solved.iter().map(|s| s.1).max().unwrap_or(0);
        let mut change = vec![Vec4::ZERO; values.len()];
        for (block, (of, _)) in self.blocks.iter().zip(&solved) {
            for (&t, c) in block.texels.iter().zip(of) {
                change[t as usize] = c.as_vec4();
            }
        }
        (change, most)
    }
}

impl Equations<'_> {
    /// Texels that hang together, in the order of their least numbers. Those with more than `most` in an order in which what lies near is near.
    fn islands(&self, most: usize) -> Vec<Vec<u32>> {
        let n = self.hold.len();
        let mut root: Vec<u32> = (0..n as u32).collect();
        for (i, j) in self.links() {
            let (i, j) = (find(&mut root, i), find(&mut root, j));
            root[i.max(j) as usize] = i.min(j);
        }
        let mut islands: Vec<Vec<u32>> = Vec::new();
        let mut number = vec![u32::MAX; n];
        for t in (0..n as u32).filter(|&t| !self.still[t as usize]) {
            let r = find(&mut root, t) as usize;
            if number[r] == u32::MAX {
                number[r] = islands.len() as u32;
                islands.push(Vec::new());
            }
            islands[number[r] as usize].push(t);
        }
        if islands.iter().any(|texels| texels.len() > most) {
            let near = self.near();
            for texels in islands.iter_mut().filter(|texels| texels.len() > most) {
                // By steps from the first, and once more from the last, which lies at an end.
                for _ in 0..2 {
                    let last = *texels.last().expect("more than none");
                    *texels = by_steps(&near, last);
                }
            }
        }
        islands
    }

    /// Pairs of texels that equations tie together, not all of them: enough to get from any to any other.
    fn links(&self) -> impl Iterator<Item = (u32, u32)> {
        let rows = self.rows.iter().filter(|row| row.agree > 0.0);
        let rows = rows.flat_map(|row| {
            let terms = || row.terms().filter(|(t, _)| !self.still[*t]);
            let terms = || terms().map(|(t, _)| t as u32);
            terms().zip(terms().skip(1))
        });
        let even = self.even.iter().map(|&(i, j, _)| (i, j));
        let moves = |t: u32| !self.still[t as usize];
        even.filter(move |&(i, j)| moves(i) && moves(j)).chain(rows)
    }

    /// Ends of links by texel: where each texel's begin, and the others.
    fn near(&self) -> (Vec<usize>, Vec<u32>) {
        let n = self.hold.len();
        let mut starts = vec![0usize; n + 1];
        for (i, j) in self.links() {
            starts[i as usize + 1] += 1;
            starts[j as usize + 1] += 1;
        }
        for t in 0..n {
            starts[t + 1] += starts[t];
        }
        let mut next = starts.clone();
        let mut others = vec![0; starts[n]];
        for (i, j) in self.links() {
            for (i, j) in [(i, j), (j, i)] {
                others[next[i as usize]] = j;
                next[i as usize] += 1;
            }
        }
        (starts, others)
    }
}

/// What can be reached from a texel, nearest first.
fn by_steps((starts, others): &(Vec<usize>, Vec<u32>), first: u32) -> Vec<u32> {
    let mut seen = vec![false; starts.len() - 1];
    let mut list = vec![first];
    seen[first as usize] = true;
    let mut k = 0;
    while let Some(&t) = list.get(k) {
        for &other in &others[starts[t as usize]..starts[t as usize + 1]] {
            if !std::mem::replace(&mut seen[other as usize], true) {
                list.push(other);
            }
        }
        k += 1;
    }
    list
}

/// The least number of the set that a texel is in.
fn find(root: &mut [u32], mut t: u32) -> u32 {
    while root[t as usize] != t {
        let next = root[root[t as usize] as usize];
        root[t as usize] = next;
        t = next;
    }
    t
}

impl Block {
    fn new(
        of: &Equations<'_>,
        places: &[(u32, u32)],
        texels: Vec<u32>,
        rows: Vec<u32>,
        even: Vec<(u32, u32, f32)>,
    ) -> Self {
        let n = texels.len();
        let own = texels.first().map_or(0, |&t| places[t as usize].0);
        let local = |t: usize| Some(places[t].1).filter(|_| places[t].0 == own);
        let mut diagonal: Vec<f64> = texels
            .iter()
            .map(|&t| f64::from(of.hold[t as usize]))
            .collect();
        let mut entries: Vec<(u32, u32, f64)> = Vec::new();
        let mut ties = Vec::new();
        for (i, j, weight) in even {
            let (Some(a), b) = (local(i as usize), local(j as usize)) else {
                continue;
            };
            diagonal[a as usize] += f64::from(weight);
            match b {
                Some(b) => {
                    diagonal[b as usize] += f64::from(weight);
                    entries.push((a.min(b), a.max(b), -f64::from(weight)));
                }
                None => ties.push((a, j, weight)),
            }
        }
        // Samples that lie near to each other read the same texels.
        let alike = |x: &u32, y: &u32| of.rows[*x as usize].texels == of.rows[*y as usize].texels;
        for rows in rows.chunk_by(alike) {
            let mut products = [[0f64; 8]; 8];
            for &r in rows {
                let row = &of.rows[r as usize];
                let weights = row.weights.map(f64::from);
                for a in 0..8 {
                    for b in a..8 {
                        products[a][b] += f64::from(row.agree) * weights[a] * weights[b];
                    }
                }
            }
            let texels = of.rows[rows[0] as usize].texels.map(|t| local(t as usize));
            for a in 0..8 {
                for b in a..8 {
                    let (Some(i), Some(j)) = (texels[a], texels[b]) else {
                        continue;
                    };
                    let product = products[a][b];
                    if i != j && product != 0.0 {
                        entries.push((i.min(j), i.max(j), product));
                    } else if i == j {
                        // Two of its terms may read one texel.
                        diagonal[i as usize] += if a == b { product } else { 2.0 * product };
                    }
                }
            }
        }
        let (columns, below, values) = by_columns(n, &entries);
        let pattern = Pattern::new(n, &columns, &below);
        let matrix = Matrix {
            columns,
            below,
            values,
            diagonal,
            pattern,
        };
        Block {
            texels,
            rows,
            ties,
            matrix,
        }
    }

    /// What these channels want of the block, where others have `changed`.
    fn wanted(
        &self,
        islands: &Islands<'_>,
        values: &[Vec4],
        [low, high]: &[Vec<Vec4>; 2],
        changed: &dyn Fn(usize) -> DVec4,
    ) -> Wanted {
        let mut right = vec![DVec4::ZERO; self.texels.len()];
        let own = self
            .texels
            .first()
            .map_or(0, |&t| islands.places[t as usize].0);
        let mut energy = DVec4::ZERO;
        for &r in &self.rows {
            let row = &islands.of.rows[r as usize];
            let mut difference = DVec4::ZERO;
            for (t, w) in row.terms() {
                let value = values[t].as_dvec4();
                let value = match islands.places[t].0 == own {
                    true => value,
                    false => value + changed(t),
                };
                difference += value * f64::from(w);
            }
            let pull = difference * f64::from(row.agree);
            energy += pull * difference;
            for (t, w) in row.terms() {
                let (block, k) = islands.places[t];
                if block == own {
                    right[k as usize] -= pull * f64::from(w);
                }
            }
        }
        for &(k, other, weight) in &self.ties {
            let by = changed(other as usize);
            right[k as usize] += by * f64::from(weight);
            energy += by * by * f64::from(weight);
        }
        let of = |list: &[Vec4]| -> Vec<DVec4> {
            (self.texels.iter())
                .map(|&t| list[t as usize].as_dvec4())
                .collect()
        };
        Wanted {
            right,
            energy,
            low: of(low),
            high: of(high),
        }
    }
}

/// Entries (column, row below, value) by columns: where each begins, rows in ascending order, and the sums of what lies in the same place.
fn by_columns(n: usize, entries: &[(u32, u32, f64)]) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
    let mut starts = vec![0usize; n + 1];
    for &(j, _, _) in entries {
        starts[j as usize + 1] += 1;
    }
    for j in 0..n {
        starts[j + 1] += starts[j];
    }
    let mut next = starts.clone();
    let mut sorted = vec![(0u32, 0f64); entries.len()];
    for &(j, i, value) in entries {
        sorted[next[j as usize]] = (i, value);
        next[j as usize] += 1;
    }
    let mut columns = vec![0];
    let (mut below, mut values) = (Vec::new(), Vec::new());
    for j in 0..n {
        let column = &mut sorted[starts[j]..starts[j + 1]];
        // Stable: sums in the order of the equations.
        column.sort_by_key(|e| e.0);
        for same in column.chunk_by(|x, y| x.0 == y.0) {
            below.push(same[0].0);
            values.push(same.iter().map(|e| e.1).sum());
        }
        columns.push(below.len());
    }
    (columns, below, values)
}
