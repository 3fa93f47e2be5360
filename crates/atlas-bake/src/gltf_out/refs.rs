//! References to accessors and buffer views, and garbage collection of unreferenced ones.

use std::collections::BTreeSet;

use serde_json::{Map, Value};

use super::json::{elements_mut, has_array, indices_of};

/// Extensions whose references are all visited below. If a document has any other extension,
/// nothing is re-indexed, because it may contain unknown references.
const KNOWN: [&str; 21] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "FB_ngon_encoding",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MOZ_lightmap",
    "MOZ_texture_rgbe",
    "MSFT_lod",
    "MSFT_texture_dds",
];

fn is_known(name: &str) -> bool {
    KNOWN.contains(&name) || name.starts_with("KHR_materials_")
}

/// Names of all extensions that the document uses or declares.
pub(super) fn extensions(json: &Map<String, Value>) -> BTreeSet<String> {
    let mut names = present(json);
    for list in ["extensionsUsed", "extensionsRequired"] {
        let declared = json
            .get(list)
            .and_then(Value::as_array)
            .into_iter()
            .flatten();
        names.extend(declared.filter_map(Value::as_str).map(str::to_owned));
    }
    names
}

/// Names of the extensions that appear in an `extensions` object.
pub(super) fn present(json: &Map<String, Value>) -> BTreeSet<String> {
    fn walk(object: &Map<String, Value>, names: &mut BTreeSet<String>) {
        for (key, value) in object {
            match value {
                // `extras` may contain anything, including an object called "extensions".
                _ if key == "extras" => {}
                Value::Object(inner) => {
                    if key == "extensions" {
                        names.extend(inner.keys().cloned());
                    }
                    walk(inner, names);
                }
                Value::Array(items) => items
                    .iter()
                    .filter_map(Value::as_object)
                    .for_each(|o| walk(o, names)),
                _ => {}
            }
        }
    }
    let mut names = BTreeSet::new();
    walk(json, &mut names);
    names
}

/// Calls `f` on every accessor index outside `accessors`.
fn visit_accessors(json: &mut Map<String, Value>, f: &mut dyn FnMut(&mut Value)) {
    for primitive in elements_mut(json, "meshes").flat_map(|m| elements_mut(m, "primitives")) {
        indices_of(primitive.get_mut("attributes"), f);
        if let Some(indices) = primitive.get_mut("indices") {
            f(indices);
        }
        for target in primitive
            .get_mut("targets")
            .and_then(Value::as_array_mut)
            .into_iter()
            .flatten()
        {
            indices_of(Some(target), f);
        }
    }
    for skin in elements_mut(json, "skins") {
        if let Some(matrices) = skin.get_mut("inverseBindMatrices") {
            f(matrices);
        }
    }
    for sampler in elements_mut(json, "animations").flat_map(|a| elements_mut(a, "samplers")) {
        for key in ["input", "output"] {
            if let Some(accessor) = sampler.get_mut(key) {
                f(accessor);
            }
        }
    }
    for node in elements_mut(json, "nodes") {
        let instancing = node
            .get_mut("extensions")
            .and_then(|e| e.get_mut("EXT_mesh_gpu_instancing"));
        indices_of(instancing.and_then(|e| e.get_mut("attributes")), f);
    }
}

/// Calls `f` on every buffer view index.
fn visit_views(json: &mut Map<String, Value>, f: &mut dyn FnMut(&mut Value)) {
    for accessor in elements_mut(json, "accessors") {
        if let Some(view) = accessor.get_mut("bufferView") {
            f(view);
        }
        for part in ["indices", "values"] {
            let sparse = accessor.get_mut("sparse").and_then(|s| s.get_mut(part));
            if let Some(view) = sparse.and_then(|s| s.get_mut("bufferView")) {
                f(view);
            }
        }
    }
    for image in elements_mut(json, "images") {
        if let Some(view) = image.get_mut("bufferView") {
            f(view);
        }
    }
    for primitive in elements_mut(json, "meshes").flat_map(|m| elements_mut(m, "primitives")) {
        let draco = primitive
            .get_mut("extensions")
            .and_then(|e| e.get_mut("KHR_draco_mesh_compression"));
        if let Some(view) = draco.and_then(|d| d.get_mut("bufferView")) {
            f(view);
        }
    }
}

/// Drops unreferenced accessors and buffer views and re-indexes the rest, preserving their order.
/// Returns the old index of each remaining buffer view.
///
/// Does nothing (and returns the identity) if the document has an extension that may contain
/// unknown references.
pub(super) fn collect_garbage(json: &mut Map<String, Value>) -> Vec<usize> {
    let views = json
        .get("bufferViews")
        .and_then(Value::as_array)
        .map_or(0, Vec::len);
    if !extensions(json).iter().all(|name| is_known(name)) {
        return (0..views).collect();
    }
    sweep(json, "accessors", visit_accessors);
    sweep(json, "bufferViews", visit_views)
}

type Visit = fn(&mut Map<String, Value>, &mut dyn FnMut(&mut Value));

