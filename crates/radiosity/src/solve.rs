//! The whole solve: direct light, links, relaxation.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, Vec3};
use mesh_ingest::Pyramids;
use patch_subdivision::{
    ElementId, ElementPoints, Options as CutOptions, PatchId, PointOn, Stats, Subdivision,
};
use rayon::prelude::*;

use crate::audit::audit;
use crate::direct::{DirectLight, DirectOptions, DirectParts, Known};
use crate::emitters::Emitters;
use crate::first_bounce::{FirstBounce, LitScene};
use crate::links::{Links, TIMES, rays_of_patch};
use crate::monitor::{Cancelled, Monitor, Phase, Silent};
use crate::openings::Openings;
use crate::relax::{RelaxOptions, RelaxReport, System};
use crate::sampling::{cosine_hemisphere, hash_u32, sample_2d};
use crate::scarce::scarce;
use crate::solution::{Afar, GroupLight, Solution, SolveReport, SolveStep, WALL, element_edge};
use crate::world::{Emission, Side, SurfacePoint, World, luminance};

/// The resolution of a solve.
#[derive(Debug, Clone, Copy)]
pub struct SolveOptions {
    /// Patches and elements.
    pub cut: CutOptions,
    /// Rays per patch; fewer if their memory would exceed `link_bytes`.
    pub rays: u32,
    /// Maximum memory for links, in bytes.
    pub link_bytes: u64,
    /// Direct light on elements.
    pub direct: DirectOptions,
    /// Split patches with something close to them into their elements, each with its own light.
    pub crowded: bool,
    /// At hits on patches with varying direct light, sample a light instead of reading the
    /// element's direct light.
    pub resample: bool,
    /// When to stop.
    pub relax: RelaxOptions,
}

impl Default for SolveOptions {
    fn default() -> Self {
        SolveOptions {
            cut: CutOptions::default(),
            rays: 256,
            link_bytes: 512 << 20,
            direct: DirectOptions::every(8, 8),
            crowded: true,
            resample: true,
            relax: RelaxOptions::default(),
        }
    }
}

/// Rays per patch in the first pass; each later pass quadruples them.
const FIRST_PASS: u32 = 16;

/// Patches whose light arrives more often than this get [`TIMES`] the rays of others: those of
/// closed rooms that reflect more than 88 %.
const OFTEN: f64 = 8.0;

/// Residual at which the number of arrivals is known well enough.
const ROUGH: f64 = 0.1;

/// Residual at which passes before the last stop. Their result is only the starting point of the
/// next pass, and the noise of few rays is larger than this.
const EARLY: f64 = 1e-2;

