//! Lamps whose direct light the engine adds (`--mode indirect` and `--mode shadowmask`).

use atlas_bake::{ManifestLamp, MixedLight, NodelessSun};
use mesh_ingest::{LampMode, Light, LightKind, Scene};
use radiosity::{DirectLight, Emitters, LampRoles, MASKS, Solution, World, lamps_that_reach};
use serde_json::Value;
use wildmatch::WildMatch;

use crate::error::Error;
use crate::named::some_of;
use crate::page_groups;
use crate::settings::{BakeMode, Settings};

/// The mode of each light of `scene`, from options and extras. Options take precedence.
///
/// # Errors
/// [`Error::Setting`] if a pattern matches no lamp, or both options match the same lamp.
pub(crate) fn modes(
    scene: &Scene,
    document: &Value,
    settings: &Settings,
) -> Result<Vec<LampMode>, Error> {
    let node_name = |light: &Light| {
        let node = light
            .node
            .and_then(|n| document["nodes"][n]["name"].as_str());
        node.unwrap_or_default().to_string()
    };
    let matches = |option: &str, patterns: &[String]| -> Result<Vec<bool>, Error> {
        let mut found = vec![false; scene.lights.len()];
        for pattern in patterns {
            let wild = WildMatch::new(pattern);
            let mut any = false;
            for (light, found) in scene.lights.iter().zip(&mut found) {
                let fits = wild.matches(&light.name) || wild.matches(&node_name(light));
                any |= fits;
                *found |= fits;
            }
            if !any {
                let names = scene.lights.iter().map(|l| l.name.as_str());
                return Err(Error::Setting(format!(
                    "{option}: no lamp is named {pattern:?}; there are {}",
                    page_groups::list(names)
                )));
            }
        }
        Ok(found)
    };
    let mixed = matches("--mixed", &settings.mixed)?;
    let realtime = matches("--realtime", &settings.realtime)?;
    if let Some(k) = (0..mixed.len()).find(|&k| mixed[k] && realtime[k]) {
        return Err(Error::Setting(format!(
            "{:?} matches --mixed and --realtime, expected only one of the two",
            scene.lights[k].name
        )));
    }
    let by_extras = |light: &Light| {
        let mode = light.node.and_then(|n| scene.lamp_modes.get(&n));
        mode.copied().unwrap_or_default()
    };
    let mode = |(k, light): (usize, &Light)| match (mixed[k], realtime[k]) {
        (true, _) => LampMode::Mixed,
        (_, true) => LampMode::Realtime,
        _ => by_extras(light),
    };
    Ok(scene.lights.iter().enumerate().map(mode).collect())
}

/// Lamps that are left out of the lightmap, and their entries in the manifest.
pub(crate) struct Mixed {
    pub roles: LampRoles,
    pub light: MixedLight,
    pub warnings: Vec<String>,
}

/// Decides which lamps are left out; `None` for a full bake.
pub(crate) fn settle(
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    modes: &[LampMode],
    settings: &Settings,
) -> Option<Mixed> {
    let mode = match settings.mode {
        BakeMode::Full => return None,
        BakeMode::Indirect => "indirect",
        BakeMode::Shadowmask => "shadowmask",
    };
    let scene = world.scene;
    let mut warnings = Vec::new();
    let mut roles = LampRoles {
        left_out: modes.iter().map(|m| *m != LampMode::Baked).collect(),
        channels: vec![None; modes.len()],
        masks: Vec::new(),
    };
    if !roles.left_out.contains(&true) {
        warnings.push(format!(
            "--mode {mode}, but no lamp is mixed or realtime, so all light is in the lightmap: name lamps with --mixed, or set extras.lumel.mode"
        ));
    }
    if settings.mode == BakeMode::Shadowmask {
        let mixed: Vec<usize> = (0..modes.len())
            .filter(|&k| modes[k] == LampMode::Mixed)
            .collect();
        let direct = DirectLight::new(world, emitters);
        let reached = lamps_that_reach(world, &direct, solution, &mixed);
        let refused = roles.assign_channels(&mixed, &reached);
        roles.masks.resize(scene.instances.len(), [None; MASKS]);
        if !refused.is_empty() {
            let names = refused
                .iter()
                .map(|&k| format!("{:?}", scene.lights[k].name));
            warnings.push(format!(
                "a shadow mask has {MASKS} channels, and more mixed lamps reach one node: {} stay in the lightmap entirely; mark fewer lamps as mixed, give lamps a range, or split the node",
                some_of(names)
            ));
        }
    }
    let light = describe(scene, modes, &roles, mode);
    Some(Mixed {
        roles,
        light,
        warnings,
    })
}

/// The manifest's entries; file names are added when files are made.
fn describe(
    scene: &Scene,
    modes: &[LampMode],
    roles: &LampRoles,
    mode: &'static str,
) -> MixedLight {
    let mut out = MixedLight {
        mode,
        ..MixedLight::default()
    };
    let mut number = vec![None; modes.len()];
    for (k, light) in scene.lights.iter().enumerate() {
        if !roles.leaves_out(k) {
            continue;
        }
        number[k] = Some(out.lamps.len());
        let sun = match (light.node, light.kind) {
            (None, LightKind::Directional { direction, .. }) => Some(NodelessSun {
                direction: direction.to_array(),
                lux: light.intensity.to_array(),
            }),
            _ => None,
        };
        out.lamps.push(ManifestLamp {
            name: light.name.clone(),
            node: light.node,
            mode: match modes[k] {
                LampMode::Realtime => "realtime",
                LampMode::Mixed | LampMode::Baked => "mixed",
            },
            channel: roles.channels[k],
            sun,
        });
    }
    let index = |lamp: Option<u32>| lamp.and_then(|k| number[k as usize]);
    out.of_instance = roles.masks.iter().map(|lamps| lamps.map(index)).collect();
    out
}
