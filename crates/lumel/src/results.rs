//! A bake's results in memory.

use atlas_bake::{
    GlbOptions, Manifest, Page, suggested_exposure, write_lightmapped_glb_with, write_vertex_glb,
};

use crate::baker::Baker;
use crate::error::Error;
use crate::pipeline::Bake;

/// Baked light at the vertices of one primitive of one node.
///
/// ```no_run
/// let bake = lumel::Baker::new().bake("level.glb")?;
/// for colors in bake.vertex_colors() {
///     println!("{}: {} vertices", colors.name, colors.irradiance.len());
/// }
/// # Ok::<(), lumel::Error>(())
/// ```
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct VertexColors<'b> {
    /// Index of the glTF node.
    pub node: usize,
    /// The node's name, or empty.
    pub name: &'b str,
    /// Index of the `EXT_mesh_gpu_instancing` copy, if the node has any.
    pub copy: Option<u32>,
    /// Index of the glTF mesh.
    pub mesh: usize,
    /// Index among the mesh's primitives.
    pub primitive: usize,
    /// Irradiance E (lx or W/m²), linear Rec.709: first the vertices of the document's accessors,
    /// then those added by splitting (`Settings::vertex_error`). The outgoing radiance is
    /// `E × albedo / π`.
    pub irradiance: &'b [[f32; 3]],
}

impl Bake {
    /// Options for a bake; the same as [`Baker::new`].
    pub fn builder<'a>() -> Baker<'a> {
        Baker::new()
    }

    /// Lightmap pages: R = E/π per texel unless [`Settings::value`](crate::Settings::value) says
    /// otherwise. Linear Rec.709, row 0 at the top, with coverage and the requested layers
    /// ([`Page::channel`]).
    ///
    /// ```
    /// use lumel::{Baker, Quality};
    ///
    /// let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
    /// let bake = Baker::new().quality(Quality::Draft).texels_per_unit(2.0).bake(scene)?;
    /// for page in bake.pages() {
    ///     assert_eq!(page.value.len(), (page.width * page.height) as usize);
    ///     let lumels = page.coverage.iter().filter(|c| **c > 0.0).count();
    ///     println!("{lumels} lumels on {} x {} texels", page.width, page.height);
    /// }
    /// # Ok::<(), lumel::Error>(())
    /// ```
    pub fn pages(&self) -> &[Page] {
        &self.baked.pages
    }

    /// Name and pages of each light group, in the order of the settings, `rest` last. Their pages
    /// sum to [`pages`](Self::pages).
    pub fn groups(&self) -> impl Iterator<Item = (&str, &[Page])> {
        let pages = self.baked.groups.iter().map(|p| &p[..]);
        self.group_names.iter().map(String::as_str).zip(pages)
    }

    /// The suggested exposure, from radiance to a screen's values, 1 being white:
    /// [`suggested_exposure`] of [`pages`](Self::pages).
    pub fn exposure(&self) -> f64 {
        suggested_exposure(&self.baked.pages, self.value)
    }

    /// The rectangle of each node on the pages, as in `level.lightmap.json`.
    ///
    /// # Errors
    /// [`Error::Output`] if a node's rectangle cannot be determined.
    pub fn manifest(&self) -> Result<Manifest, Error> {
        let glb = format!("{}.glb", self.stem);
        let scene = &self.loaded.scene;
        let mut manifest =
            Manifest::new(scene, &self.layout, &glb, &self.page_names(), self.value)?;
        manifest.exposure = Some(self.exposure());
        Ok(manifest)
    }

    /// Light at the vertices of everything that receives light, in the order of instances and
    /// primitives; empty if [`Settings::vertex_colors`](crate::Settings::vertex_colors) is false.
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

    /// The scene with lightmap coordinates and `extras.lightmap`, as in `level.glb`.
    ///
    /// # Errors
    /// [`Error::Output`] if the document cannot be written, e.g. because an image file was deleted.
    pub fn lightmapped_glb(&self) -> Result<Vec<u8>, Error> {
        let (document, scene) = (&self.loaded.document, &self.loaded.scene);
        let uris = self.page_names();
        let options = GlbOptions {
            value: self.value,
            exposure: Some(self.exposure()),
            ..GlbOptions::default()
        };
        let (bytes, _) =
            write_lightmapped_glb_with(document, scene, &self.layout, &uris, &options)?;
        Ok(bytes)
    }

    /// The scene with baked vertex colours, as in `level.vertex.glb`.
    ///
    /// # Errors
    /// As [`lightmapped_glb`](Self::lightmapped_glb); [`Error::Setting`] if
    /// [`Settings::vertex_colors`](crate::Settings::vertex_colors) is false.
    pub fn vertex_glb(&self) -> Result<Vec<u8>, Error> {
        if !self.report.settings.vertex_colors {
            return Err(Error::Setting(
                "the bake has no vertex colours: expected Settings::vertex_colors".into(),
            ));
        }
        let (document, scene) = (&self.loaded.document, &self.loaded.scene);
        Ok(write_vertex_glb(document, scene, &self.baked.vertices)?.0)
    }
}
