//! `level.glb`: the input with lightmap coordinates in `TEXCOORD_1` and each node's rectangle in
//! its extras.

use std::collections::{BTreeMap, BTreeSet};

use atlas::{Layout, UvOrigin};
use mesh_ingest::{Document, Scene};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::editor::{Editor, remove_extensions};
use super::json::{element, element_mut, index, object_at, push, set_extra};
use super::moz;
use super::nodes::{LIGHTMAP_EXTRA, REFLECTION_EXTRA, by_node};
use super::split::{Split, accessor_of, add_gathered};
use super::texcoord;
use crate::error::{Error, Result};
use crate::ktx2::Ktx2Format;
use crate::manifest::{ManifestReflection, UvTransform, ValueKind, check, ktx2_json, uv_of};
use crate::mixed::{LAMP_EXTRA, MixedLight};
use crate::page::Page;

/// Changes that writing a glTF made besides coordinates.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct GltfStats {
    /// Primitives that were rewritten because vertices were split at chart borders or unpacked from
    /// Draco.
    pub primitives_rewritten: u64,
    /// Vertices of baked primitives before.
    pub vertices_before: u64,
    /// Vertices of baked primitives after.
    pub vertices_after: u64,
    /// Primitives whose own `TEXCOORD_1` moved to another set because a material reads it.
    pub sets_moved: u64,
    /// Primitives whose own `TEXCOORD_1` was replaced, since no material reads it.
    pub sets_replaced: u64,
    /// Materials copied so that only those primitives read the moved set.
    pub materials_copied: u64,
    /// Meshes copied because their instances differ too much to share charts
    /// ([`separate_unlike`](atlas::separate_unlike)).
    pub meshes_copied: u64,
    /// Meshes copied for `MOZ_lightmap`, whose coordinates must be those of the page.
    pub moz_meshes: u64,
    /// Materials copied for `MOZ_lightmap`.
    pub moz_materials: u64,
    /// `EXT_mesh_gpu_instancing` copies without `MOZ_lightmap`, because they share their node's
    /// materials.
    pub moz_left_out: u64,
    /// Images that were files or data URIs and are now embedded.
    pub images_embedded: u64,
    /// Images that could not be read or have an unknown format, and keep their URI.
    pub images_left: u64,
}

/// Optional contents of a lightmapped .glb.
#[derive(Debug, Clone, Copy, Default)]
pub struct GlbOptions<'a> {
    /// Quantity in the pages.
    pub value: ValueKind,
    /// Suggested exposure ([`suggested_exposure`](crate::suggested_exposure)).
    pub exposure: Option<f64>,
    /// Format and names of pages that are also stored as KTX2, in order; no names, or one per page.
    pub ktx2: Option<(Ktx2Format, &'a [String])>,
    /// The pages, if `MOZ_lightmap` is to be written. Coordinates are then those of the page, and
    /// the rectangle in extras is the whole page.
    pub moz: Option<&'a [Page]>,
    /// Lamps that are left out, and shadow masks.
    pub mixed: Option<&'a MixedLight>,
    /// Reflection captures.
    pub reflections: &'a [ManifestReflection],
}

/// Writes `document` with the lightmap coordinates of `layout`. `page_uris` are the names of the
/// page files in order.
///
/// Nodes and primitives that receive no light (occluders) stay unchanged.
///
/// Texture v points down, as in glTF: page uv = `TEXCOORD_1` × scale + offset, v = 0 at row 0 of
/// the page.
///
/// # Errors
/// [`Error::Inconsistent`] if the layout does not fit the scene or the scene does not fit the
/// document, [`Error::Document`] if the document's data cannot be read, [`Error::Limit`] beyond 4
/// GiB.
pub fn write_lightmapped_glb(
    document: &Document,
    scene: &Scene,
    layout: &Layout,
    page_uris: &[String],
    value: ValueKind,
) -> Result<(Vec<u8>, GltfStats)> {
    let options = GlbOptions {
        value,
        ..GlbOptions::default()
    };
    write_lightmapped_glb_with(document, scene, layout, page_uris, &options)
}

