//! The map of lumels that passes of a bake work on.

use radiosity::World;

use crate::barriers::Barriers;
use crate::footprint::LumelFootprint;
use crate::options::Interpolation;
use crate::plan::Plan;
use crate::received::Received;
use atlas::Layout;
use atlas::{Lumel, Lumels, TexelIndex};

/// Lumels: their places, how they lie to each other, and their light. Lists are by lumel.
pub(crate) struct LumelMap {
    pub lumels: Lumels,
    /// Which lumel a texel is.
    pub index: TexelIndex,
    /// Which lumels are interpolated, and between which.
    pub plan: Plan,
    /// Walls between lumels; none until they were looked for.
    pub barriers: Barriers,
    /// Light; empty until the first pass.
    pub received: Vec<Received>,
    /// Times as many rays as at first that a lumel has.
    pub times: Vec<u32>,
}

impl LumelMap {
    /// Finds the lumels of a layout, none of them gathered at.
    pub(crate) fn new(world: &World, layout: &Layout, rule: Interpolation) -> Self {
        let lumels = Lumels::find(world.scene, world.soup, layout);
        let index = TexelIndex::build(&lumels.lumels, layout);
        let count = lumels.lumels.len();
        let plan = match world.is_dark() {
            true => Plan::none(count),
            false => Plan::find(world, &lumels, &index, rule),
        };
        LumelMap {
            lumels,
            index,
            plan,
            barriers: Barriers::default(),
            received: Vec::new(),
            times: vec![1; count],
        }
    }

    /// How many lumels there are.
    pub(crate) fn len(&self) -> usize {
        self.lumels.lumels.len()
    }

    /// The place of lumel `i`.
    pub(crate) fn lumel(&self, i: usize) -> &Lumel {
        &self.lumels.lumels[i]
    }

    /// The footprint of lumel `i`, and the seed of its random numbers.
    pub(crate) fn footprint<'l, 'w, 'a>(
        &'l self,
        world: &'w World<'a>,
        i: usize,
    ) -> (LumelFootprint<'l, 'w, 'a>, u32) {
        LumelFootprint::of(world, &self.lumels, i)
    }

    /// The lumel so many texels from lumel `i`, if it is of the same instance.
    pub(crate) fn beside(&self, i: usize, [dx, dy]: [i64; 2]) -> Option<usize> {
        let l = self.lumel(i);
        let [x, y] = l.texel.map(i64::from);
        let j = self.index.at(l.page, x + dx, y + dy)?;
        (self.lumel(j).instance == l.instance).then_some(j)
    }
}
