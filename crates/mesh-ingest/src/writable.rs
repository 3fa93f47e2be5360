//! Checks what light ignores but writers copy, so that its faults are found before the bake and not
//! after it.

use std::collections::BTreeSet;

use rayon::prelude::*;

use crate::accessor::{DataType, Dimensions};
use crate::document::Document;
use crate::error::{Fault, Faults, Outcome};
use crate::json::Item;
use crate::primitive::{Want, attribute_list};
use crate::scene::{Mesh, Scene};

/// Types of components.
type Components = &'static [DataType];

/// Decodes what writers re-index, and checks what they copy.
pub(crate) fn check(document: &Document, scene: &Scene, faults: &mut Faults) {
    decode(document, scene, faults);
    check_deformation(document, faults);
}

/// Reads attributes and morph targets that light ignores, and compressed animation data.
fn decode(document: &Document, scene: &Scene, faults: &mut Faults) {
    let root = document.root();
    let views = root.len_of("bufferViews").unwrap_or(0);
    let in_document = |m: &&Mesh| m.gltf_mesh != Mesh::NOT_IN_DOCUMENT;
    let primitives: BTreeSet<_> = (scene.meshes.iter().filter(in_document))
        .flat_map(|mesh| mesh.primitives.iter().map(|p| (mesh.gltf_mesh, p)))
        .filter(|(_, p)| !scene.materials[p.material].occluder_only)
        .map(|(mesh, p)| (mesh, p.gltf_primitive))
        .collect();
    let primitives: Vec<_> = primitives.into_iter().collect();
    let whole: Vec<_> = (primitives.into_par_iter())
        .map(|(mesh, primitive)| {
            let item = root
                .element("meshes", mesh)?
                .element("primitives", primitive)?;
            document.read_primitive(&item, Want::All).map(drop)
        })
        .collect();
    let decoded: Vec<_> = (0..views)
        .into_par_iter()
        .map(|i| {
            let view = document.view_at(i)?;
            match view.meshopt {
                Some(_) => document.view_bytes(i, &view).map(drop),
                None => Ok(()),
            }
        })
        .collect();
    for outcome in whole.into_iter().chain(decoded) {
        faults.take(outcome);
    }
}

/// Checks the accessors of joints, skins and animations, whether their nodes are baked or not: they
/// must exist, and have a type that glTF allows (2.0, §3.7.3.3). Other programs index memory by
/// them.
fn check_deformation(document: &Document, faults: &mut Faults) {
    let root = document.root();
    for mesh in faults.take(root.elements("meshes")).unwrap_or_default() {
        for primitive in faults.take(mesh.elements("primitives")).unwrap_or_default() {
            faults.take(check_primitive(document, &primitive));
        }
    }
    for skin in faults.take(root.elements("skins")).unwrap_or_default() {
        faults.take(check_skin(document, &skin));
    }
    for animation in faults.take(root.elements("animations")).unwrap_or_default() {
        for sampler in faults
            .take(animation.elements("samplers"))
            .unwrap_or_default()
        {
            for key in ["input", "output"] {
                let known = |at: usize| document.known_accessor(at, &sampler.path_of(key));
                let accessor = faults.take(sampler.opt_uint(key)).flatten();
                faults.take(accessor.map(known).transpose());
            }
        }
    }
}

fn check_primitive(document: &Document, primitive: &Item<'_>) -> Outcome<()> {
    if primitive.get("attributes").is_none() {
        return Ok(());
    }
    for (name, accessor, path) in attribute_list(primitive)? {
        document.known_accessor(accessor, &path)?;
        if name.starts_with("JOINTS_") {
            let allowed: Components = &[DataType::U8, DataType::U16];
            check_type(document, accessor, Dimensions::Vec4, allowed, &path)?;
        } else if name.starts_with("WEIGHTS_") {
            let allowed: Components = &[DataType::U8, DataType::U16, DataType::F32];
            check_type(document, accessor, Dimensions::Vec4, allowed, &path)?;
        }
    }
    Ok(())
}

fn check_skin(document: &Document, skin: &Item<'_>) -> Outcome<()> {
    let nodes = document.root().len_of("nodes")?;
    for (k, joint) in skin.uints("joints")?.into_iter().enumerate() {
        if joint >= nodes {
            return Err(Fault::invalid(
                format!("{}[{k}]", skin.path_of("joints")),
                format!("{joint}"),
                format!("an index into nodes, which has {nodes}"),
            ));
        }
    }
    skin.opt_index("skeleton", "nodes", nodes)?;
    let Some(matrices) = skin.opt_uint("inverseBindMatrices")? else {
        return Ok(());
    };
    let path = skin.path_of("inverseBindMatrices");
    document.known_accessor(matrices, &path)?;
    check_type(
        document,
        matrices,
        Dimensions::Mat4,
        &[DataType::F32],
        &path,
    )
}

/// Checks the type that accessor `accessor`, which exists, states.
fn check_type(
    document: &Document,
    accessor: usize,
    dimensions: Dimensions,
    components: Components,
    path: &str,
) -> Outcome<()> {
    let head = document.accessor_head(accessor)?;
    if head.dimensions == dimensions && components.contains(&head.component) {
        return Ok(());
    }
    let allowed: Vec<_> = components.iter().map(|c| format!("{c:?}")).collect();
    Err(Fault::invalid(
        path,
        format!("{:?} of {:?}", head.dimensions, head.component),
        format!("{dimensions:?} of {}", allowed.join(" or ")),
    ))
}
