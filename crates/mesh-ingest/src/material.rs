//! Materials, textures and samplers.

use glam::{Affine2, Mat2, Vec2, Vec3, Vec4};

use crate::document::Document;
use crate::error::{Fault, Outcome};
use crate::extras::SurfaceExtras;
use crate::json::Item;
use crate::report::IngestReport;
use crate::scene::{AlphaMode, Material, TextureRef, Wrap};

/// A material and its image requirements.
#[derive(Debug)]
pub(crate) struct MaterialRead {
    pub material: Material,
    /// Faults of textures that light needs; reported only if a primitive uses the material.
    pub faults: Vec<Fault>,
    /// Whether its primitives are left out (`extras.lumel.exclude`).
    pub excluded: bool,
}

/// Reads material `index`; `all` are the extras of the scene and the root.
pub(crate) fn read(
    document: &Document,
    index: usize,
    all: SurfaceExtras,
    report: &mut IngestReport,
) -> Outcome<MaterialRead> {
    let item = document.root().element("materials", index)?;
    let mut faults = Vec::new();
    // Specular-glossiness, if present, replaces metallic-roughness; both have a diffuse colour.
    let (colors, factor, texture) = match item.extension("KHR_materials_pbrSpecularGlossiness")? {
        Some(ext) => (Some(ext), "diffuseFactor", "diffuseTexture"),
        None => (
            item.opt_object("pbrMetallicRoughness")?,
            "baseColorFactor",
            "baseColorTexture",
        ),
    };
    let mut base_color = Vec4::ONE;
    let mut base_texture = None;
    if let Some(colors) = colors {
        if let Some(c) = colors.opt_numbers::<4>(factor)? {
            let c = Vec4::from_array(c.map(|x| x as f32));
            base_color = c.clamp(Vec4::ZERO, Vec4::ONE);
            if base_color != c {
                report.count("materials.reflectance_clamped", 1);
                report.warn(colors.path_of(factor), format!("{c} is clamped to 0..=1"));
            }
        }
        if let Some(texture) = colors.opt_object(texture)? {
            base_texture = read_texture(document, &texture, report, &mut faults)?;
        }
    }
    let extras = SurfaceExtras::read(&item, report).or(all);
    let (emissive, emissive_texture) =
        read_emission(document, &item, &extras, report, &mut faults)?;
    let alpha = match item.opt_str("alphaMode")? {
        None | Some("OPAQUE") => AlphaMode::Opaque,
        Some("MASK") => AlphaMode::Mask {
            cutoff: item.opt_number("alphaCutoff")?.unwrap_or(0.5) as f32,
        },
        Some("BLEND") => AlphaMode::Blend,
        Some(other) => {
            return Err(Fault::invalid(
                item.path_of("alphaMode"),
                format!("\"{other}\""),
                "OPAQUE, MASK or BLEND",
            ));
        }
    };
    let double_sided = item.opt_bool("doubleSided")?.unwrap_or(false);
    let (transmission, transmission_texture) =
        read_transmission(document, &item, report, &mut faults)?;
    let material = Material {
        name: item.name(),
        gltf_material: Some(index),
        base_color,
        base_texture,
        emissive,
        emissive_texture,
        alpha,
        double_sided,
        transmission,
        transmission_texture,
        ..Material::default()
    };
    Ok(MaterialRead::new(material, faults, &extras))
}

/// The glTF default material with the extras of the scene and the root.
pub(crate) fn read_default(all: &SurfaceExtras) -> MaterialRead {
    MaterialRead::new(Material::default(), Vec::new(), all)
}

impl MaterialRead {
    fn new(material: Material, faults: Vec<Fault>, extras: &SurfaceExtras) -> MaterialRead {
        MaterialRead {
            material: Material {
                max_reflectance: extras.max_reflectance.unwrap_or(1.0),
                occluder_only: extras.occluder == Some(true),
                ..material
            },
            faults,
            excluded: extras.exclude == Some(true),
        }
    }
}

/// `KHR_materials_transmission`: the fraction of light that passes straight through, and its
/// texture, which is read only if the fraction is not zero.
fn read_transmission(
    document: &Document,
    item: &Item<'_>,
    report: &mut IngestReport,
    faults: &mut Vec<Fault>,
) -> Outcome<(f32, Option<TextureRef>)> {
    let Some(ext) = item.extension("KHR_materials_transmission")? else {
        return Ok((0.0, None));
    };
    let asked = ext.opt_number("transmissionFactor")?.unwrap_or(0.0);
    let given = asked.clamp(0.0, 1.0);
    if given != asked {
        report.count("materials.transmission_clamped", 1);
        report.warn(
            ext.path_of("transmissionFactor"),
            format!("{asked} is clamped to 0..=1"),
        );
    }
    let texture = match ext.opt_object("transmissionTexture")? {
        Some(texture) if given > 0.0 => read_texture(document, &texture, report, faults)?,
        _ => None,
    };
    Ok((given as f32, texture))
}

