//! Chooses where charts are cut: under thin walls with different light on their two sides.
//!
//! A lumel under a wall thinner than a lumel is read by lookups on both sides of it. Whatever it
//! holds is wrong on one of them: a bright line at the foot of a partition, a dark one, or light in
//! a dark room. The solve already knows the walls between neighbouring elements, and the light on
//! either side. Where walls are thicker, lumels inside them separate the sides.

use std::collections::BTreeMap;

use atlas::{LayoutReport, MeshReport, UvOrigin};
use glam::{DVec3, Vec3};
use mesh_ingest::{Cut, Loaded, Mesh, Scene, TriangleSource};
use patch_subdivision::PatchId;
use radiosity::{Incoming, Solution, SurfacePoint, World, cosine_hemisphere, luminance, sample_4d};
use rayon::prelude::*;

use crate::named::{node_of, some_of};

/// Relative difference of the light on two sides from which a piece of a wall counts.
const DIFFERENT: f32 = 0.3;

/// Mean relative difference along a wall from which its foot is cut: the brighter side has 1.7
/// times the light. A lookup beside the wall takes up to half of its light from the shared lumel,
/// so the line is a third brighter than the floor.
const NOTICED: f32 = 0.4;

/// Larger meshes are not cut. Their charts take long and would be made twice, and the walls of
/// scans and of finely carved architecture are no straight lines.
const MOST_TRIANGLES: usize = 20_000;

/// Nor are larger ones that several nodes share, as each node gets a copy.
const MOST_COPIED: usize = 1_000;

/// Light below this fraction of the scene's mean is not told from black.
const BLACK: f32 = 0.02;

/// Walls at least this thick, in lumels, have a lumel of their own between the two sides.
const THIN: f32 = 1.5;

/// A wall's normal is within 45° of the surface it stands on. What lies flatter is a cover.
const UPRIGHT: f32 = 0.7;

/// Walls are the same line if they are parallel within this sine …
const PARALLEL: f32 = 0.03;

/// … and this many lumels apart at most. The two sides of a wall are two lines, unless they are
/// that close.
const BESIDE: f32 = 0.05;

/// Shorter lines, in lumels, are not worth a border of charts where the light differs just
/// [noticeably](NOTICED).
const SHORT: f32 = 8.0;

/// Nor is a border nearer than this, in lumels, to the end of the surface: the strip beyond it is
/// where a floor ends outside of a room's walls.
const STRIP: f32 = 1.5;

/// Rays from each side of each pair of elements, which tell whether people can be there.
const RAYS: u32 = 4;

/// A ray that meets a front beyond this many lumels, or nothing, crosses a place where people can
/// be; the inside of a sofa and the gap behind a cupboard have none.
const ROOM: f32 = 3.0;

/// The fraction of such rays from which a side counts …
const SEEN: f32 = 0.25;

/// … if this fraction meets the front of something. The wall itself fills half of the view from
/// beside it, but below a terrain there are backs and the sky.
const INSIDE: f32 = 0.25;

/// Most lines of a surface, the most visible first: each can double the number of its charts.
const MOST_LINES: usize = 16;

/// Most lines that are looked for on a surface.
const MOST_FOUND: usize = 256;

/// A straight line on a surface along which a wall stands.
struct Line {
    /// Unit normal of the wall, in the surface's plane, and the wall's distance from the origin
    /// along it, metres, in recentred world space.
    normal: Vec3,
    offset: f32,
    /// Length found, metres, and the same weighted by the difference of the light.
    length: f32,
    weight: f32,
    /// What rays from either side found.
    sides: [Found; 2],
    /// A triangle of the surface.
    triangle: u32,
}

/// What rays from one side of a wall found.
#[derive(Clone, Copy, Default)]
struct Found {
    rays: u32,
    /// Those that cross a place where people can be.
    open: u32,
    /// Those that meet the front of something.
    fronts: u32,
}

impl Found {
    fn add(&mut self, other: &Found) {
        self.rays += other.rays;
        self.open += other.open;
        self.fronts += other.fronts;
    }

    /// Whether people can be there.
    fn is_seen(&self) -> bool {
        let share = |n: u32| n as f32 / self.rays.max(1) as f32;
        share(self.open) >= SEEN && share(self.fronts) >= INSIDE
    }
}

