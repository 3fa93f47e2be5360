//! Original primitives: dense attributes and the unrolled triangle list.

use std::borrow::Cow;

pub use gltf::mesh::Mode;

use crate::accessor::{DataType, Dimensions, RawAccessor};
use crate::compress::Draco;
use crate::document::Document;
use crate::error::{Error, Fault, Outcome};
use crate::json::Item;

/// One primitive of the document, decoded but not cleaned.
#[derive(Debug, Clone)]
pub struct RawPrimitive<'a> {
    /// Number of vertices; every attribute has as many elements.
    pub vertex_count: usize,
    /// Every attribute by name, in the document's order: known ones, `_CUSTOM` ones, joints and
    /// weights.
    pub attributes: Vec<(String, RawAccessor<'a>)>,
    /// The attributes of each morph target.
    pub targets: Vec<Vec<(String, RawAccessor<'a>)>>,
    /// Topology of the document's indices.
    pub mode: Mode,
    /// Triangles with strips and fans unrolled, counter-clockwise, nothing dropped; empty for
    /// points and lines. Index *i* here is the *i* of
    /// [`Primitive::source_triangles`](crate::Primitive::source_triangles). All vertex indices are
    /// below `vertex_count`.
    pub triangles: Vec<[u32; 3]>,
}

/// Parts of a primitive to read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Want {
    /// Those that light needs.
    Light,
    /// All.
    All,
}

impl RawPrimitive<'_> {
    /// The attribute with that name.
    pub fn attribute(&self, name: &str) -> Option<&RawAccessor<'_>> {
        self.attributes
            .iter()
            .find(|(n, _)| n == name)
            .map(|(_, a)| a)
    }
}

/// Attribute sets that the normal form keeps. No known engine supports more.
pub(crate) const TEX_COORD_SETS: usize = 8;

fn affects_light(name: &str) -> bool {
    matches!(name, "POSITION" | "NORMAL" | "COLOR_0")
        || name
            .strip_prefix("TEXCOORD_")
            .and_then(|n| n.parse().ok())
            .is_some_and(|n: usize| n < TEX_COORD_SETS)
}

impl Document {
    /// Primitive `primitive` of mesh `mesh`, for writers that re-index its vertices.
    ///
    /// # Errors
    /// The primitive does not exist, an accessor is invalid, attributes differ in length, an index
    /// is out of range, or compressed data does not decode.
    pub fn primitive_raw(&self, mesh: usize, primitive: usize) -> Result<RawPrimitive<'_>, Error> {
        let read = || {
            let item = self
                .root()
                .element("meshes", mesh)?
                .element("primitives", primitive)?;
            self.read_primitive(&item, Want::All)
        };
        read().map_err(|f| f.into_error(self.file()))
    }

    pub(crate) fn read_primitive(&self, item: &Item<'_>, want: Want) -> Outcome<RawPrimitive<'_>> {
        let mode = primitive_mode(item)?;
        let draco = match item.extension("KHR_draco_mesh_compression")? {
            None => None,
            Some(ext) => Some(self.decode_draco(&ext)?),
        };
        let mut attributes = Vec::new();
        let mut vertex_count = draco.as_ref().map(|(d, _)| d.points());
        for (name, accessor, path) in attribute_list(item)? {
            if want == Want::Light && !affects_light(&name) {
                continue;
            }
            let compressed = draco
                .as_ref()
                .and_then(|(d, ids)| Some((d, ids.iter().find(|(n, _)| *n == name)?.1)));
            let raw = match compressed {
                Some((d, id)) => self.draco_attribute(d, id, accessor, &path)?,
                None => {
                    self.known_accessor(accessor, &path)?;
                    self.accessor(accessor)?
                }
            };
            check_shape(&name, &raw, &path)?;
            match vertex_count {
                None => vertex_count = Some(raw.count),
                Some(n) if n != raw.count => {
                    return Err(Fault::invalid(
                        path,
                        format!("{} elements", raw.count),
                        format!("{n}, as the others have"),
                    ));
                }
                Some(_) => {}
            }
            attributes.push((name, raw));
        }
        let vertex_count = vertex_count.unwrap_or(0);
        let mut targets = Vec::new();
        if want == Want::All {
            for target in item.elements("targets")? {
                targets.push(self.read_target(&target, vertex_count)?);
            }
        }
        let triangles = match &draco {
            Some((d, _)) => d.triangles(),
            None => {
                let indices = self.read_indices(item)?;
                unroll(mode, indices.as_deref(), vertex_count)
            }
        };
        if let Some(&index) = triangles
            .iter()
            .flatten()
            .find(|&&i| i as usize >= vertex_count)
        {
            return Err(Fault::invalid(
                item.path_of("indices"),
                format!("index {index}"),
                format!("indices below {vertex_count}, the number of vertices"),
            ));
        }
        Ok(RawPrimitive {
            vertex_count,
            attributes,
            targets,
            mode,
            triangles,
        })
    }

    fn read_target(
        &self,
        target: &Item<'_>,
        vertex_count: usize,
    ) -> Outcome<Vec<(String, RawAccessor<'_>)>> {
        let mut attributes = Vec::new();
        let Some(map) = target.value.as_object() else {
            return Ok(attributes);
        };
        for name in map.keys() {
            let accessor = target.uint(name)?;
            self.known_accessor(accessor, &target.path_of(name))?;
            let raw = self.accessor(accessor)?;
            if raw.count != vertex_count {
                return Err(Fault::invalid(
                    target.path_of(name),
                    format!("{} elements", raw.count),
                    format!("{vertex_count}, one per vertex"),
                ));
            }
            attributes.push((name.clone(), raw));
        }
        Ok(attributes)
    }

    fn read_indices(&self, item: &Item<'_>) -> Outcome<Option<Vec<u32>>> {
        let Some(accessor) = item.opt_uint("indices")? else {
            return Ok(None);
        };
        let path = item.path_of("indices");
        self.known_accessor(accessor, &path)?;
        let raw = self.accessor(accessor)?;
        match raw.to_indices() {
            Some(indices) => Ok(Some(indices)),
            None => Err(Fault::invalid(
                path,
                format!("{:?} of {:?}", raw.dimensions, raw.component),
                "a scalar accessor of unsigned integers",
            )),
        }
    }

    pub(crate) fn known_accessor(&self, accessor: usize, path: &str) -> Outcome<()> {
        let len = self.root().len_of("accessors")?;
        if accessor < len {
            Ok(())
        } else {
            Err(Fault::invalid(
                path,
                format!("{accessor}"),
                format!("an index into accessors, which has {len}"),
            ))
        }
    }

    fn decode_draco(&self, ext: &Item<'_>) -> Outcome<(Draco, Vec<(String, u32)>)> {
        let view = ext.uint("bufferView")?;
        let bytes = self.view_bytes(view, &self.view_at(view)?)?;
        let limits = self.limits();
        let draco = Draco::decode(bytes, limits.decoded_bytes, limits.triangles)
            .map_err(|found| Fault::invalid(ext.path.clone(), found, "a valid Draco stream"))?;
        let mut ids = Vec::new();
        if let Some(attributes) = ext.opt_object("attributes")? {
            for name in attributes
                .value
                .as_object()
                .into_iter()
                .flat_map(|map| map.keys())
            {
                let id = attributes.uint(name)?;
                let id = u32::try_from(id).map_err(|_| {
                    Fault::invalid(
                        attributes.path_of(name),
                        format!("{id}"),
                        "a 32-bit attribute id",
                    )
                })?;
                ids.push((name.clone(), id));
            }
        }
        Ok((draco, ids))
    }

    fn draco_attribute(
        &self,
        draco: &Draco,
        id: u32,
        accessor: usize,
        path: &str,
    ) -> Outcome<RawAccessor<'_>> {
        self.known_accessor(accessor, path)?;
        let head = self.accessor_head(accessor)?;
        let width = head.dimensions.multiplicity();
        let bytes = draco
            .attribute(id, head.component, width)
            .map_err(|found| {
                Fault::invalid(
                    path,
                    found,
                    format!("{width} components of {:?}", head.component),
                )
            })?;
        Ok(RawAccessor {
            component: head.component,
            dimensions: head.dimensions,
            count: draco.points(),
            normalized: head.normalized,
            bytes: Cow::Owned(bytes),
        })
    }
}

