//! A level under construction: its contents, and the data needed to place cameras.

use glam::{DVec3, Quat, Vec3};
use serde_json::json;

use super::random::{Random, sin_cos};
use super::{Level, Size};
use crate::geometry::Geometry;
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};
use crate::path_tracer::Triangle;

/// Lumels per metre of small levels: tens of thousands in total, which take a draft one or two
/// seconds.
const SMALL_DENSITY: f32 = 10.0;

/// A mesh that can be placed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mesh(usize);

/// Properties of a material that rays need.
#[derive(Debug, Clone, Copy)]
pub(super) struct Paint {
    pub double_sided: bool,
    pub emits: bool,
    pub textured: bool,
}

/// A box in which a camera may stand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Space {
    pub min: Vec3,
    pub max: Vec3,
}

/// Where a mesh goes; [`Place::default`] is the origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub at: Vec3,
    /// Degrees about +Y.
    pub turn: f32,
    pub scale: Vec3,
}

impl Default for Place {
    fn default() -> Place {
        Place {
            at: Vec3::ZERO,
            turn: 0.0,
            scale: Vec3::ONE,
        }
    }
}

/// At `at`, turned by `turn` degrees.
pub(super) fn place(at: Vec3, turn: f32) -> Place {
    Place {
        at,
        turn,
        ..Place::default()
    }
}

/// A level under construction.
pub(super) struct Kit {
    pub b: GltfBuilder,
    pub rng: Random,
    pub size: Size,
    /// Radiance of the sky.
    pub sky: Option<[f32; 3]>,
    /// Direction in which sunlight travels.
    pub sun: Option<Vec3>,
    pub spaces: Vec<Space>,
    /// Whether backs of nodes count as the inside of something when placing cameras. False for
    /// shells that people walk in.
    pub solid: bool,
    pub paints: Vec<Paint>,
    /// World triangles; `surface` is an index into `paints`, `node` one into `solids`.
    pub soup: Vec<Triangle>,
    pub solids: Vec<bool>,
    /// Points slightly in front of emitting surfaces.
    pub lamps: Vec<DVec3>,
    meshes: Vec<Vec<(Geometry, usize)>>,
    indices: Vec<usize>,
}

impl Kit {
    pub fn new(rng: Random, size: Size) -> Kit {
        Kit {
            b: GltfBuilder::new(),
            rng,
            size,
            sky: None,
            sun: None,
            spaces: Vec::new(),
            solid: true,
            paints: Vec::new(),
            soup: Vec::new(),
            solids: Vec::new(),
            lamps: Vec::new(),
            meshes: Vec::new(),
            indices: Vec::new(),
        }
    }

    pub fn small(&self) -> bool {
        self.size == Size::Small
    }

    /// `small` in a small level, else drawn from `full`.
    pub fn count(&mut self, small: u32, full: [u32; 2]) -> u32 {
        if self.small() {
            small
        } else {
            self.rng.int(full[0], full[1])
        }
    }

    /// Adds any material.
    pub fn material(&mut self, m: &Material) -> usize {
        self.paints.push(Paint {
            double_sided: m.double_sided,
            emits: m.emission != [0.0; 3],
            textured: m.texture.is_some(),
        });
        self.b.material(m)
    }

    /// A plain single-sided paint.
    pub fn paint(&mut self, name: &str, rho: [f32; 3]) -> usize {
        self.material(&Material::diffuse(name, rho))
    }

    /// A plain paint with or without a back.
    pub fn paint_sided(&mut self, name: &str, rho: [f32; 3], double_sided: bool) -> usize {
        self.material(&Material {
            double_sided,
            ..Material::diffuse(name, rho)
        })
    }

    /// A lamp's surface of this radiance.
    pub fn glow(&mut self, name: &str, radiance: [f32; 3]) -> usize {
        self.material(&Material::emitter(name, radiance, [0.4; 3]))
    }

