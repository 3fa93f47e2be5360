//! Emissive surfaces, in a tree that distinguishes near from far ones.

mod merge;
mod parts;
mod tree;

use glam::Vec3;

use crate::world::{Emission, SurfacePoint, World, luminance};

pub(crate) use parts::brightness;
pub(crate) use tree::Node;

/// An emissive triangle: a triangle of the scene, a part of one with an uneven texture, or a part
/// of the union of several coplanar triangles with the same emission.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Emitter {
    /// The scene triangle that it belongs to, or the first of several.
    pub triangle: u32,
    pub corners: [Vec3; 3],
    /// Unit normal of the front.
    pub normal: Vec3,
    pub area: f32,
    /// Mean radiance.
    pub radiance: Vec3,
    /// Whether emission varies over the triangle (a texture).
    pub textured: bool,
    pub two_sided: bool,
}

impl Emitter {
    /// Luminance × area. The power sent differs by the factor π and by the number of sides.
    fn power(&self) -> f64 {
        luminance(self.radiance) as f64 * self.area as f64
    }
}

/// Nodes of at most this many emitters are not descended further: the choice is made among all of
/// them.
const FEW: u32 = 16;

/// Maximum number of parts of a node whose contributions to a receiver are computed one by one.
const PARTS: usize = 128;

/// Parts of a node, each an emitter or a smaller node, and their approximate contributions to a
/// receiver.
pub(crate) struct Parts {
    count: usize,
    sum: f32,
    nodes: [u32; PARTS],
    weights: [f32; PARTS],
}

impl Parts {
    /// Chooses a part in proportion to its contribution, with `x` ∈ [0, 1). Returns it with its
    /// probability and what is left of `x`; `None` if none contributes.
    fn choose(&self, x: f64) -> Option<(u32, f32, f64)> {
        let mut left = x * f64::from(self.sum);
        let mut chosen = None;
        let parts = self.nodes.iter().zip(&self.weights).take(self.count);
        for (&node, &weight) in parts.filter(|(_, weight)| **weight > 0.0) {
            let within = left / f64::from(weight);
            chosen = Some((node, weight / self.sum, within.min(1.0 - f64::EPSILON)));
            if within < 1.0 {
                break;
            }
            left -= f64::from(weight);
        }
        chosen
    }
}

/// The surfaces whose light [`DirectLight`](crate::DirectLight) computes.
///
/// They are in a binary tree by position. A receiver uses nearby triangles individually, in closed
/// form, and distant groups as a whole, so that ten thousand triangles cost little more than ten.
/// Before the tree is built, triangles that form a polygon of uniform emission are merged, and
/// textured triangles are subdivided where they are bright.
#[derive(Debug, Default)]
pub struct Emitters {
    pub(crate) emitters: Vec<Emitter>,
    pub(crate) nodes: Vec<Node>,
    /// Running sum of power before each emitter, with one more entry than emitters.
    cumulative: Vec<f64>,
}

impl Emitters {
    /// Collects the emitters to sample. O(n log n) in emissive triangles. The total number of
    /// texture samples is bounded (with at least one per triangle).
    pub fn collect(world: &World) -> Self {
        let (scene, soup) = (world.scene, world.soup);
        let (varied, plain): (Vec<u32>, Vec<u32>) = (0..soup.triangles.len() as u32)
            .filter(|&t| world.emission(t) == Emission::Sampled)
            .partition(|&t| parts::varies(scene, soup.materials[t as usize]));
        let mut emitters: Vec<Emitter> = plain
            .into_iter()
            .map(|t| {
                let material = &scene.materials[soup.materials[t as usize] as usize];
                Emitter {
                    triangle: t,
                    corners: soup.triangles[t as usize],
                    normal: soup.normals[t as usize],
                    area: soup.areas[t as usize],
                    radiance: material.emissive,
                    textured: false,
                    two_sided: material.double_sided,
                }
            })
            .collect();
        merge::merge_coplanar(
            &mut emitters,
            |e| soup.materials[e.triangle as usize],
            |p| 0.5 * world.offset(p),
        );
        emitters.extend(parts::subdivide(world, &varied));
        Self::new(emitters)
    }

    fn new(mut emitters: Vec<Emitter>) -> Self {
        let nodes = tree::build(&mut emitters);
        let mut cumulative = Vec::with_capacity(emitters.len() + 1);
        let mut sum = 0f64;
        cumulative.push(0.0);
        for e in &emitters {
            sum += e.power();
            cumulative.push(sum);
        }
        Emitters {
            emitters,
            nodes,
            cumulative,
        }
    }

