//! A small writer of binary glTF 2.0 files for test scenes.
//!
//! It supports only what Lumel's scenes need: indexed triangles, embedded PNG textures, nodes,
//! punctual lights, cameras and extras. The same calls give the same bytes, and the files pass the
//! Khronos validator without errors. Source: Khronos, *glTF 2.0 Specification*, §3 (concepts) and
//! §4 (GLB container).

use std::collections::BTreeSet;

use glam::{Quat, Vec2, Vec3};
use image::{ExtendedColorType, ImageEncoder, RgbaImage, codecs::png};
use serde_json::{Map, Value, json};

use crate::geometry::Geometry;

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;

/// A surface's material. [`Material::default`] is white, opaque, single-sided and not emissive.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name in the document.
    pub name: String,
    /// Linear RGB reflectance, 0..=1 (`baseColorFactor`).
    pub reflectance: [f32; 3],
    /// Index from [`GltfBuilder::texture`], multiplied by `reflectance`; needs uv.
    pub texture: Option<usize>,
    /// Radiance of the front in W/(m² sr), any size ≥ 0; above 1 `KHR_materials_emissive_strength`
    /// is used.
    pub emission: [f32; 3],
    /// Index from [`GltfBuilder::texture`], multiplied by `emission`; needs uv.
    pub emission_texture: Option<usize>,
    /// `alphaMode` MASK with this cutoff.
    pub mask: Option<f32>,
    /// `alphaMode` BLEND with this alpha (`baseColorFactor`).
    pub blend: Option<f32>,
    /// `transmissionFactor` of `KHR_materials_transmission`.
    pub transmission: f32,
    /// Whether both sides reflect and emit.
    pub double_sided: bool,
    /// Free data for `extras`.
    pub extras: Option<Value>,
}

impl Default for Material {
    fn default() -> Self {
        Material {
            name: String::new(),
            reflectance: [1.0; 3],
            texture: None,
            emission: [0.0; 3],
            emission_texture: None,
            mask: None,
            blend: None,
            transmission: 0.0,
            double_sided: false,
            extras: None,
        }
    }
}

impl Material {
    /// A plain reflecting surface.
    pub fn diffuse(name: &str, reflectance: [f32; 3]) -> Material {
        Material {
            name: name.into(),
            reflectance,
            ..Material::default()
        }
    }

    /// A surface that emits radiance `emission` and reflects `reflectance`.
    pub fn emitter(name: &str, emission: [f32; 3], reflectance: [f32; 3]) -> Material {
        Material {
            emission,
            ..Material::diffuse(name, reflectance)
        }
    }
}

/// A `KHR_lights_punctual` light; it shines along its node's −Z.
#[derive(Debug, Clone, Copy)]
pub enum Light {
    /// Candela (W/sr) per colour channel.
    Point([f32; 3]),
    /// Candela per colour channel, then the half-angles in radians at which full intensity and all
    /// light end.
    Spot([f32; 3], f32, f32),
    /// Lux (W/m²) on a plane facing it, per colour channel.
    Directional([f32; 3]),
}

/// A node to place; [`Node::default`] is nameless, empty and at the origin.
#[derive(Debug, Clone)]
pub struct Node {
    /// Name in the document.
    pub name: String,
    /// Translation in metres.
    pub translation: Vec3,
    /// Rotation.
    pub rotation: Quat,
    /// Scale per axis; may be negative.
    pub scale: Vec3,
    /// Index from [`GltfBuilder::mesh`].
    pub mesh: Option<usize>,
    /// Index from [`GltfBuilder::light`].
    pub light: Option<usize>,
    /// Index from [`GltfBuilder::camera`].
    pub camera: Option<usize>,
    /// Indices of nodes that were added before.
    pub children: Vec<usize>,
    /// Free data for `extras`.
    pub extras: Option<Value>,
}