/// Solves the light of a scene.
///
/// The solve is progressive: its passes use more and more rays, each pass starts from the previous
/// result, and the last one is relaxed until its residual is below the tolerance. If the monitor
/// cancels, the last result is kept (at least direct light on the finished elements) and
/// [`SolveReport::cancelled`] is set.
///
/// The same input gives the same bits for any number of threads.
pub fn solve(
    world: &World,
    emitters: &Emitters,
    options: &SolveOptions,
    monitor: &dyn Monitor,
) -> Solution {
    let Divided {
        cut,
        buried,
        walled,
    } = divide(world, options);
    let mut report = SolveReport {
        subdivision: cut.stats(),
        buried_elements: buried,
        walled_elements: walled,
        fine_patches: (cut.patches().iter()).filter(|p| p.fine).count() as u64,
        emitters: emitters.len(),
        ..SolveReport::default()
    };
    let light = direct_light(world, emitters, &cut, &options.direct, monitor);
    report.shadow_rays = light.rays;
    report.cancelled = !light.finished;
    let reflectance = element_reflectance(world, &cut);
    let groups = world.group_count();
    let surfaces = PatchSurfaces::average(&cut, &reflectance, &light.direct);
    let by_group = light.surfaces_by_group(&cut, &reflectance, groups);
    let rays = rays_per_patch(world, cut.patches().len(), options);
    let first_bounce = FirstBounce::sample(
        &LitScene {
            world,
            cut: &cut,
            reflectance: &reflectance,
            direct: &light.direct,
            by_group: &light.groups,
            groups,
        },
        rays,
        monitor,
    );
    let bounces = Bounces {
        world,
        cut: &cut,
        surfaces: &surfaces,
        by_group: &by_group,
        first: &first_bounce,
        most: rays,
        most_links: options.link_bytes / 4,
        relax: options.relax,
    };
    let (links, of_groups) = bounces.solve(&mut report, monitor);
    let indirect: Vec<DVec3> = match &of_groups[..] {
        [one] => one.clone(),
        all => (0..links.patches)
            .map(|i| all.iter().map(|g| g[i]).sum())
            .collect(),
    };
    let openings = Openings::find(world, &cut, &links);
    report.link_rays = links.count() as u64;
    report.bytes = links.bytes()
        + openings.bytes()
        + first_bounce.bytes()
        + report.subdivision.bytes
        + (cut.elements().len() * size_of::<Afar>()) as u64
        + ((light.direct.len() + reflectance.len() + light.groups.len()) * size_of::<Vec3>())
            as u64;
    report.audit = audit(
        world,
        &cut,
        &links,
        &surfaces,
        &light.direct,
        &indirect,
        &report.relaxation,
    );
    let rough = match options.resample {
        true => find_rough(&cut, &light.direct),
        false => vec![false; links.patches],
    };
    report.rough_patches = rough.iter().filter(|r| **r).count() as u64;
    let groups = (groups > 1).then(|| GroupLight {
        count: groups,
        direct: light.groups,
        direct_mean: interleave(&by_group, links.patches, |g, i| g.direct[i].as_vec3()),
        indirect: interleave(&of_groups, links.patches, |g, i| g[i].as_vec3()),
    });
    let mut solution = Solution {
        openings,
        groups,
        direct_mean: surfaces.direct.iter().map(|e| e.as_vec3()).collect(),
        afar: Vec::new(),
        indirect: indirect.iter().map(|e| e.as_vec3()).collect(),
        cut,
        direct: light.direct,
        reflectance,
        rough,
        report,
    };
    solution.refresh(world);
    solution
}

/// Rays that each patch gets in the last pass.
fn rays_per_patch(world: &World, patches: usize, options: &SolveOptions) -> u32 {
    // Links take 4 bytes per ray.
    let affordable = options.link_bytes / (4 * patches.max(1) as u64);
    if world.is_dark() {
        FIRST_PASS // for the row sums; there is no light to distribute
    } else {
        options
            .rays
            .min(affordable.min(u64::from(u32::MAX)) as u32)
            .max(FIRST_PASS)
    }
}

/// Values by patch, then by group, of values by group.
fn interleave<G>(groups: &[G], patches: usize, value: impl Fn(&G, usize) -> Vec3) -> Vec<Vec3> {
    let n = groups.len();
    (0..patches * n)
        .map(|k| value(&groups[k % n], k / n))
        .collect()
}

/// What light does after it has arrived: the passes of the solve.
struct Bounces<'s> {
    world: &'s World<'s>,
    cut: &'s Subdivision,
    surfaces: &'s PatchSurfaces,
    /// The same with the light of each group alone, if groups are separate.
    by_group: &'s [PatchSurfaces],
    first: &'s FirstBounce,
    /// Rays per patch in the last pass, unless it needs more.
    most: u32,
    /// Most rays of all patches.
    most_links: u64,
    relax: RelaxOptions,
}

