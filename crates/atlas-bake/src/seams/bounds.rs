//! Limits on how far stitching may change a texel.

use glam::Vec4;

use crate::seams::rows::{LITTLE, Row};

/// Lower and upper bounds of the change that the seams justify, for four channels at once.
///
/// - A fully covered lumel changes by at most the initial difference of the lookups that read it or
///   its neighbours. It also stays within the range of those lookups on both sides and its own
///   value, so that nothing becomes brighter or darker than its surroundings.
/// - Partially covered lumels (`seen` < 1; 0 if dilated) and lumels in `narrow` charts have wider
///   bounds.
/// - Nothing goes below `floor`.
/// - Texels that seams do not read, `steps` away from those that they do, take the bounds of the
///   neighbours (`even`) through which they are reached.
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
            terms
                .filter(|(_, w)| w.abs() > LITTLE)
                .map(|(&t, _)| t as usize)
        };
        // Dilated and hidden texels only set bounds if there are no others.
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
    // Neighbours along the seam count too: an intermediate value in one grid may be an extreme in
    // the other.
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
    // In ascending order of distance, so that the nearer texel's bounds are known.
    for &(i, j, _) in even {
        let (i, j) = (i as usize, j as usize);
        if steps[j] == steps[i] + 1 {
            low[j] = low[j].min(low[i]);
            high[j] = high[j].max(high[i]);
            most[j] = most[j].max(most[i]);
        }
    }
    for i in 0..values.len() {
        // The centre of a barely covered lumel lies beyond the border, so its value extrapolates a
        // slope.
        let room = (high[i] - low[i]) * (1.0 - seen[i]);
        // The initial difference is what one side alone would have to make up. With twice that,
        // parts of a chart between two slits, which cannot agree with both, moved lookups on a
        // sphere a fifth further from the truth without better agreement. A narrow strip has to
        // make up for several differences, and has no light of its own to preserve.
        let most = match narrow[i] {
            true => Vec4::INFINITY,
            false => most[i] / seen[i].max(1e-3),
        };
        // Light is not negative. A clamp must be known here, while other texels can still
        // compensate for it.
        let dark = (floor - values[i]).min(Vec4::ZERO);
        low[i] = (low[i] - room - values[i]).max(-most).max(dark);
        high[i] = (high[i] + room - values[i]).min(most);
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bounds of the change of texel 0 by a seam between it and a darker one. Beside both lies a
    /// bright texel of another chart, which the lookups read with this weight.
    fn of_half_covered(weight: f32) -> [f32; 2] {
        let row = Row {
            texels: [0, 2, 2, 2, 1, 2, 2, 2],
            weights: [
                1.0 - weight,
                weight,
                0.0,
                0.0,
                weight - 1.0,
                -weight,
                0.0,
                0.0,
            ],
            agree: 1.0,
            misfit: 0.0,
            scale: 1.0,
            texels_long: 1.0,
            counts: true,
        };
        let values = [0.4, 0.3, 3.0].map(Vec4::splat);
        let (seen, narrow) = ([0.5, 0.5, 1.0], [false; 3]);
        let [low, high] = bounds(&[row], &[], &[0; 3], &seen, &narrow, &values, Vec4::ZERO);
        [low[0].x, high[0].x]
    }

    #[test]
    fn what_rounding_makes_a_lookup_read_widens_no_bounds() {
        // Borders through the centres of texels read the next chart with weights of 1e-6.
        let near = |[a, b]: [f32; 2], [c, d]: [f32; 2]| (a - c).abs() + (b - d).abs() < 1e-4;
        assert!(near(of_half_covered(1e-6), of_half_covered(0.0)));
        let [low, high] = of_half_covered(0.0);
        assert!(low > -0.2 && high < 0.1, "{low} {high}");
    }
}
