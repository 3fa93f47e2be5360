//! Light at vertices.
//!
//! A vertex's colour matters only through interpolation. If the lightmap has enough lumels on a
//! triangle, values are fitted to them ([`fit`]). Smaller triangles are gathered, as means over the
//! surface around each point. Vertices at the same position and in the same smoothing group share
//! one value, whatever seams of texture coordinates or materials separate them ([`sheet`]), unless
//! charts end there at the edge of a shadow.

mod cluster;
mod difference;
mod fit;
mod gathered;
mod moments;
mod read;
mod result;
mod sheet;
mod smooth;
mod split;

use std::cell::Cell;

use glam::Vec3;
use mesh_ingest::Scene;
use radiosity::{Cancelled, Monitor, SharpLights, World, hash_u32, luminance};
use rayon::prelude::*;
use serde::Serialize;

use atlas::{Layout, TexelIndex};
pub use difference::VertexDifference;
pub use result::{SplitPrimitive, VertexLight};

use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::options::VertexOptions;
use crate::planes::Wanted;
use crate::thinned::Thinned;
use gathered::Job;
use moments::{LumelLight, Moments};
use read::{LumelPlace, Reader};
use sheet::Sheet;
use split::SplitOptions;

/// Most vertices that splitting may add to one instance.
pub const MOST_ADDED_VERTICES: usize = 200_000;

/// Report on vertex light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct VertexReport {
    /// Points with separate values: vertices, with those at the same position and in the same
    /// smoothing group counted once.
    pub points: u64,
    /// Points of small triangles whose light was read from the surrounding lumels.
    pub read: u64,
    /// Points of small triangles that were gathered, because lumels were not sufficient.
    pub gathered: u64,
    /// Gathering and shadow rays.
    pub rays: u64,
    /// Vertices added by splitting, over all instances.
    pub added: u64,
    /// Instances that would have needed more than 200,000 vertices.
    pub full: u64,
    /// Difference from the lightmap.
    pub difference: VertexDifference,
}

/// Light at vertices of a level, summed up over tiles.
pub struct VertexLights {
    light: VertexLight,
    report: VertexReport,
    pairs: Thinned<difference::Pair>,
}

impl VertexLights {
    /// None yet: 0 at all vertices of the scene.
    pub fn new(scene: &Scene) -> Self {
        VertexLights {
            light: VertexLight {
                instances: empty(scene),
                split: vec![Vec::new(); scene.instances.len()],
            },
            report: VertexReport::default(),
            pairs: Thinned::default(),
        }
    }

    /// Adds the vertices of a tile's instances: fitted to its lumels, and gathered separately where
    /// lumels are too large. `gatherer` is the one for lumels.
    ///
    /// # Errors
    /// [`Cancelled`] if the monitor asks for it.
    pub fn add(
        &mut self,
        gatherer: &Gatherer,
        layout: &Layout,
        mut map: LumelMap,
        options: VertexOptions,
        monitor: &dyn Monitor,
    ) -> Result<(), Cancelled> {
        // Means over lumels that a wall cuts are for measurements; vertices must not read them.
        let places = (gatherer.options.open_only).then(|| LumelPlace::find(&map));
        let light: Vec<LumelLight> = map.received.iter().map(LumelLight::of).collect();
        map.received = Vec::new();
        let vertices = VertexBake {
            world: gatherer.world(),
            layout,
            map: &map,
            light: &light,
            places: places.as_deref(),
            error: options.error,
        };
        // Vertices store a single colour.
        let gatherer = Gatherer {
            wanted: Wanted::default(),
            ..gatherer.with(options.gather)
        };
        vertices.run(&gatherer, monitor, self)
    }

    /// Light and report.
    pub fn finish(mut self) -> (VertexLight, VertexReport) {
        self.report.difference = difference::summarise(self.pairs.items());
        (self.light, self.report)
    }
}

/// Inputs of light at vertices.
struct VertexBake<'b, 'w, 'a> {
    pub world: &'w World<'a>,
    pub layout: &'b Layout,
    pub map: &'b LumelMap,
    /// By lumel.
    pub light: &'b [LumelLight],
    /// By lumel; `None` if lumels must not be read.
    pub places: Option<&'b [LumelPlace]>,
    /// See [`VertexOptions::error`](crate::VertexOptions::error).
    pub error: Option<f32>,
}

