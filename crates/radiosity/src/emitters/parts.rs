//! Subdivides textured emissive triangles where they are bright.
//!
//! A sign that glows in a large dark texture is one triangle to a renderer and a small lamp to a
//! receiver. Points spread over the whole triangle mostly miss it, and the mean radiance says
//! nothing about where its light comes from. Such triangles are therefore split into four similar
//! parts, recursively while the radiance changes over them; black parts are dropped. The remaining
//! emitters have nearly uniform radiance, and a hierarchy can distinguish near from far ones.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;
use std::cell::Cell;

use super::Emitter;
use crate::world::{World, luminance};
use mesh_ingest::{Scene, Soup};

/// Maximum number of parts of all triangles together: 5 MB of emitters. With a quarter of that, a
/// photograph on a wall is still split into 16,000.
const MOST_PARTS: usize = 1 << 16;

/// Maximum depth: 4⁶ parts per triangle, each with 1/64 of its edge.
const MOST_LEVELS: u32 = 6;

/// Maximum number of finest parts examined, and of texture samples: half a second on one core,
/// however many triangles share them.
const MOST_CELLS: usize = 1 << 20;
const MOST_SAMPLES: usize = 1 << 23;

/// Texture samples per triangle: the minimum, whatever the number of triangles, and the maximum.
const SAMPLES: std::ops::RangeInclusive<usize> = 4..=1 << 16;

/// Number of samples that determines the mean of a few large texels, with edges at any position, to
/// 0.1 %.
const WELL_KNOWN: usize = 1 << 14;

/// Radiance with a relative standard deviation below this counts as uniform. A few points then
/// determine the mean to a few per cent, and splitting would cost more than it gains.
const EVEN: f32 = 0.1;

const WHOLE: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];

/// Whether [`Scene::emitted`] can vary over a triangle of this material.
pub(crate) fn varies(scene: &Scene, material: u32) -> bool {
    let m = &scene.materials[material as usize];
    m.emissive_texture.is_some() || m.lets_light_through()
}

/// Mean radiance of a part of a triangle, and the mean of its squared luminance.
#[derive(Debug, Clone, Copy, Default)]
struct Look {
    mean: Vec3,
    square: f32,
}

impl Look {
    /// Standard deviation of luminance over the part.
    fn spread(&self) -> f32 {
        let l = luminance(self.mean);
        (self.square - l * l).max(0.0).sqrt()
    }

    fn is_even(&self) -> bool {
        self.spread() <= EVEN * luminance(self.mean)
    }
}

/// Samples the centres of n² equal sub-triangles of a part.
fn look(scene: &Scene, soup: &Soup, triangle: u32, [a, b, c]: [Vec2; 3], n: u32) -> Look {
    let (ab, ac) = ((b - a) / n as f32, (c - a) / n as f32);
    let mut sum = Vec4::ZERO;
    let mut add = |at: Vec2| {
        let radiance = scene.emitted(soup, triangle, at.x, at.y);
        let l = luminance(radiance);
        sum += radiance.extend(l * l);
    };
    for row in 0..n {
        for column in 0..n - row {
            let at = a + ab * column as f32 + ac * row as f32;
            add(at + (ab + ac) / 3.0);
            if column + row + 1 < n {
                add(at + (ab + ac) * (2.0 / 3.0));
            }
        }
    }
    sum /= (n * n) as f32;
    Look {
        mean: sum.xyz(),
        square: sum.w,
    }
}

/// Approximate number of texels that cover the triangle, at most `most`: as many as
/// [`Scene::mean_over`] samples.
fn texels(scene: &Scene, soup: &Soup, triangle: u32, most: usize) -> u32 {
    let count = Cell::new(0u32);
    scene.mean_over(soup, triangle, WHOLE, most as u32, |_, _| {
        count.set(count.get() + 1);
        Vec4::ZERO
    });
    count.get()
}

