//! The node hierarchy, validated before it is walked, in time linear in the document's size.

use crate::error::{Fault, Faults, Outcome};
use crate::json::Item;
use crate::report::IngestReport;

/// Root nodes of the scene and children by node; `None`, with faults, unless the nodes form a
/// forest. Only a forest can be walked: a node with two parents may be its own ancestor, and a
/// chain of nodes that each list the next one twice doubles at every step.
///
/// Nodes outside the scene may list nodes in it, because some exporters leave such parents behind.
/// They are ignored.
pub(crate) fn hierarchy(
    root: &Item<'_>,
    count: usize,
    scene: Option<usize>,
    faults: &mut Faults,
    report: &mut IngestReport,
) -> Option<(Vec<usize>, Vec<Vec<usize>>)> {
    let children = read_children(root, count, faults)?;
    let roots = faults.take(scene_roots(root, scene, &children, report))?;
    let reached = reach(&roots, &children);
    let parents = parents(&children, &reached, faults, report)?;
    for (node, path) in &roots {
        if parents[*node].is_some() {
            let found = format!("node {node}, which is the child of another node");
            faults.push(Fault::invalid(path, found, "a root node"));
            return None;
        }
    }
    if let Some(i) = find_loop(&parents) {
        faults.push(Fault::invalid(
            format!("nodes[{i}]"),
            "a node that is its own ancestor",
            "a hierarchy without loops",
        ));
        return None;
    }
    Some((roots.into_iter().map(|(node, _)| node).collect(), children))
}

/// Children by node, validated as node indices.
fn read_children(root: &Item<'_>, count: usize, faults: &mut Faults) -> Option<Vec<Vec<usize>>> {
    let mut children = Vec::with_capacity(count);
    let mut sound = true;
    for i in 0..count {
        let node = faults.take(root.element("nodes", i))?;
        let own = faults.take(node.uints("children"))?;
        for (k, child) in own.iter().enumerate().filter(|(_, child)| **child >= count) {
            faults.push(Fault::invalid(
                format!("{}.children[{k}]", node.path),
                format!("{child}"),
                format!("an index into nodes, which has {count}"),
            ));
            sound = false;
        }
        children.push(own);
    }
    sound.then_some(children)
}

/// Whether each node is a descendant of `roots`.
fn reach(roots: &[(usize, String)], children: &[Vec<usize>]) -> Vec<bool> {
    let mut reached = vec![false; children.len()];
    let mut stack: Vec<usize> = roots.iter().map(|(node, _)| *node).collect();
    while let Some(i) = stack.pop() {
        if !std::mem::replace(&mut reached[i], true) {
            stack.extend(&children[i]);
        }
    }
    reached
}

/// The parent of each node; `None`, with faults, if a node has several.
fn parents(
    children: &[Vec<usize>],
    reached: &[bool],
    faults: &mut Faults,
    report: &mut IngestReport,
) -> Option<Vec<Option<usize>>> {
    let mut parent: Vec<Option<usize>> = vec![None; children.len()];
    let mut sound = true;
    for (i, own) in children.iter().enumerate() {
        for (k, &child) in own.iter().enumerate() {
            let path = || format!("nodes[{i}].children[{k}]");
            let (found, expected) = match parent[child] {
                _ if reached[child] && !reached[i] => {
                    report.warn(
                        path(),
                        format!(
                            "node {child} is in the scene but its parent {i} is not; the parent is ignored"
                        ),
                    );
                    continue;
                }
                _ if child == i => (format!("node {child} itself"), "a hierarchy without loops"),
                None => {
                    parent[child] = Some(i);
                    continue;
                }
                Some(first) if first == i => (format!("node {child} twice"), "each child once"),
                Some(first) => (
                    format!("node {child}, already a child of node {first}"),
                    "a node with one parent",
                ),
            };
            sound = false;
            faults.push(Fault::invalid(path(), found, expected));
        }
    }
    sound.then_some(parent)
}

/// A node that is its own ancestor. If each node has one parent, these are the nodes whose
/// ancestors never reach a root.
fn find_loop(parent: &[Option<usize>]) -> Option<usize> {
    // Marks the nodes of this and earlier climbs, so that each is visited once.
    let mut climb = vec![0usize; parent.len()];
    for start in 0..parent.len() {
        let mut at = Some(start);
        while let Some(i) = at {
            if climb[i] == start + 1 {
                return Some(i);
            }
            if climb[i] != 0 {
                break;
            }
            climb[i] = start + 1;
            at = parent[i];
        }
    }
    None
}

/// The requested scene, else the document's default, else the first; `None` if there is none.
pub(crate) fn chosen_scene(root: &Item<'_>, asked: Option<usize>) -> Outcome<Option<usize>> {
    let scenes = root.len_of("scenes")?;
    match asked {
        Some(s) if s < scenes => Ok(Some(s)),
        Some(s) => Err(Fault::invalid(
            "scenes",
            format!("{scenes} scenes"),
            format!("the requested scene {s}"),
        )),
        None => Ok(root
            .opt_index("scene", "scenes", scenes)?
            .or((scenes > 0).then_some(0))),
    }
}

/// Root nodes of the scene with their document paths.
fn scene_roots(
    root: &Item<'_>,
    scene: Option<usize>,
    children: &[Vec<usize>],
    report: &mut IngestReport,
) -> Outcome<Vec<(usize, String)>> {
    let Some(chosen) = chosen_scene(root, scene)? else {
        let mut is_child = vec![false; children.len()];
        children.iter().flatten().for_each(|&c| is_child[c] = true);
        let roots = (0..children.len()).filter(|&i| !is_child[i]);
        return Ok(roots.map(|i| (i, format!("nodes[{i}]"))).collect());
    };
    let item = root.element("scenes", chosen)?;
    let mut roots = Vec::new();
    let mut seen = vec![false; children.len()];
    for (k, node) in item.uints("nodes")?.into_iter().enumerate() {
        let path = format!("{}.nodes[{k}]", item.path);
        let Some(seen) = seen.get_mut(node) else {
            return Err(Fault::invalid(
                path,
                format!("{node}"),
                format!("an index into nodes, which has {}", children.len()),
            ));
        };
        if std::mem::replace(seen, true) {
            report.warn(
                path,
                format!("node {node} is listed twice; the second entry is ignored"),
            );
            continue;
        }
        roots.push((node, path));
    }
    Ok(roots)
}
