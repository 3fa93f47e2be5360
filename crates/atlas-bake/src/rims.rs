//! What the lit side of a thin wall gives up for the dark one.
//!
//! Beside a wall thinner than a lookup's reach, lookups in the dark read a lumel that lies in the light. One value cannot serve both sides. A bright
//! line along the foot of a wall in a dark room is the worse fault: it looks like light that comes through. So where one side is black beside the other, that
//! lumel takes the dark side's light, and the lit side has a dark rim of a lumel or so. Where both have some light, each keeps its own.

use glam::Vec2;
use radiosity::{World, luminance};
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::gather::Received;
use crate::lumels::{Lumels, TexelIndex};
use crate::walls::LIFT;

/// One side is black beside the other below this share of its light. A wall in the sun has its own shade behind it, some hundredths of the sunny side, and no
/// line on either of its sides is right or wrong there.
const BLACK: f32 = 0.02;

/// Points of a dark lumel whose lookups are tried.
const POINTS: u32 = 24;

/// A lumel that counts less than this in a lookup shows nothing there. What is left of it is at most the goal of half a per cent times four, on a
/// few points right at the wall.
const SHOWN: f32 = 0.02;

const AROUND: [[i64; 2]; 8] = [
    [0, -1],
    [-1, 0],
    [1, 0],
    [0, 1],
    [-1, -1],
    [1, -1],
    [-1, 1],
    [1, 1],
];

/// Gives lumels that lookups behind a wall read the dark light there.
pub(crate) fn darken_rims(
    world: &World,
    lumels: &Lumels,
    layout: &Layout,
    received: &mut [Received],
) {
    let index = TexelIndex::build(&lumels.lumels, layout);
    let found: Vec<(usize, usize)> = (0..received.len())
        .into_par_iter()
        .with_min_len(256)
        .filter_map(|i| Some((i, dark_side(world, lumels, &index, received, i)?)))
        .collect();
    // All from what they were: a rim does not spread.
    let light: Vec<Received> = (found.iter())
        .map(|&(i, from)| Received {
            position: received[i].position,
            normal: received[i].normal,
            size: received[i].size,
            open: received[i].open,
            near: received[i].near,
            rays: received[i].rays,
            edge: received[i].edge,
            ..received[from].clone()
        })
        .collect();
    for ((i, _), light) in found.into_iter().zip(light) {
        received[i] = light;
    }
}

fn light(r: &Received) -> f32 {
    luminance(r.direct + r.indirect)
}

/// The black lumel behind a wall, lookups in which read lumel `i`: the darkest of them.
fn dark_side(
    world: &World,
    lumels: &Lumels,
    index: &TexelIndex,
    received: &[Received],
    i: usize,
) -> Option<usize> {
    let (l, own) = (&lumels.lumels[i], &received[i]);
    if !own.near || own.open == 0.0 || light(own) <= 0.0 {
        return None;
    }
    let [x, y] = l.texel.map(i64::from);
    let mut dark: Vec<usize> = (AROUND.into_iter())
        .filter_map(|[dx, dy]| index.at(l.page, x + dx, y + dy))
        .filter(|&j| lumels.lumels[j].instance == l.instance)
        .filter(|&j| received[j].near && received[j].open > 0.0)
        .filter(|&j| received[j].normal.dot(own.normal) > 0.5)
        .filter(|&j| light(&received[j]) < BLACK * light(own))
        .collect();
    dark.sort_by(|&a, &b| (light(&received[a]).total_cmp(&light(&received[b]))).then(a.cmp(&b)));
    let centre = Vec2::new(l.texel[0] as f32, l.texel[1] as f32) + 0.5;
    let lift = LIFT * own.size;
    let here = own.point(world);
    dark.into_iter().find(|&j| {
        let there = received[j].point(world);
        // A shadow that ends here without a wall is no leak.
        if !world.wall_between(&here, &there, lift) {
            return false;
        }
        let (footprint, _) = lumels.footprint(world, j);
        (0..POINTS).any(|k| {
            footprint.placed(k).is_some_and(|(at, p)| {
                let away = (at - centre).abs();
                let weight = (1.0 - away.x).max(0.0) * (1.0 - away.y).max(0.0);
                weight > SHOWN
                    && !world.wall_between(&p, &there, lift)
                    && world.wall_between(&p, &here, lift)
            })
        })
    })
}
