//! The solve: error by patches, by rays, and against its own bound.

use glam::{DVec3, Vec3};
use mesh_ingest::Soup;
use patch_subdivision::{Options as CutOptions, PatchId};
use radiosity::{
    DirectOptions, Emitters, RelaxOptions, Silent, Solution, SolveOptions, World, WorldOptions,
    sample_2d, solve,
};
use rayon::prelude::*;

use super::scene::lit_cube;
use crate::enclosures::cube;
use crate::form_factor::form_factor_polygon;
use crate::solver::{self, Method, Options, System};
use crate::{Enclosure, Matrix};

/// Reflectance of the cube's faces.
const RHO: f64 = 0.5;
/// Index of [`cube`]'s ceiling.
const CEILING: usize = 1;

/// Solves the lit cube with about `n` × `n` patches per face and passes the solution on.
fn with_solution<T>(
    n: u32,
    rays: u32,
    reflectance: f32,
    relax: RelaxOptions,
    look: impl FnOnce(&World, &Solution) -> T,
) -> T {
    let scene = lit_cube(reflectance);
    let soup = Soup::build(&scene);
    let world =
        World::build(&scene, &soup, WorldOptions::default()).expect("twelve triangles make a tree");
    let emitters = Emitters::collect(&world);
    let options = SolveOptions {
        cut: CutOptions {
            patches: 6 * n * n,
            region_share: 1.0,
            ..CutOptions::default()
        },
        rays,
        link_bytes: 4 << 30,
        direct: DirectOptions::every(4, 8),
        // The subdivision must be the grid.
        crowded: false,
        resample: true,
        relax,
    };
    look(&world, &solve(&world, &emitters, &options, &Silent))
}

/// Relaxation whose error is negligible here.
const EXACT: RelaxOptions = RelaxOptions {
    tolerance: 1e-9,
    sweeps: 0,
};

/// The position of a patch: the mean of its elements' points.
fn centre(world: &World, solution: &Solution, patch: usize) -> DVec3 {
    let elements = solution.cut.elements_of(PatchId(patch as u32));
    let count = elements.len().max(1) as f64;
    let sum: DVec3 = elements
        .map(|k| {
            let e = solution.cut.elements()[k];
            let [a, b, c] = world.soup.triangles[e.triangle as usize];
            (a + (b - a) * e.u + (c - a) * e.v).as_dvec3()
        })
        .sum();
    sum / count
}

/// B by patch of a dense system with matrix `f` in an enclosure of reflectance [`RHO`] that emits
/// `exitance`, to 1e-12 of its flux.
fn dense(f: &Matrix, enclosure: &Enclosure, exitance: Vec<f64>) -> Vec<f64> {
    let area = enclosure.patches.iter().map(|p| p.area()).collect();
    let n = f.len();
    let exitance = exitance.into_iter().map(DVec3::splat).collect();
    let system = System::from_parts(f, area, exitance, vec![DVec3::splat(RHO); n])
        .expect("a checked matrix");
    let options = Options {
        tolerance: 1e-12,
        ..Options::default()
    };
    let solution =
        solver::solve(Method::GaussSeidel, &system, &options).expect("a positive tolerance");
    solution.radiosity.iter().map(|b| b.x).collect()
}

/// The lit cube's indirect irradiance anywhere on its faces.
///
/// Collocation: the radiosity is constant on each of a fine grid's cells and satisfies the equation
/// at their centres, with closed-form factors from points to polygons. Its error falls with the
/// square of the cell size, which a comparison of two grids confirms.
pub struct Field {
    enclosure: Enclosure,
    /// Reflected radiosity by cell, without the ceiling's emission.
    radiosity: Vec<f64>,
}

/// Direct irradiance: that of a ceiling of exitance 1.
fn direct(p: DVec3, normal: DVec3) -> f64 {
    let ceiling = &cube(1).patches[CEILING];
    form_factor_polygon(p, normal, &ceiling.corners)
}

impl Field {
    /// `n` × `n` cells per face; takes 36 n⁴ form factors at 8 bytes each.
    pub fn new(n: usize) -> Self {
        let enclosure = cube(n);
        let patches = &enclosure.patches;
        let mut matrix = Matrix::zeros(patches.len());
        matrix
            .values_mut()
            .par_chunks_mut(patches.len())
            .zip(patches)
            .for_each(|(row, own)| {
                for (f, other) in row.iter_mut().zip(patches) {
                    *f = form_factor_polygon(own.centre(), own.normal(), &other.corners);
                }
            });
        let first = patches
            .iter()
            .map(|p| RHO * direct(p.centre(), p.normal()))
            .collect();
        let radiosity = dense(&matrix, &enclosure, first);
        Field {
            enclosure,
            radiosity,
        }
    }

