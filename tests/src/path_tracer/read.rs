//! Reads the `.glb` files of this project, and refuses what the path tracer does not model.

use glam::{DMat4, DQuat, DVec2, DVec3};
use serde_json::Value;

use super::scene::{Light, Scene, Surface, Triangle};

type Result<T> = std::result::Result<T, String>;

const FLOAT: u64 = 5126;
const UNSIGNED_SHORT: u64 = 5123;
const UNSIGNED_INT: u64 = 5125;

/// Node depth beyond which a file is assumed to have a cycle.
const DEEPEST: usize = 64;

impl Scene {
    /// Reads a binary glTF 2.0: float positions, u16 or u32 indices, triangle lists, node
    /// transforms, base colour and emission factors, punctual lights, and lightmap coordinates if a
    /// bake has written them. The sky is black.
    ///
    /// Zero-area triangles are dropped. A mirroring scale keeps fronts outside, as glTF requires.
    ///
    /// # Errors
    /// A sentence, for a file that is invalid or contains anything that affects light and is not
    /// modelled here: textures on surfaces, vertex colours, alpha, sparse or quantised accessors,
    /// skins, morph targets, ranges and radii of lights, required extensions. Nothing is guessed.
    pub fn from_glb(bytes: &[u8]) -> Result<Scene> {
        let file = File::parse(bytes)?;
        if let Some(required) = file.json["extensionsRequired"].as_array()
            && !required.is_empty()
        {
            return Err(format!("the file requires {required:?}"));
        }
        let mut surfaces = list(&file.json, "materials")
            .iter()
            .map(surface)
            .collect::<Result<Vec<_>>>()?;
        // The surface of primitives without a material.
        surfaces.push(surface(&Value::Object(serde_json::Map::new()))?);
        let mut scene = Scene {
            surfaces,
            nodes: list(&file.json, "nodes")
                .iter()
                .map(|n| n["name"].as_str().unwrap_or_default().to_owned())
                .collect(),
            ..Scene::default()
        };
        let number = file.json["scene"].as_u64().unwrap_or(0);
        let roots = &at(&file.json, "scenes", Some(number))?["nodes"];
        for root in roots.as_array().map_or(&[][..], Vec::as_slice) {
            file.node(&mut scene, root.as_u64(), DMat4::IDENTITY, 0)?;
        }
        Ok(scene)
    }
}

struct File<'a> {
    json: Value,
    bin: &'a [u8],
}

fn list<'v>(json: &'v Value, key: &str) -> &'v [Value] {
    json[key].as_array().map_or(&[], Vec::as_slice)
}

fn at<'v>(json: &'v Value, key: &str, index: Option<u64>) -> Result<&'v Value> {
    let index = index.ok_or_else(|| format!("an index into {key} is missing"))?;
    list(json, key)
        .get(index as usize)
        .ok_or_else(|| format!("{key}[{index}] is not there"))
}

/// Up to three numbers, the missing ones from `default`.
fn vec3(value: &Value, default: DVec3) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|k| {
        value[k].as_f64().unwrap_or(default[k])
    }))
}

fn surface(material: &Value) -> Result<Surface> {
    let name = material["name"].as_str().unwrap_or("without a name");
    let pbr = &material["pbrMetallicRoughness"];
    if !pbr["baseColorTexture"].is_null() || !material["emissiveTexture"].is_null() {
        return Err(format!("material {name} has a texture"));
    }
    if material["alphaMode"].as_str().unwrap_or("OPAQUE") != "OPAQUE" {
        return Err(format!("material {name} is not opaque"));
    }
    let strength = &material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"];
    Ok(Surface {
        reflectance: vec3(&pbr["baseColorFactor"], DVec3::ONE),
        emission: vec3(&material["emissiveFactor"], DVec3::ZERO) * strength.as_f64().unwrap_or(1.0),
        double_sided: material["doubleSided"].as_bool().unwrap_or(false),
    })
}