/// The attributes of a primitive: name, accessor, document path.
pub(crate) fn attribute_list(item: &Item<'_>) -> Outcome<Vec<(String, usize, String)>> {
    let Some(attributes) = item.opt_object("attributes")? else {
        return Err(Fault::invalid(
            item.path_of("attributes"),
            "nothing",
            "an object",
        ));
    };
    let names = attributes
        .value
        .as_object()
        .into_iter()
        .flat_map(|map| map.keys());
    names
        .map(|name| {
            Ok((
                name.clone(),
                attributes.uint(name)?,
                attributes.path_of(name),
            ))
        })
        .collect()
}

pub(crate) fn primitive_mode(item: &Item<'_>) -> Outcome<Mode> {
    Ok(match item.opt_uint("mode")? {
        Some(0) => Mode::Points,
        Some(1) => Mode::Lines,
        Some(2) => Mode::LineLoop,
        Some(3) => Mode::LineStrip,
        None | Some(4) => Mode::Triangles,
        Some(5) => Mode::TriangleStrip,
        Some(6) => Mode::TriangleFan,
        Some(n) => {
            return Err(Fault::invalid(
                item.path_of("mode"),
                format!("{n}"),
                "0..=6",
            ));
        }
    })
}

/// Checks the attributes that the normal form reads; others may have any shape.
fn check_shape(name: &str, raw: &RawAccessor<'_>, path: &str) -> Outcome<()> {
    let (dimensions, expected): (&[Dimensions], _) = match name {
        "POSITION" | "NORMAL" => (&[Dimensions::Vec3], "VEC3"),
        "COLOR_0" => (&[Dimensions::Vec3, Dimensions::Vec4], "VEC3 or VEC4"),
        _ if name.starts_with("TEXCOORD_") => (&[Dimensions::Vec2], "VEC2"),
        _ => return Ok(()),
    };
    if dimensions.contains(&raw.dimensions) && raw.component != DataType::U32 {
        return Ok(());
    }
    let found = format!("{:?} of {:?}", raw.dimensions, raw.component);
    Err(Fault::invalid(
        path,
        found,
        format!("{expected} of floats (or of 8- or 16-bit integers)"),
    ))
}

/// Triangles of an index list (glTF 2.0, §3.7.2.1), or of `0..vertices` without one. Incomplete
/// triangles at the end are dropped.
pub(crate) fn unroll(mode: Mode, indices: Option<&[u32]>, vertices: usize) -> Vec<[u32; 3]> {
    let count = indices.map_or(vertices, <[u32]>::len);
    let at = |i: usize| indices.map_or(i as u32, |list| list[i]);
    match mode {
        Mode::Triangles => (0..count / 3)
            .map(|t| [at(3 * t), at(3 * t + 1), at(3 * t + 2)])
            .collect(),
        Mode::TriangleStrip => (0..count.saturating_sub(2))
            .map(|t| [at(t), at(t + 1 + t % 2), at(t + 2 - t % 2)])
            .collect(),
        Mode::TriangleFan => (0..count.saturating_sub(2))
            .map(|t| [at(t + 1), at(t + 2), at(0)])
            .collect(),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Vec::new(),
    }
}
