//! Dark buildings outdoors, under a sky and a sun.

use std::f32::consts::PI;

use glam::{Affine3A, Vec2, Vec3};

use super::kit::{ALL, FAR, Kit, block, span, span_in, turned};
use super::{Hull, Kind, LeakScene};
use crate::geometry::{Geometry, cuboid, grid, room};
use crate::scenes::smooth::averaged;

/// Direction of the sun's light: buildings cast their shadows to −x and −z.
const SUN: Vec3 = Vec3::new(-0.5, -0.7, -0.3);

fn in_the_open(k: Kit, name: &'static str, what: &'static str) -> LeakScene {
    LeakScene {
        sky: 1.0,
        ..k.finish(name, what)
    }
}

/// Rooms of one skin, some with split corner normals and some with normals averaged across corners.
pub(super) fn corner_normals() -> LeakScene {
    let mut k = Kit::new();
    k.ground(4.0, -0.02).sun(SUN);
    let walls = || room(Vec3::splat(-0.8), Vec3::splat(0.8), 2);
    let place = |x: f32| turned(20.0, Vec3::new(x, 0.8, 0.0));
    k.part("split", &walls().transformed(place(-1.5)));
    let smooth = averaged(&walls()).transformed(place(1.5));
    k.part("averaged", &smooth);
    // The same corners with two skins: the averaged normals of the inner one lean across the wall.
    let thin = turned(35.0, Vec3::new(0.0, 0.8, 2.4));
    let shell = cuboid(Vec3::splat(-0.8), Vec3::splat(0.8), 2);
    k.part("skin", &averaged(&shell).transformed(thin));
    let inner = averaged(&room(Vec3::splat(-0.79), Vec3::splat(0.79), 2));
    k.part("two skins", &inner.transformed(thin));
    for node in ["split", "averaged", "two skins"] {
        k.region(Kind::Dark, node, Vec::new());
    }
    k.region(Kind::Lit, "ground", span([2.8, FAR], ALL, ALL));
    in_the_open(
        k,
        "corner_normals",
        "sealed rooms in the open: corners with split normals, with averaged ones, and with averaged ones inside a second skin",
    )
}

/// A room of single-sided faces that look inwards, on the ground.
pub(super) fn inward_room() -> LeakScene {
    let mut k = Kit::new();
    k.ground(4.0, 0.0).sun(SUN);
    let frame = turned(7.0, Vec3::new(0.1, 0.0, 0.2));
    let (min, max) = (Vec3::new(-1.5, 0.01, -1.2), Vec3::new(1.5, 2.4, 1.2));
    k.part("room", &room(min, max, 1).transformed(frame));
    k.region(Kind::Dark, "room", Vec::new());
    // Out of its shadow.
    for within in [
        span_in(frame, [max.x, FAR], ALL, [-0.5, FAR]),
        span_in(frame, [-0.5, FAR], ALL, [max.z, FAR]),
    ] {
        k.region(Kind::Lit, "ground", within);
    }
    in_the_open(
        k,
        "inward_room",
        "room of one skin that looks inwards, 1 cm over a ground in sun and sky",
    )
}

/// Half sides and height of the houses' insides, metres, and how thick their walls are.
const HOUSE: Vec3 = Vec3::new(1.7, 2.2, 1.3);
const WALL: f32 = 0.15;

/// The terrain under the barn: y = a x + b z + c.
const SLOPE: [f32; 3] = [0.07, -0.05, 0.1];

/// Four wall boxes that overlap at the corners and extend down to `low`, and a roof of the same
/// thickness `gap` above them.
fn house(k: &mut Kit, frame: Affine3A, low: f32, wall: f32, gap: f32) {
    let Vec3 { x, y, z } = HOUSE;
    let (ox, oz) = (x + wall, z + wall);
    k.part("west", &block(frame, [-ox, low, -oz], [-x, y, oz]))
        .part("east", &block(frame, [x, low, -oz], [ox, y, oz]))
        .part("north", &block(frame, [-ox, low, -oz], [ox, y, -z]))
        .part("south", &block(frame, [-ox, low, z], [ox, y, oz]));
    let (from, to) = (y + gap, y + gap + wall);
    k.part("roof", &block(frame, [-ox, from, -oz], [ox, to, oz]));
}

