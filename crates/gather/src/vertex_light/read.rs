//! Light at vertices of small triangles, read from the lightmap.
//!
//! Triangles smaller than a few lumels cannot be fitted to them, but the light around their corners
//! can still be read by a bilinear lookup, at the centre of each corner's part of the triangle. A
//! lookup is trusted if its lumels are on the same surface and agree. Their positions and normals
//! show this: interpolated, they must give the point's own position and normal. This detects
//! lookups across a fold, a gap in the chart or a coarse curve, whatever the reason. Lumels that
//! walls or contacts cross have the light of only a part of them, and are not read.

use std::cell::Cell;

use atlas::{Placement, TexelIndex};
use glam::{DVec2, Vec3};
use radiosity::{DirectLight, SurfacePoint, World, hash_u32, luminance};

use super::moments::LumelLight;
use super::sheet::{Sheet, Tri, corners_of};
use crate::map::LumelMap;
use crate::received::{Edge, Received};

/// Least cosine between normals of lumels and of the point: 60°. On a curve their mean can still be
/// right, which [`SAME_NORMAL`] checks.
const LIKE_NORMAL: f32 = 0.5;

/// Least cosine between the mean of the lumels' normals and the point's own: 15°.
const SAME_NORMAL: f32 = 0.966;

/// Largest distance, in lumels, of the interpolated position from the point, if most of the
/// lookup's weight is present and comes from whole lumels.
const SAME_PLACE: f32 = 0.3;

/// The same at chart borders, where lookups are shifted inwards. There a shadow ray to each lamp
/// that matters must agree with the lumels. On the demo level (with each triangle split into nine),
/// the lookups that this, [`LEAST_WEIGHT`] and [`PART`] admit were closer to gathering with 2048
/// rays than gathering itself with 16 rays (`draft`) and 64 (`preview`), in the median and at the
/// 95th percentile; see lab/profile.md.
const NEAR_PLACE: f32 = 0.75;

/// Fraction of a lookup's weight from trusted lumels that counts as most of it.
const MOST_WEIGHT: f32 = 0.9;

/// Least fraction of a lookup's weight from trusted lumels at chart borders.
const LEAST_WEIGHT: f32 = 0.25;

/// Coverage from which a lumel counts as whole.
const WHOLE: f32 = 0.9;

/// Least coverage of other lumels that are read if no shadow edge crosses them; if one does, the
/// covered part says nothing about the rest.
const PART: f32 = 0.25;

/// Lamps that would contribute less than this fraction of the light need no shadow ray.
const MATTERS: f32 = 0.01;

/// Lumels of a lookup that differ by more than this fraction of their mean cannot be interpolated.
const MOST_SPREAD: f32 = 0.4;

/// Longest edge, in texels, of a triangle for which one lookup represents a corner's part; longer
/// triangles are subdivided for reading.
const LOOKUP: f64 = 2.0;

/// Most subdivisions of an edge; longer triangles are gathered.
const MOST_CUTS: u32 = 6;

/// Place of a lumel, and whether its light may be interpolated with its neighbours'.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LumelPlace {
    position: Vec3,
    normal: Vec3,
    size: f32,
    sure: bool,
    whole: bool,
    /// Lamps visible from all of it, and lamps hidden from all of it, as in [`Received`].
    lamps: [u32; 2],
    /// Whether there is a wall on its right, and below.
    walls: [bool; 2],
}

impl LumelPlace {
    /// By lumel.
    pub(crate) fn find(map: &LumelMap) -> Vec<LumelPlace> {
        (map.received.iter().zip(&map.lumels.lumels).enumerate())
            .map(|(i, (r, lumel))| LumelPlace {
                position: r.position,
                normal: r.normal,
                size: r.size,
                whole: lumel.coverage >= WHOLE,
                lamps: [r.lit & !r.hidden, r.hidden & !r.lit],
                sure: lumel.coverage >= least_coverage(r)
                    && r.open == 1.0
                    && !r.behind
                    && r.edge != Edge::Contact,
                walls: [false, true].map(|down| map.barriers.after(i, down)),
            })
            .collect()
    }
}

/// Coverage from which a lumel with this light is read.
fn least_coverage(r: &Received) -> f32 {
    match r.edge {
        Edge::None => PART,
        _ => WHOLE,
    }
}

