//! Members of `extras.lumel` that extend `KHR_lights_punctual`. Those of the node override those of
//! the light.

use super::measured::Profiles;
use crate::document::Document;
use crate::error::Outcome;
use crate::json::{Item, show};
use crate::nodes::Placed;
use crate::options::MAX_COORDINATE;
use crate::report::IngestReport;
use crate::scene::{LampMode, PlacedProfile};

/// Member `key` of `extras.lumel`, with its path.
pub(super) fn member<'a>(item: &Item<'a>, key: &str) -> Option<Item<'a>> {
    item.get("extras")?.get("lumel")?.get(key)
}

/// The first valid number of `places` in 0..=`most`; others are ignored with a warning.
pub(super) fn number(
    places: [&Item<'_>; 2],
    key: &str,
    most: f64,
    expected: &str,
    report: &mut IngestReport,
) -> Option<f64> {
    for place in places {
        let Some(item) = member(place, key) else {
            continue;
        };
        match item.value.as_f64() {
            Some(x) if (0.0..=most).contains(&x) => return Some(x),
            _ => ignore(&item, expected, report),
        }
    }
    None
}

pub(super) fn ignore(item: &Item<'_>, expected: &str, report: &mut IngestReport) {
    report.count("lights.extras_ignored", 1);
    report.warn(
        &item.path,
        format!("found {}, expected {expected}; ignored", show(item.value)),
    );
}

/// `radius`: radius of the emitting sphere in world-space metres. The node's scale does not affect
/// it, just as it does not affect intensities.
pub(super) fn radius(places: [&Item<'_>; 2], report: &mut IngestReport) -> f32 {
    let expected = "a radius in metres, at least 0";
    number(places, "radius", MAX_COORDINATE, expected, report).unwrap_or(0.0) as f32
}

/// `mode`: who computes the lamp's direct light; `None` if absent.
pub(super) fn mode(places: [&Item<'_>; 2], report: &mut IngestReport) -> Option<LampMode> {
    for place in places {
        let Some(item) = member(place, "mode") else {
            continue;
        };
        match item.value.as_str() {
            Some("baked") => return Some(LampMode::Baked),
            Some("mixed") => return Some(LampMode::Mixed),
            Some("realtime") => return Some(LampMode::Realtime),
            _ => ignore(&item, "\"baked\", \"mixed\" or \"realtime\"", report),
        }
    }
    None
}

/// Half of `angle` (degrees, the diameter of the disc), in radians.
pub(super) fn half_angle(places: [&Item<'_>; 2], report: &mut IngestReport) -> f32 {
    let expected = "the diameter of the disc in degrees, 0..=180";
    let degrees = number(places, "angle", 180.0, expected, report).unwrap_or(0.0);
    (0.5 * degrees).to_radians() as f32
}

/// `ies`: URI of a photometric file for the light; `None` if absent.
///
/// # Errors
/// The file cannot be read or is invalid.
pub(super) fn profile(
    document: &Document,
    places: [&Item<'_>; 2],
    placed: &Placed,
    profiles: &mut Profiles,
    report: &mut IngestReport,
) -> Outcome<Option<PlacedProfile>> {
    for place in places {
        let Some(item) = member(place, "ies") else {
            continue;
        };
        match item.value.as_str() {
            Some(uri) => {
                let (profile, _) = profiles.of_uri(document, uri, &item.path, report)?;
                let worn = super::measured::wear(profile, &placed.transform);
                if worn.is_none() {
                    report.count("lights.extras_ignored", 1);
                    report.warn(
                        &item.path,
                        "the node's transform gives the profile no direction; the profile is ignored",
                    );
                }
                return Ok(worn);
            }
            None => ignore(&item, "the URI of an IES file", report),
        }
    }
    Ok(None)
}

/// Warns about members that do not apply to this kind of light.
pub(super) fn refuse(places: [&Item<'_>; 2], keys: &[&str], kind: &str, report: &mut IngestReport) {
    for item in places
        .iter()
        .flat_map(|place| keys.iter().filter_map(|key| member(place, key)))
    {
        report.count("lights.extras_ignored", 1);
        report.warn(&item.path, format!("does not apply to a {kind}; ignored"));
    }
}
