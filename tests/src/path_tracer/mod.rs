//! A path tracer that shares no code with the baker: the second method for scenes without a closed
//! form.
//!
//! It is deliberately naive, so that it can be read in one sitting and trusted: double precision
//! throughout, a textbook ray–triangle test, a tree split at the median, independent pseudo-random
//! numbers (PCG) and no stratification. Every path is thus an independent sample of the same
//! irradiance, and the standard error is the simple one. It reads glTF files itself and uses none
//! of the crates that it judges. It shares only the model with them (Lambertian surfaces, geometric
//! normals here, single-sided backs that block light and are black, KHR_lights_punctual) and the
//! fact that a lightmap's coordinates define the surface of each texel.
//!
//! [`Scene::from_glb`] reads a scene, [`footprints`] finds the surface of the texels of a
//! lightmapped scene, [`PathTracer::irradiance`] estimates E over a footprint, and [`Comparison`]
//! judges two lists of values.
//!
//! Source of the method: J. T. Kajiya, *The Rendering Equation*, 1986; E. Veach, *Robust Monte
//! Carlo Methods for Light Transport Simulation*, 1997, ch. 9 (multiple importance sampling) and 10
//! (Russian roulette). `tools/second_method.py` compares it with Mitsuba.

mod compare;
mod footprint;
mod random;
mod read;
mod scene;
mod trace;
mod tree;

#[cfg(test)]
mod tests;

pub use compare::{Bias, Comparison, Pair};
pub use footprint::{Footprint, choose, footprints};
pub use scene::{Light, Scene, Surface, Triangle};
pub use trace::{Effort, EmitterSampling, Estimate, PathTracer, Seen, luminance};
pub use tree::{Hit, Ray, Tree};
