//! The documents, taken apart: code, links and headings.

use std::fs;
use std::path::{Path, PathBuf};

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};

/// The project's folder.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// A Markdown file.
pub struct Page {
    /// Path from the project's folder.
    pub name: String,
    pub text: String,
    /// Code within sentences and tables.
    pub spans: Vec<String>,
    /// Blocks of code: language and text.
    pub blocks: Vec<(String, String)>,
    pub links: Vec<String>,
    /// Anchors of headings, as mdBook and GitHub make them.
    pub anchors: Vec<String>,
}

impl Page {
    pub fn read(path: &Path) -> Page {
        let text = fs::read_to_string(path).expect("a page can be read");
        let name = path.strip_prefix(root()).expect("a page of the project");
        let mut page = Page {
            name: name.to_str().expect("names are UTF-8").to_owned(),
            spans: Vec::new(),
            blocks: Vec::new(),
            links: Vec::new(),
            anchors: Vec::new(),
            text: text.clone(),
        };
        let (mut in_block, mut heading) = (false, None);
        for event in Parser::new_ext(&text, Options::ENABLE_TABLES) {
            match event {
                Event::Start(Tag::CodeBlock(kind)) => {
                    let language = match kind {
                        CodeBlockKind::Fenced(language) => language.to_string(),
                        CodeBlockKind::Indented => String::new(),
                    };
                    page.blocks.push((language, String::new()));
                    in_block = true;
                }
                Event::End(TagEnd::CodeBlock) => in_block = false,
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => {
                    page.anchors.extend(heading.take().as_deref().map(anchor));
                }
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    page.links.push(dest_url.to_string());
                }
                Event::Text(text) if in_block => {
                    let (_, block) = page.blocks.last_mut().expect("a block has begun");
                    block.push_str(&text);
                }
                Event::Text(text) | Event::Code(text) if heading.is_some() => {
                    heading.iter_mut().for_each(|h| h.push_str(&text));
                }
                Event::Code(code) => page.spans.push(code.to_string()),
                _ => {}
            }
        }
        page
    }

    /// Its folder.
    pub fn folder(&self) -> PathBuf {
        root().join(&self.name).parent().expect("a file").to_owned()
    }
}

/// What a heading is linked by.
fn anchor(heading: &str) -> String {
    (heading.chars())
        .filter_map(|c| match c {
            ' ' => Some('-'),
            '-' | '_' => Some(c),
            _ => c.is_alphanumeric().then(|| c.to_ascii_lowercase()),
        })
        .collect()
}

/// The files below a folder with one of the endings, in order of their names.
pub fn files_below(folder: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder of the project") {
            let path = entry.expect("it can be listed").path();
            let has = |e: &&str| path.extension().is_some_and(|x| *x == **e);
            if path.is_dir() {
                let skipped = ["node_modules", "target", "vendor", "__pycache__"];
                if !skipped.iter().any(|s| path.ends_with(s)) {
                    folders.push(path);
                }
            } else if endings.iter().any(has) {
                out.push(path);
            }
        }
    }
    out.sort();
    out
}

/// The book and the pages at the top of the project: what users and contributors read.
pub fn documents() -> Vec<Page> {
    let mut paths = files_below(&root().join("docs"), &["md"]);
    paths.extend(["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(|n| root().join(n)));
    paths.iter().map(|p| Page::read(p)).collect()
}

/// The laboratory's notebooks and the pages of the tools.
pub fn notes() -> Vec<Page> {
    let mut paths = files_below(&root().join("lab"), &["md"]);
    paths.extend(files_below(&root().join("tools"), &["md"]));
    paths.iter().map(|p| Page::read(p)).collect()
}
