//! Tone mapping.

use glam::Vec3;

use crate::exposure::{KEY, Luminances};

/// Scale and compression of radiance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Exposure {
    /// Factor on radiance.
    scale: f32,
    /// Scaled radiance that maps to white.
    white: f32,
}

impl Exposure {
    /// Measures the luminances of a picture: the log-average of the middle 90 % becomes middle
    /// grey, the 99th percentile white.
    pub fn measure(colors: impl Iterator<Item = Vec3>) -> Exposure {
        let Some(y) = Luminances::of(colors) else {
            return Exposure {
                scale: 1.0,
                white: 1.0,
            };
        };
        let scale = KEY as f32 / (y.typical() as f32).max(f32::MIN_POSITIVE);
        Exposure {
            scale,
            white: (y.at(0.99) * scale).clamp(0.3, 16.0),
        }
    }

    /// sRGB-encoded colour in 0..=1: Reinhard's curve with a white point, per channel so that
    /// highlights desaturate.
    pub fn display(&self, color: Vec3) -> Vec3 {
        let x = color.max(Vec3::ZERO) * self.scale;
        if !x.is_finite() {
            return Vec3::ONE;
        }
        let y = x * (Vec3::ONE + x / (self.white * self.white)) / (Vec3::ONE + x);
        Vec3::from(y.to_array().map(encode))
    }
}

/// Linear light to sRGB (IEC 61966-2-1).
fn encode(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    if x <= 0.003_130_8 {
        12.92 * x
    } else {
        1.055 * x.powf(1.0 / 2.4) - 0.055
    }
}

/// 0..=1 to bytes.
pub(super) fn to_bytes(c: Vec3) -> [u8; 3] {
    c.to_array()
        .map(|x| (x.clamp(0.0, 1.0) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_does_not_depend_on_units() {
        let scene = |unit: f32| (1..=1000).map(move |i| Vec3::splat(i as f32 * unit));
        let (a, b) = (
            Exposure::measure(scene(1e-6)),
            Exposure::measure(scene(1e4)),
        );
        for i in [1.0, 100.0, 1000.0] {
            let [x, y] = [
                a.display(Vec3::splat(i * 1e-6)),
                b.display(Vec3::splat(i * 1e4)),
            ];
            assert!((x - y).abs().max_element() < 1e-4, "{x} {y}");
        }
        assert!(a.display(Vec3::splat(1e-3)).x > 0.99);
    }

    #[test]
    fn darkness_and_nonsense_are_shown() {
        let e = Exposure::measure([Vec3::ZERO, Vec3::NAN].into_iter());
        assert_eq!(
            (e.display(Vec3::ZERO), e.display(Vec3::INFINITY)),
            (Vec3::ZERO, Vec3::ONE)
        );
        assert_eq!(to_bytes(Vec3::new(-1.0, 0.5, 2.0)), [0, 128, 255]);
    }
}
