//! Options of a bake.

use gather::{GatherOptions, Gatherer, LightOptions, Wanted};
use glam::Vec3;
use radiosity::{DirectLight, Emitters, Solution, World};
use serde::Serialize;

use crate::manifest::ValueKind;

/// Extra channels of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Layer {
    /// `direct.R/G/B`: light that arrives directly from lamps and emitters.
    Direct,
    /// `indirect.R/G/B`: the rest.
    Indirect,
    /// `radiosity.R/G/B`: reflected radiance, ρE/π.
    Radiosity,
    /// `error.Y`: estimated standard error of the value's luminance.
    Error,
    /// `coverage.Y`: fraction of the texel covered by the surface.
    Coverage,
    /// `ao.Y`: ambient occlusion as openness, i.e. the cosine-weighted fraction of rays that hit
    /// nothing within [`BakeOptions::ao_distance`].
    Ao,
    /// `sun_mask.Y`: visible fraction of the directional lights, 0..=1; 0 on faces turned away.
    SunMask,
}

/// Stored directionality of light, with which engines can light normal maps. Directions are in the
/// glTF's world space.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Directional {
    /// First-order spherical harmonics: `L0.R/G/B`, `L1x.…`, `L1y.…`, `L1z.…`, scaled so that a
    /// surface with normal n gets L0 + L1x nx + L1y ny + L1z nz, in the unit of R, G, B.
    Sh1,
    /// `dominant.X/Y/Z`: the mean direction of light, weighted by luminance. Its length is 1 if all
    /// light comes from one direction, and less otherwise.
    Dominant,
}

/// Options of a bake.
#[derive(Debug, Clone)]
pub struct BakeOptions {
    /// Light at lumels.
    pub lumels: GatherOptions,
    /// Light at vertices. `None` leaves it out: no rays are cast for it, and
    /// [`Baked::vertices`](crate::Baked::vertices) is empty.
    pub vertices: Option<GatherOptions>,
    /// Extra channels in the order in which they are written.
    pub layers: Vec<Layer>,
    /// Number of texels around charts that are dilated.
    pub padding: u32,
    /// Quantity in R, G, B and the light layers.
    pub value: ValueKind,
    /// Directionality to store.
    pub directional: Option<Directional>,
    /// Distance of [`Layer::Ao`], metres; `None` for a tenth of the scene's diagonal.
    pub ao_distance: Option<f32>,
    /// Value of lumels that are partly inside or behind something.
    pub hidden: Hidden,
    /// Whether bilinear lookups on both sides of chart borders are made to agree.
    pub stitch: bool,
    /// Gather until [`LightReport::estimated_error`](gather::LightReport::estimated_error) is at
    /// most this; `None` stops after [`lumels`](Self::lumels).
    pub error: Option<f32>,
    /// Split edges for vertex light until its relative error is about this; `None` keeps the mesh
    /// unchanged.
    pub vertex_error: Option<f32>,
    /// Minimum of R = E/π for every lumel and vertex, per channel; 0 for none. Applied last, to R,
    /// G and B (`L0` gets the difference), not to the layers.
    pub ambient_floor: [f32; 3],
    /// Share of the occlusion of [`Layer::Ao`] that darkens light: 0 for none, 1 for all of it.
    /// Applied to R, G, B, to groups and to [`Directional::Sh1`], not to the layers.
    pub ao_multiply: f32,
}

/// Value of lumels that are partly inside, behind or beyond something.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hidden {
    /// The light of the visible part; lumels without a visible part take their neighbours' light.
    #[default]
    Fill,
    /// The mean over the whole lumel with hidden parts black: an area average over the texel, for
    /// measurements.
    Mean,
}

impl BakeOptions {
    /// A gatherer for lumels with these options.
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

    /// Options of the light at lumels.
    pub(crate) fn light(&self) -> LightOptions {
        LightOptions {
            rings: self.padding + 1,
            error: self.error,
        }
    }

    /// Quantities that lumels record in addition to irradiance.
    pub(crate) fn wanted(&self, world: &World) -> Wanted {
        let roles = world.roles.as_ref();
        let asked = self.wanted_of(Divided {
            groups: world.groups.as_ref().map_or(0, |g| g.count),
            left_out: roles.is_some(),
            masks: roles.is_some_and(|r| !r.masks.is_empty()),
        });
        let far = || self.ao_distance.unwrap_or_else(|| 0.1 * diagonal(world));
        Wanted {
            openness: asked.openness.map(|_| far()),
            ..asked
        }
    }

    /// As [`wanted`](Self::wanted), but openness has no meaningful distance.
    pub(crate) fn wanted_of(&self, divided: Divided) -> Wanted {
        let openness = self.layers.contains(&Layer::Ao) || self.ao_multiply > 0.0;
        Wanted {
            groups: divided.groups,
            moments: self.directional.is_some(),
            openness: openness.then_some(1.0),
            sun: self.layers.contains(&Layer::SunMask),
            kept: divided.left_out,
            masks: divided.masks,
        }
    }
}

/// How the light of a bake is divided.
#[derive(Debug, Clone, Copy, Default)]
pub struct Divided {
    /// Number of light groups; 0 if there are none.
    pub groups: usize,
    /// Whether lamps are left out.
    pub left_out: bool,
    /// Whether there are shadow masks.
    pub masks: bool,
}

/// Diagonal of the scene's bounding box, metres.
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
