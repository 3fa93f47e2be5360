//! The solved light of a scene.

use glam::{DVec3, Vec3};
use patch_subdivision::{ElementId, Locus, PatchId, Stats, Subdivision, Tap};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use visibility::Hit;

use crate::audit::Audit;
use crate::direct::DirectLight;
use crate::openings::Openings;
use crate::relax::{RelaxReport, RelaxStep};
use crate::world::{World, luminance};

/// Irradiance of every element and patch, ready for the final gather.
pub struct Solution {
    /// The subdivision of the surfaces.
    pub cut: Subdivision,
    /// Direct irradiance per element.
    pub direct: Vec<Vec3>,
    /// Mean reflectance per element.
    pub reflectance: Vec<Vec3>,
    /// Mean direct irradiance per patch.
    pub direct_mean: Vec<Vec3>,
    /// Indirect irradiance per patch: reflected light, the sky, and emission that rays gather.
    pub indirect: Vec<Vec3>,
    /// Patches whose direct light varies too much for their elements to represent it: at a shadow
    /// edge, near a lamp, or with a wall on them.
    pub rough: Vec<bool>,
    /// The same by light group, if groups are separate.
    pub groups: Option<GroupLight>,
    /// By element, computed from the light above when the solve ended or [`refresh`](Self::refresh)
    /// was called.
    pub(crate) afar: Vec<Afar>,
    /// Directions of the sky from indoors.
    pub openings: Openings,
    /// Statistics of the solve.
    pub report: SolveReport,
}

/// The irradiances of [`Solution`] by light group: those of element or patch *i* and group *g* are
/// at *i* × `count` + *g*.
#[derive(Debug, Default)]
pub struct GroupLight {
    /// Number of groups.
    pub count: usize,
    /// Direct irradiance per element.
    pub direct: Vec<Vec3>,
    /// Mean direct irradiance per patch.
    pub direct_mean: Vec<Vec3>,
    /// Indirect irradiance per patch.
    pub indirect: Vec<Vec3>,
}

/// An element as seen from a distance: everything that a gathering ray needs to know about it, in
/// one place.
///
/// Beyond a patch's size, an element covers a small part of the view, and the mean represents its
/// texture and indirect light well. A ray then does not need to read a texture and four patches.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Afar {
    direct: Vec3,
    /// [`World::pattern`] of the triangle of its point.
    pattern: u32,
    /// Interpolated to the centre of its cell.
    indirect: Vec3,
    /// Position of that centre on the region's grid.
    q: [f32; 2],
    /// Mean reflectance around its point, of triangles with this pattern.
    reflectance: Vec3,
}

impl Afar {
    /// For all elements. O(elements).
    pub(crate) fn collect(
        world: &World,
        cut: &Subdivision,
        direct: &[Vec3],
        reflectance: &[Vec3],
        indirect: &[Vec3],
    ) -> Vec<Afar> {
        let of_patch = |patch: usize| {
            let patch = PatchId(patch as u32);
            cut.elements_of(patch).map(move |e| {
                let triangle = cut.elements()[e].triangle;
                let element = ElementId(e as u32);
                let q = cut.middle(element, world.soup);
                let at = Locus {
                    patch,
                    element: Some(element),
                };
                let taps = cut.taps_at(q, at);
                let light = taps.map(|(taps, n)| interpolated(indirect, &taps[..n]));
                let afar = Afar {
                    direct: direct[e],
                    pattern: world.pattern(triangle),
                    indirect: light.unwrap_or_default(),
                    q,
                    reflectance: world.even_reflectance(triangle).unwrap_or(reflectance[e]),
                };
                (e, afar)
            })
        };
        let found: Vec<(usize, Afar)> = (0..cut.patches().len())
            .into_par_iter()
            .with_min_len(64)
            .flat_map_iter(of_patch)
            .collect();
        let mut out = vec![Afar::default(); cut.elements().len()];
        for (e, afar) in found {
            out[e] = afar;
        }
        out
    }
}

/// Irradiance interpolated between patches.
#[inline]
fn interpolated(indirect: &[Vec3], taps: &[Tap]) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for t in taps {
        sum += indirect[t.patch.0 as usize] * t.weight;
    }
    sum
}

/// Patch and element of the point `p` of a `hit`, on its side of walls that stand on the surface.
/// Returns `None` like [`Subdivision::locate`].
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

/// Height above a surface at which walls on it are searched for, in element edges.
pub(crate) const WALL: f32 = 0.2;

/// Edge length of an element around `triangle`, in metres.
pub(crate) fn element_edge(cut: &Subdivision, triangle: u32) -> f32 {
    0.25 * cut.patch_edge(triangle)
}

/// A step of the solve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SolveStep {
    /// Rays per patch in this pass.
    pub rays: u32,
    /// State of its relaxation.
    #[serde(flatten)]
    pub step: RelaxStep,
}

