//! Rays between patches: the rows of the form-factor matrix.

use glam::Vec3;
use patch_subdivision::{Element, PatchId, Subdivision};
use rayon::prelude::*;

use crate::monitor::{Cancelled, Monitor, Phase};
use crate::sampling::{cosine_hemisphere, hash_u32, sample_4d};
use crate::world::{Incoming, World};

/// The ray left the scene.
pub(crate) const ESCAPED: u32 = u32::MAX;
/// The ray met the back of a single-sided face, which is black.
pub(crate) const BLACK: u32 = u32::MAX - 1;
/// The ray met a surface that no patch stands for (a triangle too small for any cell of its region).
pub(crate) const NOWHERE: u32 = u32::MAX - 2;

/// What each patch sees: `rays` cosine-distributed rays from points spread over it, and the patch that each of them hits.
///
/// F_ij is estimated by the share of row *i* that names *j*. Whatever the scene, a row's shares (escaped rays included) sum to
/// exactly 1, so in a closed scene no energy is made or lost by the matrix, which the closed-form furnace then shows.
pub(crate) struct Links {
    pub patches: usize,
    /// Rays per patch cast so far.
    pub rays: u32,
    stride: u32,
    targets: Vec<u32>,
    /// Σ radiance over a patch's rays of what is not another patch's reflection: the sky and gathered emission.
    source: Vec<Vec3>,
    /// The sky's part of `source`.
    sky: Vec<Vec3>,
}

impl Links {
    /// Room for `stride` rays a patch.
    pub(crate) fn new(patches: usize, stride: u32) -> Self {
        Links {
            patches,
            rays: 0,
            stride,
            targets: vec![ESCAPED; patches * stride as usize],
            source: vec![Vec3::ZERO; patches],
            sky: vec![Vec3::ZERO; patches],
        }
    }

    /// Memory, bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (self.targets.len() * 4 + 2 * self.source.len() * size_of::<Vec3>()) as u64
    }

    /// The row of a patch.
    pub(crate) fn row(&self, patch: usize) -> &[u32] {
        let at = patch * self.stride as usize;
        &self.targets[at..at + self.rays as usize]
    }

    /// Irradiance of a patch from the sky and from gathered emission.
    pub(crate) fn source(&self, patch: usize) -> Vec3 {
        self.source[patch] * (std::f32::consts::PI / self.rays.max(1) as f32)
    }

    /// Irradiance of a patch from the sky alone.
    pub(crate) fn sky(&self, patch: usize) -> Vec3 {
        self.sky[patch] * (std::f32::consts::PI / self.rays.max(1) as f32)
    }

    /// Casts rays until every patch has `rays`, for all patches or, when cancelled, for none: the links stay as they were.
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
        let done = std::sync::atomic::AtomicU64::new(0);
        let total = (self.patches as u64) * (rays - from) as u64;
        let added: Vec<[Vec3; 2]> = self
            .targets
            .par_chunks_mut(stride * BLOCK)
            .enumerate()
            .flat_map_iter(|(block, rows)| {
                let mut sums = Vec::with_capacity(BLOCK);
                if !monitor.cancelled() {
                    for (k, row) in rows.chunks_mut(stride).enumerate() {
                        let patch = PatchId((block * BLOCK + k) as u32);
                        sums.push(cast(
                            world,
                            cut,
                            patch,
                            from,
                            &mut row[from as usize..rays as usize],
                        ));
                    }
                    let n = sums.len() as u64 * (rays - from) as u64;
                    let now = done.fetch_add(n, std::sync::atomic::Ordering::Relaxed) + n;
                    monitor.progress(Phase::Links, now, total);
                }
                sums
            })
            .collect();
        if added.len() != self.patches {
            return Err(Cancelled);
        }
        for ((source, sky), a) in self.source.iter_mut().zip(&mut self.sky).zip(added) {
            *source += a[0];
            *sky += a[1];
        }
        self.rays = rays;
        Ok(())
    }
}

/// The seed of a patch's rays.
fn seed(patch: PatchId) -> u32 {
    hash_u32(patch.0 ^ 0x5bd1_e995)
}

/// Which of a patch's elements a ray starts from whose third dimension is `x`: by area, `area` being their sum.
fn pick(elements: &[Element], area: f32, x: f32) -> usize {
    let mut left = x * area;
    for (k, e) in elements.iter().enumerate() {
        if left < e.area {
            return k;
        }
        left -= e.area;
    }
    elements.len() - 1
}

/// For each ray of a patch, in the order of its row, the element that it started from (counted within the patch).
pub(crate) fn origins(
    cut: &Subdivision,
    patch: PatchId,
    rays: u32,
) -> impl Iterator<Item = usize> + '_ {
    let elements = &cut.elements()[cut.elements_of(patch)];
    let area: f32 = elements.iter().map(|e| e.area).sum();
    let seed = seed(patch);
    (0..rays).map(move |k| pick(elements, area, sample_4d(k, 0, seed)[2]))
}

/// Casts rays `from..` of a patch into `row`; returns the radiance they see that is no reflection, and the sky's part of it.
fn cast(world: &World, cut: &Subdivision, patch: PatchId, from: u32, row: &mut [u32]) -> [Vec3; 2] {
    let back = cut.patches()[patch.0 as usize].back;
    let elements = &cut.elements()[cut.elements_of(patch)];
    let area: f32 = elements.iter().map(|e| e.area).sum();
    let seed = seed(patch);
    let (mut source, mut sky) = (Vec3::ZERO, Vec3::ZERO);
    for (k, target) in row.iter_mut().enumerate() {
        let s = sample_4d(from + k as u32, 0, seed);
        let e = &elements[pick(elements, area, s[2])];
        let p = world.inset_point(e.triangle, e.u, e.v, back, false);
        let direction = cosine_hemisphere(p.normal, s[0], s[1]);
        *target = match world.incoming(p.origin, direction) {
            Incoming::Escaped => {
                let l = world.sky.radiance(direction);
                source += l;
                sky += l;
                ESCAPED
            }
            Incoming::Black => BLACK,
            Incoming::Surface(hit) => {
                source += world.gathered_emission(hit.triangle, hit.u, hit.v);
                match cut.locate(hit.triangle, p.origin + direction * hit.t, hit.back) {
                    Some(at) => at.patch.0,
                    None => NOWHERE,
                }
            }
        };
    }
    [source, sky]
}

#[cfg(test)]
mod tests;
