//! Compares a written document with its original: each difference is either a change that a bake
//! may make, counted by kind, or a fault.
//!
//! JSON is compared member by member. Where it refers to accessors, views or images, their contents
//! are compared byte for byte.

use std::collections::{BTreeMap, BTreeSet};

use lumel::mesh_ingest::{Document, RawPrimitive};
use serde_json::{Map, Value, json};

/// Which of the two files it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `level.glb`.
    Lightmapped,
    /// `level.vertex.glb`.
    Vertex,
}

/// The result.
#[derive(Debug, Default)]
pub struct Diff {
    /// Differences that a bake must not make, with their place in the document.
    pub faults: Vec<String>,
    /// The others, by kind.
    pub allowed: BTreeMap<&'static str, u64>,
}

impl Diff {
    fn fault(&mut self, path: &str, what: impl std::fmt::Display) {
        self.faults.push(format!("{path}: {what}"));
    }

    fn allow(&mut self, kind: &'static str) {
        *self.allowed.entry(kind).or_default() += 1;
    }
}

/// Compressed data is written uncompressed; copies are written out for vertex light.
const UNPACKED: [&str; 3] = [
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
];

/// All differences between `before` and `after`.
pub fn compare(before: &Document, after: &Document, kind: Kind) -> Diff {
    let mut pair = Pair {
        before,
        after,
        kind,
        lit: BTreeMap::new(),
        diff: Diff::default(),
    };
    pair.root();
    pair.diff
}

struct Pair<'a> {
    before: &'a Document,
    after: &'a Document,
    kind: Kind,
    /// Meshes of the written document that replace nodes' own.
    lit: BTreeMap<usize, usize>,
    diff: Diff,
}

fn list<'v>(json: &'v Value, key: &str) -> &'v [Value] {
    json.get(key).and_then(Value::as_array).map_or(&[], |a| a)
}

fn keys(a: &Value, b: &Value) -> BTreeSet<String> {
    let of = |v: &Value| -> Vec<String> {
        v.as_object()
            .map(|o| o.keys().cloned().collect())
            .unwrap_or_default()
    };
    of(a).into_iter().chain(of(b)).collect()
}

fn number(v: &Value) -> Option<usize> {
    v.as_u64().map(|n| n as usize)
}

/// `value` without these members.
fn without(value: &Value, names: &[&str]) -> Value {
    let mut out = value.clone();
    if let Some(o) = out.as_object_mut() {
        names.iter().for_each(|n| {
            o.remove(*n);
        });
    }
    out
}

/// `value` without these extensions, and without an empty list of them.
fn without_extensions(value: &Value, gone: impl Fn(&str) -> bool) -> Value {
    let mut out = value.clone();
    let Some(o) = out.as_object_mut() else {
        return out;
    };
    if let Some(e) = o.get_mut("extensions").and_then(Value::as_object_mut) {
        e.retain(|name, _| !gone(name));
        if e.is_empty() {
            o.remove("extensions");
        }
    }
    out
}

/// A material (or primitive) whose textures read set `to` where they read set 1.
fn reading(value: &Value, to: usize) -> Value {
    match value {
        Value::Object(o) => {
            let texture = o.contains_key("index");
            let transformed = |m: &Map<String, Value>| m.contains_key("texCoord");
            Value::Object(
                o.iter()
                    .map(|(k, v)| {
                        let new = match (k.as_str(), v) {
                            ("extras", v) => v.clone(),
                            ("texCoord", v) if texture && *v == json!(1) => json!(to),
                            ("KHR_texture_transform", Value::Object(t)) if transformed(t) => {
                                let mut t = t.clone();
                                if t["texCoord"] == json!(1) {
                                    t["texCoord"] = json!(to);
                                }
                                Value::Object(t)
                            }
                            (_, v) => reading(v, to),
                        };
                        (k.clone(), new)
                    })
                    .collect(),
            )
        }
        Value::Array(a) => a.iter().map(|v| reading(v, to)).collect(),
        v => v.clone(),
    }
}

