//! Lamps in a tree by position. A receiver treats near and strong lamps one by one and groups of
//! weak ones as single lights, so that a thousand lamps cost little more than some dozens.
//!
//! Based on: Walter and others, *Lightcuts*, 2005. Unlike there, the light of a group is not
//! assumed but sampled: each sample chooses a lamp, so the result is unbiased.

use glam::Vec3;
use mesh_ingest::{Light, LightKind};

use super::sample::falloff;
use crate::divide::lower_part;
use crate::world::luminance;

/// Up to this many lamps are always treated one by one.
const FEW: usize = 16;

/// A group is split if it could contribute more than this share of the unoccluded light: the noise
/// of choosing a lamp, and the shadows that its few samples miss, stay below it.
const SHARE: f32 = 0.01;

/// A group is always split if the receiver is nearer than this many times its radius: a near lamp
/// may be all that a dark room has, while strong ones are hidden.
const NEAR: f32 = 1.5;

/// Most lights of a receiver, and most if near groups must be split: a thousand lamps in one place
/// are all near. Finding them takes the square of this number of steps.
const MOST: usize = 64;
const MOST_NEAR: usize = 256;

/// A lamp, or a group of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Lamps {
    One(u32),
    /// A node of the tree.
    Group(u32),
}

/// The lamps of a scene.
#[derive(Debug, Default)]
pub(crate) struct LampTree {
    /// Lamps that are always treated alone: suns, those of which something is recorded, and all if
    /// there are few. In ascending order.
    alone: Vec<u32>,
    /// The others, by place.
    lamps: Vec<u32>,
    /// The root comes first.
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Bounding sphere of its lamps' positions.
    centre: Vec3,
    radius: f32,
    /// Σ luminance of the intensity.
    power: f32,
    /// Nothing farther than this from the centre gets light; may be infinite.
    reach: f32,
    /// The first of its lamps.
    first: u32,
    /// The second child; the first one follows its parent. 0 for a leaf, which has one lamp.
    second: u32,
}

/// Position and range of a lamp that has one.
fn place(light: &Light) -> Option<(Vec3, f32)> {
    match light.kind {
        LightKind::Directional { .. } => None,
        LightKind::Point {
            position, range, ..
        }
        | LightKind::Spot {
            position, range, ..
        } => {
            let range = range.filter(|r| *r > 0.0);
            Some((position, range.unwrap_or(f32::INFINITY)))
        }
    }
}

/// Luminance of the highest irradiance that a lamp causes within `scale` of a point, apart from its
/// direction; 0 only out of its range.
pub(super) fn weight(light: &Light, p: Vec3, scale: f32) -> f32 {
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
            // The shortest distance between receiver and lamp.
            let d = (p.distance(position) - scale).max(radius.max(1e-3));
            l * falloff(Vec3::X * d, range)
        }
    }
}

impl LampTree {
    /// Lamps that may join others may be treated with them as one. O(n log n) in lamps.
    pub(crate) fn new(lights: &[Light], may_join: impl Fn(usize) -> bool) -> Self {
        let all = 0..lights.len() as u32;
        let may_join = |&k: &u32| place(&lights[k as usize]).is_some() && may_join(k as usize);
        let (mut lamps, alone): (Vec<u32>, Vec<u32>) = all.clone().partition(may_join);
        if lamps.len() <= FEW {
            return LampTree {
                alone: all.collect(),
                ..LampTree::default()
            };
        }
        let mut nodes = Vec::with_capacity(2 * lamps.len());
        let n = lamps.len();
        split(lights, &mut lamps, 0, n, &mut nodes);
        LampTree {
            alone,
            lamps,
            nodes,
        }
    }

    /// The lights of a receiver of size `scale` (metres) at `p`, each with a rough contribution
    /// above 0.
    pub(super) fn cut(&self, lights: &[Light], p: Vec3, scale: f32) -> Vec<(Lamps, f32)> {
        let one = |k: u32| (Lamps::One(k), weight(&lights[k as usize], p, scale));
        let mut out: Vec<(Lamps, f32)> = Vec::with_capacity(self.alone.len() + MOST / 2);
        out.extend(self.alone.iter().map(|&k| one(k)));
        let judge = |id: u32| {
            let node = &self.nodes[id as usize];
            match node.second {
                0 => one(self.lamps[node.first as usize]),
                _ => (Lamps::Group(id), node.weight(p, scale)),
            }
        };
        if !self.nodes.is_empty() {
            out.push(judge(0));
        }
        out.retain(|light| light.1 > 0.0);
        let mut sum: f32 = out.iter().map(|light| light.1).sum();
        loop {
            let widest = (out.iter().enumerate()).filter_map(|(at, (lamps, weight))| {
                let Lamps::Group(id) = *lamps else {
                    return None;
                };
                let near = self.nodes[id as usize].is_near(p, scale) && out.len() < MOST_NEAR;
                let worth = near || (*weight > SHARE * sum && out.len() < MOST);
                worth.then_some((at, id, if near { f32::INFINITY } else { *weight }))
            });
            let Some((at, id, _)) = widest.max_by(|a, b| a.2.total_cmp(&b.2)) else {
                return out;
            };
            sum -= out.swap_remove(at).1;
            for child in [id + 1, self.nodes[id as usize].second] {
                let light = judge(child);
                if light.1 > 0.0 {
                    sum += light.1;
                    out.push(light);
                }
            }
        }
    }

