//! The scene graph: placed meshes and lights, and nodes that are left out.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, Vec3};
use serde_json::Value;

use crate::document::Document;
use crate::error::{Fault, Faults, Outcome};
use crate::extras::{NodeExtras, density_of_all};
use crate::hierarchy::{chosen_scene, hierarchy};
use crate::json::Item;
use crate::lods::{Lods, Marked};
use crate::options::LoadOptions;
use crate::report::{IngestReport, LeftOut, LeftOutReason};

/// A mesh or light placed in the world (not recentred).
#[derive(Debug)]
pub(crate) struct Placed {
    pub node: usize,
    pub copy: Option<u32>,
    /// Index into the document's meshes or lights.
    pub index: usize,
    pub transform: DAffine3,
    /// Whether the node or an ancestor only casts shadows.
    pub occluder: bool,
    /// Factor on the scene's lumels per metre.
    pub density: f64,
}

/// Everything in the chosen scene.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    pub meshes: Vec<Placed>,
    pub lights: Vec<Placed>,
    /// Lights of `EXT_lights_ies`; `index` is into the extension's list.
    pub measured_lights: Vec<Placed>,
    /// Lights of `EXT_lights_area`.
    pub area_lights: Vec<Placed>,
    /// Levels of detail and variants.
    pub lods: Lods,
    /// Names of page groups, and the group of each node that is in one.
    pub page_names: Vec<String>,
    pub pages: BTreeMap<usize, usize>,
    /// Walkable volumes and cameras, not recentred.
    pub walkable: Vec<DAffine3>,
    pub cameras: Vec<DVec3>,
    /// Nodes with a reflection capture, and their positions, not recentred.
    pub reflections: Vec<(usize, DVec3)>,
}

/// Properties that a node passes on to its children.
#[derive(Debug, Clone, Copy)]
struct Inherited {
    transform: DAffine3,
    animated: bool,
    /// The nearest `extras.lumel.bake`.
    bake: bool,
    hidden: bool,
    excluded: bool,
    /// The nearest `extras.lumel.occluder`.
    occluder: bool,
    /// The nearest `extras.lumel.density`.
    density: f64,
    /// Level of detail and variant.
    marked: Marked,
    /// The nearest `extras.lumel.page`: index into [`Graph::page_names`].
    page: Option<usize>,
}

/// What animations change on each node.
#[derive(Debug, Default, Clone, Copy)]
struct Animated {
    moves: bool,
    morphs: bool,
}

/// Walks the requested scene (or the document's default) depth first, without recursion, because
/// hierarchies may be deep.
pub(crate) fn walk(
    document: &Document,
    options: &LoadOptions,
    faults: &mut Faults,
    report: &mut IngestReport,
) -> Graph {
    let root = document.root();
    let scene = options.scene;
    let mut graph = Graph::default();
    let Some(count) = faults.take(root.len_of("nodes")) else {
        return graph;
    };
    let Some((roots, children)) = hierarchy(&root, count, scene, faults, report) else {
        return graph;
    };
    let lods = Lods::read(&root, &children, !options.ignore_lod_names);
    let Some(lods) = faults.take(lods) else {
        return graph;
    };
    graph.lods = lods;
    let animated = faults
        .take(animated_nodes(&root, count))
        .unwrap_or_else(|| vec![Animated::default(); count]);
    let top = Inherited {
        transform: DAffine3::IDENTITY,
        animated: false,
        bake: false,
        hidden: false,
        excluded: false,
        occluder: false,
        density: density_of_all(&root, chosen_scene(&root, scene).unwrap_or(None), report)
            .unwrap_or(1.0),
        marked: [None; 2],
        page: None,
    };
    let mut stack: Vec<(usize, Inherited)> = roots.iter().rev().map(|&r| (r, top)).collect();
    while let Some((index, from_parent)) = stack.pop() {
        let visit = visit(
            document,
            index,
            from_parent,
            animated[index],
            &mut graph,
            report,
        );
        let Some(own) = faults.take(visit) else {
            continue;
        };
        let levels = graph.lods.unplaced(index, &roots);
        stack.extend(levels.map(|level| (level, from_parent)));
        stack.extend(children[index].iter().rev().map(|&child| (child, own)));
    }
    graph
}

