//! The lumels around one that are on the same piece of surface.

use crate::map::LumelMap;
use crate::received::Received;

/// Texels on each side of a lumel in the window: 48 neighbours for a fit of six unknowns, which
/// leaves about a tenth of the variance, a third of the noise.
pub(crate) const REACH: i64 = 3;

/// The same of the wide window, where light is interpolated or the surface is narrow.
pub(crate) const WIDE: i64 = 2 * REACH;

/// Width of the wide window in lumels.
const ACROSS: usize = (2 * WIDE + 1) as usize;

/// A surface is narrow if the small window has fewer lumels than this, half of all: a frame or the
/// front of a step, one to three lumels wide.
const NARROW: usize = SIDE * SIDE / 2;

/// Least cosine between the normals of two lumels, which otherwise see too different hemispheres.
/// About 30°: along a curve light changes steadily, which the fit follows, and pillars are only a
/// few lumels around.
pub(crate) const SAME_FACING: f32 = 0.85;

/// Width of a window in lumels.
pub(crate) const SIDE: usize = (2 * REACH + 1) as usize;

/// A neighbour and its offset in texels.
pub(crate) type Neighbour = (usize, i64, i64);

/// How much of a lumel people can see.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sight {
    Whole,
    /// A wall cuts it.
    Cut,
    Hidden,
}

impl Sight {
    pub(crate) fn of(r: &Received) -> Sight {
        if r.open == 1.0 {
            Sight::Whole
        } else if r.open > 0.0 {
            Sight::Cut
        } else {
            Sight::Hidden
        }
    }
}

/// Looks up lumels by their neighbours.
#[derive(Clone, Copy)]
pub(crate) struct Window<'m> {
    map: &'m LumelMap,
}

impl<'m> Window<'m> {
    pub(crate) fn new(map: &'m LumelMap) -> Self {
        Window { map }
    }

    /// Gathered lumels around `i`, including itself if gathered, on the same piece of surface and
    /// completely visible, or cut by a wall if `i` is. Where light is interpolated, the window is
    /// twice as wide and contains every second lumel, so it has the usual number, or at least more
    /// than the small one. On a narrow surface it is wider too, until it has as many.
    pub(crate) fn around(&self, i: usize) -> ([Neighbour; SIDE * SIDE], usize) {
        let mut wide = ([(0, 0, 0); SIDE * SIDE], 0);
        if self.map.plan.bears(i) || self.map.plan.is(i) {
            let n = self.on_grid(i, &mut wide.0);
            wide.1 = self.over_clear_ground(i, &mut wide.0, n);
            if 2 * wide.1 >= SIDE * SIDE {
                return wide;
            }
        }
        let of = Sight::of(&self.map.received[i]);
        let mut found = self.connected(i, REACH, of);
        if found.1 < NARROW {
            found = self.connected(i, WIDE, of);
        }
        // Beside a wall, interpolation leaves few gathered lumels in the small window.
        if wide.1 > found.1 { wide } else { found }
    }

    /// Gathered lumels up to `reach` texels from `i`, nearest first, as many as fit. Steps over
    /// lumels of this sight lead to them from `i` without crossing a wall.
    pub(crate) fn connected(
        &self,
        i: usize,
        reach: i64,
        of: Sight,
    ) -> ([Neighbour; SIDE * SIDE], usize) {
        let (mut found, mut n) = ([(0, 0, 0); SIDE * SIDE], 0);
        // Rows of bits, and lumels with their offsets. Small, because each call fills them with
        // zeros.
        let mut known = [0u16; ACROSS];
        let mut queue = [(0u32, 0i8, 0i8); ACROSS * ACROSS];
        let (mut first, mut last) = (0, 1);
        queue[0] = (i as u32, 0, 0);
        known[WIDE as usize] = 1 << WIDE;
        let own = self.map.lumel(i);
        let [cx, cy] = own.texel.map(i64::from);
        while first < last && n < found.len() {
            let (j, dx, dy) = queue[first];
            let (j, dx, dy) = (j as usize, i64::from(dx), i64::from(dy));
            first += 1;
            // Steps may cross interpolated lumels.
            if !self.map.plan.is(j) {
                found[n] = (j, dx, dy);
                n += 1;
            }
            for (sx, sy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let (x, y) = (dx + sx, dy + sy);
                if x.abs().max(y.abs()) > reach {
                    continue;
                }
                let (row, bit) = ((y + WIDE) as usize, 1 << (x + WIDE));
                if known[row] & bit != 0 {
                    continue;
                }
                let Some(k) = self.map.index.at(own.page, cx + x, cy + y) else {
                    continue;
                };
                let before = if sx + sy > 0 { j } else { k };
                if self.is_beside(i, k, x, y, of) && !self.map.barriers.after(before, sy != 0) {
                    known[row] |= bit;
                    queue[last] = (k as u32, x as i8, y as i8);
                    last += 1;
                }
            }
        }
        (found, n)
    }

