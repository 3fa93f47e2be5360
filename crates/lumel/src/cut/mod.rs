//! Chooses where charts are cut: under [thin walls](walls) with different light on their two sides,
//! and along the [edges of sharp shadows](shadows).
//!
//! A lumel that such a line crosses is read by lookups on both sides of it, and whatever it holds
//! is wrong on one of them.

mod ends;
mod shadows;
mod walls;

use std::collections::{BTreeMap, BTreeSet};

use atlas::{LayoutReport, MeshReport, UvOrigin};
use glam::{DVec3, Vec3};
use mesh_ingest::{Cut, Loaded, Mesh, Scene, TriangleSource};
use patch_subdivision::{FlatPieces, PatchId};
use radiosity::{Emitters, Ground, SharpLights, Solution, SurfacePoint, World, luminance};

use crate::named::{node_of, some_of};
use ends::{Ends, Light};
use shadows::{Edge, Shaded};
use walls::{Found, Wall};

/// Relative difference of the light on two sides from which a piece of a line counts.
const DIFFERENT: f32 = 0.3;

/// Mean relative difference along a line from which charts end there: the brighter side has 1.7
/// times the light. A lookup beside a wall takes up to half of its light from the shared lumel, so
/// the line is a third brighter than the floor.
const NOTICED: f32 = 0.4;

/// Larger meshes are not cut. Their charts take long and would be made twice, and the walls of
/// scans and of finely carved architecture are no straight lines.
const MOST_TRIANGLES: usize = 20_000;

/// Nor are larger ones that several nodes share, as each node gets a copy.
const MOST_COPIED: usize = 1_000;

/// Light below this fraction of the scene's mean is not told from black.
const BLACK: f32 = 0.02;

/// Whether a point is on a surface is looked for within this many of its [offsets](World::offset).
const LIFTED: f32 = 8.0;

/// Lines are the same if they are parallel within this sine …
const PARALLEL: f32 = 0.03;

/// … and this many lumels apart at most. The two sides of a wall are two lines, unless they are
/// that close.
const BESIDE: f32 = 0.05;

/// Lines of neighbouring surfaces that end this close to each other, in lumels, meet. Lumels there
/// hold a hundredth of the other side's light at most.
const MEET: f32 = 0.015;

/// Shorter lines, in lumels, are not worth a border of charts where the light differs just
/// [noticeably](NOTICED). With 8, the shadows of leaves, crates and books were blurred, and the far
/// side of where leaves cross was lit.
const SHORT: f32 = 2.0;

/// Nor is a border under a wall nearer than this, in lumels, to the end of the surface, unless the
/// strip beyond it is seen across a room: else it is where a floor ends outside of the walls.
const STRIP: f32 = 1.5;

/// Nor is the edge of a shadow nearer than this, in lumels. Wider strips of sun would light up a
/// whole lumel, as along the top of a wall.
const SUNLIT_STRIP: f32 = 0.1;

/// Of the shaded half of a penumbra, this fraction times the fourth root of the shade's light over
/// the sun's is left to charts of shade, and the rest to those of sun. If they met in the middle,
/// the shade's lumels would hold a fifth of the penumbra's light, and in a room a hundredth of the
/// sun doubles the light in the shade. With the root, lumels beside the widest penumbras get less
/// than half brighter there, and a sixth beside those of 0.75 lumels. If they met behind the
/// penumbra, sunlit shapes would be too wide by half of it.
const BEYOND: f32 = 0.65;

/// Pieces of a shadow's edge that are this far apart at most, in lumels, are one.
const GAP: f32 = 1.5;

/// Most walls on a surface, the most visible first: each can double the number of its charts.
const MOST_WALLS: usize = 16;

/// Most edges of shadows on a surface, likewise. Each divides only the charts that it enters.
const MOST_SHADOWS: usize = 64;

/// And on all surfaces of a node, as rough ground has thousands.
const MOST_OF_NODE: usize = 1024;

