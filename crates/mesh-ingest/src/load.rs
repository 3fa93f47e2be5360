//! Loading: reads the parts of a document in order.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;

use crate::cuts::{self, Cut};
use crate::document::{Document, ImageSource};
use crate::error::{Error, Fault, Faults, Kind, Outcome};
use crate::extras::SurfaceExtras;
use crate::files::MemoryDocument;
use crate::geometry;
use crate::hierarchy;
use crate::material::{self, MaterialRead};
use crate::nodes::{self, Graph, Placed};
use crate::options::{LoadOptions, MAX_COORDINATE, MAX_REFLECTIONS};
use crate::primitive::{attribute_list, primitive_mode};
use crate::report::{IngestReport, LeftOutReason, Totals};
use crate::scene::{Instance, Mesh, Primitive, ReflectionPoint, Scene};
use crate::settle::{needed_images, settle_alpha};
use crate::{environment, extensions, extras, images, lights, lods, sides, writable};

/// A loaded document in normal form, the original, and a report.
#[derive(Debug)]
pub struct Loaded {
    /// The scene in normal form.
    pub scene: Scene,
    /// The original document, for writers.
    pub document: Document,
    /// What was dropped, clamped and left out.
    pub report: IngestReport,
}

/// Reads the glTF 2.0 document at `path` (.gltf or .glb, detected by content) into normal form.
///
/// # Errors
/// See [`Error`]; all problems found are reported together. A document whose chosen scene has no
/// valid triangle gives [`Error::NoTriangles`].
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, Error> {
    read(Document::open(path, options)?, options)
}

/// As [`load`], for a document in memory. Nothing is read from disk unless the document has a
/// folder.
///
/// # Errors
/// As [`load`]; files that its resolver cannot provide give [`Error::Io`].
pub fn load_memory(document: &MemoryDocument, options: &LoadOptions) -> Result<Loaded, Error> {
    read(Document::in_memory(document, options)?, options)
}

fn read(mut document: Document, options: &LoadOptions) -> Result<Loaded, Error> {
    let path = &document.file().to_path_buf();
    let mut report = IngestReport::default();
    let mut faults = Faults::default();
    extensions::check(&document.root(), &mut faults, &mut report);
    check_layout(&document, &mut faults);
    faults.check(path)?;
    let mut backs = BTreeMap::new();
    if !options.split_sides.is_empty() {
        let split = faults.take(sides::split(&mut document, &options.split_sides));
        faults.check(path)?;
        backs = split.unwrap_or_default();
    }
    if !options.cuts.is_empty() {
        // Both sides of a sheet are cut alike.
        let of_back = |cut: &Cut| {
            let primitive = *backs.get(&(cut.mesh, cut.primitive))?;
            Some(Cut { primitive, ..*cut })
        };
        let cuts = options.cuts.iter();
        let cuts: Vec<Cut> = cuts
            .flat_map(|c| [Some(*c), of_back(c)])
            .flatten()
            .collect();
        faults.take(cuts::apply(&mut document, &cuts));
        faults.check(path)?;
    }

    let graph = nodes::walk(&document, options, &mut faults, &mut report);
    let materials = read_materials(&document, options.scene, &mut faults, &mut report);
    extras::warn_misplaced(&document, &mut report);
    let used: BTreeSet<usize> = graph.meshes.iter().map(|placed| placed.index).collect();
    check_size(&document, &graph, &used, &mut faults);
    faults.check(path)?;

    let read = read_meshes(&document, &used, &materials, &mut faults, &mut report);
    let (mut scene, used_materials) =
        assemble(&document, read, &graph, materials, &mut faults, &mut report);
    faults.check(path)?;
    if scene.instances.is_empty() {
        return Err(Error::NoTriangles {
            file: path.clone(),
            why: why_empty(&graph, &report),
        });
    }
    scene.origin = recentre(&mut scene, &mut report);
    let name = |(node, page): (&usize, &usize)| (*node, graph.page_names[*page].clone());
    scene.page_groups = graph.pages.iter().map(name).collect();
    let origin = scene.origin;
    scene.cameras = graph
        .cameras
        .iter()
        .map(|p| (*p - origin).as_vec3())
        .collect();
    let recentred = |v: &DAffine3| DAffine3::from_translation(-origin) * *v;
    scene.walkable = graph.walkable.iter().map(recentred).collect();
    scene.reflections = reflections(&document, &graph, scene.origin, &mut report);
    lods::settle(&mut scene, &graph.lods, &mut report);
    lights::read_all(&mut document, &graph, &mut scene, &mut faults, &mut report);
    let projected = (scene.cookies.iter()).map(|i| i.pixels.len() as u64).sum();
    let needed = needed_images(&scene.materials, &used_materials);
    scene.images = images::decode(&mut document, &needed, projected, &mut faults);
    faults.check(path)?;
    let sky = environment::read(
        &mut document,
        options.scene,
        &scene.images,
        projected,
        &mut report,
    );
    scene.environment = faults.take(sky).flatten();
    faults.check(path)?;
    if scene.instances.is_empty() {
        return Err(Error::NoTriangles {
            file: path.clone(),
            why: why_empty(&graph, &report),
        });
    }
    writable::check(&document, &scene, &mut faults);
    note_missing_images(&mut document, &needed, &mut faults, &mut report);
    faults.check(path)?;
    settle_alpha(&mut scene, &used_materials, &mut report);
    report.files = document.input_uris();
    report.totals = totals(&scene);
    tracing::debug!(totals = ?report.totals, counts = ?report.counts, "ingested {}", path.display());
    Ok(Loaded {
        scene,
        document,
        report,
    })
}

