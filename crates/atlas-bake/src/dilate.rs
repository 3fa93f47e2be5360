//! Dilation: empty texels take their neighbours' values, so that bilinear lookups at chart borders
//! read light instead of black.

use atlas::Rect;

use crate::page::Page;
use crate::seams::EMPTY;

/// Fills empty texels of `rect` from filled ones, in `rings` rings. `charts` gives the piece of
/// surface that a texel's value comes from, or [`EMPTY`], and is updated. `readers` gives the piece
/// whose lookups read an empty texel. Nothing outside `rect` is read or written.
///
/// A new texel is the mean of its filled neighbours to the left, right, top and bottom; only if
/// there are none, of the diagonal ones, which are farther away and may belong to another surface.
///
/// A texel that is read by lookups on one piece takes no values from another, whose lumels may be
/// direct neighbours.
pub(crate) fn dilate(page: &mut Page, charts: &mut [u32], readers: &[u32], rect: Rect, rings: u32) {
    let width = page.width as usize;
    let index = |x: u32, y: u32| y as usize * width + x as usize;
    let mut frontier: Vec<(u32, u32)> = Vec::new();
    for y in rect.y..rect.y + rect.h {
        for x in rect.x..rect.x + rect.w {
            if charts[index(x, y)] == EMPTY
                && neighbours(rect, x, y).any(|(x, y, _)| charts[index(x, y)] != EMPTY)
            {
                frontier.push((x, y));
            }
        }
    }
    for ring in 0..rings {
        let filled: Vec<(usize, Fill)> = frontier
            .iter()
            .filter_map(|&(x, y)| {
                let fill = mean_of_neighbours(page, charts, readers, rect, x, y)?;
                Some((index(x, y), fill))
            })
            .collect();
        for (at, fill) in filled {
            charts[at] = fill.chart;
            fill.store(page, at);
        }
        if ring + 1 == rings {
            break;
        }
        let mut next: Vec<(u32, u32)> = frontier
            .iter()
            .flat_map(|&(x, y)| neighbours(rect, x, y).map(|(x, y, _)| (y, x)))
            .filter(|&(y, x)| charts[index(x, y)] == EMPTY)
            .collect();
        next.sort_unstable();
        next.dedup();
        frontier = next.into_iter().map(|(y, x)| (x, y)).collect();
    }
}

/// Value and layers for one texel, and the piece of surface of its first neighbour.
struct Fill {
    value: [f32; 3],
    layers: Vec<f32>,
    chart: u32,
}

impl Fill {
    /// Stores the values in texel `at`. Coverage stays 0, because dilation adds no surface.
    fn store(self, page: &mut Page, at: usize) {
        page.value[at] = self.value;
        for (layer, v) in page.layers.iter_mut().zip(self.layers) {
            if layer.0 != "coverage.Y" {
                layer.1[at] = v;
            }
        }
    }
}

/// Mean of the usable filled texels around (x, y) in `rect`; `None` if there are none.
fn mean_of_neighbours(
    page: &Page,
    charts: &[u32],
    readers: &[u32],
    rect: Rect,
    x: u32,
    y: u32,
) -> Option<Fill> {
    let index = |x: u32, y: u32| y as usize * page.width as usize + x as usize;
    let reader = readers[index(x, y)];
    let serves = |chart: u32| chart != EMPTY && (reader == EMPTY || chart == reader);
    let filled = || neighbours(rect, x, y).filter(|&(x, y, _)| serves(charts[index(x, y)]));
    let beside = filled().any(|(.., corner)| !corner);
    let mut fill = Fill {
        value: [0.0; 3],
        layers: vec![0.0; page.layers.len()],
        chart: EMPTY,
    };
    let mut count = 0f32;
    for (nx, ny, corner) in filled() {
        if corner && beside {
            continue;
        }
        let at = index(nx, ny);
        for (s, v) in fill.value.iter_mut().zip(page.value[at]) {
            *s += v;
        }
        for (s, l) in fill.layers.iter_mut().zip(&page.layers) {
            *s += l.1[at];
        }
        if count == 0.0 {
            fill.chart = charts[at];
        }
        count += 1.0;
    }
    if count == 0.0 {
        return None;
    }
    for v in fill.value.iter_mut().chain(&mut fill.layers) {
        *v /= count;
    }
    Some(fill)
}

/// The texels around (x, y) inside `rect`, and whether each is diagonal.
fn neighbours(rect: Rect, x: u32, y: u32) -> impl Iterator<Item = (u32, u32, bool)> {
    (-1i64..=1).flat_map(move |dy| {
        (-1i64..=1).filter_map(move |dx| {
            let (nx, ny) = (x as i64 + dx, y as i64 + dy);
            let inside = nx >= rect.x as i64
                && ny >= rect.y as i64
                && nx < (rect.x + rect.w) as i64
                && ny < (rect.y + rect.h) as i64;
            ((dx, dy) != (0, 0) && inside).then_some((nx as u32, ny as u32, dx * dy != 0))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> (Page, Vec<u32>) {
        let page = Page {
            width: 8,
            height: 8,
            value: vec![[0.0; 3]; 64],
            coverage: vec![0.0; 64],
            layers: vec![("direct.R".into(), vec![0.0; 64])],
        };
        (page, vec![EMPTY; 64])
    }

    #[test]
    fn fills_rings_inside_the_rectangle_only() {
        let (mut page, mut charts) = page();
        page.value[3 * 8 + 3] = [2.0, 4.0, 6.0];
        charts[3 * 8 + 3] = 5;
        let rect = Rect {
            x: 2,
            y: 2,
            w: 6,
            h: 6,
        };
        dilate(&mut page, &mut charts, &[EMPTY; 64], rect, 2);
        // Two rings around (3, 3), clipped at the rectangle's left and top edge (2).
        let filled = charts.iter().filter(|c| **c == 5).count();
        assert_eq!(filled, 16);
        assert_eq!(page.value[5 * 8 + 5], [2.0, 4.0, 6.0]);
        assert_eq!(page.value[8 + 3], [0.0; 3]);
    }

    #[test]
    fn corners_count_only_where_nothing_is_nearer() {
        let (mut page, mut charts) = page();
        // Two surfaces: one above the row, the other diagonal to (3, 3).
        for (x, y, v, chart) in [(3, 2, 1.0, 0), (4, 4, 9.0, 1)] {
            page.value[y * 8 + x] = [v; 3];
            page.layers[0].1[y * 8 + x] = v;
            charts[y * 8 + x] = chart;
        }
        let rect = Rect {
            x: 0,
            y: 0,
            w: 8,
            h: 8,
        };
        let (fresh, fresh_charts) = (page.clone(), charts.clone());
        let mut readers = vec![EMPTY; 64];
        dilate(&mut page, &mut charts, &readers, rect, 1);
        assert_eq!((page.value[3 * 8 + 3], charts[3 * 8 + 3]), ([1.0; 3], 0));
        assert_eq!(page.layers[0].1[3 * 8 + 3], 1.0);
        assert_eq!(page.value[5 * 8 + 5], [9.0; 3]);
        // Unless lookups of the other surface read the texel.
        (page, charts) = (fresh, fresh_charts);
        readers[3 * 8 + 3] = 1;
        dilate(&mut page, &mut charts, &readers, rect, 1);
        assert_eq!((page.value[3 * 8 + 3], charts[3 * 8 + 3]), ([9.0; 3], 1));
    }
}
