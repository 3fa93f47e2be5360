//! Packs charts into a rectangle of texels: phase on the texel grid, masks, positions, final
//! coordinates.
//!
//! Charts are kept apart by the texels that bilinear lookups on them read, not by their outlines
//! ([`UnwrapOptions::padding`]). A chart is therefore aligned to the grid so that its lookups read
//! as few texels as possible: a side of 4.2 texels reads 6 at the best phase and 7 at others.

use glam::{DVec2, Vec2};
use rayon::prelude::*;

use super::charts::{Charts, Shape};
use super::mask::{Mask, SLACK};
use super::measure::signed_area2;
use super::place::{Item, Place, place_all};
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh};

/// From this many texels on, the shorter side of a rectangular chart is aligned to texel borders,
/// whatever it reads. A border row of half-covered lumels costs as much to bake as full ones, and
/// the saved texels are few in relation to the chart.
const LARGE_SIDE: f64 = 64.0;

/// Non-rectangular charts are tried at sixteen phases of the grid if that takes fewer steps
/// (triangles × rows) than this.
const PHASE_WORK: f64 = 20_000.0;

/// Cost factor of rectangles more than twice as long as wide. Six sides of a box fit 1 × 6 as well
/// as 2 × 3, and squares are easier to pack. Five equal sides in 2 × 3 waste a sixth, which a strip
/// across the page would waste as well.
const STRIP_COST: f64 = 1.25;

/// Number of attempts at lower densities before charts count as too many.
const TRIES: usize = 24;

/// Rules for the distance of masks.
#[derive(Debug, Clone, Copy)]
struct Rule {
    /// See [`Mask::cover`].
    reach: f64,
    /// Free texels between masks.
    gap: u32,
    /// Free texels between masks and the border of the rectangle.
    border: u32,
    /// Masks are aligned to blocks of this many texels.
    unit: u32,
    /// Sides of the rectangle are multiples of this many units.
    step: u32,
}

impl Rule {
    fn new(options: &UnwrapOptions) -> Rule {
        // A block larger than the page is impossible.
        let block = options.block.clamp(1, options.max_size.max(1));
        let (unit, step) = if options.block_charts {
            (block, 1)
        } else {
            (1, block)
        };
        let (reach, gap) = match options.padding {
            0 => (0.5, 0),
            1 => (0.5, 1),
            n => (1.0, n - 2),
        };
        Rule {
            reach,
            gap,
            border: gap.div_ceil(2),
            unit,
            step,
        }
    }
}

/// A chart on the texel grid.
struct Stamp {
    mask: Mask,
    /// Corners of the triangles in texels of the mask.
    corners: Vec<[DVec2; 3]>,
}

/// Packs `charts` at the density of `options`, or at the highest density found at which they fit.
///
/// # Errors
/// [`UnwrapError::DoesNotFit`] if there are too many charts at any density; [`UnwrapError::Failed`]
/// if a chart folds over.
pub(super) fn pack_charts(
    charts: &Charts,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
) -> Result<UnwrappedMesh, UnwrapError> {
    let rule = Rule::new(options);
    let lists = charts.by_chart();
    let shapes: Vec<Shape> = lists
        .into_par_iter()
        .map(|list| Shape::new(charts, list))
        .collect();
    let room = f64::from(options.max_size).powi(2);
    let mut density = f64::from(options.texels_per_unit);
    let area: f64 = shapes.iter().map(|s| s.area).sum();
    let longest = shapes.iter().map(|s| s.extent.x).fold(0.0, f64::max);
    // A first bound without rasterising: charts never fill a page completely, and each must fit on
    // it.
    density = density
        .min((0.98 * room / area.max(f64::MIN_POSITIVE)).sqrt())
        .min(f64::from(options.max_size) / longest.max(f64::MIN_POSITIVE));
    let too_many = || UnwrapError::DoesNotFit {
        charts: charts.count,
        max_size: options.max_size,
    };
    // Each failed attempt reduces the density by 3 % to half, after eight by at least a fifth; the
    // last ones leave every chart a few texels.
    let mut before = f64::INFINITY;
    for tried in 0..TRIES {
        if cancel() {
            return Err(UnwrapError::Cancelled);
        }
        let stamps: Vec<Stamp> = shapes
            .par_iter()
            .map(|shape| Stamp::new(shape, density, &rule))
            .collect();
        // A total larger than the page need not be tried, and a total that does not decrease never
        // fits.
        let needed: f64 = stamps.iter().map(|s| s.mask.count() as f64).sum();
        if needed > room {
            if needed > 0.999 * before {
                return Err(too_many());
            }
            before = needed;
        } else if let Some(result) =
            arrange(&shapes, &stamps, density, charts, options, &rule, cancel)?
        {
            return Ok(result);
        }
        let most = if tried < 8 { 0.97 } else { 0.8 };
        density *= (0.97 * room / needed.max(1.0)).sqrt().clamp(0.5, most);
    }
    Err(too_many())
}