/// Statistics of a solve.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct SolveReport {
    /// Numbers of regions, patches and elements.
    pub subdivision: Stats,
    /// Elements inside objects, which are excluded from their patches' means.
    pub buried_elements: u64,
    /// Pairs of neighbouring elements that an object on their surface separates.
    pub walled_elements: u64,
    /// Patches of one element each, where something is close.
    pub fine_patches: u64,
    /// Emissive triangles that direct light samples.
    pub emitters: usize,
    /// Patches whose direct light is computed again at each hit.
    pub rough_patches: u64,
    /// Rays cast from each patch; those with much nearby, which are divided, cast a quarter from each
    /// part. Where light is reflected often, or few rays bring it, four times as many.
    pub rays_per_patch: u32,
    /// Total number of rays between patches, including those of hidden patches, which are not cast.
    pub link_rays: u64,
    /// Shadow rays for direct light on elements.
    pub shadow_rays: u64,
    /// The relaxation of the last pass.
    pub relaxation: RelaxReport,
    /// The steps of all passes, each with more rays than the previous one and starting from its
    /// result. With light groups, the steps of each pass are listed group after group.
    pub history: Vec<SolveStep>,
    /// The energy balance.
    pub audit: Audit,
    /// Whether the solve was stopped early. The solution is then the last intermediate result.
    pub cancelled: bool,
    /// Memory of links, subdivision and the light of elements, in bytes.
    pub bytes: u64,
}

impl Solution {
    /// Recomputes the elements as seen from a distance, after the light was changed.
    pub fn refresh(&mut self, world: &World) {
        self.afar = Afar::collect(
            world,
            &self.cut,
            &self.direct,
            &self.reflectance,
            &self.indirect,
        );
    }

    /// Radiance that leaves the point `p` of a `hit` towards the ray's origin: ρE/π and gathered
    /// emission.
    ///
    /// Indirect light is interpolated between patches. Direct light is that of the point's element
    /// or, on [`rough`](Solution::rough) patches, sampled from the lights with one shadow ray.
    /// Otherwise, the direct light at an element's one point would represent all of it (as on the
    /// ceiling just above a hanging lamp, or on the floor under the edge of a box). `seed`
    /// determines the directions of these rays.
    #[inline]
    pub fn radiance(
        &self,
        world: &World,
        lights: &DirectLight,
        hit: &Hit,
        p: Vec3,
        seed: u32,
    ) -> Vec3 {
        let all = Look {
            hit: *hit,
            at: p,
            seed,
            of: Reflected::All,
        };
        self.radiance_sent(world, lights, &all).light
    }

    /// [`radiance`](Self::radiance), or a part of it.
    #[inline]
    pub fn radiance_sent(&self, world: &World, lights: &DirectLight, look: &Look) -> Sent {
        let Look { hit, at: p, .. } = look;
        let (p, seed, of) = (*p, look.seed, look.of);
        let Some(at) = place(world, &self.cut, hit, p) else {
            return Sent::default();
        };
        let glow = world.gathered_emission(hit.triangle, hit.u, hit.v);
        if let Some(afar) = self.afar(at, of) {
            let kept = of.kept(afar.direct);
            let reflectance = match afar.pattern == world.pattern(hit.triangle) {
                true => afar.reflectance,
                false => world.reflectance(hit.triangle, hit.u, hit.v),
            };
            return Sent {
                light: sent(reflectance, afar.direct * kept, afar.indirect, glow),
                left_out: kept < 1.0,
            };
        }
        let kept = self.kept(at, of);
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
        let reflectance = world.reflectance(hit.triangle, hit.u, hit.v);
        let indirect = interpolated(&self.indirect, &taps[..n]);
        Sent {
            light: sent(reflectance, direct * kept, indirect, glow),
            left_out: kept < 1.0,
        }
    }

    /// A place as seen from a distance, if requested.
    #[inline]
    fn afar(&self, at: Locus, of: Reflected) -> Option<&Afar> {
        match (of, at.element) {
            (Reflected::Afar(_), Some(e)) if !self.rough[at.patch.0 as usize] => {
                self.afar.get(e.0 as usize)
            }
            _ => None,
        }
    }

    /// The requested share of the direct light at a place.
    #[inline]
    fn kept(&self, at: Locus, of: Reflected) -> f32 {
        match at.element {
            Some(e) if !self.rough[at.patch.0 as usize] => of.kept(self.direct[e.0 as usize]),
            _ => 1.0,
        }
    }