impl File<'_> {
    fn parse(bytes: &[u8]) -> Result<File<'_>> {
        let word = |at: usize| -> Result<usize> {
            let b = bytes.get(at..at + 4).and_then(|b| b.try_into().ok());
            Ok(u32::from_le_bytes(b.ok_or("the file is cut off")?) as usize)
        };
        if word(0)? != 0x4654_6C67 || word(4)? != 2 {
            return Err("not a binary glTF 2".into());
        }
        let end = 20 + word(12)?;
        let text = bytes.get(20..end).ok_or("the JSON chunk is cut off")?;
        let json = serde_json::from_slice(text).map_err(|e| e.to_string())?;
        let bin = if end + 8 <= bytes.len() {
            bytes
                .get(end + 8..end + 8 + word(end)?)
                .ok_or("the binary chunk is cut off")?
        } else {
            &[]
        };
        Ok(File { json, bin })
    }

    /// The elements of an accessor, `width` numbers each.
    fn accessor(&self, index: &Value, kind: &str, width: usize) -> Result<Vec<f64>> {
        let accessor = at(&self.json, "accessors", index.as_u64())?;
        if accessor["type"] != kind
            || !accessor["sparse"].is_null()
            || accessor["normalized"] == true
        {
            return Err(format!("accessor {index} is not a plain {kind}"));
        }
        let view = at(&self.json, "bufferViews", accessor["bufferView"].as_u64())?;
        let component = accessor["componentType"].as_u64().unwrap_or(0);
        let size = match component {
            FLOAT | UNSIGNED_INT => 4,
            UNSIGNED_SHORT => 2,
            other => return Err(format!("accessor {index} has components of type {other}")),
        };
        let number = |v: &Value, default: usize| v.as_u64().map_or(default, |n| n as usize);
        let start = number(&view["byteOffset"], 0) + number(&accessor["byteOffset"], 0);
        let stride = number(&view["byteStride"], size * width);
        let count = number(&accessor["count"], 0);
        let mut out = Vec::new();
        for i in 0..count {
            for k in 0..width {
                let from = start + i * stride + k * size;
                let bytes = self
                    .bin
                    .get(from..from + size)
                    .ok_or("an accessor lies outside the file")?;
                out.push(match *bytes {
                    [a, b, c, d] if component == FLOAT => {
                        f64::from(f32::from_le_bytes([a, b, c, d]))
                    }
                    [a, b, c, d] => f64::from(u32::from_le_bytes([a, b, c, d])),
                    [a, b] => f64::from(u16::from_le_bytes([a, b])),
                    _ => return Err("a component of no known size".into()),
                });
            }
        }
        Ok(out)
    }

    fn node(
        &self,
        scene: &mut Scene,
        index: Option<u64>,
        parent: DMat4,
        depth: usize,
    ) -> Result<()> {
        let node = at(&self.json, "nodes", index)?;
        if depth > DEEPEST {
            return Err("nodes go round in a circle".into());
        }
        if !node["skin"].is_null() || !node["extensions"]["EXT_mesh_gpu_instancing"].is_null() {
            return Err("a node has a skin or is instanced".into());
        }
        let to_world = parent * local(node);
        if !node["mesh"].is_null() {
            self.mesh(scene, index.unwrap_or(0) as usize, node, to_world)?;
        }
        let light = &node["extensions"]["KHR_lights_punctual"]["light"];
        if !light.is_null() {
            let lights = &self.json["extensions"]["KHR_lights_punctual"];
            scene
                .lights
                .push(punctual(at(lights, "lights", light.as_u64())?, to_world)?);
        }
        for child in list(node, "children") {
            self.node(scene, child.as_u64(), to_world, depth + 1)?;
        }
        Ok(())
    }

    fn mesh(&self, scene: &mut Scene, node: usize, json: &Value, to_world: DMat4) -> Result<()> {
        let lightmap = &json["extras"]["lightmap"];
        let mesh = at(&self.json, "meshes", json["mesh"].as_u64())?;
        let mirrored = to_world.determinant() < 0.0;
        for primitive in list(mesh, "primitives") {
            let attributes = &primitive["attributes"];
            if primitive["mode"].as_u64().unwrap_or(4) != 4
                || !primitive["targets"].is_null()
                || !attributes["COLOR_0"].is_null()
            {
                return Err(format!(
                    "{}: a primitive is no plain triangle list",
                    scene.nodes[node]
                ));
            }
            let positions = self.accessor(&attributes["POSITION"], "VEC3", 3)?;
            let positions: Vec<DVec3> = positions
                .chunks_exact(3)
                .map(|p| to_world.transform_point3(DVec3::new(p[0], p[1], p[2])))
                .collect();
            let indices: Vec<usize> = if primitive["indices"].is_null() {
                (0..positions.len()).collect()
            } else {
                let indices = self.accessor(&primitive["indices"], "SCALAR", 1)?;
                indices.iter().map(|i| *i as usize).collect()
            };
            let uv = if lightmap.is_null() {
                Vec::new()
            } else {
                self.lightmap_uv(lightmap, attributes)?
            };
            let page = lightmap["page"].as_u64().unwrap_or(0) as usize;
            let default = scene.surfaces.len() - 1;
            let surface = primitive["material"]
                .as_u64()
                .map_or(default, |m| m as usize);
            if surface > default {
                return Err(format!("materials[{surface}] is not there"));
            }
            for t in indices.chunks_exact(3) {
                let order = if mirrored {
                    [t[0], t[2], t[1]]
                } else {
                    [t[0], t[1], t[2]]
                };
                if order
                    .iter()
                    .any(|i| *i >= positions.len() || (!uv.is_empty() && *i >= uv.len()))
                {
                    return Err(format!("{}: an index is out of range", scene.nodes[node]));
                }
                let triangle = Triangle {
                    corners: order.map(|i| positions[i]),
                    surface,
                    node,
                    lightmap: (!uv.is_empty()).then(|| (page, order.map(|i| uv[i]))),
                };
                if triangle.area() > 0.0 {
                    scene.triangles.push(triangle);
                }
            }
        }
        Ok(())
    }

    /// Coordinates on the page: the mesh's own, scaled and moved to the node's rectangle.
    fn lightmap_uv(&self, lightmap: &Value, attributes: &Value) -> Result<Vec<DVec2>> {
        let pair = |v: &Value, default: f64| {
            DVec2::new(
                v[0].as_f64().unwrap_or(default),
                v[1].as_f64().unwrap_or(default),
            )
        };
        let (scale, offset) = (
            pair(&lightmap["scale"], 1.0),
            pair(&lightmap["offset"], 0.0),
        );
        let set = format!("TEXCOORD_{}", lightmap["texCoord"].as_u64().unwrap_or(1));
        let uv = self.accessor(&attributes[set], "VEC2", 2)?;
        Ok(uv
            .chunks_exact(2)
            .map(|p| DVec2::new(p[0], p[1]) * scale + offset)
            .collect())
    }
}

