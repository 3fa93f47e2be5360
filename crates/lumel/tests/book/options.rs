//! The book's page of options matches `lumel COMMAND --help`.

use std::fmt::Write;
use std::fs;

use super::pages::root;
use super::{COMMANDS, WIDTH, none};
use crate::common::lumel;

/// An option or an argument: its syntax and its text.
#[derive(PartialEq)]
struct Item {
    name: String,
    text: String,
    values: Vec<String>,
}

/// Options and arguments of a command's help.
fn items(help: &str) -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    let lines = help
        .lines()
        .skip_while(|l| !matches!(*l, "Arguments:" | "Options:"));
    for line in lines.filter(|l| l.starts_with(' ')) {
        let words = line.trim();
        let indent = line.len() - line.trim_start().len();
        if indent < 10 && words.starts_with(['-', '<', '[']) {
            let (name, text) = words.split_once("  ").unwrap_or((words, ""));
            let (name, text) = (name.to_owned(), text.trim().to_owned());
            items.push(Item {
                name,
                text,
                values: Vec::new(),
            });
            continue;
        }
        let item = items.last_mut().expect("a text follows a name");
        if let Some(value) = words.strip_prefix("- ") {
            item.values.push(value.to_owned());
        } else if words != "Possible values:" {
            // `[default: …]` follows values, in a paragraph of its own.
            let text = match item.values.last_mut() {
                Some(value) if !words.starts_with("[default") => value,
                _ => &mut item.text,
            };
            if !text.is_empty() {
                text.push(' ');
            }
            text.push_str(words);
        }
    }
    items.retain(|i| i.name != "-h, --help");
    items
}

/// A list entry in lines of at most [`WIDTH`], the first after `bullet`.
fn wrapped(bullet: &str, text: &str) -> String {
    let (mut out, mut line) = (String::new(), bullet.trim_end().to_owned());
    for word in text.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > WIDTH {
            out += &line;
            out.push('\n');
            line = " ".repeat(bullet.len().saturating_sub(1));
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line += word;
    }
    out + &line + "\n"
}

/// Whether an option only overrides its opposite in a settings file. Its line is its opposite's.
fn overrides(item: &Item) -> bool {
    item.text.starts_with("Override `")
}

/// The head of the page.
const HEAD: &str = "# Options

From `lumel COMMAND --help`, which also explains the values. The second of two names overrides the
first in a settings file.
";

fn page() -> String {
    let mut page = HEAD.to_owned();
    let mut seen: Vec<Item> = Vec::new();
    let mut bake = 0;
    for command in COMMANDS {
        let help = lumel([command, "--help"]).ok().stdout;
        let about = help.lines().next().expect("help says something");
        write!(page, "\n## `lumel {command}`\n\n{about}.\n\n").expect("memory");
        let (old, new): (Vec<_>, Vec<_>) = items(&help).into_iter().partition(|i| seen.contains(i));
        for (i, item) in new.iter().enumerate().filter(|(_, i)| !overrides(i)) {
            let opposite = new.get(i + 1).filter(|i| overrides(i));
            let opposite = opposite.map_or(String::new(), |i| format!(", `{}`", i.name));
            let mut text = format!("`{}`{opposite}: {}", item.name, item.text);
            let name = |v: &String| format!("`{}`", v.split(':').next().unwrap_or(v));
            let values: Vec<_> = item.values.iter().map(name).collect();
            if !values.is_empty() {
                text += &format!(": {}", values.join(", "));
            }
            page += &wrapped("- ", &text);
        }
        if !old.is_empty() {
            page += &format!("\n{}", wrapped("", &known(&seen[..bake], &old)));
        }
        seen.extend(new);
        if command == "bake" {
            bake = seen.len();
        }
    }
    page
}

/// A sentence on items explained further up, which were all of `bake` or some of it.
fn known(bake: &[Item], old: &[Item]) -> String {
    let options = |i: &Item| i.name.starts_with('-');
    if !bake.is_empty() && bake.iter().all(|i| !options(i) || old.contains(i)) {
        return "All options of `lumel bake`.".to_owned();
    }
    // Neighbours in the list of `bake` become a range.
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    let mut names = Vec::new();
    for item in old {
        match bake.iter().position(|i| i == item) {
            Some(at) if ranges.last().is_some_and(|r| r.1 + 1 == at) => {
                ranges.last_mut().expect("it was just seen").1 = at;
            }
            Some(at) => ranges.push((at, at)),
            None => names.push(format!("`{}`", item.name)),
        }
    }
    names.extend(ranges.into_iter().map(|(from, to)| {
        let (a, b) = (&bake[from].name, &bake[to].name);
        match to - from {
            0 => format!("`{a}`"),
            1 => format!("`{a}`, `{b}`"),
            _ => format!("`{a}` to `{b}`"),
        }
    }));
    format!("As above: {}.", names.join(", "))
}

#[test]
fn the_page_of_options_is_current() {
    let path = root().join("docs/options.md");
    let page = page();
    if fs::read_to_string(&path).is_ok_and(|old| old == page) {
        return;
    }
    let hint = "docs/options.md is not what --help says: run with LUMEL_BLESS=1";
    if std::env::var_os("LUMEL_BLESS").is_some() {
        fs::write(&path, page).expect("the page can be written");
    }
    none(&[hint.to_owned()]);
}
