//! Final gather: the light that a footprint receives.

use glam::Vec3;
use radiosity::{
    DirectLight, DirectOptions, Incoming, Solution, SurfacePoint, World, cosine_hemisphere,
    hash_u32, luminance, sample_4d,
};

use crate::footprint::Footprint;

/// How carefully light is gathered.
#[derive(Debug, Clone, Copy)]
pub struct GatherOptions {
    /// Gathering rays a footprint gets at least; a multiple of 16.
    pub rays: u32,
    /// Rays it gets at most; `rays` doubles up to here until the estimate is good enough.
    pub most_rays: u32,
    /// Good enough: estimated standard error of the indirect light over the total.
    pub error: f32,
    /// Direct light.
    pub direct: DirectOptions,
    /// Leave sub-points inside closed things out of the mean. A lumel is by definition the mean over all of its part of the
    /// surface, buried or not; a vertex in a corner stands for what is seen of its faces.
    pub open_only: bool,
}

/// Light that a footprint receives.
#[derive(Debug, Clone, Copy, Default)]
pub struct Received {
    /// Irradiance straight from lamps and emitters.
    pub direct: Vec3,
    /// Irradiance reflected from surfaces, from the sky, and from wide dim emitters.
    pub indirect: Vec3,
    /// Estimated standard error of the sum's luminance.
    pub error: f32,
    /// The part of `error`² that comes from `indirect`.
    pub indirect_variance: f32,
    /// Mean position of the footprint's points, metres, recentred.
    pub position: Vec3,
    /// Mean shading normal, unit.
    pub normal: Vec3,
    /// Size of the footprint, metres.
    pub size: f32,
    /// Share of the footprint that lies in the open, 0..=1; 0 if all of it is inside or behind something.
    pub open: f32,
    /// Gathering and shadow rays cast.
    pub rays: u64,
}

/// Sub-points of a footprint, each with its share of gathering rays.
const POINTS: usize = 16;

/// A sub-point is inside something when this share of its rays meets black back faces. Not all: a ray may slip out through a seam of
/// what it is in. A sub-point that is merely near the back of things sees them in half of its hemisphere at most.
const INSIDE: f32 = 0.9;

/// Gathers light at footprints.
pub struct Gatherer<'w, 'a> {
    /// Scene.
    pub world: &'w World<'a>,
    /// Its solved light.
    pub solution: &'w Solution,
    /// Its direct light.
    pub direct: DirectLight<'w, 'a>,
    /// How carefully.
    pub options: GatherOptions,
}

/// Running sums of one sub-point.
#[derive(Clone, Copy, Default)]
struct Point {
    sum: Vec3,
    rays: u32,
    black: u32,
}

impl Gatherer<'_, '_> {
    /// Mean irradiance over the footprint.
    ///
    /// Sub-points inside closed things are those from which nearly all rays meet black back faces. Where all of the footprint is
    /// inside, the mean is over all of it, whatever [`GatherOptions::open_only`] says.
    pub fn gather(&self, footprint: &impl Footprint, seed: u32) -> Received {
        if self.world.is_dark() {
            return Received {
                open: 1.0,
                ..Received::default()
            };
        }
        let points = spread(footprint);
        let mut sums = [Point::default(); POINTS];
        let mut per_point = (self.options.rays / POINTS as u32).max(1);
        let most = (self.options.most_rays / POINTS as u32).max(per_point);
        let mut from = 0;
        let mut direct: Option<(Vec3, f32)> = None;
        let mut rays = 0u64;
        loop {
            for (k, sum) in sums.iter_mut().enumerate() {
                // Aligned blocks of a Sobol sequence are well distributed, each by itself and all together.
                let base = from * POINTS as u32 + k as u32 * (per_point - from);
                self.indirect(&points[k], base..base + (per_point - from), seed, sum);
            }
            rays += (per_point - from) as u64 * POINTS as u64;
            let mut open = sums.map(|s| (s.black as f32) < INSIDE * s.rays as f32);
            let count = open.iter().filter(|&&o| o).count();
            if count == 0 || !self.options.open_only {
                open = [true; POINTS];
            }
            let (mean, variance) = mean_and_variance(&sums, &open);
            let (e, direct_variance) = *direct.get_or_insert_with(|| {
                let d = self.direct_light(footprint, &points, &open, seed);
                rays += d.rays as u64;
                (d.irradiance, d.variance)
            });
            let total = luminance(e + mean);
            if 2 * per_point > most || variance.sqrt() <= self.options.error * total {
                return Received {
                    direct: e,
                    indirect: mean,
                    error: (variance + direct_variance).sqrt(),
                    indirect_variance: variance,
                    position: points.iter().map(|p| p.position).sum::<Vec3>() / POINTS as f32,
                    normal: points
                        .iter()
                        .map(|p| p.normal)
                        .sum::<Vec3>()
                        .normalize_or(points[0].normal),
                    size: footprint.size(),
                    open: count as f32 / POINTS as f32,
                    rays,
                };
            }
            from = per_point;
            per_point *= 2;
        }
    }

