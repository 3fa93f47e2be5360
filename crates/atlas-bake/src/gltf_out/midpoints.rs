//! Attributes of vertices that were added at midpoints by splitting triangles.

use std::borrow::Cow;

use gather::SplitPrimitive;
use mesh_ingest::{DataType, Primitive, RawAccessor, RawPrimitive};

use super::split::Repeated;

/// How two elements are averaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Blend {
    /// Componentwise, with integers rounded.
    Mean,
    /// The normalised mean of the first three components; a fourth (a tangent's handedness) is the
    /// first parent's.
    Direction,
    /// The first parent's element, for numbers that identify something.
    First,
}

fn blend_of(name: &str, raw: &RawAccessor<'_>) -> Blend {
    match name {
        "NORMAL" | "TANGENT" => Blend::Direction,
        _ if name.starts_with('_') && raw.component != DataType::F32 && !raw.normalized => {
            Blend::First
        }
        _ => Blend::Mean,
    }
}

/// Whether the primitive's vertices move (skin, morph targets). Midpoints would not follow them.
pub(super) fn deforms(raw: &RawPrimitive<'_>) -> bool {
    !raw.targets.is_empty() || raw.attribute("JOINTS_0").is_some()
}

/// Elements of `raw` followed by the midpoints of `parents`, packed.
pub(super) fn extended(name: &str, raw: &RawAccessor<'_>, parents: &[[u32; 2]]) -> Vec<u8> {
    let size = raw.element_size();
    let blend = blend_of(name, raw);
    let mut bytes = raw.bytes.to_vec();
    bytes.reserve(parents.len() * size);
    let components = raw.dimensions.multiplicity();
    for pair in parents {
        let [a, b] = pair.map(|v| v as usize * size);
        let new = bytes.len();
        bytes.extend_from_within(a..a + size);
        if blend == Blend::First {
            continue;
        }
        let width = raw.component.size();
        let read =
            |bytes: &[u8], at: usize, c: usize| read(raw.component, &bytes[at + c * width..]);
        let mut values: Vec<f64> = (0..components)
            .map(|c| 0.5 * (read(&bytes, a, c) + read(&bytes, b, c)))
            .collect();
        if blend == Blend::Direction {
            let length = values.iter().take(3).map(|x| x * x).sum::<f64>().sqrt();
            let unit = full_scale(raw);
            // Opposite directions have no mean, so the first parent's is used.
            if length.is_nan() || length <= 1e-3 * unit {
                continue;
            }
            values.iter_mut().take(3).for_each(|x| *x *= unit / length);
            if components > 3 {
                values[3] = read(&bytes, a, 3);
            }
        }
        for (c, x) in values.into_iter().enumerate() {
            write(raw.component, x, &mut bytes[new + c * width..]);
        }
    }
    bytes
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

/// The integer that represents 1 in a normalised accessor.
fn full_scale(raw: &RawAccessor<'_>) -> f64 {
    match raw.component {
        DataType::I8 => 127.0,
        DataType::U8 => 255.0,
        DataType::I16 => 32767.0,
        DataType::U16 => 65535.0,
        DataType::U32 | DataType::F32 => 1.0,
    }
}

fn read(component: DataType, b: &[u8]) -> f64 {
    match component {
        DataType::I8 => f64::from(b[0] as i8),
        DataType::U8 => f64::from(b[0]),
        DataType::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
        DataType::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
        DataType::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        DataType::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
    }
}

/// Rounds integers; `as` saturates at their limits.
fn write(component: DataType, x: f64, out: &mut [u8]) {
    match component {
        DataType::I8 => out[0] = (x.round() as i8) as u8,
        DataType::U8 => out[0] = x.round() as u8,
        DataType::I16 => out[..2].copy_from_slice(&(x.round() as i16).to_le_bytes()),
        DataType::U16 => out[..2].copy_from_slice(&(x.round() as u16).to_le_bytes()),
        DataType::U32 => out[..4].copy_from_slice(&(x.round() as u32).to_le_bytes()),
        DataType::F32 => out[..4].copy_from_slice(&(x as f32).to_le_bytes()),
    }
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
    use mesh_ingest::Dimensions;

    use super::*;

    fn raw(
        component: DataType,
        normalized: bool,
        dimensions: Dimensions,
        bytes: &[u8],
    ) -> RawAccessor<'_> {
        let count = bytes.len() / (dimensions.multiplicity() * component.size());
        RawAccessor {
            component,
            dimensions,
            count,
            normalized,
            bytes: bytes.into(),
        }
    }

    #[test]
    fn quantised_directions_stay_unit_and_handedness_whole() {
        // +X and +Y with w = 1 and −1, signed bytes.
        let bytes = [127, 0, 0, 127, 0, 127, 0, 129];
        let tangents = raw(DataType::I8, true, Dimensions::Vec4, &bytes);
        let out = extended("TANGENT", &tangents, &[[0, 1]]);
        // 127/√2 = 89.8.
        assert_eq!(out[8..], [90, 90, 0, 127]);
        let opposite = [127, 0, 0, 127, 129, 0, 0, 127];
        let tangents = raw(DataType::I8, true, Dimensions::Vec4, &opposite);
        assert_eq!(
            extended("TANGENT", &tangents, &[[0, 1]])[8..],
            opposite[..4]
        );
    }

    #[test]
    fn middles_of_middles_and_numbers_that_name_something() {
        let bytes = [0, 100, 201, 255];
        let weights = raw(DataType::U8, true, Dimensions::Scalar, &bytes);
        // 50, then the midpoint of 50 and 201: 125.5 is rounded away from zero.
        assert_eq!(
            extended("_PAINT", &weights, &[[0, 1], [4, 2]])[4..],
            [50, 126]
        );
        let ids = raw(DataType::U8, false, Dimensions::Scalar, &bytes);
        assert_eq!(extended("_ID", &ids, &[[1, 2], [4, 3]])[4..], [100, 100]);
        let floats: Vec<u8> = [1.0f32, 2.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let heat = raw(DataType::F32, false, Dimensions::Scalar, &floats);
        assert_eq!(
            extended("_HEAT", &heat, &[[0, 1]])[8..],
            1.5f32.to_le_bytes()
        );
    }

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
