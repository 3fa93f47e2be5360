//! Building blocks of the leak suite's scenes.

use glam::{Affine3A, Vec3};

use super::LeakScene;
use super::region::{Hull, Kind, Region};
use crate::geometry::{Geometry, cuboid, grid, quad};
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};

/// The axis-parallel box from `min` to `max`, moved by `frame` (rigid), as half-spaces.
pub(super) fn hull(frame: Affine3A, min: Vec3, max: Vec3) -> Hull {
    let mut out = Vec::new();
    for (k, axis) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
        for (side, at) in [(-1.0, min[k]), (1.0, max[k])] {
            if at.abs() < FAR {
                let n = frame.transform_vector3(axis * side).as_dvec3().normalize();
                let p = frame.transform_point3(axis * at).as_dvec3();
                out.push([n.x, n.y, n.z, n.dot(p)]);
            }
        }
    }
    out
}

/// A coordinate beyond which [`hull`] leaves a side open.
pub(super) const FAR: f32 = 1e3;

/// The whole range of an axis.
pub(super) const ALL: [f32; 2] = [-FAR, FAR];

/// [`hull`] of ranges along x, y and z, in world space.
pub(super) fn span(x: [f32; 2], y: [f32; 2], z: [f32; 2]) -> Hull {
    span_in(Affine3A::IDENTITY, x, y, z)
}

/// The same in `frame`.
pub(super) fn span_in(frame: Affine3A, x: [f32; 2], y: [f32; 2], z: [f32; 2]) -> Hull {
    let at = |k: usize| Vec3::new(x[k], y[k], z[k]);
    hull(frame, at(0), at(1))
}

/// Rotated about the y axis by `degrees`, then moved.
pub(super) fn turned(degrees: f32, to: Vec3) -> Affine3A {
    let turn = glam::Quat::from_rotation_y(degrees.to_radians());
    Affine3A::from_rotation_translation(turn, to)
}

/// A box of `min` to `max` in `frame`, fronts outside.
pub(super) fn block(frame: Affine3A, min: [f32; 3], max: [f32; 3]) -> Geometry {
    cuboid(min.into(), max.into(), 1).transformed(frame)
}

/// A scene under construction, all in one paint.
pub(super) struct Kit {
    b: GltfBuilder,
    paint: usize,
    both: usize,
    regions: Vec<Region>,
}

impl Kit {
    /// Reflectance 0.7.
    pub fn new() -> Kit {
        Kit::of_reflectance(0.7)
    }

    pub fn of_reflectance(rho: f32) -> Kit {
        Kit::painted(Material::diffuse("paint", [rho; 3]))
    }

    /// A kit whose surfaces reflect half of the light and emit as much: in a closed space all
    /// radiance is 1, and E = π.
    pub fn furnace() -> Kit {
        Kit::painted(Material::emitter("paint", [0.5; 3], [0.5; 3]))
    }

    fn painted(plain: Material) -> Kit {
        let mut b = GltfBuilder::new();
        let paint = b.material(&plain);
        let both = b.material(&Material {
            name: "both".into(),
            double_sided: true,
            ..plain
        });
        Kit {
            b,
            paint,
            both,
            regions: Vec::new(),
        }
    }

    /// A single-sided node.
    pub fn part(&mut self, name: &str, g: &Geometry) -> &mut Self {
        let mesh = self.b.mesh(name, &[(g, self.paint)]);
        self.b.node(Node::of_mesh(name, mesh));
        self
    }

    /// A double-sided node.
    pub fn sheet(&mut self, name: &str, g: &Geometry) -> &mut Self {
        let mesh = self.b.mesh(name, &[(g, self.both)]);
        self.b.node(Node::of_mesh(name, mesh));
        self
    }

    /// A mesh to be placed several times.
    pub fn mesh(&mut self, name: &str, g: &Geometry) -> usize {
        self.b.mesh(name, &[(g, self.paint)])
    }

