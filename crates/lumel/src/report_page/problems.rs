//! What a user should look at, with the nodes that it is about.

use serde_json::Value;

use super::html::{Cell, count, list, note, number, percent, short, table, text};

/// So many rows of each kind are in the page; the rest is counted.
const ROWS: usize = 100;

/// So many of them are seen at once.
const OPEN: usize = 8;

/// Share of the light on backs of faces from which on the baker warns.
const LOST_BEHIND: f64 = 0.05;

/// The section.
pub(super) fn section(report: &Value) -> String {
    let mut out = String::new();
    let warnings: Vec<Vec<Cell>> = (list(report, "/warnings").iter())
        .filter_map(|w| Some(vec![Cell::Text(w.as_str()?.to_owned())]))
        .collect();
    if warnings.is_empty() {
        out += "<p>No warnings.</p>\n";
    }
    out += &titled("Warnings", &[], warnings);
    out += &titled(
        "Left out of the bake",
        &["node", "name", "reason"],
        left_out(report),
    );
    out += &titled(
        "Lightmap coordinates of the asset",
        &["mesh", "node", "severity", "fault", "what became of them"],
        uv_faults(report),
    );
    out += &titled(
        "Meshes whose density is not the scene's",
        &["mesh", "node", "why", "lumels per metre"],
        adjusted(report),
    );
    let gaps = rows_of_nodes(report, "/solve/audit/gaps");
    if !gaps.is_empty() {
        out += &titled(
            "Gaps in a scene that is nearly closed",
            &["node", "patches", "least row sum", "near"],
            gaps,
        );
        out += &note(
            "From these patches some light gets out between faces that hardly anything else gets through.",
        );
    }
    out += &backs(report);
    out += &titled(
        "Repaired while reading",
        &["what", "how often"],
        counts(report),
    );
    out
}

/// Nodes that see backs of faces: folded away unless enough light is lost there for a warning.
fn backs(report: &Value) -> String {
    let rows = rows_of_nodes(report, "/solve/audit/beyond");
    if rows.is_empty() {
        return String::new();
    }
    let sum = |pointer: &str| -> f64 {
        let list = list(report, pointer).iter();
        list.filter_map(Value::as_f64).sum()
    };
    let emitted = sum("/solve/audit/flux_emitted");
    let lost = sum("/solve/audit/flux_behind") / emitted.max(1e-300);
    let head = ["node", "patches", "least row sum", "near"];
    let text = note(&format!(
        "Single-sided faces are black on their backs. {} of the light ends there; from {} on the baker warns. Trunks that stand in a floor and what else reaches into things look at backs without harm. A room in this list has faces turned inside out, or none.",
        percent(lost),
        percent(LOST_BEHIND)
    ));
    let title = format!("Nodes that look at backs of faces ({})", rows.len());
    if lost > LOST_BEHIND {
        return format!(
            "{}{text}",
            titled("Nodes that look at backs of faces", &head, rows)
        );
    }
    format!(
        "<details><summary>{title}, nothing to worry about</summary>\n{text}{}</details>\n",
        table(&head, &rows)
    )
}

fn titled(title: &str, head: &[&str], mut rows: Vec<Vec<Cell>>) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let all = rows.len();
    rows.truncate(ROWS);
    let folded = rows.split_off(rows.len().min(OPEN));
    let mut out = format!("<h3>{title} ({all})</h3>\n{}", table(head, &rows));
    if !folded.is_empty() {
        let more = table(head, &folded);
        out += &format!("<details><summary>{} more</summary>\n{more}", folded.len());
        if all > ROWS {
            out += &note(&format!("… and {} that are not listed", all - ROWS));
        }
        out += "</details>\n";
    }
    out
}

fn name_of(name: &str, index: Option<&Value>) -> String {
    match (name, index) {
        ("", Some(i)) => format!("(no name) #{i}"),
        ("", None) => "(no name)".into(),
        (name, _) => name.into(),
    }
}

