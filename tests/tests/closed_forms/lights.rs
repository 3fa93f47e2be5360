//! Lamps over a black floor.

use glam::{DVec3, Vec3};
use lumel_tests::scenes::closed_form as scenes;

use super::{GOLDEN, HALF, SMOOTH};
use crate::common::{Seen, at, bake, lumels_of, mean, worst};

#[test]
fn a_point_light_over_a_floor() {
    for h in [2.0, 0.5] {
        let b = bake(&scenes::point_over_floor(10.0, h as f32), &at(24.0));
        let w = worst(&lumels_of(&b, "floor"), 0.0, |l| {
            l.mean(|p| scenes::point_irradiance(10.0, h, p.x.hypot(p.z)))
        });
        assert!(w < SMOOTH, "h {h}: {w}");
    }
}

#[test]
fn a_point_light_almost_on_the_floor_is_finite_and_right_elsewhere() {
    let h = 1e-4;
    let b = bake(&scenes::point_over_floor(1.0, h as f32), &at(16.0));
    let lumels = lumels_of(&b, "floor");
    assert!(lumels.iter().all(|l| l.red().is_finite()));
    // Away from the foot by five lumels; h = 1e-4 itself has 24 bits, 1e-7, but rays start about
    // 3e-6 above the floor.
    let far: Vec<_> = lumels
        .into_iter()
        .filter(|l| l.all(|p| p.x.hypot(p.z) > 0.3))
        .collect();
    let floor = scenes::point_irradiance(1.0, h, 1.5);
    let w = worst(&far, floor, |l| {
        l.mean(|p| scenes::point_irradiance(1.0, h, p.x.hypot(p.z)))
    });
    // 16 against 64 points of a function ∝ 1/r³ over 6 cm at 30 cm: its second-order term is
    // (0.06/0.3)² / 2 = 2 %.
    assert!(w < 0.02, "{w}");
}

