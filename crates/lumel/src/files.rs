//! The files that a bake writes.

use std::path::{Path, PathBuf};

use atlas_bake::{
    ExrOptions, GlbOptions, Ktx2Format, LitScene, ManifestGroup, ManifestReflection, MixedLight,
    OutputSet, Page, PictureLight, PngFormat, ProbeFile, choose_camera, render_preview,
    scene_camera, write_lightmap_exr, write_lightmap_ktx2, write_lightmap_png,
    write_lightmapped_glb_with, write_mask_ktx2, write_probe_volume, write_reflection_ktx2,
    write_vertex_glb,
};
use mesh_ingest::{Digest, Soup};
use radiosity::Phase;
use visibility::{BuildOptions, Bvh};

use crate::clock::Clock;
use crate::error::Error;
use crate::level_record::LevelRecord;
use crate::memory;
use crate::overwrite;
use crate::pipeline::Bake;
use crate::record::{self, PREVIEW, Provenance, ReadFile, RecordedInput, RecordedOutput};
use crate::report::{Blank, Measured, Report, StoredPage, StoredPng};
use crate::settings::{BakeMode, GltfExt, Settings};
use crate::sources;

/// An output file: name and bytes.
pub type NamedFile = (String, Vec<u8>);

/// Names of the files that a bake of `scene` writes, with only the first page; the report is last.
pub fn output_names(scene: &Path, settings: &Settings) -> Vec<String> {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    let mut ends = vec!["lightmap.exr", "glb"];
    ends.extend(settings.vertex_colors.then_some(VERTEX));
    ends.push("lightmap.json");
    ends.extend(settings.ktx2.map(|_| "lightmap.ktx2"));
    ends.extend(settings.png.map(|_| "lightmap.png"));
    if settings.mode == BakeMode::Shadowmask {
        ends.push("shadowmask.exr");
        ends.extend(settings.ktx2.map(|_| "shadowmask.ktx2"));
    }
    ends.extend(settings.probes.as_ref().map(|_| PROBES));
    ends.extend((settings.probes.is_some() && settings.probe_volume).then_some(VOLUME));
    let mut names: Vec<String> = ends.iter().map(|end| format!("{stem}.{end}")).collect();
    let groups = settings.groups.iter().map(|g| g.name.as_str());
    let rest = (!settings.groups.is_empty()).then_some(sources::REST);
    for g in groups.chain(rest) {
        names.push(format!("{stem}.group.{g}.exr"));
        names.extend(settings.ktx2.map(|_| format!("{stem}.group.{g}.ktx2")));
    }
    names.push(format!("{stem}.report.json"));
    names
}

/// Ending of the name of the scene with vertex colours.
const VERTEX: &str = "vertex.glb";

/// Ending of the name of the probe file, and of its volume texture.
pub(crate) const PROBES: &str = "probes.json";
pub(crate) const VOLUME: &str = "probes.ktx2";

/// Name of the file with page `i`.
pub(crate) fn page_name(stem: &str, what: &str, i: usize, end: &str) -> String {
    match i {
        0 => format!("{stem}.{what}.{end}"),
        i => format!("{stem}.{what}.{i}.{end}"),
    }
}

impl Bake {
    /// Names of the page files, in order.
    pub fn page_names(&self) -> Vec<String> {
        self.numbered("lightmap", "exr")
    }

    /// Names of a light group's page files, in order.
    pub fn group_page_names(&self, group: &str) -> Vec<String> {
        self.numbered(&format!("group.{group}"), "exr")
    }

    /// One name for each page.
    fn numbered(&self, what: &str, end: &str) -> Vec<String> {
        (0..self.layout.pages.len())
            .map(|i| page_name(&self.stem, what, i, end))
            .collect()
    }

    /// Name of the report file.
    pub fn report_name(&self) -> String {
        format!("{}.report.json", self.stem)
    }