fn local(node: &Value) -> DMat4 {
    if let Some(m) = node["matrix"].as_array() {
        return DMat4::from_cols_array(&std::array::from_fn(|k| {
            m.get(k).and_then(Value::as_f64).unwrap_or(0.0)
        }));
    }
    let q = &node["rotation"];
    let part = |k: usize, default: f64| q[k].as_f64().unwrap_or(default);
    DMat4::from_scale_rotation_translation(
        vec3(&node["scale"], DVec3::ONE),
        DQuat::from_xyzw(part(0, 0.0), part(1, 0.0), part(2, 0.0), part(3, 1.0)).normalize(),
        vec3(&node["translation"], DVec3::ZERO),
    )
}

fn punctual(light: &Value, to_world: DMat4) -> Result<Light> {
    if !light["range"].is_null() {
        return Err("a light has a range".into());
    }
    if !light["extras"]["lumel"]["radius"].is_null() {
        return Err("a light has a radius".into());
    }
    let intensity = vec3(&light["color"], DVec3::ONE) * light["intensity"].as_f64().unwrap_or(1.0);
    let position = to_world.transform_point3(DVec3::ZERO);
    let direction = to_world.transform_vector3(DVec3::NEG_Z).normalize();
    let cone = |key: &str, default: f64| light["spot"][key].as_f64().unwrap_or(default);
    match light["type"].as_str() {
        Some("point") => Ok(Light::Point {
            position,
            intensity,
        }),
        Some("spot") => Ok(Light::Spot {
            position,
            direction,
            intensity,
            inner: cone("innerConeAngle", 0.0),
            outer: cone("outerConeAngle", std::f64::consts::FRAC_PI_4),
        }),
        Some("directional") => Ok(Light::Directional {
            direction,
            irradiance: intensity,
            radius: 0.5
                * light["extras"]["lumel"]["angle"]
                    .as_f64()
                    .unwrap_or(0.0)
                    .to_radians(),
        }),
        other => Err(format!("a light of type {other:?}")),
    }
}