/// Most lines that are looked for on a surface: the leaves of a bush shall not crowd out a wall.
const MOST_FOUND: usize = 1024;

/// A straight line on a surface along which its light changes.
struct Line {
    /// Unit normal of the line, in the surface's plane, and its distance from the origin along it,
    /// metres, in recentred world space.
    normal: Vec3,
    offset: f32,
    cause: Cause,
    /// A triangle of the surface.
    triangle: u32,
}

/// What makes the light change.
enum Cause {
    /// A thin wall.
    Wall {
        /// Length found, metres, and the same weighted by the difference of the light.
        length: f32,
        weight: f32,
        /// What rays from either side found.
        sides: [Found; 2],
    },
    /// The edge of a shadow; the normal points into the shade.
    Shadow(Vec<Piece>),
}

/// A piece of a shadow's edge.
struct Piece {
    /// Where along the edge its middle is, metres.
    at: f32,
    length: f32,
    /// How far it is behind the line, metres.
    behind: f32,
    /// How far behind the piece the shade is complete, metres.
    penumbra: f32,
    /// Relative difference of the light.
    differ: f32,
}

/// Pieces of a shadow's edge without a gap between them.
struct Stretch {
    /// Where it begins and ends.
    ends: [f32; 2],
    pieces: Vec<Piece>,
}

impl Stretch {
    /// Pieces that are at most `gap` apart are of one stretch.
    fn all(mut pieces: Vec<Piece>, gap: f32) -> Vec<Stretch> {
        pieces.sort_by(|a, b| a.at.total_cmp(&b.at));
        let mut out: Vec<Stretch> = Vec::new();
        for piece in pieces {
            let ends = [-0.5, 0.5].map(|side| piece.at + side * piece.length);
            match out.last_mut() {
                Some(last) if ends[0] <= last.ends[1] + gap => {
                    last.ends[1] = last.ends[1].max(ends[1]);
                    last.pieces.push(piece);
                }
                _ => out.push(Stretch {
                    ends,
                    pieces: vec![piece],
                }),
            }
        }
        out
    }

    fn mean(&self, of: impl Fn(&Piece) -> f32) -> f32 {
        self.pieces.iter().map(of).sum::<f32>() / self.pieces.len() as f32
    }

    /// By place along the edge, how far behind the line charts end, metres: where the penumbras of
    /// all pieces do, less [a part of them](BEYOND). It changes along the edge, as penumbras grow
    /// with the distance from what casts them.
    fn behind(&self) -> impl Fn(f32) -> f32 {
        // Elements in the penumbra differ less, so the largest difference is that of sun and shade.
        let differ = self.pieces.iter().map(|p| p.differ).fold(0.0, f32::max);
        let shade = (1.0 - differ).max(0.0);
        let sunny = 1.0 - BEYOND * shade.sqrt().sqrt();
        let behind = |p: &Piece| p.behind + sunny * p.penumbra;
        let middle = self.mean(|p| p.at);
        // That of pieces with a length, so that two in one place are not steep.
        let spread = self.mean(|p| (p.at - middle).powi(2) + p.length * p.length / 12.0);
        let slope = self.mean(|p| (p.at - middle) * behind(p)) / spread;
        let above = (self.pieces.iter()).map(|p| behind(p) - slope * (p.at - middle));
        let level = above.fold(f32::NEG_INFINITY, f32::max);
        move |at| level + slope * (at - middle)
    }
}

/// A level with its light, and what the search for lines needs of it.
struct Level<'l> {
    world: &'l World<'l>,
    solution: &'l Solution,
    /// The surfaces that lines are on.
    surfaces: FlatPieces,
    /// By instance, the edge of its lumels in metres, unless its charts cannot be cut.
    lumels: Vec<Option<f32>>,
    /// By element, the luminance of its light, and whether it is on a back.
    light: Vec<f32>,
    back: Vec<bool>,
    /// Light that is not told from black.
    black: f32,
}

