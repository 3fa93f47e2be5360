//! `level.lightmap.json`: each node's lightmap rectangle, for engines that drop glTF extras.

use mesh_ingest::Scene;
use serde::Serialize;

use atlas::{Layout, Placement, Rect};
use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::ktx2::Ktx2Format;
use crate::mixed::{ManifestLamp, MixedLight};
use crate::small::PngFormat;

/// Quantity in the R, G and B channels of a lightmap.
///
/// ```
/// use atlas_bake::ValueKind;
///
/// assert_eq!(ValueKind::Irradiance.scale_to_irradiance(), Some(1.0));
/// assert_eq!(ValueKind::Radiance.scale_to_irradiance(), Some(std::f64::consts::PI));
/// assert_eq!(ValueKind::Radiosity.scale_to_irradiance(), None);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ValueKind {
    /// R = E/π, the radiance of a white diffuse surface, which engines multiply by the albedo.
    #[default]
    Radiance,
    /// E.
    Irradiance,
    /// B = M_e + ρE.
    Radiosity,
}

impl ValueKind {
    /// Factor from the stored value to irradiance; `None` for radiosity, for which there is no such
    /// factor.
    pub fn scale_to_irradiance(self) -> Option<f64> {
        match self {
            ValueKind::Radiance => Some(std::f64::consts::PI),
            ValueKind::Irradiance => Some(1.0),
            ValueKind::Radiosity => None,
        }
    }
}

/// A lightmap rectangle as a UV transform: page uv = mesh uv × scale + offset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UvTransform {
    /// Top left corner of the rectangle, as a fraction of the page.
    pub offset: [f64; 2],
    /// Size of the rectangle, as a fraction of the page.
    pub scale: [f64; 2],
}

impl UvTransform {
    /// The whole page, for coordinates that are already those of the page.
    pub const PAGE: UvTransform = UvTransform {
        offset: [0.0; 2],
        scale: [1.0; 2],
    };

    /// The transform of `placement` on `layout`'s pages; `None` if there is no such page or it is
    /// empty.
    pub fn new(layout: &Layout, placement: &Placement) -> Option<UvTransform> {
        let [w, h] = layout.pages.get(placement.page as usize)?.map(f64::from);
        let r = placement.rect;
        (w > 0.0 && h > 0.0).then(|| UvTransform {
            offset: [f64::from(r.x) / w, f64::from(r.y) / h],
            scale: [f64::from(r.w) / w, f64::from(r.h) / h],
        })
    }
}

/// The manifest. The order of fields is that of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Manifest {
    /// Format version; raised when readers of the old version would misread the file.
    pub version: u32,
    /// Program and version.
    pub generator: String,
    /// The glTF file that has the lightmap coordinates, next to this file.
    pub scene: String,
    /// Quantity in the pages.
    pub value: ValueKind,
    /// Unit of the stored value: photometric or radiometric, depending on the scene's lights. glTF
    /// files do not say which.
    pub units: &'static str,
    /// Factor from the stored value to irradiance; null if there is none.
    pub scale_to_irradiance: Option<f64>,
    /// Suggested exposure ([`suggested_exposure`](crate::suggested_exposure)): the factor from
    /// radiance to a screen's values, 1 being white.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
    /// Always `linear Rec.709`.
    pub color_space: &'static str,
    /// Always `top-down`: row 0 is v = 0, as in glTF.
    pub row_order: &'static str,
    /// The `TEXCOORD_n` with lightmap coordinates.
    pub tex_coord: u32,
    /// Requested texels per metre.
    pub texels_per_unit: f32,
    /// One per page.
    pub pages: Vec<ManifestPage>,
    /// Channels of the pages in addition to R, G and B.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<String>,
    /// `indirect` or `shadowmask` if lamps are left out; absent for a full bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<&'static str>,
    /// Lamps whose direct light is not in the pages.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lamps: Vec<ManifestLamp>,
    /// Light groups with their own pages, which sum to `pages`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<ManifestGroup>,
    /// Reflection captures.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reflections: Vec<ManifestReflection>,
    /// One per instance that has a lightmap, in scene-graph order.
    pub nodes: Vec<ManifestNode>,
}

/// A page file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ManifestPage {
    /// File name, next to the manifest.
    pub uri: String,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Name of the page group, if it is in one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// The same page as KTX2, if that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ktx2: Option<ManifestKtx2>,
    /// The same page with 8 bits per channel, if that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub png: Option<ManifestPng>,
    /// Its shadow mask, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<ManifestMask>,
}

/// A page as PNG.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ManifestPng {
    /// File name, next to the manifest.
    pub uri: String,
    /// How light is stored.
    pub format: PngFormat,
    /// Factor of the decoding.
    pub scale: f32,
}

/// The shadow mask of a page.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ManifestMask {
    /// File name, next to the manifest: RGBA.
    pub uri: String,
    /// The same as KTX2 (RGBA, 8 bits), if that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ktx2: Option<String>,
}

/// A page as KTX2.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ManifestKtx2 {
    /// File name, next to the manifest.
    pub uri: String,
    /// Texel format.
    pub format: Ktx2Format,
}

