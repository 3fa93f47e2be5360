//! Walls between a lit room and a dark one.

use glam::{Affine3A, Vec2, Vec3};

use super::kit::{ALL, FAR, Kit, block, hull, span, span_in, turned};
use super::{Hull, Kind, LeakScene};
use crate::carve::Carver;
use crate::geometry::{Geometry, cuboid, grid, prism, room};

/// How deep walls extend into floors, ceilings and each other, metres: beyond all rounding, as
/// artists do.
const SUNK: f32 = 0.05;

/// A closed box of 1 mm board that floats in a lit room.
pub(super) fn sealed_box() -> LeakScene {
    let mut k = Kit::new();
    k.shell([-2.0, 0.0, -2.0], [2.0, 2.8, 2.0]);
    k.lamp(Vec3::new(0.0, 2.7, 0.0), [0.8; 2]);
    let frame = turned(10.0, Vec3::new(0.13, 1.0, 0.07));
    k.part("outside", &block(frame, [-0.75; 3], [0.75; 3]));
    let inner = room(Vec3::splat(-0.749), Vec3::splat(0.749), 1).transformed(frame);
    k.part("inside", &inner)
        .region(Kind::Dark, "inside", Vec::new())
        .region(Kind::Lit, "outside", Vec::new())
        .region(Kind::Lit, "floor", Vec::new())
        .region(Kind::Lit, "walls", Vec::new());
    k.finish(
        "sealed_box",
        "closed box of 1 mm board, faces on both sides, floats in a lit room",
    )
}

/// The same without a bottom of its own, on the room's floor.
pub(super) fn box_on_floor() -> LeakScene {
    let mut k = Kit::new();
    k.shell([-2.0, 0.0, -2.0], [2.0, 2.8, 2.0]);
    k.lamp(Vec3::new(0.0, 2.7, 0.0), [0.8; 2]);
    let frame = turned(10.0, Vec3::new(0.13, 0.0, 0.07));
    let open = |g: [Geometry; 6]| {
        let [a, b, _, c, d, e] = g;
        Geometry::union(&[a, b, c, d, e]).transformed(frame)
    };
    let faces = |half: f32, top: f32| {
        crate::geometry::box_faces(
            Vec3::new(-half, -0.002, -half),
            Vec3::new(half, top, half),
            1,
        )
    };
    let (outer, inner) = (0.75, 0.749);
    k.part("outside", &open(faces(outer, 1.0)));
    k.part("inside", &open(faces(inner, 0.999)).flipped());
    let square = |half: f32| span_in(frame, [-half, half], ALL, [-half, half]);
    k.region(Kind::Dark, "inside", Vec::new())
        .region(Kind::Dark, "floor", square(inner))
        .region(Kind::Lit, "floor", Vec::new())
        .without([square(outer)])
        .region(Kind::Lit, "outside", span(ALL, [0.0, FAR], ALL));
    LeakScene {
        shared_lumels: true,
        ..k.finish(
            "box_on_floor",
            "box of 1 mm board without a bottom stands on the floor of a lit room",
        )
    }
}

/// The wall between the two rooms.
enum Wall {
    /// A closed box of this thickness.
    Solid(f32),
    /// One double-sided quadrilateral whose front looks into the lit room.
    Sheet,
}

