//! Builds a binary tree from the top down: each set of boxes is divided at the plane where the
//! surface area heuristic is least, of all planes between two centres along each axis.
//!
//! Based on MacDonald and Booth, *Heuristics for ray tracing using space subdivision* (1990), and
//! Wald and Havran, *On building fast kd-trees for ray tracing* (2006), for sorting once only.

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

/// Sets deeper than this are halved, so that the work is O(n log n) for any boxes: the heuristic
/// alone parts nested boxes one by one.
const DEEPEST: u32 = 48;

/// Builds the tree over at least one box. Depends only on its input.
pub(crate) fn build(boxes: &[Aabb]) -> Bvh2 {
    let mut sets = Sets::new(boxes);
    let whole =
        |set: &[u32]| (set.iter()).fold(Aabb::empty(), |all, &i| all.union(&boxes[i as usize]));
    let mut nodes = Vec::with_capacity(2 * boxes.len() - 1);
    nodes.push(Bvh2Node::default());
    // A range of each order, its node, and its depth.
    let mut work = vec![(0..boxes.len(), 0usize, 0u32)];
    while let Some((range, slot, depth)) = work.pop() {
        let set = &sets.orders[0][range.clone()];
        if let [one] = set {
            nodes[slot] = Bvh2Node::new(boxes[*one as usize], 1, *one);
            continue;
        }
        let first = nodes.len();
        nodes[slot] = Bvh2Node::new(whole(set), 0, first as u32);
        nodes.resize(first + 2, Bvh2Node::default());
        let (axis, middle) = match depth < DEEPEST {
            true => sets.cheapest(boxes, range.clone()),
            false => (0, range.start + range.len() / 2),
        };
        sets.part(range.clone(), axis, middle);
        work.push((middle..range.end, first + 1, depth + 1));
        work.push((range.start..middle, first, depth + 1));
    }
    let mut tree = Bvh2 {
        nodes,
        primitive_indices: (0..boxes.len() as u32).collect(),
        ..Bvh2::default()
    };
    tree.children_are_ordered_after_parents = true;
    tree
}

/// The boxes in the order of their centres along each axis. Each set of the tree has the same range
/// in all three.
struct Sets {
    orders: [Vec<u32>; 3],
    /// Whether a box is in the first part, and room for the second.
    in_first: Vec<bool>,
    second: Vec<u32>,
    /// The cost of what follows each place.
    after: Vec<f32>,
}

impl Sets {
    fn new(boxes: &[Aabb]) -> Self {
        let orders = [0, 1, 2].map(|axis| {
            let key = |i: u32| boxes[i as usize].min[axis] + boxes[i as usize].max[axis];
            let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
            order.sort_unstable_by(|&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
            order
        });
        Sets {
            orders,
            in_first: vec![false; boxes.len()],
            second: Vec::with_capacity(boxes.len()),
            after: vec![0.0; boxes.len()],
        }
    }

    /// The axis and the place at which parting `range` costs least: number of boxes × area of their
    /// bounding box, summed over both parts. Halves if costs are not numbers.
    fn cheapest(&mut self, boxes: &[Aabb], range: std::ops::Range<usize>) -> (usize, usize) {
        let mut best = (f32::INFINITY, 0, range.start + range.len() / 2);
        for axis in 0..3 {
            let order = &self.orders[axis];
            let mut all = Aabb::empty();
            for k in (range.start + 1..range.end).rev() {
                all = all.union(&boxes[order[k] as usize]);
                self.after[k] = all.half_area() * (range.end - k) as f32;
            }
            let mut all = Aabb::empty();
            for k in range.start + 1..range.end {
                all = all.union(&boxes[order[k - 1] as usize]);
                let cost = all.half_area() * (k - range.start) as f32 + self.after[k];
                if cost < best.0 {
                    best = (cost, axis, k);
                }
            }
        }
        (best.1, best.2)
    }

    /// Parts `range` of all orders at the place `middle` of the order along `axis`.
    fn part(&mut self, range: std::ops::Range<usize>, axis: usize, middle: usize) {
        for k in range.clone() {
            self.in_first[self.orders[axis][k] as usize] = k < middle;
        }
        for other in (0..3).filter(|&other| other != axis) {
            let order = &mut self.orders[other][range.clone()];
            self.second.clear();
            let mut firsts = 0;
            for k in 0..order.len() {
                let i = order[k];
                if self.in_first[i as usize] {
                    order[firsts] = i;
                    firsts += 1;
                } else {
                    self.second.push(i);
                }
            }
            order[firsts..].copy_from_slice(&self.second);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Depth of the tree, after checking that each of `boxes` is in one leaf, and each node inside of
    /// its parent.
    fn depth_of(tree: &Bvh2, boxes: &[Aabb]) -> u32 {
        let mut found = vec![0; boxes.len()];
        let mut deepest = 0;
        let mut work = vec![(0u32, *tree.nodes[0].aabb(), 0u32)];
        while let Some((id, around, depth)) = work.pop() {
            deepest = deepest.max(depth);
            let node = &tree.nodes[id as usize];
            assert_eq!(around.union(node.aabb()), around);
            if node.is_leaf() {
                let which = tree.primitive_indices[node.first_index as usize] as usize;
                found[which] += 1;
                assert_eq!(*node.aabb(), boxes[which]);
            } else {
                work.push((node.first_index, *node.aabb(), depth + 1));
                work.push((node.first_index + 1, *node.aabb(), depth + 1));
            }
        }
        assert!(found.iter().all(|n| *n == 1));
        deepest
    }

    fn cube(centre: [f32; 3], half: f32) -> Aabb {
        let centre = glam::Vec3A::from_array(centre);
        Aabb::new(centre - half, centre + half)
    }

    #[test]
    fn rooms_are_parted_from_each_other() {
        // Two rooms of 100 boxes each, 1 m apart; their own boxes are 0.1 m apart.
        let boxes: Vec<Aabb> = (0..200)
            .map(|k| {
                cube(
                    [(k % 2) as f32 * 2.0 + (k / 2) as f32 * 0.01, 0.0, 0.0],
                    0.01,
                )
            })
            .collect();
        let tree = build(&boxes);
        depth_of(&tree, &boxes);
        let [a, b] = [1, 2].map(|id| *tree.nodes[id].aabb());
        assert!(a.max.x < 1.5 && b.min.x > 1.5, "{a:?} {b:?}");
    }

    #[test]
    fn nested_and_equal_boxes_end_soon() {
        let n = 20_000;
        // Each box costs less alone than with the others: the heuristic parts one at a time.
        let nested: Vec<Aabb> = (0..n)
            .map(|k| cube([0.0; 3], 0.7f32.powi(k % 90)))
            .collect();
        let growing: Vec<Aabb> = (0..n)
            .map(|k| cube([k as f32; 3], k as f32 * 1e3))
            .collect();
        let equal = vec![cube([0.5; 3], 0.0); n as usize];
        for boxes in [nested, growing, equal, vec![cube([0.0; 3], 1.0)]] {
            let depth = depth_of(&build(&boxes), &boxes);
            assert!(depth <= DEEPEST + 15, "{depth}");
        }
    }
}