/// Sum of the lookups for a point.
#[derive(Clone, Copy, Default)]
struct Sum {
    light: Vec3,
    area: f32,
    border: Option<Border>,
}

/// A lookup at a chart border, and the lamps visible to all lumels there, and hidden from all.
#[derive(Clone, Copy)]
struct Border {
    at: SurfacePoint,
    lamps: [u32; 2],
}

/// Inputs of lookups.
pub(super) struct Reader<'b, 'w, 'a> {
    pub world: &'w World<'a>,
    /// Tells which lamps are hidden.
    pub direct: &'b DirectLight<'w, 'a>,
    pub placement: &'b Placement,
    pub index: &'b TexelIndex,
    pub light: &'b [LumelLight],
    pub places: &'b [LumelPlace],
    /// 1 % of the mean luminance.
    pub floor: f32,
    /// Number of shadow rays.
    pub rays: Cell<u64>,
}

impl Reader<'_, '_, '_> {
    /// For each point, the mean light over its part of the small triangles around it, if the lumels
    /// are sufficient; else `None`.
    pub fn read(&self, sheet: &Sheet) -> Vec<Option<Vec3>> {
        let mut sums = vec![Some(Sum::default()); sheet.points];
        for tri in sheet.tris.iter().filter(|t| !t.moments.measured()) {
            let points = sheet.points_of(tri);
            let cuts = cuts(tri);
            for (k, point) in points.into_iter().enumerate() {
                let Some(sum) = &mut sums[point] else {
                    continue;
                };
                let own = tri.area as f32;
                match cuts.and_then(|cuts| self.corner(tri, k, cuts, &mut sum.border)) {
                    Some(e) => {
                        sum.light += e * own;
                        sum.area += own;
                    }
                    None => sums[point] = None,
                }
            }
        }
        (sums.into_iter().zip(0u32..))
            .map(|(sum, point)| {
                let sum = sum.filter(|s| s.area > 0.0)?;
                let e = sum.light / sum.area;
                if let Some(border) = sum.border {
                    let seed = hash_u32(point ^ hash_u32(sheet.instance as u32));
                    let least = MATTERS * luminance(e);
                    let rays =
                        (self.direct).lamps_seen_as(&border.at, border.lamps, least, seed)?;
                    self.rays.set(self.rays.get() + u64::from(rays));
                }
                Some(e)
            })
            .collect()
    }

    /// The mean over a triangle weighted by corner `k`'s hat function φ, with its edges divided
    /// into `cuts`. Over a part with φ = f₀, f₁, f₂ at its corners, ∫ φ p = A/12 Σ (fⱼ + Σf) pⱼ, so
    /// a lookup at that weighted centre is exact for linear light.
    fn corner(&self, tri: &Tri, k: usize, cuts: u32, border: &mut Option<Border>) -> Option<Vec3> {
        let (triangle, order, back) = corners_of(self.world.soup, tri.face);
        let n = cuts as i32;
        let (mut light, mut total) = (Vec3::ZERO, 0.0f32);
        let mut part = |corners: [[i32; 2]; 3]| -> Option<()> {
            // Barycentric coordinates of the triangle's own corners, corner k first.
            let at = corners.map(|[i, j]| [n - i - j, i, j].map(|x| x as f32 / n as f32));
            let sum = at[0][0] + at[1][0] + at[2][0];
            let mut w = [0.0f32; 3];
            for (j, b) in at.iter().enumerate() {
                let share = (at[j][0] + sum) / (4.0 * sum);
                for (c, b) in b.iter().enumerate() {
                    w[(k + c) % 3] += share * b;
                }
            }
            let mut page = DVec2::ZERO;
            let mut world = [0.0f32; 3];
            for j in 0..3 {
                page += tri.page[j] * f64::from(w[j]);
                world[usize::from(order[j])] = w[j];
            }
            let p = self
                .world
                .surface_point(triangle, world[1], world[2], back, true);
            light += self.lookup(page, &p, border)? * sum;
            total += sum;
            Some(())
        };
        for i in 0..n {
            for j in 0..n - i {
                part([[i, j], [i + 1, j], [i, j + 1]])?;
                if i + j + 2 <= n {
                    part([[i + 1, j], [i + 1, j + 1], [i, j + 1]])?;
                }
            }
        }
        Some(light / total)
    }

    /// The light at a position of the instance's rectangle, which is `p` in the world. Sets
    /// `border` if lamps have to be checked.
    fn lookup(&self, page: DVec2, p: &SurfacePoint, border: &mut Option<Border>) -> Option<Vec3> {
        let q = page - 0.5;
        let base = q.floor();
        let f = (q - base).as_vec2();
        let rect = &self.placement.rect;
        let taps = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| {
            let (column, row) = (base.x as i64 + x, base.y as i64 + y);
            (self.index).at(
                self.placement.page,
                i64::from(rect.x) + column,
                i64::from(rect.y) + row,
            )
        });
        let wall =
            |k: usize, down: bool| taps[k].is_some_and(|i| self.places[i].walls[usize::from(down)]);
        if wall(0, false) || wall(0, true) || wall(1, true) || wall(2, false) {
            return None;
        }
        let weights = [
            (1.0 - f.x) * (1.0 - f.y),
            f.x * (1.0 - f.y),
            (1.0 - f.x) * f.y,
            f.x * f.y,
        ];
        let mut mix = Mix::default();
        for (tap, w) in taps.into_iter().zip(weights) {
            if let Some(i) = tap {
                mix.add(&self.places[i], self.light[i].e, w, p.normal);
            }
        }
        if mix.sum < LEAST_WEIGHT {
            return None;
        }
        let away = (mix.position / mix.sum).distance_squared(p.position);
        let size = mix.size / mix.sum;
        let within = |lumels: f32| away <= (lumels * size) * (lumels * size);
        let [low, high] = mix.range;
        let known = within(NEAR_PLACE)
            && mix.normal.normalize_or_zero().dot(p.normal) >= SAME_NORMAL
            && high - low <= MOST_SPREAD * (0.5 * (high + low) + self.floor);
        if !known {
            return None;
        }
        if !(mix.whole && mix.sum >= MOST_WEIGHT && within(SAME_PLACE)) {
            let border = border.get_or_insert(Border {
                at: *p,
                lamps: mix.lamps,
            });
            border.lamps = [0, 1].map(|k| border.lamps[k] & mix.lamps[k]);
        }
        Some(mix.e / mix.sum)
    }
}