/// As [`write_lightmapped_glb`], with further conventions.
///
/// # Errors
/// As there; also [`Error::Inconsistent`] if `options` does not have one entry per page, or if
/// `MOZ_lightmap` is requested for radiosity pages, from which irradiance cannot be derived.
pub fn write_lightmapped_glb_with(
    document: &Document,
    scene: &Scene,
    layout: &Layout,
    page_uris: &[String],
    options: &GlbOptions<'_>,
) -> Result<(Vec<u8>, GltfStats)> {
    check(scene, layout, page_uris)?;
    let value = options.value;
    for (at, n) in [
        ("KTX2 pages", options.ktx2.map(|k| k.1.len())),
        ("pages of MOZ_lightmap", options.moz.map(<[Page]>::len)),
    ] {
        if n.is_some_and(|n| n != page_uris.len()) {
            return Err(Error::Inconsistent {
                at: at.into(),
                message: format!("{n:?}, expected {}", page_uris.len()),
            });
        }
    }
    let mut coordinates = moz::Coordinates::new();
    let mut editor = Editor::new(document)?;
    let mut stats = GltfStats::default();
    let mut moves = BTreeMap::new();
    let targets = targets(&mut editor, scene, layout, &mut stats);
    for ((mesh, atlas), &target) in scene.meshes.iter().zip(&layout.meshes).zip(&targets) {
        if mesh.primitives.len() != atlas.primitives.len() {
            let message = format!(
                "{} primitives, {} in the layout",
                mesh.primitives.len(),
                atlas.primitives.len()
            );
            return Err(Error::Inconsistent {
                at: format!("meshes[{}]", mesh.gltf_mesh),
                message,
            });
        }
        let Some(Target { mesh: target, .. }) = target.filter(|t| !t.there) else {
            continue;
        };
        for (primitive, atlas_of) in mesh.primitives.iter().zip(&atlas.primitives) {
            if scene.materials[primitive.material].occluder_only {
                continue;
            }
            let at = (mesh.gltf_mesh, primitive.gltf_primitive);
            let path = format!("meshes[{}].primitives[{}]", at.0, at.1);
            let raw = document.primitive_raw(at.0, at.1)?;
            let kept = atlas.origin == UvOrigin::Kept;
            let split = Split::new(primitive, atlas_of, &raw, atlas.size, kept, &path)?;
            if options.moz.is_some() {
                coordinates.insert((target, at.1), split.uv.clone());
            }
            let own = element(&editor.json, "meshes", target)
                .and_then(|m| element(m, "primitives", at.1))
                .cloned();
            let mut own = own.ok_or_else(|| Error::Inconsistent {
                at: path,
                message: "not in the document".into(),
            })?;
            stats.vertices_before += raw.vertex_count as u64;
            stats.vertices_after += split.source.len() as u64;
            let compressed = own
                .get("extensions")
                .is_some_and(|e| e.get("KHR_draco_mesh_compression").is_some());
            if !split.identity || compressed {
                stats.primitives_rewritten += 1;
                rewrite(&mut editor, &mut own, &raw, &split);
            }
            let kept = raw.attribute("TEXCOORD_0").and(raw.attribute("TEXCOORD_1"));
            let same =
                split.identity && kept.is_some_and(|old| old.to_floats::<2>(0.0) == split.uv);
            if !same
                && let Some(set) = put_coordinates(&mut editor, &mut own, &split.uv, &mut stats)
            {
                moves.insert((target, at.1), set);
            }
            if let Some(slot) = element_mut(&mut editor.json, "meshes", target)
                .and_then(|m| element_mut(m, "primitives", at.1))
            {
                *slot = own;
            }
        }
    }
    stats.materials_copied = texcoord::follow(&mut editor.json, &moves);
    let mut places = Vec::with_capacity(scene.instances.len());
    let mut lit = Vec::new();
    for (i, (instance, placement)) in scene.instances.iter().zip(&layout.placements).enumerate() {
        if !scene.has_lumels(i) {
            continue;
        }
        let own = scene.meshes[instance.mesh].gltf_mesh;
        if let Some(copy) = targets[instance.mesh].map(|t| t.mesh).filter(|&t| t != own)
            && let Some(node) = element_mut(&mut editor.json, "nodes", instance.node)
        {
            node.insert("mesh".into(), copy.into());
        }
        let mut uv = uv_of(layout, placement, i)?;
        if options.moz.is_some()
            && let Some(target) = targets[instance.mesh]
        {
            if instance.copy.is_some() {
                stats.moz_left_out += 1;
            } else {
                let page = placement.page as usize;
                let (node, mesh) = (instance.node, target.mesh);
                lit.push(moz::Lit {
                    node,
                    mesh,
                    page,
                    uv,
                });
                uv = UvTransform::PAGE;
            }
        }
        let mut place = json!({
            "uri": page_uris[placement.page as usize],
            "page": placement.page,
            "texCoord": texcoord::LIGHTMAP_SET,
            "offset": uv.offset,
            "scale": uv.scale,
        });
        if let Some(factor) = value.scale_to_irradiance() {
            place["scaleToIrradiance"] = factor.into();
        }
        if let Some(exposure) = options.exposure {
            place["exposure"] = exposure.into();
        }
        if let Some((format, names)) = options.ktx2 {
            place["ktx2"] = ktx2_json(format, &names[placement.page as usize]);
        }
        let page = placement.page as usize;
        if let Some(mask) = options.mixed.and_then(|m| m.mask_json(i, page)) {
            place["mask"] = mask;
        }
        places.push((instance.node, instance.copy, place));
    }
    if let Some(pages) = options.moz {
        let scale = value
            .scale_to_irradiance()
            .ok_or_else(|| Error::Inconsistent {
                at: "MOZ_lightmap".into(),
                message: "the pages hold radiosity, expected radiance or irradiance".into(),
            })?;
        let copied = moz::apply(&mut editor, &lit, &coordinates, pages, scale)?;
        stats.moz_meshes = copied.meshes;
        stats.moz_materials = copied.materials;
    }
    for (node, place) in by_node(places.into_iter()) {
        let Some(object) = element_mut(&mut editor.json, "nodes", node) else {
            return Err(Error::Inconsistent {
                at: format!("nodes[{node}]"),
                message: "not in the document".into(),
            });
        };
        set_extra(object, LIGHTMAP_EXTRA, place);
    }
    for (node, lamp) in options.mixed.into_iter().flat_map(MixedLight::node_extras) {
        if let Some(object) = element_mut(&mut editor.json, "nodes", node) {
            set_extra(object, LAMP_EXTRA, lamp);
        }
    }
    for reflection in options.reflections {
        if let Some(object) = element_mut(&mut editor.json, "nodes", reflection.node) {
            set_extra(object, REFLECTION_EXTRA, json!({"uri": reflection.uri}));
        }
    }
    let (glb, finished) = editor.finish()?;
    stats.images_embedded = finished.images_embedded;
    stats.images_left = finished.images_left;
    Ok((glb, stats))
}