/// The brightness of a triangle, which decides how its light is transported.
pub(crate) struct Brightness {
    /// Mean luminance.
    pub mean: f32,
    /// Mean luminance weighted by light instead of area: ∫L²/∫L. For a sign that glows in a dark
    /// texture, this is the luminance of the sign.
    pub bright: f32,
}

/// Brightness of the given triangles; zero for dark ones. The total number of texture samples is
/// bounded, with at least one per triangle.
pub(crate) fn brightness(scene: &Scene, soup: &Soup, triangles: &[u32]) -> Vec<Brightness> {
    let textured = triangles
        .iter()
        .filter(|&&t| varies(scene, soup.materials[t as usize]))
        .count();
    let samples = (MOST_SAMPLES / textured.max(1)).clamp(4, 1 << 12);
    triangles
        .par_iter()
        .map(|&t| {
            if !varies(scene, soup.materials[t as usize]) {
                let l = luminance(scene.emission(soup, t, 0.0, 0.0));
                return Brightness { mean: l, bright: l };
            }
            let n = texels(scene, soup, t, samples).isqrt();
            let seen = look(scene, soup, t, WHOLE, n.max(1));
            let mean = luminance(seen.mean);
            Brightness {
                mean,
                bright: if mean > 0.0 { seen.square / mean } else { 0.0 },
            }
        })
        .collect()
}

