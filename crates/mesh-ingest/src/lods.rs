//! Levels of detail and variants: nodes that show the same object in several ways, of which a level
//! shows one at a time.
//!
//! Rays see the first of a group; the others stand in for it
//! ([`Instance::stands_in`](crate::Instance::stands_in)). If all of them cast shadows, each would
//! be in the dark inside another. Groups are recognised, in this order of precedence, by
//! - `extras.lumel.lod` and `extras.lumel.variant`,
//! - `MSFT_lod` (node levels; material levels are ignored), whose lower levels need not be in the
//!   scene graph,
//! - node names that end in `_LOD0`, `_LOD1`, …, among siblings, or anywhere if each level exists
//!   once, provided that the levels are in the same place.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::error::{Fault, Outcome};
use crate::extras::GroupMember;
use crate::json::Item;
use crate::report::{IngestReport, LodGroup, LodSource};
use crate::scene::Scene;

/// Levels recognised by name are in the same place if the centres of their bounds are no further
/// apart than this fraction of the larger diagonal. This allows a tree that loses its lower
/// branches, and excludes levels placed side by side in a showcase.
const ONE_PLACE: f64 = 0.25;

/// Identifies a group.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Variant(String),
    Lod(String),
    /// The node with `MSFT_lod`.
    Msft(usize),
    Named {
        parent: Option<usize>,
        stem: String,
    },
}

/// A node's membership in a group.
#[derive(Debug, Clone)]
struct Mark {
    key: Key,
    level: u32,
    /// The group's name for people.
    name: String,
}

/// Inherited marks of a node, as a level and as a variant: indices.
pub(crate) type Marked = [Option<usize>; 2];

/// Marked nodes, found while walking the scene graph.
#[derive(Debug, Default)]
pub(crate) struct Lods {
    parent: Vec<Option<usize>>,
    /// For each node in `MSFT_lod.ids`: the node that lists it, and its level.
    lower: BTreeMap<usize, (usize, u32)>,
    /// The inverse map.
    lower_of: BTreeMap<usize, Vec<usize>>,
    names_count: bool,
    marks: Vec<Mark>,
    of_node: BTreeMap<usize, Marked>,
}

impl Lods {
    /// Reads `MSFT_lod`. `names` says whether node names mark levels.
    ///
    /// # Errors
    /// An id that is not a node.
    pub fn read(root: &Item<'_>, children: &[Vec<usize>], names: bool) -> Outcome<Lods> {
        let mut lods = Lods {
            parent: vec![None; children.len()],
            names_count: names,
            ..Lods::default()
        };
        for (i, own) in children.iter().enumerate() {
            own.iter().for_each(|&child| lods.parent[child] = Some(i));
            for (k, id) in ids(&root.element("nodes", i)?)?.into_iter().enumerate() {
                if id >= children.len() {
                    return Err(Fault::invalid(
                        format!("nodes[{i}].extensions.MSFT_lod.ids[{k}]"),
                        format!("{id}"),
                        format!("an index into nodes, which has {}", children.len()),
                    ));
                }
                if let Entry::Vacant(free) = lods.lower.entry(id) {
                    free.insert((i, k as u32 + 1));
                    lods.lower_of.entry(i).or_default().push(id);
                }
            }
        }
        Ok(lods)
    }

