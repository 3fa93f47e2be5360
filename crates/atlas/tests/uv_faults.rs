//! Faults of an asset's own TEXCOORD_1: a mesh with each fault, the reported place, and the
//! consequence.

use crate::common::*;
use atlas::{LayoutOptions, MeshReport, Severity, UvFault, UvFaultKind, UvMode, UvOrigin, layout};
use glam::{Vec2, Vec3};
use mesh_ingest::Mesh;

/// Quads of one metre in the plane z = 0, one metre apart, each with its own coordinates, in one
/// primitive.
fn quads(uv: &[[Vec2; 4]]) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..uv.len() as u32 {
        let x = 2.0 * i as f32;
        positions.extend([
            Vec3::new(x, 0.0, 0.0),
            Vec3::new(x + 1.0, 0.0, 0.0),
            Vec3::new(x + 1.0, 1.0, 0.0),
            Vec3::new(x, 1.0, 0.0),
        ]);
        triangles.extend([[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
    }
    let mut mesh = mesh(positions, triangles);
    mesh.primitives[0].tex_coords = vec![Vec::new(), uv.concat()];
    mesh
}

/// A square of the atlas, in the corner order of `quads` with v up.
fn square(u: f32, v: f32, side: f32) -> [Vec2; 4] {
    [
        Vec2::new(u, v),
        Vec2::new(u + side, v),
        Vec2::new(u + side, v + side),
        Vec2::new(u, v + side),
    ]
}

fn report_of(mesh: Mesh, texels_per_unit: f32, uv_mode: UvMode) -> (MeshReport, Vec<String>) {
    let (scene, soup) = lone(mesh);
    let options = LayoutOptions {
        texels_per_unit: Some(texels_per_unit),
        uv_mode,
        ..LayoutOptions::default()
    };
    let (_, report) = layout(&scene, &soup, &options, &|_| true).expect("a layout");
    (report.meshes[0].clone(), report.warnings)
}

#[track_caller]
fn fault(report: &MeshReport, kind: UvFaultKind) -> UvFault {
    let found = report.uv_faults.iter().find(|f| f.kind == kind);
    found
        .unwrap_or_else(|| panic!("no {kind:?} in {:?}", report.uv_faults))
        .clone()
}

#[track_caller]
fn replaced(report: &MeshReport) -> &str {
    match &report.origin {
        UvOrigin::Replaced { why } => why,
        other => panic!("{other:?}: {:?}", report.uv_faults),
    }
}

#[test]
fn sound_coordinates_have_no_fault() {
    let mesh = quads(&[square(0.05, 0.05, 0.4), square(0.55, 0.05, 0.4)]);
    let (report, warnings) = report_of(mesh, 50.0, UvMode::Auto);
    assert_eq!(
        (&report.origin, &report.uv_faults[..]),
        (&UvOrigin::Kept, &[][..])
    );
    assert_eq!(warnings, [""; 0]);
}

#[test]
fn an_overlap_is_replaced_and_its_place_told() {
    // The second quad covers a quarter of the first: (0.3, 0.3) to (0.5, 0.5).
    let mesh = || quads(&[square(0.1, 0.1, 0.4), square(0.3, 0.3, 0.4)]);
    let (report, warnings) = report_of(mesh(), 50.0, UvMode::Auto);
    let found = fault(&report, UvFaultKind::Overlap);
    assert_eq!(found.severity, Severity::Bad);
    // 0.04 of 0.28, on a grid of 256 × 256 (102 texels per side): whole rows of centres.
    assert!((found.share - 1.0 / 7.0).abs() < 0.01, "{found:?}");
    let worst = found.worst.expect("a place");
    let [u, v] = worst.uv.expect("finite");
    assert!(
        (0.3..0.5).contains(&u) && (0.3..0.5).contains(&v),
        "{worst:?}"
    );
    assert!(worst.triangle == 2 || worst.triangle == 3, "{worst:?}");
    assert_eq!(replaced(&report), found.message);
    assert!(
        warnings[0].contains("mesh 0") && warnings[0].contains("node 0"),
        "{warnings:?}"
    );
    assert!(warnings[0].contains("triangle 2") || warnings[0].contains("triangle 3"));
    // `Keep` keeps them with a warning.
    let (report, warnings) = report_of(mesh(), 50.0, UvMode::Keep);
    assert_eq!(report.origin, UvOrigin::Kept);
    assert!(
        warnings[0].contains("kept, but triangles overlap"),
        "{warnings:?}"
    );
}

#[test]
fn coordinates_out_of_range_or_not_finite_are_never_kept() {
    let outside = || quads(&[square(0.1, 0.1, 0.4), square(0.8, 0.1, 0.4)]);
    let mut nan = outside();
    nan.primitives[0].tex_coords[1][6] = Vec2::new(f32::NAN, 0.2);
    for mode in [UvMode::Auto, UvMode::Keep] {
        let (report, _) = report_of(outside(), 50.0, mode);
        let found = fault(&report, UvFaultKind::OutOfRange);
        assert_eq!((found.severity, found.triangles), (Severity::Unusable, 2));
        let worst = found.worst.expect("a place");
        assert_eq!((worst.primitive, worst.triangle), (0, 2));
        assert!(
            (worst.uv.expect("finite")[0] - 1.2).abs() < 1e-6,
            "{worst:?}"
        );
        replaced(&report);

        let (report, _) = report_of(nan.clone(), 50.0, mode);
        let found = fault(&report, UvFaultKind::NotFinite);
        assert_eq!(found.severity, Severity::Unusable);
        // Vertex 6 is the third corner of quad 1, which both of its triangles have.
        assert_eq!(
            (found.triangles, found.worst.map(|w| w.triangle)),
            (2, Some(2))
        );
        replaced(&report);
    }
}

#[test]
fn a_primitive_without_the_set_makes_all_of_it_unusable() {
    let mut mesh = quads(&[square(0.1, 0.1, 0.4)]);
    let mut bare = quads(&[square(0.5, 0.5, 0.4)]).primitives.remove(0);
    bare.tex_coords.clear();
    bare.gltf_primitive = 7;
    for p in &mut bare.positions {
        p.z += 1.0;
    }
    mesh.primitives.push(bare);
    let (report, _) = report_of(mesh, 20.0, UvMode::Keep);
    let found = fault(&report, UvFaultKind::Missing);
    assert_eq!(found.worst.map(|w| (w.primitive, w.triangle)), Some((7, 0)));
    replaced(&report);
}

#[test]
fn surface_without_area_in_the_atlas_is_told_with_its_share() {
    let mesh = quads(&[square(0.1, 0.1, 0.8), [Vec2::splat(0.95); 4]]);
    let (report, _) = report_of(mesh, 20.0, UvMode::Auto);
    let found = fault(&report, UvFaultKind::Collapsed);
    assert_eq!((found.severity, found.triangles), (Severity::Bad, 2));
    assert!((found.share - 0.5).abs() < 1e-6, "{found:?}");
    replaced(&report);
}

#[test]
fn charts_too_near_for_the_size_are_replaced_at_that_size_only() {
    // 1 % of the atlas apart. Quads are 0.49 of it wide, so at 100 lumels per metre the gap is two
    // texels, at 10 a fifth.
    let mesh = || quads(&[square(0.0, 0.0, 0.49), square(0.5, 0.0, 0.49)]);
    let (report, _) = report_of(mesh(), 100.0, UvMode::Auto);
    assert_eq!(report.uv_faults, []);
    let (report, _) = report_of(mesh(), 10.0, UvMode::Auto);
    replaced(&report);
    let (report, warnings) = report_of(mesh(), 10.0, UvMode::Keep);
    let found = fault(&report, UvFaultKind::Close);
    assert_eq!(
        (found.severity, &report.origin),
        (Severity::Bad, &UvOrigin::Kept)
    );
    // Half a texel, plus the grid's resolution, along one of each quad's four sides of ten texels.
    assert!((0.04..0.12).contains(&found.share), "{found:?}");
    let [u, v] = found.worst.and_then(|w| w.uv).expect("a place");
    assert!(
        (0.4..0.6).contains(&u) && (0.0..0.5).contains(&v),
        "{found:?}"
    );
    assert!(warnings[0].contains("too close"), "{warnings:?}");
}

#[test]
fn triangles_in_cells_thinner_than_a_texel_are_unwrapped_anew() {
    // A column of 32 quads, each in a row of its own, as Blender's *Lightmap Pack* makes them. At 2
    // lumels per metre, rows are half a texel high; at 64, 16 texels.
    let rows: Vec<[Vec2; 4]> = (0..32)
        .map(|k| {
            let v = k as f32 / 32.0;
            [[0.0, v], [0.9, v], [0.9, v + 0.028], [0.0, v + 0.028]].map(Vec2::from)
        })
        .collect();
    let (report, _) = report_of(quads(&rows), 2.0, UvMode::Auto);
    assert!(replaced(&report).contains("too close"), "{report:?}");
    let found = fault(&report, UvFaultKind::Close);
    assert_eq!(found.severity, Severity::Bad);
    let (report, _) = report_of(quads(&rows), 2.0, UvMode::Keep);
    assert_eq!(report.origin, UvOrigin::Kept);
    let (report, _) = report_of(quads(&rows), 64.0, UvMode::Auto);
    assert_eq!(report.origin, UvOrigin::Kept, "{report:?}");
}

#[test]
fn charts_that_go_on_in_space_and_atlas_are_not_too_near() {
    // Two halves of a floor as two primitives, adjacent both in the atlas and in space.
    let mut mesh = quads(&[square(0.0, 0.0, 0.5)]);
    let mut right = quads(&[square(0.5, 0.0, 0.5)]).primitives.remove(0);
    for p in &mut right.positions {
        p.x += 1.0;
    }
    right.gltf_primitive = 1;
    mesh.primitives.push(right);
    let (report, _) = report_of(mesh, 10.0, UvMode::Auto);
    assert_eq!(
        (&report.origin, &report.uv_faults[..]),
        (&UvOrigin::Kept, &[][..])
    );
}

#[test]
fn a_density_that_varies_more_than_fourfold_is_warned_about() {
    let with = |side: f32| {
        let mesh = quads(&[
            square(0.0, 0.0, 0.4),
            square(0.5, 0.0, 0.4),
            square(0.8, 0.8, side),
        ]);
        report_of(mesh, 60.0, UvMode::Auto).0
    };
    assert_eq!(with(0.11).uv_faults, [], "3.6 times");
    let report = with(0.08);
    let found = fault(&report, UvFaultKind::Uneven);
    assert_eq!(
        (found.severity, &report.origin),
        (Severity::Warning, &UvOrigin::Kept)
    );
    assert!(found.message.contains("factor of 5.0"), "{}", found.message);
    // The worst place has too few lumels.
    assert!(found.worst.is_some_and(|w| w.triangle >= 4), "{found:?}");
    let [least, _, most] = report.density;
    assert!((most / least - 5.0).abs() < 1e-3, "{:?}", report.density);
}

#[test]
fn mirrored_charts_are_a_note_and_kept() {
    let mut turned = square(0.55, 0.05, 0.4);
    turned.reverse();
    let mesh = quads(&[square(0.05, 0.05, 0.4), square(0.05, 0.55, 0.4), turned]);
    let (report, warnings) = report_of(mesh, 50.0, UvMode::Auto);
    let found = fault(&report, UvFaultKind::Mirrored);
    assert_eq!((found.severity, found.triangles), (Severity::Note, 2));
    assert_eq!(found.worst.map(|w| w.triangle), Some(4));
    assert_eq!((&report.origin, &warnings[..]), (&UvOrigin::Kept, &[][..]));
}