#[test]
fn a_spot_light_inside_its_cone_and_out() {
    let (inner, outer, h) = (0.3f64, 0.6f64, 2.0f64);
    let b = bake(
        &scenes::spot_over_floor(10.0, h as f32, inner as f32, outer as f32),
        &at(16.0),
    );
    let cone = |p: DVec3| {
        let r = p.x.hypot(p.z);
        let cos = h / h.hypot(r);
        let x = ((cos - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
        x * x * scenes::point_irradiance(10.0, h, r)
    };
    let lumels = lumels_of(&b, "floor");
    // Near the rim the falloff is steep, and the mean of 16 points differs from that of 64; the
    // test excludes values below a fiftieth of the peak.
    let w = worst(&lumels, 10.0 / (h * h) / 50.0, |l| l.mean(cone));
    assert!(w < 0.03, "{w}");
    for l in &lumels {
        // A lumel's width beyond the rim.
        if l.all(|p| p.x.hypot(p.z) > h * outer.tan() + 0.07) {
            assert_eq!(l.red(), 0.0);
        }
    }
}

#[test]
fn sunlight_by_the_cosine() {
    for direction in [Vec3::NEG_Y, Vec3::new(1.0, -0.5, 0.3)] {
        let b = bake(&scenes::sun_over_floor(5.0, direction), &at(4.0));
        let exact = f64::from(5.0 * -direction.normalize().y);
        let w = worst(&lumels_of(&b, "floor"), 0.0, |_| exact);
        assert!(w < 1e-3, "{w}"); // half float twice over
    }
}

#[test]
fn a_rectangle_over_a_floor() {
    for (side, h) in [(1.0, 1.0), (0.2, 2.0), (2.0, 0.1)] {
        let b = bake(
            &scenes::rectangle_over_floor(3.0, side as f32, h as f32),
            &at(16.0),
        );
        let corners = scenes::square(side, h);
        let exact = |l: &Seen| l.mean(|p| scenes::polygon_irradiance(3.0, &corners, p, DVec3::Y));
        let lumels = lumels_of(&b, "floor");
        // The required 0.5 %: all light that arrives.
        let (sum, all) = lumels
            .iter()
            .fold((0.0, 0.0), |s, l| (s.0 + l.red(), s.1 + exact(l)));
        let off = sum / all - 1.0;
        assert!(off.abs() < GOLDEN, "side {side} height {h}: {off}");
        // Within two lumels of the lamp's edge, light falls off steeply if it hangs low.
        let w = worst(&lumels, 0.01, exact);
        let tolerance = if h < 0.5 { 0.05 } else { GOLDEN };
        assert!(w < tolerance, "side {side} height {h}: {w}");
    }
}

#[test]
fn a_point_light_from_afar_to_a_millimetre() {
    for h in [100.0, 10.0, 1.0, 0.1, 1e-2, 1e-3] {
        let b = bake(&scenes::point_over_floor(1000.0, h as f32), &at(16.0));
        let lumels = lumels_of(&b, "floor");
        let all = mean(&lumels) * 16.0;
        let exact = |p: DVec3| scenes::point_irradiance(1000.0, h, p.x.hypot(p.z));
        // If the lamp is farther than three lumels, the second-order term over a lumel is (1/3)²/2
        // = 6 % of E between its own points, of which the two sets of points differ by a quarter at
        // worst.
        let near = 3.0 / 16.0;
        let fair: Vec<_> = lumels
            .into_iter()
            .filter(|l| l.all(|p| p.x.hypot(p.z).hypot(h) > near))
            .collect();
        let w = worst(&fair, 0.0, |l| l.mean(exact));
        let tolerance = if h >= 1.0 { SMOOTH } else { 0.015 };
        // Below a millimetre of height, E at 2 m is 1e-4 of a nit, where half floats are still
        // exact to 2⁻¹¹ (down to 6e-5).
        assert!(w < tolerance, "h {h}: {w}");
        // All light that arrives: I × 4 atan(a²/(h √(2a² + h²))) for a square of half side a = 2.
        if h > near {
            let flux = 1000.0 * 4.0 * (4.0 / (h * (8.0 + h * h).sqrt())).atan();
            assert!((all / flux - 1.0).abs() < 2e-3, "h {h}: {all} {flux}");
        }
    }
}

#[test]
fn panels_of_every_aspect_over_a_floor() {
    for (a, b, h) in [
        (1.0, 1.0, 10.0),
        (0.1, 1.0, 1.0),
        (0.02, 2.0, 1.0),
        (2.0, 0.02, 0.3),
        (0.004, 0.4, 0.5),
    ] {
        let glb = scenes::panel_over_floor(50.0, a as f32, b as f32, h as f32);
        let bake = bake(&glb, &at(12.0));
        let (x, z) = (0.5 * a, 0.5 * b);
        let corners = [(-x, -z), (x, -z), (x, z), (-x, z)].map(|(x, z)| DVec3::new(x, h, z));
        let lumels = lumels_of(&bake, "floor");
        let peak = scenes::polygon_irradiance(50.0, &corners, DVec3::ZERO, DVec3::Y);
        let w = worst(&lumels, 1e-3 * peak, |l| {
            l.mean(|p| scenes::polygon_irradiance(50.0, &corners, p, DVec3::Y))
        });
        // A lumel of 8 cm seen from 30 cm: the second-order term is (0.08/0.3)²/2 = 3.5 %, of which
        // the two sets of points differ by a quarter.
        let tolerance = if h < 0.5 { 0.02 } else { SMOOTH };
        assert!(w < tolerance, "{a} × {b} at {h}: {w}");
    }
}

#[test]
fn discs_over_a_floor() {
    for (r, h) in [(1.0, 1.0), (0.1, 1.0), (0.5, 0.5), (0.3, 3.0)] {
        for sides in [24, 64] {
            let glb = scenes::disc_over_floor(5.0, r as f32, h as f32, sides);
            let lumels = lumels_of(&bake(&glb, &at(12.0)), "floor");
            let exact = |l: &Seen| l.mean(|p| scenes::disc_irradiance(5.0, r, h, p.x.hypot(p.z)));
            let w = worst(&lumels, 1e-3, exact);
            // A polygon with the disc's area differs from it by some (2π/n)²/12 of the light next
            // to the rim: 0.6 % and 0.1 %. Triangles share 64 points of the footprint, so that many
            // lamps cost little more than few: three each for 24. E changes by up to 1.4 per metre,
            // 12 % over a lumel, which is a spread of 3.4 %, or 2 % for three points; the worst of
            // some thousand lumels is 3.5 times that. Beyond 32 triangles, groups are sampled, with
            // 64 points in all: over a triangle from axis to rim the kernel falls to a quarter (r =
            // h), a spread of 30 %, or 4 % for 64 points. Single lumels are then noisy, and the
            // mean says more.
            if sides <= 32 {
                assert!(w < 0.07, "r {r}, h {h}, {sides} sides: {w}");
            }
            let sum = |f: &dyn Fn(&Seen) -> f64| lumels.iter().map(f).sum::<f64>();
            let bias = sum(&|l| l.red()) / sum(&exact) - 1.0;
            assert!(bias.abs() < 2e-3, "r {r}, h {h}, {sides} sides: {bias}");
            let squares = |l: &Seen| (l.red() - exact(l)).powi(2);
            let rms = (lumels.iter().map(squares).sum::<f64>()
                / lumels.iter().map(|l| exact(l).powi(2)).sum::<f64>())
            .sqrt();
            let noise = if sides > 32 { 0.04 } else { 0.02 };
            assert!(rms < noise, "r {r}, h {h}, {sides} sides: {rms}");
        }
    }
}

#[test]
fn sunlight_at_every_angle() {
    for degrees in [0.0f32, 30.0, 60.0, 85.0, 89.0, 89.9] {
        let (s, c) = degrees.to_radians().sin_cos();
        let direction = Vec3::new(s, -c, 0.0);
        let b = bake(&scenes::sun_over_floor(1000.0, direction), &at(4.0));
        let exact = 1000.0 * f64::from(c);
        // The node's rotation is a quaternion of f32, accurate to 1e-7 rad, compared with a cosine
        // of 1.7e-3 at the flattest: 6e-5.
        let w = worst(&lumels_of(&b, "floor"), 0.0, |_| exact);
        assert!(w < HALF + 1e-4, "{degrees}°: {w}");
    }
}
