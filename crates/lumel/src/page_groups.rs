//! `--page-by`: page groups from names of nodes and materials.

use std::collections::{BTreeMap, BTreeSet};

use mesh_ingest::Scene;
use serde_json::Value;
use wildmatch::WildMatch;

use crate::error::Error;
use crate::settings::Settings;

/// Most names listed in a message.
const LISTED: usize = 20;

/// Puts nodes into page groups by the settings' patterns, in addition to `extras.lumel.page`, which
/// takes precedence.
///
/// The group of an instance is the name of the nearest node that matches, starting with its own and
/// going up; otherwise the first material of its mesh that matches.
///
/// # Errors
/// [`Error::Setting`] if a pattern matches neither a node nor a material in use.
pub(crate) fn assign(
    scene: &mut Scene,
    document: &Value,
    settings: &Settings,
) -> Result<(), Error> {
    if settings.page_by.is_empty() {
        return Ok(());
    }
    let patterns: Vec<WildMatch> = settings.page_by.iter().map(|p| WildMatch::new(p)).collect();
    let mut used = vec![false; patterns.len()];
    let mut matching = |name: &str| {
        let mut any = false;
        for (pattern, used) in patterns.iter().zip(&mut used) {
            let fits = !name.is_empty() && pattern.matches(name);
            *used |= fits;
            any |= fits;
        }
        any
    };
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let name = |node: usize| nodes[node]["name"].as_str().unwrap_or_default();
    let parent = parents(nodes);
    let mut found = BTreeMap::new();
    for instance in &scene.instances {
        // The scene graph is a tree, so this always ends; the bound makes that evident.
        let up = std::iter::successors(Some(instance.node), |n| parent[*n]).take(nodes.len());
        let by_node = up.map(name).find(|n| matching(n));
        let worn = (scene.meshes[instance.mesh].primitives.iter())
            .map(|p| scene.materials[p.material].name.as_str());
        let by_material = worn.into_iter().find(|n| matching(n));
        if let Some(group) = by_node.or(by_material) {
            found.insert(instance.node, group.to_string());
        }
    }
    if let Some(unused) = used.iter().position(|u| !u) {
        let names = (scene.instances.iter())
            .map(|i| i.name.as_str())
            .chain(scene.materials.iter().map(|m| m.name.as_str()));
        return Err(Error::Setting(format!(
            "--page-by: no node with a lightmap, no ancestor of one and no material is named {:?}; there are {}",
            settings.page_by[unused],
            list(names)
        )));
    }
    for (node, group) in found {
        scene.page_groups.entry(node).or_insert(group);
    }
    Ok(())
}

/// The parent of each node.
pub(crate) fn parents(nodes: &[Value]) -> Vec<Option<usize>> {
    let mut parent = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for child in node["children"].as_array().into_iter().flatten() {
            if let Some(slot) = child.as_u64().and_then(|c| parent.get_mut(c as usize)) {
                *slot = Some(i);
            }
        }
    }
    parent
}

/// Names in alphabetical order, at most [`LISTED`].
pub(crate) fn list<'n>(names: impl Iterator<Item = &'n str>) -> String {
    let all: BTreeSet<&str> = names.filter(|n| !n.is_empty()).collect();
    if all.is_empty() {
        return "no names".into();
    }
    let some: Vec<String> = all.iter().take(LISTED).map(|n| format!("{n:?}")).collect();
    match all.len() - some.len() {
        0 => some.join(", "),
        n => format!("{} and {n} more", some.join(", ")),
    }
}
