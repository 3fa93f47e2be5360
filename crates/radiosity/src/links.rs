//! Rays between patches: the rows of the form-factor matrix.

use glam::{DVec3, Vec3};
use patch_subdivision::{Element, PatchId, Subdivision};
use rayon::prelude::*;

use crate::monitor::{Cancelled, Monitor, Phase};
use crate::sampling::{cosine_hemisphere, hash_u32, sample_4d};
use crate::solution::place;
use crate::world::{Incoming, SurfacePoint, World};

/// The ray left the scene.
pub(crate) const ESCAPED: u32 = u32::MAX;
/// The ray hit the back of a single-sided face, which is black.
pub(crate) const BLACK: u32 = u32::MAX - 1;
/// The ray hit a surface without a patch (a triangle too small for any cell of its region).
pub(crate) const NOWHERE: u32 = u32::MAX - 2;

/// What each patch sees: `rays` cosine-distributed rays from points spread over it, and the patch
/// that each of them hits.
///
/// F_ij is estimated by the share of row *i* that refers to *j*. In every scene, the shares of a
/// row (escaped rays included) sum to exactly 1. In a closed scene, the matrix therefore neither
/// creates nor loses energy, which the closed-form furnace test verifies.
pub(crate) struct Links {
    pub patches: usize,
    /// Number of rays cast per patch so far.
    pub rays: u32,
    stride: u32,
    targets: Vec<u32>,
    /// Colour transmitted along each ray, packed; empty if nothing colours light.
    tints: Vec<u32>,
    /// Number of light groups.
    groups: usize,
    /// Σ radiance over a patch's rays from everything but the reflection of other patches, i.e. the
    /// sky and gathered emission; by patch, then by group.
    source: Vec<Vec3>,
    /// The sky's part of `source`.
    sky: Vec<Vec3>,
}

impl Links {
    /// Allocates `stride` rays per patch of a world.
    pub(crate) fn of(world: &World, patches: usize, stride: u32) -> Self {
        let groups = world.group_count();
        let tints = if world.tinted() {
            vec![CLEAR; patches * stride as usize]
        } else {
            Vec::new()
        };
        Links {
            tints,
            groups,
            source: vec![Vec3::ZERO; patches * groups],
            ..Links::new(patches, stride)
        }
    }

    /// Allocates `stride` rays per patch, for one light group and colourless transmission.
    pub(crate) fn new(patches: usize, stride: u32) -> Self {
        Links {
            patches,
            rays: 0,
            stride,
            targets: vec![ESCAPED; patches * stride as usize],
            tints: Vec::new(),
            groups: 1,
            source: vec![Vec3::ZERO; patches],
            sky: vec![Vec3::ZERO; patches],
        }
    }

