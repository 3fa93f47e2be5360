//! The sections made only from the report's figures.

use serde_json::Value;

use super::Inputs;
use super::html::{Cell, count, list, note, number, percent, short, table, text};
use super::svg::{Line, bars, lines};

fn row(name: &str, value: Option<String>) -> Option<Vec<Cell>> {
    Some(vec![Cell::Text(name.into()), Cell::Number(value?)])
}

/// The most important figures.
pub(super) fn summary(source: &Inputs<'_>) -> String {
    let r = source.report;
    let n = |pointer: &str| number(r, pointer);
    let pages: Vec<String> = list(r, "/layout/pages")
        .iter()
        .map(|p| format!("{} × {}", p[0], p[1]))
        .collect();
    let problems = list(r, "/warnings").len();
    let rows: Vec<_> = [
        row(
            "quality",
            r.pointer("/settings/quality")
                .and_then(Value::as_str)
                .map(str::to_owned),
        ),
        row(
            "estimated error, median over lumels",
            n("/gather/median_error").map(percent),
        ),
        row(
            "estimated error, root mean square",
            n("/gather/estimated_error").map(percent),
        ),
        row("lumels", n("/gather/lumels").map(count)),
        row("lumels per metre", n("/layout/texels_per_unit").map(short)),
        row("pages", (!pages.is_empty()).then(|| pages.join(", "))),
        row("charts", n("/layout/charts").map(count)),
        row("pages filled", n("/layout/coverage").map(percent)),
        row(
            "meshes, instances",
            n("/ingest/totals/meshes")
                .zip(n("/ingest/totals/instances"))
                .map(|(a, b)| format!("{}, {}", count(a), count(b))),
        ),
        row(
            "triangles, with instances",
            n("/ingest/totals/triangles")
                .zip(n("/ingest/totals/triangles_instanced"))
                .map(|(a, b)| format!("{}, {}", count(a), count(b))),
        ),
        row("lightmap quantity", Some(source.manifest.value.clone())),
        row(
            "light groups",
            (!source.manifest.groups.is_empty()).then(|| {
                source
                    .manifest
                    .groups
                    .iter()
                    .map(|g| g.name.as_str())
                    .collect::<Vec<_>>()
                    .join(", ")
            }),
        ),
        row("warnings", Some(problems.to_string())),
        row(
            "time",
            n("/measured/seconds").map(|s| format!("{} s", short(s))),
        ),
        row(
            "peak memory",
            n("/measured/peak_bytes").map(|b| format!("{:.0} MiB", b / 1048576.0)),
        ),
    ]
    .into_iter()
    .flatten()
    .collect();
    table(&[], &rows)
}

/// Residual and flux during the solve, and the energy balance.
pub(super) fn solve(report: &Value) -> String {
    let mut out = String::new();
    let n = |pointer: &str| number(report, pointer);
    let rows: Vec<_> = [
        row("patches", n("/solve/subdivision/patches").map(count)),
        row("elements", n("/solve/subdivision/elements").map(count)),
        row("rays per patch", n("/solve/rays_per_patch").map(count)),
        row(
            "Gauss–Seidel sweeps in the last pass",
            n("/solve/relaxation/sweeps").map(count),
        ),
        row(
            "Bi-CGSTAB iterations",
            n("/solve/relaxation/iterations").map(count),
        ),
        row(
            "residual (upper bound of undistributed light)",
            n("/solve/relaxation/residual").map(percent),
        ),
        row("row sum, mean", n("/solve/audit/row_sum_mean").map(short)),
    ]
    .into_iter()
    .flatten()
    .collect();
    out += &table(&[], &rows);

    out += &history(report);

    let flux = |name: &str| -> Option<[f64; 3]> {
        let list = list(report, &format!("/solve/audit/flux_{name}"));
        Some([
            list.first()?.as_f64()?,
            list.get(1)?.as_f64()?,
            list.get(2)?.as_f64()?,
        ])
    };
    let parts = [
        ("emitted", "emitted"),
        ("absorbed", "absorbed"),
        ("behind", "lost on backfaces"),
        ("escaped", "escaped"),
    ];
    let rows: Vec<_> = (parts.iter())
        .filter_map(|(key, name)| Some((name, flux(key)?)))
        .collect();
    if !rows.is_empty() {
        out += "<h3>Energy, W or lm</h3>\n";
        let chart: Vec<_> = rows
            .iter()
            .map(|(name, f)| ((**name).to_owned(), f.iter().sum(), short(f.iter().sum())))
            .collect();
        out += &bars("Energy", &chart);
        let cells: Vec<Vec<Cell>> = (rows.iter())
            .map(|(name, f)| {
                std::iter::once(Cell::Text((**name).to_owned()))
                    .chain(f.iter().map(|x| Cell::Number(short(*x))))
                    .collect()
            })
            .collect();
        out += &table(&["", "R", "G", "B"], &cells);
        if let (Some(x), Some(bound)) = (n("/solve/audit/imbalance"), n("/solve/audit/bound")) {
            let verdict = match report
                .pointer("/solve/audit/within_bound")
                .and_then(Value::as_bool)
            {
                Some(false) => "more than sampling noise explains",
                _ => "within sampling noise",
            };
            out += &note(&format!(
                "Imbalance {}, {verdict} ({}).",
                percent(x),
                percent(bound)
            ));
        }
    }
    out
}

