//! The scene as rays see it.

use glam::Vec3;
use mesh_ingest::{Scene, Soup};
use visibility::{BuildError, BuildOptions, Bvh, Hit, HitFilter, Ray};

use crate::emitters::brightness;
use crate::sampling::hash_u32;

/// Rec.709 luminance of a linear colour.
#[inline]
pub fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// What a ray meets that leaves the scene.
#[derive(Debug, Clone, Default)]
pub enum Sky {
    /// Nothing.
    #[default]
    Black,
    /// The same radiance from everywhere (W/(m² sr) or nit).
    Constant(Vec3),
    /// A latitude-longitude map: column 0 begins at −X and runs through −Z, row 0 is +Y; values are radiances.
    Map {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Row-major radiances.
        pixels: Vec<Vec3>,
    },
}

impl Sky {
    /// Radiance that arrives against the unit `direction`.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match self {
            Sky::Black => Vec3::ZERO,
            Sky::Constant(l) => *l,
            Sky::Map {
                width,
                height,
                pixels,
            } => {
                let (w, h) = (*width as usize, *height as usize);
                let u = 0.5 + direction.x.atan2(-direction.z) / std::f32::consts::TAU;
                let v = direction.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI;
                let (x, y) = (
                    u * w as f32 - 0.5,
                    (v * h as f32 - 0.5).clamp(0.0, h as f32 - 1.0),
                );
                let (fx, fy) = (x - x.floor(), y - y.floor());
                let column = |i: i64| i.rem_euclid(w as i64) as usize;
                let (x0, x1) = (column(x.floor() as i64), column(x.floor() as i64 + 1));
                let (y0, y1) = (y as usize, (y as usize + 1).min(h - 1));
                let at = |x: usize, y: usize| pixels[y * w + x];
                at(x0, y0)
                    .lerp(at(x1, y0), fx)
                    .lerp(at(x0, y1).lerp(at(x1, y1), fx), fy)
            }
        }
    }

    /// Whether it sends any light.
    pub fn is_black(&self) -> bool {
        match self {
            Sky::Black => true,
            Sky::Constant(l) => *l == Vec3::ZERO,
            Sky::Map { pixels, .. } => pixels.iter().all(|p| *p == Vec3::ZERO),
        }
    }
}

/// A point on a surface that receives light.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    /// The point itself, metres, recentred world space.
    pub position: Vec3,
    /// Where its rays start: `position` moved off the surface along `geometric`.
    pub origin: Vec3,
    /// Unit shading normal: the axis of the receiver's hemisphere.
    pub normal: Vec3,
    /// Unit geometric normal of the receiving side.
    pub geometric: Vec3,
}

/// What a gathering ray finds.
#[derive(Debug, Clone, Copy)]
pub enum Incoming {
    /// It left the scene.
    Escaped,
    /// It met the back of a single-sided face, which is black.
    Black,
    /// It met a surface that reflects.
    Surface(Hit),
}

/// How a [`World`] is made.
#[derive(Debug, Clone, Default)]
pub struct WorldOptions {
    /// What rays that leave the scene meet.
    pub sky: Sky,
    /// The tree's build options.
    pub tree: BuildOptions,
}

/// How a triangle's own emission reaches receivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Emission {
    None,
    /// By [`DirectLight`](crate::DirectLight), in closed form; rays that hit it see its reflected light only.
    Sampled,
    /// By the rays that hit it.
    Gathered,
}

/// A scene with its ray-casting tree.
pub struct World<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its triangles.
    pub soup: &'a Soup,
    /// The sky.
    pub sky: Sky,
    bvh: Bvh,
    two_sided: Vec<bool>,
    radius: f32,
    /// Per triangle; empty where nothing emits, so that such a scene pays nothing.
    emission: Vec<Emission>,
}

