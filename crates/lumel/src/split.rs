//! Chooses the double-sided primitives whose two sides get separate faces.
//!
//! A lightmap has one value for both sides of a face. If people can be on both sides of a sheet and
//! its light differs, as on a wall without thickness between two rooms, one value is wrong on one
//! side. The outside of a room's shell, or the inside of a box, needs no lumels of its own.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use glam::Vec3;
use mesh_ingest::{Cut, Loaded, Scene, TriangleSource};
use patch_subdivision::PatchId;
use radiosity::{Incoming, Solution, World, cosine_hemisphere, luminance, sample_4d};

use crate::named::{node_of, some_of};

/// Relative difference of the light on two sides from which it is visible on walls.
const DIFFERENT: f32 = 0.1;

/// A place is inside the level if this fraction of its rays hits the front of something. The
/// outside of a shell sees backs and the sky.
const INSIDE: f32 = 0.1;

/// The same for unlit places, of the rays that leave what touches the sheet: a dark room has walls
/// all around, even if a wardrobe stands against this one. The underside of an open crate sees only
/// the floor, and the inside of one that stands in others sees half of theirs from behind.
const INSIDE_IN_THE_DARK: f32 = 0.75;

/// Irradiance below this fraction of the scene's mean counts as unlit.
const UNLIT: f32 = 0.01;

/// Most rays from each patch: one from every second of its elements.
const RAYS: u32 = 8;

/// What is closer than this fraction of the sheet's size touches it: nobody looks between a picture
/// and its wall.
const TOUCHING: f32 = 0.05;

/// One side of a primitive of an instance.
#[derive(Clone, Copy, Default)]
struct Side {
    /// Irradiance × area.
    light: Vec3,
    area: f32,
    rays: Rays,
}

/// What rays from a side hit, as the areas that the rays stand for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Rays {
    all: f32,
    /// The front of something beyond what touches the sheet.
    fronts: f32,
    /// Something that touches the sheet, or nothing: the place is in a body that covers the sheet.
    near: f32,
}

impl Side {
    fn mean(&self) -> Vec3 {
        self.light / self.area.max(f32::MIN_POSITIVE)
    }

    /// Whether people can be there.
    fn is_inside(&self, mean: f32) -> bool {
        let dark = luminance(self.mean()) <= UNLIT * mean;
        self.rays.are_inside(dark)
    }
}

impl Rays {
    fn are_inside(&self, dark: bool) -> bool {
        let left = self.all - self.near;
        let surrounded = !dark || self.fronts >= INSIDE_IN_THE_DARK * left;
        self.fronts >= INSIDE * self.all && left > 0.0 && surrounded
    }
}

/// The two sides of all pieces.
fn whole(pieces: &BTreeMap<usize, [Side; 2]>) -> [Side; 2] {
    let mut whole = [Side::default(); 2];
    for piece in pieces.values() {
        for (of, side) in whole.iter_mut().zip(piece) {
            of.light += side.light;
            of.area += side.area;
        }
    }
    whole
}

/// Whether the light differs, on average over the pieces of a primitive: of a bush, the leaves that
/// turn their fronts to the sun may be as many as those that turn their backs.
fn differ(pieces: &BTreeMap<usize, [Side; 2]>) -> bool {
    let (mut differences, mut sum) = (Vec3::ZERO, Vec3::ZERO);
    let seen = |[a, b]: &&[Side; 2]| a.area > 0.0 && b.area > 0.0;
    for [a, b] in pieces.values().filter(seen) {
        let area = a.area + b.area;
        differences += (a.mean() - b.mean()).abs() * area;
        sum += 0.5 * (a.mean() + b.mean()) * area;
    }
    differences.max_element() > DIFFERENT * sum.max_element()
}

/// The primitives to split, as (mesh, primitive) of the document.
pub(crate) fn wanted(
    loaded: &Loaded,
    world: &World,
    solution: &Solution,
) -> BTreeSet<(usize, usize)> {
    let scene = &loaded.scene;
    (seen_from_both_sides(world, solution).into_iter())
        .filter_map(|(instance, primitive)| {
            let placed = &scene.instances[instance as usize];
            let mesh = &scene.meshes[placed.mesh];
            let primitive = &mesh.primitives[primitive as usize];
            let material = &scene.materials[primitive.material];
            let number = (mesh.gltf_mesh, primitive.gltf_primitive);
            let may = !material.lets_light_through()
                && !material.occluder_only
                && !placed.occluder
                && (loaded.document).can_split(number.0, number.1);
            may.then_some(number)
        })
        .collect()
}

/// Double-sided primitives, as (instance, primitive of its mesh), with different light on their two
/// sides, if people can be on both.
fn seen_from_both_sides(world: &World, solution: &Solution) -> BTreeSet<(u32, u32)> {
    let mut pieces: BTreeMap<(u32, u32), BTreeMap<usize, [Side; 2]>> = BTreeMap::new();
    each_side(world, solution, |patch| {
        let Some(region) = solution.cut.region_of(patch.triangle) else {
            return;
        };
        if patch.hidden {
            return;
        }
        let of = &mut pieces
            .entry((patch.source.instance, patch.source.primitive))
            .or_default()
            .entry(region)
            .or_default()[usize::from(patch.back)];
        of.light += patch.light * patch.area;
        of.area += patch.area;
    });
    let mut found: BTreeMap<(u32, u32), [Side; 2]> = (pieces.iter())
        .filter(|(_, pieces)| differ(pieces))
        .map(|(key, pieces)| (*key, whole(pieces)))
        .collect();
    if found.is_empty() {
        return BTreeSet::new();
    }
    each_side(world, solution, |patch| {
        let key = (patch.source.instance, patch.source.primitive);
        let Some(sides) = found.get_mut(&key) else {
            return;
        };
        let of = &mut sides[usize::from(patch.back)];
        let touching = TOUCHING * of.area.sqrt();
        of.rays.all += patch.area;
        // Nobody is in a body, whatever else lies in it.
        if patch.hidden {
            of.rays.near += patch.area;
        } else {
            cast(world, solution, patch, touching, &mut of.rays);
        }
    });
    let mean = luminance(solution.mean_irradiance().as_vec3());
    found.retain(|_, sides| sides.iter().all(|s| s.is_inside(mean)));
    found.into_keys().collect()
}

