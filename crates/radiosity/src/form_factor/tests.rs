use super::*;
use std::f64::consts::PI;

/// A rectangle a × b parallel to the origin's tangent plane at height c, with one corner straight
/// above the point: F = 1/2π (A/√(1+A²) atan(B/√(1+A²)) + B/√(1+B²) atan(A/√(1+B²))), A = a/c, B =
/// b/c (Howell, *A catalog of radiation heat transfer configuration factors*, B-3).
fn corner_rectangle(a: f64, b: f64, c: f64) -> f64 {
    let (x, y) = (a / c, b / c);
    let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    (x / p * (y / p).atan() + y / q * (x / q).atan()) / (2.0 * PI)
}

fn facing_rectangle(a: f64, b: f64, c: f64) -> [DVec3; 4] {
    // The front faces down (−z): counter-clockwise as seen from below.
    [
        DVec3::new(0., 0., c),
        DVec3::new(0., b, c),
        DVec3::new(a, b, c),
        DVec3::new(a, 0., c),
    ]
}

#[test]
fn rectangle_overhead_matches_the_catalogue_over_twelve_decades() {
    for e in -6..=6 {
        let c = 10f64.powi(e);
        for (a, b) in [(1.0, 1.0), (0.01, 100.0), (3.0, 0.5)] {
            let f = form_factor_polygon(DVec3::ZERO, DVec3::Z, &facing_rectangle(a, b, c));
            let exact = corner_rectangle(a, b, c);
            // Cancellation among four edge terms of order a/c, each with a rounding error of 1e-16.
            assert!(
                (f - exact).abs() <= 1e-13 + 1e-9 * exact,
                "{a} {b} {c}: {f} {exact}"
            );
        }
    }
}

#[test]
fn behind_is_negative_and_below_the_horizon_is_nothing() {
    let r = facing_rectangle(1., 1., 1.);
    let back: Vec<_> = r.iter().rev().copied().collect();
    let f = form_factor_polygon(DVec3::ZERO, DVec3::Z, &r);
    assert!((form_factor_polygon(DVec3::ZERO, DVec3::Z, &back) + f).abs() < 1e-15);
    assert_eq!(form_factor_polygon(DVec3::ZERO, -DVec3::Z, &r), 0.0);
}

#[test]
fn a_wall_that_crosses_the_horizon_counts_its_upper_half_only() {
    // A wall in the plane x = 1 from z = −5 to 5 equals the same wall from z = 0 to 5.
    let wall = |z0: f64| {
        [
            DVec3::new(1., -2., z0),
            DVec3::new(1., -2., 5.),
            DVec3::new(1., 2., 5.),
            DVec3::new(1., 2., z0),
        ]
    };
    let (whole, half) = (
        form_factor_polygon(DVec3::ZERO, DVec3::Z, &wall(-5.)),
        form_factor_polygon(DVec3::ZERO, DVec3::Z, &wall(0.)),
    );
    assert!(
        (whole - half).abs() < 1e-15 && whole > 0.1,
        "{whole} {half}"
    );
}

#[test]
fn the_inside_of_a_cube_sums_to_one_wherever_one_stands() {
    let p = DVec3::new(0.3, 0.2, 0.1);
    let c = |i: usize| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64);
    // Faces are counter-clockwise as seen from inside.
    let faces = [
        [0, 2, 6, 4],
        [1, 5, 7, 3],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 1, 3, 2],
        [4, 6, 7, 5],
    ];
    for n in [DVec3::X, DVec3::new(1., 2., -3.).normalize(), -DVec3::Z] {
        let sum: f64 = faces
            .iter()
            .map(|f| form_factor_polygon(p, n, &f.map(c)))
            .sum();
        assert!((sum.abs() - 1.0).abs() < 1e-14, "{sum}");
    }
}

/// Nodes and weights of the eight-point Gauss–Legendre rule on [−1, 1], positive half (Abramowitz &
/// Stegun, table 25.4).
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_27),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// Points and weights on [0, 1] for functions that change within `layer` of either end and are
/// smooth elsewhere: Gauss panels that double in width from the ends to the middle.
fn graded(layer: f64) -> Vec<(f64, f64)> {
    let mut borders = vec![0.0];
    let mut x = (layer / 16.0).min(0.25);
    while x < 0.5 {
        borders.push(x);
        x *= 2.0;
    }
    borders.push(0.5);
    let mut points = Vec::new();
    for w in borders.windows(2) {
        let (middle, half) = (0.5 * (w[0] + w[1]), 0.5 * (w[1] - w[0]));
        for (x, weight) in GAUSS {
            for x in [middle - half * x, middle + half * x] {
                points.push((x, weight * half));
                points.push((1.0 - x, weight * half));
            }
        }
    }
    points
}

/// Mean over the rectangle `corner + s x + t y` with normal `n` of the form factor to `polygon`;
/// `layers` as in [`graded`], one per side.
fn mean_factor(
    corner: DVec3,
    [x, y]: [DVec3; 2],
    n: DVec3,
    layers: [f64; 2],
    polygon: &[DVec3],
) -> f64 {
    let (s, t) = (graded(layers[0]), graded(layers[1]));
    let mut sum = 0.0;
    for (s, ws) in &s {
        for (t, wt) in &t {
            sum += ws * wt * form_factor_polygon(corner + x * *s + y * *t, n, polygon);
        }
    }
    sum
}