impl<'l> Level<'l> {
    fn new(world: &'l World<'l>, solution: &'l Solution, lumels: Vec<Option<f32>>) -> Self {
        let cut = &solution.cut;
        let mut light = vec![0.0f32; cut.elements().len()];
        let mut back = vec![false; light.len()];
        for (p, patch) in cut.patches().iter().enumerate() {
            for e in cut.elements_of(PatchId(p as u32)) {
                light[e] = luminance(solution.direct[e] + solution.indirect[p]);
                back[e] = patch.back;
            }
        }
        Level {
            world,
            solution,
            surfaces: FlatPieces::find(world.soup, |t| world.two_sided(t as u32)),
            lumels,
            light,
            back,
            black: BLACK * luminance(solution.mean_irradiance().as_vec3()),
        }
    }

    /// Edge of the lumels of a triangle's surface, metres, unless its charts cannot be cut.
    fn lumel_of(&self, triangle: u32) -> Option<f32> {
        let instance = self.world.soup.sources[triangle as usize].instance;
        self.lumels[instance as usize]
    }

    /// Relative difference of the light of two elements, if it counts.
    fn difference(&self, pair: [u32; 2]) -> Option<f32> {
        self.relative(pair.map(|e| self.light[e as usize]))
    }

    /// Relative difference of light in two places, if it counts.
    fn relative(&self, [a, b]: [f32; 2]) -> Option<f32> {
        let differ = (a - b).abs() / a.max(b).max(self.black);
        (differ > DIFFERENT).then_some(differ)
    }

    /// Whether a point of the plane of a triangle is on its surface, where somebody may see it.
    /// Others may be in the same place: of coincident panels any may be the one that is seen.
    fn is_on(&self, p: Vec3, triangle: u32, ground: &Ground) -> bool {
        let lift = LIFTED * self.world.offset(p);
        let own = self.surfaces.of(triangle);
        let same = self.world.is_on(p, lift, |t| self.surfaces.of(t) == own);
        let point = || SurfacePoint {
            position: p,
            origin: p + ground.up * lift,
            normal: ground.up,
            geometric: ground.up,
        };
        same && !self.world.inside_a_body(&point())
    }

    /// The points of two elements of one side of a surface.
    fn points(&self, pair: [u32; 2]) -> [SurfacePoint; 2] {
        let back = self.back[pair[0] as usize];
        pair.map(|e| {
            let e = self.solution.cut.elements()[e as usize];
            self.world.surface_point(e.triangle, e.u, e.v, back, false)
        })
    }
}

/// The lines of a surface, as they are found.
#[derive(Default)]
struct Lines(Vec<Line>);

impl Lines {
    /// Adds a piece of a wall to the lines of its two faces.
    fn enter_wall(&mut self, wall: &Wall) {
        for at in wall.faces() {
            let new = || Line {
                normal: wall.normal,
                offset: wall.normal.dot(at),
                cause: Cause::Wall {
                    length: 0.0,
                    weight: 0.0,
                    sides: Default::default(),
                },
                triangle: wall.triangle,
            };
            let same = |l: &Line| l.is_along(wall.normal, at, wall.lumel);
            if let Some(line) = self.find_or_add(same, new)
                && let Cause::Wall {
                    length,
                    weight,
                    sides,
                } = &mut line.cause
            {
                *length += wall.length;
                *weight += wall.length * wall.differ;
                sides[0].add(&wall.sides[0]);
                sides[1].add(&wall.sides[1]);
            }
        }
    }

    /// Adds the edge of a shadow on a surface with this normal of its front.
    fn enter_shadow(&mut self, edge: &Edge, up: Vec3) {
        let Shaded { lumel, .. } = edge.on;
        let new = || Line {
            normal: edge.normal,
            offset: edge.normal.dot(edge.ends[0]),
            cause: Cause::Shadow(Vec::new()),
            triangle: edge.on.triangle,
        };
        let same = |l: &Line| {
            let is_along = |&at: &Vec3| l.is_along(edge.normal, at, lumel);
            edge.ends.iter().all(is_along)
                && !(matches!(l.cause, Cause::Shadow(_)) && l.normal.dot(edge.normal) < 0.0)
        };
        // Along a wall, the wall decides.
        if let Some(line) = self.find_or_add(same, new)
            && let Cause::Shadow(pieces) = &mut line.cause
        {
            let along = line.normal.cross(up);
            pieces.extend(edge.points.iter().map(|(point, differ)| Piece {
                at: along.dot(point.at),
                length: edge.step,
                behind: line.normal.dot(point.at) - line.offset,
                penumbra: point.penumbra,
                differ: *differ,
            }));
        }
    }

