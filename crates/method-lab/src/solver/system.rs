//! The linear system that every solver takes, validated once.

use glam::DVec3;

use super::Record;
use crate::enclosure::{Enclosure, Matrix};

/// Why a system cannot be solved.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// Lengths differ.
    #[error("{what}: got {got}, expected {expected} (one per row of the matrix)")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        got: usize,
        /// Number of rows.
        expected: usize,
    },
    /// A value is out of range.
    #[error("patch {patch}: {what} is {value}, expected {expected}")]
    Value {
        /// Index of the patch.
        patch: usize,
        /// The quantity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Its valid range.
        expected: &'static str,
    },
    /// The tolerance is negative or not a number.
    #[error("the tolerance is {0}, expected a number >= 0")]
    Tolerance(f64),
    /// A matrix cannot be made closed.
    #[error("row {patch} cannot be scaled to sum to 1: {why}")]
    NotClosable {
        /// The row.
        patch: usize,
        /// The fault.
        why: &'static str,
    },
}

/// B = M + ρ F B.
#[derive(Debug, Clone, PartialEq)]
pub struct System<'m> {
    matrix: &'m Matrix,
    area: Vec<f64>,
    exitance: Vec<DVec3>,
    reflectance: Vec<DVec3>,
    contraction: DVec3,
    emitted: DVec3,
}

impl<'m> System<'m> {
    /// F with the areas, exitances and reflectances of `enclosure`.
    ///
    /// # Errors
    /// As [`System::from_parts`].
    pub fn new(matrix: &'m Matrix, enclosure: &Enclosure) -> Result<Self, SystemError> {
        let p = &enclosure.patches;
        System::from_parts(
            matrix,
            p.iter().map(|p| p.area()).collect(),
            p.iter().map(|p| p.exitance).collect(),
            p.iter().map(|p| p.reflectance).collect(),
        )
    }

    /// F (n × n), areas in m², exitances M in W/m² and reflectances ρ by channel.
    ///
    /// # Errors
    /// [`SystemError::Length`] if a list does not have one value per row; [`SystemError::Value`] if
    /// F_ij is negative or not finite, an area is not positive, M is negative or not finite, ρ is
    /// outside 0..=1, or ρ_i F_ii ≥ 1 (a patch that keeps all its light).
    pub fn from_parts(
        matrix: &'m Matrix,
        area: Vec<f64>,
        exitance: Vec<DVec3>,
        reflectance: Vec<DVec3>,
    ) -> Result<Self, SystemError> {
        let n = matrix.len();
        for (what, got) in [
            ("areas", area.len()),
            ("exitances", exitance.len()),
            ("reflectances", reflectance.len()),
        ] {
            if got != n {
                return Err(SystemError::Length {
                    what,
                    got,
                    expected: n,
                });
            }
        }
        let mut contraction = DVec3::ZERO;
        let mut emitted = DVec3::ZERO;
        for i in 0..n {
            let row = matrix.row(i);
            let fail = |what, value, expected| SystemError::Value {
                patch: i,
                what,
                value,
                expected,
            };
            if !(area[i] > 0.0 && area[i].is_finite()) {
                return Err(fail("area", area[i], "a positive number"));
            }
            for k in 0..3 {
                let (m, rho) = (exitance[i][k], reflectance[i][k]);
                if !(m >= 0.0 && m.is_finite()) {
                    return Err(fail("exitance", m, "a number >= 0"));
                }
                if !(0.0..=1.0).contains(&rho) {
                    return Err(fail("reflectance", rho, "0..=1"));
                }
                if rho * row[i] >= 1.0 {
                    return Err(fail("reflectance times F_ii", rho * row[i], "below 1"));
                }
            }
            let mut sum = 0.0;
            for &f in row {
                if !(f >= 0.0 && f.is_finite()) {
                    return Err(fail("form factor", f, "a number >= 0"));
                }
                sum += f;
            }
            contraction = contraction.max(reflectance[i] * sum);
            emitted += exitance[i] * area[i];
        }
        Ok(System {
            matrix,
            area,
            exitance,
            reflectance,
            contraction,
            emitted,
        })
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// Whether there is no patch.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// F.
    pub fn matrix(&self) -> &Matrix {
        self.matrix
    }

    /// A by patch, m².
    pub fn area(&self) -> &[f64] {
        &self.area
    }

    /// M by patch, W/m².
    pub fn exitance(&self) -> &[DVec3] {
        &self.exitance
    }

    /// ρ by patch.
    pub fn reflectance(&self) -> &[DVec3] {
        &self.reflectance
    }

    /// ‖ρF‖∞ = max_i ρ_i Σ_j F_ij by channel. Below 1 every solver converges, and the residual
    /// bounds the error.
    pub fn contraction(&self) -> DVec3 {
        self.contraction
    }

    /// r = M + ρFB − B by patch, W/m². `radiosity` has one value per patch.
    ///
    /// # Errors
    /// [`SystemError::Length`].
    pub fn residual(&self, radiosity: &[DVec3]) -> Result<Vec<DVec3>, SystemError> {
        if radiosity.len() != self.len() {
            return Err(SystemError::Length {
                what: "radiosities",
                got: radiosity.len(),
                expected: self.len(),
            });
        }
        Ok(self.residual_of(radiosity))
    }

    pub(super) fn residual_of(&self, radiosity: &[DVec3]) -> Vec<DVec3> {
        (0..self.len())
            .map(|i| {
                let gathered: DVec3 = self
                    .matrix
                    .row(i)
                    .iter()
                    .zip(radiosity)
                    .map(|(&f, &b)| b * f)
                    .sum();
                self.exitance[i] + self.reflectance[i] * gathered - radiosity[i]
            })
            .collect()
    }

    /// Bound on ‖B − B*‖∞ by channel from ‖r‖∞, W/m²; infinite without a bound (see
    /// [`Record::error_bound`]).
    pub fn error_bound(&self, residual_max: DVec3) -> DVec3 {
        let bound = |r: f64, c: f64| {
            if r == 0.0 && c < 1.0 {
                0.0
            } else if c < 1.0 {
                r / (1.0 - c)
            } else {
                f64::INFINITY
            }
        };
        let (r, c) = (residual_max, self.contraction);
        DVec3::new(bound(r.x, c.x), bound(r.y, c.y), bound(r.z, c.z))
    }

    /// Norms of `residual` as an entry of a history.
    pub(super) fn record(&self, iteration: u64, work: u64, residual: &[DVec3]) -> Record {
        let (mut most, mut flux) = (DVec3::ZERO, DVec3::ZERO);
        for (r, &a) in residual.iter().zip(&self.area) {
            // `max` would drop NaN, which must remain visible.
            if r.is_nan() {
                most = DVec3::INFINITY;
            }
            most = most.max(r.abs());
            flux += r.abs() * a;
        }
        Record {
            iteration,
            work,
            residual_max: most,
            residual_flux: flux,
            left: self.left(flux),
            error_bound: self.error_bound(most),
        }
    }

    /// Largest fraction of a channel's emitted flux; a channel without emission has nothing to
    /// distribute.
    pub(super) fn left(&self, flux: DVec3) -> f64 {
        let mut left: f64 = 0.0;
        for k in 0..3 {
            if flux[k].is_nan() {
                return f64::INFINITY;
            }
            if self.emitted[k] > 0.0 {
                left = left.max(flux[k] / self.emitted[k]);
            }
        }
        left
    }
}
