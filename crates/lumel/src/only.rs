//! `--only`: bakes nodes anew into the results of an earlier bake.

use std::collections::BTreeSet;
use std::path::Path;

use atlas_bake::Earlier;
use mesh_ingest::Scene;
use serde::Serialize;
use serde_json::Value;
use wildmatch::WildMatch;

use crate::beside::Beside;
use crate::earlier_bake::EarlierBake;
use crate::error::Error;
use crate::files::NamedFile;
use crate::joints::Order;
use crate::level_record::{LevelRecord, instances_of};
use crate::named::node_of;
use crate::open::{Solved, Start};
use crate::page_groups::{list, parents};
use crate::pipeline::{Bake, Elsewhere, bake_rest};
use crate::plan::Done;
use radiosity::Monitor;

/// Nodes that are baked anew.
#[derive(Debug, Clone, Copy)]
pub struct Only<'o> {
    /// The folder with the results of an earlier bake.
    pub folder: &'o Path,
    /// Names of nodes, with wildcards `*` and `?`. A node stands for its children too.
    pub names: &'o [String],
}

/// Outcome of [`rebake`].
#[derive(Debug)]
pub enum Rebaked {
    /// Nothing that the nodes' light depends on changed since they were baked.
    Current,
    /// A bake whose files replace those of the earlier one.
    Done(Box<Bake>),
}

/// What a bake of a part of a level did, for the report.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct OnlyReport {
    /// The names that were asked for.
    pub names: Vec<String>,
    /// The nodes that were baked anew.
    pub nodes: Vec<String>,
    /// Number of other nodes with lumels, which keep their light.
    pub kept_nodes: usize,
}

/// What stays of an earlier bake.
pub(crate) struct Kept {
    pub level: LevelRecord,
    /// Instances that were baked anew.
    pub anew: Vec<usize>,
    /// Results that stay as they are.
    pub files: Vec<NamedFile>,
}

/// Bakes nodes of a level anew, into the pages of an earlier bake. Other nodes keep their places
/// and their light.
///
/// ```no_run
/// use lumel::{Beside, Only, Order, Provenance, Rebaked, Settings, Silent, rebake};
///
/// let (settings, provenance) = (Settings::default(), Provenance::default());
/// let scene = "level.glb".as_ref();
/// let order = Order { scene, settings: &settings, provenance: &provenance };
/// let only = Only { folder: "out".as_ref(), names: &["lamp_*".into()] };
/// if let Rebaked::Done(bake) = rebake(order, &only, &Beside::default(), &Silent)? {
///     bake.write("out")?;
/// }
/// # Ok::<(), lumel::Error>(())
/// ```
///
/// # Errors
/// [`Error::Setting`] for names that no node has, [`Error::Folder`] if there is no earlier bake
/// with the same settings, or if geometry or places of other nodes changed.
pub fn rebake(
    order: Order<'_>,
    only: &Only<'_>,
    beside: &Beside<'_>,
    monitor: &dyn Monitor,
) -> Result<Rebaked, Error> {
    let settings = order.settings;
    if settings.vertex_error.is_some() {
        return Err(Error::Setting(
            "--only cannot keep the vertices that --vertex-error added: leave one of them out"
                .into(),
        ));
    }
    let before = EarlierBake::open(only.folder, order)?;
    let start = Start {
        changes: before.level.changes(),
        decided: true,
        ..Start::default()
    };
    let only_cut = start.changes.only_cut();
    let (mut opened, mut outside) = order.open(beside, start, monitor)?;
    opened.leave_probes();
    let scene = &opened.loaded.scene;
    let named = find(scene, opened.loaded.document.json(), only.names)?;
    let now = instances_of(scene);
    before.check_geometry(&now, &named)?;
    let lit = |i: &usize| scene.has_lightmap(*i);
    let anew: Vec<usize> = named.into_iter().filter(lit).collect();
    if before.is_current(order, &anew) {
        return Ok(Rebaked::Current);
    }
    let report = describe(scene, only.names, &anew);
    let earlier: Earlier = before.read(scene, settings, anew.clone())?;
    let files = before.kept_files(settings)?;
    let check =
        |scene: &Scene, layout: &_| before.check_places((scene, layout), now.clone(), &anew);
    let elsewhere = Elsewhere {
        done: Done::Earlier(&earlier),
        check: &check,
    };
    if only_cut {
        // As in a bake that finds the cuts by itself.
        outside.solved = Some(Solved::Uncut(order.uncut(None, beside, monitor)?));
    }
    let settled = (settings, order.provenance);
    let with = (beside, &elsewhere);
    let mut bake = bake_rest(order.scene, (opened, outside), settled, with, monitor)?;
    bake.report.notes.push(format!(
        "--only: {} nodes were baked anew, {} keep the light of earlier bakes",
        report.nodes.len(),
        report.kept_nodes
    ));
    bake.report.only = Some(report);
    bake.kept = Some(Kept {
        level: before.level,
        anew,
        files,
    });
    Ok(Rebaked::Done(Box::new(bake)))
}

