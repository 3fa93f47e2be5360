//! Emissive textures whose mean radiance is known.

use glam::{DVec3, Vec2, Vec3};
use image::{Rgba, RgbaImage};

use crate::geometry::grid;
use crate::gltf::{GltfBuilder, Material, Node};

/// The emissive pattern on the panel of [`textured_panel`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GlowPattern {
    /// One texel of every 4 × 4 is white (1), the others are sRGB 64 (0.05127). Filtered; 0.110565
    /// on average, and even.
    Dots,
    /// A white square of 4 × 4 texels in the middle on black: 1/64 of the panel. Not filtered.
    Sign,
}

impl GlowPattern {
    /// Mean of the texture, linear: [`Self::Dots`] (1 + 15 c)/16 with c = ((64/255 +
    /// 0.055)/1.055)^2.4 (IEC 61966-2-1), [`Self::Sign`] 1/64.
    pub fn mean(self) -> f64 {
        match self {
            GlowPattern::Dots => {
                (1.0 + 15.0 * ((64.0 / 255.0 + 0.055) / 1.055f64).powf(2.4)) / 16.0
            }
            GlowPattern::Sign => 1.0 / 64.0,
        }
    }
}

/// A square `panel` of `side` metres that faces up at y = 0, with a texture of 32 × 32 texels whose
/// white has `radiance`, and a black `plate` of 1 m that faces down from `height` above its middle.
/// A black floor of 20 m is below.
///
/// At a point of the plate, E = π F × mean radiance if the pattern is even or far away:
/// [`super::polygon_irradiance`] of the panel with the radiance times [`GlowPattern::mean`]. For
/// the sign it is exactly that of its own square, [`sign_corners`].
pub fn textured_panel(pattern: GlowPattern, radiance: f32, side: f32, height: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let picture = RgbaImage::from_fn(32, 32, |x, y| {
        let v = match pattern {
            GlowPattern::Dots if x % 4 == 0 && y % 4 == 0 => 255,
            GlowPattern::Dots => 64,
            GlowPattern::Sign if (14..18).contains(&x) && (14..18).contains(&y) => 255,
            GlowPattern::Sign => 0,
        };
        Rgba([v, v, v, 255])
    });
    let texture = b.texture("glow", &picture, pattern == GlowPattern::Sign);
    let lamp = b.material(&Material {
        emission_texture: Some(texture),
        ..Material::emitter("lamp", [radiance; 3], [0.0; 3])
    });
    let square = |size: f32, y: f32, up: bool| {
        let h = size / 2.0;
        let along = if up { -Vec3::Z } else { Vec3::Z };
        let corner = Vec3::new(-h, y, if up { h } else { -h });
        grid(corner, Vec3::X * size, along * size, [1, 1])
    };
    let mut panel = square(side, 0.0, true);
    panel.uv = (panel.positions.iter())
        .map(|p| Vec2::new(p.x, p.z) / side + 0.5)
        .collect();
    for (name, g, m) in [
        ("panel", panel, lamp),
        ("plate", square(1.0, height, false).bare(), black),
        ("floor", square(20.0, -1.0, true).bare(), black),
    ] {
        let mesh = b.mesh(name, &[(&g, m)]);
        b.node(Node::of_mesh(name, mesh));
    }
    b.finish()
}

/// Corners of the white square of [`GlowPattern::Sign`] on a panel of `side` metres.
pub fn sign_corners(side: f64) -> [DVec3; 4] {
    super::square(side / 8.0, 0.0)
}
