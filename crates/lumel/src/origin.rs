//! Where settings come from.

use serde::Serialize;

/// Who gave a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// The file of settings.
    File,
    /// The command line.
    Flag,
}
