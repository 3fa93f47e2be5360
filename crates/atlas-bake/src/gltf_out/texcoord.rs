//! Frees `TEXCOORD_1`: coordinates that a material uses move to another set, and the material is
//! updated.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value};

use super::json::{element, element_mut, elements_mut, index, push};

/// The coordinate set used for the lightmap.
pub(super) const LIGHTMAP_SET: u64 = 1;

/// Number of consecutive `TEXCOORD_n` in `attributes`, from 0.
pub(super) fn sets(attributes: &Map<String, Value>) -> usize {
    (0..)
        .find(|n| !attributes.contains_key(&format!("TEXCOORD_{n}")))
        .unwrap_or(0)
}

/// Whether a texture of one of the primitive's materials (including variants) reads set 1.
pub(super) fn needs_set_1(json: &Map<String, Value>, primitive: &Map<String, Value>) -> bool {
    materials_of(primitive)
        .into_iter()
        .any(|m| reads_set_1(json, m))
}

fn reads_set_1(json: &Map<String, Value>, material: usize) -> bool {
    let Some(mut material) = element(json, "materials", material).cloned() else {
        return false;
    };
    let mut found = false;
    texture_infos(&mut material, &mut |slot| {
        found |= slot.as_u64() == Some(LIGHTMAP_SET)
    });
    found
}

/// Materials that `primitive` references.
fn materials_of(primitive: &Map<String, Value>) -> Vec<usize> {
    let variants = primitive
        .get("extensions")
        .and_then(|e| e.get("KHR_materials_variants"))
        .and_then(|v| v.get("mappings"));
    let variants = variants
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .filter_map(Value::as_object);
    index(primitive, "material")
        .into_iter()
        .chain(variants.filter_map(|m| index(m, "material")))
        .collect()
}

/// Calls `f` on each material reference of `primitive`.
pub(super) fn material_slots(primitive: &mut Map<String, Value>, f: &mut dyn FnMut(&mut Value)) {
    if let Some(slot) = primitive.get_mut("material") {
        f(slot);
    }
    let variants = primitive
        .get_mut("extensions")
        .and_then(|e| e.get_mut("KHR_materials_variants"));
    let mappings = variants
        .and_then(|v| v.get_mut("mappings"))
        .and_then(Value::as_array_mut);
    for mapping in mappings.into_iter().flatten() {
        if let Some(slot) = mapping.get_mut("material") {
            f(slot);
        }
    }
}

/// Calls `f` on every explicit `texCoord` of a textureInfo in `material`, including
/// `KHR_texture_transform` overrides.
///
/// A textureInfo is recognised by its name, which ends in `Texture` in the core and in every
/// material extension, and by its `index`.
fn texture_infos(material: &mut Map<String, Value>, f: &mut dyn FnMut(&mut Value)) {
    for (key, value) in material {
        let Some(object) = value.as_object_mut() else {
            continue;
        };
        if key == "extras" {
            continue;
        }
        if key.ends_with("Texture") && object.contains_key("index") {
            if let Some(slot) = object.get_mut("texCoord") {
                f(slot);
            }
            let transform = object
                .get_mut("extensions")
                .and_then(|e| e.get_mut("KHR_texture_transform"));
            if let Some(slot) = transform.and_then(|t| t.get_mut("texCoord")) {
                f(slot);
            }
        } else {
            texture_infos(object, f);
        }
    }
}