impl Bounces<'_> {
    /// Irradiance by reflected light and by the sky, by group and patch; and the links of the last
    /// pass.
    fn solve(&self, report: &mut SolveReport, monitor: &dyn Monitor) -> (Links, Vec<Vec<DVec3>>) {
        let patches = self.cut.patches().len();
        let mut links = Links::of(self.world, patches, self.most);
        let mut of_groups = vec![vec![DVec3::ZERO; patches]; self.world.group_count()];
        let mut rays = FIRST_PASS.min(self.most);
        let mut more = Vec::new();
        while !report.cancelled {
            let last = rays == self.most;
            let wanted = |p: usize| {
                let own = rays_of_patch(&self.cut.patches()[p], rays);
                match more.get(p) {
                    Some(true) if last => TIMES * own,
                    _ => own,
                }
            };
            if let Err(Cancelled) = links.extend(self.world, self.cut, wanted, monitor) {
                report.cancelled = true;
                break;
            }
            report.rays_per_patch = rays;
            report.relaxation = self.pass(&links, rays, &mut of_groups, report, monitor);
            report.cancelled = monitor.cancelled();
            if last {
                break;
            }
            if more.is_empty() {
                more = self.need_more(&links, &of_groups);
            }
            rays = (rays * 4).min(self.most);
        }
        (links, of_groups)
    }

    /// By patch, whether it gets [`TIMES`] the rays of others: if light that it sends arrives often,
    /// or few rays bring it light. If memory is short, only the former count, or none.
    fn need_more(&self, links: &Links, of_groups: &[Vec<DVec3>]) -> Vec<bool> {
        let fits = |more: &Vec<bool>| {
            let rays = (more.iter().zip(self.cut.patches())).map(|(more, p)| {
                u64::from(rays_of_patch(p, self.most)) * if *more { u64::from(TIMES) } else { 1 }
            });
            rays.sum::<u64>() <= self.most_links
        };
        let often = self.reflected_often(links);
        let scarce = self.scarcely_lit(links, of_groups);
        let both = often.iter().zip(scarce).map(|(a, b)| a | b).collect();
        ([both, often].into_iter().find(fits)).unwrap_or_else(|| vec![false; links.patches])
    }

    /// By patch, whether light that it sends arrives often: first there, then reflected. Each error
    /// of what is lost at a reflection adds up: in a room that reflects 98 %, `preview`'s 64 rays a
    /// patch leave the level of light 1 % off, in a colour that depends on the draw.
    fn reflected_often(&self, links: &Links) -> Vec<bool> {
        let ones = vec![DVec3::ONE; links.patches];
        let system = System {
            links,
            reflectance: &self.surfaces.reflectance,
            area: &self.surfaces.area,
            source: &ones,
        };
        let mut arrivals = ones.clone();
        let rough = RelaxOptions {
            tolerance: ROUGH,
            ..self.relax
        };
        system.relax(&mut arrivals, &rough, &Silent);
        arrivals.iter().map(|n| n.max_element() > OFTEN).collect()
    }

    /// By patch, whether few rays bring it light, given the light of a pass.
    fn scarcely_lit(&self, links: &Links, of_groups: &[Vec<DVec3>]) -> Vec<bool> {
        let of = |c: DVec3| f64::from(luminance(c.as_vec3()));
        let further: Vec<f64> = (0..links.patches)
            .map(|p| {
                let arrives: DVec3 = of_groups.iter().map(|g| g[p]).sum();
                of(arrives * self.surfaces.reflectance[p])
            })
            .collect();
        let direct: Vec<f64> = (self.surfaces.direct_radiosity.iter())
            .map(|b| of(*b))
            .collect();
        scarce(self.world, self.cut, links, |i, j| {
            f64::from(self.first.left_to_rays(i, j)) * direct[j] + further[j]
        })
    }

    /// Relaxes the light of each group on the links so far, starting from the pass before.
    fn pass(
        &self,
        links: &Links,
        rays: u32,
        of_groups: &mut [Vec<DVec3>],
        report: &mut SolveReport,
        monitor: &dyn Monitor,
    ) -> RelaxReport {
        let mut relax = self.relax;
        if rays < self.most {
            relax.tolerance = relax.tolerance.max(EARLY);
        }
        let mut all: Option<RelaxReport> = None;
        for (g, indirect) in of_groups.iter_mut().enumerate() {
            let source = self.source(links, rays, g);
            let system = System {
                links,
                reflectance: &self.surfaces.reflectance,
                area: &self.surfaces.area,
                source: &source,
            };
            let mut one = system.relax(indirect, &relax, monitor);
            one.converged = one.residual <= self.relax.tolerance;
            report
                .history
                .extend(one.steps.iter().map(|&step| SolveStep { rays, step }));
            all = Some(match all {
                None => one,
                Some(all) => all.and(&one),
            });
        }
        all.unwrap_or_default()
    }

    /// Irradiance of each patch by a group's light that was reflected once, and by its sky and
    /// gathered emission.
    fn source(&self, links: &Links, rays: u32, group: usize) -> Vec<DVec3> {
        let direct = &self
            .by_group
            .get(group)
            .unwrap_or(self.surfaces)
            .direct_radiosity;
        (0..links.patches)
            .into_par_iter()
            .map(|i| {
                // Earlier passes are only a starting point.
                let reflected = match rays == self.most {
                    true => self.first.gather(links, i, group, direct),
                    false => links.gather(i, direct),
                };
                reflected + links.source(i, group).as_dvec3()
            })
            .collect()
    }
}

