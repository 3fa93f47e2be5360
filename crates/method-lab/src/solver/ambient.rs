//! The ambient term: an estimate of the light that has not been shot yet.

use glam::DVec3;

use super::{System, SystemError};

/// Estimated radiosity that unshot light will contribute to a white surface, by channel, W/m².
///
/// Ambient = (Σ ΔB_i A_i / Σ A_i) / (1 − ρ̄) with ρ̄ = Σ ρ_i A_i / Σ A_i: the mean unshot radiosity
/// and all its bounces in a room with evenly mixed surfaces. 0 in a channel with ρ̄ = 1, for which
/// there is no such estimate. It is only for display; the solution does not use it. Source: Cohen,
/// Chen, Wallace, Greenberg, 1988, eq. 6–10.
///
/// # Errors
/// [`SystemError::Length`] if `unshot` does not have one value per patch.
pub fn ambient(system: &System<'_>, unshot: &[DVec3]) -> Result<DVec3, SystemError> {
    if unshot.len() != system.len() {
        return Err(SystemError::Length {
            what: "unshot radiosities",
            got: unshot.len(),
            expected: system.len(),
        });
    }
    let (mut area, mut light, mut rho) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for (i, &a) in system.area().iter().enumerate() {
        area += a;
        light += unshot[i] * a;
        rho += system.reflectance()[i] * a;
    }
    if area == 0.0 {
        return Ok(DVec3::ZERO);
    }
    let kept = DVec3::ONE - rho / area;
    let share = |light: f64, kept: f64| if kept > 0.0 { light / area / kept } else { 0.0 };
    Ok(DVec3::new(
        share(light.x, kept.x),
        share(light.y, kept.y),
        share(light.z, kept.z),
    ))
}

/// The radiosity to display during shooting: B_i + ρ_i · Ambient, W/m².
///
/// # Errors
/// [`SystemError::Length`] if a list does not have one value per patch.
pub fn with_ambient(
    system: &System<'_>,
    radiosity: &[DVec3],
    unshot: &[DVec3],
) -> Result<Vec<DVec3>, SystemError> {
    if radiosity.len() != system.len() {
        return Err(SystemError::Length {
            what: "radiosities",
            got: radiosity.len(),
            expected: system.len(),
        });
    }
    let ambient = ambient(system, unshot)?;
    Ok(radiosity
        .iter()
        .zip(system.reflectance())
        .map(|(&b, &rho)| b + rho * ambient)
        .collect())
}
