//! Optional quantities per lumel: light by group, directional moments, openness, visibility of the
//! sun.
//!
//! All of them come from the same rays as the irradiance, with the same weights, and are smoothed
//! with the same weights. So they cost little and are consistent: the groups of a lumel sum to its
//! irradiance up to rounding.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use radiosity::{DirectParts, MASKS, MaskLamps};

/// The quantities to record.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Wanted {
    /// Number of light groups; 0 if light is not separated.
    pub groups: usize,
    /// Moments of the radiance: ∫ L dω and ∫ L ω dω.
    pub moments: bool,
    /// Openness: the cosine-weighted fraction of rays that hit nothing within this distance,
    /// metres.
    pub openness: Option<f32>,
    /// Irradiance from directional lights, with and without occlusion.
    pub sun: bool,
    /// Direct irradiance without the lamps that are left out ([`radiosity::LampRoles`]); `indirect`
    /// is 0.
    pub kept: bool,
    /// Luminances from the lamps of the shadow mask, with and without occlusion.
    pub masks: bool,
}

/// One quantity of one lumel, in the parts of [`Received`](crate::Received).
#[derive(Debug, Clone, Copy, Default)]
pub struct Plane {
    /// Directly from lamps and emitters.
    pub direct: Vec3,
    /// From gathering rays.
    pub indirect: Vec3,
    /// `indirect` from the first half of the points.
    pub first_half: Vec3,
}

impl Plane {
    /// Direct and indirect.
    pub fn sum(&self) -> Vec3 {
        self.direct + self.indirect
    }

    /// Two independent estimates of `indirect`.
    pub(crate) fn halves(&self) -> [Vec3; 2] {
        [self.first_half, 2.0 * self.indirect - self.first_half]
    }
}

impl Wanted {
    /// Number of planes per lumel: the groups, four moments, openness (x), the sun (x: with, y:
    /// without occlusion), kept direct light, shadow masks (three).
    pub fn planes(&self) -> usize {
        self.masks_plane() + if self.masks { 3 } else { 0 }
    }

    /// Index of direct light that is kept.
    pub fn kept_plane(&self) -> usize {
        self.sun_plane() + usize::from(self.sun)
    }

    /// Index of the first of three planes of shadow masks; see [`masks_of`](Self::masks_of).
    pub fn masks_plane(&self) -> usize {
        self.kept_plane() + usize::from(self.kept)
    }

    /// Luminance from the lamp of each channel, with and without occlusion.
    pub fn masks_of(&self, planes: &[Plane]) -> [[f32; 2]; MASKS] {
        let [seen, all, last] = [0, 1, 2].map(|k| planes[self.masks_plane() + k].direct);
        [
            [seen.x, all.x],
            [seen.y, all.y],
            [seen.z, all.z],
            [last.x, last.y],
        ]
    }

    /// Index of the first moment.
    pub fn moments_plane(&self) -> usize {
        self.groups
    }

    /// Index of openness.
    pub fn openness_plane(&self) -> usize {
        self.groups + if self.moments { 4 } else { 0 }
    }

    /// Index of the sun.
    pub fn sun_plane(&self) -> usize {
        self.openness_plane() + usize::from(self.openness.is_some())
    }

    /// The parts of direct light to record.
    pub(crate) fn direct_parts(&self, lamps: MaskLamps) -> DirectParts {
        DirectParts {
            groups: vec![Vec3::ZERO; self.groups],
            moments: self.moments.then_some([Vec3::ZERO; 4]),
            sun: self.sun.then_some([0.0; 2]),
            kept: self.kept.then_some(Vec3::ZERO),
            masks: self.masks.then_some((lamps, [[0.0; 2]; MASKS])),
        }
    }

    /// Stores the parts of direct light in their planes.
    pub(crate) fn place_direct(&self, parts: &DirectParts, planes: &mut [Plane]) {
        for (plane, e) in planes.iter_mut().zip(&parts.groups) {
            plane.direct = *e;
        }
        if let Some(m) = parts.moments {
            for (plane, m) in planes[self.moments_plane()..].iter_mut().zip(m) {
                plane.direct = m;
            }
        }
        if let Some([seen, all]) = parts.sun {
            planes[self.sun_plane()].direct = Vec3::new(seen, all, 0.0);
        }
        if let Some(kept) = parts.kept {
            planes[self.kept_plane()].direct = kept;
        }
        if let Some((_, [r, g, b, a])) = parts.masks {
            let at = self.masks_plane();
            planes[at].direct = Vec3::new(r[0], g[0], b[0]);
            planes[at + 1].direct = Vec3::new(r[1], g[1], b[1]);
            planes[at + 2].direct = Vec3::new(a[0], a[1], 0.0);
        }
    }
}

/// Sums over gathering rays.
pub(crate) struct PlaneSums {
    wanted: Wanted,
    /// Sums over all rays, and over those of the first half of the points.
    sums: Vec<[Vec3; 2]>,
    rays: [u32; 2],
    /// The same sums for lit elements at points, and the number of points.
    from_lit: Vec<[Vec3; 2]>,
    points: [u32; 2],
    /// Contribution of one ray, by group.
    pub of_ray: Vec<Vec3>,
    /// Whether the current rays belong to the first half of the points.
    pub first_half: bool,
    /// Number of rays of the block of a sequence that the current rays belong to.
    pub batch: u32,
}

