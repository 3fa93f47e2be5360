//! Mean reflectance around a point, from image pyramids.
//!
//! Based on: L. Williams, *Pyramidal Parametrics*, SIGGRAPH 1983. Levels contain the mean in linear
//! light, weighted by presence, so that texels cut out by a mask do not count, whatever their
//! colour.

use std::collections::BTreeMap;

use glam::{DVec2, Vec2, Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use crate::scene::{AlphaMode, Image, Material, Scene, TextureRef};
use crate::shading::{Taps, nearest_texel, srgb_to_linear};
use crate::soup::Soup;

/// Samples along each side of the neighbourhood. Four approximate a square by the round blurs of an
/// isotropic pyramid, and handle textures that are stretched up to fourfold.
const SIDE: u32 = 4;

/// Largest area of a neighbourhood, as a multiple of the triangle's. It may extend beyond the
/// triangle, extrapolating its mapping, but further away another triangle uses another part of the
/// texture.
const BEYOND: f32 = 4.0;

/// Pyramids of the base textures of a scene.
///
/// Memory: 8/3 bytes per texel, once per image and way in which materials use it (their mask, and
/// their limit if it clamps the texture); see [`Pyramids::bytes`].
#[derive(Debug, Default)]
pub struct Pyramids {
    pyramids: Vec<Pyramid>,
    /// Index of the pyramid of each material.
    of_material: Vec<Option<usize>>,
}

/// How a material uses the texels of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Use {
    image: usize,
    cover: Cover,
    /// Bits of the texel value above which the material's limit clamps, per channel.
    limit: [u32; 3],
    /// The material, if its transmission texture has the same mapping as its base texture.
    glass: Option<usize>,
}

/// Presence of the surface by a texel's alpha.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Cover {
    All,
    /// Full presence from this alpha byte on.
    From(u16),
    Alpha,
}

#[derive(Debug)]
struct Pyramid {
    usage: Use,
    /// Levels 1, 2, …, down to one texel. Level 0 is the image.
    levels: Vec<Level>,
}

/// Mean colour of the present part, and presence, as 16-bit fractions.
#[derive(Debug)]
struct Level {
    size: [u32; 2],
    texels: Vec<[u16; 4]>,
}

impl Use {
    fn of(material: &Material, index: usize) -> Option<Use> {
        let texture = material.base_texture.as_ref()?;
        let factor = material.base_color;
        let cover = match material.alpha {
            AlphaMode::Opaque => Cover::All,
            AlphaMode::Blend => Cover::Alpha,
            AlphaMode::Mask { cutoff } => Cover::From(
                (0..=255u16)
                    .find(|&byte| factor.w * (f32::from(byte) * (1.0 / 255.0)) >= cutoff)
                    .unwrap_or(256),
            ),
        };
        let limit = factor.xyz().to_array().map(|f| {
            let cut = material.max_reflectance / f.max(f32::MIN_POSITIVE);
            cut.min(1.0).to_bits()
        });
        let transmission = material.transmission_texture.as_ref();
        Some(Use {
            image: texture.image,
            cover,
            limit,
            glass: transmission
                .filter(|t| t.tex_coord == texture.tex_coord)
                .map(|_| index),
        })
    }

    /// Level 0: linear colour of a texel, and the fraction of it that reflects.
    #[inline(always)]
    fn texel(&self, scene: &Scene, image: &Image, x: u32, y: u32) -> Vec4 {
        let [r, g, b, a] = image.pixels[y as usize * image.width as usize + x as usize];
        let color = Vec3::from_array([r, g, b].map(srgb_to_linear));
        let mut there = match self.cover {
            Cover::All => 1.0,
            Cover::From(least) => f32::from(u8::from(u16::from(a) >= least)),
            Cover::Alpha => f32::from(a) * (1.0 / 255.0),
        };
        if let Some(material) = self.glass {
            there *= 1.0 - transmission(scene, &scene.materials[material], image, x, y);
        }
        color
            .min(Vec3::from_array(self.limit.map(f32::from_bits)))
            .extend(there)
    }
}

