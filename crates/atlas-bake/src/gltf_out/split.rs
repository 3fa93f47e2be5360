//! Splits a primitive's vertices at the borders of lightmap charts.

use std::collections::HashMap;

use atlas::PrimitiveAtlas;
use mesh_ingest::{Primitive, RawAccessor, RawPrimitive};
use serde_json::{Map, Value, json};

use super::editor::Editor;
use crate::error::{Error, Result};

/// New vertices and triangles of a primitive.
pub(super) struct Split {
    /// For each new vertex, the document's vertex that it copies.
    pub source: Vec<u32>,
    /// Lightmap coordinates of each new vertex, 0..=1 of the mesh's rectangle.
    pub uv: Vec<[f32; 2]>,
    /// All of the document's triangles in order, including those without lumels.
    pub triangles: Vec<[u32; 3]>,
    /// Whether nothing is split and no index changes, so that the document's own attributes and
    /// indices can stay.
    pub identity: bool,
}

/// Checks that `atlas` fits `primitive`, whose raw form has `vertices` vertices and `triangles`
/// triangles.
fn check(
    primitive: &Primitive,
    atlas: &PrimitiveAtlas,
    raw: &RawPrimitive<'_>,
    at: &str,
) -> Result<()> {
    let fail = |message: String| {
        Err(Error::Inconsistent {
            at: at.to_owned(),
            message,
        })
    };
    if primitive.positions.len() != raw.vertex_count {
        return fail(format!(
            "{} vertices in the scene, {} in the document",
            primitive.positions.len(),
            raw.vertex_count
        ));
    }
    if atlas.uv.len() != atlas.xref.len() || atlas.triangles.len() != primitive.triangles.len() {
        return fail(format!(
            "{} coordinates for {} new vertices, {} triangles for {}",
            atlas.uv.len(),
            atlas.xref.len(),
            atlas.triangles.len(),
            primitive.triangles.len()
        ));
    }
    if let Some(v) = atlas.xref.iter().find(|&&v| v as usize >= raw.vertex_count) {
        return fail(format!(
            "a new vertex copies vertex {v} of {}",
            raw.vertex_count
        ));
    }
    if let Some(i) = atlas
        .triangles
        .iter()
        .flatten()
        .find(|&&i| i as usize >= atlas.xref.len())
    {
        return fail(format!(
            "a triangle names new vertex {i} of {}",
            atlas.xref.len()
        ));
    }
    if let Some(t) = primitive
        .source_triangles
        .iter()
        .find(|&&t| t as usize >= raw.triangles.len())
    {
        return fail(format!("triangle {t} of {}", raw.triangles.len()));
    }
    Ok(())
}

/// Whether each triangle that ingest dropped has its vertices in one chart, so that it can stay
/// unchanged.
fn stay_in_their_chart(
    primitive: &Primitive,
    atlas: &PrimitiveAtlas,
    raw: &RawPrimitive<'_>,
) -> bool {
    if raw.triangles.len() == primitive.triangles.len() {
        return true; // No triangle was dropped.
    }
    let mut chart_of: Vec<Option<u32>> = vec![None; raw.vertex_count];
    for (t, chart) in atlas.triangles.iter().zip(&atlas.chart) {
        for &v in t {
            chart_of[v as usize] = Some(*chart);
        }
    }
    raw.triangles.iter().all(|t| {
        let [a, b, c] = t.map(|v| chart_of[v as usize]);
        a.is_some() && a == b && b == c
    })
}

impl Split {
    /// Combines the document's triangles with `atlas`, whose coordinates are in texels of a
    /// rectangle of `size`.
    ///
    /// A triangle that ingest dropped keeps its place. A duplicate uses the corners of its
    /// original. Any other has zero area and is collapsed to a point of the lightmap: that of a
    /// copy of one of its vertices. `kept` coordinates, which are the document's own, stay
    /// unchanged.
    pub fn new(
        primitive: &Primitive,
        atlas: &PrimitiveAtlas,
        raw: &RawPrimitive<'_>,
        size: [u32; 2],
        kept: bool,
        at: &str,
    ) -> Result<Split> {
        check(primitive, atlas, raw, at)?;
        let scale = size.map(|s| s.max(1) as f32);
        let uv_at = |v: usize| [atlas.uv[v].x / scale[0], atlas.uv[v].y / scale[1]];
        let identity = atlas.xref.len() == raw.vertex_count
            && atlas.xref.iter().enumerate().all(|(i, &v)| i == v as usize)
            && atlas.triangles == primitive.triangles
            && (kept || stay_in_their_chart(primitive, atlas, raw));
        if identity {
            let uv = (0..atlas.uv.len()).map(uv_at).collect();
            return Ok(Split {
                source: atlas.xref.clone(),
                uv,
                triangles: raw.triangles.clone(),
                identity,
            });
        }

        const NONE: u32 = u32::MAX;
        let mut triangles: Vec<Option<[u32; 3]>> = vec![None; raw.triangles.len()];
        for (&number, &corners) in primitive.source_triangles.iter().zip(&atlas.triangles) {
            triangles[number as usize] = Some(corners);
        }
        // Atlas vertices without triangles are left out; the others keep their order.
        let mut new_of_atlas = vec![NONE; atlas.xref.len()];
        for &v in atlas.triangles.iter().flatten() {
            new_of_atlas[v as usize] = 0;
        }
        let mut split = Split {
            source: Vec::new(),
            uv: Vec::new(),
            triangles: Vec::new(),
            identity,
        };
        let mut copy_of = vec![NONE; raw.vertex_count];
        for (v, new) in new_of_atlas
            .iter_mut()
            .enumerate()
            .filter(|(_, new)| **new != NONE)
        {
            *new = split.source.len() as u32;
            split.source.push(atlas.xref[v]);
            split.uv.push(uv_at(v));
            let copy = &mut copy_of[atlas.xref[v] as usize];
            *copy = (*copy).min(*new);
        }
        let mut collapsed = HashMap::new();
        let repeated = Repeated::new(primitive, triangles.contains(&None));
        for (number, corners) in triangles.iter().enumerate() {
            let original = raw.triangles[number];
            let corners = corners.map(|c| c.map(|v| new_of_atlas[v as usize]));
            let corners = corners.or_else(|| {
                let (first, order) = repeated.find(original)?;
                let of = atlas.triangles[first];
                Some(order.map(|k| new_of_atlas[of[k] as usize]))
            });
            let corners = corners.unwrap_or_else(|| match kept {
                true => original.map(|v| split.copy(v, &mut copy_of)),
                false => split.collapse(original, &mut copy_of, &mut collapsed),
            });
            split.triangles.push(corners);
        }
        Ok(split)
    }

