//! The normal form that every glTF document is brought into.
//!
//! The rest of Lumel never sees glTF again: it sees meshes of clean indexed triangles, instances
//! that place them, materials in linear light, and lights in world space. See [`Scene`] for what is
//! guaranteed.

use std::collections::BTreeMap;

use glam::{Affine2, DAffine3, DVec3, Mat3, Vec2, Vec3, Vec4};

/// A level in normal form.
///
/// Guarantees, made by [`crate::load`] and relied upon everywhere:
/// - every number is finite; every index (vertex, material, image, mesh) is in range;
/// - no triangle of a [`Primitive`] names one vertex twice, has zero area in local space or names
///   the same vertices as another (same facing, or any where its material is double-sided);
/// - instances refer to meshes that have at least one triangle, and their transforms are
///   invertible;
/// - colours are linear Rec.709; reflectances lie in 0..=1; emission is a radiance and ≥ 0.
///
/// World space is the glTF's (right-handed, Y up, metres) moved by −[`origin`](Scene::origin) so
/// that `f32` is precise about the scene's centre.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Unique geometry, in the order of the document's `meshes` (a mesh that is not used has no
    /// entry). Whoever gives instances of one mesh geometry of their own appends copies, which name
    /// the same mesh of the document.
    pub meshes: Vec<Mesh>,
    /// Placements of meshes that receive and cast light, in scene-graph order (depth first).
    pub instances: Vec<Instance>,
    /// The document's materials in order, then the glTF default material.
    pub materials: Vec<Material>,
    /// Decoded images that materials refer to; `None` where an image is not needed for light.
    pub images: Vec<Option<Image>>,
    /// Punctual lights in recentred world space.
    pub lights: Vec<Light>,
    /// Intensity distributions that lights refer to (`EXT_lights_ies`).
    pub profiles: Vec<Profile>,
    /// Light from all around (`EXT_lights_image_based`).
    pub environment: Option<Environment>,
    /// World position (metres, glTF axes) of the recentred origin.
    pub origin: DVec3,
    /// By group of levels of detail or variants: its instances that rays see, ascending; see
    /// [`Instance::stands_in`].
    pub firsts: Vec<Vec<usize>>,
}

impl Scene {
    /// Whether primitive `primitive` of instance `instance` receives light: neither the node nor
    /// the material only occludes.
    pub fn receives(&self, instance: usize, primitive: usize) -> bool {
        let instance = &self.instances[instance];
        let worn = self.meshes[instance.mesh].primitives[primitive].material;
        !instance.occluder && !self.materials[worn].occluder_only
    }

    /// Whether some primitive of instance `instance` receives light.
    pub fn has_lightmap(&self, instance: usize) -> bool {
        let primitives = &self.meshes[self.instances[instance].mesh].primitives;
        (0..primitives.len()).any(|p| self.receives(instance, p))
    }

    /// Whether instance `instance` has a place in the lightmap: it receives light and its density
    /// is not 0.
    pub fn has_lumels(&self, instance: usize) -> bool {
        self.instances[instance].density > 0.0 && self.has_lightmap(instance)
    }

    /// Which materials some primitive wears.
    pub(crate) fn worn(&self) -> Vec<bool> {
        let mut worn = vec![false; self.materials.len()];
        for primitive in self.meshes.iter().flat_map(|mesh| &mesh.primitives) {
            worn[primitive.material] = true;
        }
        worn
    }
}

/// One glTF mesh in its local space.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Index into the document's `meshes`.
    pub gltf_mesh: usize,
    /// The document's name, or empty.
    pub name: String,
    /// Triangle primitives that have at least one sound triangle; points and lines are not here.
    pub primitives: Vec<Primitive>,
}

/// One glTF primitive: vertices as in the document, triangles cleaned.
#[derive(Debug, Clone, Default)]
pub struct Primitive {
    /// Index into the document's `meshes[gltf_mesh].primitives`.
    pub gltf_primitive: usize,
    /// Vertex positions, local space, one per vertex of the document's accessor (vertex *i* is
    /// accessor element *i*).
    pub positions: Vec<Vec3>,
    /// Unit vertex normals (unusable ones replaced by those of the faces around), or empty where
    /// the document has none (then faces are flat).
    pub normals: Vec<Vec3>,
    /// `TEXCOORD_n` by n; an inner vector is empty where the set is absent.
    pub tex_coords: Vec<Vec<Vec2>>,
    /// `COLOR_0`, linear RGBA, or empty.
    pub colors: Vec<Vec4>,
    /// Triangles as vertex indices, counter-clockwise seen from the front in local space.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, its number in the document's primitive (strips and fans counted as
    /// unrolled).
    pub source_triangles: Vec<u32>,
    /// Index into [`Scene::materials`].
    pub material: usize,
}

