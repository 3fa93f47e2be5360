//! The `uvunwrap` crate as an [`Unwrapper`].

use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec2, Vec2, Vec3};
use uvunwrap::{Density, Error, MeshInput, Options, Packing};

use super::charts::Charts;
use super::finish::finish;
use super::input::UnwrapInput;
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};

/// Largest mesh given to uvunwrap. Scans and height fields take 30 to 75 µs of processor time per
/// triangle (lab/robust.md), so five minutes at most. Larger meshes go to the box projection.
pub const MAX_TRIANGLES: usize = 4_000_000;

/// Most disconnected pieces. Time grows faster than their number: loose triangles take 50 µs each
/// if there are 128,000, and 90 µs if there are 256,000 (`examples/unwrap_cost.rs`).
const PIECES: u32 = 250_000;

/// `uvunwrap` 0.3: segmentation within a normal cone, conformal and as-rigid-as-possible
/// parametrisation. Lumel packs the charts itself.
#[derive(Debug, Clone, Copy, Default)]
pub struct UvUnwrap;

impl Unwrapper for UvUnwrap {
    fn name(&self) -> &'static str {
        "uvunwrap"
    }

    fn unwrap(
        &self,
        mesh: &UnwrapInput,
        options: &UnwrapOptions,
        cancel: Cancel<'_>,
    ) -> Result<UnwrappedMesh, UnwrapError> {
        if mesh.triangles.len() > MAX_TRIANGLES {
            return Err(UnwrapError::Failed(format!(
                "more than {MAX_TRIANGLES} triangles"
            )));
        }
        if mesh.regions > PIECES {
            return Err(UnwrapError::Failed(format!("more than {PIECES} pieces")));
        }
        finish(mesh, flatten(mesh, None, cancel)?, options, cancel)
    }
}

/// Meshes with more triangles get charts of limited size, because the solver's time for a chart is
/// superlinear. A scan of 595,000 triangles took 160 s of processor time with charts of about a
/// thousand triangles, 52, 39 and 31 s with 128, 64 and 32, for the same share of the page. Sponza
/// (262,000) fills 70 % of its page with large charts, 67 % with limited ones.
const LARGE_MESH: usize = 300_000;

/// Most average-sized triangles in a chart of a large mesh.
const LARGE_MESH_CHART: f64 = 64.0;

/// Area in texels of all charts on the page that `uvunwrap` packs, which is discarded.
const PAGE_TEXELS: f64 = 65536.0;

/// Cuts `mesh` into flat charts, or takes its existing charts: `existing` are texture coordinates
/// per corner in any unit. Their islands are scaled to their area in space; overlapping and folded
/// ones are unwrapped again.
pub(super) fn flatten(
    mesh: &UnwrapInput,
    existing: Option<&[[Vec2; 3]]>,
    cancel: Cancel<'_>,
) -> Result<Charts, UnwrapError> {
    let layers = Layers::new(mesh, existing);
    let area: f64 = mesh.areas().iter().sum();
    let mut density = (PAGE_TEXELS / area.max(f64::MIN_POSITIVE)).sqrt();
    // Long thin charts may need more texels than uvunwrap allows; any density will do.
    for _ in 0..8 {
        match layers.generate(density as f32, cancel) {
            Err(UnwrapError::DoesNotFit { .. }) => density /= 16.0,
            result => return result,
        }
    }
    Err(UnwrapError::Failed("charts are too long".into()))
}

/// The mesh as one `uvunwrap` mesh per layer of [`UnwrapInput::layer`].
struct Layers<'a> {
    mesh: &'a UnwrapInput,
    positions: Vec<[f32; 3]>,
    /// Existing coordinates, one per position.
    uvs: Option<Vec<[f32; 2]>>,
    layers: Vec<Layer>,
}

#[derive(Default)]
struct Layer {
    /// Triangle indices in the whole mesh.
    triangles: Vec<u32>,
    indices: Vec<u32>,
    primitive: Vec<u32>,
    seams: Vec<[bool; 3]>,
}

impl<'a> Layers<'a> {
    /// Limit of a chart's area, m²; 0 for none.
    fn largest_chart(&self) -> f32 {
        let n = self.mesh.triangles.len();
        if n <= LARGE_MESH {
            return 0.0;
        }
        let area: f64 = self.mesh.areas().iter().sum();
        (area * LARGE_MESH_CHART / n as f64) as f32
    }

    fn new(mesh: &'a UnwrapInput, existing: Option<&[[Vec2; 3]]>) -> Self {
        let (positions, uvs, triangles) = match existing {
            None => (mesh.positions.clone(), None, mesh.triangles.clone()),
            Some(existing) => split_at_seams(mesh, existing),
        };
        let mut layers: Vec<Layer> = (0..mesh.layers.max(1)).map(|_| Layer::default()).collect();
        for (t, corners) in triangles.iter().enumerate() {
            let layer = &mut layers[mesh.layer[t] as usize];
            layer.triangles.push(t as u32);
            layer.indices.extend(corners);
            layer.primitive.push(mesh.primitive[t]);
            layer.seams.push(mesh.seams[t]);
        }
        Layers {
            mesh,
            positions: positions.iter().map(|p| p.to_array()).collect(),
            uvs,
            layers,
        }
    }