/// One shell with one floor, ceiling and pair of walls, divided into two rooms by a wall at an
/// angle of 3°, so that it crosses lumels at every position. The first room has a lamp.
fn two_rooms(wall: &Wall) -> Kit {
    let mut k = Kit::new();
    let (half, height) = (2.0, 2.6);
    k.shell([-3.5, 0.0, -half], [3.5, height, half]);
    k.lamp(Vec3::new(-1.8, height - 0.1, 0.0), [0.7; 2]);
    let frame = turned(3.0, Vec3::new(0.03, 0.0, 0.0));
    let (low, high) = (-SUNK, height + SUNK);
    let reach = half + 3.0 * SUNK;
    let t = match wall {
        Wall::Solid(t) => {
            k.part(
                "wall",
                &block(frame, [-t / 2.0, low, -reach], [t / 2.0, high, reach]),
            );
            let there = |x| span_in(frame, x, [0.0, height], ALL);
            k.region(Kind::Dark, "wall", there([0.0, FAR]))
                .facing(frame.transform_vector3(Vec3::X))
                .region(Kind::Lit, "wall", in_shell(there([-FAR, 0.0]), half))
                .facing(frame.transform_vector3(Vec3::NEG_X));
            *t
        }
        Wall::Sheet => {
            let corner = Vec3::new(0.0, low, -reach);
            let (y, z) = (Vec3::Y * (high - low), Vec3::Z * 2.0 * reach);
            k.sheet("wall", &grid(corner, z, y, [1, 1]).transformed(frame));
            let there = span_in(frame, ALL, [0.0, height], ALL);
            k.region(Kind::Lit, "wall", in_shell(there, half));
            0.0
        }
    };
    // The lamp's own shadow on the ceiling does not count.
    let above_lamp = span([-3.1, -0.5], [height - 0.05, FAR], [-1.3, 1.3]);
    for node in ["floor", "ceiling", "walls"] {
        k.region(
            Kind::Dark,
            node,
            span_in(frame, [t / 2.0, FAR], [-FAR, FAR], ALL),
        )
        .region(Kind::Lit, node, span_in(frame, [-FAR, -t / 2.0], ALL, ALL))
        .without([above_lamp.clone()]);
    }
    k
}

/// `hull`, limited to −`half` ≤ z ≤ `half`.
fn in_shell(mut hull: Hull, half: f32) -> Hull {
    hull.extend(span(ALL, ALL, [-half, half]));
    hull
}

/// Two rooms and a solid wall of 1 mm on one floor.
pub(super) fn wall_1mm() -> LeakScene {
    LeakScene {
        shared_lumels: true,
        ..two_rooms(&Wall::Solid(0.001)).finish(
            "wall_1mm",
            "two rooms on one floor, solid wall of 1 mm, sunk into all that it meets",
        )
    }
}

/// Two rooms and a solid wall of 20 cm on one floor.
pub(super) fn wall_20cm() -> LeakScene {
    two_rooms(&Wall::Solid(0.2)).finish(
        "wall_20cm",
        "floor slab runs under a wall of 20 cm between a lit room and a dark one",
    )
}

/// Two rooms and a double-sided sheet on one floor.
pub(super) fn sheet_wall() -> LeakScene {
    LeakScene {
        shared_lumels: true,
        ..two_rooms(&Wall::Sheet).finish(
            "sheet_wall",
            "two rooms on one floor, parted by a double-sided sheet of no thickness",
        )
    }
}

/// One lit and two dark rooms on one floor: walls of 5 cm that meet in a T.
pub(super) fn three_rooms() -> LeakScene {
    let mut k = Kit::new();
    let height = 2.6;
    k.shell([-3.0, 0.0, -3.0], [3.0, height, 3.0]);
    k.lamp(Vec3::new(-1.5, height - 0.1, 0.0), [0.7; 2]);
    let frame = turned(5.0, Vec3::new(0.21, 0.0, 0.11));
    let t = 0.025;
    let (low, high) = (-SUNK, height + SUNK);
    k.part("long", &block(frame, [-t, low, -3.6], [t, high, 3.6]));
    // Its end stops in the middle of the long wall.
    k.part("short", &block(frame, [0.0, low, -t], [3.6, high, t]));
    for node in ["floor", "ceiling", "walls"] {
        k.region(Kind::Dark, node, span_in(frame, [t, FAR], ALL, ALL))
            .region(Kind::Lit, node, span_in(frame, [-FAR, -t], ALL, ALL))
            .without([span([-2.8, -0.2], [height - 0.05, FAR], [-1.3, 1.3])]);
    }
    k.region(Kind::Dark, "short", span_in(frame, [t, FAR], ALL, ALL));
    k.region(Kind::Dark, "long", Vec::new())
        .facing(frame.transform_vector3(Vec3::X))
        .region(Kind::Lit, "long", span(ALL, [0.0, height], [-3.0, 3.0]))
        .facing(frame.transform_vector3(Vec3::NEG_X));
    LeakScene {
        shared_lumels: true,
        ..k.finish(
            "three_rooms",
            "walls of 5 cm meet in a T on one floor; one of the three rooms is lit",
        )
    }
}

