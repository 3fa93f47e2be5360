//! Extras that writers add to nodes.

use std::collections::BTreeMap;

use serde_json::Value;

/// Name of the node extra with a lightmap's rectangle.
pub const LIGHTMAP_EXTRA: &str = "lightmap";

/// Name of the node extra of a reflection capture.
pub const REFLECTION_EXTRA: &str = "lightmapReflection";

/// Name of the extra with the scale of baked vertex colours, on `asset` and on every baked node.
pub const VERTEX_LIGHT_EXTRA: &str = "vertexLight";

/// Values of the instances of each node: one, or a list by `EXT_mesh_gpu_instancing` copy with null
/// for copies without a value.
pub(super) fn by_node(
    values: impl Iterator<Item = (usize, Option<u32>, Value)>,
) -> BTreeMap<usize, Value> {
    let mut nodes: BTreeMap<usize, Value> = BTreeMap::new();
    for (node, copy, value) in values {
        match copy {
            None => {
                nodes.insert(node, value);
            }
            Some(copy) => {
                let list = nodes
                    .entry(node)
                    .or_insert_with(|| Value::Array(Vec::new()));
                if let Value::Array(list) = list {
                    let copy = copy as usize;
                    if list.len() <= copy {
                        list.resize(copy + 1, Value::Null);
                    }
                    list[copy] = value;
                }
            }
        }
    }
    nodes
}