/// τ of a glass at the centre of a texel of its base texture.
fn transmission(scene: &Scene, material: &Material, image: &Image, x: u32, y: u32) -> f32 {
    let (Some(base), Some(glass)) = (&material.base_texture, &material.transmission_texture) else {
        return material.transmission;
    };
    let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
    let uv = centre / Vec2::new(image.width as f32, image.height as f32);
    let uv = base.transform.inverse().transform_point2(uv);
    if !uv.is_finite() {
        return material.transmission;
    }
    let texel = scene.transmission_texel(glass, glass.transform.transform_point2(uv));
    (material.transmission * texel).clamp(0.0, 1.0)
}

impl Pyramids {
    /// Builds the pyramids of all base textures used by triangles of `soup`, in parallel; the
    /// result does not depend on the number of threads. O(texels).
    pub fn build(scene: &Scene, soup: &Soup) -> Pyramids {
        let mut worn = vec![false; scene.materials.len()];
        for &material in &soup.materials {
            worn[material as usize] = true;
        }
        let mut uses: BTreeMap<Use, usize> = BTreeMap::new();
        let used: Vec<Option<Use>> = scene
            .materials
            .iter()
            .enumerate()
            .map(|(i, m)| {
                let usage = Use::of(m, i).filter(|_| worn[i] && !m.occluder_only)?;
                scene.images.get(usage.image)?.as_ref()?;
                uses.insert(usage, 0);
                Some(usage)
            })
            .collect();
        for (number, slot) in uses.values_mut().enumerate() {
            *slot = number;
        }
        let list: Vec<Use> = uses.keys().copied().collect();
        Pyramids {
            pyramids: list
                .into_par_iter()
                .map(|usage| Pyramid::build(scene, usage))
                .collect(),
            of_material: used.into_iter().map(|u| Some(uses[&u?])).collect(),
        }
    }

    /// Memory of the levels in bytes.
    pub fn bytes(&self) -> u64 {
        let levels = self.pyramids.iter().flat_map(|p| &p.levels);
        levels.map(|l| 8 * l.texels.len() as u64).sum()
    }

    /// Mean reflectance (linear RGB, 0..=1) of the present part of the surface, over a square of
    /// `area` m² around a point of soup triangle `tri`, in the triangle's plane and with its
    /// mapping.
    ///
    /// `u` and `v` are the barycentric weights of world corners 1 and 2; `scene` and `soup` are
    /// those of [`Pyramids::build`]. With base colour c and presence p it is ∫ c p dA / ∫ p dA, and
    /// black if nothing is present or the triangle is an occluder. `COLOR_0` is evaluated at the
    /// point itself (without its alpha), and so is everything else if there is no texture. The
    /// square is at most four times as large as the triangle; its border is soft by an eighth of
    /// its side.
    ///
    /// Compared with 48² samples in squares on 1,500 triangles of Sponza, the mean was 0.2 % high
    /// and the root mean square of the differences 0.004 (of 0.075). Not guaranteed: beyond the
    /// edge of a clamped texture, coarse levels read the mean of its border instead of the last
    /// row; masks are applied per texel, not after filtering.
    pub fn reflectance(
        &self,
        scene: &Scene,
        soup: &Soup,
        tri: u32,
        u: f32,
        v: f32,
        area: f32,
    ) -> Vec3 {
        if scene.only_occludes(soup, tri) {
            return Vec3::ZERO;
        }
        let index = soup.materials[tri as usize] as usize;
        let material = &scene.materials[index];
        let pyramid = self.of_material.get(index).copied().flatten();
        let found = pyramid.and_then(|p| {
            let pyramid = &self.pyramids[p];
            let image = scene.images[pyramid.usage.image].as_ref()?;
            Some((pyramid, image, material.base_texture.as_ref()?))
        });
        let Some((pyramid, image, texture)) = found else {
            return scene.base_color(soup, tri, u, v).xyz();
        };
        let area = area.min(BEYOND * soup.areas[tri as usize]);
        let square = Square::new(
            soup.triangles[tri as usize],
            scene.texture_corners(soup, tri, texture),
            [u, v],
            area,
        );
        let level = square.level([image.width, image.height]);
        let view = View {
            scene,
            image,
            texture,
            pyramid,
        };
        let mut sum = Vec4::ZERO;
        for at in square.points() {
            sum += view.sample(at, level);
        }
        if sum.w <= 0.0 {
            return Vec3::ZERO;
        }
        let mean = sum.xyz() / sum.w * scene.untextured_color(soup, tri, u, v);
        mean.clamp(Vec3::ZERO, Vec3::splat(material.max_reflectance))
    }
}

