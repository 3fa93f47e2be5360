use glam::Vec2;
use mesh_ingest::{Image, Scene, Soup, TextureRef, Wrap};
use visibility::Ray;

use super::*;
use crate::emitters::Emitters;
use crate::fixtures::{add_quad, cube, lamp, material};
use crate::monitor::Silent;
use crate::sampling::sample_2d;
use crate::solve::{SolveOptions, solve};
use crate::world::WorldOptions;

/// A lit room with a chequered floor of 64 × 64 fields.
fn chequered_room() -> Scene {
    let mut scene = cube(0.5, Vec3::ZERO);
    let field = |k: u32| match (k % 64 + k / 64) % 2 {
        0 => [230, 230, 230, 255],
        _ => [30, 60, 30, 255],
    };
    scene.images.push(Some(Image {
        width: 64,
        height: 64,
        pixels: (0..64 * 64).map(field).collect(),
    }));
    let mut floor = material(1.0, Vec3::ZERO);
    floor.base_texture = Some(TextureRef {
        image: 0,
        tex_coord: 0,
        transform: glam::Affine2::IDENTITY,
        wrap: [Wrap::Clamp; 2],
        nearest: true,
    });
    add_quad(&mut scene, floor, Vec3::Z * 0.01, Vec3::X, Vec3::Y);
    if let Some(mesh) = scene.meshes.last_mut() {
        mesh.primitives[0].tex_coords = vec![vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]];
    }
    scene.lights.push(lamp());
    scene
}

fn look(hit: &Hit, at: Vec3, of: Reflected) -> Look {
    Look {
        hit: *hit,
        at,
        seed: 1,
        of,
    }
}

/// The results of `look` for `n` hits spread over the middle of the floor.
fn over_the_floor(n: u32, mut look: impl FnMut(&World, &Solution, &DirectLight, &Hit, Vec3)) {
    let scene = chequered_room();
    let soup = Soup::build(&scene);
    let world = World::build(&scene, &soup, WorldOptions::default()).expect("a tree");
    let emitters = Emitters::collect(&world);
    let mut options = SolveOptions::default();
    // Elements of 7 cm, four fields across.
    options.cut.patches = 96;
    let solution = solve(&world, &emitters, &options, &Silent);
    let lights = DirectLight::new(&world, &emitters).on_patches(&solution.cut);
    for k in 0..n {
        let [u, v] = sample_2d(k, 0, 7);
        let ray = Ray {
            origin: Vec3::new(0.1 + 0.8 * u, 0.1 + 0.8 * v, 0.3),
            direction: Vec3::NEG_Z,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        let hit = world.closest_hit(&ray).expect("the floor");
        let at = ray.origin + ray.direction * hit.t;
        look(&world, &solution, &lights, &hit, at);
    }
}

#[test]
fn from_afar_a_surface_sends_what_it_sends_on_average() {
    let (mut near, mut afar, mut differ) = (Vec3::ZERO, Vec3::ZERO, 0);
    let n = 1 << 14;
    over_the_floor(n, |world, solution, lights, hit, at| {
        let sent = |of| {
            solution
                .radiance_sent(world, lights, &look(hit, at, of))
                .light
        };
        let pair = [sent(Reflected::All), sent(Reflected::Afar(0.0))];
        near += pair[0] / n as f32;
        afar += pair[1] / n as f32;
        // Fields are light or dark; their mean is neither.
        differ += u32::from((pair[0] - pair[1]).abs().max_element() > 0.2 * pair[0].max_element());
    });
    // 16,384 points of a Sobol sequence in 4,096 fields determine the share of light fields to 0.1
    // %. An element's mean is over some 16 fields, and its border may cut more light fields or more
    // dark ones.
    let off = (afar / near - 1.0).abs().max_element();
    assert!(off < 0.02, "{near} {afar}");
    assert!(
        differ > n * 9 / 10,
        "{differ}: textures are read at the point"
    );
}

#[test]
fn what_is_left_out_from_afar_is_the_share_of_direct_light() {
    over_the_floor(64, |world, solution, lights, hit, at| {
        let sent = |of| solution.radiance_sent(world, lights, &look(hit, at, of));
        let (all, part) = (sent(Reflected::Afar(0.0)), sent(Reflected::Afar(0.2)));
        assert!(!all.left_out && part.left_out);
        let place = place(world, &solution.cut, hit, at).expect("a patch");
        let afar = solution.afar[place.element.expect("an element").0 as usize];
        let share = of_lit(0.2, luminance(afar.direct));
        let left = afar.reflectance * afar.direct * (share * std::f32::consts::FRAC_1_PI);
        // The roundings of a sum of two numbers.
        let off = (all.light - part.light - left).abs().max_element();
        assert!(off < 1e-6 * all.light.max_element(), "{off}");
    });
}
