//! Tests of charts and pages as one program, because linking each file separately takes most of the
//! time.

mod common;
mod layout;
mod nasty;
mod scenes;
mod unlike;
mod unwrappers;
mod uv_faults;
