//! The pieces of surface that receive light: a lumel's part of a texel, or the surroundings of a
//! vertex.

use glam::{Vec2, Vec3};
use radiosity::{SurfacePoint, World, hash_u32, sample_2d};

use atlas::{Fragment, Lumel, Lumels};

/// A piece of surface as a stream of evenly distributed points.
pub trait Footprint: Sync {
    /// Candidate `i`, or `None` if it is off the surface. Any prefix of the stream covers the piece
    /// evenly.
    fn candidate(&self, i: u32) -> Option<SurfacePoint>;
    /// A point that is certainly on the surface.
    fn fallback(&self) -> SurfacePoint;
    /// Size of the piece, metres: the square root of its area (of the whole texel's area, for a
    /// partly covered texel).
    fn size(&self) -> f32;
    /// Extent of the piece, metres; larger than its size if it is elongated.
    fn reach(&self) -> f32 {
        self.size()
    }
    /// The instance that it is on, if it is on only one.
    fn instance(&self) -> Option<usize> {
        None
    }
    /// A triangle that it is on, and whether it is on its back; `None` if that does not tell its
    /// patch.
    fn side(&self) -> Option<(u32, bool)> {
        None
    }
}

/// The part of a lumel's texel on the surface.
pub struct LumelFootprint<'l, 'w, 'a> {
    world: &'w World<'a>,
    lumels: &'l Lumels,
    lumel: Lumel,
    seed: u32,
    size: f32,
    reach: f32,
}

impl<'l, 'w, 'a> LumelFootprint<'l, 'w, 'a> {
    /// The footprint of `lumel`.
    pub fn new(world: &'w World<'a>, lumels: &'l Lumels, lumel: Lumel, seed: u32) -> Self {
        let (mut size, mut reach) = (0f32, 0f32);
        for f in lumels.fragments(&lumel) {
            size = size.max(texel_size(world, &f));
            reach = reach.max(texel_reach(world, &f));
        }
        LumelFootprint {
            world,
            lumels,
            lumel,
            seed,
            size,
            reach: reach.max(size),
        }
    }

    /// The footprint of lumel `i`, and the seed of its random numbers, which depends on its place
    /// on the page.
    pub(crate) fn of(world: &'w World<'a>, lumels: &'l Lumels, i: usize) -> (Self, u32) {
        let lumel = lumels.lumels[i];
        let seed = hash_u32(lumel.texel[0] ^ hash_u32(lumel.texel[1] ^ hash_u32(lumel.page)));
        (Self::new(world, lumels, lumel, seed), seed)
    }
}

impl LumelFootprint<'_, '_, '_> {
    /// Reflectance of the surface, averaged over sixteen points.
    pub fn mean_reflectance(&self) -> Vec3 {
        let (mut sum, mut n) = (Vec3::ZERO, 0.0f32);
        for i in 0..16 {
            if let Some((fragment, u, v)) = self.locate(i) {
                sum += self.reflectance(&fragment, u, v);
                n += 1.0;
            }
        }
        if n > 0.0 {
            return sum / n;
        }
        let third = 1.0 / 3.0;
        (self.lumels.fragments(&self.lumel).next())
            .map_or(Vec3::ZERO, |f| self.reflectance(&f, third, third))
    }

    /// Reflectance of the face itself, which may be a duplicate with its own material.
    fn reflectance(&self, fragment: &Fragment, u: f32, v: f32) -> Vec3 {
        let w = [1.0 - u - v, u, v];
        let [u, v] = match self.world.soup.duplicate(fragment.face) {
            None => [u, v],
            Some(d) => [w[d.corners[1] as usize], w[d.corners[2] as usize]],
        };
        self.world.own_reflectance(fragment.face, u, v)
    }

    /// Triangle and barycentrics of candidate `i`.
    fn locate(&self, i: u32) -> Option<(Fragment, f32, f32)> {
        let [x, y] = sample_2d(i, 63, self.seed);
        let p = Vec2::new(
            self.lumel.texel[0] as f32 + x,
            self.lumel.texel[1] as f32 + y,
        );
        self.lumels.fragments(&self.lumel).find_map(|f| {
            let (u, v) = barycentrics(f.corners, p)?;
            (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then_some((f, u, v))
        })
    }
}

