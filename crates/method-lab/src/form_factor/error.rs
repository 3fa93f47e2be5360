//! Errors of form-factor computation.

/// Why no form factors were computed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FormFactorError {
    /// A patch that is not a flat convex polygon of 3 to 8 finite corners and some area.
    #[error("patch {patch}: {fault}")]
    InvalidPatch {
        /// Index of the patch.
        patch: usize,
        /// The fault.
        fault: &'static str,
    },
    /// A setting outside its range.
    #[error("{setting}: expected {expected}, got {got}")]
    InvalidSetting {
        /// Name of the setting.
        setting: &'static str,
        /// Its valid range.
        expected: &'static str,
        /// Its value.
        got: String,
    },
}