/// The mesh of the JSON that a mesh of the scene is written to.
#[derive(Clone, Copy)]
struct Target {
    /// The document's mesh: the original, or a copy if another mesh of the scene uses the original.
    mesh: usize,
    /// Whether an earlier mesh was already written there, with the document's own coordinates,
    /// which serve this one too.
    there: bool,
}

/// Targets by mesh of the scene; `None` if no instance has lumels.
fn targets(
    editor: &mut Editor<'_>,
    scene: &Scene,
    layout: &Layout,
    stats: &mut GltfStats,
) -> Vec<Option<Target>> {
    let mut taken = BTreeSet::new();
    let mut kept: BTreeMap<usize, usize> = BTreeMap::new();
    let mut targets = Vec::with_capacity(scene.meshes.len());
    for (mesh, atlas) in scene.meshes.iter().zip(&layout.meshes) {
        let own = mesh.gltf_mesh;
        let keeps = atlas.origin == UvOrigin::Kept;
        let there = kept.get(&own).copied().filter(|_| keeps);
        let target = if atlas.size == [0, 0] {
            None
        } else if there.is_some() {
            there
        } else if taken.insert(own) {
            Some(own)
        } else {
            let copy = element(&editor.json, "meshes", own).cloned();
            stats.meshes_copied += 1;
            copy.map(|copy| push(&mut editor.json, "meshes", Value::Object(copy)))
        };
        if let (Some(target), true) = (target, keeps) {
            kept.insert(own, target);
        }
        targets.push(target.map(|mesh| Target {
            mesh,
            there: there.is_some(),
        }));
    }
    targets
}

/// Replaces attributes, morph targets and indices of `own` by those of `split`, as an uncompressed
/// triangle list.
fn rewrite(
    editor: &mut Editor<'_>,
    own: &mut Map<String, Value>,
    raw: &mesh_ingest::RawPrimitive<'_>,
    split: &Split,
) {
    remove_extensions(own, &["KHR_draco_mesh_compression"]);
    own.shift_remove("mode");
    let attributes = object_at(own, "attributes");
    for (name, accessor) in &raw.attributes {
        let new = add_gathered(
            editor,
            name,
            accessor,
            &split.source,
            accessor_of(attributes, name),
        );
        attributes.insert(name.clone(), new.into());
    }
    for (i, target) in raw.targets.iter().enumerate() {
        let Some(slots) = element_mut(own, "targets", i) else {
            continue;
        };
        for (name, accessor) in target {
            let new = add_gathered(
                editor,
                name,
                accessor,
                &split.source,
                accessor_of(slots, name),
            );
            slots.insert(name.clone(), new.into());
        }
    }
    let indices = editor.add_indices(&split.triangles);
    own.insert("indices".into(), indices.into());
}

/// Stores `uv` as set 1 of `own`, and also as set 0 if there is none, because sets must be
/// consecutive (§3.7.2.1). Returns the set that a `TEXCOORD_1` used by a material moved to.
fn put_coordinates(
    editor: &mut Editor<'_>,
    own: &mut Map<String, Value>,
    uv: &[[f32; 2]],
    stats: &mut GltfStats,
) -> Option<usize> {
    let needed = texcoord::needs_set_1(&editor.json, own);
    let new = editor.add_floats(uv);
    let attributes = object_at(own, "attributes");
    attributes.entry("TEXCOORD_0").or_insert(new.into());
    let mut moved = None;
    if let Some(old) = index(attributes, "TEXCOORD_1") {
        if needed {
            let free = texcoord::sets(attributes);
            attributes.insert(format!("TEXCOORD_{free}"), old.into());
            stats.sets_moved += 1;
            moved = Some(free);
        } else {
            stats.sets_replaced += 1;
        }
    }
    attributes.insert("TEXCOORD_1".into(), new.into());
    moved
}
