//! The document as it came: JSON, buffers, and dense access to what they hold.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::Value;

use crate::accessor::{RawAccessor, component_from_gl, dimensions_from_name, element_size};
use crate::compress::{self, Filter, Meshopt, Mode};
use crate::container::{self, Target};
use crate::error::{Error, Fault, Faults, Outcome};
use crate::json::Item;
use crate::options::Limits;

/// A glTF document with its buffers, for those who write it back.
///
/// Nothing in [`json`](Document::json) is changed, unknown members and extensions included, and member order is kept.
#[derive(Debug)]
pub struct Document {
    file: PathBuf,
    base: PathBuf,
    json: Value,
    binary: bool,
    buffers: Vec<Option<Vec<u8>>>,
    /// Decoded `EXT_meshopt_compression` views, filled on first use: several accessors usually share one.
    decoded: Vec<OnceLock<Result<Vec<u8>, String>>>,
    inputs: Vec<PathBuf>,
    input_uris: Vec<String>,
    limits: Limits,
}

/// Where an image's file lies.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageSource<'a> {
    /// In the document (a buffer view or a data URI).
    Embedded(Cow<'a, [u8]>),
    /// In a file of its own.
    File(PathBuf),
}

/// A buffer view, checked against its buffer.
#[derive(Debug, Clone)]
pub(crate) struct View {
    path: String,
    buffer: usize,
    offset: usize,
    /// Bytes once decoded.
    pub length: usize,
    pub stride: Option<usize>,
    meshopt: Option<(Meshopt, usize, usize, usize)>,
}

impl Document {
    /// Reads the document and its buffers; images are left for [`Document::image_source`].
    pub(crate) fn open(file: &Path, limits: &Limits) -> Result<Document, Error> {
        let fail = |fault: Fault| fault.into_error(file);
        let bytes = container::read_file(file, "", limits.file_bytes).map_err(fail)?;
        let container = container::parse(bytes).map_err(fail)?;
        let base = file.parent().map(Path::to_path_buf).unwrap_or_default();
        let mut document = Document {
            file: file.to_path_buf(),
            base,
            json: container.json,
            binary: container.binary,
            buffers: Vec::new(),
            decoded: Vec::new(),
            inputs: vec![file.to_path_buf()],
            input_uris: Vec::new(),
            limits: limits.clone(),
        };
        check_version(&document.root()).map_err(fail)?;
        let views = document.root().len_of("bufferViews").map_err(fail)?;
        document.decoded.resize_with(views, OnceLock::new);
        document.read_buffers(container.chunk)?;
        Ok(document)
    }

    fn read_buffers(&mut self, mut chunk: Option<Vec<u8>>) -> Result<(), Error> {
        let mut faults = Faults::default();
        let count = faults.take(self.root().len_of("buffers")).unwrap_or(0);
        let (mut buffers, mut files) = (Vec::with_capacity(count), Vec::new());
        for i in 0..count {
            let read = self.read_buffer(i, &mut chunk, &mut files);
            buffers.push(faults.take(read).flatten());
        }
        faults.check(&self.file)?;
        self.buffers = buffers;
        for (file, uri) in files {
            self.note_input(file, uri);
        }
        Ok(())
    }

    fn read_buffer(
        &self,
        i: usize,
        chunk: &mut Option<Vec<u8>>,
        files: &mut Vec<(PathBuf, String)>,
    ) -> Outcome<Option<Vec<u8>>> {
        let item = self.root().element("buffers", i)?;
        let length = item.uint("byteLength")?;
        let path = item.path_of("uri");
        let mut bytes = match item.opt_str("uri")? {
            Some(uri) => match container::resolve(uri, &self.base, &path)? {
                Target::Data(bytes) => bytes,
                Target::File(file) => {
                    let bytes = container::read_file(&file, &path, self.limits.file_bytes)?;
                    files.push((file, uri.to_string()));
                    bytes
                }
            },
            None if i == 0 && chunk.is_some() => chunk.take().unwrap_or_default(),
            // A placeholder that only compressed views refer to; who else does is told so.
            None => return Ok(None),
        };
        if bytes.len() < length {
            return Err(Fault::invalid(
                item.path_of("byteLength"),
                format!("{length}"),
                format!("at most the {} bytes that there are", bytes.len()),
            ));
        }
        bytes.truncate(length);
        Ok(Some(bytes))
    }

    pub(crate) fn note_input(&mut self, file: PathBuf, uri: String) {
        if !self.inputs.contains(&file) {
            self.inputs.push(file);
            self.input_uris.push(uri);
        }
    }