/// Opposed rectangles a × b at distance c: F = 2/(πXY) {½ ln[(1+X²)(1+Y²)/(1+X²+Y²)] + X√(1+Y²)
/// atan(X/√(1+Y²)) + Y√(1+X²) atan(Y/√(1+X²)) − X atan X − Y atan Y}, X = a/c, Y = b/c (Howell,
/// *Catalog*, C-11).
fn opposed(a: f64, b: f64, c: f64) -> f64 {
    let (x, y) = (a / c, b / c);
    let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let log = (p * q / (1.0 + x * x + y * y).sqrt()).ln();
    2.0 / (PI * x * y)
        * (log + x * q * (x / q).atan() + y * p * (y / p).atan() - x * x.atan() - y * y.atan())
}

/// Rectangles w × 1 and h × 1 at right angles with a common edge of length 1, from the one of depth
/// w: Howell, *Catalog*, C-14.
fn perpendicular(w: f64, h: f64) -> f64 {
    let (w2, h2) = (w * w, h * h);
    let s = w2 + h2;
    let log = ((1.0 + w2) * (1.0 + h2) / (1.0 + s)).ln()
        + w2 * (w2 * (1.0 + s) / ((1.0 + w2) * s)).ln()
        + h2 * (h2 * (1.0 + s) / ((1.0 + h2) * s)).ln();
    let atan = |x: f64| x * (1.0 / x).atan();
    (atan(w) + atan(h) - atan(s.sqrt()) + 0.25 * log) / (PI * w)
}

#[test]
fn opposed_rectangles_match_the_catalogue_from_afar_to_near_contact() {
    assert!((opposed(1.0, 1.0, 1.0) - 0.199_825).abs() < 5e-7);
    for (a, b) in [
        (1.0, 1.0),
        (0.1, 10.0),
        (10.0, 0.1),
        (0.01, 1.0),
        (1.0, 100.0),
    ] {
        for d in [10.0, 3.0, 1.0, 0.3, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
            let above = facing_rectangle(a, b, d);
            let f = mean_factor(
                DVec3::ZERO,
                [DVec3::X * a, DVec3::Y * b],
                DVec3::Z,
                [d / a, d / b],
                &above,
            );
            let exact = opposed(a, b, d);
            // Panels that double in width, with the kernel's poles a panel's width off: 16 digits'
            // worth of Gauss points gives about ((2 + √3))^−16 = 1e-9. The catalogue's formula
            // cancels (1/XY)² terms: 1e-16 × (d²/ab)² × XY at the far end.
            let rounding = 1e-15 * (d * d / (a * b)).max(1.0).powi(2);
            assert!(
                (f / exact - 1.0).abs() < 2e-9 + rounding,
                "{a} × {b} at {d}: {f} {exact}"
            );
        }
    }
}

#[test]
fn perpendicular_rectangles_match_the_catalogue_over_all_aspects() {
    assert!((perpendicular(1.0, 1.0) - 0.200_044).abs() < 5e-7);
    for w in [0.01, 0.1, 0.5, 1.0, 3.0, 10.0, 100.0] {
        for h in [0.01, 0.1, 1.0, 7.0, 100.0] {
            // The floor extends w from x = 0, the wall is on x = 0, h high, with its front towards
            // +x; both extend from y = 0 to 1.
            let wall = [
                DVec3::ZERO,
                DVec3::Y,
                DVec3::new(0.0, 1.0, h),
                DVec3::new(0.0, 0.0, h),
            ];
            let f = mean_factor(
                DVec3::ZERO,
                [DVec3::X * w, DVec3::Y],
                DVec3::Z,
                [1e-9, 1e-9],
                &wall,
            );
            let exact = perpendicular(w, h);
            // Panels of relative width 1 reach down to 1e-10 of either side. The omitted corner is
            // 1e-10 of the mean, and the catalogue's formula loses (1/w + 1/h + w + h)² of 1e-16 to
            // cancellation.
            let rounding = 1e-15 * (1.0 / w + 1.0 / h + w + h).powi(3);
            assert!(
                (f / exact - 1.0).abs() < 2e-9 + rounding,
                "w {w}, h {h}: {f} {exact}"
            );
            // A_1 F_12 = A_2 F_21.
            assert!((w * exact / (h * perpendicular(h, w)) - 1.0).abs() < 1e-9 + rounding * 10.0);
        }
    }
}

/// Form factor from a point to a disc of radius `r` at height `z` around the axis, approximated by
/// `n` triangles with the disc's area.
fn disc_factor(point: DVec3, r: f64, z: f64, n: usize) -> f64 {
    let step = 2.0 * PI / n as f64;
    // The area of the inscribed polygon is n/2 r² sin(2π/n).
    let r = r * (step / step.sin()).sqrt();
    let at = |k: usize| {
        let (s, c) = (k as f64 * step).sin_cos();
        DVec3::new(r * c, r * s, z)
    };
    (0..n)
        .map(|k| {
            let corners = [DVec3::new(0.0, 0.0, z), at(k + 1), at(k)];
            form_factor_polygon(point, DVec3::Z, &corners)
        })
        .sum()
}

