//! The documents are true: every path, option, field and symbol in them exists, links lead
//! somewhere, and the book's commands run.

mod commands;
mod options;
mod pages;

use std::collections::{BTreeSet, HashSet};
use std::fs;

use self::pages::{Page, documents, files_below, notes, root};
use crate::common::{bake, lumel, parse, quads, temp, write};

/// Commands of the binary.
const COMMANDS: [&str; 12] = [
    "bake",
    "solve",
    "gather",
    "merge",
    "watch",
    "inspect",
    "diff",
    "config",
    "completions",
    "man",
    "view",
    "report",
];

/// Fails with all of `faults`, one a line.
#[track_caller]
fn none(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn links_lead_somewhere() {
    let mut faults = Vec::new();
    for page in documents().iter().chain(&notes()) {
        for link in page.links.iter().filter(|l| !l.contains("://")) {
            let (file, place) = link.split_once('#').unwrap_or((link, ""));
            let target = if file.is_empty() {
                root().join(&page.name)
            } else {
                page.folder().join(file)
            };
            let found = target.exists()
                && (place.is_empty() || Page::read(&target).anchors.iter().any(|a| a == place));
            if !found {
                faults.push(format!("{}: {link} leads nowhere", page.name));
            }
        }
    }
    none(&faults);
}

#[test]
fn every_page_is_in_the_books_index() {
    let docs = root().join("docs");
    let index = Page::read(&docs.join("SUMMARY.md"));
    let listed: HashSet<_> = index.links.iter().map(|l| docs.join(l)).collect();
    let lost: Vec<_> = (files_below(&docs, &["md"]).into_iter())
        .filter(|p| !p.ends_with("SUMMARY.md") && !listed.contains(p))
        .map(|p| p.display().to_string())
        .collect();
    none(&lost);
}

/// Folders of the project whose files documents name.
const FOLDERS: [&str; 7] = [
    "crates/", "docs/", "lab/", "tools/", "assets/", "tests/", ".ci/",
];

#[test]
fn every_path_exists() {
    let mut faults = Vec::new();
    for page in documents() {
        let blocks = page.blocks.iter().map(|(_, text)| text);
        let words = page
            .spans
            .iter()
            .chain(blocks)
            .flat_map(|s| s.split_whitespace());
        let paths = words.map(|w| w.trim_end_matches(|c: char| !c.is_alphanumeric()));
        for word in paths.filter(|w| FOLDERS.iter().any(|f| w.starts_with(f))) {
            if !root().join(word).exists() {
                faults.push(format!("{}: {word} does not exist", page.name));
            }
        }
    }
    none(&faults);
}

/// Long options in a text.
fn long_options(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '-' || c == '_'))
        .filter(|w| {
            w.strip_prefix("--")
                .is_some_and(|o| o.starts_with(|c: char| c.is_ascii_lowercase()))
        })
}

/// The arguments of `lumel` in a line of a shell, a build file or prose; `None` if the line calls
/// another program.
fn arguments(line: &str) -> Option<&str> {
    if line.starts_with("--") {
        return Some(line);
    }
    let call = |c: &&str| {
        line.find(&format!("lumel {c}"))
            .or(line.find(&format!("lumel -- {c}")))
    };
    COMMANDS.iter().find_map(call).map(|at| &line[at..])
}

#[test]
fn every_option_exists() {
    let help: String = COMMANDS.map(|c| lumel([c, "--help"]).ok().stdout).concat();
    let known: HashSet<&str> = long_options(&help).chain(["--version"]).collect();
    let mut faults = BTreeSet::new();
    for page in documents() {
        let blocks = page.blocks.iter().flat_map(|(_, text)| text.lines());
        let lines = page.spans.iter().map(String::as_str).chain(blocks);
        for option in lines.filter_map(arguments).flat_map(long_options) {
            if !known.contains(option) {
                faults.insert(format!("{}: lumel has no option {option}", page.name));
            }
        }
    }
    none(&faults.into_iter().collect::<Vec<_>>());
}

#[test]
fn every_field_of_the_report_exists() {
    let t = temp();
    let scene = write(t.path().join("level.gltf"), quads::scene());
    let options = format!(
        "--sun {} --probes 4 --ktx2 rgb9e5 --page-by flat",
        quads::sun()
    );
    let out = t.path().join("out");
    bake(&scene, &out, &options).ok();
    let report = parse(fs::read(out.join("level.report.json")).expect("a report"));
    let is_field = |s: &str| {
        let first = s.split('.').next().expect("split gives something");
        s.contains('.')
            && report.get(first).is_some()
            && s.chars()
                .all(|c| c.is_ascii_lowercase() || "._".contains(c))
    };
    let mut faults = Vec::new();
    for page in documents() {
        for span in page.spans.iter().filter(|s| is_field(s)) {
            if report
                .pointer(&format!("/{}", span.replace('.', "/")))
                .is_none()
            {
                faults.push(format!("{}: the report has no {span}", page.name));
            }
        }
    }
    none(&faults);
}

