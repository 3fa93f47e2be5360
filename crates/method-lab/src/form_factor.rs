//! Form factors of a whole enclosure by each of the classic methods. F_ij is the fraction of the
//! power leaving patch i that reaches j; row i contains all F_ij.

mod area;
mod contour;
pub(crate) mod cull;
mod error;
mod hemicube;
mod hemisphere;
mod point;
mod sample;
mod shadow;

use rayon::prelude::*;

use crate::{Enclosure, Matrix, Patch, Visibility};
use cull::Shaft;

pub use area::exchange_area;
pub use contour::exchange_contour;
pub use error::FormFactorError;
pub use hemicube::Hemicube;
pub use hemisphere::{row_nusselt, row_rays, visible_share};
pub use point::{form_factor_disc, form_factor_point, form_factor_polygon};
pub use sample::{Cell, cells, centroid, gauss_legendre, point_on, polygon_nodes};
pub use shadow::form_factor_visible_polygon;

/// A method with the settings that determine its accuracy.
///
/// Methods with `shadow_rays` compute unoccluded form factors and multiply each by the visible
/// fraction, estimated by this many rays between the two patches ([`visible_share`]); 0 ignores
/// occlusion.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// [`form_factor_point`] between the centres of `cells` × `cells` cells of both patches
    /// (1..=64).
    PointToPoint {
        /// Cells along each side of each patch.
        cells: usize,
        /// Rays for each pair (0..=65536).
        shadow_rays: usize,
    },
    /// [`form_factor_disc`] between the centres of `cells` × `cells` cells of both patches
    /// (1..=64).
    PointToDisc {
        /// Cells along each side of each patch.
        cells: usize,
        /// Rays for each pair (0..=65536).
        shadow_rays: usize,
    },
    /// [`form_factor_polygon`] from the centres of `cells` × `cells` cells of the leaving patch to
    /// the whole other one (1..=64).
    PointToPolygon {
        /// Cells along each side of the leaving patch.
        cells: usize,
        /// Rays for each pair (0..=65536).
        shadow_rays: usize,
    },
    /// [`exchange_contour`]: exact except for occlusion.
    Contour {
        /// Allowed error, absolute in F (1e-14..=0.1).
        tolerance: f64,
        /// Rays for each pair (0..=65536).
        shadow_rays: usize,
    },
    /// [`row_nusselt`]: the scanned disc, including occlusion.
    Nusselt {
        /// Pixels along the disc's diameter (1..=4096).
        resolution: usize,
        /// Points along each side of the leaving patch (1..=64).
        points: usize,
    },
    /// [`Hemicube`]: drawn with a depth buffer, including occlusion.
    Hemicube {
        /// Pixels along the top's edge, even (2..=4096).
        resolution: usize,
        /// Points along each side of the leaving patch (1..=64).
        points: usize,
    },
    /// [`exchange_area`] with a ray for each pair of quadrature points.
    AreaToArea {
        /// Gauss–Legendre points along each side of each piece (1..=16).
        order: usize,
        /// Allowed error, absolute in F (1e-12..=1).
        tolerance: f64,
    },
    /// [`row_rays`]: hits of cosine-distributed rays.
    Rays {
        /// Rays from each patch (1..=2^24).
        count: usize,
    },
}

/// The form factors of an enclosure and their cost.
#[derive(Debug, Clone, PartialEq)]
pub struct FormFactors {
    /// F_ij by rows.
    pub matrix: Matrix,
    /// Rays cast.
    pub rays: u64,
    /// Memory of the matrix and of one thread's buffers, bytes.
    pub bytes: usize,
}

