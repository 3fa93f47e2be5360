//! Tests of the library and of the real binary, in one program: linking is what costs, and each
//! file of its own would be linked with everything below it once more.

mod browser;
mod cache;
mod cli;
mod common;
mod engines;
mod examples;
mod fuzz;
mod hostile;
mod inspect;
#[cfg(unix)]
mod interrupt;
mod library;
mod newcomer;
mod pipeline;
mod probes;
mod sources;
mod vertex_colors;
mod view;
mod warnings;
