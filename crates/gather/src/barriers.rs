//! Walls between lumels: lumels take no light from neighbours behind a wall.

use atlas::{Lumels, TexelIndex};
use radiosity::World;
use rayon::prelude::*;

use crate::parts::LIFT;
use crate::received::Received;

/// Pairs of adjacent lumels with a wall between them.
#[derive(Debug, Default)]
pub(crate) struct Barriers {
    /// For each lumel, bit 0 for a wall on its right, bit 1 for one below. Empty if there are none.
    bits: Vec<u8>,
}

impl Barriers {
    /// Searches between lumels that have something near them.
    pub(crate) fn find(
        world: &World,
        lumels: &Lumels,
        index: &TexelIndex,
        received: &[Received],
    ) -> Barriers {
        let bits = (0..received.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let (l, own) = (&lumels.lumels[i], &received[i]);
                if !own.near || own.open == 0.0 {
                    return 0;
                }
                let [x, y] = l.texel.map(i64::from);
                let blocked = |x: i64, y: i64| {
                    let Some(j) = index.at(l.page, x, y) else {
                        return false;
                    };
                    let other = &received[j];
                    lumels.lumels[j].instance == l.instance
                        && other.near
                        && other.open > 0.0
                        && world.wall_between(
                            &own.point(world),
                            &other.point(world),
                            LIFT * own.size,
                        )
                };
                u8::from(blocked(x + 1, y)) | u8::from(blocked(x, y + 1)) << 1
            })
            .collect();
        Barriers { bits }
    }

    /// Whether a wall is between two lumels that share an edge.
    pub(crate) fn between(&self, lumels: &Lumels, i: usize, j: usize) -> bool {
        let [a, b] = [i, j].map(|k| lumels.lumels[k].texel);
        let first = if (a[1], a[0]) < (b[1], b[0]) { i } else { j };
        self.after(first, a[1] != b[1])
    }

    /// Whether a wall is on the right of lumel `i`, or below it (`down`).
    #[inline]
    pub(crate) fn after(&self, i: usize, down: bool) -> bool {
        self.bits
            .get(i)
            .is_some_and(|b| b >> u8::from(down) & 1 == 1)
    }
}