/// A scene divided into patches and elements.
pub(crate) struct Divided {
    pub cut: Subdivision,
    /// Elements inside something, and pairs of neighbours with a wall between them.
    buried: u64,
    walled: u64,
}

/// A scene's patches, before rays tell which of them are hidden or divided.
pub fn cut_surfaces(world: &World, options: &patch_subdivision::Options) -> Subdivision {
    let between = |a: Vec3, b: Vec3, counts: &dyn Fn(u32) -> bool| world.any_between(a, b, counts);
    let two_sided = |t| world.two_sided(t as u32);
    Subdivision::build_among(world.soup, two_sided, &between, options)
}

/// Divides a scene. The same scene and options give the same patches.
pub(crate) fn divide(world: &World, options: &SolveOptions) -> Divided {
    let mut cut = cut_surfaces(world, &options.cut);
    let Survey {
        buried,
        first,
        under,
        moved,
        partly,
    } = survey(world, &cut);
    cut.move_points(&moved);
    cut.keep_shares(&partly);
    let crowded = match options.crowded {
        true => find_crowded(&cut, &buried, &first, &under),
        false => vec![false; cut.patches().len()],
    };
    cut.hide(&buried);
    let walled = stand_apart(world, &mut cut, &crowded);
    Divided {
        cut,
        buried: buried.iter().filter(|b| **b).count() as u64,
        walled,
    }
}

/// Counts the patches and elements of a solve, which casts a few rays from each element. Where
/// things are close to each other, there are up to ten times as many patches as asked for.
pub fn count_patches(world: &World, options: &SolveOptions) -> Stats {
    divide(world, options).cut.stats()
}

/// Patches whose elements' direct light spans more than half of the brightest. Below that, the
/// error of a single element is less than the noise of a gathering ray. Patches below 1 % of the
/// mean are left out, because their error is invisible.
fn find_rough(cut: &Subdivision, direct: &[Vec3]) -> Vec<bool> {
    let (mut sum, mut area) = (0f64, 0f64);
    for (e, x) in cut.elements().iter().zip(direct) {
        sum += luminance(*x) as f64 * e.area as f64;
        area += e.area as f64;
    }
    let floor = (0.01 * sum / area.max(1e-300)) as f32;
    (0..cut.patches().len() as u32)
        .into_par_iter()
        .map(|p| {
            let (mut low, mut high) = (f32::INFINITY, 0f32);
            for k in cut.elements_of(PatchId(p)) {
                let l = luminance(direct[k]);
                low = low.min(l);
                high = high.max(l);
            }
            high > floor && high - low > 0.5 * high
        })
        .collect()
}

