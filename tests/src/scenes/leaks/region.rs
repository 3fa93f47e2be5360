//! Regions of surfaces and their light.

use glam::DVec3;

/// A convex body as half-spaces x·a + y·b + z·c ≤ d, each `[a, b, c, d]` with a unit normal;
/// metres, world space. Without half-spaces it is all of space.
pub type Hull = Vec<[f64; 4]>;

/// Whether `p` lies in `hull` or on its surface.
pub fn inside(hull: &Hull, p: DVec3) -> bool {
    (hull.iter()).all(|&[a, b, c, d]| p.dot(DVec3::new(a, b, c)) <= d)
}

/// The light of a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// No light: E is exactly 0.
    Dark,
    /// Little light, through an opening.
    Dim,
    /// The light of the lit room or of the open air.
    Lit,
}

impl Kind {
    /// Its name in `leaks.json`.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Dark => "dark",
            Kind::Dim => "dim",
            Kind::Lit => "lit",
        }
    }
}

/// A part of a node's surface.
#[derive(Debug, Clone)]
pub struct Region {
    /// Name of the node.
    pub node: String,
    /// Its light.
    pub kind: Kind,
    /// Only faces whose normal is at most 60° off this direction.
    pub facing: Option<DVec3>,
    /// Only the part inside this body.
    pub within: Hull,
    /// Without the parts inside these.
    pub without: Vec<Hull>,
}

impl Region {
    /// Whether faces with the unit `normal` belong to it.
    pub fn faces(&self, normal: DVec3) -> bool {
        self.facing.is_none_or(|f| f.dot(normal) > 0.5)
    }

    /// Area in m² of the part of a convex polygon in the region; the polygon's face must belong to
    /// it.
    pub fn area(&self, polygon: &[DVec3]) -> f64 {
        let mut part = polygon.to_vec();
        for plane in &self.within {
            part = clip(&part, plane, 1.0);
        }
        let mut parts = vec![part];
        for hull in &self.without {
            let mut rest = Vec::new();
            for mut part in parts {
                for plane in hull {
                    rest.push(clip(&part, plane, -1.0));
                    part = clip(&part, plane, 1.0);
                }
            }
            rest.retain(|p| p.len() >= 3);
            parts = rest;
        }
        parts.iter().map(|p| polygon_area(p)).sum()
    }

    /// Whether a point of a face that belongs to the region is in it.
    pub fn holds(&self, p: DVec3) -> bool {
        inside(&self.within, p) && !self.without.iter().any(|h| inside(h, p))
    }
}

/// The part of a convex polygon on the inner (`side` 1) or outer (−1) side of a plane (Sutherland
/// and Hodgman 1974).
fn clip(polygon: &[DVec3], &[a, b, c, d]: &[f64; 4], side: f64) -> Vec<DVec3> {
    let depth = |p: DVec3| side * (d - p.dot(DVec3::new(a, b, c)));
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (here, there) = (depth(p), depth(q));
        if here >= 0.0 {
            out.push(p);
        }
        if (here >= 0.0) != (there >= 0.0) {
            out.push(p + (q - p) * (here / (here - there)));
        }
    }
    out
}

fn polygon_area(p: &[DVec3]) -> f64 {
    let fan = p.get(1..).unwrap_or_default().windows(2);
    0.5 * (fan.map(|w| (w[0] - p[0]).cross(w[1] - p[0])).sum::<DVec3>()).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_taken_out_of_polygons() {
        let square = [(0.0, 0.0), (0.0, 2.0), (2.0, 2.0), (2.0, 0.0)];
        let square = square.map(|(x, z)| DVec3::new(x, 1.0, z));
        let upto = |x: f64| [1.0, 0.0, 0.0, x];
        let from = |x: f64| [-1.0, 0.0, 0.0, -x];
        let mut region = Region {
            node: String::new(),
            kind: Kind::Lit,
            facing: None,
            within: vec![upto(1.5)],
            without: Vec::new(),
        };
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(region.area(&square), 3.0));
        region.without.push(vec![from(0.5), upto(1.0)]);
        assert!(near(region.area(&square), 2.0));
        // Holes may overlap.
        region.without.push(vec![from(0.75), upto(5.0)]);
        assert!(near(region.area(&square), 1.0));
        assert!(region.holds(DVec3::new(0.25, 1.0, 1.0)));
        assert!(!region.holds(DVec3::new(0.7, 1.0, 1.0)));
        region.without.push(Vec::new());
        assert_eq!(region.area(&square), 0.0);
    }
}