    /// The first line that is the `same`, or a new one if there is room.
    fn find_or_add(
        &mut self,
        same: impl Fn(&Line) -> bool,
        new: impl FnOnce() -> Line,
    ) -> Option<&mut Line> {
        let k = match self.0.iter().position(same) {
            Some(k) => k,
            None if self.0.len() == MOST_FOUND => return None,
            None => {
                self.0.push(new());
                self.0.len() - 1
            }
        };
        Some(&mut self.0[k])
    }
}

impl Line {
    /// Whether a line with this normal through this point is the same.
    fn is_along(&self, normal: Vec3, at: Vec3, lumel: f32) -> bool {
        self.normal.dot(normal).abs() > 1.0 - 0.5 * PARALLEL * PARALLEL
            && (self.normal.dot(at) - self.offset).abs() < BESIDE * lumel
    }

    /// The lines where charts may end, on a surface with these lumels and points.
    fn chosen(self, lumel: f32, world: &World, points: &[Vec3]) -> Vec<Chosen> {
        match self.cause {
            Cause::Wall {
                length,
                weight,
                sides,
            } => {
                let far = |side: f32| {
                    let beyond =
                        (points.iter()).map(|p| side * (self.normal.dot(*p) - self.offset));
                    beyond.fold(0.0, f32::max)
                };
                let strips = [far(1.0), far(-1.0)].map(|far| far <= STRIP * lumel);
                let visible = |(strip, side): (bool, &Found)| strip && side.is_seen_across();
                let worth = is_worth_it(length, weight / length, lumel)
                    && (strips == [false; 2] || strips.into_iter().zip(&sides).any(visible));
                let seen = sides.iter().all(Found::is_seen);
                let line = Chosen {
                    normal: self.normal,
                    offset: self.offset,
                    ends: None,
                    triangle: self.triangle,
                    length,
                    differ: weight / length,
                };
                (worth && seen).then_some(line).into_iter().collect()
            }
            Cause::Shadow(pieces) => {
                let up = world.soup.normals[self.triangle as usize];
                let on = world.soup.triangles[self.triangle as usize][0];
                let foot = self.normal * self.offset + up * up.dot(on);
                let along = self.normal.cross(up);
                (Stretch::all(pieces, GAP * lumel).into_iter())
                    .map(|stretch| {
                        let [from, to] = stretch.ends;
                        let behind = stretch.behind();
                        let ends = [from, to].map(|x| foot + along * x + self.normal * behind(x));
                        let normal = up.cross(ends[1] - ends[0]).normalize_or_zero();
                        Chosen {
                            normal,
                            offset: normal.dot(ends[0]),
                            ends: Some(ends),
                            triangle: self.triangle,
                            length: to - from,
                            differ: stretch.mean(|p| p.differ),
                        }
                    })
                    .collect()
            }
        }
    }
}

/// A line along which charts end.
struct Chosen {
    normal: Vec3,
    offset: f32,
    /// Its ends; `None` if it goes through.
    ends: Option<[Vec3; 2]>,
    triangle: u32,
    /// Its length, metres, and the mean relative difference of the light.
    length: f32,
    differ: f32,
}

impl Chosen {
    /// How visible it is.
    fn weight(&self) -> f32 {
        self.length * self.differ
    }

