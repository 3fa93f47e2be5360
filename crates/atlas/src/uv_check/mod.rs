//! Checks whether an asset's own `TEXCOORD_1` can serve as lightmap coordinates, and at which size.

mod fault;

use glam::{DVec2, Vec2};
use mesh_ingest::Mesh;

use crate::atlas::{MeshAtlas, PrimitiveAtlas, UvOrigin};
use crate::overlap::{Bleeding, Overlaps};
use crate::unwrap::{UnwrapInput, weighted_median};

pub use fault::{Severity, UvFault, UvFaultKind, UvPlace};

/// Largest allowed fraction of covered texels under two triangles. Shared borders in authors'
/// atlases cross a few texel centres; real overlaps (tiled or mirrored layouts) are far above this.
const MAX_OVERLAP: f64 = 0.005;

/// How far a coordinate may be outside 0..1: the rounding of quantised coordinates, far below a
/// texel.
const RANGE_SLACK: f32 = 1e-4;

/// Largest allowed fraction of the surface without area in the lightmap.
const MAX_COLLAPSED: f64 = 0.01;

/// Least side of the grid for finding overlaps, texels, because a small lightmap could miss them
/// between its centres.
const LEAST_GRID: u32 = 256;

/// Fraction of the covered area whose lookups may read another chart's lumels: a few corners. Charts
/// without padding mix along their whole border, which is a dark line wherever one is outside of the
/// level; on walls of 25 lumels that is only 7 % of the area (lab/unseen_levels.md).
const CLOSE: f64 = 0.01;

/// Densities that differ by more than this factor (99 % and 1 % quantiles by area) give a warning.
const UNEVEN: f64 = 4.0;

/// Choice of lightmap coordinates.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UvMode {
    /// The asset's `TEXCOORD_1` if it has no [bad](Severity::Bad) fault, else new coordinates.
    #[default]
    Auto,
    /// The asset's `TEXCOORD_1` if it is usable at all, with warnings.
    Keep,
    /// Always new coordinates.
    Generate,
}

/// Result of checking an asset's own coordinates.
#[derive(Debug, Clone)]
pub struct OwnUvs {
    /// Their faults, in the order of [`UvFaultKind`].
    pub faults: Vec<UvFault>,
    /// Charts made from them; `None` if they are [unusable](Severity::Unusable).
    pub atlas: Option<MeshAtlas>,
    /// Reached density relative to the requested one; below 1 if the size was limited.
    pub reached: f32,
}

impl OwnUvs {
    /// The worst fault.
    pub fn worst(&self) -> Option<&UvFault> {
        // The first of equally bad ones.
        let faults = self.faults.iter().rev();
        faults.max_by_key(|f| f.severity)
    }
}

/// Checks `mesh`'s `TEXCOORD_1` as lightmap coordinates, at a size where the median texel density
/// is one texel per unit of `input`, which is the same mesh welded and scaled to lumels.
///
/// `None` if no primitive has the set. Texel coordinates are exactly `TEXCOORD_1 × size`, so a
/// writer may leave the attribute unchanged.
pub fn check_uvs(mesh: &Mesh, input: &UnwrapInput, max_size: u32) -> Option<OwnUvs> {
    let present = |p: &mesh_ingest::Primitive| p.tex_coords.get(1).is_some_and(|c| !c.is_empty());
    if !mesh.primitives.iter().any(present) {
        return None;
    }
    let mut check = Check::new(mesh, input);
    let usable = check.read();
    check.collapsed();
    if !usable {
        return Some(OwnUvs {
            faults: check.faults,
            atlas: None,
            reached: 1.0,
        });
    }
    let (size, reached) = check.size(max_size);
    check.overlap(size);
    check.close(size);
    check.uneven(size);
    check.mirrored();
    let atlas = check.atlas(size);
    Some(OwnUvs {
        faults: check.faults,
        atlas: Some(atlas),
        reached,
    })
}

/// One mesh under examination.
struct Check<'a> {
    mesh: &'a Mesh,
    input: &'a UnwrapInput,
    /// Coordinates of each triangle's corners; zero if there are none.
    flat: Vec<[Vec2; 3]>,
    /// Area of each triangle, lumels.
    areas: Vec<f64>,
    total: f64,
    faults: Vec<UvFault>,
}

