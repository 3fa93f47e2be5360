//! What a user should look at, with the nodes that it is about.

use serde_json::Value;

use super::html::{Cell, count, list, note, number, percent, short, table, text};

/// So many rows of each kind are shown; the rest is counted.
const ROWS: usize = 100;

/// The section.
pub(super) fn section(report: &Value) -> String {
    let mut out = String::new();
    let warnings: Vec<Vec<Cell>> = (list(report, "/warnings").iter())
        .filter_map(|w| Some(vec![Cell::Text(w.as_str()?.to_owned())]))
        .collect();
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
    out += &titled(
        "Nodes that look at backs of faces or out of gaps",
        &["node", "patches", "least row sum", "near"],
        rows_of_nodes(report),
    );
    out += &titled(
        "Repaired while reading",
        &["what", "how often"],
        counts(report),
    );
    if out.is_empty() {
        out = "<p>None.</p>\n".into();
    }
    out
}

fn titled(title: &str, head: &[&str], mut rows: Vec<Vec<Cell>>) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let all = rows.len();
    rows.truncate(ROWS);
    let more = if all > ROWS {
        note(&format!("… and {} more", all - ROWS))
    } else {
        String::new()
    };
    format!("<h3>{title} ({all})</h3>\n{}{more}", table(head, &rows))
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

fn rows_of_nodes(report: &Value) -> Vec<Vec<Cell>> {
    let lists = ["/solve/audit/beyond", "/solve/audit/gaps"];
    (lists.iter().flat_map(|pointer| list(report, pointer)))
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
