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

fn page() -> String {
    let mut page = "# Options\n\nWhat `lumel COMMAND --help` says.\n".to_owned();
    let mut seen: Vec<Item> = Vec::new();
    let mut bake = 0;
    for command in COMMANDS {
        let help = lumel([command, "--help"]).ok().stdout;
        let about = help.lines().next().expect("help says something");
        write!(page, "\n## `lumel {command}`\n\n{about}.\n\n").expect("memory");
        let (old, new): (Vec<_>, Vec<_>) = items(&help).into_iter().partition(|i| seen.contains(i));
        for item in &new {
            page += &wrapped("- ", &format!("`{}`: {}", item.name, item.text));
            for value in &item.values {
                let (value, text) = value.split_once(':').unwrap_or((value, ""));
                page += &wrapped("  - ", &format!("`{value}`: {}", text.trim()));
            }
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

/// A sentence on items explained further up. If a command shares most options with `bake`, it names
/// those that are missing instead.
fn known(bake: &[Item], old: &[Item]) -> String {
    let list = |items: &[&Item]| {
        let names: Vec<_> = items.iter().map(|i| format!("`{}`", i.name)).collect();
        names.join(", ")
    };
    let lacking: Vec<&Item> = bake.iter().filter(|i| !old.contains(i)).collect();
    if lacking.len() >= old.len() {
        return format!("As above: {}.", list(&old.iter().collect::<Vec<_>>()));
    }
    let options: Vec<&Item> = lacking
        .into_iter()
        .filter(|i| i.name.starts_with('-'))
        .collect();
    if options.is_empty() {
        return "All options of `lumel bake`.".to_owned();
    }
    format!("Options of `lumel bake`, except {}.", list(&options))
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