/// Triangles with the same fault, and the worst of them.
#[derive(Default)]
struct Tally {
    triangles: u64,
    area: f64,
    worst: Option<(f64, usize, Option<Vec2>)>,
}

impl Tally {
    /// Counts triangle `t` with severity `badly` near `at`. The first of equally bad ones is the
    /// worst.
    fn add(&mut self, t: usize, area: f64, badly: f64, at: Option<Vec2>) {
        self.triangles += 1;
        self.area += area;
        if self.worst.is_none_or(|(worst, ..)| badly > worst) {
            self.worst = Some((badly, t, at));
        }
    }
}

impl<'a> Check<'a> {
    fn new(mesh: &'a Mesh, input: &'a UnwrapInput) -> Self {
        let areas = input.areas();
        Check {
            mesh,
            input,
            flat: Vec::with_capacity(areas.len()),
            total: areas.iter().sum(),
            areas,
            faults: Vec::new(),
        }
    }

    /// The asset's indices of triangle `t`.
    fn place(&self, t: usize, uv: Option<Vec2>) -> UvPlace {
        let number = self.input.primitive[t] as usize;
        let before: usize = (self.mesh.primitives[..number].iter())
            .map(|p| p.triangles.len())
            .sum();
        let primitive = &self.mesh.primitives[number];
        UvPlace {
            primitive: primitive.gltf_primitive,
            triangle: primitive
                .source_triangles
                .get(t - before)
                .copied()
                .unwrap_or(0),
            uv: uv.filter(|p| p.is_finite()).map(|p| p.to_array()),
        }
    }

    fn middle(&self, t: usize) -> Vec2 {
        let [a, b, c] = self.flat[t];
        (a + b + c) / 3.0
    }

    /// Adds the tallied fault, if any. `say` makes the message from the description of the place.
    fn report(
        &mut self,
        kind: UvFaultKind,
        severity: Severity,
        tally: &Tally,
        share: f64,
        say: impl Fn(&str) -> String,
    ) {
        let worst = tally.worst.map(|(_, t, at)| self.place(t, at));
        let place = worst.map_or(String::new(), |w| w.to_string());
        self.faults.push(UvFault {
            kind,
            severity,
            triangles: tally.triangles,
            share,
            worst,
            message: say(&place),
        });
    }

    /// Reads the coordinates; returns whether all exist, are finite and in range.
    fn read(&mut self) -> bool {
        let (mut missing, mut not_finite, mut outside) =
            (Tally::default(), Tally::default(), Tally::default());
        let mesh = self.mesh;
        for primitive in &mesh.primitives {
            let uv = primitive.tex_coords.get(1);
            let uv = uv.filter(|uv| uv.len() == primitive.positions.len());
            for triangle in &primitive.triangles {
                let t = self.flat.len();
                let area = self.areas[t];
                let Some(uv) = uv else {
                    missing.add(t, area, 0.0, None);
                    self.flat.push([Vec2::ZERO; 3]);
                    continue;
                };
                let corners = triangle.map(|v| uv[v as usize]);
                if !corners.iter().all(|p| p.is_finite()) {
                    not_finite.add(t, area, 0.0, None);
                    self.flat.push([Vec2::ZERO; 3]);
                    continue;
                }
                let beyond = |p: Vec2| (p - 1.0).max(-p).max_element();
                let far = corners.into_iter().fold(corners[0], |far, p| {
                    if beyond(p) > beyond(far) { p } else { far }
                });
                if beyond(far) > RANGE_SLACK {
                    outside.add(t, area, f64::from(beyond(far)), Some(far));
                }
                self.flat.push(corners);
            }
        }
        let total = self.total.max(f64::MIN_POSITIVE);
        let before = self.faults.len();
        if missing.triangles > 0 {
            self.report(
                UvFaultKind::Missing,
                Severity::Unusable,
                &missing,
                missing.area / total,
                |at| format!("a primitive has no TEXCOORD_1 ({at})"),
            );
        }
        if not_finite.triangles > 0 {
            let n = not_finite.triangles;
            self.report(
                UvFaultKind::NotFinite,
                Severity::Unusable,
                &not_finite,
                not_finite.area / total,
                |at| format!("coordinates of {n} triangles are not finite ({at})"),
            );
        }
        if let Some((_, _, Some(far))) = outside.worst {
            let n = outside.triangles;
            self.report(
                UvFaultKind::OutOfRange,
                Severity::Unusable,
                &outside,
                outside.area / total,
                |at| {
                    format!(
                        "coordinates of {n} triangles leave 0..1, up to ({:.3}, {:.3}) ({at})",
                        far.x, far.y
                    )
                },
            );
        }
        self.faults.len() == before
    }

