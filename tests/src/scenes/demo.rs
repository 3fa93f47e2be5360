//! The demo level: a small keep with a pillared hall, a courtyard, a corridor and three rooms off
//! it.
//!
//! Units are relative: R = E/π is 1 on a level floor in full sun, so that a preview needs no
//! exposure. It needs no sky; `--sky 0.25,0.35,0.5` makes the courtyard's shade bluer.

use std::f32::consts::PI;

use glam::{Affine3A, Quat, Vec2, Vec3};

use super::add_camera;
use crate::carve::{Carver, Face};
use crate::geometry::{Geometry, box_faces, cuboid, grid, icosphere, prism, quad};
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};
use crate::textures;

/// Thickness of walls and slabs, metres.
const WALL: f32 = 0.3;
/// Direction in which sunlight travels: into the hall through the courtyard's arches.
const SUN: Vec3 = Vec3::new(-0.42, -0.62, 0.66);

/// The spaces of the level; the number is the [`crate::carve::Space`].
const SPACES: [&str; 8] = [
    "outside",
    "hall",
    "courtyard",
    "corridor",
    "grate_room",
    "gallery",
    "store",
    "doorways",
];
const OUTSIDE: u8 = 0;
const HALL: u8 = 1;
const COURTYARD: u8 = 2;
const CORRIDOR: u8 = 3;
const GRATE_ROOM: u8 = 4;
const GALLERY: u8 = 5;
const STORE: u8 = 6;
const DOORWAYS: u8 = 7;

/// Paints of the architecture, in the order of [`paints`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Paint {
    Tiles,
    Plaster,
    Dado,
    Ceiling,
    Paving,
    Sandstone,
    Slate,
    CorridorWall,
    Blue,
    Concrete,
    Terracotta,
    Boards,
    Ochre,
    Trim,
    Render,
    Grass,
}

/// The demo level as GLB.
///
/// It has six spaces with doorways between them; roofs everywhere but over the courtyard; about
/// fifty instances of shared props; tiles, boards, bricks and crates with textures; a masked grate
/// over an opening in the roof; emissive panels and lanterns; a sun, point lights and a spot. The
/// first camera is in the hall, the second shows the level from above.
pub fn demo_level() -> Vec<u8> {
    let mut b = GltfBuilder::new();
    architecture(&mut b);
    hall_and_courtyard(&mut b);
    corridor_and_grate(&mut b);
    gallery(&mut b);
    store(&mut b);
    let sun = b.light("sun", Light::Directional([9.4, 8.8, 7.6]));
    b.node(Node {
        name: "sun".into(),
        translation: Vec3::new(10.0, 20.0, -10.0),
        rotation: look_along(SUN, Vec3::Y),
        light: Some(sun),
        ..Node::default()
    });
    add_camera(
        &mut b,
        Vec3::new(1.5, 1.95, 6.4),
        Vec3::new(8.6, 1.55, 1.9),
        60.0,
    );
    add_camera(
        &mut b,
        Vec3::new(-0.5, 17.0, -21.0),
        Vec3::new(13.4, 0.0, 1.6),
        42.0,
    );
    add_camera(
        &mut b,
        Vec3::new(12.9, 1.65, 4.3),
        Vec3::new(27.0, 1.35, 4.7),
        58.0,
    );
    add_camera(
        &mut b,
        Vec3::new(19.4, 1.8, -2.4),
        Vec3::new(15.6, 0.9, 3.0),
        66.0,
    );
    add_camera(
        &mut b,
        Vec3::new(19.4, 1.7, 10.4),
        Vec3::new(15.4, 1.3, 7.2),
        66.0,
    );
    add_camera(
        &mut b,
        Vec3::new(24.8, 2.2, 7.4),
        Vec3::new(28.6, 0.9, 3.2),
        66.0,
    );
    b.finish()
}

