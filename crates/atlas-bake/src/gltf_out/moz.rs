//! `MOZ_lightmap`: lightmaps referenced by materials, for loaders that support the extension (Hubs,
//! and three.js with a plug-in).
//!
//! The extension stores a texture, its coordinate set and an intensity on a *material*, but a
//! lightmap's rectangle belongs to a *node*. So each lit node gets its own mesh, whose `TEXCOORD_1`
//! is already in page coordinates (Hubs ignores `KHR_texture_transform` in the extension), and each
//! material gets a copy for each page that it appears on. Positions, normals and indices stay
//! shared: the copies are JSON, and the added data is 8 bytes per vertex and node.
//!
//! glTF has no images with more than 8 bits per channel, so each page is stored twice: as PNG, and
//! as Radiance RGBE with `MOZ_texture_rgbe` for loaders that support it. Both are divided by the
//! page's largest value, and the intensity is multiplied by it.
//!
//! Based on: Hubs, pull request 2375 "Add support for MOZ_lightmap"; three.js, "Light maps contain
//! linear irradiance".

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

use serde_json::{Map, Value, json};

use super::editor::Editor;
use super::json::{element, element_mut, index, object_at, push};
use super::texcoord::{self, material_slots};
use crate::error::{Error, Result};
use crate::exr_io::HALF_MAX;
use crate::false_color::encode_png;
use crate::manifest::UvTransform;
use crate::page::Page;

/// The extensions' names.
const LIGHTMAP: &str = "MOZ_lightmap";
const RGBE: &str = "MOZ_texture_rgbe";

/// glTF's constants for LINEAR and CLAMP_TO_EDGE: chart padding is too small for mipmaps and for
/// wrapping.
const SAMPLER: (u32, u32) = (9729, 33071);

/// Coordinates to be replaced by [`apply`], by mesh and primitive of the JSON.
pub(super) type Coordinates = BTreeMap<(usize, usize), Vec<[f32; 2]>>;

/// A node with a lightmap.
pub(super) struct Lit {
    pub node: usize,
    /// Its mesh in the JSON before the mesh is copied.
    pub mesh: usize,
    pub page: usize,
    pub uv: UvTransform,
}

/// Number of copies that [`apply`] made.
#[derive(Default)]
pub(super) struct Copied {
    pub meshes: u64,
    pub materials: u64,
}

/// Adds the lightmaps of `lit` nodes to their materials. `scale` converts stored values to
/// irradiance.
pub(super) fn apply(
    editor: &mut Editor<'_>,
    lit: &[Lit],
    coordinates: &Coordinates,
    pages: &[Page],
    scale: f64,
) -> Result<Copied> {
    let mut copied = Copied::default();
    if lit.is_empty() {
        return Ok(copied);
    }
    let textures = (pages.iter().enumerate())
        .map(|(i, page)| add_texture(editor, page, i, scale))
        .collect::<Result<Vec<_>>>()?;
    let mut shared = other_users(&editor.json, lit);
    let mut materials = BTreeMap::new();
    for node in lit {
        // The last lit node of a mesh may use the original, if no other node shows it.
        let users = shared.entry(node.mesh).or_insert(0);
        let mesh = if *users == 1 {
            node.mesh
        } else {
            *users = users.saturating_sub(1);
            let copy = element(&editor.json, "meshes", node.mesh).cloned();
            let copy = copy.ok_or_else(|| missing(format!("meshes[{}]", node.mesh)))?;
            copied.meshes += 1;
            push(&mut editor.json, "meshes", Value::Object(copy))
        };
        for ((_, p), uv) in coordinates.range((node.mesh, 0)..(node.mesh + 1, 0)) {
            let place = |[u, v]: [f32; 2]| {
                let [x, y] =
                    [0, 1].map(|i| node.uv.offset[i] + node.uv.scale[i] * [u, v][i] as f64);
                [x as f32, y as f32]
            };
            let placed: Vec<[f32; 2]> = uv.iter().map(|uv| place(*uv)).collect();
            let accessor = editor.add_floats(&placed);
            let mut own = element(&editor.json, "meshes", mesh)
                .and_then(|m| element(m, "primitives", *p))
                .cloned()
                .ok_or_else(|| missing(format!("meshes[{mesh}].primitives[{p}]")))?;
            let attributes = object_at(&mut own, "attributes");
            attributes.insert("TEXCOORD_1".into(), accessor.into());
            own.entry("material").or_insert(Value::Null);
            material_slots(&mut own, &mut |slot| {
                let from = slot.as_u64().map(|m| m as usize);
                let to = *materials.entry((from, node.page)).or_insert_with(|| {
                    copied.materials += 1;
                    copy_material(&mut editor.json, from, &textures[node.page])
                });
                *slot = to.into();
            });
            if let Some(slot) = element_mut(&mut editor.json, "meshes", mesh)
                .and_then(|m| element_mut(m, "primitives", *p))
            {
                *slot = own;
            }
        }
        if let Some(object) = element_mut(&mut editor.json, "nodes", node.node) {
            object.insert("mesh".into(), mesh.into());
        }
    }
    Ok(copied)
}