    /// Surface without lumels.
    fn collapsed(&mut self) {
        // A ten-thousandth of a texel on a 4096² page.
        const MIN_AREA: f64 = 1e-4 / (4096.0 * 4096.0);
        let mut tally = Tally::default();
        let wrong =
            |kind: UvFaultKind| matches!(kind, UvFaultKind::Missing | UvFaultKind::NotFinite);
        if self.faults.iter().any(|f| wrong(f.kind)) {
            // Their triangles have no area here and were already reported.
            return;
        }
        for (t, (corners, &area)) in self.flat.iter().zip(&self.areas).enumerate() {
            if 0.5 * cross(corners).abs() < MIN_AREA && area > self.total * 1e-9 {
                tally.add(t, area, area, Some(self.middle(t)));
            }
        }
        let share = tally.area / self.total.max(f64::MIN_POSITIVE);
        if self.total <= 0.0 || share > MAX_COLLAPSED {
            let percent = 100.0 * share;
            self.report(UvFaultKind::Collapsed, Severity::Bad, &tally, share, |at| {
                format!("{percent:.1} % of the surface has no area in the lightmap ({at})")
            });
        }
    }

    /// Size of the rectangle in texels, and the reached density relative to the requested one.
    fn size(&self, max_size: u32) -> ([u32; 2], f32) {
        let ideal = ideal_size(self.input, &self.flat, &self.areas);
        let fit = (f64::from(max_size) / ideal.max_element()).min(1.0);
        let limit = max_size.max(1);
        let size = (ideal * fit)
            .to_array()
            // Rounded to a thousandth first, so that a scene in other units, whose sizes differ by
            // rounding, gets the same texels.
            .map(|s| {
                (((s * 1e3).round() * 1e-3).round() as u32)
                    .next_multiple_of(4)
                    .clamp(1, limit)
            });
        (size, fit as f32)
    }

    fn scaled(&self, size: [u32; 2]) -> Vec<[Vec2; 3]> {
        let scale = Vec2::new(size[0] as f32, size[1] as f32);
        self.flat.iter().map(|c| c.map(|p| p * scale)).collect()
    }

    /// Overlapping triangles.
    fn overlap(&mut self, size: [u32; 2]) {
        let covered: f64 = self.flat.iter().map(|c| 0.5 * cross(c).abs()).sum();
        // Coordinates that are tiled a thousandfold would fill the page once per triangle.
        if covered > 16.0 {
            let tally = Tally {
                triangles: self.flat.len() as u64,
                ..Tally::default()
            };
            self.report(UvFaultKind::Overlap, Severity::Bad, &tally, 1.0, |_| {
                format!("triangles overlap (they cover {covered:.0} times the unit square)")
            });
            return;
        }
        let grid = size.map(|s| s.max(LEAST_GRID));
        let found = Overlaps::find(&self.scaled(grid), grid);
        let share = found.share();
        if share <= MAX_OVERLAP {
            return;
        }
        let mut tally = Tally::default();
        for (t, &n) in found.by_triangle.iter().enumerate() {
            if n > 0 {
                let [x, y] = found.first[t].0;
                let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
                    / Vec2::new(grid[0] as f32, grid[1] as f32);
                tally.add(t, self.areas[t], f64::from(n), Some(at));
            }
        }
        let under = tally.worst.map(|(_, t, _)| found.first[t].1 as usize);
        let under = under.map_or(String::new(), |t| {
            let place = self.place(t, None);
            format!(" over {place}")
        });
        let percent = 100.0 * share;
        self.report(UvFaultKind::Overlap, Severity::Bad, &tally, share, |at| {
            format!("triangles overlap on {percent:.1} % of the texels ({at}{under})")
        });
    }

