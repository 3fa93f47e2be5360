//! Effective properties of materials: images that light needs, materials that are opaque in effect,
//! and reflectances above the limit.

use std::collections::BTreeSet;

use glam::Vec3;
use rayon::prelude::*;

use crate::report::IngestReport;
use crate::scene::{AlphaMode, Image, Material, Scene};

/// Images that affect the light of a material in use.
pub(crate) fn needed_images(materials: &[Material], used: &BTreeSet<usize>) -> BTreeSet<usize> {
    let mut needed = BTreeSet::new();
    for &i in used {
        let m = &materials[i];
        // Without reflectance and transmission the base texture does not matter.
        let black = m.base_color.truncate() == Vec3::ZERO || m.max_reflectance == 0.0;
        let dark = black && m.base_color.truncate() * m.transmission == Vec3::ZERO;
        let absorbs = dark || (m.occluder_only && m.transmission == 0.0);
        let base = m.base_texture.as_ref();
        needed.extend(
            base.filter(|_| !(absorbs && m.alpha == AlphaMode::Opaque))
                .map(|t| t.image),
        );
        needed.extend(m.emissive_texture.as_ref().map(|t| t.image));
        needed.extend(m.transmission_texture.as_ref().map(|t| t.image));
    }
    needed
}

/// Lowest alpha and highest colour of `COLOR_0` on each material, 1 without `COLOR_0`.
struct VertexColors {
    least_alpha: Vec<f32>,
    most: Vec<Vec3>,
}

impl VertexColors {
    fn of(scene: &Scene) -> VertexColors {
        let mut least_alpha = vec![1.0f32; scene.materials.len()];
        let mut most = vec![Vec3::ZERO; scene.materials.len()];
        for primitive in scene.meshes.iter().flat_map(|mesh| &mesh.primitives) {
            let (least, most) = (
                &mut least_alpha[primitive.material],
                &mut most[primitive.material],
            );
            if primitive.colors.is_empty() {
                *most = Vec3::ONE;
            }
            for color in &primitive.colors {
                *least = least.min(color.w);
                *most = most.max(color.truncate());
            }
        }
        VertexColors { least_alpha, most }
    }
}

/// Maximum of each channel over an image's texels.
fn most_texel(image: &Image) -> [u8; 4] {
    image
        .pixels
        .par_chunks(1 << 14)
        .map(|chunk| {
            chunk
                .iter()
                .fold([0u8; 4], |m, p| std::array::from_fn(|c| m[c].max(p[c])))
        })
        .reduce(|| [0; 4], |a, b| std::array::from_fn(|c| a[c].max(b[c])))
}

/// Maximum texels of images, each scanned once.
struct MostTexels<'a> {
    scene: &'a Scene,
    found: Vec<Option<[u8; 4]>>,
}

impl MostTexels<'_> {
    fn new(scene: &Scene) -> MostTexels<'_> {
        MostTexels {
            scene,
            found: vec![None; scene.images.len()],
        }
    }

    /// White if the image was not decoded, because it is sampled as white.
    fn of(&mut self, image: usize) -> [u8; 4] {
        match self.scene.images.get(image) {
            Some(Some(pixels)) => *self.found[image].get_or_insert_with(|| most_texel(pixels)),
            _ => [255; 4],
        }
    }

    /// Upper bound of a material's reflectance before its limit, per channel.
    fn reflectance(&mut self, material: &Material, vertices: Vec3) -> Vec3 {
        let texel = match &material.base_texture {
            Some(texture) => {
                let [r, g, b, _] = self.of(texture.image);
                Vec3::from_array([r, g, b].map(crate::shading::srgb_to_linear))
            }
            None => Vec3::ONE,
        };
        material.base_color.truncate() * texel * vertices
    }
}

/// Makes materials opaque that never let light through: exporters mark whole scenes `BLEND`, and
/// every ray would have to check.
///
/// This concerns `MASK` and `BLEND` by alpha, and transmission if its texture or the base colour,
/// which tints transmitted light, is black.
pub(crate) fn settle_alpha(scene: &mut Scene, used: &BTreeSet<usize>, report: &mut IngestReport) {
    let colors = VertexColors::of(scene);
    let mut texels = MostTexels::new(scene);
    let settled: Vec<(usize, AlphaMode, bool)> = used
        .iter()
        .map(|&i| (i, &scene.materials[i]))
        .filter(|(_, m)| m.lets_light_through())
        .map(|(i, m)| {
            let dark_glass = m.transmission > 0.0
                && (m.transmission_texture.as_ref()).is_some_and(|t| texels.of(t.image)[0] == 0);
            let glass = m.transmission > 0.0
                && !dark_glass
                && texels.reflectance(m, colors.most[i]) != Vec3::ZERO;
            (i, alpha_in_effect(scene, m, colors.least_alpha[i]), glass)
        })
        .collect();
    for (i, alpha, glass) in settled {
        let material = &mut scene.materials[i];
        material.alpha = alpha;
        if !glass {
            material.transmission = 0.0;
            material.transmission_texture = None;
        }
        if !material.lets_light_through() {
            report.count("materials.opaque_in_effect", 1);
        }
    }
}

/// `material`'s alpha mode, or opaque if none of its alpha values lets light through.
fn alpha_in_effect(scene: &Scene, material: &Material, least_color: f32) -> AlphaMode {
    let needed = match material.alpha {
        AlphaMode::Opaque => return AlphaMode::Opaque,
        AlphaMode::Mask { cutoff } => cutoff,
        AlphaMode::Blend => 1.0,
    };
    // Filtering and interpolation stay above the minimum, but sampling rounds, so the minimum must
    // clear a mask's cutoff by this much.
    const ROUNDING: f32 = 1e-5;
    let untextured = material.base_color.w * least_color;
    if untextured < needed {
        return material.alpha;
    }
    let texture = material.base_texture.as_ref();
    let least_texel = texture
        .and_then(|t| scene.images[t.image].as_ref())
        .map_or(255, |image| {
            image.pixels.iter().map(|p| p[3]).min().unwrap_or(255)
        });
    let alpha = untextured * f32::from(least_texel) / 255.0;
    if alpha >= 1.0 || alpha > needed + ROUNDING {
        AlphaMode::Opaque
    } else {
        material.alpha
    }
}

impl Scene {
    /// Limits reflectances to `limit` (0..=1) in every channel; a lower limit of a material's own
    /// stays.
    ///
    /// Returns the number of materials in use that the limits affect: those for which base colour
    /// factor × brightest texel × brightest `COLOR_0` exceeds the limit in a channel. This is an
    /// upper bound, because the brightest values need not coincide.
    pub fn limit_reflectance(&mut self, limit: f32) -> u64 {
        for material in &mut self.materials {
            material.max_reflectance = material.max_reflectance.min(limit);
        }
        let worn = self.worn();
        let colors = VertexColors::of(self);
        let mut texels = MostTexels::new(self);
        let mut touched = 0;
        for (i, m) in self.materials.iter().enumerate() {
            if !worn[i] || m.occluder_only {
                continue;
            }
            let vertices = colors.most[i];
            // Most materials are decided without scanning their texture.
            let untextured = m.base_color.truncate() * vertices;
            touched += u64::from(
                untextured.max_element() > m.max_reflectance
                    && texels.reflectance(m, vertices).max_element() > m.max_reflectance,
            );
        }
        touched
    }
}
