//! The first bounce: light that patches receive after one reflection.
//!
//! Where the sun shines through a window, most of a room's light comes from a spot that one ray in
//! a thousand hits, and so the level of light in the whole room depends on few rays. Elements that
//! direct light reaches are therefore sampled from patches as they are from lumels
//! ([`LitElements`]); rays and samples share their light by the balance heuristic.

use glam::{DVec3, Vec3};
use patch_subdivision::{Element, PatchId, Subdivision};
use rayon::prelude::*;

use crate::links::{Links, Sequence, pick};
use crate::lit::{LitCut, LitElements};
use crate::monitor::Monitor;
use crate::solution::of_lit;
use crate::world::{SurfacePoint, World, luminance};

/// Samples of lit elements for each of a patch's rays.
const SAMPLES: f32 = 1.0 / 8.0;

/// The same for the parts of a crowded patch, of which there are up to sixteen.
const OF_PARTS: f32 = 1.0 / 32.0;

/// Index of the set of random numbers.
const SET: u32 = 61;

/// Patches sampled in a row, which can share what they see.
const RUN: usize = 64;

/// How far apart, in edges of whole patches, the parts of a crowded patch are that share it. With
/// their own size that is an edge, which the receiver's size allows for.
const NEAR: f32 = 0.8;

/// What direct light makes of a scene.
pub(crate) struct LitScene<'s> {
    pub world: &'s World<'s>,
    pub cut: &'s Subdivision,
    /// By element: mean reflectance, direct irradiance, and the same by element and group if there
    /// are several groups.
    pub reflectance: &'s [Vec3],
    pub direct: &'s [Vec3],
    pub by_group: &'s [Vec3],
    pub groups: usize,
}

/// Light from lit elements, sampled from each patch.
pub(crate) struct FirstBounce {
    /// By receiving patch: what rays leave out ([`of_lit`]).
    share: Vec<f32>,
    /// By receiving patch and group: irradiance that samples contribute.
    sampled: Vec<DVec3>,
    groups: usize,
    senders: Vec<Sender>,
}

/// A patch as seen from others.
#[derive(Clone, Copy)]
struct Sender {
    middle: Vec3,
    edge: f32,
    /// Luminance of its mean direct irradiance; 0 if it is not sampled.
    arrives: f32,
}

impl Sender {
    /// Share of the light from `other` that samples contribute here.
    fn of_samples(&self, other: &Sender, share: f32) -> f32 {
        // Half diagonals are 0.71 edges, so points are farther from each other than an edge of
        // `other`: nearer ones `LitElements` leaves to rays.
        let apart = LitElements::FROM * other.edge + 0.75 * (self.edge + other.edge);
        match self.middle.distance_squared(other.middle) > apart * apart {
            true => of_lit(share, other.arrives),
            false => 0.0,
        }
    }
}

/// The lit elements as seen from a patch.
struct LitView {
    cut: LitCut,
    /// What rays leave out.
    share: f32,
    /// The patch.
    from: usize,
}

impl LitView {
    /// Whether patch `p` may use it: the parts of a crowded patch, each a patch of its own, see
    /// nearly the same.
    fn serves(&self, cut: &Subdivision, p: usize, senders: &[Sender]) -> bool {
        let [own, other] = [p, self.from].map(|p| cut.patches()[p]);
        let triangle = |p: usize| cut.elements()[cut.patches()[p].first_element as usize].triangle;
        let near = NEAR * senders[p].edge;
        own.fine
            && other.fine
            && own.back == other.back
            && cut.region_of(triangle(p)) == cut.region_of(triangle(self.from))
            && senders[p]
                .middle
                .distance_squared(senders[self.from].middle)
                < near * near
    }
}

