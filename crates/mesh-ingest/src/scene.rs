//! The normal form of glTF documents.
//!
//! The rest of Lumel never sees glTF. It sees meshes of clean indexed triangles, instances that
//! place them, materials in linear light, and lights in world space. [`Scene`] lists the
//! guarantees.

use std::collections::BTreeMap;

use glam::{Affine2, DAffine3, DVec3, Mat3, Vec2, Vec3, Vec4};

/// A level in normal form.
///
/// Guarantees of [`crate::load`] that the whole pipeline relies on:
/// - every number is finite; every index (vertex, material, image, mesh) is in range;
/// - no triangle of a [`Primitive`] repeats a vertex, has zero area in local space, or has the same
///   vertices as another (with the same facing, or any facing if its material is double-sided);
/// - instances refer to meshes with at least one triangle, and their transforms are invertible;
/// - colours are linear Rec.709; reflectances are in 0..=1; emission is a radiance and ≥ 0.
///
/// World space is that of the glTF (right-handed, Y up, metres), translated by
/// −[`origin`](Scene::origin) so that `f32` is precise around the scene's centre.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Unique geometry, in the order of the document's `meshes`; unused meshes have no entry. Code
    /// that gives instances of one mesh separate geometry appends copies that refer to the same
    /// mesh of the document.
    pub meshes: Vec<Mesh>,
    /// Placed meshes that receive and cast light, in scene-graph order (depth first).
    pub instances: Vec<Instance>,
    /// The document's materials in order, then the glTF default material.
    pub materials: Vec<Material>,
    /// Decoded images that materials refer to; `None` if light does not need the image.
    pub images: Vec<Option<Image>>,
    /// Punctual lights in recentred world space.
    pub lights: Vec<Light>,
    /// Intensity distributions that lights refer to (`EXT_lights_ies`).
    pub profiles: Vec<Profile>,
    /// Pictures that lights refer to (`extras.lumel.cookie`).
    pub cookies: Vec<Image>,
    /// Light from the surroundings (`EXT_lights_image_based`).
    pub environment: Option<Environment>,
    /// World position (metres, glTF axes) of the recentred origin.
    pub origin: DVec3,
    /// For each group of levels of detail or variants, its instances that rays see, ascending; see
    /// [`Instance::stands_in`].
    pub firsts: Vec<Vec<usize>>,
    /// Page groups: the name of each node's group, for nodes that are in one
    /// (`extras.lumel.page` of the node or the nearest ancestor that has it). Instances of
    /// different groups share no page of the lightmap.
    pub page_groups: BTreeMap<usize, String>,
    /// Who computes the direct light of lamps, by node; lamps of other nodes are baked
    /// (`extras.lumel.mode` of the node or the light).
    pub lamp_modes: BTreeMap<usize, LampMode>,
    /// Volumes where players walk (`extras.lumel.walkable`): each maps the cube from −1 to 1 to
    /// recentred world space.
    pub walkable: Vec<DAffine3>,
    /// Positions of the document's cameras, recentred.
    pub cameras: Vec<Vec3>,
    /// Where reflections are captured (`extras.lumel.reflection`).
    pub reflections: Vec<ReflectionPoint>,
    /// By mesh, primitive and triangle: whether nobody sees it, so that it needs no lumels. Empty
    /// if nothing is culled.
    pub unseen: Vec<Vec<Vec<bool>>>,
}

impl Scene {
    /// The page group of instance `instance`.
    pub fn page_group(&self, instance: usize) -> Option<&str> {
        let node = self.instances[instance].node;
        self.page_groups.get(&node).map(String::as_str)
    }

    /// Whether primitive `primitive` of instance `instance` receives light, i.e. neither the node
    /// nor the material is an occluder, and it is not the surface of an area light.
    pub fn receives(&self, instance: usize, primitive: usize) -> bool {
        let instance = &self.instances[instance];
        let mesh = &self.meshes[instance.mesh];
        let worn = mesh.primitives[primitive].material;
        let of_a_light = mesh.gltf_mesh == Mesh::NOT_IN_DOCUMENT;
        !instance.occluder && !of_a_light && !self.materials[worn].occluder_only
    }

    /// Whether any primitive of instance `instance` receives light.
    pub fn has_lightmap(&self, instance: usize) -> bool {
        let primitives = &self.meshes[self.instances[instance].mesh].primitives;
        (0..primitives.len()).any(|p| self.receives(instance, p))
    }

