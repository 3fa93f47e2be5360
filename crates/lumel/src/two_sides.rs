//! Warns about sheets that have different light on their two sides.
//!
//! A double-sided face has one place in the lightmap, which holds the light of its front. On a wall
//! without thickness between a bright and a dark room, one side is wrong. [`split`](crate::split)
//! gives such sides separate faces; this warns about those that it cannot split, or of which it
//! takes one side for the outside of the level.

use radiosity::{Solution, World, luminance};

use crate::named::{node_of, some_of};
use crate::split::each_side;

/// Ratio of the light on the two sides that gives a warning: two stops.
const RATIO: f64 = 4.0;

/// Below this fraction of the scene's mean light, a side is taken to be invisible, e.g. the inside
/// of a closed box.
const UNLIT: f64 = 0.01;

/// Light of an instance's sheets, irradiance × area by side: front, back.
#[derive(Clone, Copy, Default)]
struct Sides {
    light: [f64; 2],
    area: [f64; 2],
}

impl Sides {
    /// Mean irradiance of front and back; `None` if there are not two sides.
    fn means(&self) -> Option<[f64; 2]> {
        let [front, back] = self.area;
        (front > 0.0 && back > 0.0).then(|| [self.light[0] / front, self.light[1] / back])
    }

    fn differ(&self, mean: f64) -> Option<[f64; 2]> {
        let [front, back] = self.means()?;
        let (low, high) = (front.min(back), front.max(back));
        (low > UNLIT * mean && high > RATIO * low).then_some([front, back])
    }
}

/// Names the nodes, those with the largest sheets first.
pub(crate) fn warning(world: &World, solution: &Solution) -> Option<String> {
    let mean = f64::from(luminance(solution.mean_irradiance().as_vec3()));
    let sides = sides(world, solution);
    let mut found: Vec<(usize, [f64; 2])> = (sides.iter().enumerate())
        .filter_map(|(i, s)| Some((i, s.differ(mean)?)))
        .collect();
    found.sort_by(|a, b| sides[b.0].area[0].total_cmp(&sides[a.0].area[0]));
    let one = |(i, [front, back]): &(usize, [f64; 2])| {
        let name = node_of(world.scene, *i);
        match back > front {
            true => format!("{name} ({:.0} times brighter at the back)", back / front),
            false => format!("{name} ({:.0} times brighter in front)", front / back),
        }
    };
    (!found.is_empty()).then(|| {
        format!(
            "double-sided faces have different light on their two sides: {}; a lightmap has one value for both sides, the front's: give walls a thickness, or each side its own faces",
            some_of(found.iter().map(one))
        )
    })
}

/// Light of the sheets of each instance.
fn sides(world: &World, solution: &Solution) -> Vec<Sides> {
    let mut out = vec![Sides::default(); world.scene.instances.len()];
    each_side(world, solution, |patch| {
        if patch.hidden {
            return;
        }
        let of = &mut out[patch.source.instance as usize];
        let side = usize::from(patch.back);
        of.light[side] += f64::from(luminance(patch.light) * patch.area);
        of.area[side] += f64::from(patch.area);
    });
    out
}
