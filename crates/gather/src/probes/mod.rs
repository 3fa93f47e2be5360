//! Light probes: the light at points in the air, for moving objects.
//!
//! A probe stores the radiance from all directions as nine coefficients of spherical harmonics
//! ([`Sh2`]). Light directly from lamps is summed lamp by lamp
//! ([`DirectLight::for_each_arrival`](radiosity::DirectLight::for_each_arrival)). The rest is
//! gathered by rays over the whole sphere, which read the solution where they hit and the sky where
//! they leave, like those of lumels ([`Gatherer`](crate::Gatherer)).
//!
//! Based on: R. Ramamoorthi and P. Hanrahan, *An efficient representation for irradiance
//! environment maps*, 2001. Probes inside objects are recognised by the backfaces that they see, as
//! in Z. Majercik and others, *Dynamic diffuse global illumination with ray-traced irradiance
//! fields*, 2019.

mod bake;
mod grid;
mod probe;
mod reflection;
mod sh;

pub use bake::{ProbeOptions, ProbeReport, ProbeScene, bake_probes, report_probes};
pub use grid::{ProbeGrid, TooManyProbes};
pub use probe::{MAX_PROBES, Probe};
pub use reflection::{
    ReflectionCube, ReflectionOptions, ReflectionReport, capture_reflections, report_reflections,
};
pub use sh::Sh2;