    /// A mesh to be placed, one primitive per material; parts with the same material become one.
    pub fn mesh(&mut self, name: &str, parts: &[(Geometry, usize)]) -> Mesh {
        let mut joined: Vec<(Geometry, usize)> = Vec::new();
        for (g, m) in parts {
            let mut g = g.clone();
            if g.uv1.is_empty() && !self.paints[*m].textured {
                g.uv.clear();
            }
            match joined.iter_mut().find(|(_, other)| other == m) {
                Some((all, _)) => {
                    all.append(&g);
                }
                None => joined.push((g, *m)),
            }
        }
        let list: Vec<(&Geometry, usize)> = joined.iter().map(|(g, m)| (g, *m)).collect();
        self.indices.push(self.b.mesh(name, &list));
        self.meshes.push(joined);
        Mesh(self.meshes.len() - 1)
    }

    /// An instance.
    pub fn put(&mut self, name: &str, mesh: Mesh, to: Place) {
        let (s, c) = sin_cos(to.turn / 2.0);
        let rotation = if to.turn == 0.0 {
            Quat::IDENTITY
        } else {
            Quat::from_xyzw(0.0, s, 0.0, c)
        };
        let index = self.indices[mesh.0];
        self.b.node(Node {
            translation: to.at,
            rotation,
            scale: to.scale,
            ..Node::of_mesh(name, index)
        });
        self.solids.push(self.solid);
        let node = self.solids.len() - 1;
        let mirrored = to.scale.x * to.scale.y * to.scale.z < 0.0;
        let mut soup = Vec::new();
        for (g, material) in &self.meshes[mesh.0] {
            for t in &g.triangles {
                let mut corners = t.map(|i| {
                    let p = g.positions[i as usize] * to.scale;
                    (rotation * p + to.at).as_dvec3()
                });
                if mirrored {
                    corners.swap(1, 2);
                }
                soup.push(Triangle {
                    corners,
                    surface: *material,
                    node,
                    lightmap: None,
                });
            }
        }
        for t in soup {
            if t.area() <= 1e-12 {
                continue;
            }
            if self.paints[t.surface].emits {
                self.lamps.push(t.at(0.33, 0.33) + t.normal() * 0.02);
            }
            self.soup.push(t);
        }
    }

    /// A mesh with one node at the origin.
    pub fn part(&mut self, name: &str, g: &Geometry, material: usize) {
        self.item(name, &[(g.clone(), material)], Place::default());
    }

    /// A mesh with one node.
    pub fn item(&mut self, name: &str, parts: &[(Geometry, usize)], to: Place) {
        let mesh = self.mesh(name, parts);
        self.put(name, mesh, to);
    }

    /// Cameras may stand between these corners.
    pub fn space(&mut self, min: Vec3, max: Vec3) {
        self.spaces.push(Space { min, max });
    }

    /// A sun whose light travels along `direction`, with a disc of `angle` degrees (0 for parallel
    /// light).
    pub fn add_sun(&mut self, direction: Vec3, lux: [f32; 3], angle: f32) {
        let light = self.b.light("sun", Light::Directional(lux));
        if angle > 0.0 {
            self.b.light_json(light)["extras"] =
                json!({"lumel": {"angle": f64::from((angle * 100.0).round()) / 100.0}});
        }
        self.b.node(Node {
            name: "sun".into(),
            rotation: look_along(direction, Vec3::Y),
            light: Some(light),
            ..Node::default()
        });
        self.sun = Some(direction.normalize());
    }

    /// A lamp without extent.
    pub fn add_lamp(&mut self, name: &str, at: Vec3, along: Vec3, light: Light) {
        let index = self.b.light(name, light);
        self.b.node(Node {
            name: name.into(),
            translation: at,
            rotation: look_along(along, Vec3::Y),
            light: Some(index),
            ..Node::default()
        });
        self.lamps.push(at.as_dvec3());
    }

    /// The finished level.
    pub fn finish(mut self) -> Level {
        self.add_views();
        let mut settings = String::new();
        if let Some([r, g, b]) = self.sky {
            settings += &format!("sky = [{r:.3}, {g:.3}, {b:.3}]\n");
        }
        if self.small() {
            // Lumels chosen by the scene's size are as many in a small level as in a large one.
            settings += &format!("texels-per-unit = {SMALL_DENSITY:.1}\n");
        }
        Level {
            glb: self.b.finish(),
            settings,
        }
    }
}
