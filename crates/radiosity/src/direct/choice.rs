//! Chooses a light at a gathering ray's hit, with a table per patch.
//!
//! A hit takes one sample of direct light. The possible contribution of each light hardly differs
//! over a patch, so the sum over lights that the choice needs is computed once per patch, at the
//! first hit. Computed at each hit, it took five times as long as the shadow ray.

use std::sync::OnceLock;

use glam::Vec3;
use mesh_ingest::{Light, LightKind};
use patch_subdivision::{PatchId, Subdivision};

use super::lamp_tree::Lamps;
use super::sample::falloff;
use super::tally::Tally;
use super::{DirectLight, Term};
use crate::sampling::{hash_u32, sample_4d};
use crate::solution::element_edge;
use crate::world::{SurfacePoint, luminance};

/// Number of emitter groups that a patch distinguishes, unless some must be split further.
const GROUPS: usize = 12;

/// Minimum probability of every light whose range includes the patch, as a share of the rest's
/// probability. The few elements of a patch do not see all of it.
const LEAST: f32 = 0.01;

/// Weight of a light that no element sees. It may be hidden from the elements' points but not
/// everywhere.
const HIDDEN: f32 = 0.1;

/// Patches whose elements' normals are within an angle of this cosine (11°) count as flat.
const FLAT: f32 = 0.98;

/// A source of light.
#[derive(Debug, Clone, Copy)]
enum Source {
    Lamps(Lamps),
    Sky(u32),
    /// A node of the emitter tree.
    Emitters(u32),
}

/// A source, and the cumulative probability up to and including it.
type Choice = (Source, f32);

/// The table of each patch, built at its first hit.
#[derive(Default)]
pub(super) struct Tables(Vec<OnceLock<Box<[Choice]>>>);

impl Tables {
    pub(super) fn new(patches: usize) -> Self {
        Tables(
            std::iter::repeat_with(OnceLock::new)
                .take(patches)
                .collect(),
        )
    }
}

