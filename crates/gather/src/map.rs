//! The map of lumels that the passes of a bake work on.

use atlas::{Layout, Lumel, Lumels, TexelIndex};
use radiosity::World;

use crate::barriers::Barriers;
use crate::footprint::LumelFootprint;
use crate::options::Interpolation;
use crate::plan::Plan;
use crate::received::Received;

/// Lumels: their places, neighbours and light. Lists are by lumel.
pub struct LumelMap {
    pub(crate) lumels: Lumels,
    /// The lumel of each texel.
    pub(crate) index: TexelIndex,
    /// The interpolated lumels, and the lumels that they are interpolated between.
    pub(crate) plan: Plan,
    /// Walls between lumels; none until they are searched for.
    pub(crate) barriers: Barriers,
    /// Light; empty until the first pass.
    pub(crate) received: Vec<Received>,
    /// Factor on the initial number of rays of each lumel.
    pub(crate) times: Vec<u32>,
    /// Whether it has the lumels of each instance.
    pub(crate) has: Vec<bool>,
}

impl LumelMap {
    /// Finds the lumels of these instances, in rising order, without gathering.
    pub fn of(
        world: &World,
        layout: &Layout,
        rule: Interpolation,
        instances: impl IntoIterator<Item = usize>,
    ) -> Self {
        let mut has = vec![false; world.scene.instances.len()];
        let instances = instances.into_iter().inspect(|&i| has[i] = true);
        let lumels = Lumels::find_of(world.scene, world.soup, layout, instances);
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
            has,
        }
    }

    /// Whether it has the lumels of this instance.
    pub(crate) fn has(&self, instance: usize) -> bool {
        self.has[instance]
    }

    /// Number of lumels.
    pub fn len(&self) -> usize {
        self.lumels.lumels.len()
    }

    /// Whether there are no lumels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The lumels, without their light.
    pub fn lumels(&self) -> &Lumels {
        &self.lumels
    }

    /// The light of each lumel; empty before the first pass.
    pub fn received(&self) -> &[Received] {
        &self.received
    }

    /// Whether lumel `i` is gathered; before the first pass, whether it certainly is.
    pub fn is_gathered(&self, i: usize) -> bool {
        self.plan.is_gathered(i)
    }

    /// Memory of lumels and their planes, bytes.
    pub fn bytes(&self) -> u64 {
        let planes = |r: &Received| size_of_val(&*r.planes) as u64;
        self.lumels.bytes() + self.received.iter().map(planes).sum::<u64>()
    }

    /// The place of lumel `i`.
    pub(crate) fn lumel(&self, i: usize) -> &Lumel {
        &self.lumels.lumels[i]
    }

    /// The footprint of lumel `i`, and the seed of its random numbers.
    pub fn footprint<'l, 'w, 'a>(
        &'l self,
        world: &'w World<'a>,
        i: usize,
    ) -> (LumelFootprint<'l, 'w, 'a>, u32) {
        LumelFootprint::of(world, &self.lumels, i)
    }

    /// The lumel at this offset in texels from lumel `i`, if it belongs to the same instance.
    pub(crate) fn beside(&self, i: usize, [dx, dy]: [i64; 2]) -> Option<usize> {
        let l = self.lumel(i);
        let [x, y] = l.texel.map(i64::from);
        let j = self.index.at(l.page, x + dx, y + dy)?;
        (self.lumel(j).instance == l.instance).then_some(j)
    }
}
