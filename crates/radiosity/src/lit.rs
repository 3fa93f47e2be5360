//! Sampling lit elements like lights.
//!
//! A sunlit floor illuminates a room as a lamp does, and from a dark corner a gathering ray hits it
//! as rarely as a lamp. After the solve, the light that lamps, suns and emitters contribute to
//! elements is known. The reflection of an element can therefore be sampled like a lamp: an element
//! is chosen roughly in proportion to its contribution, and a shadow ray tests its visibility.
//!
//! Neither strategy is always better: a point in the open is lit from all around, where a few
//! samples say less than many gathering rays. Both strategies therefore share the light of each
//! element according to their probability of finding it ([`of_lit`](crate::of_lit); the balance
//! heuristic of Veach and Guibas, *Optimally combining sampling techniques for Monte Carlo
//! rendering*, 1995). The shares sum to one for any assumed probabilities, so these may be rough.
//! Elements nearer than [`LitElements::FROM`] are left to gathering rays, because one point does
//! not represent a near element and 1/d² is unbounded. Surfaces that transmit light, or have holes,
//! are also left to gathering rays.

use std::cell::Cell;

use glam::Vec3;
use patch_subdivision::{PatchId, Subdivision};
use rayon::prelude::*;

use crate::divide::lower_part;
use crate::solution::Solution;
use crate::world::{SurfacePoint, World, luminance};

/// Maximum number of elements per leaf. The choice among them uses the contribution of each.
const LEAF: usize = 8;

/// Items per block: their powers share a cache line.
const BLOCK: usize = 16;

/// An element that direct light reaches.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Item {
    /// Where shadow rays to it end.
    origin: Vec3,
    /// Unit normal of the lit side.
    normal: Vec3,
    /// Intensity along its normal: reflectance × direct irradiance × area / π.
    sends: Vec3,
    /// Luminance of its direct irradiance.
    arrives: f32,
    /// Squared distance in metres beyond which gathering rays skip its direct light.
    from2: f32,
    element: u32,
}

impl Item {
    #[inline]
    fn power(&self) -> f32 {
        luminance(self.sends)
    }

    /// Unoccluded contribution to a point `p` with normal `normal` per unit of intensity: cos cos /
    /// d².
    #[inline]
    fn kernel(&self, p: Vec3, normal: Vec3) -> f32 {
        let v = self.origin - p;
        let d2 = v.length_squared();
        if d2 <= self.from2 {
            return 0.0;
        }
        let (receives, sends) = (normal.dot(v), -self.normal.dot(v));
        if receives <= 0.0 || sends <= 0.0 {
            return 0.0;
        }
        receives * sends / (d2 * d2)
    }
}

/// A node of the tree.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// Centre of the light it sends.
    origin: Vec3,
    /// Radius of a sphere around that centre that contains its items.
    radius: f32,
    /// Σ power, and the mean direct irradiance weighted by power.
    power: f32,
    arrives: f32,
    /// Σ power × normal.
    flux: Vec3,
    /// Radius of the smallest sphere around `flux` / power that contains the normals.
    spread: f32,
    /// The smallest and the largest `from` of its items, in metres.
    from: [f32; 2],
    /// Centre and half-size of its items' bounding box.
    middle: Vec3,
    half: Vec3,
    /// Items `[start, end)`.
    start: u32,
    end: u32,
    /// The second child; the first one follows its parent. 0 for a leaf.
    second: u32,
}

/// A sample of [`LitElements`].
#[derive(Debug, Clone, Copy)]
pub struct LitSample {
    item: u32,
    /// The probability with which it was drawn.
    probability: f32,
}

/// The contribution of a sample of [`LitElements`] to a point.
#[derive(Debug, Clone, Copy)]
pub struct FromLit {
    /// From the point's origin to the element.
    pub to: Vec3,
    /// Its irradiance divided by the probability of having drawn it.
    pub light: Vec3,
    /// Luminance of the element's direct irradiance.
    pub arrives: f32,
    /// Its irradiance per unit of intensity, divided by that probability.
    pub kernel: f32,
    /// Unit direction towards it.
    pub direction: Vec3,
    /// Cosine between that and the point's normal.
    pub cos: f32,
}

/// The elements that direct light reaches, in a tree by position.
#[derive(Debug, Default)]
pub struct LitElements {
    items: Vec<Item>,
    nodes: Vec<Node>,
    /// Luminance of each item's intensity, and the running sum before each block of [`BLOCK`].
    powers: Vec<f32>,
    blocks: Vec<f64>,
    /// Their mean reflectance, by luminance.
    reflects: f32,
}