/// Keeps the elements of `array` that `visit` reaches; returns their old indices.
fn sweep(json: &mut Map<String, Value>, array: &str, visit: Visit) -> Vec<usize> {
    if !has_array(json, array) {
        return Vec::new();
    }
    let len = json
        .get(array)
        .and_then(Value::as_array)
        .map_or(0, Vec::len);
    let mut used = vec![false; len];
    visit(json, &mut |slot| {
        if let Some(u) = slot.as_u64().and_then(|i| used.get_mut(i as usize)) {
            *u = true;
        }
    });
    let kept: Vec<usize> = (0..len).filter(|&i| used[i]).collect();
    if kept.len() == len {
        return kept;
    }
    let mut new_index = vec![0u64; len];
    for (new, &old) in kept.iter().enumerate() {
        new_index[old] = new as u64;
    }
    visit(json, &mut |slot| {
        if let Some(&new) = slot.as_u64().and_then(|i| new_index.get(i as usize)) {
            *slot = new.into();
        }
    });
    if let Some(items) = json.get_mut(array).and_then(Value::as_array_mut) {
        let mut i = 0;
        items.retain(|_| {
            i += 1;
            used[i - 1]
        });
    }
    kept
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn object(value: Value) -> Map<String, Value> {
        match value {
            Value::Object(map) => map,
            other => panic!("{other} is no object"),
        }
    }

    fn document() -> Value {
        json!({
            "meshes": [{"primitives": [{"attributes": {"POSITION": 1, "_FOO": 3}, "indices": 5, "targets": [{"POSITION": 6}],
                "extensions": {"KHR_draco_mesh_compression": {"bufferView": 7, "attributes": {"POSITION": 0}}}}]}],
            "skins": [{"inverseBindMatrices": 7}],
            "animations": [{"samplers": [{"input": 8, "output": 9}]}],
            "nodes": [{"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 10}}}}],
            "images": [{"bufferView": 6}, {"uri": "x.png"}],
            "accessors": (0..12).map(|i| match i {
                3 => json!({"id": i, "sparse": {"indices": {"bufferView": 3}, "values": {"bufferView": 4}}}),
                2 => json!({"id": i, "bufferView": 5}),
                _ => json!({"id": i, "bufferView": 1}),
            }).collect::<Vec<_>>(),
            "bufferViews": (0..9).map(|i| json!({"id": i})).collect::<Vec<_>>(),
        })
    }

    #[test]
    fn unused_things_go_and_every_reference_follows() {
        let mut json = object(document());
        let kept = collect_garbage(&mut json);
        assert_eq!(kept, [1, 3, 4, 6, 7]);
        let ids = |a: &str| {
            json[a]
                .as_array()
                .unwrap()
                .iter()
                .map(|x| x["id"].as_u64().unwrap())
                .collect::<Vec<_>>()
        };
        assert_eq!(ids("accessors"), [1, 3, 5, 6, 7, 8, 9, 10]);
        assert_eq!(ids("bufferViews"), [1, 3, 4, 6, 7]);
        // Every reference still leads to the element with its old id.
        let accessor = |v: &Value| {
            json["accessors"][v.as_u64().unwrap() as usize]["id"]
                .as_u64()
                .unwrap()
        };
        let p = &json["meshes"][0]["primitives"][0];
        let refs = [
            &p["attributes"]["POSITION"],
            &p["attributes"]["_FOO"],
            &p["indices"],
            &p["targets"][0]["POSITION"],
        ];
        assert_eq!(refs.map(accessor), [1, 3, 5, 6]);
        assert_eq!(accessor(&json["skins"][0]["inverseBindMatrices"]), 7);
        let s = &json["animations"][0]["samplers"][0];
        assert_eq!((accessor(&s["input"]), accessor(&s["output"])), (8, 9));
        assert_eq!(
            accessor(
                &json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"]
            ),
            10
        );
        let draco = &p["extensions"]["KHR_draco_mesh_compression"];
        // Attributes of a Draco extension are ids within its stream, not accessors.
        assert_eq!(
            (&draco["bufferView"], &draco["attributes"]["POSITION"]),
            (&json!(4), &json!(0))
        );
        let sparse = &json["accessors"][1]["sparse"];
        assert_eq!(
            (
                &sparse["indices"]["bufferView"],
                &sparse["values"]["bufferView"]
            ),
            (&json!(1), &json!(2))
        );
        assert_eq!(json["images"][0]["bufferView"], json!(3));
    }

    #[test]
    fn an_unknown_extension_keeps_everything_where_it_is() {
        let mut json = object(document());
        json.insert(
            "extensions".into(),
            json!({"ACME_audio": {"clips": [{"bufferView": 8}]}}),
        );
        let before = json.clone();
        assert_eq!(collect_garbage(&mut json), (0..9).collect::<Vec<_>>());
        assert_eq!(json, before);
    }

    #[test]
    fn extras_are_not_searched_for_extensions() {
        let json = object(
            json!({"nodes": [{"extras": {"extensions": {"NOT_ONE": {}}}, "extensions": {"MSFT_lod": {}}}]}),
        );
        assert_eq!(present(&json).into_iter().collect::<Vec<_>>(), ["MSFT_lod"]);
    }
}