/// The cuts, surface by surface.
pub(crate) fn wanted(
    loaded: &Loaded,
    world: &World,
    solution: &Solution,
    report: &LayoutReport,
) -> Vec<Cut> {
    let cut = &solution.cut;
    if !cut.has_walls() {
        return Vec::new();
    }
    let lumels = lumel_sizes(loaded, report);
    let lumel_of = |triangle: u32| lumels[world.soup.sources[triangle as usize].instance as usize];
    let mut lines: BTreeMap<usize, Vec<Line>> = BTreeMap::new();
    for wall in walls(world, solution, &lumel_of) {
        if let Some(region) = cut.region_of(wall.triangle) {
            let length = 0.25 * cut.patch_edge(wall.triangle);
            enter(lines.entry(region).or_default(), &wall, length);
        }
    }
    let points = visible_points(solution, world, &lines);
    let uses = uses(&loaded.scene);
    let copies = copies(world, &lumels);
    let mut cuts = Vec::new();
    for (region, mut of_region) in lines {
        of_region.retain(|line| {
            lumel_of(line.triangle).is_some_and(|lumel| line.is_worth_it(lumel, &points[&region]))
        });
        // Stable, so of equal lines the first found stays first.
        of_region.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        of_region.truncate(MOST_LINES);
        for line in &of_region {
            // What coincides is cut alike, or it would coincide no more.
            let own = world.soup.sources[line.triangle as usize];
            let copies = copies.get(&line.triangle).into_iter().flatten();
            let sources = std::iter::once(own).chain(copies.copied());
            cuts.extend(sources.map(|source| in_mesh(&loaded.scene, &uses, line, source)));
        }
    }
    cuts
}

/// By triangle, those that coincide with it, of meshes that can be cut.
fn copies(world: &World, lumels: &[Option<f32>]) -> BTreeMap<u32, Vec<TriangleSource>> {
    let mut copies: BTreeMap<u32, Vec<TriangleSource>> = BTreeMap::new();
    for d in &world.soup.duplicates {
        if lumels[d.source.instance as usize].is_some() {
            copies.entry(d.kept).or_default().push(d.source);
        }
    }
    copies
}

/// Thin walls with different light on their two sides, pair by pair of neighbouring elements.
fn walls(
    world: &World,
    solution: &Solution,
    lumel_of: &(dyn Fn(u32) -> Option<f32> + Sync),
) -> Vec<Wall> {
    let cut = &solution.cut;
    let mut light = vec![0.0f32; cut.elements().len()];
    let mut back = vec![false; light.len()];
    for (p, patch) in cut.patches().iter().enumerate() {
        for e in cut.elements_of(PatchId(p as u32)) {
            light[e] = luminance(solution.direct[e] + solution.indirect[p]);
            back[e] = patch.back;
        }
    }
    let black = BLACK * luminance(solution.mean_irradiance().as_vec3());
    (cut.across().par_iter().with_min_len(1024))
        .filter_map(|&[a, b]| {
            let (la, lb) = (light[a as usize], light[b as usize]);
            let differ = (la - lb).abs() / la.max(lb).max(black);
            if differ <= DIFFERENT {
                return None;
            }
            let lumel = lumel_of(cut.elements()[a as usize].triangle)?;
            let wall = wall(world, solution, [a, b], back[a as usize], lumel)?;
            Some(Wall { differ, ..wall })
        })
        .collect()
}

/// Adds a piece of a wall to the lines of its two faces.
fn enter(lines: &mut Vec<Line>, wall: &Wall, length: f32) {
    for at in wall.faces() {
        let same = |l: &Line| {
            l.normal.dot(wall.normal).abs() > 1.0 - 0.5 * PARALLEL * PARALLEL
                && (l.normal.dot(at) - l.offset).abs() < BESIDE * wall.lumel
        };
        let k = match lines.iter().position(same) {
            Some(k) => k,
            None if lines.len() == MOST_FOUND => continue,
            None => {
                lines.push(Line {
                    normal: wall.normal,
                    offset: wall.normal.dot(at),
                    length: 0.0,
                    weight: 0.0,
                    sides: [Found::default(); 2],
                    triangle: wall.triangle,
                });
                lines.len() - 1
            }
        };
        let line = &mut lines[k];
        line.length += length;
        line.weight += length * wall.differ;
        line.sides[0].add(&wall.sides[0]);
        line.sides[1].add(&wall.sides[1]);
    }
}