/// What a few rays from each element find.
struct Survey {
    /// Whether it is inside something: in a body, or all of its rays hit black backfaces.
    buried: Vec<bool>,
    /// Distance of what its ray shows first, in edges of a patch.
    first: Vec<f32>,
    /// Whether something is above one of its points within that distance.
    under: Vec<bool>,
    /// Points that are seen from further away than that, of elements whose own point may not be.
    moved: Vec<(ElementId, PointOn)>,
    /// Elements of which something covers a part, and the share that is like their point: covered
    /// or not.
    partly: Vec<(ElementId, f32)>,
}

/// Finds the elements that are inside something, and those with something close to them.
///
/// An object on a floor hides the part of a patch under it. Rays from other surfaces never hit that
/// part, so the patch's light must be the mean over the rest. If the dark part were included, every
/// foot of a pillar would remove light from the room. It removed 3 % in the hall of the demo level
/// with 35,000 patches, and 6 % with 13,000.
fn survey(world: &World, cut: &Subdivision) -> Survey {
    // A visible point near backfaces sees them in at most half of its hemisphere. It is
    // misclassified with a probability of 1/256, and 15 other elements then represent it. The first
    // ray suffices for nearly every visible point.
    const RAYS: u32 = 8;
    // The gathering rays that read an element come from beyond a patch's edge length, so its point
    // is one that a ray leaves that far: drawn like this, points are distributed by how much of the
    // view of them is from afar.
    const OTHERS: u32 = 8;
    // Points that tell how large a part of an element something covers.
    const POINTS: u32 = 8;
    // A single back may be seen from a room; inside something they are a large part.
    const FEW_BACKS: u32 = 1;
    let point = |p: PatchId, on: PointOn| -> Option<SurfacePoint> {
        let back = cut.patches()[p.0 as usize].back;
        let [u, v] = on.uv;
        let point = world.surface_point(on.triangle, u, v, back, false);
        (!world.inside_a_body(&point)).then_some(point)
    };
    let cast = |k: usize, point: &SurfacePoint, ray: u32| -> Side {
        let [a, b] = sample_2d(ray, 2, hash_u32(k as u32 ^ 0x7f4a_7c15));
        world.side_met(point.origin, cosine_hemisphere(point.normal, a, b))
    };
    // The distance of the first surface that shows itself. What may be the side of a wall or of
    // something solid counts if hardly any backs are beside it.
    let first = |k: usize, point: SurfacePoint| -> Option<f32> {
        let (mut backs, mut either) = (0, None);
        for ray in 0..RAYS {
            match cast(k, &point, ray) {
                Side::Shown(t) => return Some(t),
                Side::Back => backs += 1,
                Side::Either(t) => either = either.or(Some(t)),
            }
        }
        either.filter(|_| backs <= FEW_BACKS)
    };
    // Points of an element with something above.
    let beneath = |p: PatchId, k: usize, own: PointOn, drawn: &mut ElementPoints| {
        let width = element_edge(cut, cut.elements()[k].triangle);
        let own = point(p, own).filter(|own| world.anything_above(own, width));
        let further = own.map(|_| (0..POINTS).map(|i| drawn.draw(OTHERS + i)));
        let further = further.into_iter().flatten();
        let all: Vec<SurfacePoint> = (own.into_iter())
            .chain(further.filter_map(|on| point(p, on)))
            .collect();
        all
    };
    // What lies on an element covers the part below, which nobody sees from afar. Points are moved
    // out of there, so the element counts with the rest of its area. Parts in a body are another
    // matter: points stay there, and then the element does not count at all.
    let partly = |points: &[SurfacePoint], width: f32| -> Option<f32> {
        let is_covered = world.covered(points.first()?, width);
        let alike = (points.iter())
            .filter(|other| world.covered(other, width) == is_covered)
            .count();
        (alike < points.len()).then_some(alike as f32 / points.len() as f32)
    };
    let look = |p: PatchId, k: usize| -> Seen {
        let e = &cut.elements()[k];
        if world.emission(e.triangle) != Emission::None {
            // The element's own light is counted where it starts.
            return Seen {
                first: f32::INFINITY,
                ..Seen::default()
            };
        }
        let own = PointOn {
            triangle: e.triangle,
            uv: [e.u, e.v],
        };
        let at = point(p, own);
        let Some(t) = at.and_then(|point| first(k, point)) else {
            return Seen {
                buried: true,
                ..Seen::default()
            };
        };
        let edge = cut.patch_edge(e.triangle);
        let id = ElementId(k as u32);
        let mut drawn = cut.points_of(id, world.soup);
        let from_afar = |(ray, on): &(u32, PointOn)| {
            point(p, *on).is_some_and(|point| match cast(k, &point, *ray) {
                Side::Shown(t) | Side::Either(t) => t >= edge,
                Side::Back => false,
            })
        };
        let moved = match t < edge {
            true => (0..OTHERS)
                .map(|i| (RAYS + i, drawn.draw(i)))
                .find(from_afar),
            false => None,
        };
        let moved = moved.map(|(_, on)| on);
        let points = beneath(p, k, moved.unwrap_or(own), &mut drawn);
        let share = partly(&points, element_edge(cut, e.triangle));
        let mut all = points.iter().chain(&at);
        Seen {
            buried: false,
            first: t / edge,
            under: all.any(|point| world.covered(point, edge)),
            moved: moved.map(|on| (id, on)),
            partly: share.map(|share| (id, share)),
        }
    };
    let seen: Vec<Seen> = (0..cut.patches().len() as u32)
        .into_par_iter()
        .flat_map_iter(|p| {
            cut.elements_of(PatchId(p))
                .map(move |k| look(PatchId(p), k))
        })
        .collect();
    Survey {
        buried: seen.iter().map(|s| s.buried).collect(),
        first: seen.iter().map(|s| s.first).collect(),
        under: seen.iter().map(|s| s.under).collect(),
        moved: seen.iter().filter_map(|s| s.moved).collect(),
        partly: seen.iter().filter_map(|s| s.partly).collect(),
    }
}

