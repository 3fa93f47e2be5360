//! Decoders of compressed geometry: `EXT_meshopt_compression` and `KHR_draco_mesh_compression`.

use draco_core::{DataType as DracoType, DecodeLimits, DecoderBuffer, MeshDecoder, PointIndex};
use gltf::accessor::DataType;
use meshopt::ffi;

/// Parameters of a meshopt stream, named as in the extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Meshopt {
    pub stride: usize,
    pub count: usize,
    pub mode: Mode,
    pub filter: Filter,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Filter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

/// Decodes one buffer view; the error describes what was found.
pub(crate) fn decode_meshopt(encoded: &[u8], m: Meshopt, limit: u64) -> Result<Vec<u8>, String> {
    let strides_fit = match m.mode {
        Mode::Attributes => m.stride.is_multiple_of(4) && (4..=256).contains(&m.stride),
        Mode::Triangles => (m.stride == 2 || m.stride == 4) && m.count.is_multiple_of(3),
        Mode::Indices => m.stride == 2 || m.stride == 4,
    };
    let filter_fits = match m.filter {
        Filter::None => true,
        _ if m.mode != Mode::Attributes => false,
        Filter::Octahedral | Filter::Color => m.stride == 4 || m.stride == 8,
        Filter::Quaternion => m.stride == 8,
        Filter::Exponential => m.stride.is_multiple_of(4),
    };
    if !strides_fit || !filter_fits {
        return Err(format!(
            "stride {} with {:?} and {:?}",
            m.stride, m.mode, m.filter
        ));
    }
    // A block of at most 256 vertices takes at least stride/4 bytes, so the output is at most 1024
    // times the input. A larger claim would make us reserve memory without justification.
    const MAX_RATIO: usize = 1024;
    let size = m.stride.checked_mul(m.count).filter(|&n| n as u64 <= limit);
    let Some(size) = size.filter(|&n| n / MAX_RATIO <= encoded.len()) else {
        return Err(format!(
            "a count of {} from {} bytes",
            m.count,
            encoded.len()
        ));
    };
    let mut out = vec![0u8; size];
    let (source, length) = (encoded.as_ptr(), encoded.len());
    // SAFETY: `out` holds exactly count × stride bytes, `source` is valid for `length` bytes, and
    // the strides were checked against what meshoptimizer.h requires of each function (its own
    // checks are assertions that release builds lack). The decoders are documented as safe for
    // untrusted input and need no alignment of their destination.
    let code = unsafe {
        match m.mode {
            Mode::Attributes => ffi::meshopt_decodeVertexBuffer(
                out.as_mut_ptr().cast(),
                m.count,
                m.stride,
                source,
                length,
            ),
            Mode::Triangles => ffi::meshopt_decodeIndexBuffer(
                out.as_mut_ptr().cast(),
                m.count,
                m.stride,
                source,
                length,
            ),
            Mode::Indices => ffi::meshopt_decodeIndexSequence(
                out.as_mut_ptr().cast(),
                m.count,
                m.stride,
                source,
                length,
            ),
        }
    };
    if code != 0 {
        return Err(format!(
            "a meshopt stream that does not decode (code {code})"
        ));
    }
    if m.filter != Filter::None {
        // The filters read and write 16- and 32-bit numbers, so they need an aligned block.
        let mut words: Vec<u32> = out
            .chunks_exact(4)
            .map(|b| u32::from_ne_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        let target = words.as_mut_ptr().cast();
        // SAFETY: `words` holds count × stride bytes (stride is a multiple of 4) and is aligned for
        // 32-bit access.
        unsafe {
            match m.filter {
                Filter::Octahedral => ffi::meshopt_decodeFilterOct(target, m.count, m.stride),
                Filter::Quaternion => ffi::meshopt_decodeFilterQuat(target, m.count, m.stride),
                Filter::Exponential => ffi::meshopt_decodeFilterExp(target, m.count, m.stride),
                Filter::Color => ffi::meshopt_decodeFilterColor(target, m.count, m.stride),
                Filter::None => {}
            }
        }
        for (b, word) in out.chunks_exact_mut(4).zip(words) {
            b.copy_from_slice(&word.to_ne_bytes());
        }
    }
    Ok(out)
}

/// A decoded Draco primitive.
pub(crate) struct Draco {
    mesh: draco_core::Mesh,
}

impl Draco {
    /// Decodes a Draco stream; the error describes what was found.
    pub fn decode(encoded: &[u8], max_bytes: u64, max_faces: u64) -> Result<Draco, String> {
        let mut limits = DecodeLimits::default();
        limits.max_decoded_bytes = max_bytes;
        limits.max_faces = max_faces;
        limits.max_points = max_faces.saturating_mul(3);
        // The decoder promises errors instead of panics, but it is young and its input is
        // untrusted. A panic there must not abort a bake.
        let result = std::panic::catch_unwind(|| {
            let mut mesh = draco_core::Mesh::new();
            let mut buffer = DecoderBuffer::new(encoded).with_limits(limits);
            MeshDecoder::new()
                .decode(&mut buffer, &mut mesh)
                .map(|_| mesh)
        });
        match result {
            Ok(Ok(mesh)) => Ok(Draco { mesh }),
            Ok(Err(e)) => Err(format!("a Draco stream that does not decode ({e})")),
            Err(_) => Err("a Draco stream that does not decode".into()),
        }
    }

    pub fn points(&self) -> usize {
        self.mesh.num_points()
    }

    pub fn triangles(&self) -> Vec<[u32; 3]> {
        self.mesh
            .faces()
            .iter()
            .map(|face| face.map(|p| p.0))
            .collect()
    }

    /// The attribute with Draco's `unique_id`, as `width` components of type `component` per point.
    pub fn attribute(
        &self,
        unique_id: u32,
        component: DataType,
        width: usize,
    ) -> Result<Vec<u8>, String> {
        let Some(attribute) = self.mesh.attribute_by_unique_id(unique_id) else {
            return Err(format!("a Draco stream without attribute {unique_id}"));
        };
        if usize::from(attribute.num_components()) != width {
            return Err(format!("{} Draco components", attribute.num_components()));
        }
        let (from, stride) = (attribute.data_type(), attribute.byte_stride() as usize);
        let scalar = from.byte_length();
        let data = attribute.buffer().data();
        let mut out = Vec::with_capacity(self.points() * width * component.size());
        for point in 0..self.points() {
            let index = attribute.mapped_index(PointIndex(point as u32)).0 as usize;
            let value = index
                .checked_mul(stride)
                .and_then(|at| data.get(at..))
                .and_then(|d| d.get(..width * scalar));
            let Some(value) = value else {
                return Err(format!("Draco value {index} that is not there"));
            };
            if same(from, component) {
                out.extend_from_slice(value);
            } else {
                for part in value.chunks_exact(scalar) {
                    convert(from, part, component, &mut out)?;
                }
            }
        }
        Ok(out)
    }
}

fn same(draco: DracoType, component: DataType) -> bool {
    matches!(
        (draco, component),
        (DracoType::Int8, DataType::I8)
            | (DracoType::Uint8, DataType::U8)
            | (DracoType::Int16, DataType::I16)
            | (DracoType::Uint16, DataType::U16)
            | (DracoType::Uint32, DataType::U32)
            | (DracoType::Float32, DataType::F32)
    )
}

/// Converts values: Draco may store an attribute in another type than its accessor declares, and
/// the accessor's type wins.
fn convert(from: DracoType, b: &[u8], to: DataType, out: &mut Vec<u8>) -> Result<(), String> {
    let x = match from {
        DracoType::Int8 => f64::from(b[0] as i8),
        DracoType::Uint8 | DracoType::Bool => f64::from(b[0]),
        DracoType::Int16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
        DracoType::Uint16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
        DracoType::Int32 => f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        DracoType::Uint32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        DracoType::Float32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        other => return Err(format!("Draco values of type {other:?}")),
    };
    match to {
        DataType::I8 => out.push(x as i8 as u8),
        DataType::U8 => out.push(x as u8),
        DataType::I16 => out.extend((x as i16).to_le_bytes()),
        DataType::U16 => out.extend((x as u16).to_le_bytes()),
        DataType::U32 => out.extend((x as u32).to_le_bytes()),
        DataType::F32 => out.extend((x as f32).to_le_bytes()),
    }
    Ok(())
}