/// A square on a triangle's plane, in texture coordinates.
struct Square {
    centre: DVec2,
    sides: [DVec2; 2],
}

impl Square {
    /// A square around barycentric `at` of the triangle with these world corners and texture
    /// coordinates.
    fn new(corners: [Vec3; 3], uv: [Vec2; 3], at: [f32; 2], area: f32) -> Square {
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let [ta, tb, tc] = uv.map(|p| p.as_dvec2());
        let (e1, e2, t1, t2) = (b - a, c - a, tb - ta, tc - ta);
        let centre = ta + t1 * f64::from(at[0]) + t2 * f64::from(at[1]);
        let side = f64::from(area).max(0.0).sqrt();
        // Axes: X along e1 and Y across, so e1 = (l, 0), e2 = (p, q).
        let l = e1.length();
        let (p, q) = (e2.dot(e1) / l, e1.cross(e2).length() / l);
        let along = t1 / l;
        let across = (t2 - along * p) / q;
        let sides = [along * side, across * side];
        let sound = centre.is_finite() && sides.iter().all(|s| s.is_finite());
        Square {
            centre: if sound { centre } else { DVec2::ZERO },
            sides: if sound { sides } else { [DVec2::ZERO; 2] },
        }
    }

    /// Level whose texels have the size of one sample's part, in an image of `size`.
    fn level(&self, size: [u32; 2]) -> f32 {
        let size = DVec2::new(f64::from(size[0]), f64::from(size[1]));
        let [a, b] = self.sides.map(|s| s * size);
        let part = a.perp_dot(b).abs() / f64::from(SIDE * SIDE);
        (0.5 * libm::log2(part.max(1.0))) as f32
    }

    /// Centres of the samples' parts.
    fn points(&self) -> impl Iterator<Item = Vec2> {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(SIDE) - 0.5;
        let [a, b] = self.sides;
        (0..SIDE * SIDE).map(move |k| (self.centre + a * at(k % SIDE) + b * at(k / SIDE)).as_vec2())
    }
}

/// A pyramid with its image and mapping.
struct View<'a> {
    scene: &'a Scene,
    image: &'a Image,
    texture: &'a TextureRef,
    pyramid: &'a Pyramid,
}

impl View<'_> {
    /// Σ colour × presence and Σ presence at a fractional level.
    fn sample(&self, uv: Vec2, level: f32) -> Vec4 {
        let top = self.pyramid.levels.len();
        let low = (level.floor() as usize).min(top);
        let part = level - low as f32;
        let below = self.sample_level(uv, low);
        if low == top || part <= 0.0 {
            below
        } else {
            below.lerp(self.sample_level(uv, low + 1), part)
        }
    }

    fn sample_level(&self, uv: Vec2, level: usize) -> Vec4 {
        let wrap = self.texture.wrap;
        let weigh = |texel: Vec4| (texel.xyz() * texel.w).extend(texel.w);
        let (size, stored) = match level {
            0 => ([self.image.width, self.image.height], None),
            n => {
                let level = &self.pyramid.levels[n - 1];
                (level.size, Some(level))
            }
        };
        let texel = |x: u32, y: u32| {
            weigh(match stored {
                None => self.pyramid.usage.texel(self.scene, self.image, x, y),
                Some(level) => level.texel(x, y),
            })
        };
        if level == 0 && self.texture.nearest {
            let [x, y] = nearest_texel(size, wrap, uv);
            return texel(x, y);
        }
        let taps = Taps::new(size, wrap, uv);
        let ([x0, x1], [y0, y1], [fx, fy]) = (taps.x, taps.y, taps.weights);
        let top = texel(x0, y0).lerp(texel(x1, y0), fx);
        let bottom = texel(x0, y1).lerp(texel(x1, y1), fx);
        top.lerp(bottom, fy)
    }
}

