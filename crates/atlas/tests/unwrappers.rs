//! Every unwrapper on the same meshes.

use crate::common::*;
use atlas::UnwrapperChoice;
use atlas::{LayoutOptions, UvOrigin, layout, pack_pages};
use glam::Vec3;

#[test]
fn every_unwrapper_keeps_what_the_trait_promises() {
    let all = [
        UnwrapperChoice::Unroll,
        UnwrapperChoice::Xatlas,
        UnwrapperChoice::Box,
    ];
    for unwrapper in all {
        for mesh in [
            plane(3.0, 2.0),
            cuboid(Vec3::new(4.0, 3.0, 5.0)),
            cuboid(Vec3::splat(1e-4)),
            sphere(16, 2.0),
            moebius(48),
            loose_triangles(200),
        ] {
            let case = lone(mesh);
            let options = LayoutOptions {
                unwrapper,
                lumel_budget: 20_000,
                ..LayoutOptions::default()
            };
            let run = || layout(&case.0, &case.1, &options, &|_| true).expect("a layout");
            let (result, report) = run();
            check_generated(&result.meshes[0], 2);
            assert_eq!(result.meshes[0].origin, UvOrigin::Generated);
            // A chart whose density is off by more than a third would look blurred; single slivers
            // may be off.
            let m = &report.meshes[0];
            assert!(m.stretch < 1.3, "{unwrapper:?} {m:?}");
            assert_eq!(
                format!("{result:?}"),
                format!("{:?}", run().0),
                "{unwrapper:?}"
            );
        }
    }
}

#[test]
fn xatlas_refuses_what_it_would_choke_on_and_another_takes_over() {
    for (mesh, what) in [
        (sphere(130, 1.0), "more than 60000 triangles"),
        (loose_triangles(16_001), "more than 16000 pieces"),
    ] {
        let case = lone(mesh);
        let options = LayoutOptions {
            unwrapper: UnwrapperChoice::Xatlas,
            ..LayoutOptions::default()
        };
        let (_, report) = layout(&case.0, &case.1, &options, &|_| true).expect("a layout");
        assert_eq!(report.meshes[0].unwrapper, Some("unroll"));
        let said = format!("xatlas: {what}; unroll used");
        assert!(report.warnings[0].contains(&said), "{:?}", report.warnings);
    }
}

/// A terrain in one chart takes quadratic time; in pieces it does not, and the pieces are still
/// large.
#[test]
fn xatlas_gets_large_charts_in_pieces() {
    let sheet = plane_of(90);
    let case = lone(sheet);
    let options = LayoutOptions {
        unwrapper: UnwrapperChoice::Xatlas,
        ..LayoutOptions::default()
    };
    let (result, report) = layout(&case.0, &case.1, &options, &|_| true).expect("a layout");
    assert_eq!(report.meshes[0].unwrapper, Some("xatlas"));
    check_generated(&result.meshes[0], 2);
    // 16,200 triangles are halved four times to fall below 2,000; xatlas may cut a piece once more.
    assert!(
        (2..=32).contains(&report.meshes[0].charts),
        "{}",
        report.meshes[0].charts
    );
}

/// A wavy sheet of n × n cells.
fn plane_of(n: u32) -> mesh_ingest::Mesh {
    let at = |i: u32| Vec3::new((i % (n + 1)) as f32, 0.0, (i / (n + 1)) as f32);
    let positions = (0..(n + 1) * (n + 1)).map(at);
    let wavy = positions.map(|p| p + Vec3::Y * (p.x * 0.1).sin() * (p.z * 0.07).cos() * 3.0);
    let cells = (0..n).flat_map(|i| (0..n).map(move |j| i * (n + 1) + j));
    let triangles = cells.flat_map(|a| [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]]);
    mesh(wavy.collect(), triangles.collect())
}

#[test]
fn thousands_of_rectangles_are_packed_tight_apart_and_the_same_each_time() {
    let mut r = random(1);
    let mut side = || 3 + (r() * r() * 60.0) as u32;
    for (count, block) in [(2, 1), (7, 4), (300, 1), (1400, 1), (9000, 1), (900, 4)] {
        let sizes: Vec<[u32; 2]> = (0..count).map(|_| [side(), side()]).collect();
        let packed = pack_pages(&sizes, 1024, block).expect("a packing");
        assert_eq!(packed, pack_pages(&sizes, 1024, block).expect("a packing"));
        let mut taken: Vec<Vec<bool>> = packed
            .pages
            .iter()
            .map(|p| vec![false; (p[0] * p[1]) as usize])
            .collect();
        for (size, &(page, [x, y])) in sizes.iter().zip(&packed.places) {
            let [w, h] = packed.pages[page as usize];
            assert!(x + size[0] <= w && y + size[1] <= h && w <= 1024 && h <= 1024);
            assert!([x, y, w, h].iter().all(|v| v.is_multiple_of(block)));
            for v in y..y + size[1] {
                for u in x..x + size[0] {
                    let cell = &mut taken[page as usize][(v * w + u) as usize];
                    assert!(!*cell);
                    *cell = true;
                }
            }
        }
        let filled = taken.iter().flatten().filter(|&&t| t).count() as f64;
        let total: usize = taken.iter().map(Vec::len).sum();
        // A regression bound: the measured values are 0.94 to 0.98 for 300 and more.
        if count >= 300 && block == 1 {
            assert!(
                filled / total as f64 > 0.85,
                "{count}: {}",
                filled / total as f64
            );
        }
    }
    assert!(pack_pages(&[[2000, 3], [3, 3]], 1024, 4).is_none());
}
