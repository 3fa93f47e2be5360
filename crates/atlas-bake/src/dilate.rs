//! Dilation: texels without a value of their own take their neighbours', so that bilinear lookups at chart borders read light
//! and not the void.

use crate::atlas::{Page, Rect};

/// Fills empty texels of `rect` from filled ones, ring by ring, `rings` times. `own` says which texels have a value, and is
/// updated. Reads and writes nothing outside `rect`.
///
/// A new texel is the mean of its filled neighbours, diagonal ones counting half.
pub(crate) fn dilate(page: &mut Page, own: &mut [bool], rect: Rect, rings: u32) {
    let width = page.width as usize;
    let index = |x: u32, y: u32| y as usize * width + x as usize;
    let mut frontier: Vec<(u32, u32)> = Vec::new();
    for y in rect.y..rect.y + rect.h {
        for x in rect.x..rect.x + rect.w {
            if !own[index(x, y)] && touches(own, rect, x, y, index) {
                frontier.push((x, y));
            }
        }
    }
    for ring in 0..rings {
        let filled: Vec<(usize, Fill)> = frontier
            .iter()
            .filter_map(|&(x, y)| Some((index(x, y), mean_of_neighbours(page, own, rect, x, y)?)))
            .collect();
        for (at, fill) in filled {
            fill.store(page, at);
            own[at] = true;
        }
        if ring + 1 == rings {
            break;
        }
        let mut next: Vec<(u32, u32)> = frontier
            .iter()
            .flat_map(|&(x, y)| neighbours(rect, x, y).map(|(x, y, _)| (y, x)))
            .filter(|&(y, x)| !own[index(x, y)])
            .collect();
        next.sort_unstable();
        next.dedup();
        frontier = next.into_iter().map(|(y, x)| (x, y)).collect();
    }
}

/// Value and layers for one texel.
struct Fill {
    value: [f32; 3],
    layers: Vec<f32>,
}

impl Fill {
    /// Writes it to texel `at`. Coverage stays: it says what is surface, and dilation adds none.
    fn store(self, page: &mut Page, at: usize) {
        page.value[at] = self.value;
        for (layer, v) in page.layers.iter_mut().zip(self.layers) {
            if layer.0 != "coverage.Y" {
                layer.1[at] = v;
            }
        }
    }
}

/// Mean of the filled texels about (x, y) in `rect`, diagonal ones counting half; `None` where there is none.
fn mean_of_neighbours(page: &Page, own: &[bool], rect: Rect, x: u32, y: u32) -> Option<Fill> {
    let (mut value, mut weight) = ([0f32; 3], 0f32);
    let mut layers = vec![0f32; page.layers.len()];
    for (nx, ny, w) in neighbours(rect, x, y) {
        let at = ny as usize * page.width as usize + nx as usize;
        if own[at] {
            for (s, v) in value.iter_mut().zip(page.value[at]) {
                *s += w * v;
            }
            for (s, l) in layers.iter_mut().zip(&page.layers) {
                *s += w * l.1[at];
            }
            weight += w;
        }
    }
    (weight > 0.0).then(|| Fill {
        value: value.map(|s| s / weight),
        layers: layers.into_iter().map(|s| s / weight).collect(),
    })
}

fn touches(own: &[bool], rect: Rect, x: u32, y: u32, index: impl Fn(u32, u32) -> usize) -> bool {
    neighbours(rect, x, y).any(|(x, y, _)| own[index(x, y)])
}

/// The texels about (x, y) inside `rect`, with weights.
fn neighbours(rect: Rect, x: u32, y: u32) -> impl Iterator<Item = (u32, u32, f32)> {
    (-1i64..=1).flat_map(move |dy| {
        (-1i64..=1).filter_map(move |dx| {
            let (nx, ny) = (x as i64 + dx, y as i64 + dy);
            let inside = nx >= rect.x as i64
                && ny >= rect.y as i64
                && nx < (rect.x + rect.w) as i64
                && ny < (rect.y + rect.h) as i64;
            let weight = if dx == 0 || dy == 0 { 1.0 } else { 0.5 };
            ((dx, dy) != (0, 0) && inside).then_some((nx as u32, ny as u32, weight))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fills_rings_inside_the_rectangle_only() {
        let mut page = Page {
            width: 8,
            height: 8,
            value: vec![[0.0; 3]; 64],
            coverage: vec![0.0; 64],
            layers: vec![],
        };
        let mut own = vec![false; 64];
        page.value[3 * 8 + 3] = [2.0, 4.0, 6.0];
        own[3 * 8 + 3] = true;
        dilate(
            &mut page,
            &mut own,
            Rect {
                x: 2,
                y: 2,
                w: 6,
                h: 6,
            },
            2,
        );
        // Two rings about (3, 3), cut at the rectangle's left and top edge (2).
        let filled = own.iter().filter(|o| **o).count();
        assert_eq!(filled, 16);
        assert_eq!(page.value[5 * 8 + 5], [2.0, 4.0, 6.0]);
        assert_eq!(page.value[8 + 3], [0.0; 3]);
    }
}