    fn generate(&self, texels_per_unit: f32, cancel: Cancel<'_>) -> Result<Charts, UnwrapError> {
        let meshes: Vec<MeshInput<'_>> = self
            .layers
            .iter()
            .map(|layer| MeshInput {
                face_materials: Some(&layer.primitive),
                seams: Some(&layer.seams),
                existing_uvs: self.uvs.as_deref(),
                ..MeshInput::new(&self.positions, &layer.indices)
            })
            .collect();
        let settings = Options {
            density: Density::Fixed {
                texels_per_unit,
                page_size: None,
            },
            padding: 0,
            packing: Packing::Fast,
            max_chart_area: self.largest_chart(),
            ..Options::default()
        };
        let stopped = AtomicBool::new(false);
        let result = uvunwrap::generate_with_progress(&meshes, &settings, |_| {
            let stop = cancel();
            stopped.fetch_or(stop, Ordering::Relaxed);
            !stop
        });
        let atlas = match result {
            Ok(atlas) => atlas,
            Err(Error::Cancelled) => return Err(UnwrapError::Cancelled),
            Err(Error::AtlasTooLarge { .. } | Error::ChartTooLarge { .. }) => {
                return Err(UnwrapError::DoesNotFit {
                    charts: self.mesh.regions,
                    max_size: 0,
                });
            }
            Err(error) => return Err(UnwrapError::Failed(error.to_string())),
        };
        self.collect(&atlas)
    }

    /// The charts in metres, numbered in the order of their first triangles.
    fn collect(&self, atlas: &uvunwrap::Atlas) -> Result<Charts, UnwrapError> {
        let count = self.mesh.triangles.len();
        let mut charts = Charts {
            corners: vec![[DVec2::ZERO; 3]; count],
            chart: vec![u32::MAX; count],
            count: 0,
        };
        let scale = DVec2::new(f64::from(atlas.width), f64::from(atlas.height))
            / f64::from(atlas.texels_per_unit);
        let mut homeless = Vec::new();
        for (layer, output) in self.layers.iter().zip(&atlas.meshes) {
            for (&t, corners) in layer.triangles.iter().zip(output.indices.chunks_exact(3)) {
                let vertices = [0, 1, 2].map(|k| &output.vertices[corners[k] as usize]);
                match vertices[0].chart {
                    Some(chart) => {
                        charts.corners[t as usize] =
                            vertices.map(|v| Vec2::from(v.uv).as_dvec2() * scale);
                        charts.chart[t as usize] = chart;
                    }
                    None => homeless.push(t as usize),
                }
            }
        }
        // For zero-area triangles without a neighbour that has area: a point of the first chart.
        let Some(first) = charts.chart.iter().position(|&c| c != u32::MAX) else {
            return Err(UnwrapError::Failed(
                "no triangle is thick enough for a chart".into(),
            ));
        };
        let (chart, at) = (charts.chart[first], charts.corners[first][0]);
        for t in homeless {
            charts.corners[t] = [at; 3];
            charts.chart[t] = chart;
        }
        if charts.corners.iter().flatten().any(|p| !p.is_finite()) {
            return Err(UnwrapError::Failed("a coordinate is not finite".into()));
        }
        charts.renumber();
        Ok(charts)
    }
}

type Split = (Vec<Vec3>, Option<Vec<[f32; 2]>>, Vec<[u32; 3]>);

/// One vertex per (welded vertex, coordinate): positions, coordinates, triangles.
fn split_at_seams(mesh: &UnwrapInput, existing: &[[Vec2; 3]]) -> Split {
    let mut keys: Vec<(u32, [u32; 2], u32)> = Vec::with_capacity(existing.len() * 3);
    for (t, (triangle, uv)) in mesh.triangles.iter().zip(existing).enumerate() {
        for k in 0..3 {
            let bits = uv[k].to_array().map(f32::to_bits);
            keys.push((triangle[k], bits, (t * 3 + k) as u32));
        }
    }
    keys.sort_unstable();
    let (mut positions, mut uvs) = (Vec::new(), Vec::new());
    let mut triangles = vec![[0; 3]; existing.len()];
    for run in keys.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        for &(.., corner) in run {
            triangles[corner as usize / 3][corner as usize % 3] = positions.len() as u32;
        }
        positions.push(mesh.positions[run[0].0 as usize]);
        uvs.push(run[0].1.map(f32::from_bits));
    }
    (positions, Some(uvs), triangles)
}