impl Stamp {
    fn new(shape: &Shape, density: f64, rule: &Rule) -> Stamp {
        let small = shape.extent.y * density < LARGE_SIDE && rule.reach > 0.5;
        let axes = shape
            .extent
            .to_array()
            .map(|e| Axis::new(e * density, shape.rectangle, small));
        let mut best = Laid::new(shape, density, axes, rule.reach);
        let work = shape.triangles.len() as f64 * (axes[1].length + 3.0);
        if small && !shape.rectangle && work < PHASE_WORK {
            let mut least = best.mask.count();
            for phase in 0..16u8 {
                let mut moved = axes;
                moved[0].low = f64::from(phase % 4) * 0.25;
                moved[1].low = f64::from(phase / 4) * 0.25;
                let laid = Laid::new(shape, density, moved, rule.reach);
                if laid.mask.count() < least {
                    least = laid.mask.count();
                    best = laid;
                }
            }
        }
        let Laid { mask, mut corners } = best;
        let (mask, [left, top]) = mask.trimmed();
        let shift = DVec2::new(f64::from(left), f64::from(top));
        for p in corners.iter_mut().flatten() {
            *p -= shift;
        }
        Stamp { mask, corners }
    }
}

/// A chart at one phase of the grid.
struct Laid {
    mask: Mask,
    corners: Vec<[DVec2; 3]>,
}

impl Laid {
    fn new(shape: &Shape, density: f64, axes: [Axis; 2], reach: f64) -> Laid {
        // One texel of margin for what lookups read beyond the chart.
        let map = |p: DVec2| {
            DVec2::new(
                1.0 + axes[0].map(p.x * density),
                1.0 + axes[1].map(p.y * density),
            )
        };
        let corners: Vec<[DVec2; 3]> = shape.corners.iter().map(|c| c.map(map)).collect();
        let size = axes.map(|a| (a.low + a.length).ceil() as u32 + 2);
        let mut mask = Mask::new(size[0], size[1]);
        for c in &corners {
            mask.cover(c, reach);
        }
        Laid { mask, corners }
    }
}

/// Position of a chart on the texel grid along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axis {
    /// Its original length, texels.
    from: f64,
    /// Its final length: rectangles are stretched slightly, never shrunk.
    length: f64,
    /// Its start, 0..1 texels.
    low: f64,
}

impl Axis {
    /// With `small`, minimises the texels read. Otherwise rectangles are aligned to texel borders.
    ///
    /// A length of n + ½ texels that starts at a border and ends at a centre reads n + 2 texels and
    /// touches n + 1. A length of n texels between two centres reads and touches n + 1; between
    /// borders it would read n + 2 and touch n.
    fn new(from: f64, rectangle: bool, small: bool) -> Axis {
        let halves = (2.0 * (from - SLACK)).ceil().max(1.0);
        let odd = halves % 2.0 == 1.0;
        // A wall with a whole number of texels keeps whole lumels, so that users who build on a
        // grid and choose a matching density get what they expect.
        let whole = from >= 4.0 && (from - from.round()).abs() < SLACK;
        let (length, low) = match (rectangle, small && !whole) {
            (true, true) => (halves / 2.0, if odd { 0.0 } else { 0.5 }),
            (false, true) => (from, if odd { 0.0 } else { 0.5 }),
            (true, false) => ((from - SLACK).ceil().max(1.0), 0.0),
            (false, false) => (from, 0.0),
        };
        Axis { from, length, low }
    }

