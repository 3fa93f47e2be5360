//! An interior for timing rays, and rays like those of a final gather.
#![allow(dead_code, reason = "each program uses a part")]

use std::f32::consts::{PI, TAU};

use glam::{Vec3, vec3};
use visibility::Ray;

/// SplitMix64 (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// A grid of `n × m` squares over `surface(s, t)`, `s` and `t` in 0..=1.
fn sheet(out: &mut Vec<[Vec3; 3]>, n: usize, m: usize, surface: impl Fn(f32, f32) -> Vec3) {
    let at = |i: usize, j: usize| surface(i as f32 / n as f32, j as f32 / m as f32);
    for i in 0..n {
        for j in 0..m {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            out.extend([[a, b, c], [a, c, d]]);
        }
    }
}

/// A two-storey hall of 30 × 12 × 10 m with columns, arches, a vaulted ceiling, hangings, pots and
/// a few huge triangles. It has about 260,000 triangles, from millimetres to the length of the
/// hall, as in scanned or modelled atria.
pub fn interior() -> Vec<[Vec3; 3]> {
    let mut t = vec![];
    // The shell: floor and long walls of two triangles each, end walls, vault.
    sheet(&mut t, 1, 1, |s, u| vec3(s * 30.0, u * 12.0, 0.0));
    for y in [0.0, 12.0] {
        sheet(&mut t, 1, 1, |s, u| vec3(s * 30.0, y, u * 8.0));
    }
    for x in [0.0, 30.0] {
        sheet(&mut t, 4, 4, |s, u| vec3(x, s * 12.0, u * 11.0));
    }
    sheet(&mut t, 120, 60, |s, u| {
        let groin = 0.25 * (s * 10.0 * TAU).cos().abs();
        vec3(
            s * 30.0,
            6.0 - 6.0 * (u * PI).cos(),
            8.0 + 2.0 * (u * PI).sin() + groin,
        )
    });
    // Two rows of fluted columns on two storeys, with bases and capitals.
    for storey in [0.0, 4.0] {
        for row in [3.0, 9.0] {
            for column in 0..9 {
                let centre = vec3(3.0 + column as f32 * 3.0, row, storey);
                sheet(&mut t, 48, 26, |s, u| {
                    let a = s * TAU;
                    let swell = 0.12 * ((u - 0.5).abs() * 2.0).powi(8);
                    let r = 0.25 + 0.012 * (a * 16.0).sin() + swell;
                    centre + vec3(r * a.cos(), r * a.sin(), u * 3.2)
                });
                // An arch to the next column.
                sheet(&mut t, 24, 6, |s, u| {
                    let a = s * PI;
                    let r = 1.25 + 0.1 * (u * TAU).cos();
                    centre
                        + vec3(
                            1.5 - r * a.cos(),
                            0.3 * (u * TAU).sin(),
                            3.2 + 0.6 * a.sin(),
                        )
                });
            }
            // The gallery floor.
            sheet(&mut t, 60, 2, |s, u| {
                vec3(
                    s * 30.0,
                    if row < 6.0 { u * 3.0 } else { 9.0 + u * 3.0 },
                    4.0 + storey,
                )
            });
        }
    }
    // Hangings between the columns.
    for i in 0..8 {
        for row in [3.0, 9.0] {
            let x = 3.6 + i as f32 * 3.0;
            sheet(&mut t, 40, 40, |s, u| {
                let wave = 0.15 * u * (s * 5.0 * TAU + i as f32).sin();
                vec3(x + s * 1.8, row + wave, 7.4 - u * 2.6)
            });
        }
    }
    // Pots with leaves on the floor.
    let mut r = Random(11);
    for i in 0..24 {
        let centre = vec3(
            1.5 + (i / 2) as f32 * 2.4,
            if i % 2 == 0 { 4.4 } else { 7.6 },
            0.0,
        );
        sheet(&mut t, 32, 16, |s, u| {
            let a = s * TAU;
            let r = 0.3 + 0.12 * (u * PI).sin();
            centre + vec3(r * a.cos(), r * a.sin(), u * 0.6)
        });
        for _ in 0..900 {
            let (a, h, l) = (r.unit() * TAU, r.unit(), 0.05 + 0.1 * r.unit());
            let p = centre + vec3(a.cos() * 0.5 * h, a.sin() * 0.5 * h, 0.6 + h * r.unit());
            let e = vec3(r.unit() - 0.5, r.unit() - 0.5, r.unit() - 0.5) * l;
            let f = vec3(r.unit() - 0.5, r.unit() - 0.5, r.unit() - 0.5) * l;
            t.push([p, p + e, p + f]);
        }
    }
    // Ornament: rings along the walls.
    for i in 0..28 {
        for y in [0.15, 11.85] {
            let centre = vec3(1.5 + i as f32, y, 2.4);
            sheet(&mut t, 32, 16, |s, u| {
                let (a, b) = (s * TAU, u * TAU);
                let r = 0.35 + 0.06 * b.cos();
                centre + vec3(r * a.cos(), 0.06 * b.sin(), r * a.sin())
            });
        }
    }
    t
}

/// `count` rays from points distributed by area over `triangles`, cosine-distributed about the
/// normal of a random side.
///
/// `length`: infinity for gather rays, the distance to the light for shadow rays.
pub fn hemisphere_rays(triangles: &[[Vec3; 3]], count: usize, length: f32) -> Vec<Ray> {
    let mut sum = 0.0f64;
    let cumulative: Vec<f64> = triangles
        .iter()
        .map(|[a, b, c]| {
            sum += f64::from((*b - *a).cross(*c - *a).length());
            sum
        })
        .collect();
    let (lo, hi) = triangles
        .iter()
        .flatten()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), &p| {
            (l.min(p), h.max(p))
        });
    let centre = (lo + hi) * 0.5;
    let mut r = Random(3);
    (0..count)
        .map(|_| {
            let x = f64::from(r.unit()) * sum + f64::from(r.unit()) * sum / f64::from(1u32 << 24);
            let [a, b, c] = triangles[cumulative
                .partition_point(|&s| s <= x)
                .min(triangles.len() - 1)];
            let (mut u, mut v) = (r.unit(), r.unit());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let p = a + (b - a) * u + (c - a) * v;
            let mut n = (b - a).cross(c - a).normalize_or(Vec3::Z);
            // Mostly the side that faces the centre of the hall.
            if n.dot(centre - p) < 0.0 {
                n = -n;
            }
            let (phi, s) = (r.unit() * TAU, r.unit());
            let (x, y) = n.any_orthonormal_pair();
            let d = (x * phi.cos() + y * phi.sin()) * s.sqrt() + n * (1.0 - s).sqrt();
            Ray {
                origin: p + n * 1e-4,
                direction: d,
                t_min: 0.0,
                t_max: length,
            }
        })
        .collect()
}

/// Triangles from a file of little-endian `f32`, nine per triangle.
pub fn read_triangles(path: &str) -> std::io::Result<Vec<[Vec3; 3]>> {
    let bytes = std::fs::read(path)?;
    let floats: Vec<f32> = bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect();
    Ok(floats
        .as_chunks::<9>()
        .0
        .iter()
        .map(|c| [0, 3, 6].map(|i| Vec3::from_slice(&c[i..i + 3])))
        .collect())
}