/// Groups of lit elements as seen from a receiver, with their approximate contributions.
#[derive(Debug, Default)]
pub struct LitCut {
    groups: Vec<Group>,
    /// Σ of weights × mean direct irradiance.
    arrives: f32,
}

thread_local! {
    /// The list of the last cut that was dropped, for the next one to fill. Lists grow to some
    /// hundred groups, and a bake makes millions of them.
    static SPARE: Cell<Vec<Group>> = const { Cell::new(Vec::new()) };
}

impl Drop for LitCut {
    fn drop(&mut self) {
        if self.groups.capacity() > 0 {
            SPARE.set(std::mem::take(&mut self.groups));
        }
    }
}

/// Items `[start, end)`, and the running sum of weights including them.
#[derive(Debug, Clone, Copy)]
struct Group {
    start: u32,
    end: u32,
    after: f32,
}

/// Positions of elements are compared in steps of this share of the size of the set to split.
const STEP: f32 = 1.0 / 65_536.0;

/// Items that rise by less than this share of their size above a receiver are coplanar with it.
const GRAZING: f32 = 1e-3;

/// Nothing is drawn if the expected sample is less than this times as likely to be hit by a
/// gathering ray as the mean: it would cost time and gain nothing.
const LEAST: f32 = 0.25;

/// A node is used as a whole if its angular size (radius over distance) is below this.
const WHOLE: f32 = 0.6;

impl LitElements {
    /// Distance, in patch sizes, beyond which direct light that elements reflect is sampled in
    /// addition to being gathered.
    pub const FROM: f32 = 1.0;

    /// Collects the lit elements of a solution, on opaque surfaces. O(n log n) in elements.
    pub fn collect(world: &World, solution: &Solution) -> Self {
        let (reflectance, direct) = (&solution.reflectance, &solution.direct);
        let even = |p: usize| !solution.rough[p];
        Self::of(world, &solution.cut, reflectance, direct, &even)
    }

    /// The same of the patches for which `counts` holds, given `reflectance` and `direct` irradiance
    /// by element.
    pub(crate) fn of(
        world: &World,
        cut: &Subdivision,
        reflectance: &[Vec3],
        direct: &[Vec3],
        counts: &(dyn Fn(usize) -> bool + Sync),
    ) -> Self {
        let item = |patch: usize, e: usize| -> Option<Item> {
            let element = cut.elements()[e];
            let sends = reflectance[e] * (element.area * std::f32::consts::FRAC_1_PI) * direct[e];
            if luminance(sends) <= 0.0 {
                return None;
            }
            let (t, u, v) = (element.triangle, element.u, element.v);
            // Gathering rays hit partly transparent surfaces as often as their presence requires.
            if world.lets_light_through(t) {
                return None;
            }
            let at = world.inset_point(t, u, v, cut.patches()[patch].back, false);
            let from = Self::FROM * cut.patch_edge(t);
            Some(Item {
                origin: at.origin,
                normal: at.geometric,
                sends,
                arrives: luminance(direct[e]),
                from2: from * from,
                element: e as u32,
            })
        };
        let items: Vec<Item> = (0..cut.patches().len())
            .into_par_iter()
            .filter(|&p| counts(p))
            .flat_map_iter(|p| {
                let elements = cut.elements_of(PatchId(p as u32));
                elements.filter_map(move |e| item(p, e))
            })
            .collect();
        let mut arrives = 0f64;
        for item in &items {
            let area = cut.elements()[item.element as usize].area;
            arrives += f64::from(item.arrives * area * std::f32::consts::FRAC_1_PI);
        }
        let power: f64 = items.iter().map(|i| f64::from(i.power())).sum();
        Self::of_items(items, (power / arrives.max(1e-300)) as f32)
    }

    /// Builds the tree over `items`, whose mean reflectance is `reflects`.
    fn of_items(mut items: Vec<Item>, reflects: f32) -> Self {
        let mut nodes = Vec::with_capacity(items.len() / 2);
        let n = items.len();
        if n > 0 {
            split(&mut items, 0, n, &mut nodes);
        }
        let powers: Vec<f32> = items.iter().map(Item::power).collect();
        let mut blocks = Vec::with_capacity(n / BLOCK + 2);
        let mut sum = 0f64;
        for block in powers.chunks(BLOCK) {
            blocks.push(sum);
            sum += block.iter().map(|p| f64::from(*p)).sum::<f64>();
        }
        blocks.push(sum);
        LitElements {
            reflects,
            items,
            nodes,
            powers,
            blocks,
        }
    }

