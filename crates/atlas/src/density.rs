//! Lumel density of each mesh.

use glam::{DAffine3, DMat3, DVec3};
use mesh_ingest::{Mesh, Scene, Soup};
use rayon::prelude::*;

/// Largest fraction of the lumel budget that one huge instance may take in a scene of more than
/// [`HUGE_FROM`] instances.
const HUGE_SHARE: f64 = 0.25;
/// Fraction that all huge instances may take together.
const HUGE_TOTAL: f64 = 0.5;
/// An instance is huge if it exceeds its fraction and is this many times as large as all smaller
/// instances together.
const HUGE_RATIO: f64 = 2.0;
/// Scenes with fewer instances are rooms made of few meshes, not levels on a ground plane.
const HUGE_FROM: usize = 4;
/// The rest of the scene gets at most this many times the density of a huge instance.
const HUGE_CONTRAST: f64 = 32.0;
/// Minimum lumels per instance: a rectangle of 4 × 4.
const FLOOR_LUMELS: f64 = 16.0;
/// Fraction of the budget that this minimum may take if there are very many small instances.
const FLOOR_SHARE: f64 = 0.25;
/// A mesh with instances of different sizes gets lumels for at most this many times their mean
/// area.
const UNEVEN: f64 = 4.0;

/// Density of one mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshDensity {
    /// Shape of the representative instance, i.e. the one that needs the most lumels. It maps
    /// lengths to metres ([`shape_of`]).
    pub linear: DMat3,
    /// World area of that instance, m².
    pub area: f64,
    /// Number of instances that have lumels.
    pub instances: usize,
    /// Lumels per metre on the representative instance.
    pub texels_per_unit: f32,
    /// Density factor of that instance ([`mesh_ingest::Instance::density`]).
    pub factor: f32,
    /// Why it differs from the scene's density.
    pub adjusted: Option<Adjusted>,
}

/// Why a mesh's density differs from the scene's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Adjusted {
    /// Lowered: the instance is far larger than the rest of the scene.
    Huge,
    /// Lowered: its largest instance is far larger than the others, and all share one rectangle
    /// size.
    Uneven,
    /// Raised, so that it gets a few lumels at all.
    Small,
}

/// Densities of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct DensityPlan {
    /// Lumels per metre of meshes that are not adjusted.
    pub texels_per_unit: f32,
    /// By mesh of the scene.
    pub meshes: Vec<MeshDensity>,
}

/// Densities of all meshes: `wanted` if given, else from the budget of `lumels`.
///
/// The default density gives all instances together about `lumels` lumels (within 12 %). It is a
/// [preferred number](preferred), so that charts stay unchanged while a level grows. Huge instances
/// count only with their allowed fraction. Density factors of nodes do not count, so a factor on
/// one node does not change the others.
pub fn plan(scene: &Scene, soup: &Soup, wanted: Option<f32>, lumels: u64) -> DensityPlan {
    let mut meshes = survey(scene, soup);
    if let Some(texels_per_unit) = wanted {
        for mesh in &mut meshes {
            mesh.texels_per_unit = (texels_per_unit * mesh.factor).clamp(1e-6, 1e6);
        }
        return DensityPlan {
            texels_per_unit,
            meshes: meshes.into_iter().map(|m| m.density).collect(),
        };
    }
    let budget = (lumels.max(1)) as f64;
    let count: usize = meshes.iter().map(|m| m.instances).sum();
    // Area that counts for each mesh's instances.
    let charged: Vec<f64> = meshes
        .iter()
        .map(|m| (m.largest).min(UNEVEN * m.total / m.instances.max(1) as f64))
        .collect();
    let huge = huge_meshes(&meshes, &charged, count);
    let cap = budget * HUGE_SHARE.min(HUGE_TOTAL / huge.len().max(1) as f64);
    let mut rest = 0.0;
    for (i, m) in meshes.iter().enumerate() {
        if !huge.contains(&i) {
            rest += charged[i] * m.instances as f64;
        }
    }
    let free = budget - cap * huge.len() as f64;
    let mut density = (free / rest.max(f64::MIN_POSITIVE)).sqrt();
    for &i in &huge {
        density = density.min(HUGE_CONTRAST * (cap / charged[i]).sqrt());
    }
    let density = preferred(density.clamp(1e-6, 1e6));
    let floor = FLOOR_LUMELS.min(FLOOR_SHARE * budget / count.max(1) as f64);
    for (i, m) in meshes.iter_mut().enumerate() {
        let (mut own, mut adjusted) = (f64::from(density), None);
        if huge.contains(&i) {
            own = own.min((cap / charged[i]).sqrt());
            adjusted = Some(Adjusted::Huge);
        }
        own *= f64::from(m.factor);
        let most = UNEVEN * m.demand / m.instances.max(1) as f64;
        let wanted = m.area * f64::from(m.factor).powi(2);
        if most < wanted * 0.99 {
            own *= (most / wanted).sqrt();
            adjusted = Some(Adjusted::Uneven);
        }
        let least = (floor / m.area.max(f64::MIN_POSITIVE)).sqrt().min(1e6);
        if own < least {
            own = least;
            adjusted = Some(Adjusted::Small);
        }
        m.density.texels_per_unit = own as f32;
        m.density.adjusted = adjusted;
    }
    DensityPlan {
        texels_per_unit: density,
        meshes: meshes.into_iter().map(|m| m.density).collect(),
    }
}