/// Validates every accessor and buffer view, used or not: writers copy all of them, and a file with
/// one false statement cannot be trusted elsewhere.
fn check_layout(document: &Document, faults: &mut Faults) {
    let root = document.root();
    let mut unbacked = 0u64;
    for i in 0..faults.take(root.len_of("bufferViews")).unwrap_or(0) {
        if let Some(view) = faults.take(document.view_at(i)) {
            faults.take(document.check_view(&view));
        }
    }
    for i in 0..faults.take(root.len_of("accessors")).unwrap_or(0) {
        let Some(head) = faults.take(document.accessor_head(i)) else {
            continue;
        };
        if head.view.is_none() {
            let size = crate::accessor::element_size(head.component, head.dimensions) as u64;
            unbacked = unbacked.saturating_add(size.saturating_mul(head.count as u64));
        }
        faults.take(document.check_accessor(&head));
    }
    // Accessors of Draco primitives have no view by design; their data is limited when it is
    // decoded.
    let uses_draco = root
        .value
        .get("extensionsUsed")
        .is_some_and(|v| v.to_string().contains("draco"));
    let allowed = document.limits().unbacked_bytes;
    if unbacked > allowed && !uses_draco {
        faults.push(Fault::limit(
            "accessors",
            format!("{unbacked} bytes without a buffer view"),
            format!("at most {allowed}"),
        ));
    }
}

/// Estimates the size of the geometry from counts alone and refuses what would not fit.
fn check_size(document: &Document, graph: &Graph, used: &BTreeSet<usize>, faults: &mut Faults) {
    let (mut bytes, mut triangles) = (0u64, BTreeMap::new());
    for &mesh in used {
        let Some((mesh_bytes, mesh_triangles)) = faults.take(mesh_size(document, mesh)) else {
            return;
        };
        bytes = bytes.saturating_add(mesh_bytes);
        triangles.insert(mesh, mesh_triangles);
    }
    let total = graph.meshes.iter().fold(0u64, |sum, placed| {
        sum.saturating_add(triangles[&placed.index])
    });
    let limits = document.limits();
    if bytes > limits.geometry_bytes {
        let allowed = format!("at most {}", limits.geometry_bytes);
        faults.push(Fault::limit(
            "meshes",
            format!("geometry of about {bytes} bytes"),
            allowed,
        ));
    }
    if total > limits.triangles {
        faults.push(Fault::limit(
            "nodes",
            format!("{total} triangles after instancing"),
            format!("at most {}", limits.triangles),
        ));
    }
}

