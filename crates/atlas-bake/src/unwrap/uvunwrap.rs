//! The `uvunwrap` crate behind [`Unwrapper`].

use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Vec2, Vec3};
use uvunwrap::{Density, Error, MeshInput, Options, Packing};

use super::measure::snap_rectangles;
use super::{Cancel, UnwrapError, UnwrapInput, UnwrapOptions, UnwrappedMesh, Unwrapper};

/// From how many charts on to pack by outline rows instead of by shape. Packing by shape fills 2 to 8 % more of the page at
/// 400 to 2500 charts and costs a quarter of a second there, growing quadratic (`docs/unwrap.md`).
const FAST_PACKING_CHARTS: u32 = 4000;

/// `uvunwrap` 0.3: segmentation within a normal cone, conformal and as-rigid-as-possible maps, packing by shape.
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
        pack(mesh, None, options, cancel)
    }
}

/// Meshes of more triangles get charts of bounded size: flattening is more than linear in a chart's triangles, and a scan of 595,000
/// took 10.6 s with charts as large as they come, 5.6 s with charts of about a thousand (14,000 and 18,000 charts).
const LARGE_MESH: usize = 300_000;

/// Triangles of average size in a chart of a large mesh, at most.
const LARGE_MESH_CHART: f64 = 1024.0;

/// Unwraps `mesh`, or packs the charts it already has: `existing` texture coordinates per corner, in any unit. Islands of
/// them are scaled to their area in space; those that overlap or fold are unwrapped anew.
pub(super) fn pack(
    mesh: &UnwrapInput,
    existing: Option<&[[Vec2; 3]]>,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
) -> Result<UnwrappedMesh, UnwrapError> {
    let layers = Layers::new(mesh, existing);
    let area: f64 = mesh.areas().iter().sum();
    let page = f64::from(options.max_size).powi(2);
    let density = f64::from(options.texels_per_unit);
    // Charts never fill the page; a first try at a density that leaves no room would be wasted.
    if area * density * density <= 0.95 * page {
        let fixed = Density::Fixed {
            texels_per_unit: options.texels_per_unit,
            page_size: None,
        };
        match layers.generate(options, fixed, cancel) {
            Ok(result) if result.size.iter().all(|&s| s <= options.max_size) => {
                return squarer(&layers, result, options, cancel);
            }
            Ok(_) | Err(UnwrapError::DoesNotFit { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    let auto = Density::Auto {
        page_size: options.max_size,
    };
    layers.generate(options, auto, cancel)
}

/// Packs again into a square where the charts were laid into a strip more than twice as long as wide (six equal sides of
/// a box fill 1 × 6 as well as 2 × 3); keeps the strip where the square would waste more than a quarter
/// (five equal sides in 2 × 3 waste a fifth, which a strip across the page would waste as well).
fn squarer(
    layers: &Layers<'_>,
    strip: UnwrappedMesh,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
) -> Result<UnwrappedMesh, UnwrapError> {
    let [w, h] = strip.size;
    if w.max(h) <= 2 * w.min(h) {
        return Ok(strip);
    }
    let area = f64::from(w) * f64::from(h);
    for growth in [1.03, 1.12, 1.25, 1.42] {
        let side = (area.sqrt() * growth).ceil() as u32;
        if side > options.max_size {
            break;
        }
        let square = Density::Fixed {
            texels_per_unit: options.texels_per_unit,
            page_size: Some(side),
        };
        match layers.generate(options, square, cancel) {
            Ok(mut result) => {
                crop(&mut result, options.padding.div_ceil(2));
                let cropped = f64::from(result.size[0]) * f64::from(result.size[1]);
                let [w, h] = result.size;
                if cropped <= area * 1.25 && w.max(h) <= 2 * w.min(h) {
                    return Ok(result);
                }
            }
            Err(UnwrapError::Cancelled) => return Err(UnwrapError::Cancelled),
            // More than one page, or a chart longer than the square: the next is larger.
            Err(_) => {}
        }
    }
    Ok(strip)
}

/// Cuts off what lies beyond the charts and a border.
fn crop(mesh: &mut UnwrappedMesh, border: u32) {
    let high = mesh
        .corners
        .iter()
        .flatten()
        .fold(Vec2::ZERO, |high, &p| high.max(p));
    for axis in 0..2 {
        // Corners that were not snapped carry rounding of up to 1e-3 texel.
        let used = (high[axis] - 1e-3).ceil().max(1.0) as u32 + border;
        mesh.size[axis] = mesh.size[axis].min(used);
    }
}

/// The mesh cut into one `uvunwrap` mesh per layer of [`UnwrapInput::layer`].
struct Layers<'a> {
    mesh: &'a UnwrapInput,
    positions: Vec<[f32; 3]>,
    /// Existing coordinates, one per position.
    uvs: Option<Vec<[f32; 2]>>,
    layers: Vec<Layer>,
}

#[derive(Default)]
struct Layer {
    /// Triangle numbers in the whole mesh.
    triangles: Vec<u32>,
    indices: Vec<u32>,
    primitive: Vec<u32>,
    seams: Vec<[bool; 3]>,
}

impl<'a> Layers<'a> {
    /// Chart area limit, m²; 0 for none.
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

    fn generate(
        &self,
        options: &UnwrapOptions,
        density: Density,
        cancel: Cancel<'_>,
    ) -> Result<UnwrappedMesh, UnwrapError> {
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
            density,
            // The crate keeps charts twice its padding apart.
            padding: options.padding.div_ceil(2),
            packing: if self.mesh.regions > FAST_PACKING_CHARTS {
                Packing::Fast
            } else {
                Packing::Shape
            },
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
                    max_size: options.max_size,
                });
            }
            Err(error) => return Err(UnwrapError::Failed(error.to_string())),
        };
        if atlas.page_count > 1 {
            return Err(UnwrapError::DoesNotFit {
                charts: atlas.chart_count,
                max_size: options.max_size,
            });
        }
        self.collect(&atlas)
    }

    fn collect(&self, atlas: &uvunwrap::Atlas) -> Result<UnwrappedMesh, UnwrapError> {
        let count = self.mesh.triangles.len();
        let mut result = UnwrappedMesh {
            size: [atlas.width, atlas.height],
            texels_per_unit: atlas.texels_per_unit,
            corners: vec![[Vec2::ZERO; 3]; count],
            chart: vec![u32::MAX; count],
            charts: atlas.chart_count,
        };
        let scale = Vec2::new(atlas.width as f32, atlas.height as f32);
        let mut anchor = None;
        let mut homeless = Vec::new();
        for (layer, output) in self.layers.iter().zip(&atlas.meshes) {
            for (&t, corners) in layer.triangles.iter().zip(output.indices.chunks_exact(3)) {
                let vertices = [0, 1, 2].map(|k| &output.vertices[corners[k] as usize]);
                match vertices[0].chart {
                    Some(chart) => {
                        let at = vertices.map(|v| Vec2::from(v.uv) * scale);
                        anchor.get_or_insert((chart, at[0]));
                        result.corners[t as usize] = at;
                        result.chart[t as usize] = chart;
                    }
                    None => homeless.push(t as usize),
                }
            }
        }
        // Triangles without area and without a neighbour that has any: a point of the first chart serves.
        let Some((chart, at)) = anchor else {
            return Err(UnwrapError::Failed(
                "no triangle is thick enough for a chart".into(),
            ));
        };
        for t in homeless {
            result.corners[t] = [at; 3];
            result.chart[t] = chart;
        }
        snap_rectangles(&mut result);
        Ok(result)
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
