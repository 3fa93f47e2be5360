//! Emissive triangles, in a tree that tells near from far.

use glam::Vec3;

use crate::world::{Emission, MEAN_SAMPLES, World, luminance};

/// One emissive triangle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Emitter {
    pub triangle: u32,
    pub corners: [Vec3; 3],
    /// Unit normal of the front.
    pub normal: Vec3,
    pub area: f32,
    /// Mean radiance.
    pub radiance: Vec3,
    /// Emission varies over the triangle (a texture).
    pub textured: bool,
    pub two_sided: bool,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    pub centre: Vec3,
    pub radius: f32,
    /// Σ luminance × area.
    pub power: f32,
    /// Emitters `[start, end)`.
    pub start: u32,
    pub end: u32,
    /// The second child; the first follows its parent. 0 for a leaf, which has one emitter.
    pub second: u32,
}

/// The surfaces whose light [`DirectLight`](crate::DirectLight) computes.
///
/// A binary tree by position: a receiver takes nearby triangles one by one, in closed form, and far groups whole, so that ten
/// thousand triangles cost little more than ten.
#[derive(Debug, Default)]
pub struct Emitters {
    pub(crate) emitters: Vec<Emitter>,
    pub(crate) nodes: Vec<Node>,
    /// Running Σ luminance × area before each emitter, one more than there are.
    pub(crate) cumulative: Vec<f64>,
}

impl Emitters {
    /// Collects the emitters that are to be sampled. O(n log² n).
    pub fn collect(world: &World) -> Self {
        let mut emitters: Vec<Emitter> = (0..world.soup.triangles.len() as u32)
            .filter(|&t| world.emission(t) == Emission::Sampled)
            .map(|t| {
                let material = &world.scene.materials[world.soup.materials[t as usize] as usize];
                Emitter {
                    triangle: t,
                    corners: world.soup.triangles[t as usize],
                    normal: world.soup.normals[t as usize],
                    area: world.soup.areas[t as usize],
                    radiance: world.scene.mean_emission(world.soup, t, MEAN_SAMPLES),
                    textured: material.emissive_texture.is_some(),
                    two_sided: material.double_sided,
                }
            })
            .collect();
        let mut nodes = Vec::with_capacity(2 * emitters.len());
        if !emitters.is_empty() {
            let n = emitters.len();
            split(&mut emitters, 0, n, &mut nodes);
        }
        let mut cumulative = Vec::with_capacity(emitters.len() + 1);
        let mut sum = 0f64;
        cumulative.push(0.0);
        for e in &emitters {
            sum += (luminance(e.radiance) * e.area) as f64;
            cumulative.push(sum);
        }
        Emitters {
            emitters,
            nodes,
            cumulative,
        }
    }

    /// How many triangles.
    pub fn len(&self) -> usize {
        self.emitters.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// The emitter of `[start, end)` at the share `x` ∈ [0, 1) of their power, with its probability.
    pub(crate) fn pick(&self, start: u32, end: u32, x: f32) -> (&Emitter, f32) {
        let c = &self.cumulative[start as usize..=end as usize];
        let (low, high) = (c[0], c[c.len() - 1]);
        let at = low + x as f64 * (high - low);
        let k = c[1..].partition_point(|&s| s <= at).min(c.len() - 2);
        let p = (c[k + 1] - c[k]) / (high - low);
        (&self.emitters[start as usize + k], p as f32)
    }
}

/// Orders `emitters[start..end]` and appends their subtree to `nodes`. The depth is log2 n, since halves are equal.
fn split(emitters: &mut [Emitter], start: usize, end: usize, nodes: &mut Vec<Node>) {
    let part = &mut emitters[start..end];
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut power = 0f64;
    for e in part.iter() {
        for c in e.corners {
            low = low.min(c);
            high = high.max(c);
        }
        power += (luminance(e.radiance) * e.area) as f64;
    }
    let id = nodes.len();
    nodes.push(Node {
        centre: (low + high) * 0.5,
        radius: (high - low).length() * 0.5,
        power: power as f32,
        start: start as u32,
        end: end as u32,
        second: 0,
    });
    if part.len() == 1 {
        return;
    }
    let size = high - low;
    let axis = size.max_position();
    let key = |e: &Emitter| e.corners[0][axis] + e.corners[1][axis] + e.corners[2][axis];
    let middle = part.len() / 2;
    part.select_nth_unstable_by(middle, |a, b| {
        key(a).total_cmp(&key(b)).then(a.triangle.cmp(&b.triangle))
    });
    split(emitters, start, start + middle, nodes);
    nodes[id].second = nodes.len() as u32;
    split(emitters, start + middle, end, nodes);
}
