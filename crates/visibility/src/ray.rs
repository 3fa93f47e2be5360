//! Rays, hits and the filter that alpha masks plug into.

use glam::Vec3;

/// A ray segment: the points `origin + t · direction` for `t_min < t < t_max`.
///
/// A ray that is not finite, or has direction zero, or `t_min >= t_max`, hits nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where `t = 0`.
    pub origin: Vec3,
    /// Direction of increasing `t`; need not be unit. `t` counts in its length.
    pub direction: Vec3,
    /// Hits at or before this are ignored. Negative values count as zero.
    pub t_min: f32,
    /// Hits at or after this are ignored; infinity is allowed.
    pub t_max: f32,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index into the slice given to the build.
    pub triangle: u32,
    /// Ray parameter, in units of the direction's length.
    pub t: f32,
    /// Barycentric weight of corner 1.
    pub u: f32,
    /// Barycentric weight of corner 2.
    pub v: f32,
    /// The ray arrived at the back, the side from which the corners run clockwise.
    pub back: bool,
}

/// Decides whether a candidate hit stops the ray (alpha masks).
///
/// It is called only for triangles that were flagged at the build, possibly for candidates that
/// lose to a nearer hit later, in an order that hangs on the tree. Its answer must depend on its
/// arguments alone. It may keep notes for its caller: [`Bvh::occluded`](crate::Bvh::occluded) asks
/// once about every flagged triangle that the ray meets before `t_max`, as long as none stops it.
pub trait HitFilter {
    /// Whether the hit on `triangle` at barycentrics `u`, `v` (weights of corners 1 and 2) stops
    /// `ray`.
    fn accept(&self, triangle: u32, u: f32, v: f32, ray: &Ray) -> bool;
}

/// Lets every hit stop the ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AcceptAll;

impl HitFilter for AcceptAll {
    fn accept(&self, _: u32, _: f32, _: f32, _: &Ray) -> bool {
        true
    }
}
