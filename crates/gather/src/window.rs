//! The lumels around one that are on the same piece of surface.

use crate::map::LumelMap;

/// Texels on each side of a lumel in the window: 48 neighbours for a fit of six unknowns, which
/// leaves about a tenth of the variance, a third of the noise.
pub(crate) const REACH: i64 = 3;

/// Least cosine between the normals of two lumels, which otherwise see too different hemispheres.
/// About 30°: along a curve light changes steadily, which the fit follows, and pillars are only a
/// few lumels around.
pub(crate) const SAME_FACING: f32 = 0.85;

/// Width of a window in lumels.
pub(crate) const SIDE: usize = (2 * REACH + 1) as usize;

/// A neighbour and its offset in texels.
pub(crate) type Neighbour = (usize, i64, i64);

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
    /// completely visible. Where light is interpolated, the window is twice as wide and contains
    /// every second lumel, so it has the usual number, or at least more than the small one.
    pub(crate) fn around(&self, i: usize) -> ([Neighbour; SIDE * SIDE], usize) {
        let mut wide = ([(0, 0, 0); SIDE * SIDE], 0);
        if self.map.plan.bears(i) || self.map.plan.is(i) {
            let n = self.on_grid(i, 2, &mut wide.0);
            wide.1 = self.over_clear_ground(i, &mut wide.0, n);
            if 2 * wide.1 >= SIDE * SIDE {
                return wide;
            }
        }
        let mut found = [(0, 0, 0); SIDE * SIDE];
        let mut n = self.on_grid(i, 1, &mut found);
        if self.map.barriers.matter() {
            n = self.on_this_side(i, &mut found, n);
        }
        // Beside a wall, interpolation leaves few gathered lumels in the small window.
        if wide.1 > n { wide } else { (found, n) }
    }

    /// Lumels in the window around `i` whose column and row are multiples of `stride`, or any if
    /// that is 1. With a larger stride, lumels near something are left out, because barriers are
    /// only known between adjacent lumels.
    fn on_grid(&self, i: usize, stride: i64, found: &mut [Neighbour; SIDE * SIDE]) -> usize {
        let (l, own) = (self.map.lumel(i), &self.map.received[i]);
        let [cx, cy] = l.texel.map(i64::from);
        // From an odd lumel the window has one column less than from an even one.
        let side = |c: i64| {
            let odd = c.rem_euclid(stride);
            let steps = REACH * stride - odd;
            (-steps..=steps).step_by(stride as usize)
        };
        let mut n = 0;
        for dy in side(cy) {
            for dx in side(cx) {
                let (x, y) = (cx + dx, cy + dy);
                let Some(j) = self.map.index.at(l.page, x, y) else {
                    continue;
                };
                let r = &self.map.received[j];
                let steps = ((dx * dx + dy * dy) as f32).sqrt();
                let between = r.position - own.position;
                if self.map.lumel(j).instance == l.instance
                    && !self.map.plan.is(j)
                    && (r.open == 1.0 || j == i)
                    && (stride == 1 || j == i || !r.near)
                    && r.normal.dot(own.normal) >= SAME_FACING
                    && between.length() <= 1.5 * (steps + 0.5) * own.size
                    && between.dot(own.normal).abs() <= 0.5 * (steps + 1.0) * own.size
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
        const WIDE: i64 = 2 * REACH;
        const ACROSS: usize = (2 * WIDE + 1) as usize;
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

    /// Keeps those of the first `n` that can be reached from the centre without crossing a barrier,
    /// in order; returns their number.
    fn on_this_side(&self, i: usize, found: &mut [Neighbour; SIDE * SIDE], n: usize) -> usize {
        // Lumels that a wall cuts are not among the neighbours, and lumels next to a wall have
        // something near.
        if !found[..n].iter().any(|f| self.map.received[f.0].near) {
            return n;
        }
        let place = |dx: i64, dy: i64| ((dy + REACH) * SIDE as i64 + dx + REACH) as usize;
        let mut slot = [usize::MAX; SIDE * SIDE];
        for &(j, dx, dy) in &found[..n] {
            slot[place(dx, dy)] = j;
        }
        // Steps may cross interpolated lumels.
        let (l, reach) = (self.map.lumel(i), -REACH..=REACH);
        for (dx, dy) in reach
            .clone()
            .flat_map(|dy| reach.clone().map(move |dx| (dx, dy)))
        {
            let [x, y] = l.texel.map(i64::from);
            let j = (self.map.index.at(l.page, x + dx, y + dy))
                .filter(|&j| self.map.plan.is(j) && self.map.lumel(j).instance == l.instance);
            if let Some(j) = j {
                slot[place(dx, dy)] = j;
            }
        }
        let mut reached = [false; SIDE * SIDE];
        let mut next = Vec::with_capacity(n);
        next.push((0i64, 0i64));
        reached[place(0, 0)] = true;
        while let Some((x, y)) = next.pop() {
            let own = slot[place(x, y)];
            for (dx, dy) in [(1i64, 0i64), (-1, 0), (0, 1), (0, -1)] {
                let (u, v) = (x + dx, y + dy);
                if u.abs() > REACH || v.abs() > REACH || reached[place(u, v)] {
                    continue;
                }
                let other = slot[place(u, v)];
                // The centre itself may not be among those found.
                let before = if dx + dy > 0 { own } else { other };
                let free = other != usize::MAX
                    && (before == usize::MAX || !self.map.barriers.after(before, dy != 0));
                if free {
                    reached[place(u, v)] = true;
                    next.push((u, v));
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