/// Bytes and triangles that mesh `index` claims.
fn mesh_size(document: &Document, index: usize) -> Outcome<(u64, u64)> {
    let mesh = document.root().element("meshes", index)?;
    let (mut bytes, mut triangles) = (0u64, 0u64);
    for item in mesh.elements("primitives")? {
        let mut vertices = 0;
        for (name, accessor, path) in attribute_list(&item)? {
            document.known_accessor(accessor, &path)?;
            let count = document.accessor_head(accessor)?.count as u64;
            if name == "POSITION" {
                vertices = count;
            }
            // The largest element of the normal form is a 16-byte colour.
            bytes = bytes.saturating_add(count.saturating_mul(16));
        }
        let corners = match item.opt_uint("indices")? {
            Some(accessor) => {
                document.known_accessor(accessor, &item.path_of("indices"))?;
                document.accessor_head(accessor)?.count as u64
            }
            None => vertices,
        };
        let count = if primitive_mode(&item)? == gltf::mesh::Mode::Triangles {
            corners / 3
        } else {
            corners
        };
        triangles += count;
        bytes = bytes.saturating_add(count.saturating_mul(28));
    }
    Ok((bytes, triangles))
}

/// All materials in order, then the default one.
fn read_materials(
    document: &Document,
    scene: Option<usize>,
    faults: &mut Faults,
    report: &mut IngestReport,
) -> Vec<MaterialRead> {
    let root = document.root();
    let count = faults.take(root.len_of("materials")).unwrap_or(0);
    // A wrong choice of scene is already reported as a fault.
    let scene = hierarchy::chosen_scene(&root, scene).ok().flatten();
    let all = SurfaceExtras::of_document(document, scene, report);
    let mut materials: Vec<MaterialRead> = (0..count)
        .map(|i| {
            let read = faults.take(material::read(document, i, all, report));
            read.unwrap_or_else(|| material::read_default(&all))
        })
        .collect();
    materials.push(material::read_default(&all));
    materials
}

/// Reads the primitives of all used meshes in parallel; results and counts are in document order.
fn read_meshes(
    document: &Document,
    used: &BTreeSet<usize>,
    materials: &[MaterialRead],
    faults: &mut Faults,
    report: &mut IngestReport,
) -> BTreeMap<usize, Vec<Primitive>> {
    let root = document.root();
    let mut jobs = Vec::new();
    for &mesh in used {
        let primitives = root
            .element("meshes", mesh)
            .and_then(|item| item.elements("primitives"));
        let primitives = faults.take(primitives).unwrap_or_default();
        jobs.extend(
            primitives
                .into_iter()
                .enumerate()
                .map(|(p, item)| (mesh, p, item)),
        );
    }
    let default = materials.len() - 1;
    let results: Vec<_> = jobs
        .par_iter()
        .map(|(mesh, number, item)| {
            let mut part = IngestReport::default();
            let primitive = item
                .opt_index("material", "materials", default)
                .and_then(|material| {
                    let material = material.unwrap_or(default);
                    if materials[material].excluded {
                        part.count("primitives.excluded", 1);
                        return Ok(None);
                    }
                    let double_sided = materials[material].material.double_sided;
                    geometry::read(document, item, *number, material, double_sided, &mut part)
                });
            (*mesh, primitive, part)
        })
        .collect();
    let mut meshes: BTreeMap<usize, Vec<Primitive>> = BTreeMap::new();
    for (mesh, primitive, part) in results {
        report.merge(part);
        if let Some(primitive) = faults.take(primitive).flatten() {
            meshes.entry(mesh).or_default().push(primitive);
        }
    }
    meshes
}

/// Combines meshes, materials and instances; also determines the materials in use.
fn assemble(
    document: &Document,
    read: BTreeMap<usize, Vec<Primitive>>,
    graph: &Graph,
    materials: Vec<MaterialRead>,
    faults: &mut Faults,
    report: &mut IngestReport,
) -> (Scene, BTreeSet<usize>) {
    let root = document.root();
    let mut scene = Scene::default();
    let mut place = BTreeMap::new();
    for (gltf_mesh, primitives) in read {
        place.insert(gltf_mesh, scene.meshes.len());
        let name = root
            .element("meshes", gltf_mesh)
            .map(|item| item.name())
            .unwrap_or_default();
        scene.meshes.push(Mesh {
            gltf_mesh,
            name,
            primitives,
        });
    }
    for placed in &graph.meshes {
        match place.get(&placed.index) {
            Some(&mesh) => scene
                .instances
                .extend(instance(document, placed, mesh, report)),
            None => report.count("instances.empty", 1),
        }
    }
    let used: BTreeSet<usize> = scene
        .meshes
        .iter()
        .flat_map(|m| &m.primitives)
        .map(|p| p.material)
        .collect();
    for (i, read) in materials.into_iter().enumerate() {
        if used.contains(&i) {
            read.faults.into_iter().for_each(|fault| faults.push(fault));
        }
        scene.materials.push(read.material);
    }
    check_tex_coords(&scene, report);
    (scene, used)
}