    /// Whether it goes on where another line ends.
    fn meets(&self, other: &Chosen, near: f32) -> bool {
        let ends = |line: &Chosen| line.ends.into_iter().flatten();
        ends(self).any(|a| ends(other).any(|b| a.distance(b) <= near))
    }
}

/// Whether a line is noticed. Where the light differs more, shorter lines are; by the square of the
/// difference, edges of a third of a lumel would be, and leave slivers of charts.
fn is_worth_it(length: f32, differ: f32, lumel: f32) -> bool {
    let stark = differ / NOTICED;
    stark >= 1.0 && length * stark >= SHORT * lumel
}

/// The cuts, surface by surface.
pub(crate) fn wanted(
    loaded: &Loaded,
    (world, emitters, solution): (&World, &Emitters, &Solution),
    report: &LayoutReport,
) -> Vec<Cut> {
    let lumels = lumel_sizes(loaded, report);
    let may_cut = lumels.iter().any(Option::is_some);
    if !may_cut {
        return Vec::new();
    }
    let lights = SharpLights::new(world);
    if !solution.cut.has_walls() && lights.is_empty() {
        return Vec::new();
    }
    let level = Level::new(world, solution, lumels);
    let mut lines: BTreeMap<u32, Lines> = BTreeMap::new();
    let (ends, light) = (Ends::find(&level), Light::new(&level, emitters));
    let walls = walls::find(&level).into_iter();
    for wall in walls.chain(ends::walls(&level, &ends, &light)) {
        if let Some(surface) = level.surfaces.of(wall.triangle) {
            lines.entry(surface).or_default().enter_wall(&wall);
        }
    }
    for edge in shadows::find(&level, &lights, &ends, &light) {
        if let Some(surface) = level.surfaces.of(edge.on.triangle) {
            let up = world.soup.normals[edge.on.triangle as usize];
            lines.entry(surface).or_default().enter_shadow(&edge, up);
        }
    }
    let points = visible_points(&level, &lines);
    let (scene, uses) = (&loaded.scene, &uses(&loaded.scene));
    let copies = copies(world, &level.lumels);
    let mut candidates: BTreeMap<u32, Vec<Chosen>> = BTreeMap::new();
    for (surface, Lines(found)) in lines {
        let of_surface = candidates.entry(surface).or_default();
        for line in found {
            if let Some(lumel) = level.lumel_of(line.triangle) {
                of_surface.extend(line.chosen(lumel, world, &points[&surface]));
            }
        }
    }
    let noticed = noticed(&level, &candidates);
    let mut chosen: Vec<Chosen> = Vec::new();
    for ((_, lines), noticed) in candidates.into_iter().zip(noticed) {
        let lines = lines
            .into_iter()
            .zip(noticed)
            .filter(|(_, noticed)| *noticed);
        let (walls, shadows): (Vec<Chosen>, Vec<Chosen>) = lines
            .map(|(line, _)| line)
            .partition(|line| line.ends.is_none());
        for (mut lines, most) in [(walls, MOST_WALLS), (shadows, MOST_SHADOWS)] {
            // Stable, so of equal lines the first found stays first.
            lines.sort_by(|a, b| b.weight().total_cmp(&a.weight()));
            lines.truncate(most);
            chosen.append(&mut lines);
        }
    }
    keep_most_of_nodes(&mut chosen, world);
    let cuts = chosen.iter().flat_map(|line| {
        let lumel = level.lumel_of(line.triangle).unwrap_or(0.0);
        // What coincides is cut alike, or it would coincide no more.
        let own = world.soup.sources[line.triangle as usize];
        let copies = copies.get(&line.triangle).into_iter().flatten();
        let sources = std::iter::once(own).chain(copies.copied());
        sources.map(move |source| in_mesh(scene, uses, (line, lumel), source))
    });
    cuts.collect()
}

