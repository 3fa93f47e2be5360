//! Thin walls with different light on their two sides.
//!
//! A lumel under a wall thinner than a lumel is read by lookups on both sides of it. Whatever it
//! holds is wrong on one of them: a bright line at the foot of a partition, a dark one, or light in
//! a dark room. The solve already knows the walls between neighbouring elements, and the light on
//! either side. Where walls are thicker, lumels inside them separate the sides.

use glam::Vec3;
use radiosity::{Incoming, SurfacePoint, World, cosine_hemisphere, sample_4d};
use rayon::prelude::*;

use super::{BESIDE, Level};

/// Walls at least this thick, in lumels, have a lumel of their own between the two sides.
pub(super) const THIN: f32 = 1.5;

/// A wall's normal is within 45° of the surface it stands on. What lies flatter is a cover.
const UPRIGHT: f32 = 0.7;

/// Rays from each side of each pair of elements, which tell whether people can be there.
const RAYS: u32 = 4;

/// A ray that meets a front beyond this many lumels, or nothing, crosses a place where people can
/// be; the inside of a sofa and the gap behind a cupboard have none.
pub(super) const ROOM: f32 = 3.0;

/// The fraction of such rays from which a side counts …
const SEEN: f32 = 0.25;

/// … if this fraction meets the front of something. The wall itself fills half of the view from
/// beside it, but below a terrain there are backs and the sky.
const INSIDE: f32 = 0.25;

/// A thin wall between two neighbouring elements.
pub(super) struct Wall {
    /// Unit normal in the plane of the surface.
    pub normal: Vec3,
    /// Points on its two faces.
    pub ends: [Vec3; 2],
    /// What rays from either element found, first from the one that the normal points to.
    pub sides: [Found; 2],
    /// Relative difference of the light.
    pub differ: f32,
    /// Edge of the surface's lumels, metres.
    pub lumel: f32,
    /// The first element's triangle.
    pub triangle: u32,
    /// Length of the wall that it stands for, metres.
    pub length: f32,
}

/// What rays from one side of a wall found.
#[derive(Clone, Copy, Default)]
pub(super) struct Found {
    rays: u32,
    /// Those that cross a place where people can be.
    open: u32,
    /// Those that meet the front of something.
    fronts: u32,
    /// Those that do both.
    across: u32,
}

impl Found {
    pub fn add(&mut self, other: &Found) {
        self.rays += other.rays;
        self.open += other.open;
        self.fronts += other.fronts;
        self.across += other.across;
    }

    /// Whether people can be there.
    pub fn is_seen(&self) -> bool {
        self.share(self.open) >= SEEN && self.share(self.fronts) >= INSIDE
    }

    /// Whether it is seen from across a room, not just from outside of the level.
    pub fn is_seen_across(&self) -> bool {
        self.share(self.across) >= SEEN
    }

    fn share(&self, rays: u32) -> f32 {
        rays as f32 / self.rays.max(1) as f32
    }
}

impl Wall {
    /// Points on its faces, or one between them if they are very close.
    pub fn faces(&self) -> impl Iterator<Item = Vec3> {
        let [a, b] = self.ends;
        let one = self.normal.dot(b - a).abs() < BESIDE * self.lumel;
        let points = if one {
            [Some(0.5 * (a + b)), None]
        } else {
            [Some(a), Some(b)]
        };
        points.into_iter().flatten()
    }
}

/// All of them, pair by pair of neighbouring elements.
pub(super) fn find(level: &Level) -> Vec<Wall> {
    let cut = &level.solution.cut;
    if !cut.has_walls() {
        return Vec::new();
    }
    (cut.across().par_iter().with_min_len(1024))
        .filter_map(|&pair| {
            let differ = level.difference(pair)?;
            let lumel = level.lumel_of(cut.elements()[pair[0] as usize].triangle)?;
            let wall = wall(level, pair, lumel)?;
            Some(Wall { differ, ..wall })
        })
        .collect()
}

/// The wall between two elements, if it is thin.
fn wall(level: &Level, pair: [u32; 2], lumel: f32) -> Option<Wall> {
    let (world, cut) = (level.world, &level.solution.cut);
    let triangle = cut.elements()[pair[0] as usize].triangle;
    let lift = 0.05 * cut.patch_edge(triangle);
    let [a, b] = level.points(pair);
    if !world.wall_between(&a, &b, lift) {
        return None;
    }
    let up = a.geometric;
    let [from, to] = [a, b].map(|p| p.origin + up * (0.5 * lift));
    let hit = world.first_between(from, to)?;
    let other = world.first_between(to, from)?;
    let normal = upright(world, hit.triangle, up)?;
    let ends = [from.lerp(to, hit.t), to.lerp(from, other.t)];
    if normal.dot(ends[1] - ends[0]).abs() >= THIN * lumel {
        return None;
    }
    let mut sides = [a, b].map(|p| look(world, &p, pair[0], ROOM * lumel));
    if normal.dot(a.position - b.position) < 0.0 {
        sides.reverse();
    }
    Some(Wall {
        normal,
        ends,
        sides,
        differ: 0.0,
        lumel,
        triangle,
        length: 0.25 * cut.patch_edge(triangle),
    })
}

/// Unit normal in the plane of a surface of a triangle that stands on it; `None` if it lies
/// flatter.
pub(super) fn upright(world: &World, triangle: u32, up: Vec3) -> Option<Vec3> {
    let normal = world.soup.normals[triangle as usize];
    let level = normal - up * normal.dot(up);
    if level.length() < UPRIGHT {
        return None;
    }
    let level = level.normalize();
    // Always the same of the two directions, whichever element comes first.
    let first = level
        .to_array()
        .into_iter()
        .find(|x| x.abs() > 0.1)
        .unwrap_or(1.0);
    Some(level * first.signum())
}

/// Casts [`RAYS`] from a point.
pub(super) fn look(world: &World, p: &SurfacePoint, seed: u32, room: f32) -> Found {
    let mut found = Found {
        rays: RAYS,
        ..Found::default()
    };
    for k in 0..RAYS {
        let s = sample_4d(k, 0, seed);
        let toward = cosine_hemisphere(p.normal, s[0], s[1]);
        match world.incoming(p.origin, toward).0 {
            Incoming::Escaped => found.open += 1,
            Incoming::Surface(hit) if !hit.back => {
                found.fronts += 1;
                found.open += u32::from(hit.t > room);
                found.across += u32::from(hit.t > room);
            }
            Incoming::Surface(_) | Incoming::Black => {}
        }
    }
    found
}