/// The four similar triangles formed by the corners and the edge midpoints, with the winding of the
/// original.
fn quarters<P>([a, b, c]: [P; 3]) -> [[P; 3]; 4]
where
    P: Copy + std::ops::Add<Output = P> + std::ops::Mul<f32, Output = P>,
{
    let (ab, bc, ca) = ((a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5);
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

/// The radiance of a triangle at every level of subdivision. Level *l* has 4^l cells; the children
/// of cell *i* are the cells from 4*i* to 4*i* + 3 of the next level.
struct Pyramid {
    triangle: u32,
    levels: Vec<Vec<Look>>,
}

impl Pyramid {
    /// Samples the finest level and averages upwards, so that the means of parts add up to the mean
    /// of the whole.
    fn build(world: &World, triangle: u32, most_levels: u32, samples: usize) -> Self {
        let (scene, soup) = (world.scene, world.soup);
        let texels = texels(scene, soup, triangle, samples);
        let across = texels.isqrt().max(1);
        let depth = across.next_power_of_two().ilog2().min(most_levels);
        let mut parts = vec![WHOLE];
        for _ in 0..depth {
            parts = parts.into_iter().flat_map(quarters).collect();
        }
        // Means matter even at a distance: several samples per texel that a cell's edge may cross,
        // within the limit.
        let wanted = (4 * texels as usize).max(WELL_KNOWN).min(samples);
        let each = ((wanted >> (2 * depth)) as u32).isqrt().max(1);
        let finest: Vec<Look> = parts
            .into_iter()
            .map(|part| look(scene, soup, triangle, part, each))
            .collect();
        let mut levels = vec![finest];
        for _ in 0..depth {
            let above = levels[levels.len() - 1]
                .as_chunks::<4>()
                .0
                .iter()
                .map(|four| Look {
                    mean: four.iter().map(|c| c.mean).sum::<Vec3>() * 0.25,
                    square: four.iter().map(|c| c.square).sum::<f32>() * 0.25,
                })
                .collect();
            levels.push(above);
        }
        levels.reverse();
        Pyramid { triangle, levels }
    }
}

/// A candidate cell for splitting.
struct Cut {
    /// Misplaced flux compared with uniform radiance: spread × area. It never exceeds that of the
    /// parent cell.
    gain: f32,
    pyramid: u32,
    level: u32,
    cell: u32,
}

/// Splits `triangles`, whose emission varies, into emitters. Together they cover every bright part
/// of each triangle.
///
/// The cells with the most misplaced flux are split first, up to [`MOST_PARTS`]. Deterministic.
pub(super) fn subdivide(world: &World, triangles: &[u32]) -> Vec<Emitter> {
    if triangles.is_empty() {
        return Vec::new();
    }
    let share = |most: usize| most / triangles.len();
    let samples = share(MOST_SAMPLES).clamp(*SAMPLES.start(), *SAMPLES.end());
    let levels = (share(MOST_CELLS).max(1).ilog2() / 2).min(MOST_LEVELS);
    let pyramids: Vec<Pyramid> = triangles
        .par_iter()
        .map(|&t| Pyramid::build(world, t, levels, samples))
        .collect();
    let mut cuts = Vec::new();
    for (k, pyramid) in pyramids.iter().enumerate() {
        candidates(world, k as u32, pyramid, &mut cuts);
    }
    // Ties go to the coarser cell, so that no cell precedes its parent.
    cuts.sort_unstable_by(|a, b| {
        (b.gain.total_cmp(&a.gain))
            .then(a.pyramid.cmp(&b.pyramid))
            .then(a.level.cmp(&b.level))
            .then(a.cell.cmp(&b.cell))
    });
    cuts.truncate(MOST_PARTS.saturating_sub(triangles.len()) / 3);
    cuts.sort_unstable_by_key(|c| (c.pyramid, c.level, c.cell));
    let mut emitters = Vec::with_capacity(triangles.len() + 3 * cuts.len());
    let mut rest = cuts.as_slice();
    for (k, pyramid) in pyramids.iter().enumerate() {
        let n = rest.partition_point(|c| c.pyramid == k as u32);
        let (own, others) = rest.split_at(n);
        rest = others;
        emit(world, pyramid, own, &mut emitters);
    }
    emitters
}

/// Finds the cells with uneven radiance, from the whole triangle downwards.
fn candidates(world: &World, index: u32, pyramid: &Pyramid, cuts: &mut Vec<Cut>) {
    let area = world.soup.areas[pyramid.triangle as usize];
    let mut frontier = vec![(0u32, f32::INFINITY)];
    for (level, cells) in pyramid.levels.iter().enumerate() {
        if level + 1 == pyramid.levels.len() {
            break;
        }
        let part = area / (1u32 << (2 * level)) as f32;
        let mut next = Vec::new();
        for &(cell, above) in &frontier {
            let c = &cells[cell as usize];
            if c.is_even() {
                continue;
            }
            let gain = (c.spread() * part).min(above);
            cuts.push(Cut {
                gain,
                pyramid: index,
                level: level as u32,
                cell,
            });
            next.extend((0..4).map(|q| (4 * cell + q, gain)));
        }
        frontier = next;
    }
}

/// Emits the parts that result from the cuts, except black ones. `cuts` are sorted by level and
/// cell.
fn emit(world: &World, pyramid: &Pyramid, cuts: &[Cut], emitters: &mut Vec<Emitter>) {
    let t = pyramid.triangle as usize;
    let material = &world.scene.materials[world.soup.materials[t] as usize];
    let area = world.soup.areas[t];
    let mut todo = vec![(0u32, 0u32, world.soup.triangles[t])];
    while let Some((level, cell, corners)) = todo.pop() {
        let seen = &pyramid.levels[level as usize][cell as usize];
        if seen.mean == Vec3::ZERO {
            continue;
        }
        if (cuts.binary_search_by_key(&(level, cell), |c| (c.level, c.cell))).is_ok() {
            for (q, corners) in quarters(corners).into_iter().enumerate().rev() {
                todo.push((level + 1, 4 * cell + q as u32, corners));
            }
            continue;
        }
        emitters.push(Emitter {
            triangle: pyramid.triangle,
            corners,
            normal: world.soup.normals[t],
            area: area / (1u32 << (2 * level)) as f32,
            radiance: seen.mean,
            // 8-bit texels do not resolve less than a hundredth of the mean.
            textured: seen.spread() > 0.01 * luminance(seen.mean),
            two_sided: material.double_sided,
        });
    }
}