/// By surface, which of its lines are noticed. Where a surface bends, the edge of a shadow goes on
/// as another line, and is noticed if both together are long enough.
fn noticed(level: &Level, candidates: &BTreeMap<u32, Vec<Chosen>>) -> Vec<Vec<bool>> {
    let all: Vec<(u32, &Chosen)> = (candidates.iter())
        .flat_map(|(surface, lines)| lines.iter().map(move |line| (*surface, line)))
        .collect();
    let lines = &all[..];
    let of_surface = move |surface: u32| {
        let [from, to] = [surface, surface + 1].map(|s| lines.partition_point(|l| l.0 < s));
        from..to
    };
    let lumel = |line: &Chosen| level.lumel_of(line.triangle).unwrap_or(f32::MIN_POSITIVE);
    let goes_on_as = |k: usize| {
        let (surface, line) = lines[k];
        let beside = level.surfaces.beside(surface).iter().copied();
        beside
            .flat_map(of_surface)
            .filter(move |&m| line.meets(lines[m].1, GAP * lumel(line)))
    };
    let mut noticed: Vec<Option<bool>> = vec![None; lines.len()];
    for k in 0..lines.len() {
        if noticed[k].is_some() {
            continue;
        }
        let mut chain = BTreeSet::from([k]);
        let mut next = vec![k];
        while let Some(k) = next.pop() {
            next.extend(goes_on_as(k).filter(|m| chain.insert(*m)));
        }
        let length: f32 = chain.iter().map(|m| lines[*m].1.length).sum();
        for m in chain {
            let line = lines[m].1;
            let worth = line.ends.is_none() || is_worth_it(length, line.differ, lumel(line));
            noticed[m] = Some(worth);
        }
    }
    let mut noticed = noticed.into_iter().map(|n| n.unwrap_or(false));
    let lengths = candidates.values().map(Vec::len);
    lengths
        .map(|n| noticed.by_ref().take(n).collect())
        .collect()
}

