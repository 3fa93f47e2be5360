//! The texels that a chart occupies, as rows of bits.

use glam::DVec2;

/// A rectangle of texels, some of which are taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Mask {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    words: usize,
    bits: Vec<u64>,
}

impl Mask {
    /// All texels free.
    pub fn new(width: u32, height: u32) -> Mask {
        let words = (width as usize).div_ceil(64).max(1);
        Mask {
            width,
            height,
            words,
            bits: vec![0; words * height as usize],
        }
    }

    /// One row with 64 texels per word, the leftmost in the lowest bit.
    pub fn row(&self, y: u32) -> &[u64] {
        &self.bits[y as usize * self.words..][..self.words]
    }

    /// Whether a texel is taken.
    #[cfg(test)]
    pub fn get(&self, x: u32, y: u32) -> bool {
        self.bits[y as usize * self.words + x as usize / 64] >> (x % 64) & 1 == 1
    }

    /// Marks the texels `from..to` of row `y` as taken.
    pub fn fill(&mut self, y: u32, from: u32, to: u32) {
        let row = &mut self.bits[y as usize * self.words..][..self.words];
        let (mut x, to) = (from as usize, to as usize);
        while x < to {
            let end = to.min((x / 64 + 1) * 64);
            let ones = u64::MAX >> (64 - (end - x));
            row[x / 64] |= ones << (x % 64);
            x = end;
        }
    }

    /// Number of texels taken.
    pub fn count(&self) -> u64 {
        self.bits.iter().map(|b| u64::from(b.count_ones())).sum()
    }

    /// Takes every texel whose centre is less than `reach` from the triangle along both axes. A
    /// reach of 0.5 gives the texels that the triangle touches, a reach of 1 those that bilinear
    /// lookups on it read. Contacts below [`SLACK`] do not count.
    pub fn cover(&mut self, c: &[DVec2; 3], reach: f64) {
        let reach = reach - SLACK;
        let low = c[0].y.min(c[1].y).min(c[2].y) - reach;
        let high = c[0].y.max(c[1].y).max(c[2].y) + reach;
        let first = (low - 0.5).ceil().max(0.0) as u32;
        for y in first..self.height {
            let middle = f64::from(y) + 0.5;
            if middle > high {
                break;
            }
            let (left, right) = clipped(c, middle - reach, middle + reach);
            let from = (left - reach - 0.5).ceil().max(0.0) as u32;
            let to = (right + reach + 0.5)
                .floor()
                .clamp(0.0, f64::from(self.width)) as u32;
            if from < to {
                self.fill(y, from, to);
            }
        }
    }

    /// The bounding box of all taken texels, and its top left corner.
    pub fn trimmed(&self) -> (Mask, [u32; 2]) {
        let rows: Vec<Vec<(u32, u32)>> = (0..self.height).map(|y| self.runs(y)).collect();
        let taken = || rows.iter().enumerate().filter(|r| !r.1.is_empty());
        let (Some((top, _)), Some((bottom, _))) = (taken().next(), taken().next_back()) else {
            return (Mask::new(0, 0), [0, 0]);
        };
        let left = taken().map(|r| r.1[0].0).min().unwrap_or(0);
        let right = taken().map(|r| r.1[r.1.len() - 1].1).max().unwrap_or(0);
        let mut out = Mask::new(right - left, (bottom - top + 1) as u32);
        for (y, runs) in rows[top..=bottom].iter().enumerate() {
            for (from, to) in runs {
                out.fill(y as u32, from - left, to - left);
            }
        }
        (out, [left, top as u32])
    }

    /// Rotated by a quarter turn, clockwise as seen with y down: (x, y) goes to (height − 1 − y,
    /// x).
    pub fn turned(&self) -> Mask {
        let mut out = Mask::new(self.height, self.width);
        for y in 0..self.height {
            for (from, to) in self.runs(y) {
                let x = self.height - 1 - y;
                for row in from..to {
                    out.fill(row, x, x + 1);
                }
            }
        }
        out
    }

