//! A path tracer that shares nothing with the baker: the second method that a bake is held against
//! where no closed form is known.
//!
//! It is naive on purpose, so that it can be read in one sitting and believed: double precision
//! throughout, a ray–triangle test out of a textbook, a tree that is split at the median,
//! independent pseudo-random numbers (PCG) and no stratification, so that every path is an
//! independent sample of the same irradiance and the standard error is the plain one. It reads the
//! glTF files itself and uses no code of the crates that it judges. What it has in common with them
//! is the model (Lambertian surfaces, geometric normals here, single-sided backs that block and are
//! black, KHR_lights_punctual) and that a lightmap says by its own coordinates which piece of
//! surface a texel stands for.
//!
//! [`Scene::from_glb`] reads a scene, [`footprints`] the pieces of surface behind the texels of a
//! lightmapped one, [`PathTracer::irradiance`] estimates E over a footprint, [`Comparison`] judges
//! two lists of values.
//!
//! Source of the method: J. T. Kajiya, *The Rendering Equation*, 1986; E. Veach, *Robust Monte
//! Carlo Methods for Light Transport Simulation*, 1997, ch. 9 (weights when light is sampled in two
//! ways) and 10 (roulette). `tools/second_method.py` compares it with Mitsuba.

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
pub use trace::{Effort, EmitterSampling, Estimate, PathTracer, luminance};
pub use tree::{Hit, Ray, Tree};