    /// For each ray of a patch, in row order, the element from which it started (index within the
    /// patch).
    pub(crate) fn origins<'c>(
        &self,
        cut: &'c Subdivision,
        patch: PatchId,
    ) -> impl Iterator<Item = usize> + use<'c> {
        let elements = &cut.elements()[cut.elements_of(patch)];
        let area: f32 = elements.iter().map(|e| e.area).sum();
        let sequence = Sequence::of(cut, patch, self.stride);
        (0..self.rays).map(move |k| pick(elements, area, sequence.sample(k)[2]))
    }

    /// Number of a patch's rays that left the scene.
    pub(crate) fn escaped_rays(&self, patch: usize) -> usize {
        self.row(patch).iter().filter(|&&to| to == ESCAPED).count()
    }

    /// Directions of these rays.
    pub(crate) fn escaped<'l>(
        &'l self,
        world: &'l World,
        cut: &'l Subdivision,
        patch: PatchId,
    ) -> impl Iterator<Item = Vec3> + use<'l> {
        let start = Start::of(cut, patch);
        let sequence = Sequence::of(cut, patch, self.stride);
        (self.row(patch.0 as usize).iter().enumerate())
            .filter(|(_, target)| **target == ESCAPED)
            .map(move |(k, _)| {
                let s = sequence.sample(k as u32);
                cosine_hemisphere(start.point(world, s[2]).normal, s[0], s[1])
            })
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (self.targets.len() * 4
            + self.tints.len() * 4
            + (self.source.len() + self.sky.len()) * size_of::<Vec3>()) as u64
    }

    /// The row of a patch.
    pub(crate) fn row(&self, patch: usize) -> &[u32] {
        let at = patch * self.stride as usize;
        &self.targets[at..at + self.rays as usize]
    }

    /// Whether transmission between patches is coloured.
    pub(crate) fn tinted(&self) -> bool {
        !self.tints.is_empty()
    }

    /// Transmittance along ray `k` of a patch.
    pub(crate) fn tint(&self, patch: usize, k: usize) -> DVec3 {
        match self.tints.get(patch * self.stride as usize + k) {
            Some(&packed) => unpack(packed),
            None => DVec3::ONE,
        }
    }

    /// Σ over a patch's rays of `radiosity` at the other end times transmittance.
    pub(crate) fn gather(&self, patch: usize, radiosity: &[DVec3]) -> DVec3 {
        let mut sum = DVec3::ZERO;
        // Escaped and black rays have indices past the end.
        if self.tinted() {
            for (k, &j) in self.row(patch).iter().enumerate() {
                if let Some(b) = radiosity.get(j as usize) {
                    sum += *b * self.tint(patch, k);
                }
            }
        } else {
            for &j in self.row(patch) {
                if let Some(b) = radiosity.get(j as usize) {
                    sum += *b;
                }
            }
        }
        sum
    }

    /// Irradiance of a patch from the sky and from gathered emission of a group.
    pub(crate) fn source(&self, patch: usize, group: usize) -> Vec3 {
        let sum = self.source[patch * self.groups + group];
        sum * (std::f32::consts::PI / self.rays.max(1) as f32)
    }

    /// Irradiance of a patch from the sky and from gathered emission of all groups.
    pub(crate) fn all_sources(&self, patch: usize) -> Vec3 {
        (0..self.groups).map(|g| self.source(patch, g)).sum()
    }

    /// Irradiance of a patch from the sky alone.
    pub(crate) fn sky(&self, patch: usize) -> Vec3 {
        self.sky[patch] * (std::f32::consts::PI / self.rays.max(1) as f32)
    }

    /// Casts rays until every patch has `rays`. If cancelled, it leaves the links of all patches
    /// unchanged.
    pub(crate) fn extend(
        &mut self,
        world: &World,
        cut: &Subdivision,
        rays: u32,
        monitor: &dyn Monitor,
    ) -> Result<(), Cancelled> {
        const BLOCK: usize = 64;
        let rays = rays.min(self.stride);
        let (from, stride) = (self.rays, self.stride as usize);
        let sources_before = (self.source.clone(), self.sky.clone());
        let done = std::sync::atomic::AtomicU64::new(0);
        let total = (self.patches as u64) * (rays - from) as u64;
        let tinted = self.tinted();
        let groups = self.groups;
        // Rows of tints next to the rows of targets, if there are any.
        let mut no_tints: Vec<&mut [u32]> = Vec::new();
        let blocks = self.patches.div_ceil(BLOCK);
        let tints: Vec<&mut [u32]> = if tinted {
            self.tints.chunks_mut(stride * BLOCK).collect()
        } else {
            no_tints.resize_with(blocks, || &mut []);
            no_tints
        };
        let sources = self.source.par_chunks_mut(groups * BLOCK);
        let skies = self.sky.par_chunks_mut(BLOCK);
        self.targets
            .par_chunks_mut(stride * BLOCK)
            .zip(tints)
            .zip(sources)
            .zip(skies)
            .enumerate()
            .for_each(|(block, (((rows, tints), source), skies))| {
                if monitor.cancelled() {
                    return;
                }
                let mut n = 0u64;
                let range = from as usize..rays as usize;
                for (k, row) in rows.chunks_mut(stride).enumerate() {
                    let patch = PatchId((block * BLOCK + k) as u32);
                    n += (rays - from) as u64;
                    if cut.patches()[patch.0 as usize].hidden {
                        // It neither receives nor sends anything.
                        row[range.clone()].fill(BLACK);
                        continue;
                    }
                    let range = range.clone();
                    let mut out = Row {
                        sequence: Sequence::of(cut, patch, stride as u32),
                        from,
                        targets: &mut row[range.clone()],
                        tints: if tinted {
                            &mut tints[k * stride..][range]
                        } else {
                            &mut []
                        },
                        source: &mut source[k * groups..(k + 1) * groups],
                        sky: &mut skies[k],
                    };
                    cast(world, cut, patch, &mut out);
                }
                let now = done.fetch_add(n, std::sync::atomic::Ordering::Relaxed) + n;
                monitor.progress(Phase::Links, now, total);
            });
        if done.into_inner() != total {
            // The sources of finished rows already include the new rays, so they are restored.
            self.source = sources_before.0;
            self.sky = sources_before.1;
            return Err(Cancelled);
        }
        self.rays = rays;
        Ok(())
    }
}

/// Most patches whose rays are blocks of one sequence.
const TOGETHER: u32 = 256;

/// Number of points of [`sample_4d`].
const POINTS: u32 = 1 << 16;

