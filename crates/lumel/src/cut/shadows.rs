//! Straight edges of the shadows of suns.
//!
//! A lumel that such an edge crosses holds the mean of sun and shade. In a room the sun is a
//! hundred times as bright as the shade, so its patch on a wall grows by a lumel and gets teeth, at
//! any density. If charts end where the edge is, both sides are as they should be.

use glam::Vec3;
use radiosity::{ShadowEdge, Suns};
use rayon::prelude::*;

use super::Level;

/// Edges of shadows whose penumbra is wider than this, in lumels, are soft: a lumel that they cross
/// shows them well.
pub(super) const SOFT: f32 = 0.75;

/// A piece of the edge of a shadow.
pub(super) struct Edge {
    /// A point of it, and where along its normal the shade is complete.
    pub edge: ShadowEdge,
    /// Unit normal of the surface's front.
    pub up: Vec3,
    /// Relative difference of the light.
    pub differ: f32,
    /// Edge of the surface's lumels, metres.
    pub lumel: f32,
    /// A triangle of the surface.
    pub triangle: u32,
}

/// All of them, pair by pair of neighbouring elements.
pub(super) fn find(level: &Level) -> Vec<Edge> {
    let suns = Suns::new(level.world);
    if suns.is_empty() {
        return Vec::new();
    }
    let cut = &level.solution.cut;
    let of_pair = |&pair: &[u32; 2]| {
        let triangle = cut.elements()[pair[0] as usize].triangle;
        let known =
            (level.difference(pair)).and_then(|differ| Some((differ, level.lumel_of(triangle)?)));
        let Some((differ, lumel)) = known else {
            return Vec::new();
        };
        let edges = suns.edges(level.world, &level.points(pair), SOFT * lumel);
        let pieces = edges.into_iter().map(|edge| Edge {
            edge,
            up: level.world.soup.normals[triangle as usize],
            differ,
            lumel,
            triangle,
        });
        pieces.collect()
    };
    let pairs = cut.neighbours();
    let pieces = pairs.par_iter().with_min_len(1024).flat_map_iter(of_pair);
    pieces.collect()
}
