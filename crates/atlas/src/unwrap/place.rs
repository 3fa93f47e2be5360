//! Places masks on one page: each goes to the first position from the top where its texels are
//! free.
//!
//! All positions of a row are tested at once, 64 per word. Rows without a wide enough gap are
//! skipped, and the search for a mask starts where the last one of its size was placed. The time is
//! therefore nearly linear in the number of masks: smaller masks fill the gaps between larger ones,
//! because they start their own search at the top.

use std::collections::BTreeMap;

use super::mask::Mask;

/// A chart to place.
pub(super) struct Item {
    /// The mask in each allowed orientation, with its number of quarter turns.
    pub turns: Vec<(u8, Mask)>,
}

/// Position of a placed item.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// Left and top of its mask.
    pub at: [u32; 2],
    /// Index into [`Item::turns`].
    pub turn: usize,
}

/// Places `items` in the given order on a page of `width` columns and at most `max_height` rows,
/// with at least `gap` texels between masks. Returns the positions and the height used, or `None`
/// if something does not fit.
pub(super) fn place_all(
    items: &[Item],
    order: &[u32],
    width: u32,
    max_height: u32,
    gap: u32,
) -> Option<(Vec<Place>, u32)> {
    let mut page = Page::new(width, max_height);
    let mut places = vec![Place::default(); items.len()];
    let mut used = 0;
    for &i in order {
        let item = &items[i as usize];
        let mut best: Option<(u32, u32, usize, u32)> = None;
        for (turn, (_, mask)) in item.turns.iter().enumerate() {
            // Only positions that end higher than the best so far matter.
            let limit = best.map_or(max_height, |b| b.0 - 1);
            if let Some((x, y)) = page.find(mask, limit) {
                let found = (y + mask.height, y, turn, x);
                if best.is_none_or(|b| found < b) {
                    best = Some(found);
                }
            }
        }
        let (bottom, y, turn, x) = best?;
        let mask = &item.turns[turn].1;
        page.take(mask, x, y, gap);
        places[i as usize] = Place { at: [x, y], turn };
        used = used.max(bottom);
    }
    Some((places, used))
}

/// The page being filled.
struct Page {
    width: u32,
    max_height: u32,
    words: usize,
    /// Allocated rows; further ones are free.
    rows: Vec<u64>,
    /// Longest run of free texels of each allocated row.
    free: Vec<u32>,
    /// Row where the last mask of each size class was placed.
    start: BTreeMap<(u32, u32), u32>,
    candidates: Vec<u64>,
    shifted: Vec<u64>,
}

/// Sizes that share a starting row: exact up to 12 texels, then in steps of an eighth.
fn class(size: u32) -> u32 {
    if size <= 12 {
        return size;
    }
    let step = (size / 8).next_power_of_two().max(2) / 2;
    size / step * step
}

impl Page {
    fn new(width: u32, max_height: u32) -> Page {
        let words = (width as usize).div_ceil(64).max(1);
        Page {
            width,
            max_height,
            words,
            rows: Vec::new(),
            free: Vec::new(),
            start: BTreeMap::new(),
            candidates: vec![0; words],
            shifted: vec![0; words],
        }
    }

    fn height(&self) -> u32 {
        self.free.len() as u32
    }

    /// The first position, by rows and then columns, that ends at row `limit` or above.
    fn find(&mut self, mask: &Mask, limit: u32) -> Option<(u32, u32)> {
        if mask.width > self.width || mask.height > limit.min(self.max_height) {
            return None;
        }
        let last = limit.min(self.max_height) - mask.height;
        let key = (class(mask.width), class(mask.height));
        let from = self.start.get(&key).copied().unwrap_or(0);
        let runs: Vec<Vec<(u32, u32)>> = (0..mask.height).map(|y| mask.runs(y)).collect();
        let need: Vec<u32> = runs
            .iter()
            .map(|r| r.iter().map(|(a, b)| b - a).max().unwrap_or(0))
            .collect();
        let mut y = from;
        while y <= last {
            if y >= self.height() {
                self.start.insert(key, y);
                return Some((0, y));
            }
            // The lowest of the mask's rows without a gap gives the least distance to move.
            let blocked = (0..mask.height).rev().find(|&r| {
                self.free
                    .get((y + r) as usize)
                    .is_some_and(|&f| f < need[r as usize])
            });
            if blocked.is_none()
                && let Some(x) = self.first_column(mask, &runs, y)
            {
                self.start.insert(key, y);
                return Some((x, y));
            }
            y += 1;
        }
        self.start.insert(key, from.max(last + 1));
        None
    }

