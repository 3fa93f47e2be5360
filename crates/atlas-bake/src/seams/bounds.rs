//! How far stitching may change a texel at most.

use glam::Vec4;

use crate::seams::rows::Row;

/// Least and greatest change that the seams at hand give reason for, for four channels at once.
///
/// No whole lumel moves further than what lookups that read it or its neighbours differed before,
/// nor out of the range of what those lookups read on both sides and it had itself: nothing becomes
/// brighter or darker than all that lies about. What is `seen` by a share only, 0 if dilated, has
/// more room, and so has what lies in a `narrow` chart. Nothing goes below `floor`. Texels beyond
/// those that seams read, `steps` from them, have the bounds of the neighbours (`even`) by which
/// they are reached.
pub(super) fn bounds(
    rows: &[Row],
    even: &[(u32, u32, f32)],
    steps: &[u8],
    seen: &[f32],
    narrow: &[bool],
    values: &[Vec4],
    floor: Vec4,
) -> [Vec<Vec4>; 2] {
    let mut low = values.to_vec();
    let mut high = values.to_vec();
    let mut most = vec![Vec4::ZERO; values.len()];
    for row in rows {
        let difference = row.difference(values).abs();
        let reads = || {
            let terms = row.texels.iter().zip(&row.weights);
            terms.filter(|(_, w)| **w != 0.0).map(|(&t, _)| t as usize)
        };
        // What is only dilated, or inside of something, sets no bounds of its own if there is
        // better.
        let any = reads().any(|t| seen[t] > 0.0);
        let (lo, hi) = reads()
            .filter(|&t| seen[t] > 0.0 || !any)
            .fold((Vec4::INFINITY, Vec4::NEG_INFINITY), |(lo, hi), t| {
                (lo.min(values[t]), hi.max(values[t]))
            });
        for t in reads() {
            low[t] = low[t].min(lo);
            high[t] = high[t].max(hi);
            most[t] = most[t].max(difference);
        }
    }
    // What lies beside a texel along the seam counts too: a value between two others of one grid
    // may be outermost in the other.
    let own = (low.clone(), high.clone(), most.clone());
    for &(i, j, _) in even {
        for (i, j) in [(i as usize, j as usize), (j as usize, i as usize)] {
            if steps[i] == 0 && steps[j] == 0 {
                low[j] = low[j].min(own.0[i]);
                high[j] = high[j].max(own.1[i]);
                most[j] = most[j].max(own.2[i]);
            }
        }
    }
    // In ascending order of the nearer texel, whose bounds are then known.
    for &(i, j, _) in even {
        let (i, j) = (i as usize, j as usize);
        if steps[j] == steps[i] + 1 {
            low[j] = low[j].min(low[i]);
            high[j] = high[j].max(high[i]);
            most[j] = most[j].max(most[i]);
        }
    }
    for i in 0..values.len() {
        // A lumel of which little is surface stands for a slope that goes on past the border, where
        // its centre lies.
        let room = (high[i] - low[i]) * (1.0 - seen[i]);
        // The difference itself is what one side alone would make up for. With twice of it, fingers
        // of a chart between two slits, which cannot agree with both, took lookups on a sphere a
        // fifth further from the truth, and nothing agreed better. A strip between others has to
        // make up for several differences, and has no light of its own to keep.
        let most = match narrow[i] {
            true => Vec4::INFINITY,
            false => most[i] / seen[i].max(1e-3),
        };
        // Light is positive: what would be cut off later must be known while the others can make up
        // for it.
        let dark = (floor - values[i]).min(Vec4::ZERO);
        low[i] = (low[i] - room - values[i]).max(-most).max(dark);
        high[i] = (high[i] + room - values[i]).min(most);
    }
    [low, high]
}
