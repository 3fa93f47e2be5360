//! Layouts of small scenes: charts, densities, rectangles.

mod common;

use atlas_bake::{Layout, LayoutError, LayoutOptions, LayoutReport, UvMode, UvOrigin, layout};
use common::*;
use glam::{DAffine3, DVec3, Vec2, Vec3};
use mesh_ingest::{Mesh, Scene, Soup};

fn at_density(texels_per_unit: f32) -> LayoutOptions {
    LayoutOptions {
        texels_per_unit: Some(texels_per_unit),
        ..LayoutOptions::default()
    }
}

fn lay_out(scene: &(Scene, Soup), options: &LayoutOptions) -> (Layout, LayoutReport) {
    let (result, report) = layout(&scene.0, &scene.1, options, &|_| true).expect("a layout");
    check_placements(&scene.0, &result);
    (result, report)
}

/// Lays one mesh out and checks everything that must hold of any generated atlas.
fn lay_out_lone(mesh: Mesh, options: &LayoutOptions) -> (Layout, LayoutReport) {
    let (result, report) = lay_out(&lone(mesh), options);
    check_generated(&result.meshes[0], options.padding);
    (result, report)
}

#[test]
fn a_rectangle_is_one_chart_on_whole_texels() {
    // 3.05 x 2 m at 10 lumels per metre: 30.5 x 20 texels, stretched to 31 x 20, and a texel all round.
    let (result, report) = lay_out_lone(plane(3.05, 2.0), &at_density(10.0));
    let atlas = &result.meshes[0];
    assert_eq!(report.meshes[0].charts, 1);
    let mut size = atlas.size;
    size.sort_unstable();
    assert_eq!(size, [22, 33]);
    assert_eq!(
        result.pages,
        vec![atlas.size],
        "a lone rectangle is the page"
    );
    for (c, _) in corners(atlas) {
        for p in c {
            assert_eq!(p, p.round(), "borders lie on texel borders");
        }
    }
    assert_eq!(atlas.primitives[0].xref, [0, 1, 2, 3], "nothing was split");
}

#[test]
fn a_box_has_six_charts_and_a_hard_edged_strip_none_across() {
    let (_, report) = lay_out_lone(cuboid(Vec3::new(4.0, 3.0, 5.0)), &at_density(8.0));
    assert_eq!(report.meshes[0].charts, 6);
    assert!(report.meshes[0].stretch < 1.001, "{:?}", report.meshes[0]);
}

#[test]
fn a_smooth_sphere_is_flattened_without_overlap_and_with_little_stretch() {
    let (_, report) = lay_out_lone(sphere(24, 2.0), &at_density(12.0));
    let m = &report.meshes[0];
    assert!(m.charts <= 16, "{m:?}");
    // 1 is an isometry; uvunwrap splits charts whose area is off by more than 4.
    assert!(m.stretch < 1.15, "{m:?}");
    assert!((m.density[1] - 12.0).abs() < 1.2, "{m:?}");
    assert_eq!(m.flipped, 0);
}

#[test]
fn a_sheet_and_its_modelled_back_are_one_chart_each() {
    // Two coincident grids of opposite winding that share all vertices: every inner edge has four triangles.
    let n = 8u32;
    let positions: Vec<Vec3> = (0..=n)
        .flat_map(|y| (0..=n).map(move |x| Vec3::new(x as f32, y as f32, 0.0)))
        .collect();
    let mut triangles = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            triangles.push([a, a + 1, a + n + 1]);
            triangles.push([a + 1, a + n + 2, a + n + 1]);
        }
    }
    let back: Vec<[u32; 3]> = triangles.iter().map(|t| [t[0], t[2], t[1]]).collect();
    triangles.extend(back);
    let (_, report) = lay_out_lone(mesh(positions, triangles), &at_density(4.0));
    assert_eq!(report.meshes[0].charts, 2);
}
