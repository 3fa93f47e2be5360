//! Self-validation of a tree.

use glam::Vec3;

use crate::bvh::Bvh;
use crate::error::ValidateError;
use crate::node::{Child, FILTERED, NO_TRIANGLE, WIDTH};

impl Bvh {
    /// Checks every invariant that traversal relies on: each node, pack and triangle is reached
    /// exactly once, boxes contain their subtrees, and the depth is at most the recorded one.
    /// O(triangles).
    ///
    /// # Errors
    /// The first [`ValidateError`] found.
    pub fn validate(&self) -> Result<(), ValidateError> {
        let mut seen_nodes = vec![false; self.nodes.len()];
        let mut seen_packs = vec![false; self.packs.len()];
        let mut times = vec![0u32; self.triangles];
        // Parents before children, for the check of boxes.
        let mut order = Vec::with_capacity(self.nodes.len());
        let mut work = vec![];
        if !self.nodes.is_empty() {
            seen_nodes[0] = true;
            work.push((0u32, 1u32));
        }
        let mut deepest = 0;
        while let Some((index, depth)) = work.pop() {
            deepest = deepest.max(depth);
            order.push(index);
            let node = &self.nodes[index as usize];
            for slot in 0..WIDTH {
                let place = (index, slot as u32);
                let child = node.child(slot);
                if child == Child::EMPTY {
                    continue;
                }
                if child.is_leaf() {
                    for pack in child.packs() {
                        mark(&mut seen_packs, pack, place)?;
                        for id in self.packs[pack]
                            .ids
                            .into_iter()
                            .filter(|&id| id != NO_TRIANGLE)
                        {
                            let triangle = id & !FILTERED;
                            match times.get_mut(triangle as usize) {
                                Some(n) => *n += 1,
                                None => return Err(ValidateError::Triangle { triangle, times: 1 }),
                            }
                        }
                    }
                } else {
                    mark(&mut seen_nodes, child.0 as usize, place)?;
                    work.push((child.0, depth + 1));
                }
            }
        }
        let unreached = seen_nodes
            .iter()
            .chain(&seen_packs)
            .filter(|seen| !**seen)
            .count();
        if unreached > 0 {
            return Err(ValidateError::Unreached { unreached });
        }
        if let Some(triangle) = times.iter().position(|&n| n != 1) {
            return Err(ValidateError::Triangle {
                triangle: triangle as u32,
                times: times[triangle],
            });
        }
        if deepest > self.depth {
            return Err(ValidateError::Depth {
                depth: deepest,
                recorded: self.depth,
            });
        }
        self.validate_boxes(&order)
    }

    /// Sweeps children first: each child's box must contain the union of its subtree.
    fn validate_boxes(&self, order: &[u32]) -> Result<(), ValidateError> {
        let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut unions = vec![nothing; self.nodes.len()];
        for &index in order.iter().rev() {
            let node = &self.nodes[index as usize];
            let mut union = nothing;
            for slot in 0..WIDTH {
                let (node_index, slot_index) = (index, slot as u32);
                let (lo, hi) = node.child_box(slot);
                let child = node.child(slot);
                let in_use = lo.cmple(hi).all();
                if in_use != (child != Child::EMPTY) {
                    return Err(ValidateError::Empty {
                        node: node_index,
                        child: slot_index,
                    });
                }
                if !in_use {
                    continue;
                }
                let below = if child.is_leaf() {
                    self.packs[child.packs()].iter().fold(nothing, |all, pack| {
                        (0..pack.ids.len())
                            .filter(|&lane| pack.ids[lane] != NO_TRIANGLE)
                            .fold(all, |all, lane| {
                                pack.triangle(lane)
                                    .iter()
                                    .fold(all, |(a, b), &c| (a.min(c), b.max(c)))
                            })
                    })
                } else {
                    unions[child.0 as usize]
                };
                if !(lo.cmple(below.0).all() && hi.cmpge(below.1).all()) {
                    return Err(ValidateError::Box {
                        node: node_index,
                        child: slot_index,
                    });
                }
                union = (union.0.min(lo), union.1.max(hi));
            }
            unions[index as usize] = union;
        }
        Ok(())
    }
}

fn mark(seen: &mut [bool], index: usize, (node, child): (u32, u32)) -> Result<(), ValidateError> {
    match seen.get_mut(index) {
        None => Err(ValidateError::OutOfRange { node, child }),
        Some(true) => Err(ValidateError::Shared { node, child }),
        Some(place) => {
            *place = true;
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuildOptions;

    fn row(count: usize) -> Bvh {
        let triangles: Vec<_> = (0..count)
            .map(|i| {
                let o = Vec3::X * i as f32;
                [o, o + Vec3::Y, o + Vec3::Z]
            })
            .collect();
        Bvh::build(&triangles, |i| i % 3 == 0, &BuildOptions::default()).expect("finite input")
    }

    #[test]
    fn a_sound_tree_passes() {
        for count in [0, 1, 2, 8, 9, 64, 65, 1000] {
            assert_eq!(row(count).validate(), Ok(()), "{count} triangles");
        }
    }

    #[test]
    fn each_kind_of_damage_is_found() {
        let sound = row(1000);

        let mut b = sound.clone();
        b.nodes[3].bounds[1][1][0] -= 0.5;
        assert!(
            matches!(b.validate(), Err(ValidateError::Box { .. })),
            "shrunk box: {:?}",
            b.validate()
        );

        let mut b = sound.clone();
        b.nodes[3].bounds[1][1][0] = f32::NAN;
        assert!(
            matches!(b.validate(), Err(ValidateError::Empty { .. })),
            "NaN box: {:?}",
            b.validate()
        );

        let mut b = sound.clone();
        let inner = b.nodes[0]
            .children
            .iter()
            .position(|&c| !Child(c).is_leaf())
            .expect("1000 need two levels");
        b.nodes[0].children[inner] = 0;
        assert!(
            matches!(b.validate(), Err(ValidateError::Shared { .. })),
            "cycle: {:?}",
            b.validate()
        );
        b.nodes[0].children[inner] = 1_000_000;
        assert!(
            matches!(b.validate(), Err(ValidateError::OutOfRange { .. })),
            "wild index: {:?}",
            b.validate()
        );

        let mut b = sound.clone();
        b.packs[0].ids[0] = b.packs[1].ids[0];
        assert!(
            matches!(b.validate(), Err(ValidateError::Triangle { .. })),
            "lost triangle: {:?}",
            b.validate()
        );

        let mut b = sound.clone();
        b.packs.push(crate::node::Pack::EMPTY);
        assert_eq!(b.validate(), Err(ValidateError::Unreached { unreached: 1 }));

        let mut b = sound;
        b.depth = 1;
        assert!(
            matches!(b.validate(), Err(ValidateError::Depth { .. })),
            "depth: {:?}",
            b.validate()
        );
    }
}
