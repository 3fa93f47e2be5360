//! `level.vertex.glb`: the input with its light in vertex colours, rendered unlit.
//!
//! An unlit renderer shows `COLOR_0 × baseColorFactor × baseColorTexture`. The picture should be
//! the outgoing radiance ρR + L_e, divided by one scale s for the whole file, where R = E/π, ρ =
//! factor × texture × c, and c is the input's own `COLOR_0`. Therefore
//!
//! - a surface without emission gets `COLOR_0 = c R / s`, and the material keeps factor and
//!   texture;
//! - an emissive surface without a base texture gets `COLOR_0 = (factor c R + L_e) / s` and a white
//!   factor, which is exact at the vertices;
//! - an emissive surface with a base texture t gets
//!   `COLOR_0 = (c R + L_e / max(factor t, 0.05)) / s`, evaluated at the vertex; between vertices
//!   the texture tints the emission.
//!
//! s is the largest value, but at most 16 times the 99th percentile of cR, so that a highlight or a
//! lamp does not cost the rest of the 16-bit colours precision. Values beyond s are clamped and
//! counted. `_IRRADIANCE` stores E itself at full precision.

use std::collections::{BTreeMap, BTreeSet};
use std::f32::consts::PI;

use gather::{SplitPrimitive, VertexLight};
use glam::Vec3;
use mesh_ingest::{Document, Primitive, RawAccessor, Scene};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::editor::{Editor, remove_extensions};
use super::json::{element, element_mut, elements_mut, index, object_at, push, set_extra};
use super::midpoints;
use super::nodes::{VERTEX_LIGHT_EXTRA, by_node};
use super::split::{accessor_of, add_gathered};
use crate::error::{Error, Result};
use crate::texture;

/// Largest ratio of the scale to the 99th percentile of reflected radiance; it leaves 4096 16-bit
/// steps below that percentile.
const HEADROOM: f32 = 16.0;

/// Lower bound of the reflectance that emission is divided by, because black texels would give huge
/// values.
const LEAST_REFLECTANCE: f32 = 0.05;

/// Report of [`write_vertex_glb`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct VertexStats {
    /// Radiance (nit or W/(m² sr)) of a colour of 1.
    pub scale: f32,
    /// Vertices with a colour, over all instances.
    pub vertices: u64,
    /// Vertices with a component beyond `scale`, stored as 1.
    pub clamped: u64,
    /// Vertices whose light was NaN, infinite or negative, stored as 0.
    pub unusable: u64,
    /// Meshes copied because two instances cannot share colours.
    pub meshes_copied: u64,
    /// Vertices that splitting added.
    pub vertices_added: u64,
    /// Nodes added for `EXT_mesh_gpu_instancing` copies.
    pub nodes_added: u64,
}

/// Writes `document` with `light` as vertex colours.
///
/// The scale is in `asset.extras.vertexLight.scale` and in `extras.vertexLight.scale` of every
/// baked node: radiance = `COLOR_0` × base colour × scale.
///
/// # Errors
/// [`Error::Inconsistent`] if `light` does not fit the scene or the scene does not fit the
/// document, [`Error::Document`] if the document's data cannot be read, [`Error::Limit`] beyond 4
/// GiB.
pub fn write_vertex_glb(
    document: &Document,
    scene: &Scene,
    light: &VertexLight,
) -> Result<(Vec<u8>, VertexStats)> {
    check(scene, light)?;
    let mut writer = Writer {
        editor: Editor::new(document)?,
        scene,
        stats: VertexStats {
            scale: scale_of(scene, light),
            ..VertexStats::default()
        },
        bases: vec![None; scene.meshes.len()],
        materials: BTreeMap::new(),
        glowing: glowing(scene),
    };
    let in_place = writer.meshes_of_baked_nodes_only();
    writer.convert_materials(&in_place);
    let mut mesh_of = Vec::with_capacity(scene.instances.len());
    let mut taken = BTreeSet::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        if !scene.has_lightmap(i) {
            mesh_of.push(None);
            continue;
        }
        let mesh = writer.lit_mesh(i, light)?;
        let own = scene.meshes[instance.mesh].gltf_mesh;
        let at = if in_place.contains(&own) && taken.insert(own) {
            writer.editor.json["meshes"][own] = mesh;
            own
        } else {
            writer.stats.meshes_copied += 1;
            push(&mut writer.editor.json, "meshes", mesh)
        };
        mesh_of.push(Some(at));
    }
    writer.place(&mesh_of)?;
    let scale = json!({"scale": writer.stats.scale, "attribute": "COLOR_0", "irradianceAttribute": "_IRRADIANCE"});
    set_extra(
        object_at(&mut writer.editor.json, "asset"),
        VERTEX_LIGHT_EXTRA,
        scale,
    );
    writer.editor.use_extension("KHR_materials_unlit");
    let (glb, _) = writer.editor.finish()?;
    Ok((glb, writer.stats))
}