    /// Whether there are no lit elements.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Memory in bytes.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.items[..])
            + size_of_val(&self.nodes[..])
            + size_of_val(&self.powers[..])
            + size_of_val(&self.blocks[..])) as u64
    }

    /// The groups as seen from a receiver around `p`. The receiver is `scale` metres wide, and its
    /// normals differ from that of `p` by vectors of length `bend` at most. O(log n).
    pub fn cut(&self, p: &SurfacePoint, scale: f32, bend: f32) -> LitCut {
        let mut cut = LitCut::default();
        if self.is_empty() {
            return cut;
        }
        cut.groups = SPARE.take();
        cut.groups.clear();
        let mut sum = 0f32;
        // A child has at most three quarters of its parent's items (`lower_part`), so this is enough
        // for 8 · (4/3)⁶³ ≈ 6 · 10⁸ of them.
        let mut stack = [0u32; 64];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let id = stack[depth];
            let node = &self.nodes[id as usize];
            let power = node.power;
            let v = node.origin - p.origin;
            let d2 = v.length_squared();
            let reach = node.radius + scale;
            let most = d2.sqrt() + node.radius;
            // By the node's box instead of its sphere, which rejects nodes coplanar with the
            // receiver at once.
            let to = node.middle - p.origin;
            let above = p.normal.dot(to) + p.normal.abs().dot(node.half) + bend * most;
            let before = -node.flux.dot(to) + node.flux.abs().dot(node.half);
            let turned = power * (node.spread * most + scale);
            let within = node.from[0] - reach;
            if above <= GRAZING * reach
                || before + turned <= 0.0
                || (within > 0.0 && d2 < within * within)
            {
                continue;
            }
            let height = p.normal.dot(v);
            let far = node.from[1] + reach;
            if reach * reach < WHOLE * WHOLE * d2 && d2 > far * far {
                let inverse = 1.0 / d2.sqrt();
                let angle = reach * inverse;
                // At least a part of the maximum contribution of any of its points.
                let receives = (height * inverse).max(0.5 * (angle + bend));
                let sends = (-node.flux.dot(v) * inverse).max(0.5 * power * (angle + node.spread));
                let w = receives * sends / d2;
                sum += w;
                cut.arrives += w * node.arrives;
                cut.groups.push(Group {
                    start: node.start,
                    end: node.end,
                    after: sum,
                });
            } else if node.second == 0 {
                for k in node.start..node.end {
                    let item = &self.items[k as usize];
                    let v = item.origin - p.origin;
                    let d2 = v.length_squared();
                    let from = item.from2.sqrt() - scale;
                    let bent = bend * d2.sqrt();
                    let (height, facing) = (p.normal.dot(v), -item.normal.dot(v));
                    if (from > 0.0 && d2 < from * from)
                        || height + bent <= GRAZING * scale
                        || facing + scale <= 0.0
                    {
                        continue;
                    }
                    let d2 = d2.max(item.from2);
                    let receives = height.max(0.5 * (scale + bent));
                    let w = item.power() * receives * facing.max(0.5 * scale) / (d2 * d2);
                    sum += w;
                    cut.arrives += w * item.arrives;
                    cut.groups.push(Group {
                        start: k,
                        end: k + 1,
                        after: sum,
                    });
                }
            } else {
                stack[depth] = node.second;
                stack[depth + 1] = id + 1;
                depth += 2;
            }
        }
        cut
    }

    /// The share for gathering rays to leave out ([`of_lit`](crate::of_lit)) at the receiver of
    /// `cut` if `samples` are drawn per gathering ray. 0 if nothing is worth drawing.
    ///
    /// The probability that a gathering ray hits an element is cos cos' / π d² per area. A sample
    /// is drawn with that probability times the element's brightness over the mean brightness of
    /// all candidates (their unoccluded irradiance over π).
    pub fn share(&self, cut: &LitCut, samples: f32) -> f32 {
        let brings = cut.groups.last().map_or(0.0, |g| g.after);
        if brings <= 0.0 {
            return 0.0;
        }
        let share = samples * self.reflects / brings;
        match share * cut.arrives < LEAST * brings {
            true => 0.0,
            false => share,
        }
    }

    /// Draws one, roughly in proportion to its contribution to the receiver of `cut`; `None` if
    /// none contributes. `x` ∈ [0, 1). O(log n).
    pub fn draw(&self, cut: &LitCut, x: f32) -> Option<LitSample> {
        let sum = cut.groups.last()?.after;
        let at = x * sum;
        let g = (cut.groups.partition_point(|g| g.after <= at)).min(cut.groups.len() - 1);
        let Group { start, end, after } = cut.groups[g];
        let before = if g == 0 { 0.0 } else { cut.groups[g - 1].after };
        let weight = after - before;
        if weight.is_nan() || weight <= 0.0 {
            return None;
        }
        let inner = ((at - before) / weight).clamp(0.0, 1.0);
        let (item, own) = match end - start {
            1 => (start, 1.0),
            _ => self.by_power(start as usize, end as usize, inner),
        };
        Some(LitSample {
            item,
            probability: weight / sum * own,
        })
    }

    /// The item of `[start, end)` at the share `x` of their power, and its own share.
    fn by_power(&self, start: usize, end: usize, x: f32) -> (u32, f32) {
        let (first, last) = (start / BLOCK, end / BLOCK);
        let part = |range: std::ops::Range<usize>| -> f64 {
            self.powers[range].iter().map(|p| f64::from(*p)).sum()
        };
        let low = self.blocks[first] + part(first * BLOCK..start);
        let high = self.blocks[last] + part(last * BLOCK..end);
        if high <= low {
            // The power of the range is lost in rounding next to the sum before it.
            let n = (end - start) as f32;
            return (start as u32 + (x * n).min(n - 1.0) as u32, 1.0 / n);
        }
        let at = low + f64::from(x) * (high - low);
        let blocks = &self.blocks[first + 1..=last];
        let block = first + blocks.partition_point(|b| *b <= at);
        let mut sum = self.blocks[block].max(low);
        let from = (block * BLOCK).max(start);
        let to = ((block + 1) * BLOCK).min(end);
        let mut chosen = from;
        for k in from..to {
            let p = f64::from(self.powers[k]);
            chosen = k;
            if at < sum + p {
                break;
            }
            sum += p;
        }
        let own = f64::from(self.powers[chosen]) / (high - low);
        (chosen as u32, own as f32)
    }

    /// The element of a sample.
    pub fn element(&self, sample: LitSample) -> u32 {
        self.items[sample.item as usize].element
    }

    /// The contribution of a sample to `p`; `None` if it is zero.
    pub fn arriving(&self, sample: LitSample, p: &SurfacePoint) -> Option<FromLit> {
        let item = &self.items[sample.item as usize];
        let kernel = item.kernel(p.origin, p.normal);
        let to = item.origin - p.origin;
        if kernel <= 0.0 || p.geometric.dot(to) <= 0.0 {
            return None;
        }
        let direction = to.normalize();
        Some(FromLit {
            to,
            light: item.sends * (kernel / sample.probability),
            arrives: item.arrives,
            kernel: kernel / sample.probability,
            direction,
            cos: p.normal.dot(direction),
        })
    }
}