    /// The lamps that, apart from their direction and what hides them, bring at least this share of
    /// all lamps' light to a point, and all suns.
    pub(crate) fn strongest(&self, lights: &[Light], p: Vec3, share: f32) -> Vec<u32> {
        let mut around = self.cut(lights, p, 0.0);
        let is_sun = |lamps: &Lamps| match *lamps {
            Lamps::One(k) => place(&lights[k as usize]).is_none(),
            Lamps::Group(_) => false,
        };
        let of_lamps = around.iter().filter(|(lamps, _)| !is_sun(lamps));
        let least = share * of_lamps.map(|(_, weight)| weight).sum::<f32>();
        around.retain(|(lamps, weight)| is_sun(lamps) || *weight >= least);
        let one = |(lamps, _)| match lamps {
            Lamps::One(k) => Some(k),
            Lamps::Group(_) => None,
        };
        around.into_iter().filter_map(one).collect()
    }

    /// The lamps of a node.
    #[cfg(test)]
    pub(super) fn members(&self, id: u32) -> Vec<u32> {
        let node = &self.nodes[id as usize];
        match node.second {
            0 => vec![self.lamps[node.first as usize]],
            second => [self.members(id + 1), self.members(second)].concat(),
        }
    }

    /// Samples a lamp of a node, roughly in proportion to its contribution at `p`; with its
    /// probability. `None` if none can contribute. `x` ∈ [0, 1). O(log n).
    pub(super) fn pick(&self, lights: &[Light], node: u32, p: Vec3, x: f64) -> Option<(u32, f32)> {
        let (mut id, mut x, mut probability) = (node, x, 1f64);
        loop {
            let node = &self.nodes[id as usize];
            if node.second == 0 {
                return Some((self.lamps[node.first as usize], probability as f32));
            }
            let children = [id + 1, node.second];
            let [a, b] = children.map(|c| {
                let child = &self.nodes[c as usize];
                f64::from(match child.second {
                    0 => weight(&lights[self.lamps[child.first as usize] as usize], p, 0.0),
                    _ => child.weight(p, 0.0),
                })
            });
            if a + b <= 0.0 {
                return None;
            }
            let share = a / (a + b);
            let second = x >= share;
            let (low, part) = if second {
                (share, 1.0 - share)
            } else {
                (0.0, share)
            };
            x = ((x - low) / part).clamp(0.0, 1.0 - f64::EPSILON);
            probability *= part;
            id = children[usize::from(second)];
        }
    }

    /// Calls `see` with each lamp that may cause more than `least` (luminance) at `p`, in an order
    /// that depends on the lamps only, until it returns `None`.
    pub(super) fn each_above(
        &self,
        p: Vec3,
        least: f32,
        mut see: impl FnMut(u32) -> Option<()>,
    ) -> Option<()> {
        self.alone.iter().try_for_each(|&k| see(k))?;
        let mut left: Vec<u32> = if self.nodes.is_empty() {
            Vec::new()
        } else {
            vec![0]
        };
        while let Some(id) = left.pop() {
            let node = &self.nodes[id as usize];
            let nearest = (node.centre.distance(p) - node.radius).max(0.0);
            if node.power <= least * nearest * nearest || nearest + node.radius > node.reach {
                continue;
            }
            match node.second {
                0 => see(self.lamps[node.first as usize])?,
                second => left.extend([second, id + 1]),
            }
        }
        Some(())
    }
}

impl Node {
    /// Rough irradiance from its lamps; 0 only out of their range.
    fn weight(&self, p: Vec3, scale: f32) -> f32 {
        let d = self.centre.distance(p);
        if d > self.reach + scale {
            return 0.0;
        }
        let near = 0.5 * (self.radius + scale);
        self.power / (d * d).max(near * near).max(1e-6)
    }

    fn is_near(&self, p: Vec3, scale: f32) -> bool {
        let reach = NEAR * (self.radius + scale);
        self.centre.distance_squared(p) < reach * reach
    }
}

/// Sorts `lamps[start..end]` and appends their subtree to `nodes`. The depth is O(log n).
fn split(lights: &[Light], lamps: &mut [u32], start: usize, end: usize, nodes: &mut Vec<Node>) {
    let at = |k: u32| place(&lights[k as usize]).unwrap_or_default();
    let part = &mut lamps[start..end];
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for &k in part.iter() {
        low = low.min(at(k).0);
        high = high.max(at(k).0);
    }
    let centre = (low + high) * 0.5;
    let away = |k: u32| at(k).0.distance(centre);
    let id = nodes.len();
    nodes.push(Node {
        centre,
        radius: part.iter().map(|&k| away(k)).fold(0.0, f32::max),
        power: (part
            .iter()
            .map(|&k| luminance(lights[k as usize].intensity)))
        .sum(),
        reach: (part.iter().map(|&k| away(k) + at(k).1)).fold(0.0, f32::max),
        first: start as u32,
        second: 0,
    });
    if part.len() == 1 {
        return;
    }
    let axis = (high - low).max_position();
    let middle = lower_part(part.iter().map(|&k| at(k).0[axis]));
    part.select_nth_unstable_by(middle, |&a, &b| {
        (at(a).0[axis].total_cmp(&at(b).0[axis])).then(a.cmp(&b))
    });
    split(lights, lamps, start, start + middle, nodes);
    nodes[id].second = nodes.len() as u32;
    split(lights, lamps, start + middle, end, nodes);
}
