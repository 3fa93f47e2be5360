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
//! Bevy shows a texel v of a [`Lightmap`] on a surface of albedo a as v × a × `lightmap_exposure`
//! (of its material) × the camera's exposure. That fits radiances in nit. A Lumel lightmap holds R
//! = E/π, the radiance of a white surface, so no factor is needed. Its rows run as Bevy's do, so no
//! flip is needed either. Cameras get the exposure that the bake suggests ([`LevelExposure`]).

mod mixed;
mod probes;

use bevy::camera::Exposure;
use bevy::gltf::GltfExtras;
use bevy::light::GlobalAmbientLight;
use bevy::math::Rect;
use bevy::pbr::Lightmap;
use bevy::prelude::*;
use serde::Deserialize;

pub use mixed::{LevelLamp, MaskedMaterial, ShadowMask};
pub use probes::{REFLECTION_RANGE, can_reflect, irradiance_volume};

/// Gives every baked node of every spawned glTF its lightmap.
#[derive(Debug, Clone, Default, Resource)]
pub struct LumelPlugin {
    /// The [`Exposure`] of cameras.
    pub exposure: LevelExposure,
    /// Load pages as KTX2 if the bake has them (`--ktx2`).
    pub ktx2: bool,
    /// Keep the diffuse light of the file's lamps on baked surfaces, whose lightmap contains it
    /// already.
    pub keep_lights: bool,
}

/// The factor by which cameras multiply all light.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum LevelExposure {
    /// The suggestion of the level that was loaded last. Bevy's own default suits lamps in candela
    /// outdoors; levels in other units would be black or white.
    #[default]
    Suggested,
    /// This factor: radiance × factor is what a screen shows, 1 being white.
    Factor(f32),
    /// Leave cameras unchanged.
    Untouched,
}

/// The suggested exposure of the level that was loaded last, as a factor.
#[derive(Debug, Clone, Copy, PartialEq, Resource)]
pub struct Suggested(pub f32);

/// A factor on radiance as Bevy's cameras express it: 2^-EV100 / 1.2.
pub fn camera_exposure(factor: f32) -> Exposure {
    Exposure {
        ev100: -(1.2 * factor).log2(),
    }
}

impl Plugin for LumelPlugin {
    fn build(&self, app: &mut App) {
        mixed::build(app);
        let spare = (
            mixed::spare::<PointLight>,
            mixed::spare::<SpotLight>,
            mixed::spare::<DirectionalLight>,
        );
        app.insert_resource(self.clone())
            .add_systems(Update, (spare, attach, mixed::find).chain().in_set(Attach))
            .add_systems(Update, expose.after(Attach))
            .add_systems(
                PostUpdate,
                probes::capture.after(TransformSystems::Propagate),
            );
        if let LevelExposure::Factor(factor) = self.exposure {
            app.insert_resource(Suggested(factor));
        }
        // The lightmap contains the sky's light already.
        app.insert_resource(GlobalAmbientLight {
            affects_lightmapped_meshes: false,
            ..app.world().get_resource().cloned().unwrap_or_default()
        });
    }
}

/// What a level's extras say is spread over its entities.
#[derive(SystemSet, Debug, Clone, PartialEq, Eq, Hash)]
struct Attach;

/// `extras` of a node.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Extras {
    lightmap: Option<Place>,
    lightmap_lamp: Option<LevelLamp>,
    lightmap_reflection: Option<probes::Reflection>,
}

/// A node's extras, as far as they are Lumel's. Instances by `EXT_mesh_gpu_instancing`, which Bevy
/// does not read, have a list of places.
fn extras(text: &str) -> Extras {
    serde_json::from_str(text).unwrap_or_default()
}

/// A node's place in the lightmap: page uv = offset + scale × TEXCOORD_1, v from the top.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Place {
    uri: String,
    offset: [f32; 2],
    scale: [f32; 2],
    exposure: Option<f32>,
    ktx2: Option<Ktx2>,
    mask: Option<mixed::Mask>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Ktx2 {
    uri: String,
}

/// The path of a file beside an asset. `resolve` would treat a `#` in a file name as a label.
fn beside(asset: &bevy::asset::AssetPath, name: &str) -> bevy::asset::AssetPath<'static> {
    bevy::asset::AssetPath::from_path_buf(asset.path().with_file_name(name))
        .with_source(asset.source().clone_owned())
}