/// Meshes with a single instance that dwarfs everything smaller.
fn huge_meshes(meshes: &[Surveyed], charged: &[f64], count: usize) -> Vec<usize> {
    if count <= HUGE_FROM {
        return Vec::new();
    }
    let mut order: Vec<usize> = (0..meshes.len()).filter(|&i| charged[i] > 0.0).collect();
    order.sort_by(|&a, &b| charged[b].total_cmp(&charged[a]).then(a.cmp(&b)));
    let total: f64 = order
        .iter()
        .map(|&i| charged[i] * meshes[i].instances as f64)
        .sum();
    let mut smaller = total;
    let mut huge = Vec::new();
    for i in order {
        smaller -= charged[i] * meshes[i].instances as f64;
        let alone = meshes[i].instances == 1;
        // The fraction is relative to the scene without those found so far.
        if !(alone && smaller > 0.0 && charged[i] > HUGE_RATIO * smaller) {
            break;
        }
        huge.push(i);
    }
    huge
}

/// A mesh with totals over its instances.
struct Surveyed {
    density: MeshDensity,
    /// World area of its largest instance, m².
    largest: f64,
    /// World area of all its instances, m².
    total: f64,
    /// The same, each multiplied by the square of its density factor.
    demand: f64,
}

impl std::ops::Deref for Surveyed {
    type Target = MeshDensity;
    fn deref(&self) -> &MeshDensity {
        &self.density
    }
}

impl std::ops::DerefMut for Surveyed {
    fn deref_mut(&mut self) -> &mut MeshDensity {
        &mut self.density
    }
}

fn survey(scene: &Scene, soup: &Soup) -> Vec<Surveyed> {
    let areas: Vec<Option<f64>> = scene
        .instances
        .par_iter()
        .enumerate()
        .map(|(i, instance)| {
            if !scene.has_lumels(i) {
                return None;
            }
            let listed = soup.instance_ranges.get(i).map_or(0.0, |&[first, end]| {
                let receiving = (first..end).filter(|&t| !scene.only_occludes(soup, t));
                receiving.map(|t| f64::from(soup.areas[t as usize])).sum()
            });
            // The soup omits duplicates, but an instance that coincides with another still needs
            // lumels.
            Some(if listed > 0.0 {
                listed
            } else {
                world_area(
                    scene,
                    &scene.meshes[instance.mesh],
                    instance.transform.matrix3,
                )
            })
        })
        .collect();
    let mut meshes: Vec<Surveyed> = scene
        .meshes
        .iter()
        .map(|_| Surveyed {
            density: MeshDensity {
                linear: DMat3::IDENTITY,
                area: 0.0,
                instances: 0,
                texels_per_unit: 1.0,
                factor: 1.0,
                adjusted: None,
            },
            largest: 0.0,
            total: 0.0,
            demand: 0.0,
        })
        .collect();
    for (instance, &area) in scene.instances.iter().zip(&areas) {
        let Some(area) = area else {
            continue;
        };
        let mesh = &mut meshes[instance.mesh];
        mesh.instances += 1;
        mesh.total += area;
        mesh.largest = mesh.largest.max(area);
        let square = |factor: f32| f64::from(factor).powi(2);
        let demand = area * square(instance.density);
        mesh.demand += demand;
        // Small differences count as equal, so that rounding of rotations does not decide which
        // instance represents the mesh.
        if mesh.instances == 1 || demand > mesh.area * square(mesh.factor) * (1.0 + 1e-4) {
            mesh.area = area;
            mesh.factor = instance.density;
            mesh.linear = shape_of(&instance.transform);
        }
    }
    meshes
}

/// Area of the primitives of `mesh` that receive light.
fn world_area(scene: &Scene, mesh: &Mesh, linear: DMat3) -> f64 {
    let area = |corners: [DVec3; 3]| {
        let [a, b, c] = corners.map(|p| linear * p);
        0.5 * (b - a).cross(c - a).length()
    };
    mesh.primitives
        .iter()
        .filter(|p| !scene.materials[p.material].occluder_only)
        .flat_map(|p| {
            p.triangles
                .iter()
                .map(|t| area(t.map(|v| p.positions[v as usize].as_dvec3())))
        })
        .sum()
}

