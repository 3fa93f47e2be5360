//! Typed access to JSON that tracks the path of each value.

use serde_json::Value;

use crate::error::{Fault, Outcome};

/// A JSON value and its path in the document.
///
/// Methods named `opt_*` return `None` if the key is absent and a [`Fault`] if it has the wrong
/// type, so only members that are read are validated.
#[derive(Debug, Clone)]
pub(crate) struct Item<'a> {
    pub value: &'a Value,
    pub path: String,
}

impl<'a> Item<'a> {
    pub fn root(value: &'a Value) -> Item<'a> {
        Item {
            value,
            path: String::new(),
        }
    }

    pub fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_string()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    fn wrong(&self, expected: &str) -> Fault {
        Fault::invalid(self.path.clone(), show(self.value), expected)
    }

    /// The member `key` of any type.
    pub fn get(&self, key: &str) -> Option<Item<'a>> {
        self.value.get(key).map(|value| Item {
            value,
            path: self.path_of(key),
        })
    }

    pub fn object(self) -> Outcome<Item<'a>> {
        if self.value.is_object() {
            Ok(self)
        } else {
            Err(self.wrong("an object"))
        }
    }

    pub fn opt_object(&self, key: &str) -> Outcome<Option<Item<'a>>> {
        self.get(key).map(Item::object).transpose()
    }

    /// The extension `name` of this object, if present.
    pub fn extension(&self, name: &str) -> Outcome<Option<Item<'a>>> {
        match self.value.get("extensions") {
            None => Ok(None),
            Some(_) => match self.opt_object("extensions")? {
                Some(extensions) => extensions.opt_object(name),
                None => Ok(None),
            },
        }
    }

    /// Number of elements of the array `key`; 0 if it is absent.
    pub fn len_of(&self, key: &str) -> Outcome<usize> {
        match self.get(key) {
            None => Ok(0),
            Some(item) => item
                .value
                .as_array()
                .map(Vec::len)
                .ok_or_else(|| item.wrong("an array")),
        }
    }

    /// Element `index` of the array `key`, which must be an object.
    pub fn element(&self, key: &str, index: usize) -> Outcome<Item<'a>> {
        match self
            .value
            .get(key)
            .and_then(|v| v.as_array())
            .and_then(|a| a.get(index))
        {
            Some(value) => Item {
                value,
                path: format!("{}[{index}]", self.path_of(key)),
            }
            .object(),
            None => Err(Fault::invalid(
                format!("{}[{index}]", self.path_of(key)),
                "nothing",
                format!("an index below {}", self.len_of(key)?),
            )),
        }
    }

    /// All elements of the array `key`, which must be objects.
    pub fn elements(&self, key: &str) -> Outcome<Vec<Item<'a>>> {
        (0..self.len_of(key)?)
            .map(|i| self.element(key, i))
            .collect()
    }

    /// A non-negative integer; `2.0` counts as one, as in JSON Schema.
    fn whole(&self) -> Outcome<usize> {
        let number = self.value.as_u64().or_else(|| match self.value.as_f64() {
            Some(x) if (0.0..9.0e15).contains(&x) && x.fract() == 0.0 => Some(x as u64),
            _ => None,
        });
        number
            .and_then(|n| usize::try_from(n).ok())
            .ok_or_else(|| self.wrong("a non-negative integer"))
    }

    /// The non-negative integer `key`, if present.
    pub fn opt_uint(&self, key: &str) -> Outcome<Option<usize>> {
        let Some(item) = self.get(key) else {
            return Ok(None);
        };
        item.whole().map(Some)
    }

    pub fn uint(&self, key: &str) -> Outcome<usize> {
        self.opt_uint(key)?
            .ok_or_else(|| Fault::invalid(self.path_of(key), "nothing", "a non-negative integer"))
    }

    /// A reference into an array of `len` elements.
    pub fn opt_index(&self, key: &str, array: &str, len: usize) -> Outcome<Option<usize>> {
        match self.opt_uint(key)? {
            Some(i) if i >= len => Err(Fault::invalid(
                self.path_of(key),
                format!("{i}"),
                format!("an index into {array}, which has {len}"),
            )),
            other => Ok(other),
        }
    }

    /// A finite number that also fits `f32`.
    pub fn opt_number(&self, key: &str) -> Outcome<Option<f64>> {
        self.get(key).map(|item| item.number()).transpose()
    }

    fn number(&self) -> Outcome<f64> {
        match self.value.as_f64() {
            Some(x) if x.is_finite() && x.abs() <= f64::from(f32::MAX) => Ok(x),
            _ => Err(self.wrong("a number within ±3.4e38")),
        }
    }

    /// An array of exactly `N` numbers.
    pub fn opt_numbers<const N: usize>(&self, key: &str) -> Outcome<Option<[f64; N]>> {
        let Some(item) = self.get(key) else {
            return Ok(None);
        };
        let expected = || format!("an array of {N} numbers");
        let array = item
            .value
            .as_array()
            .filter(|a| a.len() == N)
            .ok_or_else(|| item.wrong(&expected()))?;
        let mut out = [0.0; N];
        for (i, value) in array.iter().enumerate() {
            out[i] = Item {
                value,
                path: format!("{}[{i}]", item.path),
            }
            .number()?;
        }
        Ok(Some(out))
    }

    /// An array of non-negative integers; empty if absent.
    pub fn uints(&self, key: &str) -> Outcome<Vec<usize>> {
        let Some(item) = self.get(key) else {
            return Ok(Vec::new());
        };
        let array = item
            .value
            .as_array()
            .ok_or_else(|| item.wrong("an array"))?;
        array
            .iter()
            .enumerate()
            .map(|(i, value)| {
                Item {
                    value,
                    path: format!("{}[{i}]", item.path),
                }
                .whole()
            })
            .collect()
    }

    pub fn opt_bool(&self, key: &str) -> Outcome<Option<bool>> {
        self.get(key)
            .map(|item| {
                item.value
                    .as_bool()
                    .ok_or_else(|| item.wrong("true or false"))
            })
            .transpose()
    }

    pub fn opt_str(&self, key: &str) -> Outcome<Option<&'a str>> {
        self.get(key)
            .map(|item| item.value.as_str().ok_or_else(|| item.wrong("a string")))
            .transpose()
    }

    /// The `name`; empty if it is absent or not a string, because names are only for people.
    pub fn name(&self) -> String {
        self.value
            .get("name")
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_string()
    }
}

/// A value in an error message: complete if short.
pub(crate) fn show(value: &Value) -> String {
    match value {
        Value::Object(map) => format!("an object of {} members", map.len()),
        Value::Array(array) if array.len() > 4 => format!("an array of {}", array.len()),
        other => {
            let text = other.to_string();
            match text.char_indices().nth(60) {
                Some((cut, _)) => format!("{}…", &text[..cut]),
                None => text,
            }
        }
    }
}
