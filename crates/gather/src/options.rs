//! Accuracy of gathering.

use radiosity::DirectOptions;

/// Accuracy of gathering.
#[derive(Debug, Clone, Copy)]
pub struct GatherOptions {
    /// Initial gathering rays per footprint; a multiple of `points`.
    pub rays: u32,
    /// Points of the footprint that share those rays: a power of two, at most 64. A contact that
    /// covers less than one part in `points` is missed.
    pub points: u32,
    /// Points of a footprint that an edge crosses; see
    /// [`Gatherer::gather`](crate::Gatherer::gather). 0 disables the search for edges.
    pub edge_points: u32,
    /// Whether a footprint whose first `points` disagree counts as crossed by an edge. Otherwise
    /// only footprints partly inside or behind something do.
    pub contacts: bool,
    /// Follow shadow edges for this many lumels from where they were found.
    pub follow: u32,
    /// Most rays of a lumel whose neighbours show that `rays` are too few; a power of two times
    /// `rays`. Very noisy ones get up to eight times `rays`, unless this is `rays`.
    pub most_rays: u32,
    /// Cast more rays until the estimated standard error of indirect light, relative to all light,
    /// is at most this.
    pub error: f32,
    /// Direct light.
    pub direct: DirectOptions,
    /// Shadow rays from each point to elements lit by direct light. With 0 only gathering rays find
    /// them.
    pub lit: u32,
    /// Which lumels are interpolated instead of gathered.
    pub interpolation: Interpolation,
    /// Indirect light that varies by at most this over 8 × 8 lumels of an open surface, relative to
    /// all light, is taken from nine samples; 0 never does so but in the dark.
    pub calm: f32,
    /// Rays continue as paths if they hit something within this many patch sizes. Less is faster,
    /// and blurs light between nearby objects.
    pub near: f32,
    /// Leave out points inside closed bodies. If a wall splits the footprint, keep its largest
    /// visible part. Else the mean is over all of the footprint.
    pub open_only: bool,
    /// Texels of a tile, i.e. of what is in memory at a time; [`TILE`](crate::TILE) unless memory
    /// is to be tested. Another value gives other noise.
    pub tile: u64,
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

/// Passes after the gather.
#[derive(Debug, Clone, Copy)]
pub struct LightOptions {
    /// Depth in lumels to which hidden ones take the light of visible ones, i.e. as far as lookups
    /// read.
    pub rings: u32,
    /// Gather until [`LightReport::estimated_error`](crate::LightReport::estimated_error) is at
    /// most this; `None` stops after [`GatherOptions`].
    pub error: Option<f32>,
}

/// Options of light at vertices.
#[derive(Debug, Clone, Copy)]
pub struct VertexOptions {
    /// Gathering at triangles that are too small for lumels.
    pub gather: GatherOptions,
    /// Split edges until the relative error is about this; `None` keeps the mesh unchanged.
    pub error: Option<f32>,
}
