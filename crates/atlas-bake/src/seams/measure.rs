//! Measures how far lookups on the two sides of seams differ.

use serde::Serialize;

/// Distribution of differences between the two sides: |a − b| relative to their mean + 1 % of the
/// map's mean, by luminance and weighted by the seams' length in texels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SeamError {
    /// Median of the differences.
    pub median: f64,
    /// 99th percentile of the differences.
    pub p99: f64,
    /// Largest difference.
    pub max: f64,
}

/// Report on seams.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SeamReport {
    /// Points of seams that were compared.
    pub samples: u64,
    /// Length of all seams where light is continuous, metres.
    pub metres: f64,
    /// Length of those where one side has more than twice the light of the other, metres:
    /// places under something, and edges of shadows. They are left as they are.
    pub jumps: f64,
    /// Differences after gathering and dilation.
    pub before: SeamError,
    /// Differences in the final map; the same as `before` without stitching.
    pub after: SeamError,
    /// Root mean square change of lumels within two texels of a seam, relative to their value + 1 %
    /// of the map's mean, weighted by coverage.
    pub moved_near: f64,
    /// The same for all other lumels.
    pub moved_elsewhere: f64,
    /// Lumel values that would have become negative and were set to 0.
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