    /// An instance of a mesh.
    pub fn place(&mut self, name: &str, mesh: usize, degrees: f32, to: Vec3) -> &mut Self {
        self.b.node(Node {
            translation: to,
            rotation: glam::Quat::from_rotation_y(degrees.to_radians()),
            ..Node::of_mesh(name, mesh)
        });
        self
    }

    /// A rectangular lamp of radiance 10 W/(m² sr) around `middle` that shines down and reflects
    /// nothing; `half` is half of its sides along x and z.
    pub fn lamp(&mut self, middle: Vec3, half: [f32; 2]) -> &mut Self {
        let [x, z] = [Vec3::X * half[0], Vec3::Z * half[1]];
        let glow = Material::emitter("lamp", [10.0; 3], [0.0; 3]);
        let glow = self.b.material(&glow);
        let panel = quad([
            middle - x - z,
            middle + x - z,
            middle + x + z,
            middle - x + z,
        ]);
        let mesh = self.b.mesh("lamp", &[(&panel, glow)]);
        self.b.node(Node::of_mesh("lamp", mesh));
        self
    }

    /// Parallel light of 10 W/m² that travels along `direction`.
    pub fn sun(&mut self, direction: Vec3) -> &mut Self {
        let sun = self.b.light("sun", Light::Directional([10.0; 3]));
        self.b.node(Node {
            name: "sun".into(),
            rotation: look_along(direction, Vec3::Y),
            light: Some(sun),
            ..Node::default()
        });
        self
    }

    /// A point light of 1 W/sr.
    pub fn point(&mut self, at: Vec3) -> &mut Self {
        let light = self.b.light("point", Light::Point([1.0; 3]));
        self.b.node(Node {
            name: "point".into(),
            translation: at,
            light: Some(light),
            ..Node::default()
        });
        self
    }

    /// The inside of a box as three single-sided nodes: `floor`, `ceiling` and `walls`.
    pub fn shell(&mut self, min: [f32; 3], max: [f32; 3]) -> &mut Self {
        let [a, b, floor, ceiling, c, d] =
            crate::geometry::box_faces(min.into(), max.into(), 1).map(Geometry::flipped);
        self.part("floor", &floor).part("ceiling", &ceiling);
        self.part("walls", &Geometry::union(&[a, b, c, d]))
    }

    /// A level square ground at `y` that extends `half` metres to each side.
    pub fn ground(&mut self, half: f32, y: f32) -> &mut Self {
        let corner = Vec3::new(-half, y, half);
        let g = grid(corner, Vec3::X * 2.0 * half, Vec3::Z * -2.0 * half, [1, 1]);
        self.part("ground", &g)
    }

    /// Declares the light of `node` inside `within`.
    pub fn region(&mut self, kind: Kind, node: &str, within: Hull) -> &mut Self {
        self.regions.push(Region {
            node: node.into(),
            kind,
            facing: None,
            within,
            without: Vec::new(),
        });
        self
    }

    /// Restricts the last region to faces that face along `direction`.
    pub fn facing(&mut self, direction: Vec3) -> &mut Self {
        self.last().facing = Some(direction.as_dvec3().normalize());
        self
    }

    /// Excludes `hulls` from the last region.
    pub fn without(&mut self, hulls: impl IntoIterator<Item = Hull>) -> &mut Self {
        self.last().without.extend(hulls);
        self
    }

    /// Cuts the regions that `which` selects by a half-space.
    pub fn narrow(&mut self, which: impl Fn(&Region) -> bool, plane: [f64; 4]) -> &mut Self {
        for r in self.regions.iter_mut().filter(|r| which(r)) {
            r.within.push(plane);
        }
        self
    }

    fn last(&mut self) -> &mut Region {
        self.regions.last_mut().expect("a region was added")
    }

    /// The scene, at 8 lumels a metre and without a sky.
    pub fn finish(self, name: &'static str, what: &'static str) -> LeakScene {
        LeakScene {
            name,
            what,
            glb: self.b.finish(),
            sky: 0.0,
            texels_per_unit: 8.0,
            regions: self.regions,
            shared_lumels: false,
            even: None,
            received: None,
        }
    }
}
