//! `--cull-unseen`: surfaces that nobody sees from where players walk get no lumels.
//!
//! Sample points represent the places where players can be: in walkable volumes, at the points of a
//! probe file, or wherever a flood of rays from the cameras arrives. A triangle is seen if a ray
//! from a sample point hits it, or if a segment between a point on it and a sample point is free.
//! Cut-out, blended and glass surfaces hide nothing. Triangles that fail both tests are culled.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DAffine3, DVec3, Vec3};
use mesh_ingest::{Scene, Soup};
use radiosity::{hash_u32, sample_2d, sample_4d};
use rayon::prelude::*;
use serde::Serialize;
use visibility::{BuildOptions, Bvh, HitFilter, Ray};
use wildmatch::WildMatch;

use crate::error::Error;
use crate::named::node_of;
use crate::page_groups;
use crate::probes;
use crate::settings::Settings;

/// Most sample points. More would find more slits, in proportional time.
const POINTS: usize = 1024;

/// Rays from each sample point over the sphere.
const RAYS: u32 = 1024;

/// Number of sample points that each unseen triangle is tested against, and of points on the
/// triangle for each. If a fiftieth of all segments between the triangle and the sample points is
/// free, all of these tests miss it with a probability of 0.98^512 = 3e-5.
const AGAINST: usize = 128;
const ON_TRIANGLE: u32 = 4;

/// Range of heights above a walkable node from which players look around, metres.
const FEET: f32 = 0.1;
const EYES: f32 = 2.0;

/// Rounds of a flood; each extends as far as its rays.
const FLOODS: usize = 8;

/// What was culled.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CullReport {
    /// Where players walk: `walkable`, `probes` or `cameras`.
    pub from: &'static str,
    /// Number of sample points.
    pub points: usize,
    /// Number of triangles without lumels.
    pub triangles: u64,
    /// Share of the surface that could have lumels.
    pub area: f64,
    /// Nodes without any lumels.
    pub nodes: Vec<String>,
    /// Nodes that lost part of their lumels: name and share of their area.
    pub partly: Vec<(String, f64)>,
}

/// Finds the surfaces that nobody sees, and marks them in `scene`.
///
/// # Errors
/// [`Error::Setting`] if nothing says where players walk, or a name matches nothing.
pub(crate) fn apply(
    scene: &mut Scene,
    soup: &Soup,
    settings: &Settings,
) -> Result<Option<CullReport>, Error> {
    if !settings.cull_unseen {
        return Ok(None);
    }
    let probes = settings.probes.as_ref().map(probes::read).transpose()?;
    let probes = probes.unwrap_or_default();
    let bvh = Bvh::build(
        soup.seen_triangles(),
        |t| scene.needs_alpha(soup.materials[t as usize]),
        &BuildOptions::default(),
    )
    .map_err(|e| Error::Internal(format!("cannot build the tree: {e}")))?;
    let looker = Looker { soup, bvh };
    let (from, points) = looker.points(scene, settings, &probes)?;
    let seen = looker.seen(&points);
    let mut report = mark(scene, soup, &seen);
    report.from = from;
    report.points = points.len();
    Ok(Some(report))
}

/// A filter by which surfaces that let light through hide nothing.
struct Opaque;

impl HitFilter for Opaque {
    fn accept(&self, _: u32, _: f32, _: f32, _: &Ray) -> bool {
        false
    }
}

struct Looker<'s> {
    soup: &'s Soup,
    bvh: Bvh,
}