    fn map(&self, x: f64) -> f64 {
        if self.length == self.from {
            return self.low + x;
        }
        // Both ends must be exact, whatever the rounding.
        let y = x / self.from * self.length;
        let y = if y < SLACK {
            0.0
        } else if y > self.length - SLACK {
            self.length
        } else {
            y
        };
        self.low + y
    }
}

/// Finds the smallest rectangle among a few widths; `None` if nothing fits.
fn arrange(
    shapes: &[Shape],
    stamps: &[Stamp],
    density: f64,
    charts: &Charts,
    options: &UnwrapOptions,
    rule: &Rule,
    cancel: Cancel<'_>,
) -> Result<Option<UnwrappedMesh>, UnwrapError> {
    let items: Vec<Item> = stamps.par_iter().map(|s| item(&s.mask, rule)).collect();
    let orders = [largest_first(&items, true), largest_first(&items, false)];
    let Rule { unit, step, .. } = *rule;
    let border = rule.border.div_ceil(unit);
    let gap = rule.gap.div_ceil(unit);
    // Everything from here on is in units.
    let max = options.max_size / unit / step * step;
    let Some(inner) = max.checked_sub(2 * border).filter(|&m| m > 0) else {
        return Ok(None);
    };
    // Masks enlarged by their part of the gaps.
    let grown = |m: &Mask| match gap {
        0 => m.count() as f64,
        _ => f64::from(m.width + gap) * f64::from(m.height + gap),
    };
    let needed: f64 = items.iter().map(|i| grown(&i.turns[0].1)).sum();
    let widest = items
        .iter()
        .map(|i| i.turns.iter().map(|t| t.1.width).min().unwrap_or(1))
        .max()
        .unwrap_or(1);
    let longest = items
        .iter()
        .map(|i| i.turns[0].1.width.max(i.turns[0].1.height))
        .max()
        .unwrap_or(1);
    let mut best: Option<(f64, [u32; 2], Vec<Place>)> = None;
    let tries = widths(needed, [widest, longest], inner, items.len());
    for (width, order) in tries
        .into_iter()
        .flat_map(|w| orders.iter().map(move |o| (w, o)))
    {
        if cancel() {
            return Err(UnwrapError::Cancelled);
        }
        let outer = (width + 2 * border).next_multiple_of(step);
        // Only results smaller than the best so far matter.
        let limit = best.as_ref().map_or(max, |b| {
            let lower = ((b.0 - 1.0) / f64::from(outer)).clamp(0.0, f64::from(max)) as u32;
            lower / step * step
        });
        let Some(limit) = limit.checked_sub(2 * border) else {
            continue;
        };
        if let Some((places, used)) = place_all(&items, order, outer - 2 * border, limit, gap) {
            let height = (used + 2 * border).next_multiple_of(step);
            let area = f64::from(outer) * f64::from(height);
            let long = outer.max(height) > 2 * outer.min(height);
            let cost = area * if long { STRIP_COST } else { 1.0 };
            if best.as_ref().is_none_or(|b| cost < b.0) {
                best = Some((cost, [outer, height], places));
            }
        }
    }
    let Some((_, size, places)) = best else {
        return Ok(None);
    };
    let size = size.map(|s| s * unit);
    let mut result = UnwrappedMesh {
        size,
        texels_per_unit: density as f32,
        corners: vec![[Vec2::ZERO; 3]; charts.corners.len()],
        chart: charts.chart.clone(),
        charts: charts.count,
    };
    for (((shape, stamp), item), place) in shapes.iter().zip(stamps).zip(&items).zip(&places) {
        let quarters = item.turns[place.turn].0;
        // Rotated about the whole blocks that were placed.
        let whole =
            [stamp.mask.width, stamp.mask.height].map(|s| f64::from(s.next_multiple_of(unit)));
        let at = place.at.map(|s| f64::from((s + border) * unit));
        for (&t, corners) in shape.triangles.iter().zip(&stamp.corners) {
            result.corners[t as usize] =
                corners.map(|p| (turn(p, whole, quarters) + DVec2::from(at)).as_vec2());
        }
    }
    unfold(&mut result)?;
    Ok(Some(result))
}

