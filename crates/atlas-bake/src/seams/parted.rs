//! Texels that the edges of sharp shadows part.

use glam::{Vec2, Vec3};
use radiosity::{SOFT, SharpLights, World};

use crate::seams::border::Piece;
use crate::seams::rows::lookup;

/// A page and a position on it, texels.
pub(super) type Place = (u32, Vec2);

/// Distance from a seam, texels, at which a light is compared.
const AT_THE_EDGE: f32 = 0.1;

/// Likewise, as a fraction of what lies between the seam and the far border of the triangle.
const INSIDE: f32 = 0.5;

/// Of each texel, whether lookups read it in the light at the edge of a shadow, and in its shade.
pub(super) struct Parted<'p> {
    pages: &'p [[u32; 2]],
    tags: Vec<Vec<u8>>,
}

const LIT: u8 = 1;
const SHADED: u8 = 2;

impl<'p> Parted<'p> {
    /// The texels that are read at these places, each on its lit and its shaded side.
    pub fn new(pages: &'p [[u32; 2]], places: &[[Place; 2]]) -> Parted<'p> {
        let mut tags = vec![Vec::new(); pages.len()];
        for (side, tag) in [LIT, SHADED].into_iter().enumerate() {
            for place in places {
                let (page, at) = place[side];
                let (size, tags) = (pages[page as usize], &mut tags[page as usize]);
                tags.resize(size[0] as usize * size[1] as usize, 0);
                for (texel, _) in lookup(size, at) {
                    tags[texel] |= tag;
                }
            }
        }
        Parted { pages, tags }
    }

    /// Whether lookups at these two places read both what is lit and what is shaded. If they were
    /// made to agree, shade would be brighter, and what is lit darker.
    pub fn parts(&self, sides: &[Place; 2]) -> bool {
        let [a, b] = sides.map(|(page, at)| {
            let tags = &self.tags[page as usize];
            let read = lookup(self.pages[page as usize], at);
            let tag = |(texel, _): (usize, f32)| tags.get(texel).copied().unwrap_or(0);
            read.into_iter().map(tag).fold(0, |a, b| a | b)
        });
        (a & LIT != 0 && b & SHADED != 0) || (a & SHADED != 0 && b & LIT != 0)
    }
}

/// Whether charts may end at the edges of shadows between two pieces: in one surface of facets.
pub(super) fn may_part(world: &World, pieces: [&Piece; 2], same_facing: f32) -> bool {
    let [n, m] = pieces.map(|p| world.soup.normals[p.triangle as usize]);
    n.dot(m) >= same_facing
}

/// Which of two pieces is lit, if a shadow ends between them.
pub(super) fn lit_side(
    (world, lights): (&World, &SharpLights),
    pieces: [&Piece; 2],
    params: [f32; 2],
) -> Option<usize> {
    let p = pieces[0];
    let normal = world.soup.normals[p.triangle as usize];
    let on = p.world[0].lerp(p.world[1], params[0]);
    let texel = p.texel.max(pieces[1].texel);
    let steps = [0, 1].map(|k| {
        let p = pieces[k];
        let from = p.world[0].lerp(p.world[1], params[k]);
        let room = room(world.soup.triangles[p.triangle as usize], from, p.inward);
        p.inward * (AT_THE_EDGE * texel).min(INSIDE * room)
    });
    let on = on + normal * world.offset(on);
    lights.lit_side(world, on, (steps, normal), SOFT * texel)
}

/// Distance from a point of a triangle to its border in a direction.
fn room([a, b, c]: [Vec3; 3], from: Vec3, direction: Vec3) -> f32 {
    let normal = (b - a).cross(c - a);
    let distances = [[a, b], [b, c], [c, a]].into_iter().filter_map(|[p, q]| {
        let inward = normal.cross(q - p);
        let rate = inward.dot(direction);
        (rate < 0.0).then(|| (inward.dot(p - from) / rate).max(0.0))
    });
    distances.fold(f32::INFINITY, f32::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lookups_of_sun_and_shade_are_parted_and_others_are_not() {
        let places = [[(0, Vec2::new(2.5, 1.5)), (0, Vec2::new(2.5, 5.5))]];
        let parted = Parted::new(&[[8, 8], [8, 8]], &places);
        let at = |x: f32, y: f32| (0u32, Vec2::new(x, y));
        // A texel beside reads the same lumels, two beside others.
        for x in [1.6, 2.5, 3.4] {
            assert!(parted.parts(&[at(x, 1.5), at(x, 5.5)]), "{x}");
            assert!(parted.parts(&[at(x, 5.5), at(x, 1.5)]), "{x}");
            assert!(!parted.parts(&[at(x, 1.5), at(x, 1.5)]), "{x}");
        }
        assert!(!parted.parts(&[at(5.5, 1.5), at(2.5, 5.5)]));
        assert!(!parted.parts(&[at(2.5, 1.5), (1, Vec2::new(2.5, 5.5))]));
    }

    #[test]
    fn steps_end_inside_the_triangle() {
        let corners = [Vec3::ZERO, Vec3::X * 2.0, Vec3::new(1.0, 1.0, 0.0)];
        for (x, expected) in [(0.25, 0.25), (1.0, 1.0), (1.5, 0.5)] {
            let found = room(corners, Vec3::X * x, Vec3::Y);
            assert!((found - expected).abs() < 1e-6, "{found} at {x}");
        }
    }
}
