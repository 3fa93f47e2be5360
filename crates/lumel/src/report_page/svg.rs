//! Small charts as SVG.

use super::html::{escape, short};

/// Width and height of charts, with room for labels.
const SIZE: [f64; 2] = [640.0, 220.0];
const LEFT: f64 = 64.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 38.0;

/// A line of a chart.
pub(super) struct Line<'a> {
    pub name: &'a str,
    /// `la`, `lb` or `lc`.
    pub class: &'a str,
    pub points: Vec<[f64; 2]>,
}

/// A chart of lines over a linear x; y is logarithmic if `log`. Points that a logarithm does not take are left out.
pub(super) fn lines(title: &str, x_title: &str, lines: &[Line<'_>], log: bool) -> String {
    let map = |y: f64| if log { y.log10() } else { y };
    let sound = |p: &[f64; 2]| p[0].is_finite() && map(p[1]).is_finite();
    let all: Vec<[f64; 2]> = lines
        .iter()
        .flat_map(|l| &l.points)
        .copied()
        .filter(sound)
        .collect();
    if all.len() < 2 {
        return String::new();
    }
    let range = |of: &dyn Fn(&[f64; 2]) -> f64| {
        let low = all.iter().map(of).fold(f64::INFINITY, f64::min);
        let high = all.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        (low, if high > low { high } else { low + 1.0 })
    };
    let (x0, x1) = range(&|p| p[0]);
    let (mut y0, mut y1) = range(&|p| map(p[1]));
    if log {
        (y0, y1) = (y0.floor(), y1.ceil());
    } else {
        y0 = y0.min(0.0);
    }
    let at = |p: &[f64; 2]| {
        let x = LEFT + (p[0] - x0) / (x1 - x0) * (SIZE[0] - LEFT - RIGHT);
        let y = SIZE[1] - BOTTOM - (map(p[1]) - y0) / (y1 - y0) * (SIZE[1] - TOP - BOTTOM);
        (x, y)
    };
    let mut out = open(title);
    let ticks: Vec<f64> = if log {
        let step = ((y1 - y0) / 6.0).ceil().max(1.0);
        (0..=((y1 - y0) / step) as u32)
            .map(|k| 10f64.powf(y0 + f64::from(k) * step))
            .collect()
    } else {
        (0..=4)
            .map(|k| y0 + (y1 - y0) * f64::from(k) / 4.0)
            .collect()
    };
    for t in ticks {
        let (_, y) = at(&[x0, t]);
        out += &format!(
            "<path class=\"grid\" d=\"M{LEFT:.1} {y:.1}H{:.1}\"/>",
            SIZE[0] - RIGHT
        );
        let label = if log {
            format!("1e{:.0}", t.log10())
        } else {
            short(t)
        };
        out += &text(LEFT - 6.0, y + 4.0, "end", &label);
    }
    for (x, anchor) in [(x0, "start"), (x1, "end")] {
        out += &text(
            at(&[x, if log { 10f64.powf(y0) } else { y0 }]).0,
            SIZE[1] - BOTTOM + 15.0,
            anchor,
            &short(x),
        );
    }
    out += &text(0.5 * (LEFT + SIZE[0]), SIZE[1] - 6.0, "middle", x_title);
    for (i, line) in lines.iter().enumerate() {
        let points: Vec<String> = (line.points.iter().filter(|p| sound(p)))
            .map(|p| {
                let (x, y) = at(p);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        out += &format!(
            "<polyline class=\"{}\" points=\"{}\"/>",
            line.class,
            points.join(" ")
        );
        let y = TOP + 14.0 + 15.0 * i as f64;
        out += &format!(
            "<path class=\"{}\" stroke-width=\"2\" d=\"M{:.1} {:.1}h16\"/>",
            line.class,
            SIZE[0] - 190.0,
            y - 4.0
        );
        out += &text(SIZE[0] - 168.0, y, "start", line.name);
    }
    out + "</svg>\n"
}

/// A histogram: heights of bins, and labels at borders of bins (index, text).
pub(super) fn histogram(
    title: &str,
    bins: &[f64],
    labels: &[(usize, String)],
    x_title: &str,
) -> String {
    let most = bins.iter().copied().fold(0.0, f64::max);
    if most <= 0.0 {
        return String::new();
    }
    let wide = (SIZE[0] - LEFT - RIGHT) / bins.len() as f64;
    let floor = SIZE[1] - BOTTOM;
    let mut out = open(title);
    for (i, b) in bins.iter().enumerate() {
        let high = b / most * (floor - TOP);
        out += &format!(
            "<rect class=\"a\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{high:.1}\"/>",
            LEFT + wide * i as f64,
            floor - high,
            (wide - 0.5).max(0.5),
        );
    }
    out += &format!(
        "<path class=\"grid\" d=\"M{LEFT:.1} {floor:.1}H{:.1}\"/>",
        SIZE[0] - RIGHT
    );
    for (i, label) in labels {
        out += &text(LEFT + wide * *i as f64, floor + 15.0, "middle", label);
    }
    out += &text(0.5 * (LEFT + SIZE[0]), SIZE[1] - 6.0, "middle", x_title);
    out += &text(LEFT - 6.0, TOP + 8.0, "end", &super::html::percent(most));
    out + "</svg>\n"
}

/// Horizontal bars: name, length, text at the end.
pub(super) fn bars(title: &str, rows: &[(String, f64, String)]) -> String {
    let most = rows.iter().map(|r| r.1).fold(0.0, f64::max);
    if most <= 0.0 {
        return String::new();
    }
    const ROW: f64 = 22.0;
    const NAMES: f64 = 150.0;
    const TEXTS: f64 = 130.0;
    let high = ROW * rows.len() as f64 + 4.0;
    let mut out = format!(
        "<svg viewBox=\"0 0 {:.0} {high:.0}\" width=\"{:.0}\" height=\"{high:.0}\" role=\"img\" aria-label=\"{}\">",
        SIZE[0],
        SIZE[0],
        escape(title)
    );
    for (i, (name, value, label)) in rows.iter().enumerate() {
        let y = ROW * i as f64;
        let wide = value / most * (SIZE[0] - NAMES - TEXTS);
        out += &text(NAMES - 8.0, y + 15.0, "end", name);
        out += &format!(
            "<rect class=\"a\" x=\"{NAMES:.1}\" y=\"{:.1}\" width=\"{wide:.1}\" height=\"14\"/>",
            y + 4.0
        );
        out += &text(NAMES + wide + 6.0, y + 15.0, "start", label);
    }
    out + "</svg>\n"
}

fn open(title: &str) -> String {
    let [w, h] = SIZE;
    format!(
        "<svg viewBox=\"0 0 {w:.0} {h:.0}\" width=\"{w:.0}\" height=\"{h:.0}\" role=\"img\" aria-label=\"{}\">",
        escape(title)
    )
}

fn text(x: f64, y: f64, anchor: &str, text: &str) -> String {
    format!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>",
        escape(text)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_of_nothing_are_nothing() {
        assert_eq!(lines("t", "x", &[], true), "");
        let flat = Line {
            name: "n",
            class: "la",
            points: vec![[0.0, 0.0], [1.0, f64::NAN]],
        };
        assert_eq!(lines("t", "x", &[flat], true), "");
        assert_eq!(histogram("t", &[0.0], &[], "x"), "");
        assert_eq!(bars("t", &[]), "");
    }

    #[test]
    fn equal_values_still_make_a_chart() {
        let flat = Line {
            name: "<n>",
            class: "la",
            points: vec![[0.0, 1.0], [0.0, 1.0]],
        };
        for log in [false, true] {
            let svg = lines(
                "t",
                "x",
                &[Line {
                    name: flat.name,
                    class: "la",
                    points: flat.points.clone(),
                }],
                log,
            );
            assert!(
                svg.contains("polyline") && !svg.contains("NaN") && svg.contains("&lt;n&gt;"),
                "{svg}"
            );
        }
    }
}
