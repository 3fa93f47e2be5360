//! Objects in a lit room, and in a furnace.

use glam::{Affine3A, Vec3};

use super::kit::{ALL, FAR, Kit, block, hull, span, span_in, turned};
use super::{Hull, Kind, LeakScene};
use crate::geometry::{Geometry, cuboid, icosphere};

/// A lit room of 4 × 2.8 × 4 m.
fn lit_room() -> Kit {
    let mut k = Kit::new();
    k.shell([-2.0, 0.0, -2.0], [2.0, 2.8, 2.0]);
    k.lamp(Vec3::new(0.2, 2.7, 0.4), [0.8; 2]);
    k
}

/// A staircase of boards along a wall, closed at the side and at the end: a cupboard without a
/// door.
pub(super) fn stairs() -> LeakScene {
    let mut k = lit_room();
    let (count, run, rise) = (8u8, 0.28, 0.2);
    let (tread, riser, nose, sunk) = (0.03, 0.02, 0.02, 0.004);
    let x0 = -1.3;
    // From the back wall (sunk into it) to the side panel, which is flush with the steps.
    let (back, front, panel) = (-2.0, -1.0, 0.02);
    let at = |i: u8| x0 + run * f32::from(i);
    let top = |i: u8| rise * f32::from(i + 1);
    let mut boards = Geometry::default();
    let mut solid: Vec<Hull> = Vec::new();
    let mut add = |boards: &mut Geometry, min: [f32; 3], max: [f32; 3]| {
        boards.append(&cuboid(min.into(), max.into(), 1));
        solid.push(hull(Affine3A::IDENTITY, min.into(), max.into()));
    };
    let side = [back - 0.02, front];
    for i in 0..count {
        let under = if i == 0 { -sunk } else { top(i - 1) - sunk };
        let bottom = top(i) - tread;
        add(
            &mut boards,
            [at(i), under, side[0]],
            [at(i) + riser, bottom + sunk, side[1]],
        );
        let end = at(i + 1) + if i + 1 == count { 0.0 } else { riser };
        add(
            &mut boards,
            [at(i) - nose, bottom, side[0]],
            [end, top(i), side[1]],
        );
    }
    let end = at(count);
    add(
        &mut boards,
        [end - riser, -sunk, side[0]],
        [end, top(count - 1) - tread + sunk, side[1]],
    );
    let mut panels = Geometry::default();
    let mut cupboard: Vec<Hull> = Vec::new();
    for i in 0..count {
        let bottom = top(i) - tread;
        let last = i + 1 == count;
        let x = [
            at(i) + if i == 0 { riser / 2.0 } else { 0.0 },
            at(i + 1) + if last { -riser / 2.0 } else { riser / 2.0 },
        ];
        add(
            &mut panels,
            [x[0], -sunk, front - panel],
            [x[1], bottom + sunk, front - 0.001],
        );
        let x = [at(i) + riser, at(i + 1) + if last { -riser } else { riser }];
        cupboard.push(span(x, [-FAR, bottom], [back, front - panel]));
    }
    k.part("boards", &boards).part("side", &panels);
    for h in &cupboard {
        k.region(Kind::Dark, "walls", h.clone());
    }
    let floor = span([x0 + riser, end - riser], ALL, [back, front - panel]);
    k.region(Kind::Dark, "floor", floor)
        .region(Kind::Dark, "side", Vec::new())
        .facing(Vec3::NEG_Z);
    for i in 0..count {
        // Treads from below, behind the riser that supports them; and the riser from behind.
        let x = [
            at(i) + riser,
            at(i + 1) + if i + 1 == count { -riser } else { riser },
        ];
        let inner = [back, front - panel];
        k.region(
            Kind::Dark,
            "boards",
            span(x, [top(i) - tread - 1e-3, top(i) - tread + 1e-3], inner),
        )
        .facing(Vec3::NEG_Y);
        let under = if i == 0 { 0.0 } else { top(i - 1) - tread };
        let x = [at(i) + riser - 1e-3, at(i) + riser + 1e-3];
        k.region(
            Kind::Dark,
            "boards",
            span(x, [under, top(i) - tread], inner),
        )
        .facing(Vec3::X);
        let x = [
            at(i) - nose,
            at(i + 1) - if i + 1 == count { 0.0 } else { nose },
        ];
        k.region(
            Kind::Lit,
            "boards",
            span(x, [top(i) - 1e-3, top(i) + 1e-3], [back, front]),
        )
        .facing(Vec3::Y);
    }
    let prism = span([x0, end], ALL, [back, front]);
    k.region(Kind::Lit, "floor", Vec::new()).without([prism]);
    k.region(Kind::Lit, "walls", Vec::new())
        .without(solid.into_iter().chain(cupboard));
    LeakScene {
        shared_lumels: true,
        ..k.finish(
        "stairs",
        "cupboard under stairs of boards (treads 3 cm, risers and side 2 cm), closed on all sides",
    )
    }
}

