//! Files of a crate import each other in one direction only, so that each can be understood with
//! those below it.
//!
//! Method calls need no import, so an `impl` block for a type of another file is not detected.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A module by its path from the crate's root, which is empty.
type Module = Vec<String>;

/// What each module of a crate imports.
type Imports = BTreeMap<Module, BTreeSet<Module>>;

/// Crates whose files must not import each other in a circle.
const CRATES: [&str; 3] = ["atlas", "gather", "atlas-bake"];

/// The text of each module below `folder`.
fn read(folder: &Path, at: &Module, out: &mut BTreeMap<Module, String>) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("readable").path();
        let name = path.file_stem().expect("a name").to_string_lossy();
        if name == "tests" {
            continue;
        }
        let mut module = at.clone();
        if !["lib", "mod"].contains(&&*name) {
            module.push(name.into_owned());
        }
        if path.is_dir() {
            read(&path, &module, out);
        } else {
            let text = std::fs::read_to_string(&path).expect("UTF-8");
            out.insert(module, text);
        }
    }
}

/// The modules that a text refers to by `crate::` or `super::`, and those that it declares.
/// Comments and tests, which come last in a file, do not count.
fn named(module: &Module, text: &str, all: &BTreeMap<Module, String>) -> BTreeSet<Module> {
    let text = text.split("mod tests {").next().unwrap_or_default();
    let mut out = BTreeSet::new();
    for line in text.lines() {
        let code = line.split("//").next().unwrap_or_default();
        let part_of_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
        for path in code
            .split(|c| !part_of_path(c))
            .filter(|p| p.contains("::"))
        {
            let mut names: Vec<&str> = path.split("::").collect();
            let mut target = match names[0] {
                "crate" => Module::new(),
                _ => module.clone(),
            };
            match names[0] {
                "crate" => _ = names.remove(0),
                "super" => {
                    while names.first() == Some(&"super") {
                        names.remove(0);
                        target.pop();
                    }
                }
                child if text.contains(&format!("mod {child};")) => {}
                _ => continue,
            }
            for name in names {
                target.push(name.to_owned());
                if !all.contains_key(&target) {
                    target.pop();
                    break;
                }
            }
            out.insert(target);
        }
    }
    out.remove(module);
    out
}

/// A circle that begins and ends with the same module, if there is one.
fn circle(imports: &Imports) -> Option<Vec<Module>> {
    fn visit(
        at: &Module,
        imports: &Imports,
        way: &mut Vec<Module>,
        done: &mut BTreeSet<Module>,
    ) -> bool {
        way.push(at.clone());
        if let Some(first) = way[..way.len() - 1].iter().position(|m| m == at) {
            way.drain(..first);
            return true;
        }
        let found =
            !done.contains(at) && (imports[at].iter()).any(|to| visit(to, imports, way, done));
        if !found {
            done.insert(at.clone());
            way.pop();
        }
        found
    }
    let (mut way, mut done) = (Vec::new(), BTreeSet::new());
    (imports.keys())
        .any(|m| visit(m, imports, &mut way, &mut done))
        .then_some(way)
}

fn imports(all: &BTreeMap<Module, String>) -> Imports {
    (all.iter())
        .map(|(module, text)| (module.clone(), named(module, text, all)))
        .collect()
}

fn written(circle: Option<Vec<Module>>) -> Option<String> {
    Some(
        circle?
            .iter()
            .map(|m| format!("crate::{}", m.join("::")))
            .collect::<Vec<_>>()
            .join(" -> "),
    )
}

#[test]
fn files_import_each_other_in_one_direction() {
    for name in CRATES {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../crates")
            .join(name);
        let mut all = BTreeMap::new();
        read(&folder.join("src"), &Module::new(), &mut all);
        let imports = imports(&all);
        let count: usize = imports.values().map(BTreeSet::len).sum();
        assert!(
            count > all.len(),
            "{name}: {count} imports in {} files were found",
            all.len()
        );
        assert_eq!(written(circle(&imports)), None, "{name}");
    }
}

#[test]
fn circles_are_found() {
    let texts = [
        (vec![], "mod a;\nmod b;\npub use a::x;"),
        (vec!["a"], "use crate::b::c::{\n    y,\n};"),
        (vec!["b"], "pub mod c;"),
        (vec!["b", "c"], "fn y() {\n    super::super::a::x()\n}"),
    ];
    let mut all: BTreeMap<Module, String> = texts
        .map(|(m, text)| (m.into_iter().map(String::from).collect(), text.into()))
        .into();
    let found = written(circle(&imports(&all)));
    assert_eq!(
        found.as_deref(),
        Some("crate::a -> crate::b::c -> crate::a")
    );
    all.insert(
        vec!["b".into(), "c".into()],
        "// crate::a::x\n#[cfg(test)]\nmod tests {\n    use crate::a;\n}".into(),
    );
    assert_eq!(written(circle(&imports(&all))), None);
}
