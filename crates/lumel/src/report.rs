//! The bake's report.

use atlas_bake::{BakeReport, ExrStats, LayoutReport};
use mesh_ingest::IngestReport;
use radiosity::SolveReport;
use serde::Serialize;

use crate::settings::Settings;

/// What a bake read, did and found: `level.report.json`.
///
/// Everything but [`measured`](Report::measured) is the same for the same input, settings and version.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Program and version.
    pub generator: String,
    /// File name of the scene, without its path.
    pub scene: String,
    /// Settings.
    pub settings: Settings,
    /// What was read, dropped, clamped and left out.
    pub ingest: IngestReport,
    /// World-space triangles left out: zero area, duplicates.
    pub dropped_triangles: [u64; 2],
    /// Materials whose reflectance was lowered to `settings.max_reflectance`.
    pub clamped_materials: u64,
    /// Charts and pages.
    pub layout: LayoutReport,
    /// The solve: patches, elements, residual, row sums, energy.
    pub solve: SolveReport,
    /// The gather.
    pub gather: BakeReport,
    /// Samples clamped when written, by page.
    pub clamped: Vec<ExrStats>,
    /// What a user should look at; `--strict` makes a bake with any of these fail.
    pub warnings: Vec<String>,
    /// What differs from run to run.
    pub measured: Measured,
}

/// Times and memory of this run. Zeroed where results are compared.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Measured {
    /// Worker threads.
    pub threads: usize,
    /// Wall time per phase, in order.
    pub phases: Vec<PhaseTime>,
    /// Wall time of all, seconds.
    pub seconds: f64,
    /// Million gathering, link and shadow rays per second over the phases that cast them.
    pub mrays_per_second: f64,
    /// Peak resident memory, bytes; absent where the system does not tell.
    pub peak_bytes: Option<u64>,
}

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
        let mut bytes = serde_json::to_vec_pretty(self).unwrap_or_default();
        bytes.push(b'\n');
        bytes
    }
}
