//! Tests of rays, in one program: linking is what costs, and each file of its own would be
//! linked with everything below it once more.

mod brute_force;
mod common;
mod degenerate;
mod slivers;
mod watertight;
