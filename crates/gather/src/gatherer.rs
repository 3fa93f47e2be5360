//! The inputs of a gather: a scene with its solution, and options.

use std::sync::Arc;

use radiosity::{DirectEstimate, DirectLight, DirectOptions, Known, Solution, World};

use crate::footprint::Footprint;
use crate::options::GatherOptions;
use crate::planes::{Plane, Wanted};
use crate::points::{OpenPoints, Sampling};
use crate::tracer::Tracer;

/// Emissive triangles that are nearer to a point than this fraction of its footprint's size, and rise
/// less than that above it, do not light it. A lamp that stands out of a ceiling by a millimetre
/// lights a hairline beside it, and a lumel would be as bright as its points happen to lie on that
/// line: one to twenty times as bright as the ceiling. Without the first condition a campfire would
/// not light ground of wide lumels, and without the second a plate that stands on the ground would
/// lose 1 % of its light.
const HAIRLINE: f32 = 1.0 / 16.0;

/// Gathers light at footprints.
#[derive(Clone)]
pub struct Gatherer<'w, 'a> {
    pub(crate) tracer: Arc<Tracer<'w, 'a>>,
    /// Accuracy options.
    pub options: GatherOptions,
    /// Quantities to record besides irradiance.
    pub wanted: Wanted,
}

impl<'w, 'a> Gatherer<'w, 'a> {
    /// Gathers from `solution`, which belongs to `world`.
    pub fn new(
        world: &'w World<'a>,
        solution: &'w Solution,
        direct: DirectLight<'w, 'a>,
        options: GatherOptions,
        wanted: Wanted,
    ) -> Self {
        Gatherer {
            tracer: Arc::new(Tracer::new(world, solution, direct, options.lit > 0)),
            options,
            wanted,
        }
    }

    /// The same scene with other options.
    pub(crate) fn with(&self, options: GatherOptions) -> Self {
        Gatherer {
            options,
            ..self.clone()
        }
    }

    /// Memory of precomputed data, bytes.
    pub fn bytes(&self) -> u64 {
        self.tracer.lit.bytes()
    }

    /// The scene.
    pub fn world(&self) -> &'w World<'a> {
        self.tracer.world
    }
}

impl Gatherer<'_, '_> {
    /// The gathering rays of a footprint's points.
    pub(crate) fn sampling(&self, footprint: &impl Footprint, seed: u32) -> Sampling {
        Sampling {
            rays: (self.options.rays / self.options.points.max(1)).max(1),
            before: 0,
            seed,
            reach: footprint.reach(),
            side: footprint.side(),
        }
    }

    /// Direct light on the open points, but for [hairlines](HAIRLINE).
    pub(crate) fn direct_light<F: Footprint>(
        &self,
        mut points: OpenPoints<F>,
        seed: u32,
        options: &DirectOptions,
        known: &Known,
        planes: &mut [Plane],
    ) -> DirectEstimate {
        let masks = points.instance().map(|i| self.world().mask_lamps(i));
        let mut parts = self.wanted.direct_parts(masks.unwrap_or_default());
        let (seed, size) = (seed ^ 0x68bc_21eb, points.size());
        let known = &Known {
            beside: HAIRLINE * size,
            ..*known
        };
        let point = |i: u32| points.get(i);
        let lights = &self.tracer.direct;
        let out = lights.irradiance_parts(point, size, seed, options, known, &mut parts);
        self.wanted.place_direct(&parts, planes);
        out
    }
}

/// Known before direct light is computed: luminance of the rest, and lights to sample densely.
pub(crate) fn known(light: f32, look: u32) -> Known {
    Known {
        light,
        look,
        ..Known::default()
    }
}