    /// Number of emitters: triangles after merging and subdividing.
    pub fn len(&self) -> usize {
        self.emitters.len()
    }

    /// Whether there are no emitters.
    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// Samples one emitter of a node, roughly in proportion to its contribution to `p`, and returns
    /// it with its probability; `None` if none can contribute. `x` ∈ [0, 1). O(log n).
    pub(crate) fn pick(&self, node: u32, p: &SurfacePoint, x: f64) -> Option<(&Emitter, f32)> {
        let mut id = node;
        let (mut x, mut probability) = (x, 1f64);
        loop {
            let node = &self.nodes[id as usize];
            if node.second == 0 {
                return Some((&self.emitters[node.start as usize], probability as f32));
            }
            if node.looks_alike(p.position) {
                let (e, own) = self.pick_by_power(node.start, node.end, x);
                return Some((e, (probability * own) as f32));
            }
            if node.end - node.start <= FEW {
                break;
            }
            // Not `array::map`, which is not inlined.
            let weight =
                |child: u32| self.nodes[child as usize].importance(p.position, p.normal, 0.0);
            let children = [id + 1, node.second];
            let (a, b) = (weight(children[0]) as f64, weight(children[1]) as f64);
            let sum = a + b;
            if sum <= 0.0 {
                return None;
            }
            let share = a / sum;
            let second = x >= share;
            let (low, part) = if second {
                (share, 1.0 - share)
            } else {
                (0.0, share)
            };
            x = ((x - low) / part).clamp(0.0, 1.0 - f64::EPSILON);
            probability *= part;
            id = children[second as usize];
        }
        let (leaf, own, _) = self.parts(id, p, 0.0).choose(x)?;
        let e = &self.emitters[self.nodes[leaf as usize].start as usize];
        Some((e, (probability * own as f64) as f32))
    }

    /// As [`pick`](Self::pick), of a node whose parts are known.
    pub(crate) fn pick_of(
        &self,
        parts: &Parts,
        p: &SurfacePoint,
        x: f64,
    ) -> Option<(&Emitter, f32)> {
        let (node, share, x) = parts.choose(x)?;
        let (e, own) = self.pick(node, p, x)?;
        Some((e, share * own))
    }

    /// The parts of a node: all of its emitters if there are not too many. Their contributions are
    /// to a receiver of size `scale` (metres) around `p`.
    ///
    /// Small parts, because the faces of a node may look everywhere (as those of a box or a bulb
    /// do), and a choice between two nodes does not know which of their faces look away. Many faces
    /// that look the same way remain one part.
    pub(crate) fn parts(&self, node: u32, p: &SurfacePoint, scale: f32) -> Parts {
        let mut parts = Parts {
            count: 0,
            sum: 0.0,
            nodes: [0; PARTS],
            weights: [0.0; PARTS],
        };
        let count = |node: &Node| (node.end - node.start) as usize;
        // A child has at least a quarter of its parent's emitters (`lower_part`), so this makes at
        // most four times as many parts as it says.
        let most = match count(&self.nodes[node as usize]) {
            n if n <= PARTS => 1,
            n => n / (PARTS / 4),
        };
        let mut stack = [0u32; 64];
        stack[0] = node;
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let id = stack[depth];
            let node = &self.nodes[id as usize];
            let alike = node.cos_spread > tree::ALIKE && count(node) > FEW as usize;
            if count(node) > most && !alike {
                (stack[depth], stack[depth + 1]) = (node.second, id + 1);
                depth += 2;
                continue;
            }
            let weight = node.importance(p.position, p.normal, scale);
            (parts.nodes[parts.count], parts.weights[parts.count]) = (id, weight);
            parts.sum += weight;
            parts.count += 1;
        }
        parts
    }

    /// The emitter of `[start, end)` at the share `x` ∈ [0, 1) of their power, with its
    /// probability.
    fn pick_by_power(&self, start: u32, end: u32, x: f64) -> (&Emitter, f64) {
        let c = &self.cumulative[start as usize..=end as usize];
        let (low, high) = (c[0], c[c.len() - 1]);
        let at = low + x * (high - low);
        let k = c[1..].partition_point(|&s| s <= at).min(c.len() - 2);
        let own = (c[k + 1] - c[k]) / (high - low).max(f64::MIN_POSITIVE);
        (&self.emitters[start as usize + k], own)
    }
}

#[cfg(test)]
mod tests;