    /// Whether instance `instance` has a place in the lightmap: it receives light and its density
    /// is not 0.
    pub fn has_lumels(&self, instance: usize) -> bool {
        self.instances[instance].density > 0.0 && self.has_lightmap(instance)
    }

    /// Whether any primitive uses each material.
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
    /// Index into the document's `meshes`, or [`Mesh::NOT_IN_DOCUMENT`].
    pub gltf_mesh: usize,
    /// The document's name, or empty.
    pub name: String,
    /// Triangle primitives with at least one valid triangle, without points and lines.
    pub primitives: Vec<Primitive>,
}

impl Mesh {
    /// [`gltf_mesh`](Self::gltf_mesh) of an area light's surface. It receives no light,
    /// and writers leave it out.
    pub const NOT_IN_DOCUMENT: usize = usize::MAX;
}

/// One glTF primitive: vertices as in the document, triangles cleaned.
#[derive(Debug, Clone, Default)]
pub struct Primitive {
    /// Index into the document's `meshes[gltf_mesh].primitives`.
    pub gltf_primitive: usize,
    /// Vertex positions, local space, one per vertex of the document's accessor (vertex *i* is
    /// accessor element *i*).
    pub positions: Vec<Vec3>,
    /// Unit vertex normals, with unusable ones replaced by the adjacent faces'; empty if the
    /// document has none (flat shading).
    pub normals: Vec<Vec3>,
    /// `TEXCOORD_n` by n; an inner vector is empty if the set is absent.
    pub tex_coords: Vec<Vec<Vec2>>,
    /// `COLOR_0`, linear RGBA, or empty.
    pub colors: Vec<Vec4>,
    /// Triangles as vertex indices, counter-clockwise seen from the front in local space.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, its index in the document's primitive (with strips and fans unrolled).
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
    /// Index of the node's `EXT_mesh_gpu_instancing` copy, if it has any.
    pub copy: Option<u32>,
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// Local to world (before recentring); may mirror.
    pub transform: DAffine3,
    /// Blocks light without reflecting or emitting any, and gets no lightmap
    /// (`extras.lumel.occluder` of the node or an ancestor).
    pub occluder: bool,
    /// Factor on the scene's lumels per metre, 0..=1000. With 0 it gets no lightmap but still
    /// affects the light (`extras.lumel.density` of the node or the nearest ancestor that has it,
    /// else 1).
    pub density: f32,
    /// Set for a coarser level of detail or another variant: index into [`Scene::firsts`] of the
    /// instances that it stands in for. It neither shadows, reflects nor emits, and copies the
    /// light of their nearest surface.
    pub stands_in: Option<usize>,
    /// `{"lumel": …}` from the node's `extras`, without other members.
    pub extras: Option<serde_json::Value>,
}

/// Optical properties of a surface. Every surface is Lambertian; metalness and roughness are
/// ignored.
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
    /// `emissiveFactor` × `emissiveStrength`: radiance in W/(m² sr), or nit if the scene is
    /// photometric.
    pub emissive: Vec3,
    /// `emissiveTexture` (sRGB), multiplied by `emissive`.
    pub emissive_texture: Option<TextureRef>,
    /// How alpha is used; opaque if no alpha value lets light through, whatever the document says.
    pub alpha: AlphaMode,
    /// Both sides reflect and emit; otherwise the back blocks light without reflecting or emitting
    /// any.
    pub double_sided: bool,
    /// `KHR_materials_transmission`: the fraction of light that passes straight through, tinted by
    /// the base colour, instead of being reflected diffusely; 0..=1.
    pub transmission: f32,
    /// `transmissionTexture` (red channel, linear), multiplied by `transmission`.
    pub transmission_texture: Option<TextureRef>,
    /// Upper limit of reflectance in each channel, 0..=1.
    pub max_reflectance: f32,
    /// Blocks light without reflecting or emitting any, and gets no lightmap
    /// (`extras.lumel.occluder`).
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
    /// Whether light can pass straight through parts of it, so that rays must check each hit.
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

/// Texture reference: an image and how to sample it.
#[derive(Debug, Clone)]
pub struct TextureRef {
    /// Index into [`Scene::images`].
    pub image: usize,
    /// Index of the `TEXCOORD_n` (after `KHR_texture_transform`'s override).
    pub tex_coord: usize,
    /// `KHR_texture_transform`; identity if absent.
    pub transform: Affine2,
    /// Wrapping in s and t.
    pub wrap: [Wrap; 2],
    /// Nearest instead of bilinear magnification.
    pub nearest: bool,
}

