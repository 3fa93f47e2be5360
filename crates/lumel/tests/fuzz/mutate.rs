//! Damages bytes, and JSON as a tree, so that the result is still JSON.

use serde_json::{Map, Value, json};

/// SplitMix64 (Steele, Lea, Flood, *Fast Splittable Pseudorandom Number Generators*, 2014).
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// 0 to n − 1; 0 if n is 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    pub fn pick<T: Clone>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())].clone()
    }
}

/// Integers at the edges of types.
const WORDS: [u32; 10] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_fffe,
    0xffff_ffff,
];

/// Damages `bytes` in one to eight places, usually few; `other` is a seed to splice from.
pub fn bytes(random: &mut Random, bytes: &[u8], other: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    let most = random.below(8);
    for _ in 0..=random.below(1 + most) {
        let at = random.below(out.len());
        let to = (at + 1 + random.below(64)).min(out.len());
        match random.below(9) {
            _ if out.is_empty() => out.push(random.below(256) as u8),
            0 => out[at] ^= 1 << random.below(8),
            1 => out[at] = random.below(256) as u8,
            2 => out[at] = random.pick(b"0123456789-+.eE,\n {}[]\"\0\xff"),
            3 | 4 => {
                let word = random.pick(&WORDS);
                let word = if random.below(2) == 0 {
                    word.to_le_bytes()
                } else {
                    word.to_be_bytes()
                };
                let end = (at + 4).min(out.len());
                out[at..end].copy_from_slice(&word[..end - at]);
            }
            5 => out.truncate(at),
            6 => drop(out.drain(at..to)),
            7 => {
                let copy = out[at..to].to_vec();
                out.splice(at..at, copy);
            }
            _ => {
                let from = random.below(other.len());
                let end = (from + 1 + random.below(64)).min(other.len());
                out.splice(at..to, other[from..end].iter().copied());
            }
        }
    }
    out
}

/// Numbers that are invalid as indices, counts or coordinates.
fn number(random: &mut Random) -> Value {
    match random.below(14) {
        0..=4 => json!(random.below(6)),
        5 => json!(-1),
        6 => json!(0.5),
        7 => json!(1e300),
        8 => json!(-3.4e38),
        9 => json!(1e-300),
        10 => json!(u64::MAX),
        11 => json!(1u64 << 31),
        12 => json!(random.pick(&[5120, 5121, 5123, 5125, 5126, 255, 256, 65535, 65536])),
        _ => json!(random.below(1000) as f64 / 7.0),
    }
}

/// Number of values in `v`, including itself.
fn size(v: &Value) -> usize {
    1 + match v {
        Value::Array(list) => list.iter().map(size).sum(),
        Value::Object(members) => members.values().map(size).sum(),
        _ => 0,
    }
}

/// The `n`th value of `v` in textual order.
fn nth<'v>(v: &'v mut Value, n: &mut usize) -> Option<&'v mut Value> {
    if *n == 0 {
        return Some(v);
    }
    *n -= 1;
    match v {
        Value::Array(list) => list.iter_mut().find_map(|v| nth(v, n)),
        Value::Object(members) => members.values_mut().find_map(|v| nth(v, n)),
        _ => None,
    }
}

/// Damages a document in one to six places, usually few.
pub fn tree(random: &mut Random, document: &Value) -> Value {
    let mut out = document.clone();
    let most = random.below(6);
    for _ in 0..=random.below(1 + most) {
        let (at, from) = (random.below(size(&out)), random.below(size(&out)));
        let copy = nth(&mut out, &mut { from }).cloned().unwrap_or_default();
        let Some(value) = nth(&mut out, &mut { at }) else {
            continue;
        };
        change(random, value, copy);
    }
    out
}

fn change(random: &mut Random, value: &mut Value, copy: Value) {
    match (random.below(12), &mut *value) {
        (0..=4, Value::Number(n)) => *value = nudged(random, n.as_f64().unwrap_or(0.0)),
        (0..=1, Value::Array(list)) if !list.is_empty() => {
            list.remove(random.below(list.len()));
        }
        (2, Value::Array(list)) if !list.is_empty() => {
            let again = list[random.below(list.len())].clone();
            list.push(again);
        }
        (3, Value::Array(list)) => list.push(number(random)),
        (4, Value::Array(list)) if list.len() > 1 => {
            let (a, b) = (random.below(list.len()), random.below(list.len()));
            list.swap(a, b);
        }
        (0..=1, Value::Object(members)) => {
            let gone = members.keys().nth(random.below(members.len())).cloned();
            gone.and_then(|key| members.shift_remove(&key));
        }
        (2..=4, Value::Object(members)) => add_member(random, members, copy),
        (5, Value::String(s)) => *s = "\u{1b}[31m\n".repeat(1 + random.below(3)) + s,
        (6, Value::String(s)) => s.push_str(random.pick(&["%2e%2e/", "/", "\\", "é", "\0"])),
        (7, Value::Bool(b)) => *b = !*b,
        (8, _) => *value = number(random),
        (9, _) => *value = copy,
        (10, _) => {
            *value = random.pick(&[json!(null), json!([]), json!({}), json!(""), json!(true)])
        }
        (11, _) => *value = (0..random.below(200)).fold(copy, |v, _| json!([v])),
        _ => {}
    }
}

fn nudged(random: &mut Random, x: f64) -> Value {
    let whole = x.fract() == 0.0 && x.abs() < 1e15;
    match random.below(6) {
        0 if whole => json!(x as i64 + 1),
        1 if whole => json!(x as i64 - 1),
        2 => json!(-x),
        3 => json!(x * 1e6),
        4 => json!(x * 1e-6),
        _ => number(random),
    }
}

/// Inserts a member that other objects of documents have.
fn add_member(random: &mut Random, members: &mut Map<String, Value>, copy: Value) {
    const KEYS: [&str; 50] = [
        "children",
        "mesh",
        "nodes",
        "scale",
        "rotation",
        "matrix",
        "translation",
        "count",
        "byteOffset",
        "byteLength",
        "byteStride",
        "bufferView",
        "sparse",
        "normalized",
        "indices",
        "attributes",
        "targets",
        "extensions",
        "extras",
        "uri",
        "skin",
        "weights",
        "material",
        "alphaMode",
        "lumel",
        "cookie",
        "cookieSize",
        "reflection",
        "page",
        "mode",
        "light",
        "rect",
        "size",
        "inverseBindMatrices",
        "JOINTS_0",
        "WEIGHTS_0",
        "lod",
        "variant",
        "group",
        "level",
        "index",
        "walkable",
        "exclude",
        "occluder",
        "density",
        "bake",
        "emitScale",
        "maxReflectance",
        "MSFT_lod",
        "ids",
    ];
    let value = match random.below(3) {
        0 => number(random),
        1 => json!([number(random), number(random), number(random)]),
        _ => copy,
    };
    members.insert(random.pick(&KEYS).into(), value);
}
