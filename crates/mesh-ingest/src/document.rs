//! The original document: JSON, buffers, and dense access to their contents.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use serde_json::Value;

use crate::accessor::RawAccessor;
use crate::container;
use crate::cuts;
use crate::error::{Error, Fault, Faults, Outcome};
use crate::files::{Files, MemoryDocument};
use crate::input::{Digest, Input};
use crate::json::Item;
use crate::options::{Limits, LoadOptions};
use crate::sides;
use crate::uri::Target;
use crate::version;

/// A glTF document with its buffers, for writers.
///
/// [`json`](Document::json) is unchanged, including unknown members and extensions and the order of
/// members.
#[derive(Debug)]
pub struct Document {
    file: PathBuf,
    base: PathBuf,
    pub(crate) files: Files,
    on_disk: bool,
    json: Value,
    binary: bool,
    pub(crate) buffers: Vec<Option<Vec<u8>>>,
    /// Decoded `EXT_meshopt_compression` views, filled on first use, because several accessors
    /// usually share one.
    pub(crate) decoded: Vec<OnceLock<Result<Vec<u8>, String>>>,
    inputs: Vec<Input>,
    /// Image files that only writers requested, by image.
    written: Mutex<BTreeMap<usize, Input>>,
    /// Images that could not be read when the document was loaded.
    pub(crate) missing: BTreeSet<usize>,
    pub(crate) limits: Limits,
}

/// Location of an image file.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageSource<'a> {
    /// In the document (a buffer view or a data URI).
    Embedded(Cow<'a, [u8]>),
    /// In a separate file; only a name if the caller's resolver provides files.
    File(PathBuf),
}

impl Document {
    /// Reads the document and its buffers, without a scene. Images are read later through
    /// [`Document::image_source`]; other files that the document names are not read.
    ///
    /// # Errors
    /// The document or a buffer cannot be read.
    pub fn open(file: &Path, options: &LoadOptions) -> Result<Document, Error> {
        let bytes = container::read_file(file, "", options.limits.file_bytes)
            .map_err(|fault| fault.into_error(file))?;
        let base = file.parent().map(Path::to_path_buf).unwrap_or_default();
        Self::new(file, &bytes, Files::in_folder(base), true, options)
    }

    /// As [`Document::open`], for a document in memory.
    pub(crate) fn in_memory(
        from: &MemoryDocument,
        options: &LoadOptions,
    ) -> Result<Document, Error> {
        let (bytes, limits) = (&from.bytes, &options.limits);
        if bytes.len() as u64 > limits.file_bytes {
            let found = format!("{} bytes", bytes.len());
            let allowed = format!("at most {}", limits.file_bytes);
            return Err(Fault::limit("", found, allowed).into_error(&from.name));
        }
        Self::new(&from.name, bytes, from.files.clone(), false, options)
    }

    fn new(
        file: &Path,
        bytes: &[u8],
        files: Files,
        on_disk: bool,
        options: &LoadOptions,
    ) -> Result<Document, Error> {
        let fail = |fault: Fault| fault.into_error(file);
        let input = Input::new(file.to_path_buf(), String::new(), bytes);
        let container = container::parse(bytes).map_err(fail)?;
        let base = files.folder().map(Path::to_path_buf).unwrap_or_default();
        let mut document = Document {
            file: file.to_path_buf(),
            base,
            files: files.allow_outside(options.allow_outside),
            on_disk,
            json: container.json,
            binary: container.binary,
            buffers: Vec::new(),
            decoded: Vec::new(),
            inputs: vec![input],
            written: Mutex::default(),
            missing: BTreeSet::new(),
            limits: options.limits.clone(),
        };
        version::check(&document.root()).map_err(fail)?;
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
        files.into_iter().for_each(|f| self.note_input(f));
        Ok(())
    }

