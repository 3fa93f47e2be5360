//! Light transport: form factors, direct light and the progressive radiosity solve.
//!
//! In reading order:
//!
//! | read | to learn about |
//! |---|---|
//! | [`World`] | the scene as rays see it |
//! | [`DirectLight`], [`Emitters`] | light that arrives straight from lamps and emissive surfaces |
//! | [`solve`], [`SolveOptions`] | the light that surfaces exchange |
//! | [`Solution`] | the result, ready for the final gather |
//! | [`Audit`] | the energy balance of a solve |
//!
//! Symbols follow the literature: radiosity B and irradiance E in W/m² (lx if the scene is
//! photometric), radiance L = B/π, reflectance ρ, and the form factor F_ij, which is the share of
//! power leaving *i* that reaches *j*. Therefore `E_i = Σ_j F_ij B_j` and `A_i F_ij = A_j F_ji`.

mod audit;
mod bounce;
mod carried;
mod curved;
mod direct;
mod divide;
mod emitters;
mod facing;
mod first_bounce;
#[cfg(test)]
mod fixtures;
mod form_factor;
mod glass;
mod groups;
mod lamps;
mod links;
mod lit;
mod monitor;
mod openings;
mod relax;
mod roles;
mod sampling;
mod scarce;
mod shadow_edges;
mod sky;
mod solids;
mod solution;
mod solve;
mod stand_in;
mod stored;
mod world;

pub use audit::{Audit, AuditBounds, RowsOfNode};
pub use bounce::Bounce;
pub use direct::{DirectEstimate, DirectLight, DirectOptions, DirectParts, Known};
pub use emitters::Emitters;
pub use facing::facing;
pub use form_factor::form_factor_polygon;
pub use groups::LightGroups;
pub use lit::{FromLit, LitCut, LitElements, LitSample};
pub use monitor::{Cancelled, Monitor, Phase, Silent};
pub use openings::{Opening, Openings};
pub use relax::{RelaxOptions, RelaxReport, RelaxStep};
pub use roles::{LampRoles, MASKS, MaskLamps, lamps_that_reach};
pub use sampling::{cosine_hemisphere, hash_u32, sample_2d, sample_4d};
pub use shadow_edges::{Caster, Ground, Outline, SOFT, ShadowEdge, SharpLights};
pub use sky::Sky;
pub use solution::{Look, Reflected, Sent, Solution, SolveReport, SolveStep, of_lit};
pub use solve::{SolveOptions, count_patches, cut_surfaces, solve};
pub use stored::StoredSolution;
pub use world::{Backs, Incoming, SurfacePoint, World, WorldOptions, luminance};
