//! Every mesh that may break an unwrapper gets charts: inside the page, separated, not inverted,
//! and deterministic.

use crate::common::nasty::nasty;
use crate::common::*;
use atlas::UnwrapperChoice;
use atlas::{Layout, LayoutOptions, LayoutReport, layout};
use glam::DAffine3;

fn lay_out(
    name: &str,
    case: &(mesh_ingest::Scene, mesh_ingest::Soup),
    options: &LayoutOptions,
) -> (Layout, LayoutReport) {
    layout(&case.0, &case.1, options, &|_| true).unwrap_or_else(|e| panic!("{name}: {e}"))
}

#[test]
fn thirty_nasty_meshes_get_sound_charts() {
    let all = nasty(true);
    assert!(all.len() >= 30, "{}", all.len());
    for (name, positions, triangles) in all {
        let case = lone(mesh(positions, triangles));
        let (result, report) = lay_out(name, &case, &LayoutOptions::default());
        check_generated(&result.meshes[0], 2);
        let m = &report.meshes[0];
        assert_eq!(m.flipped, 0, "{name}");
        // (Almost) zero-area meshes only consist of points and lines, which are no charts.
        let expected = match name {
            "all vertices equal" | "all on a line" | "slivers of 1e6" => "box",
            _ => "unroll",
        };
        assert_eq!(m.unwrapper, Some(expected), "{name}: {:?}", report.warnings);
    }
}

#[test]
fn the_last_resort_takes_all_of_them() {
    for (name, positions, triangles) in nasty(false) {
        let case = lone(mesh(positions, triangles));
        let options = LayoutOptions {
            unwrapper: UnwrapperChoice::Box,
            padding: 3,
            ..LayoutOptions::default()
        };
        let (result, report) = lay_out(name, &case, &options);
        check_generated(&result.meshes[0], 3);
        assert_eq!(report.meshes[0].flipped, 0, "{name}");
    }
}

#[test]
fn charts_are_the_same_alone_and_among_others_on_one_thread_and_on_two() {
    let chosen = [
        "sphere",
        "slivers of 1e6",
        "soup of shared vertices",
        "T-junctions",
        "helix",
        "noise terrain",
    ];
    let meshes: Vec<_> = nasty(false)
        .into_iter()
        .filter(|n| chosen.contains(&n.0))
        .map(|(_, positions, triangles)| mesh(positions, triangles))
        .collect();
    assert_eq!(meshes.len(), chosen.len());
    let options = LayoutOptions {
        texels_per_unit: Some(7.0),
        ..LayoutOptions::default()
    };
    let alone: Vec<String> = meshes
        .iter()
        .map(|m| {
            format!(
                "{:?}",
                lay_out("alone", &lone(m.clone()), &options).0.meshes[0]
            )
        })
        .collect();
    let instances = (0..meshes.len()).map(|i| (i, DAffine3::IDENTITY)).collect();
    let together = scene(meshes, instances);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        let (result, _) = pool.install(|| lay_out("together", &together, &options));
        for (a, b) in alone.iter().zip(&result.meshes) {
            assert_eq!(a, &format!("{b:?}"), "{threads} threads");
        }
    }
}
