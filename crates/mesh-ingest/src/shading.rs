//! Optical properties at a point of the soup: reflectance, transparency, emission, shading normal.
//!
//! Textures are decoded from sRGB per texel and then filtered, as the glTF specification requires
//! (glTF 2.0, §3.9.2).

use std::sync::LazyLock;

use glam::{Affine2, DVec3, Vec2, Vec3, Vec4, Vec4Swizzles};

use crate::scene::{AlphaMode, Image, Material, Primitive, Scene, TextureRef, Wrap};
use crate::soup::Soup;

/// sRGB byte to linear (IEC 61966-2-1).
pub(crate) static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let x = i as f64 / 255.0;
        (if x <= 0.04045 {
            x / 12.92
        } else {
            libm::pow((x + 0.055) / 1.055, 2.4)
        }) as f32
    })
});

/// An sRGB byte as linear light, 0..=1.
pub(crate) fn srgb_to_linear(byte: u8) -> f32 {
    SRGB[usize::from(byte)]
}

/// Maps a soup triangle to its primitive: local vertices in the order of the *world* corners.
struct Lookup<'a> {
    primitive: &'a Primitive,
    vertices: [usize; 3],
}

impl Lookup<'_> {
    fn weights(u: f32, v: f32) -> Vec3 {
        Vec3::new(1.0 - u - v, u, v)
    }

    fn tex_coord(&self, set: usize, u: f32, v: f32) -> Vec2 {
        match self
            .primitive
            .tex_coords
            .get(set)
            .filter(|set| !set.is_empty())
        {
            None => Vec2::ZERO,
            Some(set) => {
                let ([a, b, c], w) = (self.vertices, Self::weights(u, v));
                set[a] * w.x + set[b] * w.y + set[c] * w.z
            }
        }
    }

    fn color(&self, u: f32, v: f32) -> Vec4 {
        if self.primitive.colors.is_empty() {
            return Vec4::ONE;
        }
        let [a, b, c] = self.vertices.map(|i| self.primitive.colors[i]);
        let w = Self::weights(u, v);
        a * w.x + b * w.y + c * w.z
    }
}

