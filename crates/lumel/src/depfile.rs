//! Dependency files for make and ninja.
//!
//! One rule with all targets, and an empty rule for each input, so that one that is deleted or
//! renamed is no error but a reason to build. That is what compilers write with `-MP`; ninja's
//! `deps = gcc` and make's `-include` read it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::error::Error;

/// The text of a dependency file: `targets` are made from `inputs`.
///
/// Paths are written as they are given. Each appears once, in the given order; an input that is a
/// target too is left out.
///
/// # Errors
/// [`Error::Setting`] for a path that is not UTF-8 or holds a line break, which neither program can
/// read.
pub fn depfile(targets: &[PathBuf], inputs: &[PathBuf]) -> Result<String, Error> {
    let mut seen = BTreeSet::new();
    let mut names = |paths: &[PathBuf]| -> Result<Vec<String>, Error> {
        let fresh = paths.iter().filter(|p| seen.insert(p.to_path_buf()));
        fresh.map(|p| escape(p)).collect()
    };
    let (targets, inputs) = (names(targets)?, names(inputs)?);
    let mut text = targets.join(" \\\n  ");
    text.push(':');
    for input in &inputs {
        text.push_str(" \\\n  ");
        text.push_str(input);
    }
    text.push('\n');
    for input in &inputs {
        text.push('\n');
        text.push_str(input);
        text.push_str(":\n");
    }
    Ok(text)
}

/// A name as GCC escapes it: blanks and `#` get a backslash, and backslashes right before them are
/// doubled; `$` is doubled.
fn escape(path: &Path) -> Result<String, Error> {
    let fail = |what: &str| {
        Error::Setting(format!(
            "{path:?}: found {what} in a path, which a dependency file cannot hold"
        ))
    };
    let name = path
        .to_str()
        .ok_or_else(|| fail("bytes that are not UTF-8"))?;
    let mut out = String::with_capacity(name.len());
    let mut slashes = 0;
    for c in name.chars() {
        match c {
            '\n' | '\r' => return Err(fail("a line break")),
            ' ' | '\t' | '#' => {
                out.extend(std::iter::repeat_n('\\', slashes));
                out.push('\\');
            }
            '$' => out.push('$'),
            _ => {}
        }
        slashes = if c == '\\' { slashes + 1 } else { 0 };
        out.push(c);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(names: &[&str]) -> Vec<PathBuf> {
        names.iter().map(PathBuf::from).collect()
    }

    #[test]
    fn one_rule_and_an_empty_one_per_input() {
        let text = depfile(
            &paths(&["o/a.exr", "o/a b.glb"]),
            &paths(&["a.glb", "t.png", "a.glb"]),
        );
        let expected = "o/a.exr \\\n  o/a\\ b.glb: \\\n  a.glb \\\n  t.png\n\na.glb:\n\nt.png:\n";
        assert_eq!(text.ok().as_deref(), Some(expected));
    }

    #[test]
    fn awkward_names_are_escaped_and_hopeless_ones_refused() {
        let one = |name| escape(Path::new(name)).ok();
        for (name, escaped) in [
            ("größe 三.png", "größe\\ 三.png"),
            ("a#b$c", "a\\#b$$c"),
            ("a\\ b", "a\\\\\\ b"),
            ("a\\b", "a\\b"),
        ] {
            assert_eq!(one(name).as_deref(), Some(escaped));
        }
        assert_eq!(one("a\nb"), None);
    }
}
