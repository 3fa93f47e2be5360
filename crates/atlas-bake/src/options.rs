//! How a scene is baked.

use gather::{GatherOptions, Gatherer, LightOptions, Wanted};
use glam::Vec3;
use radiosity::{DirectLight, Emitters, Solution, World};
use serde::Serialize;

use crate::manifest::ValueKind;

/// Extra channels of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Layer {
    /// `direct.R/G/B`: light straight from lamps and emitters.
    Direct,
    /// `indirect.R/G/B`: the rest.
    Indirect,
    /// `radiosity.R/G/B`: what the lumel sends on, ρE/π.
    Radiosity,
    /// `error.Y`: estimated standard error of the value's luminance.
    Error,
    /// `coverage.Y`: share of the texel that lies on the surface.
    Coverage,
    /// `ao.Y`: ambient occlusion, as openness: the cosine-weighted share of rays that meet nothing
    /// within [`BakeOptions::ao_distance`].
    Ao,
    /// `sun_mask.Y`: share of the light of directional lights that gets through, 0..=1; 0 on faces
    /// turned away.
    SunMask,
}

/// What a lightmap keeps of the directions that light comes from, so that engines can light normal
/// maps. Directions are in the axes of the glTF's world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Directional {
    /// Spherical harmonics of first order: `L0.R/G/B`, `L1x.…`, `L1y.…`, `L1z.…`, scaled so that a
    /// surface with normal n gets L0 + L1x nx + L1y ny + L1z nz, in the unit of R, G, B.
    Sh1,
    /// `dominant.X/Y/Z`: the mean direction of light, weighted by luminance. Its length is 1 where
    /// all light comes from one side and less where it does not.
    Dominant,
}

/// How a scene is baked.
#[derive(Debug, Clone)]
pub struct BakeOptions {
    /// Light at lumels.
    pub lumels: GatherOptions,
    /// Light at vertices; `None` leaves it out: no ray is cast for it, and
    /// [`Baked::vertices`](crate::Baked::vertices) is empty.
    pub vertices: Option<GatherOptions>,
    /// Extra channels, in the order in which they are to be written.
    pub layers: Vec<Layer>,
    /// Texels around charts that take their neighbours' value.
    pub padding: u32,
    /// What R, G, B (and the light layers) hold.
    pub value: ValueKind,
    /// Keep the directions of light.
    pub directional: Option<Directional>,
    /// How far [`Layer::Ao`] looks, metres; `None` for a tenth of the scene's diagonal.
    pub ao_distance: Option<f32>,
    /// What lumels hold of which a part lies inside or behind something.
    pub hidden: Hidden,
    /// Make bilinear lookups on both sides of chart borders agree.
    pub stitch: bool,
    /// Gather on until [`LightReport::estimated_error`](gather::LightReport::estimated_error) is at
    /// most this; `None` stops where [`lumels`](Self::lumels) says.
    pub error: Option<f32>,
    /// Split edges for vertex light until its relative error is about this; `None` keeps the mesh
    /// as it is.
    pub vertex_error: Option<f32>,
}

/// What lumels hold of which a part lies inside or behind something, or beyond a wall.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hidden {
    /// The light of the part that can be seen; lumels of which nothing can be seen take their
    /// neighbours'.
    #[default]
    Fill,
    /// The mean over all of it, hidden parts being dark: what an area average over the texel says,
    /// for measuring.
    Mean,
}

impl BakeOptions {
    /// Gathers at lumels as these options say.
    pub(crate) fn gatherer<'w, 'a>(
        &self,
        world: &'w World<'a>,
        emitters: &'w Emitters,
        solution: &'w Solution,
    ) -> Gatherer<'w, 'a> {
        let options = GatherOptions {
            open_only: self.hidden == Hidden::Fill,
            ..self.lumels
        };
        let direct = DirectLight::new(world, emitters);
        Gatherer::new(world, solution, direct, options, self.wanted(world))
    }

    /// How far the light at lumels is taken.
    pub(crate) fn light(&self) -> LightOptions {
        LightOptions {
            rings: self.padding + 1,
            error: self.error,
        }
    }

    /// What lumels are to keep beside their irradiance.
    pub(crate) fn wanted(&self, world: &World) -> Wanted {
        Wanted {
            groups: world.groups.as_ref().map_or(0, |g| g.count),
            moments: self.directional.is_some(),
            openness: (self.layers.contains(&Layer::Ao))
                .then(|| self.ao_distance.unwrap_or_else(|| 0.1 * diagonal(world))),
            sun: self.layers.contains(&Layer::SunMask),
        }
    }
}

/// Of the box about the scene, metres.
fn diagonal(world: &World) -> f32 {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for p in world.soup.seen_triangles().iter().flatten() {
        (low, high) = (low.min(*p), high.max(*p));
    }
    if world.soup.is_empty() {
        0.0
    } else {
        (high - low).length()
    }
}