    /// Blocks of `block` × `block` texels, counted from (0, 0), that contain any taken texel.
    pub fn blocks(&self, block: u32) -> Mask {
        if block <= 1 {
            return self.clone();
        }
        let mut out = Mask::new(self.width.div_ceil(block), self.height.div_ceil(block));
        for y in 0..self.height {
            for (from, to) in self.runs(y) {
                out.fill(y / block, from / block, (to - 1) / block + 1);
            }
        }
        out
    }

    /// Runs of taken texels in row `y`, from left to right.
    pub fn runs(&self, y: u32) -> Vec<(u32, u32)> {
        let row = self.row(y);
        let end = row.len() as u32 * 64;
        let next = |from: u32, taken: bool| {
            let mut x = from;
            while x < end {
                let word = row[(x / 64) as usize];
                let word = if taken { word } else { !word } >> (x % 64);
                if word != 0 {
                    return (x + word.trailing_zeros()).min(end);
                }
                x = (x / 64 + 1) * 64;
            }
            end
        };
        let mut out = Vec::new();
        let mut x = next(0, true);
        while x < end {
            let to = next(x, false);
            out.push((x, to));
            x = next(to, true);
        }
        out
    }
}

/// Contact that does not count, texels: the rounding of coordinates stored as `f32` 0..1 on a page
/// of up to 16384 texels (1e-3), and half as much again. With rounding on top, a lookup gives
/// another chart's texel a weight of at most 0.002.
pub(super) const SLACK: f64 = 1.5e-3;

/// Range of x of the part of a triangle between two heights; empty (low > high) if there is none.
fn clipped(c: &[DVec2; 3], top: f64, bottom: f64) -> (f64, f64) {
    let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut see = |x: f64| {
        left = left.min(x);
        right = right.max(x);
    };
    for k in 0..3 {
        let (a, b) = (c[k], c[(k + 1) % 3]);
        if a.y >= top && a.y <= bottom {
            see(a.x);
        }
        for y in [top, bottom] {
            if (a.y < y) != (b.y < y) {
                see(a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)));
            }
        }
    }
    (left, right)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, w: f64, h: f64) -> [[DVec2; 3]; 2] {
        let p = |i: f64, j: f64| DVec2::new(x + i * w, y + j * h);
        [
            [p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)],
            [p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)],
        ]
    }

    #[test]
    fn a_square_reads_a_ring_more_on_texel_borders_and_none_more_on_texel_middles() {
        for (at, reach, texels) in [
            (2.0, 0.5, 9),
            (2.0, 1.0, 25),
            (2.5, 0.5, 16),
            (2.5, 1.0, 16),
        ] {
            let mut mask = Mask::new(9, 9);
            for t in square(at, at, 3.0, 3.0) {
                mask.cover(&t, reach);
            }
            assert_eq!(mask.count(), texels, "at {at} within {reach}");
        }
    }

    #[test]
    fn fill_runs_turn_and_blocks_agree_texel_by_texel() {
        let mut mask = Mask::new(150, 5);
        mask.fill(1, 3, 70);
        mask.fill(1, 100, 101);
        mask.fill(4, 60, 150);
        assert_eq!(mask.runs(1), [(3, 70), (100, 101)]);
        assert_eq!(mask.runs(4), [(60, 150)]);
        assert_eq!(mask.count(), 67 + 1 + 90);
        let (turned, blocks) = (mask.turned(), mask.blocks(4));
        for y in 0..5 {
            for x in 0..150 {
                assert_eq!(turned.get(4 - y, x), mask.get(x, y));
                if mask.get(x, y) {
                    assert!(blocks.get(x / 4, y / 4));
                }
            }
        }
        assert_eq!(mask.turned().turned().turned().turned(), mask);
    }
}