    /// Lower levels of `node` that are not in the scene graph; they take its place. Each belongs to
    /// one node.
    pub fn unplaced<'l>(&'l self, node: usize, roots: &'l [usize]) -> impl Iterator<Item = usize> {
        let lower = self.lower_of.get(&node).into_iter().flatten().copied();
        lower.filter(|id| self.parent[*id].is_none() && !roots.contains(id))
    }

    /// The marks of a node, which its children inherit; `from` is its parent's.
    pub fn mark(
        &mut self,
        index: usize,
        node: &Item<'_>,
        said: [Option<&GroupMember>; 2],
        from: Marked,
    ) -> Outcome<Marked> {
        let [lod, variant] = said;
        let own = |place: &GroupMember, key: fn(String) -> Key| Mark {
            key: key(place.group.clone()),
            level: place.number,
            name: place.group.clone(),
        };
        let level = match lod {
            Some(place) => Some(own(place, Key::Lod)),
            None => self.level_of(index, node, from[0].is_some())?,
        };
        let variant = variant.map(|place| own(place, Key::Variant));
        let mut marked = from;
        for (slot, mark) in marked.iter_mut().zip([level, variant]) {
            if let Some(mark) = mark {
                self.marks.push(mark);
                *slot = Some(self.marks.len() - 1);
            }
        }
        if marked != [None; 2] {
            self.of_node.insert(index, marked);
        }
        Ok(marked)
    }

    /// From `MSFT_lod`, or from the name if no ancestor is marked.
    fn level_of(&self, index: usize, node: &Item<'_>, inherits: bool) -> Outcome<Option<Mark>> {
        let name = node.name();
        if let Some(&(base, level)) = self.lower.get(&index) {
            let key = Key::Msft(base);
            return Ok(Some(Mark { key, level, name }));
        }
        if !ids(node)?.is_empty() {
            let (key, level) = (Key::Msft(index), 0);
            return Ok(Some(Mark { key, level, name }));
        }
        let parent = self.parent[index];
        let named = (self.names_count && !inherits).then(|| level_by_name(&name));
        Ok(named.flatten().map(|(stem, level)| Mark {
            key: Key::Named {
                parent,
                stem: stem.to_ascii_lowercase(),
            },
            name: stem,
            level,
        }))
    }
}

/// The lower levels in a node's `MSFT_lod`.
fn ids(node: &Item<'_>) -> Outcome<Vec<usize>> {
    match node.extension("MSFT_lod")? {
        Some(ext) => ext.uints("ids"),
        None => Ok(Vec::new()),
    }
}

/// `tree_LOD1` and `tree_lod1.002` (Blender's numbering of copies) are level 1 of `tree` and of
/// `tree.002`.
pub fn level_by_name(name: &str) -> Option<(String, u32)> {
    let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    let (body, copy) = match name.rsplit_once('.') {
        Some((body, copy)) if digits(copy) => (body, &name[body.len()..]),
        _ => (name, ""),
    };
    // ASCII lower-casing does not move any byte.
    let at = body.to_ascii_lowercase().rfind("_lod")?;
    let (stem, level) = (&body[..at], &body[at + 4..]);
    if !digits(level) || level.len() > 2 {
        return None;
    }
    Some((format!("{stem}{copy}"), level.parse().ok()?))
}

/// A group's instances by level.
type Levels = BTreeMap<u32, Vec<usize>>;

/// Decides which instances stand in for others.
pub(crate) fn settle(scene: &mut Scene, lods: &Lods, report: &mut IngestReport) {
    if lods.of_node.is_empty() {
        return;
    }
    let groups = groups(scene, lods, report);
    // For each instance, the groups in which it is not first. Groups of variants take precedence
    // over levels.
    let mut behind: Vec<Vec<usize>> = vec![Vec::new(); scene.instances.len()];
    for (g, (_, levels)) in groups.iter().enumerate() {
        for i in levels.values().skip(1).flatten() {
            behind[*i].push(g);
        }
    }
    scene.firsts = (groups.iter())
        .map(|(_, levels)| {
            let all = levels.values().flatten().copied();
            let mut seen: Vec<usize> = all.filter(|i| behind[*i].is_empty()).collect();
            seen.sort_unstable();
            seen
        })
        .collect();
    for (instance, behind) in scene.instances.iter_mut().zip(&behind) {
        let mut groups = behind.iter().copied();
        instance.stands_in = groups.find(|g| !scene.firsts[*g].is_empty());
    }
    for (mark, levels) in &groups {
        let nodes = levels.values().skip(1).flatten();
        let nodes: BTreeSet<usize> = nodes.map(|i| scene.instances[*i].node).collect();
        report.lods.push(LodGroup {
            name: mark.name.clone(),
            by: match mark.key {
                Key::Variant(_) => LodSource::Variant,
                Key::Lod(_) => LodSource::Extras,
                Key::Msft(_) => LodSource::MsftLod,
                Key::Named { .. } => LodSource::Name,
            },
            levels: levels.keys().copied().collect(),
            stand_ins: nodes.into_iter().collect(),
        });
    }
}