/// Weight of a ray in integrals over solid angle, as rays are cosine-distributed: 1/cos, averaged
/// over the ray's stratum of `n`. Flat rays would have weights without limit, and a variance without
/// limit.
#[inline]
fn steep(cos: f32, n: u32) -> f32 {
    // cos² is uniform. ∫ dx/√x = 2√x.
    let n = n.max(1) as f32;
    let k = (cos * cos * n).clamp(0.0, n - 1.0).floor();
    2.0 * n.sqrt() * ((k + 1.0).sqrt() - k.sqrt())
}

impl PlaneSums {
    pub(crate) fn new(wanted: Wanted) -> Self {
        PlaneSums {
            sums: vec![[Vec3::ZERO; 2]; wanted.planes()],
            rays: [0; 2],
            from_lit: Vec::new(),
            points: [0; 2],
            of_ray: vec![Vec3::ZERO; wanted.groups],
            first_half: true,
            batch: 1,
            wanted,
        }
    }

    /// Adds the sums of `other`, and resets them.
    pub(crate) fn take(&mut self, other: &mut PlaneSums) {
        for (sum, more) in self.sums.iter_mut().zip(&mut other.sums) {
            for (a, b) in sum.iter_mut().zip(more) {
                *a += std::mem::take(b);
            }
        }
        for (n, more) in self.rays.iter_mut().zip(&mut other.rays) {
            *n += std::mem::take(more);
        }
        if !other.from_lit.is_empty() {
            self.from_lit.resize(self.sums.len(), [Vec3::ZERO; 2]);
            for (sum, more) in self.from_lit.iter_mut().zip(&mut other.from_lit) {
                for (a, b) in sum.iter_mut().zip(more) {
                    *a += std::mem::take(b);
                }
            }
        }
        for (n, more) in self.points.iter_mut().zip(&mut other.points) {
            *n += std::mem::take(more);
        }
    }

    /// Whether nothing is recorded.
    #[inline]
    pub(crate) fn is_empty(&self) -> bool {
        self.sums.is_empty()
    }

    /// Adds one ray: its radiance (`of_ray` has the groups' parts, and is reset), its unit
    /// direction, the axis of the hemisphere, and its length.
    pub(crate) fn add(&mut self, radiance: Vec3, direction: Vec3, axis: Vec3, distance: f32) {
        self.rays[0] += 1;
        self.rays[1] += u32::from(self.first_half);
        let first = if self.first_half { 1.0 } else { 0.0 };
        let mut put = |k: usize, x: Vec3| {
            self.sums[k][0] += x;
            self.sums[k][1] += x * first;
        };
        for (k, part) in self.of_ray.iter_mut().enumerate() {
            put(k, std::mem::take(part));
        }
        if self.wanted.moments {
            let at = self.wanted.moments_plane();
            let cos = axis.dot(direction);
            let flux = radiance * steep(cos, self.batch);
            put(at, flux);
            for k in 0..3 {
                // Along the axis the weight and the cosine cancel.
                let along = direction[k] - axis[k] * cos;
                put(at + 1 + k, flux * along + radiance * axis[k]);
            }
        }
        if let Some(reach) = self.wanted.openness
            && distance > reach
        {
            put(self.wanted.openness_plane(), Vec3::X * FRAC_1_PI);
        }
    }

    /// Counts another point that receives light from lit elements.
    pub(crate) fn add_point(&mut self) {
        self.points[0] += 1;
        self.points[1] += u32::from(self.first_half);
    }

    /// Adds the light of a lit element at a point: irradiance (`of_ray` has the groups' parts, and
    /// is reset), its unit direction, and the cosine of that.
    pub(crate) fn add_lit(&mut self, irradiance: Vec3, direction: Vec3, cos: f32) {
        let (wanted, first) = (self.wanted, if self.first_half { 1.0 } else { 0.0 });
        let sums = &mut self.from_lit;
        sums.resize(wanted.planes(), [Vec3::ZERO; 2]);
        let mut put = |k: usize, x: Vec3| {
            sums[k][0] += x;
            sums[k][1] += x * first;
        };
        for (k, part) in self.of_ray.iter_mut().enumerate() {
            put(k, std::mem::take(part));
        }
        if wanted.moments {
            let at = wanted.moments_plane();
            let flux = irradiance / cos.max(1e-4);
            put(at, flux);
            for k in 0..3 {
                put(at + 1 + k, flux * direction[k]);
            }
        }
    }

    /// Means over all rays, times π, as irradiances are computed from radiances.
    pub(crate) fn finish(&self) -> Vec<Plane> {
        let [all, first] = self.rays.map(|n| PI / n.max(1) as f32);
        let [lit_all, lit_first] = self.points.map(|n| 1.0 / n.max(1) as f32);
        let one_half = self.rays[1] == 0 || self.rays[1] == self.rays[0];
        let nothing = [Vec3::ZERO; 2];
        let from_lit = self.from_lit.iter().chain(std::iter::repeat(&nothing));
        (self.sums.iter())
            .zip(from_lit)
            .map(|([sum, half], [lit, lit_half])| {
                let indirect = *sum * all + *lit * lit_all;
                Plane {
                    direct: Vec3::ZERO,
                    indirect,
                    first_half: match one_half {
                        true => indirect,
                        false => *half * first + *lit_half * lit_first,
                    },
                }
            })
            .collect()
    }
}
