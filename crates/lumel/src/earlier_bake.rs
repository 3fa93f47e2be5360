//! Reads the results of an earlier bake, for a bake of a part of the level.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atlas::Layout;
use atlas_bake::{Earlier, Page, read_exr};
use gather::VertexLight;
use mesh_ingest::{Digest, Document, LoadOptions, Scene, read_regular};
use serde::Deserialize;
use serde_json::Value;

use crate::error::Error;
use crate::files::{NamedFile, PROBES, VOLUME, page_name};
use crate::folder::MAX_JSON;
use crate::joints::Order;
use crate::level_record::{InstanceRecord, LevelRecord, add_places};
use crate::named::some_of;
use crate::record::{PROGRAM, RecordedInput, hash_file, key, locate, read_inputs};
use crate::settings::{BakeMode, Settings};
use crate::sources::REST;

/// The results of an earlier bake of a level.
pub(crate) struct EarlierBake {
    dir: PathBuf,
    stem: String,
    report: PathBuf,
    /// Hashes of the results, by file name.
    outputs: BTreeMap<String, Digest>,
    inputs: Vec<RecordedInput>,
    pages: Vec<[u32; 2]>,
    pub level: LevelRecord,
}

/// What is read of a report's record.
#[derive(Deserialize)]
struct Content {
    outputs: Vec<Output>,
    level: LevelRecord,
}

#[derive(Deserialize)]
struct Output {
    file: String,
    digest: String,
}

fn fault(path: &Path, message: impl Into<String>, io: bool) -> Error {
    Error::Folder {
        path: path.to_owned(),
        message: message.into(),
        io,
    }
}

const ANEW: &str = "bake the whole level anew, without --only";

impl EarlierBake {
    /// Reads the report of the results in `dir`, and refuses those of another program or of other
    /// settings.
    ///
    /// # Errors
    /// [`Error::Folder`].
    pub fn open(dir: &Path, order: Order<'_>) -> Result<EarlierBake, Error> {
        let stem = order.scene.file_stem().unwrap_or_default();
        let stem = stem.to_string_lossy().into_owned();
        let path = dir.join(format!("{stem}.report.json"));
        let bytes = read_regular(&path, MAX_JSON).map_err(|e| {
            let message = format!("--only needs the results of an earlier bake: {e}");
            fault(&path, message, true)
        })?;
        let broken = || {
            let message =
                format!("found a report that was changed or is of another version; {ANEW}");
            fault(&path, message, false)
        };
        let v = crate::report::parse_sealed(&bytes).ok_or_else(broken)?;
        let content = Content::deserialize(&v["content"]).map_err(|_| broken())?;
        if content.level.program != PROGRAM || !content.level.is_whole() {
            let found = &content.level.program;
            let message =
                format!("found a bake of lumel {found}, expected one of lumel {PROGRAM}; {ANEW}");
            return Err(fault(&path, message, false));
        }
        if let Some(differs) = other_settings(&v["settings"], order.settings) {
            let message = format!("found other settings in the earlier bake ({differs}); {ANEW}");
            return Err(fault(&path, message, false));
        }
        let mut outputs = BTreeMap::new();
        for output in content.outputs {
            outputs.insert(output.file, output.digest.parse().map_err(|()| broken())?);
        }
        Ok(EarlierBake {
            dir: dir.to_owned(),
            stem,
            outputs,
            inputs: read_inputs(&v["content"]["inputs"]).ok_or_else(broken)?,
            pages: serde_json::from_value(v["layout"]["pages"].clone()).map_err(|_| broken())?,
            level: content.level,
            report: path,
        })
    }

    fn refuse(&self, message: String) -> Error {
        fault(&self.report, message, false)
    }