    /// Charts too close to each other, unless they overlap.
    fn close(&mut self, size: [u32; 2]) {
        // Overlapping charts are already reported.
        let overlap = |f: &UvFault| f.kind == UvFaultKind::Overlap;
        let chart = self.islands();
        if self.faults.iter().any(overlap) || chart.iter().all(|&c| c == chart[0]) {
            return;
        }
        let found = Bleeding::find(&self.scaled(size), &chart, size, |_, _| {});
        let share = found.share();
        if share <= CLOSE {
            return;
        }
        let mut tally = Tally::default();
        let scale = Vec2::new(size[0] as f32, size[1] as f32);
        for (t, &area) in found.by_triangle.iter().enumerate() {
            if area > 0.0 {
                tally.add(t, self.areas[t], area, Some(found.at[t].0 / scale));
            }
        }
        let (percent, [w, h]) = (100.0 * share, size);
        self.report(
            UvFaultKind::Close,
            Severity::Bad,
            &tally,
            share,
            |at| {
                format!(
                    "charts are too close together for {w} x {h} texels: {percent:.1} % of the lookups mix two ({at})"
                )
            },
        );
    }

    /// Places with far more or fewer lumels than others.
    fn uneven(&mut self, size: [u32; 2]) {
        let scaled = self.scaled(size);
        let mut list: Vec<(f64, f64, usize)> = Vec::with_capacity(scaled.len());
        for (t, (corners, &area)) in scaled.iter().zip(&self.areas).enumerate() {
            let texels = 0.5 * cross(corners).abs();
            if area > self.total * 1e-9 && texels > 0.0 {
                list.push(((texels / area).sqrt(), area, t));
            }
        }
        list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let total: f64 = list.iter().map(|d| d.1).sum();
        let quantile = |q: f64| {
            let mut seen = 0.0;
            list.iter()
                .find(|d| {
                    seen += d.1;
                    seen >= q * total
                })
                .or(list.last())
                .copied()
        };
        let (Some(low), Some(middle), Some(high)) = (quantile(0.01), quantile(0.5), quantile(0.99))
        else {
            return;
        };
        if high.0 <= UNEVEN * low.0 {
            return;
        }
        let mut tally = Tally::default();
        // The worst place has the fewest lumels, ignoring the last 1 %.
        for &(density, area, t) in list.iter().filter(|d| d.0 >= low.0) {
            let off = (density / middle.0).max(middle.0 / density);
            if off > 2.0 {
                let badly = if density < middle.0 { off } else { 0.0 };
                tally.add(t, area, badly, Some(self.middle(t)));
            }
        }
        let share = tally.area / self.total;
        let ratio = high.0 / low.0;
        self.report(
            UvFaultKind::Uneven,
            Severity::Warning,
            &tally,
            share,
            |at| {
                format!(
                    "density varies by a factor of {ratio:.1} ({:.2} to {:.2} of the requested density; {at})",
                    low.0, high.0
                )
            },
        );
    }

    /// Mirrored charts. Not a fault, but of interest to users who bake normal maps with the same
    /// set.
    fn mirrored(&mut self) {
        let mut tally = Tally::default();
        // Texture v points down, and front faces are counter-clockwise. The area of unmirrored
        // triangles is negative or positive here, depending on the direction of v in the modelling
        // program, so the sign of most of the surface counts as unmirrored.
        let signed = |t: usize| cross(&self.flat[t]).signum() * self.areas[t];
        let sum: f64 = (0..self.flat.len()).map(signed).sum();
        for t in 0..self.flat.len() {
            if cross(&self.flat[t]) * sum < 0.0 && self.areas[t] > self.total * 1e-9 {
                tally.add(t, self.areas[t], self.areas[t], Some(self.middle(t)));
            }
        }
        if tally.triangles > 0 {
            let share = tally.area / self.total;
            let (n, percent) = (tally.triangles, 100.0 * share);
            self.report(
                UvFaultKind::Mirrored,
                Severity::Note,
                &tally,
                share,
                |at| format!("{n} triangles ({percent:.1} % of the surface) are mirrored relative to the others ({at})"),
            );
        }
    }

