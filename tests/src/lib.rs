//! Scene makers and helpers for Lumel's whole-pipeline tests.
//!
//! [`scenes`] holds the scenes, each a function of its parameters that returns the bytes of a
//! `.glb`; [`assets`] lists the ones that are committed under `assets/`, which
//! `cargo run -p lumel-tests --bin make-assets` writes; [`gltf`] and [`geometry`] are what they are
//! made with; [`levels`] draws levels as people build them. [`path_tracer`] is a second method,
//! which shares nothing with the baker, to hold a bake against.

pub mod assets;
pub mod carve;
pub mod geometry;
pub mod gltf;
pub mod levels;
pub mod path_tracer;
pub mod scenes;
pub mod textures;