/// [`Survey`] of one element.
#[derive(Clone, Copy, Default)]
struct Seen {
    buried: bool,
    first: f32,
    under: bool,
    moved: Option<(ElementId, PointOn)>,
    partly: Option<(ElementId, f32)>,
}

/// Share of a patch's visible elements with something close to them from which the patch counts as
/// crowded. In the corner of a room, the share is a quarter to a third.
const CROWDED: f32 = 0.2;

/// Mean distance, in patch edges, of what a patch's elements see first, below which it is left
/// whole. Between two plates it is twice their distance, and light gets into the gap about as far:
/// here a quarter of an element.
const NARROW: f32 = 1.0 / 16.0;

/// Finds patches with something close to them. Light may differ by a factor of 100 between their
/// sides (a wall behind a cupboard, the ground under a car), so each of their elements gets its own
/// light.
///
/// A patch that is half in a gap carries the light outside into it, and the next one carries it on.
/// At `preview`, this made lumels in gaps brighter by 50 % or more in the garage
/// (lab/speed_error.md) and by 75 % in godot_gi_demo. Patches of a quarter of the width everywhere
/// have the same effect, with fourteen times as many elements.
///
/// Something above a single element is enough, because rays in all directions find it by luck: a
/// patch of 2.3 m that passed under a wall, which ended 0.4 m above the floor, carried so much light
/// out of a white room that it became 8 % darker, or not, by the number of patches.
///
/// Patches in gaps so narrow that light ends within an element are left whole. Two plates a tenth of
/// a millimetre apart took 80 times as long when all of their patches were split.
fn find_crowded(cut: &Subdivision, buried: &[bool], first: &[f32], under: &[bool]) -> Vec<bool> {
    let is_crowded = |p: usize| {
        let seen = || (cut.elements_of(PatchId(p as u32))).filter(|&k| !buried[k]);
        let count = seen().count() as f32;
        let near = seen().filter(|&k| first[k] < 1.0).count() as f32;
        let distances: f32 = seen().map(|k| first[k].min(1.0)).sum();
        let covered = seen().any(|k| under[k]);
        (covered || near > CROWDED * count) && distances > NARROW * count
    };
    (0..cut.patches().len()).map(is_crowded).collect()
}

