//! Lamps whose direct light an engine adds while a game runs: which lightmaps leave them out, and
//! which surfaces have shadow masks for them.

use rayon::prelude::*;

use crate::direct::DirectLight;
use crate::solution::Solution;
use crate::world::World;

/// Channels of a shadow mask.
pub const MASKS: usize = 4;

/// The lamps of each channel of a shadow mask: indices into [`mesh_ingest::Scene::lights`].
pub type MaskLamps = [Option<u32>; MASKS];

/// How lumels treat the direct light of each lamp. Light that surfaces reflect is not affected.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LampRoles {
    /// By light of [`mesh_ingest::Scene::lights`]: whether its direct light is left out.
    pub left_out: Vec<bool>,
    /// By light: its channel in the shadow masks.
    pub channels: Vec<Option<u8>>,
    /// By instance: the lamps that its lumels record in each channel. Empty without masks.
    pub masks: Vec<MaskLamps>,
}

impl LampRoles {
    /// Whether the direct light of light `k` is left out.
    #[inline]
    pub fn leaves_out(&self, k: usize) -> bool {
        self.left_out.get(k).copied().unwrap_or(false)
    }

    /// Gives each of the `mixed` lamps a channel: lamps that reach a common instance
    /// ([`lamps_that_reach`]) get different ones. Greedy colouring: lamps that reach more instances
    /// come first, then lower indices. Returns the lamps for which no channel is left; they have no
    /// mask, and their direct light is not left out.
    pub fn assign_channels(&mut self, mixed: &[usize], reached: &[Vec<bool>]) -> Vec<usize> {
        let instances = reached.first().map_or(0, Vec::len);
        let count = |k: usize| reached[k].iter().filter(|r| **r).count();
        let mut order: Vec<usize> = (0..mixed.len()).collect();
        order.sort_by_key(|&k| (std::cmp::Reverse(count(k)), k));
        self.channels = vec![None; self.left_out.len()];
        self.masks = vec![[None; MASKS]; instances];
        let mut refused = Vec::new();
        for k in order {
            let on = || (0..instances).filter(|&i| reached[k][i]);
            let free = (0..MASKS).find(|&c| on().all(|i| self.masks[i][c].is_none()));
            let Some(c) = free else {
                self.left_out[mixed[k]] = false;
                refused.push(mixed[k]);
                continue;
            };
            self.channels[mixed[k]] = Some(c as u8);
            for i in on() {
                self.masks[i][c] = Some(mixed[k] as u32);
            }
        }
        refused.sort_unstable();
        refused
    }
}

/// For each of `lamps`, the instances that it reaches, i.e. those with an element that sees it. An
/// instance that stands in for others is reached where they are.
pub fn lamps_that_reach(
    world: &World,
    light: &DirectLight,
    solution: &Solution,
    lamps: &[usize],
) -> Vec<Vec<bool>> {
    let scene = world.scene;
    let mut elements: Vec<Vec<(u32, bool)>> = vec![Vec::new(); scene.instances.len()];
    for patch in 0..solution.cut.patches().len() {
        let back = solution.cut.patches()[patch].back;
        for e in (solution.cut).elements_of(patch_subdivision::PatchId(patch as u32)) {
            let triangle = solution.cut.elements()[e].triangle;
            let instance = world.soup.sources[triangle as usize].instance;
            elements[instance as usize].push((e as u32, back));
        }
    }
    let mut out: Vec<Vec<bool>> = (lamps.iter())
        .map(|&lamp| {
            (elements.par_iter())
                .map(|own| {
                    own.iter().any(|&(e, back)| {
                        let e = solution.cut.elements()[e as usize];
                        let point = world.surface_point(e.triangle, e.u, e.v, back, false);
                        light.lamp_is_seen(lamp, &point, e.triangle)
                    })
                })
                .collect()
        })
        .collect();
    for reached in &mut out {
        for (i, instance) in scene.instances.iter().enumerate() {
            if let Some(group) = instance.stands_in {
                reached[i] = scene.firsts[group].iter().any(|&first| reached[first]);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lamps_that_meet_get_different_channels_and_a_fifth_is_refused() {
        let mut roles = LampRoles {
            left_out: vec![true; 7],
            ..LampRoles::default()
        };
        // Lamps 0 to 4 meet on instance 0; 5 and 6 are alone on instances 1 and 2.
        let mut reached = vec![vec![true, false, false]; 5];
        reached[3][1] = true;
        reached.push(vec![false, true, false]);
        reached.push(vec![false, false, true]);
        let mixed: Vec<usize> = (0..7).collect();
        let refused = roles.assign_channels(&mixed, &reached);
        assert_eq!(refused, [4]);
        assert!(!roles.leaves_out(4) && roles.leaves_out(3));
        // Lamp 3 reaches most, so it comes first; 5 meets it.
        let channels = [Some(1), Some(2), Some(3), Some(0), None, Some(1), Some(0)];
        assert_eq!(roles.channels, channels);
        assert_eq!(roles.masks[0], [Some(3), Some(0), Some(1), Some(2)]);
        assert_eq!(roles.masks[1], [Some(3), Some(5), None, None]);
        assert_eq!(roles.masks[2], [Some(6), None, None, None]);
    }
}
