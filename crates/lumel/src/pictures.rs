//! Pictures of a scene's charts, for `lumel inspect --pictures`.

use atlas::{Layout, LayoutReport, MeshReport, Severity, UvOrigin, shape_of};
use atlas_bake::{Paint, mesh_picture, own_uv_picture, page_picture};
use mesh_ingest::{Scene, Soup};

use crate::error::Error;
use crate::files::NamedFile;

/// Most pages that are drawn, starting with the first.
const PAGES: usize = 8;

/// Most meshes that are drawn: those with problems first, then those with the most lumels. A
/// thousand pictures would fill a disk and would not be looked at.
const MESHES: usize = 32;

/// Data that the pictures are drawn from.
pub(crate) struct Drawn<'a> {
    pub scene: &'a Scene,
    pub soup: &'a Soup,
    pub layout: &'a Layout,
    pub report: &'a LayoutReport,
    pub paint: Paint,
}

impl Drawn<'_> {
    /// PNG files whose names begin with `stem`, and the number of skipped pages and meshes.
    pub(crate) fn pictures(
        &self,
        stem: &str,
        cancelled: impl Fn() -> bool,
    ) -> Result<(Vec<NamedFile>, usize), Error> {
        let mut files = Vec::new();
        let pages = self.layout.pages.len();
        for page in 0..pages.min(PAGES) {
            let bytes = page_picture(self.scene, self.soup, self.layout, page, self.paint)?;
            files.push((format!("{stem}.page{page}.png"), bytes));
            if cancelled() {
                return Err(Error::Cancelled);
            }
        }
        let meshes = self.meshes();
        let left = pages.saturating_sub(PAGES) + meshes.len().saturating_sub(MESHES);
        for (mesh, name, report) in meshes.into_iter().take(MESHES) {
            self.mesh(mesh, &format!("{stem}.{name}"), report, &mut files)?;
            if cancelled() {
                return Err(Error::Cancelled);
            }
        }
        Ok((files, left))
    }

    /// Meshes with lumels, the most interesting first: index in the scene, picture name, report.
    fn meshes(&self) -> Vec<(usize, String, &MeshReport)> {
        let atlases = self.layout.meshes.iter().enumerate();
        let charted = atlases.filter(|(_, atlas)| atlas.size != [0, 0]);
        let mut copies = vec![0usize; self.scene.meshes.len()];
        let mut list: Vec<_> = charted
            .zip(&self.report.meshes)
            .map(|((i, _), report)| {
                // Scene meshes that come from the same mesh of the document are numbered.
                let of = self
                    .scene
                    .meshes
                    .iter()
                    .position(|m| m.gltf_mesh == report.gltf_mesh);
                let copy = of.map_or(0, |of| {
                    copies[of] += 1;
                    copies[of]
                });
                let mut name = format!("mesh{}", report.gltf_mesh);
                if copy > 1 {
                    name += &format!("-{copy}");
                }
                (i, name, report)
            })
            .collect();
        let rank = |report: &MeshReport| {
            let worst = report.uv_faults.iter().map(|f| f.severity).max();
            let texels = f64::from(report.size[0]) * f64::from(report.size[1]);
            (worst.unwrap_or(Severity::Note), texels * report.utilisation)
        };
        list.sort_by(|a, b| {
            let (a, b) = (rank(a.2), rank(b.2));
            b.0.cmp(&a.0).then(b.1.total_cmp(&a.1))
        });
        list
    }

    /// The charts of one mesh, and its own coordinates if they were replaced.
    fn mesh(
        &self,
        mesh: usize,
        name: &str,
        report: &MeshReport,
        files: &mut Vec<NamedFile>,
    ) -> Result<(), Error> {
        let (own, atlas) = (&self.scene.meshes[mesh], &self.layout.meshes[mesh]);
        let replaced = matches!(report.origin, UvOrigin::Replaced { .. });
        let faults = if replaced { &[] } else { &report.uv_faults[..] };
        let placed = |i: &&mesh_ingest::Instance| i.mesh == mesh && i.node == report.node;
        let instance = self.scene.instances.iter().find(placed);
        let shape = instance.map_or(glam::DMat3::IDENTITY, |i| shape_of(&i.transform));
        let wanted = self.report.texels_per_unit;
        let bytes = mesh_picture(own, atlas, shape, wanted, faults, self.paint)?;
        files.push((format!("{name}.png"), bytes));
        if replaced {
            let bytes = own_uv_picture(own, &report.uv_faults)?;
            files.push((format!("{name}.uv1.png"), bytes));
        }
        Ok(())
    }
}