fn check(scene: &Scene, all: &VertexLight) -> Result<()> {
    let fail = |at: String, expected: usize, got: usize| {
        Err(Error::Inconsistent {
            at,
            message: format!("expected {expected}, got {got}"),
        })
    };
    if all.instances.len() != scene.instances.len() {
        return fail(
            "vertex light of the instances".into(),
            scene.instances.len(),
            all.instances.len(),
        );
    }
    for (i, (instance, light)) in scene.instances.iter().zip(&all.instances).enumerate() {
        if !scene.has_lightmap(i) {
            continue;
        }
        let primitives = scene
            .meshes
            .get(instance.mesh)
            .map_or(&[][..], |m| &m.primitives);
        if light.len() != primitives.len() {
            return fail(
                format!("vertex light of instance {i}, primitives"),
                primitives.len(),
                light.len(),
            );
        }
        for (p, (primitive, light)) in primitives.iter().zip(light).enumerate() {
            if !scene.receives(i, p) {
                continue;
            }
            let own = primitive.positions.len();
            let split = all.split_of(i, p);
            let count = own + split.map_or(0, |s| s.parents.len());
            if light.len() != count {
                let at = format!("vertex light of instance {i}, primitive {p}");
                return fail(at, count, light.len());
            }
            let Some(split) = split else {
                continue;
            };
            let at = || format!("split triangles of instance {i}, primitive {p}");
            for (k, pair) in split.parents.iter().enumerate() {
                if let Some(&v) = pair.iter().find(|&&v| v as usize >= own + k) {
                    return fail(at(), own + k, v as usize);
                }
            }
            let mut vertices = split.triangles.iter().flat_map(|t| t.1);
            if let Some(v) = vertices.find(|&v| v as usize >= count) {
                return fail(at(), count, v as usize);
            }
            if !split.triangles.is_sorted_by_key(|t| t.0) {
                return fail(at(), 0, 1);
            }
        }
    }
    Ok(())
}

/// Whether each material of the scene is emissive.
fn glowing(scene: &Scene) -> Vec<bool> {
    scene
        .materials
        .iter()
        .map(|m| m.emissive.max_element() > 0.0)
        .collect()
}

/// R at a vertex, black if E is unusable.
fn radiance(e: [f32; 3]) -> Vec3 {
    let e = Vec3::from(e);
    if e.is_finite() {
        e.max(Vec3::ZERO) / PI
    } else {
        Vec3::ZERO
    }
}

/// c at a vertex.
fn own_color(primitive: &Primitive, v: usize) -> Vec3 {
    primitive.colors.get(v).map_or(Vec3::ONE, |c| c.truncate())
}

/// Required value of `COLOR_0` × scale at vertex `v`.
fn target(scene: &Scene, primitive: &Primitive, glows: bool, v: usize, e: [f32; 3]) -> Vec3 {
    let reflected = own_color(primitive, v) * radiance(e);
    if !glows {
        return reflected;
    }
    let material = &scene.materials[primitive.material];
    let (corners, weights) = ([v as u32; 3], [1.0, 0.0, 0.0]);
    let emission = texture::emission_at(scene, primitive, material, corners, weights);
    let factor = material.base_color.truncate();
    match &material.base_texture {
        None => factor * reflected + emission,
        some => {
            let t = texture::texel(scene, primitive, some.as_ref(), corners, weights).truncate();
            reflected + emission / (factor * t).max(Vec3::splat(LEAST_REFLECTANCE))
        }
    }
}

