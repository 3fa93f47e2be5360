//! Triangles near a place.

use glam::Vec3;
use smallvec::{SmallVec, smallvec};

use crate::bvh::Bvh;
use crate::node::{Child, FILTERED, PACK, Pack, WIDTH};

impl Bvh {
    /// Whether `found` returns true for any of the triangles whose own boxes overlap the box from
    /// `low` to `high`: all that touch it, and some nearby. `found` receives a triangle's index and
    /// corners. Stops at the first match; the order depends on the tree.
    pub fn any_near(
        &self,
        low: Vec3,
        high: Vec3,
        mut found: impl FnMut(u32, [Vec3; 3]) -> bool,
    ) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let mut stack: SmallVec<[Child; 64]> = smallvec![Child::node(0)];
        while let Some(child) = stack.pop() {
            if child.is_leaf() {
                for pack in &self.packs[child.packs()] {
                    let touched = touched(pack, low, high);
                    for (lane, &id) in pack.ids.iter().enumerate() {
                        if touched[lane] && found(id & !FILTERED, pack.triangle(lane)) {
                            return true;
                        }
                    }
                }
                continue;
            }
            let node = &self.nodes[child.0 as usize];
            // All children at a time, in a form that compilers turn into vector instructions. Boxes
            // of empty slots are inverted and overlap nothing.
            let mut overlap = [true; WIDTH];
            for (axis, [lo, hi]) in node.bounds.iter().enumerate() {
                for slot in 0..WIDTH {
                    overlap[slot] &= (lo[slot] <= high[axis]) & (hi[slot] >= low[axis]);
                }
            }
            stack.extend(
                (0..WIDTH)
                    .filter(|&slot| overlap[slot])
                    .map(|slot| node.child(slot)),
            );
        }
        false
    }
}

/// Which triangles' boxes overlap a box; all four at a time. Unused lanes are NaN and overlap
/// nothing.
fn touched(pack: &Pack, low: Vec3, high: Vec3) -> [bool; PACK] {
    let mut touched = [true; PACK];
    for (axis, [a, b, c]) in pack.corners.iter().enumerate() {
        for lane in 0..PACK {
            let lo = a[lane].min(b[lane]).min(c[lane]);
            let hi = a[lane].max(b[lane]).max(c[lane]);
            touched[lane] &= (lo <= high[axis]) & (hi >= low[axis]);
        }
    }
    touched
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuildOptions;

    #[test]
    fn finds_all_that_touch() {
        // A grid of small triangles: those whose boxes overlap must be found for any query.
        let triangles: Vec<[Vec3; 3]> = (0..400)
            .map(|k| {
                let p = Vec3::new((k % 20) as f32, (k / 20) as f32, (k % 7) as f32);
                [p, p + Vec3::X * 0.5, p + Vec3::Y * 0.5]
            })
            .collect();
        let bvh = Bvh::build(&triangles, |t| t % 3 == 0, &BuildOptions::default()).unwrap();
        for k in 0..50 {
            let low = Vec3::new((k % 10) as f32 * 1.7, k as f32 * 0.3, (k % 5) as f32);
            let high = low + Vec3::splat(0.3 + 0.1 * k as f32);
            let mut seen = vec![false; triangles.len()];
            bvh.any_near(low, high, |t, corners| {
                assert_eq!(corners, triangles[t as usize]);
                seen[t as usize] = true;
                false
            });
            for (t, [a, b, c]) in triangles.iter().enumerate() {
                let (lo, hi) = (a.min(*b).min(*c), a.max(*b).max(*c));
                let overlaps = lo.cmple(high).all() && hi.cmpge(low).all();
                assert!(seen[t] || !overlaps, "triangle {t}, query {k}");
            }
            let first = bvh.any_near(low, high, |_, _| true);
            assert_eq!(first, seen.iter().any(|s| *s));
        }
    }
}