fn architecture(b: &mut GltfBuilder) {
    let mut c = Carver::new();
    // Ground around the building, then each space's shell of rock, then the spaces themselves.
    c.fill([-3.3, -WALL, -11.3], [33.0, -0.06, 14.3]);
    let spaces: [(u8, [f32; 3], [f32; 3]); 6] = [
        (HALL, [0.0, 0.0, 0.0], [12.0, 5.0, 9.0]),
        (COURTYARD, [2.0, 0.0, -8.3], [12.0, 3.2, -WALL]),
        (CORRIDOR, [12.3, 0.0, 3.5], [24.0, 2.8, 5.7]),
        (GRATE_ROOM, [14.0, 0.0, -3.0], [20.0, 4.0, 3.2]),
        (GALLERY, [14.0, 0.0, 6.0], [20.0, 3.4, 11.0]),
        (STORE, [24.3, 0.0, 1.0], [30.0, 4.2, 8.0]),
    ];
    for (space, min, max) in spaces {
        let roof = if space == COURTYARD { 0.0 } else { WALL };
        c.fill(
            [min[0] - WALL, -WALL, min[2] - WALL],
            [max[0] + WALL, max[1] + roof, max[2] + WALL],
        );
    }
    for (space, min, max) in spaces {
        c.carve(min, max, space);
    }
    // Hall to courtyard: three openings; the other doors; a window from the gallery to the grounds.
    for x in [3.2, 6.2, 9.2] {
        c.carve([x, 0.0, -WALL], [x + 1.8, 3.0, 0.0], DOORWAYS);
    }
    c.carve([12.0, 0.0, 3.9], [12.3, 2.3, 5.3], DOORWAYS);
    c.carve([17.8, 0.0, 3.2], [19.2, 2.3, 3.5], DOORWAYS);
    c.carve([16.2, 0.0, 5.7], [17.6, 2.3, 6.0], DOORWAYS);
    c.carve([24.0, 0.0, 3.9], [24.3, 2.3, 5.3], DOORWAYS);
    c.carve([20.0, 1.0, 7.4], [20.3, 2.4, 9.6], DOORWAYS);
    // The opening under the grate, and a skylight over the store's stairs.
    c.carve([17.2, 4.0, -2.6], [19.4, 4.3, -0.4], GRATE_ROOM);
    c.carve([26.0, 4.2, 1.8], [28.0, 4.5, 3.2], STORE);
    c.cut(1, 1.05);
    let faces = c.faces(|f| paint(f).map(|p| (f.space, p)));
    let paints = paints(b);
    for (space, name) in SPACES.iter().enumerate() {
        let scaled: Vec<(Geometry, usize)> = faces
            .iter()
            .filter(|((s, _), _)| usize::from(*s) == space)
            .map(|((_, paint), g)| {
                let (material, metres) = paints[*paint as usize];
                let mut g = g.clone();
                for uv in &mut g.uv {
                    *uv /= metres;
                }
                (g, material)
            })
            .collect();
        let primitives: Vec<(&Geometry, usize)> = scaled.iter().map(|(g, m)| (g, *m)).collect();
        let mesh = b.mesh(name, &primitives);
        b.node(Node::of_mesh(name, mesh));
    }
}

/// The paint of a face, by its position and the space in front of it.
fn paint(f: &Face) -> Option<Paint> {
    let (up, down) = (f.normal.y > 0.5, f.normal.y < -0.5);
    let low = f.centre.y < 1.05;
    let floor = up && f.centre.y.abs() < 0.01;
    Some(match f.space {
        // The underside of the ground belongs to no space.
        OUTSIDE if down => return None,
        OUTSIDE if up && f.centre.y < 0.0 => Paint::Grass,
        OUTSIDE => Paint::Render,
        HALL if floor => Paint::Tiles,
        HALL if down => Paint::Ceiling,
        HALL if low => Paint::Dado,
        HALL => Paint::Plaster,
        COURTYARD if floor => Paint::Paving,
        COURTYARD => Paint::Sandstone,
        CORRIDOR if floor => Paint::Slate,
        CORRIDOR if down => Paint::Ceiling,
        CORRIDOR => Paint::CorridorWall,
        GRATE_ROOM if floor => Paint::Concrete,
        GRATE_ROOM if down => Paint::Ceiling,
        GRATE_ROOM => Paint::Blue,
        GALLERY if floor => Paint::Boards,
        GALLERY if down => Paint::Ceiling,
        GALLERY => Paint::Terracotta,
        STORE if floor => Paint::Concrete,
        STORE if down => Paint::Ceiling,
        STORE => Paint::Ochre,
        _ => Paint::Trim,
    })
}

