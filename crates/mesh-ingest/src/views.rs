//! Buffer views and accessors: bounds, decompression, dense elements.

use std::borrow::Cow;
use std::ops::Range;

use crate::accessor::{
    DataType, Dimensions, RawAccessor, component_from_gl, dimensions_from_name, element_size,
    trailing_padding,
};
use crate::compress::{self, Filter, Meshopt, Mode};
use crate::document::Document;
use crate::error::{Fault, Outcome};
use crate::json::Item;

/// A buffer view, validated against its buffer.
#[derive(Debug, Clone)]
pub(crate) struct View {
    path: String,
    buffer: usize,
    offset: usize,
    /// Bytes after decoding.
    pub length: usize,
    pub stride: Option<usize>,
    pub meshopt: Option<(Meshopt, usize, usize, usize)>,
}

/// An accessor's parameters without its data.
#[derive(Debug)]
pub(crate) struct Head {
    pub component: DataType,
    pub dimensions: Dimensions,
    pub count: usize,
    pub normalized: bool,
    pub view: Option<usize>,
    offset: usize,
    sparse: Option<Sparse>,
    pub path: String,
}

#[derive(Debug)]
struct Sparse {
    count: usize,
    index: DataType,
    index_view: usize,
    index_offset: usize,
    value_view: usize,
    value_offset: usize,
    path: String,
}

impl Document {
    pub(crate) fn view_at(&self, i: usize) -> Outcome<View> {
        let item = self.root().element("bufferViews", i)?;
        let buffer = item.uint("buffer")?;
        let offset = item.opt_uint("byteOffset")?.unwrap_or(0);
        let length = item.uint("byteLength")?;
        let stride = item.opt_uint("byteStride")?;
        let known = |path: String, b: usize| {
            if b < self.buffers.len() {
                Ok(())
            } else {
                Err(Fault::invalid(
                    path,
                    format!("{b}"),
                    format!("an index into buffers, which has {}", self.buffers.len()),
                ))
            }
        };
        known(item.path_of("buffer"), buffer)?;
        let extension = match item.extension("EXT_meshopt_compression")? {
            None => item.extension("KHR_meshopt_compression")?,
            some => some,
        };
        let meshopt = match extension {
            None => None,
            Some(ext) => {
                let source = ext.uint("buffer")?;
                known(ext.path_of("buffer"), source)?;
                let mode = match ext.opt_str("mode")? {
                    Some("ATTRIBUTES") => Mode::Attributes,
                    Some("TRIANGLES") => Mode::Triangles,
                    Some("INDICES") => Mode::Indices,
                    other => {
                        let expected = "ATTRIBUTES, TRIANGLES or INDICES";
                        return Err(Fault::invalid(
                            ext.path_of("mode"),
                            format!("{other:?}"),
                            expected,
                        ));
                    }
                };
                let filter = match ext.opt_str("filter")? {
                    None | Some("NONE") => Filter::None,
                    Some("OCTAHEDRAL") => Filter::Octahedral,
                    Some("QUATERNION") => Filter::Quaternion,
                    Some("EXPONENTIAL") => Filter::Exponential,
                    Some("COLOR") => Filter::Color,
                    Some(other) => {
                        return Err(Fault::unsupported(
                            ext.path_of("filter"),
                            format!("\"{other}\""),
                            "a known filter",
                        ));
                    }
                };
                let parameters = Meshopt {
                    stride: ext.uint("byteStride")?,
                    count: ext.uint("count")?,
                    mode,
                    filter,
                };
                if parameters.stride.checked_mul(parameters.count) != Some(length) {
                    return Err(Fault::invalid(
                        ext.path_of("count"),
                        format!(
                            "{} elements of {} bytes",
                            parameters.count, parameters.stride
                        ),
                        format!("bufferView.byteLength, which is {length}"),
                    ));
                }
                Some((
                    parameters,
                    source,
                    ext.opt_uint("byteOffset")?.unwrap_or(0),
                    ext.uint("byteLength")?,
                ))
            }
        };
        Ok(View {
            path: item.path,
            buffer,
            offset,
            length,
            stride,
            meshopt,
        })
    }