impl Looker<'_> {
    /// Sample points in recentred world space, and where they come from.
    fn points(
        &self,
        scene: &Scene,
        settings: &Settings,
        probes: &[DVec3],
    ) -> Result<(&'static str, Vec<Vec3>), Error> {
        let mut boxes = scene.walkable.clone();
        for pattern in &settings.walkable {
            let wild = WildMatch::new(pattern);
            let named = (scene.instances.iter().enumerate()).filter(|(_, i)| wild.matches(&i.name));
            let before = boxes.len();
            boxes.extend(named.map(|(i, _)| self.bounds(i)));
            if boxes.len() == before {
                let names = scene.instances.iter().map(|i| i.name.as_str());
                return Err(Error::Setting(format!(
                    "--walkable: no node with a mesh is named {pattern:?}; there are {}",
                    page_groups::list(names)
                )));
            }
        }
        let (from, points) = if !boxes.is_empty() {
            ("walkable", in_boxes(&boxes))
        } else if !probes.is_empty() {
            let step = probes.len().div_ceil(POINTS);
            let local = |p: &DVec3| (*p - scene.origin).as_vec3();
            ("probes", probes.iter().step_by(step).map(local).collect())
        } else if !scene.cameras.is_empty() {
            ("cameras", self.flood(&scene.cameras))
        } else {
            return Err(Error::Setting(
                "--cull-unseen: nothing says where players walk: expected a node with extras.lumel.walkable, --walkable NAME, a file of --probes or a camera".into(),
            ));
        };
        Ok((from, points))
    }

    /// The box of an instance's triangles, extended by the heights from which a player on it looks
    /// around.
    fn bounds(&self, instance: usize) -> DAffine3 {
        let [start, end] = self.soup.instance_ranges[instance];
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in self.soup.triangles[start as usize..end as usize]
            .iter()
            .flatten()
        {
            (low, high) = (low.min(*p), high.max(*p));
        }
        let (low, high) = (low + Vec3::Y * FEET, high + Vec3::Y * EYES);
        let half = (0.5 * (high - low)).as_dvec3();
        DAffine3::from_scale_rotation_translation(
            half,
            glam::DQuat::IDENTITY,
            (0.5 * (low + high)).as_dvec3(),
        )
    }

    /// Points that rays from `start` reach: halfway to each hit, and just before it.
    fn flood(&self, start: &[Vec3]) -> Vec<Vec3> {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in self.soup.seen_triangles().iter().flatten() {
            (low, high) = (low.min(*p), high.max(*p));
        }
        let cell = ((high - low).length() / 64.0).max(1e-3);
        let key = |p: Vec3| (p / cell).floor().as_ivec3().to_array();
        let mut taken = std::collections::BTreeSet::new();
        let mut points: Vec<Vec3> = Vec::new();
        let mut front: Vec<Vec3> = start.to_vec();
        for _ in 0..FLOODS {
            let mut next = Vec::new();
            for p in front {
                if points.len() < POINTS && taken.insert(key(p)) {
                    points.push(p);
                    next.push(p);
                }
            }
            // Few rays each, because the next round starts from every place reached.
            let reached: Vec<Vec<Vec3>> = (next.par_iter())
                .map(|p| {
                    let rays = (0..64).filter_map(|i| {
                        let ray = self.ray(*p, i, 64);
                        let hit = self.bvh.closest_hit(&ray, &Opaque)?;
                        Some((ray, hit.t))
                    });
                    rays.flat_map(|(ray, t)| [0.5, 0.95].map(|s| *p + ray.direction * (s * t)))
                        .collect()
                })
                .collect();
            front = reached.into_iter().flatten().collect();
        }
        points
    }

    /// Ray `i` of `n` from a point over the sphere; their directions differ from point to point.
    fn ray(&self, p: Vec3, i: u32, n: u32) -> Ray {
        let seed = p
            .to_array()
            .iter()
            .fold(n, |s, x| hash_u32(s ^ x.to_bits()));
        let [u, v] = sample_2d(i, 0, seed);
        let z = 1.0 - 2.0 * u;
        let (sin, cos) = libm::sincosf(std::f32::consts::TAU * v);
        let r = (1.0 - z * z).max(0.0).sqrt();
        Ray {
            origin: p,
            direction: Vec3::new(r * cos, r * sin, z),
            t_min: 0.0,
            t_max: f32::INFINITY,
        }
    }

    /// For each triangle of the soup, whether any sample point sees it.
    fn seen(&self, points: &[Vec3]) -> Vec<bool> {
        let n = self.soup.triangles.len();
        let hit: Vec<AtomicBool> = (0..n).map(|_| AtomicBool::new(false)).collect();
        points.par_iter().for_each(|p| {
            for i in 0..RAYS {
                if let Some(h) = self.bvh.closest_hit(&self.ray(*p, i, RAYS), &Opaque) {
                    hit[h.triangle as usize].store(true, Ordering::Relaxed);
                }
            }
        });
        let seen_by_rays = |t: usize| hit[t].load(Ordering::Relaxed);
        let step = points.len().div_ceil(AGAINST).max(1);
        (0..n)
            .into_par_iter()
            .with_min_len(64)
            .map(|t| {
                // Coarser levels of detail stand in for others, whose visibility they share.
                t >= self.soup.seen()
                    || seen_by_rays(t)
                    || (points.iter().skip(t % step).step_by(step))
                        .enumerate()
                        .any(|(k, p)| self.meets(t, k as u32, *p))
            })
            .collect()
    }

    /// Whether some point on triangle `t` and the sample point `p` see each other.
    fn meets(&self, t: usize, k: u32, p: Vec3) -> bool {
        let [a, b, c] = self.soup.triangles[t];
        let normal = self.soup.normals[t];
        (0..ON_TRIANGLE).any(|i| {
            let s = sample_4d(k * ON_TRIANGLE + i, 5, t as u32);
            let (u, v) = match s[0] + s[1] > 1.0 {
                true => (1.0 - s[0], 1.0 - s[1]),
                false => (s[0], s[1]),
            };
            let at = a + (b - a) * u + (c - a) * v;
            let to = p - at;
            let side = normal * normal.dot(to).signum();
            let origin = at + side * (1e-4 * to.length()).min(1e-3);
            let ray = Ray {
                origin,
                direction: p - origin,
                t_min: 0.0,
                t_max: 1.0,
            };
            !self.bvh.occluded(&ray, &Opaque)
        })
    }
}

