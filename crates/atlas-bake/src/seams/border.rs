//! Borders of charts: edges of lightmap triangles at which the chart ends.

use glam::{Vec2, Vec3};
use radiosity::World;
use rayon::prelude::*;

use atlas::{Layout, Lumels};

/// A straight piece of a chart border.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    /// Ends, metres, recentred.
    pub world: [Vec3; 2],
    /// The same ends on the page, texels.
    pub texels: [Vec2; 2],
    /// Page.
    pub page: u32,
    /// Soup triangle that the piece belongs to.
    pub triangle: u32,
    /// Barycentric coordinates (of world corners 1 and 2) at the ends.
    pub weights: [Vec2; 2],
    /// Unit vector into the triangle, in its plane and perpendicular to the edge.
    pub inward: Vec3,
    /// Altitude of the triangle above the edge, metres.
    pub altitude: f32,
    /// Length of the whole edge, metres.
    pub edge: f32,
    /// Size of a texel there, metres.
    pub texel: f32,
}

/// Longest piece, texels. Short pieces have small bounding boxes, however long and slanted the edge
/// is. If overlapping charts have more border than the pages have texels, pieces become longer, so
/// that their number stays bounded.
const LONGEST: f32 = 16.0;

/// The borders of all charts of all instances, in the order of the soup's triangles.
///
/// An edge is interior if another triangle of the chart has an edge with the same two lightmap
/// positions, whether or not they share vertices. Triangles without area in the lightmap have no
/// lookups and no borders. There are at most as many pieces as edges plus a sixteenth of the pages'
/// texels.
pub(crate) fn border_pieces(world: &World, layout: &Layout, lumels: &Lumels) -> Vec<Piece> {
    let edges: Vec<[u32; 3]> = (0..world.scene.instances.len())
        .into_par_iter()
        .flat_map_iter(|i| instance_edges(world, layout, lumels, i))
        .collect();
    let length = |&[_, t, k]: &[u32; 3]| {
        let corners = lumels.page_corners(t);
        f64::from((corners[(k as usize + 1) % 3] - corners[k as usize]).length())
    };
    let all: f64 = edges.iter().map(length).sum();
    let longest = LONGEST * ((all / layout.texels()) as f32).max(1.0);
    let mut out = Vec::new();
    for [page, t, k] in edges {
        let corners = lumels.page_corners(t);
        cut(world, corners, page, t, k as usize, longest, &mut out);
    }
    out
}

/// Chart, end positions in ascending order, triangle, corner where the edge starts.
type Edge = (u32, [u32; 2], [u32; 2], u32, u32);

/// Page, triangle and starting corner of each edge that is a border.
fn instance_edges(
    world: &World,
    layout: &Layout,
    lumels: &Lumels,
    instance: usize,
) -> Vec<[u32; 3]> {
    let atlas = &layout.meshes[world.scene.instances[instance].mesh];
    let page = layout.placements[instance].page;
    let [start, end] = world.soup.instance_ranges[instance];
    let mut edges: Vec<Edge> = Vec::new();
    for t in start..end {
        let source = world.soup.sources[t as usize];
        let primitive = &atlas.primitives[source.primitive as usize];
        let corners = lumels.page_corners(t);
        // NaN if the triangle receives no light.
        let extent = area(corners).abs();
        if extent.is_nan() || extent == 0.0 {
            continue;
        }
        let chart = primitive.chart[source.triangle as usize];
        // Adding zero turns −0 into 0.
        let bits = corners.map(|c| [(c.x + 0.0).to_bits(), (c.y + 0.0).to_bits()]);
        for k in 0..3 {
            let (a, b) = (bits[k], bits[(k + 1) % 3]);
            edges.push((chart, a.min(b), a.max(b), t, k as u32));
        }
    }
    edges.sort_unstable();
    let mut alone: Vec<[u32; 3]> = edges
        .chunk_by(|x, y| (x.0, x.1, x.2) == (y.0, y.1, y.2))
        .filter(|run| run.len() == 1)
        .map(|run| [page, run[0].3, run[0].4])
        .collect();
    alone.sort_unstable();
    alone
}

fn area([a, b, c]: [Vec2; 3]) -> f32 {
    0.5 * (b - a).perp_dot(c - a)
}

/// Cuts edge `k` of triangle `t` into pieces of `longest` texels.
fn cut(
    world: &World,
    corners: [Vec2; 3],
    page: u32,
    t: u32,
    k: usize,
    longest: f32,
    out: &mut Vec<Piece>,
) {
    let triangle = world.soup.triangles[t as usize];
    let next = (k + 1) % 3;
    let (a, b, c) = (triangle[k], triangle[next], triangle[(k + 2) % 3]);
    let texels = corners[next] - corners[k];
    let along = b - a;
    let edge = along.length();
    let up = (c - a) - along * ((c - a).dot(along) / along.length_squared());
    let altitude = up.length();
    if !(texels.length() > 0.0 && edge > 0.0 && altitude > 0.0 && altitude.is_finite()) {
        return;
    }
    let texel = (world.soup.areas[t as usize] / area(corners).abs()).sqrt();
    let corner = [Vec2::ZERO, Vec2::X, Vec2::Y];
    let n = (texels.length() / longest).ceil();
    for i in 0..n as u32 {
        let ends = [i as f32 / n, (i + 1) as f32 / n];
        out.push(Piece {
            world: ends.map(|s| a.lerp(b, s)),
            texels: ends.map(|s| corners[k].lerp(corners[next], s)),
            page,
            triangle: t,
            weights: ends.map(|s| corner[k].lerp(corner[next], s)),
            inward: up / altitude,
            altitude,
            edge,
            texel,
        });
    }
}