impl Default for Node {
    fn default() -> Self {
        Node {
            name: String::new(),
            translation: Vec3::ZERO,
            rotation: Quat::IDENTITY,
            scale: Vec3::ONE,
            mesh: None,
            light: None,
            camera: None,
            children: Vec::new(),
            extras: None,
        }
    }
}

impl Node {
    /// A node that shows `mesh` at the origin.
    pub fn of_mesh(name: &str, mesh: usize) -> Node {
        Node {
            name: name.into(),
            mesh: Some(mesh),
            ..Node::default()
        }
    }
}

/// Rotation that turns a camera's or light's −Z to `forward` with +Y near `up`.
///
/// A `forward` along `up` uses +Z in its place.
pub fn look_along(forward: Vec3, up: Vec3) -> Quat {
    let f = forward.normalize();
    let up = if f.cross(up).length_squared() < 1e-6 {
        Vec3::Z
    } else {
        up
    };
    let right = f.cross(up).normalize();
    Quat::from_mat3(&glam::Mat3::from_cols(right, right.cross(f), -f))
}

/// Collects a document and writes it as GLB.
#[derive(Debug, Clone, Default)]
pub struct GltfBuilder {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    samplers: Vec<Value>,
    textures: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    roots: Vec<usize>,
    lights: Vec<Value>,
    cameras: Vec<Value>,
    /// Names of extensions that materials use.
    material_extensions: BTreeSet<&'static str>,
    /// Extensions of the root and of the scene, by name.
    root_extensions: Map<String, Value>,
    scene_extensions: Map<String, Value>,
}

/// The shortest decimal that reads back as `x`, so that files contain `0.1` instead of
/// `0.10000000149`.
fn number(x: f32) -> Value {
    json!(x.to_string().parse::<f64>().unwrap_or(0.0))
}

fn numbers(v: &[f32]) -> Value {
    Value::Array(v.iter().map(|&x| number(x)).collect())
}

