//! Gathered and direct light at one receiver, against closed forms.

use gather::{Footprint, GatherOptions, Gatherer, Interpolation};
use glam::{DVec3, Vec3};
use mesh_ingest::Soup;
use patch_subdivision::Options as CutOptions;
use radiosity::{
    DirectLight, DirectOptions, Emitters, RelaxOptions, Silent, Solution, SolveOptions,
    SurfacePoint, World, WorldOptions, hash_u32, sample_2d, solve,
};

use super::scene::{EDGE_HEIGHT, LAMP, OPEN, half_hidden_lamp, lit_cube};
use crate::enclosures::cube;
use crate::form_factor::{form_factor_polygon, gauss_legendre};

/// An axis-parallel square on a floor.
struct Square {
    /// The triangle under it, and its lowest corner relative to that; its plane is z = 0.
    corner: Vec3,
    size: f32,
    seed: u32,
}

impl Square {
    fn at(&self, u: f32, v: f32) -> SurfacePoint {
        let position = self.corner + Vec3::new(u, v, 0.0) * self.size;
        SurfacePoint {
            position,
            origin: position + Vec3::Z * 1e-5,
            normal: Vec3::Z,
            geometric: Vec3::Z,
        }
    }

    /// The mean of `f` over it by 8 × 8 Gauss points, exact to rounding for functions that are
    /// smooth over such a small square.
    fn mean(&self, f: impl Fn(DVec3) -> f64) -> f64 {
        let rule = gauss_legendre(8);
        let mut sum = 0.0;
        for (u, a) in &rule {
            for (v, b) in &rule {
                let p = self.at(*u as f32, *v as f32).position.as_dvec3();
                sum += a * b * f(p);
            }
        }
        sum
    }
}

impl Footprint for Square {
    fn candidate(&self, i: u32) -> Option<SurfacePoint> {
        let [u, v] = sample_2d(i, 63, self.seed);
        Some(self.at(u, v))
    }

    fn fallback(&self) -> SurfacePoint {
        self.at(0.5, 0.5)
    }

    fn size(&self) -> f32 {
        self.size
    }
}

/// Number of independent receivers, each with its own random numbers; the RMS over them is accurate
/// to 1/√(2·128) = 6 %.
const RECEIVERS: u32 = 128;

/// Receiver `k`: a square of `size` whose corner is in the middle ninth of the unit square,
/// translated by `shift`.
fn receiver(k: u32, size: f32, shift: Vec3) -> Square {
    let [u, v] = sample_2d(k, 5, 7);
    Square {
        corner: Vec3::new(u, v, 0.0) / 3.0 + shift,
        size,
        seed: hash_u32(k + 1),
    }
}

/// Relative RMS error of the final gather's indirect light for each number of rays, without
/// smoothing: at a point, or over a lumel of 5 cm whose `points` share the rays.
///
/// A cube's floor gathers from walls that are black, except one that is assigned irradiance 1 and
/// reflectance ½. The truth is half the form factor to that wall, averaged over the lumel.
pub fn indirect_error(points: u32, rays: &[u32]) -> Vec<(f64, f64)> {
    in_dark_cube(|world, emitters, solution| {
        // The wall at x = 0.
        for (k, patch) in solution.cut.patches().iter().enumerate() {
            let element = solution.cut.elements()[patch.first_element as usize];
            if world.soup.normals[element.triangle as usize].x > 0.5 {
                solution.indirect[k] = Vec3::ONE;
            }
        }
        solution.refresh(world);
        let wall = cube(1).patches[2].corners.clone();
        let truth =
            |square: &Square| square.mean(|p| 0.5 * form_factor_polygon(p, DVec3::Z, &wall));
        let size = if points == 1 { 0.0 } else { 0.05 };
        (rays.iter())
            .map(|&rays| {
                let gatherer = gatherer(world, emitters, solution, (rays, points, 0));
                let [_, rms] = errors(&gatherer, size, truth);
                (f64::from(rays), rms)
            })
            .collect()
    })
}

/// Relative bias and RMS error, as in [`indirect_error`], if only a spot of 20 cm on the wall is
/// lit, by direct light. There are `rays` gathering rays, and `lit` shadow rays from each of 16
/// points to the wall's elements.
///
/// The truth is the sum over elements of a lumel's mean point-to-point kernel. Elements are 1.25 cm
/// wide and at least 30 cm away, so it is accurate to (1.25/30)² = 0.2 %.
pub fn lit_error(rays: u32, lit: u32) -> [f64; 2] {
    in_dark_cube(|world, emitters, solution| {
        let mut spot: Vec<(DVec3, f64)> = Vec::new();
        for k in 0..solution.cut.elements().len() {
            let e = solution.cut.elements()[k];
            let at = world.surface_point(e.triangle, e.u, e.v, false, false);
            let middle = (at.position - Vec3::splat(0.5)).abs();
            if at.normal.x > 0.5 && middle.y.max(middle.z) < 0.1 {
                solution.direct[k] = Vec3::ONE;
                spot.push((at.position.as_dvec3(), f64::from(e.area)));
            }
        }
        solution.refresh(world);
        let truth = |square: &Square| {
            square.mean(|p| {
                let brings = |(q, area): &(DVec3, f64)| {
                    let v = *q - p;
                    0.5 * area * v.z.max(0.0) * -v.x / v.length_squared().powi(2)
                };
                spot.iter().map(brings).sum::<f64>() / std::f64::consts::PI
            })
        };
        errors(
            &gatherer(world, emitters, solution, (rays, 16, lit)),
            0.05,
            truth,
        )
    })
}