    /// Pieces of the atlas: triangles connected by edges that coincide in space and in the atlas,
    /// also across primitives.
    fn islands(&self) -> Vec<u32> {
        // Welded vertex and bits of its coordinates.
        type End = (u32, [u32; 2]);
        let mut edges: Vec<([End; 2], u32)> = Vec::with_capacity(self.flat.len() * 3);
        for (t, (vertices, corners)) in self.input.triangles.iter().zip(&self.flat).enumerate() {
            let end = |k: usize| {
                let uv = (corners[k % 3] + Vec2::ZERO).to_array();
                (vertices[k % 3], uv.map(f32::to_bits))
            };
            for k in 0..3 {
                let (a, b) = (end(k), end(k + 1));
                edges.push((if a < b { [a, b] } else { [b, a] }, t as u32));
            }
        }
        edges.sort_unstable();
        let mut parent: Vec<u32> = (0..self.flat.len() as u32).collect();
        fn root(parent: &mut [u32], mut t: u32) -> u32 {
            while parent[t as usize] != t {
                parent[t as usize] = parent[parent[t as usize] as usize];
                t = parent[t as usize];
            }
            t
        }
        for pair in edges.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            let (a, b) = (root(&mut parent, pair[0].1), root(&mut parent, pair[1].1));
            parent[a.max(b) as usize] = a.min(b);
        }
        (0..self.flat.len() as u32)
            .map(|t| root(&mut parent, t))
            .collect()
    }

    fn atlas(&self, size: [u32; 2]) -> MeshAtlas {
        let (input, flat) = (self.input, &self.flat);
        // Neighbours are in the same chart if their coordinates agree at both ends of their edge.
        let agree = |t: usize, k: usize| {
            let u = input.neighbors[t][k] as usize;
            let ends = [
                (input.triangles[t][k], flat[t][k]),
                (input.triangles[t][(k + 1) % 3], flat[t][(k + 1) % 3]),
            ];
            ends.iter().all(|&(vertex, at)| {
                (0..3).any(|l| input.triangles[u][l] == vertex && flat[u][l] == at)
            })
        };
        let (chart, charts) = input.components(agree);
        let scale = Vec2::new(size[0] as f32, size[1] as f32);
        let mut first = 0;
        let primitives = self
            .mesh
            .primitives
            .iter()
            .map(|primitive| {
                let end = first + primitive.triangles.len();
                let uv = primitive.tex_coords.get(1).map_or(&[][..], Vec::as_slice);
                let atlas = PrimitiveAtlas {
                    xref: (0..primitive.positions.len() as u32).collect(),
                    uv: uv
                        .iter()
                        .map(|&p| {
                            // Unused vertices may have any coordinates.
                            let p = if p.is_finite() { p } else { Vec2::ZERO };
                            (p * scale).clamp(Vec2::ZERO, scale)
                        })
                        .collect(),
                    triangles: primitive.triangles.clone(),
                    chart: chart[first..end].to_vec(),
                    ..PrimitiveAtlas::default()
                };
                first = end;
                atlas
            })
            .collect();
        MeshAtlas {
            size,
            primitives,
            charts,
            origin: UvOrigin::Kept,
        }
    }
}

fn cross(corners: &[Vec2; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| p.as_dvec2());
    (b - a).perp_dot(c - a)
}

/// Lengths that the sides of the unit square represent (weighted medians).
fn ideal_size(input: &UnwrapInput, flat: &[[Vec2; 3]], areas: &[f64]) -> DVec2 {
    let mut along: [Vec<(f64, f64)>; 2] = [Vec::new(), Vec::new()];
    let mut side = Vec::new();
    for ((triangle, corners), &area) in input.triangles.iter().zip(flat).zip(areas) {
        let d = cross(corners);
        if d.abs() < 1e-14 || area <= 0.0 {
            continue;
        }
        let [p, q, r] = triangle.map(|v| input.positions[v as usize].as_dvec3());
        let [a, b, c] = corners.map(|v| v.as_dvec2());
        let su = (p * (b.y - c.y) + q * (c.y - a.y) + r * (a.y - b.y)) / d;
        let sv = (p * (c.x - b.x) + q * (a.x - c.x) + r * (b.x - a.x)) / d;
        along[0].push((su.length(), area));
        along[1].push((sv.length(), area));
        side.push(((2.0 * area / d.abs()).sqrt(), area));
    }
    let median = |list: &mut Vec<(f64, f64)>| {
        list.sort_by(|x, y| x.0.total_cmp(&y.0));
        weighted_median(list).max(1e-9)
    };
    let [u, v] = [median(&mut along[0]), median(&mut along[1])];
    // Randomly rotated charts make u and v differ slightly; a lightmap for a 2 : 1 image makes them
    // differ by a factor of two.
    if u.max(v) > 1.5 * u.min(v) {
        DVec2::new(u, v)
    } else {
        DVec2::splat(median(&mut side))
    }
}