impl FirstBounce {
    /// Samples lit elements from each patch, for `rays` rays a patch; stops early if the monitor
    /// cancels.
    pub(crate) fn sample(lit: &LitScene, rays: u32, monitor: &dyn Monitor) -> FirstBounce {
        let (world, cut) = (lit.world, lit.cut);
        let n = cut.patches().len();
        let elements = LitElements::of(world, cut, lit.reflectance, lit.direct, &|_| true);
        let senders: Vec<Sender> = (0..n).into_par_iter().map(|p| lit.sender(p)).collect();
        let mut bounce = FirstBounce {
            share: vec![0.0; n],
            sampled: vec![DVec3::ZERO; n * lit.groups],
            groups: lit.groups,
            senders,
        };
        if elements.is_empty() || monitor.cancelled() {
            return bounce;
        }
        let mut patch_of = vec![0u32; cut.elements().len()];
        for p in 0..n {
            patch_of[cut.elements_of(PatchId(p as u32))].fill(p as u32);
        }
        let senders = &bounce.senders;
        (bounce.share.par_chunks_mut(RUN))
            .zip(bounce.sampled.par_chunks_mut(RUN * lit.groups))
            .enumerate()
            .filter(|_| !monitor.cancelled())
            .for_each(|(chunk, (shares, sampled))| {
                let mut seen: Option<LitView> = None;
                for (k, share) in shares.iter_mut().enumerate() {
                    let p = chunk * RUN + k;
                    if cut.patches()[p].hidden {
                        continue;
                    }
                    let per_ray = match cut.patches()[p].fine {
                        true => OF_PARTS,
                        false => SAMPLES,
                    };
                    let from = match seen.take() {
                        Some(seen) if seen.serves(cut, p, senders) => seen,
                        _ => lit.seen_from(&elements, p, senders, per_ray),
                    };
                    let count = ((per_ray * rays as f32) as u32).max(1);
                    *share = from.share;
                    let sampled = &mut sampled[k * lit.groups..(k + 1) * lit.groups];
                    lit.receive((&elements, &patch_of, &from), senders, (p, count), sampled);
                    seen = Some(from);
                }
            });
        bounce
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&self.share[..])
            + size_of_val(&self.sampled[..])
            + size_of_val(&self.senders[..])) as u64
    }

    /// The share of the direct light that patch `other` reflects to `patch` and that rays find.
    pub(crate) fn left_to_rays(&self, patch: usize, other: usize) -> f32 {
        1.0 - self.senders[patch].of_samples(&self.senders[other], self.share[patch])
    }

    /// Irradiance of a patch by light of a group that others reflect once. `radiosity` is theirs.
    pub(crate) fn gather(
        &self,
        links: &Links,
        patch: usize,
        group: usize,
        radiosity: &[DVec3],
    ) -> DVec3 {
        let (own, share) = (&self.senders[patch], self.share[patch]);
        if share == 0.0 {
            return links.gather(patch, radiosity);
        }
        let sent = |j: usize| {
            let b = radiosity.get(j).filter(|b| **b != DVec3::ZERO)?;
            Some(*b * (1.0 - f64::from(own.of_samples(&self.senders[j], share))))
        };
        links.mean(patch, sent) + self.sampled[patch * self.groups + group]
    }
}

