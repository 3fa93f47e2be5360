//! Flattens a group of faces as rigidly as possible (Liu et al. 2008, "A local/global approach to
//! mesh parameterization"), from its projection.
//!
//! What bends in one direction only (pillars, arches, cloth) is unrolled exactly by the first step:
//! in its projection the rotation of every face is the right one already.

use clarabel::algebra::CscMatrix;
use clarabel::qdldl::QDLDLFactorisation;
use glam::{DVec2, DVec3};

use super::charts::cross2;
use super::input::UnwrapInput;

/// A projection that changes no face's area by more than this stays as it is.
const FLAT: f64 = 1.02;

/// Most that a chart may change a face's area, against its mean.
const DISTORTION: f64 = 4.0;

/// Most that a chart may stretch its faces, in the mean: how much wider a lumel becomes.
const STRETCH: f64 = 1.1;

/// Steps of rotating the faces and moving the vertices after them, at most.
const STEPS: usize = 10;

/// Steps end when no vertex moves further than this share of the group's size.
const SETTLED: f64 = 1e-4;

/// Faces lower than this share of their longest edge have no shape to keep: rounding makes it.
const SLIVER: f64 = 1e-6;

/// And they stay lower than this share when they are flattened.
const THIN: f64 = 1e-4;

/// Most faces that are solved for at a time. The factors of a height field of 488,000 take 170 MB.
const MOST_FACES: usize = 500_000;

/// Whether the corners lie on a line, or nearly.
pub(super) fn is_sliver([a, b, c]: [DVec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - b).length_squared());
    let longest = longest.max((a - c).length_squared());
    (b - a).cross(c - a).length() <= SLIVER * longest
}

/// A group of faces with vertices of its own.
pub(super) struct Group {
    /// Vertices in space.
    vertices: Vec<DVec3>,
    /// Vertices of each face.
    faces: Vec<[usize; 3]>,
    gradients: Vec<Gradient>,
    /// Mean normal.
    normal: DVec3,
}

impl Group {
    pub fn new(mesh: &UnwrapInput, faces: &[u32]) -> Group {
        let corners = |&t: &u32| mesh.triangles[t as usize];
        let mut used: Vec<u32> = faces.iter().flat_map(corners).collect();
        used.sort_unstable();
        used.dedup();
        let vertices: Vec<DVec3> = used
            .iter()
            .map(|&v| mesh.positions[v as usize].as_dvec3())
            .collect();
        let faces: Vec<[usize; 3]> = faces
            .iter()
            .map(|t| corners(t).map(|v| used.partition_point(|&u| u < v)))
            .collect();
        let spread = |f: &[usize; 3]| {
            let [a, b, c] = f.map(|v| vertices[v]);
            (b - a).cross(c - a)
        };
        Group {
            normal: faces
                .iter()
                .map(spread)
                .sum::<DVec3>()
                .normalize_or(DVec3::Z),
            gradients: faces
                .iter()
                .map(|f| Gradient::new(f.map(|v| vertices[v])))
                .collect(),
            vertices,
            faces,
        }
    }

    /// Area of the faces, m².
    pub fn area(&self) -> f64 {
        self.gradients.iter().map(|g| g.area).sum()
    }

    /// The faces' corners in the plane, in metres and true to their area in the mean; `None` if
    /// that would distort them.
    pub fn flatten(&self) -> Option<Vec<[DVec2; 3]>> {
        let flat = self.projected();
        if self.faces.len() == 1 || self.allows(&flat, FLAT) {
            return Some(self.corners(&flat));
        }
        if self.faces.len() > MOST_FACES {
            return None;
        }
        let flat = self.as_rigid_as_possible(flat)?;
        self.allows(&flat, DISTORTION).then(|| self.corners(&flat))
    }

    fn corners(&self, flat: &[DVec2]) -> Vec<[DVec2; 3]> {
        let corners: Vec<[DVec2; 3]> = self.faces.iter().map(|f| f.map(|v| flat[v])).collect();
        true_to_area(corners, self.area())
    }

    /// The vertices along the mean normal; those of the front are counter-clockwise.
    fn projected(&self) -> Vec<DVec2> {
        let (x, y) = self.normal.any_orthonormal_pair();
        let origin = self.vertices[0];
        self.vertices
            .iter()
            .map(|&p| DVec2::new((p - origin).dot(x), (p - origin).dot(y)))
            .collect()
    }

