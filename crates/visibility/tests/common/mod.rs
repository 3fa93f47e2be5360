//! Meshes, rays and a brute-force ray caster for the tests.
#![allow(dead_code, reason = "tests use all of it, examples a part")]

use glam::{DVec3, Vec3};
use visibility::{AcceptAll, BuildOptions, Bvh, Hit, HitFilter, Ray};

/// SplitMix64 (Steele, Lea, Flood 2014): repeatable, and good enough for tests.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// In the cube from -1 to 1.
    pub fn cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// On the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let p = self.cube();
            let l = p.length_squared();
            if l > 1e-6 && l <= 1.0 {
                return p / l.sqrt();
            }
        }
    }
}

pub fn build(triangles: &[[Vec3; 3]]) -> Bvh {
    let bvh = Bvh::build(triangles, |_| false, &BuildOptions::default()).expect("finite input");
    bvh.validate().expect("a sound tree");
    bvh
}

pub fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: f32::INFINITY,
    }
}

/// Tests every triangle separately, each in its own tree, and keeps the nearest hit, lowest index
/// first. The tree must return the same, bit for bit.
pub struct BruteForce(Vec<Bvh>);

impl BruteForce {
    pub fn new(triangles: &[[Vec3; 3]]) -> BruteForce {
        BruteForce(
            triangles
                .iter()
                .map(|t| build(std::slice::from_ref(t)))
                .collect(),
        )
    }

    pub fn closest(&self, ray: &Ray, skip: impl Fn(u32, &Hit) -> bool) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (index, one) in self.0.iter().enumerate() {
            if let Some(hit) = one.closest_hit(ray, &AcceptAll)
                && best.is_none_or(|b| hit.t < b.t)
                && !skip(index as u32, &hit)
            {
                best = Some(Hit {
                    triangle: index as u32,
                    ..hit
                });
            }
        }
        best
    }
}

/// A triangle list with shared corner positions that encloses a point.
pub struct Closed {
    pub name: &'static str,
    pub triangles: Vec<[Vec3; 3]>,
    /// Points well inside the mesh.
    pub inside: fn(&mut Random) -> DVec3,
}

/// A subdivided icosahedron of radius 1.
pub fn icosphere(levels: u32) -> Closed {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let v: Vec<DVec3> = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ]
    .map(|p| DVec3::from_array(p).normalize())
    .to_vec();
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut triangles: Vec<[DVec3; 3]> = faces.map(|f| f.map(|i: usize| v[i])).to_vec();
    for _ in 0..levels {
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                // a + b and b + a are equal, so neighbours share the midpoint bit for bit.
                let (ab, bc, ca) = (
                    (a + b).normalize(),
                    (b + c).normalize(),
                    (c + a).normalize(),
                );
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Closed {
        name: "icosphere",
        triangles: triangles.iter().map(|t| t.map(|p| p.as_vec3())).collect(),
        inside: |r| r.cube() * 0.5,
    }
}