    /// Whether the results are as they were written, and the light of these instances is what a bake
    /// of the present files would give.
    pub fn is_current(&self, order: Order<'_>, anew: &[usize]) -> bool {
        let same = |input: &RecordedInput| {
            let file = locate(order.scene, order.settings, order.provenance, input);
            file.is_some_and(|file| hash_file(&file) == input.digest)
        };
        let key = key(order.settings, &order.provenance.origins, &self.inputs);
        let level = &self.level;
        let of_now = |i: &usize| level.bakes[level.instances[*i].bake] == key;
        let beside = |name: &&String| Path::new(name).file_name() == Some(name.as_ref());
        let mut results = self.outputs.keys().filter(beside);
        let whole = results.all(|name| self.whole(name).is_ok());
        whole && anew.iter().all(of_now) && self.inputs.iter().all(same)
    }

    /// Refuses geometry other than that of the earlier bake, apart from that of the `named`
    /// instances.
    ///
    /// # Errors
    /// [`Error::Folder`] with the names of what changed.
    pub fn check_geometry(&self, now: &[InstanceRecord], named: &[usize]) -> Result<(), Error> {
        let was = &self.level.instances;
        let same = |a: &InstanceRecord, b: &InstanceRecord| (&a.name, a.copy) == (&b.name, b.copy);
        let alike = was.len() == now.len() && was.iter().zip(now).all(|(a, b)| same(a, b));
        if !alike {
            let added = some_of(lacking(now, was));
            let gone = some_of(lacking(was, now));
            let told = match (&added[..], &gone[..]) {
                ("", "") => "its nodes are in another order".into(),
                (added, "") => format!("it lacks {added}"),
                ("", gone) => format!("it has {gone}, which the level lacks"),
                (added, gone) => format!("it lacks {added}, and has {gone}, which the level lacks"),
            };
            return Err(self.refuse(format!(
                "found an earlier bake of other nodes with meshes: {told}; {ANEW}"
            )));
        }
        let moved = (0..now.len())
            .filter(|&i| was[i].geometry != now[i].geometry)
            .filter(|i| named.binary_search(i).is_err())
            .map(|i| label(&now[i]));
        let moved = some_of(moved);
        if moved.is_empty() {
            return Ok(());
        }
        Err(self.refuse(format!(
            "found that the geometry of {moved} changed since the earlier bake, expected only that of \
             the nodes named by --only: name it too, or {ANEW}"
        )))
    }

    /// Refuses a layout in which others than the `anew` instances changed their places. `now` are
    /// the instances, to which places are added.
    ///
    /// # Errors
    /// [`Error::Folder`] with the names of what changed.
    pub fn check_places(
        &self,
        (scene, layout): (&Scene, &Layout),
        mut now: Vec<InstanceRecord>,
        anew: &[usize],
    ) -> Result<(), Error> {
        add_places(&mut now, scene, layout);
        let was = &self.level.instances;
        let moved = (0..now.len())
            .filter(|&i| was[i].place != now[i].place && scene.has_lumels(i))
            .filter(|i| anew.binary_search(i).is_err())
            .map(|i| label(&now[i]));
        let moved = some_of(moved);
        if moved.is_empty() && layout.pages == self.pages {
            return Ok(());
        }
        let told = match &moved[..] {
            "" => "pages of other sizes".to_owned(),
            moved => format!("other places of {moved} on the pages"),
        };
        Err(self.refuse(format!(
            "found {told} than in the earlier bake, because the size of something changed; {ANEW}"
        )))
    }

    /// The path of a result, which is as it was written.
    fn whole(&self, name: &str) -> Result<PathBuf, Error> {
        let path = self.dir.join(name);
        let expected = self.outputs.get(name);
        match hash_file(&path) {
            Some(found) if Some(&found) == expected => Ok(path),
            Some(_) => Err(fault(
                &path,
                format!("found another file than the earlier bake wrote; {ANEW}"),
                false,
            )),
            None => Err(fault(&path, format!("found no file; {ANEW}"), true)),
        }
    }

