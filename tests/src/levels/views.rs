//! Cameras at plausible viewpoints, drawn in the spaces that a family provides and kept if rays
//! show that the picture is useful.

use std::collections::BTreeSet;
use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::kit::{Kit, Space};
use crate::gltf::{Node, look_along};
use crate::path_tracer::{Ray, Tree};

/// Width over height.
const ASPECT: f64 = 1.5;
/// Smallest distance of anything from a camera, metres.
const CLEAR: f64 = 0.3;
/// Columns and rows of the rays that judge a view.
const GRID: [u32; 2] = [9, 6];
/// Largest fraction of rays that may hit backs of single-sided faces, or leave a level without a
/// sky.
const MOST_BAD: f64 = 0.04;

struct View {
    eye: DVec3,
    forward: DVec3,
    yfov: f64,
    score: f64,
}

struct Judge<'a> {
    kit: &'a Kit,
    tree: Tree,
}

impl Kit {
    /// Adds `view_0` (a look around) and `view_1`, `view_2` (corners and contacts from 1.5 to 4 m).
    pub(super) fn add_views(&mut self) {
        let spaces = self.spaces.clone();
        let mut views = Vec::new();
        let judge = Judge {
            tree: Tree::new(self.soup.clone()),
            kit: self,
        };
        // The stream depends on the geometry, because a stream of its own would be drawn from the
        // same seed.
        let mut rng = super::random::Random::new(judge.tree.triangles().len() as u64, 0x0063_616D);
        for k in 0..3 {
            let mut best: Vec<View> = Vec::new();
            // A fallback: the view with the fewest backs.
            let mut spare: Option<View> = None;
            for attempt in 0..6000 {
                // First spaces without a view yet, later any, and later with lower standards.
                let space = spaces[rng.int(0, spaces.len() as u32 - 1) as usize];
                let view = draw(&mut rng, &space, k);
                let slack = f64::from(attempt / 1500);
                let Some((mut score, bad)) = judge.score(&view, k, slack) else {
                    continue;
                };
                if score == 0.0 {
                    if spare.as_ref().is_none_or(|s| -bad > s.score) && judge.fits(view.eye) {
                        spare = Some(View {
                            score: -bad,
                            ..view
                        });
                    }
                    continue;
                }
                let near =
                    |v: &View| (v.eye - view.eye).length() + (v.forward - view.forward).length();
                score += views.iter().map(near).fold(2.0, f64::min) * 0.5;
                best.push(View { score, ..view });
                if best.len() >= 24 {
                    break;
                }
            }
            best.sort_by(|a, b| b.score.total_cmp(&a.score));
            let found = best.into_iter().find(|v| judge.fits(v.eye));
            let found = found.or(spare);
            views.push(found.unwrap_or_else(|| draw(&mut rng, &spaces[0], k)));
        }
        for (k, v) in views.into_iter().enumerate() {
            let camera = self
                .b
                .camera(&format!("view_{k}"), v.yfov as f32, ASPECT as f32);
            self.b.node(Node {
                name: format!("view_{k}"),
                translation: v.eye.as_vec3(),
                rotation: look_along(v.forward.as_vec3(), Vec3::Y),
                camera: Some(camera),
                ..Node::default()
            });
        }
    }
}

fn draw(rng: &mut super::random::Random, space: &Space, k: usize) -> View {
    let low = space.min.y + 1.0;
    let high = (space.min.y + 1.8).min(space.max.y - 0.3);
    let y = if high > low {
        rng.range(low, high)
    } else {
        (space.min.y + space.max.y) / 2.0
    };
    let eye = Vec3::new(
        rng.range(space.min.x, space.max.x),
        y,
        rng.range(space.min.z, space.max.z),
    );
    let mut along = rng.direction();
    along.y = rng.range(-0.6, if k == 0 { 0.0 } else { 0.25 });
    View {
        eye: ((eye * 1000.0).round() / 1000.0).as_dvec3(),
        forward: along.normalize().as_dvec3(),
        yfov: f64::from(rng.range(48.0, 62.0).round().to_radians()),
        score: 0.0,
    }
}

