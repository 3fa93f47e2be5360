//! `extras.lumel`: instructions from an asset's author to the baker.
//!
//! Extras may contain anything, so they never make a document invalid: an unusable value or an
//! unknown key is ignored with a warning.

use serde_json::Value;

use crate::document::Document;
use crate::json::{Item, show};
use crate::report::IngestReport;

/// Keys of nodes; those of [`crate::lights`] apply to the node's light.
const NODE_KEYS: &[&str] = &[
    "angle",
    "bake",
    "cookie",
    "cookieSize",
    "density",
    "exclude",
    "ies",
    "lod",
    "mode",
    "occluder",
    "page",
    "radius",
    "reflection",
    "variant",
    "walkable",
];

/// Keys of materials.
const MATERIAL_KEYS: &[&str] = &["emitScale", "exclude", "maxReflectance", "occluder"];

/// Keys of the scene and of the whole document: those of materials, and those that apply to all
/// nodes.
const DOCUMENT_KEYS: &[&str] = &[
    "density",
    "emitScale",
    "exclude",
    "maxReflectance",
    "occluder",
];

/// Largest factor of `density`: from one lumel per metre to one per millimetre.
const MOST_DENSITY: f64 = 1000.0;

/// The `extras.lumel` object of `item`, if any.
fn lumel_of<'a>(item: &Item<'a>, report: &mut IngestReport) -> Option<Item<'a>> {
    // Extras may be of any type; other types are ignored.
    let extras = item.get("extras").filter(|extras| extras.value.is_object());
    let lumel = extras?.get("lumel")?;
    if lumel.value.is_object() {
        return Some(lumel);
    }
    ignore(&lumel, "an object", report);
    None
}

fn ignore(item: &Item<'_>, expected: &str, report: &mut IngestReport) {
    report.count("extras.ignored", 1);
    report.warn(
        &item.path,
        format!("found {}, expected {expected}; ignored", show(item.value)),
    );
}

fn warn_unknown(lumel: &Item<'_>, known: &[&str], report: &mut IngestReport) {
    let members = lumel.value.as_object().into_iter().flatten();
    for (key, _) in members.filter(|(key, _)| !known.contains(&key.as_str())) {
        report.count("extras.unknown_keys", 1);
        report.warn(
            lumel.path_of(key),
            format!("unknown key; known keys are {}", known.join(", ")),
        );
    }
}

/// The value of `key` as parsed by `read`.
fn value<T>(
    lumel: &Item<'_>,
    key: &str,
    expected: &str,
    report: &mut IngestReport,
    read: impl Fn(&Value) -> Option<T>,
) -> Option<T> {
    let item = lumel.get(key)?;
    let value = read(item.value);
    if value.is_none() {
        ignore(&item, expected, report);
    }
    value
}

fn flag(lumel: &Item<'_>, key: &str, report: &mut IngestReport) -> Option<bool> {
    value(lumel, key, "true or false", report, Value::as_bool)
}

/// A number from 0 to `most`.
fn number(
    lumel: &Item<'_>,
    key: &str,
    most: f64,
    expected: &str,
    report: &mut IngestReport,
) -> Option<f64> {
    value(lumel, key, expected, report, |v| {
        v.as_f64().filter(|x| (0.0..=most).contains(x))
    })
}

/// Factor on the scene's density.
fn density(lumel: &Item<'_>, report: &mut IngestReport) -> Option<f64> {
    let expected = "a number from 0 to 1000";
    number(lumel, "density", MOST_DENSITY, expected, report)
}

/// A node's group and number among levels of detail or variants.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GroupMember {
    pub group: String,
    pub number: u32,
}

/// `{"group": …, number: …}`.
fn place(
    lumel: &Item<'_>,
    key: &str,
    number: &str,
    report: &mut IngestReport,
) -> Option<GroupMember> {
    let expected = format!("{{\"group\": a name, \"{number}\": a whole number from 0 to 999}}");
    value(lumel, key, &expected, report, |v| {
        Some(GroupMember {
            group: v.get("group")?.as_str()?.to_string(),
            // Blender writes whole numbers of custom properties as they are, some exporters as 1.0.
            number: v
                .get(number)?
                .as_f64()
                .filter(|n| (0.0..1000.0).contains(n) && n.fract() == 0.0)?
                as u32,
        })
    })
}

/// Longest name of a page group, characters: names are for people.
const PAGE_NAME: usize = 64;

/// Name of a page group.
fn page(lumel: &Item<'_>, report: &mut IngestReport) -> Option<String> {
    let expected = "a name of 1 to 64 characters";
    value(lumel, "page", expected, report, |v| {
        let name = v.as_str()?;
        (1..=PAGE_NAME)
            .contains(&name.chars().count())
            .then(|| name.to_string())
    })
}

