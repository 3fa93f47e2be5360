//! A solution on surfaces whose triangles were divided.
//!
//! Where charts are cut, triangles are divided, but surfaces stay, and with them the light: patches
//! are cells of grids over surfaces, whatever triangles these consist of.

use std::collections::BTreeMap;

use glam::Vec3;
use mesh_ingest::Soup;
use patch_subdivision::weights;
use visibility::{BuildOptions, Bvh};

use crate::solution::Solution;
use crate::world::World;

/// Farthest that a part's corners lie off the plane of its triangle, as a fraction of the part's
/// size: f32 rounds new vertices to 1e-7 of their coordinates.
const OFF: f32 = 1e-3;

/// Least barycentric of a part's middle in its triangle. Corners may lie farther outside: cuts of
/// neighbouring surfaces that nearly meet are moved together.
const INSIDE: f32 = -1e-3;

/// Least cosine between their normals.
const FACING: f32 = 0.999;

impl Solution {
    /// The same light on the triangles of `world`, into which those of `from` were divided. `None`
    /// if some are no part of one.
    pub fn carried(mut self, from: &Soup, world: &World) -> Option<Solution> {
        let parents = parents(from, world.soup)?;
        self.cut = self.cut.carried(from, world.soup, &parents)?;
        self.refresh(world);
        Some(self)
    }
}

/// For each triangle of `to` that rays see, the one of `from` that it is a part of, where each has
/// one. O(n log n), but for faces of one instance that coincide, of which each part looks at all.
fn parents(from: &Soup, to: &Soup) -> Option<Vec<u32>> {
    let of_instance = |soup: &Soup| {
        let mut all: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (source, t) in soup.sources[..soup.seen()].iter().zip(0..) {
            all.entry(source.instance).or_default().push(t);
        }
        all
    };
    let (before, after) = (of_instance(from), of_instance(to));
    if !before.keys().eq(after.keys()) {
        return None;
    }
    let mut parents = vec![0; to.seen()];
    for (old, new) in before.values().zip(after.values()) {
        let same = |(a, b): (&u32, &u32)| from.triangles[*a as usize] == to.triangles[*b as usize];
        if old.len() == new.len() && old.iter().zip(new).all(same) {
            (old.iter().zip(new)).for_each(|(a, b)| parents[*b as usize] = *a);
            continue;
        }
        let triangles: Vec<[Vec3; 3]> = old.iter().map(|&t| from.triangles[t as usize]).collect();
        let tree = Bvh::build(&triangles, |_| false, &BuildOptions::default()).ok()?;
        let mut found = Vec::with_capacity(new.len());
        for &part in new {
            let of = parent((from, old, &tree), (to, part))?;
            parents[part as usize] = of;
            found.push(of);
        }
        found.sort_unstable();
        found.dedup();
        if found != *old {
            return None;
        }
    }
    Some(parents)
}