impl Line {
    /// Whether charts should end here, on a surface with these points.
    fn is_worth_it(&self, lumel: f32, points: &[Vec3]) -> bool {
        let far = |side: f32| {
            let beyond = points
                .iter()
                .map(|p| side * (self.normal.dot(*p) - self.offset));
            beyond.fold(0.0, f32::max)
        };
        // Where the light differs more, shorter lines are noticed.
        let stark = self.weight / (NOTICED * self.length);
        self.length * stark * stark >= SHORT * lumel
            && stark >= 1.0
            && self.sides.iter().all(Found::is_seen)
            && far(1.0).min(far(-1.0)) > STRIP * lumel
    }
}

/// Points of the visible elements of each region that has lines.
fn visible_points(
    solution: &Solution,
    world: &World,
    lines: &BTreeMap<usize, Vec<Line>>,
) -> BTreeMap<usize, Vec<Vec3>> {
    let cut = &solution.cut;
    let mut points: BTreeMap<usize, Vec<Vec3>> =
        lines.keys().map(|&region| (region, Vec::new())).collect();
    for (p, patch) in cut.patches().iter().enumerate() {
        for e in cut.elements_of(PatchId(p as u32)) {
            let element = cut.elements()[e];
            let of_region = (cut.region_of(element.triangle)).and_then(|r| points.get_mut(&r));
            if let Some(of_region) = of_region.filter(|_| !patch.hidden) {
                let [a, b, c] = world.soup.triangles[element.triangle as usize];
                of_region.push(a + (b - a) * element.u + (c - a) * element.v);
            }
        }
    }
    points
}

/// By mesh of the document, its number of instances.
fn uses(scene: &Scene) -> BTreeMap<usize, usize> {
    let mut uses = BTreeMap::new();
    for instance in &scene.instances {
        let mesh = scene.meshes[instance.mesh].gltf_mesh;
        *uses.entry(mesh).or_default() += 1;
    }
    uses
}

/// By instance, the edge of its lumels in metres; `None` for those whose charts cannot be cut. A
/// node that shares its mesh gets a copy of it, unless it is large or the node itself has copies.
fn lumel_sizes(loaded: &Loaded, report: &LayoutReport) -> Vec<Option<f32>> {
    let scene = &loaded.scene;
    let uses = uses(scene);
    let reports: BTreeMap<usize, &MeshReport> =
        report.meshes.iter().map(|m| (m.gltf_mesh, m)).collect();
    (scene.instances.iter())
        .map(|instance| {
            let mesh = scene.meshes[instance.mesh].gltf_mesh;
            let made = reports.get(&mesh)?;
            let primitives = &scene.meshes[instance.mesh].primitives;
            let triangles = primitives.iter().map(|p| p.triangles.len()).sum::<usize>();
            let most = match uses[&mesh] {
                1 => MOST_TRIANGLES,
                _ if instance.copy.is_some() => 0,
                _ => MOST_COPIED,
            };
            let may = mesh != Mesh::NOT_IN_DOCUMENT
                && triangles <= most
                && made.origin != UvOrigin::Kept
                && loaded.document.can_cut(mesh);
            (may && made.density[1] > 0.0).then(|| (1.0 / made.density[1]) as f32)
        })
        .collect()
}

/// A thin wall between two neighbouring elements.
struct Wall {
    /// Unit normal in the plane of the surface.
    normal: Vec3,
    /// Points on its two faces.
    ends: [Vec3; 2],
    /// What rays from either element found, first from the one that the normal points to.
    sides: [Found; 2],
    /// Relative difference of the light.
    differ: f32,
    /// Edge of the surface's lumels, metres.
    lumel: f32,
    /// The first element's triangle.
    triangle: u32,
}

impl Wall {
    /// Points on its faces, or one between them if they are very close.
    fn faces(&self) -> impl Iterator<Item = Vec3> {
        let [a, b] = self.ends;
        let one = self.normal.dot(b - a).abs() < BESIDE * self.lumel;
        let points = if one {
            [Some(0.5 * (a + b)), None]
        } else {
            [Some(a), Some(b)]
        };
        points.into_iter().flatten()
    }
}

