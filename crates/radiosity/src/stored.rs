//! A solution without its patches, for other processes that divide the same scene again.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::openings::Openings;
use crate::relax::RelaxStep;
use crate::solution::{GroupLight, Solution, SolveReport, SolveStep};
use crate::solve::{Divided, SolveOptions, divide};
use crate::world::World;

/// The light of a [`Solution`]: what is expensive about it. Patches and elements follow from the
/// scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StoredSolution {
    direct: Vec<[f32; 3]>,
    reflectance: Vec<[f32; 3]>,
    direct_mean: Vec<[f32; 3]>,
    indirect: Vec<[f32; 3]>,
    rough: Vec<bool>,
    openings: Openings,
    /// Number of groups, and their light.
    groups: Option<(usize, [Vec<[f32; 3]>; 3])>,
    /// Without its history, whose JSON form binary formats do not have.
    report: SolveReport,
    history: Vec<(u32, RelaxStep)>,
}

fn arrays(v: &[Vec3]) -> Vec<[f32; 3]> {
    v.iter().map(|v| v.to_array()).collect()
}

fn vectors(v: Vec<[f32; 3]>) -> Vec<Vec3> {
    v.into_iter().map(Vec3::from_array).collect()
}

impl StoredSolution {
    /// The light of a solution.
    pub fn of(solution: &Solution) -> StoredSolution {
        let groups = |g: &GroupLight| {
            let light = [&g.direct, &g.direct_mean, &g.indirect].map(|v| arrays(v));
            (g.count, light)
        };
        let mut report = solution.report.clone();
        let history = std::mem::take(&mut report.history);
        StoredSolution {
            direct: arrays(&solution.direct),
            reflectance: arrays(&solution.reflectance),
            direct_mean: arrays(&solution.direct_mean),
            indirect: arrays(&solution.indirect),
            rough: solution.rough.clone(),
            openings: solution.openings.clone(),
            groups: solution.groups.as_ref().map(groups),
            report,
            history: history.iter().map(|s| (s.rays, s.step)).collect(),
        }
    }

    /// The solution, on the patches of `world`; `None` if those are not the ones that it was stored
    /// for. `options` are those of the solve.
    pub fn restore(self, world: &World, options: &SolveOptions) -> Option<Solution> {
        let Divided { cut, .. } = divide(world, options);
        let (patches, elements) = (cut.patches().len(), cut.elements().len());
        let fits = self.direct.len() == elements
            && self.reflectance.len() == elements
            && self.direct_mean.len() == patches
            && self.indirect.len() == patches
            && self.rough.len() == patches
            && self.openings.fits(patches)
            && self.groups.as_ref().is_none_or(|(count, light)| {
                let [direct, mean, indirect] = light.each_ref().map(Vec::len);
                [direct, mean, indirect] == [elements * count, patches * count, patches * count]
            });
        if !fits {
            return None;
        }
        let history = self.history.into_iter();
        let mut solution = Solution {
            cut,
            direct: vectors(self.direct),
            reflectance: vectors(self.reflectance),
            direct_mean: vectors(self.direct_mean),
            indirect: vectors(self.indirect),
            rough: self.rough,
            groups: self.groups.map(|(count, light)| {
                let [direct, direct_mean, indirect] = light.map(vectors);
                GroupLight {
                    count,
                    direct,
                    direct_mean,
                    indirect,
                }
            }),
            afar: Vec::new(),
            openings: self.openings,
            report: SolveReport {
                history: history
                    .map(|(rays, step)| SolveStep { rays, step })
                    .collect(),
                ..self.report
            },
        };
        solution.refresh(world);
        Some(solution)
    }
}