/// Rotates a point of a `size` rectangle by quarter turns, clockwise as seen with y down
/// ([`Mask::turned`]).
fn turn(p: DVec2, size: [f64; 2], quarters: u8) -> DVec2 {
    match quarters {
        0 => p,
        1 => DVec2::new(size[1] - p.y, p.x),
        2 => DVec2::new(size[0] - p.x, size[1] - p.y),
        _ => DVec2::new(p.y, size[0] - p.x),
    }
}

/// A mask in its distinct orientations, in whole blocks.
fn item(mask: &Mask, rule: &Rule) -> Item {
    let mut turns: Vec<(u8, Mask)> = Vec::with_capacity(4);
    let mut next = mask.blocks(rule.unit);
    for quarters in 0..4 {
        let turned = next.turned();
        if turns.iter().all(|t| t.1 != next) {
            turns.push((quarters, next));
        }
        next = turned;
    }
    Item { turns }
}

/// Indices of items in decreasing order of their shorter side (`thick`) or longer side, then of
/// their area. Neither order is always better.
fn largest_first(items: &[Item], thick: bool) -> Vec<u32> {
    let key = |i: u32| {
        let mask = &items[i as usize].turns[0].1;
        let (short, long) = (mask.width.min(mask.height), mask.width.max(mask.height));
        let side = if thick { short } else { long };
        (std::cmp::Reverse((side, mask.count())), i)
    };
    let mut order: Vec<u32> = (0..items.len() as u32).collect();
    order.sort_by_cached_key(|&i| key(i));
    order
}

/// Widths to try for masks with a total of `needed` units², most promising first. `sides`: the
/// width of the widest mask, and the longest side of any.
fn widths(needed: f64, sides: [u32; 2], inner: u32, count: usize) -> Vec<u32> {
    let side = needed.sqrt();
    let factors: &[f64] = match count {
        0..=64 => &[
            1.02, 1.0, 1.05, 1.1, 0.95, 0.9, 1.16, 0.84, 1.24, 0.78, 1.32, 0.72, 1.4,
        ],
        65..=12_000 => &[1.01, 1.05, 0.97, 1.09, 0.93, 1.14, 0.99, 1.03],
        _ => &[1.01, 1.06, 0.96],
    };
    let mut wanted: Vec<u32> = factors.iter().map(|f| (side * f).ceil() as u32).collect();
    if count <= 64 {
        // A few large charts side by side.
        let [widest, longest] = sides;
        wanted.extend([
            widest,
            2 * widest,
            3 * widest,
            longest,
            2 * longest,
            widest + longest,
        ]);
    }
    // The whole page as a last resort for charts that barely fit.
    if side * 1.2 > f64::from(inner) {
        wanted.push(inner);
    }
    let mut out: Vec<u32> = Vec::new();
    for width in wanted {
        let width = width.clamp(1, inner).max(sides[0]);
        if width <= inner && !out.contains(&width) {
            out.push(width);
        }
    }
    out
}

/// Flattens triangles that rounding has inverted: they are thinner than any texel can show.
fn unfold(mesh: &mut UnwrappedMesh) -> Result<(), UnwrapError> {
    /// Rounding of a corner, texels, with a margin: `f32` is accurate to 1e-3 at 16384 texels.
    const ROUNDING: f64 = 4e-3;
    for c in &mut mesh.corners {
        let twice = signed_area2(c);
        if twice >= 0.0 {
            continue;
        }
        let side = |k: usize| c[k].as_dvec2().distance(c[(k + 1) % 3].as_dvec2());
        let sides = [side(0), side(1), side(2)];
        if -twice > ROUNDING * sides.iter().fold(0.0, |a: f64, &b| a.max(b)) {
            return Err(UnwrapError::Failed("a chart folds over".into()));
        }
        let shortest = (0..3)
            .min_by(|&i, &j| sides[i].total_cmp(&sides[j]))
            .unwrap_or(0);
        c[(shortest + 1) % 3] = c[shortest];
    }
    Ok(())
}
