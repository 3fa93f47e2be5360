//! Light probes: the light that passes through points in the air, for things that move.
//!
//! A probe holds the radiance that arrives from all around as nine coefficients of spherical
//! harmonics ([`Sh2`]). Light straight from lamps is summed up lamp by lamp
//! ([`DirectLight::for_each_arrival`](radiosity::DirectLight::for_each_arrival)); the rest is
//! gathered by rays over the whole sphere, which read the solution where they hit and the sky where
//! they leave, as those of lumels do ([`Gatherer`](crate::Gatherer)).
//!
//! Based on: R. Ramamoorthi and P. Hanrahan, *An efficient representation for irradiance
//! environment maps*, 2001. Probes inside of things are told by the backs of faces that they see,
//! as in Z. Majercik and others, *Dynamic diffuse global illumination with ray-traced irradiance
//! fields*, 2019.

mod bake;
mod grid;
mod probe;
mod sh;

pub use bake::{ProbeOptions, ProbeReport, ProbeScene, bake_probes, report_probes};
pub use grid::{ProbeGrid, TooManyProbes};
pub use probe::{MAX_PROBES, Probe};
pub use sh::Sh2;