    fn indirect(
        &self,
        p: &SurfacePoint,
        samples: std::ops::Range<u32>,
        seed: u32,
        out: &mut Point,
    ) {
        for i in samples {
            let s = sample_4d(i, 0, seed);
            let direction = cosine_hemisphere(p.normal, s[0], s[1]);
            out.rays += 1;
            // An interpolated normal's hemisphere dips below the face itself: nothing arrives from there.
            if p.geometric.dot(direction) <= 0.0 {
                continue;
            }
            match self.world.incoming(p.origin, direction) {
                Incoming::Escaped => out.sum += self.world.sky.radiance(direction),
                Incoming::Black => out.black += 1,
                Incoming::Surface(hit) => {
                    let at = p.origin + direction * hit.t;
                    out.sum += self.solution.radiance(
                        self.world,
                        &self.direct,
                        &hit,
                        at,
                        hash_u32(seed ^ i),
                    );
                }
            }
        }
    }

    fn direct_light(
        &self,
        footprint: &impl Footprint,
        points: &[SurfacePoint; POINTS],
        open: &[bool; POINTS],
        seed: u32,
    ) -> radiosity::DirectEstimate {
        let valid: Vec<SurfacePoint> = (0..POINTS)
            .filter(|&k| open[k])
            .map(|k| points[k])
            .collect();
        let all_open = valid.len() == POINTS;
        let mut stream = 0;
        let mut extra: Vec<SurfacePoint> = Vec::new();
        let point = |i: u32| -> SurfacePoint {
            let i = i as usize;
            if i < valid.len() {
                return valid[i];
            }
            // More points than the gather had: go on in the footprint's stream, staying near open ones.
            while extra.len() <= i - valid.len() {
                let mut found = None;
                for _ in 0..8 {
                    let c = footprint.candidate(stream + POINTS as u32);
                    stream += 1;
                    found = c.filter(|c| all_open || nearest_is_open(points, open, c.position));
                    if found.is_some() {
                        break;
                    }
                }
                extra.push(found.unwrap_or(valid[extra.len() % valid.len()]));
            }
            extra[i - valid.len()]
        };
        self.direct.irradiance(
            point,
            footprint.size(),
            seed ^ 0x68bc_21eb,
            &self.options.direct,
        )
    }
}

/// The first points of the stream that lie on the surface, repeated where it has fewer.
fn spread(footprint: &impl Footprint) -> [SurfacePoint; POINTS] {
    let mut points = [None; POINTS];
    let mut n = 0;
    for i in 0..8 * POINTS as u32 {
        if n == POINTS || (n == 0 && i == 4 * POINTS as u32) {
            break;
        }
        if let Some(p) = footprint.candidate(i) {
            points[n] = Some(p);
            n += 1;
        }
    }
    if n == 0 {
        return [footprint.fallback(); POINTS];
    }
    let mut k = 0;
    points.map(|p| {
        k += 1;
        p.or(points[(k - 1) % n])
            .unwrap_or_else(|| footprint.fallback())
    })
}

fn nearest_is_open(points: &[SurfacePoint; POINTS], open: &[bool; POINTS], p: Vec3) -> bool {
    let mut best = (f32::INFINITY, true);
    for k in 0..POINTS {
        let d = points[k].position.distance_squared(p);
        if d < best.0 {
            best = (d, open[k]);
        }
    }
    best.1
}

/// Mean irradiance over open points, and the variance of its luminance as if the points were independent. They are stratified
/// against each other, so the variance is on the safe side.
fn mean_and_variance(sums: &[Point; POINTS], open: &[bool; POINTS]) -> (Vec3, f32) {
    let pi = std::f32::consts::PI;
    let (mut mean, mut n) = (Vec3::ZERO, 0.0f32);
    for (s, _) in sums.iter().zip(open).filter(|(_, o)| **o) {
        mean += s.sum * (pi / s.rays as f32);
        n += 1.0;
    }
    mean /= n;
    let m = luminance(mean);
    let mut square = 0.0;
    for (s, _) in sums.iter().zip(open).filter(|(_, o)| **o) {
        let d = luminance(s.sum) * (pi / s.rays as f32) - m;
        square += d * d;
    }
    (
        mean,
        if n > 1.0 {
            square / (n * (n - 1.0))
        } else {
            m * m
        },
    )
}
