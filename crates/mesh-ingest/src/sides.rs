//! Gives each side of a double-sided primitive its own faces.
//!
//! A face has one place in a lightmap, so a sheet between two rooms can hold the light of only one
//! of them. Here the document itself is changed, before it is read: the primitive becomes
//! single-sided, and a copy of it that faces the other way is added. Everything after that, the
//! writers included, sees an ordinary document.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use crate::added::{Added, members};
use crate::document::Document;
use crate::error::Outcome;
use crate::json::Item;

/// Number of a primitive in the document: mesh, primitive of that mesh.
type PrimitiveNumber = (usize, usize);

/// Component type and size of written indices and vectors.
const U32: u32 = 5125;
const F32: u32 = 5126;

/// Whether a primitive is a triangle list with all of its data in plain accessors, which a copy can
/// share or mirror. With an extension or morph targets it may not be.
pub(crate) fn is_plain(primitive: &Item) -> bool {
    let json = &primitive.value;
    let is_list = json.get("mode").is_none_or(|m| m.as_u64() == Some(4));
    is_list && json.get("extensions").is_none() && json.get("targets").is_none()
}

/// A primitive can be split if it [is plain](is_plain) and its material can be made single-sided.
pub(crate) fn can_split(primitive: &Item) -> bool {
    is_plain(primitive) && primitive.value.get("material").is_some()
}

/// Splits the primitives of `which` that exist and that [`can_split`] allows. The copies follow all
/// primitives of their mesh, in order, with their triangles in the same order. Returns the number of
/// each copy in its mesh.
pub(crate) fn split(
    document: &mut Document,
    which: &BTreeSet<PrimitiveNumber>,
) -> Outcome<BTreeMap<PrimitiveNumber, usize>> {
    let mut added = Added::new(document)?;
    let mut copies: Vec<(PrimitiveNumber, Value)> = Vec::new();
    let root = document.root();
    let materials = root.len_of("materials")?;
    // New material by old one.
    let mut single: BTreeMap<usize, usize> = BTreeMap::new();
    let mut clones: Vec<Value> = Vec::new();
    for &(mesh, number) in which {
        // The document may be another one than when they were chosen.
        let item = root.element("meshes", mesh);
        let Ok(primitive) = item.and_then(|mesh| mesh.element("primitives", number)) else {
            continue;
        };
        if !can_split(&primitive) {
            continue;
        }
        let Some(material) = primitive.opt_index("material", "materials", materials)? else {
            continue;
        };
        let of_one_side = *single.entry(material).or_insert_with(|| {
            let mut clone = root.value["materials"][material].clone();
            clone["doubleSided"] = json!(false);
            clones.push(clone);
            materials + clones.len() - 1
        });
        let mut copy = primitive.value.clone();
        copy["material"] = json!(of_one_side);
        let mirrored = mirrored(document, &primitive)?;
        for (slot, data) in mirrored {
            let at = match slot {
                "indices" => &mut copy[slot],
                _ => &mut copy["attributes"][slot],
            };
            *at = json!(data.push(&mut added));
        }
        copies.push(((mesh, number), copy));
    }
    let mut backs = BTreeMap::new();
    if copies.is_empty() {
        return Ok(backs);
    }
    added.finish(document, clones);
    let json = document.json_mut();
    for ((mesh, number), copy) in copies {
        let primitives = &mut json["meshes"][mesh]["primitives"];
        primitives[number]["material"] = copy["material"].clone();
        if let Some(list) = primitives.as_array_mut() {
            backs.insert((mesh, number), list.len());
            list.push(copy);
        }
    }
    Ok(backs)
}

/// Data of a new accessor.
enum Data {
    Indices(Vec<u32>),
    Normals(Vec<[f32; 3]>),
    Tangents(Vec<[f32; 4]>),
}

impl Data {
    /// Adds the accessor; returns its number.
    fn push(&self, added: &mut Added) -> usize {
        let floats = |list: &[f32]| list.iter().flat_map(|x| x.to_le_bytes()).collect();
        let (bytes, count, members): (Vec<u8>, _, _) = match self {
            Data::Indices(list) => {
                let bytes = list.iter().flat_map(|i| i.to_le_bytes()).collect();
                (bytes, list.len(), members(U32, "SCALAR"))
            }
            Data::Normals(list) => (
                floats(list.as_flattened()),
                list.len(),
                members(F32, "VEC3"),
            ),
            Data::Tangents(list) => (
                floats(list.as_flattened()),
                list.len(),
                members(F32, "VEC4"),
            ),
        };
        added.push(&bytes, count, members)
    }
}

/// Members of the copy that differ: corners in reverse order, normals that point the other way, and
/// tangents whose bitangent stays as it is.
fn mirrored(document: &Document, primitive: &Item) -> Outcome<Vec<(&'static str, Data)>> {
    let attribute = |name: &str| {
        let number = primitive.value["attributes"][name].as_u64();
        let number = number.and_then(|n| usize::try_from(n).ok());
        number.map(|n| document.accessor(n)).transpose()
    };
    let indices = match primitive.opt_uint("indices")? {
        Some(i) => document.accessor(i)?.to_indices().unwrap_or_default(),
        None => {
            let count = attribute("POSITION")?.map_or(0, |a| a.count);
            (0..count as u32).collect()
        }
    };
    let turned = indices
        .chunks_exact(3)
        .flat_map(|t| [t[0], t[2], t[1]])
        .collect();
    let mut out = vec![("indices", Data::Indices(turned))];
    if let Some(normals) = attribute("NORMAL")? {
        let normals = normals.to_floats::<3>(0.0);
        let turned = normals.into_iter().map(|n| n.map(|x| -x)).collect();
        out.push(("NORMAL", Data::Normals(turned)));
    }
    if let Some(tangents) = attribute("TANGENT")? {
        let tangents = tangents.to_floats::<4>(1.0);
        let turned = tangents.into_iter().map(|[x, y, z, w]| [x, y, z, -w]);
        out.push(("TANGENT", Data::Tangents(turned.collect())));
    }
    Ok(out)
}
