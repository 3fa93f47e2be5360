//! Light at vertices of small triangles, read from the lightmap.
//!
//! Triangles smaller than some lumels cannot be fitted to them, but the light about their corners
//! is there all the same: a bilinear lookup, at the middle of each corner's share of the triangle.
//! A lookup is trusted where its lumels are of the same surface and agree. Whether they are is told
//! by their places: what lumels' positions and normals are interpolated to must be the point's own
//! position and normal. So a lookup that reads across a fold, a gap of the chart or a coarse curve
//! is found out, whatever the reason. Lumels that walls or contacts cross hold the light of a part
//! of them, and are not read at all.

use std::cell::Cell;

use atlas::{Placement, TexelIndex};
use glam::{DVec2, Vec3};
use radiosity::{DirectLight, SurfacePoint, World, hash_u32, luminance};

use super::moments::LumelLight;
use super::sheet::{Sheet, Tri, corners_of};
use crate::map::LumelMap;
use crate::received::{Edge, Received};

/// Lumels' normals may differ from the point's by 60°: on a curve their mean can still be right,
/// which [`SAME_NORMAL`] tells.
const LIKE_NORMAL: f32 = 0.5;

/// Cosine of 15° between the mean of lumels' normals and the point's own.
const SAME_NORMAL: f32 = 0.966;

/// Distance in lumels of the place that was read from the point, where most of the lookup's weight
/// is there and of whole lumels.
const SAME_PLACE: f32 = 0.3;

/// And at charts' borders, where lookups lie a little inside: there a shadow ray to each lamp that
/// matters must find what the lumels found. What this, [`LEAST_WEIGHT`] and [`PART`] let in over
/// the demo level (each triangle split in nine) was nearer to gathering with 2048 rays than
/// gathering itself is, in the median and at the 95th percentile, with 16 rays (`draft`) and with
/// 64 (`preview`); lab/profile.md has the figures.
const NEAR_PLACE: f32 = 0.75;

/// Share of a lookup from lumels that can be trusted which is most of it.
const MOST_WEIGHT: f32 = 0.9;

/// Share of a lookup that must come from such at charts' borders.
const LEAST_WEIGHT: f32 = 0.25;

/// Coverage of whole lumels.
const WHOLE: f32 = 0.9;

/// Coverage of others that are read, where no shadow's edge crosses them: on which side of it a
/// part lies says nothing about the rest.
const PART: f32 = 0.25;

/// Lamps that would bring less than this share of the light are not looked for.
const MATTERS: f32 = 0.01;

/// Lumels of a lookup that differ by more than this share of their mean do not say what lies
/// between them.
const MOST_SPREAD: f32 = 0.4;

/// Longest edge in texels of which one lookup stands for a corner's share; longer triangles are cut
/// for reading.
const LOOKUP: f64 = 2.0;

/// Cuts of an edge at most; longer triangles are gathered at.
const MOST_CUTS: u32 = 6;

/// Where a lumel lies, and whether its light may be read between it and its neighbours.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LumelPlace {
    position: Vec3,
    normal: Vec3,
    size: f32,
    sure: bool,
    whole: bool,
    /// Lamps that all of it sees, and that are hidden from all, as [`Received`] has them.
    lamps: [u32; 2],
    /// A wall stands right of it, and below.
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

/// What was read for a point so far.
#[derive(Clone, Copy, Default)]
struct Sum {
    light: Vec3,
    area: f32,
    border: Option<Border>,
}

/// A place at a chart's border, and the lamps that all lumels there see, and that are hidden from
/// all.
#[derive(Clone, Copy)]
struct Border {
    at: SurfacePoint,
    lamps: [u32; 2],
}

/// What lookups go by.
pub(super) struct Reader<'b, 'w, 'a> {
    pub world: &'w World<'a>,
    /// Says where lamps are hidden.
    pub direct: &'b DirectLight<'w, 'a>,
    pub placement: &'b Placement,
    pub index: &'b TexelIndex,
    pub light: &'b [LumelLight],
    pub places: &'b [LumelPlace],
    /// 1 % of the mean luminance.
    pub floor: f32,
    /// Shadow rays that were cast.
    pub rays: Cell<u64>,
}

impl Reader<'_, '_, '_> {
    /// By point: the mean light over its share of the small triangles about it, where the lumels
    /// know; `None` elsewhere.
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

    /// The mean over a triangle weighted by corner `k`'s hat function φ, its edges cut in `cuts`.
    /// Over a part with φ = f₀, f₁, f₂ at its corners, ∫ φ p = A/12 Σ (fⱼ + Σf) pⱼ: a lookup at
    /// that mean place is exact for light that is linear there.
    fn corner(&self, tri: &Tri, k: usize, cuts: u32, border: &mut Option<Border>) -> Option<Vec3> {
        let (triangle, order, back) = corners_of(self.world.soup, tri.face);
        let n = cuts as i32;
        let (mut light, mut total) = (Vec3::ZERO, 0.0f32);
        let mut part = |corners: [[i32; 2]; 3]| -> Option<()> {
            // Barycentrics of the triangle's own corners, corner k first.
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

    /// The light at a place of the instance's rectangle, which is `p` in the world. Where lamps are
    /// to be looked for, `border` gets to know.
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
        let (mut e, mut sum) = (Vec3::ZERO, 0.0);
        let (mut position, mut normal, mut size) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        let (mut low, mut high) = (f32::INFINITY, 0.0f32);
        let (mut whole, mut lamps) = (true, [u32::MAX; 2]);
        for (tap, w) in taps.into_iter().zip(weights) {
            let Some(i) = tap else {
                continue;
            };
            let place = &self.places[i];
            if !place.sure || place.normal.dot(p.normal) < LIKE_NORMAL {
                continue;
            }
            sum += w;
            e += self.light[i].e * w;
            position += place.position * w;
            normal += place.normal * w;
            size += place.size * w;
            let y = luminance(self.light[i].e);
            (low, high) = (low.min(y), high.max(y));
            whole &= place.whole;
            lamps = [0, 1].map(|k| lamps[k] & place.lamps[k]);
        }
        if sum < LEAST_WEIGHT {
            return None;
        }
        let away = (position / sum).distance_squared(p.position);
        let size = size / sum;
        let within = |lumels: f32| away <= (lumels * size) * (lumels * size);
        let known = within(NEAR_PLACE)
            && normal.normalize_or_zero().dot(p.normal) >= SAME_NORMAL
            && high - low <= MOST_SPREAD * (0.5 * (high + low) + self.floor);
        if !known {
            return None;
        }
        if !(whole && sum >= MOST_WEIGHT && within(SAME_PLACE)) {
            let border = border.get_or_insert(Border { at: *p, lamps });
            border.lamps = [0, 1].map(|k| border.lamps[k] & lamps[k]);
        }
        Some(e / sum)
    }
}

/// In how many parts edges are cut so that one lookup may stand for each; `None` where there is no
/// chart, or it is drawn out too far.
fn cuts(tri: &Tri) -> Option<u32> {
    let [a, b, c] = tri.page;
    let longest = (a.distance(b)).max(b.distance(c)).max(c.distance(a));
    let cuts = (longest / LOOKUP).ceil();
    (cuts <= f64::from(MOST_CUTS)).then(|| (cuts as u32).max(1))
}
