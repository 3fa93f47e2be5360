//! Attributes of vertices that were added at midpoints by splitting triangles.

use std::borrow::Cow;

use gather::SplitPrimitive;
use mesh_ingest::{Between, Primitive, RawAccessor, RawPrimitive, blended};

use super::split::Repeated;

/// Whether the primitive's vertices move (skin, morph targets). Midpoints would not follow them.
pub(super) fn deforms(raw: &RawPrimitive<'_>) -> bool {
    !raw.targets.is_empty() || raw.attribute("JOINTS_0").is_some()
}

/// Elements of `raw` followed by the midpoints of `parents`, packed.
pub(super) fn extended(name: &str, raw: &RawAccessor<'_>, parents: &[[u32; 2]]) -> Vec<u8> {
    let middles: Vec<Between> = (parents.iter())
        .map(|&parents| Between { parents, at: 0.5 })
        .collect();
    blended(name, raw, &middles)
}

/// The attributes that colours are computed from (own colours and texture coordinates), including
/// those of added vertices. Other attributes cover only the original vertices, and triangles are
/// empty.
pub(super) fn looks<'a>(primitive: &'a Primitive, parents: &[[u32; 2]]) -> Cow<'a, Primitive> {
    if parents.is_empty() {
        return Cow::Borrowed(primitive);
    }
    let mut out = Primitive {
        colors: primitive.colors.clone(),
        tex_coords: primitive.tex_coords.clone(),
        material: primitive.material,
        ..Primitive::default()
    };
    for pair in parents {
        let [a, b] = pair.map(|v| v as usize);
        if !out.colors.is_empty() {
            out.colors.push((out.colors[a] + out.colors[b]) * 0.5);
        }
        for set in out.tex_coords.iter_mut().filter(|s| !s.is_empty()) {
            set.push((set[a] + set[b]) * 0.5);
        }
    }
    Cow::Owned(out)
}

/// All of the document's triangles in order, with those of `split` replaced by their parts. A
/// triangle that ingest dropped as a duplicate is split like its original; any other dropped
/// triangle has zero area and stays.
pub(super) fn triangles(
    primitive: &Primitive,
    raw: &RawPrimitive<'_>,
    split: &SplitPrimitive,
) -> Vec<[u32; 3]> {
    let mut kept: Vec<Option<usize>> = vec![None; raw.triangles.len()];
    for (t, &number) in primitive.source_triangles.iter().enumerate() {
        kept[number as usize] = Some(t);
    }
    let repeated = Repeated::new(primitive, kept.contains(&None));
    let parts = |t: usize| {
        let start = split.triangles.partition_point(|p| (p.0 as usize) < t);
        let end = split.triangles.partition_point(|p| (p.0 as usize) <= t);
        &split.triangles[start..end]
    };
    let mut out = Vec::with_capacity(split.triangles.len());
    for (number, &original) in raw.triangles.iter().enumerate() {
        let (of, even) = match kept[number] {
            Some(t) => (Some(t), true),
            None => match repeated.find(original) {
                Some((t, order)) => (Some(t), matches!(order, [0, 1, 2] | [1, 2, 0] | [2, 0, 1])),
                None => (None, true),
            },
        };
        let parts = of.map_or(&[][..], parts);
        if parts.is_empty() {
            out.push(original);
        }
        for &(_, [a, b, c]) in parts {
            out.push(if even { [a, b, c] } else { [a, c, b] });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_ingest_dropped_is_split_with_what_it_repeats_or_stays() {
        let primitive = Primitive {
            positions: vec![glam::Vec3::ZERO; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            source_triangles: vec![0, 3],
            ..Primitive::default()
        };
        // The second has zero area; the third is the first with reversed winding.
        let raw = RawPrimitive {
            vertex_count: 4,
            attributes: Vec::new(),
            targets: Vec::new(),
            mode: mesh_ingest::Mode::Triangles,
            triangles: vec![[0, 1, 2], [0, 0, 3], [0, 2, 1], [0, 2, 3]],
        };
        let split = SplitPrimitive {
            parents: vec![[0, 1]],
            triangles: vec![(0, [0, 4, 2]), (0, [4, 1, 2])],
        };
        assert_eq!(
            triangles(&primitive, &raw, &split),
            [
                [0, 4, 2],
                [4, 1, 2],
                [0, 0, 3],
                [0, 2, 4],
                [4, 2, 1],
                [0, 2, 3]
            ]
        );
    }
}
