//! A scene as the path tracer sees it: triangles, Lambertian surfaces, lights, a constant sky.

use glam::{DVec2, DVec3};

/// A Lambertian surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// ρ, linear RGB, 0..=1.
    pub reflectance: DVec3,
    /// Emitted radiance L, W/(m² sr).
    pub emission: DVec3,
    /// Whether it reflects and emits on both sides; otherwise its back blocks light and is black.
    pub double_sided: bool,
}

/// A triangle in world space; its front is where the corners run counter-clockwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Corners, metres.
    pub corners: [DVec3; 3],
    /// Index into [`Scene::surfaces`].
    pub surface: usize,
    /// Index into [`Scene::nodes`].
    pub node: usize,
    /// Page of the lightmap and the corners' positions on it (0..=1, v down), if the node has a
    /// lightmap.
    pub lightmap: Option<(usize, [DVec2; 3])>,
}

impl Triangle {
    /// (b − a) × (c − a): twice the area along the front's normal.
    pub fn cross(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a)
    }

    /// Unit normal of the front; NaN without area.
    pub fn normal(&self) -> DVec3 {
        self.cross() / self.cross().length()
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        0.5 * self.cross().length()
    }

    /// a + u·(b − a) + v·(c − a).
    pub fn at(&self, u: f64, v: f64) -> DVec3 {
        let [a, b, c] = self.corners;
        a + (b - a) * u + (c - a) * v
    }
}

/// A light without extent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Light {
    /// Shines from a point.
    Point {
        /// Metres.
        position: DVec3,
        /// Intensity, W/sr (candela).
        intensity: DVec3,
    },
    /// Shines from a point into a cone; between the half-angles the intensity falls as the square
    /// of a ramp in the cosine (KHR_lights_punctual, "Inner and Outer Cone Angles").
    Spot {
        /// Metres.
        position: DVec3,
        /// Axis of the cone, unit, away from the light.
        direction: DVec3,
        /// Intensity on the axis, W/sr (candela).
        intensity: DVec3,
        /// Half-angle of full intensity, radians.
        inner: f64,
        /// Half-angle at which it ends, radians.
        outer: f64,
    },
    /// Light from a disc at infinity.
    Directional {
        /// Direction in which light travels, unit.
        direction: DVec3,
        /// Irradiance on a surface that faces it, W/m² (lux).
        irradiance: DVec3,
        /// Half the angle of its disc, rad.
        radius: f64,
    },
}

/// A scene.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scene {
    /// Triangles with area, world space.
    pub triangles: Vec<Triangle>,
    /// Surfaces.
    pub surfaces: Vec<Surface>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Radiance of the sky, equal in all directions, W/(m² sr).
    pub sky: DVec3,
    /// Names of the document's nodes.
    pub nodes: Vec<String>,
}
