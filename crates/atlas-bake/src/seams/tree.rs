//! A bounding box tree for border pieces.
//!
//! Splitting at the median keeps the depth at log₂ n even if boxes coincide. obvhs, which builds
//! the tree for rays, merges pairs of boxes by cost; seams consist of pairs of equal boxes, and
//! kits of rows of them, which it would merge pair by pair.

use glam::Vec3;

/// Most boxes per leaf.
const LEAF: usize = 4;

/// Boxes by place.
pub(crate) struct BoxTree {
    /// Bounds of nodes; children of `i` are `2 i + 1` and `2 i + 2`.
    nodes: Vec<[Vec3; 2]>,
    /// Boxes in the order of leaves.
    order: Vec<u32>,
}

impl BoxTree {
    /// Builds a tree of boxes, each given by its lower and upper corner. O(n log n).
    pub(crate) fn build(boxes: &[[Vec3; 2]]) -> BoxTree {
        let mut tree = BoxTree {
            nodes: Vec::new(),
            order: (0..boxes.len() as u32).collect(),
        };
        let mut order = std::mem::take(&mut tree.order);
        tree.split(boxes, &mut order, 0);
        tree.order = order;
        tree
    }

    fn split(&mut self, boxes: &[[Vec3; 2]], order: &mut [u32], node: usize) {
        let bounds = order
            .iter()
            .fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[lo, hi], &i| {
                let [l, h] = boxes[i as usize];
                [lo.min(l), hi.max(h)]
            });
        if self.nodes.len() <= node {
            self.nodes
                .resize(node + 1, [Vec3::INFINITY, Vec3::NEG_INFINITY]);
        }
        self.nodes[node] = bounds;
        if order.len() <= LEAF {
            return;
        }
        let size = bounds[1] - bounds[0];
        let axis = size.max_position();
        let middle = |i: u32| boxes[i as usize][0][axis] + boxes[i as usize][1][axis];
        let half = order.len() / 2;
        order.select_nth_unstable_by(half, |&x, &y| {
            middle(x).total_cmp(&middle(y)).then(x.cmp(&y))
        });
        let (left, right) = order.split_at_mut(half);
        self.split(boxes, left, 2 * node + 1);
        self.split(boxes, right, 2 * node + 2);
    }

    /// Calls `found` with boxes that may overlap this one, in unspecified order, until it returns
    /// `false`.
    pub(crate) fn meet(&self, low: Vec3, high: Vec3, found: &mut impl FnMut(u32) -> bool) {
        if !self.order.is_empty() {
            self.visit(0, 0, self.order.len(), [low, high], found);
        }
    }

    fn visit(
        &self,
        node: usize,
        first: usize,
        count: usize,
        [low, high]: [Vec3; 2],
        found: &mut impl FnMut(u32) -> bool,
    ) -> bool {
        let [lo, hi] = self.nodes[node];
        if lo.cmpgt(high).any() || hi.cmplt(low).any() {
            return true;
        }
        if count <= LEAF {
            let mut leaf = self.order[first..first + count].iter();
            return leaf.all(|&i| found(i));
        }
        let half = count / 2;
        self.visit(2 * node + 1, first, half, [low, high], found)
            && self.visit(2 * node + 2, first + half, count - half, [low, high], found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_a_search_of_all_finds() {
        let at = |i: u32| {
            let [x, y] = radiosity::sample_2d(i, 1, 7);
            let [z, r] = radiosity::sample_2d(i, 2, 7);
            let low = Vec3::new(x, y, z);
            [low, low + 0.1 * r]
        };
        // Some boxes twice, because pairs of equal boxes are common.
        let boxes: Vec<_> = (0..500).map(|i| at(i % 400)).collect();
        let tree = BoxTree::build(&boxes);
        for q in 1000..1100 {
            let [low, high] = at(q);
            let mut found = Vec::new();
            tree.meet(low, high, &mut |i| {
                let [l, h] = boxes[i as usize];
                if l.cmple(high).all() && h.cmpge(low).all() {
                    found.push(i);
                }
                true
            });
            found.sort_unstable();
            let all: Vec<u32> = (0..500)
                .filter(|&i| {
                    let [l, h] = boxes[i as usize];
                    l.cmple(high).all() && h.cmpge(low).all()
                })
                .collect();
            assert_eq!(found, all);
        }
        BoxTree::build(&[]).meet(Vec3::ZERO, Vec3::ONE, &mut |_| panic!("nothing there"));
    }
}
