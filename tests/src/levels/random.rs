//! Numbers that are the same on every machine: random draws, sine and cosine, noise.

use std::f64::consts::PI;

use glam::Vec3;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng;

/// A stream of draws (PCG64 XSL-RR).
pub(super) struct Random(Pcg64);

impl Random {
    /// Stream `stream` of `seed`.
    pub fn new(seed: u64, stream: u64) -> Random {
        Random(Pcg64::new(u128::from(seed), u128::from(stream)))
    }

    /// Uniform in 0..1, from 24 bits, so that the `f32` is exact.
    pub fn unit(&mut self) -> f32 {
        (self.0.next_u64() >> 40) as f32 / (1u32 << 24) as f32
    }

    /// Uniform in `a..b`.
    pub fn range(&mut self, a: f32, b: f32) -> f32 {
        a + (b - a) * self.unit()
    }

    /// Uniform in `a..b` in whole centimetres, as people enter sizes.
    pub fn metres(&mut self, a: f32, b: f32) -> f32 {
        (self.range(a, b) * 100.0).round() / 100.0
    }

    /// A whole number in `a..=b`.
    pub fn int(&mut self, a: u32, b: u32) -> u32 {
        a + (self.0.next_u64() % u64::from(b - a + 1)) as u32
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f32) -> bool {
        self.unit() < p
    }

    /// One of `list`.
    pub fn pick<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.int(0, list.len() as u32 - 1) as usize]
    }

    /// A direction, uniform on the sphere (Marsaglia's rejection from the cube).
    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = Vec3::new(
                self.range(-1.0, 1.0),
                self.range(-1.0, 1.0),
                self.range(-1.0, 1.0),
            );
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }

    /// A colour of luminance about `level`, whose channels differ by up to `spread` of it; at most
    /// 0.98.
    pub fn colour(&mut self, level: f32, spread: f32) -> [f32; 3] {
        [0; 3].map(|_| (level * (1.0 + self.range(-spread, spread))).clamp(0.02, 0.98))
    }

    /// A typical ground colour: grass, earth, sand, gravel, snow.
    pub fn ground(&mut self) -> [f32; 3] {
        let [r, g, b] = self.pick(&[
            [0.16, 0.24, 0.08],
            [0.24, 0.17, 0.11],
            [0.5, 0.42, 0.28],
            [0.32, 0.31, 0.29],
            [0.88, 0.9, 0.93],
        ]);
        let level = self.range(0.8, 1.05);
        [r * level, g * level, b * level]
    }
}

/// Sine and cosine of degrees by Taylor series, because libraries differ in the last bit and the
/// bytes must not.
///
/// Exact at multiples of 90.
pub(super) fn sin_cos(degrees: f32) -> (f32, f32) {
    let turns = f64::from(degrees) / 90.0;
    let quarter = turns.round();
    let x = (turns - quarter) * PI / 2.0;
    // |x| ≤ π/4: the next terms would be below 1e-17.
    let series = |first: f64, from: u32| {
        let mut term = first;
        let mut sum = first;
        for k in 0..8 {
            let n = f64::from(from + 2 * k);
            term *= -x * x / ((n + 1.0) * (n + 2.0));
            sum += term;
        }
        sum
    };
    let (s, c) = (series(x, 1), series(1.0, 0));
    let (s, c) = match (quarter as i64).rem_euclid(4) {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    };
    (s as f32, c as f32)
}

/// Hash of a lattice point to 0..1 (the finaliser of MurmurHash3).
fn lattice(x: i32, y: i32, z: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA6B)
        ^ (z as u32).wrapping_mul(0xC2B2_AE35)
        ^ seed.wrapping_mul(0x27D4_EB2F);
    h ^= h >> 16;
    h = h.wrapping_mul(0x85EB_CA6B);
    h ^= h >> 13;
    h = h.wrapping_mul(0xC2B2_AE35);
    ((h ^ (h >> 16)) >> 8) as f32 / (1u32 << 24) as f32
}

/// Value noise in −1..1 with features of one metre.
pub(super) fn noise(p: Vec3, seed: u32) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let f = f * f * (Vec3::splat(3.0) - f * 2.0);
    let [x, y, z] = cell.to_array().map(|v| v as i32);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let edge = |dy: i32, dz: i32| {
        mix(
            lattice(x, y + dy, z + dz, seed),
            lattice(x + 1, y + dy, z + dz, seed),
            f.x,
        )
    };
    let face = |dz: i32| mix(edge(0, dz), edge(1, dz), f.y);
    mix(face(0), face(1), f.z) * 2.0 - 1.0
}

/// Four octaves of [`noise`].
pub(super) fn fractal(p: Vec3, seed: u32) -> f32 {
    let mut sum = 0.0;
    let (mut scale, mut height) = (1.0, 1.0);
    for octave in 0..4 {
        sum += noise(p * scale, seed + octave) * height;
        scale *= 2.0;
        height *= 0.5;
    }
    sum / 1.875
}