/// The material of each [`Paint`], and the metres that its texture covers.
fn paints(b: &mut GltfBuilder) -> Vec<(usize, f32)> {
    let tiles = b.texture(
        "tiles",
        &textures::tiles(128, [226, 218, 202], [116, 122, 128], [88, 86, 84]),
        false,
    );
    let paving = b.texture(
        "paving",
        &textures::bricks(128, [196, 176, 146], [128, 116, 100]),
        false,
    );
    let stone = b.texture(
        "sandstone",
        &textures::bricks(128, [214, 186, 146], [168, 148, 120]),
        false,
    );
    let boards = b.texture("boards", &textures::boards(128, [164, 116, 76]), false);
    let grass = b.texture("grass", &textures::ground(64, [120, 146, 84]), false);
    let mut plain = |name: &str, rgb: [f32; 3]| (b.material(&Material::diffuse(name, rgb)), 1.0);
    let plaster = plain("plaster", [0.72, 0.68, 0.60]);
    let dado = plain("dado", [0.13, 0.30, 0.30]);
    let ceiling = plain("ceiling", [0.74, 0.72, 0.68]);
    let slate = plain("slate", [0.26, 0.28, 0.31]);
    let corridor = plain("corridor_wall", [0.58, 0.64, 0.60]);
    let blue = plain("blue_wall", [0.24, 0.40, 0.58]);
    let concrete = plain("concrete", [0.50, 0.49, 0.46]);
    let terracotta = plain("terracotta", [0.66, 0.27, 0.17]);
    let ochre = plain("ochre", [0.66, 0.50, 0.24]);
    let trim = plain("trim", [0.34, 0.22, 0.14]);
    let render = plain("render", [0.60, 0.57, 0.52]);
    let mut textured = |name: &str, texture: usize, metres: f32| {
        (
            b.material(&Material {
                texture: Some(texture),
                ..Material::diffuse(name, [1.0; 3])
            }),
            metres,
        )
    };
    vec![
        textured("tiles", tiles, 3.0),
        plaster,
        dado,
        ceiling,
        textured("paving", paving, 2.0),
        textured("sandstone", stone, 2.0),
        slate,
        corridor,
        blue,
        concrete,
        terracotta,
        textured("boards", boards, 2.0),
        ochre,
        trim,
        render,
        textured("grass", grass, 4.0),
    ]
}

/// A node of `mesh` at a place, turned about Y by `turn` radians and scaled.
fn put(b: &mut GltfBuilder, name: &str, mesh: usize, at: [f32; 3], turn: f32, scale: Vec3) {
    // Half-angles in f64, because the asset's bytes must not depend on the platform's f32 sine.
    let (s, c) = (f64::from(turn) / 2.0).sin_cos();
    b.node(Node {
        translation: at.into(),
        rotation: Quat::from_xyzw(0.0, s as f32, 0.0, c as f32),
        scale,
        ..Node::of_mesh(name, mesh)
    });
}

fn lamp(b: &mut GltfBuilder, name: &str, light: usize, at: [f32; 3], along: Vec3) {
    b.node(Node {
        name: name.into(),
        translation: at.into(),
        rotation: look_along(along, Vec3::Y),
        light: Some(light),
        ..Node::default()
    });
}

/// A regular outline of `n` corners, in the order that [`prism`] wants.
fn ring(n: u32, radius: f32) -> Vec<Vec2> {
    (0..n)
        .map(|i| {
            let (s, c) = (-f64::from(i) / f64::from(n) * 2.0 * f64::from(PI)).sin_cos();
            Vec2::new(c as f32 * radius, s as f32 * radius)
        })
        .collect()
}