/// A reflection capture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ManifestReflection {
    /// Index of the glTF node.
    pub node: usize,
    /// Its name, or empty.
    pub name: String,
    /// Its position in the glTF's world space, metres.
    pub position: [f64; 3],
    /// File name of the cube map, next to the manifest.
    pub uri: String,
}

/// A light group.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ManifestGroup {
    /// Its name.
    pub name: String,
    /// Page files with the same sizes and order as the scene's.
    pub pages: Vec<String>,
    /// The same pages as KTX2, if those were written.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ktx2: Vec<String>,
}

/// One instance.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ManifestNode {
    /// Index of the glTF node.
    pub node: usize,
    /// Its name, or empty.
    pub name: String,
    /// Index of the `EXT_mesh_gpu_instancing` copy of the node.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub copy: Option<u32>,
    /// Index of the glTF mesh.
    pub mesh: usize,
    /// Page index.
    pub page: u32,
    /// Rectangle in texels of the page.
    pub rect: Rect,
    /// Lamps in its shadow mask: indices into the manifest's `lamps`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lamps: Vec<usize>,
    /// The rectangle as a transform of `TEXCOORD_1`.
    #[serde(flatten)]
    pub uv: UvTransform,
    /// Index of its instance in the scene.
    #[serde(skip)]
    pub(crate) instance: usize,
}

impl Manifest {
    /// Describes a finished bake; `page_uris` are the names of the page files in order, `scene_uri`
    /// that of the glTF.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if `layout` and `page_uris` do not fit `scene`.
    pub fn new(
        scene: &Scene,
        layout: &Layout,
        scene_uri: &str,
        page_uris: &[String],
        value: ValueKind,
    ) -> Result<Manifest> {
        check(scene, layout, page_uris)?;
        let mut nodes = Vec::with_capacity(scene.instances.len());
        for (i, (instance, placement)) in scene.instances.iter().zip(&layout.placements).enumerate()
        {
            if !scene.has_lumels(i) {
                continue;
            }
            nodes.push(ManifestNode {
                node: instance.node,
                name: instance.name.clone(),
                copy: instance.copy,
                mesh: scene.meshes[instance.mesh].gltf_mesh,
                page: placement.page,
                rect: placement.rect,
                lamps: Vec::new(),
                uv: uv_of(layout, placement, i)?,
                instance: i,
            });
        }
        Ok(Manifest {
            version: 1,
            generator: concat!("lumel ", env!("CARGO_PKG_VERSION")).into(),
            scene: scene_uri.into(),
            value,
            units: match value {
                ValueKind::Radiance => "nit or W/(m2 sr)",
                ValueKind::Irradiance | ValueKind::Radiosity => "lx or W/m2",
            },
            scale_to_irradiance: value.scale_to_irradiance(),
            exposure: None,
            color_space: "linear Rec.709",
            row_order: "top-down",
            tex_coord: 1,
            texels_per_unit: layout.texels_per_unit,
            pages: layout
                .pages
                .iter()
                .zip(page_uris)
                .enumerate()
                .map(|(i, (&[width, height], uri))| ManifestPage {
                    group: (layout.page_groups.get(i).cloned()).filter(|g| !g.is_empty()),
                    uri: uri.clone(),
                    width,
                    height,
                    ktx2: None,
                    png: None,
                    mask: None,
                })
                .collect(),
            channels: Vec::new(),
            reflections: Vec::new(),
            mode: None,
            lamps: Vec::new(),
            groups: Vec::new(),
            nodes,
        })
    }

    /// Adds the pages' KTX2 files, in order.
    pub fn set_ktx2(&mut self, format: Ktx2Format, uris: &[String]) {
        for (page, uri) in self.pages.iter_mut().zip(uris) {
            let uri = uri.clone();
            page.ktx2 = Some(ManifestKtx2 { uri, format });
        }
    }

    /// Adds the pages' PNG files, in order.
    pub fn set_png(&mut self, format: PngFormat, scale: f32, uris: &[String]) {
        for (page, uri) in self.pages.iter_mut().zip(uris) {
            let uri = uri.clone();
            page.png = Some(ManifestPng { uri, format, scale });
        }
    }

    /// Adds lamps that are left out, and shadow masks.
    pub fn set_mixed(&mut self, mixed: &MixedLight) {
        self.mode = Some(mixed.mode);
        self.lamps.clone_from(&mixed.lamps);
        for (i, (page, uri)) in self.pages.iter_mut().zip(&mixed.masks).enumerate() {
            page.mask = Some(ManifestMask {
                uri: uri.clone(),
                ktx2: mixed.ktx2.get(i).cloned(),
            });
        }
        for node in &mut self.nodes {
            node.lamps = mixed.lamps_of(node.instance);
        }
    }

    /// Declares that the glTF's coordinates are already those of the page, as `MOZ_lightmap`
    /// requires (except for instanced copies).
    pub fn set_coordinates_on_page(&mut self) {
        for node in self.nodes.iter_mut().filter(|n| n.copy.is_none()) {
            node.uv = UvTransform::PAGE;
        }
    }