/// A node's extras; `None` if a key is absent.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct NodeExtras {
    /// Bake the node although it is animated, skinned or morphed.
    pub bake: Option<bool>,
    /// Leave out the node and its children.
    pub exclude: Option<bool>,
    /// The node and its children only cast shadows.
    pub occluder: Option<bool>,
    /// Factor on the scene's lumels per metre for the node and its children, ≥ 0.
    pub density: Option<f64>,
    /// The level of detail of the node and its children.
    pub lod: Option<GroupMember>,
    /// The variant of the node and its children.
    pub variant: Option<GroupMember>,
    /// Name of the page group of the node and its children.
    pub page: Option<String>,
    /// A reflection capture at the node's position.
    pub reflection: Option<bool>,
    /// The node is a volume where players walk, and is not part of the level.
    pub walkable: Option<bool>,
}

impl NodeExtras {
    pub fn read(node: &Item<'_>, report: &mut IngestReport) -> NodeExtras {
        let Some(lumel) = lumel_of(node, report) else {
            return NodeExtras::default();
        };
        warn_unknown(&lumel, NODE_KEYS, report);
        NodeExtras {
            bake: flag(&lumel, "bake", report),
            exclude: flag(&lumel, "exclude", report),
            occluder: flag(&lumel, "occluder", report),
            density: density(&lumel, report),
            lod: place(&lumel, "lod", "level", report),
            variant: place(&lumel, "variant", "index", report),
            page: page(&lumel, report),
            reflection: flag(&lumel, "reflection", report),
            walkable: flag(&lumel, "walkable", report),
        }
    }
}

/// Extras about materials; `None` if a key is absent.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct SurfaceExtras {
    /// Leave out its primitives.
    pub exclude: Option<bool>,
    /// The material only casts shadows.
    pub occluder: Option<bool>,
    /// Factor on emitted radiance, ≥ 0.
    pub emit_scale: Option<f64>,
    /// Upper limit of reflectance, 0..=1.
    pub max_reflectance: Option<f32>,
}

impl SurfaceExtras {
    /// Reads the extras of a material.
    pub fn read(item: &Item<'_>, report: &mut IngestReport) -> SurfaceExtras {
        Self::read_known(item, MATERIAL_KEYS, report)
    }

    /// Reads the extras of a material, of a scene or of the document's root.
    fn read_known(item: &Item<'_>, known: &[&str], report: &mut IngestReport) -> SurfaceExtras {
        let Some(lumel) = lumel_of(item, report) else {
            return SurfaceExtras::default();
        };
        warn_unknown(&lumel, known, report);
        let most = f64::from(f32::MAX);
        let emit_scale = number(&lumel, "emitScale", most, "a number of at least 0", report);
        let limit = number(
            &lumel,
            "maxReflectance",
            1.0,
            "a number from 0 to 1",
            report,
        );
        SurfaceExtras {
            exclude: flag(&lumel, "exclude", report),
            occluder: flag(&lumel, "occluder", report),
            emit_scale,
            max_reflectance: limit.map(|x| x as f32),
        }
    }

    /// Extras for all materials of the chosen scene; the scene overrides the root.
    pub fn of_document(
        document: &Document,
        scene: Option<usize>,
        report: &mut IngestReport,
    ) -> SurfaceExtras {
        let root = document.root();
        let all = SurfaceExtras::read_known(&root, DOCUMENT_KEYS, report);
        let scene = scene.and_then(|scene| root.element("scenes", scene).ok());
        match scene {
            Some(scene) => SurfaceExtras::read_known(&scene, DOCUMENT_KEYS, report).or(all),
            None => all,
        }
    }

    /// These extras, with absent keys taken from `other`.
    pub fn or(self, other: SurfaceExtras) -> SurfaceExtras {
        SurfaceExtras {
            exclude: self.exclude.or(other.exclude),
            occluder: self.occluder.or(other.occluder),
            emit_scale: self.emit_scale.or(other.emit_scale),
            max_reflectance: self.max_reflectance.or(other.max_reflectance),
        }
    }
}

/// Density of nodes without their own; the scene overrides the root.
pub(crate) fn density_of_all(
    root: &Item<'_>,
    scene: Option<usize>,
    report: &mut IngestReport,
) -> Option<f64> {
    let scene = scene.and_then(|scene| root.element("scenes", scene).ok());
    let items = scene.iter().chain(std::iter::once(root));
    let mut words = items.filter_map(|item| {
        // Other faults here are reported elsewhere.
        let lumel = item.get("extras")?.get("lumel")?;
        density(&lumel, report)
    });
    words.next()
}

/// Warns about `extras.lumel` at places where it is ignored: exporters write a mesh's custom
/// properties on the mesh, not on its node.
pub(crate) fn warn_misplaced(document: &Document, report: &mut IngestReport) {
    let root = document.root();
    let meshes = root.elements("meshes").unwrap_or_default();
    for mesh in &meshes {
        let primitives = mesh.elements("primitives").unwrap_or_default();
        for item in std::iter::once(mesh).chain(&primitives) {
            if let Some(lumel) = item.get("extras").and_then(|extras| extras.get("lumel")) {
                report.count("extras.ignored", 1);
                report.warn(
                    lumel.path,
                    "ignored here; put it on the node or the material",
                );
            }
        }
    }
}