/// A node's extras are on its entity, and its primitives are children. Child nodes are
/// children without meshes.
fn attach(
    mut commands: Commands,
    settings: Res<LumelPlugin>,
    assets: Res<AssetServer>,
    nodes: Query<(&GltfExtras, &Children), Added<GltfExtras>>,
    meshes: Query<(&Mesh3d, &MeshMaterial3d<StandardMaterial>)>,
    standard: Res<Assets<StandardMaterial>>,
    mut masked: ResMut<Assets<MaskedMaterial>>,
) {
    for (text, children) in &nodes {
        let Some(place) = extras(&text.value).lightmap else {
            continue;
        };
        if let (LevelExposure::Suggested, Some(factor)) = (settings.exposure, place.exposure) {
            commands.insert_resource(Suggested(factor));
        }
        let page = match place.ktx2 {
            Some(ktx2) if settings.ktx2 => ktx2.uri,
            _ => place.uri,
        };
        for child in children {
            let Ok((mesh, material)) = meshes.get(*child) else {
                continue;
            };
            // Pages are beside the glTF.
            let Some(file) = mesh.0.path() else { continue };
            let [x, y] = place.offset;
            let [w, h] = place.scale;
            commands.entity(*child).insert(Lightmap {
                image: assets.load(beside(file, &page)),
                uv_rect: Rect::new(x, y, x + w, y + h),
                bicubic_sampling: false,
            });
            let (Some(mask), Some(material)) = (&place.mask, standard.get(&material.0)) else {
                continue;
            };
            let uri = match &mask.ktx2 {
                Some(ktx2) if settings.ktx2 => &ktx2.uri,
                _ => &mask.uri,
            };
            let mask = mask.of(Vec4::new(x, y, w, h), assets.load(beside(file, uri)));
            commands
                .entity(*child)
                .remove::<MeshMaterial3d<StandardMaterial>>()
                .insert(MeshMaterial3d(masked.add(mixed::masked(material, mask))));
        }
    }
}

/// Sets the exposure of all cameras when it changes, and of new cameras later.
fn expose(
    settings: Res<LumelPlugin>,
    suggested: Option<Res<Suggested>>,
    mut cameras: Query<(&mut Exposure, Ref<Camera3d>)>,
) {
    let Some(suggested) = suggested.filter(|_| settings.exposure != LevelExposure::Untouched)
    else {
        return;
    };
    for (mut exposure, camera) in &mut cameras {
        if suggested.is_changed() || camera.is_added() {
            *exposure = camera_exposure(suggested.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_multiply_by_the_factor() {
        for factor in [1e-4, 0.36, 1.0, 5.0] {
            let exposed = camera_exposure(factor).exposure();
            assert!((exposed / factor - 1.0).abs() < 1e-4, "{exposed} {factor}");
        }
    }

    #[test]
    fn cameras_get_what_the_level_suggests_unless_told_otherwise() {
        for (exposure, expected) in [
            (LevelExposure::Suggested, camera_exposure(0.25).ev100),
            (LevelExposure::Factor(2.0), camera_exposure(2.0).ev100),
            (LevelExposure::Untouched, Exposure::default().ev100),
        ] {
            let mut app = App::new();
            app.insert_resource(LumelPlugin {
                exposure,
                ..default()
            });
            app.insert_resource(Suggested(match exposure {
                LevelExposure::Factor(x) => x,
                _ => 0.25,
            }));
            app.add_systems(Update, expose);
            let camera = app
                .world_mut()
                .spawn((Camera3d::default(), Exposure::default()))
                .id();
            app.update();
            let ev = |app: &App| app.world().get::<Exposure>(camera).map(|e| e.ev100);
            assert_eq!(ev(&app), Some(expected), "{exposure:?}");
            // Values that a game sets later stay.
            app.world_mut()
                .entity_mut(camera)
                .insert(Exposure { ev100: 3.0 });
            app.update();
            assert_eq!(ev(&app), Some(3.0));
        }
    }

    #[test]
    fn places_are_read_and_other_extras_are_not() {
        let text = r#"{"lightmap": {"uri": "a b #1.exr", "page": 0, "texCoord": 1, "offset": [0.5, 0], "scale": [0.25, 1],
            "scaleToIrradiance": 3.14, "exposure": 0.25, "ktx2": {"uri": "a.ktx2", "format": "bc6h"}}, "other": 1}"#;
        let found = extras(text).lightmap.unwrap();
        assert_eq!((found.offset, found.scale), ([0.5, 0.0], [0.25, 1.0]));
        assert_eq!(found.exposure, Some(0.25));
        assert_eq!(found.ktx2.map(|k| k.uri), Some("a.ktx2".into()));
        for other in [r#"{"lightmap": [null]}"#, r#"{"x": 1}"#, "3", ""] {
            assert_eq!(extras(other).lightmap, None, "{other}");
        }
    }
}
