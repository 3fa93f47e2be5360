//! Denoises the light gathered for vertices.
//!
//! Like the denoising of lumels ([`crate::smooth`]), on the mesh instead of the page: adjacent
//! points on one piece of surface gathered similar light with independent random numbers. The
//! result is a mean in which each point counts as far as its difference can be explained by noise,
//! with weights for one half of the samples from the other half. A mean instead of a fit, because a
//! vertex has few and unevenly distributed neighbours.

use glam::Vec3;
use radiosity::{World, luminance};
use rayon::prelude::*;

use super::cluster::Spot;
use crate::parts::LIFT;
use crate::received::Received;
use crate::smooth::likely;
use crate::window::SAME_FACING;

/// Number of steps from group to group in a window.
const RINGS: usize = 2;

/// Extent of a window, in lumels of its centre.
const REACH: f32 = 4.0;

/// Most groups in a window.
const MOST: usize = 24;

/// Groups to smooth, and their adjacency on the mesh without walls between them.
pub(super) struct Mesh {
    spots: Vec<Option<Spot>>,
    /// Start of each one's neighbours in `next`; ascending.
    starts: Vec<u32>,
    next: Vec<u32>,
}

impl Mesh {
    /// A mesh of `spots`, whose edges are `pairs`.
    pub fn new(spots: Vec<Option<Spot>>, mut pairs: Vec<[u32; 2]>, world: &World) -> Mesh {
        pairs.retain(|[a, b]| a < b);
        pairs.par_sort_unstable();
        pairs.dedup();
        let open: Vec<[u32; 2]> = (pairs.into_par_iter())
            .with_min_len(256)
            .filter(|pair| {
                let [Some(a), Some(b)] = pair.map(|g| spots[g as usize]) else {
                    return false;
                };
                let lift = LIFT * a.size.min(b.size);
                beside(&a, &b) && beside(&b, &a) && !world.wall_between(&a.at, &b.at, lift)
            })
            .collect();
        Mesh::of(spots, &open)
    }

    /// A mesh with these neighbours.
    fn of(spots: Vec<Option<Spot>>, pairs: &[[u32; 2]]) -> Mesh {
        let mut starts = vec![0u32; spots.len() + 1];
        for g in pairs.iter().flatten() {
            starts[*g as usize + 1] += 1;
        }
        for g in 0..spots.len() {
            starts[g + 1] += starts[g];
        }
        let mut next = vec![0u32; 2 * pairs.len()];
        let mut at = starts.clone();
        for &[a, b] in pairs {
            for (from, to) in [(a, b), (b, a)] {
                next[at[from as usize] as usize] = to;
                at[from as usize] += 1;
            }
        }
        Mesh {
            spots,
            starts,
            next,
        }
    }

    /// The groups around one, itself first.
    fn around(&self, group: usize, out: &mut Vec<u32>) {
        out.clear();
        out.push(group as u32);
        let Some(own) = self.spots[group] else {
            return;
        };
        let mut from = 0;
        for _ in 0..RINGS {
            let to = out.len();
            for k in from..to {
                let [start, end] = [0, 1].map(|i| self.starts[out[k] as usize + i] as usize);
                for &g in &self.next[start..end] {
                    let near = self.spots[g as usize].is_some_and(|s| beside(&own, &s));
                    if out.len() < MOST && near && !out.contains(&g) {
                        out.push(g);
                    }
                }
            }
            from = to;
        }
    }

    /// For each group, whether there are others around it. Then smoothing at least halves its
    /// variance, provided that they are similar, and half of the rays suffice.
    pub fn has_others(&self) -> Vec<bool> {
        (0..self.spots.len())
            .into_par_iter()
            .with_min_len(256)
            .map_init(Vec::new, |around, g| {
                self.around(g, around);
                around.len() > 1
            })
            .collect()
    }

    /// Smooths indirect light in place, for groups that are completely visible.
    pub fn smooth(&self, received: &mut [Received]) {
        let variance = |g: u32| received[g as usize].indirect_variance;
        let pooled = self.of_windows(received, |_, around| {
            let sum: f32 = around.iter().map(|g| variance(*g)).sum();
            sum / around.len().max(1) as f32
        });
        let smoothed = self.of_windows(received, |g, around| {
            (around.len() > 1).then(|| mean(g, around, received, &pooled))
        });
        for (r, smoothed) in received.iter_mut().zip(smoothed) {
            if let Some((indirect, variance)) = smoothed {
                (r.indirect, r.indirect_variance) = (indirect, variance);
            }
        }
    }

    /// `what` of each group and the visible groups around it; hidden groups have none around them.
    fn of_windows<T: Send>(
        &self,
        received: &[Received],
        what: impl Fn(usize, &mut Vec<u32>) -> T + Sync,
    ) -> Vec<T> {
        let whole = |g: u32| received[g as usize].open == 1.0;
        (0..received.len())
            .into_par_iter()
            .with_min_len(256)
            .map_init(Vec::new, |around, g| {
                match whole(g as u32) {
                    true => self.around(g, around),
                    false => around.clear(),
                }
                around.retain(|k| whole(*k));
                what(g, around)
            })
            .collect()
    }
}