impl<'a> World<'a> {
    /// Builds the tree and sorts emitters.
    ///
    /// # Errors
    /// What [`Bvh::build`] reports: never for a [`Soup`] of [`Soup::build`].
    pub fn build(
        scene: &'a Scene,
        soup: &'a Soup,
        options: WorldOptions,
    ) -> Result<Self, BuildError> {
        let filtered: Vec<bool> = scene
            .materials
            .iter()
            .map(|m| m.lets_light_through())
            .collect();
        let bvh = Bvh::build(
            &soup.triangles,
            |t| filtered[soup.materials[t as usize] as usize],
            &options.tree,
        )?;
        let radius = soup
            .triangles
            .iter()
            .flatten()
            .map(|p| p.abs().max_element())
            .fold(0.0, f32::max);
        Ok(World {
            emission: classify_emission(scene, soup),
            two_sided: scene.materials.iter().map(|m| m.double_sided).collect(),
            sky: options.sky,
            scene,
            soup,
            bvh,
            radius,
        })
    }

    /// The tree.
    pub fn tree(&self) -> &Bvh {
        &self.bvh
    }

    /// Whether both sides of the triangle act on light.
    #[inline]
    pub fn two_sided(&self, triangle: u32) -> bool {
        self.two_sided[self.soup.materials[triangle as usize] as usize]
    }

    /// Whether nothing at all shines: no lamp, no emissive surface, a black sky.
    pub fn is_dark(&self) -> bool {
        self.scene.lights.is_empty()
            && self.sky.is_black()
            && self.emission.iter().all(|e| *e == Emission::None)
    }

    #[inline]
    pub(crate) fn emission(&self, triangle: u32) -> Emission {
        match self.emission.get(triangle as usize) {
            Some(e) => *e,
            None => Emission::None,
        }
    }

    /// The point at barycentrics (u, v) of world corners 1 and 2, on the front, or on the back if `back`. `smooth` uses
    /// interpolated normals for the hemisphere's axis.
    pub fn surface_point(
        &self,
        triangle: u32,
        u: f32,
        v: f32,
        back: bool,
        smooth: bool,
    ) -> SurfacePoint {
        let [a, b, c] = self.soup.triangles[triangle as usize];
        let position = a + (b - a) * u + (c - a) * v;
        let side = if back { -1.0 } else { 1.0 };
        let geometric = self.soup.normals[triangle as usize] * side;
        let normal = if smooth {
            self.scene.shading_normal(self.soup, triangle, u, v) * side
        } else {
            geometric
        };
        SurfacePoint {
            position,
            origin: position + geometric * self.offset(position),
            normal,
            geometric,
        }
    }

    /// [`surface_point`](Self::surface_point), drawn in from the triangle's edges just enough that, moved off the surface, it stays on
    /// its own side of a neighbouring face: a point in a corner would see behind the wall. By four times the offset, or to the
    /// middle of triangles that are smaller than that.
    pub fn inset_point(
        &self,
        triangle: u32,
        u: f32,
        v: f32,
        back: bool,
        smooth: bool,
    ) -> SurfacePoint {
        let corners = self.soup.triangles[triangle as usize];
        let position = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
        let margin = 4.0 * self.offset(position);
        // Height above each edge is barycentric × altitude; altitude = 2 area / edge.
        let area2 = 2.0 * self.soup.areas[triangle as usize];
        let edge = |i: usize, j: usize| (corners[i] - corners[j]).length();
        let least = [edge(1, 2), edge(2, 0), edge(0, 1)]
            .map(|e| (margin * e / area2.max(1e-30)).min(1.0 / 3.0));
        let mut w = [1.0 - u - v, u, v];
        if w.iter().zip(&least).all(|(w, least)| w >= least) {
            return self.surface_point(triangle, u, v, back, smooth);
        }
        for (w, least) in w.iter_mut().zip(least) {
            *w = w.max(least);
        }
        let sum = w[0] + w[1] + w[2];
        self.surface_point(triangle, w[1] / sum, w[2] / sum, back, smooth)
    }

    /// How far rays start from the surface, metres. A barycentric sum of three `f32` corners is off by at most some
    /// 4 ulp of the largest coordinate (3e-7 of it, Higham's γ₅), and so is the plane that the tree tests against: 1e-6
    /// covers both. The second term is for points near the origin whose triangles reach far from it.
    #[inline]
    pub fn offset(&self, position: Vec3) -> f32 {
        1e-6 * position.abs().max_element() + 2e-7 * self.radius
    }