    /// Whether no face is turned over or changes its area by more than `most` against the mean,
    /// slivers stay thin, and the faces are stretched by no more than [`STRETCH`].
    fn allows(&self, flat: &[DVec2], most: f64) -> bool {
        let size = |f: &[usize; 3]| 0.5 * cross2(&f.map(|v| flat[v]));
        let total: f64 = self.faces.iter().map(size).sum();
        let area = self.area();
        let scale = area / total;
        let mut stretch = 0.0;
        for (f, gradient) in self.faces.iter().zip(&self.gradients) {
            if gradient.area == 0.0 {
                let [a, b, c] = f.map(|v| flat[v]);
                let sides = [a.distance(b), b.distance(c), c.distance(a)];
                if size(f).abs() > THIN * sides.into_iter().fold(0.0, f64::max).powi(2) {
                    return false;
                }
                continue;
            }
            let ratio = size(f) * scale / gradient.area;
            if !(ratio * most >= 1.0 && ratio <= most) {
                return false;
            }
            let [x, y] = gradient.of(f.map(|v| flat[v]));
            let grown = (x.length_squared() + y.length_squared()) * scale;
            stretch += gradient.area * grown / (2.0 * ratio * ratio);
        }
        stretch <= STRETCH * STRETCH * area
    }

    /// The vertices after at most [`STEPS`] steps from `flat`.
    fn as_rigid_as_possible(&self, mut flat: Vec<DVec2>) -> Option<Vec<DVec2>> {
        let mut solver = QDLDLFactorisation::new(&self.stiffness(), None).ok()?;
        let [mut x, mut y] = [(); 2].map(|()| vec![0.0; flat.len() - 1]);
        let extent = flat
            .iter()
            .fold(0.0, |most: f64, p| most.max(p.length_squared()));
        for _ in 0..STEPS {
            x.fill(0.0);
            y.fill(0.0);
            for (f, gradient) in self.faces.iter().zip(&self.gradients) {
                let pull = gradient.pull(f.map(|v| flat[v]));
                for (&v, pull) in f.iter().zip(pull) {
                    // The first vertex stays at the origin.
                    if v > 0 {
                        x[v - 1] += pull.x;
                        y[v - 1] += pull.y;
                    }
                }
            }
            solver.solve(&mut x);
            solver.solve(&mut y);
            let mut moved: f64 = 0.0;
            for (p, (&x, &y)) in flat[1..].iter_mut().zip(x.iter().zip(&y)) {
                let to = DVec2::new(x, y);
                moved = moved.max(p.distance_squared(to));
                *p = to;
            }
            if moved <= extent * SETTLED * SETTLED {
                break;
            }
        }
        Some(flat)
    }

    /// The upper triangle of what relates the vertices' places to the faces' gradients, without the
    /// first vertex.
    fn stiffness(&self) -> CscMatrix<f64> {
        let count = self.vertices.len() - 1;
        // A vertex of nothing but faces without area has no entry otherwise.
        let mut entries: Vec<(usize, usize, f64)> = (0..count).map(|v| (v, v, 0.0)).collect();
        for (f, gradient) in self.faces.iter().zip(&self.gradients) {
            for i in 0..3 {
                for j in 0..3 {
                    if f[i] > 0 && f[i] <= f[j] && (i == j || f[i] != f[j]) {
                        let value = gradient.weight * gradient.rows[i].dot(gradient.rows[j]);
                        entries.push((f[j] - 1, f[i] - 1, value));
                    }
                }
            }
        }
        entries.sort_by_key(|e| (e.0, e.1));
        let (mut starts, mut rows, mut values) = (vec![0; count + 1], Vec::new(), Vec::new());
        for same in entries.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            rows.push(same[0].1);
            values.push(same.iter().map(|e| e.2).sum());
            starts[same[0].0 + 1] = rows.len();
        }
        CscMatrix::new(count, count, starts, rows, values)
    }
}

/// `corners` scaled so that their area is `area`.
pub(super) fn true_to_area(mut corners: Vec<[DVec2; 3]>, area: f64) -> Vec<[DVec2; 3]> {
    let flat: f64 = corners.iter().map(|c| 0.5 * cross2(c)).sum();
    let scale = if flat > 0.0 && area > 0.0 {
        (area / flat).sqrt()
    } else {
        1.0
    };
    corners.iter_mut().flatten().for_each(|p| *p *= scale);
    corners
}

/// How a value at the corners of a face changes in its plane.
struct Gradient {
    /// What each corner's value adds to the derivatives along and across the first edge.
    rows: [DVec2; 3],
    /// Area of the face; 0 for a sliver.
    area: f64,
    /// Area with which the face counts: slivers hold their corners together as if they were a
    /// little thicker.
    weight: f64,
}

impl Gradient {
    fn new([a, b, c]: [DVec3; 3]) -> Gradient {
        let (edge, other) = (b - a, c - a);
        let (length, area) = (edge.length(), 0.5 * edge.cross(other).length());
        if length == 0.0 {
            return Gradient {
                rows: [DVec2::ZERO; 3],
                area: 0.0,
                weight: 0.0,
            };
        }
        let least = SLIVER * length.max(other.length());
        let (along, across) = (other.dot(edge) / length, (2.0 * area / length).max(least));
        let twice = length * across;
        Gradient {
            rows: [
                DVec2::new(-1.0 / length, (along - length) / twice),
                DVec2::new(1.0 / length, -along / twice),
                DVec2::new(0.0, 1.0 / across),
            ],
            area: if is_sliver([a, b, c]) { 0.0 } else { area },
            weight: 0.5 * twice,
        }
    }