/// The random numbers of a patch's rays.
///
/// Neighbouring patches take successive blocks of one Sobol sequence, so that their rays are also
/// well distributed together. What they find is averaged over all of them: the light of a window or
/// of a sunlit spot, which each of them rarely hits. With a sequence for each patch, the level of
/// light in the rooms of a kit at `draft` varied with the seed by 8 %, now by 2 to 4 %
/// (lab/unseen_levels.md).
#[derive(Clone, Copy)]
pub(crate) struct Sequence {
    set: u32,
    seed: u32,
    first: u32,
}

impl Sequence {
    /// For at most `stride` rays per patch.
    fn of(cut: &Subdivision, patch: PatchId, stride: u32) -> Sequence {
        Sequence::from_set(0, cut, patch, stride)
    }

    /// The same with another set of random numbers.
    pub(crate) fn from_set(set: u32, cut: &Subdivision, patch: PatchId, stride: u32) -> Sequence {
        let name = cut.patches()[patch.0 as usize].name;
        let block = stride.next_power_of_two();
        let together = (POINTS / block).clamp(1, TOGETHER);
        Sequence {
            set,
            seed: hash_u32((name / together) ^ 0x5bd1_e995),
            first: name % together * block,
        }
    }

    /// For ray `k` of the patch.
    pub(crate) fn sample(self, k: u32) -> [f32; 4] {
        sample_4d(self.first + k, self.set, self.seed)
    }
}

/// The patch element from which a ray with third sample dimension `x` starts: by area, where `area`
/// is their sum.
pub(crate) fn pick(elements: &[Element], area: f32, x: f32) -> usize {
    let mut left = x * area;
    for (k, e) in elements.iter().enumerate() {
        if left < e.area {
            return k;
        }
        left -= e.area;
    }
    elements.len() - 1
}

/// Where the rays of a patch start.
struct Start<'c> {
    elements: &'c [Element],
    area: f32,
    back: bool,
}

impl<'c> Start<'c> {
    fn of(cut: &'c Subdivision, patch: PatchId) -> Self {
        let elements = &cut.elements()[cut.elements_of(patch)];
        Start {
            elements,
            area: elements.iter().map(|e| e.area).sum(),
            back: cut.patches()[patch.0 as usize].back,
        }
    }

    /// The point of a random number: that of an element.
    fn point(&self, world: &World, x: f32) -> SurfacePoint {
        let e = &self.elements[pick(self.elements, self.area, x)];
        world.inset_point(e.triangle, e.u, e.v, self.back, false)
    }
}

/// Where the rays of one patch are written.
struct Row<'l> {
    sequence: Sequence,
    /// The index of the first ray.
    from: u32,
    targets: &'l mut [u32],
    /// Empty if transmission is colourless.
    tints: &'l mut [u32],
    /// Sums of radiance by group, and from the sky.
    source: &'l mut [Vec3],
    sky: &'l mut Vec3,
}

/// Casts rays of a patch and sums the radiance that is not reflected.
fn cast(world: &World, cut: &Subdivision, patch: PatchId, out: &mut Row) {
    let start = Start::of(cut, patch);
    // Summed separately first, because short sums round less.
    let mut source = [Vec3::ZERO; 2];
    for (k, target) in out.targets.iter_mut().enumerate() {
        let s = out.sequence.sample(out.from + k as u32);
        let p = start.point(world, s[2]);
        let direction = cosine_hemisphere(p.normal, s[0], s[1]);
        let (found, tint) = world.incoming(p.origin, direction);
        if let Some(slot) = out.tints.get_mut(k) {
            *slot = pack(tint);
        }
        *target = match found {
            Incoming::Escaped => {
                source[0] += world.sky.radiance(direction) * tint;
                ESCAPED
            }
            Incoming::Black => BLACK,
            Incoming::Surface(hit) => {
                let glow = world.gathered_emission(hit.triangle, hit.u, hit.v) * tint;
                if out.source.len() == 1 {
                    source[1] += glow;
                } else {
                    out.source[world.emission_group(hit.triangle)] += glow;
                }
                match place(world, cut, &hit, p.origin + direction * hit.t) {
                    Some(at) => at.patch.0,
                    None => NOWHERE,
                }
            }
        };
    }
    out.source[world.sky_group()] += source[0];
    out.source[0] += source[1];
    *out.sky += source[0];
}

/// Full transmission.
const CLEAR: u32 = u32::MAX;

/// Ten bits per channel: steps of a thousandth, for light that is averaged over many rays.
fn pack(tint: Vec3) -> u32 {
    let bits = tint
        .to_array()
        .map(|x| (x.clamp(0.0, 1.0) * 1023.0 + 0.5) as u32);
    0xc000_0000 | bits[0] << 20 | bits[1] << 10 | bits[2]
}

fn unpack(packed: u32) -> DVec3 {
    let part = |shift: u32| f64::from(packed >> shift & 1023) / 1023.0;
    DVec3::new(part(20), part(10), part(0))
}

#[cfg(test)]
mod tests;