impl Scene {
    fn lookup(&self, soup: &Soup, tri: u32) -> Lookup<'_> {
        let source = soup.source(tri);
        let mesh = self.instances[source.instance as usize].mesh;
        let primitive = &self.meshes[mesh].primitives[source.primitive as usize];
        let [a, b, c] = primitive.triangles[source.triangle as usize].map(|i| i as usize);
        Lookup {
            primitive,
            vertices: if source.mirrored {
                [a, c, b]
            } else {
                [a, b, c]
            },
        }
    }

    fn material_of(&self, soup: &Soup, tri: u32) -> &Material {
        &self.materials[soup.material(tri) as usize]
    }

    /// Whether soup triangle `tri` is an occluder: it reflects, emits and receives no light
    /// ([`Material::occluder_only`], [`crate::Instance::occluder`]).
    pub fn only_occludes(&self, soup: &Soup, tri: u32) -> bool {
        let instance = soup.source(tri).instance;
        self.material_of(soup, tri).occluder_only || self.instances[instance as usize].occluder
    }

    /// Reflectance (linear RGB, 0..=1) and alpha (0..=1) at a point of soup triangle `tri`: base
    /// colour × base texture × `COLOR_0`, at most [`Material::max_reflectance`] in each channel;
    /// black if the triangle is an occluder.
    ///
    /// `u` and `v` are the barycentric weights of the triangle's world corners 1 and 2. `tri` may
    /// be any face, including duplicates.
    pub fn base_color(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec4 {
        let material = self.material_of(soup, tri);
        let color = self.color(soup, tri, u, v);
        if self.only_occludes(soup, tri) {
            return Vec4::new(0.0, 0.0, 0.0, color.w);
        }
        color.min(Vec3::splat(material.max_reflectance).extend(1.0))
    }

    /// Tint of transmitted light. It is not a reflectance, so the limit does not apply.
    fn unclamped_color(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec3 {
        self.color(soup, tri, u, v).xyz()
    }

    fn color(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec4 {
        let material = self.material_of(soup, tri);
        let lookup = self.lookup(soup, tri);
        let mut color = material.base_color;
        if !lookup.primitive.colors.is_empty() {
            color *= lookup.color(u, v);
        }
        if let Some(texture) = &material.base_texture {
            color *= self.sample(texture, lookup.tex_coord(texture.tex_coord, u, v));
        }
        // Barycentric weights may leave 0..=1 by rounding.
        color.clamp(Vec4::ZERO, Vec4::ONE)
    }

    /// Radiance emitted at a point by the triangle's emitting sides (units of
    /// [`Material::emissive`]); `u`, `v` as in [`Scene::base_color`].
    pub fn emission(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec3 {
        let material = self.material_of(soup, tri);
        // Most surfaces are not emissive; the early exit avoids lookups for them.
        if material.emissive == Vec3::ZERO || self.only_occludes(soup, tri) {
            return Vec3::ZERO;
        }
        match &material.emissive_texture {
            Some(texture) => {
                let uv = self.lookup(soup, tri).tex_coord(texture.tex_coord, u, v);
                (material.emissive * self.sample(texture, uv).xyz()).max(Vec3::ZERO)
            }
            _ => material.emissive,
        }
    }

    /// [`Scene::emission`] times presence: the mean emission of a piece of the surface.
    pub fn emitted(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec3 {
        let radiance = self.emission(soup, tri, u, v);
        if self.needs_alpha(soup.materials[tri as usize]) {
            radiance * self.presence(soup, tri, u, v)
        } else {
            radiance
        }
    }

    /// Base colour factor × `COLOR_0` at a point, i.e. the factor of the base texture.
    pub(crate) fn untextured_color(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec3 {
        let color = self.lookup(soup, tri).color(u, v);
        (self.material_of(soup, tri).base_color * color).xyz()
    }

    /// Transformed coordinates of `texture` at the triangle's world corners 0, 1 and 2.
    pub(crate) fn texture_corners(&self, soup: &Soup, tri: u32, texture: &TextureRef) -> [Vec2; 3] {
        let lookup = self.lookup(soup, tri);
        WHOLE.map(|p| {
            let uv = lookup.tex_coord(texture.tex_coord, p.x, p.y);
            texture.transform.transform_point2(uv)
        })
    }

    /// The red channel of a transmission texture at a transformed coordinate.
    pub(crate) fn transmission_texel(&self, texture: &TextureRef, uv: Vec2) -> f32 {
        let untransformed = TextureRef {
            transform: Affine2::IDENTITY,
            ..texture.clone()
        };
        match self.images.get(texture.image) {
            Some(Some(image)) => filtered(image, &untransformed, uv, linear_byte).x,
            _ => 1.0,
        }
    }

    /// Whether rays must evaluate [`Scene::transmittance`] or [`Scene::presence`] at triangles of
    /// this material.
    pub fn needs_alpha(&self, material: u32) -> bool {
        self.materials[material as usize].lets_light_through()
    }

    /// Fraction of light, 0..=1 per channel, that passes straight through the triangle at a point.
    ///
    /// With coverage α (1 if opaque, 0 or 1 for `MASK`, alpha for `BLEND`), transmission τ and base
    /// colour c it is (1 − α) + α τ c: uncovered parts pass everything, and glass tints what it
    /// passes.
    pub fn transmittance(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec3 {
        let coverage = self.coverage(soup, tri, u, v);
        let open = Vec3::splat(1.0 - coverage);
        match self.transmission(soup, tri, u, v) {
            0.0 => open,
            t => open + self.unclamped_color(soup, tri, u, v) * (coverage * t),
        }
    }

    /// Fraction of the surface, 0..=1, that reflects at a point: α (1 − τ), see
    /// [`Scene::transmittance`]. The rest transmits or absorbs light.
    pub fn presence(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> f32 {
        self.coverage(soup, tri, u, v) * (1.0 - self.transmission(soup, tri, u, v))
    }

    /// α: the covered fraction of the surface.
    fn coverage(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> f32 {
        match self.material_of(soup, tri).alpha {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask { cutoff } => {
                f32::from(u8::from(self.alpha(soup, tri, u, v) >= cutoff))
            }
            AlphaMode::Blend => self.alpha(soup, tri, u, v),
        }
    }

    /// τ: the fraction of light that glass transmits.
    fn transmission(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> f32 {
        let material = self.material_of(soup, tri);
        match &material.transmission_texture {
            Some(texture) if material.transmission > 0.0 => {
                let uv = self.lookup(soup, tri).tex_coord(texture.tex_coord, u, v);
                let red = match self.images.get(texture.image) {
                    Some(Some(image)) => filtered(image, texture, uv, linear_byte).x,
                    _ => 1.0,
                };
                (material.transmission * red).clamp(0.0, 1.0)
            }
            _ => material.transmission,
        }
    }

    /// The alpha of [`Scene::base_color`], without its colour.
    fn alpha(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> f32 {
        let material = self.material_of(soup, tri);
        let lookup = self.lookup(soup, tri);
        let mut alpha = material.base_color.w * lookup.color(u, v).w;
        if let Some(texture) = &material.base_texture {
            alpha *= self
                .sample(texture, lookup.tex_coord(texture.tex_coord, u, v))
                .w;
        }
        alpha.clamp(0.0, 1.0)
    }

    /// The interpolated vertex normal in world space (unit), on the side of the geometric normal;
    /// the geometric normal if the primitive has no normals or they cancel.
    pub fn shading_normal(&self, soup: &Soup, tri: u32, u: f32, v: f32) -> Vec3 {
        let geometric = soup.normals[tri as usize];
        let lookup = self.lookup(soup, tri);
        if lookup.primitive.normals.is_empty() {
            return geometric;
        }
        let source = soup.sources[tri as usize];
        let m = &self.instances[source.instance as usize].transform.matrix3;
        let [a, b, c] = lookup
            .vertices
            .map(|i| lookup.primitive.normals[i].as_dvec3());
        let w = Lookup::weights(u, v).as_dvec3();
        let local = a * w.x + b * w.y + c * w.z;
        // Cofactors are the inverse transpose times the determinant. This avoids a division, and
        // the sign is fixed below.
        let world: DVec3 = m.y_axis.cross(m.z_axis) * local.x
            + m.z_axis.cross(m.x_axis) * local.y
            + m.x_axis.cross(m.y_axis) * local.z;
        match world.try_normalize() {
            None => geometric,
            Some(n) => {
                let n = n.as_vec3();
                let side = n.dot(geometric);
                // A normal exactly in the surface does not determine the side.
                if side == 0.0 || !n.is_finite() {
                    geometric
                } else {
                    n * side.signum()
                }
            }
        }
    }

    /// Mean of [`Scene::base_color`] over triangle `tri`; see [`Scene::mean_over`].
    pub fn mean_base_color(&self, soup: &Soup, tri: u32, max_samples: u32) -> Vec4 {
        let material = self.material_of(soup, tri);
        if material.base_texture.is_none() && self.lookup(soup, tri).primitive.colors.is_empty() {
            return self.base_color(soup, tri, 0.0, 0.0);
        }
        self.mean_over(soup, tri, WHOLE, max_samples, |u, v| {
            self.base_color(soup, tri, u, v)
        })
    }

    /// Mean of [`Scene::emitted`] over triangle `tri`; see [`Scene::mean_over`].
    pub fn mean_emission(&self, soup: &Soup, tri: u32, max_samples: u32) -> Vec3 {
        let material = self.material_of(soup, tri);
        let even = material.emissive_texture.is_none() && material.alpha == AlphaMode::Opaque;
        if even || material.emissive == Vec3::ZERO {
            return self.emission(soup, tri, 0.0, 0.0);
        }
        self.mean_over(soup, tri, WHOLE, max_samples, |u, v| {
            self.emitted(soup, tri, u, v).extend(0.0)
        })
        .xyz()
    }

    /// Mean of `value(u, v)` over the part of triangle `tri` between the barycentric points
    /// `corners` (weights of world corners 1 and 2).
    ///
    /// Samples the centres of n² equal sub-triangles, with n chosen so that about one falls on each
    /// texel of the finest texture in the part, and n² ≤ max(`max_samples`, 1). Deterministic;
    /// textures finer than the samples are aliased.
    pub fn mean_over(
        &self,
        soup: &Soup,
        tri: u32,
        corners: [Vec2; 3],
        max_samples: u32,
        value: impl Fn(f32, f32) -> Vec4,
    ) -> Vec4 {
        let texels = self.texels_in(soup, tri, corners);
        // Without textures, vertex colours vary linearly, so the centre gives the mean.
        let n = (texels.sqrt().ceil().max(1.0) as u32).min(max_samples.max(1).isqrt());
        let [a, b, c] = corners;
        let (ab, ac) = ((b - a) / n as f32, (c - a) / n as f32);
        let mut sum = Vec4::ZERO;
        for row in 0..n {
            // Separate sums per row reduce rounding.
            let mut row_sum = Vec4::ZERO;
            for column in 0..n - row {
                let at = a + ab * column as f32 + ac * row as f32;
                let centre = at + (ab + ac) / 3.0;
                row_sum += value(centre.x, centre.y);
                if column + row + 1 < n {
                    let centre = at + (ab + ac) * (2.0 / 3.0);
                    row_sum += value(centre.x, centre.y);
                }
            }
            sum += row_sum;
        }
        sum / (n * n) as f32
    }

    /// Area of the part in texels of the triangle's finest texture.
    fn texels_in(&self, soup: &Soup, tri: u32, corners: [Vec2; 3]) -> f32 {
        let material = self.material_of(soup, tri);
        let lookup = self.lookup(soup, tri);
        [&material.base_texture, &material.emissive_texture]
            .into_iter()
            .flatten()
            .filter_map(|texture| {
                let image = self.images.get(texture.image)?.as_ref()?;
                let size = Vec2::new(image.width as f32, image.height as f32);
                let [a, b, c] = corners.map(|p| {
                    texture.transform.transform_point2(lookup.tex_coord(
                        texture.tex_coord,
                        p.x,
                        p.y,
                    )) * size
                });
                let area = 0.5 * (b - a).perp_dot(c - a).abs();
                area.is_finite().then_some(area)
            })
            .fold(0.0, f32::max)
    }

    /// Linear RGBA of a texture; white if its image was not decoded.
    fn sample(&self, texture: &TextureRef, uv: Vec2) -> Vec4 {
        match self.images.get(texture.image) {
            Some(Some(image)) => sample(image, texture, uv),
            _ => Vec4::ONE,
        }
    }
}

const WHOLE: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];

/// Linear RGBA of a picture at an untransformed coordinate.
pub(crate) fn sample(image: &Image, texture: &TextureRef, uv: Vec2) -> Vec4 {
    let srgb = &*SRGB;
    filtered(image, texture, uv, |[r, g, b, a]| {
        Vec4::new(
            srgb[r as usize],
            srgb[g as usize],
            srgb[b as usize],
            f32::from(a) * (1.0 / 255.0),
        )
    })
}

/// A texel that contains data instead of a colour.
fn linear_byte(texel: [u8; 4]) -> Vec4 {
    Vec4::from_array(texel.map(f32::from)) * (1.0 / 255.0)
}

/// Texels are decoded, then filtered.
#[inline(always)]
fn filtered(
    image: &Image,
    texture: &TextureRef,
    uv: Vec2,
    decode: impl Fn([u8; 4]) -> Vec4,
) -> Vec4 {
    let uv = if texture.transform == Affine2::IDENTITY {
        uv
    } else {
        texture.transform.transform_point2(uv)
    };
    let (width, height) = (image.width, image.height);
    let texel = |x: u32, y: u32| decode(image.pixels[(y as usize) * width as usize + x as usize]);
    if texture.nearest {
        let [x, y] = nearest_texel([width, height], texture.wrap, uv);
        return texel(x, y);
    }
    let taps = Taps::new([width, height], texture.wrap, uv);
    let [fx, fy] = taps.weights;
    let ([x0, x1], [y0, y1]) = (taps.x, taps.y);
    let top = texel(x0, y0).lerp(texel(x1, y0), fx);
    let bottom = texel(x0, y1).lerp(texel(x1, y1), fx);
    top.lerp(bottom, fy)
}

/// The texel that contains a (transformed) coordinate.
pub(crate) fn nearest_texel(size: [u32; 2], wrap: [Wrap; 2], uv: Vec2) -> [u32; 2] {
    std::array::from_fn(|i| {
        let x = reduce(uv[i], wrap[i]) * size[i] as f32;
        wrap_index(x.floor() as i32, size[i], wrap[i])
    })
}

/// The four texels around a point, and the interpolation weights from the first to the second of
/// each pair.
pub(crate) struct Taps {
    pub x: [u32; 2],
    pub y: [u32; 2],
    pub weights: [f32; 2],
}

impl Taps {
    /// The texels around the (transformed) coordinate `uv` in an image of `size` texels.
    #[inline(always)]
    pub fn new(size: [u32; 2], wrap: [Wrap; 2], uv: Vec2) -> Taps {
        let axis = |i: usize| {
            let x = reduce(uv[i], wrap[i]) * size[i] as f32 - 0.5;
            let first = x.floor();
            let at = |d| wrap_index(first as i32 + d, size[i], wrap[i]);
            ([at(0), at(1)], x - first)
        };
        let ((x, fx), (y, fy)) = (axis(0), axis(1));
        Taps {
            x,
            y,
            weights: [fx, fy],
        }
    }
}

/// Removes whole periods from a coordinate before scaling by the image size, which would lose
/// precision.
fn reduce(x: f32, wrap: Wrap) -> f32 {
    match wrap {
        Wrap::Repeat => x - x.floor(),
        Wrap::Mirror => x - 2.0 * (x * 0.5).floor(),
        // One texel beyond the edge already reads the edge; the bound keeps products finite.
        Wrap::Clamp => x.clamp(-1.0, 2.0),
    }
}

/// Texel index of a reduced coordinate, which is at most one texel outside its period, so no
/// division is needed. The last bound guards against rounding.
fn wrap_index(i: i32, size: u32, wrap: Wrap) -> u32 {
    let n = size as i32;
    let within = |i: i32, period: i32| {
        if i < 0 {
            i + period
        } else if i >= period {
            i - period
        } else {
            i
        }
    };
    let index = match wrap {
        Wrap::Clamp => i,
        Wrap::Repeat => within(i, n),
        Wrap::Mirror => {
            let m = within(i, 2 * n);
            if m < n { m } else { 2 * n - 1 - m }
        }
    };
    index.clamp(0, n - 1) as u32
}
