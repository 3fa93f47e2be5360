//! Closed rooms, in which the total light is known.

use std::f64::consts::PI;

use lumel::{Bake, Quality, Settings};
use lumel_tests::scenes::closed_form as scenes;
use lumel_tests::scenes::{FurnaceShape, furnace, sealed_dark_box};

use super::SMOOTH;
use crate::common::{at, bake, bright, lumels_of, mean, worst};

#[test]
fn furnaces_hold_the_same_light_everywhere() {
    for (shape, density) in [
        (FurnaceShape::Cube, 12.0),
        (FurnaceShape::Sphere, 12.0),
        (FurnaceShape::NonConvex, 6.0),
    ] {
        for rho in [0.5f32, 0.9] {
            let glb = furnace(rho, 1.0, shape);
            let b = bake(&glb, &at(density));
            let exact = PI / (1.0 - f64::from(rho));
            let scene = &b.loaded.scene;
            let names: Vec<String> = scene.instances.iter().map(|i| i.name.clone()).collect();
            for name in names {
                let w = worst(&lumels_of(&b, &name), 0.0, |_| exact);
                // The required bound. Rows sum to exactly 1, so energy could be lost only by rays
                // that leave through an edge.
                assert!(w < 0.01, "{shape:?} {rho}: {w}");
            }
            let audit = &b.report.solve.audit;
            assert_eq!(audit.rows_open, 0, "{shape:?}: rays escape");
            assert!(
                audit.imbalance.abs() < 1e-3,
                "{shape:?}: {}",
                audit.imbalance
            );
        }
    }
}

#[test]
fn a_furnace_of_reflectance_near_one_converges() {
    // Errors of the rows grow by 1/(1 − ρ) = 100; for 1 %, they and the residual must be below
    // 1e-4.
    let b = bake(&furnace(0.99, 1.0, FurnaceShape::Cube), &bright(at(4.0)));
    assert!(b.report.solve.relaxation.converged);
    let name = b.loaded.scene.instances[0].name.clone();
    let w = worst(&lumels_of(&b, &name), 0.0, |_| PI * 100.0);
    assert!(w < 0.01, "{w}");
}

#[test]
fn a_sealed_box_is_exactly_dark_inside() {
    for wall in [0.05, 0.001] {
        let b = bake(&sealed_dark_box(wall), &at(8.0));
        for l in lumels_of(&b, "dark_inside") {
            assert_eq!(l.irradiance, [0.0; 3], "wall {wall} m");
        }
        let bright = lumels_of(&b, "box_outside");
        assert!(bright.iter().any(|l| l.red() > 0.1), "the room is lit");
    }
}

#[test]
fn the_inside_of_a_sphere_is_lit_evenly_by_its_cap() {
    let rho = 0.5;
    let (glb, share) = scenes::sphere_interior(1.0, rho, 0.6, 3);
    let b = bake(&glb, &at(8.0));
    let exact = PI * share / (1.0 - f64::from(rho));
    let lumels = lumels_of(&b, "sphere");
    let mean = lumels
        .iter()
        .map(|l| l.red() * f64::from(l.coverage))
        .sum::<f64>()
        / lumels.iter().map(|l| f64::from(l.coverage)).sum::<f64>();
    // Facets instead of a sphere: angle between neighbours about 2π/50, squared 1.6 %, and a
    // quarter of that on the mean.
    assert!((mean / exact - 1.0).abs() < 0.005, "{mean} {exact}");
    let w = worst(&lumels, 0.0, |_| exact);
    // Where a dark facet's corner touches lit ones, tilted by up to 0.2 rad, each edge adds up to
    // πL (1 − cos 0.2)/2 = 5 % of E. This is correct for facets.
    assert!(w < 0.1, "{w}");
}

/// Draft quality for sweeps over means: fewer patches and rays, but exact results stay exact.
fn draft(density: f32) -> Settings {
    Settings {
        quality: Quality::Draft,
        ..at(density)
    }
}

/// Names of all nodes with geometry.
fn names(b: &Bake) -> Vec<String> {
    b.loaded
        .scene
        .instances
        .iter()
        .map(|i| i.name.clone())
        .collect()
}