/// The triangle that contains the middle of a part; of several, one of the same material, and then
/// the one that contains it best.
fn parent((from, old, tree): (&Soup, &[u32], &Bvh), (to, part): (&Soup, u32)) -> Option<u32> {
    let own = to.triangles[part as usize];
    let [a, b, c] = own;
    let middle = (a + b + c) / 3.0;
    let reach = OFF * (b - a).length().max((c - a).length());
    let normal = to.normals[part as usize];
    let mut best: Option<(bool, f32, u32)> = None;
    tree.any_near(middle - reach, middle + reach, |i, corners| {
        let t = old[i as usize];
        // The part may be a sliver, whose own normal is less certain.
        let up = from.normals[t as usize];
        let alike = normal.dot(up) >= FACING
            && (own.iter()).all(|p| up.dot(*p - corners[0]).abs() <= reach);
        let [u, v] = weights(corners, middle);
        let inside = match from.triangles[t as usize] == own {
            true => f32::INFINITY,
            false => u.min(v).min(1.0 - u - v),
        };
        let kind = from.materials[t as usize] == to.materials[part as usize];
        let better = best.is_none_or(|(same, most, other)| {
            (kind, inside) > (same, most) || (kind, inside) == (same, most) && t < other
        });
        if alike && inside >= INSIDE && better {
            best = Some((kind, inside, t));
        }
        false
    });
    best.map(|(_, _, t)| t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direct::DirectLight;
    use crate::emitters::Emitters;
    use crate::fixtures::{add_quad, add_triangles, lamp, material};
    use crate::monitor::Silent;
    use crate::solve::{SolveOptions, solve};
    use crate::world::WorldOptions;
    use mesh_ingest::Scene;

    /// A floor and a box on it under a lamp. The floor consists of two triangles, or of these,
    /// divided along x = `cut`, in another order.
    fn room(cut: Option<f32>) -> Scene {
        let mut scene = Scene::default();
        let grey = || material(0.5, Vec3::ZERO);
        let at = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let corners = vec![at(-2.0, -2.0), at(-2.0, 2.0), at(2.0, 2.0), at(2.0, -2.0)];
        match cut {
            None => add_triangles(&mut scene, grey(), corners, vec![[0, 1, 2], [0, 2, 3]]),
            Some(x) => {
                // The diagonal is z = x.
                let ends = [at(x, -2.0), at(x, x), at(x, 2.0)];
                let positions = [corners, ends.to_vec()].concat();
                let left = [[4, 0, 5], [0, 1, 6], [6, 5, 0]];
                let right = [[5, 6, 2], [2, 3, 5], [4, 5, 3]];
                add_triangles(&mut scene, grey(), positions, [right, left].concat());
            }
        }
        let wall = Vec3::new(0.5, 0.0, -1.0);
        add_quad(&mut scene, grey(), wall, Vec3::Z, Vec3::Y);
        scene.lights.push(lamp());
        scene
    }

    #[test]
    fn a_divided_floor_keeps_its_light() {
        let build =
            |scene, soup| World::build(scene, soup, WorldOptions::default()).expect("a tree");
        let (before, after) = (room(None), room(Some(0.3)));
        let (from, to) = (Soup::build(&before), Soup::build(&after));
        let world = build(&before, &from);
        let light = || {
            let emitters = Emitters::collect(&world);
            solve(&world, &emitters, &SolveOptions::default(), &Silent)
        };
        let (first, cut) = (light(), build(&after, &to));
        let carried = light().carried(&from, &cut).expect("the floor is the same");
        for (a, b) in first.cut.elements().iter().zip(carried.cut.elements()) {
            let place = |soup: &Soup, e: &patch_subdivision::Element| {
                let [a, b, c] = soup.triangles[e.triangle as usize];
                a + (b - a) * e.u + (c - a) * e.v
            };
            // An element's point stays a ten thousandth of its triangle from the edges.
            let moved = place(&from, a).distance(place(&to, b));
            assert!(moved < 1e-3, "{moved}");
        }
        let down = |x: f32, z: f32| visibility::Ray {
            origin: Vec3::new(x, 0.2, z),
            direction: -Vec3::Y,
            t_min: 0.0,
            t_max: 1.0,
        };
        let [a, b] = [&world, &cut].map(|world| {
            let emitters = Emitters::collect(world);
            (world, emitters)
        });
        let seen = |(world, emitters): &(&World, Emitters), solution: &Solution, x: f32, z: f32| {
            let ray = down(x, z);
            let lights = DirectLight::new(world, emitters);
            let hit = world.closest_hit(&ray).expect("the floor");
            let at = ray.origin + ray.direction * hit.t;
            solution.radiance(world, &lights, &hit, at, 7)
        };
        for i in 0..400 {
            let (x, z) = (-1.9 + 0.19 * (i % 20) as f32, -1.9 + 0.19 * (i / 20) as f32);
            let (was, is) = (seen(&a, &first, x, z), seen(&b, &carried, x, z));
            // Rounding of the hit's position.
            assert!(
                (was - is).abs().max_element() <= 1e-4 * was.max_element(),
                "{x} {z}: {was} {is}"
            );
        }
    }

    #[test]
    fn other_surfaces_have_other_light() {
        let (before, after) = (room(None), room(Some(0.3)));
        let mut moved = after.clone();
        moved.meshes[0].primitives[0].positions[6].y = 0.1;
        let soup = |scene: &Scene| Soup::build(scene);
        assert!(parents(&soup(&before), &soup(&after)).is_some());
        assert!(parents(&soup(&before), &soup(&moved)).is_none());
        // Parts are no wholes.
        assert!(parents(&soup(&after), &soup(&before)).is_none());
    }
}
