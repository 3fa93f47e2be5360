//! The solved light of a scene.

use glam::{DVec3, Vec3};
use patch_subdivision::{Locus, Stats, Subdivision};
use serde::Serialize;
use visibility::Hit;

use crate::audit::Audit;
use crate::direct::DirectLight;
use crate::relax::{RelaxReport, RelaxStep};
use crate::world::World;

/// Irradiance of every element and patch, ready to be gathered from.
pub struct Solution {
    /// The surfaces' subdivision.
    pub cut: Subdivision,
    /// Direct irradiance per element.
    pub direct: Vec<Vec3>,
    /// Mean direct irradiance per patch.
    pub direct_mean: Vec<Vec3>,
    /// Indirect irradiance per patch: reflected light, the sky, and emission that rays gather.
    pub indirect: Vec<Vec3>,
    /// Patches over which direct light changes too much for their elements to stand for it: a shadow's edge, a lamp close
    /// by, a wall that stands on them.
    pub rough: Vec<bool>,
    /// The same by group of light, where groups are kept apart.
    pub groups: Option<GroupLight>,
    /// How it was reached.
    pub report: SolveReport,
}

/// [`Solution`]'s irradiances by group of light: of element or patch *i* and group *g* at *i* × `count` + *g*.
#[derive(Debug, Default)]
pub struct GroupLight {
    /// Groups.
    pub count: usize,
    /// Direct irradiance per element.
    pub direct: Vec<Vec3>,
    /// Mean direct irradiance per patch.
    pub direct_mean: Vec<Vec3>,
    /// Indirect irradiance per patch.
    pub indirect: Vec<Vec3>,
}

/// Patch and element of the point `p`, which a ray found as `hit`: on its side of walls that stand on the surface. `None` as
/// [`Subdivision::locate`].
#[inline]
pub(crate) fn place(world: &World, cut: &Subdivision, hit: &Hit, p: Vec3) -> Option<Locus> {
    let at = cut.locate(hit.triangle, p, hit.back)?;
    if !cut.has_walls() {
        return Some(at);
    }
    Some(cut.on_this_side(hit.triangle, p, at, |e| {
        let own = world.surface_point(hit.triangle, hit.u, hit.v, hit.back, false);
        let other = world.surface_point(e.triangle, e.u, e.v, hit.back, false);
        !world.wall_between(&own, &other, WALL * element_edge(cut, hit.triangle))
    }))
}

/// Height above a surface at which walls on it are looked for, in edges of an element.
pub(crate) const WALL: f32 = 0.2;

/// Edge of an element about `triangle`, metres.
pub(crate) fn element_edge(cut: &Subdivision, triangle: u32) -> f32 {
    0.25 * cut.patch_edge(triangle)
}

/// A step of the solve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SolveStep {
    /// Rays a patch of the pass.
    pub rays: u32,
    /// Where its relaxation stood.
    #[serde(flatten)]
    pub step: RelaxStep,
}

/// What the solve did.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SolveReport {
    /// Regions, patches, elements.
    pub subdivision: Stats,
    /// Elements inside of things, which stand for nothing.
    pub buried_elements: u64,
    /// Pairs of neighbouring elements that something on their surface keeps apart.
    pub walled_elements: u64,
    /// Emissive triangles that direct light samples.
    pub emitters: usize,
    /// Patches whose direct light is computed anew at each hit.
    pub rough_patches: u64,
    /// Rays cast from each patch.
    pub rays_per_patch: u32,
    /// Rays between patches, in all.
    pub link_rays: u64,
    /// Shadow rays for direct light on elements.
    pub shadow_rays: u64,
    /// The relaxation, on the links of the last pass.
    pub relaxation: RelaxReport,
    /// The way to it through all passes, each with more rays than the one before and starting from its answer; with groups of light, one
    /// after the other in each pass.
    pub history: Vec<SolveStep>,
    /// Where the energy went.
    pub audit: Audit,
    /// The solve was stopped early; what is here is what had been reached.
    pub cancelled: bool,
    /// Memory of links and subdivision, bytes.
    pub bytes: u64,
}