/// Nodes that animations move or morph, including `KHR_animation_pointer`.
fn animated_nodes(root: &Item<'_>, count: usize) -> Outcome<Vec<Animated>> {
    let mut animated = vec![Animated::default(); count];
    for animation in root.elements("animations")? {
        for channel in animation.elements("channels")? {
            let Some(target) = channel.opt_object("target")? else {
                continue;
            };
            let pointer = target
                .extension("KHR_animation_pointer")?
                .and_then(|ext| ext.value.get("pointer"))
                .and_then(Value::as_str)
                .and_then(|p| p.strip_prefix("/nodes/"))
                .and_then(|p| p.split_once('/'))
                .and_then(|(node, path)| Some((node.parse().ok()?, path)));
            let plain = target.opt_uint("node")?.zip(target.opt_str("path")?);
            let Some((node, path)) = pointer.or(plain) else {
                continue;
            };
            let Some(entry) = animated.get_mut(node) else {
                return Err(Fault::invalid(
                    target.path_of("node"),
                    format!("{node}"),
                    format!("an index into nodes, which has {count}"),
                ));
            };
            match path.split('/').next() {
                Some("translation" | "rotation" | "scale") => entry.moves = true,
                Some("weights") => entry.morphs = true,
                _ => {}
            }
        }
    }
    Ok(animated)
}

/// Reads one node; returns what its children inherit.
fn visit(
    document: &Document,
    index: usize,
    from: Inherited,
    animated: Animated,
    graph: &mut Graph,
    report: &mut IngestReport,
) -> Outcome<Inherited> {
    let root = document.root();
    let node = root.element("nodes", index)?;
    let extras = NodeExtras::read(&node, report);
    let visible = match node.extension("KHR_node_visibility")? {
        Some(ext) => ext.opt_bool("visible")?.unwrap_or(true),
        None => true,
    };
    let own = Inherited {
        transform: from.transform * local_transform(&node, report)?,
        animated: from.animated || animated.moves,
        bake: extras.bake.unwrap_or(from.bake),
        hidden: from.hidden || !visible,
        excluded: from.excluded || extras.exclude == Some(true),
        occluder: extras.occluder.unwrap_or(from.occluder),
        density: extras.density.unwrap_or(from.density),
        marked: (graph.lods).mark(
            index,
            &node,
            [extras.lod.as_ref(), extras.variant.as_ref()],
            from.marked,
        )?,
        page: match &extras.page {
            Some(name) => {
                graph.page_names.push(name.clone());
                Some(graph.page_names.len() - 1)
            }
            None => from.page,
        },
    };
    graph.pages.extend(own.page.map(|page| (index, page)));
    let mesh = node.opt_index("mesh", "meshes", root.len_of("meshes")?)?;
    if node.value.get("camera").is_some() {
        graph.cameras.push(own.transform.translation);
    }
    if extras.reflection == Some(true) && !own.excluded && !own.hidden {
        graph.reflections.push((index, own.transform.translation));
    }
    if extras.walkable == Some(true) {
        graph
            .walkable
            .extend(volume(&root, mesh, report)?.map(|v| own.transform * v));
        return Ok(own);
    }
    let light = light_of(&root, &node, "KHR_lights_punctual")?;
    let measured = light_of(&root, &node, "EXT_lights_ies")?;
    let area = light_of(&root, &node, "EXT_lights_area")?;
    if mesh.is_none() && [light, measured, area] == [None; 3] {
        return Ok(own);
    }
    if let Some(reason) = why_left_out(&root, &node, mesh, own, animated)? {
        report.left_out.push(LeftOut {
            node: index,
            name: node.name(),
            reason,
        });
        return Ok(own);
    }
    for (light, list) in [
        (light, &mut graph.lights),
        (measured, &mut graph.measured_lights),
        (area, &mut graph.area_lights),
    ] {
        list.extend(light.map(|light| Placed {
            node: index,
            copy: None,
            index: light,
            transform: own.transform,
            occluder: own.occluder,
            density: own.density,
        }));
    }
    if let Some(mesh) = mesh {
        match node.extension("EXT_mesh_gpu_instancing")? {
            None => graph.meshes.push(Placed {
                node: index,
                copy: None,
                index: mesh,
                transform: own.transform,
                occluder: own.occluder,
                density: own.density,
            }),
            Some(ext) => place_copies(document, &ext, index, mesh, own, graph)?,
        }
        let allowed = document.limits().instances;
        if graph.meshes.len() as u64 > allowed {
            return Err(Fault::limit(
                node.path,
                format!("more than {allowed} mesh instances"),
                "fewer",
            ));
        }
    }
    Ok(own)
}