impl VertexBake<'_, '_, '_> {
    /// Adds the irradiance at every vertex that a triangle uses.
    fn run(
        &self,
        gatherer: &Gatherer,
        monitor: &dyn Monitor,
        out: &mut VertexLights,
    ) -> Result<(), Cancelled> {
        let scene = self.world.scene;
        let index = &self.map.index;
        let lights = SharpLights::new(self.world);
        let mut sheets: Vec<Sheet> = (0..scene.instances.len())
            .into_par_iter()
            .filter(|&i| scene.has_lightmap(i) && self.map.has(i))
            .map(|i| {
                let parts = (self.world, &lights);
                let mut sheet = Sheet::build(parts, self.layout, &self.map.lumels, i);
                self.measure(&mut sheet, index);
                sheet
            })
            .collect();
        let report = &mut out.report;
        let floor = 0.01 * self.mean_luminance();
        let known = self.small_triangles(&sheets, floor, (gatherer, monitor), report)?;
        let fitted: Vec<Fitted> = sheets
            .par_iter_mut()
            .zip(known)
            .map(|(sheet, known)| self.fit(sheet, known, floor, index))
            .collect();
        for (sheet, fitted) in sheets.iter().zip(fitted) {
            report.points += sheet.points as u64;
            report.added += sheet.parents.len() as u64;
            report.full += u64::from(fitted.full);
            out.pairs.extend(fitted.pairs);
            fill(sheet, &fitted.values, scene, self.world, &mut out.light);
        }
        Ok(())
    }

    fn measure(&self, sheet: &mut Sheet, index: &TexelIndex) {
        let placement = &self.layout.placements[sheet.instance];
        for tri in &mut sheet.tris {
            if !tri.moments.measured() {
                tri.moments = Moments::of((&tri.page, tri.area), placement, index, self.light);
            }
        }
    }

    /// For each sheet and point, the light over the small triangles around it: read from
    /// surrounding lumels ([`read`]), or gathered if they are not sufficient. `None` without such
    /// triangles.
    fn small_triangles(
        &self,
        sheets: &[Sheet],
        floor: f64,
        (gatherer, monitor): (&Gatherer, &dyn Monitor),
        report: &mut VertexReport,
    ) -> Result<Vec<Vec<Option<Vec3>>>, Cancelled> {
        let (direct, index) = (&gatherer.tracer.direct, &self.map.index);
        let (mut out, rays): (Vec<Vec<Option<Vec3>>>, Vec<u64>) = (sheets.par_iter())
            .map(|sheet| {
                let Some(places) = self.places else {
                    return (vec![None; sheet.points], 0);
                };
                let reader = Reader {
                    world: self.world,
                    direct,
                    placement: &self.layout.placements[sheet.instance],
                    index,
                    light: self.light,
                    places,
                    floor: floor as f32,
                    rays: Cell::new(0),
                };
                (reader.read(sheet), reader.rays.get())
            })
            .unzip();
        report.read += out.iter().flatten().flatten().count() as u64;
        let mut jobs: Vec<Job> = Vec::new();
        for (s, (sheet, known)) in sheets.iter().zip(&out).enumerate() {
            // The first vertex of each point determines its seed.
            let mut seeds = vec![None; sheet.points];
            for v in &sheet.vertices {
                seeds[v.point as usize].get_or_insert_with(|| {
                    let instance = hash_u32(sheet.instance as u32 ^ 0x51ed_270b);
                    hash_u32(v.index ^ hash_u32(v.primitive ^ instance))
                });
            }
            let spokes = sheet.spokes(self.world.soup, |point| known[point].is_none());
            for (point, spokes) in spokes.into_iter().enumerate() {
                if !spokes.is_empty() {
                    jobs.push(Job {
                        sheet: s as u32,
                        point: point as u32,
                        spokes,
                        seed: seeds[point].unwrap_or(0),
                    });
                }
            }
        }
        let received = gathered::gather(&jobs, sheets, gatherer, monitor)?;
        report.gathered += received.len() as u64;
        report.rays += rays.iter().sum::<u64>() + received.iter().map(|r| r.rays).sum::<u64>();
        for (job, r) in jobs.iter().zip(&received) {
            out[job.sheet as usize][job.point as usize] = Some(r.direct + r.indirect);
        }
        Ok(out)
    }

    fn fit(
        &self,
        sheet: &mut Sheet,
        gathered: Vec<Option<Vec3>>,
        floor: f64,
        index: &TexelIndex,
    ) -> Fitted {
        let known: Vec<Vec3> = gathered.iter().map(|g| g.unwrap_or_default()).collect();
        let mut values = fit::fit(sheet, &known);
        let mut full = false;
        if let Some(error) = self.error {
            // Parts of triangles may be too small for the lumels although the whole was not; their
            // corners keep the whole's light.
            let mut gathered: Vec<Vec3> = (gathered.iter().zip(&values))
                .map(|(g, v)| g.unwrap_or(*v))
                .collect();
            let options = SplitOptions {
                error: f64::from(error),
                floor,
                most: MOST_ADDED_VERTICES,
            };
            full = split::refine(sheet, &mut values, &mut gathered, &options, |sheet| {
                self.measure(sheet, index);
            });
        }
        let placement = &self.layout.placements[sheet.instance];
        let lumels = &self.map.lumels.lumels;
        let first = lumels.partition_point(|l| (l.instance as usize) < sheet.instance);
        let end = lumels.partition_point(|l| (l.instance as usize) <= sheet.instance);
        let pairs = difference::pairs(sheet, &values, placement, index, self.light, first..end);
        Fitted {
            values,
            full,
            pairs,
        }
    }

    /// Mean luminance of the lightmap, weighted by coverage.
    fn mean_luminance(&self) -> f64 {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (l, light) in self.map.lumels.lumels.iter().zip(self.light) {
            sum += f64::from(l.coverage * luminance(light.e));
            weight += f64::from(l.coverage);
        }
        sum / f64::max(weight, f64::MIN_POSITIVE)
    }
}

