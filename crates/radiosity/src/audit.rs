//! Energy balance: emitted = absorbed + escaped, within a computed bound.
//!
//! The two sides are measured independently, so that any loss shows. Emitted flux is exact (Φ =
//! 4πI, Φ = πLA). Where it goes is measured with rays *from* the lamps and from each patch, and
//! what arrives is the solver's result *at* each element and patch. Both agree if reciprocity
//! holds, A_i F_ij = A_j F_ji, which rays satisfy up to noise. The bound is four standard errors of
//! that noise, estimated from the rays themselves, plus what relaxation and rounding may leave.

use glam::{DVec3, Vec3};
use patch_subdivision::{PatchId, Subdivision};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::lamps::LampFlux;
use crate::links::{BLACK, ESCAPED, Links, NOWHERE};
use crate::relax::RelaxReport;
use crate::solve::PatchSurfaces;
use crate::world::{Emission, World, luminance};

/// Number of standard errors that the bound allows. A sum over thousands of rows is approximately
/// normal and exceeds four standard errors once in 16,000 cases.
const SIGMAS: f64 = 4.0;

/// Share of a row's rays that may be lost before the row is reported. A watertight scene loses
/// none. A scene whose vertices do not quite meet loses some along its edges.
const ROW_BOUND: f64 = 0.01;

/// A scene is nearly closed if fewer than one ray in this many escapes.
const NEARLY_CLOSED: u64 = 100;

/// Maximum number of nodes to report: those with the most rows.
const MOST_NODES: usize = 32;

/// Energy balance, and row sums of the form-factor matrix.
///
/// Fluxes are in W, or in lm if the scene is photometric. Imbalance and bounds are shares of the
/// emitted flux, by luminance.
///
/// The emission of a sun is the flux that reaches the scene's surfaces, and that of the sky is the
/// flux that arrives on them: neither has a flux of its own. For the sky alone, there is therefore
/// nothing to compare arrival with. A lamp with a `range` loses light on the way, as the glTF
/// extension specifies; its emission is the flux that arrives.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Audit {
    /// Flux that lamps, emissive surfaces, suns and the sky emit into the scene (RGB).
    pub flux_emitted: [f64; 3],
    /// Flux that surfaces receive from these before any reflection (RGB).
    pub flux_in: [f64; 3],
    /// Flux that surfaces absorb over all reflections, including absorption in glass on the way
    /// (RGB).
    pub flux_absorbed: [f64; 3],
    /// Flux that ends on the backs of single-sided faces, which are black (RGB).
    pub flux_behind: [f64; 3],
    /// Flux that leaves the scene (RGB).
    pub flux_escaped: [f64; 3],
    /// (emitted − absorbed − behind − escaped) / emitted.
    pub imbalance: f64,
    /// Maximum permitted imbalance: the sum of `bounds`.
    pub bound: f64,
    /// The components of the bound.
    pub bounds: AuditBounds,
    /// Whether `imbalance` does not exceed `bound`.
    pub within_bound: bool,
    /// Mean share of a row that reaches surfaces.
    pub row_sum_mean: f64,
    /// Minimum share of a row that reaches surfaces; 1 everywhere in a closed scene.
    pub row_sum_min: f64,
    /// Rays that left the scene.
    pub rays_escaped: u64,
    /// Rays lost on the backs of single-sided faces.
    pub rays_behind: u64,
    /// Rays lost on surfaces without a patch.
    pub rays_nowhere: u64,
    /// Rows with at least one escaped ray.
    pub rows_open: u64,
    /// Tolerance on a row's sum, surfaces and sky together: it is below 1 by the share of rays that
    /// hit backfaces.
    pub row_bound: f64,
    /// Rows whose sum falls short by more.
    pub rows_beyond: u64,
    /// Nodes with such rows, most rows first, 32 at most.
    pub beyond: Vec<RowsOfNode>,
    /// Nodes with open rows, if less than 1 % of all rays escape: gaps in a nearly closed scene.
    pub gaps: Vec<RowsOfNode>,
}

/// The components of [`Audit::bound`], as shares of the emitted flux.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct AuditBounds {
    /// Four standard errors of reciprocity, from the spread of each row's rays around their mean,
    /// element by element.
    pub rays: f64,
    /// Four standard errors of direct light, which is evaluated at one point per element; from the
    /// spread over the elements of a patch.
    pub direct: f64,
    /// Four standard errors of the destination of lamp light, from the rays cast from the lamps.
    pub lamps: f64,
    /// Undistributed light after relaxation.
    pub residual: f64,
    /// Rounding in `f32` sums.
    pub rounding: f64,
}