    fn read_buffer(
        &self,
        i: usize,
        chunk: &mut Option<Vec<u8>>,
        files: &mut Vec<Input>,
    ) -> Outcome<Option<Vec<u8>>> {
        let item = self.root().element("buffers", i)?;
        let length = item.uint("byteLength")?;
        let path = item.path_of("uri");
        let mut bytes = match item.opt_str("uri")? {
            Some(uri) => match self.files.resolve(uri, &path)? {
                Target::Data(bytes) => bytes,
                Target::File(file) => {
                    let bytes = self.files.read(&file, &path, self.limits.file_bytes)?;
                    files.push(Input::new(file, uri.to_string(), &bytes));
                    bytes
                }
            },
            None if i == 0 && chunk.is_some() => chunk.take().unwrap_or_default(),
            // A placeholder that only compressed views reference; other references are reported as
            // errors.
            None => return Ok(None),
        };
        if bytes.len() < length {
            return Err(Fault::invalid(
                item.path_of("byteLength"),
                format!("{length}"),
                format!("at most the {} available bytes", bytes.len()),
            ));
        }
        bytes.truncate(length);
        Ok(Some(bytes))
    }

    pub(crate) fn note_input(&mut self, input: Input) {
        if !self.inputs.iter().any(|i| i.file == input.file) {
            self.inputs.push(input);
        }
    }

    /// Adds a buffer; returns its index.
    pub(crate) fn add_buffer(&mut self, bytes: Vec<u8>) -> usize {
        let index = self.buffers.len();
        if let Some(list) = self.json["buffers"].as_array_mut() {
            list.push(serde_json::json!({ "byteLength": bytes.len() }));
        }
        self.buffers.push(Some(bytes));
        index
    }

    /// The JSON, for changes before anything is read from it. Call
    /// [`refresh_views`](Self::refresh_views) after adding buffer views.
    pub(crate) fn json_mut(&mut self) -> &mut Value {
        &mut self.json
    }

    /// Makes room for the decoded contents of all buffer views.
    pub(crate) fn refresh_views(&mut self) {
        let views = self.json["bufferViews"].as_array().map_or(0, Vec::len);
        self.decoded.resize_with(views, OnceLock::new);
    }