/// The box of a mesh by its accessors' bounds, or the cube from −1 to 1 of an empty node: a map of
/// that cube.
fn volume(
    root: &Item<'_>,
    mesh: Option<usize>,
    report: &mut IngestReport,
) -> Outcome<Option<DAffine3>> {
    let Some(mesh) = mesh else {
        return Ok(Some(DAffine3::IDENTITY));
    };
    let mesh = root.element("meshes", mesh)?;
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for primitive in mesh.elements("primitives")? {
        let position = primitive.value["attributes"]["POSITION"].as_u64();
        let Some(accessor) = position else { continue };
        let accessor = root.element("accessors", accessor as usize)?;
        if let (Some(a), Some(b)) = (
            accessor.opt_numbers::<3>("min")?,
            accessor.opt_numbers::<3>("max")?,
        ) {
            (low, high) = (low.min(a.into()), high.max(b.into()));
        }
    }
    if !(low.is_finite() && high.is_finite()) {
        report.warn(
            mesh.path,
            "the walkable volume has no bounds: expected min and max of its POSITION accessor",
        );
        return Ok(None);
    }
    Ok(Some(DAffine3::from_scale_rotation_translation(
        0.5 * (high - low),
        DQuat::IDENTITY,
        0.5 * (high + low),
    )))
}

fn why_left_out(
    root: &Item<'_>,
    node: &Item<'_>,
    mesh: Option<usize>,
    own: Inherited,
    animated: Animated,
) -> Outcome<Option<LeftOutReason>> {
    if own.excluded {
        return Ok(Some(LeftOutReason::Excluded));
    }
    if own.hidden {
        return Ok(Some(LeftOutReason::Hidden));
    }
    if own.bake {
        return Ok(None);
    }
    if mesh.is_some()
        && node
            .opt_index("skin", "skins", root.len_of("skins")?)?
            .is_some()
    {
        return Ok(Some(LeftOutReason::Skinned));
    }
    if let Some(mesh) = mesh {
        let mesh = root.element("meshes", mesh)?;
        let has_targets = mesh
            .elements("primitives")?
            .iter()
            .any(|p| p.value.get("targets").is_some());
        // A node's weights replace the mesh's.
        let weights = node.get("weights").or_else(|| mesh.get("weights"));
        let deformed = weights
            .and_then(|w| {
                w.value
                    .as_array()
                    .map(|a| a.iter().any(|x| x.as_f64() != Some(0.0)))
            })
            .unwrap_or(false);
        if has_targets && (animated.morphs || deformed) {
            return Ok(Some(LeftOutReason::Morphed));
        }
    }
    Ok(own.animated.then_some(LeftOutReason::Animated))
}

/// The light that `extension` attaches to a node, as an index into the extension's list.
fn light_of(root: &Item<'_>, node: &Item<'_>, extension: &str) -> Outcome<Option<usize>> {
    let Some(ext) = node.extension(extension)? else {
        return Ok(None);
    };
    let lights = match root.extension(extension)? {
        Some(ext) => ext.len_of("lights")?,
        None => 0,
    };
    ext.opt_index("light", &format!("extensions.{extension}.lights"), lights)
}

