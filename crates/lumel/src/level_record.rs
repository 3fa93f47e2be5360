//! What a report keeps of a level's geometry and places, so that a part of it can be baked anew.

use std::fmt;
use std::str::FromStr;

use atlas::{Layout, MeshAtlas};
use mesh_ingest::{Cut, Loaded, Mesh, Scene};
use serde::{Deserialize, Serialize};

use crate::open::Changes;
use crate::record::PROGRAM;

/// Geometry and places of a level, by content.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelRecord {
    /// Version of the program and hash of its sources.
    pub program: String,
    /// Number of nodes of the document.
    pub nodes: usize,
    /// Primitives (mesh, primitive) with separate faces for their two sides.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub split: Vec<(usize, usize)>,
    /// Cuts under thin walls.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cuts: Vec<Cut>,
    /// [`Record::key`](crate::Record::key) of each bake that light of the results comes from: one,
    /// unless parts were baked anew.
    pub bakes: Vec<String>,
    /// In the order of the scene's instances: hash of its geometry, hash of its charts and their
    /// place, index into `bakes`, node with copy, name.
    pub instances: Vec<InstanceRecord>,
}

/// An instance of the scene, stored as a line of text.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct InstanceRecord {
    /// Hash of the transform and of the triangles' corners.
    pub geometry: u64,
    /// Hash of the charts, and of page and rectangle.
    pub place: u64,
    /// The bake that its light comes from.
    pub bake: usize,
    /// Index of the glTF node.
    pub node: usize,
    /// Index of the `EXT_mesh_gpu_instancing` copy.
    pub copy: Option<u32>,
    /// The node's name.
    pub name: String,
}

impl fmt::Display for InstanceRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (geometry, place, bake, node) = (self.geometry, self.place, self.bake, self.node);
        write!(f, "{geometry:016x} {place:016x} {bake} {node}")?;
        if let Some(copy) = self.copy {
            write!(f, ".{copy}")?;
        }
        write!(f, " {}", self.name)
    }
}

impl From<InstanceRecord> for String {
    fn from(record: InstanceRecord) -> String {
        record.to_string()
    }
}

impl FromStr for InstanceRecord {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        read_instance(text).ok_or("expected hashes, numbers and a name")
    }
}

fn read_instance(text: &str) -> Option<InstanceRecord> {
    let mut parts = text.splitn(5, ' ');
    let geometry = u64::from_str_radix(parts.next()?, 16).ok()?;
    let place = u64::from_str_radix(parts.next()?, 16).ok()?;
    let bake = parts.next()?.parse().ok()?;
    let node = parts.next()?;
    let (node, copy) = match node.split_once('.') {
        Some((node, copy)) => (node, Some(copy.parse().ok()?)),
        None => (node, None),
    };
    Some(InstanceRecord {
        geometry,
        place,
        bake,
        node: node.parse().ok()?,
        copy,
        name: parts.next()?.into(),
    })
}

