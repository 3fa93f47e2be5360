//! lumel
