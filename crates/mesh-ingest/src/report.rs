//! Report of ingest, for people and for the bake report.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::scene::Counts;

/// What was read, dropped, clamped and left out.
#[derive(Debug, Clone, Default, Serialize)]
pub struct IngestReport {
    /// Number of repairs and omissions by kind (see [`Counts`]).
    pub counts: Counts,
    /// Possible problems.
    pub warnings: Vec<Warning>,
    /// Nodes with geometry or lights that are left out of the bake.
    pub left_out: Vec<LeftOut>,
    /// Groups of levels of detail and variants.
    pub lods: Vec<LodGroup>,
    /// Files read besides the document, by their names in the document.
    pub files: Vec<String>,
    /// `extensionsUsed`, sorted.
    pub extensions_used: Vec<String>,
    /// Sizes of the loaded scene.
    pub totals: Totals,
}

/// A remark about a place in the document.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Document path.
    pub path: String,
    /// What was found and what was done about it.
    pub message: String,
}

/// Levels of detail or variants of the same object. Rays see the first; the others copy its light.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LodGroup {
    /// The group's name for people.
    pub name: String,
    /// How the group was recognised.
    pub by: LodSource,
    /// Numbers of its levels or variants, ascending, at least two.
    pub levels: Vec<u32>,
    /// Nodes with meshes of all levels but the first.
    pub stand_ins: Vec<usize>,
}

impl LodGroup {
    /// Its name and its levels.
    pub fn describe(&self) -> String {
        let word = match self.by {
            LodSource::Variant => "variants",
            _ => "levels",
        };
        let levels: Vec<String> = self.levels.iter().map(u32::to_string).collect();
        format!("{:?} ({word} {})", self.name, levels.join(", "))
    }
}

/// How a group of levels of detail or variants was recognised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LodSource {
    /// `extras.lumel.lod`.
    Extras,
    /// `extras.lumel.variant`.
    Variant,
    /// `MSFT_lod`.
    MsftLod,
    /// Names of nodes.
    Name,
}

/// A node that neither receives nor casts light.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Index of the glTF node.
    pub node: usize,
    /// Its name, or empty.
    pub name: String,
    /// The reason.
    pub reason: LeftOutReason,
}

/// Why a node is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LeftOutReason {
    /// A skin deforms it.
    Skinned,
    /// Morph targets deform it.
    Morphed,
    /// An animation moves it or one of its ancestors.
    Animated,
    /// `KHR_node_visibility` hides it.
    Hidden,
    /// Its own or an ancestor's `extras.lumel` says `"exclude": true`.
    Excluded,
}

/// Sizes of a loaded scene.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Totals {
    /// Unique meshes in use.
    pub meshes: usize,
    /// Number of their triangle primitives.
    pub primitives: usize,
    /// Number of their vertices.
    pub vertices: u64,
    /// Unique triangles.
    pub triangles: u64,
    /// Triangles after instancing.
    pub triangles_instanced: u64,
    /// Placed meshes.
    pub instances: usize,
    /// Materials of the document.
    pub materials: usize,
    /// Images decoded.
    pub images: usize,
    /// Punctual lights.
    pub lights: usize,
    /// Estimated bytes of scene and soup together.
    pub memory_bytes: u64,
}

impl IngestReport {
    /// Most warnings that are kept; the rest are counted under `warnings.omitted`.
    const WARNINGS: usize = 500;

    pub(crate) fn count(&mut self, key: &str, n: u64) {
        add(&mut self.counts, key, n);
    }

    pub(crate) fn warn(&mut self, path: impl Into<String>, message: impl Into<String>) {
        if self.warnings.len() < Self::WARNINGS {
            self.warnings.push(Warning {
                path: path.into(),
                message: message.into(),
            });
        } else {
            self.count("warnings.omitted", 1);
        }
    }

    /// Merges the counts and warnings of a part that was read separately.
    pub(crate) fn merge(&mut self, part: IngestReport) {
        for (key, n) in part.counts {
            self.count(&key, n);
        }
        for warning in part.warnings {
            self.warn(warning.path, warning.message);
        }
    }

    /// Number of nodes left out for each reason.
    pub fn left_out_by_reason(&self) -> BTreeMap<LeftOutReason, usize> {
        let mut by_reason = BTreeMap::new();
        for node in &self.left_out {
            *by_reason.entry(node.reason).or_insert(0) += 1;
        }
        by_reason
    }
}

pub(crate) fn add(counts: &mut Counts, key: &str, n: u64) {
    if n > 0 {
        *counts.entry(key.to_string()).or_insert(0) += n;
    }
}