/// Without the faces that look straight down, for objects that stand on a floor, sunk into it by a
/// centimetre.
fn without_bottom(mut g: Geometry) -> Geometry {
    g.triangles.retain(|t| g.normals[t[0] as usize].y > -0.5);
    g
}

fn hall_and_courtyard(b: &mut GltfBuilder) {
    let marble = b.material(&Material::diffuse("marble", [0.74, 0.70, 0.63]));
    let bronze = b.material(&Material::diffuse("bronze", [0.30, 0.21, 0.11]));
    let glow = b.material(&Material::emitter(
        "lantern_glow",
        [26.0, 15.5, 6.5],
        [0.5; 3],
    ));
    let leaf = b.material(&Material::diffuse("leaf", [0.16, 0.36, 0.10]));
    let bark = b.material(&Material::diffuse("bark", [0.22, 0.15, 0.10]));
    let cloth = b.material(&Material::diffuse("banner", [0.60, 0.09, 0.08]));
    // A pillar in three parts that overlap by volume, not by faces.
    let pillar = Geometry::union(&[
        without_bottom(cuboid(
            Vec3::new(-0.42, -0.01, -0.42),
            Vec3::new(0.42, 0.3, 0.42),
            1,
        )),
        without_bottom(prism(&ring(16, 0.3), 0.29, 4.56)),
        cuboid(
            Vec3::new(-0.42, 4.55, -0.42),
            Vec3::new(0.42, 5.01, 0.42),
            1,
        ),
    ]);
    let pillar = b.mesh("pillar", &[(&pillar, marble)]);
    for (i, x) in [2.6, 6.0, 9.4].into_iter().enumerate() {
        put(
            b,
            &format!("pillar_north_{i}"),
            pillar,
            [x, 0.0, 1.9],
            0.0,
            Vec3::ONE,
        );
        put(
            b,
            &format!("pillar_south_{i}"),
            pillar,
            [x, 0.0, 7.1],
            0.0,
            Vec3::ONE,
        );
    }
    for (i, (x, z, h)) in [(3.0, -7.2, 0.52), (11.0, -7.2, 0.34), (3.0, -1.6, 0.22)]
        .into_iter()
        .enumerate()
    {
        put(
            b,
            &format!("ruined_pillar_{i}"),
            pillar,
            [x, 0.0, z],
            0.3,
            Vec3::new(0.8, h, 0.8),
        );
    }
    // Lanterns on the hall's walls: a bronze back plate and a glowing body.
    let plate = cuboid(
        Vec3::new(-0.12, -0.25, -0.01),
        Vec3::new(0.12, 0.25, 0.03),
        1,
    );
    let body = cuboid(
        Vec3::new(-0.09, -0.16, 0.06),
        Vec3::new(0.09, 0.16, 0.24),
        1,
    );
    let cap = cuboid(Vec3::new(-0.12, 0.19, 0.02), Vec3::new(0.12, 0.24, 0.27), 1);
    let lantern = b.mesh(
        "lantern",
        &[(&Geometry::union(&[plate, cap]), bronze), (&body, glow)],
    );
    for (i, x) in [1.4, 4.3, 7.7, 10.8].into_iter().enumerate() {
        put(
            b,
            &format!("lantern_{i}"),
            lantern,
            [x, 2.6, 9.0],
            PI,
            Vec3::ONE,
        );
    }
    put(
        b,
        "lantern_4",
        lantern,
        [12.0, 2.7, 2.4],
        -PI / 2.0,
        Vec3::ONE,
    );
    put(
        b,
        "lantern_5",
        lantern,
        [12.0, 2.7, 6.8],
        -PI / 2.0,
        Vec3::ONE,
    );
    put(b, "lantern_6", lantern, [1.7, 2.7, 0.0], 0.0, Vec3::ONE);
    put(b, "lantern_7", lantern, [11.5, 2.7, 0.0], 0.0, Vec3::ONE);
    // A dais of two steps at the hall's west end, sunk into the wall by two centimetres.
    let steps = [
        cuboid(Vec3::new(-0.02, -0.01, 2.6), Vec3::new(2.0, 0.18, 6.4), 1),
        cuboid(Vec3::new(-0.02, 0.17, 3.0), Vec3::new(1.6, 0.36, 6.0), 1),
    ];
    let dais_m = b.material(&Material::diffuse("dais", [0.40, 0.42, 0.45]));
    let dais = b.mesh(
        "dais",
        &[(&Geometry::union(&steps.map(without_bottom)), dais_m)],
    );
    b.node(Node::of_mesh("dais", dais));
    // Banners over the dais and between the arches, a throne of two boxes.
    let banner = cuboid(Vec3::new(-0.5, -2.6, 0.02), Vec3::new(0.5, 0.0, 0.05), 1);
    let banner = b.mesh("banner", &[(&banner, cloth)]);
    for (i, z) in [3.3, 5.7].into_iter().enumerate() {
        put(
            b,
            &format!("banner_west_{i}"),
            banner,
            [0.0, 4.3, z],
            PI / 2.0,
            Vec3::ONE,
        );
    }
    for (i, x) in [5.6, 8.6].into_iter().enumerate() {
        put(
            b,
            &format!("banner_north_{i}"),
            banner,
            [x, 4.4, 0.0],
            0.0,
            Vec3::new(0.9, 1.0, 1.0),
        );
    }
    let seat = without_bottom(cuboid(
        Vec3::new(0.3, 0.35, 4.0),
        Vec3::new(1.1, 0.9, 5.0),
        1,
    ));
    let rest = without_bottom(cuboid(
        Vec3::new(0.12, 0.35, 3.9),
        Vec3::new(0.29, 2.1, 5.1),
        1,
    ));
    let throne = b.mesh("throne", &[(&Geometry::union(&[seat, rest]), bronze)]);
    b.node(Node::of_mesh("throne", throne));
    // A basin: an octagonal rim around a floor of water-green stone.
    let water = b.material(&Material::diffuse("water", [0.10, 0.34, 0.36]));
    let (rim, pool) = basin(1.5, 1.2);
    let basin = b.mesh("basin", &[(&rim, marble), (&pool, water)]);
    b.node(Node {
        translation: Vec3::new(7.0, 0.0, -4.5),
        ..Node::of_mesh("basin", basin)
    });
    // Courtyard: a monument in the basin, trees in it and on the grounds.
    let plinth = without_bottom(prism(&ring(8, 0.5), 0.15, 1.0));
    let ball = icosphere(Vec3::new(0.0, 1.5, 0.0), 0.52, 2);
    let monument = b.mesh("monument", &[(&plinth.bare(), marble), (&ball, bronze)]);
    put(b, "monument", monument, [7.0, 0.0, -4.5], 0.2, Vec3::ONE);
    let trunk = without_bottom(prism(&ring(7, 0.14), -0.08, 1.5)).bare();
    let crown = Geometry::union(&[
        icosphere(Vec3::new(0.0, 2.1, 0.0), 0.85, 1),
        icosphere(Vec3::new(0.35, 2.8, 0.2), 0.6, 1),
        icosphere(Vec3::new(-0.4, 2.65, -0.25), 0.5, 1),
    ]);
    let tree = b.mesh("tree", &[(&trunk, bark), (&crown, leaf)]);
    let places = [
        (10.3, 0.0, -2.3, 0.9),
        (4.2, 0.0, -7.0, 0.8),
        (0.2, -0.06, -5.0, 1.2),
        (14.6, -0.06, -7.5, 1.1),
        (23.0, -0.06, -1.5, 1.0),
        (22.4, -0.06, 10.0, 1.2),
        (-1.8, -0.06, 4.0, 0.9),
        (9.0, -0.06, 12.2, 1.1),
    ];
    for (i, (x, y, z, s)) in places.into_iter().enumerate() {
        put(
            b,
            &format!("tree_{i}"),
            tree,
            [x, y, z],
            i as f32 * 1.3,
            Vec3::splat(s),
        );
    }
}