/// Rows of a node that fall short or are open.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RowsOfNode {
    /// The node's name, or `node` and its index in the document.
    pub node: String,
    /// Number of rows.
    pub rows: u64,
    /// The smallest of their sums: surfaces and sky (`beyond`), or surfaces alone (`gaps`).
    pub least: f64,
    /// Position of the patch of that row, in the document's world space, in metres.
    pub at: [f64; 3],
}

/// The contribution of one patch.
#[derive(Default, Clone, Copy)]
struct Row {
    emitted: DVec3,
    received: DVec3,
    absorbed: DVec3,
    behind: DVec3,
    escaped: DVec3,
    /// Variances of luminous flux.
    rays: f64,
    direct: f64,
    hits: u32,
    open: u32,
    black: u32,
    nowhere: u32,
}

impl Row {
    /// Number of its rays.
    fn cast(&self) -> u32 {
        self.hits + self.open + self.black + self.nowhere
    }
}

/// What a patch sends out per surface area: means over its elements.
struct Outgoing {
    /// Mean presence (alpha).
    solid: f64,
    /// π × radiance that gathering rays see.
    glow: DVec3,
    /// π × radiance that direct light samples.
    lamp: DVec3,
    /// ρE.
    reflected: DVec3,
    /// Flux per area of emission that varies within triangles, which is known only at the elements'
    /// points.
    textured: DVec3,
    /// Variances of luminous flux due to one sample point per element: direct irradiance with
    /// `textured`, and other emission, which only matters if part of it is lost.
    spread: f64,
    spread_plain: f64,
}

impl Outgoing {
    fn new(
        world: &World,
        cut: &Subdivision,
        surfaces: &PatchSurfaces,
        direct: &[Vec3],
        indirect: DVec3,
        patch: usize,
    ) -> Self {
        let range = cut.elements_of(PatchId(patch as u32));
        let m = range.len() as f64;
        let (mut solid, mut glow, mut lamp, mut area) = (0f64, DVec3::ZERO, DVec3::ZERO, 0f64);
        let mut textured = DVec3::ZERO;
        // Luminance that each element receives directly and sends, per area.
        let (mut got, mut varied, mut plain) = ([0f64; 16], [0f64; 16], [0f64; 16]);
        let mut areas = [0f64; 16];
        for (slot, k) in range.enumerate() {
            let e = cut.elements()[k];
            let a = e.area as f64;
            area += a;
            solid += a * world.scene.presence(world.soup, e.triangle, e.u, e.v) as f64;
            let emission = world.emission(e.triangle);
            let mut out = DVec3::ZERO;
            if emission != Emission::None {
                let l = world.scene.emitted(world.soup, e.triangle, e.u, e.v);
                out = l.as_dvec3() * std::f64::consts::PI;
            }
            if emission == Emission::Sampled {
                lamp += out * a;
            } else {
                glow += out * a;
            }
            let slot = slot.min(15);
            (got[slot], areas[slot]) = (luminance(direct[k]) as f64, a);
            if varies(world, e.triangle) {
                textured += out * a;
                varied[slot] = lum(out);
            } else {
                plain[slot] = lum(out);
            }
        }
        let s = 1.0 / area.max(1e-300);
        // Per area that is present, like reflected light.
        let there = 1.0 / solid.max(1e-300);
        let spread = |x: &[f64; 16]| -> f64 {
            if m < 2.0 {
                // With nothing to compare with, the value itself is the deviation, as if it could
                // equally be twice as large or zero.
                return (areas[0] * x[0]).powi(2);
            }
            let mean: f64 = x.iter().zip(&areas).map(|(x, a)| x * a).sum::<f64>() * s;
            let squares = x.iter().zip(&areas).map(|(x, a)| (a * (x - mean)).powi(2));
            squares.sum::<f64>() * m / (m - 1.0)
        };
        Outgoing {
            solid: solid * s,
            glow: glow * there,
            lamp: lamp * there,
            reflected: surfaces.direct_radiosity[patch] + surfaces.reflectance[patch] * indirect,
            textured: textured * there,
            spread: spread(&got) + spread(&varied),
            // A patch of one element almost always has a single material.
            spread_plain: if m < 2.0 { 0.0 } else { spread(&plain) },
        }
    }
}

fn lum(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Whether emission or presence varies over the triangle.
fn varies(world: &World, triangle: u32) -> bool {
    let material = &world.scene.materials[world.soup.materials[triangle as usize] as usize];
    material.emissive_texture.is_some() || material.lets_light_through()
}

/// Flux of all emissive triangles with uniform emission: π L A for each side that shines.
fn plain_emission(world: &World) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for (t, area) in world.soup.areas.iter().enumerate() {
        let t = t as u32;
        if world.emission(t) != Emission::None && !varies(world, t) {
            let l = world.scene.emission(world.soup, t, 1.0 / 3.0, 1.0 / 3.0);
            let sides = 1.0 + world.two_sided(t) as u32 as f64;
            sum += l.as_dvec3() * (std::f64::consts::PI * sides * *area as f64);
        }
    }
    sum
}