/// A node's `matrix` or translation × rotation × scale.
fn local_transform(node: &Item<'_>, report: &mut IngestReport) -> Outcome<DAffine3> {
    if let Some(columns) = node.opt_numbers::<16>("matrix")? {
        let matrix = DMat4::from_cols_array(&columns);
        if matrix.row(3) != glam::DVec4::W {
            report.warn(
                node.path_of("matrix"),
                "the last row is not 0, 0, 0, 1 and is ignored",
            );
        }
        return Ok(DAffine3::from_mat4(matrix));
    }
    let translation = node.opt_numbers::<3>("translation")?.unwrap_or_default();
    let scale = node.opt_numbers::<3>("scale")?.unwrap_or([1.0; 3]);
    let rotation = node
        .opt_numbers::<4>("rotation")?
        .unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let rotation = unit_quaternion(rotation).unwrap_or_else(|| {
        report.warn(
            node.path_of("rotation"),
            "a quaternion of length 0 is treated as no rotation",
        );
        DQuat::IDENTITY
    });
    Ok(DAffine3::from_scale_rotation_translation(
        scale.into(),
        rotation,
        translation.into(),
    ))
}

pub(crate) fn unit_quaternion(q: [f64; 4]) -> Option<DQuat> {
    // Scaled first, because squares of components near the ends of the range would overflow or
    // underflow.
    let largest = q.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    (largest > 0.0 && largest.is_finite())
        .then(|| DQuat::from_array(q.map(|x| x / largest)).normalize())
}

/// Reads the copies of `EXT_mesh_gpu_instancing`.
fn place_copies(
    document: &Document,
    ext: &Item<'_>,
    node: usize,
    mesh: usize,
    own: Inherited,
    graph: &mut Graph,
) -> Outcome<()> {
    let mut count = None;
    let (mut translations, mut rotations, mut scales) = (None, None, None);
    for (name, accessor, path) in crate::primitive::attribute_list(ext)? {
        document.known_accessor(accessor, &path)?;
        let head = document.accessor_head(accessor)?;
        if *count.get_or_insert(head.count) != head.count {
            return Err(Fault::invalid(
                path,
                format!("{} elements", head.count),
                format!("{count:?}, as the others have"),
            ));
        }
        let allowed = document.limits().instances;
        if (graph.meshes.len() + head.count) as u64 > allowed {
            return Err(Fault::limit(
                path,
                format!("{} copies", head.count),
                format!("at most {allowed} mesh instances"),
            ));
        }
        let width = head.dimensions.multiplicity();
        let expected = match name.as_str() {
            "TRANSLATION" | "SCALE" => 3,
            "ROTATION" => 4,
            _ => continue,
        };
        if width != expected {
            return Err(Fault::invalid(
                path,
                format!("{width} components"),
                format!("{expected}"),
            ));
        }
        let raw = document.accessor(accessor)?;
        match name.as_str() {
            "TRANSLATION" => translations = Some(raw.to_floats::<3>(0.0)),
            "SCALE" => scales = Some(raw.to_floats::<3>(1.0)),
            _ => rotations = Some(raw.to_floats::<4>(0.0)),
        }
    }
    let vector = |v: [f32; 3]| Vec3::from(v).as_dvec3();
    for k in 0..count.unwrap_or(0) {
        let translation = translations.as_ref().map_or(DVec3::ZERO, |t| vector(t[k]));
        let scale = scales.as_ref().map_or(DVec3::ONE, |s| vector(s[k]));
        let rotation = rotations
            .as_ref()
            .and_then(|r| unit_quaternion(r[k].map(f64::from)))
            .unwrap_or(DQuat::IDENTITY);
        let local = DAffine3::from_scale_rotation_translation(scale, rotation, translation);
        graph.meshes.push(Placed {
            node,
            copy: Some(k as u32),
            index: mesh,
            transform: own.transform * local,
            occluder: own.occluder,
            density: own.density,
        });
    }
    Ok(())
}

/// Whether a transform is finite and invertible: its determinant must exceed 1e-12 times the
/// product of the axes' lengths (as [`MIN_ASPECT`](crate::geometry::MIN_ASPECT), far above double
/// rounding).
pub(crate) fn is_invertible(m: &DMat3) -> bool {
    let lengths = [m.x_axis, m.y_axis, m.z_axis].map(|a| a.length());
    if !m.is_finite() || lengths.iter().any(|&l| !(l > 0.0 && l.is_finite())) {
        return false;
    }
    let unit = DMat3::from_cols(
        m.x_axis / lengths[0],
        m.y_axis / lengths[1],
        m.z_axis / lengths[2],
    );
    unit.determinant().abs() > crate::geometry::MIN_ASPECT
}
