//! Where the sky is seen from indoors: windows, doors, and holes in roofs.
//!
//! In a room with a window, one ray in twenty reaches the sky, and brings most of the light. Which
//! directions these are is told by the links' rays that left the scene. Shadow rays are drawn in
//! these directions, beside gathering rays, and the balance heuristic weighs both (Veach and Guibas,
//! *Optimally combining sampling techniques for Monte Carlo rendering*, 1995). So the directions
//! need not be complete: gathering rays find the rest.

use std::collections::BTreeMap;
use std::f32::consts::{PI, TAU};

use glam::Vec3;
use patch_subdivision::{PatchId, Subdivision};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::links::Links;
use crate::world::{World, luminance};

/// Rows and columns of the directions, which have equal solid angles: 6° wide, a quarter of a
/// window at four metres.
const ROWS: usize = 32;
const COLUMNS: usize = 64;

/// Solid angle of a direction, sr.
const SOLID_ANGLE: f32 = 4.0 * PI / (ROWS * COLUMNS) as f32;

/// Edge, in patches, of the cubes whose patches have one set of directions. Smaller ones know fewer
/// directions: with 8, a room has 1.1 times the error at `quick` (lab/unseen_levels.md).
const CUBE: f32 = 16.0;

/// Patches with a larger share of their rays in the sky are outdoors. Their directions would hide
/// the windows of a room in the same cube.
const OUTDOORS: f32 = 0.4;

/// Patches with a larger share find the sky so often that their rays, which are well distributed,
/// know its light better without shadow rays.
const SELDOM: f32 = 1.0 / 16.0;

/// Fewer rays say too little about directions.
const LEAST: usize = 8;

/// A direction with less of a cube's light is left to gathering rays; rounding would decide about it.
const SMALL: f32 = 1e-6;

/// Patches whose rays are looked at together, which bounds memory.
const BLOCK: usize = 1 << 14;

/// No set of directions.
const NONE: u32 = u32::MAX;

/// Directions of the sky, by place.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Openings {
    /// By patch, the number of its set of directions, or [`NONE`].
    of_patch: Vec<u32>,
    /// The first bin of each set, and the number of bins.
    starts: Vec<u32>,
    bins: Vec<Bin>,
}

/// Number of a direction, and the share of the light from it and all before it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Bin {
    number: u16,
    running: f32,
}

/// The directions of the sky from one place.
#[derive(Debug, Clone, Copy)]
pub struct Opening<'o> {
    bins: &'o [Bin],
}

/// What the rays of a cube's patches found.
#[derive(Default)]
struct Cube {
    patches: Vec<u32>,
    escaped: usize,
    /// Light by number of the direction.
    light: BTreeMap<u16, f32>,
}

impl Openings {
    /// The directions in which the rays between patches left the scene.
    pub(crate) fn find(world: &World, cut: &Subdivision, links: &Links) -> Openings {
        if world.sky.is_black() {
            return Openings::default();
        }
        let n = cut.patches().len();
        let part = |share: f32, p: usize| (share * links.row(p).len() as f32) as usize;
        let light = |d: Vec3| (number(d), luminance(world.sky.radiance(d)));
        let mut cubes: BTreeMap<(i32, [i32; 3]), Cube> = BTreeMap::new();
        for first in (0..n).step_by(BLOCK) {
            let found: Vec<(usize, Vec<(u16, f32)>)> = (first..n.min(first + BLOCK))
                .into_par_iter()
                .with_min_len(64)
                .filter(|&p| !cut.patches()[p].hidden && links.escaped_rays(p) <= part(OUTDOORS, p))
                .map(|p| {
                    let directions = links.escaped(world, cut, PatchId(p as u32));
                    (p, directions.map(light).collect())
                })
                .collect();
            for (p, found) in found {
                let cube = cubes.entry(cube_of(world, cut, p, CUBE)).or_default();
                if found.len() <= part(SELDOM, p) {
                    cube.patches.push(p as u32);
                }
                cube.escaped += found.len();
                for (number, light) in found {
                    *cube.light.entry(number).or_default() += light;
                }
            }
        }
        Openings::of_cubes(n, cubes.values())
    }