/// Computes all form factors of `enclosure` by `method`. Same bits for any number of threads.
///
/// # Errors
/// A patch that is not a flat convex polygon of 3 to 8 finite corners with non-zero area; a setting
/// outside its range.
pub fn form_factors(enclosure: &Enclosure, method: Method) -> Result<FormFactors, FormFactorError> {
    check_enclosure(enclosure)?;
    check_method(method)?;
    let tree = Visibility::new(enclosure);
    let scene = Scene {
        patches: &enclosure.patches,
        areas: enclosure.patches.iter().map(Patch::area).collect(),
        tree: &tree,
    };
    Ok(match method {
        Method::PointToPoint { cells, shadow_rays } => {
            scene.by_cells(cells, shadow_rays, form_factor_point)
        }
        Method::PointToDisc { cells, shadow_rays } => {
            scene.by_cells(cells, shadow_rays, form_factor_disc)
        }
        Method::PointToPolygon { cells, shadow_rays } => scene.by_polygon(cells, shadow_rays),
        Method::Contour {
            tolerance,
            shadow_rays,
        } => scene.by_pairs(0, |i, j| {
            let patches = scene.patches;
            let g = exchange_contour(&patches[i].corners, &patches[j].corners, tolerance);
            let (share, rays) = scene.share(i, j, if g > 0.0 { shadow_rays } else { 0 });
            (g * share, rays)
        }),
        Method::Nusselt { resolution, points } => scene
            .by_rows(resolution * resolution * 24, |i, row| {
                row_nusselt(scene.patches, &tree, i, resolution, points, row)
            }),
        Method::Hemicube { resolution, points } => {
            let hemicube = Hemicube::new(resolution);
            scene.by_rows(hemicube.bytes(), |i, row| {
                hemicube.row(scene.patches, i, points, row);
                0
            })
        }
        Method::AreaToArea { order, tolerance } => scene.by_pairs(0, |i, j| {
            let (a, b) = (&scene.patches[i].corners, &scene.patches[j].corners);
            exchange_area(a, b, order, tolerance, Some((&tree, i, j)))
        }),
        Method::Rays { count } => {
            scene.by_rows(0, |i, row| row_rays(scene.patches, &tree, i, count, row))
        }
    })
}

struct Scene<'a> {
    patches: &'a [Patch],
    areas: Vec<f64>,
    tree: &'a Visibility,
}

impl Scene<'_> {
    /// Rows one by one, in parallel; `fill` returns the number of rays and needs `bytes` of its
    /// own.
    fn by_rows(&self, bytes: usize, fill: impl Fn(usize, &mut [f64]) -> u64 + Sync) -> FormFactors {
        let n = self.patches.len();
        let mut matrix = Matrix::zeros(n);
        let rays = matrix
            .values_mut()
            .par_chunks_mut(n.max(1))
            .enumerate()
            .map(|(i, row)| fill(i, row))
            .sum();
        let bytes = matrix.bytes() + bytes;
        FormFactors {
            matrix,
            rays,
            bytes,
        }
    }

    /// Each pair once, i < j: `exchange` gives A_i F_ij and the number of rays.
    fn by_pairs(
        &self,
        bytes: usize,
        exchange: impl Fn(usize, usize) -> (f64, u64) + Sync,
    ) -> FormFactors {
        let mut all = self.by_rows(bytes, |i, row| {
            let mut rays = 0;
            for (j, value) in row.iter_mut().enumerate().skip(i + 1) {
                if self.facing(i, j) {
                    let (g, r) = exchange(i, j);
                    *value = g;
                    rays += r;
                }
            }
            rays
        });
        mirror(&mut all.matrix, &self.areas);
        all
    }

    fn by_cells(
        &self,
        k: usize,
        shadow_rays: usize,
        kernel: impl Fn(glam::DVec3, glam::DVec3, glam::DVec3, glam::DVec3, f64) -> f64 + Sync,
    ) -> FormFactors {
        let cut: Vec<Vec<Cell>> = self.patches.iter().map(|p| cells(&p.corners, k)).collect();
        let normals: Vec<_> = self.patches.iter().map(Patch::normal).collect();
        let bytes = cut.len() * k * k * size_of::<Cell>();
        self.by_rows(bytes, |i, row| {
            let mut rays = 0;
            for (j, f) in row.iter_mut().enumerate() {
                if j == i || !self.facing(i, j) {
                    continue;
                }
                for a in &cut[i] {
                    for b in &cut[j] {
                        *f += a.area * kernel(a.centre, normals[i], b.centre, normals[j], b.area);
                    }
                }
                *f /= self.areas[i];
                if *f > 0.0 {
                    let (share, cast) = self.share(i, j, shadow_rays);
                    *f *= share;
                    rays += cast;
                }
            }
            rays
        })
    }

    fn by_polygon(&self, k: usize, shadow_rays: usize) -> FormFactors {
        let normals: Vec<_> = self.patches.iter().map(Patch::normal).collect();
        self.by_rows(k * k * size_of::<Cell>(), |i, row| {
            let points = cells(&self.patches[i].corners, k);
            let mut rays = 0;
            for (j, f) in row.iter_mut().enumerate() {
                if j == i || !self.facing(i, j) {
                    continue;
                }
                for a in &points {
                    *f += a.area
                        * form_factor_polygon(a.centre, normals[i], &self.patches[j].corners);
                }
                *f /= self.areas[i];
                if *f > 0.0 {
                    let (share, cast) = self.share(i, j, shadow_rays);
                    *f *= share;
                    rays += cast;
                }
            }
            rays
        })
    }

    /// Whether any light can go from one to the other.
    fn facing(&self, i: usize, j: usize) -> bool {
        Shaft::new(&self.patches[i], &self.patches[j]).is_some()
    }

    fn share(&self, i: usize, j: usize, rays: usize) -> (f64, u64) {
        if rays == 0 {
            (1.0, 0)
        } else {
            visible_share(self.patches, self.tree, i, j, rays)
        }
    }
}

