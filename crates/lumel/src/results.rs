//! A bake's results in memory.

use atlas_bake::{Manifest, Page, write_lightmapped_glb, write_vertex_glb};

use crate::baker::Baker;
use crate::error::Error;
use crate::pipeline::Bake;

/// Light at the vertices of one primitive of one node.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct VertexColors<'b> {
    /// Index of the glTF node.
    pub node: usize,
    /// The node's name, or empty.
    pub name: &'b str,
    /// Which `EXT_mesh_gpu_instancing` copy of the node.
    pub copy: Option<u32>,
    /// Index of the glTF mesh.
    pub mesh: usize,
    /// Index among the mesh's primitives.
    pub primitive: usize,
    /// Irradiance E (lx or W/m²), linear Rec.709: by vertex of the document's accessors, then of
    /// vertices that splitting added (`Settings::vertex_error`). `E × albedo / π` is the radiance
    /// that is seen.
    pub irradiance: &'b [[f32; 3]],
}

impl Bake {
    /// Options for a bake: the same as [`Baker::new`].
    pub fn builder<'a>() -> Baker<'a> {
        Baker::new()
    }

    /// Lightmap pages: R = E/π by texel unless [`Settings::value`](crate::Settings::value) says
    /// otherwise, linear Rec.709, row 0 at the top, with coverage and the layers asked for
    /// ([`Page::channel`]).
    pub fn pages(&self) -> &[Page] {
        &self.baked.pages
    }

    /// Light groups in the order of settings, `rest` last: name and pages. Their pages sum to
    /// [`pages`](Self::pages).
    pub fn groups(&self) -> impl Iterator<Item = (&str, &[Page])> {
        let pages = self.baked.groups.iter().map(|p| &p[..]);
        self.group_names.iter().map(String::as_str).zip(pages)
    }

    /// Where each node's light lies on the pages, as `level.lightmap.json` has it.
    ///
    /// # Errors
    /// [`Error::Output`] where a node's place cannot be told.
    pub fn manifest(&self) -> Result<Manifest, Error> {
        let glb = format!("{}.glb", self.stem);
        let scene = &self.loaded.scene;
        Ok(Manifest::new(
            scene,
            &self.layout,
            &glb,
            &self.page_names(),
            self.value,
        )?)
    }

    /// Light at vertices, of everything that receives light, in the order of instances and
    /// primitives; nothing where [`Settings::vertex_colors`](crate::Settings::vertex_colors) leaves
    /// it out.
    pub fn vertex_colors(&self) -> impl Iterator<Item = VertexColors<'_>> {
        let scene = &self.loaded.scene;
        let lit = self.baked.vertices.instances.iter().enumerate();
        lit.flat_map(move |(i, lit)| {
            let instance = &scene.instances[i];
            let mesh = &scene.meshes[instance.mesh];
            let lit = lit.iter().enumerate();
            lit.filter(move |(p, _)| scene.receives(i, *p))
                .map(move |(p, irradiance)| VertexColors {
                    node: instance.node,
                    name: &instance.name,
                    copy: instance.copy,
                    mesh: mesh.gltf_mesh,
                    primitive: mesh.primitives[p].gltf_primitive,
                    irradiance,
                })
        })
    }

    /// The scene with lightmap coordinates and `extras.lightmap`, as `level.glb` holds it.
    ///
    /// # Errors
    /// [`Error::Output`] where the document's parts cannot be written, e.g. as an image's file has
    /// gone.
    pub fn lightmapped_glb(&self) -> Result<Vec<u8>, Error> {
        let (document, scene) = (&self.loaded.document, &self.loaded.scene);
        let uris = self.page_names();
        let (bytes, _) = write_lightmapped_glb(document, scene, &self.layout, &uris, self.value)?;
        Ok(bytes)
    }

    /// The scene with baked vertex colours, as `level.vertex.glb` holds it.
    ///
    /// # Errors
    /// As [`lightmapped_glb`](Self::lightmapped_glb); [`Error::Setting`] where
    /// [`Settings::vertex_colors`](crate::Settings::vertex_colors) leaves vertex colours out.
    pub fn vertex_glb(&self) -> Result<Vec<u8>, Error> {
        if !self.report.settings.vertex_colors {
            return Err(Error::Setting(
                "the bake left vertex colours out: expected Settings::vertex_colors".into(),
            ));
        }
        let (document, scene) = (&self.loaded.document, &self.loaded.scene);
        Ok(write_vertex_glb(document, scene, &self.baked.vertices)?.0)
    }
}