    pub(crate) fn view_bytes(&self, i: usize, view: &View) -> Outcome<&[u8]> {
        let slice = |buffer: usize, offset: usize, length: usize| -> Outcome<&[u8]> {
            let Some(bytes) = &self.buffers[buffer] else {
                return Err(Fault::invalid(
                    format!("buffers[{buffer}]"),
                    "no data (neither uri nor binary chunk)",
                    "data",
                ));
            };
            offset
                .checked_add(length)
                .and_then(|end| bytes.get(offset..end))
                .ok_or_else(|| {
                    Fault::invalid(
                        view.path.clone(),
                        format!("bytes {offset}..{}", offset as u128 + length as u128),
                        format!("a range within buffers[{buffer}] of {} bytes", bytes.len()),
                    )
                })
        };
        let Some((parameters, buffer, offset, length)) = view.meshopt else {
            return slice(view.buffer, view.offset, view.length);
        };
        let encoded = slice(buffer, offset, length)?;
        self.decoded[i]
            .get_or_init(|| {
                compress::decode_meshopt(encoded, parameters, self.limits.decoded_bytes)
            })
            .as_deref()
            .map_err(|found| {
                Fault::invalid(
                    format!("{}.extensions", view.path),
                    found.clone(),
                    "a valid meshopt stream",
                )
            })
    }

    /// Checks a view's bounds without decoding it.
    pub(crate) fn check_view(&self, view: &View) -> Outcome<()> {
        let within = |buffer: usize, offset: usize, length: usize| match self.buffers.get(buffer) {
            Some(Some(bytes)) => offset
                .checked_add(length)
                .is_some_and(|end| end <= bytes.len()),
            _ => true,
        };
        let (buffer, offset, length) = match view.meshopt {
            Some((_, buffer, offset, length)) => (buffer, offset, length),
            None => (view.buffer, view.offset, view.length),
        };
        if within(buffer, offset, length) {
            return Ok(());
        }
        Err(Fault::invalid(
            view.path.clone(),
            format!("{length} bytes from {offset}"),
            format!(
                "a range within buffers[{buffer}] of {} bytes",
                self.buffer(buffer).len()
            ),
        ))
    }

    /// Checks that an accessor's elements are inside their views, without reading them.
    pub(crate) fn check_accessor(&self, head: &Head) -> Outcome<()> {
        let size = element_size(head.component, head.dimensions);
        let spare = trailing_padding(head.component, head.dimensions);
        if let Some(v) = head.view {
            self.element_range(
                &self.view_at(v)?,
                head.offset,
                [size, spare],
                head.count,
                &head.path,
            )?;
        }
        if let Some(s) = &head.sparse {
            self.element_range(
                &self.view_at(s.index_view)?,
                s.index_offset,
                [s.index.size(), 0],
                s.count,
                &s.path,
            )?;
            self.element_range(
                &self.view_at(s.value_view)?,
                s.value_offset,
                [size, 0],
                s.count,
                &s.path,
            )?;
        }
        Ok(())
    }