    /// What arrives at `origin` from the unit `direction`.
    #[inline]
    pub fn incoming(&self, origin: Vec3, direction: Vec3) -> Incoming {
        let ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        match self.bvh.closest_hit(&ray, &AlphaFilter { world: self }) {
            None => Incoming::Escaped,
            Some(hit) if hit.back && !self.two_sided(hit.triangle) => Incoming::Black,
            Some(hit) => Incoming::Surface(hit),
        }
    }

    /// The first surface along a ray, whatever its side.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.bvh.closest_hit(ray, &AlphaFilter { world: self })
    }

    /// Whether something lies on the way from `origin` along `direction` (any length) before parameter `t_max`.
    #[inline]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32) -> bool {
        let ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max,
        };
        self.bvh.occluded(&ray, &AlphaFilter { world: self })
    }

    /// Reflectance at a hit (linear, per channel).
    #[inline]
    pub fn reflectance(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        self.scene.base_color(self.soup, triangle, u, v).truncate()
    }

    /// Radiance that the surface itself emits at a hit and that gathering rays should count (see [`Emitters`](crate::Emitters)).
    #[inline]
    pub fn gathered_emission(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        if self.emission(triangle) == Emission::Gathered {
            self.scene.emission(self.soup, triangle, u, v)
        } else {
            Vec3::ZERO
        }
    }
}

/// Lets rays through the holes of masked surfaces and, with probability 1 − alpha, through blended ones.
struct AlphaFilter<'w, 'a> {
    world: &'w World<'a>,
}

impl HitFilter for AlphaFilter<'_, '_> {
    fn accept(&self, triangle: u32, u: f32, v: f32, ray: &Ray) -> bool {
        let w = self.world;
        match w.scene.presence(w.soup, triangle, u, v) {
            1.0 => true,
            0.0 => false,
            presence => {
                // One fair coin for each ray and surface: unbiased, and the same in every run.
                let mut h = triangle;
                for x in ray
                    .origin
                    .to_array()
                    .into_iter()
                    .chain(ray.direction.to_array())
                {
                    h = hash_u32(h ^ x.to_bits());
                }
                h as f32 / 4294967296.0 < presence
            }
        }
    }
}

/// Decides per triangle how its emission travels.
///
/// Small bright lamps are left to closed forms and shadow rays: a hemisphere of rays finds them too rarely. A surface whose radiance is
/// near what the scene's surfaces send anyway (a luminous ceiling, a furnace's walls) is no harder for gathering rays than
/// any reflecting one, and as many closed forms as it has triangles would be dear. The border is four times the mean radiance
/// Σ Φ/(π Σ A): there the light covers a quarter of the scene's surface, and the error of the two ways is alike.
///
/// What counts of a textured triangle is how bright its light is, not how bright all of it is on average: a sign that glows in a dark wall is
/// a small lamp.
fn classify_emission(scene: &Scene, soup: &Soup) -> Vec<Emission> {
    let glows: Vec<bool> = scene
        .materials
        .iter()
        .map(|m| m.emissive != Vec3::ZERO && !m.occluder_only)
        .collect();
    if !glows.iter().any(|&g| g) {
        return Vec::new();
    }
    let glowing: Vec<u32> = (0..soup.triangles.len() as u32)
        .filter(|&t| glows[soup.materials[t as usize] as usize])
        .collect();
    let brightness = brightness(scene, soup, &glowing);
    let area: f64 = soup.areas.iter().map(|a| *a as f64).sum();
    let flux: f64 = (glowing.iter().zip(&brightness))
        .map(|(&t, b)| b.mean as f64 * soup.areas[t as usize] as f64)
        .sum();
    let border = 4.0 * flux / area.max(1e-300);
    let mut emission = vec![Emission::None; soup.triangles.len()];
    for (&t, b) in glowing.iter().zip(&brightness) {
        if b.mean > 0.0 {
            emission[t as usize] = if (b.bright as f64) < border {
                Emission::Gathered
            } else {
                Emission::Sampled
            };
        }
    }
    emission
}

/// Reads a decoded sky image; a helper for callers that hold pixels in another form.
impl From<(u32, u32, Vec<Vec3>)> for Sky {
    fn from((width, height, pixels): (u32, u32, Vec<Vec3>)) -> Self {
        debug_assert_eq!(pixels.len(), width as usize * height as usize);
        Sky::Map {
            width,
            height,
            pixels,
        }
    }
}
