//! Regular grids of probes.

use glam::{DVec3, Vec3};

use super::probe::{MAX_PROBES, Probe};
use super::sh::Sh2;

/// A regular grid: probe (i, j, k) is at `origin` + `spacing` · (i, j, k) and has index i +
/// dims\[0\] · (j + dims\[1\] · k), like the texels of a volume texture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbeGrid {
    /// Position of the first probe, metres.
    pub origin: DVec3,
    /// Distance between neighbours, metres, in each direction.
    pub spacing: f64,
    /// Probes along x, y, z, each at least 1.
    pub dims: [u32; 3],
}

/// A grid would have more than [`MAX_PROBES`] probes.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "probes every {spacing} m make {} x {} x {} of them, expected at most {MAX_PROBES} in all: try {fits} m",
    dims[0], dims[1], dims[2]
)]
pub struct TooManyProbes {
    /// Requested spacing, metres.
    pub spacing: f64,
    /// Probes along x, y, z.
    pub dims: [f64; 3],
    /// A spacing that fits.
    pub fits: f64,
}

/// Number of probes along each side of a box for cells of `spacing`.
fn dims(extent: DVec3, spacing: f64) -> [f64; 3] {
    // A box that is a multiple of the spacing up to rounding gets no extra cell.
    extent
        .to_array()
        .map(|e| (e / spacing - 1e-6).ceil().max(1.0))
}

impl ProbeGrid {
    /// A grid over the box from `low` to `high`: cubes with edge length `spacing` > 0, centred in
    /// the box, with a probe at the centre of each. So none is on the box's sides, where a level's
    /// walls are.
    ///
    /// # Errors
    /// [`TooManyProbes`].
    pub fn over(low: DVec3, high: DVec3, spacing: f64) -> Result<ProbeGrid, TooManyProbes> {
        let extent = (high - low).max(DVec3::ZERO);
        let counts = dims(extent, spacing);
        let fits = |c: [f64; 3]| c.iter().product::<f64>() <= MAX_PROBES as f64;
        if !fits(counts) {
            // Two digits, increasingly coarse in steps of 6 to 12 %; at the box's own size there is
            // a single probe.
            let mut try_spacing = spacing;
            while !fits(dims(extent, try_spacing)) {
                let step = libm::pow(10.0, libm::log10(try_spacing).floor() - 1.0);
                // The small term keeps rounding from stalling.
                try_spacing = ((try_spacing / step + 1e-6).floor() + 1.0) * step;
            }
            // `{}` prints the shortest decimal for this number; the product above has noise in its
            // last digits.
            let fits = format!("{try_spacing:.1e}").parse().unwrap_or(try_spacing);
            return Err(TooManyProbes {
                spacing,
                dims: counts,
                fits,
            });
        }
        let [x, y, z] = counts;
        let middle = (low + high) * 0.5;
        Ok(ProbeGrid {
            origin: middle - (DVec3::new(x, y, z) - 1.0) * (0.5 * spacing),
            spacing,
            dims: counts.map(|c| c as u32),
        })
    }

    /// Number of probes.
    pub fn len(&self) -> usize {
        self.dims.iter().map(|d| *d as usize).product()
    }

    /// Whether there are none; never true for a grid of [`ProbeGrid::over`].
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Steps along x, y, z of probe `index`.
    fn cell(&self, index: usize) -> [usize; 3] {
        let [x, y, _] = self.dims.map(|d| d as usize);
        [index % x, index / x % y, index / (x * y)]
    }

    /// Position of probe `index`, metres.
    pub fn position(&self, index: usize) -> DVec3 {
        let [i, j, k] = self.cell(index).map(|c| c as f64);
        self.origin + DVec3::new(i, j, k) * self.spacing
    }

    /// Gives probes inside something the light of adjacent valid probes, then of those just filled,
    /// until none is left, because interpolation in the grid must not read the darkness inside a
    /// wall. They stay marked as invalid.
    ///
    /// A probe gets the mean over its up to 26 neighbours, weighted by 1/distance. If no probe is
    /// valid, all stay unchanged.
    pub fn fill(&self, probes: &mut [Probe]) {
        let mut known: Vec<bool> = probes.iter().map(|p| p.valid).collect();
        let mut open: Vec<usize> = (0..probes.len()).filter(|&i| !known[i]).collect();
        if open.len() == probes.len() {
            return;
        }
        while !open.is_empty() {
            let mut filled = Vec::new();
            open.retain(|&i| match self.mean_of_neighbours(i, probes, &known) {
                Some(p) => {
                    filled.push((i, p));
                    false
                }
                None => true,
            });
            for (i, (sh, error)) in filled {
                probes[i].sh = sh;
                probes[i].error = error;
                known[i] = true;
            }
        }
    }

