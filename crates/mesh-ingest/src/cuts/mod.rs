//! Cuts flat surfaces along straight lines, so that charts end there.
//!
//! A floor that continues under a thin wall has lumels that lookups on both sides of the wall read,
//! although the light of the two sides differs. After the cut no chart is on both sides (after
//! Heckbert's discontinuity meshing, *Discontinuity Meshing for Radiosity*, 1992, for charts).
//!
//! Here the document itself is changed, before it is read. Triangles that the line crosses are
//! divided, and the parts on either side of it go to different primitives, because charts never
//! span two primitives. Lines that go through divide a surface like a chessboard, so two primitives
//! suffice; where some end at others it is hardly ever more than four. Everything after that, the
//! writers included, sees an ordinary document.

mod divide;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::accessor::{DataType, RawAccessor};
use crate::added::{Added, members};
use crate::blend::{Between, blended};
use crate::document::Document;
use crate::error::Outcome;
use crate::json::Item;
use crate::primitive::{RawPrimitive, Want};
use crate::sides;
use divide::{Divided, Edges, Line};

/// A cut of a flat piece of surface by a plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cut {
    /// Index of the document's mesh.
    pub mesh: usize,
    /// The node whose surface is cut, if others have the same mesh: it gets a copy of its own. `None`
    /// cuts the mesh wherever it is.
    pub node: Option<usize>,
    /// Index of its primitive.
    pub primitive: usize,
    /// Index of a triangle of the piece in the document's primitive.
    pub triangle: u32,
    /// Normal of the plane in the mesh's coordinates, not zero.
    pub normal: [f32; 3],
    /// Points *p* with normal · *p* = offset are on the plane.
    pub offset: f32,
    /// The ends of the line on the piece; `None` if it goes through. Other cuts come before it, and
    /// it goes on to the nearest of them, or to the piece's border.
    pub ends: Option<[[f32; 3]; 2]>,
    /// Cuts of neighbouring pieces that end this close to each other meet, in the mesh's units.
    pub meet: f32,
}

/// Whether a mesh can be cut: all of its primitives are triangle lists of plain accessors with
/// float positions, without extensions, morph targets or joints.
pub(crate) fn can_cut(document: &Document, mesh: &Item) -> bool {
    let plain = |item: &Item| {
        let attributes = &item.value["attributes"];
        let position = attributes["POSITION"].as_u64();
        let accessor = position.map(|i| &document.json()["accessors"][i as usize]);
        let component = accessor.and_then(|a| a["componentType"].as_u64());
        sides::is_plain(item)
            && attributes.get("JOINTS_0").is_none()
            && component == Some(DataType::F32.as_gl_enum().into())
    };
    (mesh.elements("primitives")).is_ok_and(|all| !all.is_empty() && all.iter().all(plain))
}

/// Applies the cuts whose meshes exist and [`can_cut`]. A primitive keeps the parts of the first
/// colour; the others become new primitives after all those of its mesh.
pub(crate) fn apply(document: &mut Document, cuts: &[Cut]) -> Outcome<()> {
    let mut of_mesh: BTreeMap<(usize, Option<usize>), Vec<&Cut>> = BTreeMap::new();
    for cut in cuts {
        of_mesh.entry((cut.mesh, cut.node)).or_default().push(cut);
    }
    let mut added = Added::new(document)?;
    let mut changed: Vec<(usize, Option<usize>, Vec<Value>)> = Vec::new();
    for ((mesh, node), cuts) in of_mesh {
        // The document may be another one than when the cuts were chosen.
        let Ok(item) = document.root().element("meshes", mesh) else {
            continue;
        };
        let has_it = |node| document.json()["nodes"][node]["mesh"].as_u64() == Some(mesh as u64);
        if can_cut(document, &item) && node.is_none_or(has_it) {
            changed.push((mesh, node, cut_mesh(document, &item, &cuts, &mut added)?));
        }
    }
    if changed.is_empty() {
        return Ok(());
    }
    added.finish(document, Vec::new());
    let json = document.json_mut();
    for (mesh, node, primitives) in changed {
        let mut to = mesh;
        if let Some(node) = node {
            let copy = json["meshes"][mesh].clone();
            to = push(&mut json["meshes"], copy);
            json["nodes"][node]["mesh"] = json!(to);
        }
        json["meshes"][to]["primitives"] = Value::Array(primitives);
    }
    Ok(())
}

/// Adds an element to a list; returns its index.
fn push(list: &mut Value, element: Value) -> usize {
    let list = list.as_array_mut().expect("the list of an element");
    list.push(element);
    list.len() - 1
}