    pub(crate) fn root(&self) -> Item<'_> {
        Item::root(&self.json)
    }

    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Names of the files read so far, as in the document, without the document itself.
    pub(crate) fn input_uris(&self) -> Vec<String> {
        self.inputs[1..].iter().map(|i| i.uri.clone()).collect()
    }

    /// The document's file, or the name that stands for one if it came from memory.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The folder against which its URIs are resolved; empty if the caller's resolver does that.
    pub fn base_dir(&self) -> &Path {
        &self.base
    }

    /// Whether it is a .glb.
    pub fn is_binary(&self) -> bool {
        self.binary
    }

    /// The parsed JSON with the original order of members. Indices and counts that were written as
    /// floats (`1.0`) are integers.
    pub fn json(&self) -> &Value {
        &self.json
    }

    /// Whether the two sides of a primitive can become separate ones; see
    /// [`LoadOptions::split_sides`].
    pub fn can_split(&self, mesh: usize, primitive: usize) -> bool {
        let item = self.root().element("meshes", mesh);
        item.and_then(|mesh| mesh.element("primitives", primitive))
            .is_ok_and(|item| sides::can_split(&item))
    }

    /// Whether the surfaces of a mesh can be cut; see
    /// [`LoadOptions::cuts`].
    pub fn can_cut(&self, mesh: usize) -> bool {
        let item = self.root().element("meshes", mesh);
        item.is_ok_and(|item| cuts::can_cut(self, &item))
    }

    /// All files that were read, each once: the document first, then buffers, IES profiles and
    /// images. Last come those only requested through [`Document::image_bytes`], in the order of
    /// images, whether or not they exist.
    pub fn inputs(&self) -> Vec<Input> {
        let mut all = self.inputs.clone();
        let written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        for input in written.values() {
            if !all.iter().any(|i| i.file == input.file) {
                all.push(input.clone());
            }
        }
        all
    }

    /// Paths of the existing [`inputs`](Document::inputs) on disk, without those that the caller
    /// provided from memory.
    pub fn inputs_on_disk(&self) -> Vec<PathBuf> {
        let linked = self.files.folder().is_some();
        let inputs = self.inputs().into_iter().enumerate();
        inputs
            .filter(|(i, input)| {
                input.digest.is_some() && if *i == 0 { self.on_disk } else { linked }
            })
            .map(|(_, input)| input.file)
            .collect()
    }

    /// Number of buffers.
    pub fn buffer_count(&self) -> usize {
        self.buffers.len()
    }

    /// Bytes of buffer `i`, `byteLength` of them; empty for a placeholder without data (the
    /// fallback of `EXT_meshopt_compression`) and for an invalid index.
    pub fn buffer(&self, i: usize) -> &[u8] {
        self.buffers
            .get(i)
            .and_then(Option::as_deref)
            .unwrap_or_default()
    }

    /// Bytes of buffer view `i`, decompressed if it is compressed with meshopt.
    ///
    /// # Errors
    /// The view does not exist, is outside its buffer or does not decode.
    pub fn buffer_view_bytes(&self, i: usize) -> Result<&[u8], Error> {
        self.view_at(i)
            .and_then(|view| self.view_bytes(i, &view))
            .map_err(|f| f.into_error(&self.file))
    }

    /// Elements of accessor `i`, dense.
    ///
    /// # Errors
    /// The accessor does not exist, is outside its view, or exceeds the limits.
    pub fn accessor_raw(&self, i: usize) -> Result<RawAccessor<'_>, Error> {
        self.accessor(i).map_err(|f| f.into_error(&self.file))
    }

    /// Location of image `i`.
    ///
    /// # Errors
    /// The image does not exist or its URI cannot be resolved.
    pub fn image_source(&self, i: usize) -> Result<ImageSource<'_>, Error> {
        self.image(i).map_err(|f| f.into_error(&self.file))
    }

    /// Whether image `i` could not be read when the document was loaded; light does not need it in
    /// that case.
    pub fn image_is_missing(&self, i: usize) -> bool {
        self.missing.contains(&i)
    }

    /// The bytes of image `i`'s file, undecoded.
    ///
    /// # Errors
    /// As [`Document::image_source`], and when the file cannot be read.
    pub fn image_bytes(&self, i: usize) -> Result<Cow<'_, [u8]>, Error> {
        match self.image_source(i)? {
            ImageSource::Embedded(bytes) => Ok(bytes),
            ImageSource::File(file) => {
                let path = format!("images[{i}].uri");
                let read = self.files.read(&file, &path, self.limits.file_bytes);
                self.note_image(i, &file, read.as_deref().ok())
                    .map_err(|f| f.into_error(&self.file))?;
                read.map(Cow::Owned).map_err(|f| f.into_error(&self.file))
            }
        }
    }

    /// Records that image `i` was read from `file`, or could not be.
    ///
    /// # Errors
    /// The file's contents differ from those that the light was computed from.
    fn note_image(&self, i: usize, file: &Path, bytes: Option<&[u8]>) -> Outcome<()> {
        let item = self.root().element("images", i)?;
        let input = Input {
            file: file.to_path_buf(),
            uri: item.opt_str("uri")?.unwrap_or_default().to_string(),
            digest: bytes.map(Digest::of),
        };
        if let Some(known) = self.inputs.iter().find(|k| k.file == input.file)
            && known.digest != input.digest
        {
            let changed = std::io::Error::other("the file changed while it was being used");
            return Err(Fault::io(item.path_of("uri"), file, changed));
        }
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        // If two reads differ, the first is recorded: it will not match the file, which the next
        // run will notice.
        written.entry(i).or_insert(input);
        Ok(())
    }

    pub(crate) fn image(&self, i: usize) -> Outcome<ImageSource<'_>> {
        let item = self.root().element("images", i)?;
        if let Some(uri) = item.opt_str("uri")? {
            return Ok(match self.files.resolve(uri, &item.path_of("uri"))? {
                Target::Data(bytes) => ImageSource::Embedded(Cow::Owned(bytes)),
                Target::File(file) => ImageSource::File(file),
            });
        }
        let views = self.decoded.len();
        match item.opt_index("bufferView", "bufferViews", views)? {
            Some(v) => Ok(ImageSource::Embedded(Cow::Borrowed(
                self.view_bytes(v, &self.view_at(v)?)?,
            ))),
            None => Err(Fault::invalid(
                item.path,
                "neither uri nor bufferView",
                "one of the two",
            )),
        }
    }
}
