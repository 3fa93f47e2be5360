//! Helpers for glTF JSON that skip members that are absent or of the wrong type.

use serde_json::{Map, Value};

/// The objects in array `key` of `object`.
pub(super) fn elements_mut<'a>(
    object: &'a mut Map<String, Value>,
    key: &str,
) -> impl Iterator<Item = &'a mut Map<String, Value>> {
    object
        .get_mut(key)
        .and_then(Value::as_array_mut)
        .into_iter()
        .flatten()
        .filter_map(Value::as_object_mut)
}

/// Element `index` of array `key`, if it is an object.
pub(super) fn element_mut<'a>(
    object: &'a mut Map<String, Value>,
    key: &str,
    index: usize,
) -> Option<&'a mut Map<String, Value>> {
    object
        .get_mut(key)?
        .as_array_mut()?
        .get_mut(index)?
        .as_object_mut()
}

/// Element `index` of array `key`, if it is an object.
pub(super) fn element<'a>(
    object: &'a Map<String, Value>,
    key: &str,
    index: usize,
) -> Option<&'a Map<String, Value>> {
    object.get(key)?.as_array()?.get(index)?.as_object()
}

/// Whether `key` is an array with elements.
pub(super) fn has_array(object: &Map<String, Value>, key: &str) -> bool {
    object
        .get(key)
        .and_then(Value::as_array)
        .is_some_and(|a| !a.is_empty())
}

/// An index stored under `key`.
pub(super) fn index(object: &Map<String, Value>, key: &str) -> Option<usize> {
    object
        .get(key)?
        .as_u64()
        .and_then(|i| usize::try_from(i).ok())
}

/// Calls `f` on every member of an object whose members are indices.
pub(super) fn indices_of(object: Option<&mut Value>, f: &mut dyn FnMut(&mut Value)) {
    for (_, slot) in object.and_then(Value::as_object_mut).into_iter().flatten() {
        f(slot);
    }
}

/// The object under `key`, created if it is absent or not an object.
pub(super) fn object_at<'a>(
    object: &'a mut Map<String, Value>,
    key: &str,
) -> &'a mut Map<String, Value> {
    let slot = object.entry(key).or_insert(Value::Null);
    if !slot.is_object() {
        *slot = Value::Object(Map::new());
    }
    match slot {
        Value::Object(map) => map,
        _ => unreachable!("just made an object"),
    }
}

/// Appends to array `key`, which is created if necessary; returns the new element's index.
pub(super) fn push(object: &mut Map<String, Value>, key: &str, value: Value) -> usize {
    let slot = object.entry(key).or_insert(Value::Null);
    match slot {
        Value::Array(items) => {
            items.push(value);
            items.len() - 1
        }
        other => {
            *other = Value::Array(vec![value]);
            0
        }
    }
}

/// Sets `extras.<key>`. Extras that are not an object (a number, a string) move to
/// `extras.original`.
pub(super) fn set_extra(object: &mut Map<String, Value>, key: &str, value: Value) {
    let mut extras = match object.get_mut("extras").map(Value::take) {
        None | Some(Value::Null) => Map::new(),
        Some(Value::Object(map)) => map,
        Some(other) => Map::from_iter([("original".to_string(), other)]),
    };
    extras.insert(key.to_string(), value);
    object.insert("extras".into(), Value::Object(extras));
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn extras_of_any_type_survive() {
        for (before, after) in [
            (json!({}), json!({"extras": {"k": 1}})),
            (
                json!({"extras": {"a": [2], "k": 0}}),
                json!({"extras": {"a": [2], "k": 1}}),
            ),
            (
                json!({"extras": "text"}),
                json!({"extras": {"original": "text", "k": 1}}),
            ),
            (
                json!({"extras": [1, 2]}),
                json!({"extras": {"original": [1, 2], "k": 1}}),
            ),
        ] {
            let mut object = before.as_object().unwrap().clone();
            set_extra(&mut object, "k", json!(1));
            assert_eq!(Value::Object(object), after);
        }
    }

    #[test]
    fn push_makes_the_array() {
        let mut object = Map::new();
        assert_eq!(
            (
                push(&mut object, "a", json!(1)),
                push(&mut object, "a", json!(2))
            ),
            (0, 1)
        );
        assert_eq!(object["a"], json!([1, 2]));
    }
}
