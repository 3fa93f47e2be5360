//! The light at a footprint, as gathered and as passes over the map change it.

use glam::Vec3;
use radiosity::{DirectEstimate, SurfacePoint, World};
use serde::{Deserialize, Serialize};

use crate::estimate::{Around, Estimate};
use crate::planes::Plane;
use crate::points::Place;

/// Light that a footprint receives.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(into = "Stored", from = "Stored")]
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
    /// Fraction of its gathering rays that go far: how much it is seen from.
    pub(crate) far: f32,
    /// Gathering and shadow rays cast.
    pub rays: u64,
    /// Whether there is something within the footprint's size.
    pub(crate) near: bool,
    /// Whether many of its rays hit black backfaces, i.e. it is behind a surface that its
    /// neighbours are in front of.
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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
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
            far: 1.0,
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

    /// Whether nobody sees the footprint: it is hidden, or in the void.
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

/// [`Received`] as it is stored: vectors as arrays, and little besides the light as bits.
#[derive(Serialize, Deserialize)]
struct Stored {
    light: [[f32; 3]; 3],
    variances: [f32; 2],
    least: Option<f32>,
    doubt: [f32; 2],
    place: [[f32; 3]; 2],
    size: f32,
    open: f32,
    far: f32,
    rays: u64,
    flags: [bool; 3],
    around: Around,
    edge: Edge,
    /// Mixed, lit, hidden, looked.
    lamps: [u32; 4],
    planes: Vec<[[f32; 3]; 3]>,
}

impl From<Received> for Stored {
    fn from(r: Received) -> Stored {
        let plane = |p: &Plane| [p.direct, p.indirect, p.first_half].map(|v| v.to_array());
        Stored {
            light: [r.direct, r.indirect, r.first_half].map(|v| v.to_array()),
            variances: [r.direct_variance, r.indirect_variance],
            least: r.least,
            doubt: r.direct_doubt,
            place: [r.position, r.normal].map(|v| v.to_array()),
            size: r.size,
            open: r.open,
            far: r.far,
            rays: r.rays,
            flags: [r.near, r.behind, r.void],
            around: r.around,
            edge: r.edge,
            lamps: [r.mixed, r.lit, r.hidden, r.looked],
            planes: r.planes.iter().map(plane).collect(),
        }
    }
}

impl From<Stored> for Received {
    fn from(s: Stored) -> Received {
        let [direct, indirect, first_half] = s.light.map(Vec3::from_array);
        let [direct_variance, indirect_variance] = s.variances;
        let [position, normal] = s.place.map(Vec3::from_array);
        let [near, behind, void] = s.flags;
        let [mixed, lit, hidden, looked] = s.lamps;
        let plane = |p: [[f32; 3]; 3]| {
            let [direct, indirect, first_half] = p.map(Vec3::from_array);
            Plane {
                direct,
                indirect,
                first_half,
            }
        };
        Received {
            direct,
            indirect,
            first_half,
            direct_variance,
            indirect_variance,
            least: s.least,
            direct_doubt: s.doubt,
            position,
            normal,
            size: s.size,
            open: s.open,
            far: s.far,
            rays: s.rays,
            near,
            behind,
            around: s.around,
            void,
            edge: s.edge,
            mixed,
            lit,
            hidden,
            looked,
            planes: s.planes.into_iter().map(plane).collect(),
        }
    }
}
