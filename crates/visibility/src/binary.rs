//! Binary trees, built from the bottom up by obvhs or from the top down, and converted to a plain
//! form with exact bounds.

use glam::{DVec3, Vec3};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

use crate::bvh::Quality;
use crate::groups::Items;
use crate::sweep;

/// Most triangles in a leaf: two packs.
pub(crate) const MAX_LEAF: usize = 8;

/// Cost of a node visit in triangle tests, for merging leaves in obvhs. Its own presets use 3, for
/// triangles tested one by one. Here rays are equally fast from 3 to 8 (`examples/compare.rs`), and
/// 5 needs a fifth fewer nodes.
const TRAVERSAL_COST: f32 = 5.0;

/// Node of a [`Binary`] tree: a leaf over `order[first..first + count]`, or, if `count == 0`, the
/// parent of nodes `first` and `first + 1`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BinaryNode {
    pub lo: Vec3,
    pub hi: Vec3,
    pub first: u32,
    pub count: u32,
}

impl BinaryNode {
    /// Half of the box's surface area, proportional to the number of rays that enter. In f64, which
    /// cannot overflow.
    pub fn half_area(&self) -> f64 {
        let d = (self.hi.as_dvec3() - self.lo.as_dvec3()).max(DVec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// Binary tree with the root first and children after their parents.
pub(crate) struct Binary {
    pub nodes: Vec<BinaryNode>,
    /// Permutation of the triangles that leaves refer to.
    pub order: Vec<u32>,
}

/// What trees are built over.
pub(crate) struct Boxes<'t> {
    triangles: &'t [[Vec3; 3]],
    items: Items,
    /// In the unit cube, as obvhs requires.
    boxes: Vec<Aabb>,
}

/// Prepares `triangles`, which must be finite and not empty.
pub(crate) fn boxes(triangles: &[[Vec3; 3]]) -> Boxes<'_> {
    let mut scene = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for corner in triangles.iter().flatten() {
        scene = (scene.0.min(*corner), scene.1.max(*corner));
    }
    let origin = scene.0.as_dvec3();
    let extent = (scene.1.as_dvec3() - origin).max_element();
    // obvhs multiplies areas in f32 and unwraps comparisons when sorting. Unit scale keeps areas
    // from overflowing to NaN at 1e18 and from underflowing to equal values at 1e-18.
    let scale = if extent > 0.0 { 1.0 / extent } else { 0.0 };
    let to_unit = |p: Vec3| ((p.as_dvec3() - origin) * scale).as_vec3();
    let unit = |index: u32| {
        let [a, b, c] = triangles[index as usize].map(to_unit);
        (a.min(b).min(c), a.max(b).max(c))
    };

    let centres: Vec<[f32; 3]> = (0..triangles.len() as u32)
        .map(|i| {
            let (lo, hi) = unit(i);
            ((lo + hi) * 0.5).to_array()
        })
        .collect();
    let size = |i: u32| {
        let (lo, hi) = unit(i);
        (hi - lo).max_element()
    };
    let items = Items::gather(&centres, size);
    drop(centres);

    let boxes: Vec<Aabb> = (0..items.len())
        .map(|item| {
            let (lo, hi) =
                items
                    .triangles(item)
                    .iter()
                    .fold((Vec3::ONE, Vec3::ZERO), |(lo, hi), &t| {
                        let b = unit(t);
                        (lo.min(b.0), hi.max(b.1))
                    });
            let pad = jitter(item as u32, (hi - lo).max_element());
            Aabb::new((lo - pad).into(), (hi + pad).into())
        })
        .collect();
    Boxes {
        triangles,
        items,
        boxes,
    }
}

/// Padding of the box that obvhs sees for primitive `item` of size `size`; our own bounds stay
/// exact.
///
/// In rows of equal tiles every pair has the same cost, and PLOC then merges one pair per pass.
/// Random padding by up to 1/128 of the size breaks such ties without harming the tree; the
/// constant part gives boxes without area a cost.
fn jitter(item: u32, size: f32) -> f32 {
    let hash = item.wrapping_mul(0x9e37_79b9);
    let hash = (hash ^ hash >> 15).wrapping_mul(0x85eb_ca6b);
    let random = (hash >> 8) as f32 / (1u32 << 24) as f32;
    size * random / 128.0 + (1.0 + random) / (1u32 << 22) as f32
}

impl Boxes<'_> {
    /// Clusters pairs of boxes that are near in space (PLOC), and moves the largest nodes to where
    /// they cost least.
    pub fn clustered(&self, quality: Quality) -> Binary {
        let mut tree = PlocBuilder::new().build(
            match quality {
                Quality::Fast => PlocSearchDistance::Low,
                Quality::Balanced | Quality::High => PlocSearchDistance::VeryHigh,
            },
            &self.boxes,
            (0..self.boxes.len() as u32).collect(),
            SortPrecision::U64,
            match quality {
                Quality::Fast | Quality::Balanced => 3,
                Quality::High => 1,
            },
        );
        let ratio = match quality {
            Quality::Fast => 0.02,
            Quality::Balanced => 0.05,
            Quality::High => 1.0,
        };
        reinsert(&mut tree, ratio);
        collapse(&mut tree, MAX_LEAF as u32, TRAVERSAL_COST);
        if quality != Quality::Fast {
            reinsert(&mut tree, (ratio * 2.0).min(1.0));
        }
        to_binary(tree, &self.items, self.triangles)
    }