impl GltfBuilder {
    /// An empty document.
    pub fn new() -> GltfBuilder {
        GltfBuilder::default()
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        let mut view =
            json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bin.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn float_accessor(&mut self, values: &[f32], width: usize, bounds: bool) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        let mut accessor = json!({"bufferView": view, "componentType": FLOAT, "count": values.len() / width, "type": kind});
        if bounds {
            let fold = |f: fn(f32, f32) -> f32| -> Vec<f64> {
                (0..width)
                    .map(|k| {
                        f64::from(
                            values
                                .iter()
                                .skip(k)
                                .step_by(width)
                                .copied()
                                .reduce(f)
                                .unwrap_or(0.0),
                        )
                    })
                    .collect()
            };
            accessor["min"] = json!(fold(f32::min));
            accessor["max"] = json!(fold(f32::max));
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn index_accessor(&mut self, indices: &[u32], vertices: usize) -> usize {
        // 65535 is the primitive-restart value and may not occur as an index.
        let short = vertices <= 65535;
        let bytes: Vec<u8> = if short {
            indices
                .iter()
                .flat_map(|&i| (i as u16).to_le_bytes())
                .collect()
        } else {
            indices.iter().flat_map(|i| i.to_le_bytes()).collect()
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        let component = if short { UNSIGNED_SHORT } else { UNSIGNED_INT };
        self.accessors.push(
            json!({"bufferView": view, "componentType": component, "count": indices.len(), "type": "SCALAR"}),
        );
        self.accessors.len() - 1
    }

    /// Embeds `picture` (sRGB, row 0 at the top) as PNG; returns the texture's index. `nearest`
    /// turns filtering off.
    ///
    /// # Panics
    /// If the encoder refuses the picture (zero size).
    pub fn texture(&mut self, name: &str, picture: &RgbaImage, nearest: bool) -> usize {
        let image = self.image(name, picture);
        let filter = if nearest { 9728 } else { 9729 };
        let sampler = json!({"magFilter": filter, "minFilter": if nearest { 9728 } else { 9987 }, "wrapS": 10497, "wrapT": 10497});
        let sampler_index = self
            .samplers
            .iter()
            .position(|s| *s == sampler)
            .unwrap_or_else(|| {
                self.samplers.push(sampler);
                self.samplers.len() - 1
            });
        self.textures
            .push(json!({"name": name, "source": image, "sampler": sampler_index}));
        self.textures.len() - 1
    }

    /// Embeds `picture` (row 0 at the top) as PNG for other uses than textures; returns the image's
    /// index.
    ///
    /// # Panics
    /// If the encoder refuses the picture (zero size).
    pub fn image(&mut self, name: &str, picture: &RgbaImage) -> usize {
        let mut bytes = Vec::new();
        let encoder = png::PngEncoder::new_with_quality(
            &mut bytes,
            png::CompressionType::Best,
            png::FilterType::Adaptive,
        );
        let opaque = picture.pixels().all(|p| p.0[3] == 255);
        let (w, h) = picture.dimensions();
        let written = if opaque {
            let rgb: Vec<u8> = picture
                .pixels()
                .flat_map(|p| [p.0[0], p.0[1], p.0[2]])
                .collect();
            encoder.write_image(&rgb, w, h, ExtendedColorType::Rgb8)
        } else {
            encoder.write_image(picture.as_raw(), w, h, ExtendedColorType::Rgba8)
        };
        written.expect("a picture in memory encodes");
        let view = self.view(&bytes, None);
        self.images
            .push(json!({"name": name, "bufferView": view, "mimeType": "image/png"}));
        self.images.len() - 1
    }

    /// Adds a material; returns its index.
    pub fn material(&mut self, m: &Material) -> usize {
        let [r, g, b] = m.reflectance;
        let mut pbr = json!({"baseColorFactor": numbers(&[r, g, b, m.blend.unwrap_or(1.0)]), "metallicFactor": 0.0, "roughnessFactor": 1.0});
        if let Some(t) = m.texture {
            pbr["baseColorTexture"] = json!({"index": t});
        }
        let mut out = json!({"name": m.name, "pbrMetallicRoughness": pbr});
        let peak = m.emission.iter().copied().fold(0.0, f32::max);
        if peak > 0.0 {
            let strength = peak.max(1.0);
            out["emissiveFactor"] = numbers(&m.emission.map(|x| x / strength));
            if strength > 1.0 {
                self.material_extensions
                    .insert("KHR_materials_emissive_strength");
                out["extensions"]["KHR_materials_emissive_strength"] =
                    json!({"emissiveStrength": number(strength)});
            }
            if let Some(t) = m.emission_texture {
                out["emissiveTexture"] = json!({"index": t});
            }
        }
        if let Some(cutoff) = m.mask {
            out["alphaMode"] = json!("MASK");
            out["alphaCutoff"] = number(cutoff);
        }
        if m.blend.is_some() {
            out["alphaMode"] = json!("BLEND");
        }
        if m.transmission > 0.0 {
            self.material_extensions
                .insert("KHR_materials_transmission");
            out["extensions"]["KHR_materials_transmission"] =
                json!({"transmissionFactor": number(m.transmission)});
        }
        if m.double_sided {
            out["doubleSided"] = json!(true);
        }
        if let Some(extras) = &m.extras {
            out["extras"] = extras.clone();
        }
        self.materials.push(out);
        self.materials.len() - 1
    }

    /// Adds a mesh with one primitive per (geometry, material); returns its index.
    ///
    /// # Panics
    /// If a primitive has no triangle, or an attribute's length differs from the positions'.
    pub fn mesh(&mut self, name: &str, primitives: &[(&Geometry, usize)]) -> usize {
        let primitives: Vec<Value> = primitives
            .iter()
            .map(|(g, material)| self.primitive(name, g, *material))
            .collect();
        self.meshes
            .push(json!({"name": name, "primitives": primitives}));
        self.meshes.len() - 1
    }

    fn primitive(&mut self, name: &str, g: &Geometry, material: usize) -> Value {
        let n = g.positions.len();
        assert!(
            !g.triangles.is_empty(),
            "{name}: a primitive needs triangles"
        );
        for (what, len) in [
            ("normals", g.normals.len()),
            ("uv", g.uv.len()),
            ("uv1", g.uv1.len()),
            ("colors", g.colors.len()),
        ] {
            assert!(
                len == 0 || len == n,
                "{name}: {len} {what} for {n} vertices"
            );
        }
        let flat3 = |v: &[Vec3]| -> Vec<f32> { v.iter().flat_map(|p| p.to_array()).collect() };
        let flat2 = |v: &[Vec2]| -> Vec<f32> { v.iter().flat_map(|p| p.to_array()).collect() };
        let mut at = Map::new();
        at.insert(
            "POSITION".into(),
            json!(self.float_accessor(&flat3(&g.positions), 3, true)),
        );
        if !g.normals.is_empty() {
            at.insert(
                "NORMAL".into(),
                json!(self.float_accessor(&flat3(&g.normals), 3, false)),
            );
        }
        if !g.uv.is_empty() {
            at.insert(
                "TEXCOORD_0".into(),
                json!(self.float_accessor(&flat2(&g.uv), 2, false)),
            );
        }
        if !g.uv1.is_empty() {
            assert!(
                !g.uv.is_empty(),
                "{name}: TEXCOORD sets must be consecutive"
            );
            at.insert(
                "TEXCOORD_1".into(),
                json!(self.float_accessor(&flat2(&g.uv1), 2, false)),
            );
        }
        if !g.colors.is_empty() {
            let c: Vec<f32> = g.colors.iter().flat_map(|c| c.to_array()).collect();
            at.insert("COLOR_0".into(), json!(self.float_accessor(&c, 4, false)));
        }
        let indices: Vec<u32> = g.triangles.iter().flatten().copied().collect();
        let indices = self.index_accessor(&indices, n);
        json!({"attributes": at, "indices": indices, "material": material})
    }

    /// Adds a light definition; returns its index.
    pub fn light(&mut self, name: &str, light: Light) -> usize {
        let (kind, rgb, cone) = match light {
            Light::Point(c) => ("point", c, None),
            Light::Spot(c, inner, outer) => ("spot", c, Some((inner, outer))),
            Light::Directional(c) => ("directional", c, None),
        };
        let peak = rgb
            .iter()
            .copied()
            .fold(0.0, f32::max)
            .max(f32::MIN_POSITIVE);
        let mut out = json!({"name": name, "type": kind, "color": numbers(&rgb.map(|x| x / peak)), "intensity": number(peak)});
        if let Some((inner, outer)) = cone {
            out["spot"] = json!({"innerConeAngle": number(inner), "outerConeAngle": number(outer)});
        }
        self.lights.push(out);
        self.lights.len() - 1
    }

    /// A light definition as it will be written, for what [`Light`] does not have: `range`,
    /// `extras`.
    ///
    /// # Panics
    /// If there is no such light.
    pub fn light_json(&mut self, light: usize) -> &mut Value {
        &mut self.lights[light]
    }

    /// Sets an extension of the document's root.
    pub fn root_extension(&mut self, name: &str, value: Value) {
        self.root_extensions.insert(name.into(), value);
    }

    /// Sets an extension of the scene.
    pub fn scene_extension(&mut self, name: &str, value: Value) {
        self.scene_extensions.insert(name.into(), value);
    }

    /// Adds bytes for an extension's use; returns the buffer view's index.
    pub fn bytes(&mut self, bytes: &[u8]) -> usize {
        self.view(bytes, None)
    }

    /// Adds a perspective camera; `yfov` in radians; returns its index.
    pub fn camera(&mut self, name: &str, yfov: f32, aspect: f32) -> usize {
        self.cameras
            .push(json!({"name": name, "type": "perspective", "perspective":
            {"yfov": number(yfov), "aspectRatio": number(aspect), "znear": 0.05, "zfar": 500.0}}));
        self.cameras.len() - 1
    }

    /// Adds a node at the scene's root; returns its index.
    pub fn node(&mut self, node: Node) -> usize {
        let index = self.child(node);
        self.roots.push(index);
        index
    }

    /// Adds a node that a later node names in [`Node::children`]; returns its index.
    pub fn child(&mut self, node: Node) -> usize {
        let mut out = Map::new();
        if !node.name.is_empty() {
            out.insert("name".into(), json!(node.name));
        }
        if node.translation != Vec3::ZERO {
            out.insert("translation".into(), numbers(&node.translation.to_array()));
        }
        if node.rotation != Quat::IDENTITY {
            out.insert(
                "rotation".into(),
                numbers(&node.rotation.normalize().to_array()),
            );
        }
        if node.scale != Vec3::ONE {
            out.insert("scale".into(), numbers(&node.scale.to_array()));
        }
        if let Some(mesh) = node.mesh {
            out.insert("mesh".into(), json!(mesh));
        }
        if let Some(camera) = node.camera {
            out.insert("camera".into(), json!(camera));
        }
        if let Some(light) = node.light {
            out.insert(
                "extensions".into(),
                json!({"KHR_lights_punctual": {"light": light}}),
            );
        }
        if !node.children.is_empty() {
            out.insert("children".into(), json!(node.children));
        }
        if let Some(extras) = node.extras {
            out.insert("extras".into(), extras);
        }
        self.nodes.push(Value::Object(out));
        self.nodes.len() - 1
    }

    /// A node's JSON, for what [`Node`] has no field for.
    pub fn node_json(&mut self, node: usize) -> &mut Value {
        &mut self.nodes[node]
    }

    /// The document as GLB bytes.
    pub fn finish(mut self) -> Vec<u8> {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        let mut root = Map::new();
        root.insert(
            "asset".into(),
            json!({"version": "2.0", "generator": "lumel make-assets"}),
        );
        let mut extensions = self.root_extensions;
        if !self.lights.is_empty() {
            extensions.insert("KHR_lights_punctual".into(), json!({"lights": self.lights}));
        }
        let mut used: Vec<String> = (self.material_extensions.iter())
            .map(|name| (*name).into())
            .collect();
        for name in extensions.keys().chain(self.scene_extensions.keys()) {
            if !used.contains(name) {
                used.push(name.clone());
            }
        }
        if !extensions.is_empty() {
            root.insert("extensions".into(), Value::Object(extensions));
        }
        if !used.is_empty() {
            root.insert("extensionsUsed".into(), json!(used));
        }
        let mut scene = json!({"nodes": self.roots});
        if !self.scene_extensions.is_empty() {
            scene["extensions"] = Value::Object(self.scene_extensions);
        }
        root.insert("scene".into(), json!(0));
        root.insert("scenes".into(), json!([scene]));
        root.insert("buffers".into(), json!([{"byteLength": self.bin.len()}]));
        let lists = [
            ("nodes", self.nodes),
            ("cameras", self.cameras),
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("textures", self.textures),
            ("images", self.images),
            ("samplers", self.samplers),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
        ];
        for (key, list) in lists {
            if !list.is_empty() {
                root.insert(key.into(), Value::Array(list));
            }
        }
        let mut text = Value::Object(root).to_string().into_bytes();
        while !text.len().is_multiple_of(4) {
            text.push(b' ');
        }
        let mut out = Vec::with_capacity(28 + text.len() + self.bin.len());
        let total = 12 + 8 + text.len() + 8 + self.bin.len();
        for word in [0x4654_6C67, 2, total as u32, text.len() as u32, 0x4E4F_534A] {
            out.extend_from_slice(&u32::to_le_bytes(word));
        }
        out.extend_from_slice(&text);
        for word in [self.bin.len() as u32, 0x004E_4942] {
            out.extend_from_slice(&u32::to_le_bytes(word));
        }
        out.extend_from_slice(&self.bin);
        out
    }
}