impl Pyramid {
    fn build(scene: &Scene, usage: Use) -> Pyramid {
        let mut levels = Vec::new();
        if let Some(image) = &scene.images[usage.image] {
            let mut size = [image.width, image.height];
            let mut above: Vec<Vec4> = Vec::new();
            while size != [1, 1] {
                let half = size.map(|n| (n / 2).max(1));
                above = if levels.is_empty() {
                    shrink(size, half, |x, y| {
                        let texel = usage.texel(scene, image, x, y);
                        (texel.xyz() * texel.w).extend(texel.w)
                    })
                } else {
                    let width = size[0] as usize;
                    shrink(size, half, |x, y| above[y as usize * width + x as usize])
                };
                levels.push(Level::store(half, &above));
                size = half;
            }
        }
        Pyramid { usage, levels }
    }
}

impl Level {
    /// Stores weighted sums as mean and presence.
    fn store(size: [u32; 2], sums: &[Vec4]) -> Level {
        let word = |x: f32| (x.clamp(0.0, 1.0) * 65535.0).round() as u16;
        let texels = sums
            .par_iter()
            .map(|sum| {
                let mean = sum.xyz() / sum.w.max(f32::MIN_POSITIVE);
                // A small presence must not become zero, or its colour would be lost.
                let share = word(sum.w).max(u16::from(sum.w > 0.0));
                let [r, g, b] = mean.to_array().map(word);
                [r, g, b, share]
            })
            .collect();
        Level { size, texels }
    }

    #[inline(always)]
    fn texel(&self, x: u32, y: u32) -> Vec4 {
        let texel = self.texels[y as usize * self.size[0] as usize + x as usize];
        Vec4::from_array(texel.map(f32::from)) * (1.0 / 65535.0)
    }
}

/// Means of the source over each texel of `half`, by exact overlap, so that odd sizes preserve the
/// mean too.
fn shrink(size: [u32; 2], half: [u32; 2], source: impl Fn(u32, u32) -> Vec4 + Sync) -> Vec<Vec4> {
    let [columns, rows] = [0, 1].map(|axis| overlaps(size[axis], half[axis]));
    let mut out = vec![Vec4::ZERO; half[0] as usize * half[1] as usize];
    out.par_chunks_mut(half[0] as usize)
        .zip(&rows)
        .for_each(|(out, row)| {
            for (out, column) in out.iter_mut().zip(&columns) {
                for (dy, wy) in row.weights.iter().take(row.count).enumerate() {
                    let mut line = Vec4::ZERO;
                    for (dx, wx) in column.weights.iter().take(column.count).enumerate() {
                        line += source(column.first + dx as u32, row.first + dy as u32) * *wx;
                    }
                    *out += line * *wy;
                }
            }
        });
    out
}

/// The texels that a texel of the next level covers, with weights that sum to 1.
struct Overlap {
    first: u32,
    /// Halving an odd size of 5 or more covers 2 to 3 texels, which touch at most 4; 3 become 1.
    weights: [f32; 4],
    count: usize,
}

fn overlaps(size: u32, half: u32) -> Vec<Overlap> {
    let (size, half) = (u64::from(size), u64::from(half));
    (0..half)
        .map(|i| {
            // In units of 1/half of a texel, which is exact.
            let (start, end) = (i * size, (i + 1) * size);
            let first = start / half;
            let mut overlap = Overlap {
                first: first as u32,
                weights: [0.0; 4],
                count: 0,
            };
            for (k, weight) in (first..).zip(&mut overlap.weights) {
                let shared = end.min((k + 1) * half).saturating_sub(start.max(k * half));
                if shared == 0 {
                    break;
                }
                *weight = (shared as f64 / size as f64) as f32;
                overlap.count += 1;
            }
            overlap
        })
        .collect()
}