/// Two rooms, a doorway in a wall of 20 cm, and a door that stands 8° ajar.
pub(super) fn door_ajar() -> LeakScene {
    let mut k = Kit::new();
    let mut c = Carver::new();
    c.fill([-4.0, -0.3, -2.3], [4.0, 2.9, 2.3])
        .carve([-3.5, 0.0, -2.0], [-0.07, 2.6, 2.0], 1)
        .carve([-0.07, 0.0, -0.45], [0.13, 2.0, 0.45], 2)
        .carve([0.13, 0.0, -2.0], [3.5, 2.6, 2.0], 3);
    // One floor for both rooms; walls and ceilings by room.
    for (key, g) in c.faces(|f| match (f.space, f.normal.y > 0.5) {
        (0, _) => None,
        (_, true) => Some(0),
        (space, _) => Some(space),
    }) {
        k.part(
            ["floor", "lit room", "doorway", "dim room"][usize::from(key)],
            &g,
        );
    }
    k.lamp(Vec3::new(-1.8, 2.5, 0.0), [0.7; 2]);
    // The hinges are at z = −0.45 on the lit side, with 5 mm of air around the leaf.
    let frame = turned(-8.0, Vec3::new(-0.07, 0.0, -0.445));
    k.part(
        "door",
        &block(frame, [0.0, 0.005, 0.0], [0.04, 1.995, 0.89]),
    );
    k.region(Kind::Dim, "dim room", Vec::new())
        .region(Kind::Dim, "floor", span([0.13, FAR], ALL, ALL))
        .region(Kind::Lit, "floor", span([-FAR, -0.2], ALL, ALL))
        .region(Kind::Lit, "lit room", Vec::new())
        .facing(Vec3::NEG_X);
    k.finish(
        "door_ajar",
        "door 8° open in a wall of 20 cm, one floor under both rooms; the second room gets what comes through",
    )
}

/// Two storeys with a pillar through the slab between them; the lower one is lit.
pub(super) fn storeys() -> LeakScene {
    let mut k = Kit::new();
    k.shell([-2.0, 0.0, -2.0], [2.0, 5.2, 2.0]);
    k.lamp(Vec3::new(-0.9, 2.4, 0.0), [0.5, 0.8]);
    let reach = 2.0 + SUNK;
    let slab = cuboid(
        Vec3::new(-reach, 2.5, -reach),
        Vec3::new(reach, 2.7, reach),
        1,
    );
    k.part("slab", &slab);
    let outline: Vec<Vec2> = (0..8)
        .map(|i| {
            Vec2::new(0.7, 0.1) + 0.25 * Vec2::from_angle(-std::f32::consts::TAU * i as f32 / 8.0)
        })
        .collect();
    k.part("pillar", &prism(&outline, -SUNK, 5.2 + SUNK));
    let inner = span([-2.0, 2.0], ALL, [-2.0, 2.0]);
    let about = hull(
        Affine3A::IDENTITY,
        Vec3::new(0.44, -FAR, -0.16),
        Vec3::new(0.96, FAR, 0.36),
    );
    for node in ["walls", "pillar"] {
        k.region(Kind::Dark, node, span(ALL, [2.7, FAR], ALL))
            .region(Kind::Lit, node, span(ALL, [0.0, 2.5], ALL));
    }
    k.region(Kind::Dark, "ceiling", Vec::new())
        .region(Kind::Dark, "slab", inner.clone())
        .facing(Vec3::Y)
        .region(Kind::Lit, "slab", inner)
        .facing(Vec3::NEG_Y)
        // The lamp's own shadow does not count.
        .without([about.clone(), span([-2.0, 0.3], [-FAR, 2.6], [-1.5, 1.5])])
        .region(Kind::Lit, "floor", Vec::new())
        .without([about]);
    k.finish(
        "storeys",
        "pillar through a slab of 20 cm, walls run on behind the slab; the storey above is dark",
    )
}