/// A cube without light of its own; `decree` assigns it.
fn in_dark_cube<T>(decree: impl FnOnce(&World, &Emitters, &mut Solution) -> T) -> T {
    let scene = lit_cube(0.5);
    let soup = Soup::build(&scene);
    let world =
        World::build(&scene, &soup, WorldOptions::default()).expect("twelve triangles make a tree");
    let emitters = Emitters::collect(&world);
    let options = SolveOptions {
        cut: CutOptions {
            // Patches of 5 cm: no receiver is so close that rays continue as paths, beyond the
            // assigned light.
            patches: 2400,
            region_share: 1.0,
            ..CutOptions::default()
        },
        rays: 16,
        relax: RelaxOptions::default(),
        ..SolveOptions::default()
    };
    let mut solution = solve(&world, &emitters, &options, &Silent);
    for light in [
        &mut solution.direct,
        &mut solution.direct_mean,
        &mut solution.indirect,
    ] {
        light.fill(Vec3::ZERO);
    }
    solution.rough.fill(false);
    decree(&world, &emitters, &mut solution)
}

/// A gatherer with this many rays, points that share them, and shadow rays of each point to lit
/// elements.
fn gatherer<'w, 'a>(
    world: &'w World<'a>,
    emitters: &'w Emitters,
    solution: &'w Solution,
    (rays, points, lit): (u32, u32, u32),
) -> Gatherer<'w, 'a> {
    let options = GatherOptions {
        rays,
        points,
        edge_points: 0,
        most_rays: rays,
        error: 0.0,
        direct: DirectOptions::every(1, 1),
        contacts: false,
        follow: 0,
        interpolation: Interpolation::Open,
        calm: 0.0,
        near: 1.0,
        lit,
        open_only: false,
        tile: gather::TILE,
    };
    let direct = DirectLight::new(world, emitters);
    Gatherer::new(world, solution, direct, options, gather::Wanted::default())
}

/// Relative bias and RMS error of the indirect light at receivers in the middle of the floor, away
/// from the walls.
fn errors(gatherer: &Gatherer, size: f32, truth: impl Fn(&Square) -> f64) -> [f64; 2] {
    let (mut bias, mut squares, mut truths) = (0.0, 0.0, [0.0; 2]);
    for k in 0..RECEIVERS {
        let square = receiver(k, size, Vec3::new(0.3, 0.3, 0.0));
        let truth = truth(&square);
        let got = gatherer.gather(&square, hash_u32(k ^ 0x51ed_270b));
        let error = f64::from(got.indirect.x) - truth;
        bias += error;
        squares += error * error;
        truths = [truths[0] + truth, truths[1] + truth * truth];
    }
    [bias / truths[0], (squares / truths[1]).sqrt()]
}

/// Relative RMS error of direct light for each number of shadow rays per lamp triangle, in the
/// penumbra of a straight edge, at points (`size` 0) or as the mean over lumels of `size` metres.
///
/// The truth is the closed form for the visible part of the lamp, averaged over the lumel.
pub fn direct_error(size: f32, rays: &[u32]) -> Vec<(f64, f64)> {
    let scene = half_hidden_lamp();
    let soup = Soup::build(&scene);
    let world =
        World::build(&scene, &soup, WorldOptions::default()).expect("six triangles make a tree");
    let emitters = Emitters::collect(&world);
    let light = DirectLight::new(&world, &emitters);
    let mut out = Vec::new();
    for &rays in rays {
        let options = DirectOptions::every(rays, rays);
        let (mut squares, mut truths) = (0.0, 0.0);
        for k in 0..RECEIVERS {
            // Within a sixth of a metre of the edge's foot the shadow cuts the lamp.
            let square = receiver(k, size, Vec3::new(-1.0, -1.0, 0.0) / 6.0);
            let truth = square.mean(|p| form_factor_polygon(p, DVec3::Z, &visible_part(p)));
            let point = |i: u32| square.candidate(i).unwrap_or_else(|| square.fallback());
            let got = light.irradiance(point, size, hash_u32(k ^ 0x2c1b_3c6d), &options);
            squares += (f64::from(got.irradiance.x) - truth).powi(2);
            truths += truth * truth;
        }
        out.push((f64::from(rays), (squares / truths).sqrt()));
    }
    out
}

/// The part of the lamp visible from `p`: clipped by the plane through `p` and the occluder's edge.
fn visible_part(p: DVec3) -> Vec<DVec3> {
    let (open, height) = (OPEN.as_dvec3(), f64::from(EDGE_HEIGHT));
    // The edge's line is open · q = 0 at z = height; projected from p to z = 1 it is at open · q =
    // far.
    let from = open.dot(p);
    let far = from - from / height;
    let side = |q: DVec3| open.dot(q) - far;
    let corners = LAMP.map(|c| c.as_dvec3());
    let mut out = Vec::new();
    for k in 0..4 {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        let (sa, sb) = (side(a), side(b));
        if sa >= 0.0 {
            out.push(a);
        }
        if (sa >= 0.0) != (sb >= 0.0) {
            out.push(a + (b - a) * (sa / (sa - sb)));
        }
    }
    out
}