/// glTF sampler wrapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// Coordinates beyond the edge are clamped to it.
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

/// A `KHR_lights_punctual` light (or one from the command line) in recentred world space.
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
    /// Measured distribution of a point or spot light, multiplied by `intensity`.
    pub profile: Option<PlacedProfile>,
    /// Picture that a spot or a sun projects, multiplied by `intensity`.
    pub cookie: Option<PlacedCookie>,
}

/// A place where reflections are captured.
#[derive(Debug, Clone, PartialEq)]
pub struct ReflectionPoint {
    /// glTF node.
    pub node: usize,
    /// Its name, or empty.
    pub name: String,
    /// Recentred world position.
    pub position: Vec3,
}

/// Who computes a lamp's direct light: the bake or the engine. Light that surfaces reflect is always
/// baked.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LampMode {
    /// The bake.
    #[default]
    Baked,
    /// The engine, with baked shadows.
    Mixed,
    /// The engine, with shadows of its own.
    Realtime,
}

/// A [`Profile`] attached to a light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedProfile {
    /// Index into [`Scene::profiles`].
    pub profile: usize,
    /// Rotates world directions into the profile's axes (and mirrors them if the light's node
    /// does).
    pub from_world: Mat3,
}

/// A picture attached to a light. With q = `from_world` × (point − `position`), a spot shows the
/// point at (½, ½) + (q.x, −q.y) / −q.z × `scale` of the picture and a sun at (½, ½) + (q.x, −q.y) ×
/// `scale`, repeated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedCookie {
    /// Index into [`Scene::cookies`].
    pub cookie: usize,
    /// Rotates world directions into the light's axes (and mirrors them if its node does).
    pub from_world: Mat3,
    /// The node's recentred world position.
    pub position: Vec3,
    /// Width and height of the picture per unit of q.
    pub scale: Vec2,
}

/// A luminaire's intensity by direction: a goniometric diagram (IES LM-63).
///
/// In its own axes nadir, vertical angle 0, is −Y; horizontal angle 0 is +X and increases towards
/// −Z, counter-clockwise seen from above, as in LM-63 type C.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Vertical angles, degrees from nadir, ascending, at least two.
    pub vertical: Vec<f32>,
    /// Horizontal angles, degrees, ascending from 0 to 360 (symmetries expanded).
    pub horizontal: Vec<f32>,
    /// `horizontal.len() × vertical.len()` factors, vertical angle fastest; the largest is 1 (or
    /// all are 0).
    pub values: Vec<f32>,
}

/// A latitude-longitude map of radiances, W/(m² sr) or nit. Columns run from −X through −Z, +X (the
/// middle) and +Z back to −X (as in three.js and Blender), rows from +Y down to −Y. Pixel (i, j) of
/// w × h has its centre at longitude a = 2π((i + ½)/w − ½) and polar angle t = π(j + ½)/h, which is
/// the direction (sin t cos a, cos t, sin t sin a).
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
    /// Shines along `direction` (unit) from infinity.
    Directional {
        /// Direction in which the light travels.
        direction: Vec3,
        /// Angular radius of its disc, radians; 0 for parallel light. The sun's is 0.00465.
        angle: f32,
    },
    /// Shines in all directions.
    Point {
        /// Recentred world position.
        position: Vec3,
        /// glTF `range`, metres, where the light ends.
        range: Option<f32>,
        /// Radius of the emitting sphere, metres; 0 for a point (`extras.lumel.radius`).
        radius: f32,
    },
    /// Shines in a cone around `direction`.
    Spot {
        /// Recentred world position.
        position: Vec3,
        /// Unit axis, in the direction in which the light travels.
        direction: Vec3,
        /// glTF `range`, metres, where the light ends.
        range: Option<f32>,
        /// Radius of the emitting sphere, metres; 0 for a point (`extras.lumel.radius`).
        radius: f32,
        /// Half-angle of the cone of full intensity, radians.
        inner: f32,
        /// Half-angle at which the intensity becomes 0, radians.
        outer: f32,
    },
}

/// What ingest dropped, clamped or left out, by kind, for `inspect` and the report.
///
/// Keys are short stable identifiers (`"triangles.zero_area"`), values are numbers. A `BTreeMap`
/// keeps the order the same in every run.
pub type Counts = BTreeMap<String, u64>;
