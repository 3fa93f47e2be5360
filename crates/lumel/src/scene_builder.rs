//! Generated scenes: a small glTF writer in memory.

use mesh_ingest::MemoryDocument;
use serde_json::{Value, json};

/// Constants of the glTF specification (§3.6.2, §3.6.1.1).
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Material of a surface. The default is white, opaque, single-sided and not emissive.
///
/// ```
/// use lumel::Surface;
///
/// let lamp = Surface { emission: [10.0; 3], ..Surface::default() };
/// assert!(!lamp.double_sided);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Reflectance, linear RGB, 0..=1.
    pub reflectance: [f32; 3],
    /// Emitted radiance of the front, ≥ 0: nit if lamps are photometric, W/(m² sr) if they are
    /// radiometric.
    pub emission: [f32; 3],
    /// Whether both sides reflect and emit. A single-sided surface still blocks light from behind,
    /// and its back is black.
    pub double_sided: bool,
}

impl Default for Surface {
    fn default() -> Self {
        Surface {
            reflectance: [1.0; 3],
            emission: [0.0; 3],
            double_sided: false,
        }
    }
}

/// A material of a [`SceneBuilder`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaterialId(usize);

/// A mesh of a [`SceneBuilder`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshId(usize);

/// Builds a scene of indexed triangles and lamps, for programs that have no glTF.
///
/// It covers what most levels need. For textures and more, write a glTF by other means and bake its
/// bytes ([`MemoryDocument::new`]). Units are metres, +Y is up, and counter-clockwise triangles
/// face the viewer. Invalid numbers (an index out of range, a NaN) are reported when the scene is
/// baked.
///
/// ```
/// use lumel::{SceneBuilder, Surface};
///
/// let mut scene = SceneBuilder::new();
/// let grey = scene.material("grey", Surface { reflectance: [0.5; 3], ..Surface::default() });
/// let corners = [[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, -1.0]];
/// let square = scene.mesh("square", &corners, &[[0, 1, 2], [0, 2, 3]], grey);
/// scene.place("floor", square, [0.0, 0.0, 0.0]);
/// scene.point_light("lamp", [0.0, 2.0, 0.0], [40.0; 3]);
/// let document = scene.finish("room.glb");
/// ```
#[derive(Debug, Clone, Default)]
pub struct SceneBuilder {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    lights: Vec<Value>,
    nodes: Vec<Value>,
    strong: bool,
}

impl SceneBuilder {
    /// An empty scene.
    pub fn new() -> SceneBuilder {
        SceneBuilder::default()
    }

    /// Adds a material.
    pub fn material(&mut self, name: &str, surface: Surface) -> MaterialId {
        let [r, g, b] = surface.reflectance;
        let mut out = json!({
            "name": name,
            "pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
        });
        let peak = surface.emission.iter().copied().fold(0.0, f32::max);
        if peak > 0.0 {
            // emissiveFactor is at most 1; brighter emission needs KHR_materials_emissive_strength.
            let strength = peak.max(1.0);
            out["emissiveFactor"] = json!(surface.emission.map(|e| (e / strength).min(1.0)));
            if strength > 1.0 {
                self.strong = true;
                out["extensions"] =
                    json!({"KHR_materials_emissive_strength": {"emissiveStrength": strength}});
            }
        }
        if surface.double_sided {
            out["doubleSided"] = json!(true);
        }
        self.materials.push(out);
        MaterialId(self.materials.len() - 1)
    }

    /// Adds a mesh of flat-shaded triangles, given as indices into `positions` (metres).
    pub fn mesh(
        &mut self,
        name: &str,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        material: MaterialId,
    ) -> MeshId {
        let attributes = json!({"POSITION": self.vectors(positions)});
        self.add_mesh(name, attributes, triangles, material)
    }

    /// As [`mesh`](Self::mesh), smooth-shaded by `normals` (unit, one per position).
    pub fn smooth_mesh(
        &mut self,
        name: &str,
        positions: &[[f32; 3]],
        normals: &[[f32; 3]],
        triangles: &[[u32; 3]],
        material: MaterialId,
    ) -> MeshId {
        let attributes =
            json!({"POSITION": self.vectors(positions), "NORMAL": self.vectors(normals)});
        self.add_mesh(name, attributes, triangles, material)
    }

    /// Places a mesh with a translation (metres). Instances share the mesh's charts, but each has
    /// its own lumels.
    pub fn place(&mut self, name: &str, mesh: MeshId, translation: [f32; 3]) {
        self.nodes
            .push(json!({"name": name, "mesh": mesh.0, "translation": translation}));
    }

