//! `lumel report`: a finished bake as one self-contained HTML file, without scripts or network
//! access.

mod density;
mod html;
mod pictures;
mod problems;
mod sections;
mod svg;

use serde_json::Value;

use crate::error::Error;
use crate::folder::{BakeFolder, FinishedManifest};
use html::escape;

/// The data that the sections are made from.
struct Inputs<'a> {
    folder: &'a BakeFolder,
    stem: &'a str,
    manifest: &'a FinishedManifest,
    /// The report as JSON: if another version lacks a field, the page lacks a line.
    report: &'a Value,
}

/// The page about the bake called `stem` in `folder`: HTML, UTF-8.
///
/// The same bake gives the same bytes. Pages of two runs differ only in times and memory.
///
/// ```no_run
/// let folder = lumel::BakeFolder::open("out".as_ref())?;
/// for stem in folder.bakes() {
///     let html = lumel::report_page(&folder, &stem)?;
/// }
/// # Ok::<(), lumel::Error>(())
/// ```
///
/// # Errors
/// [`Error::Folder`] if the manifest, the report or a page is missing or broken, [`Error::Output`]
/// if an EXR cannot be read.
pub fn report_page(folder: &BakeFolder, stem: &str) -> Result<String, Error> {
    let manifest = folder.manifest(stem)?;
    let report = folder.report(stem)?;
    let source = Inputs {
        folder,
        stem,
        manifest: &manifest,
        report: &report,
    };
    let maps = pictures::maps(&source)?;
    let strangers = (folder.disagreement(stem))
        .map(|d| format!("<p class=\"mark\">{}</p>\n", escape(&d)))
        .unwrap_or_default();
    let sections = [
        ("summary", "Summary", sections::summary(&source)),
        (
            "problems",
            "Problems",
            strangers + &problems::section(&report),
        ),
        ("lightmaps", "Lightmaps", maps.lightmaps),
        ("error", "Estimated error", maps.error),
        ("solve", "Solve and energy", sections::solve(&report)),
        ("density", "Lumels per metre", density::section(&source)),
        ("seams", "Seams", sections::seams(&report)),
        ("time", "Time and memory", sections::time(&report)),
        ("settings", "Settings", sections::settings(&report)),
    ];
    let title = escape(report["scene"].as_str().unwrap_or(stem));
    let links: String = (sections.iter())
        .map(|(id, name, _)| format!("<a href=\"#{id}\">{name}</a>"))
        .collect::<Vec<_>>()
        .join(" ");
    let body: String = (sections.iter())
        .map(|(id, name, text)| {
            format!("<section id=\"{id}\">\n<h2>{name}</h2>\n{text}</section>\n")
        })
        .collect();
    let generator = escape(report["generator"].as_str().unwrap_or("lumel"));
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n\
         <title>{title}: lumel report</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <header><h1>{title}</h1><nav>{links}</nav></header>\n{body}<footer>{generator}</footer>\n</body>\n</html>\n"
    ))
}

const STYLE: &str = "\
:root { color-scheme: light dark; --line: #8884; --dim: #6b7280; --mark: #b86e00; --a: #3b6fb5; --b: #c2691d; --c: #3f8f5a; }
@media (prefers-color-scheme: dark) { :root { --dim: #9aa3b2; --mark: #e0a84a; --a: #7aa7e8; --b: #e89a55; --c: #7cc796; } }
body { font: 14px/1.5 system-ui, sans-serif; max-width: 1080px; margin: 0 auto; padding: 12px 20px 40px; }
h1 { font-size: 22px; margin: 8px 0; overflow-wrap: anywhere; } h2 { font-size: 17px; margin: 30px 0 8px; border-bottom: 1px solid var(--line); } h3 { font-size: 14px; margin: 14px 0 4px; }
nav { display: flex; flex-wrap: wrap; gap: 4px 14px; } a { color: var(--a); }
table { border-collapse: collapse; } td, th { padding: 2px 14px 2px 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; } th { color: var(--dim); font-weight: 600; }
.scroll { overflow-x: auto; } .dim, figcaption, footer { color: var(--dim); } .mark { color: var(--mark); } footer { margin-top: 40px; }
.maps { display: flex; flex-wrap: wrap; gap: 14px; } figure { margin: 0; max-width: min(100%, 510px); } figure img { display: block; max-width: 100%; background: #000; }
svg { max-width: 100%; height: auto; } svg text { fill: currentColor; font: 11px system-ui, sans-serif; } svg .grid { stroke: var(--line); fill: none; }
svg .a { fill: var(--a); } svg .b { fill: var(--b); } svg .c { fill: var(--c); } svg .la { stroke: var(--a); } svg .lb { stroke: var(--b); } svg .lc { stroke: var(--c); } svg polyline { fill: none; stroke-width: 2; }
.scale { width: 420px; max-width: 100%; display: flex; flex-wrap: wrap; justify-content: space-between; font-size: 12px; color: var(--dim); margin: 0 0 10px; font-variant-numeric: tabular-nums; }
.scale img { width: 100%; height: 12px; }
summary { cursor: pointer; margin: 6px 0; }
code { overflow-wrap: anywhere; } pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: 12px; }
";

#[cfg(test)]
mod tests;
