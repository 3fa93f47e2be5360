//! Form factors against the catalogue (Howell, *A catalog of radiation heat transfer configuration
//! factors*), and the known errors of approximate methods.

use std::f64::consts::PI;

use method_lab::enclosures::{
    coaxial_discs, concentric_spheres, opposed_plates, perpendicular_plates, sphere,
};
use method_lab::form_factor::exchange_contour;
use method_lab::reference::{self, opposed_rectangles, perpendicular_rectangles, sphere_interior};
use method_lab::{Enclosure, Matrix, Method, Patch, form_factors};

const CENTRES: [Method; 3] = [
    Method::PointToPoint {
        cells: 1,
        shadow_rays: 0,
    },
    Method::PointToDisc {
        cells: 1,
        shadow_rays: 0,
    },
    Method::PointToPolygon {
        cells: 1,
        shadow_rays: 0,
    },
];

fn matrix(enclosure: &Enclosure, method: Method) -> Matrix {
    form_factors(enclosure, method).unwrap().matrix
}

/// F from the first half of the patches together to the second.
fn half_to_half(enclosure: &Enclosure, m: &Matrix) -> f64 {
    let half = enclosure.patches.len() / 2;
    let areas: Vec<f64> = enclosure.patches.iter().map(Patch::area).collect();
    let power: f64 = (0..half)
        .map(|i| areas[i] * m.row(i)[half..].iter().sum::<f64>())
        .sum();
    power / areas[..half].iter().sum::<f64>()
}

#[test]
fn catalogue_formulae_give_the_published_digits() {
    for (f, digits) in [
        (opposed_rectangles(1.0, 1.0, 1.0), 0.199825),
        (perpendicular_rectangles(1.0, 1.0, 1.0), 0.200044),
        (reference::coaxial_discs(1.0, 1.0, 1.0), 0.381966),
    ] {
        // Half a unit of the last digit given.
        assert!((f - digits).abs() < 5e-7, "{f} {digits}");
    }
}

#[test]
fn contour_matches_opposed_squares_from_afar_to_touching() {
    for e in -24..=4 {
        let d = 10f64.powf(e as f64 / 4.0);
        let p = opposed_plates(d, 1).patches;
        let f = exchange_contour(&p[0].corners, &p[1].corners, 1e-13);
        let exact = opposed_rectangles(1.0, 1.0, d);
        // The requested tolerance, plus C-11's own cancellation of 1e-16·d⁴ relative to F.
        let allowed = 1e-12 + 1e-15 * d.powi(4);
        assert!((f - exact).abs() <= allowed, "d = {d}: {f} {exact}");
    }
}

#[test]
fn contour_matches_perpendicular_rectangles_of_any_aspect() {
    for e in -8..=8 {
        let aspect = 10f64.powf(e as f64 / 4.0);
        for (w, h) in [(aspect, 1.0), (1.0, aspect), (aspect, aspect)] {
            let p = perpendicular_plates(w, h, 1).patches;
            // The tolerance is relative to the smaller area.
            let f = exchange_contour(&p[0].corners, &p[1].corners, 1e-12) / w;
            let exact = perpendicular_rectangles(w, h, 1.0);
            // The requested tolerance for eight edges; C-14 loses 1e-16·max(w, h)² to cancellation.
            let allowed = 1e-11 + 1e-15 * w.max(h).powi(2) / w;
            assert!((f - exact).abs() <= allowed, "{w} × {h}: {f} {exact}");
        }
    }
}

#[test]
fn centre_methods_err_as_tabulated_on_opposed_squares() {
    // Published relative errors in per cent of centre to centre, centre to disc, centre to polygon;
    // from d = 0.1 on, the first is a factor. Half a unit of the last digit.
    let table = [
        (5.0, [(2.65, 0.005), (1.4, 0.05), (1.3, 0.05)]),
        (2.0, [(16.0, 0.5), (7.5, 0.05), (7.1, 0.05)]),
        (1.0, [(59.0, 0.5), (21.0, 0.5), (20.0, 0.5)]),
        (0.5, [(207.0, 0.5), (35.0, 0.5), (33.0, 0.5)]),
        (0.1, [(3749.0, 50.0), (17.0, 0.5), (17.0, 0.5)]),
    ];
    for (d, errors) in table {
        let enclosure = opposed_plates(d, 1);
        let exact = opposed_rectangles(1.0, 1.0, d);
        for (method, (percent, half_unit)) in CENTRES.into_iter().zip(errors) {
            let f = matrix(&enclosure, method).row(0)[1];
            let got = 100.0 * (f / exact - 1.0);
            assert!(
                (got - percent).abs() <= half_unit,
                "d = {d}, {method:?}: {got} %, known {percent} %"
            );
        }
    }
}

