//! Supported versions of glTF.

use serde_json::Value;

use crate::container::UPGRADE;
use crate::error::{Fault, Outcome};
use crate::json::Item;

/// Accepts 2.x documents whose `minVersion` is at most 2.0.
pub(crate) fn check(root: &Item<'_>) -> Outcome<()> {
    let number = |text: &str| -> Option<(u32, u32)> {
        let (major, minor) = text.split_once('.')?;
        Some((major.parse().ok()?, minor.parse().ok()?))
    };
    let missing = || Fault::invalid("asset.version", "nothing", "\"2.0\"");
    let Some(asset) = root.get("asset") else {
        // glTF 1.0 may lack it; its top-level collections are objects instead of arrays.
        if ["meshes", "accessors", "nodes"]
            .iter()
            .any(|k| root.value.get(k).is_some_and(Value::is_object))
        {
            return Err(Fault::unsupported(
                "asset",
                "nothing, as in glTF 1.0",
                UPGRADE,
            ));
        }
        return Err(missing());
    };
    let asset = asset.object()?;
    let version = asset.opt_str("version");
    // Some glTF 1.0 files write the version as a number.
    let version = match version {
        Err(_) if asset.value.get("version").and_then(Value::as_f64) == Some(1.0) => "1.0",
        other => other?.ok_or_else(missing)?,
    };
    match number(version) {
        Some((1, _)) => {
            return Err(Fault::unsupported(
                "asset.version",
                format!("\"{version}\""),
                UPGRADE,
            ));
        }
        Some((2, _)) => {}
        Some(_) => {
            return Err(Fault::unsupported(
                "asset.version",
                format!("\"{version}\""),
                "\"2.0\"",
            ));
        }
        None => {
            return Err(Fault::invalid(
                "asset.version",
                format!("\"{version}\""),
                "\"2.0\"",
            ));
        }
    }
    if let Some(least) = asset.opt_str("minVersion")? {
        match number(least) {
            Some(least) if number(version).is_some_and(|version| least > version) => {
                return Err(Fault::invalid(
                    "asset.minVersion",
                    format!("{least:?}"),
                    format!("at most {version}"),
                ));
            }
            Some((2, 0)) => {}
            Some(_) => {
                return Err(Fault::unsupported(
                    "asset.minVersion",
                    format!("\"{least}\""),
                    "\"2.0\"",
                ));
            }
            None => {
                return Err(Fault::invalid(
                    "asset.minVersion",
                    format!("\"{least}\""),
                    "\"2.0\"",
                ));
            }
        }
    }
    Ok(())
}
