//! The light at a footprint, as gathered and as passes over the map change it.

use glam::Vec3;
use radiosity::{DirectEstimate, SurfacePoint, World};

use crate::estimate::{Around, Estimate};
use crate::planes::Plane;
use crate::points::Place;

/// Light that a footprint receives.
#[derive(Debug, Clone, Default)]
pub struct Received {
    /// Irradiance directly from lamps and emitters.
    pub direct: Vec3,
    /// Irradiance reflected from surfaces, from the sky, and from wide dim emitters.
    pub indirect: Vec3,
    /// `indirect` from the first half of the points; the other half has 2 × `indirect` − this. The
    /// two are independent estimates.
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
    /// Visible fraction of the footprint, 0..=1; 0 if all of it is inside or behind something.
    pub open: f32,
    /// Gathering and shadow rays cast.
    pub rays: u64,
    /// Whether there is something within the footprint's size.
    pub(crate) near: bool,
    /// Whether many of its rays hit black backfaces, i.e. it is behind a surface that others are in
    /// front of.
    pub(crate) behind: bool,
    /// What surrounds it.
    pub(crate) around: Around,
    /// Whether it is dark and nearly all of its rays escaped or hit black backfaces.
    pub(crate) void: bool,
    /// The edge that crosses the footprint.
    pub(crate) edge: Edge,
    /// Lights whose shadow edge crosses it, as in [`DirectEstimate::mixed`].
    pub(crate) mixed: u32,
    /// Lamps visible from at least one of its points, as a bit mask.
    pub(crate) lit: u32,
    /// Lamps hidden from at least one of its points, as a bit mask.
    pub(crate) hidden: u32,
    /// Lights whose shadows were sampled with the maximum number of points.
    pub(crate) looked: u32,
    /// The quantities of [`Wanted`](crate::Wanted), in its order; empty if there are none.
    pub planes: Box<[Plane]>,
}

/// An edge across a footprint.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Edge {
    /// No edge was found.
    #[default]
    None,
    /// A shadow edge: a light is visible from part of the footprint, or partly visible.
    Shadow,
    /// A contact: something touches the surface or is close to it, so the footprint's points see
    /// different things. The footprint got
    /// [`GatherOptions::edge_points`](crate::GatherOptions::edge_points).
    Contact,
}

impl Edge {
    /// `Shadow` if any light of `mixed` has a shadow edge.
    pub(crate) fn of_shadows(mixed: u32) -> Edge {
        match mixed {
            0 => Edge::None,
            _ => Edge::Shadow,
        }
    }
}

impl Received {
    /// The light found at `place`, in a footprint of `size` metres.
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

    /// The same with recomputed direct light.
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

    /// Total irradiance.
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

    /// The centre of the footprint, as a point of the surface.
    pub(crate) fn point(&self, world: &World) -> SurfacePoint {
        SurfacePoint {
            position: self.position,
            origin: self.position + self.normal * world.offset(self.position),
            normal: self.normal,
            geometric: self.normal,
        }
    }
}
