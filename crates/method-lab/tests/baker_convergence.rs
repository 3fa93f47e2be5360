//! The baker's errors converge as promised, and its solver's residual is within its bound.
//!
//! A series over three decades, with each point known to 6 % (128 receivers), gives its slope to
//! 0.01. The wider ranges below allow for promises that are asymptotic.

use method_lab::convergence::{
    CutErrors, Field, Promise, Series, cut_errors, direct_error, indirect_error, lit_error,
    rays_error, residual_and_error,
};

fn assert_order(name: &'static str, promise: (f64, bool), room: f64, points: Vec<(f64, f64)>) {
    let series = Series {
        study: "test",
        name,
        promise: Promise {
            order: promise.0,
            log: promise.1,
        },
        from: 0.0,
        points,
    };
    let (measured, promised) = (series.order(), series.promised_order());
    assert!(
        (measured - promised).abs() < room,
        "{name}: order {measured:.3}, promised {promised:.3}: {:?}",
        series.points
    );
}

#[test]
fn the_solve_converges_with_patches() {
    let cut = cut_errors(&Field::new(16), &[6, 8, 12], 4096);
    let size = |pick: fn(&CutErrors) -> f64| -> Vec<(f64, f64)> {
        cut.iter()
            .map(|c| (f64::from(c.patches), pick(c)))
            .collect()
    };
    // Over a factor of two in h, the next term of an expansion in h changes by the same factor: a
    // tenth of an order.
    assert_order("constant", (0.5, false), 0.1, size(|c| c.constant));
    assert_order("interpolated", (0.75, true), 0.1, size(|c| c.interpolated));
    assert_order("interior", (1.0, false), 0.15, size(|c| c.interior));
    // Not always the same point, so only: no slower than promised.
    let worst: Vec<_> = size(|c| c.worst);
    let fell = worst[0].1 / worst[2].1;
    assert!(fell > 2.0 * 6f64.ln() / 12f64.ln() * 0.9, "{worst:?}");
}

#[test]
fn the_solve_converges_with_rays() {
    let rays: Vec<u32> = (4..=12).map(|k| 1 << k).collect();
    // A step function in four dimensions (two for a ray's start, two for its direction),
    // Owen-scrambled: N^−5/8.
    assert_order("rays", (0.625, false), 0.08, rays_error(4, &rays));
}

#[test]
fn the_gather_converges_with_rays() {
    let rays: Vec<u32> = (5..=12).map(|k| 1 << k).collect();
    // A step function of the direction alone: N^−3/4.
    assert_order("point", (0.75, false), 0.08, indirect_error(1, &rays));
    // Sixteen points with a sixteenth of the rays each: between N^−1/2 and N^−3/4.
    assert_order("lumel", (0.625, false), 0.125, indirect_error(16, &rays));
}

#[test]
fn lit_elements_bring_no_more_and_no_less_than_they_reflect() {
    // 4 % of one wall is lit. Its form factor from a lumel is half a per cent, so one gathering ray
    // in 200 hits it.
    let [_, without] = lit_error(64, 0);
    let [bias, with] = lit_error(64, 1);
    // Three standard errors of the mean over 128 receivers, plus the error of elements as points.
    assert!(
        bias.abs() < 3.0 * with / 128f64.sqrt() + 0.002,
        "{bias} {with}"
    );
    // Sixteen samples all find it, while the estimate from 64 rays has a standard error of its own
    // size. Without the share that is left to those rays, it would be below a tenth.
    assert!(with < 0.25 * without, "{with} {without}");
    // Many gathering rays for each sample: they contribute most of the light, and nothing counts
    // twice.
    let [bias, with] = lit_error(4096, 1);
    assert!(
        bias.abs() < 3.0 * with / 128f64.sqrt() + 0.002,
        "{bias} {with}"
    );
}

#[test]
fn direct_light_converges_with_shadow_rays() {
    let rays: Vec<u32> = (2..=11).map(|k| 1 << k).collect();
    assert_order("point", (0.75, false), 0.08, direct_error(0.0, &rays));
    // The points of the lumel and those of the lamp are each stratified, but their pairs are
    // random, which leaves N^−1/2.
    assert_order("lumel", (0.5, false), 0.08, direct_error(0.1, &rays));
}

#[test]
fn the_solver_leaves_no_more_than_it_says() {
    const ROUNDING: f64 = 1.0 / (1u32 << 24) as f64; // solutions are kept as f32
    let tolerances: Vec<f64> = (0..=12).map(|k| 10f64.powf(-0.5 * f64::from(k))).collect();
    for rho in [0.5f32, 0.9] {
        for krylov in [false, true] {
            for s in residual_and_error(rho, krylov, &tolerances) {
                assert!(
                    s.error <= s.bound + ROUNDING,
                    "ρ {rho}, {}: {} left, bound {}",
                    if krylov { "Bi-CGSTAB" } else { "shooting" },
                    s.error,
                    s.bound
                );
            }
        }
    }
}