/// Length of a texel's edge on the triangle, metres: √(world area / texel area).
fn texel_size(world: &World, f: &Fragment) -> f32 {
    let [a, b, c] = f.corners;
    let texels = 0.5 * (b - a).perp_dot(c - a).abs();
    if texels > 0.0 {
        (world.soup.areas[f.triangle as usize] / texels).sqrt()
    } else {
        0.0
    }
}

/// Length of the longer of a texel's edges on the triangle, metres.
fn texel_reach(world: &World, f: &Fragment) -> f32 {
    let (e1, e2) = (f.corners[1] - f.corners[0], f.corners[2] - f.corners[0]);
    let det = e1.perp_dot(e2);
    if det == 0.0 {
        return 0.0;
    }
    let [a, b, c] = world.soup.triangles[f.triangle as usize];
    let (s1, s2) = (b - a, c - a);
    let along_x = (s1 * e2.y - s2 * e1.y) / det;
    let along_y = (s2 * e1.x - s1 * e2.x) / det;
    along_x.length().max(along_y.length())
}

/// Barycentric coordinates (of corners 1 and 2) of point `p`, if the triangle has any area on the
/// page.
fn barycentrics(corners: [Vec2; 3], p: Vec2) -> Option<(f32, f32)> {
    let (e1, e2, d) = (
        corners[1] - corners[0],
        corners[2] - corners[0],
        p - corners[0],
    );
    let det = e1.perp_dot(e2);
    (det != 0.0).then(|| (d.perp_dot(e2) / det, e1.perp_dot(d) / det))
}

impl Footprint for LumelFootprint<'_, '_, '_> {
    fn instance(&self) -> Option<usize> {
        Some(self.lumel.instance as usize)
    }

    fn side(&self) -> Option<(u32, bool)> {
        let first = self.lumels.fragments(&self.lumel).next()?;
        Some((first.triangle, first.back))
    }

    fn candidate(&self, i: u32) -> Option<SurfacePoint> {
        let (f, u, v) = self.locate(i)?;
        Some(self.world.inset_point(f.triangle, u, v, f.back, true))
    }

    fn fallback(&self) -> SurfacePoint {
        // The surface point nearest to the texel's centre; for each triangle the nearest in
        // barycentric terms.
        let middle = Vec2::new(
            self.lumel.texel[0] as f32 + 0.5,
            self.lumel.texel[1] as f32 + 0.5,
        );
        let third = 1.0 / 3.0;
        let (mut best, mut place) = (f32::INFINITY, None);
        for f in self.lumels.fragments(&self.lumel) {
            place = place.or(Some((f, third, third)));
            let q = closest_on_triangle(f.corners, middle);
            let d = q.distance_squared(middle);
            if d < best
                && let Some((u, v)) = barycentrics(f.corners, q)
            {
                let (u, v) = (u.clamp(0.0, 1.0), v.clamp(0.0, 1.0));
                let s = (u + v).max(1.0);
                (best, place) = (d, Some((f, u / s, v / s)));
            }
        }
        let (triangle, back, u, v) = place.map_or((0, false, third, third), |(f, u, v)| {
            (f.triangle, f.back, u, v)
        });
        self.world.inset_point(triangle, u, v, back, true)
    }

    fn reach(&self) -> f32 {
        self.reach
    }

    fn size(&self) -> f32 {
        self.size
    }
}

fn closest_on_triangle(t: [Vec2; 3], p: Vec2) -> Vec2 {
    if let Some((u, v)) = barycentrics(t, p)
        && u >= 0.0
        && v >= 0.0
        && u + v <= 1.0
    {
        return p;
    }
    let mut best = t[0];
    for k in 0..3 {
        let (a, b) = (t[k], t[(k + 1) % 3]);
        let ab = b - a;
        let s = ((p - a).dot(ab) / ab.length_squared().max(1e-30)).clamp(0.0, 1.0);
        let q = a + ab * s;
        if q.distance_squared(p) < best.distance_squared(p) {
            best = q;
        }
    }
    best
}
