//! Which lights a receiver treats individually, and how many samples each gets.

use super::lamp_tree::Lamps;
use super::{DirectLight, Term};
use crate::sampling::hash_u32;
use crate::world::SurfacePoint;

/// More lamps than this share their points by contribution, as emissive triangles do.
const MANY_LAMPS: usize = 8;

/// A group of emitters is always treated as one if its angular size (radius over distance) is below
/// this. At 0.1, the point-to-point kernel varies by at most (1.1/0.9)² over the group, which
/// sampling points inside it averages out.
const FAR_GROUP: f32 = 0.1;

/// A group is always split if the receiver is nearer than this many times its radius. Beyond that,
/// its nearest emitter is at least a fifth of the way to its centre away. At the group's border, an
/// emitter may be next to the receiver; the group's weight does not reflect that, and dividing by
/// such a small probability causes fireflies.
const NEAR: f32 = 1.5;

/// Marks groups that must be split; larger than any weight.
const INSIDE: f32 = f32::MAX;

/// Number of terms if there are more emitters than can be treated individually. Each term then has
/// several points, which see a shadow edge that one point misses. Going from 32 to 12 reduced the
/// error of a panel of 10,000 squares over boxes from 3.2 % to 2.6 %, with less work; 4 was no
/// better (lab/emitters.md).
const GROUPS: usize = 12;

/// Maximum number of terms, whatever must be split. A receiver inside a cloud of emitters is inside
/// some dozens of nested groups.
const MOST_TERMS: usize = 256;

/// The weakest groups of a receiver that together could contribute at most this share of the
/// unoccluded light are represented by at most one sample.
pub(super) const REST: f32 = 0.01;

/// A group drawn to stand for others, and the probability of having drawn it.
pub(super) type Rest<T> = (T, f32);

/// Removes the weakest groups, if there are several, from `lights`, which have rough contributions,
/// and may return one of them, each with a probability in proportion to its contribution. The
/// probabilities add up to 1 only if the groups contribute [`REST`] of the `total`, so a sample
/// always stands for that much: receivers seldom look for far lights that hardly matter.
pub(super) fn draw_rest<T: Copy>(
    lights: &mut Vec<(T, f32)>,
    is_group: impl Fn(T) -> bool,
    total: f32,
    seed: u32,
) -> Option<Rest<T>> {
    // Groups last, and the weakest of them at the end.
    let order = |light: &(T, f32)| {
        if is_group(light.0) {
            light.1
        } else {
            f32::INFINITY
        }
    };
    lights.sort_by(|a, b| order(b).total_cmp(&order(a)));
    let most = REST * total;
    let mut sum = 0.0;
    let weak = (lights.iter().rev())
        .take_while(|light| {
            sum += order(light);
            sum <= most
        })
        .count();
    if weak < 2 {
        return None;
    }
    let mut left = hash_u32(seed) as f32 / 4294967296.0 * most;
    let rest = lights.split_off(lights.len() - weak);
    let (light, weight) = rest.into_iter().find(|light| {
        left -= light.1;
        left < 0.0
    })?;
    Some((light, weight / most))
}

impl<'w> DirectLight<'w, '_> {
    /// The lamps and groups of lamps of a receiver, with the share of the samples that each gets: all
    /// of them if there are few. Also the group drawn from the weakest ([`draw_rest`]).
    pub(super) fn lamps_of(
        &self,
        first: &SurfacePoint,
        scale: f32,
        seed: u32,
    ) -> (Vec<(Lamps, f32)>, Option<Rest<Lamps>>) {
        let lights = &self.world.scene.lights;
        if lights.len() <= MANY_LAMPS {
            let each = (0..lights.len() as u32).map(|k| (Lamps::One(k), 1.0));
            return (each.collect(), None);
        }
        let mut lamps = self.lamps.cut(lights, first.position, scale);
        let total: f32 = lamps.iter().map(|light| light.1).sum();
        lamps.iter_mut().for_each(|light| light.1 /= total);
        let is_group = |lamps| matches!(lamps, Lamps::Group(_));
        let rest = draw_rest(&mut lamps, is_group, 1.0, seed);
        (lamps, rest)
    }

    /// A lamp or a group of lamps as a term.
    pub(super) fn term_of_lamps(&self, lamps: Lamps) -> Term<'w> {
        match lamps {
            Lamps::One(k) => {
                let k = k as usize;
                Term::Lamp(&self.world.scene.lights[k], self.world.lamp_group(k))
            }
            Lamps::Group(node) => Term::Lamps(node, 1.0),
        }
    }

    /// Chooses at most `most` emissive triangles and groups, each with a rough contribution.
    ///
    /// A group that contains the receiver is always split: a point sampled from it may be
    /// arbitrarily near, and its 1/d² causes a firefly.
    ///
    /// Starts with all emitters as one group and repeatedly splits the group with the largest
    /// spread, until each group is a single triangle or distant, or there are enough groups (Walter
    /// and others, *Lightcuts*, 2005).
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

    /// A node of the emitter tree as a term.
    pub(super) fn term_of_node(&self, id: u32) -> Term<'w> {
        let node = &self.emitters.nodes[id as usize];
        if node.second == 0 {
            Term::Triangle(&self.emitters.emitters[node.start as usize])
        } else {
            Term::Group(id, 1.0)
        }
    }

    /// The nodes of [`emitter_terms`](Self::emitter_terms).
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
        /// A node with its weight, and the gain from splitting it.
        type Candidate = (u32, f32, f32);
        // Closed forms for as many emitters as allowed. With more emitters, few groups with several
        // points each, which see a shadow edge that one point misses.
        let most = if self.emitters.len() <= most {
            most
        } else {
            most.min(GROUPS)
        };
        let judge = |id: u32| -> Option<Candidate> {
            let node = &self.emitters.nodes[id as usize];
            let weight = node.importance(first.position, first.normal, scale);
            if weight <= 0.0 {
                return None; // below the horizon, or faces away entirely
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
