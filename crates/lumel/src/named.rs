//! Names of nodes in messages.

use mesh_ingest::Scene;

/// Most names that are worth reading; the rest are counted.
const NAMES: usize = 5;

/// Lists at most five names and the number of further ones.
pub(crate) fn some_of(names: impl IntoIterator<Item = String>) -> String {
    let all: Vec<String> = names.into_iter().collect();
    let shown = all[..all.len().min(NAMES)].join(", ");
    match all.len().saturating_sub(NAMES) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// The name of an instance for people: its node's name, or its index if it has none.
pub(crate) fn node_of(scene: &Scene, instance: usize) -> String {
    let instance = &scene.instances[instance];
    let mut name = match instance.name.as_str() {
        "" => format!("nodes[{}]", instance.node),
        name => format!("{name:?}"),
    };
    if let Some(copy) = instance.copy {
        name += &format!(" (copy {copy})");
    }
    name
}

#[cfg(test)]
mod tests {
    use super::some_of;

    #[test]
    fn five_names_and_a_count() {
        let names = |n: u32| some_of((0..n).map(|i| format!("n{i}")));
        assert_eq!(names(1), "n0");
        assert_eq!(names(5), "n0, n1, n2, n3, n4");
        assert_eq!(names(7), "n0, n1, n2, n3, n4 and 2 more");
    }
}
