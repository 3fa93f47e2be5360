//! The document as it came: JSON, buffers, and dense access to what they hold.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use serde_json::Value;

use crate::accessor::RawAccessor;
use crate::container;
use crate::error::{Error, Fault, Faults, Outcome};
use crate::files::{Files, MemoryDocument};
use crate::input::{Digest, Input};
use crate::json::Item;
use crate::options::{Limits, LoadOptions};
use crate::uri::Target;
use crate::version;

/// A glTF document with its buffers, for those who write it back.
///
/// Nothing that [`json`](Document::json) says is changed, unknown members and extensions included,
/// and member order is kept.
#[derive(Debug)]
pub struct Document {
    file: PathBuf,
    base: PathBuf,
    pub(crate) files: Files,
    on_disk: bool,
    json: Value,
    binary: bool,
    pub(crate) buffers: Vec<Option<Vec<u8>>>,
    /// Decoded `EXT_meshopt_compression` views, filled on first use: several accessors usually
    /// share one.
    pub(crate) decoded: Vec<OnceLock<Result<Vec<u8>, String>>>,
    inputs: Vec<Input>,
    /// Image files that only writers asked for, by image.
    written: Mutex<BTreeMap<usize, Input>>,
    /// Images that could not be read when the document was loaded.
    pub(crate) missing: BTreeSet<usize>,
    pub(crate) limits: Limits,
}

/// Where an image's file lies.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageSource<'a> {
    /// In the document (a buffer view or a data URI).
    Embedded(Cow<'a, [u8]>),
    /// In a file of its own; its name alone where a resolver of the caller's gives files.
    File(PathBuf),
}

impl Document {
    /// Reads the document and its buffers; images are left for [`Document::image_source`].
    pub(crate) fn open(file: &Path, options: &LoadOptions) -> Result<Document, Error> {
        let bytes = container::read_file(file, "", options.limits.file_bytes)
            .map_err(|fault| fault.into_error(file))?;
        let base = file.parent().map(Path::to_path_buf).unwrap_or_default();
        Self::new(file, &bytes, Files::in_folder(base), true, options)
    }

    /// As [`Document::open`], of what is in memory.
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

    pub(crate) fn note_input(&mut self, input: Input) {
        if !self.inputs.iter().any(|i| i.file == input.file) {
            self.inputs.push(input);
        }
    }

    pub(crate) fn root(&self) -> Item<'_> {
        Item::root(&self.json)
    }

    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The document's names of the files that were read so far, but itself.
    pub(crate) fn input_uris(&self) -> Vec<String> {
        self.inputs[1..].iter().map(|i| i.uri.clone()).collect()
    }

    /// The document's file; where it came from memory, the name that stands for one.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The folder against which its URIs are resolved; empty where a resolver of the caller's does
    /// that.
    pub fn base_dir(&self) -> &Path {
        &self.base
    }

    /// Whether it came as .glb.
    pub fn is_binary(&self) -> bool {
        self.binary
    }

    /// The parsed JSON, member order kept. Indices and counts that were written as floats (`1.0`)
    /// are integers in it.
    pub fn json(&self) -> &Value {
        &self.json
    }

    /// All files that were read, each once: the document first, then buffers, measured lamps and
    /// images; last, in the order of images, those that were only asked for by
    /// [`Document::image_bytes`], there or not.
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

    /// Where the [`inputs`](Document::inputs) that are there lie on disk; what the caller gave from
    /// memory is not among them.
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

    /// Bytes of buffer `i`, `byteLength` of them; empty for a placeholder without data
    /// (`EXT_meshopt_compression`'s fallback) and for an index that does not exist.
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

    /// Whether image `i` could not be read when the document was loaded; light does not need it
    /// then.
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

    /// Remembers that image `i` was read from `file`, or could not be.
    ///
    /// # Errors
    /// The light was computed from the same file when it held something else.
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
        // Of two that differ the first stays: what is there now will not equal it, and the next run
        // sees that.
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
                "one of them",
            )),
        }
    }
}
