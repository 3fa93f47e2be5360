//! How far lookups on the two sides of seams differ.

use serde::Serialize;

/// Differences of lookups on both sides: |a − b| over their mean + 1 % of the map's mean, by
/// luminance. Weighted by the seams' length in texels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SeamError {
    /// Half of all seams differ by less.
    pub median: f64,
    /// All but 1 % do.
    pub p99: f64,
    /// Greatest.
    pub max: f64,
}

/// What was done about seams.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SeamReport {
    /// Points of seams that were looked at.
    pub samples: u64,
    /// Length of all seams, metres.
    pub metres: f64,
    /// Differences as lumels were gathered and charts dilated.
    pub before: SeamError,
    /// Differences in the map as it is; the same as `before` where nothing was stitched.
    pub after: SeamError,
    /// Root mean square change of lumels within two texels of a seam, over their value + 1 % of the
    /// map's mean, weighted by coverage.
    pub moved_near: f64,
    /// The same of all others.
    pub moved_elsewhere: f64,
    /// Values of lumels that would have become negative and are 0.
    pub clamped: u64,
}

/// Quantiles of (difference, weight).
pub(crate) fn quantiles(mut differences: Vec<(f64, f64)>) -> SeamError {
    differences.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.total_cmp(&y.1)));
    let total: f64 = differences.iter().map(|d| d.1).sum();
    let at = |share: f64| {
        let mut sum = 0.0;
        (differences.iter())
            .find(|d| {
                sum += d.1;
                sum >= share * total
            })
            .map_or(0.0, |d| d.0)
    };
    SeamError {
        median: at(0.5),
        p99: at(0.99),
        max: differences.last().map_or(0.0, |d| d.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_go_by_weight() {
        let found = quantiles(vec![(3.0, 1.0), (1.0, 60.0), (2.0, 39.0)]);
        assert_eq!(
            found,
            SeamError {
                median: 1.0,
                p99: 2.0,
                max: 3.0
            }
        );
        assert_eq!(quantiles(Vec::new()), SeamError::default());
    }
}