/// Splits patches where walls stand on them, and splits crowded patches into their elements.
/// Returns the number of pairs of elements that a wall separates.
fn stand_apart(world: &World, cut: &mut Subdivision, crowded: &[bool]) -> u64 {
    let pairs = cut.neighbours();
    let point = |k: u32, back: bool| {
        let e = cut.elements()[k as usize];
        world.surface_point(e.triangle, e.u, e.v, back, false)
    };
    let back: Vec<bool> = (cut.patches().iter())
        .flat_map(|p| std::iter::repeat_n(p.back, p.elements as usize))
        .collect();
    let blocked: Vec<bool> = pairs
        .par_iter()
        .with_min_len(1024)
        .map(|&[a, b]| {
            let side = back[a as usize];
            let lift = WALL * element_edge(cut, cut.elements()[a as usize].triangle);
            world.wall_between(&point(a, side), &point(b, side), lift)
        })
        .collect();
    cut.separate(&pairs, &blocked, crowded);
    blocked.iter().filter(|b| **b).count() as u64
}

/// Direct light on elements.
struct ElementLight {
    direct: Vec<Vec3>,
    /// By group, element by element, if groups are separate; otherwise empty.
    groups: Vec<Vec3>,
    /// Number of shadow rays.
    rays: u64,
    finished: bool,
}

impl ElementLight {
    /// What patches have of each group's light, if groups are separate.
    fn surfaces_by_group(
        &self,
        cut: &Subdivision,
        reflectance: &[Vec3],
        groups: usize,
    ) -> Vec<PatchSurfaces> {
        (0..if groups > 1 { groups } else { 0 })
            .map(|g| {
                let own: Vec<Vec3> =
                    (self.groups.iter().skip(g).step_by(groups).copied()).collect();
                PatchSurfaces::average(cut, reflectance, &own)
            })
            .collect()
    }
}