    /// Whether lumel `j`, at this offset from `i`, is on the same piece of surface and of this
    /// sight.
    fn is_beside(&self, i: usize, j: usize, dx: i64, dy: i64, of: Sight) -> bool {
        let [own, r] = [i, j].map(|k| &self.map.received[k]);
        let steps = ((dx * dx + dy * dy) as f32).sqrt();
        let between = r.position - own.position;
        self.map.lumel(j).instance == self.map.lumel(i).instance
            && (Sight::of(r) == of || j == i)
            && r.normal.dot(own.normal) >= SAME_FACING
            && between.length() <= 1.5 * (steps + 0.5) * own.size
            && between.dot(own.normal).abs() <= 0.5 * (steps + 1.0) * own.size
    }

    /// Lumels in the wide window around `i` whose column and row are even. Those near something are
    /// left out, because walls are only known between adjacent lumels.
    fn on_grid(&self, i: usize, found: &mut [Neighbour; SIDE * SIDE]) -> usize {
        let l = self.map.lumel(i);
        let [cx, cy] = l.texel.map(i64::from);
        // From an odd lumel the window has one column less than from an even one.
        let side = |c: i64| {
            let steps = WIDE - c.rem_euclid(2);
            (-steps..=steps).step_by(2)
        };
        let mut n = 0;
        for dy in side(cy) {
            for dx in side(cx) {
                let Some(j) = self.map.index.at(l.page, cx + dx, cy + dy) else {
                    continue;
                };
                if !self.map.plan.is(j)
                    && (j == i || !self.map.received[j].near)
                    && self.is_beside(i, j, dx, dy, Sight::Whole)
                {
                    found[n] = (j, dx, dy);
                    n += 1;
                }
            }
        }
        n
    }

    /// Keeps those of the first `n` lumels, which are in every second column and row, that can be
    /// reached from the centre by steps over lumels with nothing near: a wall through the floor
    /// would be within or next to one of them.
    fn over_clear_ground(&self, i: usize, found: &mut [Neighbour; SIDE * SIDE], n: usize) -> usize {
        let l = self.map.lumel(i);
        let [cx, cy] = l.texel.map(i64::from);
        let place = |dx: i64, dy: i64| ((dy + WIDE) * ACROSS as i64 + dx + WIDE) as usize;
        let mut there = [false; ACROSS * ACROSS];
        let mut reached = [false; ACROSS * ACROSS];
        let mut next = [(0i64, 0i64); SIDE * SIDE];
        let mut waiting = 0;
        for &(_, dx, dy) in &found[..n] {
            there[place(dx, dy)] = true;
            // The lumel's own neighbours; itself, if it was gathered.
            if dx.abs() <= 1 && dy.abs() <= 1 {
                reached[place(dx, dy)] = true;
                next[waiting] = (dx, dy);
                waiting += 1;
            }
        }
        while waiting > 0 {
            waiting -= 1;
            let (x, y) = next[waiting];
            for (sx, sy) in [(1i64, 0i64), (-1, 0), (0, 1), (0, -1)] {
                let (u, v) = (x + 2 * sx, y + 2 * sy);
                if u.abs() > WIDE || v.abs() > WIDE || !there[place(u, v)] || reached[place(u, v)] {
                    continue;
                }
                let between = self.map.index.at(l.page, cx + x + sx, cy + y + sy);
                let clear = |j: usize| {
                    let r = &self.map.received[j];
                    self.map.lumel(j).instance == l.instance && r.open == 1.0 && !r.near
                };
                if between.is_some_and(clear) {
                    reached[place(u, v)] = true;
                    next[waiting] = (u, v);
                    waiting += 1;
                }
            }
        }
        keep(found, n, |dx, dy| reached[place(dx, dy)])
    }

    /// Mean variance of the lumels around `i`. A lumel's own estimate is not enough: where light
    /// comes from a small region (a cave's mouth), one that missed it by chance appears dark and
    /// certain, and would remain a dark dot.
    pub(crate) fn pooled_variance(&self, i: usize) -> f32 {
        let (around, n) = self.around(i);
        let sum: f32 = around[..n]
            .iter()
            .map(|a| self.map.received[a.0].indirect_variance)
            .sum();
        let own = &self.map.received[i];
        if n == 0 {
            own.indirect_variance
        } else if own.open < 1.0 {
            // A part of a lumel has fewer rays than its neighbours.
            own.indirect_variance.max(sum / n as f32)
        } else {
            sum / n as f32
        }
    }

    /// [`pooled_variance`](Self::pooled_variance) of the lumels around `i` with similar light.
    pub(crate) fn variance_of_alike(&self, i: usize, light: &[f32], alike: f32) -> f32 {
        let (around, n) = self.around(i);
        let (mut sum, mut count) = (0.0, 0.0);
        for &(j, ..) in &around[..n] {
            if light[j] <= alike * light[i] && light[i] <= alike * light[j] {
                sum += self.map.received[j].indirect_variance;
                count += 1.0;
            }
        }
        if count > 0.0 {
            sum / count
        } else {
            self.map.received[i].indirect_variance
        }
    }
}

/// Keeps those of the first `n` whose place was `reached`, in order; returns their number.
fn keep(
    found: &mut [Neighbour; SIDE * SIDE],
    n: usize,
    reached: impl Fn(i64, i64) -> bool,
) -> usize {
    let mut kept = 0;
    for k in 0..n {
        let (_, dx, dy) = found[k];
        if reached(dx, dy) {
            found[kept] = found[k];
            kept += 1;
        }
    }
    kept
}