impl Judge<'_> {
    fn cast(&self, origin: DVec3, direction: DVec3, t_max: f64) -> Option<(f64, usize)> {
        let skip = [usize::MAX; 2];
        let ray = Ray {
            origin,
            direction,
            t_max,
            skip,
        };
        self.tree.closest(&ray).map(|h| (h.t, h.triangle))
    }

    /// How much there is to see (0 for a useless view), and how much of it is faulty; `None` if no
    /// camera can be there.
    fn score(&self, v: &View, k: usize, slack: f64) -> Option<(f64, f64)> {
        for i in 0..26 {
            if self.cast(v.eye, around(i), CLEAR).is_some() {
                return None;
            }
        }
        let right = v.forward.cross(DVec3::Y).normalize();
        let up = right.cross(v.forward);
        let half = (v.yfov / 2.0).tan();
        let (mut bad, mut emits, mut lit, mut depth) = (0.0, 0.0, 0.0, Vec::new());
        let mut seen = BTreeSet::new();
        for j in 0..GRID[1] {
            for i in 0..GRID[0] {
                let at = |n: u32, of: u32| (f64::from(n) + 0.5) / f64::from(of) * 2.0 - 1.0;
                let (x, y) = (at(i, GRID[0]) * half * ASPECT, at(j, GRID[1]) * half);
                let d = (v.forward + right * x + up * y).normalize();
                let Some((t, hit)) = self.cast(v.eye, d, f64::INFINITY) else {
                    bad += if self.kit.sky.is_some() { 0.1 } else { 1.0 };
                    depth.push(f64::INFINITY);
                    continue;
                };
                depth.push(t);
                let triangle = &self.tree.triangles()[hit];
                let paint = self.kit.paints[triangle.surface];
                let n = triangle.normal();
                let back = n.dot(d) > 0.0;
                if back && !paint.double_sided {
                    bad += 1.0;
                    continue;
                }
                emits += f64::from(u8::from(paint.emits));
                let n = if back { -n } else { n };
                let facing = n.to_array().map(|x| (x * 1.9).round() as i8);
                seen.insert((triangle.node, facing));
                lit += self.light(v.eye + d * t + n * 1e-3, n);
            }
        }
        let all = f64::from(GRID[0] * GRID[1]);
        depth.sort_by(f64::total_cmp);
        let middle = depth[depth.len() / 2];
        let range = if k == 0 { 2.5..9.0 } else { 1.5..4.0 };
        let ok = bad <= MOST_BAD * all
            && emits <= 0.15 * all
            && depth[0] > 0.35
            && lit >= (0.25 - 0.08 * slack) * all
            && range.start - 0.3 * slack <= middle
            && middle <= range.end + 1.5 * slack;
        let score = (lit / all).min(0.6) * 3.0 + (seen.len() as f64).sqrt() * 0.5;
        let wrong = bad + 0.5 * (all - lit);
        Some((if ok { score } else { 0.0 }, wrong))
    }

    /// Whether some lamp, the sun or a part of the sky reaches a point, 0 to 1.
    fn light(&self, p: DVec3, n: DVec3) -> f64 {
        let free = |d: DVec3, t: f64| self.cast(p, d, t).is_none();
        if let Some(sun) = self.kit.sun {
            let d = -sun.as_dvec3();
            if d.dot(n) > 0.05 && free(d, f64::INFINITY) {
                return 1.0;
            }
        }
        if self.kit.sky.is_some() && (0..26).any(|i| around(i).dot(n) > 0.2 && free(around(i), 1e9))
        {
            return 1.0;
        }
        let mut lamps: Vec<DVec3> = self.kit.lamps.iter().map(|l| l - p).collect();
        lamps.retain(|d| d.dot(n) > 0.0);
        lamps.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let lit = lamps.iter().take(6).any(|d| free(*d, 1.0));
        f64::from(u8::from(lit))
    }

    /// Whether a camera fits: nothing is within [`CLEAR`], including thin edges that slip between
    /// rays, and no solid node surrounds it. Inside a node its winding number is about 1 (Jacobson
    /// et al., *Robust Inside-Outside Segmentation using Generalized Winding Numbers*, 2013).
    fn fits(&self, p: DVec3) -> bool {
        let mut winding = vec![0.0; self.kit.solids.len()];
        for t in self.tree.triangles() {
            let [a, b, c] = t.corners.map(|q| q - p);
            if nearest(a, b, c) < CLEAR * CLEAR {
                return false;
            }
            let (la, lb, lc) = (a.length(), b.length(), c.length());
            let det = a.dot(b.cross(c));
            let div = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
            winding[t.node] += 2.0 * det.atan2(div) / (4.0 * PI);
        }
        !(winding.iter().zip(&self.kit.solids)).any(|(w, solid)| *solid && *w > 0.8)
    }
}

/// Squared distance of a triangle from the origin: that of its plane if the foot lies inside, else
/// that of its nearest edge.
fn nearest(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let edge = |p: DVec3, q: DVec3| {
        let d = q - p;
        let t = (-p.dot(d) / d.length_squared()).clamp(0.0, 1.0);
        (p + d * t).length_squared()
    };
    let n = (b - a).cross(c - a);
    let inside = |p: DVec3, q: DVec3| n.cross(q - p).dot(-p) >= 0.0;
    if inside(a, b) && inside(b, c) && inside(c, a) {
        return a.dot(n).powi(2) / n.length_squared();
    }
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

/// The middles of a cube's faces, edges and corners.
fn around(i: u32) -> DVec3 {
    let k = if i < 13 { i } else { i + 1 };
    let at = |n: u32| f64::from(n % 3) - 1.0;
    // Turned a little, so that rays do not run along axis-parallel edges.
    let d = DVec3::new(at(k), at(k / 3), at(k / 9)) + DVec3::new(0.013, 0.021, 0.017);
    d.normalize()
}