/// Number of copies of each mesh: its lit nodes, plus one if other nodes show it too.
fn other_users(json: &Map<String, Value>, lit: &[Lit]) -> BTreeMap<usize, usize> {
    let ours: BTreeSet<usize> = lit.iter().map(|l| l.node).collect();
    let mut users = BTreeMap::new();
    for l in lit {
        *users.entry(l.mesh).or_insert(0) += 1;
    }
    let nodes = json.get("nodes").and_then(Value::as_array);
    let mut others = BTreeSet::new();
    for (i, node) in nodes.into_iter().flatten().enumerate() {
        let mesh = node.as_object().and_then(|n| index(n, "mesh"));
        others.extend(mesh.filter(|_| !ours.contains(&i)));
    }
    for mesh in others {
        users.entry(mesh).and_modify(|n| *n += 1);
    }
    users
}

/// A page as materials reference it.
struct Texture {
    index: usize,
    intensity: f64,
}

fn add_texture(editor: &mut Editor<'_>, page: &Page, i: usize, scale: f64) -> Result<Texture> {
    let picture = Picture::new(page)?;
    let mut image = |bytes: Vec<u8>, mime: &str| {
        let view = editor.add_picture(bytes);
        let name = format!("lightmap {i}");
        let image = json!({"name": name, "bufferView": view, "mimeType": mime});
        push(&mut editor.json, "images", image)
    };
    let png = image(picture.png, "image/png");
    let rgbe = image(picture.rgbe, "image/vnd.radiance");
    let (filter, wrap) = SAMPLER;
    let sampler = json!({"magFilter": filter, "minFilter": filter, "wrapS": wrap, "wrapT": wrap});
    let sampler = push(&mut editor.json, "samplers", sampler);
    let texture =
        json!({"sampler": sampler, "source": png, "extensions": {RGBE: {"source": rgbe}}});
    Ok(Texture {
        index: push(&mut editor.json, "textures", texture),
        intensity: scale * f64::from(picture.largest),
    })
}

/// A copy of material `from` (or of the default material) with the lightmap.
fn copy_material(json: &mut Map<String, Value>, from: Option<usize>, page: &Texture) -> usize {
    let from = from.and_then(|m| element(json, "materials", m).cloned());
    let mut own = from.unwrap_or_default();
    let extension = json!({
        "index": page.index, "texCoord": texcoord::LIGHTMAP_SET, "intensity": page.intensity,
    });
    object_at(&mut own, "extensions").insert(LIGHTMAP.into(), extension);
    push(json, "materials", Value::Object(own))
}

fn missing(at: String) -> Error {
    Error::Inconsistent {
        at,
        message: "not in the document".into(),
    }
}

/// A page divided by its largest value, as image files.
pub(super) struct Picture {
    pub png: Vec<u8>,
    pub rgbe: Vec<u8>,
    pub largest: f32,
}

impl Picture {
    pub(super) fn new(page: &Page) -> Result<Picture> {
        // As in the EXR, light is finite and not negative.
        let storable = |x: f32| {
            if x.is_finite() {
                x.clamp(0.0, HALF_MAX)
            } else {
                0.0
            }
        };
        let values: Vec<[f32; 3]> = page.value.iter().map(|v| v.map(storable)).collect();
        let largest = values.as_flattened().iter().copied().fold(0.0, f32::max);
        let largest = if largest > 0.0 { largest } else { 1.0 };
        let share = |x: f32| x / largest;
        let bytes: Vec<[u8; 3]> = values
            .iter()
            .map(|v| v.map(|x| (255.0 * share(x)).round() as u8))
            .collect();
        let floats: Vec<image::Rgb<f32>> = values
            .iter()
            .map(|v| image::Rgb(rgbe_exact(v.map(share))))
            .collect();
        let mut rgbe = Vec::new();
        image::codecs::hdr::HdrEncoder::new(Cursor::new(&mut rgbe))
            .encode(&floats, page.width as usize, page.height as usize)
            .map_err(|e| Error::Image {
                what: "lightmap as RGBE".into(),
                message: e.to_string(),
            })?;
        Ok(Picture {
            png: encode_png(page.width, page.height, &bytes)?,
            rgbe,
            largest,
        })
    }
}

/// A value whose encoded RGBE bytes three.js reads as the nearest to `v`: three.js decodes m / 255
/// × 2^e, but the encoder truncates m / 256 × 2^e.
fn rgbe_exact(v: [f32; 3]) -> [f32; 3] {
    let largest = v[0].max(v[1]).max(v[2]);
    // Below this the exponent byte underflows.
    if largest < 1e-30 {
        return [0.0; 3];
    }
    // 2^e ≤ largest < 2^(e + 1), and 255/255 is 2^e itself, which the page's largest value needs.
    let mut e = ((largest.to_bits() >> 23) & 255) as i32 - 127;
    let byte = |x: f32, e: i32| (f64::from(x) * 255.0 / libm::exp2(f64::from(e))).round();
    if byte(largest, e) > 255.0 {
        e += 1;
    }
    v.map(|x| ((byte(x, e) + 0.5) / 256.0 * libm::exp2(f64::from(e))) as f32)
}