/// Places of reflection captures within reach.
fn reflections(
    document: &Document,
    graph: &Graph,
    origin: DVec3,
    report: &mut IngestReport,
) -> Vec<ReflectionPoint> {
    let root = document.root();
    let mut out = Vec::new();
    for &(node, position) in &graph.reflections {
        let item = root.element("nodes", node);
        let near = (position - origin).abs().max_element() <= MAX_COORDINATE;
        if near && out.len() < MAX_REFLECTIONS {
            out.push(ReflectionPoint {
                node,
                name: item.map(|n| n.name()).unwrap_or_default(),
                position: (position - origin).as_vec3(),
            });
        } else {
            report.count("reflections.dropped", 1);
            report.warn(
                format!("nodes[{node}].extras.lumel.reflection"),
                format!("too far away, or more than {MAX_REFLECTIONS}; no reflection is captured"),
            );
        }
    }
    out
}

/// Makes an instance, unless its transform is not invertible.
fn instance(
    document: &Document,
    placed: &Placed,
    mesh: usize,
    report: &mut IngestReport,
) -> Option<Instance> {
    let root = document.root();
    let node = root.element("nodes", placed.node).ok()?;
    if !placed.transform.is_finite() || !nodes::is_invertible(&placed.transform.matrix3) {
        report.count("instances.singular", 1);
        report.warn(
            node.path,
            "its world transform is not invertible; the instance is dropped",
        );
        return None;
    }
    let lumel = node
        .value
        .get("extras")
        .and_then(|extras| extras.get("lumel"));
    Some(Instance {
        node: placed.node,
        name: node.name(),
        copy: placed.copy,
        mesh,
        transform: placed.transform,
        occluder: placed.occluder,
        density: placed.density as f32,
        stands_in: None,
        extras: lumel.map(|lumel| serde_json::json!({ "lumel": lumel })),
    })
}

/// Warns about textures whose coordinates a primitive lacks; they are sampled at (0, 0).
fn check_tex_coords(scene: &Scene, report: &mut IngestReport) {
    for mesh in &scene.meshes {
        for primitive in &mesh.primitives {
            let material = &scene.materials[primitive.material];
            let textures = [
                &material.base_texture,
                &material.emissive_texture,
                &material.transmission_texture,
            ];
            for texture in textures.into_iter().flatten() {
                if primitive
                    .tex_coords
                    .get(texture.tex_coord)
                    .is_none_or(Vec::is_empty)
                {
                    report.count("primitives.missing_tex_coords", 1);
                    report.warn(
                        format!(
                            "meshes[{}].primitives[{}]",
                            mesh.gltf_mesh, primitive.gltf_primitive
                        ),
                        format!(
                            "no TEXCOORD_{}, which its material samples; treated as (0, 0)",
                            texture.tex_coord
                        ),
                    );
                }
            }
        }
    }
}

/// Finds the centre of the world and drops instances that are too far away for `f32` arithmetic.
fn recentre(scene: &mut Scene, report: &mut IngestReport) -> DVec3 {
    // Used corners, once per mesh, so that instances cost one transform per vertex.
    let corners: Vec<Vec<Vec3>> = scene.meshes.par_iter().map(used_positions).collect();
    let bounds: Vec<[DVec3; 2]> = scene
        .instances
        .par_iter()
        .map(|instance| {
            let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
            for p in &corners[instance.mesh] {
                let p = instance.transform.transform_point3(p.as_dvec3());
                bounds = [bounds[0].min(p), bounds[1].max(p)];
            }
            bounds
        })
        .collect();
    let reachable = |b: &[DVec3; 2]| {
        b[0].min_element() >= -MAX_COORDINATE && b[1].max_element() <= MAX_COORDINATE
    };
    let before = scene.instances.len();
    let mut at = 0;
    scene.instances.retain(|_| {
        at += 1;
        reachable(&bounds[at - 1])
    });
    report.count(
        "instances.out_of_range",
        (before - scene.instances.len()) as u64,
    );
    let all = bounds
        .iter()
        .filter(|b| reachable(b))
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |all, b| {
            [all[0].min(b[0]), all[1].max(b[1])]
        });
    if scene.instances.is_empty() {
        DVec3::ZERO
    } else {
        (all[0] + all[1]) * 0.5
    }
}

