//! Sources of light by name: switching and dimming them, and sorting them into groups.
//!
//! A pattern is a name in which `*` stands for any characters and `?` for one; case counts. It
//! means every source that bears such a name: a punctual light by its own or its node's name, an
//! emissive material, the sky as `sky`, and suns of the command line as `sun`. What the document
//! leaves unnamed goes by its place, `nodes[3]` or `materials[2]`.

use std::collections::BTreeSet;

use glam::Vec3;
use mesh_ingest::Scene;
use radiosity::LightGroups;
use serde::Serialize;
use serde_json::Value;
use wildmatch::WildMatch;

use crate::error::Error;
use crate::report::GroupReport;
use crate::settings::{LightGroup, LightScale, Settings};

/// The group of all that is in no other.
pub(crate) const REST: &str = "rest";

/// Most names that a message lists.
const LISTED: usize = 20;

/// Longest name of a group, bytes: with the scene's own name before it, a file name must stay below
/// 255 of them.
const MAX_GROUP_NAME: usize = 64;

/// Most groups, [`REST`] among them: [`LightGroups`] counts in bytes.
const MAX_GROUPS: usize = 255;

/// Something that gives light, as options name it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Source {
    /// What it is.
    pub kind: SourceKind,
    /// Its name; of what has none, its place in the document.
    pub name: String,
    /// The name of the node that carries a light, where that is another.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub node: Option<String>,
}

/// Kinds of [`Source`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceKind {
    /// A punctual light, or a sun of the command line.
    Light,
    /// An emissive material.
    Material,
    /// The sky.
    Sky,
}

/// Where in a [`Scene`] a source is.
#[derive(Debug, Clone, Copy)]
enum Place {
    Light(usize),
    Material(usize),
    Sky,
}

/// All sources of a scene: lights, then materials in the document's order, then the sky.
pub(crate) struct Sources {
    sources: Vec<(Source, Place)>,
}

/// What [`Sources::apply`] leaves to be done by others.
#[derive(Debug, Default)]
pub(crate) struct Chosen {
    /// Groups of what still shines, with their names; `None` where none were asked for.
    pub groups: Option<(LightGroups, Vec<String>)>,
    /// The same for people.
    pub report: Vec<GroupReport>,
    /// Multiplies the settings' sky; a scene's own environment is dimmed already.
    pub sky_factor: f32,
}

impl Sources {
    /// Finds the sources of a scene, in which the settings' suns are already. `document` is the
    /// glTF's JSON; `sky` says whether the settings bring a sky.
    pub(crate) fn find(scene: &Scene, document: &Value, sky: bool) -> Self {
        let mut sources = Vec::new();
        for (i, light) in scene.lights.iter().enumerate() {
            let node_name = light
                .node
                .and_then(|n| document["nodes"][n]["name"].as_str())
                .unwrap_or_default();
            let name = match (light.name.as_str(), light.node) {
                ("", Some(n)) => format!("nodes[{n}]"),
                ("", None) => "light".into(),
                (name, _) => name.into(),
            };
            let node = (!node_name.is_empty() && node_name != name).then(|| node_name.into());
            let kind = SourceKind::Light;
            sources.push((Source { kind, name, node }, Place::Light(i)));
        }
        for i in glowing_materials(scene) {
            let m = &scene.materials[i];
            let name = match m.name.as_str() {
                "" => format!("materials[{i}]"),
                name => name.into(),
            };
            let source = Source {
                kind: SourceKind::Material,
                name,
                node: None,
            };
            sources.push((source, Place::Material(i)));
        }
        if sky || scene.environment.is_some() {
            let source = Source {
                kind: SourceKind::Sky,
                name: "sky".into(),
                node: None,
            };
            sources.push((source, Place::Sky));
        }
        Sources { sources }
    }

    /// The sources, for people.
    pub(crate) fn list(&self) -> Vec<Source> {
        self.sources.iter().map(|(s, _)| s.clone()).collect()
    }

    /// Indices of the sources that a pattern of `option` means.
    ///
    /// # Errors
    /// [`Error::Setting`], with the names there are, where it means none.
    fn matching(&self, option: &str, pattern: &str) -> Result<Vec<usize>, Error> {
        let wild = WildMatch::new(pattern);
        let found: Vec<usize> = (0..self.sources.len())
            .filter(|&i| {
                let s = &self.sources[i].0;
                wild.matches(&s.name) || s.node.as_deref().is_some_and(|n| wild.matches(n))
            })
            .collect();
        if found.is_empty() {
            return Err(Error::Setting(format!(
                "{option}: no source of light is named {pattern:?}; {}",
                self.names()
            )));
        }
        Ok(found)
    }