    /// E without the lamp's direct light, W/m².
    pub fn indirect(&self, p: DVec3, normal: DVec3) -> f64 {
        self.enclosure
            .patches
            .iter()
            .zip(&self.radiosity)
            .map(|(q, b)| form_factor_polygon(p, normal, &q.corners) * b)
            .sum()
    }
}

/// Errors of the solve's indirect irradiance, relative to the RMS of the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutErrors {
    /// Patches made.
    pub patches: u32,
    /// RMS of the patch values themselves.
    pub constant: f64,
    /// RMS after interpolation, as in the gather.
    pub interpolated: f64,
    /// RMS of the same over points at least ¼ m from all edges.
    pub interior: f64,
    /// The largest.
    pub worst: f64,
}

/// The lit cube with about `n` × `n` patches a face for each of `sizes`, `rays` rays a patch,
/// against `field`.
pub fn cut_errors(field: &Field, sizes: &[u32], rays: u32) -> Vec<CutErrors> {
    const POINTS: u32 = 64;
    // The same points for all sizes; only the subdivision changes.
    let points: Vec<(DVec3, DVec3, f64)> = cube(1)
        .patches
        .par_iter()
        .enumerate()
        .flat_map_iter(|(k, face)| {
            let c = &face.corners;
            let (o, s, t, n) = (c[0], c[1] - c[0], c[3] - c[0], face.normal());
            (0..POINTS).map(move |i| {
                let [u, v] = sample_2d(i, 0, k as u32 + 1).map(f64::from);
                (o + s * u + t * v, n)
            })
        })
        .map(|(p, n)| (p, n, field.indirect(p, n)))
        .collect();
    let scale = rms(points.iter().map(|p| p.2));
    sizes
        .iter()
        .map(|&n| {
            with_solution(n, rays, RHO as f32, EXACT, |world, solution| {
                let found: Vec<(f64, f64, bool)> = points
                    .iter()
                    .map(|&(p, _, truth)| {
                        let [flat, smooth] = at(world, solution, p);
                        let inner = (p - 0.5).abs().to_array();
                        let near = inner.iter().filter(|d| **d > 0.25).count();
                        (flat - truth, smooth - truth, near == 1)
                    })
                    .collect();
                CutErrors {
                    patches: solution.cut.patches().len() as u32,
                    constant: rms(found.iter().map(|e| e.0)) / scale,
                    interpolated: rms(found.iter().map(|e| e.1)) / scale,
                    interior: rms(found.iter().filter(|e| e.2).map(|e| e.1)) / scale,
                    worst: found.iter().map(|e| e.1.abs()).fold(0.0, f64::max) / scale,
                }
            })
        })
        .collect()
}

/// Indirect irradiance at a point of the cube's faces: its patch's, and interpolated.
fn at(world: &World, solution: &Solution, p: DVec3) -> [f64; 2] {
    let middle = Vec3::splat(0.5);
    let ray = visibility_ray(middle, p.as_vec3() - middle);
    let hit = world.closest_hit(&ray).expect("the cube is closed");
    let p = p.as_vec3();
    let locus = solution
        .cut
        .locate(hit.triangle, p, hit.back)
        .expect("every point has its patch");
    let (taps, n) = solution.cut.taps(hit.triangle, p, locus);
    let smooth = taps[..n]
        .iter()
        .map(|t| f64::from(solution.indirect[t.patch.0 as usize].x * t.weight))
        .sum();
    [
        f64::from(solution.indirect[locus.patch.0 as usize].x),
        smooth,
    ]
}

fn visibility_ray(origin: Vec3, direction: Vec3) -> visibility::Ray {
    visibility::Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: f32::INFINITY,
    }
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0.0f64, 0.0), |(n, s), v| (n + 1.0, s + v * v));
    (sum / n.max(1.0)).sqrt()
}

