//! What can be between two patches: a shaft around both (after Haines and Wallace, *Shaft culling
//! for efficient ray-traced radiosity*, 1991, with the two patches' own planes instead of the
//! slanted ones).

use glam::DVec3;

use crate::Patch;

/// Space that contains every segment between two patches, on the front side of both.
#[derive(Debug, Clone)]
pub(crate) struct Shaft {
    low: DVec3,
    high: DVec3,
    planes: [(DVec3, DVec3); 2],
    /// Distances below this are rounding, metres.
    close: f64,
}

impl Shaft {
    /// `None` if no point of either is in front of the other, so they exchange nothing.
    pub(crate) fn new(a: &Patch, b: &Patch) -> Option<Self> {
        let planes = [(a.corners[0], a.normal()), (b.corners[0], b.normal())];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for c in a.corners.iter().chain(&b.corners) {
            (low, high) = (low.min(*c), high.max(*c));
        }
        let close = 1e-13 * low.abs().max(high.abs()).max_element();
        let shaft = Shaft {
            low,
            high,
            planes,
            close,
        };
        (shaft.in_front(0, b) && shaft.in_front(1, a)).then_some(shaft)
    }

    fn in_front(&self, plane: usize, patch: &Patch) -> bool {
        let (o, n) = self.planes[plane];
        patch.corners.iter().any(|c| (*c - o).dot(n) > self.close)
    }

    /// Whether a patch may block some of the light; `false` is certain.
    pub(crate) fn may_cut(&self, patch: &Patch) -> bool {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for c in &patch.corners {
            (low, high) = (low.min(*c), high.max(*c));
        }
        let apart = (low - self.high).max(self.low - high).max_element() > -self.close;
        // A patch that only touches the box on a flat face touches the outside of the shaft, unless
        // it is within that face.
        let flat = (high - low).min_element() <= self.close
            && !(low - self.high)
                .max(self.low - high)
                .cmpgt(DVec3::splat(self.close))
                .any();
        (!apart || flat) && self.in_front(0, patch) && self.in_front(1, patch)
    }
}
