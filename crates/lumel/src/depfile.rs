//! Dependency files for make and ninja.
//!
//! The file has one rule with all targets, and an empty rule for each input: a deleted or renamed
//! input then triggers a build instead of an error. This is what compilers write with `-MP`, and
//! what ninja's `deps = gcc` and make's `-include` read.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::error::Error;

/// The text of a dependency file that makes `targets` depend on `inputs`.
///
/// Paths are written as given, each once, in the given order. An input that is also a target is
/// left out.
///
/// ```
/// let text = lumel::depfile(&["out/a.exr".into()], &["a.glb".into()])?;
/// assert!(text.starts_with("out/a.exr: \\\n  a.glb\n"));
/// # Ok::<(), lumel::Error>(())
/// ```
///
/// # Errors
/// [`Error::Setting`] for a path that is not UTF-8 or contains a line break, which neither program
/// can read.
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

/// Escapes a name like GCC: spaces and `#` get a backslash, backslashes right before them are
/// doubled, and `$` is doubled.
fn escape(path: &Path) -> Result<String, Error> {
    let fail = |what: &str| {
        Error::Setting(format!(
            "{path:?}: found {what} in a path, which dependency files cannot contain"
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
