//! A baked level, traced by rays.

use atlas::{Layout, Placement};
use glam::{Vec2, Vec3};
use mesh_ingest::{AlphaMode, Scene, Soup};
use radiosity::{DirectLight, Solution, World};
use visibility::{Bvh, Hit, HitFilter, Ray};

use crate::manifest::ValueKind;
use crate::page::Page;

/// Most surfaces that a ray passes through (culled backfaces, glass).
const MAX_LAYERS: usize = 32;

/// A baked level for tracing.
#[derive(Clone, Copy)]
pub struct LitScene<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its triangles.
    pub soup: &'a Soup,
    /// The tree over `soup`; triangles whose material [needs alpha](Scene::needs_alpha) are
    /// flagged.
    pub bvh: &'a Bvh,
    /// The light.
    pub light: PictureLight<'a>,
}

/// Source of a picture's light.
#[derive(Clone, Copy)]
pub enum PictureLight<'a> {
    /// A finished bake, read like an engine does.
    Pages {
        /// The lightmap layout.
        layout: &'a Layout,
        /// The pages.
        pages: &'a [Page],
        /// Quantity in the pages.
        value: ValueKind,
    },
    /// The solution on patches, before the gather: coarse, with some noise near lamps and contacts.
    Solved {
        /// The world over the same soup.
        world: &'a World<'a>,
        /// The solution.
        solution: &'a Solution,
        /// Its lights.
        lights: &'a DirectLight<'a, 'a>,
    },
}

/// Result of a ray.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    /// Radiance towards the eye.
    pub color: Vec3,
    /// Fraction of the ray that ended at surfaces.
    pub alpha: f32,
    /// Distance to the first visible surface; infinite if there is none.
    pub distance: f32,
    /// The triangle at that distance.
    pub triangle: u32,
}

/// Lets rays pass through alpha masks.
struct Masks<'a>(&'a Scene, &'a Soup);

impl HitFilter for Masks<'_> {
    fn accept(&self, triangle: u32, u: f32, v: f32, _: &Ray) -> bool {
        self.0.presence(self.1, triangle, u, v) >= 0.5
    }
}

impl LitScene<'_> {
    /// Outgoing radiance and opacity at a ray's hit. `seed` drives stochastic choices.
    fn shade(&self, ray: &Ray, hit: &Hit, seed: u32) -> (Vec3, f32) {
        let (triangle, u, v) = (hit.triangle, hit.u, hit.v);
        let base = self.scene.base_color(self.soup, triangle, u, v);
        let reflected = match self.light {
            PictureLight::Pages {
                layout,
                pages,
                value,
            } => {
                let stored = self.stored(layout, pages, hit);
                match value {
                    ValueKind::Radiance => stored * base.truncate(),
                    ValueKind::Irradiance => stored * base.truncate() / std::f32::consts::PI,
                    ValueKind::Radiosity => stored,
                }
            }
            PictureLight::Solved {
                world,
                solution,
                lights,
            } => {
                let at = ray.origin + ray.direction * hit.t;
                let leaving = solution.radiance(world, lights, hit, at, seed);
                (leaving - world.gathered_emission(triangle, u, v)).max(Vec3::ZERO)
            }
        };
        let glow = self.scene.emission(self.soup, triangle, u, v);
        (reflected + glow, base.w)
    }

    /// The stored value at a point of a triangle, with bilinear filtering; black without a
    /// lightmap.
    fn stored(&self, layout: &Layout, pages: &[Page], hit: &Hit) -> Vec3 {
        let &Hit { triangle, u, v, .. } = hit;
        let look = || {
            let source = self.soup.sources.get(triangle as usize)?;
            let instance = self.scene.instances.get(source.instance as usize)?;
            let placement = layout.placements.get(source.instance as usize)?;
            if placement.rect.w == 0 {
                return None;
            }
            let atlas = layout
                .meshes
                .get(instance.mesh)?
                .primitives
                .get(source.primitive as usize)?;
            let [a, b, c] = *atlas.triangles.get(source.triangle as usize)?;
            let corners = if source.mirrored {
                [a, c, b]
            } else {
                [a, b, c]
            };
            let mut at = Vec2::ZERO;
            for (corner, weight) in corners.into_iter().zip([1.0 - u - v, u, v]) {
                at += *atlas.uv.get(corner as usize)? * weight;
            }
            Some(bilinear(pages.get(placement.page as usize)?, placement, at))
        };
        look().unwrap_or(Vec3::ZERO)
    }

    /// Traces a ray; like in an engine, backfaces of single-sided materials are culled.
    pub(super) fn look(&self, origin: Vec3, direction: Vec3, seed: u32) -> Seen {
        let mut seen = Seen {
            distance: f32::INFINITY,
            triangle: u32::MAX,
            ..Seen::default()
        };
        let mut ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        for _ in 0..MAX_LAYERS {
            let Some(mut hit) = self.bvh.closest_hit(&ray, &Masks(self.scene, self.soup)) else {
                break;
            };
            ray.t_min = hit.t;
            let material_of = |hit: &Hit| {
                &self.scene.materials[self.soup.materials[hit.triangle as usize] as usize]
            };
            let culled = |hit: &Hit| hit.back && !material_of(hit).double_sided;
            if culled(&hit) {
                hit = radiosity::facing(self.scene, self.soup, self.bvh, &ray, hit);
            }
            if culled(&hit) {
                continue;
            }
            let material = material_of(&hit);
            if seen.triangle == u32::MAX {
                (seen.distance, seen.triangle) = (hit.t, hit.triangle);
            }
            let (color, alpha) = self.shade(&ray, &hit, seed);
            let opacity = if material.alpha == AlphaMode::Blend {
                alpha
            } else {
                1.0
            };
            seen.color += color * (opacity * (1.0 - seen.alpha));
            seen.alpha += opacity * (1.0 - seen.alpha);
            if seen.alpha > 0.999 {
                break;
            }
        }
        seen
    }
}

/// Value of `page` at `at` (texels of the placement's rectangle).
fn bilinear(page: &Page, placement: &Placement, at: Vec2) -> Vec3 {
    let p = at + Vec2::new(placement.rect.x as f32, placement.rect.y as f32) - 0.5;
    let (w, h) = (page.width as i64, page.height as i64);
    if w == 0 || h == 0 || !p.is_finite() {
        return Vec3::ZERO;
    }
    let (x, y) = (p.x.floor(), p.y.floor());
    let fetch = |dx: i64, dy: i64| {
        let (x, y) = (
            (x as i64).saturating_add(dx).clamp(0, w - 1),
            (y as i64).saturating_add(dy).clamp(0, h - 1),
        );
        page.value
            .get((y * w + x) as usize)
            .map_or(Vec3::ZERO, |v| Vec3::from(*v))
    };
    let (fx, fy) = (p.x - x, p.y - y);
    fetch(0, 0)
        .lerp(fetch(1, 0), fx)
        .lerp(fetch(0, 1).lerp(fetch(1, 1), fx), fy)
}