#[test]
fn a_disc_over_a_point_on_its_axis_and_off_it() {
    for z in [10.0, 1.0, 0.1, 1e-2] {
        for offset in [0.0, 0.5, 1.5, 4.0] {
            // F = ½ (1 − (1 + H² − R²)/√(Z² − 4R²)) with H = z/a, R = r/a, Z = 1 + H² + R², a the
            // offset (Howell, *Catalog*, B-12); multiplied through by a², so that a = 0 gives
            // r²/(r² + z²).
            let (a2, h2): (f64, f64) = (offset * offset, z * z);
            let sum = a2 + h2 + 1.0;
            let exact = 0.5 * (1.0 - (a2 + h2 - 1.0) / (sum * sum - 4.0 * a2).sqrt());
            let f = disc_factor(DVec3::new(offset, 0.0, 0.0), 1.0, z, 1024);
            // A polygon of equal area differs from the disc by the order of its angle squared, in
            // strips at the rim that cancel except for the kernel's change across them: (2π/1024)²
            // = 4e-5 of the light from within a strip's width.
            assert!(
                (f - exact).abs() < 4e-5 * exact,
                "z {z}, off {offset}: {f} {exact}"
            );
        }
    }
}

#[test]
fn coaxial_discs_match_the_catalogue() {
    for (r1, r2, h) in [
        (1.0, 1.0, 1.0),
        (1.0, 1.0, 10.0),
        (1.0, 2.0, 0.5),
        (0.3, 1.0, 1.0),
    ] {
        // F12 = ½ (X − √(X² − 4 (R2/R1)²)), X = 1 + (1 + R2²)/R1², R = r/h (Howell, *Catalog*,
        // C-41).
        let (a, b): (f64, f64) = (r1 / h, r2 / h);
        let x = 1.0 + (1.0 + b * b) / (a * a);
        let exact = 0.5 * (x - (x * x - 4.0 * (b / a).powi(2)).sqrt());
        // ∫ F 2r dr / r1² with r² = s r1².
        let f: f64 = graded(0.1)
            .iter()
            .map(|(s, w)| w * disc_factor(DVec3::new(r1 * s.sqrt(), 0.0, 0.0), r2, h, 512))
            .sum();
        // The polygon of 512 sides, as above: 1.6e-4 of the rim's strips.
        assert!((f / exact - 1.0).abs() < 2e-5, "{r1} {r2} {h}: {f} {exact}");
        if (r1, r2, h) == (1.0, 1.0, 1.0) {
            assert!((f - 0.381_966).abs() < 1e-5, "{f}");
        }
    }
}

#[test]
fn a_needle_and_a_plate_without_end() {
    // Aspect 1e6 both ways: the catalogue's rectangle over a corner.
    for (a, b, c) in [
        (1.0, 1e-6, 1.0),
        (1e-6, 1.0, 1e-3),
        (1e6, 1.0, 1.0),
        (1e3, 1e-3, 1.0),
    ] {
        let f = form_factor_polygon(DVec3::ZERO, DVec3::Z, &facing_rectangle(a, b, c));
        let exact = corner_rectangle(a, b, c);
        // Two long edges whose terms cancel down to the needle's width: the absolute rounding error
        // is 1e-16.
        assert!(
            (f - exact).abs() < 1e-15 + 1e-9 * exact,
            "{a} {b} {c}: {f} {exact}"
        );
    }
    // Between infinite plates, everything that one sends arrives; a plate 1e6 wide loses (2c/w)² of
    // it.
    let w = 1e6;
    let plate = facing_rectangle(w, w, 1.0).map(|p| p - DVec3::new(0.5 * w, 0.5 * w, 0.0));
    let f = form_factor_polygon(DVec3::ZERO, DVec3::Z, &plate);
    assert!((1.0 - f).abs() < 1e-11, "{f}");
}

#[test]
fn turning_moving_and_scaling_all_together_changes_nothing() {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
    let polygon = [
        DVec3::new(0.2, -0.1, 0.5),
        DVec3::new(0.1, 0.9, 0.7),
        DVec3::new(1.2, 0.8, 0.3),
        DVec3::new(1.3, -0.2, 0.1),
    ];
    let (p, n) = (
        DVec3::new(0.1, 0.2, -0.3),
        DVec3::new(0.2, 0.1, 1.0).normalize(),
    );
    let one = form_factor_polygon(p, n, &polygon);
    assert!(one > 0.05);
    for (scale, move_by) in [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)] {
        let at = |v: DVec3| turn * v * scale + DVec3::splat(move_by);
        let f = form_factor_polygon(at(p), turn * n, &polygon.map(at));
        // Coordinates of 1e6 have a resolution of 1e-10, and the figure has a size of 1.
        let tolerance = if move_by > 0.0 { 1e-9 } else { 1e-14 };
        assert!((f - one).abs() < tolerance, "{scale} {move_by}: {f} {one}");
    }
}