/// The wall between two elements, if it is thin.
fn wall(
    world: &World,
    solution: &Solution,
    pair: [u32; 2],
    back: bool,
    lumel: f32,
) -> Option<Wall> {
    let cut = &solution.cut;
    let lift = 0.05 * cut.patch_edge(cut.elements()[pair[0] as usize].triangle);
    let [a, b] = pair.map(|e| {
        let e = cut.elements()[e as usize];
        world.surface_point(e.triangle, e.u, e.v, back, false)
    });
    if !world.wall_between(&a, &b, lift) {
        return None;
    }
    let up = a.geometric;
    let [from, to] = [a, b].map(|p| p.origin + up * (0.5 * lift));
    let hit = world.first_between(from, to)?;
    let other = world.first_between(to, from)?;
    let normal = world.soup.normals[hit.triangle as usize];
    let level = normal - up * normal.dot(up);
    if level.length() < UPRIGHT {
        return None;
    }
    let level = level.normalize();
    // Always the same of the two directions, whichever element comes first.
    let first = level
        .to_array()
        .into_iter()
        .find(|x| x.abs() > 0.1)
        .unwrap_or(1.0);
    let normal = level * first.signum();
    let ends = [from.lerp(to, hit.t), to.lerp(from, other.t)];
    if normal.dot(ends[1] - ends[0]).abs() >= THIN * lumel {
        return None;
    }
    let mut sides = [a, b].map(|p| look(world, &p, pair[0], ROOM * lumel));
    if normal.dot(a.position - b.position) < 0.0 {
        sides.reverse();
    }
    Some(Wall {
        normal,
        ends,
        sides,
        differ: 0.0,
        lumel,
        triangle: cut.elements()[pair[0] as usize].triangle,
    })
}

/// Casts [`RAYS`] from a point.
fn look(world: &World, p: &SurfacePoint, seed: u32, room: f32) -> Found {
    let mut found = Found {
        rays: RAYS,
        ..Found::default()
    };
    for k in 0..RAYS {
        let s = sample_4d(k, 0, seed);
        let toward = cosine_hemisphere(p.normal, s[0], s[1]);
        match world.incoming(p.origin, toward).0 {
            Incoming::Escaped => found.open += 1,
            Incoming::Surface(hit) if !hit.back => {
                found.fronts += 1;
                found.open += u32::from(hit.t > room);
            }
            Incoming::Surface(_) | Incoming::Black => {}
        }
    }
    found
}

/// A line as a cut of the mesh of one of its triangles.
fn in_mesh(
    scene: &Scene,
    uses: &BTreeMap<usize, usize>,
    line: &Line,
    source: TriangleSource,
) -> Cut {
    let instance = &scene.instances[source.instance as usize];
    let mesh = &scene.meshes[instance.mesh];
    let primitive = &mesh.primitives[source.primitive as usize];
    // n · (M p + t − origin) = d, so (Mᵀ n) · p = d − n · (t − origin).
    let to_world = instance.transform;
    let world_normal = line.normal.as_dvec3();
    let normal: DVec3 = to_world.matrix3.transpose() * world_normal;
    let offset = f64::from(line.offset) - world_normal.dot(to_world.translation - scene.origin);
    let length = normal.length().max(f64::MIN_POSITIVE);
    Cut {
        mesh: mesh.gltf_mesh,
        node: (uses[&mesh.gltf_mesh] > 1).then_some(instance.node),
        primitive: primitive.gltf_primitive,
        triangle: primitive.source_triangles[source.triangle as usize],
        normal: (normal / length).as_vec3().to_array(),
        offset: (offset / length) as f32,
    }
}

/// Names the nodes whose charts were cut.
pub(crate) fn note(scene: &Scene, cuts: &[Cut]) -> Option<String> {
    let cut = |&i: &usize| {
        let instance = &scene.instances[i];
        let mesh = scene.meshes[instance.mesh].gltf_mesh;
        cuts.iter().any(|cut| match cut.node {
            Some(node) => node == instance.node,
            None => cut.mesh == mesh,
        })
    };
    (!cuts.is_empty()).then(|| {
        format!(
            "charts end under {} thin walls with different light on their two sides, with new vertices there: {} (--no-cut-charts keeps the meshes)",
            cuts.len(),
            some_of((0..scene.instances.len()).filter(cut).map(|i| node_of(scene, i)))
        )
    })
}
