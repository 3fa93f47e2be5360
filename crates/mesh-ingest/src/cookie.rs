//! Evaluates the pictures that lights project.

use glam::{Affine2, Vec2, Vec3, Vec4Swizzles};

use crate::scene::{Light, LightKind, PlacedCookie, Scene, TextureRef, Wrap};
use crate::shading::sample;

impl Scene {
    /// Factor per channel of `light`'s picture on its light at `point`, in recentred world space; 1
    /// without a picture.
    ///
    /// It depends on the receiving point only, as if the light came from the node's position or, a
    /// sun, from one direction: a lamp's size blurs its shadows, not its picture.
    pub fn cookie_factor(&self, light: &Light, point: Vec3) -> Vec3 {
        let Some(placed) = &light.cookie else {
            return Vec3::ONE;
        };
        let Some(image) = self.cookies.get(placed.cookie) else {
            return Vec3::ONE;
        };
        let local = placed.from_world * (point - placed.position);
        let (at, wrap) = match light.kind {
            // A lamp projects nothing behind itself.
            LightKind::Point { .. } | LightKind::Spot { .. } if local.z >= 0.0 => {
                return Vec3::ZERO;
            }
            LightKind::Point { .. } | LightKind::Spot { .. } => {
                (local.truncate() / -local.z, Wrap::Clamp)
            }
            LightKind::Directional { .. } => (local.truncate(), Wrap::Repeat),
        };
        let PlacedCookie { scale, .. } = placed;
        // Row 0 is at the top, which is +Y of the node.
        let uv = Vec2::splat(0.5) + Vec2::new(at.x, -at.y) * *scale;
        let texture = TextureRef {
            image: 0,
            tex_coord: 0,
            transform: Affine2::IDENTITY,
            wrap: [wrap; 2],
            nearest: false,
        };
        sample(image, &texture, uv).xyz()
    }
}