/// Whether another spot is near `own` and on the same piece of surface.
fn beside(own: &Spot, other: &Spot) -> bool {
    let reach = REACH * own.size;
    own.at.normal.dot(other.at.normal) >= SAME_FACING
        && own.at.position.distance_squared(other.at.position) <= reach * reach
}

/// Mean over a window, and the variance of its luminance.
fn mean(g: usize, around: &[u32], received: &[Received], pooled: &[f32]) -> (Vec3, f32) {
    let own = received[g].halves().map(luminance);
    let (mut indirect, mut variance) = (Vec3::ZERO, 0.0);
    for (judge, judged) in [(0, 1), (1, 0)] {
        let (mut sum, mut weight, mut squares) = (Vec3::ZERO, 0.0, 0.0);
        for k in around.iter().map(|k| *k as usize) {
            let halves = received[k].halves();
            let w = likely(luminance(halves[judge]) - own[judge], pooled[g] + pooled[k]);
            sum += halves[judged] * w;
            weight += w;
            squares += w * w * pooled[k];
        }
        indirect += 0.5 * sum / weight;
        variance += 0.5 * squares / (weight * weight);
    }
    (indirect.max(Vec3::ZERO), variance)
}

#[cfg(test)]
mod tests {
    use radiosity::SurfacePoint;

    use super::*;
    use crate::smooth::tests::normal_numbers;

    /// Columns of light after smoothing, over a floor of points with light `light(x)` and standard
    /// errors `noise(x)`. Edges run along rows, columns and diagonals as in a mesh, except from
    /// columns x with `cut` to the next.
    fn smoothed(
        light: impl Fn(u32) -> f32,
        noise: impl Fn(u32) -> f32,
        cut: impl Fn(u32) -> bool,
    ) -> Vec<Vec<f32>> {
        const SIZE: u32 = 48;
        let mut normal = normal_numbers();
        let (mut spots, mut received, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
        for [x, y] in (0..SIZE * SIZE).map(|k| [k / SIZE, k % SIZE]) {
            let position = Vec3::new(x as f32, y as f32, 0.0);
            spots.push(Some(Spot {
                at: SurfacePoint {
                    position,
                    origin: position,
                    normal: Vec3::Z,
                    geometric: Vec3::Z,
                },
                size: 1.0,
            }));
            // Halves have twice the variance.
            let halves = [0; 2].map(|_| light(x) + noise(x) * 2f32.sqrt() * normal());
            received.push(Received {
                indirect: Vec3::splat(0.5 * (halves[0] + halves[1])),
                first_half: Vec3::splat(halves[0]),
                indirect_variance: noise(x) * noise(x),
                open: 1.0,
                ..Received::default()
            });
            let own = x * SIZE + y;
            if y + 1 < SIZE {
                pairs.push([own, own + 1]);
            }
            if x + 1 < SIZE && !cut(x) {
                pairs.push([own, own + SIZE]);
                if y + 1 < SIZE {
                    pairs.push([own, own + SIZE + 1]);
                }
            }
        }
        Mesh::of(spots, &pairs).smooth(&mut received);
        let columns = received.chunks(SIZE as usize);
        columns
            .map(|c| c.iter().map(|r| luminance(r.indirect)).collect())
            .collect()
    }

    #[test]
    fn noise_goes_and_the_light_stays() {
        let columns = smoothed(|_| 1.0, |_| 0.3, |_| false);
        let inner = &columns[2..46];
        let all: Vec<f32> = inner.iter().flat_map(|c| c[2..46].to_vec()).collect();
        let n = all.len() as f32;
        let mean = all.iter().sum::<f32>() / n;
        let left = (all.iter().map(|e| (e - mean) * (e - mean)).sum::<f32>() / n).sqrt();
        // Nineteen points with equal weights would leave 0.069 of 0.3; noisy weights, e⁻¹ᐟ⁴ at one
        // standard deviation, leave slightly more.
        assert!(left < 0.11, "{left}");
        // The noise of the total mean is 0.3 / √2304 = 0.006.
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
    }

    #[test]
    fn nothing_is_shared_where_no_edge_leads() {
        // Noise that would hide the difference.
        let light = |x: u32| if x < 24 { 1.0 } else { 0.0 };
        let columns = smoothed(light, |x| 2.0 * light(x), |x| x == 23);
        assert!(columns[24..].iter().flatten().all(|e| *e == 0.0));
        let columns = smoothed(light, |x| 2.0 * light(x), |_| false);
        assert!(columns[24].iter().any(|e| *e != 0.0));
    }
}
