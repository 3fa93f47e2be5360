//! The solved light of a scene.

use glam::{DVec3, Vec3};
use patch_subdivision::{ElementId, Locus, PatchId, Stats, Subdivision, Tap};
use rayon::prelude::*;
use serde::Serialize;
use visibility::Hit;

use crate::audit::Audit;
use crate::direct::DirectLight;
use crate::relax::{RelaxReport, RelaxStep};
use crate::world::{World, luminance};

/// Irradiance of every element and patch, ready to be gathered from.
pub struct Solution {
    /// The surfaces' subdivision.
    pub cut: Subdivision,
    /// Direct irradiance per element.
    pub direct: Vec<Vec3>,
    /// Mean reflectance per element.
    pub reflectance: Vec<Vec3>,
    /// Mean direct irradiance per patch.
    pub direct_mean: Vec<Vec3>,
    /// Indirect irradiance per patch: reflected light, the sky, and emission that rays gather.
    pub indirect: Vec<Vec3>,
    /// Patches over which direct light changes too much for their elements to stand for it: a
    /// shadow's edge, a lamp close by, a wall that stands on them.
    pub rough: Vec<bool>,
    /// The same by group of light, where groups are kept apart.
    pub groups: Option<GroupLight>,
    /// By element; of the light above when the solve ended, or [`refresh`](Self::refresh) was
    /// called.
    pub(crate) afar: Vec<Afar>,
    /// How it was reached.
    pub report: SolveReport,
}

/// [`Solution`]'s irradiances by group of light: of element or patch *i* and group *g* at *i* ×
/// `count` + *g*.
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

/// An element as it is seen from afar: all that a gathering ray needs of it, in one place.
///
/// From beyond a patch's size an element fills a small part of what is seen, and what changes
/// within it, texture and indirect light, is as good as its mean: a ray need not read a texture and
/// four patches for it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Afar {
    direct: Vec3,
    triangle: u32,
    /// Interpolated to the middle of its cell.
    indirect: Vec3,
    /// Where that is on the region's grid.
    q: [f32; 2],
    /// Mean reflectance about its point, as long as that lies on the same triangle.
    reflectance: Vec3,
}

impl Afar {
    /// Of all elements. O(elements).
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
                    triangle,
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

/// Patch and element of the point `p`, which a ray found as `hit`: on its side of walls that stand
/// on the surface. `None` as [`Subdivision::locate`].
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
    /// Patches that are one element each, where something stands close.
    pub fine_patches: u64,
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
    /// The way to it through all passes, each with more rays than the one before and starting from
    /// its answer; with groups of light, one after the other in each pass.
    pub history: Vec<SolveStep>,
    /// Where the energy went.
    pub audit: Audit,
    /// The solve was stopped early; what is here is what had been reached.
    pub cancelled: bool,
    /// Memory of links, subdivision and the light of elements, bytes.
    pub bytes: u64,
}

impl Solution {
    /// Makes anew what is seen from afar, after the light was changed.
    pub fn refresh(&mut self, world: &World) {
        self.afar = Afar::collect(
            world,
            &self.cut,
            &self.direct,
            &self.reflectance,
            &self.indirect,
        );
    }

    /// Radiance that leaves the point `p`, which a ray found as `hit`, towards the ray's origin:
    /// ρE/π and gathered emission.
    ///
    /// Indirect light is interpolated between patches. Direct light comes from the point's element,
    /// or, on [`rough`](Solution::rough) patches, from the lights themselves with one shadow ray:
    /// else what an element's one point happened to see would shine from all of it (the ceiling
    /// just above a hanging lamp, the floor under a box's edge). `seed` decides where those rays
    /// go.
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
            let reflectance = match afar.triangle == hit.triangle {
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

    /// What a place looks like from afar, if that is asked for.
    #[inline]
    fn afar(&self, at: Locus, of: Reflected) -> Option<&Afar> {
        match (of, at.element) {
            (Reflected::Afar(_), Some(e)) if !self.rough[at.patch.0 as usize] => {
                self.afar.get(e.0 as usize)
            }
            _ => None,
        }
    }

    /// What share of the direct light of a place is asked for.
    #[inline]
    fn kept(&self, at: Locus, of: Reflected) -> f32 {
        match at.element {
            Some(e) if !self.rough[at.patch.0 as usize] => of.kept(self.direct[e.0 as usize]),
            _ => 1.0,
        }
    }

    /// `throughput` times what [`radiance_sent`](Self::radiance_sent) says. It is added to `parts`
    /// by group of light, unless these are empty.
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
            // One group of light is all of it.
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
        let (q, reflectance) = self.seen(hit, p, at, of);
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

    /// Where on its region's grid indirect light is read for a hit, and the element's reflectance
    /// where that is what counts.
    #[inline]
    fn seen(&self, hit: &Hit, p: Vec3, at: Locus, of: Reflected) -> ([f32; 2], Option<Vec3>) {
        match self.afar(at, of) {
            Some(afar) if afar.triangle == hit.triangle => (afar.q, Some(afar.reflectance)),
            Some(afar) => (afar.q, None),
            None => (self.cut.project(hit.triangle, p), None),
        }
    }

    /// Intensity along the normal of element `e` for each irradiance on it: reflectance × area / π.
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

/// A hit whose radiance towards the ray's origin is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    /// What the ray hit, and where.
    pub hit: Hit,
    /// See `hit`; metres, recentred.
    pub at: Vec3,
    /// Decides where shadow rays go.
    pub seed: u32,
    /// What of the light counts.
    pub of: Reflected,
}

/// What of the light that a surface reflects is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reflected {
    /// All of it.
    All,
    /// All that is seen of its element from afar, but of what lamps and emitters bring to that only
    /// what [`of_lit`] of this leaves.
    Afar(f32),
}

impl Reflected {
    /// What share of `direct` irradiance is asked for.
    #[inline]
    fn kept(self, direct: Vec3) -> f32 {
        match self {
            Reflected::All => 1.0,
            Reflected::Afar(share) => 1.0 - of_lit(share, luminance(direct)),
        }
    }
}

/// Radiance that a point sends, given the light on it.
#[inline]
fn sent(reflectance: Vec3, direct: Vec3, indirect: Vec3, glow: Vec3) -> Vec3 {
    reflectance * (direct + indirect) * std::f32::consts::FRAC_1_PI + glow
}

/// The share of a lit element's direct light (of that luminance) that is sampled there, where `s`
/// is the share of gathering rays, per luminance: the balance heuristic.
#[inline]
pub fn of_lit(s: f32, direct: f32) -> f32 {
    let x = s * direct;
    x / (1.0 + x)
}

/// Radiance of a surface.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sent {
    /// What was asked for.
    pub light: Vec3,
    /// There is more, which was not.
    pub left_out: bool,
}

/// Adds what a point sends to `parts` by group of light, and says what it is in all.
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