/// The file's scale; 1 if there is no light.
fn scale_of(scene: &Scene, all: &VertexLight) -> f32 {
    let glows = glowing(scene);
    let (mut reflected, mut largest) = (Vec::new(), 0f32);
    for (i, (instance, light)) in scene.instances.iter().zip(&all.instances).enumerate() {
        let primitives = &scene.meshes[instance.mesh].primitives;
        for (p, (primitive, light)) in primitives.iter().zip(light).enumerate() {
            if !scene.receives(i, p) {
                continue;
            }
            let parents = all.split_of(i, p).map_or(&[][..], |s| &s.parents);
            let looks = midpoints::looks(primitive, parents);
            let primitive = looks.as_ref();
            for (v, &e) in light.iter().enumerate() {
                reflected.push((own_color(primitive, v) * radiance(e)).max_element());
                let whole = target(scene, primitive, glows[primitive.material], v, e).max_element();
                largest = largest.max(whole);
            }
        }
    }
    if reflected.is_empty() || largest <= 0.0 {
        return 1.0;
    }
    let rank = (reflected.len() - 1) * 99 / 100;
    let (_, &mut p99, _) = reflected.select_nth_unstable_by(rank, f32::total_cmp);
    if p99 > 0.0 {
        largest.min(HEADROOM * p99)
    } else {
        largest
    }
}

struct Writer<'a> {
    editor: Editor<'a>,
    scene: &'a Scene,
    stats: VertexStats,
    /// The document's meshes with compressed primitives unpacked, by mesh of the scene and shared
    /// by all instances.
    bases: Vec<Option<Map<String, Value>>>,
    /// The unlit version of each material of the scene.
    materials: BTreeMap<usize, usize>,
    glowing: Vec<bool>,
}