/// Makes the materials of the primitives in `moves` read the moved set (`moves` maps mesh and
/// primitive index to the new set of the former `TEXCOORD_1`). A material that other primitives use
/// unchanged, or with another set, is copied. Returns the number of copies.
pub(super) fn follow(
    json: &mut Map<String, Value>,
    moves: &BTreeMap<(usize, usize), usize>,
) -> u64 {
    if moves.is_empty() {
        return 0;
    }
    // The sets requested of each material that reads set 1.
    let mut wanted: BTreeMap<usize, BTreeSet<Option<usize>>> = BTreeMap::new();
    let meshes = json
        .get("meshes")
        .and_then(Value::as_array)
        .into_iter()
        .flatten();
    for (m, mesh) in meshes.enumerate() {
        let primitives = mesh
            .get("primitives")
            .and_then(Value::as_array)
            .into_iter()
            .flatten();
        for (p, primitive) in primitives
            .enumerate()
            .filter_map(|(p, x)| Some((p, x.as_object()?)))
        {
            for material in materials_of(primitive) {
                wanted
                    .entry(material)
                    .or_default()
                    .insert(moves.get(&(m, p)).copied());
            }
        }
    }
    wanted
        .retain(|&material, sets| sets.iter().any(Option::is_some) && reads_set_1(json, material));
    let mut renamed: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    let mut copies = 0;
    for (&material, sets) in &wanted {
        let in_place = sets.len() == 1;
        for set in sets.iter().flatten() {
            let Some(mut changed) = element(json, "materials", material).cloned() else {
                continue;
            };
            texture_infos(&mut changed, &mut |slot| {
                if slot.as_u64() == Some(LIGHTMAP_SET) {
                    *slot = (*set).into();
                }
            });
            if in_place {
                if let Some(slot) = element_mut(json, "materials", material) {
                    *slot = changed;
                }
            } else {
                renamed.insert(
                    (material, *set),
                    push(json, "materials", Value::Object(changed)),
                );
                copies += 1;
            }
        }
    }
    for (m, mesh) in elements_mut(json, "meshes").enumerate() {
        for (p, primitive) in elements_mut(mesh, "primitives").enumerate() {
            let Some(set) = moves.get(&(m, p)) else {
                continue;
            };
            material_slots(primitive, &mut |slot| {
                let new = slot
                    .as_u64()
                    .and_then(|material| renamed.get(&(material as usize, *set)));
                if let Some(&new) = new {
                    *slot = new.into();
                }
            });
        }
    }
    copies
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn material(set: u64) -> Value {
        json!({
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
            "occlusionTexture": {"index": 1, "texCoord": set},
            "extensions": {"KHR_materials_sheen": {"sheenColorTexture": {"index": 2, "texCoord": 0,
                "extensions": {"KHR_texture_transform": {"texCoord": set}}}}},
        })
    }

    fn document() -> Map<String, Value> {
        let p = |m: u64| json!({"attributes": {}, "material": m});
        json!({"materials": [material(1), material(0), material(1)], "meshes": [{"primitives": [p(0), p(1), p(0), p(2)]}]})
            .as_object()
            .unwrap()
            .clone()
    }

    #[test]
    fn sets_are_counted_while_consecutive() {
        let count =
            |names: &[&str]| sets(&names.iter().map(|n| (n.to_string(), json!(0))).collect());
        assert_eq!(
            (
                count(&[]),
                count(&["TEXCOORD_0", "TEXCOORD_1"]),
                count(&["TEXCOORD_1"])
            ),
            (0, 2, 0)
        );
    }

    #[test]
    fn reading_set_1_is_seen_in_extensions_and_through_texture_transform() {
        let json = document();
        let primitive = |i: usize| json["meshes"][0]["primitives"][i].as_object().unwrap();
        assert!(needs_set_1(&json, primitive(0)));
        assert!(!needs_set_1(&json, primitive(1)));
    }

    #[test]
    fn a_material_of_moved_primitives_only_is_changed_in_place() {
        let mut json = document();
        let moves = BTreeMap::from([((0, 0), 2), ((0, 2), 2)]);
        assert_eq!(follow(&mut json, &moves), 0);
        assert_eq!(json["materials"][0], material(2));
        assert_eq!(json["materials"].as_array().unwrap().len(), 3);
        assert_eq!(
            (&json["materials"][1], &json["materials"][2]),
            (&material(0), &material(1))
        );
    }

    #[test]
    fn a_shared_material_is_copied_for_those_that_moved() {
        let mut json = document();
        let before = json.clone();
        assert_eq!(follow(&mut json, &BTreeMap::from([((0, 2), 3)])), 1);
        assert_eq!(
            (&json["materials"][0], &json["materials"][3]),
            (&before["materials"][0], &material(3))
        );
        let used: Vec<_> = json["meshes"][0]["primitives"]
            .as_array()
            .unwrap()
            .iter()
            .map(|p| p["material"].clone())
            .collect();
        assert_eq!(used, [0, 1, 3, 2]);
    }

    #[test]
    fn variants_follow_too() {
        let mut json = document();
        json["meshes"][0]["primitives"][1]["extensions"] = json!({"KHR_materials_variants": {"mappings": [{"material": 2, "variants": [0]}, {"material": 1, "variants": [1]}]}});
        assert_eq!(follow(&mut json, &BTreeMap::from([((0, 1), 2)])), 1);
        let p = &json["meshes"][0]["primitives"];
        assert_eq!(
            p[1]["extensions"]["KHR_materials_variants"]["mappings"][0]["material"],
            3
        );
        assert_eq!(
            (&p[1]["material"], &p[3]["material"]),
            (&json!(1), &json!(2))
        );
    }
}