/// Rim and floor of an octagonal basin, 0.45 m high, its floor 16 cm above the ground.
fn basin(outer: f32, inner: f32) -> (Geometry, Geometry) {
    let (o, i) = (ring(8, outer), ring(8, inner));
    let at = |p: Vec2, y: f32| Vec3::new(p.x, y, p.y);
    let (bottom, top, floor) = (-0.01, 0.45, 0.16);
    let mut rim = Geometry::default();
    let mut pool = Geometry {
        normals: vec![Vec3::Y; 8],
        uv: i.clone(),
        ..Geometry::default()
    };
    pool.positions = i.iter().map(|&p| at(p, floor)).collect();
    pool.triangles = (1..7).map(|k| [0, k, k + 1]).collect();
    for k in 0..8 {
        let n = (k + 1) % 8;
        rim.append(&quad([
            at(o[k], bottom),
            at(o[n], bottom),
            at(o[n], top),
            at(o[k], top),
        ]));
        rim.append(&quad([
            at(o[k], top),
            at(o[n], top),
            at(i[n], top),
            at(i[k], top),
        ]));
        rim.append(&quad([
            at(i[n], floor),
            at(i[k], floor),
            at(i[k], top),
            at(i[n], top),
        ]));
    }
    (rim, pool)
}

fn corridor_and_grate(b: &mut GltfBuilder) {
    let frame = b.material(&Material::diffuse("fixture", [0.45, 0.46, 0.48]));
    let cool = b.material(&Material::emitter("panel_glow", [4.2, 5.2, 6.2], [0.6; 3]));
    // A ceiling panel: a frame that hangs two centimetres below the ceiling, and a glowing face set
    // into it.
    let panel_frame = cuboid(
        Vec3::new(-0.75, -0.12, -0.2),
        Vec3::new(0.75, -0.02, 0.2),
        1,
    );
    let y = -0.13;
    let face = quad([
        Vec3::new(-0.7, y, -0.15),
        Vec3::new(0.7, y, -0.15),
        Vec3::new(0.7, y, 0.15),
        Vec3::new(-0.7, y, 0.15),
    ]);
    let panel = b.mesh("ceiling_panel", &[(&panel_frame, frame), (&face, cool)]);
    for (i, x) in [14.2, 17.4, 20.6, 22.9].into_iter().enumerate() {
        put(
            b,
            &format!("panel_{i}"),
            panel,
            [x, 2.8, 4.6],
            0.0,
            Vec3::ONE,
        );
    }
    // The grate lies in the roof's opening; a texture tile is 44 cm, so that bars are 11 cm apart
    // from opening to opening.
    let iron = b.texture("grate", &textures::grate(64, [92, 88, 84]), false);
    let iron = b.material(&Material {
        texture: Some(iron),
        mask: Some(0.5),
        double_sided: true,
        ..Material::diffuse("grate", [1.0; 3])
    });
    let mut bars = grid(
        Vec3::new(17.2, 4.15, -0.4),
        Vec3::X * 2.2,
        Vec3::Z * -2.2,
        [1, 1],
    );
    for uv in &mut bars.uv {
        *uv /= 0.44;
    }
    let bars = b.mesh("grate", &[(&bars, iron)]);
    b.node(Node::of_mesh("grate", bars));
    // Barrels, and a machine with a glowing screen.
    let steel = b.material(&Material::diffuse("barrel", [0.16, 0.40, 0.26]));
    let barrel = Geometry::union(&[
        without_bottom(prism(&ring(14, 0.3), -0.01, 0.92)),
        prism(&ring(14, 0.33), 0.28, 0.34),
        prism(&ring(14, 0.33), 0.58, 0.64),
    ]);
    let barrel = b.mesh("barrel", &[(&barrel, steel)]);
    let barrels = [
        (14.5, -2.4),
        (15.2, -2.5),
        (14.6, -1.7),
        (19.5, 2.6),
        (23.4, 3.95),
        (29.4, 1.6),
        (28.7, 1.5),
    ];
    for (i, (x, z)) in barrels.into_iter().enumerate() {
        put(
            b,
            &format!("barrel_{i}"),
            barrel,
            [x, 0.0, z],
            i as f32,
            Vec3::ONE,
        );
    }
    let screen = b.material(&Material::emitter("screen", [0.5, 3.2, 2.4], [0.1; 3]));
    let body = without_bottom(cuboid(
        Vec3::new(-0.9, -0.01, -0.35),
        Vec3::new(0.9, 1.7, 0.35),
        1,
    ));
    let z = 0.36;
    let face = quad([
        Vec3::new(-0.7, 0.9, z),
        Vec3::new(0.7, 0.9, z),
        Vec3::new(0.7, 1.5, z),
        Vec3::new(-0.7, 1.5, z),
    ]);
    let console = b.mesh("console", &[(&body, frame), (&face, screen)]);
    put(b, "console", console, [14.4, 0.0, 0.2], PI / 2.0, Vec3::ONE);
}