/// Takes away the least visible edges of shadows of nodes that have more than [`MOST_OF_NODE`].
fn keep_most_of_nodes(lines: &mut Vec<Chosen>, world: &World) {
    let node = |line: &Chosen| {
        let instance = || world.soup.sources[line.triangle as usize].instance;
        line.ends.map(|_| instance())
    };
    let mut weights: BTreeMap<u32, Vec<f32>> = BTreeMap::new();
    for line in lines.iter() {
        if let Some(node) = node(line) {
            weights.entry(node).or_default().push(line.weight());
        }
    }
    weights.retain(|_, weights| {
        weights.sort_by(|a, b| b.total_cmp(a));
        weights.len() > MOST_OF_NODE
    });
    lines.retain(|line| {
        let of_node = node(line).and_then(|node| weights.get(&node));
        of_node.is_none_or(|weights| line.weight() > weights[MOST_OF_NODE])
    });
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

/// Points of the visible elements of each surface that has lines.
fn visible_points(level: &Level, lines: &BTreeMap<u32, Lines>) -> BTreeMap<u32, Vec<Vec3>> {
    let (world, cut) = (level.world, &level.solution.cut);
    let mut points: BTreeMap<u32, Vec<Vec3>> =
        lines.keys().map(|&surface| (surface, Vec::new())).collect();
    for (p, patch) in cut.patches().iter().enumerate() {
        for e in cut.elements_of(PatchId(p as u32)) {
            let element = cut.elements()[e];
            let surface = level.surfaces.of(element.triangle);
            let of_surface = surface.and_then(|s| points.get_mut(&s));
            if let Some(of_surface) = of_surface.filter(|_| !patch.hidden) {
                let [a, b, c] = world.soup.triangles[element.triangle as usize];
                of_surface.push(a + (b - a) * element.u + (c - a) * element.v);
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

/// A line on a surface with these lumels as a cut of the mesh of one of its triangles.
fn in_mesh(
    scene: &Scene,
    uses: &BTreeMap<usize, usize>,
    (line, lumel): (&Chosen, f32),
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
    let from_world = to_world.inverse();
    let ends = (line.ends).map(|ends| {
        ends.map(|p| {
            from_world
                .transform_point3(p.as_dvec3() + scene.origin)
                .as_vec3()
                .to_array()
        })
    });
    Cut {
        mesh: mesh.gltf_mesh,
        node: (uses[&mesh.gltf_mesh] > 1).then_some(instance.node),
        primitive: primitive.gltf_primitive,
        triangle: primitive.source_triangles[source.triangle as usize],
        normal: (normal / length).as_vec3().to_array(),
        offset: (offset / length) as f32,
        ends,
        meet: MEET * lumel * from_world.matrix3.determinant().abs().cbrt() as f32,
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
            "charts end along {} lines, under thin walls and at the edges of sharp shadows, with new vertices there: {} (--no-cut-charts keeps the meshes)",
            cuts.len(),
            some_of((0..scene.instances.len()).filter(cut).map(|i| node_of(scene, i)))
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use radiosity::SOFT;

    #[test]
    fn a_line_follows_a_penumbra_that_grows_and_leaves_no_piece_in_the_sun() {
        let piece = |at: f32, behind: f32| Piece {
            at,
            length: 0.1,
            behind,
            penumbra: 0.0,
            differ: 1.0,
        };
        // A centimetre a metre, give or take a millimetre, with a gap of half a metre.
        let pieces: Vec<Piece> = (0..20)
            .filter(|k| !(10..15).contains(k))
            .map(|k| piece(0.1 * k as f32, 0.001 * (k + k % 2) as f32))
            .rev()
            .collect();
        let [first, second] = &Stretch::all(pieces, 0.2)[..] else {
            panic!("two stretches");
        };
        let near = |[a, b]: [f32; 2], [c, d]: [f32; 2]| (a - c).abs() + (b - d).abs() < 1e-5;
        assert!(near(first.ends, [-0.05, 0.95]), "{:?}", first.ends);
        assert!(near(second.ends, [1.45, 1.95]), "{:?}", second.ends);
        let behind = first.behind();
        for p in &first.pieces {
            let more = behind(p.at) - p.behind;
            assert!((-1e-6..2e-3).contains(&more), "{more} at {}", p.at);
        }
        let slope = behind(1.0) - behind(0.0);
        assert!((slope - 0.01).abs() < 1e-3, "{slope}");
    }

    /// Light of a penumbra from this place across it on, from 0 in its middle to 1: the integral of
    /// the visible part of a disc.
    fn light_beyond(place: f64) -> f64 {
        let steps = 1000;
        let width = (1.0 - place) / f64::from(steps);
        let visible = |s: f64| 0.5 - (s.asin() + s * (1.0 - s * s).sqrt()) / std::f64::consts::PI;
        let middles = (0..steps).map(|k| place + (f64::from(k) + 0.5) * width);
        middles.map(visible).sum::<f64>() * width
    }

    #[test]
    fn the_brighter_the_shade_the_more_of_a_penumbra_is_left_in_it() {
        let end = |shade: f32| {
            let piece = Piece {
                at: 0.0,
                length: 1.0,
                behind: 0.0,
                penumbra: 1.0,
                differ: 1.0 - shade,
            };
            let stretch = &Stretch::all(vec![piece], 0.0)[0];
            f64::from(stretch.behind()(0.0))
        };
        assert!((end(0.0) - 1.0).abs() < 1e-6, "nothing if it is black");
        let mut before = 1.0;
        for shade in [0.01, 0.1, 0.5, 0.9] {
            let place = end(shade);
            assert!(place < before, "the brighter, the more");
            assert!(place > 0.0, "sunlit shapes are not too narrow: {place}");
            // Half of a penumbra of this width, in lumels, is on either side. Leaving less of the
            // widest to the shade makes sunlit shapes too wide, which FLIP weighs as more.
            for (width, most) in [(0.75, 0.2), (SOFT, 0.5)] {
                let sun = 0.5 * f64::from(width) * light_beyond(place);
                let brighter = sun * f64::from((1.0 - shade) / shade);
                assert!(
                    brighter < most,
                    "{brighter} at {width} where the shade has {shade}"
                );
            }
            before = place;
        }
    }
}