/// Effect of a transform on lengths and angles, without rotation and mirroring: the upper
/// triangular R of M = Q R with a positive diagonal. A mesh mapped by R has its world-space shape,
/// so its UVs do not depend on its orientation.
///
/// Entries are rounded to 1e-5 of the largest, so that a rotated copy of a mesh gets exactly the
/// same R.
///
/// ```
/// use glam::{DAffine3, DMat3, DVec3};
///
/// let turned = DAffine3::from_rotation_y(0.7) * DAffine3::from_scale(DVec3::new(2.0, 1.0, 1.0));
/// assert_eq!(atlas::shape_of(&turned), DMat3::from_diagonal(DVec3::new(2.0, 1.0, 1.0)));
/// ```
pub fn shape_of(transform: &DAffine3) -> DMat3 {
    let m = transform.matrix3;
    let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
    let r11 = a.length();
    let q1 = a.normalize_or_zero();
    let r12 = q1.dot(b);
    let b = b - q1 * r12;
    let r22 = b.length();
    let q2 = b.normalize_or_zero();
    let (r13, r23) = (q1.dot(c), q2.dot(c));
    let r33 = (c - q1 * r13 - q2 * r23).length();
    // Rounding noise of node transforms is about 1e-7.
    rounded(DMat3::from_cols_array(&[
        r11, 0.0, 0.0, r12, r22, 0.0, r13, r23, r33,
    ]))
}

/// A shape times lumels per metre. Rounded again because densities are `f32`: 9 per metre and 0.009
/// per millimetre must give the same.
pub(crate) fn shape_in_lumels(shape: DMat3, texels_per_unit: f32) -> DMat3 {
    rounded(shape * f64::from(texels_per_unit))
}

/// Rounds an upper triangular matrix to 1e-5 of its largest entry's decade; its diagonal stays
/// positive.
fn rounded(m: DMat3) -> DMat3 {
    let [x, y, z] = [m.x_axis.x, m.y_axis.y, m.z_axis.z];
    let largest = x.max(y).max(z);
    if !(largest > 0.0 && largest.is_finite()) {
        return DMat3::IDENTITY;
    }
    let grid = 10f64.powi(libm::log10(largest).floor() as i32 - 5);
    let round = |x: f64| (x / grid).round() * grid;
    DMat3::from_cols(
        DVec3::new(round(x).max(grid), 0.0, 0.0),
        DVec3::new(round(m.y_axis.x), round(y).max(grid), 0.0),
        DVec3::new(round(m.z_axis.x), round(m.z_axis.y), round(z).max(grid)),
    )
}

/// The number of the R20 series of preferred numbers (ISO 3:1973) nearest to `x` > 0, by ratio:
/// steps of 12 %.
///
/// With these steps a level's density, and with it all its charts, stays the same until its surface
/// has grown by a quarter. With three digits it would change with every added crate.
pub fn preferred(x: f64) -> f32 {
    const R20: [f64; 21] = [
        1.0, 1.12, 1.25, 1.4, 1.6, 1.8, 2.0, 2.24, 2.5, 2.8, 3.15, 3.55, 4.0, 4.5, 5.0, 5.6, 6.3,
        7.1, 8.0, 9.0, 10.0,
    ];
    let power = libm::log10(x).floor();
    let unit = 10f64.powi(power as i32);
    let off = |n: f64| libm::log(x / (unit * n)).abs();
    let near = |best: f64, n: f64| if off(n) < off(best) { n } else { best };
    (R20.into_iter().fold(1.0, near) * unit) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn preferred_numbers_are_near_and_keep_their_digits_in_every_decade() {
        for (x, expected) in [
            (1.0, 1.0),
            (1.05, 1.0),
            (1.07, 1.12),
            (9.6, 10.0),
            (7.4, 7.1),
        ] {
            for decade in [-4, 0, 3] {
                let unit = 10f64.powi(decade);
                assert_eq!(
                    preferred(x * unit),
                    (expected * unit) as f32,
                    "{x} {decade}"
                );
            }
        }
        // R20's own rounding of 10^(k/20) is up to 1.2 %; half a step is 5.9 %.
        let mut x = 0.01f64;
        while x < 1000.0 {
            let ratio = f64::from(preferred(x)) / x;
            assert!((1.0 / 1.072..1.072).contains(&ratio), "{x}: {ratio}");
            x *= 1.0137;
        }
    }
}