fn gallery(b: &mut GltfBuilder) {
    let wood = b.material(&Material::diffuse("bench_wood", [0.42, 0.27, 0.15]));
    let parts = [
        (Vec3::new(-0.9, 0.42, -0.22), Vec3::new(0.9, 0.5, 0.22)),
        (Vec3::new(-0.8, -0.01, -0.18), Vec3::new(-0.68, 0.43, 0.18)),
        (Vec3::new(0.68, -0.01, -0.18), Vec3::new(0.8, 0.43, 0.18)),
    ];
    let mut bench = Geometry::default();
    for (i, (min, max)) in parts.into_iter().enumerate() {
        let g = cuboid(min, max, 1);
        bench.append(&if i == 0 { g } else { without_bottom(g) });
    }
    let bench = b.mesh("bench", &[(&bench, wood)]);
    put(b, "bench_0", bench, [16.2, 0.0, 8.5], 0.0, Vec3::ONE);
    put(b, "bench_1", bench, [18.6, 0.0, 8.5], 0.0, Vec3::ONE);
    put(b, "bench_2", bench, [0.6, 0.0, 1.3], PI / 2.0, Vec3::ONE);
    // Pictures: a dark frame and a canvas of one strong colour each.
    let dark = b.material(&Material::diffuse("picture_frame", [0.12, 0.09, 0.07]));
    let colours = [
        ("canvas_gold", [0.75, 0.58, 0.12]),
        ("canvas_sea", [0.08, 0.34, 0.62]),
        ("canvas_moss", [0.24, 0.50, 0.14]),
    ];
    let frame = cuboid(Vec3::new(-0.7, -0.5, 0.01), Vec3::new(0.7, 0.5, 0.06), 1);
    let canvas = grid(
        Vec3::new(-0.62, -0.42, 0.065),
        Vec3::X * 1.24,
        Vec3::Y * 0.84,
        [1, 1],
    );
    for (i, (name, rgb)) in colours.into_iter().enumerate() {
        let paint = b.material(&Material::diffuse(name, rgb));
        let mesh = b.mesh(name, &[(&frame, dark), (&canvas, paint)]);
        put(
            b,
            &format!("picture_{i}"),
            mesh,
            [14.0, 1.7, 7.1 + 1.4 * i as f32],
            PI / 2.0,
            Vec3::new(0.85, 0.85, 1.0),
        );
        put(
            b,
            &format!("picture_{}", i + 3),
            mesh,
            [15.2 + 1.8 * i as f32, 1.7, 11.0],
            PI,
            Vec3::ONE,
        );
    }
    // Two pendant lamps: an opaque shade open below, a point light under it.
    let shade_m = b.material(&Material {
        double_sided: true,
        ..Material::diffuse("shade", [0.70, 0.62, 0.48])
    });
    let shade = without_bottom(prism(&ring(12, 0.28), 0.0, 0.22));
    let cord = prism(&ring(6, 0.015), 0.21, 1.01);
    let pendant = b.mesh("pendant", &[(&shade, shade_m), (&cord, dark)]);
    let light = b.light("pendant", Light::Point([4.6, 3.7, 2.5]));
    for (i, x) in [15.6, 18.4].into_iter().enumerate() {
        put(
            b,
            &format!("pendant_{i}"),
            pendant,
            [x, 2.4, 8.5],
            0.0,
            Vec3::ONE,
        );
        lamp(
            b,
            &format!("pendant_light_{i}"),
            light,
            [x, 2.36, 8.5],
            Vec3::NEG_Y,
        );
    }
}

