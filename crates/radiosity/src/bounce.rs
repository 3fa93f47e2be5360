//! Bounced light that deliberately differs from physics, because artists ask for it.

use glam::Vec3;

use crate::world::luminance;

/// Changes of the light that surfaces reflect. The default changes nothing and costs nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounce {
    /// Factor on reflectances while light bounces. They are clamped to their material's limit
    /// afterwards.
    pub albedo: f32,
    /// Saturation of reflectances while light bounces: 0 for grey of the same luminance, 1 for the
    /// surface's own colour.
    pub saturation: f32,
    /// Factor on light that was reflected at least once, applied once, where it is received.
    pub reflected: f32,
}

impl Default for Bounce {
    fn default() -> Self {
        Bounce {
            albedo: 1.0,
            saturation: 1.0,
            reflected: 1.0,
        }
    }
}

impl Bounce {
    /// Whether surfaces reflect with their own reflectance.
    pub(crate) fn keeps_reflectance(&self) -> bool {
        (self.albedo, self.saturation) == (1.0, 1.0)
    }

    /// The reflectance with which light bounces off a surface of reflectance `own`:
    /// ρ' = a (Y + s (ρ − Y)) per channel with the luminance Y of ρ, clamped to 0..=`limit`.
    pub fn reflectance(&self, own: Vec3, limit: f32) -> Vec3 {
        if self.keeps_reflectance() {
            return own;
        }
        let grey = Vec3::splat(luminance(own));
        let colour = grey + (own - grey) * self.saturation;
        (colour * self.albedo).clamp(Vec3::ZERO, Vec3::splat(limit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_formula_holds_and_the_default_changes_no_bit() {
        let own = Vec3::new(0.8, 0.3, 0.1);
        assert_eq!(Bounce::default().reflectance(own, 0.5), own);
        let grey = Bounce {
            saturation: 0.0,
            ..Bounce::default()
        };
        // 0.2126 × 0.8 + 0.7152 × 0.3 + 0.0722 × 0.1 = 0.39186; f32 rounding only.
        let found = grey.reflectance(own, 1.0);
        assert!((found - Vec3::splat(0.39186)).abs().max_element() < 1e-6);
        let bright = Bounce {
            albedo: 1.5,
            ..Bounce::default()
        };
        let found = bright.reflectance(own, 0.9);
        assert!((found - Vec3::new(0.9, 0.45, 0.15)).abs().max_element() < 1e-6);
        let vivid = Bounce {
            saturation: 3.0,
            ..Bounce::default()
        };
        let found = vivid.reflectance(own, 1.0);
        assert_eq!((found.x, found.z), (1.0, 0.0), "clamped on both ends");
    }
}