/// Direct irradiance of every element.
fn direct_light(
    world: &World,
    emitters: &Emitters,
    cut: &Subdivision,
    options: &DirectOptions,
    monitor: &dyn Monitor,
) -> ElementLight {
    const BLOCK: usize = 64;
    let light = DirectLight::new(world, emitters);
    let n = cut.patches().len();
    let groups = match world.group_count() {
        1 => 0,
        more => more,
    };
    let elements = cut.elements().len();
    let mut out = ElementLight {
        direct: vec![Vec3::ZERO; elements],
        groups: vec![Vec3::ZERO; elements * groups],
        rays: 0,
        finished: true,
    };
    if light.is_dark() {
        return out;
    }
    let rays = AtomicU64::new(0);
    let done = AtomicU64::new(0);
    // Blocks of patches own consecutive elements.
    let mut blocks = Vec::with_capacity(n / BLOCK + 1);
    let (mut rest, mut rest_groups) = (&mut out.direct[..], &mut out.groups[..]);
    for first in (0..n).step_by(BLOCK) {
        let last = (first + BLOCK).min(n);
        let count: usize = (first..last)
            .map(|p| cut.patches()[p].elements as usize)
            .sum();
        let (head, tail) = rest.split_at_mut(count);
        let (head_groups, tail_groups) = rest_groups.split_at_mut(count * groups);
        blocks.push((first..last, head, head_groups));
        (rest, rest_groups) = (tail, tail_groups);
    }
    blocks.into_par_iter().for_each(|(patches, out, by_group)| {
        if monitor.cancelled() {
            return;
        }
        let mut cast = 0u64;
        let count = patches.len() as u64;
        let mut slot = 0;
        let known = Known::default();
        let mut parts = DirectParts {
            groups: vec![Vec3::ZERO; groups],
            ..DirectParts::default()
        };
        for p in patches {
            let patch = &cut.patches()[p];
            if patch.hidden {
                slot += patch.elements as usize;
                continue;
            }
            let back = patch.back;
            let cells = (0..16u32).filter(|bit| patch.mask >> bit & 1 == 1);
            for (k, cell) in cut.elements_of(PatchId(p as u32)).zip(cells) {
                let e = cut.elements()[k];
                let point = world.inset_point(e.triangle, e.u, e.v, back, false);
                // The same for an element in whatever patch it is.
                let seed = hash_u32((patch.name << 5 | cell) ^ 0x2545_f491);
                let got = light.irradiance_parts(|_| point, 0.0, seed, options, &known, &mut parts);
                cast += got.rays as u64;
                out[slot] = got.irradiance;
                by_group[slot * groups..(slot + 1) * groups].copy_from_slice(&parts.groups);
                parts.groups.fill(Vec3::ZERO);
                slot += 1;
            }
        }
        rays.fetch_add(cast, Ordering::Relaxed);
        let now = done.fetch_add(count, Ordering::Relaxed) + count;
        monitor.progress(Phase::Direct, now, n as u64);
    });
    out.rays = rays.into_inner();
    out.finished = done.into_inner() == n as u64;
    out
}

/// Mean reflectance over each element, with textures averaged over its area. Sampled at one point,
/// a tiled floor would be as bright as the tile or the joint at that point.
fn element_reflectance(world: &World, cut: &Subdivision) -> Vec<Vec3> {
    let pyramids = Pyramids::build(world.scene, world.soup);
    (cut.elements().par_iter())
        .with_min_len(256)
        .map(|e| {
            let own = pyramids.reflectance(world.scene, world.soup, e.triangle, e.u, e.v, e.area);
            world.bounced(e.triangle, own)
        })
        .collect()
}

/// Means over patches.
pub(crate) struct PatchSurfaces {
    /// m².
    pub area: Vec<f64>,
    pub reflectance: Vec<DVec3>,
    /// Direct irradiance.
    pub direct: Vec<DVec3>,
    /// Mean of ρE over elements. Light and texture may be correlated, so the product of the means
    /// would be wrong.
    pub direct_radiosity: Vec<DVec3>,
}

impl PatchSurfaces {
    /// Averages `reflectance` and `direct`, given by element.
    pub(crate) fn average(cut: &Subdivision, reflectance: &[Vec3], direct: &[Vec3]) -> Self {
        let rows: Vec<[DVec3; 3]> = (0..cut.patches().len())
            .into_par_iter()
            .map(|p| {
                let (mut rho, mut e, mut b, mut area) =
                    (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 0f64);
                for k in cut.elements_of(PatchId(p as u32)) {
                    let x = cut.elements()[k];
                    let a = x.area as f64;
                    let r = reflectance[k].as_dvec3();
                    let d = direct[k].as_dvec3();
                    rho += r * a;
                    e += d * a;
                    b += r * d * a;
                    area += a;
                }
                let s = 1.0 / area.max(1e-300);
                [rho * s, e * s, b * s]
            })
            .collect();
        PatchSurfaces {
            area: cut.patches().iter().map(|p| p.area as f64).collect(),
            reflectance: rows.iter().map(|r| r[0]).collect(),
            direct: rows.iter().map(|r| r[1]).collect(),
            direct_radiosity: rows.iter().map(|r| r[2]).collect(),
        }
    }
}

#[cfg(test)]
mod tests;