/// Names in documents that belong to other programs.
const FOREIGN: [&str; 5] = [
    "AmbientLight",
    "KHR_lights_environment",
    "KHR_materials_volume",
    "gltfpack",
    "use_bicubic_filter",
];

/// Words of a text, also in the spelling that serde writes: `row_order` as `rowOrder`.
fn words_of(text: &str) -> impl Iterator<Item = String> {
    let words = text.split(|c: char| !(c.is_alphanumeric() || c == '_'));
    words.flat_map(|w| [w.to_owned(), camel_case(w)])
}

fn camel_case(word: &str) -> String {
    let mut parts = word.split('_');
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |out, part| {
        let mut letters = part.chars();
        let head = letters.next().map(|c| c.to_ascii_uppercase());
        out + &head.into_iter().chain(letters).collect::<String>()
    })
}

/// All words of the sources, and the names of their files.
fn words() -> HashSet<String> {
    let endings = [
        "rs", "py", "js", "ts", "gd", "toml", "html", "glsl", "sh", "mjs",
    ];
    let folders = ["crates", "tests", "tools"].map(|f| files_below(&root().join(f), &endings));
    let mut words = HashSet::new();
    for path in folders
        .into_iter()
        .flatten()
        .filter(|p| !p.ends_with("tests/book.rs"))
    {
        let stem = path.file_stem().expect("a file has a name");
        words.extend(stem.to_str().map(str::to_owned));
        let text = fs::read_to_string(&path).expect("sources are UTF-8");
        words.extend(words_of(&text));
    }
    words
}

/// Whether a span of code is a name, and not a formula or a command.
fn is_name(part: &str) -> bool {
    part.starts_with(|c: char| c.is_ascii_alphabetic())
        && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

#[test]
fn every_symbol_exists() {
    let known = words();
    let mut faults = BTreeSet::new();
    for page in documents() {
        // Names that the page's own examples define.
        let own: HashSet<String> = page.blocks.iter().flat_map(|(_, b)| words_of(b)).collect();
        for span in &page.spans {
            let name = span.split('(').next().expect("split gives something");
            if !name.split("::").all(is_name) {
                continue;
            }
            let lost = |p: &&str| !known.contains(*p) && !own.contains(*p) && !FOREIGN.contains(p);
            let lost = name.split("::").filter(lost);
            faults.extend(lost.map(|p| format!("{}: there is no `{p}`", page.name)));
        }
    }
    none(&faults.into_iter().collect::<Vec<_>>());
}

/// Texts of the table of warnings, from its first column.
fn warnings(page: &str) -> Vec<&str> {
    let (_, table) = page.split_once("| it says |").expect("a table of warnings");
    let rows = table.lines().skip(2).map_while(|l| l.strip_prefix("| "));
    rows.filter_map(|row| row.split(" | ").next()).collect()
}

#[test]
fn every_warning_is_said() {
    let mut sources = String::new();
    for path in files_below(&root().join("crates"), &["rs"]) {
        sources += &fs::read_to_string(&path).expect("sources are UTF-8");
    }
    let page = fs::read_to_string(root().join("docs/troubleshooting.md")).expect("a page");
    let lost = warnings(&page).into_iter().filter(|w| !sources.contains(w));
    none(
        &lost
            .map(|w| format!("no warning says {w:?}"))
            .collect::<Vec<_>>(),
    );
    assert!(warnings(&page).len() > 10, "the table has rows");
}

/// Longest line of prose; tables and code cannot be wrapped.
const WIDTH: usize = 100;

#[test]
fn prose_is_wrapped() {
    let mut faults = Vec::new();
    for page in documents() {
        let mut in_block = false;
        for (i, line) in page.text.lines().enumerate() {
            in_block ^= line.starts_with("```");
            let prose = !in_block && !line.starts_with(['|', '!']) && !line.starts_with("    ");
            if prose && line.chars().count() > WIDTH {
                faults.push(format!("{}:{}: longer than {WIDTH}", page.name, i + 1));
            }
        }
    }
    none(&faults);
}