    /// All names in alphabetical order, at most [`LISTED`] of them, as the end of a sentence.
    fn names(&self) -> String {
        let all: BTreeSet<&str> = self
            .sources
            .iter()
            .flat_map(|(s, _)| [Some(s.name.as_str()), s.node.as_deref()])
            .flatten()
            .collect();
        if all.is_empty() {
            return "the scene has none".into();
        }
        let some: Vec<String> = all.iter().take(LISTED).map(|n| format!("{n:?}")).collect();
        let more = match all.len() - some.len() {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        format!("there are {}{more}", some.join(", "))
    }

    /// What the report calls a source: its node where others bear the same name.
    fn label(&self, i: usize) -> String {
        let s = &self.sources[i].0;
        let alike = self
            .sources
            .iter()
            .filter(|(t, _)| t.name == s.name)
            .count();
        match &s.node {
            Some(node) if alike > 1 => node.clone(),
            _ => s.name.clone(),
        }
    }

    /// Dims the scene's sources by the settings and removes those that are switched off; sorts the
    /// rest into groups.
    ///
    /// Groups may name what is switched off: it is only not there.
    ///
    /// # Errors
    /// [`Error::Setting`] where a pattern means nothing, a source is in two groups, or a light gets
    /// too bright for `f32`.
    pub(crate) fn apply(&self, scene: &mut Scene, settings: &Settings) -> Result<Chosen, Error> {
        let factors = self.factors(&settings.lights)?;
        let owners = self.owners(&settings.groups)?;
        let mut chosen = Chosen {
            sky_factor: 1.0,
            ..Chosen::default()
        };
        let mut keep = vec![true; scene.lights.len()];
        for ((source, place), &factor) in self.sources.iter().zip(&factors) {
            let dimmed = |x: Vec3| -> Result<Vec3, Error> {
                let y = x * factor;
                if y.is_finite() {
                    return Ok(y);
                }
                Err(Error::Setting(format!(
                    "{:?} is {x} and becomes too bright for 32-bit numbers when multiplied by {factor}",
                    source.name
                )))
            };
            match *place {
                Place::Light(i) => {
                    scene.lights[i].intensity = dimmed(scene.lights[i].intensity)?;
                    keep[i] = factor > 0.0;
                }
                Place::Material(i) => {
                    scene.materials[i].emissive = dimmed(scene.materials[i].emissive)?;
                }
                Place::Sky => {
                    chosen.sky_factor = factor;
                    if factor == 0.0 {
                        scene.environment = None;
                    } else if factor != 1.0
                        && let Some(e) = &mut scene.environment
                    {
                        for p in &mut e.pixels {
                            *p = dimmed(*p)?;
                        }
                    }
                }
            }
        }
        // Places of sources in `scene.lights` hold until here.
        if !settings.groups.is_empty() {
            let lit: Vec<bool> = factors.iter().map(|f| *f > 0.0).collect();
            let (groups, names, report) = self.sort(scene, settings, &owners, &lit);
            chosen.groups = Some((groups, names));
            chosen.report = report;
        }
        if let (Some((groups, _)), true) = (&mut chosen.groups, keep.contains(&false)) {
            retain(&mut groups.lights, &keep);
        }
        retain(&mut scene.lights, &keep);
        Ok(chosen)
    }

    /// Per source, what multiplies it: the last of `lights` that means it, or 1.
    fn factors(&self, lights: &[LightScale]) -> Result<Vec<f32>, Error> {
        let mut factors = vec![1.0; self.sources.len()];
        for l in lights {
            let option = if l.factor == 0.0 {
                "--light or --exclude-light"
            } else {
                "--light"
            };
            for i in self.matching(option, &l.name)? {
                factors[i] = l.factor;
            }
        }
        Ok(factors)
    }

    /// Per source, the index of the group that names it.
    fn owners(&self, groups: &[LightGroup]) -> Result<Vec<Option<usize>>, Error> {
        let mut owners = vec![None; self.sources.len()];
        for (g, group) in groups.iter().enumerate() {
            for pattern in &group.sources {
                for i in self.matching(&format!("--group {}", group.name), pattern)? {
                    match owners[i] {
                        Some(other) if other != g => {
                            let other: &LightGroup = &groups[other];
                            return Err(Error::Setting(format!(
                                "{:?} is in the groups {} and {}, expected it in one of them",
                                self.label(i),
                                other.name,
                                group.name
                            )));
                        }
                        _ => owners[i] = Some(g),
                    }
                }
            }
        }
        Ok(owners)
    }

    /// The groups of the sources that are lit, by places of the scene before any light is taken
    /// out.
    fn sort(
        &self,
        scene: &Scene,
        settings: &Settings,
        owners: &[Option<usize>],
        lit: &[bool],
    ) -> (LightGroups, Vec<String>, Vec<GroupReport>) {
        let mut report: Vec<GroupReport> = settings
            .groups
            .iter()
            .map(|g| GroupReport {
                name: g.name.clone(),
                sources: Vec::new(),
            })
            .collect();
        let rest = report.len();
        if owners.iter().zip(lit).any(|(o, lit)| o.is_none() && *lit) {
            report.push(GroupReport {
                name: REST.into(),
                sources: Vec::new(),
            });
        }
        let mut groups = LightGroups {
            count: report.len(),
            lights: vec![0; scene.lights.len()],
            materials: vec![0; scene.materials.len()],
            sky: 0,
        };
        for (i, (_, place)) in self.sources.iter().enumerate() {
            if !lit[i] {
                continue;
            }
            let g = owners[i].unwrap_or(rest);
            let label = self.label(i);
            if !report[g].sources.contains(&label) {
                report[g].sources.push(label);
            }
            // `check` admits no more than fit.
            let g = g as u8;
            match *place {
                Place::Light(i) => groups.lights[i] = g,
                Place::Material(i) => groups.materials[i] = g,
                Place::Sky => groups.sky = g,
            }
        }
        let names = report.iter().map(|g| g.name.clone()).collect();
        (groups, names, report)
    }
}

/// Keeps the items whose flag is set.
fn retain<T>(items: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    items.retain(|_| flags.next().copied().unwrap_or(true));
}

/// Materials that shine and that something in the scene wears, ascending.
fn glowing_materials(scene: &Scene) -> BTreeSet<usize> {
    scene
        .instances
        .iter()
        .filter(|i| !i.occluder)
        .flat_map(|i| &scene.meshes[i.mesh].primitives)
        .map(|p| p.material)
        .filter(|&m| {
            let m = &scene.materials[m];
            m.emissive != Vec3::ZERO && !m.occluder_only
        })
        .collect()
}

/// Checks what needs no scene: factors, and names of groups.
///
/// # Errors
/// [`Error::Setting`].
pub(crate) fn check(settings: &Settings) -> Result<(), Error> {
    for l in &settings.lights {
        if !(l.factor.is_finite() && l.factor >= 0.0) {
            return Err(Error::Setting(format!(
                "the factor of the light {:?} is {}, expected a number of at least 0",
                l.name, l.factor
            )));
        }
    }
    let groups = &settings.groups;
    // One place is kept for what is in none of them.
    if groups.len() >= MAX_GROUPS {
        return Err(Error::Setting(format!(
            "found {} groups, expected at most {}",
            groups.len(),
            MAX_GROUPS - 1
        )));
    }
    for (i, g) in groups.iter().enumerate() {
        check_name(&g.name)?;
        // Files of names that differ only so would be one on Windows and macOS.
        let twin = |h: &&LightGroup| h.name.eq_ignore_ascii_case(&g.name);
        if let Some(h) = groups[..i].iter().find(twin) {
            return Err(Error::Setting(format!(
                "found the groups {} and {}, expected names that differ by more than case",
                h.name, g.name
            )));
        }
        if g.sources.is_empty() {
            return Err(Error::Setting(format!(
                "the group {} names no sources of light, expected at least one",
                g.name
            )));
        }
    }
    Ok(())
}

/// A group's name becomes part of file names, beside the numbers of pages.
fn check_name(name: &str) -> Result<(), Error> {
    let sane = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    let expected = if name.is_empty() || name.len() > MAX_GROUP_NAME || !name.chars().all(sane) {
        format!("1 to {MAX_GROUP_NAME} of the characters A-Z a-z 0-9 . _ -")
    } else if name.starts_with('.') || name.ends_with('.') {
        "no dot at either end".into()
    } else if name.chars().all(|c| c.is_ascii_digit()) {
        "more than digits, which number a lightmap's pages".into()
    } else if name.eq_ignore_ascii_case(REST) {
        "another one: it is the group of what is in no other".into()
    } else {
        return Ok(());
    };
    Err(Error::Setting(format!(
        "the name of a group is {name:?}, expected {expected}"
    )))
}

#[cfg(test)]
mod tests;
