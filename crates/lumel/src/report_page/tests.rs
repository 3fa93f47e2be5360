use atlas_bake::{ExrOptions, Page, write_lightmap_exr};
use serde_json::json;
use tempfile::TempDir;

use super::*;

/// A handmade bake of one page with `layers`, whose report is edited by `change`.
fn bake(layers: &[&str], change: impl FnOnce(&mut Value)) -> (TempDir, BakeFolder) {
    let t = tempfile::tempdir().unwrap();
    let n = 16;
    let page = Page {
        width: 4,
        height: 4,
        value: (0..n).map(|i| [i as f32; 3]).collect(),
        coverage: vec![1.0; n],
        layers: layers
            .iter()
            .map(|l| ((*l).to_owned(), vec![0.25; n]))
            .collect(),
    };
    let exr = write_lightmap_exr(&page, &ExrOptions::default()).unwrap().0;
    let write = |name: &str, bytes: &[u8]| std::fs::write(t.path().join(name), bytes).unwrap();
    let manifest = json!({
        "version": 1, "scene": "<b>.glb", "value": "radiance", "pages": [{"uri": "<b>.exr"}], "channels": layers,
        "groups": [{"name": "<i>lamps", "pages": ["<b>.exr"]}], "nodes": [],
    });
    let mut report = json!({
        "generator": "lumel 9", "scene": "<b>\"x\".glb", "settings": {"quality": "draft"},
        "warnings": ["<script>alert(1)</script>"],
        "ingest": {
            "counts": {"x": 3}, "left_out": [{"node": 7, "name": "<script>", "reason": "skinned"}],
            "totals": {"meshes": 1, "instances": 1, "triangles": 2, "triangles_instanced": 2, "memory_bytes": 1024},
        },
        "layout": {
            "texels_per_unit": 8, "pages": [[4, 4]], "density": [1.0, 8.0, 9.0], "charts": 2,
            "meshes": [{
                "gltf_mesh": 3, "name": "", "node": 5, "node_name": "<script>lamp", "density": [1.0, 2.0, 3.0], "adjusted": "small",
                "origin": {"kind": "replaced"}, "uv_faults": [{"kind": "overlap", "severity": "bad"}, {"kind": "mirrored", "severity": "note"}],
            }],
        },
        "solve": {
            "history": [{"rays": 16, "sweeps": 0, "iterations": 0, "residual": 1.0, "flux": 1.0}, {"rays": 16, "sweeps": 9, "iterations": 0, "residual": 1e-4, "flux": 2.0}],
            "relaxation": {"sweeps": 9, "iterations": 0, "residual": 1e-4},
            "audit": {
                "flux_emitted": [3.0, 2.0, 1.0], "flux_absorbed": [1.0, 1.0, 1.0], "flux_behind": [0.0, 0.0, 0.0], "flux_escaped": [2.0, 1.0, 0.0],
                "imbalance": 0.001, "bound": 0.01, "within_bound": true, "beyond": [{"node": "tree</td>", "rows": 4, "least": 0.5, "at": [1.0, 2.0, 3.0]}],
            },
        },
        "gather": {
            "lumels": 16, "median_error": 0.01, "estimated_error": 0.02,
            "seams": {"samples": 4, "metres": 2.0, "before": {"median": 0.1, "p99": 0.2, "max": 0.3}, "after": {"median": 0.0, "p99": 0.0, "max": 0.1}},
        },
        "measured": {"threads": 2, "phases": [{"phase": "solve", "seconds": 1.5}, {"phase": "gather", "seconds": 2.5}], "seconds": 4.0, "peak_bytes": 1048576},
    });
    change(&mut report);
    write("b.lightmap.json", manifest.to_string().as_bytes());
    write("b.report.json", report.to_string().as_bytes());
    write("<b>.exr", &exr);
    let folder = BakeFolder::open(t.path()).unwrap();
    (t, folder)
}

/// Asserts that every opened element is closed in order, and that attributes contain no injected
/// markup.
#[track_caller]
fn assert_well_formed(page: &str) {
    const VOID: [&str; 3] = ["meta", "img", "rect"];
    let mut open: Vec<&str> = Vec::new();
    // Style sheets are not HTML.
    let (head, rest) = page.split_once("<style>").unwrap();
    let body = rest.split_once("</style>").unwrap().1;
    for part in [head, body] {
        for tag in part.split('<').skip(1) {
            let (tag, text) = tag
                .split_once('>')
                .unwrap_or_else(|| panic!("<{tag} does not end"));
            assert!(!text.contains('>'), "a bare > after <{tag}>");
            assert_eq!(tag.matches('"').count() % 2, 0, "<{tag}>");
            let name = tag
                .trim_start_matches('/')
                .split([' ', '/'])
                .next()
                .unwrap();
            if let Some(closed) = tag.strip_prefix('/') {
                assert_eq!(open.pop(), Some(closed));
            } else if !(tag.starts_with('!') || tag.ends_with('/') || VOID.contains(&name)) {
                open.push(name);
            }
        }
    }
    assert!(open.is_empty(), "{open:?} stay open");
}

const SECTIONS: [&str; 9] = [
    "summary",
    "problems",
    "lightmaps",
    "error",
    "solve",
    "density",
    "seams",
    "time",
    "settings",
];