/// A shelf of boards of 2 mm at a wall whose lowest compartment has a door.
pub(super) fn cabinet() -> LeakScene {
    let mut k = lit_room();
    let (x, depth, height, t) = (0.6, 0.5, 1.6, 0.002);
    let back = -2.005;
    let front = -2.0 + depth;
    let mut boards = Geometry::default();
    let mut solid = Vec::new();
    let middles = [0.7, 1.15];
    let mut add = |min: [f32; 3], max: [f32; 3]| {
        boards.append(&cuboid(min.into(), max.into(), 1));
        solid.push(hull(Affine3A::IDENTITY, min.into(), max.into()));
    };
    add([-x, -t, back], [-x + t, height, front]);
    add([x - t, -t, back], [x, height, front]);
    for y in middles {
        add([-x + t / 2.0, y, back], [x - t / 2.0, y + t, front]);
    }
    add(
        [-x + t / 2.0, height - t, back],
        [x - t / 2.0, height, front],
    );
    k.part("boards", &boards);
    let low = -0.001;
    let door = cuboid(
        Vec3::new(-x + t / 2.0, low, front - 2.0 * t),
        Vec3::new(x - t / 2.0, middles[0] + t / 2.0, front - t),
        1,
    );
    k.part("door", &door);
    let inner = [-x + t, x - t];
    let closed = span(inner, [-FAR, middles[0]], [-FAR, front - 2.0 * t]);
    k.region(Kind::Dark, "floor", closed.clone())
        .region(Kind::Dark, "walls", closed.clone())
        .region(Kind::Dark, "door", Vec::new())
        .facing(Vec3::NEG_Z);
    let skin = |y: [f32; 2]| span([-x + t - 1e-4, x - t + 1e-4], y, [-2.0, front - 2.0 * t]);
    k.region(Kind::Dark, "boards", skin([0.0, middles[0] + 1e-4]))
        .facing(Vec3::X)
        .region(Kind::Dark, "boards", skin([0.0, middles[0] + 1e-4]))
        .facing(Vec3::NEG_X)
        .region(Kind::Dark, "boards", skin([0.0, middles[0] + 1e-4]))
        .facing(Vec3::NEG_Y);
    // The sides' outer faces are beyond `skin`. Open to the room:
    let whole = span([-x, x], [-FAR, height], [-FAR, front]);
    k.region(Kind::Lit, "floor", Vec::new())
        .without([whole.clone()])
        .region(Kind::Lit, "walls", Vec::new())
        .without([whole]);
    for y in [[middles[0] + t, middles[1]], [middles[1] + t, height - t]] {
        k.region(Kind::Lit, "walls", span(inner, y, [-FAR, front]));
    }
    for y in middles {
        k.region(
            Kind::Lit,
            "boards",
            span(inner, [y + t - 1e-4, y + t + 1e-4], [-2.0, front]),
        )
        .facing(Vec3::Y);
    }
    LeakScene {
        texels_per_unit: 16.0,
        shared_lumels: true,
        ..k.finish(
            "cabinet",
            "shelf of 2 mm boards against a wall, its lowest compartment closed by a door; room, walls and floor go on behind",
        )
    }
}

