//! Text generated from the grammar: completions, manual pages and a settings template.

use std::io::Write;

use clap::CommandFactory;
use clap_mangen::Man as Page;
use lumel::atlas_bake::OutputSet;

use super::args::{Arguments, Completions, Man};
use super::{Failure, config, interrupt};

/// Month of the release, printed on manual pages; the same as in CHANGELOG.md.
const RELEASED: &str = "2026-11";

/// `lumel config`.
pub(crate) fn config() -> Result<(), Failure> {
    Ok(std::io::stdout()
        .lock()
        .write_all(config::TEMPLATE.as_bytes())?)
}

/// `lumel completions SHELL`.
pub(crate) fn completions(a: &Completions) -> Result<(), Failure> {
    // Generated in memory first: the generator panics if a pipe is closed.
    let mut text = Vec::new();
    clap_complete::generate(a.shell, &mut Arguments::command(), "lumel", &mut text);
    Ok(std::io::stdout().lock().write_all(&text)?)
}

/// `lumel man`.
pub(crate) fn man(a: &Man) -> Result<(), Failure> {
    let pages = pages()?;
    if let Some(dir) = &a.output {
        let mut set = OutputSet::create(dir)?;
        for (name, page) in &pages {
            set.add(&format!("{name}.1"), page)?;
        }
        interrupt::committing(|| set.commit())?;
        return Ok(());
    }
    let wanted = match a.command.as_deref() {
        None => "lumel".to_owned(),
        Some(command) => format!("lumel-{command}"),
    };
    let Some((_, page)) = pages.iter().find(|(name, _)| *name == wanted) else {
        let known: Vec<&str> = (pages.iter())
            .filter_map(|(name, _)| name.strip_prefix("lumel-"))
            .collect();
        return Err(lumel::Error::Setting(format!(
            "found the command {:?}, expected one of {}",
            a.command.as_deref().unwrap_or_default(),
            known.join(", ")
        ))
        .into());
    };
    Ok(std::io::stdout().lock().write_all(page)?)
}

/// Every command's name and page, `lumel` first.
fn pages() -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let mut grammar = Arguments::command().disable_help_subcommand(true);
    grammar.build();
    let mut out = Vec::new();
    let mut add = |name: String, command: clap::Command| -> Result<(), Failure> {
        let mut page = Vec::new();
        // Built commands are named `lumel-bake`. Without a title and a manual name, clap_mangen
        // leaves blanks in the page's heading.
        Page::new(command)
            .title(name.to_uppercase())
            .date(RELEASED)
            .source(concat!("lumel ", env!("CARGO_PKG_VERSION")))
            .manual("Lumel Manual")
            .render(&mut page)?;
        out.push((name, page));
        Ok(())
    };
    add("lumel".into(), grammar.clone())?;
    for command in grammar.get_subcommands() {
        let name = format!("lumel-{}", command.get_name());
        add(name, command.clone())?;
    }
    Ok(out)
}