#[test]
fn all_sections_are_there_and_names_are_text() {
    let (_t, folder) = bake(&["error.Y", "coverage.Y"], |_| {});
    let page = report_page(&folder, "b").unwrap();
    assert_well_formed(&page);
    for id in SECTIONS {
        assert!(page.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
    assert!(!page.contains("<script") && !page.contains("<b>") && !page.contains("<i>"));
    for words in [
        "&lt;script&gt;lamp",
        "&lt;script&gt;alert(1)",
        "tree&lt;/td&gt;",
        "(no name) #3",
        "overlap",
        "skinned",
        "<polyline",
        "within sampling noise",
        "group &lt;i&gt;lamps",
        "Lumels by estimated error",
        "1.0 MiB",
    ] {
        assert!(page.contains(words), "{words}");
    }
    assert!(!page.contains("mirrored"), "notes are no problems");
    // The lightmap, its group, the error, the error's scale.
    assert_eq!(page.matches("<img ").count(), 4);
    // Nothing may be loaded from outside.
    assert!(!page.contains("http:") && !page.contains("https:") && !page.contains("src=\"/"));
    assert_eq!(report_page(&folder, "b").unwrap(), page);
}

/// With two groups each pass of the solve has two relaxations, which must be separate curves.
#[test]
fn groups_have_curves_of_their_own() {
    let (_t, folder) = bake(&[], |report| {
        let step = |sweeps: u32, flux: f64| json!({"rays": 16, "sweeps": sweeps, "iterations": 0, "residual": 0.5, "flux": flux});
        report["solve"]["history"] = json!([
            step(0, 0.0),
            step(9, 7000.0),
            step(0, 0.0),
            step(9, 900.0),
            step(0, 7000.0),
            step(3, 7100.0)
        ]);
        report["groups"] =
            json!([{"name": "day", "sources": []}, {"name": "<i>rest", "sources": []}]);
    });
    let page = report_page(&folder, "b").unwrap();
    assert_well_formed(&page);
    // Three relaxations in two charts; the third one is of the group "day" again.
    assert_eq!(page.matches("<polyline class=\"la\"").count(), 4);
    assert_eq!(page.matches("<polyline class=\"lb\"").count(), 2);
    assert_eq!(page.matches(">&lt;i&gt;rest</text>").count(), 2);
    assert!(page.contains("light groups are solved one after the other"));
}

#[test]
fn long_lists_are_folded_and_harmless_backs_too() {
    let nodes = |n: usize| -> Vec<Value> {
        let node = |i: usize| json!({"node": format!("n{i}."), "rows": 4, "least": 0.5, "at": [1.0, 2.0, 3.0]});
        (0..n).map(node).collect()
    };
    let with = |behind: f64| {
        let (_t, folder) = bake(&[], |report| {
            report["solve"]["audit"]["beyond"] = json!(nodes(20));
            report["solve"]["audit"]["gaps"] = json!([]);
            report["solve"]["audit"]["flux_behind"] = json!([behind, 0.0, 0.0]);
        });
        report_page(&folder, "b").unwrap()
    };
    let folded = |page: &str, name: &str| {
        let at = page.find(name).expect(name);
        page[..at].matches("<details>").count() > page[..at].matches("</details>").count()
    };
    // Of 6 units emitted, 0.06 is 1 %, which is harmless; 0.6 is 10 %, which the baker warns about.
    let harmless = with(0.06);
    assert_well_formed(&harmless);
    assert!(folded(&harmless, "n0.") && harmless.contains("1.00 % of the light ends there"));
    let lost = with(0.6);
    assert_well_formed(&lost);
    assert!(!folded(&lost, "n7.") && folded(&lost, "n8.") && folded(&lost, "n19."));
    assert!(lost.contains("12 more"));
}

#[test]
fn without_optional_layers_and_fields_the_page_says_so() {
    let (_t, folder) = bake(&[], |report| {
        *report = json!({"scene": "b.glb", "warnings": []});
    });
    let page = report_page(&folder, "b").unwrap();
    assert_well_formed(&page);
    for id in SECTIONS {
        assert!(page.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
    for words in [
        "--layers error",
        "<p>No warnings.</p>",
        "no history",
        "Seams were not measured",
    ] {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn odd_types_in_a_report_leave_lines_out_and_nothing_else() {
    for odd in [
        json!(null),
        json!([]),
        json!("x"),
        json!({}),
        json!(-1e300),
        json!([[[]], 1, "x", {}]),
    ] {
        let (_t, folder) = bake(&["error.Y"], |report| {
            fn spoil(v: &mut Value, odd: &Value, depth: usize) {
                if let Value::Object(o) = v {
                    for (_, child) in o.iter_mut() {
                        if depth == 0 {
                            *child = odd.clone()
                        } else {
                            spoil(child, odd, depth - 1)
                        }
                    }
                }
            }
            for key in ["layout", "solve", "gather", "measured", "ingest"] {
                spoil(&mut report[key], &odd, 0);
            }
        });
        assert_well_formed(&report_page(&folder, "b").unwrap());
    }
}

#[test]
fn missing_files_are_one_clear_error() {
    let (t, folder) = bake(&[], |_| {});
    std::fs::remove_file(t.path().join("<b>.exr")).unwrap();
    let e = report_page(&folder, "b").unwrap_err();
    assert_eq!(e.exit_code(), 3);
    assert!(e.to_string().contains("<b>.exr"), "{e}");
    assert_eq!(report_page(&folder, "none").unwrap_err().exit_code(), 3);
}