/// Groups of at least two levels, variants first, each with a mark of its first level.
fn groups<'l>(scene: &Scene, lods: &'l Lods, report: &mut IngestReport) -> Vec<(&'l Mark, Levels)> {
    let mut groups: BTreeMap<&Key, (&Mark, Levels)> = BTreeMap::new();
    for (i, instance) in scene.instances.iter().enumerate() {
        let marked = lods.of_node.get(&instance.node).into_iter().flatten();
        for mark in marked.flatten().map(|m| &lods.marks[*m]) {
            let (_, levels) = groups.entry(&mark.key).or_insert((mark, Levels::new()));
            levels.entry(mark.level).or_default().push(i);
        }
    }
    join_lonely(&mut groups);
    let mut out: Vec<(&Mark, Levels)> = groups.into_values().collect();
    for (mark, levels) in &mut out {
        if let Key::Named { .. } = mark.key {
            let before = levels.len();
            keep_in_place(scene, levels);
            report.count("lods.elsewhere", (before - levels.len()) as u64);
        }
    }
    out.retain(|(_, levels)| levels.len() > 1);
    out
}

/// Joins levels of the same name with different parents, if each exists once.
fn join_lonely(groups: &mut BTreeMap<&Key, (&Mark, Levels)>) {
    let mut lonely: BTreeMap<&str, Vec<&Key>> = BTreeMap::new();
    for (key, (_, levels)) in groups.iter() {
        if let Key::Named { stem, .. } = key
            && levels.len() == 1
        {
            lonely.entry(stem).or_default().push(key);
        }
    }
    for keys in lonely.into_values().filter(|keys| keys.len() > 1) {
        let level = |key: &&Key| groups[*key].1.keys().next().copied();
        let distinct: BTreeSet<_> = keys.iter().map(level).collect();
        if distinct.len() < keys.len() {
            continue;
        }
        for key in &keys[1..] {
            let Some((_, levels)) = groups.remove(key) else {
                continue;
            };
            if let Some((_, all)) = groups.get_mut(keys[0]) {
                all.extend(levels);
            }
        }
    }
}

/// Removes levels that are not in the same place as the first.
fn keep_in_place(scene: &Scene, levels: &mut Levels) {
    let Some(first) = levels.values().next().map(|first| bounds(scene, first)) else {
        return;
    };
    levels.retain(|_, instances| {
        let own = bounds(scene, instances);
        let size = |b: [DVec3; 2]| (b[1] - b[0]).length();
        let apart = (own[0] + own[1] - first[0] - first[1]).length() * 0.5;
        apart <= ONE_PLACE * size(own).max(size(first))
    });
}

/// World bounds of some instances.
fn bounds(scene: &Scene, instances: &[usize]) -> [DVec3; 2] {
    let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for instance in instances.iter().map(|i| &scene.instances[*i]) {
        for primitive in &scene.meshes[instance.mesh].primitives {
            for v in primitive.triangles.iter().flatten() {
                let p = primitive.positions[*v as usize].as_dvec3();
                let p = instance.transform.transform_point3(p);
                bounds = [bounds[0].min(p), bounds[1].max(p)];
            }
        }
    }
    bounds
}

#[cfg(test)]
mod tests {
    use super::level_by_name;

    #[test]
    fn names_that_end_in_a_level_tell_it() {
        for (name, expected) in [
            ("tree_LOD0", Some(("tree", 0))),
            ("Tree_lod12", Some(("Tree", 12))),
            ("a_LOD1.002", Some(("a.002", 1))),
            ("_LOD3", Some(("", 3))),
            ("x_LOD1_LOD2", Some(("x_LOD1", 2))),
            ("tree_LOD", None),
            ("tree_LOD123", None),
            ("tree_LOD1_leaves", None),
            ("treeLOD1", None),
            ("tree_LOD1.a", None),
            ("é_LOD1", Some(("é", 1))),
        ] {
            let found = level_by_name(name);
            let found = found.as_ref().map(|(stem, level)| (stem.as_str(), *level));
            assert_eq!(found, expected, "{name}");
        }
    }
}
