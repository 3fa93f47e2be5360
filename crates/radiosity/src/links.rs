//! Rays between patches: the rows of the form-factor matrix.

use std::ops::Range;

use glam::{DVec3, Vec3};
use patch_subdivision::{Element, Patch, PatchId, Subdivision};
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

/// What each patch sees: cosine-distributed rays from points spread over it, and the patch that each
/// of them hits.
///
/// F_ij is estimated by the share of row *i* that refers to *j*. In every scene, the shares of a
/// row (escaped rays included) sum to exactly 1. In a closed scene, the matrix therefore neither
/// creates nor loses energy, which the closed-form furnace test verifies.
pub(crate) struct Links {
    pub patches: usize,
    /// Rays per patch, as planned; some patches may get [`TIMES`] as many, and those of
    /// [`rays_of_patch`] fewer.
    planned: u32,
    /// The rays of patch *i* are `starts[i]..starts[i + 1]`.
    starts: Vec<usize>,
    targets: Vec<u32>,
    /// Colour transmitted along each ray, packed; empty if nothing colours light.
    tints: Vec<u32>,
    tinted: bool,
    /// Number of light groups.
    groups: usize,
    /// Σ radiance over a patch's rays from everything but the reflection of other patches, i.e. the
    /// sky and gathered emission; by patch, then by group.
    source: Vec<Vec3>,
    /// The sky's part of `source`.
    sky: Vec<Vec3>,
}

impl Links {
    /// None yet, for `planned` rays per patch of a world.
    pub(crate) fn of(world: &World, patches: usize, planned: u32) -> Self {
        let groups = world.group_count();
        Links {
            tinted: world.tinted(),
            groups,
            source: vec![Vec3::ZERO; patches * groups],
            ..Links::new(patches, planned)
        }
    }

    /// The same for one light group and colourless transmission.
    pub(crate) fn new(patches: usize, planned: u32) -> Self {
        Links {
            patches,
            planned,
            starts: vec![0; patches + 1],
            targets: Vec::new(),
            tints: Vec::new(),
            tinted: false,
            groups: 1,
            source: vec![Vec3::ZERO; patches],
            sky: vec![Vec3::ZERO; patches],
        }
    }

    /// Number of rays of all patches.
    pub(crate) fn count(&self) -> usize {
        self.targets.len()
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
        let random = RowSequence::of(cut, patch, self.planned);
        let rays = self.row(patch.0 as usize).len() as u32;
        (0..rays).map(move |k| pick(elements, area, random.sample(k)[2]))
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
        let random = RowSequence::of(cut, patch, self.planned);
        (self.row(patch.0 as usize).iter().enumerate())
            .filter(|(_, target)| **target == ESCAPED)
            .map(move |(k, _)| {
                let s = random.sample(k as u32);
                cosine_hemisphere(start.point(world, s[2]).normal, s[0], s[1])
            })
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&self.starts[..])
            + size_of_val(&self.targets[..])
            + size_of_val(&self.tints[..])
            + size_of_val(&self.source[..])
            + size_of_val(&self.sky[..])) as u64
    }

    fn rays_of(&self, patch: usize) -> Range<usize> {
        self.starts[patch]..self.starts[patch + 1]
    }

    /// The row of a patch.
    pub(crate) fn row(&self, patch: usize) -> &[u32] {
        &self.targets[self.rays_of(patch)]
    }

    /// Transmittance along ray `k` of a patch.
    pub(crate) fn tint(&self, patch: usize, k: usize) -> DVec3 {
        match self.tints.get(self.starts[patch] + k) {
            Some(&packed) => unpack(packed),
            None => DVec3::ONE,
        }
    }

    /// Mean over a patch's rays of `radiosity` at the other end times transmittance.
    pub(crate) fn gather(&self, patch: usize, radiosity: &[DVec3]) -> DVec3 {
        self.mean(patch, |j| radiosity.get(j).copied())
    }

    /// The same of what `at` says of the patch at the other end: nothing of those past the end,
    /// which escaped and black rays have.
    #[inline]
    pub(crate) fn mean(&self, patch: usize, at: impl Fn(usize) -> Option<DVec3>) -> DVec3 {
        let (mut sum, row) = (DVec3::ZERO, self.row(patch));
        if self.tints.is_empty() {
            for b in row.iter().filter_map(|&j| at(j as usize)) {
                sum += b;
            }
        } else {
            for (&j, &tint) in row.iter().zip(&self.tints[self.rays_of(patch)]) {
                if let Some(b) = at(j as usize) {
                    sum += b * unpack(tint);
                }
            }
        }
        sum * (1.0 / row.len().max(1) as f64)
    }

    /// Irradiance of a patch from the sky and from gathered emission of a group.
    pub(crate) fn source(&self, patch: usize, group: usize) -> Vec3 {
        let sum = self.source[patch * self.groups + group];
        sum * self.per_ray(patch)
    }

    /// Irradiance of a patch from the sky and from gathered emission of all groups.
    pub(crate) fn all_sources(&self, patch: usize) -> Vec3 {
        (0..self.groups).map(|g| self.source(patch, g)).sum()
    }

    /// Irradiance of a patch from the sky alone.
    pub(crate) fn sky(&self, patch: usize) -> Vec3 {
        self.sky[patch] * self.per_ray(patch)
    }

    /// From a sum of radiance over a patch's rays to irradiance.
    fn per_ray(&self, patch: usize) -> f32 {
        std::f32::consts::PI / self.row(patch).len().max(1) as f32
    }

    /// Casts rays until every patch has as many as `wanted` says. If cancelled, it leaves all links
    /// unchanged.
    pub(crate) fn extend(
        &mut self,
        world: &World,
        cut: &Subdivision,
        wanted: impl Fn(usize) -> u32,
        monitor: &dyn Monitor,
    ) -> Result<(), Cancelled> {
        let mut starts = vec![0];
        for p in 0..self.patches {
            let rays = self.rays_of(p).len().max(wanted(p) as usize);
            starts.push(starts[p] + rays);
        }
        let count = starts[self.patches];
        let mut targets = vec![ESCAPED; count];
        let mut tints = vec![CLEAR; if self.tinted { count } else { 0 }];
        let (mut source, mut sky) = (self.source.clone(), self.sky.clone());
        let rows = rows_of(
            &starts,
            self.groups,
            [&mut targets, &mut tints],
            [&mut source, &mut sky],
        );
        let total = (count - self.count()) as u64;
        let done = std::sync::atomic::AtomicU64::new(0);
        rows.into_par_iter().for_each(|(first, rows)| {
            if monitor.cancelled() {
                return;
            }
            let mut n = 0u64;
            for (p, mut row) in (first..).zip(rows) {
                let old = self.rays_of(p);
                n += (row.targets.len() - old.len()) as u64;
                row.targets[..old.len()].copy_from_slice(&self.targets[old.clone()]);
                if self.tinted {
                    row.tints[..old.len()].copy_from_slice(&self.tints[old.clone()]);
                }
                if cut.patches()[p].hidden {
                    // It neither receives nor sends anything.
                    row.targets[old.len()..].fill(BLACK);
                } else {
                    let patch = PatchId(p as u32);
                    let random = RowSequence::of(cut, patch, self.planned);
                    cast(world, cut, patch, random, old.len(), &mut row);
                }
            }
            let now = done.fetch_add(n, std::sync::atomic::Ordering::Relaxed) + n;
            monitor.progress(Phase::Links, now, total);
        });
        if done.into_inner() != total {
            return Err(Cancelled);
        }
        self.starts = starts;
        self.targets = targets;
        self.tints = tints;
        self.source = source;
        self.sky = sky;
        Ok(())
    }
}

