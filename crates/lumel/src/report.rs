//! The bake's report.

use atlas::LayoutReport;
use atlas_bake::{BakeReport, ExrStats, Ktx2Report};
use gather::probes::ProbeReport;
use mesh_ingest::IngestReport;
use radiosity::{Audit, SolveReport};
use serde::Serialize;

use std::collections::BTreeMap;

use mesh_ingest::Digest;
use serde_json::Value;

use crate::cache::CacheReport;
use crate::origin::Origin;
use crate::record::Record;
use crate::settings::Settings;

/// What a bake read, did and found: `level.report.json`.
///
/// Everything but [`measured`](Report::measured) is the same for the same input, settings and
/// version.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Program and version.
    pub generator: String,
    /// File name of the scene, without its path.
    pub scene: String,
    /// Settings.
    pub settings: Settings,
    /// Settings that are not defaults, and who gave them.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub origins: BTreeMap<String, Origin>,
    /// What was read and written, by content.
    pub content: Record,
    /// What was read, dropped, clamped and left out.
    pub ingest: IngestReport,
    /// World-space triangles left out: zero area, duplicates.
    pub dropped_triangles: [u64; 2],
    /// Materials in use that somewhere reflect more than `settings.max_reflectance` or their own,
    /// lower limit; it counts as the limit.
    pub clamped_materials: u64,
    /// Groups of light, in order; empty where all light is together.
    pub groups: Vec<GroupReport>,
    /// Charts and pages.
    pub layout: LayoutReport,
    /// The solve: patches, elements, residual, row sums, energy.
    pub solve: SolveReport,
    /// The gather.
    pub gather: BakeReport,
    /// Light probes, where any were asked for.
    pub probes: Option<ProbeReport>,
    /// Samples clamped when written, by page.
    pub clamped: Vec<ExrStats>,
    /// Pages stored as KTX2, groups' too, and what that cost; empty without `--ktx2`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ktx2: Vec<StoredPage>,
    /// What was decided for the user, who need not do anything about it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// What a user should look at; `--strict` makes a bake with any of these fail.
    pub warnings: Vec<String>,
    /// What differs from run to run.
    pub measured: Measured,
}

/// A group of light as it was resolved.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GroupReport {
    /// Its name.
    pub name: String,
    /// What is in it and not switched off.
    pub sources: Vec<String>,
}

/// A page as KTX2.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoredPage {
    /// The file.
    pub file: String,
    /// How it was stored, and what that changed.
    #[serde(flatten)]
    pub stored: Ktx2Report,
}

/// Times and memory of this run. Zeroed where results are compared.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Measured {
    /// Worker threads.
    pub threads: usize,
    /// Wall time per phase, in order. Charts are made while the tree is built and the light is
    /// solved, so that these times overlap and sum to more than all, unless there is one thread or
    /// `--in-turn`.
    pub phases: Vec<PhaseTime>,
    /// Wall time of all, seconds.
    pub seconds: f64,
    /// Million gathering, link and shadow rays per second over the phases that cast them.
    pub mrays_per_second: f64,
    /// Peak resident memory, bytes; absent where the system does not tell.
    pub peak_bytes: Option<u64>,
    /// What a cache did; null without one.
    pub cache: Option<CacheReport>,
    /// Hash of this file with zeros in the place of these digits.
    pub digest: Blank,
}

/// 64 zeros, which [`Report::to_json`] replaces.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Blank;

impl Serialize for Blank {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(ZEROS)
    }
}

/// No hash that anyone will meet.
const ZEROS: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Wall time of one phase.
#[derive(Debug, Clone, Serialize)]
pub struct PhaseTime {
    /// The phase's name.
    pub phase: &'static str,
    /// Seconds.
    pub seconds: f64,
}

impl Report {
    /// The file's bytes.
    pub fn to_json(&self) -> Vec<u8> {
        // Plain structs with string keys always serialise.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        let digest = Digest::of(text.as_bytes()).to_string();
        if let Some(at) = text.rfind(ZEROS) {
            text.replace_range(at..at + ZEROS.len(), &digest);
        }
        text.into_bytes()
    }
}

/// The JSON of a report that is byte for byte as [`Report::to_json`] wrote it; `None` for anything
/// else.
pub(crate) fn parse_sealed(report: &[u8]) -> Option<Value> {
    let text = std::str::from_utf8(report).ok()?;
    let v: Value = serde_json::from_str(text).ok()?;
    let seal = v["measured"]["digest"].as_str()?;
    let digest: Digest = seal.parse().ok()?;
    let at = text.rfind(seal)?;
    let mut blank = text.to_owned();
    blank.replace_range(at..at + seal.len(), ZEROS);
    (Digest::of(blank.as_bytes()) == digest).then_some(v)
}

/// That `materials` reflect more than they may; nothing where there is none.
pub(crate) fn clamped_warning(materials: u64) -> Option<String> {
    (materials > 0).then(|| {
        let reflect = match materials {
            1 => "1 material reflects".into(),
            n => format!("{n} materials reflect"),
        };
        format!(
            "{reflect} more than --max-reflectance or extras.lumel.maxReflectance allows; what is above counts as the limit"
        )
    })
}

/// What a user should know about the balance of energy; nothing where it is sound.
pub(crate) fn audit_warnings(audit: &Audit) -> Vec<String> {
    let mut out = Vec::new();
    let percent = |x: f64| 100.0 * x;
    if !audit.within_bound {
        let (few, side) = if audit.imbalance > 0.0 {
            (
                "less",
                "a lamp nearer to a surface than the solve resolves loses light so",
            )
        } else {
            (
                "more",
                "faces that lie in one another's plane receive light that none of them takes from the other",
            )
        };
        out.push(format!(
            "energy does not balance: surfaces account for {:.2} % {few} light than is emitted, sampling explains {:.2} % ({side})",
            percent(audit.imbalance.abs()),
            percent(audit.bound),
        ));
    }
    let sum = |rgb: [f64; 3]| rgb.iter().sum::<f64>();
    let behind = sum(audit.flux_behind) / sum(audit.flux_emitted).max(1e-300);
    if behind > LOST_BEHIND {
        let most = audit.beyond.first().map_or(String::new(), |n| {
            format!(", most seen from {} near {:.3?}", n.node, n.at)
        });
        out.push(format!(
            "{:.1} % of the light ends on the backs of single-sided faces, which are black{most}",
            percent(behind)
        ));
    }
    out
}

/// Share of the light that may end on backs of faces without a word: a floor's underside beyond a
/// level's edge takes a little.
const LOST_BEHIND: f64 = 0.05;
