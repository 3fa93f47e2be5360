//! Groups triangles with coinciding centres before the tree is built.
//!
//! PLOC merges pairs that are each other's nearest neighbour. Among boxes with equal costs there
//! are hardly any such pairs, a pass merges only one, and the build becomes quadratic (obvhs took
//! eight seconds for 20,000 identical triangles). So crowded cells of a fine grid become one
//! primitive each, and are halved afterwards.

/// Cells along each axis of the scene's largest extent. Centres in one cell are within 1e-6 of the
/// scene, too close for a tree to separate them usefully, and 3 × 20 bits fit one key.
const CELLS: f32 = (1u32 << 20) as f32;

/// Members from which a cell becomes a group. Below this, quadratic cost is negligible, and obvhs
/// splits better than halving.
const CROWD: u8 = 16;

/// Primitives for the tree builder: ranges of a permutation of the triangles.
pub(crate) struct Items {
    /// Triangle indices.
    pub order: Vec<u32>,
    /// `[first, end)` in `order` of each primitive; empty if every primitive is the single triangle
    /// with its index.
    groups: Vec<[u32; 2]>,
    /// Primitives below `singles` are `order[i]`; later ones are groups.
    singles: usize,
}

impl Items {
    /// Number of primitives.
    pub fn len(&self) -> usize {
        self.singles + self.groups.len()
    }

    /// Triangles of primitive `item`.
    pub fn triangles(&self, item: usize) -> &[u32] {
        match item.checked_sub(self.singles) {
            None => &self.order[item..=item],
            Some(group) => {
                let [first, end] = self.groups[group];
                &self.order[first as usize..end as usize]
            }
        }
    }

    /// Groups coincident triangles. `centres` are scaled to the unit cube; `sizes` order the
    /// members of a group, so that halves of nested triangles nest.
    pub fn gather(centres: &[[f32; 3]], sizes: impl Fn(u32) -> f32) -> Items {
        let count = centres.len();
        let key = |centre: &[f32; 3]| {
            centre.iter().fold(0u64, |key, &x| {
                key << 20 | ((x * CELLS) as u64).min(CELLS as u64 - 1)
            })
        };
        // A counting table with one byte per hashed cell finds the crowded ones in O(n) without
        // sorting everything. A false positive only costs the sort of its few members.
        let bits = count.next_power_of_two().trailing_zeros().max(8);
        let slot = |key: u64| (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (64 - bits)) as usize;
        let mut crowd = vec![0u8; 1 << bits];
        for centre in centres {
            let n = &mut crowd[slot(key(centre))];
            *n = n.saturating_add(1);
        }
        let mut order = Vec::with_capacity(count);
        let mut suspects = Vec::new();
        for (index, centre) in centres.iter().enumerate() {
            let key = key(centre);
            if crowd[slot(key)] >= CROWD {
                suspects.push((key, index as u32));
            } else {
                order.push(index as u32);
            }
        }
        drop(crowd);
        suspects.sort_unstable();
        let mut grouped = Vec::new();
        for run in suspects.chunk_by(|a, b| a.0 == b.0) {
            if run.len() < usize::from(CROWD) {
                order.extend(run.iter().map(|s| s.1));
            } else {
                grouped.push(run);
            }
        }
        let singles = order.len();
        let groups = grouped
            .into_iter()
            .map(|run| {
                let first = order.len();
                order.extend(run.iter().map(|s| s.1));
                order[first..]
                    .sort_unstable_by(|&a, &b| sizes(a).total_cmp(&sizes(b)).then(a.cmp(&b)));
                [first as u32, order.len() as u32]
            })
            .collect();
        Items {
            order,
            groups,
            singles,
        }
    }
}