#[test]
fn furnaces_of_every_reflectance() {
    for rho in [0.0f32, 0.1, 0.3, 0.7, 0.97, 0.999] {
        for shape in [FurnaceShape::Cube, FurnaceShape::NonConvex] {
            let b = bake(&furnace(rho, 0.1, shape), &bright(draft(3.0)));
            let exact = 0.1 * PI / (1.0 - f64::from(rho));
            for name in names(&b) {
                let w = worst(&lumels_of(&b, &name), 0.0, |_| exact);
                // Rows sum to exactly 1 and all patches are alike, so only relaxation (1e-4 of all
                // light) and half floats remain. 1 − ρ at 0.999 in f32 is accurate to 6e-8/1e-3.
                assert!(w < 2e-3, "{shape:?} {rho}: {w}");
            }
            let audit = &b.report.solve.audit;
            assert_eq!((audit.rows_open, audit.rows_beyond), (0, 0), "{audit:?}");
            assert!(audit.within_bound && audit.bound < 0.01, "{audit:?}");
            assert!(b.report.solve.relaxation.converged);
        }
    }
}

#[test]
fn a_reflectance_of_one_is_lowered_and_counted() {
    // A closed scene with ρ = 1 has no solution. The baker clamps to 0.98, and the report says so.
    let b = bake(&furnace(1.0, 0.01, FurnaceShape::Cube), &at(3.0));
    assert_eq!(b.report.clamped_materials, 1);
    let warned = |w: &String| w.contains("1 material reflects more than");
    assert!(b.report.warnings.iter().any(warned));
    let exact = 0.01 * PI / (1.0 - 0.98);
    let w = worst(&lumels_of(&b, &names(&b)[0]), 0.0, |_| exact);
    assert!(w < 2e-3, "{w}");
}

#[test]
fn spheres_lit_by_caps_of_every_size_and_reflectance() {
    for (cap, rho) in [
        (0.9, 0.0),
        (0.0, 0.8),
        (-0.7, 0.3),
        (0.6, 0.95),
        (0.6, 0.999),
    ] {
        let (glb, share) = scenes::sphere_interior(1.0, rho, cap, 3);
        let b = bake(&glb, &bright(draft(6.0)));
        let exact = PI * share / (1.0 - f64::from(rho));
        let m = mean(&lumels_of(&b, "sphere"));
        // As above, a quarter of 1.6 % for facets. At high ρ, all emitted light is absorbed,
        // whatever the facets.
        assert!(
            (m / exact - 1.0).abs() < 0.005,
            "cap {cap}, ρ {rho}: {m} {exact}"
        );
        assert!(b.report.solve.audit.within_bound);
    }
}

#[test]
fn a_cube_shares_the_light_of_its_ceiling_between_floor_and_walls() {
    let b = bake(&scenes::lit_cube(10.0), &at(24.0));
    for (name, f) in [("floor", 0.199_825), ("walls", 0.200_044)] {
        let m = mean(&lumels_of(&b, name));
        let exact = 10.0 * PI * f;
        // Gathered by 128 rays per lumel, over at least 576 lumels: 2/√(128·576) = 0.7 % if
        // unstratified, which is below SMOOTH.
        assert!((m / exact - 1.0).abs() < SMOOTH, "{name}: {m} {exact}");
    }
    assert_eq!(b.report.solve.audit.row_sum_min, 1.0);
    let dark = lumels_of(&b, "ceiling");
    assert!(
        dark.iter().all(|l| l.red() == 0.0),
        "nothing shines on the lamp"
    );
}

#[test]
fn concentric_spheres_of_every_ratio() {
    for (r, rho) in [(0.1, 0.0), (0.5, 0.0), (0.5, 0.5), (0.9, 0.5), (0.5, 0.99)] {
        let (glb, a) = scenes::concentric_spheres(1.0, r, rho);
        let b = bake(&glb, &bright(draft(8.0)));
        let rho = f64::from(rho);
        let outer = PI * a / (1.0 - rho * (1.0 - a));
        for (name, exact) in [("outer", outer), ("inner", rho * outer)] {
            let m = mean(&lumels_of(&b, name));
            // Facets again: 1280 each, 1.6 % and a quarter of that; the ratio of areas is that of
            // the facets. The light that returns to the inner sphere comes from patches whose
            // direct light is drawn with one ray from 1280 lamps in a few groups: measured −1.0 to
            // +0.4 %.
            let tolerance = if name == "inner" { 0.02 } else { 0.006 };
            let off = (m - exact).abs();
            assert!(
                off <= tolerance * exact,
                "r {r}, ρ {rho}, {name}: {m} {exact}"
            );
        }
        assert!(b.report.solve.audit.within_bound);
    }
}
