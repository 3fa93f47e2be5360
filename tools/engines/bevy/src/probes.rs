//! Light of a bake on moving objects: the volume of `--probe-volume`, and reflection captures.

use bevy::gltf::GltfExtras;
use bevy::light::{EnvironmentMapLight, IrradianceVolume, LightProbe, ParallaxCorrection};
use bevy::prelude::*;
use bevy::render::renderer::RenderDevice;
use bevy::render::settings::WgpuFeatures;
use serde::Deserialize;

/// A capture acts within this many metres along each axis, less with distance. Where captures
/// overlap, Bevy blends them.
pub const REFLECTION_RANGE: f32 = 10.0;

/// `extras.lightmapReflection` of a node.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Reflection {
    uri: String,
}

/// `level.probes.json`, as far as it is needed.
#[derive(Deserialize)]
struct Probes {
    volume: Volume,
}

#[derive(Deserialize)]
struct Volume {
    center: [f32; 3],
    size: [f32; 3],
}

/// A light probe for the grid of `level.probes.json` (its text) with the texture
/// `level.probes.ktx2`. None if the bake had no `--probe-volume`.
pub fn irradiance_volume(json: &str, voxels: Handle<Image>) -> Option<impl Bundle + use<>> {
    let Volume { center, size } = serde_json::from_str::<Probes>(json).ok()?.volume;
    let volume = IrradianceVolume {
        voxels,
        // The texture holds R = E/π, as lightmaps do.
        intensity: 1.0,
        affects_lightmapped_meshes: false,
    };
    let place = Transform::from_translation(center.into()).with_scale(size.into());
    Some((place, volume))
}

/// Whether Bevy can show reflection captures on this device, which needs arrays of textures.
/// Without them Bevy shows such light probes only at the camera, and its shader for that (0.20.1)
/// does not compile for lightmapped meshes.
pub fn can_reflect(device: &RenderDevice) -> bool {
    let features = WgpuFeatures::TEXTURE_BINDING_ARRAY
        | WgpuFeatures::SAMPLED_TEXTURE_AND_STORAGE_BUFFER_ARRAY_NON_UNIFORM_INDEXING;
    let limits = device.limits();
    // As `binding_arrays_are_usable` of bevy_pbr: 16 for a material, 8 for probes.
    device.features().contains(features)
        && limits.max_binding_array_elements_per_shader_stage >= 24
        && limits.max_binding_array_sampler_elements_per_shader_stage >= 24
}

/// Gives each capture of a level a light probe. Captures have the world's axes, even if their node
/// is turned.
pub(crate) fn capture(
    mut commands: Commands,
    assets: Res<AssetServer>,
    device: Option<Res<RenderDevice>>,
    mut images: ResMut<Assets<Image>>,
    nodes: Query<(Entity, &GltfExtras, &GlobalTransform), Added<GltfExtras>>,
    files: Query<&WorldAssetRoot>,
    parents: Query<&ChildOf>,
) {
    if !device.is_some_and(|device| can_reflect(&device)) {
        return;
    }
    for (node, text, place) in &nodes {
        let Some(reflection) = super::extras(&text.value).lightmap_reflection else {
            continue;
        };
        let level = parents.iter_ancestors(node).find_map(|e| files.get(e).ok());
        let Some(file) = level.and_then(|level| level.0.path()) else {
            continue;
        };
        let (scale, rotation, _) = place.to_scale_rotation_translation();
        commands.spawn((
            ChildOf(node),
            Transform::from_rotation(rotation.inverse()).with_scale(2.0 * REFLECTION_RANGE / scale),
            LightProbe { falloff: Vec3::ONE },
            // The walls' distance is not known.
            ParallaxCorrection::None,
            EnvironmentMapLight {
                specular_map: assets.load(super::beside(file, &reflection.uri)),
                // Diffuse light comes from lightmaps and the volume.
                ..EnvironmentMapLight::solid_color(&mut images, Color::BLACK).with_intensity(1.0)
            },
        ));
    }
}
