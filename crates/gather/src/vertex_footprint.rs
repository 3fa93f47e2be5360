//! The surroundings of a vertex as a footprint.

use radiosity::{SurfacePoint, World};

use crate::footprint::Footprint;

/// The triangles around a vertex, weighted by the vertex's hat function: the mean of E with these
/// weights is what the vertex's colour represents, if light hardly changes over a triangle.
pub(crate) struct VertexFootprint<'b, 'w, 'a> {
    /// The world.
    pub world: &'w World<'a>,
    /// The triangles, at least one.
    pub around: &'b [Spoke],
    /// Scrambles the points.
    pub seed: u32,
}

/// A triangle around a vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spoke {
    /// Index into the [`mesh_ingest::Soup`].
    pub triangle: u32,
    /// The world corner that is the vertex.
    pub corner: u8,
    /// Whether the vertex is lit on the triangle's back.
    pub back: bool,
    /// Total area of this and all previous triangles, m².
    pub running: f32,
}

impl Footprint for VertexFootprint<'_, '_, '_> {
    fn candidate(&self, i: u32) -> Option<SurfacePoint> {
        let s = radiosity::sample_4d(i, 62, self.seed);
        let total = self.around[self.around.len() - 1].running;
        let k = self
            .around
            .partition_point(|a| a.running <= s[0] * total)
            .min(self.around.len() - 1);
        let Spoke {
            triangle,
            corner,
            back,
            ..
        } = self.around[k];
        // Density ∝ b over the triangle: b has density 6b(1−b), whose distribution 3b² − 2b³
        // inverts in closed form.
        let b = 0.5 - libm::sinf(libm::asinf((1.0 - 2.0 * s[1]).clamp(-1.0, 1.0)) / 3.0);
        let mut w = [0.0; 3];
        w[corner as usize] = b;
        w[(corner as usize + 1) % 3] = (1.0 - b) * (1.0 - s[2]);
        w[(corner as usize + 2) % 3] = (1.0 - b) * s[2];
        Some(self.world.inset_point(triangle, w[1], w[2], back, true))
    }

    fn fallback(&self) -> SurfacePoint {
        let first = self.around[0];
        let third = 1.0 / 3.0;
        (self.world).inset_point(first.triangle, third, third, first.back, true)
    }

    fn side(&self) -> Option<(u32, bool)> {
        Some((self.around[0].triangle, self.around[0].back))
    }

    fn size(&self) -> f32 {
        let corners = self.world.soup.triangles[self.around[0].triangle as usize];
        (corners[1] - corners[0]).length()
    }
}