/// The radiance `emissiveFactor × emissiveStrength × emitScale` and its texture, which is read only
/// if the radiance is not zero.
fn read_emission(
    document: &Document,
    item: &Item<'_>,
    extras: &SurfaceExtras,
    report: &mut IngestReport,
    faults: &mut Vec<Fault>,
) -> Outcome<(Vec3, Option<TextureRef>)> {
    let factor = item.opt_numbers::<3>("emissiveFactor")?.unwrap_or_default();
    let strength = match item.extension("KHR_materials_emissive_strength")? {
        Some(ext) => ext.opt_number("emissiveStrength")?.unwrap_or(1.0),
        None => 1.0,
    };
    let scale = match extras.occluder {
        Some(true) => 0.0,
        _ => extras.emit_scale.unwrap_or(1.0),
    };
    let strength = strength * scale;
    let asked = factor.map(|f| f * strength);
    let given = asked.map(|x| x.clamp(0.0, f64::from(f32::MAX)));
    if given != asked {
        report.count("materials.emission_clamped", 1);
        report.warn(
            item.path_of("emissiveFactor"),
            format!("{factor:?} × {strength} is clamped to a radiance ≥ 0"),
        );
    }
    let emissive = Vec3::from_array(given.map(|x| x as f32));
    let texture = match item.opt_object("emissiveTexture")? {
        Some(texture) if emissive != Vec3::ZERO => {
            read_texture(document, &texture, report, faults)?
        }
        _ => None,
    };
    Ok((emissive, texture))
}

/// Reads a `textureInfo`; `None` if it leads to no image.
fn read_texture(
    document: &Document,
    info: &Item<'_>,
    report: &mut IngestReport,
    faults: &mut Vec<Fault>,
) -> Outcome<Option<TextureRef>> {
    let root = document.root();
    let index = info
        .opt_index("index", "textures", root.len_of("textures")?)?
        .ok_or_else(|| {
            Fault::invalid(info.path_of("index"), "nothing", "an index into textures")
        })?;
    let texture = root.element("textures", index)?;
    let Some(image) = choose_image(document, &texture, report, faults)? else {
        return Ok(None);
    };
    let mut tex_coord = info.opt_uint("texCoord")?.unwrap_or(0);
    let mut transform = Affine2::IDENTITY;
    if let Some(ext) = info.extension("KHR_texture_transform")? {
        tex_coord = ext.opt_uint("texCoord")?.unwrap_or(tex_coord);
        let [ox, oy] = ext.opt_numbers::<2>("offset")?.unwrap_or([0.0, 0.0]);
        let [sx, sy] = ext.opt_numbers::<2>("scale")?.unwrap_or([1.0, 1.0]);
        let (sin, cos) = libm::sincos(ext.opt_number("rotation")?.unwrap_or(0.0));
        // Translation × rotation × scale as in the extension: v points down, so positive angles
        // rotate clockwise in (u, v).
        let linear = [cos * sx, -sin * sx, sin * sy, cos * sy].map(|x| x as f32);
        transform = Affine2::from_mat2_translation(
            Mat2::from_cols_array(&linear),
            Vec2::new(ox as f32, oy as f32),
        );
    }
    let (mut wrap, mut nearest) = ([Wrap::Repeat; 2], false);
    if let Some(s) = texture.opt_index("sampler", "samplers", root.len_of("samplers")?)? {
        let sampler = root.element("samplers", s)?;
        for (slot, key) in wrap.iter_mut().zip(["wrapS", "wrapT"]) {
            *slot = match sampler.opt_uint(key)? {
                Some(33071) => Wrap::Clamp,
                Some(33648) => Wrap::Mirror,
                None | Some(10497) => Wrap::Repeat,
                Some(n) => {
                    report.warn(
                        sampler.path_of(key),
                        format!("{n} is not a wrapping mode; the texture repeats"),
                    );
                    Wrap::Repeat
                }
            };
        }
        nearest = sampler.opt_uint("magFilter")? == Some(9728);
    }
    Ok(Some(TextureRef {
        image,
        tex_coord,
        transform,
        wrap,
        nearest,
    }))
}

/// The first image of a texture, including fallbacks, that this crate can decode.
pub(crate) fn choose_image(
    document: &Document,
    texture: &Item<'_>,
    report: &mut IngestReport,
    faults: &mut Vec<Fault>,
) -> Outcome<Option<usize>> {
    let images = document.root().len_of("images")?;
    let of = |ext: &str| match texture.extension(ext)? {
        Some(ext) => ext.opt_index("source", "images", images),
        None => Ok(None),
    };
    if let Some(webp) = of("EXT_texture_webp")? {
        return Ok(Some(webp));
    }
    if let Some(source) = texture.opt_index("source", "images", images)? {
        return Ok(Some(source));
    }
    if let Some(ktx2) = of("KHR_texture_basisu")? {
        return Ok(Some(ktx2));
    }
    for (name, way_out) in [
        ("EXT_texture_avif", AVIF_WAY_OUT),
        ("MSFT_texture_dds", "a PNG, JPEG or WebP image"),
    ] {
        if let Some(image) = of(name)? {
            let path = format!("{}.extensions.{name}", texture.path);
            faults.push(Fault::unsupported(
                path,
                format!("images[{image}] without a fallback source"),
                way_out,
            ));
            return Ok(None);
        }
    }
    report.warn(&texture.path, "no image; treated as white");
    report.count("textures.no_image", 1);
    Ok(None)
}

/// Commands of @gltf-transform/cli 4.5 (npm).
pub(crate) const KTX2_WAY_OUT: &str =
    "a PNG, JPEG or WebP image; `npx @gltf-transform/cli ktxdecompress in.glb out.glb` converts it";
pub(crate) const AVIF_WAY_OUT: &str = "a PNG, JPEG or WebP image; `npx @gltf-transform/cli png --formats '*' in.glb out.glb` converts it";