/// Blocks of rows, each with the number of its first patch: `starts` as in [`Links`], targets and
/// tints by ray, sources by patch and group, the sky by patch.
fn rows_of<'l>(
    starts: &[usize],
    groups: usize,
    [targets, tints]: [&'l mut [u32]; 2],
    [source, sky]: [&'l mut [Vec3]; 2],
) -> Vec<(usize, Vec<Row<'l>>)> {
    const BLOCK: usize = 64;
    let (mut targets, mut tints) = (targets, tints);
    let mut rows =
        (starts.windows(2).zip(source.chunks_mut(groups)).zip(sky)).map(|((ends, source), sky)| {
            let rays = ends[1] - ends[0];
            let tinted = rays.min(tints.len());
            Row {
                targets: targets.split_off_mut(..rays).unwrap_or_default(),
                tints: tints.split_off_mut(..tinted).unwrap_or_default(),
                source,
                sky,
            }
        });
    (0..starts.len() - 1)
        .step_by(BLOCK)
        .map(|first| (first, rows.by_ref().take(BLOCK).collect()))
        .collect()
}

/// Patches whose light is reflected often, or that few rays bring light, get this many times the rays
/// of others.
pub(crate) const TIMES: u32 = 4;

/// Parts of a crowded patch cast this fraction of a patch's rays. Sixteen of them share what they
/// find, and still cast four times a patch's rays.
const PART: u32 = 4;

/// Rays of a patch, given those of an ordinary one.
pub(crate) fn rays_of_patch(patch: &Patch, rays: u32) -> u32 {
    match patch.fine {
        true => (rays / PART).max(1),
        false => rays,
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
    /// Blocks of at least `stride` points, of one set of random numbers.
    pub(crate) fn new(set: u32, cut: &Subdivision, patch: PatchId, stride: u32) -> Sequence {
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

/// The random numbers of a row: the rays that are planned take those of one sequence, further ones
/// those of another, so that both are well distributed.
#[derive(Clone, Copy)]
struct RowSequence {
    planned: u32,
    first: Sequence,
    further: Sequence,
}

impl RowSequence {
    fn of(cut: &Subdivision, patch: PatchId, planned: u32) -> Self {
        let planned = rays_of_patch(&cut.patches()[patch.0 as usize], planned);
        RowSequence {
            planned,
            first: Sequence::new(0, cut, patch, planned),
            further: Sequence::new(FURTHER, cut, patch, (TIMES - 1) * planned),
        }
    }

    fn sample(self, k: u32) -> [f32; 4] {
        match k.checked_sub(self.planned) {
            Some(k) => self.further.sample(k),
            None => self.first.sample(k),
        }
    }
}

/// The set of random numbers of further rays.
const FURTHER: u32 = 62;

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
    targets: &'l mut [u32],
    /// Empty if transmission is colourless.
    tints: &'l mut [u32],
    /// Sums of radiance by group, and from the sky.
    source: &'l mut [Vec3],
    sky: &'l mut Vec3,
}

/// Casts the rays of a patch from number `from` on and adds up the radiance that is not reflected.
fn cast(
    world: &World,
    cut: &Subdivision,
    patch: PatchId,
    random: RowSequence,
    from: usize,
    out: &mut Row,
) {
    let start = Start::of(cut, patch);
    // Summed separately first, because short sums round less.
    let mut source = [Vec3::ZERO; 2];
    for (k, target) in out.targets.iter_mut().enumerate().skip(from) {
        let s = random.sample(k as u32);
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
