//! The input of every method: flat patches, and the matrix of their form factors.

use glam::DVec3;

/// A flat convex polygon of constant radiosity.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// Three or four corners, counter-clockwise seen from the front, metres.
    pub corners: Vec<DVec3>,
    /// Emitted exitance M_e by colour channel, W/m².
    pub exitance: DVec3,
    /// Reflectance ρ by colour channel, 0..=1.
    pub reflectance: DVec3,
}

impl Patch {
    /// Vector area: the normal times the area, m².
    pub fn vector_area(&self) -> DVec3 {
        let c = &self.corners;
        (1..c.len() - 1)
            .map(|k| (c[k] - c[0]).cross(c[k + 1] - c[0]))
            .sum::<DVec3>()
            * 0.5
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        self.vector_area().length()
    }

    /// Unit normal on the front.
    pub fn normal(&self) -> DVec3 {
        self.vector_area().normalize_or_zero()
    }

    /// Mean of the corners, metres.
    pub fn centre(&self) -> DVec3 {
        self.corners.iter().sum::<DVec3>() / self.corners.len() as f64
    }
}

/// Patches that see one another. Each blocks light and reflects only on its front.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Enclosure {
    /// The patches.
    pub patches: Vec<Patch>,
}

/// A square matrix, dense, by rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    n: usize,
    values: Vec<f64>,
}

impl Matrix {
    /// n × n zeros.
    pub fn zeros(n: usize) -> Self {
        Matrix {
            n,
            values: vec![0.0; n * n],
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether it has no row.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Row `i`: F_ij for all j, the share of the power leaving patch i that reaches patch j.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.n..(i + 1) * self.n]
    }

    /// Row `i`, to be filled.
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.values[i * self.n..(i + 1) * self.n]
    }

    /// All rows in order, to be filled in parallel with `par_chunks_mut(len())`.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Memory of the values, bytes.
    pub fn bytes(&self) -> usize {
        self.values.len() * size_of::<f64>()
    }
}