    fn read_pages(&self, what: &str) -> Result<Vec<Page>, Error> {
        let one = |i: usize| {
            let path = self.whole(&page_name(&self.stem, what, i, "exr"))?;
            let page = page_of(&path)?;
            match [page.width, page.height] == self.pages[i] {
                true => Ok(page),
                false => Err(fault(
                    &path,
                    format!("found a page of another size; {ANEW}"),
                    false,
                )),
            }
        };
        (0..self.pages.len()).map(one).collect()
    }

    /// The light of the earlier bake.
    ///
    /// # Errors
    /// [`Error::Folder`] if a result is missing or was changed.
    pub fn read(
        &self,
        scene: &Scene,
        settings: &Settings,
        anew: Vec<usize>,
    ) -> Result<Earlier, Error> {
        let groups = settings.groups.iter().map(|g| g.name.as_str());
        let rest = (!settings.groups.is_empty()).then_some(REST);
        let groups: Result<Vec<_>, Error> = (groups.chain(rest))
            .map(|name| self.read_pages(&format!("group.{name}")))
            .collect();
        let masks = page_name(&self.stem, "shadowmask", 0, "exr");
        let masked = settings.mode == BakeMode::Shadowmask && self.outputs.contains_key(&masks);
        Ok(Earlier {
            pages: self.read_pages("lightmap")?,
            groups: groups?,
            masks: match masked {
                true => self.read_pages("shadowmask")?,
                false => Vec::new(),
            },
            vertices: match settings.vertex_colors {
                true => self.read_vertices(scene, settings, &anew)?,
                false => VertexLight::default(),
            },
            anew,
        })
    }

    /// Irradiance at the vertices of instances that are not baked anew.
    fn read_vertices(
        &self,
        scene: &Scene,
        settings: &Settings,
        anew: &[usize],
    ) -> Result<VertexLight, Error> {
        let path = self.whole(&format!("{}.vertex.glb", self.stem))?;
        let options = LoadOptions {
            limits: settings.bounds.limits(),
            ..LoadOptions::default()
        };
        // Files that its lamps name are beside the level, not beside the results.
        let document = &Document::open(&path, &options)?;
        let mut out = VertexLight {
            instances: vec![Vec::new(); scene.instances.len()],
            split: Vec::new(),
        };
        for (i, instance) in scene.instances.iter().enumerate() {
            if !scene.has_lightmap(i) || anew.binary_search(&i).is_ok() {
                continue;
            }
            let mesh = self.mesh_of(document.json(), &self.level.instances[i]);
            let primitives = scene.meshes[instance.mesh].primitives.iter().enumerate();
            for (p, primitive) in primitives {
                let light = match scene.receives(i, p) {
                    true => irradiance(document, mesh, primitive.gltf_primitive),
                    false => Some(Vec::new()),
                };
                let count = primitive.positions.len();
                let fits = |l: &Vec<[f32; 3]>| !scene.receives(i, p) || l.len() == count;
                let Some(light) = light.filter(fits) else {
                    let name = label(&self.level.instances[i]);
                    let message = format!("found no light at the vertices of {name}; {ANEW}");
                    return Err(fault(&path, message, false));
                };
                out.instances[i].push(light);
            }
        }
        Ok(out)
    }