    /// The derivatives of the corners' places along and across the first edge.
    fn of(&self, flat: [DVec2; 3]) -> [DVec2; 2] {
        let (mut along, mut across) = (DVec2::ZERO, DVec2::ZERO);
        for (p, row) in flat.into_iter().zip(self.rows) {
            along += p * row.x;
            across += p * row.y;
        }
        [along, across]
    }

    /// Where the face, turned as its corners `flat` are but of its own shape, pulls its corners.
    fn pull(&self, flat: [DVec2; 3]) -> [DVec2; 3] {
        let [along, across] = self.of(flat);
        let turn = (along - across.perp()).normalize_or(DVec2::X);
        self.rows.map(|row| self.weight * turn.rotate(row))
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// A grid of `n` × `n` squares, two triangles each, bent by `bend`.
    fn sheet(n: u32, bend: impl Fn(f32, f32) -> Vec3) -> UnwrapInput {
        let at = |i: u32| i as f32 / n as f32;
        let side = n + 1;
        UnwrapInput {
            positions: (0..side * side)
                .map(|v| bend(at(v % side), at(v / side)))
                .collect(),
            triangles: (0..n * n)
                .flat_map(|i| {
                    let a = i / n * side + i % n;
                    [[a, a + 1, a + side + 1], [a, a + side + 1, a + side]]
                })
                .collect(),
            ..UnwrapInput::default()
        }
    }

    fn group(mesh: &UnwrapInput) -> Group {
        Group::new(
            mesh,
            &(0..mesh.triangles.len() as u32).collect::<Vec<u32>>(),
        )
    }

    /// Largest relative change of a side's length.
    fn error(mesh: &UnwrapInput, flat: &[[DVec2; 3]]) -> f64 {
        let mut most: f64 = 0.0;
        for (t, corners) in mesh.triangles.iter().zip(flat) {
            let p = t.map(|v| mesh.positions[v as usize].as_dvec3());
            for k in 0..3 {
                let (true_, flat) = (
                    p[k].distance(p[(k + 1) % 3]),
                    corners[k].distance(corners[(k + 1) % 3]),
                );
                most = most.max((flat / true_ - 1.0).abs());
            }
        }
        most
    }

    #[test]
    fn half_a_pillar_is_unrolled_exactly() {
        // 120° of a cylinder: its projection is up to half too narrow.
        let mesh = sheet(24, |x, y| {
            let angle = (x - 0.5) * 120_f32.to_radians();
            Vec3::new(libm::sinf(angle), y, libm::cosf(angle))
        });
        let group = group(&mesh);
        let projected = group.corners(&group.projected());
        assert!(error(&mesh, &projected) > 0.3);
        let flat = group.flatten().expect("it unrolls");
        // Positions are `f32`, whose rounding is 1e-7 of the radius and 3e-6 of a side.
        assert!(error(&mesh, &flat) < 1e-5, "{}", error(&mesh, &flat));
    }

    #[test]
    fn a_closed_cone_is_not_forced_into_the_plane() {
        // 60° steep: a disc of its area is stretched by 1.25 in the mean, and STRETCH is 1.1.
        let mesh = UnwrapInput {
            positions: (0..=24)
                .map(|i| {
                    let angle = std::f32::consts::TAU * i as f32 / 24.0;
                    match i {
                        24 => Vec3::new(0.0, 0.0, 1.732),
                        _ => Vec3::new(libm::cosf(angle), libm::sinf(angle), 0.0),
                    }
                })
                .collect(),
            triangles: (0..24).map(|i| [24, i, (i + 1) % 24]).collect(),
            ..UnwrapInput::default()
        };
        assert!(group(&mesh).flatten().is_none());
    }

    #[test]
    fn a_sliver_stays_on_the_line_of_its_corners() {
        // A bent sheet whose border has one more vertex between the first two, in a sliver only.
        let mut mesh = sheet(8, |x, y| {
            let angle = (x - 0.5) * 120_f32.to_radians();
            Vec3::new(libm::sinf(angle), y, libm::cosf(angle))
        });
        let middle = mesh.positions.len() as u32;
        mesh.positions
            .push(mesh.positions[0].midpoint(mesh.positions[1]));
        mesh.triangles.push([0, middle, 1]);
        let flat = group(&mesh).flatten().expect("it unrolls");
        let [a, middle, b] = flat[flat.len() - 1];
        // THIN of the border's length.
        assert!(
            a.distance(b) > 0.2 && middle.distance(a.midpoint(b)) < 1e-4,
            "{a} {middle} {b}"
        );
    }
}