/// A mesh placed in the world.
#[derive(Debug, Clone)]
pub struct Instance {
    /// Index of the glTF node.
    pub node: usize,
    /// The node's name, or empty.
    pub name: String,
    /// Which of the node's `EXT_mesh_gpu_instancing` copies this is.
    pub copy: Option<u32>,
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// Local to world (before recentring); may mirror.
    pub transform: DAffine3,
    /// Blocks light, reflects and emits nothing, and gets no lightmap (`extras.lumel.occluder` of
    /// the node or an ancestor).
    pub occluder: bool,
    /// Lumels per metre over the scene's, 0..=1000; with 0 it gets no lightmap but else takes part
    /// in the light (`extras.lumel.density` of the node or the nearest ancestor that says
    /// something, 1 if none does).
    pub density: f32,
    /// A coarser level of detail or another variant of what some other instances show: index into
    /// [`Scene::firsts`]. It neither shadows, reflects nor emits, and receives the light of the
    /// nearest surface of those.
    pub stands_in: Option<usize>,
    /// `{"lumel": …}` from the node's `extras`, where it is there; nothing else of them.
    pub extras: Option<serde_json::Value>,
}

/// What a surface does to light. Every surface is Lambertian; metalness and roughness are not read.
#[derive(Debug, Clone)]
pub struct Material {
    /// The document's name, or empty.
    pub name: String,
    /// Index into the document's `materials`; `None` for the default material.
    pub gltf_material: Option<usize>,
    /// `baseColorFactor`, linear.
    pub base_color: Vec4,
    /// `baseColorTexture` (sRGB).
    pub base_texture: Option<TextureRef>,
    /// `emissiveFactor` × `emissiveStrength`: radiance in W/(m² sr), or nit where the scene is
    /// photometric.
    pub emissive: Vec3,
    /// `emissiveTexture` (sRGB), multiplied with `emissive`.
    pub emissive_texture: Option<TextureRef>,
    /// How alpha is used; opaque also where the document says otherwise but no alpha lets light
    /// through.
    pub alpha: AlphaMode,
    /// Acts on both sides; otherwise the back blocks light, reflects nothing and emits nothing.
    pub double_sided: bool,
    /// `KHR_materials_transmission`: the share of light that passes straight through, coloured by
    /// the base colour, instead of being reflected diffusely; 0..=1.
    pub transmission: f32,
    /// `transmissionTexture` (red channel, linear), multiplied with `transmission`.
    pub transmission_texture: Option<TextureRef>,
    /// Reflectances above this count as this, channel by channel, 0..=1.
    pub max_reflectance: f32,
    /// Blocks light, reflects and emits nothing, and gets no lightmap (`extras.lumel.occluder`).
    pub occluder_only: bool,
}

impl Default for Material {
    /// The glTF default material (glTF 2.0, §3.9.7).
    fn default() -> Self {
        Material {
            name: String::new(),
            gltf_material: None,
            base_color: Vec4::ONE,
            base_texture: None,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha: AlphaMode::Opaque,
            double_sided: false,
            transmission: 0.0,
            transmission_texture: None,
            max_reflectance: 1.0,
            occluder_only: false,
        }
    }
}

impl Material {
    /// Whether some light passes straight through some of it, so that rays must ask at each hit.
    pub fn lets_light_through(&self) -> bool {
        self.alpha != AlphaMode::Opaque || self.transmission > 0.0
    }
}

/// glTF `alphaMode`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Rays pass where alpha < `cutoff`.
    Mask {
        /// glTF `alphaCutoff`.
        cutoff: f32,
    },
    /// Rays pass with probability 1 − alpha.
    Blend,
}

/// How a material samples an image.
#[derive(Debug, Clone)]
pub struct TextureRef {
    /// Index into [`Scene::images`].
    pub image: usize,
    /// Which `TEXCOORD_n` (after `KHR_texture_transform`'s override).
    pub tex_coord: usize,
    /// `KHR_texture_transform`; identity where absent.
    pub transform: Affine2,
    /// Wrapping in s and t.
    pub wrap: [Wrap; 2],
    /// Nearest instead of bilinear magnification.
    pub nearest: bool,
}