/// Weighted sums over the lumels of a lookup.
struct Mix {
    e: Vec3,
    /// Of weights.
    sum: f32,
    position: Vec3,
    normal: Vec3,
    size: f32,
    /// Least and largest luminance.
    range: [f32; 2],
    /// Whether all lumels are whole.
    whole: bool,
    /// Lamps that all see, and that are hidden from all.
    lamps: [u32; 2],
}

impl Default for Mix {
    fn default() -> Self {
        Mix {
            e: Vec3::ZERO,
            sum: 0.0,
            position: Vec3::ZERO,
            normal: Vec3::ZERO,
            size: 0.0,
            range: [f32::INFINITY, 0.0],
            whole: true,
            lamps: [u32::MAX; 2],
        }
    }
}

impl Mix {
    /// Adds a lumel that faces like `normal`, if its light is sure.
    fn add(&mut self, place: &LumelPlace, e: Vec3, w: f32, normal: Vec3) {
        if !place.sure || place.normal.dot(normal) < LIKE_NORMAL {
            return;
        }
        self.sum += w;
        self.e += e * w;
        self.position += place.position * w;
        self.normal += place.normal * w;
        self.size += place.size * w;
        let y = luminance(e);
        self.range = [self.range[0].min(y), self.range[1].max(y)];
        self.whole &= place.whole;
        self.lamps = [0, 1].map(|k| self.lamps[k] & place.lamps[k]);
    }
}

/// Number of subdivisions of the edges for which one lookup represents each part; `None` without a
/// chart, or if it is too elongated.
fn cuts(tri: &Tri) -> Option<u32> {
    let [a, b, c] = tri.page;
    let longest = (a.distance(b)).max(b.distance(c)).max(c.distance(a));
    let cuts = (longest / LOOKUP).ceil();
    (cuts <= f64::from(MOST_CUTS)).then(|| (cuts as u32).max(1))
}
