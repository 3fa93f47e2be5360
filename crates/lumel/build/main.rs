//! Generates what the binary needs from the source tree: a hash of the sources and the viewer's
//! files.

#![allow(
    clippy::print_stdout,
    reason = "this is how a build script speaks to cargo"
)]

mod assets;
mod sources;

fn main() {
    sources::write();
    assets::write();
}