/// Crates, a ball, a slab and a board that intersect each other and the floor.
pub(super) fn overlapping_props() -> LeakScene {
    let mut k = lit_room();
    let first = turned(20.0, Vec3::new(-0.6, 0.0, -0.5));
    let second = turned(-25.0, Vec3::new(-0.1, 0.0, -0.2));
    let slab = turned(5.0, Vec3::new(0.9, 0.0, 0.9));
    let crates = [
        ("first crate", first, [-0.4, -0.1, -0.4], [0.4, 0.7, 0.4]),
        (
            "second crate",
            second,
            [-0.3, -0.05, -0.3],
            [0.3, 0.45, 0.3],
        ),
        ("slab", slab, [-0.6, -0.01, -0.4], [0.6, 0.02, 0.4]),
        (
            "board",
            turned(70.0, Vec3::new(-1.2, 0.0, 0.9)),
            [-0.01, -0.1, -0.5],
            [0.01, 0.8, 0.5],
        ),
    ];
    let mut hulls = Vec::new();
    for (name, frame, min, max) in crates {
        k.part(name, &block(frame, min, max));
        hulls.push(hull(frame, min.into(), max.into()));
    }
    let (middle, radius) = (Vec3::new(0.9, 0.15, -0.9), 0.4);
    let mut ball = icosphere(middle, radius, 2);
    ball.normals = (ball.positions.iter())
        .map(|p| (*p - middle).normalize())
        .collect();
    k.part("ball", &ball);
    let r = (radius * radius - 0.15 * 0.15f32).sqrt();
    hulls.push(span(
        [middle.x - r, middle.x + r],
        ALL,
        [middle.z - r, middle.z + r],
    ));
    k.region(Kind::Lit, "floor", Vec::new())
        .without(hulls.iter().cloned());
    for (i, name) in ["first crate", "second crate", "slab", "board"]
        .into_iter()
        .enumerate()
    {
        let others = (hulls.iter().enumerate()).filter(|(j, _)| *j != i);
        k.region(Kind::Lit, name, span(ALL, [0.0, FAR], ALL))
            .without(others.map(|(_, h)| h.clone()));
    }
    k.finish(
        "overlapping_props",
        "crates in each other and in the floor, a ball half sunk, a slab and a board of 2 cm",
    )
}

/// Crates on a floor: flush, double-sided, sunk, hovering, and hollow ones in which it is dark.
pub(super) fn crates() -> LeakScene {
    let mut k = lit_room();
    let mut hulls = Vec::new();
    let (min, max) = ([-0.3, 0.0, -0.3], [0.3, 0.6, 0.3]);
    let places = [
        ("single-sided", turned(10.0, Vec3::new(-1.1, 0.0, -1.0))),
        ("double-sided", turned(30.0, Vec3::new(0.1, 0.0, -1.1))),
        ("sunk", turned(50.0, Vec3::new(1.2, -0.2, -0.9))),
        ("hovering", turned(70.0, Vec3::new(-1.0, 0.001, 0.7))),
        ("hollow", turned(25.0, Vec3::new(0.9, 0.0, 0.8))),
    ];
    for (name, frame) in places {
        let crate_ = block(frame, min, max);
        if name == "double-sided" || name == "hollow" {
            k.sheet(name, &crate_);
        } else {
            k.part(name, &crate_);
        }
        hulls.push(hull(frame, min.into(), max.into()));
    }
    // The double-sided one has a single-sided lining that faces inwards, a millimetre away, as in a
    // chest with a lid.
    let frame = places[4].1;
    let lining = block(frame, [-0.299, 0.001, -0.299], [0.299, 0.599, 0.299]).flipped();
    k.part("lining", &lining);
    k.region(Kind::Dark, "lining", Vec::new());
    // The floor under them is not a region: it is invisible, and a baker may fill it to suit the
    // lit lumels beside it.
    for (i, (name, _)) in places.into_iter().enumerate() {
        let above = if i == 2 { 0.0 } else { 0.002 };
        k.region(Kind::Lit, name, span(ALL, [above, FAR], ALL));
    }
    let holes = places
        .into_iter()
        .map(|(_, frame)| span_in(frame, [-0.3, 0.3], ALL, [-0.3, 0.3]));
    k.region(Kind::Lit, "floor", Vec::new()).without(holes);
    LeakScene {
        shared_lumels: true,
        ..k.finish(
            "crates",
            "crates flush on a floor (single- and double-sided), sunk, 1 mm above it, and a double-sided one with a lining",
        )
    }
}

