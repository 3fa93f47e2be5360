//! Data that is added to a document before it is read.

use serde_json::{Map, Value, json};

use crate::document::Document;
use crate::error::Outcome;

/// A new buffer with its views and accessors.
pub(crate) struct Added {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// Numbers of the first new view and accessor.
    first: [usize; 2],
}

impl Added {
    /// Nothing yet. The document must have accessors and views.
    pub fn new(document: &Document) -> Outcome<Added> {
        let root = document.root();
        Ok(Added {
            bytes: Vec::new(),
            views: Vec::new(),
            accessors: Vec::new(),
            first: [root.len_of("bufferViews")?, root.len_of("accessors")?],
        })
    }

    /// Adds an accessor of tightly packed elements; returns its number. `members` are its
    /// `componentType`, `type` and whatever else it has.
    ///
    /// Elements of vertex attributes start at multiples of four bytes (glTF 2.0, §3.6.2.4).
    pub fn push(
        &mut self,
        elements: &[u8],
        count: usize,
        mut members: Map<String, Value>,
    ) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let at = self.bytes.len();
        let size = elements.len() / count.max(1);
        let mut view = Map::new();
        if size.is_multiple_of(4) {
            self.bytes.extend(elements);
        } else {
            let stride = size.next_multiple_of(4);
            for element in elements.chunks_exact(size.max(1)) {
                let start = self.bytes.len();
                self.bytes.extend(element);
                self.bytes.resize(start + stride, 0);
            }
            view.insert("byteStride".into(), json!(stride));
        }
        view.insert("byteOffset".into(), json!(at));
        view.insert("byteLength".into(), json!(self.bytes.len() - at));
        members.insert("bufferView".into(), json!(self.first[0] + self.views.len()));
        members.insert("count".into(), json!(count));
        self.views.push(Value::Object(view));
        self.accessors.push(Value::Object(members));
        self.first[1] + self.accessors.len() - 1
    }

    /// Appends everything to the document, with these materials.
    pub fn finish(mut self, document: &mut Document, materials: Vec<Value>) {
        let buffer = document.add_buffer(self.bytes);
        for view in &mut self.views {
            view["buffer"] = json!(buffer);
        }
        let json = document.json_mut();
        append(json, "bufferViews", self.views);
        append(json, "accessors", self.accessors);
        append(json, "materials", materials);
        document.refresh_views();
    }
}

fn append(json: &mut Value, list: &str, values: Vec<Value>) {
    // Indexing would add a missing one as `null`.
    if let Some(list) = json.get_mut(list).and_then(Value::as_array_mut) {
        list.extend(values);
    }
}

/// The members of an accessor of this type.
pub(crate) fn members(component: u32, kind: &str) -> Map<String, Value> {
    let mut members = Map::new();
    members.insert("componentType".into(), json!(component));
    members.insert("type".into(), json!(kind));
    members
}