fn store(b: &mut GltfBuilder) {
    let face = b.texture("crate", &textures::crate_face(64, [178, 134, 84]), false);
    let wood = b.material(&Material {
        texture: Some(face),
        ..Material::diffuse("crate", [1.0; 3])
    });
    let mut sides = box_faces(Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 1.0, 0.5), 1);
    for g in &mut sides {
        for uv in &mut g.uv {
            uv.y += 1.0;
        }
    }
    // A crate keeps its bottom: some stand across the edge of another.
    let crate_mesh = b.mesh("crate", &[(&Geometry::union(&sides), wood)]);
    let crates = [
        ([25.2, -0.01, 1.8], 0.15, 1.0),
        ([26.4, -0.01, 1.7], -0.1, 0.9),
        ([25.7, 0.991, 1.8], 0.5, 0.75),
        ([29.2, -0.01, 3.4], 0.3, 1.1),
        ([29.3, -0.01, 4.55], -0.2, 0.8),
        ([29.2, 1.091, 3.4], 0.9, 0.6),
        ([29.3, 1.09, 7.3], 0.25, 0.8),
        ([28.6, 1.09, 7.5], -0.3, 0.55),
        ([18.9, -0.01, -2.3], 0.4, 0.9),
        ([11.3, -0.01, 0.8], 0.2, 0.8),
        ([21.8, -0.01, 5.25], 0.12, 0.6),
        ([11.2, -0.01, -5.6], -0.35, 0.9),
        ([10.2, -0.01, -6.6], 0.6, 0.7),
    ];
    for (i, (at, turn, size)) in crates.into_iter().enumerate() {
        put(
            b,
            &format!("crate_{i}"),
            crate_mesh,
            at,
            turn,
            Vec3::splat(size),
        );
    }
    // Stairs to a landing, sunk into the walls by two centimetres.
    let stone = b.material(&Material::diffuse("stairs", [0.48, 0.46, 0.43]));
    let mut stairs = without_bottom(cuboid(
        Vec3::new(27.9, -0.01, 5.2),
        Vec3::new(30.02, 1.1, 8.02),
        1,
    ));
    for step in 0..4u8 {
        // Each step reaches two centimetres into the next one.
        let x = 26.62 + 0.32 * f32::from(step);
        let high = 0.22 * f32::from(step + 1);
        stairs.append(&without_bottom(cuboid(
            Vec3::new(x, -0.01, 5.6),
            Vec3::new(x + 0.34, high, 7.4),
            1,
        )));
    }
    let stairs = b.mesh("stairs", &[(&stairs, stone)]);
    b.node(Node::of_mesh("stairs", stairs));
    // A warm spot on the crates from a can at the ceiling.
    let can_m = b.material(&Material::diffuse("spot_can", [0.2; 3]));
    let can = prism(&ring(12, 0.12), 0.0, 0.3)
        .transformed(Affine3A::from_translation(Vec3::new(0.0, -0.32, 0.0)));
    let can = b.mesh("spot_can", &[(&can, can_m)]);
    put(b, "spot_can", can, [26.6, 4.2, 4.6], 0.0, Vec3::ONE);
    let spot = b.light("spot", Light::Spot([22.0, 16.0, 8.5], 0.35, 0.75));
    lamp(
        b,
        "spot",
        spot,
        [26.6, 3.84, 4.6],
        Vec3::new(1.6, -3.2, -1.1),
    );
    let fill = b.light("store_fill", Light::Point([1.6, 1.9, 2.4]));
    lamp(b, "store_fill", fill, [25.4, 3.3, 6.6], Vec3::NEG_Y);
}