/// Walls, boards and crates that intersect a closed room's walls and floor; everything visible is
/// declared as lit. The order of nodes, which starts with the room and then the other parts, is
/// turned by `first` places: patches are numbered anew, and so get other random numbers.
fn crowded(k: &mut Kit, first: usize) {
    let (half, height) = (2.0, 2.4);
    let low = -0.05;
    let parts = [
        // A wall of 1 mm from floor to ceiling that ends in the room, and one of 20 cm.
        (
            "thin wall",
            turned(3.0, Vec3::ZERO),
            [-0.0005, low, -2.3],
            [0.0005, 2.45, 0.3],
        ),
        (
            "thick wall",
            turned(-4.0, Vec3::new(1.0, 0.0, 0.0)),
            [-0.1, low, 0.4],
            [0.1, 2.45, 2.3],
        ),
        (
            "crate",
            turned(20.0, Vec3::new(-1.0, 0.0, -0.9)),
            [-0.35, low, -0.35],
            [0.35, 0.6, 0.35],
        ),
        (
            "shelf",
            turned(0.0, Vec3::new(-1.0, 0.0, 1.0)),
            [-1.05, 1.0, -0.5],
            [-0.6, 1.002, 0.5],
        ),
        (
            "slab",
            turned(30.0, Vec3::new(-0.6, 0.0, 1.1)),
            [-0.5, -0.01, -0.3],
            [0.5, 0.02, 0.3],
        ),
        (
            "pillar",
            turned(12.0, Vec3::new(1.2, 0.0, -1.1)),
            [-0.15, low, -0.15],
            [0.15, 2.45, 0.15],
        ),
    ];
    let hulls = parts.map(|(_, frame, min, max)| hull(frame, min.into(), max.into()));
    let mut order = [&[None][..], &parts.map(Some)].concat();
    order.rotate_left(first);
    for part in order {
        match part {
            None => k.shell([-half, 0.0, -half], [half, height, half]),
            Some((name, frame, min, max)) => k.part(name, &block(frame, min, max)),
        };
    }
    let inner = span([-half, half], [0.0, height], [-half, half]);
    for (i, (name, ..)) in parts.into_iter().enumerate() {
        let others = (hulls.iter().enumerate()).filter(|(j, _)| *j != i);
        k.region(Kind::Lit, name, inner.clone())
            .without(others.map(|(_, h)| h.clone()));
    }
    for node in ["floor", "ceiling", "walls"] {
        k.region(Kind::Lit, node, Vec::new())
            .without(hulls.iter().cloned());
    }
}

/// A furnace: every visible point has E = π, so any lack of light is a black spot.
pub(super) fn furnace() -> LeakScene {
    let mut k = Kit::furnace();
    crowded(&mut k, 0);
    LeakScene {
        even: Some(std::f64::consts::PI),
        ..k.finish(
            "furnace",
            "closed furnace with walls of 1 mm and 20 cm, a crate, a shelf, a slab and a pillar stuck in it: E is the same everywhere",
        )
    }
}

/// The same room with white walls and a lamp. All of the lamp's light is absorbed on visible
/// surfaces, so ∫ E dA = Φ/(1 − ρ), and bounced light that is lost in hidden places counts ten
/// times.
pub(super) fn white_room() -> LeakScene {
    white_room_from(0)
}

/// The white room of the suite with the order of its nodes turned by `first` < 7 places.
pub fn white_room_from(first: usize) -> LeakScene {
    let rho = 0.9;
    let mut k = Kit::of_reflectance(rho);
    crowded(&mut k, first);
    k.point(Vec3::new(0.1, 1.4, -0.1));
    LeakScene {
        received: Some(4.0 * std::f64::consts::PI / (1.0 - f64::from(rho))),
        ..k.finish(
            "white_room",
            "the same room, white (reflectance 0.9), with a point light: light must not get lost in what is hidden",
        )
    }
}
