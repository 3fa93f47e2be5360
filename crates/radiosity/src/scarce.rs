//! Places that few rays bring light to.
//!
//! In a gallery beside a bright courtyard, or deep in a cave, one ray in a hundred brings as much
//! light as all others together. How bright such a place is then depends on the draw: with 32 rays
//! a patch, walls in Sponza were between 1.2 and 1.7 times too bright (lab/unseen_levels.md).

use std::collections::BTreeMap;

use patch_subdivision::Subdivision;
use rayon::prelude::*;

use crate::links::{ESCAPED, Links};
use crate::openings::cube_of;
use crate::world::{World, luminance};

/// Edge, in patches, of the cubes whose patches of one facing are judged together. A patch's own
/// rays must not decide how many more it gets: those that happen to find much light would count for
/// more than those that find too little.
const CUBE: f32 = 4.0;

/// Share of the rays, as [`Brought::effective`] counts them, below which they are few.
const FEW: f64 = 1.0 / 8.0;

/// What the rays of some patches bring.
#[derive(Debug, Clone, Default)]
struct Brought {
    rays: f64,
    /// Sum of their light, and of its square.
    light: f64,
    square: f64,
}

impl Brought {
    fn ray(&mut self, light: f64) {
        self.add(&Brought {
            rays: 1.0,
            light,
            square: light * light,
        });
    }

    fn add(&mut self, other: &Brought) {
        self.rays += other.rays;
        self.light += other.light;
        self.square += other.square;
    }

    /// So many rays that all bring the same light have the same relative error (Kish, *Survey
    /// Sampling*, 1965).
    fn effective(&self) -> f64 {
        self.light * self.light / self.square.max(f64::MIN_POSITIVE)
    }

    fn is_scarce(&self) -> bool {
        self.square > 0.0 && self.effective() < FEW * self.rays
    }
}

