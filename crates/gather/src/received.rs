//! The light at a footprint, as it is gathered and as passes over the map change it.

use glam::Vec3;
use radiosity::{DirectEstimate, SurfacePoint, World};

use crate::estimate::Estimate;
use crate::planes::Plane;
use crate::points::Place;

/// Light that a footprint receives.
#[derive(Debug, Clone, Default)]
pub struct Received {
    /// Irradiance straight from lamps and emitters.
    pub direct: Vec3,
    /// Irradiance reflected from surfaces, from the sky, and from wide dim emitters.
    pub indirect: Vec3,
    /// `indirect` from the first half of the points alone; the other half has 2 × `indirect` −
    /// this. The two are independent estimates.
    pub(crate) first_half: Vec3,
    /// Estimated variance of the luminance of `direct`.
    pub(crate) direct_variance: f32,
    /// Estimated variance of the luminance of `indirect`.
    pub(crate) indirect_variance: f32,
    /// Set where smoothing brightened the footprint: its luminance before, or the most that its
    /// rays may have missed. Relative errors are taken against this. `None` elsewhere.
    pub(crate) least: Option<f32>,
    /// [`DirectEstimate::doubt`] of `direct`.
    pub(crate) direct_doubt: [f32; 2],
    /// Mean position of the footprint's points, metres, recentred.
    pub(crate) position: Vec3,
    /// Mean shading normal, unit.
    pub(crate) normal: Vec3,
    /// Size of the footprint, metres.
    pub(crate) size: f32,
    /// Share of the footprint that lies in the open, 0..=1; 0 if all of it is inside or behind
    /// something.
    pub open: f32,
    /// Gathering and shadow rays cast.
    pub rays: u64,
    /// Something stands within the footprint's size of it.
    pub(crate) near: bool,
    /// Many of its rays meet black backs: it lies behind what others lie before.
    pub(crate) behind: bool,
    /// It is dark, and nearly all of its rays went where nothing is.
    pub(crate) void: bool,
    /// What crosses the footprint.
    pub(crate) edge: Edge,
    /// Lights whose shadow's edge does, as [`DirectEstimate::mixed`] names them.
    pub(crate) mixed: u32,
    /// Lamps that a point of it sees, and lamps that are hidden from one, by the same bits.
    pub(crate) lit: u32,
    /// See `lit`.
    pub(crate) hidden: u32,
    /// Lights at whose shadows it was looked as closely as at most.
    pub(crate) looked: u32,
    /// What [`Wanted`](crate::Wanted) asks for, in its order; empty where that is nothing.
    pub planes: Box<[Plane]>,
}

/// An edge across a footprint.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Edge {
    /// None was seen.
    #[default]
    None,
    /// Of a shadow: a light is seen from a part of the footprint, or partly.
    Shadow,
    /// Of a thing that touches the surface or stands close to it: what is seen from the points of
    /// the footprint differs. It got
    /// [`GatherOptions::edge_points`](crate::GatherOptions::edge_points).
    Contact,
}

impl Edge {
    /// Of a shadow, where any light of `mixed` has one.
    pub(crate) fn of_shadows(mixed: u32) -> Edge {
        match mixed {
            0 => Edge::None,
            _ => Edge::Shadow,
        }
    }
}

impl Received {
    /// What was found at `place`, in a footprint of `size` metres.
    pub(crate) fn of(
        direct: DirectEstimate,
        indirect: &Estimate,
        planes: Vec<Plane>,
        (place, size): (Place, f32),
    ) -> Received {
        Received {
            direct: direct.irradiance,
            indirect: indirect.mean,
            first_half: indirect.first_half,
            direct_variance: direct.variance,
            indirect_variance: indirect.variance,
            direct_doubt: direct.doubt,
            position: place.position,
            normal: place.normal,
            size,
            open: 1.0,
            rays: u64::from(direct.rays),
            edge: Edge::of_shadows(direct.mixed),
            mixed: direct.mixed,
            lit: direct.lit,
            hidden: direct.hidden,
            planes: planes.into(),
            ..Received::default()
        }
    }

    /// The same with direct light that was looked at again.
    pub(crate) fn with_direct(self, direct: DirectEstimate, planes: Box<[Plane]>) -> Received {
        Received {
            direct: direct.irradiance,
            direct_variance: direct.variance,
            direct_doubt: direct.doubt,
            rays: self.rays + u64::from(direct.rays),
            edge: Edge::of_shadows(direct.mixed),
            mixed: direct.mixed,
            lit: direct.lit,
            hidden: direct.hidden,
            planes,
            ..self
        }
    }

    /// Irradiance.
    pub fn light(&self) -> Vec3 {
        self.direct + self.indirect
    }

    /// Whether nobody looks at the footprint: it is hidden, or lies in the void.
    pub(crate) fn is_unseen(&self) -> bool {
        self.open == 0.0 || self.void
    }

    /// Estimated variance of the light's luminance.
    pub fn variance(&self) -> f32 {
        self.direct_variance + self.indirect_variance
    }

    /// Estimated standard error of the light's luminance.
    pub fn error(&self) -> f32 {
        self.variance().sqrt()
    }

    /// Two independent estimates of `indirect`.
    pub(crate) fn halves(&self) -> [Vec3; 2] {
        [self.first_half, 2.0 * self.indirect - self.first_half]
    }

    /// The middle of the footprint, as a point of the surface.
    pub(crate) fn point(&self, world: &World) -> SurfacePoint {
        SurfacePoint {
            position: self.position,
            origin: self.position + self.normal * world.offset(self.position),
            normal: self.normal,
            geometric: self.normal,
        }
    }
}