    pub(crate) fn accessor(&self, i: usize) -> Outcome<RawAccessor<'_>> {
        let head = self.accessor_head(i)?;
        let size = element_size(head.component, head.dimensions);
        let spare = trailing_padding(head.component, head.dimensions);
        let total = size.saturating_mul(head.count);
        let mut bytes = match head.view {
            Some(v) => self.dense(v, head.offset, [size, spare], head.count, &head.path)?,
            None if total as u64 > self.limits.unbacked_bytes => {
                return Err(Fault::limit(
                    format!("{}.count", head.path),
                    format!("{} zeros without a buffer view ({total} bytes)", head.count),
                    format!("at most {} bytes", self.limits.unbacked_bytes),
                ));
            }
            None => Cow::Owned(vec![0; total]),
        };
        if let Some(sparse) = head.sparse {
            let at = self.dense(
                sparse.index_view,
                sparse.index_offset,
                [sparse.index.size(), 0],
                sparse.count,
                &sparse.path,
            )?;
            let values = self.dense(
                sparse.value_view,
                sparse.value_offset,
                [size, 0],
                sparse.count,
                &sparse.path,
            )?;
            let target = bytes.to_mut();
            for (k, raw) in at.chunks_exact(sparse.index.size()).enumerate() {
                let index = raw
                    .iter()
                    .rev()
                    .fold(0usize, |n, &b| n << 8 | usize::from(b));
                let Some(slot) = target
                    .get_mut(index.saturating_mul(size)..)
                    .and_then(|t| t.get_mut(..size))
                else {
                    return Err(Fault::invalid(
                        format!("{}.indices", sparse.path),
                        format!("index {index}"),
                        format!("an index below {}", head.count),
                    ));
                };
                slot.copy_from_slice(&values[k * size..(k + 1) * size]);
            }
        }
        let normalized = head.normalized;
        Ok(RawAccessor {
            component: head.component,
            dimensions: head.dimensions,
            count: head.count,
            normalized,
            bytes,
        })
    }

    /// `count` elements of `size` bytes from a view, made contiguous if they are strided.
    fn dense(
        &self,
        v: usize,
        offset: usize,
        [size, spare]: [usize; 2],
        count: usize,
        path: &str,
    ) -> Outcome<Cow<'_, [u8]>> {
        let view = self.view_at(v)?;
        let bytes = self.view_bytes(v, &view)?;
        let (stride, range) = self.element_range(&view, offset, [size, spare], count, path)?;
        // The view's declared length was checked against its bytes, so this holds for plain and
        // decoded views.
        let range = bytes.get(range).unwrap_or_default();
        if stride == size && range.len() == count * size {
            return Ok(Cow::Borrowed(range));
        }
        let mut out = Vec::with_capacity(count * size);
        for element in range.chunks(stride) {
            out.extend_from_slice(&element[..size.min(element.len())]);
        }
        out.resize(count * size, 0);
        Ok(Cow::Owned(out))
    }

    /// Stride and byte range of `count` elements of `size` bytes in a view; the last `spare` bytes
    /// are padding.
    fn element_range(
        &self,
        view: &View,
        offset: usize,
        [size, spare]: [usize; 2],
        count: usize,
        path: &str,
    ) -> Outcome<(usize, Range<usize>)> {
        let stride = view.stride.unwrap_or(size);
        if stride < size {
            return Err(Fault::invalid(
                format!("{}.byteStride", view.path),
                format!("{stride}"),
                format!("at least {size}, the size of an element of {path}"),
            ));
        }
        let end = count.checked_sub(1).and_then(|n| {
            // Files may leave off the padding after the last element.
            n.checked_mul(stride)?
                .checked_add(size - spare)?
                .checked_add(offset)
        });
        match end.filter(|&end| end <= view.length) {
            Some(end) => Ok((stride, offset..end)),
            None => Err(Fault::invalid(
                path,
                format!("{count} elements of {size} bytes every {stride} from byte {offset}"),
                format!(
                    "elements inside {}, which has {} bytes",
                    view.path, view.length
                ),
            )),
        }
    }

    pub(crate) fn accessor_head(&self, i: usize) -> Outcome<Head> {
        let item = self.root().element("accessors", i)?;
        let views = self.decoded.len();
        let component = |item: &Item<'_>| {
            let n = item.uint("componentType")?;
            component_from_gl(n).ok_or_else(|| {
                Fault::invalid(
                    item.path_of("componentType"),
                    format!("{n}"),
                    "5120, 5121, 5122, 5123, 5125 or 5126",
                )
            })
        };
        let count = item.uint("count")?;
        if count == 0 {
            return Err(Fault::invalid(item.path_of("count"), "0", "at least 1"));
        }
        let name = item.opt_str("type")?.unwrap_or_default();
        let Some(dimensions) = dimensions_from_name(name) else {
            return Err(Fault::invalid(
                item.path_of("type"),
                format!("\"{name}\""),
                "SCALAR, VEC2..VEC4 or MAT2..MAT4",
            ));
        };
        let sparse = match item.opt_object("sparse")? {
            None => None,
            Some(sparse) => {
                let missing = |key| Fault::invalid(sparse.path_of(key), "nothing", "an object");
                let indices = sparse
                    .opt_object("indices")?
                    .ok_or_else(|| missing("indices"))?;
                let values = sparse
                    .opt_object("values")?
                    .ok_or_else(|| missing("values"))?;
                let view = |item: &Item<'_>| {
                    item.opt_index("bufferView", "bufferViews", views)?
                        .ok_or_else(|| {
                            Fault::invalid(item.path_of("bufferView"), "nothing", "an index")
                        })
                };
                let sparse_count = sparse.uint("count")?;
                if sparse_count == 0 || sparse_count > count {
                    return Err(Fault::invalid(
                        sparse.path_of("count"),
                        format!("{sparse_count}"),
                        format!("1..={count}"),
                    ));
                }
                let index = component(&indices)?;
                if !matches!(index.as_gl_enum(), 5121 | 5123 | 5125) {
                    return Err(Fault::invalid(
                        indices.path_of("componentType"),
                        format!("{index:?}"),
                        "an unsigned type",
                    ));
                }
                Some(Sparse {
                    count: sparse_count,
                    index,
                    index_view: view(&indices)?,
                    index_offset: indices.opt_uint("byteOffset")?.unwrap_or(0),
                    value_view: view(&values)?,
                    value_offset: values.opt_uint("byteOffset")?.unwrap_or(0),
                    path: sparse.path,
                })
            }
        };
        Ok(Head {
            component: component(&item)?,
            dimensions,
            count,
            normalized: item.opt_bool("normalized")?.unwrap_or(false),
            view: item.opt_index("bufferView", "bufferViews", views)?,
            offset: item.opt_uint("byteOffset")?.unwrap_or(0),
            sparse,
            path: item.path,
        })
    }
}
