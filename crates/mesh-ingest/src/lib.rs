//! Reads glTF 2.0 into [`Scene`], one documented normal form.

mod scene;
mod soup;

pub use scene::*;
pub use soup::{Soup, TriangleSource};
