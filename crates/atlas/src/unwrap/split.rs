//! Splits charts that leave most of their box empty, e.g. the ring road of a level.

use rayon::prelude::*;

use super::charts::{Charts, Shape, cross2};
use super::input::{NONE, UnwrapInput};

/// A chart is split if the empty part of its box exceeds this fraction of all charts' area, which
/// other charts cannot fill.
const EMPTY: f64 = 0.5;

/// Smaller charts are not split, lumels²: a border costs more than it saves.
const MIN_AREA: f64 = 256.0;

/// Most halvings.
const ROUNDS: usize = 8;

/// Halves hollow charts across their longer sides until none is left.
pub(super) fn split_hollow(mesh: &UnwrapInput, charts: &mut Charts, lumel: f64) {
    let all: f64 = charts.corners.iter().map(|c| 0.5 * cross2(c)).sum();
    for _ in 0..ROUNDS {
        let mut areas = vec![0.0; charts.count as usize];
        for (c, &chart) in charts.corners.iter().zip(&charts.chart) {
            areas[chart as usize] += 0.5 * cross2(c);
        }
        let large = |c: usize| areas[c] > MIN_AREA * lumel * lumel;
        let shapes: Vec<Shape> = charts
            .by_chart()
            .into_par_iter()
            .enumerate()
            .filter(|(c, _)| large(*c))
            .map(|(_, list)| Shape::new(charts, list))
            .collect();
        let hollow: Vec<&Shape> = shapes
            .iter()
            .filter(|s| s.extent.x * s.extent.y - s.area > EMPTY * all)
            .collect();
        if hollow.is_empty() {
            return;
        }
        for shape in hollow {
            cut(mesh, charts, shape);
        }
    }
}

/// Splits `shape` at the middle of its longer side; every connected part becomes a chart, and the
/// first keeps its number.
fn cut(mesh: &UnwrapInput, charts: &mut Charts, shape: &Shape) {
    let old = charts.chart[shape.triangles[0] as usize];
    let middle = shape.extent.x * 0.5;
    // Two unused numbers mark the halves that are not assigned yet.
    let marks = [u32::MAX - 1, u32::MAX];
    for (&t, c) in shape.triangles.iter().zip(&shape.corners) {
        let right = c[0].x + c[1].x + c[2].x > 3.0 * middle;
        charts.chart[t as usize] = marks[usize::from(right)];
    }
    let mut next = old;
    let mut stack = Vec::new();
    for &seed in &shape.triangles {
        let mark = charts.chart[seed as usize];
        if !marks.contains(&mark) {
            continue;
        }
        charts.chart[seed as usize] = next;
        stack.push(seed);
        while let Some(t) = stack.pop() {
            for k in 0..3 {
                let u = mesh.neighbors[t as usize][k];
                if u != NONE && charts.chart[u as usize] == mark {
                    charts.chart[u as usize] = next;
                    stack.push(u);
                }
            }
        }
        if next == old {
            next = charts.count;
        } else {
            next += 1;
        }
    }
    charts.count = charts.count.max(next);
}