    /// Returns `throughput` times [`radiance_sent`](Self::radiance_sent), and adds it to `parts` by
    /// light group unless `parts` is empty.
    #[inline]
    pub fn radiance_by_group(
        &self,
        world: &World,
        lights: &DirectLight,
        look: &Look,
        throughput: Vec3,
        parts: &mut [Vec3],
    ) -> Sent {
        let Some(groups) = self.groups.as_ref().filter(|_| !parts.is_empty()) else {
            // With a single light group, all light belongs to it.
            let mut sent = self.radiance_sent(world, lights, look);
            sent.light *= throughput;
            if let Some(all) = parts.first_mut() {
                *all += sent.light;
            }
            return sent;
        };
        let Look { hit, at: p, .. } = look;
        let (p, seed, of) = (*p, look.seed, look.of);
        let Some(at) = place(world, &self.cut, hit, p) else {
            return Sent::default();
        };
        let kept = self.kept(at, of);
        let drawn = self.rough[at.patch.0 as usize].then(|| {
            let point = world.inset_point(hit.triangle, hit.u, hit.v, hit.back, false);
            lights.sample_on(&self.cut, at.patch, &point, seed)
        });
        let (q, reflectance) = self.seen(world, hit, p, at, of);
        let reflectance =
            reflectance.unwrap_or_else(|| world.reflectance(hit.triangle, hit.u, hit.v));
        let Some((taps, count)) = self.cut.taps_at(q, at) else {
            return Sent::default();
        };
        let glow = world.gathered_emission(hit.triangle, hit.u, hit.v);
        let glow = (glow, world.emission_group(hit.triangle));
        let taps = &taps[..count];
        sent_by_group(
            groups,
            throughput,
            reflectance,
            (at, drawn, kept),
            taps,
            glow,
            parts,
        )
    }

    /// Grid position at which indirect light is read for a hit, and the element's reflectance if
    /// that is used.
    #[inline]
    fn seen(
        &self,
        world: &World,
        hit: &Hit,
        p: Vec3,
        at: Locus,
        of: Reflected,
    ) -> ([f32; 2], Option<Vec3>) {
        match self.afar(at, of) {
            Some(afar) if afar.pattern == world.pattern(hit.triangle) => {
                (afar.q, Some(afar.reflectance))
            }
            Some(afar) => (afar.q, None),
            None => (self.cut.project(hit.triangle, p), None),
        }
    }

    /// Intensity along the normal of element `e` per unit of irradiance: reflectance × area / π.
    pub fn intensity_of_irradiance(&self, e: usize) -> Vec3 {
        self.reflectance[e] * (self.cut.elements()[e].area * std::f32::consts::FRAC_1_PI)
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

/// A hit for which the radiance towards the ray's origin is requested.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    /// The hit.
    pub hit: Hit,
    /// Its position in metres, recentred.
    pub at: Vec3,
    /// Determines the directions of shadow rays.
    pub seed: u32,
    /// The requested part of the light.
    pub of: Reflected,
}

/// The requested part of the light that a surface reflects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reflected {
    /// All of it.
    All,
    /// The element as seen from a distance, with only the share of light from lamps and emitters
    /// that [`of_lit`] of this value leaves.
    Afar(f32),
}

impl Reflected {
    /// The requested share of `direct` irradiance.
    #[inline]
    fn kept(self, direct: Vec3) -> f32 {
        match self {
            Reflected::All => 1.0,
            Reflected::Afar(share) => 1.0 - of_lit(share, luminance(direct)),
        }
    }
}

/// Radiance that a point sends, given its light.
#[inline]
fn sent(reflectance: Vec3, direct: Vec3, indirect: Vec3, glow: Vec3) -> Vec3 {
    reflectance * (direct + indirect) * std::f32::consts::FRAC_1_PI + glow
}

/// The share of a lit element's direct light (of luminance `direct`) that is sampled, where `s` is
/// the share of gathering rays per luminance: the balance heuristic.
#[inline]
pub fn of_lit(s: f32, direct: f32) -> f32 {
    let x = s * direct;
    x / (1.0 + x)
}

/// Radiance of a surface.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sent {
    /// The requested radiance.
    pub light: Vec3,
    /// Whether there is more that was not requested.
    pub left_out: bool,
}

/// Adds the radiance of a point to `parts` by light group, and returns the total.
#[inline]
fn sent_by_group(
    groups: &GroupLight,
    throughput: Vec3,
    reflectance: Vec3,
    (at, drawn, kept): (Locus, Option<(Vec3, usize)>, f32),
    taps: &[Tap],
    (glow, glow_group): (Vec3, usize),
    parts: &mut [Vec3],
) -> Sent {
    let n = groups.count.min(parts.len());
    let reflected = throughput * reflectance * std::f32::consts::FRAC_1_PI;
    let mut light = Vec3::ZERO;
    let mut add = |group: usize, radiance: Vec3| {
        parts[group] += radiance;
        light += radiance;
    };
    if let Some((direct, group)) = drawn {
        add(group, reflected * direct);
    } else {
        let direct = match at.element {
            Some(e) => &groups.direct[e.0 as usize * groups.count..],
            None => &groups.direct_mean[at.patch.0 as usize * groups.count..],
        };
        for (g, e) in direct[..n].iter().enumerate() {
            add(g, reflected * (*e * kept));
        }
    }
    for t in taps {
        let of_patch = &groups.indirect[t.patch.0 as usize * groups.count..];
        for (g, e) in of_patch[..n].iter().enumerate() {
            add(g, reflected * (*e * t.weight));
        }
    }
    if glow != Vec3::ZERO {
        add(glow_group, throughput * glow);
    }
    Sent {
        light,
        left_out: kept < 1.0,
    }
}

#[cfg(test)]
mod tests;
