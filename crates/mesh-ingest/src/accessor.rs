//! Accessors as dense bytes, and their conversion to numbers.

use std::borrow::Cow;

pub use gltf::accessor::{DataType, Dimensions};

/// The elements of an accessor: tightly packed, decompressed, with sparse substitution applied.
#[derive(Debug, Clone)]
pub struct RawAccessor<'a> {
    /// Type of a component.
    pub component: DataType,
    /// Shape of an element.
    pub dimensions: Dimensions,
    /// Number of elements.
    pub count: usize,
    /// Whether integers represent 0..=1 or −1..=1.
    pub normalized: bool,
    /// `count × element_size()` bytes, little-endian.
    pub bytes: Cow<'a, [u8]>,
}

/// Bytes of one element, with the column padding that the specification requires for small matrices
/// (glTF 2.0, §3.6.2.4).
pub(crate) fn element_size(component: DataType, dimensions: Dimensions) -> usize {
    match (dimensions, component.size()) {
        (Dimensions::Mat2, 1) => 8,
        (Dimensions::Mat3, 1) => 12,
        (Dimensions::Mat3, 2) => 24,
        (_, size) => dimensions.multiplicity() * size,
    }
}

/// Padding bytes at the end of an element, which a file may omit after the last one.
pub(crate) fn trailing_padding(component: DataType, dimensions: Dimensions) -> usize {
    match (dimensions, component.size()) {
        (Dimensions::Mat2, 1) | (Dimensions::Mat3, 2) => 2,
        (Dimensions::Mat3, 1) => 1,
        _ => 0,
    }
}

pub(crate) fn component_from_gl(n: usize) -> Option<DataType> {
    Some(match n {
        5120 => DataType::I8,
        5121 => DataType::U8,
        5122 => DataType::I16,
        5123 => DataType::U16,
        5125 => DataType::U32,
        5126 => DataType::F32,
        _ => return None,
    })
}

pub(crate) fn dimensions_from_name(name: &str) -> Option<Dimensions> {
    Some(match name {
        "SCALAR" => Dimensions::Scalar,
        "VEC2" => Dimensions::Vec2,
        "VEC3" => Dimensions::Vec3,
        "VEC4" => Dimensions::Vec4,
        "MAT2" => Dimensions::Mat2,
        "MAT3" => Dimensions::Mat3,
        "MAT4" => Dimensions::Mat4,
        _ => return None,
    })
}

impl RawAccessor<'_> {
    /// Bytes of one element.
    pub fn element_size(&self) -> usize {
        element_size(self.component, self.dimensions)
    }

    /// Bytes of element `i`.
    ///
    /// # Panics
    /// If `i` is not below `count`.
    pub fn element(&self, i: usize) -> &[u8] {
        let size = self.element_size();
        &self.bytes[i * size..(i + 1) * size]
    }

    /// Detaches the bytes from the document.
    pub fn into_owned(self) -> RawAccessor<'static> {
        RawAccessor {
            bytes: Cow::Owned(self.bytes.into_owned()),
            ..self
        }
    }

    /// The first `N` components of every element as numbers, with normalised integers mapped to
    /// 0..=1 or −1..=1 (glTF 2.0, §3.6.2.2). Missing components are `fill`.
    pub fn to_floats<const N: usize>(&self, fill: f32) -> Vec<[f32; N]> {
        let components = self.dimensions.multiplicity().min(N);
        let size = self.component.size();
        let (scale, low) = match (self.normalized, self.component) {
            (true, DataType::I8) => (127.0, -1.0),
            (true, DataType::U8) => (255.0, 0.0),
            (true, DataType::I16) => (32767.0, -1.0),
            (true, DataType::U16) => (65535.0, 0.0),
            _ => (1.0, f32::NEG_INFINITY),
        };
        self.bytes
            .chunks_exact(self.element_size())
            .map(|element| {
                let mut out = [fill; N];
                for (c, slot) in out.iter_mut().enumerate().take(components) {
                    let x = number(self.component, &element[c * size..]);
                    // max() would turn NaN into a bound and hide it from the sanitiser.
                    *slot = if scale == 1.0 {
                        x
                    } else {
                        (x / scale).max(low)
                    };
                }
                out
            })
            .collect()
    }

    /// A scalar unsigned accessor as numbers; `None` if it is neither.
    pub fn to_indices(&self) -> Option<Vec<u32>> {
        if self.dimensions != Dimensions::Scalar {
            return None;
        }
        Some(match self.component {
            DataType::U8 => self.bytes.iter().map(|&b| u32::from(b)).collect(),
            DataType::U16 => self
                .bytes
                .chunks_exact(2)
                .map(|b| u32::from(u16::from_le_bytes([b[0], b[1]])))
                .collect(),
            DataType::U32 => self
                .bytes
                .chunks_exact(4)
                .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                .collect(),
            _ => return None,
        })
    }
}

fn number(component: DataType, b: &[u8]) -> f32 {
    match component {
        DataType::I8 => f32::from(b[0] as i8),
        DataType::U8 => f32::from(b[0]),
        DataType::I16 => f32::from(i16::from_le_bytes([b[0], b[1]])),
        DataType::U16 => f32::from(u16::from_le_bytes([b[0], b[1]])),
        DataType::U32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32,
        DataType::F32 => f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
    }
}
