//! Plates that face each other or share an edge.

use std::f64::consts::PI;

use lumel::{Quality, Settings};
use lumel_tests::scenes::closed_form as scenes;

use super::SMOOTH;
use crate::common::{at, bake, bright, lumels_of, mean};

#[test]
fn plates_that_face_each_other_down_to_a_micrometre() {
    for gap in [1.0, 0.1, 1e-3, 1e-5] {
        let b = bake(&scenes::facing_plates(2.0, gap as f32), &at(16.0));
        let lumels = lumels_of(&b, "plate");
        let mean = lumels
            .iter()
            .map(|l| l.red() * f64::from(l.coverage))
            .sum::<f64>()
            / lumels.iter().map(|l| f64::from(l.coverage)).sum::<f64>();
        let exact = 2.0 * PI * scenes::form_factor_opposed_squares(gap);
        assert!(
            (mean / exact - 1.0).abs() < SMOOTH,
            "gap {gap}: {mean} {exact}"
        );
    }
}

#[test]
fn opposed_plates_of_every_distance_and_aspect() {
    for sides in [[1.0, 1.0], [0.1, 10.0], [3.0, 0.3]] {
        for gap in [1.0, 0.1, 1e-2, 1e-4] {
            let glb = scenes::opposed_plates(100.0, sides, gap as f32, [0.0; 2]);
            let b = bake(&glb, &fine(8.0));
            let m = mean(&lumels_of(&b, "plate"));
            let [x, y] = sides.map(f64::from);
            let exact = 100.0 * PI * scenes::form_factor_opposed(x, y, gap);
            // A closed form at 16 points of each lumel: if the lamp's rim crosses a lumel, half of
            // it is lit. The mean over hundreds is as accurate as SMOOTH; if the gap is small, so
            // is the share of such lumels. Gathering rays find lamps that are a quarter of the
            // scene: fewest hit at [0.1, 10] and 1, some 80 lumels × 4096 rays × F = 0.047, so
            // 15,000 rays, i.e. 0.8 % if they were random.
            let off = (m / exact - 1.0).abs();
            assert!(off < SMOOTH, "{sides:?} at {gap}: {m} {exact}");
        }
    }
}

#[test]
fn opposed_plates_far_apart() {
    // At a distance of ten, F is 0.0032, and gathering rays find the lamp: 64 lumels × 4096 rays ×
    // F = 840 hits, 3.4 % if they were random; three times that. (When lumels whose first rays
    // found nothing stopped there, only a quarter of the light remained.)
    let glb = scenes::opposed_plates(100.0, [1.0, 1.0], 10.0, [0.0; 2]);
    let m = mean(&lumels_of(&bake(&glb, &fine(8.0)), "plate"));
    let exact = 100.0 * PI * scenes::form_factor_opposed(1.0, 1.0, 10.0);
    assert!((m / exact - 1.0).abs() < 0.1, "{m} {exact}");
}

/// `production` at a density.
fn fine(texels_per_unit: f32) -> Settings {
    Settings {
        quality: Quality::Production,
        ..at(texels_per_unit)
    }
}

#[test]
fn plates_a_micrometre_apart_are_lit_or_dark_but_never_wrong() {
    // At coordinates of 0.5 m, 1e-6 m is about the offset of rays from the surface (at least 7e-7
    // m). The lamp's light has a closed form, so the value is correct if the receiver can be
    // distinguished from the lamp; otherwise light is missing, never invented.
    let b = bake(
        &scenes::opposed_plates(2.0, [1.0, 1.0], 1e-6, [0.0; 2]),
        &at(16.0),
    );
    let full = 2.0 * PI;
    for l in lumels_of(&b, "plate") {
        assert!(
            l.red().is_finite() && l.red() <= full * (1.0 + SMOOTH),
            "{}",
            l.red()
        );
        if l.all(|p| p.x.abs() < 0.45 && p.z.abs() < 0.45) {
            assert!(
                (l.red() / full - 1.0).abs() < SMOOTH,
                "{} at {}",
                l.red(),
                l.points[0]
            );
        }
    }
}

#[test]
fn perpendicular_plates_of_every_aspect() {
    for (w, h) in [
        (1.0, 1.0),
        (1.0, 0.1),
        (0.1, 1.0),
        (1.0, 0.01),
        (1.0, 10.0),
        (4.0, 0.5),
    ] {
        let glb = scenes::perpendicular_plates(10.0, w as f32, h as f32);
        let b = bake(&glb, &at(32.0));
        let m = mean(&lumels_of(&b, "plate"));
        let exact = 10.0 * PI * scenes::form_factor_perpendicular(w, h);
        // Along the common edge, E rises to πL/2 within the wall's height. Lumels of 3 cm average
        // that over 16 points each, so the light of a wall of 1 cm is in one row of 32 lumels,
        // whose means scatter by 1/√(16·32) of a peaked function, about 4 %.
        let tolerance = if h < 0.05 { 0.1 } else { SMOOTH };
        assert!(
            (m / exact - 1.0).abs() < tolerance,
            "w {w}, h {h}: {m} {exact}"
        );
    }
}

#[test]
fn infinite_plates_reflect_for_ever() {
    for rho in [0.0, 0.5, 0.9, 0.99] {
        let glb = scenes::opposed_plates(1.0, [2.0, 2.0], 1e-3, [rho; 2]);
        let b = bake(&glb, &bright(at(8.0)));
        let exact = PI / (1.0 - f64::from(rho * rho));
        for (name, e) in [("plate", exact), ("lamp", f64::from(rho) * exact)] {
            for l in lumels_of(&b, name) {
                if l.all(|p| p.x.abs() < 0.5 && p.z.abs() < 0.5) {
                    // At each of 1/(1 − ρ²) reflections before it is absorbed, light moves by a gap
                    // or two, in total by √(1/(1 − ρ²)) gaps, a hundredth of the half metre to the
                    // rim at ρ = 0.99. But it moves over patches of 4 cm, which lose what their rim
                    // loses: some 1e-3/0.04 of each rim patch, which spreads inwards.
                    let tolerance = if rho > 0.95 { 0.03 } else { 0.01 };
                    let off = (l.red() - e).abs();
                    assert!(
                        off <= tolerance * e + 1e-6,
                        "ρ {rho}, {name}: {} {e}",
                        l.red()
                    );
                }
            }
        }
        assert!(
            b.report.solve.audit.within_bound,
            "{rho} {:?}",
            b.report.solve
        );
    }
}