/// Balances the emitted light with the arrivals in `direct` (per element) and `indirect` (per
/// patch).
pub(crate) fn audit(
    world: &World,
    cut: &Subdivision,
    links: &Links,
    surfaces: &PatchSurfaces,
    direct: &[Vec3],
    indirect: &[DVec3],
    relaxation: &RelaxReport,
) -> Audit {
    let n = links.patches;
    let outgoing: Vec<Outgoing> = (0..n)
        .into_par_iter()
        .map(|i| Outgoing::new(world, cut, surfaces, direct, indirect[i], i))
        .collect();
    let seen: Vec<f64> = outgoing.iter().map(|o| lum(o.reflected + o.glow)).collect();
    let rows: Vec<Row> = (0..n)
        .into_par_iter()
        .with_min_len(64)
        .map(|i| {
            if cut.patches()[i].hidden {
                return Row::default();
            }
            let (o, area) = (&outgoing[i], surfaces.area[i] * outgoing[i].solid);
            let out = o.reflected + o.glow + o.lamp;
            let mut row = Row::default();
            // The luminance that a ray takes along minus what it would return. By reciprocity, the
            // mean over all patches is 0.
            let level = lum(out);
            let (mut sum, mut squares) = (0f64, 0f64);
            let (mut by_element, mut count) = ([0f64; 16], [0f64; 16]);
            // Absorbed by glass on the way.
            let mut taken = DVec3::ZERO;
            let mut lost_behind = DVec3::ZERO;
            let mut lost_outside = DVec3::ZERO;
            for (k, (&j, e)) in (links.row(i).iter())
                .zip(links.origins(cut, PatchId(i as u32)))
                .enumerate()
            {
                let tint = links.tint(i, k);
                taken += DVec3::ONE - tint;
                match j {
                    ESCAPED => lost_outside += tint,
                    BLACK | NOWHERE => lost_behind += tint,
                    _ => {}
                }
                let gain = match j {
                    ESCAPED => {
                        row.open += 1;
                        0.0
                    }
                    BLACK => {
                        row.black += 1;
                        0.0
                    }
                    NOWHERE => {
                        row.nowhere += 1;
                        0.0
                    }
                    j => {
                        row.hits += 1;
                        (level - seen[j as usize]) * lum(tint)
                    }
                };
                sum += gain;
                squares += gain * gain;
                by_element[e.min(15)] += gain;
                count[e.min(15)] += 1.0;
            }
            let rays = f64::from(row.cast().max(1));
            let mean = sum / rays;
            let independent = squares - sum * mean;
            // Rays from one point of one element are correlated, and the point is as random as they
            // are. A single element has no others to differ from, so it is compared with 0.
            let mean = match cut.elements_of(PatchId(i as u32)).len() {
                1 => 0.0,
                _ => mean,
            };
            let clustered: f64 = (by_element.iter().zip(&count))
                .map(|(s, n)| (s - n * mean).powi(2))
                .sum();
            let weight = area / rays;
            row.rays = independent.max(clustered) * weight * weight;
            let lost = 1.0 - row.hits as f64 / rays;
            row.direct = (o.spread + o.spread_plain * lost * lost) * o.solid * o.solid;
            let (direct, source) = (surfaces.direct[i], links.all_sources(i).as_dvec3());
            row.emitted = (o.textured + links.sky(i).as_dvec3()) * area;
            row.received = (direct + source) * area;
            row.absorbed = (direct + indirect[i] - o.reflected) * area + out * taken * weight;
            row.behind = out * lost_behind * weight;
            row.escaped = out * lost_outside * weight;
            row
        })
        .collect();
    let lamps = LampFlux::measure(world);
    balance(world, cut, surfaces, indirect, relaxation, &rows, &lamps)
}