    /// The mesh of an instance in the scene with vertex colours. Copies of instanced nodes are
    /// children there, behind the document's own nodes.
    fn mesh_of<'v>(&self, document: &'v Value, instance: &InstanceRecord) -> &'v Value {
        let node = &document["nodes"][instance.node];
        let node = match instance.copy {
            None => node,
            Some(copy) => {
                let own = |c: &&Value| c.as_u64().is_some_and(|c| c as usize >= self.level.nodes);
                let mut children = node["children"]
                    .as_array()
                    .into_iter()
                    .flatten()
                    .filter(own);
                let child = children.nth(copy as usize).and_then(Value::as_u64);
                &document["nodes"][child.map_or(usize::MAX, |c| c as usize)]
            }
        };
        let mesh = node["mesh"].as_u64().map_or(usize::MAX, |m| m as usize);
        &document["meshes"][mesh]
    }

    /// Results that stay as they are.
    ///
    /// # Errors
    /// [`Error::Folder`] if one is missing or was changed.
    pub fn kept_files(&self, settings: &Settings) -> Result<Vec<NamedFile>, Error> {
        let probes = settings.probes.is_some().then_some(PROBES);
        let volume = probes.filter(|_| settings.probe_volume).map(|_| VOLUME);
        let one = |end: &str| {
            let name = format!("{}.{end}", self.stem);
            let path = self.whole(&name)?;
            let bytes = read_regular(&path, MAX_JSON);
            Ok((name, bytes.map_err(|e| fault(&path, e.to_string(), true))?))
        };
        probes.into_iter().chain(volume).map(one).collect()
    }
}

/// The light of a primitive in the scene with vertex colours.
fn irradiance(document: &Document, mesh: &Value, primitive: usize) -> Option<Vec<[f32; 3]>> {
    let attributes = &mesh["primitives"][primitive]["attributes"];
    let accessor = attributes["_IRRADIANCE"].as_u64()?;
    let raw = document.accessor_raw(accessor as usize).ok()?;
    Some(raw.to_floats::<3>(0.0))
}

/// A page as it was written.
fn page_of(path: &Path) -> Result<Page, Error> {
    let image = read_exr(path)?;
    let mut channels: BTreeMap<String, Vec<f32>> = image.channels.into_iter().collect();
    let mut color = ["R", "G", "B"].map(|c| channels.remove(c).unwrap_or_default());
    let texels = image.width as usize * image.height as usize;
    color.iter_mut().for_each(|c| c.resize(texels, 0.0));
    let [r, g, b] = color;
    Ok(Page {
        width: image.width,
        height: image.height,
        value: (0..texels).map(|i| [r[i], g[i], b[i]]).collect(),
        coverage: Vec::new(),
        layers: channels.into_iter().collect(),
    })
}

/// An instance for people.
fn label(instance: &InstanceRecord) -> String {
    let mut name = match &instance.name[..] {
        "" => format!("nodes[{}]", instance.node),
        name => format!("{name:?}"),
    };
    if let Some(copy) = instance.copy {
        name += &format!(" (copy {copy})");
    }
    name
}

/// Labels of the instances of `all` whose names `others` lacks.
fn lacking(all: &[InstanceRecord], others: &[InstanceRecord]) -> Vec<String> {
    let mut left: BTreeMap<(&str, Option<u32>), usize> = BTreeMap::new();
    for other in others {
        *left.entry((&other.name, other.copy)).or_default() += 1;
    }
    let mut out = Vec::new();
    for instance in all {
        match left.get_mut(&(&instance.name[..], instance.copy)) {
            Some(n) if *n > 0 => *n -= 1,
            _ => out.push(label(instance)),
        }
    }
    out
}

/// The settings that differ from those of a report, for people.
fn other_settings(was: &Value, now: &Settings) -> Option<String> {
    // As text, because a report holds the shortest text of a number.
    let now = serde_json::to_string(now).unwrap_or_default();
    let now: Value = serde_json::from_str(&now).unwrap_or_default();
    let (Some(was), Some(now)) = (was.as_object(), now.as_object()) else {
        return Some("they are not a list".into());
    };
    let absent = Value::Null;
    let mut differ = Vec::new();
    for name in was
        .keys()
        .chain(now.keys().filter(|k| !was.contains_key(*k)))
    {
        let (a, b) = (
            was.get(name).unwrap_or(&absent),
            now.get(name).unwrap_or(&absent),
        );
        if a != b {
            differ.push(format!("{name}: {a} there, {b} here"));
        }
    }
    (!differ.is_empty()).then(|| differ[..differ.len().min(3)].join("; "))
}
