//! Lumel's lightmaps in Bevy.
//!
//! ```no_run
//! use bevy::prelude::*;
//!
//! App::new()
//!     .add_plugins((DefaultPlugins, lumel_bevy::LumelPlugin::default()))
//!     .add_systems(Startup, |mut commands: Commands, assets: Res<AssetServer>| {
//!         commands.spawn(WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset("level.glb"))));
//!     })
//!     .run();
//! ```
//!
//! What Bevy does with a texel v of a [`Lightmap`]: a surface of albedo a shows v × a ×
//! `lightmap_exposure` (of its material) × the camera's exposure. That is what a radiance in nit
//! needs, and a Lumel lightmap holds R = E/π, the radiance of a white surface: no factor. Its rows
//! run as Bevy's do: no flip.

use bevy::gltf::GltfExtras;
use bevy::light::GlobalAmbientLight;
use bevy::math::Rect;
use bevy::pbr::Lightmap;
use bevy::prelude::*;
use serde::Deserialize;

/// Gives every baked node of every glTF that is spawned its lightmap.
#[derive(Debug, Clone, Resource)]
pub struct LumelPlugin {
    /// Multiplies the light of baked surfaces only (`StandardMaterial::lightmap_exposure`). Leave
    /// it at 1 and set the camera's [`Exposure`](bevy::camera::Exposure) where lamps are
    /// photometric; see the README for levels that are not.
    pub exposure: f32,
    /// Load pages as KTX2 where the bake has them (`--ktx2`).
    pub ktx2: bool,
    /// Leave the diffuse light of the file's lamps on baked surfaces, which have it already.
    pub keep_lights: bool,
}

impl Default for LumelPlugin {
    fn default() -> Self {
        LumelPlugin {
            exposure: 1.0,
            ktx2: false,
            keep_lights: false,
        }
    }
}

impl Plugin for LumelPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.clone())
            .add_systems(Update, (attach, spare_lamps));
        // The bake has the sky's light already.
        app.insert_resource(GlobalAmbientLight {
            affects_lightmapped_meshes: false,
            ..app.world().get_resource().cloned().unwrap_or_default()
        });
    }
}

/// `extras` of a node.
#[derive(Deserialize)]
struct Extras {
    lightmap: Option<Place>,
}

/// Where a node's light is: page uv = offset + scale × TEXCOORD_1, v from the top.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Place {
    uri: String,
    offset: [f32; 2],
    scale: [f32; 2],
    ktx2: Option<Ktx2>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Ktx2 {
    uri: String,
}

/// The place in a node's extras, if there is one. Instances by `EXT_mesh_gpu_instancing`, which
/// Bevy does not read, have a list of them.
fn place(extras: &str) -> Option<Place> {
    serde_json::from_str::<Extras>(extras).ok()?.lightmap
}

/// A node's extras are on its entity; its primitives are children with meshes. Nodes below it are
/// children too, without.
fn attach(
    mut commands: Commands,
    settings: Res<LumelPlugin>,
    assets: Res<AssetServer>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    nodes: Query<(&GltfExtras, &Children), Added<GltfExtras>>,
    meshes: Query<(&Mesh3d, &MeshMaterial3d<StandardMaterial>)>,
) {
    for (extras, children) in &nodes {
        let Some(place) = place(&extras.value) else {
            continue;
        };
        let page = match place.ktx2 {
            Some(ktx2) if settings.ktx2 => ktx2.uri,
            _ => place.uri,
        };
        for child in children {
            let Ok((mesh, material)) = meshes.get(*child) else {
                continue;
            };
            // Pages lie beside the glTF. `resolve` would take a `#` in a file's name for a label.
            let Some(file) = mesh.0.path() else { continue };
            let path = file.path().with_file_name(&page);
            let path = bevy::asset::AssetPath::from_path_buf(path)
                .with_source(file.source().clone_owned());
            let [x, y] = place.offset;
            let [w, h] = place.scale;
            commands.entity(*child).insert(Lightmap {
                image: assets.load(path),
                uv_rect: Rect::new(x, y, x + w, y + h),
                bicubic_sampling: false,
            });
            if settings.exposure != 1.0
                && let Some(mut material) = materials.get_mut(&material.0)
            {
                material.lightmap_exposure = settings.exposure;
            }
        }
    }
}

/// Lamps light what moves, and the gloss of all; baked surfaces have their diffuse light.
fn spare_lamps(
    settings: Res<LumelPlugin>,
    mut points: Query<&mut PointLight, Added<PointLight>>,
    mut spots: Query<&mut SpotLight, Added<SpotLight>>,
    mut suns: Query<&mut DirectionalLight, Added<DirectionalLight>>,
) {
    if settings.keep_lights {
        return;
    }
    for mut lamp in &mut points {
        lamp.affects_lightmapped_mesh_diffuse = false;
    }
    for mut lamp in &mut spots {
        lamp.affects_lightmapped_mesh_diffuse = false;
    }
    for mut lamp in &mut suns {
        lamp.affects_lightmapped_mesh_diffuse = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_and_other_extras_are_not() {
        let text = r#"{"lightmap": {"uri": "a b #1.exr", "page": 0, "texCoord": 1, "offset": [0.5, 0], "scale": [0.25, 1],
            "scaleToIrradiance": 3.14, "ktx2": {"uri": "a.ktx2", "format": "bc6h"}}, "other": 1}"#;
        let found = place(text).unwrap();
        assert_eq!((found.offset, found.scale), ([0.5, 0.0], [0.25, 1.0]));
        assert_eq!(found.ktx2.map(|k| k.uri), Some("a.ktx2".into()));
        for other in [r#"{"lightmap": [null]}"#, r#"{"x": 1}"#, "3", ""] {
            assert_eq!(place(other), None, "{other}");
        }
    }
}
