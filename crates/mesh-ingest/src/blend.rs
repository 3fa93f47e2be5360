//! Attributes of vertices on the edge between two others.

use crate::accessor::{DataType, RawAccessor};

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

/// A new vertex between two others, which may be new themselves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Between {
    /// Indices of the two.
    pub parents: [u32; 2],
    /// How far it is from the first to the second, 0..=1.
    pub at: f64,
}

/// Elements of attribute `name`, followed by those of `added` vertices, packed.
pub fn blended(name: &str, raw: &RawAccessor<'_>, added: &[Between]) -> Vec<u8> {
    let size = raw.element_size();
    let blend = blend_of(name, raw);
    let mut bytes = raw.bytes.to_vec();
    bytes.reserve(added.len() * size);
    let components = raw.dimensions.multiplicity();
    for vertex in added {
        let [a, b] = vertex.parents.map(|v| v as usize * size);
        let shares = [1.0 - vertex.at, vertex.at];
        let new = bytes.len();
        bytes.extend_from_within(a..a + size);
        if blend == Blend::First {
            continue;
        }
        let width = raw.component.size();
        let read =
            |bytes: &[u8], at: usize, c: usize| read(raw.component, &bytes[at + c * width..]);
        let mut values: Vec<f64> = (0..components)
            .map(|c| shares[0] * read(&bytes, a, c) + shares[1] * read(&bytes, b, c))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accessor::Dimensions;

    fn middles(parents: &[[u32; 2]]) -> Vec<Between> {
        let middle = |&parents| Between { parents, at: 0.5 };
        parents.iter().map(middle).collect()
    }

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
        let out = blended("TANGENT", &tangents, &middles(&[[0, 1]]));
        // 127/√2 = 89.8.
        assert_eq!(out[8..], [90, 90, 0, 127]);
        let opposite = [127, 0, 0, 127, 129, 0, 0, 127];
        let tangents = raw(DataType::I8, true, Dimensions::Vec4, &opposite);
        assert_eq!(
            blended("TANGENT", &tangents, &middles(&[[0, 1]]))[8..],
            opposite[..4]
        );
    }

    #[test]
    fn middles_of_middles_and_numbers_that_name_something() {
        let bytes = [0, 100, 201, 255];
        let weights = raw(DataType::U8, true, Dimensions::Scalar, &bytes);
        // 50, then the midpoint of 50 and 201: 125.5 is rounded away from zero.
        assert_eq!(
            blended("_PAINT", &weights, &middles(&[[0, 1], [4, 2]]))[4..],
            [50, 126]
        );
        let ids = raw(DataType::U8, false, Dimensions::Scalar, &bytes);
        assert_eq!(
            blended("_ID", &ids, &middles(&[[1, 2], [4, 3]]))[4..],
            [100, 100]
        );
        let floats: Vec<u8> = [1.0f32, 2.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let heat = raw(DataType::F32, false, Dimensions::Scalar, &floats);
        assert_eq!(
            blended("_HEAT", &heat, &middles(&[[0, 1]]))[8..],
            1.5f32.to_le_bytes()
        );
    }

    #[test]
    fn a_quarter_of_the_way_takes_a_quarter() {
        let floats: Vec<u8> = [1.0f32, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let heat = raw(DataType::F32, false, Dimensions::Scalar, &floats);
        let vertex = Between {
            parents: [0, 1],
            at: 0.25,
        };
        assert_eq!(
            blended("_HEAT", &heat, &[vertex])[8..],
            1.5f32.to_le_bytes()
        );
    }
}