/// glTF sampler wrapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// Coordinates beyond the edge read the edge.
    Clamp,
    /// Every other copy is mirrored.
    Mirror,
    /// The image repeats.
    Repeat,
}

/// A decoded image, row 0 at the top, as stored (sRGB not decoded).
#[derive(Debug, Clone)]
pub struct Image {
    /// Width in pixels, ≥ 1.
    pub width: u32,
    /// Height in pixels, ≥ 1.
    pub height: u32,
    /// `width × height` RGBA values.
    pub pixels: Vec<[u8; 4]>,
}

/// A `KHR_lights_punctual` light (or one given on the command line) in recentred world space.
#[derive(Debug, Clone)]
pub struct Light {
    /// Name of the light or its node, or empty.
    pub name: String,
    /// glTF node that carries it; `None` for a light from the command line.
    pub node: Option<usize>,
    /// Colour × intensity, linear: candela (W/sr) for point and spot, lux (W/m²) for directional.
    pub intensity: Vec3,
    /// The kind, with its geometry.
    pub kind: LightKind,
    /// Measured distribution of a point or spot light's intensity, multiplied with `intensity`.
    pub profile: Option<PlacedProfile>,
}

/// A [`Profile`] as one light wears it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedProfile {
    /// Index into [`Scene::profiles`].
    pub profile: usize,
    /// Rotates directions of the world into the profile's axes (and mirrors them, where the light's
    /// node does).
    pub from_world: Mat3,
}

/// A luminaire's intensity by direction: a goniometric diagram (IES LM-63).
///
/// In its own axes nadir, vertical angle 0, is −Y; the horizontal angle 0 is +X and grows towards
/// −Z: counter-clockwise seen from above, as LM-63's type C has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Vertical angles, degrees from nadir, ascending, at least two.
    pub vertical: Vec<f32>,
    /// Horizontal angles, degrees, ascending from 0 to 360 (symmetries undone).
    pub horizontal: Vec<f32>,
    /// `horizontal.len() × vertical.len()` factors, vertical fastest; the largest is 1 (or all are
    /// 0).
    pub values: Vec<f32>,
}

/// A latitude-longitude map of radiances, W/(m² sr) or nit: columns run from −X through −Z, +X (the
/// middle) and +Z back to −X (as three.js and Blender have it), rows from +Y down to −Y. Pixel (i,
/// j) of w × h has its centre at longitude a = 2π((i + ½)/w − ½) and polar angle t = π(j + ½)/h,
/// which is the direction (sin t cos a, cos t, sin t sin a).
#[derive(Debug, Clone, PartialEq)]
pub struct Environment {
    /// Name of the light, or empty.
    pub name: String,
    /// Width in pixels, ≥ 1.
    pub width: u32,
    /// Height in pixels, ≥ 1.
    pub height: u32,
    /// Row-major radiances, linear, ≥ 0.
    pub pixels: Vec<Vec3>,
}

/// Geometry of a punctual light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// Shines along `direction` (unit) from infinitely far.
    Directional {
        /// Direction of travel of the light.
        direction: Vec3,
        /// Angle between the middle and the rim of its disc, radians; 0 for parallel light. The
        /// sun's is 0.00465.
        angle: f32,
    },
    /// Shines in all directions.
    Point {
        /// Recentred world position.
        position: Vec3,
        /// glTF `range`, metres; the light's window ends there.
        range: Option<f32>,
        /// Radius of the sphere that shines, metres; 0 for a point (`extras.lumel.radius`).
        radius: f32,
    },
    /// Shines in a cone about `direction`.
    Spot {
        /// Recentred world position.
        position: Vec3,
        /// Unit axis, direction of travel.
        direction: Vec3,
        /// glTF `range`, metres.
        range: Option<f32>,
        /// Radius of the sphere that shines, metres; 0 for a point (`extras.lumel.radius`).
        radius: f32,
        /// Half-angle of full intensity, radians.
        inner: f32,
        /// Half-angle where it ends, radians.
        outer: f32,
    },
}

/// What ingest dropped, clamped or left out, by kind, for `inspect` and the report.
///
/// Keys are short stable identifiers (`"triangles.zero_area"`); values are how many. A `BTreeMap`
/// so that the order is the same in every run.
pub type Counts = BTreeMap<String, u64>;