/// Converts A_i F_ij above the diagonal to F_ij and F_ji on both sides of it.
pub(crate) fn mirror(matrix: &mut Matrix, areas: &[f64]) {
    let n = matrix.len();
    let values = matrix.values_mut();
    for i in 0..n {
        for j in i + 1..n {
            let g = values[i * n + j];
            values[i * n + j] = g / areas[i];
            values[j * n + i] = g / areas[j];
        }
    }
}

/// Refuses patches that the methods do not support.
pub(crate) fn check_enclosure(enclosure: &Enclosure) -> Result<(), FormFactorError> {
    for (patch, p) in enclosure.patches.iter().enumerate() {
        let invalid = |fault| Err(FormFactorError::InvalidPatch { patch, fault });
        let c = &p.corners;
        if !(3..=8).contains(&c.len()) {
            return invalid("has fewer than 3 or more than 8 corners");
        }
        if c.iter().any(|c| !c.is_finite()) {
            return invalid("has a corner that is not finite");
        }
        let size = c.iter().map(|a| (*a - c[0]).length()).fold(0.0, f64::max);
        let normal = p.normal();
        if normal == glam::DVec3::ZERO {
            return invalid("has no area");
        }
        // Rounding of the makers' corners is 1e-16 of their distance from the origin.
        let rounding = 1e-9 * size + 1e-15 * c[0].length();
        if c.iter().any(|a| (*a - c[0]).dot(normal).abs() > rounding) {
            return invalid("is not flat");
        }
        for k in 0..c.len() {
            let (a, b, d) = (c[k], c[(k + 1) % c.len()], c[(k + 2) % c.len()]);
            if (b - a).cross(d - b).dot(normal) < -rounding * size {
                return invalid("is not convex");
            }
        }
    }
    Ok(())
}

fn check_method(method: Method) -> Result<(), FormFactorError> {
    let range = |setting, low: usize, high: usize, expected, got: usize| {
        if (low..=high).contains(&got) {
            Ok(())
        } else {
            Err(FormFactorError::InvalidSetting {
                setting,
                expected,
                got: got.to_string(),
            })
        }
    };
    let tolerance_in = |low: f64, high: f64, expected, got: f64| {
        if got >= low && got <= high {
            Ok(())
        } else {
            Err(FormFactorError::InvalidSetting {
                setting: "tolerance",
                expected,
                got: got.to_string(),
            })
        }
    };
    let shadow = |rays| range("shadow_rays", 0, hemisphere::SEQUENCE, "0 to 65536", rays);
    match method {
        Method::PointToPoint { cells, shadow_rays }
        | Method::PointToDisc { cells, shadow_rays }
        | Method::PointToPolygon { cells, shadow_rays } => {
            range("cells", 1, 64, "1 to 64", cells)?;
            shadow(shadow_rays)
        }
        Method::Contour {
            tolerance,
            shadow_rays,
        } => {
            tolerance_in(1e-14, 0.1, "1e-14 to 0.1", tolerance)?;
            shadow(shadow_rays)
        }
        Method::Nusselt { resolution, points } => {
            range("resolution", 1, 4096, "1 to 4096", resolution)?;
            range("points", 1, 64, "1 to 64", points)
        }
        Method::Hemicube { resolution, points } => {
            let expected = "an even number from 2 to 4096";
            range("resolution", 2, 4096, expected, resolution)?;
            if resolution % 2 != 0 {
                return Err(FormFactorError::InvalidSetting {
                    setting: "resolution",
                    expected,
                    got: resolution.to_string(),
                });
            }
            range("points", 1, 64, "1 to 64", points)
        }
        Method::AreaToArea { order, tolerance } => {
            range("order", 1, 16, "1 to 16", order)?;
            tolerance_in(1e-12, 1.0, "1e-12 to 1", tolerance)
        }
        Method::Rays { count } => range("count", 1, 1 << 24, "1 to 16777216", count),
    }
}
