//! Light sources by name: scaling them, switching them off and sorting them into groups.
//!
//! A pattern is a case-sensitive name in which `*` stands for any characters and `?` for one. It
//! matches every source with such a name: a punctual light by its own or its node's name, an
//! emissive material, the sky as `sky`, and suns of the command line as `sun`. Unnamed sources are
//! called by their place in the document, `nodes[3]` or `materials[2]`.

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

/// The group of sources in no other group.
pub(crate) const REST: &str = "rest";

/// Most names listed in a message.
const LISTED: usize = 20;

/// Longest name of a group, bytes. A file name, which also contains the scene's name, must stay
/// below 255.
const MAX_GROUP_NAME: usize = 64;

/// Most groups, including [`REST`]: [`LightGroups`] stores indices in a byte.
const MAX_GROUPS: usize = 255;

/// A light source, as options name it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Source {
    /// Its kind.
    pub kind: SourceKind,
    /// Its name, or its place in the document if it has none.
    pub name: String,
    /// The name of the node that carries a light, if it differs.
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

/// Position of a source in a [`Scene`].
#[derive(Debug, Clone, Copy)]
enum Target {
    Light(usize),
    Material(usize),
    Sky,
}

/// All sources of a scene: lights, then materials in the document's order, then the sky.
pub(crate) struct Sources {
    sources: Vec<(Source, Target)>,
}

/// Results of [`Sources::apply`] for later stages.
#[derive(Debug, Default)]
pub(crate) struct Chosen {
    /// Groups of the remaining sources with their names; `None` if none were requested.
    pub groups: Option<(LightGroups, Vec<String>)>,
    /// The groups, for the report.
    pub report: Vec<GroupReport>,
    /// Factor on the settings' sky; the scene's own environment is already scaled.
    pub sky_factor: f32,
}

impl Sources {
    /// Finds the sources of a scene that already contains the settings' suns. `document` is the
    /// glTF's JSON; `sky` says whether the settings have a sky.
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
            sources.push((Source { kind, name, node }, Target::Light(i)));
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
            sources.push((source, Target::Material(i)));
        }
        if sky || scene.environment.is_some() {
            let source = Source {
                kind: SourceKind::Sky,
                name: "sky".into(),
                node: None,
            };
            sources.push((source, Target::Sky));
        }
        Sources { sources }
    }

    /// The sources, for reports.
    pub(crate) fn list(&self) -> Vec<Source> {
        self.sources.iter().map(|(s, _)| s.clone()).collect()
    }

    /// Indices of the sources that a pattern of `option` matches.
    ///
    /// # Errors
    /// [`Error::Setting`] with the existing names, if there is no match.
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
                "{option}: no light source is named {pattern:?}; {}",
                self.names()
            )));
        }
        Ok(found)
    }

    /// All names in alphabetical order, at most [`LISTED`], as the end of a sentence.
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

    /// Name of a source in the report: its node's name if the source's own is not unique.
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

    /// Scales the scene's sources by the settings, removes those that are switched off, and sorts
    /// the rest into groups.
    ///
    /// Groups may contain sources that are switched off.
    ///
    /// # Errors
    /// [`Error::Setting`] if a pattern matches nothing, a source is in two groups, or a light
    /// becomes too bright for `f32`.
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
                    "{:?} is {x} and overflows 32-bit floats when multiplied by {factor}",
                    source.name
                )))
            };
            match *place {
                Target::Light(i) => {
                    scene.lights[i].intensity = dimmed(scene.lights[i].intensity)?;
                    keep[i] = factor > 0.0;
                }
                Target::Material(i) => {
                    let boost = settings.not_physical.emissive_boost;
                    let boosted = scene.materials[i].emissive * boost;
                    scene.materials[i].emissive = dimmed(boosted)?;
                }
                Target::Sky => {
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
        // Indices into `scene.lights` are valid until here.
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

    /// Factor of each source: the last match in `lights`, or 1.
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

    /// Index of the group of each source, if any.
    fn owners(&self, groups: &[LightGroup]) -> Result<Vec<Option<usize>>, Error> {
        let mut owners = vec![None; self.sources.len()];
        for (g, group) in groups.iter().enumerate() {
            for pattern in &group.sources {
                for i in self.matching(&format!("--group {}", group.name), pattern)? {
                    match owners[i] {
                        Some(other) if other != g => {
                            let other: &LightGroup = &groups[other];
                            return Err(Error::Setting(format!(
                                "{:?} is in the groups {} and {}, expected it in only one",
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

    /// The groups of the remaining sources; indices are those before any light is removed.
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
            // `check` ensures that it fits.
            let g = g as u8;
            match *place {
                Target::Light(i) => groups.lights[i] = g,
                Target::Material(i) => groups.materials[i] = g,
                Target::Sky => groups.sky = g,
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

/// Emissive materials that the scene uses, ascending.
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

/// Checks factors and names of groups, which needs no scene.
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
    // One index is reserved for the group `rest`.
    if groups.len() >= MAX_GROUPS {
        return Err(Error::Setting(format!(
            "found {} groups, expected at most {}",
            groups.len(),
            MAX_GROUPS - 1
        )));
    }
    for (i, g) in groups.iter().enumerate() {
        check_name(&g.name)?;
        // Windows and macOS would treat such file names as the same.
        let twin = |h: &&LightGroup| h.name.eq_ignore_ascii_case(&g.name);
        if let Some(h) = groups[..i].iter().find(twin) {
            return Err(Error::Setting(format!(
                "found the groups {} and {}, expected names that do not differ only in case",
                h.name, g.name
            )));
        }
        if g.sources.is_empty() {
            return Err(Error::Setting(format!(
                "the group {} names no light sources, expected at least one",
                g.name
            )));
        }
    }
    Ok(())
}

/// A group's name becomes part of file names, next to page numbers.
fn check_name(name: &str) -> Result<(), Error> {
    let sane = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    let expected = if name.is_empty() || name.len() > MAX_GROUP_NAME || !name.chars().all(sane) {
        format!("1 to {MAX_GROUP_NAME} of the characters A-Z a-z 0-9 . _ -")
    } else if name.starts_with('.') || name.ends_with('.') {
        "no dot at either end".into()
    } else if name.chars().all(|c| c.is_ascii_digit()) {
        "not only digits, because those number the lightmap's pages".into()
    } else if name.eq_ignore_ascii_case(REST) {
        "another name: it is reserved for sources in no group".into()
    } else {
        return Ok(());
    };
    Err(Error::Setting(format!(
        "the name of a group is {name:?}, expected {expected}"
    )))
}

#[cfg(test)]
mod tests;
