//! Origin of settings.

use serde::Serialize;

/// Who set a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// The settings file.
    File,
    /// The command line.
    Flag,
}