/// The inside of a house, from below ground upwards.
fn hall(frame: Affine3A) -> Hull {
    let Vec3 { x, y, z } = HOUSE;
    span_in(frame, [-x, x], [-FAR, y], [-z, z])
}

fn house_regions(k: &mut Kit, frame: Affine3A, kind: Kind) {
    let Vec3 { x, z, .. } = HOUSE;
    // Inner faces: those that face into the hall, as far as it extends; their other ends are inside
    // other walls.
    for (node, inward) in [
        ("west", Vec3::X),
        ("east", Vec3::NEG_X),
        ("north", Vec3::Z),
        ("south", Vec3::NEG_Z),
    ] {
        let within = match inward.x {
            0.0 => span_in(frame, [-x, x], [0.0, FAR], ALL),
            _ => span_in(frame, ALL, [0.0, FAR], [-z, z]),
        };
        k.region(kind, node, within)
            .facing(frame.transform_vector3(inward));
    }
    k.region(kind, "roof", span_in(frame, [-x, x], ALL, [-z, z]))
        .facing(Vec3::NEG_Y);
    k.region(kind, "ground", hall(frame));
}

/// A house without a floor of its own.
pub(super) fn house_on_ground() -> LeakScene {
    let mut k = Kit::new();
    k.ground(4.5, 0.0).sun(SUN);
    let frame = turned(7.0, Vec3::new(0.1, 0.0, 0.2));
    house(&mut k, frame, -0.05, WALL, -0.02);
    house_regions(&mut k, frame, Kind::Dark);
    // Outside any shadow of the house.
    let sunny = |x, z| span_in(frame, x, ALL, z);
    k.region(
        Kind::Lit,
        "ground",
        sunny([HOUSE.x + WALL, FAR], [-0.5, FAR]),
    )
    .region(
        Kind::Lit,
        "ground",
        sunny([-0.5, FAR], [HOUSE.z + WALL, FAR]),
    );
    for (node, out) in [("east", Vec3::X), ("south", Vec3::Z)] {
        k.region(Kind::Lit, node, span(ALL, [0.0, FAR], ALL))
            .facing(frame.transform_vector3(out));
    }
    LeakScene {
        shared_lumels: true,
        ..in_the_open(
            k,
            "house_on_ground",
            "house of four wall boxes of 15 cm and a roof; its floor is the ground that runs on under the walls",
        )
    }
}

/// The same on a smooth-shaded terrain.
pub(super) fn barn_on_terrain() -> LeakScene {
    let mut k = Kit::new();
    k.sun(SUN);
    let n = 12u32;
    let mut ground = grid(
        Vec3::new(-4.5, 0.0, 4.5),
        Vec3::X * 9.0,
        Vec3::Z * -9.0,
        [n, n],
    );
    // A slope under the barn, at least a cell wider than it, surrounded by hills.
    let [a, b, c] = SLOPE;
    let height = |x: f32, z: f32| {
        let far = ((x * x + z * z).sqrt() - 3.7).max(0.0);
        a * x + b * z + c + 0.3 * far * (1.3 * x + 0.4).sin() * (0.9 * z - 0.3).cos()
    };
    for (p, normal) in ground.positions.iter_mut().zip(&mut ground.normals) {
        p.y = height(p.x, p.z);
        let d = 1e-2;
        let slope = |dx: f32, dz: f32| {
            (height(p.x + dx, p.z + dz) - height(p.x - dx, p.z - dz)) / (2.0 * d)
        };
        *normal = Vec3::new(-slope(d, 0.0), 1.0, -slope(0.0, d)).normalize();
    }
    k.part("ground", &ground);
    let frame = turned(-12.0, Vec3::new(0.1, 0.0, 0.2));
    house(&mut k, frame, -0.6, WALL, -0.02);
    house_regions(&mut k, frame, Kind::Dark);
    // Surfaces below the slope look out under the terrain, into the sky, and nobody sees them. 20
    // µm allow for the rounding of the slope's vertices.
    let up = Vec3::new(-a, 1.0, -b).as_dvec3();
    let [x, y, z] = (-up.normalize()).to_array();
    let above = [x, y, z, (-f64::from(c) - 2e-5) / up.length()];
    k.narrow(|r| r.node != "ground" && r.node != "roof", above);
    k.region(
        Kind::Lit,
        "ground",
        span_in(frame, [HOUSE.x + WALL, FAR], ALL, [-0.5, FAR]),
    )
    .region(
        Kind::Lit,
        "ground",
        span_in(frame, [-0.5, FAR], ALL, [HOUSE.z + WALL, FAR]),
    );
    LeakScene {
        shared_lumels: true,
        ..in_the_open(
            k,
            "barn_on_terrain",
            "house sunk into a smooth-shaded terrain, which is its floor",
        )
    }
}