impl Writer<'_> {
    /// Whether the primitive gets colours on instances that are not occluders.
    fn receives(&self, primitive: &Primitive) -> bool {
        !self.scene.materials[primitive.material].occluder_only
    }

    /// The document's meshes that only baked nodes use.
    fn meshes_of_baked_nodes_only(&self) -> BTreeSet<usize> {
        let instances = &self.scene.instances;
        let baked: BTreeSet<usize> = (0..instances.len())
            .filter(|&i| self.scene.has_lightmap(i))
            .map(|i| instances[i].node)
            .collect();
        let mut meshes: BTreeSet<usize> = self.scene.meshes.iter().map(|m| m.gltf_mesh).collect();
        let nodes = self
            .editor
            .json
            .get("nodes")
            .and_then(Value::as_array)
            .into_iter()
            .flatten();
        for (i, node) in nodes.enumerate() {
            if let Some(mesh) = node
                .as_object()
                .and_then(|n| index(n, "mesh"))
                .filter(|_| !baked.contains(&i))
            {
                meshes.remove(&mesh);
            }
        }
        meshes
    }

    /// Makes an unlit version of every material that a baked primitive uses: in place unless
    /// something else uses it too.
    fn convert_materials(&mut self, in_place: &BTreeSet<usize>) {
        let baked: BTreeSet<(usize, usize)> = self
            .scene
            .meshes
            .iter()
            .filter(|m| in_place.contains(&m.gltf_mesh))
            .flat_map(|m| {
                let receiving = m.primitives.iter().filter(|p| self.receives(p));
                receiving.map(|p| (m.gltf_mesh, p.gltf_primitive))
            })
            .collect();
        let mut kept = BTreeSet::new();
        for (m, mesh) in elements_mut(&mut self.editor.json, "meshes").enumerate() {
            for (p, primitive) in elements_mut(mesh, "primitives").enumerate() {
                if !baked.contains(&(m, p)) {
                    kept.extend(index(primitive, "material"));
                }
            }
        }
        let used: BTreeSet<usize> = (0..self.scene.instances.len())
            .filter(|&i| self.scene.has_lightmap(i))
            .flat_map(|i| &self.scene.meshes[self.scene.instances[i].mesh].primitives)
            .filter(|p| self.receives(p))
            .map(|p| p.material)
            .collect();
        for material in used {
            let of = &self.scene.materials[material];
            let own = of
                .gltf_material
                .and_then(|i| element(&self.editor.json, "materials", i).cloned());
            let mut unlit = own.unwrap_or_default();
            let obsolete: Vec<String> = unlit
                .get("extensions")
                .and_then(Value::as_object)
                .into_iter()
                .flat_map(|e| e.keys())
                .filter(|name| name.starts_with("KHR_materials_"))
                .cloned()
                .collect();
            remove_extensions(
                &mut unlit,
                &obsolete.iter().map(String::as_str).collect::<Vec<_>>(),
            );
            object_at(&mut unlit, "extensions").insert("KHR_materials_unlit".into(), json!({}));
            if self.glowing[material] {
                // The emission is in the colours; a renderer without unlit support must not add it
                // again.
                unlit.shift_remove("emissiveFactor");
                unlit.shift_remove("emissiveTexture");
                if of.base_texture.is_none() {
                    let pbr = object_at(&mut unlit, "pbrMetallicRoughness");
                    pbr.insert(
                        "baseColorFactor".into(),
                        json!([1.0, 1.0, 1.0, of.base_color.w]),
                    );
                }
            }
            let at = match of.gltf_material.filter(|i| !kept.contains(i)) {
                Some(i) => {
                    self.editor.json["materials"][i] = Value::Object(unlit);
                    i
                }
                None => push(&mut self.editor.json, "materials", Value::Object(unlit)),
            };
            self.materials.insert(material, at);
        }
    }

    /// The document's mesh with compressed primitives unpacked.
    fn base(&mut self, mesh: usize) -> Result<Map<String, Value>> {
        if let Some(base) = &self.bases[mesh] {
            return Ok(base.clone());
        }
        let of = &self.scene.meshes[mesh];
        let missing = || Error::Inconsistent {
            at: format!("meshes[{}]", of.gltf_mesh),
            message: "not in the document".into(),
        };
        let mut base = element(&self.editor.json, "meshes", of.gltf_mesh)
            .cloned()
            .ok_or_else(missing)?;
        for primitive in of
            .primitives
            .iter()
            .filter(|p| !self.scene.materials[p.material].occluder_only)
        {
            let own = element_mut(&mut base, "primitives", primitive.gltf_primitive)
                .ok_or_else(missing)?;
            // Variants would switch to lit materials.
            remove_extensions(own, &["KHR_materials_variants"]);
            if own
                .get("extensions")
                .is_some_and(|e| e.get("KHR_draco_mesh_compression").is_some())
            {
                let raw = self
                    .editor
                    .document
                    .primitive_raw(of.gltf_mesh, primitive.gltf_primitive)?;
                remove_extensions(own, &["KHR_draco_mesh_compression"]);
                own.shift_remove("mode");
                let all: Vec<u32> = (0..raw.vertex_count as u32).collect();
                let attributes = object_at(own, "attributes");
                for (name, accessor) in &raw.attributes {
                    let new = add_gathered(
                        &mut self.editor,
                        name,
                        accessor,
                        &all,
                        accessor_of(attributes, name),
                    );
                    attributes.insert(name.clone(), new.into());
                }
                let indices = self.editor.add_indices(&raw.triangles);
                own.insert("indices".into(), indices.into());
            }
        }
        self.bases[mesh] = Some(base.clone());
        Ok(base)
    }

    /// A copy of an instance's mesh with `light` on it.
    fn lit_mesh(&mut self, instance: usize, light: &VertexLight) -> Result<Value> {
        let mesh = self.scene.instances[instance].mesh;
        let mut lit = self.base(mesh)?;
        let gltf_mesh = self.scene.meshes[mesh].gltf_mesh;
        // If one primitive of a mesh deforms, none is split, because cracks would open between
        // them.
        let mut splits = false;
        if light.split.get(instance).is_some_and(|s| !s.is_empty()) {
            splits = true;
            for primitive in &self.scene.meshes[mesh].primitives {
                let document = self.editor.document;
                let raw = document.primitive_raw(gltf_mesh, primitive.gltf_primitive)?;
                splits &= !midpoints::deforms(&raw);
            }
        }
        let primitives = &self.scene.meshes[mesh].primitives;
        for (p, (primitive, light_of)) in primitives
            .iter()
            .zip(&light.instances[instance])
            .enumerate()
        {
            if !self.receives(primitive) {
                continue;
            }
            let split = light.split_of(instance, p).filter(|_| splits);
            let own = primitive.positions.len();
            let (light_of, parents) = match split {
                Some(split) => (&light_of[..], &split.parents[..]),
                None => (&light_of[..own], &[][..]),
            };
            let Some(slot) = element_mut(&mut lit, "primitives", primitive.gltf_primitive) else {
                continue;
            };
            if let Some(split) = split {
                self.rewrite(slot, primitive, gltf_mesh, split)?;
            }
            let colors = self.add_colors(&midpoints::looks(primitive, parents), light_of);
            let irradiance = self.editor.add_floats(light_only(light_of).as_slice());
            let attributes = object_at(slot, "attributes");
            attributes.insert("COLOR_0".into(), colors.into());
            attributes.insert("_IRRADIANCE".into(), irradiance.into());
            if let Some(&material) = self.materials.get(&primitive.material) {
                slot.insert("material".into(), material.into());
            }
        }
        Ok(Value::Object(lit))
    }

    /// Gives a primitive the vertices and triangles of `split`.
    fn rewrite(
        &mut self,
        slot: &mut Map<String, Value>,
        primitive: &Primitive,
        gltf_mesh: usize,
        split: &SplitPrimitive,
    ) -> Result<()> {
        let document = self.editor.document;
        let raw = document.primitive_raw(gltf_mesh, primitive.gltf_primitive)?;
        let count = raw.vertex_count + split.parents.len();
        slot.shift_remove("mode");
        let attributes = object_at(slot, "attributes");
        for (name, accessor) in &raw.attributes {
            if name == "COLOR_0" || name == "_IRRADIANCE" {
                continue; // Replaced below.
            }
            let template = accessor_of(attributes, name);
            let elements = midpoints::extended(name, accessor, &split.parents);
            let extended = RawAccessor {
                bytes: elements.into(),
                count,
                ..accessor.clone()
            };
            let all: Vec<u32> = (0..count as u32).collect();
            let new = add_gathered(&mut self.editor, name, &extended, &all, template);
            attributes.insert(name.clone(), new.into());
        }
        let triangles = midpoints::triangles(primitive, &raw, split);
        let indices = self.editor.add_indices(&triangles);
        slot.insert("indices".into(), indices.into());
        self.stats.vertices_added += split.parents.len() as u64;
        Ok(())
    }

    /// Normalised 16-bit colours, with alpha if the primitive has its own colours, which may be
    /// transparent.
    fn add_colors(&mut self, primitive: &Primitive, light: &[[f32; 3]]) -> usize {
        let glows = self.glowing[primitive.material];
        let with_alpha = primitive.colors.iter().any(|c| c.w != 1.0);
        let scale = self.stats.scale;
        let word = |x: f32| (x.clamp(0.0, 1.0) * 65535.0).round() as u16;
        let mut bytes = Vec::with_capacity(light.len() * 8);
        for (v, &e) in light.iter().enumerate() {
            let color = target(self.scene, primitive, glows, v, e) / scale;
            self.stats.vertices += 1;
            // Rounding of the division does not count as clamping.
            self.stats.clamped += u64::from(color.max_element() > 1.0 + f32::EPSILON);
            self.stats.unusable += u64::from(e.iter().any(|x| !(x.is_finite() && *x >= 0.0)));
            let alpha = primitive.colors.get(v).filter(|_| with_alpha).map(|c| c.w);
            for x in color.to_array().into_iter().chain(alpha) {
                bytes.extend_from_slice(&word(x).to_le_bytes());
            }
        }
        let kind = if with_alpha { "VEC4" } else { "VEC3" };
        let accessor = json!({"componentType": 5123, "normalized": true, "type": kind});
        let accessor = accessor.as_object().cloned().unwrap_or_default();
        self.editor.add_attribute(accessor, bytes, light.len())
    }

    /// Assigns each node its mesh; copies of instanced nodes become children.
    fn place(&mut self, mesh_of: &[Option<usize>]) -> Result<()> {
        let scale = json!({"scale": self.stats.scale});
        let instances = &self.scene.instances;
        let nodes = by_node(
            instances
                .iter()
                .zip(mesh_of)
                .filter_map(|(i, &mesh)| Some((i.node, i.copy, mesh?.into()))),
        );
        for (node, meshes) in nodes {
            let missing = || Error::Inconsistent {
                at: format!("nodes[{node}]"),
                message: "not in the document".into(),
            };
            let mut own = element(&self.editor.json, "nodes", node)
                .cloned()
                .ok_or_else(missing)?;
            set_extra(&mut own, VERTEX_LIGHT_EXTRA, scale.clone());
            match meshes {
                Value::Array(meshes) => self.expand(node, &mut own, &meshes)?,
                mesh => {
                    own.insert("mesh".into(), mesh);
                }
            }
            self.editor.json["nodes"][node] = Value::Object(own);
        }
        Ok(())
    }

    /// Replaces the `EXT_mesh_gpu_instancing` of `own` by child nodes. Unbaked copies (null in
    /// `meshes`, or beyond its end) keep the document's mesh.
    fn expand(
        &mut self,
        node: usize,
        own: &mut Map<String, Value>,
        meshes: &[Value],
    ) -> Result<()> {
        let path = format!("nodes[{node}].extensions.EXT_mesh_gpu_instancing");
        let attributes = own
            .get("extensions")
            .and_then(|e| e.get("EXT_mesh_gpu_instancing"))
            .and_then(|e| e.get("attributes"));
        let attributes = attributes.and_then(Value::as_object).cloned();
        let attributes = attributes.ok_or_else(|| Error::Inconsistent {
            at: path,
            message: "not in the document".into(),
        })?;
        let mut read = BTreeMap::new();
        let mut count = meshes.len();
        for (name, key) in [
            ("TRANSLATION", "translation"),
            ("ROTATION", "rotation"),
            ("SCALE", "scale"),
        ] {
            if let Some(accessor) = index(&attributes, name) {
                let raw = self.editor.document.accessor_raw(accessor)?;
                count = count.max(raw.count);
                read.insert(key, raw.to_floats::<4>(0.0));
            }
        }
        let mesh = own.shift_remove("mesh").unwrap_or(Value::Null);
        let name = own.get("name").and_then(Value::as_str).map(str::to_owned);
        remove_extensions(own, &["EXT_mesh_gpu_instancing"]);
        for copy in 0..count {
            let mut child = Map::new();
            if let Some(name) = &name {
                child.insert("name".into(), format!("{name}.{copy}").into());
            }
            child.insert(
                "mesh".into(),
                meshes
                    .get(copy)
                    .filter(|m| !m.is_null())
                    .unwrap_or(&mesh)
                    .clone(),
            );
            for (key, values) in &read {
                let Some(x) = values.get(copy).map(|x| x.map(f64::from)) else {
                    continue;
                };
                let value = if *key == "rotation" {
                    // Quantised quaternions are not exactly unit, but a node's rotation must be.
                    let length = x.iter().map(|x| x * x).sum::<f64>().sqrt();
                    if length > 0.0 {
                        json!(x.map(|x| x / length))
                    } else {
                        json!([0.0, 0.0, 0.0, 1.0])
                    }
                } else {
                    json!(&x[..3])
                };
                child.insert((*key).into(), value);
            }
            set_extra(
                &mut child,
                VERTEX_LIGHT_EXTRA,
                json!({"scale": self.stats.scale}),
            );
            let child = push(&mut self.editor.json, "nodes", Value::Object(child));
            push(own, "children", child.into());
            self.stats.nodes_added += 1;
        }
        Ok(())
    }
}

/// E with unusable values set to 0, so that the file contains no NaN.
fn light_only(light: &[[f32; 3]]) -> Vec<[f32; 3]> {
    light
        .iter()
        .map(|e| {
            if e.iter().all(|x| x.is_finite()) {
                *e
            } else {
                [0.0; 3]
            }
        })
        .collect()
}