#[test]
fn refining_into_a_corner_is_of_first_order_only() {
    let exact = perpendicular_rectangles(1.0, 1.0, 1.0);
    let error = |n| {
        let e = perpendicular_plates(1.0, 1.0, n);
        half_to_half(&e, &matrix(&e, CENTRES[0])) / exact - 1.0
    };
    let errors = [1, 2, 4, 8, 16].map(error);
    // +59 %, +16 %, +4.2 % for n = 1, 4, 16; half a unit of the last digit.
    for (k, percent, half_unit) in [(0, 59.0, 0.5), (2, 16.0, 0.5), (4, 4.2, 0.05)] {
        assert!(
            (100.0 * errors[k] - percent).abs() <= half_unit,
            "{errors:?}"
        );
    }
    // O(h): the last halving of h halves the error. The share of touching cells is h, and each is
    // wrong by a fixed fraction.
    let order = (errors[3] / errors[4]).log2();
    assert!((order - 1.0).abs() < 0.05, "{order}");
}

#[test]
fn discs_are_reached_as_polygons_gain_sides() {
    let exact = reference::coaxial_discs(1.0, 1.0, 1.0);
    let error = |sides| {
        let e = coaxial_discs(sides);
        let m = matrix(
            &e,
            Method::Contour {
                tolerance: 1e-9,
                shadow_rays: 0,
            },
        );
        half_to_half(&e, &m) - exact
    };
    let errors = [6, 12, 24].map(error);
    // Polygons of the disc's area: the outline is off by O(1/sides²), inwards and outwards alike,
    // which cancels and leaves fourth order.
    for k in 0..2 {
        let order = (errors[k] / errors[k + 1]).abs().log2();
        assert!((order - 4.0).abs() < 0.2, "{errors:?}");
    }
    assert!(errors[2].abs() < 1e-5, "{errors:?}");
}

#[test]
fn inside_a_sphere_the_form_factor_is_the_area_share() {
    let errors = [1, 2].map(|level| {
        let e = sphere(1.0, level, true);
        let m = matrix(
            &e,
            Method::Contour {
                tolerance: 1e-8,
                shadow_rays: 0,
            },
        );
        let total: f64 = e.patches.iter().map(Patch::area).sum();
        let (mut difference, mut norm, mut far) = (0.0, 0.0, 0f64);
        for (i, p) in e.patches.iter().enumerate() {
            for (j, q) in e.patches.iter().enumerate() {
                // The facets' share of the total replaces that of the sphere's parts.
                let exact = sphere_interior(4.0 * PI * q.area() / total, 1.0);
                let f = m.row(i)[j];
                difference += (f - exact).powi(2);
                norm += exact * exact;
                if p.centre().dot(q.centre()) < 0.0 {
                    far = far.max((f / exact - 1.0).abs());
                }
            }
        }
        [(difference / norm).sqrt(), far]
    });
    // First order in the size of a facet. Facets of a subdivided icosahedron are not equilateral: a
    // facet's centroid is off the foot of its normal by a fixed fraction of its size, and so is the
    // cosine there. Near pairs that see each other only across the fold between two facets are each
    // wrong by a fixed fraction, but there are fewer of them as facets shrink. Measured: 0.131,
    // 0.067; 0.064, 0.033.
    for (coarse, fine) in errors[0].iter().zip(errors[1]) {
        let order = (coarse / fine).log2();
        assert!((order - 1.0).abs() < 0.1, "{errors:?}");
    }
    assert!(errors[1][0] < 0.068 && errors[1][1] < 0.034, "{errors:?}");
}

#[test]
fn concentric_spheres_exchange_by_their_areas() {
    let e = concentric_spheres(0.5, 1);
    let m = reference::reference_matrix(&e, 8).unwrap().matrix;
    let half = e.patches.len() / 2;
    let areas: Vec<f64> = e.patches.iter().map(Patch::area).collect();
    let (inner, outer): (f64, f64) = (areas[..half].iter().sum(), areas[half..].iter().sum());
    // All light that leaves a convex body arrives on the surface around it. The rest follows by
    // reciprocity, for facets as for spheres.
    let f12 = half_to_half(&e, &m);
    let back: f64 = (half..2 * half)
        .map(|i| areas[i] * m.row(i)[..half].iter().sum::<f64>())
        .sum();
    let f21 = back / outer;
    let f22: f64 = (half..2 * half)
        .map(|i| areas[i] * m.row(i)[half..].iter().sum::<f64>())
        .sum::<f64>()
        / outer;
    // The inner body is convex, so its rows have no shadow: contour tolerance, 80 patches of 1e-10.
    assert!((f12 - 1.0).abs() < 1e-8, "{f12}");
    assert!((f21 - inner / outer).abs() < 1e-8, "{f21}");
    // From outside, the smaller body's outline is a shadow edge: 8 × 8 points each, measured 9e-6.
    assert!((f22 - 1.0 + inner / outer).abs() < 2e-5, "{f22}");
}
