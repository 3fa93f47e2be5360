//! Edits a document: JSON is changed in place, new data is appended, and everything is written as
//! one .glb.

use std::collections::BTreeMap;

use mesh_ingest::Document;
use serde_json::{Map, Value, json};

use super::glb;
use super::json::{elements_mut, has_array, push};
use super::refs;
use crate::error::{Error, Result};

/// `bufferView.target` of vertex attributes.
const ARRAY_BUFFER: u32 = 34962;
/// `bufferView.target` of indices.
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The document's JSON with added views and accessors.
pub(super) struct Editor<'a> {
    pub document: &'a Document,
    pub json: Map<String, Value>,
    /// Number of buffer views in the original document.
    own_views: usize,
    /// Data of the added views.
    added: Vec<Vec<u8>>,
}

/// What happened to the document's images and compression.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Finished {
    pub images_embedded: u64,
    pub images_left: u64,
}

impl<'a> Editor<'a> {
    pub fn new(document: &'a Document) -> Result<Editor<'a>> {
        let json = document
            .json()
            .as_object()
            .cloned()
            .ok_or_else(|| Error::Inconsistent {
                at: "document".into(),
                message: "its JSON is not an object".into(),
            })?;
        let own_views = json
            .get("bufferViews")
            .and_then(Value::as_array)
            .map_or(0, Vec::len);
        Ok(Editor {
            document,
            json,
            own_views,
            added: Vec::new(),
        })
    }

    fn add_view(&mut self, bytes: Vec<u8>, target: Option<u32>, stride: Option<usize>) -> usize {
        let mut view = json!({"buffer": 0, "byteLength": bytes.len()});
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.added.push(bytes);
        push(&mut self.json, "bufferViews", view)
    }

    /// Adds a vertex attribute of `count` tightly packed `elements`. `accessor` gives the type
    /// (`componentType`, `type`, and optionally `normalized`, a name, …); view and count are filled
    /// in.
    ///
    /// Elements are padded to multiples of four bytes, as the specification requires (§3.6.2.4).
    pub fn add_attribute(
        &mut self,
        mut accessor: Map<String, Value>,
        elements: Vec<u8>,
        count: usize,
    ) -> usize {
        let size = elements.len() / count.max(1);
        let stride = size.next_multiple_of(4).max(4);
        let bytes = if stride == size {
            elements
        } else {
            let mut spread = vec![0; stride * count];
            for (to, from) in spread
                .chunks_exact_mut(stride)
                .zip(elements.chunks_exact(size.max(1)))
            {
                to[..size].copy_from_slice(from);
            }
            spread
        };
        let view = self.add_view(bytes, Some(ARRAY_BUFFER), Some(stride));
        for key in ["byteOffset", "sparse"] {
            accessor.shift_remove(key);
        }
        accessor.insert("bufferView".into(), view.into());
        accessor.insert("count".into(), count.into());
        push(&mut self.json, "accessors", Value::Object(accessor))
    }

    /// Adds an image file; returns its view.
    pub fn add_picture(&mut self, bytes: Vec<u8>) -> usize {
        self.add_view(bytes, None, None)
    }

    /// Adds a float attribute of `N` components.
    pub fn add_floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        let accessor = Map::from_iter([
            ("componentType".to_string(), json!(5126)),
            ("type".to_string(), json!(kind)),
        ]);
        let bytes = values
            .as_flattened()
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        self.add_attribute(accessor, bytes, values.len())
    }

