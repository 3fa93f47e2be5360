//! Layouts of small scenes: charts, densities, rectangles.

use crate::common::*;
use atlas::{Layout, LayoutError, LayoutOptions, LayoutReport, UvMode, UvOrigin, layout};
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

/// Lays out one mesh and checks the invariants of any generated atlas.
fn lay_out_lone(mesh: Mesh, options: &LayoutOptions) -> (Layout, LayoutReport) {
    let (result, report) = lay_out(&lone(mesh), options);
    check_generated(&result.meshes[0], options.padding);
    (result, report)
}

#[test]
fn a_rectangle_is_one_chart_on_whole_texels() {
    // 3.05 × 4 m at 10 lumels per metre is 30.5 × 40 texels; with one texel all round 32.5 × 42, in
    // whole blocks of 4. At 22 lumels per metre both sides exceed 64 texels, so borders are aligned
    // to texel borders.
    let (small, _) = lay_out_lone(plane(3.05, 4.0), &at_density(10.0));
    let mut size = small.meshes[0].size;
    size.sort_unstable();
    assert_eq!(
        size,
        [32, 44],
        "30.5 texels read 32 from a texel's border to a middle"
    );
    let (result, report) = lay_out_lone(plane(3.05, 4.0), &at_density(22.0));
    let atlas = &result.meshes[0];
    assert_eq!(report.meshes[0].charts, 1);
    let mut size = atlas.size;
    size.sort_unstable();
    assert_eq!(size, [72, 92], "68 x 88, and a texel all round");
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

/// The side of a barrel: twelve staves, 0.5 m wide where the profile's radius is 1, that meet at
/// 30°. `profile` has a height in metres and a radius for each ring.
fn barrel(profile: &[(f32, f32)], smooth: bool) -> Mesh {
    let rings = profile.len() as u32;
    let out = |i: u32| Vec3::X.rotate_y(std::f32::consts::TAU * i as f32 / 12.0);
    let radius = 0.25 / (std::f32::consts::PI / 12.0).sin();
    let at = |i: u32| {
        let ring = move |&(y, r): &(f32, f32)| out(i) * radius * r + y * Vec3::Y;
        profile.iter().map(ring)
    };
    let positions: Vec<Vec3> = (0..12).flat_map(at).collect();
    let stave = |i: u32| {
        (0..rings - 1).flat_map(move |k| {
            let [a, b] = [rings * i + k, rings * ((i + 1) % 12) + k];
            [[a, b, b + 1], [a, b + 1, a + 1]]
        })
    };
    let mut barrel = mesh(positions, (0..12).flat_map(stave).collect());
    if smooth {
        let around = |i| std::iter::repeat_n(out(i), rings as usize);
        barrel.primitives[0].normals = (0..12).flat_map(around).collect();
    }
    barrel
}

#[test]
fn facets_are_charts_where_they_are_shaded_hard_and_not_tiny() {
    let charts = |smooth, density| {
        let sides = barrel(&[(0.0, 1.0), (1.5, 1.0)], smooth);
        let (_, report) = lay_out_lone(sides, &at_density(density));
        report.meshes[0].charts
    };
    // A stave has 12, 2.4 and 1.7 lumels.
    assert_eq!(
        [4.0, 1.8, 1.5].map(|density| charts(false, density)),
        [12, 12, 1]
    );
    assert_eq!(
        [4.0, 1.8, 1.5].map(|density| charts(true, density)),
        [1, 1, 1]
    );
}

#[test]
fn small_facets_join_no_large_ones() {
    // Staves of 12 lumels with rims of 0.4 at 16°, which meet each other and the staves at creases
    // too. Each rim belongs to its stave, and the staves stay apart.
    let drum = barrel(
        &[(0.0, 0.985), (0.05, 1.0), (1.55, 1.0), (1.6, 0.985)],
        false,
    );
    let (_, report) = lay_out_lone(drum, &at_density(4.0));
    assert_eq!(report.meshes[0].charts, 12);
}

#[test]
fn a_smooth_sphere_is_flattened_without_overlap_and_with_little_stretch() {
    let (_, report) = lay_out_lone(sphere(24, 2.0), &at_density(12.0));
    let m = &report.meshes[0];
    assert!(m.charts <= 16, "{m:?}");
    // 1 is an isometry; charts are cut above a stretch of 1.1, and density varies within them.
    assert!(m.stretch < 1.15, "{m:?}");
    assert!((m.density[1] - 12.0).abs() < 1.2, "{m:?}");
    assert_eq!(m.flipped, 0);
}

#[test]
fn a_sheet_and_its_modelled_back_are_one_chart_each() {
    // Two coincident grids of opposite winding that share all vertices: every inner edge has four
    // triangles.
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

#[test]
fn equal_charts_are_packed_into_a_square_rather_than_a_strip() {
    let (result, report) = lay_out_lone(cuboid(Vec3::splat(1.0)), &at_density(64.0));
    let [w, h] = result.meshes[0].size;
    assert!(w.max(h) <= 2 * w.min(h), "{w} x {h}");
    assert!(report.coverage > 0.85, "{}", report.coverage);
}

#[test]
fn primitives_are_flattened_together_and_never_share_a_chart() {
    // Two halves of a floor as two primitives with separate vertices.
    let mut floor = plane(2.0, 2.0);
    let mut other = plane(2.0, 2.0).primitives.remove(0);
    for p in &mut other.positions {
        p.x += 2.0;
    }
    floor.primitives.push(other);
    let (result, report) = lay_out_lone(floor, &at_density(10.0));
    assert_eq!(report.meshes[0].charts, 2);
    let [a, b] = [0, 1].map(|i| result.meshes[0].primitives[i].chart[0]);
    assert_ne!(a, b);
    assert_eq!(result.meshes[0].primitives[1].xref, [0, 1, 2, 3]);
}

#[test]
fn a_moebius_strip_and_loose_triangles_are_laid_out_without_overlap() {
    let (_, report) = lay_out_lone(moebius(64), &at_density(20.0));
    assert!(
        report.meshes[0].charts >= 2,
        "not orientable, so at least one cut"
    );
    let (_, report) = lay_out_lone(loose_triangles(3000), &at_density(10.0));
    assert_eq!(report.meshes[0].charts, 3000);
}

#[test]
fn padding_is_kept_at_every_width() {
    for padding in 0..=16 {
        let options = LayoutOptions {
            padding,
            ..at_density(5.0)
        };
        lay_out_lone(cuboid(Vec3::new(2.0, 3.0, 4.7)), &options);
        lay_out_lone(sphere(10, 1.3), &options);
    }
}

#[test]
fn blocks_are_kept_by_rectangles_pages_and_charts() {
    for (block, padding) in [(4, 2), (8, 0), (4, 5), (3, 1), (1, 2)] {
        let options = LayoutOptions {
            padding,
            block,
            block_charts: true,
            ..at_density(5.0)
        };
        for mesh in [cuboid(Vec3::new(2.0, 3.0, 4.7)), sphere(10, 1.3)] {
            let (result, _) = lay_out(&lone(mesh), &options);
            check_blocks(&result.meshes[0], padding, i64::from(block));
        }
        let case = scene(
            vec![cuboid(Vec3::new(2.0, 3.0, 4.7)), sphere(10, 1.3)],
            (0..9)
                .map(|i| (i % 2, at(f64::from(i as u32) * 5.0, 0.0, 0.0)))
                .collect(),
        );
        let options = LayoutOptions {
            block_charts: false,
            ..options
        };
        let (result, _) = lay_out(&case, &options);
        let whole = |x: &u32| x.is_multiple_of(block);
        assert!(
            result.pages.iter().flatten().all(whole),
            "{:?}",
            result.pages
        );
        for p in &result.placements {
            assert!(
                [p.rect.x, p.rect.y, p.rect.w, p.rect.h].iter().all(whole),
                "{p:?}"
            );
        }
    }
}

#[test]
fn coplanar_pieces_that_share_parts_of_edges_become_one_chart() {
    // A floor of one large and three small slabs that only share the outer vertices; 0.4 m is two
    // lumels.
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for [x, z, w, d] in [
        [0.0, 0.0, 0.4, 1.2],
        [0.4, 0.0, 0.4, 0.3],
        [0.4, 0.3, 0.4, 0.5],
        [0.4, 0.8, 0.4, 0.4],
    ] {
        let first = positions.len() as u32;
        let p = |i: f32, j: f32| Vec3::new(x + i * w, 0.0, z + j * d);
        positions.extend([p(0.0, 0.0), p(0.0, 1.0), p(1.0, 1.0), p(1.0, 0.0)]);
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    let (result, report) = lay_out_lone(mesh(positions, triangles), &at_density(5.0));
    assert_eq!(report.meshes[0].charts, 1);
    // The pieces are placed as in space: distances between their corners are preserved.
    let atlas = &result.meshes[0].primitives[0];
    let uv = |v: u32| atlas.uv[atlas.xref.iter().position(|&x| x == v).expect("a copy")];
    let flat = uv(0).distance(uv(14));
    assert!((flat - 5.0 * (0.64f32 + 1.44).sqrt()).abs() < 0.2, "{flat}");
}

#[test]
fn a_ring_is_cut_rather_than_laid_around_nothing() {
    let n = 64;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..n {
        let a = std::f32::consts::TAU * i as f32 / n as f32;
        for r in [19.0, 20.0] {
            positions.push(Vec3::new(r * a.cos(), 0.0, r * a.sin()));
        }
        let [a, b] = [2 * i, 2 * i + 1];
        let [c, d] = [(2 * i + 2) % (2 * n), (2 * i + 3) % (2 * n)];
        triangles.extend([[a, c, b], [b, c, d]]);
    }
    let (_, report) = lay_out_lone(mesh(positions, triangles), &at_density(10.0));
    // In one piece it covers 1 - 0.95² of a disc: 8 % of the page.
    assert!(report.coverage > 0.4, "{}", report.coverage);
    assert!(report.meshes[0].charts > 1);
}

#[test]
fn a_non_uniformly_scaled_instance_gets_charts_of_its_world_shape() {
    // A unit square stretched to 8 × 2 m, rotated and mirrored: 80 × 20 lumels.
    let transform = DAffine3::from_rotation_y(0.7)
        * DAffine3::from_scale(DVec3::new(-8.0, 3.0, 2.0))
        * DAffine3::from_translation(DVec3::new(5.0, 1.0, -3.0));
    let case = scene(vec![plane(1.0, 1.0)], vec![(0, transform)]);
    let (result, report) = lay_out(&case, &at_density(10.0));
    let mut size = result.meshes[0].size;
    size.sort_unstable();
    // 80 × 20 plus what lookups read beyond: one texel in total, or one on either side.
    assert_eq!(size, [24, 84]);
    assert!((report.meshes[0].density[1] - 10.0).abs() < 0.01);
    check_generated(&result.meshes[0], 2);
}

#[test]
fn a_mesh_has_the_same_coordinates_in_any_scene_and_for_any_thread_count() {
    let options = at_density(9.0);
    let alone = lay_out(&lone(sphere(16, 1.0)), &options).0;
    let many = scene(
        vec![cuboid(Vec3::ONE), sphere(16, 1.0)],
        vec![
            (0, at(3.0, 0.0, 0.0)),
            (1, at(-7.0, 2.0, 1.0) * DAffine3::from_rotation_x(1.1)),
            (1, at(9.0, 9.0, 9.0)),
        ],
    );
    let pool = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool")
    };
    let one = pool(1).install(|| lay_out(&many, &options));
    let four = pool(4).install(|| lay_out(&many, &options));
    assert_eq!(format!("{:?}", one.0), format!("{:?}", four.0));
    assert_eq!(one.1, four.1);
    assert_eq!(
        format!("{:?}", alone.meshes[0].primitives),
        format!("{:?}", one.0.meshes[1].primitives)
    );
}

#[test]
fn a_huge_plane_is_capped_and_small_things_get_their_lumels() {
    let mut instances = vec![(0, at(-1024.0, 0.0, -1024.0))];
    for i in 0..20 {
        instances.push((1, at(f64::from(i) * 3.0, 0.0, 0.0)));
    }
    instances.push((2, at(0.0, 5.0, 0.0)));
    let case = scene(
        vec![
            plane(2048.0, 2048.0),
            cuboid(Vec3::new(1.0, 2.0, 1.0)),
            cuboid(Vec3::splat(1e-3)),
        ],
        instances,
    );
    let (result, report) = lay_out(&case, &LayoutOptions::default());
    let texels = |m: usize| f64::from(result.meshes[m].size[0] * result.meshes[m].size[1]);
    // A quarter of 200,000, plus the border and rounding of a square of 224 texels.
    assert!(texels(0) < 50_000.0 * 1.05, "{}", texels(0));
    assert!(texels(0) > 40_000.0);
    // At the plane's own density a crate would have 10 m² × 0.012 = 0.1 lumels; contrast is limited
    // to 32.
    assert!(report.meshes[1].density[1] > 30.0 * report.meshes[0].density[1]);
    assert!(result.meshes[2].size.iter().all(|&s| s >= 4));
    assert!(
        report.warnings.iter().any(|w| w.contains("huge")),
        "{report:?}"
    );
}

#[test]
fn the_budget_is_met_and_a_mesh_too_large_for_the_page_is_lowered() {
    let (_, report) = lay_out(
        &lone(cuboid(Vec3::new(8.0, 3.0, 6.0))),
        &LayoutOptions::default(),
    );
    // Half a step of the preferred numbers (7 % with their own rounding), squared, plus the
    // rounding of borders to whole texels.
    assert!(
        (report.lumels - 200_000.0).abs() < 30_000.0,
        "{}",
        report.lumels
    );
    let options = LayoutOptions {
        max_page: 256,
        ..at_density(100.0)
    };
    let (result, report) = lay_out_lone(cuboid(Vec3::new(8.0, 3.0, 6.0)), &options);
    assert!(result.pages[0].iter().all(|&s| s <= 256));
    assert!(
        report.warnings.iter().any(|w| w.contains("lowered")),
        "{report:?}"
    );
}

fn with_uv1(mut mesh: Mesh, uv: Vec<Vec2>) -> Mesh {
    mesh.primitives[0].tex_coords = vec![Vec::new(), uv];
    mesh
}

fn unit_square() -> Vec<Vec2> {
    vec![Vec2::ZERO, Vec2::Y, Vec2::ONE, Vec2::X]
}

#[test]
fn good_coordinates_are_kept_at_the_wanted_density() {
    let case = lone(with_uv1(plane(4.0, 4.0), unit_square()));
    let (result, report) = lay_out(&case, &at_density(10.0));
    let atlas = &result.meshes[0];
    assert_eq!(atlas.origin, UvOrigin::Kept);
    assert_eq!(atlas.size, [40, 40]);
    assert_eq!(atlas.primitives[0].uv[2], Vec2::splat(40.0));
    assert_eq!(atlas.primitives[0].xref, [0, 1, 2, 3]);
    assert_eq!((atlas.charts, report.meshes[0].unwrapper), (1, None));
    assert_eq!(result.pages, [[40, 40]]);
    let options = LayoutOptions {
        uv_mode: UvMode::Generate,
        ..at_density(10.0)
    };
    assert_eq!(
        lay_out(&case, &options).0.meshes[0].origin,
        UvOrigin::Generated
    );
}

#[test]
fn kept_rectangles_keep_their_distance() {
    let case = scene(
        vec![with_uv1(plane(4.0, 4.0), unit_square())],
        (0..9)
            .map(|i| (0, at(f64::from(i) * 5.0, 0.0, 0.0)))
            .collect(),
    );
    let (result, _) = lay_out(&case, &at_density(10.0));
    for (i, a) in result.placements.iter().enumerate() {
        for b in &result.placements[i + 1..] {
            let apart = |p: u32, s: u32, q: u32, t: u32| q >= p + s + 2 || p >= q + t + 2;
            let (a, b) = (a.rect, b.rect);
            assert!(apart(a.x, a.w, b.x, b.w) || apart(a.y, a.h, b.y, b.h));
        }
    }
}

#[test]
fn bad_coordinates_are_replaced_and_the_reason_given() {
    let mut half = plane(1.0, 1.0);
    half.primitives.push(plane(1.0, 1.0).primitives.remove(0));
    half.primitives[0].tex_coords = vec![Vec::new(), unit_square()];
    let fold = vec![
        Vec2::ZERO,
        Vec2::Y,
        Vec2::new(0.6, 0.6),
        Vec2::new(0.1, 0.9),
    ];
    let cases = [
        (
            with_uv1(
                plane(1.0, 1.0),
                unit_square().iter().map(|p| *p * 2.0).collect(),
            ),
            "leave 0..1",
        ),
        (
            with_uv1(plane(1.0, 1.0), vec![Vec2::splat(0.5); 4]),
            "no area",
        ),
        (with_uv1(plane(1.0, 1.0), vec![Vec2::NAN; 4]), "not finite"),
        (with_uv1(plane(1.0, 1.0), fold), "overlap"),
        (half, "has no TEXCOORD_1"),
    ];
    for (mesh, reason) in cases {
        let (result, report) = lay_out_lone(mesh, &at_density(20.0));
        let UvOrigin::Replaced { why } = &result.meshes[0].origin else {
            panic!("{reason}: {:?}", result.meshes[0].origin);
        };
        assert!(why.contains(reason), "{why} / {reason}");
        assert!(report.warnings.iter().any(|w| w.contains(reason)));
    }
}

#[test]
fn cancelling_and_bad_options_are_errors() {
    let case = lone(sphere(40, 1.0));
    let cancelled = layout(&case.0, &case.1, &LayoutOptions::default(), &|_| false);
    assert!(matches!(cancelled, Err(LayoutError::Cancelled)));
    for options in [
        at_density(0.0),
        at_density(f32::NAN),
        LayoutOptions {
            max_page: 4,
            ..LayoutOptions::default()
        },
    ] {
        let refused = layout(&case.0, &case.1, &options, &|_| true);
        assert!(matches!(refused, Err(LayoutError::Option { .. })));
    }
}
