//! Small charts as SVG.

use super::html::{escape, short};

/// Width and height of charts with room for labels.
const SIZE: [f64; 2] = [640.0, 220.0];
const LEFT: f64 = 64.0;
/// Half the width of a label such as "100 %", which extends past the axis.
const RIGHT: f64 = 26.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 38.0;

/// Height of the legend above a chart of several lines.
const LEGEND: f64 = 18.0;

/// A line of a chart. Lines with the same name are pieces of one curve.
pub(super) struct Line<'a> {
    pub name: &'a str,
    /// `la`, `lb` or `lc`.
    pub class: &'a str,
    pub points: Vec<[f64; 2]>,
}

/// A line chart over a linear x; y is logarithmic if `log`, which leaves out non-positive points.
/// The legend appears if there is more than one name.
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
    let (low, high) = range(&|p| map(p[1]));
    // Ticks at whole decades, or at 1, 2 or 5 times a power of ten. The chart begins and ends at a
    // tick.
    let step = if log {
        ((high.ceil() - low.floor()) / 6.0).ceil().max(1.0)
    } else {
        round_step((high - low.min(0.0)) / 4.0)
    };
    let low = if log { low } else { low.min(0.0) };
    let (y0, y1) = ((low / step).floor() * step, (high / step).ceil() * step);
    let mut names: Vec<&Line<'_>> = Vec::new();
    for line in lines {
        if names.iter().all(|n| n.name != line.name) {
            names.push(line);
        }
    }
    let top = TOP + if names.len() > 1 { LEGEND } else { 0.0 };
    let at = |x: f64, y: f64| {
        (
            LEFT + (x - x0) / (x1 - x0) * (SIZE[0] - LEFT - RIGHT),
            SIZE[1] - BOTTOM - (y - y0) / (y1 - y0) * (SIZE[1] - top - BOTTOM),
        )
    };
    let mut out = open(title);
    for k in 0..=((y1 - y0) / step).round() as u32 {
        let t = y0 + f64::from(k) * step;
        let (_, y) = at(x0, t);
        out += &format!(
            "<path class=\"grid\" d=\"M{LEFT:.1} {y:.1}H{:.1}\"/>",
            SIZE[0] - RIGHT
        );
        let label = if log { format!("1e{t:.0}") } else { mark(t) };
        out += &text(LEFT - 6.0, y + 4.0, "end", &label);
    }
    for (x, anchor) in [(x0, "start"), (x1, "end")] {
        let label = SIZE[1] - BOTTOM + 15.0;
        out += &text(at(x, y0).0, label, anchor, &mark(x));
    }
    out += &text(0.5 * (LEFT + SIZE[0]), SIZE[1] - 6.0, "middle", x_title);
    for line in lines {
        let points: Vec<String> = (line.points.iter().filter(|p| sound(p)))
            .map(|p| {
                let (x, y) = at(p[0], map(p[1]));
                format!("{x:.1},{y:.1}")
            })
            .collect();
        out += &format!(
            "<polyline class=\"{}\" points=\"{}\"/>",
            line.class,
            points.join(" ")
        );
    }
    let wide = (SIZE[0] - LEFT - RIGHT) / names.len() as f64;
    for (i, line) in names.iter().enumerate().filter(|_| names.len() > 1) {
        let x = LEFT + wide * i as f64;
        out += &format!(
            "<path class=\"{}\" stroke-width=\"2\" d=\"M{x:.1} {TOP:.1}h16\"/>",
            line.class,
        );
        // About seven units per letter; a longer name would overlap the next.
        let room = ((wide - 30.0) / 7.0).max(1.0) as usize;
        let name: String = line.name.chars().take(room).collect();
        out += &text(x + 22.0, TOP + 4.0, "start", &name);
    }
    out + "</svg>\n"
}

/// The next of 1, 2, 5, 10, … times a power of ten.
fn round_step(least: f64) -> f64 {
    let ten = 10f64.powf(least.log10().floor());
    let step = [1.0, 2.0, 5.0].map(|k| k * ten);
    step.into_iter().find(|s| *s >= least).unwrap_or(10.0 * ten)
}

/// A figure at an axis, without trailing zeros.
pub(super) fn mark(x: f64) -> String {
    let figure = short(x);
    if figure.contains('e') || !figure.contains('.') {
        return figure;
    }
    figure
        .trim_end_matches('0')
        .trim_end_matches('.')
        .to_owned()
}

/// A fraction at an axis, as a percentage.
pub(super) fn percent_mark(x: f64) -> String {
    format!("{} %", mark(100.0 * x))
}

/// A histogram: bin heights, and labels at bin borders (index, text).
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
    out += &text(LEFT - 6.0, TOP + 8.0, "end", &percent_mark(most));
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

    fn flat<'a>(name: &'a str, class: &'a str) -> Line<'a> {
        Line {
            name,
            class,
            points: vec![[0.0, 1.0], [0.0, 1.0]],
        }
    }

    #[test]
    fn equal_values_still_make_a_chart() {
        for log in [false, true] {
            let svg = lines("t", "x", &[flat("<n>", "la")], log);
            assert!(svg.contains("polyline") && !svg.contains("NaN"), "{svg}");
        }
    }

    #[test]
    fn names_are_shown_once_and_only_where_there_are_several() {
        let one = lines("t", "x", &[flat("<n>", "la"), flat("<n>", "la")], false);
        assert!(!one.contains("&lt;n&gt;"), "{one}");
        let names = ["<n>", "b", "<n>"];
        let two = lines("t", "x", &names.map(|n| flat(n, "la")), false);
        assert_eq!(two.matches("&lt;n&gt;").count(), 1, "{two}");
        assert_eq!(two.matches("polyline").count(), 3);
    }

    #[test]
    fn axes_have_round_figures() {
        let line = Line {
            name: "n",
            class: "la",
            points: vec![[0.0, 0.0], [82.0, 6822.0]],
        };
        let svg = lines("t", "x", &[line], false);
        for label in [">0<", ">2000<", ">4000<", ">6000<", ">8000<", ">82<"] {
            assert!(svg.contains(label), "{label} in {svg}");
        }
        let of = [0.3, 0.02, 7.0, 1000.0].map(round_step);
        assert_eq!(of, [0.5, 0.02, 10.0, 1000.0]);
        assert_eq!(percent_mark(0.1), "10 %");
    }
}
