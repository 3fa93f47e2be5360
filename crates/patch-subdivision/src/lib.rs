//! patch-subdivision