/// A hall of a modular kit: instances of one wall panel, one floor tile and one roof tile that meet
/// edge to edge.
pub(super) fn modular() -> LeakScene {
    let mut k = Kit::new();
    k.ground(4.5, -0.15).sun(SUN);
    let (side, tall, t) = (2.0, 2.4, 0.1);
    // The panel's inner face is at z = 0; the panel extends from x = 0 to 2 and outwards to −z.
    let panel = cuboid(Vec3::new(0.0, 0.0, -t), Vec3::new(side, tall, 0.0), 1);
    let panel = k.mesh("panel", &panel);
    let post = k.mesh(
        "post",
        &cuboid(Vec3::new(-t, 0.0, -t), Vec3::new(0.0, tall, 0.0), 1),
    );
    let tile = cuboid(Vec3::new(-t, -t, -t), Vec3::new(side + t, 0.0, side + t), 1);
    let tile = k.mesh("tile", &tile);
    let (nx, nz) = (2, 2);
    let (width, depth) = (side * nx as f32, side * nz as f32);
    let middle = Vec3::new(-width / 2.0, 0.0, -depth / 2.0);
    let mut inner = Vec::new();
    for i in 0..nx {
        let along = side * i as f32;
        for (name, degrees, at) in [
            ("north", 0.0, Vec3::new(along, 0.0, 0.0)),
            ("south", 180.0, Vec3::new(along + side, 0.0, depth)),
            ("west", 90.0, Vec3::new(0.0, 0.0, along + side)),
            ("east", -90.0, Vec3::new(width, 0.0, along)),
        ] {
            let name = format!("{name} {i}");
            k.place(&name, panel, degrees, at + middle);
            let inward = turned(degrees, Vec3::ZERO).transform_vector3(Vec3::Z);
            inner.push((name, inward));
        }
        for j in 0..nz {
            let at = Vec3::new(along, 0.0, side * j as f32) + middle;
            let floor = format!("floor {i}{j}");
            k.place(&floor, tile, 0.0, at);
            let roof = format!("roof {i}{j}");
            k.place(&roof, tile, 0.0, at + Vec3::Y * (tall + t));
            inner.extend([(floor, Vec3::Y), (roof, Vec3::NEG_Y)]);
        }
    }
    for (i, (x, z)) in [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
        .into_iter()
        .enumerate()
    {
        let name = format!("post {i}");
        k.place(&name, post, -90.0 * i as f32, Vec3::new(x, 0.0, z) + middle);
    }
    for (name, inward) in inner {
        // Up to the middle of the walls: their inner faces, and the part of the tiles between the
        // walls.
        let (x, z) = (width / 2.0, depth / 2.0);
        let within = span([-x - 1e-4, x + 1e-4], ALL, [-z - 1e-4, z + 1e-4]);
        k.region(Kind::Dark, &name, within).facing(inward);
    }
    for i in 0..nx {
        k.region(Kind::Lit, &format!("east {i}"), Vec::new())
            .facing(Vec3::X)
            .region(Kind::Lit, &format!("south {i}"), Vec::new())
            .facing(Vec3::Z);
    }
    in_the_open(
        k,
        "modular",
        "hall of a kit: instances of a wall panel of 10 cm, a post and a tile, turned by 90° and put edge to edge",
    )
}

/// The arch of a barrel vault along z, facets and normals outwards, from `z` to −`z`.
fn arch(radius: f32, spring: f32, z: f32, n: u32) -> Geometry {
    let mut out = Geometry::default();
    for end in [z, -z] {
        for i in 0..=n {
            let d = Vec2::from_angle(PI * i as f32 / n as f32);
            out.positions
                .push(Vec3::new(radius * d.x, spring + radius * d.y, end));
            out.normals.push(d.extend(0.0));
        }
    }
    let row = n + 1;
    for i in 0..n {
        out.triangles.push([i, i + row, i + row + 1]);
        out.triangles.push([i, i + row + 1, i + 1]);
    }
    out
}

/// The end wall of the vault at `z`, front along +z if `z` > 0.
fn gable(radius: f32, spring: f32, low: f32, z: f32, n: u32) -> Geometry {
    let mut outline = vec![Vec2::new(-radius, low), Vec2::new(radius, low)];
    for i in 0..=n {
        outline.push(Vec2::new(0.0, spring) + radius * Vec2::from_angle(PI * i as f32 / n as f32));
    }
    let g = Geometry {
        positions: outline.iter().map(|p| p.extend(z)).collect(),
        normals: vec![Vec3::Z; outline.len()],
        triangles: (1..outline.len() as u32 - 1)
            .map(|i| [0, i, i + 1])
            .collect(),
        ..Geometry::default()
    };
    if z > 0.0 { g } else { g.flipped() }
}

/// The four surfaces of a hall under a vault, fronts outwards: arch, side walls, gables.
fn vaulted(radius: f32, spring: f32, low: f32, z: f32) -> [Geometry; 3] {
    let n = 10;
    let wall = |x: f32| {
        let (up, along) = (Vec3::Y * (spring - low), Vec3::Z * 2.0 * z);
        let g = grid(Vec3::new(x, low, -z), up, along, [1, 1]);
        let g = if x > 0.0 { g } else { g.flipped() };
        Geometry {
            uv: Vec::new(),
            ..g
        }
    };
    [
        arch(radius, spring, z, n),
        Geometry::union(&[wall(radius), wall(-radius)]),
        Geometry::union(&[
            gable(radius, spring, low, z, n),
            gable(radius, spring, low, -z, n),
        ]),
    ]
}

/// A smooth-shaded barrel vault on two walls, with two skins 5 cm apart.
pub(super) fn vault() -> LeakScene {
    let mut k = Kit::new();
    k.ground(4.5, 0.0).sun(SUN);
    let (radius, spring, z, t) = (1.5, 1.1, 2.0, 0.05);
    let names = ["vault", "sides", "gables"];
    // The inner arch stands on the inner walls; its facets' middles are 1.8 cm nearer to the axis
    // than its edges.
    for (name, g) in names.iter().zip(vaulted(radius, spring, -0.05, z)) {
        k.part(name, &g.flipped());
        k.region(Kind::Dark, name, span(ALL, [0.0, FAR], ALL));
    }
    let outer = ["outer vault", "outer sides", "outer gables"];
    for (name, g) in outer.iter().zip(vaulted(radius + t, spring, -0.05, z + t)) {
        k.part(name, &g);
    }
    let hall = |e: f32| span([-radius - e, radius + e], ALL, [-z - e, z + e]);
    k.region(Kind::Dark, "ground", hall(0.0))
        .region(
            Kind::Lit,
            "ground",
            span([radius + t, FAR], ALL, [-0.5, FAR]),
        )
        .region(Kind::Lit, "outer sides", span(ALL, [0.0, FAR], ALL))
        .facing(Vec3::X);
    LeakScene {
        shared_lumels: true,
        ..in_the_open(
            k,
            "vault",
            "smooth-shaded vault of ten facets on walls, inner and outer skin 5 cm apart, the ground its floor",
        )
    }
}

/// A shed whose roof lies 1 mm above its walls, which are 5 cm thick.
pub(super) fn roof_gap() -> LeakScene {
    let mut k = Kit::new();
    k.ground(4.5, 0.0).sun(SUN);
    let frame = turned(7.0, Vec3::new(0.1, 0.0, 0.2));
    let wall = 0.05;
    house(&mut k, frame, -0.05, wall, 0.001);
    house_regions(&mut k, frame, Kind::Dim);
    k.region(
        Kind::Lit,
        "ground",
        span_in(frame, [HOUSE.x + wall, FAR], ALL, [-0.5, FAR]),
    );
    LeakScene {
        shared_lumels: true,
        ..in_the_open(
            k,
            "roof_gap",
            "shed with walls of 5 cm whose roof lies 1 mm above them: a little light is right",
        )
    }
}