fn describe(scene: &Scene, names: &[String], anew: &[usize]) -> OnlyReport {
    let lit = (0..scene.instances.len()).filter(|&i| scene.has_lumels(i));
    OnlyReport {
        names: names.to_vec(),
        nodes: anew.iter().map(|&i| node_of(scene, i)).collect(),
        kept_nodes: lit.filter(|i| anew.binary_search(i).is_err()).count(),
    }
}

/// Instances of nodes with these names, of their children, and of what copies their light: coarser
/// levels of detail and other variants. In rising order.
fn find(scene: &Scene, document: &Value, names: &[String]) -> Result<Vec<usize>, Error> {
    let patterns: Vec<WildMatch> = names.iter().map(|n| WildMatch::new(n)).collect();
    let mut used = vec![false; patterns.len()];
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let parent = parents(nodes);
    let mut known = BTreeSet::new();
    let mut found = Vec::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        // The scene graph is a tree, so this ends; the bound only says so.
        let up = std::iter::successors(Some(instance.node), |n| parent[*n]).take(nodes.len());
        let mut chosen = false;
        for name in up.map(|n| nodes[n]["name"].as_str().unwrap_or_default()) {
            known.insert(name);
            for (pattern, used) in patterns.iter().zip(&mut used) {
                let fits = !name.is_empty() && pattern.matches(name);
                *used |= fits;
                chosen |= fits;
            }
        }
        if chosen {
            found.push(i);
        }
    }
    if let Some(unused) = used.iter().position(|u| !u) {
        return Err(unknown(&names[unused], known));
    }
    if !found.iter().any(|&i| scene.has_lightmap(i)) {
        return Err(Error::Setting(format!(
            "--only: none of the nodes named {} has a lightmap",
            list(names.iter().map(String::as_str))
        )));
    }
    let copies = |i: &usize| {
        let group = scene.instances[*i].stands_in;
        group.is_some_and(|g| {
            scene.firsts[g]
                .iter()
                .any(|f| found.binary_search(f).is_ok())
        })
    };
    let copies: Vec<usize> = (0..scene.instances.len()).filter(copies).collect();
    found.extend(copies);
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

/// Similarity of names that somebody may have meant.
const NEAR: f64 = 0.8;

/// Most names that are offered.
const OFFERED: usize = 5;

fn unknown(name: &str, known: BTreeSet<&str>) -> Error {
    let lower = name.to_lowercase();
    let mut near: Vec<(f64, &str)> = (known.iter())
        .map(|k| (strsim::jaro_winkler(&lower, &k.to_lowercase()), *k))
        .filter(|(like, _)| *like >= NEAR)
        .collect();
    near.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    let offer = match near.len() {
        0 => format!("there are {}", list(known.into_iter())),
        n => {
            let names: Vec<String> = (near[..n.min(OFFERED)].iter())
                .map(|(_, k)| format!("{k:?}"))
                .collect();
            format!("did you mean {}?", names.join(" or "))
        }
    };
    Error::Setting(format!(
        "--only: no node with a mesh, and no parent of one, is named {name:?}; {offer}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_offered() {
        let known = BTreeSet::from(["chair", "chair.001", "table", ""]);
        let text = unknown("Chiar", known.clone()).to_string();
        assert!(text.contains("did you mean \"chair\" or"), "{text}");
        assert!(!text.contains("table"), "{text}");
        let text = unknown("zzz", known).to_string();
        assert!(
            text.contains("there are \"chair\", \"chair.001\", \"table\""),
            "{text}"
        );
    }
}
