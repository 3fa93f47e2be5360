//! What a user should look at, with the nodes concerned.

use serde_json::Value;

use super::html::{Cell, count, list, note, number, percent, short, table, text};

/// Most rows of each kind in the page; further ones are only counted.
const ROWS: usize = 100;

/// Rows of each kind that are visible without unfolding.
const OPEN: usize = 8;

/// Fraction of the light absorbed by backfaces that gives a warning in the bake.
const LOST_BEHIND: f64 = 0.05;

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
        "Lightmap coordinates of the asset (TEXCOORD_1)",
        &["mesh", "node", "severity", "fault", "what the bake did"],
        uv_faults(report),
    );
    out += &titled(
        "Meshes with another density than the scene",
        &["mesh", "node", "why", "lumels per metre"],
        adjusted(report),
    );
    let gaps = rows_of_nodes(report, "/solve/audit/gaps");
    if !gaps.is_empty() {
        out += &titled(
            "Gaps in a scene that is nearly closed",
            &["node", "patches", "lowest row sum", "near"],
            gaps,
        );
        out += &note(
            "Almost no light escapes from this scene, but some rays of these patches leave it between faces.",
        );
    }
    out += &backs(report);
    out += &titled("Repaired on import", &["what", "how often"], counts(report));
    out
}

/// Nodes that see backfaces. The list is folded unless the baker warns about the lost light.
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
    let head = ["node", "patches", "lowest row sum", "near"];
    let text = note(&format!(
        "Backfaces of single-sided materials are black. {} of the light ends there; the baker warns from {}. Objects that intersect others, like tree trunks in a floor, see backfaces without harm. A room in this list has inverted or missing faces.",
        percent(lost),
        percent(LOST_BEHIND)
    ));
    let title = format!("Nodes that see backfaces ({})", rows.len());
    if lost > LOST_BEHIND {
        return format!("{}{text}", titled("Nodes that see backfaces", &head, rows));
    }
    format!(
        "<details><summary>{title}, harmless</summary>\n{text}{}</details>\n",
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
            out += &note(&format!("… and {} more", all - ROWS));
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
            // Notes are not problems.
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
        "zero-area triangles",
        number(report, "/dropped_triangles/0").unwrap_or(0.0),
    );
    add(
        "triangles that coincide with others",
        number(report, "/dropped_triangles/1").unwrap_or(0.0),
    );
    add(
        "materials above the reflectance limit",
        number(report, "/clamped_materials").unwrap_or(0.0),
    );
    for (field, what) in [
        ("clamped", "samples clamped to the half float range"),
        ("non_finite", "non-finite samples"),
        ("negative", "negative samples"),
    ] {
        let pages = list(report, "/clamped").iter();
        add(what, pages.filter_map(|p| p.get(field)?.as_f64()).sum());
    }
    rows
}
