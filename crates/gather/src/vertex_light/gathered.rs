//! Light gathered at points for which the lightmap is not sufficient.

use radiosity::{Cancelled, Monitor, Phase, World};
use rayon::prelude::*;

use super::cluster::Clusters;
use super::sheet::Sheet;
use super::smooth::Mesh;
use crate::between::Between;
use crate::blocks::in_blocks;
use crate::estimate::mean_and_spread;
use crate::footprint::Footprint;
use crate::gatherer::Gatherer;
use crate::options::GatherOptions;
use crate::parts::LIFT;
use crate::points::spread;
use crate::received::Received;
use crate::vertex_footprint::{Spoke, VertexFootprint};

/// A point to gather at.
pub(super) struct Job {
    pub sheet: u32,
    pub point: u32,
    pub spokes: Vec<Spoke>,
    pub seed: u32,
}

impl Job {
    fn footprint<'b, 'w, 'a>(&'b self, world: &'w World<'a>) -> VertexFootprint<'b, 'w, 'a> {
        VertexFootprint {
            world,
            around: &self.spokes,
            seed: self.seed,
        }
    }
}

/// Jobs that share indirect light.
struct Group {
    /// Indices of jobs, ascending.
    jobs: Vec<u32>,
    /// Whether something is so near that it may cut their triangles.
    beside: bool,
}

/// The light of each job. `jobs` are in the order of sheets and points.
pub(super) fn gather(
    jobs: &[Job],
    sheets: &[Sheet],
    gatherer: &Gatherer,
    monitor: &dyn Monitor,
) -> Result<Vec<Received>, Cancelled> {
    let world = gatherer.world();
    let clusters: Vec<Clusters> = (sheets.par_iter().enumerate())
        .map(|(s, sheet)| {
            let s = s as u32;
            let start = jobs.partition_point(|j| j.sheet < s);
            match jobs.get(start).is_some_and(|j| j.sheet == s) {
                true => Clusters::find(sheet, world),
                false => Clusters::default(),
            }
        })
        .collect();
    let groups = groups(jobs, &clusters, world);
    let mut group_of = vec![0u32; jobs.len()];
    for (g, group) in groups.iter().enumerate() {
        (group.jobs.iter()).for_each(|&k| group_of[k as usize] = g as u32);
    }
    let mesh = mesh_of(jobs, sheets, &clusters, &groups, &group_of, world);
    let shared = shared_light(jobs, &groups, &mesh, gatherer, monitor)?;
    let members: Vec<u32> = (0..jobs.len() as u32)
        .filter(|&k| groups[group_of[k as usize] as usize].jobs.len() > 1)
        .collect();
    let own = in_blocks(members.len(), Phase::Vertices, monitor, |m| {
        let job = &jobs[members[m] as usize];
        let g = group_of[members[m] as usize] as usize;
        let (group, light) = (&groups[g], &shared[g]);
        let footprint = job.footprint(world);
        // If partly inside something, each job must find out by itself.
        let whole = light.open == 1.0 || light.open == 0.0;
        let spot = || clusters[job.sheet as usize].spots[job.point as usize];
        let cut = || spot().is_none_or(|s| is_cut(job, &s, world));
        if !whole || (group.beside && cut()) {
            return gatherer.gather(&footprint, job.seed);
        }
        let indirect = Between {
            indirect: light.indirect,
            first_half: light.first_half,
            variance: light.indirect_variance,
            planes: Vec::new(),
        };
        gatherer.gather_direct(&footprint, job.seed, &indirect)
    })?;
    Ok(each(&groups, &group_of, &shared, own))
}

/// The light of each job: its own where several share, of which `own` holds only these.
fn each(
    groups: &[Group],
    group_of: &[u32],
    shared: &[Received],
    own: Vec<Received>,
) -> Vec<Received> {
    let mut own = own.into_iter();
    let of_job = |(k, &g): (usize, &u32)| {
        let (group, shared) = (&groups[g as usize].jobs, &shared[g as usize]);
        if group.len() == 1 {
            return shared.clone();
        }
        let mut own = own.next().unwrap_or_default();
        // Shared rays are counted once, with the first job.
        if group[0] as usize == k {
            own.rays += shared.rays;
        }
        own
    };
    group_of.iter().enumerate().map(of_job).collect()
}

/// The light of each group, smoothed.
fn shared_light(
    jobs: &[Job],
    groups: &[Group],
    mesh: &Mesh,
    gatherer: &Gatherer,
    monitor: &dyn Monitor,
) -> Result<Vec<Received>, Cancelled> {
    let mut shared: Vec<Received> = Vec::new();
    shared.resize_with(groups.len(), Received::default);
    let smoothed = mesh.has_others();
    for which in [false, true] {
        // Points that will be smoothed need fewer rays.
        let gatherer = match which {
            false => gatherer.clone(),
            true => gatherer.with(half(&gatherer.options)),
        };
        let part: Vec<usize> = (0..groups.len())
            .filter(|&g| smoothed[g] == which)
            .collect();
        let of_part = gather_groups(&part, jobs, groups, &gatherer, monitor)?;
        for (g, received) in part.into_iter().zip(of_part) {
            shared[g] = received;
        }
    }
    mesh.smooth(&mut shared);
    Ok(shared)
}

/// Half of the rays, but at least two per point.
fn half(options: &GatherOptions) -> GatherOptions {
    let rays = (options.rays / 2).max(1);
    GatherOptions {
        rays,
        points: options.points.min((rays / 2).max(1)),
        ..*options
    }
}

