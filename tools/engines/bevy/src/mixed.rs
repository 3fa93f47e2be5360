//! Mixed light (`lumel bake --mode`): Bevy's own lamps light baked surfaces through shadow masks.

use bevy::asset::embedded_asset;
use bevy::gltf::GltfExtras;
use bevy::material::OpaqueRendererMethod;
use bevy::pbr::{ExtendedMaterial, MaterialExtension};
use bevy::prelude::*;
use bevy::render::render_resource::AsBindGroup;
use bevy::shader::ShaderRef;
use serde::Deserialize;

/// A [`StandardMaterial`] whose mixed lamps are multiplied by a shadow mask.
pub type MaskedMaterial = ExtendedMaterial<StandardMaterial, ShadowMask>;

/// A lamp whose direct light is not in the lightmap. The plug-in gives it to the file's lamps. For
/// a sun of the command line, spawn a [`DirectionalLight`] with the manifest's `id` and mode.
#[derive(Component, Debug, Clone, PartialEq, Deserialize)]
pub struct LevelLamp {
    /// Index of the lamp in the manifest.
    pub id: u32,
    /// `mixed`: multiplied by shadow masks, unless it has shadow maps; or `realtime`.
    pub mode: String,
}

/// A mesh's shadow mask.
#[derive(Asset, AsBindGroup, TypePath, Debug, Clone)]
pub struct ShadowMask {
    /// The lamp of each channel, or -1.
    #[uniform(100)]
    pub lamps: Vec4,
    /// Offset and scale of the mesh's place on the page.
    #[uniform(100)]
    pub place: Vec4,
    /// The page's mask.
    #[texture(101)]
    #[sampler(102)]
    pub image: Handle<Image>,
}

impl MaterialExtension for ShadowMask {
    fn fragment_shader() -> ShaderRef {
        "embedded://lumel_bevy/mixed.wesl".into()
    }
}

/// A shadow mask in a node's extras.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Mask {
    pub uri: String,
    pub lamps: [Option<u32>; 4],
    pub ktx2: Option<super::Ktx2>,
}

impl Mask {
    /// The mask of a mesh at `place` (offset and scale).
    pub fn of(&self, place: Vec4, image: Handle<Image>) -> ShadowMask {
        let lamps = self.lamps.map(|lamp| lamp.map_or(-1.0, |id| id as f32));
        ShadowMask {
            lamps: Vec4::from_array(lamps),
            place,
            image,
        }
    }
}

/// `material` with a shadow mask. Deferred rendering would light it without.
pub(crate) fn masked(material: &StandardMaterial, extension: ShadowMask) -> MaskedMaterial {
    MaskedMaterial {
        base: StandardMaterial {
            opaque_render_method: OpaqueRendererMethod::Forward,
            ..material.clone()
        },
        extension,
    }
}

pub(crate) fn build(app: &mut App) {
    embedded_asset!(app, "mixed.wesl");
    app.add_plugins(MaterialPlugin::<MaskedMaterial>::default());
    let each = (
        number::<PointLight>,
        number::<SpotLight>,
        number::<DirectionalLight>,
    );
    app.add_systems(Update, each.after(super::Attach));
}

/// Marks the lamps of a level, and gives them the light of the file. They are children of their
/// nodes, which have the extras.
pub(crate) fn find(
    mut commands: Commands,
    nodes: Query<(&GltfExtras, &Children), Added<GltfExtras>>,
    mut points: Query<&mut PointLight>,
    mut spots: Query<&mut SpotLight>,
    mut suns: Query<&mut DirectionalLight>,
) {
    for (text, children) in &nodes {
        let Some(lamp) = super::extras(&text.value).lightmap_lamp else {
            continue;
        };
        for child in children {
            if let Ok(mut point) = points.get_mut(*child) {
                point.range = without_limit(point.range);
                point.color = linear(point.color);
            } else if let Ok(mut spot) = spots.get_mut(*child) {
                spot.range = without_limit(spot.range);
                spot.color = linear(spot.color);
                // Bevy 0.20.1 takes the range for the radius.
                spot.radius = 0.0;
            } else if let Ok(mut sun) = suns.get_mut(*child) {
                sun.color = linear(sun.color);
            } else {
                continue;
            }
            commands.entity(*child).insert(lamp.clone());
        }
    }
}

/// Bevy 0.20.1 reads the linear colours of a glTF's lamps as sRGB.
fn linear(color: Color) -> Color {
    let Srgba {
        red, green, blue, ..
    } = color.to_srgba();
    Color::linear_rgb(red, green, blue)
}

fn without_limit(range: f32) -> f32 {
    if range == LOADED_RANGE {
        NO_RANGE
    } else {
        range
    }
}

/// The range that Bevy gives to lamps of a glTF that have none.
const LOADED_RANGE: f32 = 20.0;
/// Within a level, lamps without a range then have the light of the inverse square.
const NO_RANGE: f32 = 1e4;

/// What the plug-in sets of any kind of lamp.
pub(crate) trait Lamp: Component<Mutability = bevy::ecs::component::Mutable> {
    /// Bevy's default of the depth bias.
    const BIAS: f32;

    /// Whether it has shadow maps; its depth bias; whether its diffuse light falls on baked
    /// surfaces.
    fn parts(&mut self) -> (bool, &mut f32, &mut bool);
}

macro_rules! lamps {
    ($($kind:ty),*) => {$(
        impl Lamp for $kind {
            const BIAS: f32 = Self::DEFAULT_SHADOW_DEPTH_BIAS;

            fn parts(&mut self) -> (bool, &mut f32, &mut bool) {
                let diffuse = &mut self.affects_lightmapped_mesh_diffuse;
                (self.shadow_maps_enabled, &mut self.shadow_depth_bias, diffuse)
            }
        }
    )*};
}

lamps!(PointLight, SpotLight, DirectionalLight);

/// Lamps light moving objects and add specular light everywhere; baked surfaces have their diffuse
/// light already.
pub(crate) fn spare<L: Lamp>(
    settings: Res<super::LumelPlugin>,
    mut lamps: Query<&mut L, Added<L>>,
) {
    for mut lamp in lamps.iter_mut().filter(|_| !settings.keep_lights) {
        *lamp.parts().2 = false;
    }
}

/// Realtime lamps light baked surfaces as all others. Of mixed lamps, the shader of masked
/// materials adds the diffuse light. It recognises them by their depth bias, -1 - id, which Bevy
/// does not use without shadow maps.
fn number<L: Lamp>(
    mut lamps: Query<(Ref<LevelLamp>, &mut L), Or<(Changed<LevelLamp>, Changed<L>)>>,
) {
    for (level, mut lamp) in &mut lamps {
        let inner = lamp.bypass_change_detection();
        let (maps, bias, diffuse) = inner.parts();
        let masked = level.mode == "mixed" && !maps;
        let wanted = if masked {
            (-1.0 - level.id as f32, false)
        } else {
            (if *bias < 0.0 { L::BIAS } else { *bias }, true)
        };
        if level.is_added() || (*bias, *diffuse) != wanted {
            (*bias, *diffuse) = wanted;
            lamp.set_changed();
        }
    }
}