/// Names the nodes whose sides were split.
pub(crate) fn note(
    scene: &Scene,
    split: &BTreeSet<(usize, usize)>,
    cuts: &[Cut],
) -> Option<String> {
    let meshes: BTreeSet<usize> = split.iter().map(|(mesh, _)| *mesh).collect();
    // A node that is cut may have a copy of its mesh.
    let copied = cuts.iter().filter(|cut| meshes.contains(&cut.mesh));
    let copied: BTreeSet<usize> = copied.filter_map(|cut| cut.node).collect();
    let nodes = (0..scene.instances.len()).filter(|&i| {
        let instance = &scene.instances[i];
        meshes.contains(&scene.meshes[instance.mesh].gltf_mesh) || copied.contains(&instance.node)
    });
    (!split.is_empty()).then(|| {
        format!(
            "double-sided faces have different light on their two sides, so each side has faces of its own in the output: {} (--no-split-sides keeps one value for both)",
            some_of(nodes.map(|i| node_of(scene, i)))
        )
    })
}

/// Adds what rays from the elements of a patch hit, at most [`RAYS`].
fn cast(world: &World, solution: &Solution, patch: &SidePatch, touching: f32, rays: &mut Rays) {
    let elements = &solution.cut.elements()[patch.elements.clone()];
    let count = (elements.len() as u32 / 2).clamp(1, RAYS);
    let area = patch.area / count as f32;
    for (k, e) in (0..count).zip(elements.iter().step_by(2)) {
        let s = sample_4d(k, 0, patch.elements.start as u32);
        let p = world.inset_point(e.triangle, e.u, e.v, patch.back, false);
        let toward = cosine_hemisphere(p.normal, s[0], s[1]);
        match world.incoming(p.origin, toward).0 {
            Incoming::Surface(hit) if hit.t <= touching => rays.near += area,
            Incoming::Surface(hit) if !hit.back => rays.fronts += area,
            _ => {}
        }
    }
}

/// A patch of a double-sided face.
pub(crate) struct SidePatch<'a> {
    pub source: &'a TriangleSource,
    /// Its elements.
    pub elements: Range<usize>,
    /// A triangle of it, in the soup.
    pub triangle: u32,
    /// Whether it is on the back.
    pub back: bool,
    /// Whether it is inside something.
    pub hidden: bool,
    /// Irradiance.
    pub light: Vec3,
    /// Area, m².
    pub area: f32,
}

/// Calls `take` with each patch of a double-sided face.
pub(crate) fn each_side(world: &World, solution: &Solution, mut take: impl FnMut(&SidePatch)) {
    let (soup, cut) = (world.soup, &solution.cut);
    let backed = soup.backed();
    for (i, patch) in cut.patches().iter().enumerate() {
        let triangle = cut.elements()[patch.first_element as usize].triangle;
        if !world.two_sided(triangle) || backed.contains(&triangle) {
            continue;
        }
        take(&SidePatch {
            source: &soup.sources[triangle as usize],
            elements: cut.elements_of(PatchId(i as u32)),
            triangle,
            back: patch.back,
            hidden: patch.hidden,
            light: solution.direct_mean[i] + solution.indirect[i],
            area: patch.area,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side(light: f32) -> Side {
        Side {
            light: Vec3::splat(2.0 * light),
            area: 2.0,
            ..Side::default()
        }
    }

    #[test]
    fn leaves_that_turn_either_side_to_the_sun_differ() {
        let piece = |front, back| [side(front), side(back)];
        let pieces = |all: &[[Side; 2]]| all.iter().copied().enumerate().collect();
        // As bright on both sides in all.
        let bush = pieces(&[piece(1.0, 0.2), piece(0.2, 1.0)]);
        assert!(differ(&bush));
        let whole = whole(&bush);
        assert_eq!(whole[0].mean(), whole[1].mean());
        // Noise of a few per cent.
        assert!(!differ(&pieces(&[piece(1.0, 0.95), piece(0.95, 1.0)])));
        // What lies on the ground has no back that anybody sees.
        assert!(!differ(&pieces(&[[side(1.0), Side::default()]])));
    }
    #[test]
    fn a_wardrobe_against_a_wall_of_a_dark_room_leaves_it_a_room() {
        let rays = |fronts, near| Rays {
            all: 100.0,
            fronts,
            near,
        };
        assert!(rays(38.0, 62.0).are_inside(true));
        // A shell's outside, which sees the ground, and a crate with another one through its side.
        assert!(!rays(38.0, 0.0).are_inside(true));
        assert!(!rays(49.0, 12.0).are_inside(true));
        // The back of a picture.
        assert!(!rays(5.0, 95.0).are_inside(false));
        assert!(!rays(5.0, 95.0).are_inside(true));
        assert!(rays(38.0, 0.0).are_inside(false));
        assert!(!rays(0.0, 100.0).are_inside(false));
    }
}