fn used_positions(mesh: &Mesh) -> Vec<Vec3> {
    let mut positions = Vec::new();
    for primitive in &mesh.primitives {
        let mut used = vec![false; primitive.positions.len()];
        primitive
            .triangles
            .iter()
            .flatten()
            .for_each(|&i| used[i as usize] = true);
        positions.extend(
            primitive
                .positions
                .iter()
                .zip(used)
                .filter(|(_, used)| *used)
                .map(|(p, _)| *p),
        );
    }
    positions
}

/// Reports images that cannot be read but that light does not need, because writers keep their
/// URIs. Any other image that a writer cannot read was lost after loading.
fn note_missing_images(
    document: &mut Document,
    needed: &BTreeSet<usize>,
    faults: &mut Faults,
    report: &mut IngestReport,
) {
    let count = document.root().len_of("images").unwrap_or(0);
    for i in (0..count).filter(|i| !needed.contains(i)) {
        let why = match document.image(i) {
            Ok(ImageSource::File(file)) => match document.files.check(&file) {
                Ok(()) => continue,
                Err(e) => format!("its file cannot be read: {e}"),
            },
            Ok(ImageSource::Embedded(_)) => continue,
            // A URI that leads to no readable file may stay. One that leads out of the folder is an
            // error, because it would be lost silently.
            Err(fault) if matches!(fault.kind, Kind::Unsupported) => fault.problem.to_string(),
            Err(fault) => {
                faults.push(fault);
                continue;
            }
        };
        document.missing.insert(i);
        report.count("images.missing", 1);
        report.warn(
            format!("images[{i}]"),
            format!("{why}; no material needs it"),
        );
    }
}

fn why_empty(graph: &Graph, report: &IngestReport) -> String {
    let mut parts = Vec::new();
    if graph.meshes.is_empty() && report.left_out.is_empty() {
        parts.push("the scene places no mesh".to_string());
    }
    let mut deformed = false;
    for (reason, count) in report.left_out_by_reason() {
        parts.push(format!("{count} nodes left out ({reason:?})"));
        deformed |= !matches!(reason, LeftOutReason::Hidden | LeftOutReason::Excluded);
    }
    parts.extend(report.counts.iter().map(|(key, n)| format!("{key} {n}")));
    let mut why = parts.join(", ");
    if deformed {
        why.push_str("; extras.lumel.bake: true on a node bakes it as it stands");
    }
    why
}

fn totals(scene: &Scene) -> Totals {
    let primitives = || scene.meshes.iter().flat_map(|m| &m.primitives);
    let of_mesh: Vec<u64> = scene
        .meshes
        .iter()
        .map(|m| m.primitives.iter().map(|p| p.triangles.len() as u64).sum())
        .collect();
    let triangles_instanced: u64 = scene.instances.iter().map(|i| of_mesh[i.mesh]).sum();
    let vertex_bytes: u64 = primitives()
        .map(|p| {
            let uv: usize = p.tex_coords.iter().map(|set| set.len() * 8).sum();
            (p.positions.len() * 12
                + p.normals.len() * 12
                + p.colors.len() * 16
                + uv
                + p.triangles.len() * 16) as u64
        })
        .sum();
    let image_bytes: u64 = scene
        .images
        .iter()
        .flatten()
        .chain(&scene.cookies)
        .map(|i| i.pixels.len() as u64 * 4)
        .sum();
    let sky_bytes = scene
        .environment
        .as_ref()
        .map_or(0, |e| e.pixels.len() as u64 * 12);
    // A soup triangle takes 36 + 12 + 4 + 16 + 4 bytes.
    let memory_bytes = vertex_bytes
        + image_bytes
        + sky_bytes
        + triangles_instanced * 72
        + scene.instances.len() as u64 * 256;
    Totals {
        meshes: scene.meshes.len(),
        primitives: primitives().count(),
        vertices: primitives().map(|p| p.positions.len() as u64).sum(),
        triangles: of_mesh.iter().sum(),
        triangles_instanced,
        instances: scene.instances.len(),
        materials: scene.materials.len() - 1,
        images: scene.images.iter().flatten().count(),
        lights: scene.lights.len(),
        memory_bytes,
    }
}