/// Light of the groups of `part`, in order.
fn gather_groups(
    part: &[usize],
    jobs: &[Job],
    groups: &[Group],
    gatherer: &Gatherer,
    monitor: &dyn Monitor,
) -> Result<Vec<Received>, Cancelled> {
    let world = gatherer.world();
    let group = |k: usize| &groups[part[k]];
    let first = |k: usize| &jobs[group(k).jobs[0] as usize];
    in_blocks(part.len(), Phase::Vertices, monitor, |k| {
        let (group, first) = (&group(k).jobs, first(k));
        if group.len() == 1 {
            return gatherer.gather(&first.footprint(world), first.seed);
        }
        let spokes = all_spokes(group.iter().map(|k| &jobs[*k as usize]), world);
        let footprint = VertexFootprint {
            world,
            around: &spokes,
            seed: first.seed,
        };
        gatherer.gather_shared(&footprint, first.seed)
    })
}

/// Groups and their adjacency by edges of triangles.
fn mesh_of(
    jobs: &[Job],
    sheets: &[Sheet],
    clusters: &[Clusters],
    groups: &[Group],
    group_of: &[u32],
    world: &World,
) -> Mesh {
    let spots = (groups.par_iter())
        .map(|group| {
            let job = &jobs[group.jobs[0] as usize];
            clusters[job.sheet as usize].spots[job.point as usize]
        })
        .collect();
    let edges = |s: usize| {
        let sheet = &sheets[s];
        let start = jobs.partition_point(|j| (j.sheet as usize) < s);
        let end = jobs.partition_point(|j| (j.sheet as usize) <= s);
        let mut of = vec![u32::MAX; if start < end { sheet.points } else { 0 }];
        for (job, g) in jobs[start..end].iter().zip(&group_of[start..end]) {
            of[job.point as usize] = *g;
        }
        let group = move |p: usize| of.get(p).copied().unwrap_or(u32::MAX);
        (sheet.tris.iter()).flat_map(move |tri| {
            let g = sheet.points_of(tri).map(&group);
            [(0, 1), (1, 2), (2, 0)].map(|(a, b)| [g[a].min(g[b]), g[a].max(g[b])])
        })
    };
    let pairs = (0..sheets.len()).into_par_iter();
    let pairs = (pairs.flat_map_iter(edges))
        .filter(|[a, b]| a != b && *b != u32::MAX)
        .collect();
    Mesh::new(spots, pairs, world)
}

/// The jobs of each cluster, ordered by the first.
fn groups(jobs: &[Job], clusters: &[Clusters], world: &World) -> Vec<Group> {
    let mut slots: Vec<Vec<u32>> = (clusters.iter())
        .map(|c| vec![u32::MAX; c.of.len()])
        .collect();
    let mut lists: Vec<Vec<u32>> = Vec::new();
    for (k, job) in jobs.iter().enumerate() {
        let cluster = clusters[job.sheet as usize].of[job.point as usize];
        let slot = &mut slots[job.sheet as usize][cluster as usize];
        if *slot == u32::MAX {
            *slot = lists.len() as u32;
            lists.push(Vec::new());
        }
        lists[*slot as usize].push(k as u32);
    }
    (lists.into_par_iter())
        .map(|list| {
            let clusters = &clusters[jobs[list[0] as usize].sheet as usize];
            let first = clusters.of[jobs[list[0] as usize].point as usize];
            let beside = || {
                clusters.spots[first as usize].is_some_and(|spot| spot.is_beside_something(world))
            };
            Group {
                beside: list.len() > 1 && beside(),
                jobs: list,
            }
        })
        .collect()
}

/// The triangles around all of some points.
fn all_spokes<'j>(jobs: impl Iterator<Item = &'j Job>, world: &World) -> Vec<Spoke> {
    let mut running = 0.0;
    jobs.flat_map(|j| &j.spokes)
        .map(|spoke| {
            running += world.soup.areas[spoke.triangle as usize];
            Spoke { running, ..*spoke }
        })
        .collect()
}

/// Whether something stands on a triangle around a point, tested from the point to the middle of
/// the opposite edge.
fn is_cut(job: &Job, spot: &super::cluster::Spot, world: &World) -> bool {
    job.spokes.iter().any(|spoke| {
        let mut w = [0.5; 3];
        w[usize::from(spoke.corner)] = 0.0;
        let far = world.inset_point(spoke.triangle, w[1], w[2], spoke.back, true);
        world.wall_between(&spot.at, &far, LIFT * spot.size)
    })
}

impl Gatherer<'_, '_> {
    /// The indirect light of [`gather`](Self::gather) without planes; the whole footprint counts
    /// even if part of it is inside something.
    fn gather_shared(&self, footprint: &impl Footprint, seed: u32) -> Received {
        if self.world().is_dark() {
            return Received {
                open: 1.0,
                ..Received::default()
            };
        }
        let points = spread(footprint, self.options.points.max(1) as usize);
        let sampled = self.sample(&points, self.sampling(footprint, seed), |_, _, _| {});
        let open = sampled.sums.iter().filter(|s| !s.inside()).count();
        let estimate = mean_and_spread(&sampled.sums, &vec![true; points.len()]);
        Received {
            indirect: estimate.mean,
            first_half: estimate.first_half,
            indirect_variance: estimate.variance,
            open: open as f32 / points.len() as f32,
            rays: sampled.rays,
            ..Received::default()
        }
    }
}