    /// Divides all boxes again and again. Moving a few nodes afterwards gains nothing.
    pub fn divided(&self, quality: Quality) -> Binary {
        let mut tree = sweep::build(&self.boxes);
        if quality == Quality::High {
            reinsert(&mut tree, 1.0);
        }
        collapse(&mut tree, MAX_LEAF as u32, TRAVERSAL_COST);
        to_binary(tree, &self.items, self.triangles)
    }
}

/// obvhs's reinsertion uses a stack of 2 × max_depth entries and silently overwrites it when it is
/// full. So this passes twice the real depth, and skips reinsertion if only a degenerate scene would
/// need more.
fn reinsert(tree: &mut Bvh2, ratio: f32) {
    let depth = depth(tree);
    if depth <= 1024 {
        tree.max_depth = (depth * 2).max(96);
        ReinsertionOptimizer::default().run(tree, ratio, None);
    }
}

/// Depth of an obvhs tree, without recursion.
fn depth(tree: &Bvh2) -> usize {
    let mut stack = vec![(0u32, 1usize)];
    let mut deepest = 0;
    while let Some((index, depth)) = stack.pop() {
        deepest = deepest.max(depth);
        let node = &tree.nodes[index as usize];
        if !node.is_leaf() {
            stack.push((node.first_index, depth + 1));
            stack.push((node.first_index + 1, depth + 1));
        }
    }
    deepest
}

/// The subtree that a slot of the new tree represents.
enum Subtree {
    Obvhs(u32),
    Range { first: u32, end: u32 },
}

fn to_binary(tree: Bvh2, items: &Items, triangles: &[[Vec3; 3]]) -> Binary {
    let empty = BinaryNode {
        lo: Vec3::INFINITY,
        hi: Vec3::NEG_INFINITY,
        first: 0,
        count: 0,
    };
    let mut nodes = Vec::with_capacity(tree.nodes.len());
    let mut order: Vec<u32> = Vec::with_capacity(triangles.len());
    nodes.push(empty);
    let mut work = vec![(Subtree::Obvhs(0), 0usize)];
    while let Some((source, slot)) = work.pop() {
        let (left, right) = match source {
            Subtree::Obvhs(index) => {
                let node = &tree.nodes[index as usize];
                if node.is_leaf() {
                    let start = order.len() as u32;
                    let range =
                        node.first_index as usize..(node.first_index + node.prim_count) as usize;
                    for &item in &tree.primitive_indices[range] {
                        order.extend_from_slice(items.triangles(item as usize));
                    }
                    work.push((
                        Subtree::Range {
                            first: start,
                            end: order.len() as u32,
                        },
                        slot,
                    ));
                    continue;
                }
                (
                    Subtree::Obvhs(node.first_index),
                    Subtree::Obvhs(node.first_index + 1),
                )
            }
            Subtree::Range { first, end } => {
                let count = end - first;
                if count as usize <= MAX_LEAF {
                    nodes[slot].first = first;
                    nodes[slot].count = count;
                    for &t in &order[first as usize..end as usize] {
                        for corner in triangles[t as usize] {
                            nodes[slot].lo = nodes[slot].lo.min(corner);
                            nodes[slot].hi = nodes[slot].hi.max(corner);
                        }
                    }
                    continue;
                }
                // Split at a multiple of the leaf size, so that all leaves but one are full.
                let middle = first + (count / 2).next_multiple_of(MAX_LEAF as u32);
                (
                    Subtree::Range { first, end: middle },
                    Subtree::Range { first: middle, end },
                )
            }
        };
        let children = nodes.len();
        nodes[slot].first = children as u32;
        nodes.extend([empty; 2]);
        work.push((right, children + 1));
        work.push((left, children));
    }
    for slot in (0..nodes.len()).rev() {
        if nodes[slot].count == 0 {
            let (a, b) = (
                nodes[nodes[slot].first as usize],
                nodes[nodes[slot].first as usize + 1],
            );
            nodes[slot].lo = a.lo.min(b.lo);
            nodes[slot].hi = a.hi.max(b.hi);
        }
    }
    Binary { nodes, order }
}