/// Progress of the solve: residual and flux by step.
fn history(report: &Value) -> String {
    let history = list(report, "/solve/history");
    if history.len() < 2 {
        return note(
            "This report has no history of the solve: it is from an earlier version, or the scene has no light.",
        );
    }
    // Each relaxation counts its sweeps from 0. With light groups, each pass has one relaxation per
    // group.
    let sweeps = |h: &Value| h.get("sweeps").and_then(Value::as_f64).unwrap_or(0.0);
    let mut starts = vec![0];
    starts.extend((1..history.len()).filter(|&i| sweeps(&history[i]) < sweeps(&history[i - 1])));
    let groups: Vec<&str> = (list(report, "/groups").iter())
        .map(|g| text(g, "name"))
        .collect();
    let classes = ["la", "lb", "lc"];
    let curve = |field: &str| -> Vec<Line<'_>> {
        let pieces = starts.iter().enumerate();
        pieces
            .map(|(k, &start)| {
                let end = starts.get(k + 1).copied().unwrap_or(history.len());
                let group = k % groups.len().max(1);
                let steps = (start..end).filter_map(|i| Some((i, history[i].get(field)?)));
                Line {
                    name: groups.get(group).copied().unwrap_or("all light"),
                    class: classes[group % classes.len()],
                    points: steps
                        .filter_map(|(i, y)| Some([i as f64, y.as_f64()?]))
                        .collect(),
                }
            })
            .collect()
    };
    let steps = "sweeps and iterations of all passes";
    let mut out = String::from(
        "<h3>Residual: undistributed light, relative to all light that arrives</h3>\n",
    );
    out += &lines("Residual of the solve", steps, &curve("residual"), true);
    out += "<h3>Indirect flux received, W or lm, sum of R, G and B</h3>\n";
    out += &lines("Indirect flux", steps, &curve("flux"), false);
    let mut remark = String::from(
        "Each pass casts more rays and starts from the previous solution. The residual jumps when more accurate links replace coarse ones.",
    );
    if groups.len() > 1 {
        remark += " In each pass light groups are solved one after the other.";
    }
    out + &note(&remark)
}

/// How far lookups on the two sides of chart borders differ.
pub(super) fn seams(report: &Value) -> String {
    let Some(seams) = report.pointer("/gather/seams").filter(|s| s.is_object()) else {
        return note("Seams were not measured (--no-stitch, or a report from an earlier version).");
    };
    let of = |when: &str, name: &str| -> Option<Vec<Cell>> {
        let get = |field: &str| {
            number(seams, &format!("/{when}/{field}")).map(|x| Cell::Number(percent(x)))
        };
        Some(vec![
            Cell::Text(name.into()),
            get("median")?,
            get("p99")?,
            get("max")?,
        ])
    };
    let rows: Vec<_> = [of("before", "as gathered"), of("after", "stitched")]
        .into_iter()
        .flatten()
        .collect();
    let mut out = table(
        &[
            "difference across chart borders",
            "median",
            "99th percentile",
            "largest",
        ],
        &rows,
    );
    let places = number(seams, "/samples").zip(number(seams, "/metres"));
    if let Some((samples, metres)) = places {
        out += &note(&format!(
            "Sampled at {} points on {} m of chart borders.",
            count(samples),
            short(metres)
        ));
    }
    let moved = number(seams, "/moved_near").zip(number(seams, "/moved_elsewhere"));
    if let Some((near, elsewhere)) = moved {
        out += &note(&format!(
            "Stitching changed lumels at borders by {} and other lumels by {} (root mean square).",
            percent(near),
            percent(elsewhere)
        ));
    }
    out
}

/// Time per phase, and memory.
pub(super) fn time(report: &Value) -> String {
    let phases: Vec<_> = (list(report, "/measured/phases").iter())
        .filter_map(|p| {
            let seconds = p.get("seconds")?.as_f64()?;
            Some((
                text(p, "phase").to_owned(),
                seconds,
                format!("{} s", short(seconds)),
            ))
        })
        .collect();
    let mut out = bars("Time by phase", &phases);
    let n = |pointer: &str| number(report, pointer);
    let mib = |b: f64| format!("{:.1} MiB", b / 1048576.0);
    let rows: Vec<_> = [
        row(
            "total time",
            n("/measured/seconds").map(|s| format!("{} s", short(s))),
        ),
        row("threads", n("/measured/threads").map(count)),
        row(
            "million rays per second",
            n("/measured/mrays_per_second").map(short),
        ),
        row(
            "peak memory of the process",
            n("/measured/peak_bytes").map(mib),
        ),
        row("scene", n("/ingest/totals/memory_bytes").map(mib)),
        row("solve", n("/solve/bytes").map(mib)),
        row("gather", n("/gather/bytes").map(mib)),
    ]
    .into_iter()
    .flatten()
    .collect();
    out += &table(&[], &rows);
    out
}

/// All settings, as the report has them.
pub(super) fn settings(report: &Value) -> String {
    match report.get("settings") {
        Some(s) => {
            let json = serde_json::to_string_pretty(s).unwrap_or_default();
            format!(
                "<details><summary>as JSON</summary><pre>{}</pre></details>\n",
                super::html::escape(&json)
            )
        }
        None => note("The report lists no settings."),
    }
}