/// Sorts `items[start..end]` and appends their subtree to `nodes`.
fn split(items: &mut [Item], start: usize, end: usize, nodes: &mut Vec<Node>) -> usize {
    let part = &mut items[start..end];
    let id = nodes.len();
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (mut flux, mut origin, mut power) = (Vec3::ZERO, Vec3::ZERO, 0f32);
    for item in part.iter() {
        low = low.min(item.origin);
        high = high.max(item.origin);
    }
    let base = low;
    let mut arrives = 0f32;
    for item in part.iter() {
        let p = item.power();
        power += p;
        flux += item.normal * p;
        origin += (item.origin - base) * p;
        arrives += item.arrives * p;
    }
    let origin = base + origin / power;
    let mean = flux / power;
    let (mut radius, mut spread) = (0f32, 0f32);
    let mut from = [f32::INFINITY, 0f32];
    for item in part.iter() {
        radius = radius.max(item.origin.distance_squared(origin));
        spread = spread.max(item.normal.distance_squared(mean));
        from = [from[0].min(item.from2), from[1].max(item.from2)];
    }
    nodes.push(Node {
        origin,
        radius: radius.sqrt(),
        power,
        arrives: arrives / power,
        flux,
        spread: spread.sqrt(),
        from: from.map(f32::sqrt),
        middle: 0.5 * (low + high),
        half: 0.5 * (high - low),
        start: start as u32,
        end: end as u32,
        second: 0,
    });
    if part.len() <= LEAF {
        return id;
    }
    // Elements lie on grids, so many share a coordinate up to rounding. Positions are compared in
    // steps; otherwise the tree, and with it the samples, would depend on the scene's scale and
    // position.
    let size = high - low;
    let longest = size.max_element();
    let axis = (0..3)
        .find(|k| size[*k] >= (1.0 - STEP) * longest)
        .unwrap_or(0);
    let step = |item: &Item| ((item.origin[axis] - low[axis]) / (STEP * longest)).round() as u32;
    let middle = lower_part(part.iter().map(|item| step(item) as f32));
    part.select_nth_unstable_by_key(middle, |item| (step(item), item.element));
    split(items, start, start + middle, nodes);
    nodes[id].second = nodes.len() as u32;
    split(items, start + middle, end, nodes);
    id
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `n` elements of very different brightness on a ceiling and a wall around a receiver on the
    /// floor.
    fn elements(n: u32) -> LitElements {
        let items = (0..n)
            .map(|k| {
                let [u, v] = crate::sampling::sample_2d(k, 3, 11);
                let (origin, normal) = match k % 3 {
                    0 => (Vec3::new(3.0, u * 4.0, v * 4.0), Vec3::NEG_X),
                    _ => (Vec3::new(u * 6.0 - 3.0, 4.0, v * 6.0 - 3.0), Vec3::NEG_Y),
                };
                let arrives = 10f32.powf(3.0 * u - 2.0);
                Item {
                    origin,
                    normal,
                    sends: Vec3::splat(0.01 * arrives),
                    arrives,
                    from2: 0.25,
                    element: k,
                }
            })
            .collect();
        LitElements::of_items(items, 0.5)
    }

    fn floor() -> SurfacePoint {
        SurfacePoint {
            position: Vec3::ZERO,
            origin: Vec3::ZERO,
            normal: Vec3::Y,
            geometric: Vec3::Y,
        }
    }

    #[test]
    fn one_group_stands_for_a_far_room() {
        let mut items = elements(600).items;
        let far = |item: &Item| item.normal == Vec3::NEG_X;
        for item in items.iter_mut().filter(|item| far(item)) {
            item.origin.x += 200.0;
        }
        let lit = LitElements::of_items(items, 0.5);
        let cut = lit.cut(&floor(), 0.1, 0.0);
        let holds = |g: &&Group| lit.items[g.start as usize..g.end as usize].iter().any(far);
        let groups: Vec<_> = cut.groups.iter().filter(holds).collect();
        assert_eq!(groups.len(), 1, "{groups:?}");
        assert_eq!(groups[0].end - groups[0].start, 200);
    }

    #[test]
    fn draws_bring_on_average_what_all_elements_bring() {
        for n in [1, 7, 8, 9, 500, 3000] {
            let lit = elements(n);
            let p = floor();
            let all: f64 = (lit.items.iter())
                .map(|i| f64::from(i.power() * i.kernel(p.origin, p.normal)))
                .sum();
            let cut = lit.cut(&p, 0.1, 0.0);
            let draws = 1 << 18;
            let mut sum = 0.0;
            for k in 0..draws {
                let x = (k as f32 + 0.5) / draws as f32;
                let from = lit.draw(&cut, x).and_then(|d| lit.arriving(d, &p));
                sum += from.map_or(0.0, |f| f64::from(luminance(f.light)));
            }
            let mean = sum / f64::from(draws);
            // Each element's part of [0, 1) contains a whole number of draws, give or take one: n
            // of 2¹⁸ at most if all were as bright as the mean. The brightest are ten times
            // brighter.
            let room = 1e-5 + 10.0 * f64::from(n) / f64::from(draws);
            assert!((mean / all - 1.0).abs() < room, "{n}: {mean} {all}");
        }
    }

    #[test]
    fn what_lies_in_one_plane_brings_nothing() {
        let mut items = elements(300).items;
        for item in &mut items {
            (item.origin.y, item.normal) = (0.0, Vec3::Y);
        }
        let lit = LitElements::of_items(items, 0.5);
        let cut = lit.cut(&floor(), 0.1, 0.0);
        assert_eq!(cut.groups.len(), 0);
        assert!(lit.draw(&cut, 0.5).is_none());
        assert_eq!(lit.share(&cut, 1.0), 0.0);
    }
}
