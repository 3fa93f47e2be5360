//! Which lights a receiver takes singly, and how much work each is worth.

use glam::Vec3;
use mesh_ingest::LightKind;

use super::sample::falloff;
use super::{DirectLight, Term};
use crate::world::{SurfacePoint, luminance};

/// Lamps beyond this number share their points by what they bring, as emissive triangles do.
const MANY_LAMPS: usize = 8;

/// A group of emitters is always taken as one when it is seen under less than this angle (radius
/// over distance). At 0.1 the point-to-point kernel varies by at most (1.1/0.9)² over it; the
/// sampling of points inside averages that out.
const FAR_GROUP: f32 = 0.1;

/// A group is always split that the receiver is nearer to than this many times its radius. Further
/// off, the nearest of its emitters is at a fifth of the way to its middle at least; at its border
/// one may be next to the receiver, which the group's weight knows nothing of, and what it brings
/// over a probability so small is a spark.
const NEAR: f32 = 1.5;

/// Marks groups that must be split; above any weight.
const INSIDE: f32 = f32::MAX;

/// Terms where there are more emitters than may count singly: so that each has several points,
/// which see a shadow's edge that one point misses. From 32 to 12 the error of a panel of 10,000
/// squares over boxes fell from 3.2 to 2.6 %, for less work; 4 did no better (lab/emitters.md).
const GROUPS: usize = 12;

/// Terms at most, whatever must be split: a receiver within a cloud of emitters has some dozen
/// nested groups about it.
const MOST_TERMS: usize = 256;

impl<'w> DirectLight<'w, '_> {
    /// How many lamps share the work, and by which parts: `None` where they are few and each gets
    /// all of it. A part is 0 only where the lamp's range ends before the receiver.
    pub(super) fn shares_of_lamps(&self, first: &SurfacePoint, scale: f32) -> Option<Vec<f32>> {
        let lights = &self.world.scene.lights;
        if lights.len() <= MANY_LAMPS {
            return None;
        }
        let mut shares: Vec<f32> = lights
            .iter()
            .map(|light| {
                let l = luminance(light.intensity);
                match light.kind {
                    LightKind::Directional { .. } => l,
                    LightKind::Point {
                        position,
                        range,
                        radius,
                    }
                    | LightKind::Spot {
                        position,
                        range,
                        radius,
                        ..
                    } => {
                        // As near as the receiver comes to it.
                        let d = (first.position.distance(position) - scale).max(radius.max(1e-3));
                        l * falloff(Vec3::X * d, range)
                    }
                }
            })
            .collect();
        let total: f32 = shares.iter().sum();
        if total > 0.0 {
            shares.iter_mut().for_each(|s| *s /= total);
        }
        Some(shares)
    }

    /// Which emissive triangles count singly and which groups whole, at most `most` of both, with
    /// roughly how much each brings.
    ///
    /// A group that the receiver lies within is always split: a point drawn from it may be
    /// arbitrarily near, and 1/d² of that is a spark.
    ///
    /// Starts from all emitters as one group and splits the one whose light is spread widest, until
    /// what is left is either a single triangle or far away, or there are enough (Walter and
    /// others, *Lightcuts*, 2005).
    pub(super) fn emitter_terms(
        &self,
        first: &SurfacePoint,
        scale: f32,
        most: usize,
        terms: &mut Vec<(Term<'w>, f32)>,
    ) {
        let mut nodes = Vec::new();
        self.emitter_nodes(first, scale, most, &mut nodes);
        terms.extend((nodes.into_iter()).map(|(id, weight)| (self.term_of_node(id), weight)));
    }

    /// A node of the emitters' tree as a term.
    pub(super) fn term_of_node(&self, id: u32) -> Term<'w> {
        let node = &self.emitters.nodes[id as usize];
        if node.second == 0 {
            Term::Triangle(&self.emitters.emitters[node.start as usize])
        } else {
            Term::Group(id)
        }
    }

    /// [`emitter_terms`](Self::emitter_terms) by their nodes.
    pub(super) fn emitter_nodes(
        &self,
        first: &SurfacePoint,
        scale: f32,
        most: usize,
        nodes: &mut Vec<(u32, f32)>,
    ) {
        if self.emitters.is_empty() {
            return;
        }
        /// A node with its weight, and how much there is to gain from splitting it.
        type Candidate = (u32, f32, f32);
        // Closed forms while they last; then a few groups with several points each, which see a
        // shadow's edge that one point misses.
        let most = if self.emitters.len() <= most {
            most
        } else {
            most.min(GROUPS)
        };
        let judge = |id: u32| -> Option<Candidate> {
            let node = &self.emitters.nodes[id as usize];
            let weight = node.importance(first.position, first.normal, scale);
            if weight <= 0.0 {
                return None; // below the horizon, or all of it faces away
            }
            if node.second == 0 {
                let e = &self.emitters.emitters[node.start as usize];
                let faces = e.two_sided || e.normal.dot(first.position - e.corners[0]) > -scale;
                return faces.then_some((id, weight, 0.0));
            }
            let reach = node.radius + scale;
            let d2 = node.centre.distance_squared(first.position);
            let far = reach * reach < FAR_GROUP * FAR_GROUP * d2;
            let gain = if far {
                0.0
            } else if NEAR * NEAR * reach * reach > d2 {
                INSIDE
            } else {
                weight * reach * reach / d2
            };
            Some((id, weight, gain))
        };
        let mut cut: Vec<Candidate> = Vec::with_capacity(most + 2);
        cut.extend(judge(0));
        while cut.len() < MOST_TERMS {
            let Some(widest) = (0..cut.len()).max_by(|&a, &b| cut[a].2.total_cmp(&cut[b].2)) else {
                break;
            };
            let (id, _, gain) = cut[widest];
            if gain <= 0.0 || (cut.len() >= most && gain < INSIDE) {
                break;
            }
            cut.swap_remove(widest);
            cut.extend(judge(id + 1));
            cut.extend(judge(self.emitters.nodes[id as usize].second));
        }
        nodes.extend(cut.into_iter().map(|(id, weight, _)| (id, weight)));
    }
}
