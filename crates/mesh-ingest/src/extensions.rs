//! Extensions that a document may require.

use crate::error::{Fault, Faults};
use crate::json::Item;
use crate::report::IngestReport;

/// Extensions that are supported.
const SUPPORTED: &[&str] = &[
    "EXT_lights_area",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MSFT_lod",
];

/// Extensions that affect neither the positions of surfaces nor diffuse light, or are checked where
/// they are used (image formats).
const HARMLESS: &[&str] = &[
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "EXT_texture_avif",
    "KHR_accessor_float64",
    "KHR_animation_pointer",
    "KHR_audio_emitter",
    "KHR_interactivity",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_packing_normalRoughnessMetallic",
    "MSFT_packing_occlusionRoughnessMetallic",
    "MSFT_texture_dds",
    "VRM",
    "VRMC_vrm",
];

/// Lights that Lumel does not model, if they are used but not required.
const DARK: &[&str] = &["KHR_lights_area"];

/// Records the extensions in use and refuses required ones that could affect geometry or light.
pub(crate) fn check(root: &Item<'_>, faults: &mut Faults, report: &mut IngestReport) {
    let mut used = names(root, "extensionsUsed", faults);
    used.sort();
    used.dedup();
    for name in &used {
        if DARK.contains(&name.as_str()) {
            report.warn(
                "extensionsUsed",
                format!("{name} is ignored: its light is missing from the bake"),
            );
        }
    }
    report.extensions_used = used;
    for (i, name) in names(root, "extensionsRequired", faults).iter().enumerate() {
        if SUPPORTED.contains(&name.as_str()) {
            continue;
        }
        // Material extensions describe gloss, coats and the like, which do not affect a Lambertian
        // bake.
        if HARMLESS.contains(&name.as_str()) || name.starts_with("KHR_materials_") {
            report.warn(
                "extensionsRequired",
                format!("{name} does not affect diffuse light and is passed through"),
            );
            continue;
        }
        faults.push(Fault::unsupported(
            format!("extensionsRequired[{i}]"),
            format!("\"{name}\""),
            "only extensions that Lumel supports; export without it",
        ));
    }
}

fn names(root: &Item<'_>, key: &str, faults: &mut Faults) -> Vec<String> {
    let Some(item) = root.get(key) else {
        return Vec::new();
    };
    let strings = item
        .value
        .as_array()
        .map(|a| a.iter().map(|v| v.as_str().map(String::from)).collect());
    match strings {
        Some(Some(names)) => names,
        _ => {
            faults.push(Fault::invalid(
                item.path,
                crate::json::show(item.value),
                "an array of strings",
            ));
            Vec::new()
        }
    }
}
