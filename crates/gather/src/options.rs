//! How carefully light is gathered.

use radiosity::DirectOptions;

/// How carefully light is gathered.
#[derive(Debug, Clone, Copy)]
pub struct GatherOptions {
    /// Gathering rays a footprint gets at least; a multiple of `points`.
    pub rays: u32,
    /// Points of the footprint that share those rays, at most 64, a power of two. Contacts smaller
    /// than one part in so many go unseen.
    pub points: u32,
    /// Points of a footprint that an edge crosses; see
    /// [`Gatherer::gather`](crate::Gatherer::gather). None are looked for with 0.
    pub edge_points: u32,
    /// Footprints whose first `points` disagree are such too, and those beside them are looked at
    /// again. Else only those that lie in part inside or behind something.
    pub contacts: bool,
    /// So many lumels from where it was found a shadow's edge is followed.
    pub follow: u32,
    /// Rays that a lumel gets at most where neighbours say that `rays` are too few; a power of two
    /// times `rays`.
    pub most_rays: u32,
    /// Good enough: estimated standard error of the indirect light over the total.
    pub error: f32,
    /// Direct light.
    pub direct: DirectOptions,
    /// Shadow rays of each point to elements that direct light falls on; with 0 gathering rays find
    /// them.
    pub lit: u32,
    /// Where lumels are interpolated instead.
    pub interpolation: Interpolation,
    /// A ray's hit is near, and the ray goes on as a path, within this many patches' size. Less is
    /// quicker, and blurs what stands close to each other.
    pub near: f32,
    /// Only what can be seen counts: sub-points inside closed things are left out of the mean, and
    /// of a footprint that a wall divides into a bright and a dark part, the bright one is. Else
    /// the mean is over all of the footprint, buried or not.
    pub open_only: bool,
}

/// Which lumels are not gathered at, but lie between others that are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Those on flat surfaces that nothing rises from within four lumels: their indirect light.
    #[default]
    Open,
    /// Those that nothing stands right beside: their indirect light, and the direct light too where
    /// no shadow's edge is near and shadow rays to lamps agree with the neighbours'.
    Wide,
}

/// How far the light at lumels is taken.
#[derive(Debug, Clone, Copy)]
pub struct LightOptions {
    /// So many lumels deep hidden ones take the light of those that are seen: as far as lookups
    /// read.
    pub rings: u32,
    /// Gather on until [`LightReport::estimated_error`](crate::LightReport::estimated_error) is at
    /// most this; `None` stops where the [`GatherOptions`] say.
    pub error: Option<f32>,
}

/// How light at vertices is made.
#[derive(Debug, Clone, Copy)]
pub struct VertexOptions {
    /// Light at triangles that are too small for lumels.
    pub gather: GatherOptions,
    /// Split edges until the relative error is about this; `None` keeps the mesh as it is.
    pub error: Option<f32>,
}