/// Points on regular grids in boxes, which map the cube from −1 to 1; about [`POINTS`] in all.
fn in_boxes(boxes: &[DAffine3]) -> Vec<Vec3> {
    let sides = |b: &DAffine3| {
        let m = b.matrix3;
        [m.x_axis, m.y_axis, m.z_axis].map(|a| 2.0 * a.length())
    };
    let volume: f64 = boxes.iter().map(|b| sides(b).iter().product::<f64>()).sum();
    let each = POINTS / boxes.len().clamp(1, POINTS);
    let spacing = libm::cbrt(volume / POINTS as f64).max(1e-3);
    let mut out = Vec::new();
    for b in boxes.iter().take(POINTS) {
        // Flat boxes have few cells across, but at least one.
        let mut n = sides(b).map(|s| ((s / spacing).ceil() as usize).clamp(1, 64));
        while n.iter().product::<usize>() > 2 * each.max(8) {
            let widest = (0..3).max_by_key(|&k| n[k]).unwrap_or(0);
            n[widest] = n[widest].div_ceil(2);
        }
        let cells: usize = n.iter().product();
        for i in 0..cells {
            let at = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
            let local: [f64; 3] =
                std::array::from_fn(|k| 2.0 * (at[k] as f64 + 0.5) / n[k] as f64 - 1.0);
            out.push(b.transform_point3(DVec3::from_array(local)).as_vec3());
        }
    }
    out
}

/// Marks triangles of meshes that no instance shows, and instances that are completely unseen.
fn mark(scene: &mut Scene, soup: &Soup, seen: &[bool]) -> CullReport {
    let mut report = CullReport::default();
    let mut unseen: Vec<Vec<Vec<bool>>> = (scene.meshes.iter())
        .map(|m| {
            m.primitives
                .iter()
                .map(|p| vec![true; p.triangles.len()])
                .collect()
        })
        .collect();
    let (mut all, mut lost) = (0.0, 0.0);
    let mut shown = vec![[0.0f64; 2]; scene.instances.len()];
    for (t, source) in soup.sources.iter().enumerate() {
        let instance = source.instance as usize;
        if !scene.receives(instance, source.primitive as usize) || !scene.has_lumels(instance) {
            continue;
        }
        let area = f64::from(soup.areas[t]);
        shown[instance][usize::from(!seen[t])] += area;
        all += area;
        if seen[t] {
            let mesh = scene.instances[instance].mesh;
            unseen[mesh][source.primitive as usize][source.triangle as usize] = false;
        }
    }
    // Triangles that coincide with others take the light of those.
    for d in &soup.duplicates {
        let mesh = scene.instances[d.source.instance as usize].mesh;
        unseen[mesh][d.source.primitive as usize][d.source.triangle as usize] = false;
    }
    for (i, [kept, gone]) in shown.iter().enumerate() {
        if *gone == 0.0 {
            continue;
        }
        if *kept == 0.0 {
            report.nodes.push(node_of(scene, i));
            scene.instances[i].density = 0.0;
            lost += gone;
        }
    }
    for (t, source) in soup.sources.iter().enumerate() {
        let instance = source.instance as usize;
        let mesh = scene.instances[instance].mesh;
        if !scene.receives(instance, source.primitive as usize) {
            continue;
        }
        let gone = unseen[mesh][source.primitive as usize][source.triangle as usize];
        report.triangles += u64::from(gone);
        if gone && scene.has_lumels(instance) {
            lost += f64::from(soup.areas[t]);
        }
    }
    for (i, [kept, gone]) in shown.iter().enumerate() {
        if *kept > 0.0 && *gone > 0.0 {
            report
                .partly
                .push((node_of(scene, i), gone / (kept + gone)));
        }
    }
    report.area = lost / all.max(f64::MIN_POSITIVE);
    scene.unseen = unseen;
    report
}