    fn of_cubes<'c>(patches: usize, cubes: impl Iterator<Item = &'c Cube>) -> Openings {
        let mut out = Openings {
            of_patch: vec![NONE; patches],
            starts: vec![0],
            bins: Vec::new(),
        };
        for cube in cubes {
            let all: f32 = cube.light.values().sum();
            let kept = || (cube.light.iter()).filter(|(_, light)| **light > SMALL * all);
            let total: f32 = kept().map(|(_, light)| light).sum();
            if cube.patches.is_empty() || cube.escaped < LEAST || total <= 0.0 {
                continue;
            }
            let set = (out.starts.len() - 1) as u32;
            (cube.patches.iter()).for_each(|&p| out.of_patch[p as usize] = set);
            let mut running = 0.0;
            out.bins.extend(kept().map(|(&number, &light)| {
                running += light / total;
                Bin { number, running }
            }));
            out.starts.push(out.bins.len() as u32);
        }
        out
    }

    /// The directions of the sky from near a patch; `None` if its own rays find the sky often, or
    /// none of its neighbours' do.
    #[inline]
    pub fn of(&self, patch: PatchId) -> Option<Opening<'_>> {
        let set = *self.of_patch.get(patch.0 as usize)?;
        let to = *self.starts.get((set as usize).checked_add(1)?)?;
        let bins = &self.bins[self.starts[set as usize] as usize..to as usize];
        Some(Opening { bins })
    }

    /// Whether it belongs to that many patches.
    pub(crate) fn fits(&self, patches: usize) -> bool {
        let ends = self
            .starts
            .last()
            .is_none_or(|&n| n as usize == self.bins.len());
        (self.of_patch.is_empty() || self.of_patch.len() == patches)
            && ends
            && self.starts.is_sorted_by(|a, b| a < b)
            && self
                .bins
                .iter()
                .all(|b| usize::from(b.number) < ROWS * COLUMNS)
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (4 * (self.of_patch.len() + self.starts.len()) + size_of_val(&self.bins[..])) as u64
    }
}

impl Opening<'_> {
    /// Draws a unit direction from two random numbers; also returns its [`density`](Self::density).
    pub fn draw(&self, x: f32, y: f32) -> (Vec3, f32) {
        let last = self.bins.len() - 1;
        let k = self.bins.partition_point(|b| b.running <= x).min(last);
        let share = self.share(k);
        let within = ((x - self.bins[k].running) / share + 1.0).clamp(0.0, 1.0);
        let number = usize::from(self.bins[k].number);
        let (row, column) = (number / COLUMNS, number % COLUMNS);
        let up = 2.0 * (row as f32 + y) / ROWS as f32 - 1.0;
        let turn = ((column as f32 + within) / COLUMNS as f32 - 0.5) * TAU;
        let (sin, cos) = libm::sincosf(turn);
        let level = (1.0 - up * up).max(0.0).sqrt();
        let direction = Vec3::new(level * cos, up, level * sin);
        (direction, share / SOLID_ANGLE)
    }

    /// Probability density per solid angle of drawing a unit direction.
    #[inline]
    pub fn density(&self, direction: Vec3) -> f32 {
        let number = number(direction);
        match self.bins.binary_search_by_key(&number, |b| b.number) {
            Ok(k) => self.share(k) / SOLID_ANGLE,
            Err(_) => 0.0,
        }
    }

    fn share(&self, k: usize) -> f32 {
        let before = k.checked_sub(1).map_or(0.0, |k| self.bins[k].running);
        self.bins[k].running - before
    }
}

/// The number of a direction: rows by height, columns around the vertical axis.
#[inline]
fn number(direction: Vec3) -> u16 {
    let row = (0.5 * (direction.y + 1.0) * ROWS as f32) as usize;
    let turn = 0.5 + libm::atan2f(direction.z, direction.x) / TAU;
    let column = (turn * COLUMNS as f32) as usize;
    (row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)) as u16
}

/// The cube that a patch is in, `edge` patches wide, by the size of its patches: most have the same,
/// but that of a plain is larger.
pub(crate) fn cube_of(
    world: &World,
    cut: &Subdivision,
    patch: usize,
    edge: f32,
) -> (i32, [i32; 3]) {
    let element = cut.elements()[cut.patches()[patch].first_element as usize];
    let [a, b, c] = world.soup.triangles[element.triangle as usize];
    let at = a + (b - a) * element.u + (c - a) * element.v;
    let size = libm::ilogbf(cut.patch_edge(element.triangle));
    let cube = at / (edge * libm::ldexpf(1.0, size));
    (size, cube.floor().as_ivec3().to_array())
}

#[cfg(test)]
mod tests;
