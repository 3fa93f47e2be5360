//! Scenes that tests build from panels and lamps.

use glam::{Vec2, Vec3};
use serde_json::{Value, json};

use crate::geometry::{box_faces, grid};
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};

/// A document under construction with a black material. Everything is in metres and in world space.
#[derive(Debug, Clone)]
pub struct Stage {
    /// The document's builder.
    pub builder: GltfBuilder,
    /// The index of a black, single-sided material.
    pub black: usize,
}

impl Default for Stage {
    fn default() -> Self {
        let mut builder = GltfBuilder::new();
        let black = builder.material(&Material::diffuse("black", [0.0; 3]));
        Stage { builder, black }
    }
}

impl Stage {
    /// An empty stage.
    pub fn new() -> Stage {
        Stage::default()
    }

    /// A parallelogram `origin + s·u + t·v` with its front along u × v, as a node of this name. Its
    /// uv are (s, t).
    pub fn panel(&mut self, name: &str, [origin, u, v]: [Vec3; 3], material: usize) -> &mut Stage {
        self.node_with_panel(name, [origin, u, v], material, None)
    }

    /// The same as an occluder (`extras.lumel.occluder`), which only casts shadows, from both
    /// sides.
    pub fn blocker(&mut self, panel: [Vec3; 3]) -> &mut Stage {
        let material = self.builder.material(&Material {
            double_sided: true,
            ..Material::diffuse("blocker", [0.0; 3])
        });
        let extras = Some(json!({"lumel": {"occluder": true}}));
        self.node_with_panel("blocker", panel, material, extras)
    }

    fn node_with_panel(
        &mut self,
        name: &str,
        [origin, u, v]: [Vec3; 3],
        material: usize,
        extras: Option<Value>,
    ) -> &mut Stage {
        let mut g = grid(origin, u, v, [1, 1]);
        g.normals.clear();
        g.uv = (g.positions.iter())
            .map(|p| {
                let d = *p - origin;
                Vec2::new(d.dot(u) / u.length_squared(), d.dot(v) / v.length_squared())
            })
            .collect();
        let mesh = self.builder.mesh(name, &[(&g, material)]);
        self.builder.node(Node {
            extras,
            ..Node::of_mesh(name, mesh)
        });
        self
    }

    /// A black floor at y = 0 that faces up, over x and z from `low` to `high`, as node `floor`.
    pub fn floor(&mut self, low: Vec2, high: Vec2) -> &mut Stage {
        let size = high - low;
        let origin = Vec3::new(low.x, 0.0, low.y);
        let panel = [origin, Vec3::Z * size.y, Vec3::X * size.x];
        self.panel("floor", panel, self.black)
    }

    /// A box whose faces face outwards, each a node: `-x`, `+x`, `-y`, `+y`, `-z`, `+z`.
    pub fn cube(&mut self, low: Vec3, high: Vec3, material: usize) -> &mut Stage {
        self.faces(low, high, material, false)
    }

    /// A closed room whose faces face inwards; each is named after its side, like those of
    /// [`Stage::cube`].
    pub fn room(&mut self, low: Vec3, high: Vec3, material: usize) -> &mut Stage {
        self.faces(low, high, material, true)
    }

    fn faces(&mut self, low: Vec3, high: Vec3, material: usize, inside: bool) -> &mut Stage {
        let names = ["-x", "+x", "-y", "+y", "-z", "+z"];
        for (name, face) in names.into_iter().zip(box_faces(low, high, 1)) {
            let face = if inside { face.flipped() } else { face };
            let mesh = self.builder.mesh(name, &[(&face.bare(), material)]);
            self.builder.node(Node::of_mesh(name, mesh));
        }
        self
    }

    /// A lamp at `at` that shines along `along`; members of `more` are added to its definition
    /// (`range`, `extras`). Its name is that of its node.
    pub fn lamp(
        &mut self,
        name: &str,
        light: Light,
        [at, along]: [Vec3; 2],
        more: Value,
    ) -> &mut Stage {
        let index = self.builder.light(name, light);
        if let Value::Object(more) = more {
            for (key, value) in more {
                self.builder.light_json(index)[key] = value;
            }
        }
        self.builder.node(Node {
            name: name.into(),
            translation: at,
            rotation: look_along(along, Vec3::Y),
            light: Some(index),
            ..Node::default()
        });
        self
    }

    /// The document as GLB bytes.
    pub fn finish(&self) -> Vec<u8> {
        self.builder.clone().finish()
    }
}
