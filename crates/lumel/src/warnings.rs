//! Warnings of a bake: the problem, the nodes concerned, and what to do.

use std::collections::BTreeMap;

use atlas::LayoutReport;
use atlas_bake::Baked;
use gather::HiddenIn;
use mesh_ingest::{Loaded, Scene, Soup};
use radiosity::{Solution, SurfacePoint, World};

use crate::brightness;
use crate::likeness::{Likeness, unmarked_levels};
use crate::named::{node_of, some_of};
use crate::report::{audit_warnings, clamped_warning};
use crate::settings::Settings;
use crate::two_sides;

/// Fraction of hidden lumels that gives a warning. Props that intersect floors hide fewer.
const MANY_HIDDEN: f64 = 0.05;

/// Number of sampled triangles that decide whether an instance is inside something.
const LOOKED_AT: usize = 24;

/// Warnings from geometry alone, known before a bake.
pub(crate) fn of_geometry(world: &World, settings: &Settings) -> Vec<String> {
    let (scene, soup) = (world.scene, world.soup);
    let like = unmarked_levels(scene, soup, settings.lods);
    let mut out = Vec::new();
    out.extend(like_levels(scene, &like));
    out.extend(coincident(scene, soup));
    out.extend(inside(world, &like));
    out
}

fn like_levels(scene: &Scene, like: &[Likeness]) -> Option<String> {
    let names = |group: &Likeness| {
        let names: Vec<String> = group.iter().map(|i| node_of(scene, *i)).collect();
        names.join(" / ")
    };
    (!like.is_empty()).then(|| {
        format!(
            "objects of nearly the same size lie inside one another, like levels of detail or variants: {}; all of them cast shadows, so the inner ones bake black: \
             name them ..._LOD0, ..._LOD1, or set extras.lumel.lod or extras.lumel.variant",
            some_of(like.iter().map(names))
        )
    })
}

fn coincident(scene: &Scene, soup: &Soup) -> Option<String> {
    let mut pairs: BTreeMap<[u32; 2], u64> = BTreeMap::new();
    for d in &soup.duplicates {
        let on = soup.sources[d.kept as usize].instance;
        *pairs.entry([d.source.instance, on]).or_default() += 1;
    }
    let mut pairs: Vec<([u32; 2], u64)> = pairs.into_iter().collect();
    pairs.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    let names = pairs.iter().map(|([a, b], n)| {
        let [a, b] = [a, b].map(|i| node_of(scene, *i as usize));
        if a == b {
            format!("within {a} ({n})")
        } else {
            format!("{a} on {b} ({n})")
        }
    });
    (!pairs.is_empty()).then(|| {
        format!(
            "{} triangles coincide with others: {}; they get the same light, but will z-fight when drawn: delete one of the two, or mark them as variants \
             (extras.lumel.variant) if only one is shown at a time",
            soup.duplicates.len(),
            some_of(names)
        )
    })
}

/// Instances that are completely inside closed bodies, without those that look like levels of
/// detail.
fn inside(world: &World, like: &[Likeness]) -> Option<String> {
    let mut known = vec![false; world.scene.instances.len()];
    like.iter().flatten().for_each(|i| known[*i] = true);
    let found: Vec<String> = (0..known.len())
        .filter(|i| !known[*i] && world.scene.has_lumels(*i) && is_inside(world, *i))
        .map(|i| node_of(world.scene, i))
        .collect();
    (!found.is_empty()).then(|| {
        let count = found.len();
        let (node, lie) = if count == 1 { ("node", "lies") } else { ("nodes", "lie") };
        format!(
            "{count} {node} {lie} completely inside closed bodies, where no light arrives: {}; delete what is never visible, or give it no lumels (extras.lumel.density 0)",
            some_of(found)
        )
    })
}

/// Whether all of an instance is inside a body, judged by a sample of its triangles.
fn is_inside(world: &World, instance: usize) -> bool {
    let [first, end] = world.soup.instance_ranges[instance];
    let end = end.min(world.soup.seen() as u32);
    let step = (end.saturating_sub(first) as usize)
        .div_ceil(LOOKED_AT)
        .max(1);
    let third = 1.0 / 3.0;
    let point = |t| -> SurfacePoint { world.surface_point(t, third, third, false, false) };
    first < end
        && (first..end)
            .step_by(step)
            .all(|t| world.inside_a_body(&point(t)))
}

/// What the warnings of a finished bake are made from.
pub(crate) struct Warned<'w> {
    pub loaded: &'w Loaded,
    pub world: &'w World<'w>,
    pub clamped_materials: u64,
    pub layout: &'w LayoutReport,
    pub solution: &'w Solution,
    pub baked: &'w Baked,
    pub settings: &'w Settings,
    /// Whether the user was already warned that the bake will be black.
    pub foretold: bool,
}

impl Warned<'_> {
    pub fn list(self) -> Vec<String> {
        let ingest = &self.loaded.report;
        let mut out: Vec<String> = (ingest.warnings.iter())
            .map(|w| format!("{}: {}", w.path, w.message))
            .collect();
        for (reason, n) in ingest.left_out_by_reason() {
            out.push(format!("{n} nodes left out: {reason:?}").to_lowercase());
        }
        out.extend(clamped_warning(self.clamped_materials));
        out.extend(self.layout.warnings.iter().cloned());
        out.extend(of_geometry(self.world, self.settings));
        let audit = &self.solution.report.audit;
        if !self.foretold && audit.flux_in.iter().all(|f| *f == 0.0) {
            out.push(
                "the lightmap is black: no lamp or emissive material reaches any surface".into(),
            );
        }
        out.extend(audit_warnings(audit));
        out.extend(self.not_reached());
        out.extend(brightness::clamped_warning(&self.baked.pages));
        out.extend(self.hidden());
        out.extend(two_sides::warning(self.world, self.solution));
        out
    }

    /// Goals that were requested but not reached.
    fn not_reached(&self) -> Vec<String> {
        let mut out = Vec::new();
        let relaxation = &self.solution.report.relaxation;
        if !relaxation.converged {
            out.push(format!(
                "the solve did not converge: up to {:.2} % of the light is not distributed",
                100.0 * relaxation.residual
            ));
        }
        let gather = &self.baked.report.light;
        if let (Some(wanted), Some(false)) = (self.settings.error, gather.error_reached) {
            out.push(format!(
                "the requested error of {} % was not reached: the estimate is {:.2} %, and {} of {} lumels have the maximum number of samples; a higher --texels-per-unit helps near contacts",
                100.0 * wanted,
                100.0 * gather.estimated_error,
                gather.exhausted_lumels,
                gather.lumels
            ));
        }
        out
    }

    fn hidden(&self) -> Option<String> {
        let gather = &self.baked.report.light;
        let many = gather.hidden_lumels as f64 > MANY_HIDDEN * gather.lumels as f64;
        let one = |h: &HiddenIn| {
            let name = node_of(&self.loaded.scene, h.instance);
            let share = 100.0 * h.hidden as f64 / h.lumels.max(1) as f64;
            format!("{name} ({share:.0} % of {})", h.lumels)
        };
        many.then(|| {
            format!(
                "{} of {} lumels are inside geometry or behind single-sided faces, most of them on {}; this is harmless where props intersect floors, else check for inverted faces",
                gather.hidden_lumels,
                gather.lumels,
                some_of(gather.hidden.iter().map(one))
            )
        })
    }
}