/// The new list of a mesh's primitives.
fn cut_mesh(
    document: &Document,
    mesh: &Item,
    cuts: &[&Cut],
    added: &mut Added,
) -> Outcome<Vec<Value>> {
    let items = mesh.elements("primitives")?;
    let raw = (items.iter())
        .map(|item| document.read_primitive(item, Want::All))
        .collect::<Outcome<Vec<_>>>()?;
    let meet = cuts.iter().map(|c| c.meet).fold(0.0, f32::max);
    let mut edges = Edges::new(f64::from(meet));
    let mut divided: Vec<Divided> = Vec::with_capacity(raw.len());
    for (number, raw) in raw.iter().enumerate() {
        let lines = (cuts.iter().filter(|c| c.primitive == number)).map(|c| Line {
            triangle: c.triangle,
            normal: c.normal.map(f64::from).into(),
            offset: f64::from(c.offset),
            ends: (c.ends).map(|ends| ends.map(|p| p.map(f64::from).into())),
        });
        let lines: Vec<Line> = lines.collect();
        divided.push(Divided::new(
            positions(raw),
            &raw.triangles,
            &lines,
            &mut edges,
        ));
    }
    // Neighbours that are not cut get the new vertices on their edges too, or hairline gaps would
    // show.
    divided.iter_mut().for_each(|d| d.join(&edges));
    let mut own = Vec::with_capacity(items.len());
    let mut new = Vec::new();
    for ((item, raw), divided) in items.iter().zip(&raw).zip(&divided) {
        if divided.is_unchanged() {
            own.push(item.value.clone());
            continue;
        }
        let data = extended(raw, divided);
        let mut parts = (divided.by_colour().into_iter())
            .filter(|part| !part.is_empty())
            .map(|part| primitive(item.value, &data, &part, added));
        own.extend(parts.next());
        new.extend(parts);
    }
    own.extend(new);
    Ok(own)
}

fn positions(raw: &RawPrimitive) -> Vec<[f32; 3]> {
    let position = raw.attributes.iter().find(|(name, _)| name == "POSITION");
    position.map_or(Vec::new(), |(_, raw)| raw.to_floats::<3>(0.0))
}

/// Every attribute with the elements of new vertices.
fn extended<'a>(
    raw: &'a RawPrimitive<'_>,
    divided: &Divided,
) -> Vec<(&'a str, &'a RawAccessor<'a>, Vec<u8>)> {
    let added: Vec<Between> = divided.added().collect();
    let of = |(name, raw): &'a (String, RawAccessor<'_>)| {
        let mut bytes = blended(name, raw, &added);
        if name == "POSITION" {
            // Exactly where neighbours have them.
            let new = divided.positions().iter().skip(raw.count).flatten();
            bytes.truncate(raw.count * raw.element_size());
            bytes.extend(new.flat_map(|x| x.to_le_bytes()));
        }
        (name.as_str(), raw, bytes)
    };
    raw.attributes.iter().map(of).collect()
}

/// A copy of a primitive with only these triangles, and the vertices that they use.
fn primitive(
    json: &Value,
    data: &[(&str, &RawAccessor<'_>, Vec<u8>)],
    triangles: &[[u32; 3]],
    added: &mut Added,
) -> Value {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let mut copy = json.clone();
    for (name, raw, bytes) in data {
        let size = raw.element_size();
        let elements: Vec<u8> = (used.iter())
            .flat_map(|&v| &bytes[v as usize * size..(v as usize + 1) * size])
            .copied()
            .collect();
        let mut members = members(raw.component.as_gl_enum(), kind(raw));
        if raw.normalized {
            members.insert("normalized".into(), json!(true));
        }
        if *name == "POSITION" {
            bounds(&elements, &mut members);
        }
        copy["attributes"][*name] = json!(added.push(&elements, used.len(), members));
    }
    let place = |v: &u32| used.binary_search(v).unwrap_or(0) as u32;
    let indices: Vec<u32> = triangles.iter().flatten().map(place).collect();
    let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
    copy["indices"] = json!(added.push(&bytes, indices.len(), members_of_indices()));
    copy
}

fn members_of_indices() -> Map<String, Value> {
    members(DataType::U32.as_gl_enum(), "SCALAR")
}

/// The accessor's `type`.
fn kind(raw: &RawAccessor) -> &'static str {
    use crate::accessor::Dimensions;
    match raw.dimensions {
        Dimensions::Scalar => "SCALAR",
        Dimensions::Vec2 => "VEC2",
        Dimensions::Vec3 => "VEC3",
        Dimensions::Vec4 => "VEC4",
        Dimensions::Mat2 => "MAT2",
        Dimensions::Mat3 => "MAT3",
        Dimensions::Mat4 => "MAT4",
    }
}

/// `min` and `max` of packed positions.
fn bounds(elements: &[u8], members: &mut Map<String, Value>) {
    let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for (i, b) in elements.chunks_exact(4).enumerate() {
        let x = f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        // `f32::min` and `max` ignore NaN.
        (min[i % 3], max[i % 3]) = (min[i % 3].min(x), max[i % 3].max(x));
    }
    let finite = |x: f32| if x.is_finite() { f64::from(x) } else { 0.0 };
    members.insert("min".into(), json!(min.map(finite)));
    members.insert("max".into(), json!(max.map(finite)));
}
