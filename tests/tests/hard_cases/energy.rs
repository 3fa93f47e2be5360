//! Energy balance through the pipeline: imbalances are reported.

use lumel_tests::geometry::grid;
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use lumel_tests::scenes::{self, closed_form};

use crate::common::{at, bake, bright, lumels_of, mean};

fn says(warnings: &[String], what: &str) -> bool {
    warnings.iter().any(|w| w.contains(what))
}

#[test]
fn every_report_balances_and_has_its_bound() {
    for glb in [
        scenes::cornell_box(),
        closed_form::sphere_interior(1.0, 0.7, 0.5, 2).0,
        closed_form::two_rooms(0.1),
    ] {
        let b = bake(&glb, &at(2.0));
        let (files, _) = b.files().expect("files");
        let report = &files.last().expect("the report").1;
        let report: serde_json::Value = serde_json::from_slice(report).expect("JSON");
        let audit = &report["solve"]["audit"];
        assert_eq!(audit["within_bound"], true, "{audit}");
        let number = |key: &str| audit[key].as_f64().expect("a number");
        assert!(
            number("imbalance").abs() <= number("bound") && number("bound") < 0.05,
            "{audit}"
        );
        let flux = |key: &str| audit[key][1].as_f64().expect("a number");
        let out = flux("flux_absorbed") + flux("flux_behind") + flux("flux_escaped");
        // The bound is for luminance, which is mostly green.
        assert!(
            (out / flux("flux_emitted") - 1.0).abs() < 2.0 * number("bound"),
            "{audit}"
        );
        for part in ["rays", "direct", "lamps", "residual", "rounding"] {
            assert!(audit["bounds"][part].as_f64().expect("a number") >= 0.0);
        }
    }
}

#[test]
fn reflectances_near_one_keep_all_light() {
    for rho in [0.99f32, 0.999] {
        let b = bake(&closed_form::cie_171_5_8(rho), &bright(at(3.0)));
        assert!(b.report.solve.relaxation.converged);
        let audit = &b.report.solve.audit;
        assert!(audit.within_bound, "{audit:?}");
        let m = mean(&lumels_of(&b, "room"));
        let exact = 10_000.0 / 96.0 / (1.0 - f64::from(rho));
        // Other columns undo a column's noise at the next reflection, so the error does not grow by
        // 1/(1 − ρ): absorbed equals emitted, within the audit's bound; half a per cent for lumels
        // that see patches.
        let off = (m / exact - 1.0).abs();
        assert!(off < audit.bound + 5e-3, "ρ {rho}: {m} {exact}, {audit:?}");
    }
}

#[test]
fn a_lamp_nearer_than_the_solve_resolves_is_named() {
    let b = bake(&closed_form::point_over_floor(1.0, 1e-4), &at(16.0));
    assert!(lumels_of(&b, "floor").iter().all(|l| l.red().is_finite()));
    let audit = &b.report.solve.audit;
    // Half of the light falls on some square millimetres that contain no element's point.
    assert!(
        !audit.within_bound && (0.3..0.6).contains(&audit.imbalance),
        "{audit:?}"
    );
    assert!(
        says(&b.report.warnings, "energy does not balance"),
        "{:?}",
        b.report.warnings
    );
}

#[test]
fn a_rug_in_the_floors_own_plane_is_named() {
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.5; 3]));
    let at_x = |x: f32| glam::Vec3::new(x, 0.0, x);
    for (name, from, size) in [("floor", 0.0, 2.0), ("rug", 0.3, 1.1)] {
        let g = grid(
            at_x(from),
            glam::Vec3::Z * size,
            glam::Vec3::X * size,
            [1, 1],
        )
        .bare();
        let mesh = b.mesh(name, &[(&g, white)]);
        b.node(Node::of_mesh(name, mesh));
    }
    let lamp = b.light("lamp", Light::Point([1.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: glam::Vec3::ONE,
        light: Some(lamp),
        ..Node::default()
    });
    let b = bake(&b.finish(), &at(8.0));
    assert!(b.report.solve.audit.imbalance < 0.0);
    assert!(
        says(&b.report.warnings, "energy does not balance"),
        "{:?}",
        b.report.warnings
    );
}

#[test]
fn light_lost_behind_faces_is_named_with_the_node() {
    // A lit room whose lamp hangs under a large single-sided tray, front up: most of the light goes
    // up into the tray, and none comes down; the floor sees the tray's black back.
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.7; 3]));
    let shell = lumel_tests::geometry::room(glam::Vec3::ZERO, glam::Vec3::splat(2.0), 1).bare();
    let mesh = b.mesh("room", &[(&shell, white)]);
    b.node(Node::of_mesh("room", mesh));
    let tray = grid(
        glam::Vec3::new(0.2, 1.5, 0.2),
        glam::Vec3::Z * 1.6,
        glam::Vec3::X * 1.6,
        [1, 1],
    );
    let mesh = b.mesh("tray", &[(&tray.bare(), white)]);
    b.node(Node::of_mesh("tray", mesh));
    let lamp = b.light("lamp", Light::Point([1.0; 3]));
    b.node(Node {
        name: "lamp".into(),
        translation: glam::Vec3::new(1.0, 1.0, 1.0),
        light: Some(lamp),
        ..Node::default()
    });
    let b = bake(&b.finish(), &at(8.0));
    let audit = &b.report.solve.audit;
    assert!(audit.within_bound, "{audit:?}");
    assert!(
        audit.flux_behind[0] > 0.2 * audit.flux_emitted[0],
        "{audit:?}"
    );
    assert_eq!(audit.beyond[0].node, "room");
    assert!(
        says(&b.report.warnings, "backfaces of single-sided materials"),
        "{:?}",
        b.report.warnings
    );
    assert!(says(&b.report.warnings, "room"), "{:?}", b.report.warnings);
}