    /// The file's bytes: indented JSON with a final newline.
    pub fn to_json(&self) -> Vec<u8> {
        // Serialising plain structs to memory cannot fail: no map has non-string keys.
        let mut bytes = serde_json::to_vec_pretty(self).unwrap_or_default();
        bytes.push(b'\n');
        bytes
    }
}

/// A KTX2 page in a node's extras, like [`ManifestKtx2`].
pub(crate) fn ktx2_json(format: Ktx2Format, uri: &str) -> Value {
    json!({"uri": uri, "format": format})
}

/// Checks that the layout fits the scene: a mesh atlas per mesh, a placement per instance, a name
/// per page.
pub(crate) fn check(scene: &Scene, layout: &Layout, page_uris: &[String]) -> Result<()> {
    let lengths = [
        ("meshes", scene.meshes.len(), layout.meshes.len()),
        ("placements", scene.instances.len(), layout.placements.len()),
        ("page names", layout.pages.len(), page_uris.len()),
    ];
    for (what, expected, got) in lengths {
        if expected != got {
            return Err(Error::Inconsistent {
                at: format!("layout {what}"),
                message: format!("expected {expected}, got {got}"),
            });
        }
    }
    match scene
        .instances
        .iter()
        .position(|i| i.mesh >= scene.meshes.len())
    {
        Some(i) => Err(Error::Inconsistent {
            at: format!("instance {i}"),
            message: "its mesh does not exist".into(),
        }),
        None => Ok(()),
    }
}

/// [`UvTransform::new`] with an error that names the instance.
pub(crate) fn uv_of(
    layout: &Layout,
    placement: &Placement,
    instance: usize,
) -> Result<UvTransform> {
    UvTransform::new(layout, placement).ok_or_else(|| Error::Inconsistent {
        at: format!("placement of instance {instance}"),
        message: format!("page {} is missing or empty", placement.page),
    })
}

#[cfg(test)]
mod tests {
    use mesh_ingest::{Instance, Material, Mesh, Primitive};

    use super::*;
    use atlas::MeshAtlas;

    fn scene() -> (Scene, Layout) {
        let instance = |node, copy| Instance {
            node,
            name: format!("n{node}"),
            copy,
            mesh: 0,
            transform: glam::DAffine3::IDENTITY,
            occluder: false,
            density: 1.0,
            stands_in: None,
            extras: None,
        };
        let scene = Scene {
            meshes: vec![Mesh {
                gltf_mesh: 4,
                primitives: vec![Primitive::default()],
                ..Mesh::default()
            }],
            materials: vec![Material::default()],
            instances: vec![instance(2, None), instance(7, Some(1))],
            ..Scene::default()
        };
        let place = |page, x| Placement {
            page,
            rect: Rect {
                x,
                y: 8,
                w: 16,
                h: 4,
            },
        };
        let layout = Layout {
            meshes: vec![MeshAtlas {
                size: [16, 4],
                ..MeshAtlas::default()
            }],
            placements: vec![place(0, 0), place(1, 32)],
            pages: vec![[64, 32], [128, 16]],
            texels_per_unit: 2.5,
            page_groups: vec![String::new(), "room".into()],
        };
        (scene, layout)
    }

    #[test]
    fn every_instance_is_listed_with_its_rectangle() {
        let (scene, layout) = scene();
        let uris = ["a.lightmap.exr".to_string(), "a.lightmap.1.exr".to_string()];
        let m = Manifest::new(&scene, &layout, "a.glb", &uris, ValueKind::Radiance).unwrap();
        let json: Value = serde_json::from_slice(&m.to_json()).unwrap();
        assert_eq!(json["scaleToIrradiance"], std::f64::consts::PI);
        assert_eq!(json["value"], "radiance");
        assert_eq!(
            json["pages"][1],
            serde_json::json!({"uri": "a.lightmap.1.exr", "width": 128, "height": 16, "group": "room"})
        );
        assert!(json["pages"][0].get("group").is_none());
        let n = &json["nodes"][1];
        assert_eq!(
            (&n["node"], &n["copy"], &n["mesh"], &n["page"]),
            (&7.into(), &1.into(), &4.into(), &1.into())
        );
        assert_eq!(
            n["rect"],
            serde_json::json!({"x": 32, "y": 8, "w": 16, "h": 4})
        );
        assert_eq!(
            (n["offset"].clone(), n["scale"].clone()),
            (
                serde_json::json!([0.25, 0.5]),
                serde_json::json!([0.125, 0.25])
            )
        );
        assert!(json["nodes"][0].get("copy").is_none());
    }

    #[test]
    fn plans_that_do_not_fit_are_errors() {
        let (scene, layout) = scene();
        let one = ["a.exr".to_string()];
        assert!(Manifest::new(&scene, &layout, "a.glb", &one, ValueKind::Radiance).is_err());
        let two = ["a.exr".to_string(), "b.exr".to_string()];
        let mut far = layout.clone();
        far.placements[1].page = 2;
        assert!(Manifest::new(&scene, &far, "a.glb", &two, ValueKind::Radiance).is_err());
    }
}