fn balance(
    world: &World,
    cut: &Subdivision,
    surfaces: &PatchSurfaces,
    indirect: &[DVec3],
    relaxation: &RelaxReport,
    rows: &[Row],
    lamps: &LampFlux,
) -> Audit {
    let mut total = Row {
        emitted: lamps.emitted + plain_emission(world),
        absorbed: lamps.taken,
        behind: lamps.behind,
        escaped: lamps.escaped,
        ..Row::default()
    };
    let mut out = Audit {
        row_sum_min: 1.0,
        row_bound: ROW_BOUND,
        ..Audit::default()
    };
    let (mut reach, mut left, mut indirect_flux) = (0f64, 0f64, 0f64);
    let (mut most_rays, mut all) = (0, 0u64);
    let mut most_reflecting = 0f64;
    let seen = || (rows.iter().enumerate()).filter(|(i, _)| !cut.patches()[*i].hidden);
    for (i, r) in seen() {
        total.emitted += r.emitted;
        total.received += r.received;
        total.absorbed += r.absorbed;
        total.behind += r.behind;
        total.escaped += r.escaped;
        total.rays += r.rays;
        total.direct += r.direct;
        let share = f64::from(r.hits) / f64::from(r.cast().max(1));
        most_rays = most_rays.max(r.cast());
        all += u64::from(r.cast());
        reach += share;
        out.row_sum_min = out.row_sum_min.min(share);
        out.rays_escaped += r.open as u64;
        out.rays_behind += r.black as u64;
        out.rays_nowhere += r.nowhere as u64;
        out.rows_open += (r.open > 0) as u64;
        out.rows_beyond += beyond(r) as u64;
        most_reflecting = most_reflecting.max(surfaces.reflectance[i].max_element());
        indirect_flux += lum(indirect[i]) * surfaces.area[i];
    }
    out.row_sum_mean = reach / seen().count().max(1) as f64;
    out.flux_emitted = total.emitted.to_array();
    out.flux_in = total.received.to_array();
    out.flux_absorbed = total.absorbed.to_array();
    out.flux_behind = total.behind.to_array();
    out.flux_escaped = total.escaped.to_array();
    let emitted = lum(total.emitted);
    if emitted > 0.0 && all > 0 {
        let balance = total.emitted - total.absorbed - total.behind - total.escaped;
        out.imbalance = lum(balance) / emitted;
        // `residual` bounds Σ A|r| / (1 − ρ), as a share of what arrives; r is what the balance
        // lacks.
        left += relaxation.residual * (1.0 - most_reflecting.min(0.9999)) * indirect_flux;
        let sigmas = |variance: f64| SIGMAS * variance.sqrt() / emitted;
        out.bounds = AuditBounds {
            rays: sigmas(total.rays),
            direct: sigmas(total.direct),
            lamps: sigmas(lamps.variance),
            residual: left / emitted,
            // A row's light from outside is a sum of as many f32 numbers as it has rays, followed by some ten
            // operations. E exceeds the emitted light by the factor that interreflection adds.
            rounding: (f64::from(most_rays) + 10.0)
                * 2f64.powi(-24)
                * (1.0 + indirect_flux / emitted),
        };
        let b = &out.bounds;
        // The three samplings are independent.
        out.bound =
            (b.rays.powi(2) + b.direct.powi(2) + b.lamps.powi(2)).sqrt() + b.residual + b.rounding;
    }
    out.within_bound = out.imbalance.abs() <= out.bound;
    if out.rows_beyond > 0 {
        let sum = |r: &Row| beyond(r).then(|| f64::from(r.hits + r.open) / f64::from(r.cast()));
        out.beyond = by_node(world, cut, rows, sum);
    }
    if out.rays_escaped > 0 && out.rays_escaped < all / NEARLY_CLOSED {
        let sum = |r: &Row| (r.open > 0).then(|| f64::from(r.hits + r.black) / f64::from(r.cast()));
        out.gaps = by_node(world, cut, rows, sum);
    }
    out
}

fn beyond(r: &Row) -> bool {
    (r.black + r.nowhere) as f64 > ROW_BOUND * f64::from(r.cast())
}

/// Groups the rows for which `sum` returns a value by node.
fn by_node(
    world: &World,
    cut: &Subdivision,
    rows: &[Row],
    sum: impl Fn(&Row) -> Option<f64>,
) -> Vec<RowsOfNode> {
    let mut nodes = vec![RowsOfNode::default(); world.scene.instances.len()];
    for (i, row) in rows.iter().enumerate() {
        let Some(sum) = sum(row) else { continue };
        let e = cut.elements()[cut.patches()[i].first_element as usize];
        let instance = world.soup.sources[e.triangle as usize].instance as usize;
        let node = &mut nodes[instance];
        if node.rows == 0 || sum < node.least {
            let p = world.surface_point(e.triangle, e.u, e.v, false, false);
            node.least = sum;
            node.at = (p.position.as_dvec3() + world.scene.origin).to_array();
        }
        node.rows += 1;
    }
    for (node, instance) in nodes.iter_mut().zip(&world.scene.instances) {
        node.node = if instance.name.is_empty() {
            format!("node {}", instance.node)
        } else {
            instance.name.clone()
        };
    }
    nodes.retain(|n| n.rows > 0);
    // A stable sort keeps nodes with equally many rows in scene order.
    nodes.sort_by_key(|n| std::cmp::Reverse(n.rows));
    nodes.truncate(MOST_NODES);
    nodes
}

#[cfg(test)]
mod tests;
