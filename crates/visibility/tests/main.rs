//! Tests of rays as one program, because linking each file separately takes most of the time.

mod brute_force;
mod common;
mod degenerate;
mod slivers;
mod watertight;