    /// First column at which the mask is free at row `y`.
    fn first_column(&mut self, mask: &Mask, runs: &[Vec<(u32, u32)>], y: u32) -> Option<u32> {
        let positions = self.width - mask.width + 1;
        self.candidates.fill(u64::MAX);
        let whole = positions as usize / 64;
        for (w, word) in self.candidates.iter_mut().enumerate() {
            if w == whole {
                *word = (1u64 << (positions % 64)) - 1;
            } else if w > whole {
                *word = 0;
            }
        }
        for (r, row_runs) in runs.iter().enumerate() {
            let row = (y as usize + r) * self.words;
            if row >= self.rows.len() {
                break;
            }
            let taken = &self.rows[row..row + self.words];
            for &(a, b) in row_runs {
                // Bit x of `shifted`: any of the texels x + a .. x + b is taken.
                shift_down(taken, a, &mut self.shifted);
                let length = b - a;
                let mut done = 1;
                while done < length {
                    let step = done.min(length - done);
                    or_shifted_down(&mut self.shifted, step);
                    done += step;
                }
                let mut any = 0;
                for (c, s) in self.candidates.iter_mut().zip(&self.shifted) {
                    *c &= !s;
                    any |= *c;
                }
                if any == 0 {
                    return None;
                }
            }
        }
        self.candidates
            .iter()
            .position(|&c| c != 0)
            .map(|w| w as u32 * 64 + self.candidates[w].trailing_zeros())
    }

    /// Takes the mask's texels and those within `gap` of them.
    fn take(&mut self, mask: &Mask, x: u32, y: u32, gap: u32) {
        let bottom = (y + mask.height + gap).min(self.max_height);
        while self.height() < bottom {
            self.rows.extend(std::iter::repeat_n(0, self.words));
            self.free.push(self.width);
        }
        for r in 0..mask.height {
            let runs = mask.runs(r);
            for row in (y + r).saturating_sub(gap)..(y + r + gap + 1).min(bottom) {
                for &(a, b) in &runs {
                    let from = (x + a).saturating_sub(gap);
                    fill(
                        &mut self.rows[row as usize * self.words..][..self.words],
                        from,
                        (x + b + gap).min(self.width),
                    );
                }
            }
        }
        for row in y.saturating_sub(gap)..bottom {
            self.free[row as usize] = self.longest_gap(row);
        }
    }

    fn longest_gap(&self, row: u32) -> u32 {
        let words = &self.rows[row as usize * self.words..][..self.words];
        let (mut longest, mut run) = (0, 0u32);
        for &word in words {
            if word == 0 {
                run += 64;
            } else {
                let mut rest = word;
                let mut at = 0;
                while rest != 0 {
                    let zeros = rest.trailing_zeros();
                    run += zeros;
                    longest = longest.max(run);
                    run = 0;
                    rest >>= zeros;
                    let ones = rest.trailing_ones();
                    at += zeros + ones;
                    rest = if ones == 64 { 0 } else { rest >> ones };
                }
                run = 64 - at;
            }
        }
        // Columns beyond the page appear free in the last word.
        let beyond = words.len() as u32 * 64 - self.width;
        longest.max(run.saturating_sub(beyond)).min(self.width)
    }
}

fn fill(row: &mut [u64], from: u32, to: u32) {
    let (mut x, to) = (from as usize, to as usize);
    while x < to {
        let end = to.min((x / 64 + 1) * 64);
        row[x / 64] |= (u64::MAX >> (64 - (end - x))) << (x % 64);
        x = end;
    }
}

/// `out` = `row` shifted by `by` texels to the left of the page (towards bit 0).
fn shift_down(row: &[u64], by: u32, out: &mut [u64]) {
    let (words, bits) = ((by / 64) as usize, by % 64);
    for (w, word) in out.iter_mut().enumerate() {
        let low = row.get(w + words).copied().unwrap_or(0);
        let high = row.get(w + words + 1).copied().unwrap_or(0);
        *word = if bits == 0 {
            low
        } else {
            low >> bits | high << (64 - bits)
        };
    }
}

/// `row` |= `row` shifted by `by` texels towards bit 0. Works in place: every word only reads
/// itself and later ones.
fn or_shifted_down(row: &mut [u64], by: u32) {
    let (words, bits) = ((by / 64) as usize, by % 64);
    for w in 0..row.len() {
        let low = row.get(w + words).copied().unwrap_or(0);
        let high = row.get(w + words + 1).copied().unwrap_or(0);
        row[w] |= if bits == 0 {
            low
        } else {
            low >> bits | high << (64 - bits)
        };
    }
}
