//! How carefully light is gathered.

use radiosity::DirectOptions;

/// How carefully light is gathered.
#[derive(Debug, Clone, Copy)]
pub struct GatherOptions {
    /// Gathering rays of a footprint at first; a multiple of `points`.
    pub rays: u32,
    /// Points of the footprint that share those rays: a power of two, at most 64. A contact that
    /// covers less than one part in so many is missed.
    pub points: u32,
    /// Points of a footprint that an edge crosses; see
    /// [`Gatherer::gather`](crate::Gatherer::gather). 0 switches the search for edges off.
    pub edge_points: u32,
    /// Treat a footprint whose first `points` disagree as crossed by an edge, and look at its
    /// neighbours again. Else only footprints that lie partly inside or behind something count.
    pub contacts: bool,
    /// Follow the edge of a shadow for so many lumels from where it was found.
    pub follow: u32,
    /// Most rays of a lumel whose neighbours show that `rays` are too few; a power of two times
    /// `rays`.
    pub most_rays: u32,
    /// Cast more rays until the estimated standard error of the indirect light, over all light, is
    /// at most this.
    pub error: f32,
    /// Direct light.
    pub direct: DirectOptions,
    /// Shadow rays from each point to elements that direct light falls on. With 0 only gathering
    /// rays find them.
    pub lit: u32,
    /// Which lumels are interpolated instead of gathered.
    pub interpolation: Interpolation,
    /// Follow rays as paths where they hit something within this many patch sizes. Less is quicker
    /// and blurs light between things that stand close together.
    pub near: f32,
    /// Leave out points inside closed bodies. If a wall splits the footprint, keep its largest
    /// visible part. Else the mean is over all of the footprint.
    pub open_only: bool,
}

/// Which lumels are interpolated between gathered neighbours.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Lumels on flat surfaces with nothing above them within four lumels: their indirect light.
    #[default]
    Open,
    /// Lumels with nothing right beside them: their indirect light. Also their direct light, where no
    /// shadow edge is near and shadow rays to lamps agree with the neighbours'.
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