    /// All output files with their names, and the completed report, which is the last file.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn files(&self) -> Result<(Vec<NamedFile>, Report), Error> {
        self.files_beside(None)
    }

    /// As [`files`](Bake::files), for a bake with a preview picture: the report records its hash.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn files_beside(&self, preview: Option<&[u8]>) -> Result<(Vec<NamedFile>, Report), Error> {
        let mut clock = self.clock.clone();
        let mut report = self.report.clone();
        let uris = self.page_names();
        let scene = &self.loaded.scene;
        let mut files = Vec::new();
        for (page, name) in self.baked.pages.iter().zip(&uris) {
            let (bytes, stats) = write_lightmap_exr(page, &ExrOptions::default())?;
            files.push((name.clone(), bytes));
            report.clamped.push(stats);
        }
        let settings = &self.report.settings;
        let ktx2 = (settings.ktx2).map(|format| (format, self.numbered("lightmap", "ktx2")));
        if let Some((format, names)) = &ktx2 {
            self.write_ktx2(*format, &self.baked.pages, names, &mut files, &mut report)?;
        }
        for (group, pages) in self.group_names.iter().zip(&self.baked.groups) {
            for (page, name) in pages.iter().zip(self.group_page_names(group)) {
                let (bytes, _) = write_lightmap_exr(page, &ExrOptions::default())?;
                files.push((name, bytes));
            }
            if let Some((format, _)) = ktx2 {
                let names = self.numbered(&format!("group.{group}"), "ktx2");
                self.write_ktx2(format, pages, &names, &mut files, &mut report)?;
            }
        }
        let png = self.write_png(&mut files, &mut report)?;
        let mixed = self.write_masks(ktx2.is_some(), &mut files)?;
        let moz = settings.ext.contains(&GltfExt::Moz);
        let reflections = self.write_reflections(&mut files)?;
        let options = GlbOptions {
            value: self.value,
            exposure: Some(self.exposure()),
            ktx2: (ktx2.as_ref()).map(|(format, names)| (*format, &names[..])),
            moz: moz.then_some(&self.baked.pages[..]),
            mixed: mixed.as_ref(),
            reflections: &reflections,
        };
        let (bytes, stats) = write_lightmapped_glb_with(
            &self.loaded.document,
            scene,
            &self.layout,
            &uris,
            &options,
        )?;
        files.push((format!("{}.glb", self.stem), bytes));
        if stats.moz_left_out > 0 {
            report.warnings.push(format!(
                "{} EXT_mesh_gpu_instancing copies have no MOZ_lightmap, because they share their node's materials",
                stats.moz_left_out
            ));
        }
        if settings.vertex_colors {
            let (bytes, _) = write_vertex_glb(&self.loaded.document, scene, &self.baked.vertices)?;
            files.push((format!("{}.{VERTEX}", self.stem), bytes));
        }
        let mut manifest = self.manifest()?;
        if let Some(page) = self.baked.pages.first() {
            manifest.channels = page.layers.iter().map(|(name, _)| name.clone()).collect();
        }
        if let Some((format, names)) = &ktx2 {
            manifest.set_ktx2(*format, names);
        }
        if let Some((format, scale)) = png {
            manifest.set_png(format, scale, &self.numbered("lightmap", "png"));
        }
        if let Some(mixed) = &mixed {
            manifest.set_mixed(mixed);
        }
        manifest.reflections = reflections;
        if moz {
            manifest.set_coordinates_on_page();
        }
        manifest.groups = (self.group_names.iter())
            .map(|name| ManifestGroup {
                name: name.clone(),
                pages: self.group_page_names(name),
                ktx2: match ktx2 {
                    Some(_) => self.numbered(&format!("group.{name}"), "ktx2"),
                    None => Vec::new(),
                },
            })
            .collect();
        files.push((format!("{}.lightmap.json", self.stem), manifest.to_json()));
        self.write_probes(&mut files)?;
        files.extend(self.kept.iter().flat_map(|kept| kept.files.iter().cloned()));
        self.record(&files, preview, &mut report);
        clock.lap(Phase::Write);
        report.measured = self.measure(clock);
        files.push((self.report_name(), report.to_json()));
        Ok((files, report))
    }

    /// Adds the pages as KTX2, and their compression errors to the report.
    fn write_ktx2(
        &self,
        format: Ktx2Format,
        pages: &[Page],
        names: &[String],
        files: &mut Vec<NamedFile>,
        report: &mut Report,
    ) -> Result<(), Error> {
        for (page, name) in pages.iter().zip(names) {
            let (bytes, stored) = write_lightmap_ktx2(page, format)?;
            files.push((name.clone(), bytes));
            report.ktx2.push(StoredPage {
                file: name.clone(),
                stored,
            });
        }
        Ok(())
    }

    /// Adds the pages as PNG, and their errors to the report. Returns their format and scale.
    fn write_png(
        &self,
        files: &mut Vec<NamedFile>,
        report: &mut Report,
    ) -> Result<Option<(PngFormat, f32)>, Error> {
        let Some(format) = self.report.settings.png else {
            return Ok(None);
        };
        let scale = format.scale(&self.baked.pages, self.exposure());
        let names = self.numbered("lightmap", "png");
        for (page, name) in self.baked.pages.iter().zip(&names) {
            let (bytes, stored) = write_lightmap_png(page, format, scale)?;
            files.push((name.clone(), bytes));
            let file = name.clone();
            report.png.push(StoredPng { file, stored });
        }
        Ok(Some((format, scale)))
    }

    /// Adds the cube maps of reflection captures.
    fn write_reflections(
        &self,
        files: &mut Vec<NamedFile>,
    ) -> Result<Vec<ManifestReflection>, Error> {
        let scene = &self.loaded.scene;
        let mut listed = Vec::with_capacity(self.reflections.len());
        for (i, (point, cube)) in scene.reflections.iter().zip(&self.reflections).enumerate() {
            let uri = page_name(&self.stem, "reflection", i, "ktx2");
            files.push((uri.clone(), write_reflection_ktx2(cube)?));
            listed.push(ManifestReflection {
                node: point.node,
                name: point.name.clone(),
                position: (point.position.as_dvec3() + scene.origin).to_array(),
                uri,
            });
        }
        Ok(listed)
    }

    /// Adds probes, and their volume texture.
    fn write_probes(&self, files: &mut Vec<NamedFile>) -> Result<(), Error> {
        let Some(probes) = &self.probes else {
            return Ok(());
        };
        let (name, volume) = (
            format!("{}.{PROBES}", self.stem),
            format!("{}.{VOLUME}", self.stem),
        );
        match probes.grid {
            Some(grid) if self.report.settings.probe_volume => {
                let with = ProbeFile {
                    volume: Some(grid.volume(&volume)),
                    ..probes.clone()
                };
                files.push((name, with.to_json()));
                files.push((volume, write_probe_volume(probes)?));
            }
            _ => files.push((name, probes.to_json())),
        }
        Ok(())
    }

    /// Adds shadow masks. Returns the manifest's entries about lamps that are left out.
    fn write_masks(
        &self,
        ktx2: bool,
        files: &mut Vec<NamedFile>,
    ) -> Result<Option<MixedLight>, Error> {
        let Some(mut mixed) = self.mixed.clone() else {
            return Ok(None);
        };
        if self.baked.masks.is_empty() {
            return Ok(Some(mixed));
        }
        mixed.masks = self.numbered("shadowmask", "exr");
        for (page, name) in self.baked.masks.iter().zip(&mixed.masks) {
            let (bytes, _) = write_lightmap_exr(page, &ExrOptions::default())?;
            files.push((name.clone(), bytes));
        }
        if ktx2 {
            mixed.ktx2 = self.numbered("shadowmask", "ktx2");
            for (page, name) in self.baked.masks.iter().zip(&mixed.ktx2) {
                files.push((name.clone(), write_mask_ktx2(page)?));
            }
        }
        Ok(Some(mixed))
    }

    /// Completes the record of inputs and outputs.
    fn record(&self, files: &[NamedFile], preview: Option<&[u8]>, report: &mut Report) {
        let content = &mut report.content;
        // Queried only now, because writers also read images that light does not need.
        content.inputs = record::document_inputs(&report.scene, self.loaded.document.inputs());
        content.inputs.extend(self.option_inputs.iter().cloned());
        content.key = record::key(&report.settings, &report.origins, &content.inputs);
        content.level = LevelRecord::of(&self.loaded, &self.layout, &self.changes);
        let kept = self.kept.as_ref().map(|kept| (&kept.level, &kept.anew[..]));
        content.level.settle(&content.key, kept);
        if kept.is_some() {
            content.key = record::mixed_key(&content.level);
        }
        let files = files
            .iter()
            .map(|(name, bytes)| (name.as_str(), &bytes[..]));
        content.outputs = files
            .chain(preview.map(|bytes| (PREVIEW, bytes)))
            .map(|(file, bytes)| RecordedOutput {
                file: file.into(),
                digest: Digest::of(bytes),
            })
            .collect();
    }

    /// Writes all files into `dir`. Until all are complete, files of an earlier bake stay
    /// unchanged.
    ///
    /// # Errors
    /// [`Error::Output`]; [`Error::Overwrite`] if one of them is a file that the scene was read
    /// from.
    pub fn write(&self, dir: impl AsRef<Path>) -> Result<Vec<PathBuf>, Error> {
        let (files, _) = self.files()?;
        let dir = dir.as_ref();
        let outputs: Vec<PathBuf> = files.iter().map(|(name, _)| dir.join(name)).collect();
        overwrite::refuse_inputs(&outputs, &self.loaded.document.inputs_on_disk())?;
        let mut set = OutputSet::create(dir)?;
        for (name, bytes) in &files {
            set.add(name, bytes)?;
        }
        self.retire_pages(&mut set);
        Ok(set.commit()?.files().map(Path::to_owned).collect())
    }

    /// Paths of all existing files that were read from disk, for a dependency file. Complete only
    /// after the output files were made.
    pub fn input_paths(&self, settings: &Settings, provenance: &Provenance) -> Vec<PathBuf> {
        let mut all = self.loaded.document.inputs_on_disk();
        let scene = self.loaded.document.file();
        let locate = |i| record::locate(scene, settings, provenance, i);
        all.extend(self.option_inputs.iter().filter_map(locate));
        all
    }

    /// Every input file with its hash when it was read, missing files included, for programs that
    /// wait for one of them to change. Complete once the output files were made.
    pub fn files_read(&self, settings: &Settings, provenance: &Provenance) -> Vec<ReadFile> {
        let document = &self.loaded.document;
        let mut all = record::document_inputs(&self.report.scene, document.inputs());
        all.extend(self.option_inputs.iter().cloned());
        let read = |input: RecordedInput| {
            Some(ReadFile {
                path: record::locate(document.file(), settings, provenance, &input)?,
                digest: input.digest,
            })
        };
        all.into_iter().filter_map(read).collect()
    }

    /// Deletes files of an earlier bake that this one does not replace: further pages, KTX2 files
    /// and vertex colours. They would show outdated light.
    pub fn retire_pages(&self, set: &mut OutputSet) {
        // Other tools write such files too, e.g. KTX2 from EXR. Only files listed in the last
        // report are deleted.
        let report = set.dir().join(self.report_name());
        let vertex = format!("{}.{VERTEX}", self.stem);
        for name in record::outputs_of(&report) {
            let mask = format!("{}.shadowmask.", self.stem);
            let ours = name.ends_with(".ktx2")
                || name.ends_with(".png")
                || name == vertex
                || name.starts_with(&mask);
            if ours && Path::new(&name).file_name() == Some(name.as_ref()) {
                set.remove_obsolete(&name);
            }
        }
        for i in self.layout.pages.len()..self.layout.pages.len() + 64 {
            set.remove_obsolete(&format!("{}.lightmap.{i}.exr", self.stem));
            for group in &self.group_names {
                set.remove_obsolete(&format!("{}.group.{group}.{i}.exr", self.stem));
            }
        }
    }

    /// A picture of the lit level as PNG, from the document's first camera or else from a place
    /// that sees much of it.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn preview(&self, size: [u32; 2]) -> Result<Vec<u8>, Error> {
        let scene = &self.loaded.scene;
        // Rebuilt, because keeping the tree during the bake would cost a large level memory while
        // files are written.
        let soup = Soup::build(scene);
        let bvh = Bvh::build(
            soup.seen_triangles(),
            |t| scene.needs_alpha(soup.materials[t as usize]),
            &BuildOptions::default(),
        )
        .map_err(|e| Error::Internal(format!("cannot build the tree: {e}")))?;
        let lit = LitScene {
            scene,
            soup: &soup,
            bvh: &bvh,
            light: PictureLight::Pages {
                layout: &self.layout,
                pages: &self.baked.pages,
                value: self.value,
            },
        };
        let camera =
            scene_camera(&self.loaded.document, scene).unwrap_or_else(|| choose_camera(&lit));
        Ok(render_preview(&lit, &camera, size)?)
    }

    fn measure(&self, clock: Clock) -> Measured {
        let seconds_in = |names: &[&str]| -> f64 {
            clock
                .phases
                .iter()
                .filter(|p| names.contains(&p.phase))
                .map(|p| p.seconds)
                .sum()
        };
        let rays = self.report.solve.link_rays
            + self.report.solve.shadow_rays
            + self.report.gather.light.lumel_rays
            + self.report.gather.vertices.map_or(0, |v| v.rays)
            + self.report.probes.as_ref().map_or(0, |p| p.rays);
        Measured {
            threads: rayon::current_num_threads(),
            seconds: (clock.last - clock.start).as_secs_f64(),
            mrays_per_second: rays as f64 * 1e-6
                / seconds_in(&["solve", "gather", "probes"]).max(1e-9),
            peak_bytes: memory::peak_bytes(),
            phases: clock.phases,
            cache: self.report.measured.cache.clone(),
            digest: Blank,
        }
    }
}
