//! The bake's report.

use atlas::LayoutReport;
use atlas_bake::{BakeReport, ExrStats, Ktx2Report, PngReport};
use gather::probes::{ProbeReport, ReflectionReport};
use mesh_ingest::IngestReport;
use radiosity::{Audit, SolveReport};
use serde::Serialize;

use std::collections::BTreeMap;

use mesh_ingest::Digest;
use serde_json::Value;

use crate::cache::CacheReport;
use crate::cull::CullReport;
use crate::only::OnlyReport;
use crate::origin::Origin;
use crate::record::Record;
use crate::settings::Settings;

/// What a bake read, did and found: `level.report.json`.
///
/// Except for [`measured`](Report::measured), it is the same for the same input, settings and
/// version.
///
/// ```no_run
/// let bake = lumel::Baker::new().bake("level.glb")?;
/// let report = &bake.report;
/// println!("{} s, warnings: {:?}", report.measured.seconds, report.warnings);
/// # Ok::<(), lumel::Error>(())
/// ```
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Program and version.
    pub generator: String,
    /// File name of the scene, without its path.
    pub scene: String,
    /// Settings.
    pub settings: Settings,
    /// Settings that are not defaults, and their origins.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub origins: BTreeMap<String, Origin>,
    /// Inputs and outputs, by content.
    pub content: Record,
    /// What was read, dropped, clamped and left out.
    pub ingest: IngestReport,
    /// Triangles left out in world space: of zero area, duplicates.
    pub dropped_triangles: [u64; 2],
    /// Materials in use whose reflectance was clamped to `settings.max_reflectance` or to a lower
    /// limit of their own.
    pub clamped_materials: u64,
    /// Light groups, in order; empty if light is not separated.
    pub groups: Vec<GroupReport>,
    /// What `--cull-unseen` left without lumels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub culled: Option<CullReport>,
    /// Charts and pages.
    pub layout: LayoutReport,
    /// The solve: patches, elements, residual, row sums, energy.
    pub solve: SolveReport,
    /// The gather.
    pub gather: BakeReport,
    /// Light probes, if any were requested.
    pub probes: Option<ProbeReport>,
    /// Reflection captures, if the scene has any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reflections: Option<ReflectionReport>,
    /// Samples clamped while writing, by page.
    pub clamped: Vec<ExrStats>,
    /// Pages stored as KTX2, including those of groups, and their compression errors; empty without
    /// `--ktx2`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ktx2: Vec<StoredPage>,
    /// Pages stored as PNG, and their errors; empty without `--png`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub png: Vec<StoredPng>,
    /// Departures from physics that the settings ask for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub not_physical: Vec<String>,
    /// What was baked anew, if only a part of the level was. The gather's figures are then those of
    /// this part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub only: Option<OnlyReport>,
    /// Decisions that the bake made, which need no action.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Possible problems; any of them makes a bake fail under `--strict`.
    pub warnings: Vec<String>,
    /// Values that differ from run to run.
    pub measured: Measured,
}

/// A light group after resolving names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GroupReport {
    /// Its name.
    pub name: String,
    /// Its sources that are not switched off.
    pub sources: Vec<String>,
}

/// A page stored as KTX2.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoredPage {
    /// The file.
    pub file: String,
    /// Format and compression error.
    #[serde(flatten)]
    pub stored: Ktx2Report,
}

/// A page stored as PNG.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoredPng {
    /// The file.
    pub file: String,
    /// Format and error.
    #[serde(flatten)]
    pub stored: PngReport,
}

/// Times and memory of this run. Zeroed when results are compared.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Measured {
    /// Worker threads.
    pub threads: usize,
    /// Wall time per phase, in order. Charts are made while light is solved, so these times overlap
    /// and sum to more than the total, unless there is one thread or `--in-turn` was given.
    pub phases: Vec<PhaseTime>,
    /// Total wall time, seconds.
    pub seconds: f64,
    /// Million gathering, link and shadow rays per second over the phases that cast them.
    pub mrays_per_second: f64,
    /// Peak resident memory, bytes; absent where the system does not provide it.
    pub peak_bytes: Option<u64>,
    /// What the cache did; null without one.
    pub cache: Option<CacheReport>,
    /// Hash of this file, computed with zeros in place of these digits.
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

/// A placeholder that no real hash will equal.
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
        // Serialising plain structs with string keys cannot fail.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        let digest = Digest::of(text.as_bytes()).to_string();
        if let Some(at) = text.rfind(ZEROS) {
            text.replace_range(at..at + ZEROS.len(), &digest);
        }
        text.into_bytes()
    }
}

/// Parses a report that is byte for byte as [`Report::to_json`] wrote it; `None` for anything else.
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

/// Warns about `materials` with clamped reflectance; `None` if there are none.
pub(crate) fn clamped_warning(materials: u64) -> Option<String> {
    (materials > 0).then(|| {
        let reflect = match materials {
            1 => "1 material reflects".into(),
            n => format!("{n} materials reflect"),
        };
        format!(
            "{reflect} more than --max-reflectance or extras.lumel.maxReflectance allows; clamped to the limit"
        )
    })
}

/// Warnings about the energy balance; empty if it is sound.
pub(crate) fn audit_warnings(audit: &Audit) -> Vec<String> {
    let mut out = Vec::new();
    let percent = |x: f64| 100.0 * x;
    if !audit.within_bound {
        let (few, side) = if audit.imbalance > 0.0 {
            (
                "less",
                "e.g. from a lamp nearer to a surface than the solve can resolve",
            )
        } else {
            (
                "more",
                "e.g. from coincident faces, which both receive the same light",
            )
        };
        out.push(format!(
            "energy does not balance: surfaces absorb {:.2} % {few} light than is emitted, but sampling noise explains only {:.2} % ({side})",
            percent(audit.imbalance.abs()),
            percent(audit.bound),
        ));
    }
    let sum = |rgb: [f64; 3]| rgb.iter().sum::<f64>();
    let behind = sum(audit.flux_behind) / sum(audit.flux_emitted).max(1e-300);
    if behind > LOST_BEHIND {
        let most = audit.beyond.first().map_or(String::new(), |n| {
            format!(", most of it seen from {} near {:.3?}", n.node, n.at)
        });
        out.push(format!(
            "{:.1} % of the light ends on backfaces of single-sided materials, which are black{most}",
            percent(behind)
        ));
    }
    out
}

/// Fraction of the light that may end on backfaces without a warning. The underside of a floor that
/// extends beyond the level receives a little.
const LOST_BEHIND: f64 = 0.05;
