//! Rays, hits and the filter for alpha masks.

use glam::Vec3;

/// A ray segment: the points `origin + t · direction` for `t_min < t < t_max`.
///
/// A ray that is not finite, has a zero direction, or has `t_min >= t_max`, hits nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The point at `t = 0`.
    pub origin: Vec3,
    /// Direction of increasing `t`; need not be unit. `t` is in units of its length.
    pub direction: Vec3,
    /// Hits at or before this are ignored. Negative values count as zero.
    pub t_min: f32,
    /// Hits at or after this are ignored; infinity is allowed.
    pub t_max: f32,
}

/// A ray's hit on a triangle.
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
    /// Whether the back was hit, i.e. the side from which the corners run clockwise.
    pub back: bool,
}

/// Decides whether a candidate hit stops the ray (alpha masks).
///
/// It is called only for triangles that were flagged at the build, possibly for candidates that
/// later lose to a nearer hit, in an order that depends on the tree. Its answer must depend only on
/// its arguments. It may record information for its caller: [`Bvh::occluded`](crate::Bvh::occluded)
/// asks exactly once about every flagged triangle that the ray hits before `t_max`, until one stops
/// it.
pub trait HitFilter {
    /// Whether the hit on `triangle` at barycentrics `u`, `v` (weights of corners 1 and 2) stops
    /// `ray`.
    fn accept(&self, triangle: u32, u: f32, v: f32, ray: &Ray) -> bool;
}

/// A filter that lets every hit stop the ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AcceptAll;

impl HitFilter for AcceptAll {
    fn accept(&self, _: u32, _: f32, _: f32, _: &Ray) -> bool {
        true
    }
}
