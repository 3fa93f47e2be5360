//! Lamps whose direct light the engine adds: what the manifest and the glTF say about them.

use radiosity::MASKS;
use serde::Serialize;
use serde_json::{Value, json};

/// Name of the node extra of a lamp whose direct light is not in the lightmap.
pub const LAMP_EXTRA: &str = "lightmapLamp";

/// Lamps whose direct light is left out of the lightmap, and their shadow masks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MixedLight {
    /// `indirect` or `shadowmask`.
    pub mode: &'static str,
    /// The lamps.
    pub lamps: Vec<ManifestLamp>,
    /// By instance of the scene: the lamp of each channel of its mask, as an index into `lamps`.
    /// Empty without masks.
    pub of_instance: Vec<[Option<usize>; MASKS]>,
    /// File name of each page's mask; empty without masks.
    pub masks: Vec<String>,
    /// The same as KTX2 (RGBA, 8 bits), if written.
    pub ktx2: Vec<String>,
}

/// A lamp whose direct light is left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ManifestLamp {
    /// Its name.
    pub name: String,
    /// Index of the glTF node; null for a sun of the command line.
    pub node: Option<usize>,
    /// `mixed` or `realtime`.
    pub mode: &'static str,
    /// Channel of the shadow mask, 0 to 3 for R, G, B, A; absent if it has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<u8>,
    /// The sun, if no node describes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun: Option<NodelessSun>,
}

/// A sun that is not in the glTF.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NodelessSun {
    /// Direction in which its light travels, unit.
    pub direction: [f32; 3],
    /// Illuminance on a surface that faces it, R, G, B.
    pub lux: [f32; 3],
}

impl MixedLight {
    /// The mask of an instance on `page`, for the extras of its node: file names, and the lamp of
    /// each channel as an index into `lamps` (null: none).
    pub(crate) fn mask_json(&self, instance: usize, page: usize) -> Option<Value> {
        let uri = self.masks.get(page)?;
        let lamps = self.of_instance.get(instance)?;
        let mut mask = json!({"uri": uri, "lamps": lamps});
        if let Some(uri) = self.ktx2.get(page) {
            mask["ktx2"] = json!({"uri": uri, "format": "rgba8"});
        }
        Some(mask)
    }

    /// The extra of each lamp's node.
    pub(crate) fn node_extras(&self) -> impl Iterator<Item = (usize, Value)> {
        self.lamps.iter().enumerate().filter_map(|(id, lamp)| {
            let mut extra = json!({"id": id, "mode": lamp.mode});
            if let Some(channel) = lamp.channel {
                extra["channel"] = channel.into();
            }
            Some((lamp.node?, extra))
        })
    }

    /// Lamps that the instance's mask records, as indices into `lamps`, by channel.
    pub(crate) fn lamps_of(&self, instance: usize) -> Vec<usize> {
        let lamps = self.of_instance.get(instance).into_iter().flatten();
        lamps.flatten().copied().collect()
    }
}
