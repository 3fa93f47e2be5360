//! Tests of charts and pages, in one program: linking is what costs, and each file of its own would
//! be linked with everything below it once more.

mod common;
mod layout;
mod nasty;
mod scenes;
mod unlike;
mod unwrappers;
mod uv_faults;
