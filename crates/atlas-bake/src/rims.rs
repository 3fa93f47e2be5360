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
use crate::walls::{Barriers, LIFT};

/// One side is black beside the other below this share of its light. A wall in the sun has its own shade behind it, some hundredths of the sunny side, and no
/// line on either of its sides is right or wrong there.
const BLACK: f32 = 0.02;

/// Points of a dark lumel whose lookups are tried.
const POINTS: u32 = 24;

/// A lumel that counts less than this in a lookup shows nothing there. What is left of it is at most the goal of half a per cent times four, on a
/// few points right at the wall.
const SHOWN: f32 = 0.02;

/// Lumels that the dark side has at least, in one piece. What is smaller is the inside of a post or a crate, which nobody sees: its surroundings must not
/// turn black for it.
const ROOM: usize = 36;

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

/// Gives lumels that lookups behind a wall read the dark light there; says which.
pub(crate) fn darken_rims(
    world: &World,
    lumels: &Lumels,
    layout: &Layout,
    received: &mut [Received],
    barriers: &Barriers,
) -> Vec<usize> {
    let index = TexelIndex::build(&lumels.lumels, layout);
    let page = Page {
        lumels,
        index: &index,
        received,
        barriers,
    };
    let found: Vec<(usize, usize)> = (0..received.len())
        .into_par_iter()
        .with_min_len(256)
        .filter_map(|i| Some((i, page.dark_side(world, i)?)))
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
    let rims: Vec<usize> = found.into_iter().map(|f| f.0).collect();
    for (&i, light) in rims.iter().zip(light) {
        received[i] = light;
    }
    rims
}

fn light(r: &Received) -> f32 {
    luminance(r.direct + r.indirect)
}

/// What is known of the lumels.
struct Page<'a> {
    lumels: &'a Lumels,
    index: &'a TexelIndex,
    received: &'a [Received],
    barriers: &'a Barriers,
}

impl Page<'_> {
    /// The lumels of the same instance around lumel `i` of which something can be seen.
    fn around(&self, i: usize) -> impl Iterator<Item = usize> {
        let l = &self.lumels.lumels[i];
        let [x, y] = l.texel.map(i64::from);
        (AROUND.into_iter())
            .filter_map(move |[dx, dy]| self.index.at(l.page, x + dx, y + dy))
            .filter(|&j| self.lumels.lumels[j].instance == l.instance)
            .filter(|&j| self.received[j].open > 0.0)
    }

    /// The black lumel behind a wall, lookups in which read lumel `i`: the darkest of them.
    fn dark_side(&self, world: &World, i: usize) -> Option<usize> {
        let (l, own) = (&self.lumels.lumels[i], &self.received[i]);
        if !own.near || own.open == 0.0 || light(own) <= 0.0 {
            return None;
        }
        let black = BLACK * light(own);
        let mut dark: Vec<usize> = (self.around(i))
            .filter(|&j| self.received[j].near && light(&self.received[j]) < black)
            .filter(|&j| self.received[j].normal.dot(own.normal) > 0.5)
            .collect();
        dark.sort_by(|&a, &b| {
            let [a_light, b_light] = [a, b].map(|j| light(&self.received[j]));
            a_light.total_cmp(&b_light).then(a.cmp(&b))
        });
        let centre = Vec2::new(l.texel[0] as f32, l.texel[1] as f32) + 0.5;
        let lift = LIFT * own.size;
        let here = own.point(world);
        dark.into_iter().find(|&j| {
            let there = self.received[j].point(world);
            // A shadow that ends here without a wall is no leak.
            if !world.wall_between(&here, &there, lift) || !self.is_room(j, black) {
                return false;
            }
            let (footprint, _) = self.lumels.footprint(world, j);
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

    /// Whether lumel `j` is one of at least [`ROOM`] in one piece that have less light than `black`.
    fn is_room(&self, j: usize, black: f32) -> bool {
        let mut piece = vec![j];
        let mut from = 0;
        while from < piece.len() && piece.len() < ROOM {
            let i = piece[from];
            from += 1;
            for next in self.around(i) {
                let beside = self.lumels.lumels[i].texel;
                let there = self.lumels.lumels[next].texel;
                let shares_edge = beside[0] == there[0] || beside[1] == there[1];
                if shares_edge
                    && light(&self.received[next]) < black
                    && !self.barriers.between(self.lumels, i, next)
                    && !piece.contains(&next)
                {
                    piece.push(next);
                }
            }
        }
        piece.len() >= ROOM
    }
}