impl LitScene<'_> {
    fn sender(&self, patch: usize) -> Sender {
        let cut = self.cut;
        let (mut middle, mut area, mut arrives) = (Vec3::ZERO, 0f32, 0f32);
        let (mut edge, mut whole) = (0f32, true);
        for k in cut.elements_of(PatchId(patch as u32)) {
            let e = cut.elements()[k];
            let [a, b, c] = self.world.soup.triangles[e.triangle as usize];
            middle += (a + (b - a) * e.u + (c - a) * e.v) * e.area;
            area += e.area;
            arrives += luminance(self.direct[k]) * e.area;
            edge = edge.max(cut.patch_edge(e.triangle));
            whole &= !self.world.lets_light_through(e.triangle);
        }
        let inverse = 1.0 / area.max(f32::MIN_POSITIVE);
        Sender {
            middle: middle * inverse,
            edge,
            arrives: if whole { arrives * inverse } else { 0.0 },
        }
    }

    /// A point of an element, on the patch's side.
    fn point(&self, back: bool, e: &Element) -> SurfacePoint {
        (self.world).inset_point(e.triangle, e.u, e.v, back, false)
    }

    /// The lit elements as seen from patch `p`, of which `per_ray` are sampled for each ray.
    fn seen_from(
        &self,
        elements: &LitElements,
        p: usize,
        senders: &[Sender],
        per_ray: f32,
    ) -> LitView {
        let back = self.cut.patches()[p].back;
        let own = &self.cut.elements()[self.cut.elements_of(PatchId(p as u32))];
        let middle = self.point(back, &own[own.len() / 2]);
        let bend = (own.iter())
            .map(|e| self.point(back, e).normal.distance_squared(middle.normal))
            .fold(0.0, f32::max);
        let cut = elements.cut(&middle, senders[p].edge, bend.sqrt());
        LitView {
            share: elements.share(&cut, per_ray),
            cut,
            from: p,
        }
    }

    /// Samples lit elements from patch `p`.
    fn receive(
        &self,
        (elements, patch_of, seen): (&LitElements, &[u32], &LitView),
        senders: &[Sender],
        (p, count): (usize, u32),
        sampled: &mut [DVec3],
    ) {
        if seen.share == 0.0 {
            return;
        }
        let (world, cut) = (self.world, self.cut);
        let own = &cut.elements()[cut.elements_of(PatchId(p as u32))];
        let area: f32 = own.iter().map(|e| e.area).sum();
        let sequence = Sequence::new(SET, cut, PatchId(p as u32), count);
        for k in 0..count {
            let s = sequence.sample(k);
            let at = self.point(cut.patches()[p].back, &own[pick(own, area, s[1])]);
            let drawn = elements.draw(&seen.cut, s[0]);
            let Some((drawn, from)) = drawn.and_then(|d| Some((d, elements.arriving(d, &at)?)))
            else {
                continue;
            };
            let e = elements.element(drawn) as usize;
            let weight = senders[p].of_samples(&senders[patch_of[e] as usize], seen.share);
            if weight == 0.0 {
                continue;
            }
            let passed = world.transmitted(at.origin, from.to, 1.0);
            if passed == Vec3::ZERO {
                continue;
            }
            let sends = self.reflectance[e]
                * (cut.elements()[e].area * std::f32::consts::FRAC_1_PI * from.kernel)
                * passed
                * (weight / count as f32);
            match &mut *sampled {
                [one] => *one += (sends * self.direct[e]).as_dvec3(),
                several => {
                    let light = &self.by_group[e * self.groups..];
                    for (sum, light) in several.iter_mut().zip(light) {
                        *sum += (sends * *light).as_dvec3();
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use mesh_ingest::Soup;
    use patch_subdivision::Options;

    use super::*;
    use crate::fixtures::cube;
    use crate::monitor::Silent;
    use crate::solve::PatchSurfaces;
    use crate::world::WorldOptions;

    const RAYS_OF_PATCH: u32 = 32;

    /// Flux that a cube's patches receive from those that are lit, given their numbers and normals,
    /// over the flux that these send: by rays and samples, and by rays alone; in two groups that
    /// share the light.
    fn received(is_lit: impl Fn(usize, Vec3) -> bool) -> [f64; 2] {
        let scene = cube(0.5, Vec3::ZERO);
        let soup = Soup::build(&scene);
        let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
        let options = Options {
            patches: 1600,
            ..Options::default()
        };
        let cut = Subdivision::build(&soup, |_| false, &options);
        let n = cut.patches().len();
        let reflectance = vec![Vec3::splat(0.5); cut.elements().len()];
        let mut direct = vec![Vec3::ZERO; cut.elements().len()];
        for p in 0..n {
            let range = cut.elements_of(PatchId(p as u32));
            let normal = soup.normals[cut.elements()[range.start].triangle as usize];
            if is_lit(p, normal) {
                direct[range].fill(Vec3::splat(3.0));
            }
        }
        let by_group: Vec<Vec3> = direct.iter().flat_map(|d| [0.25 * *d, 0.75 * *d]).collect();
        let lit = |groups| LitScene {
            world: &world,
            cut: &cut,
            reflectance: &reflectance,
            direct: &direct,
            by_group: &by_group,
            groups,
        };
        let [one, two] =
            [1, 2].map(|groups| FirstBounce::sample(&lit(groups), RAYS_OF_PATCH, &Silent));
        let surfaces = PatchSurfaces::average(&cut, &reflectance, &direct);
        let part =
            |of: f64| -> Vec<DVec3> { surfaces.direct_radiosity.iter().map(|b| *b * of).collect() };
        let parts = [part(0.25), part(0.75)];
        let mut links = Links::new(n, RAYS_OF_PATCH);
        links
            .extend(&world, &cut, |_| RAYS_OF_PATCH, &Silent)
            .unwrap();
        let sent: f64 = (surfaces.area.iter().zip(&surfaces.direct_radiosity))
            .map(|(area, b)| area * b.x)
            .sum();
        let (mut sampled, mut cast) = (0.0, 0.0);
        for i in 0..n {
            let whole = one.gather(&links, i, 0, &surfaces.direct_radiosity);
            let of_groups: DVec3 = (0..2).map(|g| two.gather(&links, i, g, &parts[g])).sum();
            // Samples are f32.
            assert!((whole - of_groups).abs().max_element() <= 1e-5 * whole.max_element());
            sampled += surfaces.area[i] * whole.x;
            cast += surfaces.area[i] * links.gather(i, &surfaces.direct_radiosity).x;
        }
        [sampled / sent, cast / sent]
    }

    #[test]
    fn what_a_spot_sends_arrives_once_and_with_less_noise_than_by_rays() {
        // One patch in 100, on all faces. In a closed room all of its light arrives.
        let ratios: Vec<[f64; 2]> = (0..1176)
            .step_by(100)
            .map(|lit| received(|p, _| p == lit))
            .collect();
        let count = ratios.len() as f64;
        let [sampled, cast] = [0, 1].map(|k| {
            let squares: f64 = ratios.iter().map(|r| (r[k] - 1.0).powi(2)).sum();
            (squares / count).sqrt()
        });
        let mean = ratios.iter().map(|r| r[0]).sum::<f64>() / count;
        // Some 32 rays find it: 0.14 instead of a sixth, as they are stratified. Samples give 0.03;
        // what rays still bring there comes from patches close to it.
        assert!(sampled < 0.3 * cast, "{sampled} {cast}");
        // Three standard errors of the mean.
        assert!(
            (mean - 1.0).abs() < 3.0 * sampled / count.sqrt(),
            "{mean} ± {sampled}"
        );
    }

    #[test]
    fn what_a_wall_sends_arrives_without_bias() {
        let walls = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| [axis, -axis]);
        let ratios: Vec<f64> = (walls.as_flattened().iter())
            .map(|side| received(|_, normal| normal.dot(*side) > 0.5)[0])
            .collect();
        let mean = ratios.iter().sum::<f64>() / 6.0;
        let squares: f64 = ratios.iter().map(|r| (r - mean).powi(2)).sum();
        // Standard error of the mean of six; 0.0018 with these numbers of patches and rays.
        let error = (squares / 5.0 / 6.0).sqrt();
        assert!(error < 0.003, "{ratios:?}");
        assert!((mean - 1.0).abs() < 3.0 * error, "{mean} ± {error}");
    }
}