impl Pair<'_> {
    fn root(&mut self) {
        let (a, b) = (self.before.json(), self.after.json());
        for key in keys(a, b) {
            let (x, y) = (&a[key.as_str()], &b[key.as_str()]);
            match key.as_str() {
                // Compared through the members that refer to them.
                "accessors" | "bufferViews" | "buffers" => {}
                "meshes" | "materials" | "nodes" => {}
                "images" => self.each("images", x, y, Self::image),
                "animations" => self.each("animations", x, y, Self::animation),
                "skins" => self.each("skins", x, y, Self::skin),
                "extensionsUsed" | "extensionsRequired" => self.extension_list(&key, x, y),
                "asset" => self.asset(x, y),
                _ => self.same(&key, x, y),
            }
        }
        self.nodes();
        self.meshes();
        self.materials();
        self.buffers();
        if self.has_unknown_extensions() {
            self.every_index_as_it_was();
        }
    }

    /// Exactly the same.
    fn same(&mut self, path: &str, a: &Value, b: &Value) {
        if a == b {
            return;
        }
        match (a, b) {
            (Value::Object(_), Value::Object(_)) => {
                for key in keys(a, b) {
                    let at = format!("{path}.{key}");
                    match (a.get(&key), b.get(&key)) {
                        (Some(x), Some(y)) => self.same(&at, x, y),
                        (Some(x), None) => self.diff.fault(&at, format!("lost {x}")),
                        (_, y) => self.diff.fault(&at, format!("came as {y:?}")),
                    }
                }
            }
            (Value::Array(x), Value::Array(y)) if x.len() == y.len() => {
                for (i, (x, y)) in x.iter().zip(y).enumerate() {
                    self.same(&format!("{path}[{i}]"), x, y);
                }
            }
            _ => self.diff.fault(path, format!("{a} became {b}")),
        }
    }

    fn each(
        &mut self,
        name: &str,
        a: &Value,
        b: &Value,
        f: fn(&mut Self, &str, usize, &Value, &Value),
    ) {
        let (x, y) = (a.as_array(), b.as_array());
        let (Some(x), Some(y)) = (x, y) else {
            // An empty list is invalid and may disappear.
            if x.is_none_or(Vec::is_empty) && y.is_none() {
                return self.diff.allow("empty list dropped");
            }
            return self.same(name, a, b);
        };
        if x.len() != y.len() {
            self.diff.fault(name, format!("{} of {}", y.len(), x.len()));
        }
        for (i, (x, y)) in x.iter().zip(y).enumerate() {
            f(self, &format!("{name}[{i}]"), i, x, y);
        }
    }

    fn image(&mut self, path: &str, i: usize, a: &Value, b: &Value) {
        let places = ["uri", "bufferView", "mimeType"];
        self.same(path, &without(a, &places), &without(b, &places));
        match (self.before.image_bytes(i), self.after.image_bytes(i)) {
            (Ok(x), Ok(y)) => {
                if x != y {
                    self.diff.fault(path, "its bytes differ");
                }
                if a.get("uri").is_some() {
                    self.diff.allow("image embedded");
                }
                if a.get("mimeType").is_some() {
                    self.same(&format!("{path}.mimeType"), &a["mimeType"], &b["mimeType"]);
                }
            }
            (Err(_), _) => self.same(path, a, b),
            (_, Err(e)) => self.diff.fault(path, e),
        }
    }

    fn animation(&mut self, path: &str, _: usize, a: &Value, b: &Value) {
        self.same(path, &without(a, &["samplers"]), &without(b, &["samplers"]));
        for (i, (x, y)) in list(a, "samplers")
            .iter()
            .zip(list(b, "samplers"))
            .enumerate()
        {
            let at = format!("{path}.samplers[{i}]");
            let data = ["input", "output"];
            self.same(&at, &without(x, &data), &without(y, &data));
            for key in data {
                self.accessor(&format!("{at}.{key}"), &x[key], &y[key]);
            }
        }
        if list(a, "samplers").len() != list(b, "samplers").len() {
            self.diff.fault(path, "samplers were lost");
        }
    }

    fn skin(&mut self, path: &str, _: usize, a: &Value, b: &Value) {
        let data = ["inverseBindMatrices"];
        self.same(path, &without(a, &data), &without(b, &data));
        if a.get(data[0]).is_some() {
            self.accessor(&format!("{path}.{}", data[0]), &a[data[0]], &b[data[0]]);
        } else if b.get(data[0]).is_some() {
            self.diff.fault(path, "matrices out of nowhere");
        }
    }

    /// The same type, name, extras, … and the same elements.
    fn accessor(&mut self, path: &str, a: &Value, b: &Value) {
        let (Some(i), Some(j)) = (number(a), number(b)) else {
            return self.same(path, a, b);
        };
        let (x, y) = (
            &self.before.json()["accessors"][i],
            &self.after.json()["accessors"][j],
        );
        let places = ["bufferView", "byteOffset", "sparse"];
        self.same(
            &format!("{path} (accessor {i})"),
            &without(x, &places),
            &without(y, &places),
        );
        match (self.before.accessor_raw(i), self.after.accessor_raw(j)) {
            (Ok(p), Ok(q)) if p.bytes == q.bytes => {}
            (Ok(_), Ok(_)) => self.diff.fault(path, "its elements differ"),
            (Err(_), Err(_)) => {}
            (p, q) => self
                .diff
                .fault(path, format!("{:?} became {:?}", p.err(), q.err())),
        }
        if let (Some(v), Some(w)) = (
            x.get("bufferView").and_then(number),
            y.get("bufferView").and_then(number),
        ) {
            self.view(&format!("{path}.bufferView"), v, w);
        }
    }

    /// Everything about a buffer view except its position.
    fn view(&mut self, path: &str, i: usize, j: usize) {
        let (x, y) = (
            &self.before.json()["bufferViews"][i],
            &self.after.json()["bufferViews"][j],
        );
        let unpacked = |v: &Value| {
            without_extensions(&without(v, &["buffer", "byteOffset"]), |n| {
                UNPACKED.contains(&n)
            })
        };
        if without_extensions(x, |n| UNPACKED.contains(&n)) != *x {
            self.diff.allow("view unpacked");
        }
        self.same(path, &unpacked(x), &unpacked(y));
    }

    fn extension_list(&mut self, key: &str, a: &Value, b: &Value) {
        let names = |v: &Value| -> BTreeSet<String> {
            v.as_array()
                .into_iter()
                .flatten()
                .filter_map(|n| n.as_str().map(str::to_owned))
                .collect()
        };
        let (x, y) = (names(a), names(b));
        for gone in x.difference(&y) {
            let replaced = match self.kind {
                Kind::Lightmapped => false,
                Kind::Vertex => {
                    gone == "EXT_mesh_gpu_instancing" || gone.starts_with("KHR_materials_")
                }
            };
            // Nothing may still use it.
            let used = self
                .after
                .json()
                .to_string()
                .contains(&format!("\"{gone}\":"));
            if used || !(replaced || UNPACKED.contains(&gone.as_str())) {
                self.diff.fault(key, format!("lost {gone}"));
            } else {
                self.diff.allow("extension no longer used");
            }
        }
        for new in y.difference(&x) {
            let present = self
                .before
                .json()
                .to_string()
                .contains(&format!("\"{new}\":"));
            if present || (self.kind == Kind::Vertex && new == "KHR_materials_unlit") {
                self.diff.allow("extension declared");
            } else {
                self.diff.fault(key, format!("{new} came"));
            }
        }
        if b.as_array().is_some_and(|l| l.len() != y.len()) {
            self.diff.fault(key, "a name stands there twice");
        }
    }

    fn asset(&mut self, a: &Value, b: &Value) {
        if self.kind == Kind::Lightmapped {
            return self.same("asset", a, b);
        }
        self.with_extra("asset", a, b, "vertexLight");
    }

    /// The same except for one more member in the extras. Returns that member.
    fn with_extra(&mut self, path: &str, a: &Value, b: &Value, key: &str) -> Value {
        let added = b["extras"][key].clone();
        if added.is_null() {
            self.diff.fault(path, format!("no extras.{key}"));
        }
        let expected = match a.get("extras") {
            None | Some(Value::Null) => json!({ key: added }),
            Some(Value::Object(o)) => {
                let mut o = o.clone();
                o.insert(key.into(), added.clone());
                Value::Object(o)
            }
            Some(other) => json!({"original": other, key: added}),
        };
        let rest = ["extras"];
        self.same(path, &without(a, &rest), &without(b, &rest));
        self.same(&format!("{path}.extras"), &expected, &b["extras"]);
        self.diff.allow(match key {
            "lightmap" => "extras.lightmap",
            _ => "extras.vertexLight",
        });
        added
    }

    fn nodes(&mut self) {
        let (before, after) = (self.before.json(), self.after.json());
        let (a, b) = (list(before, "nodes"), list(after, "nodes"));
        if b.len() < a.len() || (self.kind == Kind::Lightmapped && b.len() != a.len()) {
            self.diff
                .fault("nodes", format!("{} of {}", b.len(), a.len()));
        }
        for (i, (x, y)) in a.iter().zip(b).enumerate() {
            self.node(i, x, y);
        }
    }

    fn node(&mut self, i: usize, a: &Value, b: &Value) {
        let path = format!("nodes[{i}]");
        const COPIES: &str = "EXT_mesh_gpu_instancing";
        let extra = match self.kind {
            Kind::Lightmapped => "lightmap",
            Kind::Vertex => "vertexLight",
        };
        let (mut x, mut y) = (a.clone(), b.clone());
        let data = |v: &Value| v["extensions"][COPIES]["attributes"].clone();
        let (p, q) = (data(a), data(b));
        if p.is_object() && q.is_object() {
            for name in keys(&p, &q) {
                self.accessor(&format!("{path}.{name}"), &p[&name], &q[&name]);
            }
            for v in [&mut x, &mut y] {
                v["extensions"][COPIES]["attributes"] = json!("compared");
            }
        }
        let baked = b["extras"].get(extra) != a["extras"].get(extra);
        if self.kind == Kind::Vertex && baked {
            if p.is_object() && q.is_null() {
                self.copies(&path, a, b);
                (x, y) = (
                    without(
                        &without_extensions(&x, |n| n == COPIES),
                        &["mesh", "children"],
                    ),
                    without(&y, &["mesh", "children"]),
                );
            } else if let (Some(m), Some(n)) = (number(&a["mesh"]), number(&b["mesh"])) {
                if self.lit.insert(n, m).is_some() {
                    self.diff.fault(&path, "two nodes share a lit mesh");
                }
                (x, y) = (without(&x, &["mesh"]), without(&y, &["mesh"]));
            }
        }
        if baked {
            let place = self.with_extra(&path, &x, &y, extra);
            let known = match self.kind {
                Kind::Lightmapped => place.is_array() || place["texCoord"] == json!(1),
                Kind::Vertex => place["scale"].is_number(),
            };
            if !known {
                self.diff.fault(&path, format!("extras.{extra} is {place}"));
            }
        } else {
            self.same(&path, &x, &y);
        }
    }

    /// The copies of an instanced node are now its children.
    fn copies(&mut self, path: &str, a: &Value, b: &Value) {
        let after = self.after.json();
        let (old, new) = (list(a, "children"), list(b, "children"));
        if !new.starts_with(old) {
            return self.diff.fault(path, "its own children are not the first");
        }
        let attributes = &a["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
        let own = number(&a["mesh"]).unwrap_or(usize::MAX);
        for (k, child) in new[old.len()..].iter().enumerate() {
            let child = &after["nodes"][number(child).unwrap_or(usize::MAX)];
            let mesh = number(&child["mesh"]).unwrap_or(usize::MAX);
            let lit = list(&after["meshes"][mesh], "primitives")
                .iter()
                .any(|p| p["attributes"].get("_IRRADIANCE").is_some());
            if lit && self.lit.insert(mesh, own).is_some() {
                self.diff.fault(path, "two copies share a lit mesh");
            }
            for (key, name, n) in [
                ("translation", "TRANSLATION", 3),
                ("rotation", "ROTATION", 4),
                ("scale", "SCALE", 3),
            ] {
                let Some(accessor) = number(&attributes[name]) else {
                    continue;
                };
                let Ok(raw) = self.before.accessor_raw(accessor) else {
                    continue;
                };
                let expected = raw.to_floats::<4>(0.0)[k];
                let got: Vec<f64> = list(child, key).iter().filter_map(Value::as_f64).collect();
                // Rotations are normalised again: quantised ones are off by half a step of 127.
                let near = |(g, e): (&f64, &f32)| (g - f64::from(*e)).abs() < 5e-3;
                if got.len() != n || !got.iter().zip(&expected).all(near) {
                    self.diff
                        .fault(path, format!("copy {k}: {key} {got:?}, not {expected:?}"));
                }
            }
            self.diff.allow("copy written out as a node");
        }
    }

    fn meshes(&mut self) {
        let (before, after) = (self.before.json(), self.after.json());
        let (a, b) = (list(before, "meshes"), list(after, "meshes"));
        if b.len() < a.len() || (self.kind == Kind::Lightmapped && b.len() > a.len()) {
            self.diff
                .fault("meshes", format!("{} of {}", b.len(), a.len()));
        }
        let lit = self.lit.clone();
        for (n, y) in b.iter().enumerate() {
            match lit.get(&n) {
                Some(&m) => {
                    if m != n {
                        self.diff.allow("mesh copied for a node");
                    }
                    self.mesh(m, n, &a[m], y, true);
                }
                None if n < a.len() => self.mesh(n, n, &a[n], y, false),
                None => self.diff.fault(&format!("meshes[{n}]"), "nobody has it"),
            }
        }
    }

    fn mesh(&mut self, m: usize, n: usize, a: &Value, b: &Value, lit: bool) {
        let path = format!("meshes[{m}]");
        let rest = ["primitives"];
        self.same(&path, &without(a, &rest), &without(b, &rest));
        let (x, y) = (list(a, "primitives"), list(b, "primitives"));
        if x.len() != y.len() {
            return self.diff.fault(&path, "primitives were lost");
        }
        for (p, (x, y)) in x.iter().zip(y).enumerate() {
            let at = format!("{path}.primitives[{p}]");
            let raw = (
                self.before.primitive_raw(m, p),
                self.after.primitive_raw(n, p),
            );
            let lit = lit && y["attributes"].get("_IRRADIANCE").is_some();
            match raw {
                (Ok(r), Ok(s)) if !r.triangles.is_empty() => {
                    self.triangles(&at, x, y, &r, &s, lit);
                }
                (_, Err(e)) => self.diff.fault(&at, e),
                _ => self.other_primitive(&at, x, y),
            }
        }
    }

    /// Points, lines and unreadable primitives must not change.
    fn other_primitive(&mut self, path: &str, a: &Value, b: &Value) {
        let data = ["attributes", "indices"];
        self.same(path, &without(a, &data), &without(b, &data));
        for name in keys(&a["attributes"], &b["attributes"]) {
            let at = format!("{path}.{name}");
            self.accessor(&at, &a["attributes"][&name], &b["attributes"][&name]);
        }
        if a.get("indices").is_some() || b.get("indices").is_some() {
            self.accessor(&format!("{path}.indices"), &a["indices"], &b["indices"]);
        }
    }

    fn triangles(
        &mut self,
        path: &str,
        a: &Value,
        b: &Value,
        r: &RawPrimitive<'_>,
        s: &RawPrimitive<'_>,
        lit: bool,
    ) {
        let packed = a["extensions"].get(UNPACKED[0]).is_some();
        let data = ["attributes", "indices", "mode", "targets", "material"];
        let gone = |n: &str| UNPACKED.contains(&n) || (lit && n == "KHR_materials_variants");
        let bare = |v: &Value| without_extensions(&without(v, &data), gone);
        if packed {
            self.diff.allow("primitive unpacked");
        }
        // The new set of the former set 1.
        let moved = self.attributes(path, a, b, r, s, lit);
        let expected = moved.map_or_else(|| bare(a), |to| reading(&bare(a), to));
        self.same(
            path,
            &self.resolved(&expected, self.before),
            &self.resolved(&bare(b), self.after),
        );
        if a.get("mode") != b.get("mode") {
            self.diff.allow("strip or fan written as a list");
            if b.get("mode").is_some_and(|m| *m != json!(4)) {
                self.diff.fault(path, format!("mode {}", b["mode"]));
            }
        }
        self.material(path, a, b, moved, lit);
        if r.targets.len() != s.targets.len() {
            return self.diff.fault(path, "morph targets were lost");
        }
        for (i, (x, y)) in r.targets.iter().zip(&s.targets).enumerate() {
            let names = |t: &[(String, _)]| -> BTreeSet<String> {
                t.iter().map(|(n, _)| n.clone()).collect()
            };
            if names(x) != names(y) {
                self.diff.fault(path, format!("target {i} lost attributes"));
            }
        }
    }

    /// The extensions of a primitive without material indices, which are compared by the materials
    /// they refer to.
    fn resolved(&self, primitive: &Value, _of: &Document) -> Value {
        let mut out = primitive.clone();
        if let Some(mappings) = out
            .get_mut("extensions")
            .and_then(|e| e.get_mut("KHR_materials_variants"))
            .and_then(|v| v.get_mut("mappings"))
            .and_then(Value::as_array_mut)
        {
            for mapping in mappings {
                mapping["material"] = json!("compared");
            }
        }
        out
    }

    /// Every attribute at every corner of every triangle. Returns the set to which set 1 has moved.
    fn attributes(
        &mut self,
        path: &str,
        a: &Value,
        b: &Value,
        r: &RawPrimitive<'_>,
        s: &RawPrimitive<'_>,
        lit: bool,
    ) -> Option<usize> {
        if r.triangles.len() != s.triangles.len() {
            self.diff.fault(
                path,
                format!("{} triangles of {}", s.triangles.len(), r.triangles.len()),
            );
            return None;
        }
        let same_vertices = r.vertex_count == s.vertex_count && r.triangles == s.triangles;
        if !same_vertices {
            self.diff.allow("vertices copied at chart borders");
            if self.kind == Kind::Vertex {
                self.diff.fault(path, "its vertices were re-arranged");
            }
        }
        let names = |raw: &RawPrimitive<'_>| -> BTreeSet<String> {
            raw.attributes.iter().map(|(n, _)| n.clone()).collect()
        };
        let (old, new) = (names(r), names(s));
        let mut moved = None;
        let mut added: BTreeSet<String> = new.difference(&old).cloned().collect();
        for name in &old {
            let replaced = lit && (name == "COLOR_0" || name == "_IRRADIANCE");
            if replaced {
                self.diff.allow("vertex colours replaced");
                continue;
            }
            let mut at = name.clone();
            if self.kind == Kind::Lightmapped && name == "TEXCOORD_1" {
                // Kept, moved to a new set, or replaced.
                let candidates = std::iter::once(name.clone()).chain(added.clone());
                let found = candidates
                    .filter(|n| n.starts_with("TEXCOORD_"))
                    .find(|n| corners_equal(r, name, s, n));
                match found {
                    Some(n) if n == *name => {}
                    Some(n) => {
                        moved = n["TEXCOORD_".len()..].parse().ok();
                        self.diff.allow("set 1 moved");
                        added.remove(&n);
                        at = n;
                    }
                    None => {
                        self.diff.allow("set 1 replaced");
                        continue;
                    }
                }
            }
            if !corners_equal(r, name, s, &at) {
                self.diff
                    .fault(path, format!("{name} differs at some corner, or is gone"));
            }
            self.template(
                path,
                name,
                &a["attributes"][name],
                &b["attributes"][&at],
                same_vertices,
            );
        }
        for name in added {
            let allowed = match (self.kind, name.as_str()) {
                (Kind::Lightmapped, "TEXCOORD_1") => true,
                (Kind::Lightmapped, "TEXCOORD_0") => {
                    b["attributes"]["TEXCOORD_0"] == b["attributes"]["TEXCOORD_1"]
                }
                (Kind::Vertex, "COLOR_0" | "_IRRADIANCE") => lit,
                _ => false,
            };
            if allowed {
                self.diff.allow(match name.as_str() {
                    "TEXCOORD_0" => "TEXCOORD_0 doubles TEXCOORD_1",
                    "TEXCOORD_1" => "TEXCOORD_1",
                    _ => "vertex colours",
                });
            } else {
                self.diff.fault(path, format!("attribute {name} came"));
            }
        }
        moved
    }

    /// What an attribute's accessor states besides its elements.
    fn template(&mut self, path: &str, name: &str, a: &Value, b: &Value, same_vertices: bool) {
        let (Some(i), Some(j)) = (number(a), number(b)) else {
            return; // unpacked: the accessor may be anywhere
        };
        let (x, y) = (
            &self.before.json()["accessors"][i],
            &self.after.json()["accessors"][j],
        );
        let mut places = vec!["bufferView", "byteOffset", "sparse"];
        if !same_vertices {
            // Bounds of vertices that no triangle used may disappear.
            places.extend(["count", "min", "max"]);
        }
        let at = format!("{path}.{name} (accessor {i})");
        self.same(&at, &without(x, &places), &without(y, &places));
    }

    /// The materials of a primitive, including variants, by content.
    fn material(&mut self, path: &str, a: &Value, b: &Value, moved: Option<usize>, lit: bool) {
        let variants = |v: &Value| -> Vec<Value> {
            let mappings = &v["extensions"]["KHR_materials_variants"]["mappings"];
            (mappings.as_array().into_iter().flatten())
                .map(|m| m["material"].clone())
                .collect()
        };
        let mut pairs = vec![(a["material"].clone(), b["material"].clone())];
        if !lit {
            pairs.extend(variants(a).into_iter().zip(variants(b)));
        }
        for (x, y) in pairs {
            let get = |d: &Document, v: &Value| {
                number(v).map_or(json!({}), |i| d.json()["materials"][i].clone())
            };
            let (x, y) = (get(self.before, &x), get(self.after, &y));
            let at = format!("{path}.material");
            if lit {
                self.unlit(&at, &x, &y);
            } else {
                let expected = moved.map_or(x.clone(), |to| reading(&x, to));
                self.same(&at, &expected, &y);
            }
        }
    }

    /// A material and its unlit form.
    fn unlit(&mut self, path: &str, a: &Value, b: &Value) {
        let mut expected = without_extensions(a, |n| n.starts_with("KHR_materials_"));
        expected["extensions"]["KHR_materials_unlit"] = json!({});
        let glows = list(a, "emissiveFactor")
            .iter()
            .any(|x| x.as_f64() > Some(0.0));
        if glows && b.get("emissiveFactor").is_none() {
            expected = without(&expected, &["emissiveFactor", "emissiveTexture"]);
            let textured = a["pbrMetallicRoughness"].get("baseColorTexture").is_some();
            if !textured {
                let alpha = a["pbrMetallicRoughness"]["baseColorFactor"][3]
                    .as_f64()
                    .unwrap_or(1.0);
                expected["pbrMetallicRoughness"]["baseColorFactor"] = json!([1.0, 1.0, 1.0, alpha]);
            }
            self.diff.allow("glow moved into vertex colours");
        }
        self.diff.allow("material made unlit");
        self.same(path, &expected, b);
    }

    /// Materials keep their places; copies come after them and have a user.
    fn materials(&mut self) {
        let (a, b) = (
            list(self.before.json(), "materials"),
            list(self.after.json(), "materials"),
        );
        let users = |d: &Document| -> BTreeSet<usize> {
            let text = d.json()["meshes"].clone();
            let mut out = BTreeSet::new();
            fn walk(v: &Value, out: &mut BTreeSet<usize>) {
                match v {
                    Value::Object(o) => {
                        out.extend(o.get("material").and_then(number));
                        o.iter()
                            .filter(|(k, _)| *k != "extras")
                            .for_each(|(_, v)| walk(v, out));
                    }
                    Value::Array(a) => a.iter().for_each(|v| walk(v, out)),
                    _ => {}
                }
            }
            walk(&text, &mut out);
            out
        };
        let used = users(self.after);
        if b.len() < a.len() {
            self.diff.fault("materials", "some were lost");
        }
        for (i, (x, y)) in a.iter().zip(b).enumerate() {
            // The materials of primitives are compared with them.
            if !used.contains(&i) {
                self.same(&format!("materials[{i}]"), x, y);
            }
        }
        for i in a.len()..b.len() {
            self.diff.allow("material copied");
            if !used.contains(&i) {
                self.diff
                    .fault(&format!("materials[{i}]"), "nobody wears it");
            }
        }
    }

    fn buffers(&mut self) {
        let (a, b) = (
            list(self.before.json(), "buffers"),
            list(self.after.json(), "buffers"),
        );
        if b.len() > 1 {
            self.diff.fault("buffers", format!("{} of them", b.len()));
        }
        if a.len() > 1 {
            self.diff.allow("buffers joined");
        }
        if let (Some(x), Some(y)) = (a.first(), b.first()) {
            let places = ["uri", "byteLength"];
            let unpacked = |v| without_extensions(&without(v, &places), |n| UNPACKED.contains(&n));
            self.same("buffers[0]", &unpacked(x), &unpacked(y));
        }
    }

    /// Extensions that may refer to anything by index.
    fn has_unknown_extensions(&self) -> bool {
        self.before.json().to_string().contains("\"ACME_")
    }

    /// Every accessor and view where it was.
    fn every_index_as_it_was(&mut self) {
        for i in 0..list(self.before.json(), "accessors").len() {
            self.accessor(&format!("accessors[{i}]"), &json!(i), &json!(i));
        }
        for i in 0..list(self.before.json(), "bufferViews").len() {
            let at = format!("bufferViews[{i}]");
            self.view(&at, i, i);
            let bytes = |d: &Document| d.buffer_view_bytes(i).map(<[u8]>::to_vec).ok();
            if bytes(self.before) != bytes(self.after) {
                self.diff.fault(&at, "its bytes differ");
            }
        }
    }
}

/// Whether attribute `x` of `r` and `y` of `s` hold the same bytes at every corner, in the
/// primitive and in its morph targets.
fn corners_equal(r: &RawPrimitive<'_>, x: &str, s: &RawPrimitive<'_>, y: &str) -> bool {
    let (Some(p), Some(q)) = (r.attribute(x), s.attribute(y)) else {
        return false;
    };
    let corners = || {
        let before = r.triangles.iter().flatten();
        before.zip(s.triangles.iter().flatten())
    };
    let alike =
        (p.component, p.dimensions, p.normalized) == (q.component, q.dimensions, q.normalized);
    alike
        && corners().all(|(v, w)| p.element(*v as usize) == q.element(*w as usize))
        && r.targets.iter().zip(&s.targets).all(|(t, u)| {
            let find = |t: &[(String, _)]| t.iter().position(|(n, _)| n == x);
            match (find(t), find(u)) {
                (Some(i), Some(j)) => corners()
                    .all(|(v, w)| t[i].1.element(*v as usize) == u[j].1.element(*w as usize)),
                (i, j) => i.is_none() && j.is_none(),
            }
        })
}