impl TryFrom<String> for InstanceRecord {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

/// The first eight bytes of a hash: a level has far fewer than 2³² nodes.
fn short(hasher: &blake3::Hasher) -> u64 {
    let mut out = [0; 8];
    hasher.finalize_xof().fill(&mut out);
    u64::from_be_bytes(out)
}

/// Hashes numbers behind their count.
fn put(hasher: &mut blake3::Hasher, all: impl ExactSizeIterator<Item = u32>) {
    hasher.update(&(all.len() as u64).to_le_bytes());
    let bytes: Vec<u8> = all.flat_map(u32::to_le_bytes).collect();
    hasher.update(&bytes);
}

fn geometry_of(mesh: &Mesh) -> u64 {
    let mut h = blake3::Hasher::new();
    for p in &mesh.primitives {
        let corners: Vec<u32> = (p.positions.iter().flat_map(|v| v.to_array()))
            .map(f32::to_bits)
            .collect();
        put(&mut h, corners.into_iter());
        let triangles = p.triangles.as_flattened();
        put(&mut h, triangles.iter().copied());
    }
    short(&h)
}

fn charts_of(mesh: &MeshAtlas) -> u64 {
    let mut h = blake3::Hasher::new();
    for p in &mesh.primitives {
        put(&mut h, p.xref.iter().copied());
        let places: Vec<u32> = (p.uv.iter().flat_map(|v| v.to_array()))
            .map(f32::to_bits)
            .collect();
        put(&mut h, places.into_iter());
        put(&mut h, p.triangles.as_flattened().iter().copied());
        put(&mut h, p.chart.iter().copied());
    }
    short(&h)
}

/// The instances of a scene, without their places.
pub(crate) fn instances_of(scene: &Scene) -> Vec<InstanceRecord> {
    let meshes: Vec<u64> = scene.meshes.iter().map(geometry_of).collect();
    let one = |instance: &mesh_ingest::Instance| {
        let mut h = blake3::Hasher::new();
        h.update(&meshes[instance.mesh].to_le_bytes());
        let mut place = instance.transform;
        // The scene's origin depends on all of its geometry.
        place.translation += scene.origin;
        let numbers = place.to_cols_array().map(|x| (x as f32).to_bits());
        put(&mut h, numbers.into_iter());
        h.update(&[u8::from(instance.occluder)]);
        InstanceRecord {
            geometry: short(&h),
            node: instance.node,
            copy: instance.copy,
            name: instance.name.clone(),
            ..InstanceRecord::default()
        }
    };
    scene.instances.iter().map(one).collect()
}

/// Adds the hashes of places.
pub(crate) fn add_places(instances: &mut [InstanceRecord], scene: &Scene, layout: &Layout) {
    let meshes: Vec<u64> = layout.meshes.iter().map(charts_of).collect();
    let all = instances.iter_mut().zip(&layout.placements);
    for ((record, p), instance) in all.zip(&scene.instances) {
        let mut h = blake3::Hasher::new();
        h.update(&meshes[instance.mesh].to_le_bytes());
        let rect = [p.page, p.rect.x, p.rect.y, p.rect.w, p.rect.h];
        put(&mut h, rect.into_iter());
        record.place = short(&h);
    }
}

impl LevelRecord {
    /// The record of a bake without its key.
    pub(crate) fn of(loaded: &Loaded, layout: &Layout, changes: &Changes) -> LevelRecord {
        let mut instances = instances_of(&loaded.scene);
        add_places(&mut instances, &loaded.scene, layout);
        let nodes = loaded.document.json()["nodes"].as_array();
        LevelRecord {
            program: PROGRAM.into(),
            nodes: nodes.map_or(0, Vec::len),
            split: changes.split.iter().copied().collect(),
            cuts: changes.cuts.clone(),
            bakes: Vec::new(),
            instances,
        }
    }

    /// Changes of the document.
    pub(crate) fn changes(&self) -> Changes {
        Changes {
            split: self.split.iter().copied().collect(),
            cuts: self.cuts.clone(),
        }
    }

    /// Says which light comes from the bake with this key, and which from the bakes before:
    /// `earlier` has the same instances, of which those in `anew` were baked.
    pub(crate) fn settle(&mut self, key: &str, before: Option<(&LevelRecord, &[usize])>) {
        let Some((earlier, anew)) = before else {
            self.bakes = vec![key.into()];
            return;
        };
        let of = |i: usize| match anew.binary_search(&i) {
            Ok(_) => key,
            Err(_) => &earlier.bakes[earlier.instances[i].bake],
        };
        for (i, instance) in self.instances.iter_mut().enumerate() {
            let key = of(i);
            let at = self.bakes.iter().position(|k| k == key);
            instance.bake = at.unwrap_or_else(|| {
                self.bakes.push(key.into());
                self.bakes.len() - 1
            });
        }
    }

    /// Whether a record that was read makes sense.
    pub(crate) fn is_whole(&self) -> bool {
        self.instances.iter().all(|i| i.bake < self.bakes.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instances_are_lines() {
        for (copy, name) in [(None, "a b.c"), (Some(3), ""), (Some(0), " x\n")] {
            let record = InstanceRecord {
                geometry: 7,
                place: u64::MAX,
                bake: 2,
                node: 41,
                copy,
                name: name.into(),
            };
            assert_eq!(record.to_string().parse(), Ok(record));
        }
        for bad in ["", "7", "7 8 9", "x 8 9 1 a", "7 8 9 1.x a", "7 8 -1 1 a"] {
            assert!(bad.parse::<InstanceRecord>().is_err(), "{bad}");
        }
    }

    #[test]
    fn light_is_that_of_the_last_bake_of_each_instance() {
        let level = |n: usize| LevelRecord {
            instances: vec![InstanceRecord::default(); n],
            ..LevelRecord::default()
        };
        let mut first = level(3);
        first.settle("a", None);
        let mut second = level(3);
        second.settle("b", Some((&first, &[1])));
        let bakes = |l: &LevelRecord| -> Vec<String> {
            (l.instances.iter())
                .map(|i| l.bakes[i.bake].clone())
                .collect()
        };
        assert_eq!(bakes(&second), ["a", "b", "a"]);
        let mut third = level(3);
        third.settle("c", Some((&second, &[0, 1, 2])));
        assert_eq!(third.bakes, ["c"]);
    }
}
