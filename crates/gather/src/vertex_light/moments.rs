//! Integrals of the lightmap over a triangle, in terms of linear interpolation.

use atlas::{Placement, TexelIndex};
use glam::{DVec2, DVec3, Vec3};
use patch_subdivision::raster::{Polygon, cut_triangle};
use radiosity::luminance;

use crate::received::Received;

/// Triangles with fewer texels are gathered separately: a lumel's mean says too little about
/// variation inside it.
pub(super) const LEAST_TEXELS: f64 = 4.0;

/// Weight of a lumel without a visible part, relative to a visible one: such light counts only if
/// there is no other.
const HIDDEN: f32 = 1e-3;

/// A lumel's light.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LumelLight {
    /// Irradiance.
    pub e: Vec3,
    /// Its visible fraction.
    pub open: f32,
    /// Estimated variance of its luminance.
    pub variance: f32,
}

impl LumelLight {
    pub(crate) fn of(received: &Received) -> LumelLight {
        LumelLight {
            e: received.direct + received.indirect,
            open: received.open,
            variance: received.variance(),
        }
    }

    /// Its weight.
    fn weight(&self) -> f64 {
        f64::from(self.open.max(HIDDEN))
    }
}

/// Integrals over a triangle, weighted by the visible fraction of each lumel, m². φ₀, φ₁, φ₂ are
/// barycentric coordinates.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    /// ∫ 1.
    pub weight: f64,
    /// ∫ E φₖ.
    pub light: [DVec3; 3],
    /// ∫ φⱼ φₖ: 00, 01, 02, 11, 12, 22.
    pub mass: [f64; 6],
    /// ∫ Y² of E's luminance Y.
    pub square: f64,
    /// ∫ of the estimated variance of Y.
    pub noise: f64,
    /// Minimum and maximum E of any lumel.
    pub range: [Vec3; 2],
}

/// Index of the pair (j, k) in [`Moments::mass`].
pub(super) const PAIR: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

impl Moments {
    /// Whether there are enough lumels.
    pub fn measured(&self) -> bool {
        self.weight > 0.0
    }

    /// The moments of a triangle of `area` m² with corners at `page`; empty if it has too few
    /// texels.
    pub fn of(
        (page, area): (&[DVec2; 3], f64),
        placement: &Placement,
        index: &TexelIndex,
        light: &[LumelLight],
    ) -> Self {
        let mut out = Moments {
            range: [Vec3::INFINITY, Vec3::NEG_INFINITY],
            ..Moments::default()
        };
        let texels = texels(page);
        // NaN without a chart.
        if texels.is_nan() || texels < LEAST_TEXELS {
            return Moments::default();
        }
        let scale = area / texels;
        over_lumels(page, placement, index, |lumel, cell| {
            let l = &light[lumel];
            let weight = l.weight() * scale;
            let e = l.e.as_dvec3();
            let y = f64::from(luminance(l.e));
            out.weight += weight * cell.area;
            for (sum, phi) in out.light.iter_mut().zip(cell.linear) {
                *sum += e * (phi * weight);
            }
            for (sum, phi) in out.mass.iter_mut().zip(cell.quadratic) {
                *sum += phi * weight;
            }
            out.square += weight * cell.area * y * y;
            out.noise += weight * cell.area * f64::from(l.variance);
            out.range = [out.range[0].min(l.e), out.range[1].max(l.e)];
        });
        out
    }

    /// ∫ (Y − Σ cₖ φₖ)² for luminances `c` at the corners.
    pub fn residual(&self, c: [f64; 3]) -> f64 {
        let mut sum = self.square;
        for j in 0..3 {
            let y = luminance_of(self.light[j]);
            sum -= 2.0 * c[j] * y;
            for k in 0..3 {
                sum += c[j] * c[k] * self.mass[PAIR[j][k]];
            }
        }
        sum.max(0.0)
    }

    /// Mean luminance.
    pub fn mean(&self) -> f64 {
        self.light.iter().map(|l| luminance_of(*l)).sum::<f64>()
            / self.weight.max(f64::MIN_POSITIVE)
    }
}

/// [`luminance`] in double precision.
pub(super) fn luminance_of(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// The part of a triangle in one texel; integrals are in texels.
pub(super) struct Cell {
    /// ∫ 1.
    pub area: f64,
    /// ∫ φₖ.
    pub linear: [f64; 3],
    /// ∫ φⱼ φₖ, as in [`Moments::mass`].
    pub quadratic: [f64; 6],
}

/// Area of a triangle on the page, texels.
pub(super) fn texels([a, b, c]: &[DVec2; 3]) -> f64 {
    0.5 * (b - a).perp_dot(c - a).abs()
}

/// Calls `f` with every lumel that the triangle with corners at `page` touches.
pub(super) fn over_lumels(
    page: &[DVec2; 3],
    placement: &Placement,
    index: &TexelIndex,
    mut f: impl FnMut(usize, &Cell),
) {
    let rect = placement.rect;
    let [a, b, c] = *page;
    let det = (b - a).perp_dot(c - a);
    let on_page = page.iter().all(|p| p.is_finite());
    if !on_page || det == 0.0 || rect.w == 0 || rect.h == 0 {
        return;
    }
    let phi = |p: DVec2| {
        let d = p - a;
        let (u, v) = (d.perp_dot(c - a) / det, (b - a).perp_dot(d) / det);
        [1.0 - u - v, u, v]
    };
    cut_triangle(*page, [rect.w, rect.h], |column, row, part, _| {
        let (x, y) = (i64::from(rect.x + column), i64::from(rect.y + row));
        if let Some(lumel) = index.at(placement.page, x, y) {
            f(lumel, &integrate(part, phi));
        }
    });
}

/// Exact for linear φ: over a triangle of area A, ∫ φⱼφₖ = A/12 (Σ φⱼφₖ at the corners + Σφⱼ Σφₖ).
fn integrate(part: &Polygon, phi: impl Fn(DVec2) -> [f64; 3]) -> Cell {
    let mut cell = Cell {
        area: 0.0,
        linear: [0.0; 3],
        quadratic: [0.0; 6],
    };
    for i in 1..part.n.saturating_sub(1) {
        let corners = [part.p[0], part.p[i], part.p[i + 1]];
        let area = 0.5
            * (corners[1] - corners[0])
                .perp_dot(corners[2] - corners[0])
                .abs();
        let at = corners.map(&phi);
        let sum = [0, 1, 2].map(|k| at[0][k] + at[1][k] + at[2][k]);
        cell.area += area;
        for k in 0..3 {
            cell.linear[k] += area * sum[k] / 3.0;
            for j in 0..=k {
                let products: f64 = at.iter().map(|p| p[j] * p[k]).sum();
                cell.quadratic[PAIR[j][k]] += area / 12.0 * (products + sum[j] * sum[k]);
            }
        }
    }
    cell
}
