//! Watertight ray casting for Lumel: closest hit, occlusion and alpha masks on an eight-wide
//! bounding volume hierarchy.
//!
//! [`Bvh::build`] takes world-space triangles. Two binary trees are built, one from the bottom up by
//! `obvhs` (PLOC and reinsertion) and one from the top down, and collapsed to eight-wide nodes whose
//! leaves hold triangles in packs of four that are tested together. The tree that costs rays less by
//! the surface area heuristic is kept.
//!
//! # Guarantees
//! - **Watertight.** A ray that crosses the interior, an edge or a vertex of a mesh closed by
//!   shared corner positions hits it. See [`kernel`] for why.
//! - **Same answer everywhere.** The AVX2 path, chosen at run time, and the portable one do the
//!   same IEEE operations in the same order, without fused multiply-add, and so return the same
//!   bits. Of hits at equal `t` the lowest triangle index wins.
//! - **No absolute epsilon.** `t_min` and `t_max` are honoured as given, at any scale.
//! - **No panic on input**, no fixed stack that can overflow, and no build time quadratic in
//!   coincident triangles.
//!
//! # Not guaranteed
//! - A mesh whose neighbours do not share corner positions bit for bit (T-junctions) has cracks,
//!   and rays find them.
//! - Triangles seen exactly edge-on are not hit; their neighbours in a closed mesh are.
//!
//! ```
//! use glam::Vec3;
//! use visibility::{AcceptAll, BuildOptions, Bvh, Ray};
//!
//! let triangles = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
//! let bvh = Bvh::build(&triangles, |_| false, &BuildOptions::default())?;
//! let ray = Ray { origin: Vec3::new(0.2, 0.2, 1.0), direction: -Vec3::Z, t_min: 0.0, t_max: f32::INFINITY };
//! let hit = bvh.closest_hit(&ray, &AcceptAll).expect("the ray points at the triangle");
//! assert_eq!((hit.triangle, hit.t, hit.back), (0, 1.0, false));
//! # Ok::<(), visibility::BuildError>(())
//! ```

mod binary;
mod bvh;
mod closest;
mod collapse;
mod error;
mod groups;
pub mod kernel;
mod node;
mod ray;
mod sweep;
mod traverse;
mod validate;
mod within;

pub use bvh::{BuildOptions, Bvh, BvhStats, Quality};
pub use closest::closest_point;
pub use error::{BuildError, ValidateError};
pub use ray::{AcceptAll, Hit, HitFilter, Ray};