    pub(crate) fn root(&self) -> Item<'_> {
        Item::root(&self.json)
    }

    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    pub(crate) fn input_uris(&self) -> &[String] {
        &self.input_uris
    }

    /// The document's file.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The folder against which its URIs are resolved.
    pub fn base_dir(&self) -> &Path {
        &self.base
    }

    /// Whether it came as .glb.
    pub fn is_binary(&self) -> bool {
        self.binary
    }

    /// The parsed JSON, member order kept.
    pub fn json(&self) -> &Value {
        &self.json
    }

    /// All files that were read: the document first, then buffers and images, each once. For a depfile.
    pub fn inputs(&self) -> &[PathBuf] {
        &self.inputs
    }

    /// Number of buffers.
    pub fn buffer_count(&self) -> usize {
        self.buffers.len()
    }

    /// Bytes of buffer `i`, `byteLength` of them; empty for a placeholder without data (`EXT_meshopt_compression`'s fallback)
    /// and for an index that does not exist.
    pub fn buffer(&self, i: usize) -> &[u8] {
        self.buffers
            .get(i)
            .and_then(Option::as_deref)
            .unwrap_or_default()
    }

    /// Bytes of buffer view `i`, decompressed where it is compressed with meshopt.
    ///
    /// # Errors
    /// The view does not exist, lies outside its buffer or does not decode.
    pub fn buffer_view_bytes(&self, i: usize) -> Result<&[u8], Error> {
        self.view_at(i)
            .and_then(|view| self.view_bytes(i, &view))
            .map_err(|f| f.into_error(&self.file))
    }

    /// Elements of accessor `i`, dense.
    ///
    /// # Errors
    /// The accessor does not exist, lies outside its view, or exceeds the limits.
    pub fn accessor_raw(&self, i: usize) -> Result<RawAccessor<'_>, Error> {
        self.accessor(i).map_err(|f| f.into_error(&self.file))
    }

    /// Where image `i` lies.
    ///
    /// # Errors
    /// The image does not exist or names something that cannot be resolved.
    pub fn image_source(&self, i: usize) -> Result<ImageSource<'_>, Error> {
        self.image(i).map_err(|f| f.into_error(&self.file))
    }

    /// The bytes of image `i`'s file, undecoded.
    ///
    /// # Errors
    /// As [`Document::image_source`], and when the file cannot be read.
    pub fn image_bytes(&self, i: usize) -> Result<Cow<'_, [u8]>, Error> {
        match self.image_source(i)? {
            ImageSource::Embedded(bytes) => Ok(bytes),
            ImageSource::File(file) => {
                container::read_file(&file, &format!("images[{i}].uri"), self.limits.file_bytes)
                    .map(Cow::Owned)
                    .map_err(|f| f.into_error(&self.file))
            }
        }
    }

    pub(crate) fn image(&self, i: usize) -> Outcome<ImageSource<'_>> {
        let item = self.root().element("images", i)?;
        if let Some(uri) = item.opt_str("uri")? {
            return Ok(
                match container::resolve(uri, &self.base, &item.path_of("uri"))? {
                    Target::Data(bytes) => ImageSource::Embedded(Cow::Owned(bytes)),
                    Target::File(file) => ImageSource::File(file),
                },
            );
        }
        let views = self.decoded.len();
        match item.opt_index("bufferView", "bufferViews", views)? {
            Some(v) => Ok(ImageSource::Embedded(Cow::Borrowed(
                self.view_bytes(v, &self.view_at(v)?)?,
            ))),
            None => Err(Fault::invalid(
                item.path,
                "neither uri nor bufferView",
                "one of them",
            )),
        }
    }

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
                    "a sound meshopt stream",
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

    /// Checks that an accessor's elements lie within their views, without reading them.
    pub(crate) fn check_accessor(&self, head: &Head) -> Outcome<()> {
        let size = element_size(head.component, head.dimensions);
        if let Some(v) = head.view {
            self.element_range(&self.view_at(v)?, head.offset, size, head.count, &head.path)?;
        }
        if let Some(s) = &head.sparse {
            self.element_range(
                &self.view_at(s.index_view)?,
                s.index_offset,
                s.index.size(),
                s.count,
                &s.path,
            )?;
            self.element_range(
                &self.view_at(s.value_view)?,
                s.value_offset,
                size,
                s.count,
                &s.path,
            )?;
        }
        Ok(())
    }

    pub(crate) fn accessor(&self, i: usize) -> Outcome<RawAccessor<'_>> {
        let head = self.accessor_head(i)?;
        let size = element_size(head.component, head.dimensions);
        let total = size.saturating_mul(head.count);
        let mut bytes = match head.view {
            Some(v) => self.dense(v, head.offset, size, head.count, &head.path)?,
            None if total as u64 > self.limits.unbacked_bytes => {
                return Err(Fault::limit(
                    format!("{}.count", head.path),
                    format!(
                        "{} zeros that no buffer view backs ({total} bytes)",
                        head.count
                    ),
                    format!("at most {} bytes", self.limits.unbacked_bytes),
                ));
            }
            None => Cow::Owned(vec![0; total]),
        };
        if let Some(sparse) = head.sparse {
            let at = self.dense(
                sparse.index_view,
                sparse.index_offset,
                sparse.index.size(),
                sparse.count,
                &sparse.path,
            )?;
            let values = self.dense(
                sparse.value_view,
                sparse.value_offset,
                size,
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

    /// `count` elements of `size` bytes from a view, gathered if they are strided.
    fn dense(
        &self,
        v: usize,
        offset: usize,
        size: usize,
        count: usize,
        path: &str,
    ) -> Outcome<Cow<'_, [u8]>> {
        let view = self.view_at(v)?;
        let bytes = self.view_bytes(v, &view)?;
        let (stride, range) = self.element_range(&view, offset, size, count, path)?;
        // The view's declared length was checked against its bytes, so this holds for plain and decoded views alike.
        let range = bytes.get(range).unwrap_or_default();
        if stride == size {
            return Ok(Cow::Borrowed(range));
        }
        let mut out = Vec::with_capacity(count * size);
        for element in range.chunks(stride) {
            out.extend_from_slice(&element[..size]);
        }
        Ok(Cow::Owned(out))
    }

    /// Stride and byte range of `count` elements of `size` bytes within a view.
    fn element_range(
        &self,
        view: &View,
        offset: usize,
        size: usize,
        count: usize,
        path: &str,
    ) -> Outcome<(usize, std::ops::Range<usize>)> {
        let stride = view.stride.unwrap_or(size);
        if stride < size {
            return Err(Fault::invalid(
                format!("{}.byteStride", view.path),
                format!("{stride}"),
                format!("at least {size}, the size of an element of {path}"),
            ));
        }
        let end = count.checked_sub(1).and_then(|n| {
            n.checked_mul(stride)?
                .checked_add(size)?
                .checked_add(offset)
        });
        match end.filter(|&end| end <= view.length) {
            Some(end) => Ok((stride, offset..end)),
            None => Err(Fault::invalid(
                path,
                format!("{count} elements of {size} bytes every {stride} from byte {offset}"),
                format!(
                    "elements within {}, which has {} bytes",
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

/// An accessor's own numbers, without its data.
#[derive(Debug)]
pub(crate) struct Head {
    pub component: gltf::accessor::DataType,
    pub dimensions: gltf::accessor::Dimensions,
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
    index: gltf::accessor::DataType,
    index_view: usize,
    index_offset: usize,
    value_view: usize,
    value_offset: usize,
    path: String,
}

/// Accepts 2.x documents whose `minVersion` is at most 2.0.
fn check_version(root: &Item<'_>) -> Outcome<()> {
    let number = |text: &str| -> Option<(u32, u32)> {
        let (major, minor) = text.split_once('.')?;
        Some((major.parse().ok()?, minor.parse().ok()?))
    };
    let missing = || Fault::invalid("asset.version", "nothing", "\"2.0\"");
    let Some(asset) = root.get("asset") else {
        // glTF 1.0 may lack it; its top-level collections are objects instead of arrays.
        if ["meshes", "accessors", "nodes"]
            .iter()
            .any(|k| root.value.get(k).is_some_and(Value::is_object))
        {
            return Err(Fault::unsupported(
                "asset",
                "nothing, as in glTF 1.0",
                container::UPGRADE,
            ));
        }
        return Err(missing());
    };
    let asset = asset.object()?;
    let version = asset.opt_str("version");
    // glTF 1.0 files in the wild write the version as a number.
    let version = match version {
        Err(_) if asset.value.get("version").and_then(Value::as_f64) == Some(1.0) => "1.0",
        other => other?.ok_or_else(missing)?,
    };
    match number(version) {
        Some((1, _)) => {
            return Err(Fault::unsupported(
                "asset.version",
                format!("\"{version}\""),
                container::UPGRADE,
            ));
        }
        Some((2, _)) => {}
        Some(_) => {
            return Err(Fault::unsupported(
                "asset.version",
                format!("\"{version}\""),
                "\"2.0\"",
            ));
        }
        None => {
            return Err(Fault::invalid(
                "asset.version",
                format!("\"{version}\""),
                "\"2.0\"",
            ));
        }
    }
    if let Some(least) = asset.opt_str("minVersion")? {
        match number(least) {
            Some(least) if number(version).is_some_and(|version| least > version) => {
                return Err(Fault::invalid(
                    "asset.minVersion",
                    format!("{least:?}"),
                    format!("at most {version}"),
                ));
            }
            Some((2, 0)) => {}
            Some(_) => {
                return Err(Fault::unsupported(
                    "asset.minVersion",
                    format!("\"{least}\""),
                    "\"2.0\"",
                ));
            }
            None => {
                return Err(Fault::invalid(
                    "asset.minVersion",
                    format!("\"{least}\""),
                    "\"2.0\"",
                ));
            }
        }
    }
    Ok(())
}