    /// Places a mesh by an affine column-major matrix, as in glTF and glam (`to_cols_array`); the
    /// last row must be 0, 0, 0, 1.
    pub fn place_matrix(&mut self, name: &str, mesh: MeshId, matrix: [f32; 16]) {
        self.nodes
            .push(json!({"name": name, "mesh": mesh.0, "matrix": matrix}));
    }

    /// Adds an isotropic point lamp: candela (or W/sr) per colour channel.
    pub fn point_light(&mut self, name: &str, position: [f32; 3], intensity: [f32; 3]) {
        let peak = intensity.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
        self.lights.push(json!({
            "name": name, "type": "point", "color": intensity.map(|i| i / peak), "intensity": peak,
        }));
        let light = self.lights.len() - 1;
        self.nodes.push(json!({
            "name": name, "translation": position, "extensions": {"KHR_lights_punctual": {"light": light}},
        }));
    }

    /// The scene as a document in memory; results are named after the stem of `name`.
    pub fn finish(self, name: &str) -> MemoryDocument {
        MemoryDocument::new(name, self.glb())
    }

    /// The scene as the bytes of a .glb, which other programs can open too.
    pub fn glb(self) -> Vec<u8> {
        let roots: Vec<usize> = (0..self.nodes.len()).collect();
        let mut root = json!({
            "asset": {"version": "2.0", "generator": concat!("lumel ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [if roots.is_empty() { json!({}) } else { json!({"nodes": roots}) }],
        });
        let mut used = Vec::new();
        if !self.lights.is_empty() {
            used.push("KHR_lights_punctual");
            root["extensions"] = json!({"KHR_lights_punctual": {"lights": self.lights}});
        }
        if self.strong {
            used.push("KHR_materials_emissive_strength");
        }
        // glTF forbids empty lists.
        let mut put = |key: &str, list: Vec<Value>| {
            if !list.is_empty() {
                root[key] = Value::Array(list);
            }
        };
        put(
            "extensionsUsed",
            used.into_iter().map(Value::from).collect(),
        );
        put("nodes", self.nodes);
        put("meshes", self.meshes);
        put("materials", self.materials);
        put("accessors", self.accessors);
        put("bufferViews", self.views);
        if !self.bin.is_empty() {
            put("buffers", vec![json!({"byteLength": self.bin.len()})]);
        }
        container(root.to_string().into_bytes(), self.bin)
    }

    fn add_mesh(
        &mut self,
        name: &str,
        attributes: Value,
        triangles: &[[u32; 3]],
        material: MaterialId,
    ) -> MeshId {
        let bytes: Vec<u8> = (triangles.iter().flatten())
            .flat_map(|i| i.to_le_bytes())
            .collect();
        let view = self.view(&bytes, ELEMENT_ARRAY_BUFFER);
        self.accessors.push(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "count": 3 * triangles.len(), "type": "SCALAR",
        }));
        let indices = self.accessors.len() - 1;
        self.meshes.push(json!({
            "name": name,
            "primitives": [{"attributes": attributes, "indices": indices, "material": material.0}],
        }));
        MeshId(self.meshes.len() - 1)
    }

    fn vectors(&mut self, vectors: &[[f32; 3]]) -> usize {
        let bytes: Vec<u8> = (vectors.iter().flatten())
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let view = self.view(&bytes, ARRAY_BUFFER);
        let bound = |f: fn(f32, f32) -> f32| -> [f32; 3] {
            let fold = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|k| f(a[k], b[k]));
            vectors.iter().copied().reduce(fold).unwrap_or_default()
        };
        self.accessors.push(json!({
            "bufferView": view, "componentType": FLOAT, "count": vectors.len(), "type": "VEC3",
            "min": bound(f32::min), "max": bound(f32::max),
        }));
        self.accessors.len() - 1
    }

    fn view(&mut self, bytes: &[u8], target: u32) -> usize {
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len(), "target": target,
        }));
        // Everything stored has a multiple of four bytes, so the next view is aligned.
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }
}

/// Packs a JSON and a binary chunk into a .glb (glTF 2.0, §4.4).
fn container(mut json: Vec<u8>, bin: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let chunks = [(json, b"JSON"), (bin, b"BIN\0")];
    let chunks = || chunks.iter().filter(|(bytes, _)| !bytes.is_empty());
    let length: usize = 12 + chunks().map(|(bytes, _)| 8 + bytes.len()).sum::<usize>();
    let mut out = Vec::with_capacity(length);
    out.extend_from_slice(b"glTF");
    out.extend_from_slice(&2u32.to_le_bytes());
    out.extend_from_slice(&(length as u32).to_le_bytes());
    for (bytes, kind) in chunks() {
        out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
        out.extend_from_slice(*kind);
        out.extend_from_slice(bytes);
    }
    out
}