    fn mean_of_neighbours(
        &self,
        index: usize,
        probes: &[Probe],
        known: &[bool],
    ) -> Option<(Sh2, f32)> {
        let cell = self.cell(index);
        let dims = self.dims.map(|d| d as usize);
        let around = |axis: usize| {
            let c = cell[axis];
            c.saturating_sub(1)..(c + 2).min(dims[axis])
        };
        let (mut sum, mut error, mut weight) = ([Vec3::ZERO; 9], 0.0, 0.0);
        for k in around(2) {
            for j in around(1) {
                for i in around(0) {
                    let n = i + dims[0] * (j + dims[1] * k);
                    if !known[n] {
                        continue;
                    }
                    let steps = [i, j, k]
                        .iter()
                        .zip(cell)
                        .filter(|(a, b)| **a != *b)
                        .count();
                    let w = 1.0 / (steps as f32).sqrt();
                    for (s, c) in sum.iter_mut().zip(probes[n].sh.0) {
                        *s += c * w;
                    }
                    error += probes[n].error * w;
                    weight += w;
                }
            }
        }
        (weight > 0.0).then(|| (Sh2(sum.map(|s| s / weight)), error / weight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_are_in_the_middles_of_cells() {
        let low = DVec3::new(-1.0, 0.0, 10.0);
        let g = ProbeGrid::over(low, low + DVec3::new(4.0, 2.5, 0.0), 1.0).unwrap();
        assert_eq!((g.dims, g.len()), ([4, 3, 1], 12));
        // Three cells along a side of 2.5: they extend a quarter beyond either end.
        assert_eq!(g.origin, DVec3::new(-0.5, 0.25, 10.0));
        assert_eq!(g.position(1), DVec3::new(0.5, 0.25, 10.0));
        assert_eq!(g.position(11), DVec3::new(2.5, 2.25, 10.0));
    }

    #[test]
    fn a_multiple_of_the_spacing_gets_no_cell_more() {
        for n in 1..=64 {
            let high = DVec3::splat(f64::from(n) * 0.1);
            let g = ProbeGrid::over(DVec3::ZERO, high, 0.1).unwrap();
            assert_eq!(g.dims, [n; 3]);
        }
    }

    #[test]
    fn too_many_name_a_spacing_that_fits() {
        for (size, spacing) in [(30.0, 0.1), (1e6, 1e-30), (1e-3, 1e-9), (100.0, 0.999)] {
            let high = DVec3::new(size, 0.7 * size, 0.5 * size);
            let e = ProbeGrid::over(DVec3::ZERO, high, spacing).unwrap_err();
            let g = ProbeGrid::over(DVec3::ZERO, high, e.fits).unwrap();
            // Not much coarser than necessary: at most 12 % in each direction, and a row.
            assert!(g.len() * 2 > MAX_PROBES, "{e}: {}", g.len());
        }
        let high = DVec3::new(30.0, 20.0, 10.0);
        let e = ProbeGrid::over(DVec3::ZERO, high, 0.1).unwrap_err();
        assert_eq!(
            e.to_string(),
            "probes every 0.1 m make 300 x 200 x 100 of them, expected at most 262144 in all: try 0.29 m"
        );
    }

    /// A probe with L00 = `value` in red.
    fn probe(value: f32, valid: bool) -> Probe {
        let mut p = Probe {
            valid,
            ..Probe::default()
        };
        p.sh.0[0].x = value;
        p
    }

    #[test]
    fn holes_are_filled_from_around_them() {
        let grid = ProbeGrid {
            origin: DVec3::ZERO,
            spacing: 1.0,
            dims: [5, 1, 1],
        };
        let mut p = [1.0, -1.0, -1.0, -1.0, 4.0].map(|x: f32| probe(x.max(0.0), x > 0.0));
        grid.fill(&mut p);
        // First the ends' neighbours, then the middle from both of them.
        assert_eq!(p.map(|p| p.sh.0[0].x), [1.0, 1.0, 2.5, 4.0, 4.0]);
        assert_eq!(p.map(|p| p.valid), [true, false, false, false, true]);
        let mut none = [probe(3.0, false); 5];
        grid.fill(&mut none);
        assert_eq!(none, [probe(3.0, false); 5]);
    }

    #[test]
    fn neighbours_across_an_edge_count_less() {
        let grid = ProbeGrid {
            origin: DVec3::ZERO,
            spacing: 1.0,
            dims: [2, 2, 1],
        };
        let mut p = [(0.0, false), (3.0, true), (0.0, true), (2.0, true)].map(|(x, v)| probe(x, v));
        grid.fill(&mut p);
        let w = std::f32::consts::FRAC_1_SQRT_2;
        let expected = (3.0 + 2.0 * w) / (2.0 + w);
        assert!((p[0].sh.0[0].x - expected).abs() < 1e-6);
    }
}