/// By patch, whether few of the rays of its surroundings bring most of their light. `sent(i, j)` is
/// the radiosity (luminance) of patch `j` as far as rays from patch `i` find it.
pub(crate) fn scarce(
    world: &World,
    cut: &Subdivision,
    links: &Links,
    sent: impl Fn(usize, usize) -> f64 + Sync,
) -> Vec<bool> {
    let place = |p: usize| {
        let patch = &cut.patches()[p];
        let normal =
            world.soup.normals[cut.elements()[patch.first_element as usize].triangle as usize];
        let axis = normal.abs().max_position();
        let facing = 2 * axis + usize::from((normal[axis] < 0.0) != patch.back);
        (cube_of(world, cut, p, CUBE), facing)
    };
    let brought = |p: usize| {
        let row = links.row(p);
        // Of emission that rays gather, only the patch's sum is known. Its emitters are wide.
        let [sky, all] = [links.sky(p), links.all_sources(p)].map(|e| f64::from(luminance(e)));
        let escaped = links.escaped_rays(p).max(1) as f64;
        let sky_of_ray = sky * row.len() as f64 / escaped;
        let mut sum = Brought::default();
        for &to in row {
            let light = match to {
                ESCAPED => sky_of_ray,
                to if (to as usize) < links.patches => sent(p, to as usize),
                _ => 0.0,
            };
            sum.ray(light + all - sky);
        }
        sum
    };
    let seen = |p: &usize| !cut.patches()[*p].hidden;
    let found: Vec<(usize, Brought)> = (0..links.patches)
        .into_par_iter()
        .with_min_len(64)
        .filter(seen)
        .map(|p| (p, brought(p)))
        .collect();
    let mut places: BTreeMap<_, Brought> = BTreeMap::new();
    for (p, brought) in &found {
        places.entry(place(*p)).or_default().add(brought);
    }
    let mut out = vec![false; links.patches];
    for (p, _) in found {
        out[p] = places[&place(p)].is_scarce();
    }
    out
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use mesh_ingest::{Scene, Soup};
    use patch_subdivision::Options;

    use super::*;
    use crate::fixtures::{add_quad, material, without_ceiling};
    use crate::monitor::Silent;
    use crate::sky::Sky;
    use crate::world::WorldOptions;

    /// A room of four by four metres, two high, with a square hole in the middle of its ceiling, this
    /// wide.
    fn under_a_hole(width: f32) -> Scene {
        let mut scene = without_ceiling(4.0, 2.0, 4.0);
        let (x, y, z) = (4.0 * Vec3::X, 2.0 * Vec3::Y, 4.0 * Vec3::Z);
        let mut add = |corner, a, b| add_quad(&mut scene, material(0.5, Vec3::ZERO), corner, a, b);
        let part = 0.5 * (1.0 - width / 4.0);
        add(y, x, z * part);
        add(y + z * (1.0 - part), x, z * part);
        add(y + z * part, x * part, z * (1.0 - 2.0 * part));
        let across = y + z * part + x * (1.0 - part);
        add(across, x * part, z * (1.0 - 2.0 * part));
        scene
    }

    /// Share of the floor's patches that few rays bring light to, and whether patches of one cube
    /// agree.
    fn share_of_floor(width: f32) -> (f32, bool) {
        let scene = under_a_hole(width);
        let soup = Soup::build(&scene);
        let options = WorldOptions {
            sky: Sky::Constant(Vec3::ONE),
            ..WorldOptions::default()
        };
        let world = World::build(&scene, &soup, options).unwrap();
        let options = Options {
            patches: 2000,
            ..Options::default()
        };
        let cut = Subdivision::build(&soup, |_| false, &options);
        let n = cut.patches().len();
        let mut links = Links::of(&world, n, 32);
        links.extend(&world, &cut, |_| 16, &Silent).unwrap();
        let found = scarce(&world, &cut, &links, |_, _| 0.0);
        let triangle = |p: usize| cut.elements()[cut.patches()[p].first_element as usize].triangle;
        let floor: Vec<usize> = (0..n).filter(|p| triangle(*p) < 2).collect();
        let alike = |a: usize, b: usize| {
            cube_of(&world, &cut, a, CUBE) != cube_of(&world, &cut, b, CUBE) || found[a] == found[b]
        };
        let agree = (floor.iter()).all(|&a| floor.iter().all(|&b| alike(a, b)));
        let flagged = floor.iter().filter(|&&p| found[p]).count();
        (flagged as f32 / floor.len() as f32, agree)
    }

    #[test]
    fn a_small_hole_brings_light_with_few_rays() {
        // A twentieth of the view of the floor's middle. No light is reflected, so in corners, where
        // no ray finds the hole, there is none.
        let (share, agree) = share_of_floor(0.8);
        assert!(share > 0.6 && agree, "{share}, {agree}");
        // Most of it.
        let (share, agree) = share_of_floor(3.8);
        assert!(share < 0.1 && agree, "{share}, {agree}");
    }

    #[test]
    fn one_in_eight_rays_is_few() {
        let brought = |bright: usize, times: f64| {
            let mut sum = Brought::default();
            (0..1200).for_each(|k| sum.ray(if k < bright { times } else { 1.0 }));
            sum
        };
        // All light from a part of the rays.
        assert!(brought(1200 / 12, 1e9).is_scarce());
        assert!(!brought(1200 / 5, 1e9).is_scarce());
        // From one ray in a hundred as much as from the others, or a tenth of it.
        assert!(brought(12, 100.0).is_scarce());
        assert!(!brought(12, 10.0).is_scarce());
        // The light's unit does not matter, and the dark is not scarce.
        let mut dim = Brought::default();
        (0..1200).for_each(|k| dim.ray(if k < 100 { 1e-12 } else { 0.0 }));
        assert!(dim.is_scarce());
        assert!(!brought(0, 1.0).is_scarce() && !Brought::default().is_scarce());
    }
}