/// One instance's values.
struct Fitted {
    /// By point.
    values: Vec<Vec3>,
    full: bool,
    pairs: Vec<difference::Pair>,
}

fn empty(scene: &Scene) -> Vec<Vec<Vec<[f32; 3]>>> {
    (scene.instances.iter())
        .map(|i| {
            (scene.meshes[i.mesh].primitives.iter())
                .map(|p| vec![[0.0; 3]; p.positions.len()])
                .collect()
        })
        .collect()
}

/// Stores a sheet's values and splits for the writers.
fn fill(sheet: &Sheet, values: &[Vec3], scene: &Scene, world: &World, out: &mut VertexLight) {
    let light = &mut out.instances[sheet.instance];
    for (list, count) in light.iter_mut().zip(&sheet.counts) {
        list.resize(*count as usize, [0.0; 3]);
    }
    for v in &sheet.vertices {
        light[v.primitive as usize][v.index as usize] = values[v.point as usize].to_array();
    }
    if sheet.parents.is_empty() {
        return;
    }
    let primitives = &scene.meshes[scene.instances[sheet.instance].mesh].primitives;
    let mut split = vec![SplitPrimitive::default(); primitives.len()];
    let own = sheet.vertices.len() - sheet.parents.len();
    for (v, pair) in sheet.vertices[own..].iter().zip(&sheet.parents) {
        let parents = pair.map(|p| sheet.vertices[p as usize].index);
        split[v.primitive as usize].parents.push(parents);
    }
    for tri in &sheet.tris {
        let source = world.soup.source(tri.face);
        let corners = tri.corners.map(|c| sheet.vertices[c as usize].index);
        (split[source.primitive as usize].triangles).push((source.triangle, corners));
    }
    for primitive in &mut split {
        // Stable, so parts of a triangle stay in order.
        primitive.triangles.sort_by_key(|t| t.0);
    }
    out.split[sheet.instance] = split;
}
