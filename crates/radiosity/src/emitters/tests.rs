use glam::Vec2;
use mesh_ingest::{Image, Material, Scene, Soup, TextureRef, Wrap};

use super::*;
use crate::direct::{DirectLight, DirectOptions};
use crate::fixtures::{add_quad, add_triangles, material};
use crate::form_factor::form_factor_polygon;
use crate::sampling::sample_4d;
use crate::world::WorldOptions;

/// A black floor of 20 m at z = 0, large so that a lamp over it is a small part of the scene.
fn floor() -> Scene {
    let mut scene = Scene::default();
    add_quad(
        &mut scene,
        material(0.0, Vec3::ZERO),
        Vec3::new(-10.0, -10.0, 0.0),
        Vec3::X * 20.0,
        Vec3::Y * 20.0,
    );
    scene
}

/// A parallelogram of n × m cells with front `x × y`, whose corners `bend` moves.
fn add_grid(
    scene: &mut Scene,
    material: Material,
    [corner, x, y]: [Vec3; 3],
    [n, m]: [u32; 2],
    keep: impl Fn(u32, u32) -> bool,
    bend: impl Fn(Vec3) -> Vec3,
) {
    let at = |i: u32, j: u32| i * (m + 1) + j;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..=n {
        for j in 0..=m {
            let p = corner + x * (i as f32 / n as f32) + y * (j as f32 / m as f32);
            positions.push(bend(p));
            if i < n && j < m && keep(i, j) {
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    add_triangles(scene, material, positions, triangles);
}

/// 4 × 2 m at height z, front down.
fn panel(z: f32) -> [Vec3; 3] {
    [Vec3::new(-2.0, -1.0, z), Vec3::Y * 2.0, Vec3::X * 4.0]
}

fn with_emitters<R>(scene: &Scene, test: impl FnOnce(&World, &Emitters) -> R) -> R {
    let soup = Soup::build(scene);
    let world = World::build(scene, &soup, WorldOptions::default()).unwrap();
    let emitters = Emitters::collect(&world);
    test(&world, &emitters)
}

#[test]
fn a_grid_in_one_plane_is_two_triangles_wherever_it_hangs() {
    let turned = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
    for place in 0..5 {
        let mut scene = floor();
        add_grid(
            &mut scene,
            material(0.0, Vec3::ONE),
            panel(3.9),
            [50, 100],
            |_, _| true,
            |p| match place {
                0 => p,
                1 => p + Vec3::new(0.123, 7.7, 0.0),
                2 => p * 0.1,
                // A tolerance that grows along a side must not move its corner.
                3 => Vec3::new(p.x, 1.9, p.y),
                _ => turned * (p - Vec3::Z * 3.9) + Vec3::Z * 5.0,
            },
        );
        with_emitters(&scene, |_, emitters| {
            assert_eq!(emitters.len(), 2, "{place}")
        });
    }
}

fn receiver(position: Vec3, normal: Vec3) -> SurfacePoint {
    SurfacePoint {
        position,
        origin: position + normal * 1e-6,
        normal,
        geometric: normal,
    }
}

/// Unoccluded irradiance from a uniform polygon of radiance 1.
fn polygon(p: &SurfacePoint, [o, x, y]: [Vec3; 3]) -> f64 {
    let corners = [o, o + x, o + x + y, o + y].map(|c| c.as_dvec3());
    std::f64::consts::PI * form_factor_polygon(p.position.as_dvec3(), p.normal.as_dvec3(), &corners)
}

/// Unoccluded irradiance from an emitter of radiance 1.
fn closed_form(e: &Emitter, p: &SurfacePoint) -> f64 {
    let corners = e.corners.map(|c| c.as_dvec3());
    let (at, normal) = (p.position.as_dvec3(), p.normal.as_dvec3());
    form_factor_polygon(at, normal, &corners).max(0.0) * std::f64::consts::PI
}

/// Mean and root-mean-square deviation from `exact` (both relative to it), and shadow rays, of `n`
/// estimates with different seeds.
fn statistics(
    world: &World,
    emitters: &Emitters,
    p: &SurfacePoint,
    exact: f64,
    n: u32,
) -> (f64, f64, f64) {
    let light = DirectLight::new(world, emitters);
    let (mut sum, mut squares, mut rays) = (0.0, 0.0, 0);
    for seed in 0..n {
        let got = light.irradiance(|_| *p, 0.0, seed, &PREVIEW);
        let d = f64::from(got.irradiance.x) / exact - 1.0;
        sum += d;
        squares += d * d;
        rays += got.rays;
    }
    let n = f64::from(n);
    (sum / n, (squares / n).sqrt(), f64::from(rays) / n)
}

/// The samples that `--quality preview` takes per lumel.
const PREVIEW: DirectOptions = DirectOptions::every(16, 128);

/// Receivers under the panel of [`panel`], beside it, on a wall, just beside its edge, and close to
/// it.
fn receivers() -> [SurfacePoint; 5] {
    [
        receiver(Vec3::new(0.5, 0.3, 0.0), Vec3::Z),
        receiver(Vec3::new(3.0, 2.0, 0.0), Vec3::Z),
        receiver(Vec3::new(-5.0, 1.0, 2.0), Vec3::X),
        receiver(Vec3::new(-2.2, 1.0, 3.7), Vec3::X),
        receiver(Vec3::new(1.0, 0.5, 3.5), Vec3::Z),
    ]
}

#[test]
fn ten_thousand_triangles_in_one_plane_are_the_rectangle_exactly() {
    let mut one = floor();
    add_grid(
        &mut one,
        material(0.0, Vec3::ONE),
        panel(3.9),
        [1, 1],
        |_, _| true,
        |p| p,
    );
    let mut many = floor();
    add_grid(
        &mut many,
        material(0.0, Vec3::ONE),
        panel(3.9),
        [50, 100],
        |_, _| true,
        |p| p,
    );
    for p in receivers() {
        let exact = polygon(&p, panel(3.9));
        let [(bias, rms, rays), (_, _, rays_of_one)] = [&many, &one].map(|scene| {
            with_emitters(scene, |world, emitters| {
                statistics(world, emitters, &p, exact, 16)
            })
        });
        // The closed form is in f64; what remains is f32 sums of weights and their ratio.
        assert!(bias.abs() < 1e-5 && rms < 1e-5, "{bias} {rms}");
        assert_eq!(rays, rays_of_one);
    }
}

#[test]
fn ten_thousand_triangles_in_no_plane_cost_little_more_and_are_right_on_average() {
    // Separate squares, moved up and down by 0.03 mm so that none can be merged, which does not
    // change the light.
    let mut many = floor();
    add_grid(
        &mut many,
        material(0.0, Vec3::ONE),
        panel(3.9),
        [50, 100],
        |_, _| true,
        |p| p + Vec3::Z * (3e-5 * (p.x * 170.0 + p.y * 311.0).sin()),
    );
    with_emitters(&many, |world, emitters| {
        assert!(emitters.len() > 5000);
        // Measured 0.5, 0.9, 1.2, 4.3 and 2.3 %, from sampling points of a group. The limits are
        // 1.5 times that.
        for (p, noise) in receivers().iter().zip([0.007, 0.014, 0.018, 0.065, 0.034]) {
            let exact = polygon(p, panel(3.9));
            let n = 128;
            let (bias, rms, rays) = statistics(world, emitters, p, exact, n);
            assert!(rms < noise, "{rms} at {}", p.position);
            // Four standard errors of the mean.
            let error = 4.0 * rms / f64::from(n).sqrt();
            assert!(bias.abs() < error, "{bias} ± {error} at {}", p.position);
            // 4 × 16 shared points and one per term; close to the panel, where terms surround the
            // receiver, up to 256 terms.
            let limit = if p.position.z > 3.0 {
                64.0 + 256.0
            } else {
                64.0 + 32.0
            };
            assert!(rays <= limit, "{rays} rays at {}", p.position);
        }
    });
}

/// `n` boxes of 4 cm in a layer of 12 × 12 × 0.4 m, with six materials, so that nothing can be
/// merged.
fn boxes(n: u32) -> Scene {
    let mut scene = floor();
    let (x, y, z) = (Vec3::X * 0.04, Vec3::Y * 0.04, Vec3::Z * 0.04);
    let faces = [
        [Vec3::ZERO, y, x],
        [z, x, y],
        [Vec3::ZERO, x, z],
        [y, z, x],
        [Vec3::ZERO, z, y],
        [x, y, z],
    ];
    for [corner, u, v] in faces {
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for k in 0..n {
            let r = sample_4d(k, 0, 9);
            let o = Vec3::new(r[0] * 12.0 - 6.0, r[1] * 12.0 - 6.0, 3.5 + 0.4 * r[2]) + corner;
            let i = positions.len() as u32;
            positions.extend([o, o + u, o + u + v, o + v]);
            triangles.extend([[i, i + 1, i + 2], [i, i + 2, i + 3]]);
        }
        add_triangles(&mut scene, material(0.0, Vec3::ONE), positions, triangles);
    }
    scene
}

#[test]
fn lamps_all_over_a_hall_are_told_by_where_they_face() {
    let scene = boxes(833);
    with_emitters(&scene, |world, emitters| {
        assert_eq!(emitters.len(), 9996);
        for (p, noise) in receivers().iter().zip([0.0125, 0.012, 0.02]) {
            // The sum of ten thousand closed forms, without shadows, which remove at most 1 % of
            // this light.
            let exact: f64 = emitters.emitters.iter().map(|e| closed_form(e, p)).sum();
            let (bias, rms, rays) = statistics(world, emitters, p, exact, 256);
            // Measured 0.8, 0.8 and 1.3 %; limits are 1.5 times that. By bounds on how faces look,
            // without their mean, it was 1.0, 1.0 and 1.8 %, with power alone 7, 7 and 10 %.
            assert!(rms < noise, "{rms} at {}", p.position);
            assert!((-0.015..0.01).contains(&bias), "{bias} at {}", p.position);
            assert!(rays <= 64.0 + 32.0 + 32.0, "{rays} rays at {}", p.position);
        }
    });
}

/// Three bulbs with a radius of 6 cm, of 2 n (n − 1) triangles with an area each.
fn bulbs(n: u32) -> Scene {
    let mut scene = floor();
    for x in [-1.0, 0.5, 3.0] {
        let around = |p: Vec3| {
            let (turn, tilt) = (p.x * std::f32::consts::TAU, p.y * std::f32::consts::PI);
            let ring = Vec3::new(turn.cos(), turn.sin(), 0.0) * tilt.sin();
            Vec3::new(x, 0.3, 2.2) + 0.06 * (ring - Vec3::Z * tilt.cos())
        };
        let whole = [Vec3::ZERO, Vec3::X, Vec3::Y];
        add_grid(
            &mut scene,
            material(0.0, Vec3::ONE),
            whole,
            [n, n],
            |_, _| true,
            around,
        );
    }
    scene
}

#[test]
fn a_bulb_of_many_triangles_has_little_noise() {
    for (n, noise) in [(6, 0.002), (18, 0.051)] {
        with_emitters(&bulbs(n), |world, emitters| {
            for p in &receivers()[..3] {
                // A bulb is convex, and hides less than 1 % of what the others send.
                let exact: f64 = emitters.emitters.iter().map(|e| closed_form(e, p)).sum();
                let (bias, rms, _) = statistics(world, emitters, p, exact, 256);
                // Measured 0.07 to 0.13 % and 2.9 to 3.6 %; limits are 1.4 times that. By bounds
                // alone, it was 2.4 to 4.8 % and 8.7 to 9.4 %.
                assert!(rms < noise, "{rms} at {}", p.position);
                assert!((-0.01..0.01).contains(&bias), "{bias} at {}", p.position);
            }
        });
    }
}

#[test]
fn picks_are_as_likely_as_they_say() {
    let scene = boxes(40);
    with_emitters(&scene, |_, emitters| {
        let n = emitters.len();
        for p in receivers() {
            let mut sums = vec![(0u32, 0f32); n];
            let draws = 1 << 16;
            let mut total = 0.0;
            for k in 0..draws {
                let x = (f64::from(k) + 0.5) / f64::from(draws);
                let Some((e, probability)) = emitters.pick(0, &p, x) else {
                    total += 1.0 / draws as f32; // a node that turned out not to contribute
                    continue;
                };
                let slot = emitters
                    .emitters
                    .iter()
                    .position(|other| other.corners == e.corners)
                    .expect("one of them");
                assert!(probability > 0.0);
                sums[slot] = (sums[slot].0 + 1, probability);
            }
            for (count, probability) in sums.into_iter().filter(|s| s.0 > 0) {
                let share = count as f32 / draws as f32;
                // Equidistant x: each interval is hit to within one draw.
                assert!(
                    (share - probability).abs() < 1.5 / draws as f32,
                    "{share} {probability}"
                );
                total += probability;
            }
            // Emitters that were never drawn had a probability of less than one draw each.
            assert!((total - 1.0).abs() < 1e-2, "{total}");
        }
    });
}

/// A panel of 4 × 2 m at z = 3.9 with a texture `size` texels wide: white where `bright`, black
/// elsewhere.
fn textured_panel(size: u32, bright: impl Fn(u32, u32) -> u8) -> Scene {
    let mut scene = floor();
    let pixels = (0..size * size)
        .map(|k| {
            let b = bright(k % size, k / size);
            [b, b, b, 255]
        })
        .collect();
    scene.images.push(Some(Image {
        width: size,
        height: size,
        pixels,
    }));
    let mut m = material(0.0, Vec3::ONE);
    m.emissive_texture = Some(TextureRef {
        image: 0,
        tex_coord: 0,
        transform: glam::Affine2::IDENTITY,
        wrap: [Wrap::Clamp; 2],
        nearest: true,
    });
    let [o, x, y] = panel(3.9);
    add_quad(&mut scene, m, o, x, y);
    if let Some(mesh) = scene.meshes.last_mut() {
        mesh.primitives[0].tex_coords = vec![vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]];
    }
    scene
}

/// No emitter is counted twice or omitted.
const SIGN: [[u32; 2]; 2] = [[70, 30], [82, 43]];

fn sign() -> Scene {
    textured_panel(128, |x, y| {
        let inside = x >= SIGN[0][0] && x < SIGN[1][0] && y >= SIGN[0][1] && y < SIGN[1][1];
        255 * u8::from(inside)
    })
}

#[test]
fn a_small_sign_in_a_dark_texture_is_a_small_lamp() {
    let scene = sign();
    let [o, x, y] = panel(3.9);
    let at = |u: u32, v: u32| o + x * (u as f32 / 128.0) + y * (v as f32 / 128.0);
    let ([[u0, v0], [u1, v1]], corner) = (SIGN, at(SIGN[0][0], SIGN[0][1]));
    let sign = [corner, at(u1, v0) - corner, at(u0, v1) - corner];
    with_emitters(&scene, |world, emitters| {
        // Cut down to the sign: its area to within the finest parts, 1/64 of the edge, around its
        // rim.
        let area: f32 = emitters.emitters.iter().map(|e| e.area).sum();
        let rim = 2.0 * (sign[1].length() / 2.0 * 4.0 / 64.0 * 2.0 + sign[2].length() * 2.0 / 64.0);
        let own = sign[1].length() * sign[2].length();
        assert!((own..own + 2.0 * rim).contains(&area), "{area} {own} {rim}");
        // Two whole triangles with their texture, for comparison: points are spread over all of
        // them.
        let whole = [2, 3].map(|t: u32| Emitter {
            triangle: t,
            corners: world.soup.triangles[t as usize],
            area: world.soup.areas[t as usize],
            radiance: Vec3::splat(0.01),
            textured: true,
            ..emitters.emitters[0]
        });
        let whole = Emitters::new(whole.to_vec());
        // Measured 0.24, 0.43, 0.40, 1.3 and 2.0 %, from sampling groups of parts. The limits are
        // 1.5 times that.
        for (p, noise) in receivers().iter().zip([0.004, 0.007, 0.006, 0.02, 0.03]) {
            let exact = polygon(p, sign);
            let (bias, rms, rays) = statistics(world, emitters, p, exact, 64);
            let (_, before, rays_before) = statistics(world, &whole, p, exact, 64);
            assert!(rays <= 1.5 * rays_before.max(32.0), "{rays} {rays_before}");
            assert!(rms < noise, "{rms} at {}", p.position);
            assert!(before > 10.0 * rms, "{before} {rms} at {}", p.position);
            // The finest parts resolve the sign's rim to 1/64 of the panel; from nearby, the
            // texture itself is read.
            assert!(bias.abs() < 0.01, "{bias} at {}", p.position);
        }
    });
}

#[test]
fn parts_cover_what_shines_and_send_what_it_sends() {
    let noise = |x: u32, y: u32| (crate::sampling::hash_u32(x + 1000 * y) & 255) as u8;
    for (scene, full) in [
        (sign(), false),
        (textured_panel(128, noise), true),
        (textured_panel(16, noise), true),
        (textured_panel(1, |_, _| 200), true),
    ] {
        with_emitters(&scene, |world, emitters| {
            let mut sent = 0f64;
            for t in (2..4).filter(|&t| full || t == 2) {
                let own = emitters.emitters.iter().filter(|e| e.triangle == t);
                let (mut area, mut flux) = (0f64, 0f64);
                for e in own {
                    area += f64::from(e.area);
                    flux += e.power();
                    let [a, b, c] = e.corners;
                    // Halving middles is exact but for the last bit of metres.
                    let of_corners = 0.5 * (b - a).cross(c - a);
                    assert!((of_corners.length() / e.area - 1.0).abs() < 1e-3);
                    assert!(of_corners.normalize().dot(e.normal) > 0.999);
                }
                let whole = f64::from(world.soup.areas[t as usize]);
                if full {
                    // Some texels of the noise are black, but no part of more than one texel is.
                    assert!(
                        area <= whole * 1.0001 && area > whole * 0.97,
                        "{area} {whole}"
                    );
                } else {
                    assert!(area < 0.1 * whole, "{area} {whole}");
                }
                sent += flux;
            }
            // Exactly the mean of the texels, each of which the panel's 8 m² contain once (decoded
            // by IEC 61966-2-1).
            let image = world.scene.images[0].as_ref().expect("a picture");
            let linear = |x: u8| match f64::from(x) / 255.0 {
                x if x <= 0.04045 => x / 12.92,
                x => ((x + 0.055) / 1.055).powf(2.4),
            };
            let sum: f64 = image.pixels.iter().map(|p| linear(p[0])).sum();
            let exact = sum / image.pixels.len() as f64 * 8.0;
            // 2^14 samples or four per texel: at the edges between noise texels they are off by 0.1
            // % at most. The rest is f32 sums.
            assert!((sent / exact - 1.0).abs() < 2e-3, "{sent} {exact}");
        });
    }
}

#[test]
fn an_even_texture_is_not_cut() {
    let scene = textured_panel(64, |_, _| 255);
    with_emitters(&scene, |_, emitters| {
        assert_eq!(emitters.len(), 2);
        assert!(emitters.emitters.iter().all(|e| !e.textured));
    });
}

#[test]
fn the_number_of_parts_is_bounded() {
    let noise = |x: u32, y: u32| (crate::sampling::hash_u32(x + 5000 * y) & 255) as u8;
    let mut scene = textured_panel(256, noise);
    // A thousand more triangles, each with the whole texture.
    let m = scene.materials[1].clone();
    for k in 0..500u32 {
        let o = Vec3::new(-9.0 + 0.03 * k as f32, 3.0, 3.0 + 0.002 * k as f32);
        add_quad(&mut scene, m.clone(), o, Vec3::Y * 0.02, Vec3::X * 0.02);
        if let Some(mesh) = scene.meshes.last_mut() {
            mesh.primitives[0].tex_coords = vec![vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]];
        }
    }
    with_emitters(&scene, |_, emitters| {
        let n = emitters.len();
        // As many as allowed, minus black parts and the remainder of the last split.
        assert!((60_000..=65_536).contains(&n), "{n}");
    });
}

#[test]
fn an_outline_with_a_hole_and_a_corner_is_kept() {
    // A frame: 40 × 40 squares with a hole of 20 × 20 and one corner cut off.
    let mut scene = floor();
    let keep =
        |i: u32, j: u32| !((10..30).contains(&i) && (10..30).contains(&j)) && (i < 35 || j < 35);
    add_grid(
        &mut scene,
        material(0.0, Vec3::ONE),
        panel(3.9),
        [40, 40],
        keep,
        |p| p,
    );
    with_emitters(&scene, |world, emitters| {
        // 6 outer corners and 4 of the hole: n + 2 × holes − 2 triangles.
        assert_eq!(emitters.len(), 10);
        let [o, x, y] = panel(3.9);
        let part = |u0: f32, v0: f32, u1: f32, v1: f32| {
            [o + x * u0 + y * v0, x * (u1 - u0), y * (v1 - v0)]
        };
        for p in receivers() {
            let exact = polygon(&p, part(0.0, 0.0, 1.0, 1.0))
                - polygon(&p, part(0.25, 0.25, 0.75, 0.75))
                - polygon(&p, part(0.875, 0.875, 1.0, 1.0));
            let (bias, rms, _) = statistics(world, emitters, &p, exact, 8);
            // Exact except for the two small triangles at the corner, which form a group from a
            // distance and are 1 % of the light.
            assert!(rms < 2e-3, "{bias} {rms} at {}", p.position);
        }
    });
}

#[test]
fn bent_sheets_backs_and_other_lights_are_not_joined() {
    // A quarter of a tube, a folded sheet, and a sheet of which half has another light.
    let mut tube = floor();
    add_grid(
        &mut tube,
        material(0.0, Vec3::ONE),
        panel(3.9),
        [40, 4],
        |_, _| true,
        |p| {
            let (s, c) = (0.7 * p.y).sin_cos();
            Vec3::new(p.x, s, 3.0 + c)
        },
    );
    with_emitters(&tube, |_, emitters| {
        // Strips across the tube are planar: each of them is merged from eight triangles into two.
        assert_eq!(emitters.len(), 80);
    });
    let mut two = floor();
    for (k, radiance) in [1.0, 2.0].into_iter().enumerate() {
        let keep = move |i: u32, _: u32| (i < 10) == (k == 0);
        add_grid(
            &mut two,
            material(0.0, Vec3::splat(radiance)),
            panel(3.9),
            [20, 20],
            keep,
            |p| p,
        );
    }
    with_emitters(&two, |_, emitters| {
        assert_eq!(emitters.len(), 4);
        let flux: f64 = emitters.emitters.iter().map(Emitter::power).sum();
        assert!((flux / (4.0 + 8.0) - 1.0).abs() < 1e-5, "{flux}");
    });
    // A sheet that shines on both faces because it has two coincident layers of opposite winding.
    let mut layers = floor();
    let [o, x, y] = panel(3.9);
    for frame in [[o, x, y], [o, y, x]] {
        add_grid(
            &mut layers,
            material(0.0, Vec3::ONE),
            frame,
            [20, 20],
            |_, _| true,
            |p| p,
        );
    }
    with_emitters(&layers, |_, emitters| {
        let up: f32 = emitters.emitters.iter().map(|e| e.normal.z * e.area).sum();
        let all: f32 = emitters.emitters.iter().map(|e| e.area).sum();
        assert!(up.abs() < 1e-3 && (all - 16.0).abs() < 1e-3, "{up} {all}");
    });
}

#[test]
fn a_dim_triangle_with_a_bright_sign_is_sampled() {
    // Under a luminous ceiling, which determines the threshold: the sign's mean is a hundredth of
    // it, but its texels are brighter.
    let mut scene = sign();
    let m = &mut scene.materials[1];
    m.emissive = Vec3::splat(20.0);
    add_quad(
        &mut scene,
        material(0.0, Vec3::ONE),
        Vec3::new(-10.0, -10.0, 5.0),
        Vec3::Y * 20.0,
        Vec3::X * 20.0,
    );
    with_emitters(&scene, |world, emitters| {
        // The sign lies in one half of the panel.
        assert_eq!(
            [2, 3, 4, 5].map(|t| world.emission(t)),
            [
                Emission::Sampled,
                Emission::None,
                Emission::Gathered,
                Emission::Gathered
            ]
        );
        assert!(emitters.emitters.iter().all(|e| e.triangle < 4));
    });
}

#[test]
fn the_same_emitters_every_time() {
    let noise = |x: u32, y: u32| (crate::sampling::hash_u32(x + 5000 * y) & 255) as u8;
    let collect = |threads: usize| {
        let scene = textured_panel(64, noise);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| with_emitters(&scene, |_, e| format!("{:?}", e.nodes)))
    };
    assert_eq!(collect(1), collect(3));
}
