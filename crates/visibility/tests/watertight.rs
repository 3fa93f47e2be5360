//! Rays from inside a closed mesh always hit it.

use crate::common::{AIMS, PLACES, Random, build, cube, icosphere, inside_ray, torus};
use visibility::AcceptAll;

/// At least a million rays per target over meshes and places; `examples/leaks.rs` casts ten million
/// each.
#[test]
fn nothing_leaks_from_a_closed_mesh() {
    const RAYS: usize = 70_000;
    let mut leaks = vec![];
    for mesh in [icosphere(5), torus(96, 48), cube(24)] {
        for place in PLACES {
            let triangles = place.mesh(&mesh);
            let bvh = build(&triangles);
            for aim in AIMS {
                let mut r = Random(7);
                let (mut missed, mut open) = (0, 0);
                for _ in 0..RAYS {
                    let ray = inside_ray(&mesh, &triangles, place, aim, &mut r);
                    missed += u32::from(bvh.closest_hit(&ray, &AcceptAll).is_none());
                    open += u32::from(!bvh.occluded(&ray, &AcceptAll));
                }
                if missed + open > 0 {
                    leaks.push(format!(
                        "{} {place:?} {aim:?}: {missed} closest, {open} occluded",
                        mesh.name
                    ));
                }
            }
        }
    }
    assert!(leaks.is_empty(), "leaks:\n{}", leaks.join("\n"));
}
