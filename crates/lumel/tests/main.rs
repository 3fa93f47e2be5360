//! Tests of the library and of the real binary as one program, because linking each file separately
//! takes most of the time.

mod book;
mod browser;
mod cache;
mod cli;
mod common;
mod engines;
mod examples;
mod extras;
mod farm;
mod fuzz;
mod hostile;
mod inspect;
#[cfg(unix)]
mod interrupt;
mod library;
mod newcomer;
mod only;
mod pipeline;
mod probes;
mod scenes;
mod sources;
mod vertex_colors;
mod view;
mod warnings;
mod watch;