fn left_out(report: &Value) -> Vec<Vec<Cell>> {
    (list(report, "/ingest/left_out").iter())
        .map(|n| {
            let node = n.get("node").map(Value::to_string).unwrap_or_default();
            vec![
                Cell::Number(node),
                Cell::Text(name_of(text(n, "name"), None)),
                Cell::Text(text(n, "reason").into()),
            ]
        })
        .collect()
}

fn mesh_and_node(mesh: &Value) -> [Cell; 2] {
    [
        Cell::Text(name_of(text(mesh, "name"), mesh.get("gltf_mesh"))),
        Cell::Text(name_of(text(mesh, "node_name"), mesh.get("node"))),
    ]
}

fn uv_faults(report: &Value) -> Vec<Vec<Cell>> {
    let mut rows = Vec::new();
    for mesh in list(report, "/layout/meshes") {
        for fault in list(mesh, "/uv_faults") {
            let [a, b] = mesh_and_node(mesh);
            let severity = text(fault, "severity");
            // A note is no problem.
            if severity == "note" {
                continue;
            }
            let kind = mesh
                .pointer("/origin/kind")
                .and_then(Value::as_str)
                .unwrap_or_default();
            let fault = Cell::Text(text(fault, "kind").replace('_', " "));
            rows.push(vec![
                a,
                b,
                Cell::Text(severity.into()),
                fault,
                Cell::Text(kind.replace('_', " ")),
            ]);
        }
    }
    rows
}

fn adjusted(report: &Value) -> Vec<Vec<Cell>> {
    (list(report, "/layout/meshes").iter())
        .filter_map(|mesh| {
            let why = mesh.get("adjusted")?.as_str()?;
            let [a, b] = mesh_and_node(mesh);
            let density = number(mesh, "/density/1").map(short).unwrap_or_default();
            Some(vec![a, b, Cell::Text(why.into()), Cell::Number(density)])
        })
        .collect()
}

fn rows_of_nodes(report: &Value, pointer: &str) -> Vec<Vec<Cell>> {
    (list(report, pointer).iter())
        .map(|n| {
            let at: Vec<String> = list(n, "/at")
                .iter()
                .filter_map(Value::as_f64)
                .map(|x| format!("{x:.2}"))
                .collect();
            vec![
                Cell::Text(name_of(text(n, "node"), None)),
                Cell::Number(number(n, "/rows").map(count).unwrap_or_default()),
                Cell::Number(number(n, "/least").map(percent).unwrap_or_default()),
                Cell::Text(at.join(", ")),
            ]
        })
        .collect()
}

fn counts(report: &Value) -> Vec<Vec<Cell>> {
    let of = report.pointer("/ingest/counts").and_then(Value::as_object);
    let mut rows: Vec<Vec<Cell>> = (of.into_iter().flatten())
        .filter_map(|(what, n)| {
            Some(vec![
                Cell::Text(what.clone()),
                Cell::Number(count(n.as_f64()?)),
            ])
        })
        .collect();
    let mut add = |what: &str, n: f64| {
        if n > 0.0 {
            rows.push(vec![Cell::Text(what.into()), Cell::Number(count(n))]);
        }
    };
    add(
        "triangles without area",
        number(report, "/dropped_triangles/0").unwrap_or(0.0),
    );
    add(
        "triangles that coincide with others",
        number(report, "/dropped_triangles/1").unwrap_or(0.0),
    );
    add(
        "materials that reflect more than allowed",
        number(report, "/clamped_materials").unwrap_or(0.0),
    );
    for (field, what) in [
        ("clamped", "samples beyond what halves hold"),
        ("non_finite", "samples that were not finite"),
        ("negative", "negative samples"),
    ] {
        let pages = list(report, "/clamped").iter();
        add(what, pages.filter_map(|p| p.get(field)?.as_f64()).sum());
    }
    rows
}