/// RMS error over the patches, relative to the RMS irradiance, of the solve of the lit cube in `n`
/// × `n` patches per face, for each number of rays. The truth is the solution of the same discrete
/// problem, with the solve's own direct light, with exact form factors from the rays' origins (one
/// in each of a patch's sixteen elements). So only the rays' noise remains.
pub fn rays_error(n: u32, rays: &[u32]) -> Vec<(f64, f64)> {
    let enclosure = cube(n as usize);
    let count = enclosure.patches.len();
    rays.iter()
        .map(|&rays| {
            with_solution(n, rays, RHO as f32, EXACT, |world, solution| {
                assert_eq!(solution.cut.patches().len(), count, "the cut is the grid");
                // The corresponding patch of the reference.
                let same: Vec<usize> = (0..count)
                    .map(|p| {
                        let c = centre(world, solution, p);
                        let far = |k: usize| (enclosure.patches[k].centre() - c).length_squared();
                        (0..count)
                            .min_by(|&a, &b| far(a).total_cmp(&far(b)))
                            .unwrap_or(0)
                    })
                    .collect();
                let mut once = same.clone();
                once.sort_unstable();
                once.dedup();
                assert_eq!(once.len(), count, "each patch has one of its own");
                let mut factors = Matrix::zeros(count);
                let mut direct = vec![0.0; count];
                for (p, &k) in same.iter().enumerate() {
                    direct[k] = f64::from(solution.direct_mean[p].x);
                    let normal = enclosure.patches[k].normal();
                    let elements =
                        &solution.cut.elements()[solution.cut.elements_of(PatchId(p as u32))];
                    let area: f64 = elements.iter().map(|e| f64::from(e.area)).sum();
                    for e in elements {
                        let [a, b, c] = world.soup.triangles[e.triangle as usize];
                        let point = (a + (b - a) * e.u + (c - a) * e.v).as_dvec3();
                        let share = f64::from(e.area) / area;
                        for (f, other) in factors.row_mut(k).iter_mut().zip(&enclosure.patches) {
                            if other.normal().dot(normal) < 0.99 {
                                *f += share * form_factor_polygon(point, normal, &other.corners);
                            }
                        }
                    }
                }
                let first = (0..count)
                    .map(|i| {
                        let row = factors.row(i).iter().zip(&direct);
                        RHO * row.map(|(f, e)| f * RHO * e).sum::<f64>()
                    })
                    .collect();
                let b = dense(&factors, &enclosure, first);
                let off = |p: usize| f64::from(solution.indirect[p].x) - b[same[p]] / RHO;
                let error = rms((0..count).map(off)) / rms(b.iter().map(|b| b / RHO));
                (f64::from(solution.report.rays_per_patch), error)
            })
        })
        .collect()
}

/// A relaxation stopped at a tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounded {
    /// The requested tolerance.
    pub tolerance: f64,
    /// The reported upper bound of the rest, relative to all light that arrives.
    pub bound: f64,
    /// The actual rest.
    pub error: f64,
}

/// The lit cube in 6 × 6 patches per face with 1024 rays each, relaxed to each tolerance by
/// shooting, or with `krylov` by Bi-CGSTAB, compared with the same system relaxed to 1e-12 by the
/// other method. Solutions are stored as `f32`, whose rounding dominates below about 1e-7.
pub fn residual_and_error(reflectance: f32, krylov: bool, tolerances: &[f64]) -> Vec<Bounded> {
    const N: u32 = 6;
    const RAYS: u32 = 1024;
    let relax = |tolerance: f64, krylov: bool| RelaxOptions {
        tolerance,
        sweeps: if krylov { 0 } else { 100_000 },
    };
    let light = |relax| {
        with_solution(N, RAYS, reflectance, relax, |_, s| {
            let areas: Vec<f64> = s.cut.patches().iter().map(|p| f64::from(p.area)).collect();
            let indirect: Vec<f64> = s.indirect.iter().map(|e| f64::from(e.x)).collect();
            (areas, indirect, s.report.relaxation.clone())
        })
    };
    let (area, exact, _) = light(relax(1e-12, !krylov));
    let all: f64 = area.iter().zip(&exact).map(|(a, e)| a * e).sum();
    tolerances
        .iter()
        .map(|&t| {
            let (_, found, report) = light(relax(t, krylov));
            let left: f64 = (0..area.len())
                .map(|i| area[i] * (found[i] - exact[i]).abs())
                .sum();
            Bounded {
                tolerance: t,
                bound: report.residual,
                error: left / all,
            }
        })
        .collect()
}