/// A torus of radii 1 and 0.4.
pub fn torus(rings: usize, sides: usize) -> Closed {
    use std::f64::consts::TAU;
    let point = |i: usize, j: usize| {
        let (a, b) = (
            (i % rings) as f64 / rings as f64 * TAU,
            (j % sides) as f64 / sides as f64 * TAU,
        );
        let r = 1.0 + 0.4 * b.cos();
        DVec3::new(r * a.cos(), r * a.sin(), 0.4 * b.sin()).as_vec3()
    };
    let mut triangles = vec![];
    for i in 0..rings {
        for j in 0..sides {
            let [a, b, c, d] = [
                point(i, j),
                point(i + 1, j),
                point(i + 1, j + 1),
                point(i, j + 1),
            ];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let inside = |r: &mut Random| {
        let (a, s) = (r.unit() * TAU, r.cube() * 0.15);
        DVec3::new((1.0 + s.x) * a.cos(), (1.0 + s.x) * a.sin(), s.z)
    };
    Closed {
        name: "torus",
        triangles,
        inside,
    }
}

/// An axis-aligned cube from -1 to 1, each face of n × n squares: all boxes are flat.
pub fn cube(n: usize) -> Closed {
    let mut triangles = vec![];
    let at = |i: usize| i as f32 / n as f32 * 2.0 - 1.0;
    for axis in 0..3 {
        for side in [-1.0f32, 1.0] {
            let point = |i: usize, j: usize| {
                let mut p = [0.0; 3];
                p[axis] = side;
                p[(axis + 1) % 3] = at(i);
                p[(axis + 2) % 3] = at(j);
                Vec3::from_array(p)
            };
            for i in 0..n {
                for j in 0..n {
                    let [a, b, c, d] = [
                        point(i, j),
                        point(i + 1, j),
                        point(i + 1, j + 1),
                        point(i, j + 1),
                    ];
                    let quad = [[a, b, c], [a, c, d]];
                    triangles.extend(if side > 0.0 {
                        quad
                    } else {
                        quad.map(|[a, b, c]| [a, c, b])
                    });
                }
            }
        }
    }
    Closed {
        name: "cube",
        triangles,
        inside: |r| r.cube() * 0.9,
    }
}

/// Targets of the rays in a leak test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// Anywhere.
    Random,
    /// At a point of an edge.
    Edge,
    /// At a vertex.
    Vertex,
    /// Along the surface: from just inside, nearly in the plane of a triangle.
    Grazing,
    /// At a vertex from a point that shares one coordinate with it: one direction component is
    /// zero.
    Axis,
}

pub const AIMS: [Aim; 5] = [Aim::Random, Aim::Edge, Aim::Vertex, Aim::Grazing, Aim::Axis];

/// A ray from inside `mesh`, translated and scaled like its triangles.
pub fn inside_ray(
    mesh: &Closed,
    moved: &[[Vec3; 3]],
    place: Place,
    aim: Aim,
    r: &mut Random,
) -> Ray {
    let mut origin = place.apply((mesh.inside)(r));
    let [a, b, c] = moved[r.below(moved.len())];
    let direction = match aim {
        Aim::Random => r.direction().as_vec3(),
        Aim::Edge => a.lerp(b, r.unit() as f32) - origin,
        Aim::Vertex => a - origin,
        Aim::Grazing => {
            // A tenth of the triangle's size inside its plane, in a direction along the plane.
            let centre = (a + b + c) / 3.0;
            let normal = (b - a)
                .as_dvec3()
                .cross((c - a).as_dvec3())
                .normalize()
                .as_vec3();
            origin = centre - normal * (b - a).length() * 0.1;
            let along = a.lerp(b, r.unit() as f32) - centre;
            along + normal * (along.length() * 1e-3 * r.unit() as f32)
        }
        Aim::Axis => {
            let axis = r.below(3);
            let target = if origin[axis] != a[axis] { a } else { b };
            // The origin takes one coordinate of the vertex if that stays inside; half-way towards
            // it on the others.
            let mut d = target - origin;
            d[axis] = 0.0;
            if r.below(4) == 0 {
                d[(axis + 1) % 3] = 0.0;
                d[(axis + 2) % 3] = if r.below(2) == 0 {
                    place.scale as f32
                } else {
                    -place.scale as f32
                };
            }
            if d == Vec3::ZERO { Vec3::X } else { d }
        }
    };
    ray(origin, direction)
}

/// Scale, then translation.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub scale: f64,
    pub offset: f64,
}

pub const PLACES: [Place; 5] = [
    Place {
        scale: 1.0,
        offset: 0.0,
    },
    Place {
        scale: 1.0,
        offset: 1e4,
    },
    Place {
        scale: 1e3,
        offset: 0.0,
    },
    Place {
        scale: 1e-3,
        offset: 0.0,
    },
    Place {
        scale: 1e3,
        offset: 1e4,
    },
];

impl Place {
    pub fn apply(self, p: DVec3) -> Vec3 {
        (p * self.scale + DVec3::new(1.0, -0.7, 0.3) * self.offset).as_vec3()
    }

    /// The transformed mesh, without triangles that rounding made flat.
    pub fn mesh(self, mesh: &Closed) -> Vec<[Vec3; 3]> {
        mesh.triangles
            .iter()
            .map(|t| t.map(|p| self.apply(p.as_dvec3())))
            .collect()
    }
}

/// Skips triangles whose index is not a multiple of three.
pub struct EveryThird;

impl HitFilter for EveryThird {
    fn accept(&self, triangle: u32, _: f32, _: f32, _: &Ray) -> bool {
        triangle.is_multiple_of(3)
    }
}