    /// Adds a triangle list's indices, as 16-bit numbers if they fit.
    pub fn add_indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let indices = triangles.as_flattened();
        // The largest index of a type is the primitive restart value, which is not allowed
        // (§3.7.2.1).
        let short = indices.iter().all(|&i| i < u32::from(u16::MAX));
        let (component, bytes): (u32, Vec<u8>) = if short {
            (
                5123,
                indices
                    .iter()
                    .flat_map(|&i| (i as u16).to_le_bytes())
                    .collect(),
            )
        } else {
            (
                5125,
                indices.iter().flat_map(|&i| i.to_le_bytes()).collect(),
            )
        };
        let view = self.add_view(bytes, Some(ELEMENT_ARRAY_BUFFER), None);
        let accessor = json!({"bufferView": view, "componentType": component, "count": indices.len(), "type": "SCALAR"});
        push(&mut self.json, "accessors", accessor)
    }

    /// Declares an extension as used.
    pub fn use_extension(&mut self, name: &str) {
        let used = self
            .json
            .get("extensionsUsed")
            .and_then(Value::as_array)
            .into_iter()
            .flatten();
        if !used.clone().any(|n| n.as_str() == Some(name)) {
            push(&mut self.json, "extensionsUsed", name.into());
        }
    }

    /// Embeds images, decompresses views, drops unreferenced data, and assembles the file.
    pub fn finish(mut self) -> Result<(Vec<u8>, Finished)> {
        let done = self.embed_images()?;
        for view in elements_mut(&mut self.json, "bufferViews") {
            remove_extensions(
                view,
                &["EXT_meshopt_compression", "KHR_meshopt_compression"],
            );
        }
        // meshopt marks its placeholder buffers, which are removed with it.
        for buffer in elements_mut(&mut self.json, "buffers") {
            remove_extensions(
                buffer,
                &["EXT_meshopt_compression", "KHR_meshopt_compression"],
            );
        }
        self.prune_extension_lists();
        let views = refs::collect_garbage(&mut self.json);
        let bin = self.pack(&views)?;
        self.write_buffers(bin.len());
        let empty: Vec<_> = self
            .json
            .iter()
            .filter(|(_, v)| v.as_array().is_some_and(Vec::is_empty))
            .map(|(k, _)| k.clone())
            .collect();
        for key in empty {
            self.json.shift_remove(&key);
        }
        Ok((glb::assemble(&self.json, &bin)?, done))
    }

    /// Turns image files and data URIs into buffer views. An image that could not be read at load
    /// time or has an unknown format keeps its URI; one that disappeared since then is an error.
    fn embed_images(&mut self) -> Result<Finished> {
        let mut done = Finished::default();
        let count = self
            .json
            .get("images")
            .and_then(Value::as_array)
            .map_or(0, Vec::len);
        for i in 0..count {
            if !self.json["images"][i]
                .get("uri")
                .is_some_and(Value::is_string)
            {
                continue;
            }
            let read = match self.document.image_bytes(i) {
                Ok(bytes) => Some(bytes.into_owned()),
                Err(_) if self.document.image_is_missing(i) => None,
                Err(e) => return Err(e.into()),
            };
            let declared = self.json["images"][i]
                .get("mimeType")
                .and_then(Value::as_str)
                .map(str::to_owned);
            let mime = read
                .as_deref()
                .and_then(glb::sniff_image)
                .map(str::to_owned)
                .or(declared);
            let (Some(bytes), Some(mime)) = (read, mime) else {
                done.images_left += 1;
                continue;
            };
            let view = self.add_view(bytes, None, None);
            if let Some(image) = self.json["images"][i].as_object_mut() {
                image.shift_remove("uri");
                image.insert("bufferView".into(), view.into());
                image.insert("mimeType".into(), mime.into());
            }
            done.images_embedded += 1;
        }
        Ok(done)
    }

    /// Removes extensions from the lists that only the input used (removed compression, expanded
    /// copies), and adds those that the input used without listing. Extensions that never appear as
    /// an object, e.g. quantisation, stay listed.
    fn prune_extension_lists(&mut self) {
        let mut gone = self
            .document
            .json()
            .as_object()
            .map(refs::present)
            .unwrap_or_default();
        for name in refs::present(&self.json) {
            gone.remove(&name);
            self.use_extension(&name);
        }
        for key in ["extensionsUsed", "extensionsRequired"] {
            let Some(list) = self.json.get_mut(key).and_then(Value::as_array_mut) else {
                continue;
            };
            list.retain(|n| n.as_str().is_none_or(|n| !gone.contains(n)));
        }
    }

    /// Packs the remaining views into one buffer and updates their offsets. `views` gives their old
    /// indices.
    fn pack(&mut self, views: &[usize]) -> Result<Vec<u8>> {
        let mut bin = Vec::new();
        // Views of the same bytes keep sharing them.
        let mut placed: BTreeMap<(u64, u64, u64), usize> = BTreeMap::new();
        for (new, &old) in views.iter().enumerate() {
            let (bytes, offset, key) = if old < self.own_views {
                let source = &self.document.json()["bufferViews"][old];
                let number = |k: &str| source.get(k).and_then(Value::as_u64).unwrap_or(0);
                let plain = source.get("extensions").is_none();
                let key =
                    plain.then(|| (number("buffer"), number("byteOffset"), number("byteLength")));
                let bytes =
                    self.document
                        .buffer_view_bytes(old)
                        .map_err(|e| Error::Inconsistent {
                            at: format!("bufferViews[{old}]"),
                            message: e.to_string(),
                        })?;
                (bytes, number("byteOffset") as usize, key)
            } else {
                (self.added[old - self.own_views].as_slice(), 0, None)
            };
            let start = match key.and_then(|k| placed.get(&k)) {
                Some(&start) => start,
                None => {
                    // An accessor's alignment depends on the sum of its own offset and its view's
                    // (§3.6.2.4), so the view's stays the same modulo 4.
                    let mut start = bin.len().next_multiple_of(4) + offset % 4;
                    if start < bin.len() {
                        start += 4;
                    }
                    bin.resize(start, 0);
                    bin.extend_from_slice(bytes);
                    if let Some(key) = key {
                        placed.insert(key, start);
                    }
                    start
                }
            };
            if let Some(view) = self.json["bufferViews"][new].as_object_mut() {
                view.insert("buffer".into(), 0.into());
                view.shift_remove("byteOffset");
                if start > 0 {
                    view.insert("byteOffset".into(), start.into());
                }
            }
        }
        Ok(bin)
    }

    /// Writes one buffer with the name, extras and extensions of the document's first.
    fn write_buffers(&mut self, length: usize) {
        if !has_array(&self.json, "bufferViews") {
            self.json.shift_remove("buffers");
            return;
        }
        let first = self
            .json
            .get("buffers")
            .and_then(|b| b.get(0))
            .and_then(Value::as_object);
        let mut buffer = first.cloned().unwrap_or_default();
        buffer.shift_remove("uri");
        buffer.insert("byteLength".into(), length.into());
        self.json.insert("buffers".into(), json!([buffer]));
    }
}

/// Removes the named extensions of `object`, and its `extensions` if it becomes empty.
pub(super) fn remove_extensions(object: &mut Map<String, Value>, names: &[&str]) {
    let Some(extensions) = object.get_mut("extensions").and_then(Value::as_object_mut) else {
        return;
    };
    for name in names {
        extensions.shift_remove(*name);
    }
    if extensions.is_empty() {
        object.shift_remove("extensions");
    }
}
