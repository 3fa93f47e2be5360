//! Scene generators and helpers for Lumel's whole-pipeline tests.
//!
//! [`scenes`] contains the scenes, each a function of its parameters that returns the bytes of a
//! `.glb`. [`assets`] lists those committed under `assets/`, which
//! `cargo run -p lumel-tests --bin make-assets` writes. [`gltf`] and [`geometry`] are their
//! building blocks, and [`levels`] generates typical levels. [`path_tracer`] is an independent
//! second method to compare bakes with.

pub mod assets;
pub mod carve;
pub mod geometry;
pub mod gltf;
pub mod levels;
pub mod path_tracer;
pub mod scenes;
pub mod textures;
