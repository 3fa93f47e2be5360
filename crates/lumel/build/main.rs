//! What the binary needs of the tree that it is built from: a hash of its sources, and the viewer's
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