impl Solution {
    /// Radiance that leaves the point `p`, which a ray found as `hit`, towards the ray's origin: ρE/π and gathered emission.
    ///
    /// Indirect light is interpolated between patches. Direct light comes from the point's element, or, on
    /// [`rough`](Solution::rough) patches, from the lights themselves with one shadow ray: else what an element's one point
    /// happened to see would shine from all of it (the ceiling just above a hanging lamp, the floor under a box's edge).
    /// `seed` decides where those rays go.
    #[inline]
    pub fn radiance(
        &self,
        world: &World,
        lights: &DirectLight,
        hit: &Hit,
        p: Vec3,
        seed: u32,
    ) -> Vec3 {
        let Some(at) = place(world, &self.cut, hit, p) else {
            return Vec3::ZERO;
        };
        let direct = if self.rough[at.patch.0 as usize] {
            let point = world.inset_point(hit.triangle, hit.u, hit.v, hit.back, false);
            lights.sample_on(&self.cut, at.patch, &point, seed).0
        } else {
            match at.element {
                Some(e) => self.direct[e.0 as usize],
                None => self.direct_mean[at.patch.0 as usize],
            }
        };
        let (taps, n) = self.cut.taps(hit.triangle, p, at);
        let mut indirect = Vec3::ZERO;
        for t in &taps[..n] {
            indirect += self.indirect[t.patch.0 as usize] * t.weight;
        }
        let reflectance = world.reflectance(hit.triangle, hit.u, hit.v);
        reflectance * (direct + indirect) * std::f32::consts::FRAC_1_PI
            + world.gathered_emission(hit.triangle, hit.u, hit.v)
    }

    /// Adds `throughput` times [`radiance`](Self::radiance) to `parts` by group of light, and says what it is in all.
    #[allow(
        clippy::too_many_arguments,
        reason = "what a hit is, what to do with it, and where to put it"
    )]
    pub fn radiance_by_group(
        &self,
        world: &World,
        lights: &DirectLight,
        hit: &Hit,
        p: Vec3,
        seed: u32,
        throughput: Vec3,
        parts: &mut [Vec3],
    ) -> Vec3 {
        let Some(groups) = &self.groups else {
            // One group of light is all of it.
            let light = throughput * self.radiance(world, lights, hit, p, seed);
            if let Some(all) = parts.first_mut() {
                *all += light;
            }
            return light;
        };
        let Some(at) = place(world, &self.cut, hit, p) else {
            return Vec3::ZERO;
        };
        let n = groups.count.min(parts.len());
        let reflectance = world.reflectance(hit.triangle, hit.u, hit.v);
        let reflected = throughput * reflectance * std::f32::consts::FRAC_1_PI;
        let mut light = Vec3::ZERO;
        let mut add = |group: usize, radiance: Vec3| {
            parts[group] += radiance;
            light += radiance;
        };
        if self.rough[at.patch.0 as usize] {
            let point = world.inset_point(hit.triangle, hit.u, hit.v, hit.back, false);
            let (direct, group) = lights.sample_on(&self.cut, at.patch, &point, seed);
            add(group, reflected * direct);
        } else {
            let direct = match at.element {
                Some(e) => &groups.direct[e.0 as usize * groups.count..],
                None => &groups.direct_mean[at.patch.0 as usize * groups.count..],
            };
            for (g, e) in direct[..n].iter().enumerate() {
                add(g, reflected * *e);
            }
        }
        let (taps, count) = self.cut.taps(hit.triangle, p, at);
        for t in &taps[..count] {
            let of_patch = &groups.indirect[t.patch.0 as usize * groups.count..];
            for (g, e) in of_patch[..n].iter().enumerate() {
                add(g, reflected * (*e * t.weight));
            }
        }
        let glow = world.gathered_emission(hit.triangle, hit.u, hit.v);
        if glow != Vec3::ZERO {
            add(world.emission_group(hit.triangle), throughput * glow);
        }
        light
    }

    /// Area-weighted mean irradiance.
    pub fn mean_irradiance(&self) -> DVec3 {
        let (mut sum, mut area) = (DVec3::ZERO, 0.0);
        for (i, p) in self.cut.patches().iter().enumerate() {
            sum += (self.direct_mean[i] + self.indirect[i]).as_dvec3() * p.area as f64;
            area += p.area as f64;
        }
        sum / area.max(1e-300)
    }
}
