//! Artists' controls that depart from physics, and how the report describes them.

use serde::Serialize;

use crate::error::Error;

/// Departures from physics. The default has none, and costs neither time nor bytes.
///
/// ```
/// use lumel::{NotPhysical, Settings};
///
/// let not_physical = NotPhysical { indirect_boost: 1.5, ..NotPhysical::default() };
/// let settings = Settings { not_physical, ..Settings::default() };
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NotPhysical {
    /// Factor on light that surfaces reflected at least once, applied where lumels, vertices and
    /// probes receive it. The solve does not use it, so a factor of 2 exactly doubles such light.
    pub indirect_boost: f32,
    /// Factor on the light of emissive materials. Their own look in the glTF does not change.
    pub emissive_boost: f32,
    /// Factor on reflectances while light bounces, clamped to
    /// [`max_reflectance`](crate::Settings::max_reflectance). The surfaces' look does not change.
    pub albedo_boost: f32,
    /// Saturation of reflectances while light bounces: 0 for grey of the same luminance, 1 for the
    /// surfaces' colours, more for stronger ones.
    pub bounce_saturation: f32,
    /// Minimum of R = E/π for every lumel and vertex, per channel.
    pub ambient_floor: [f32; 3],
    /// Share of the ambient occlusion that darkens the lightmap, 0..=1.
    pub ao_multiply: f32,
}

impl Default for NotPhysical {
    fn default() -> Self {
        NotPhysical {
            indirect_boost: 1.0,
            emissive_boost: 1.0,
            albedo_boost: 1.0,
            bounce_saturation: 1.0,
            ambient_floor: [0.0; 3],
            ao_multiply: 0.0,
        }
    }
}

/// Largest factor. A level that needs more should have brighter lamps.
const MOST: f32 = 1000.0;

/// The largest half float: a higher floor would be stored as this.
const BRIGHTEST: f32 = 65504.0;

impl NotPhysical {
    /// Whether nothing departs from physics.
    pub fn is_physical(&self) -> bool {
        *self == NotPhysical::default()
    }

    /// The departures from physics, one sentence each; empty if there are none.
    pub fn describe(&self) -> Vec<String> {
        let mut out = Vec::new();
        let mut factor = |what: &str, x: f32| {
            if x != 1.0 {
                out.push(format!("{what} × {x}"));
            }
        };
        factor("light that surfaces reflected", self.indirect_boost);
        factor("light of emissive materials", self.emissive_boost);
        factor("reflectances in bounces", self.albedo_boost);
        factor("saturation of bounces", self.bounce_saturation);
        if self.ambient_floor != [0.0; 3] {
            let [r, g, b] = self.ambient_floor;
            out.push(format!("R = E/π is at least {r}, {g}, {b}"));
        }
        if self.ao_multiply != 0.0 {
            let share = self.ao_multiply;
            out.push(format!("ambient occlusion multiplied in, × {share}"));
        }
        out
    }

    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub(crate) fn check(&self) -> Result<(), Error> {
        let within = |name: &str, x: f32, most: f32| {
            if (0.0..=most).contains(&x) {
                return Ok(());
            }
            Err(Error::Setting(format!(
                "--{name} is {x}, expected a number from 0 to {most}"
            )))
        };
        within("indirect-boost", self.indirect_boost, MOST)?;
        within("emissive-boost", self.emissive_boost, MOST)?;
        within("albedo-boost", self.albedo_boost, MOST)?;
        within("bounce-saturation", self.bounce_saturation, MOST)?;
        within("ao-multiply", self.ao_multiply, 1.0)?;
        for x in self.ambient_floor {
            within("ambient-floor", x, BRIGHTEST)?;
        }
        Ok(())
    }
}
