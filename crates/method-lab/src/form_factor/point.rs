//! Form factors from a point: to another point, to a disc, to a polygon in closed form.

use std::f64::consts::PI;

use glam::DVec3;

/// From a differential area at `x` to a patch of area `area`, as if all of it were at `y`:
/// `F = A cosθ cosθ' / (π r²)`, θ at `x` with unit normal `n_x`, θ' at `y` with `n_y`.
///
/// A single evaluation of the form factor's kernel (Goral, Torrance, Greenberg, Battaile, *Modeling
/// the interaction of light between diffuse surfaces*, 1984). Accurate to (size/r)², and unbounded
/// as r goes to 0: values above 1 are not clamped. 0 if either faces away, and if the points
/// coincide.
pub fn form_factor_point(x: DVec3, n_x: DVec3, y: DVec3, n_y: DVec3, area: f64) -> f64 {
    let d = y - x;
    let (c, c1) = (n_x.dot(d), -n_y.dot(d));
    if c <= 0.0 || c1 <= 0.0 {
        return 0.0;
    }
    let r2 = d.length_squared();
    area * c * c1 / (PI * r2 * r2)
}

/// From a differential area at `x` to a patch of area `area`, as if it were a disc at `y`:
/// `F = A cosθ cosθ' / (π r² + A)`.
///
/// Exact for a disc that faces the point along its axis; otherwise an interpolation between that
/// and the far field, which never exceeds 1 (Wallace, Elmquist, Haines, *A ray tracing algorithm
/// for progressive radiosity*, 1989). Not reciprocal, because A is in the denominator on one side
/// only. 0 if either faces away, and if the points coincide.
pub fn form_factor_disc(x: DVec3, n_x: DVec3, y: DVec3, n_y: DVec3, area: f64) -> f64 {
    let d = y - x;
    let (c, c1) = (n_x.dot(d), -n_y.dot(d));
    if c <= 0.0 || c1 <= 0.0 {
        return 0.0;
    }
    let r2 = d.length_squared();
    area * (c * c1 / r2) / (PI * r2 + area)
}

/// From a differential area at `x` to a whole polygon, by Lambert's contour sum with horizon
/// clipping: the baker's [`radiosity::form_factor_polygon`], with 0 instead of a negative value if
/// the polygon faces away.
///
/// Exact for the point; the remaining error is that one point represents a whole patch.
pub fn form_factor_polygon(x: DVec3, n_x: DVec3, corners: &[DVec3]) -> f64 {
    radiosity::form_factor_polygon(x, n_x, corners).max(0.0)
}