    /// Copies of three vertices at the same lightmap point: that of the first vertex that has a
    /// copy. `made` remembers copies by vertex and point, so that many such triangles share them.
    fn collapse(
        &mut self,
        triangle: [u32; 3],
        copy_of: &mut [u32],
        made: &mut HashMap<(u32, [u32; 2]), u32>,
    ) -> [u32; 3] {
        let has_copy = |v: &u32| copy_of[*v as usize] != u32::MAX;
        let anchor = triangle.into_iter().find(has_copy).unwrap_or(triangle[0]);
        let anchor = self.copy(anchor, copy_of);
        let uv = self.uv[anchor as usize];
        triangle.map(|v| {
            let copy = copy_of[v as usize];
            if copy != u32::MAX && self.uv[copy as usize] == uv {
                return copy;
            }
            *made.entry((v, uv.map(f32::to_bits))).or_insert_with(|| {
                self.source.push(v);
                self.uv.push(uv);
                copy_of[v as usize] = copy_of[v as usize].min(self.source.len() as u32 - 1);
                self.source.len() as u32 - 1
            })
        })
    }

    /// A new vertex that copies vertex `v`, added if there is none.
    fn copy(&mut self, v: u32, copy_of: &mut [u32]) -> u32 {
        let slot = &mut copy_of[v as usize];
        if *slot == u32::MAX {
            *slot = self.source.len() as u32;
            self.source.push(v);
            self.uv.push([0.0; 2]);
        }
        *slot
    }
}

/// Finds the original of a dropped duplicate triangle.
pub(super) struct Repeated<'a> {
    primitive: &'a Primitive,
    by_vertices: HashMap<[u32; 3], usize>,
}

impl<'a> Repeated<'a> {
    /// `any`: whether there are dropped triangles to look up.
    pub fn new(primitive: &'a Primitive, any: bool) -> Repeated<'a> {
        let mut by_vertices = HashMap::new();
        if any {
            for (i, t) in primitive.triangles.iter().enumerate() {
                let mut key = *t;
                key.sort_unstable();
                by_vertices.entry(key).or_insert(i);
            }
        }
        Repeated {
            primitive,
            by_vertices,
        }
    }

    /// The kept triangle with the same vertices, and its corner for each corner of `triangle`.
    pub fn find(&self, triangle: [u32; 3]) -> Option<(usize, [usize; 3])> {
        let mut key = triangle;
        key.sort_unstable();
        let &i = self.by_vertices.get(&key)?;
        let corners = self.primitive.triangles[i];
        let order = triangle.map(|v| corners.iter().position(|&c| c == v));
        Some((i, [order[0]?, order[1]?, order[2]?]))
    }
}

/// Elements `source` of `raw`, in that order.
pub(super) fn gather(raw: &RawAccessor<'_>, source: &[u32]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(source.len() * raw.element_size());
    for &v in source {
        bytes.extend_from_slice(raw.element(v as usize));
    }
    bytes
}

/// Adds attribute `name` with elements `source` of `raw`; `template` is the original accessor.
pub(super) fn add_gathered(
    editor: &mut Editor<'_>,
    name: &str,
    raw: &RawAccessor<'_>,
    source: &[u32],
    template: Option<usize>,
) -> usize {
    let own = template.and_then(|i| editor.json.get("accessors")?.get(i)?.as_object().cloned());
    let mut accessor = own.unwrap_or_default();
    for stale in ["min", "max", "bufferView", "byteOffset", "sparse"] {
        accessor.shift_remove(stale);
    }
    let bytes = gather(raw, source);
    if name == "POSITION" {
        let (min, max) = bounds(raw, source);
        accessor.insert("min".into(), min);
        accessor.insert("max".into(), max);
    }
    editor.add_attribute(accessor, bytes, source.len())
}

/// Minimum and maximum of three components, as stored (§3.6.2.5: integers are not normalised here).
fn bounds(raw: &RawAccessor<'_>, source: &[u32]) -> (Value, Value) {
    let stored = RawAccessor {
        normalized: false,
        ..raw.clone()
    }
    .to_floats::<3>(0.0);
    let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for v in source {
        for (c, x) in stored[*v as usize].into_iter().enumerate() {
            // f32::min and max ignore NaN.
            (min[c], max[c]) = (min[c].min(x), max[c].max(x));
        }
    }
    let number = |x: f32| match raw.component {
        mesh_ingest::DataType::F32 => json!(if x.is_finite() { f64::from(x) } else { 0.0 }),
        // Integers of 8 and 16 bits are exact in f32.
        _ => json!(x as i64),
    };
    (json!(min.map(number)), json!(max.map(number)))
}

/// Attribute accessors of `attributes` by name.
pub(super) fn accessor_of(attributes: &Map<String, Value>, name: &str) -> Option<usize> {
    super::json::index(attributes, name)
}