impl<'w> DirectLight<'w, '_> {
    /// Unbiased estimate of the direct irradiance at a point of `patch` with a single shadow ray,
    /// and the light group of the sampled light. Like [`sample_one`](Self::sample_one), but with
    /// the patch's table.
    pub fn sample_on(
        &self,
        cut: &Subdivision,
        patch: PatchId,
        point: &SurfacePoint,
        seed: u32,
    ) -> (Vec3, usize) {
        let Some(table) = self.tables.0.get(patch.0 as usize) else {
            return self.sample_one(point, seed);
        };
        let choices = table.get_or_init(|| self.choices(cut, patch));
        let Some((source, scale)) = draw(choices, seed) else {
            return (Vec3::ZERO, 0);
        };
        let (lit, group) = self.sample_of(source, point, seed);
        (lit * scale, group)
    }

    /// Irradiance at a point from one sample of a light, and the light's group.
    fn sample_of(&self, source: Source, point: &SurfacePoint, seed: u32) -> (Vec3, usize) {
        let mut tally = Tally::single();
        let random = sample_4d(0, 1, seed);
        self.sample(&self.term(source), None, point, random, &mut tally);
        (tally.lit(), tally.group)
    }

    fn term(&self, source: Source) -> Term<'w> {
        match source {
            Source::Lamps(lamps) => self.term_of_lamps(lamps),
            Source::Sky(k) => match &self.world.bright {
                Some(bright) => Term::Sky(&bright.cells[k as usize]),
                None => unreachable!("cell {k} of a sky without bright parts"),
            },
            Source::Emitters(node) => self.term_of_node(node),
        }
    }

    fn choices(&self, cut: &Subdivision, patch: PatchId) -> Box<[Choice]> {
        let back = cut.patches()[patch.0 as usize].back;
        let points: Vec<SurfacePoint> = (cut.elements_of(patch))
            .map(|k| {
                let e = &cut.elements()[k];
                (self.world).inset_point(e.triangle, e.u, e.v, back, false)
            })
            .collect();
        let share = 1.0 / points.len() as f32;
        let middle = SurfacePoint {
            position: points.iter().map(|p| p.position).sum::<Vec3>() * share,
            origin: points[0].origin,
            normal: points[0].normal,
            geometric: points[0].geometric,
        };
        let edge = element_edge(cut, cut.elements()[cut.elements_of(patch).start].triangle);
        let radius = (points.iter())
            .map(|p| p.position.distance(middle.position))
            .fold(0.0, f32::max)
            + edge;
        let flat = points.iter().all(|p| p.normal.dot(middle.normal) > FLAT);
        let normal = if flat { middle.normal } else { Vec3::ZERO };
        let mut nodes = Vec::new();
        let receiver = SurfacePoint { normal, ..middle };
        self.emitter_nodes(&receiver, radius, GROUPS, &mut nodes);
        let lights = &self.world.scene.lights;
        let lamps =
            (self.lamps.cut(lights, middle.position, radius).into_iter()).map(|(lamps, rough)| {
                match lamps {
                    Lamps::One(k) => {
                        let most = at_most(&lights[k as usize], middle.position, radius);
                        (Source::Lamps(lamps), most)
                    }
                    Lamps::Group(_) => (Source::Lamps(lamps), rough),
                }
            });
        let cells = (self.world.bright.iter().flat_map(|b| &b.cells).enumerate())
            .map(|(k, cell)| (Source::Sky(k as u32), cell.power));
        let emitters = (nodes.into_iter()).map(|(id, weight)| (Source::Emitters(id), weight));
        // The (approximate) maximum contribution of each light, followed by its actual contribution
        // to the patch's elements, with one sample at each.
        let mut weights: Vec<(Source, f32, f32)> = (lamps.chain(cells).chain(emitters))
            .filter(|s| s.1 > 0.0)
            .map(|(source, most)| {
                let term = self.term(source);
                let mut tally = Tally::single();
                for (k, p) in points.iter().enumerate() {
                    let random = sample_4d(k as u32, 2, patch.0);
                    self.sample(&term, None, p, random, &mut tally);
                }
                let [lit, all] = tally.luminances(points.len() as u32);
                (source, lit + HIDDEN * (all - lit), most)
            })
            .collect();
        let total: f32 = weights.iter().map(|w| w.1).sum();
        for (_, weight, most) in &mut weights {
            let least = if total > 0.0 { LEAST * total } else { *most };
            *weight += least.min(*most);
        }
        let mut weights: Vec<Choice> = weights.into_iter().map(|w| (w.0, w.1)).collect();
        let mut sum = 0.0;
        for w in &mut weights {
            sum += w.1;
            w.1 = sum;
        }
        weights.into()
    }
}

/// Samples a table. Returns a light and the reciprocal of its probability.
#[inline]
fn draw(choices: &[Choice], seed: u32) -> Option<(Source, f32)> {
    let &(_, total) = choices.last()?;
    let x = hash_u32(seed) as f32 / 4294967296.0 * total;
    let at = choices.partition_point(|c| c.1 <= x).min(choices.len() - 1);
    let below = if at == 0 { 0.0 } else { choices[at - 1].1 };
    let (source, up_to) = choices[at];
    Some((source, total / (up_to - below)))
}

/// Luminance of the highest irradiance that a lamp causes anywhere within `radius` of a point.
fn at_most(light: &Light, at: Vec3, radius: f32) -> f32 {
    let brings = match light.kind {
        LightKind::Directional { .. } => 1.0,
        LightKind::Point {
            position, range, ..
        }
        | LightKind::Spot {
            position, range, ..
        } => {
            let d = (position.distance(at) - radius).max(0.1 * radius).max(1e-6);
            falloff(Vec3::X * d, range)
        }
    };
    luminance(light.intensity) * brings
}
