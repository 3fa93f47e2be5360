//! Looks up a material's textures at a vertex. (For points of world-space triangles there is
//! `Scene::base_color`.)

use std::sync::LazyLock;

use glam::{Vec2, Vec3, Vec4};
use mesh_ingest::{Image, Material, Primitive, Scene, TextureRef, Wrap};

/// sRGB byte to linear light (IEC 61966-2-1).
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let c = i as f64 / 255.0;
        (if c <= 0.04045 {
            c / 12.92
        } else {
            libm::pow((c + 0.055) / 1.055, 2.4)
        }) as f32
    })
});

/// Emitted radiance of `primitive` with `material`, at barycentric `weights` of its corners
/// `vertices`.
pub(crate) fn emission_at(
    scene: &Scene,
    primitive: &Primitive,
    material: &Material,
    vertices: [u32; 3],
    weights: [f32; 3],
) -> Vec3 {
    if material.emissive == Vec3::ZERO {
        return Vec3::ZERO;
    }
    material.emissive
        * texel(
            scene,
            primitive,
            material.emissive_texture.as_ref(),
            vertices,
            weights,
        )
        .truncate()
}

/// The texture's colour there; white without a texture, an image or coordinates.
pub(crate) fn texel(
    scene: &Scene,
    primitive: &Primitive,
    texture: Option<&TextureRef>,
    vertices: [u32; 3],
    weights: [f32; 3],
) -> Vec4 {
    let Some(texture) = texture else {
        return Vec4::ONE;
    };
    let image = scene.images.get(texture.image).and_then(Option::as_ref);
    let set = primitive
        .tex_coords
        .get(texture.tex_coord)
        .filter(|set| !set.is_empty());
    let (Some(image), Some(set)) = (image, set) else {
        return Vec4::ONE;
    };
    let uv: Vec2 = (0..3).map(|k| set[vertices[k] as usize] * weights[k]).sum();
    sample(texture, image, uv)
}

/// Bilinear (or nearest) lookup at `uv`, filtered in linear light.
pub(crate) fn sample(texture: &TextureRef, image: &Image, uv: Vec2) -> Vec4 {
    let uv = texture.transform.transform_point2(uv);
    let size = [image.width as i64, image.height as i64];
    let wrap = |i: i64, axis: usize| -> usize {
        let n = size[axis];
        (match texture.wrap[axis] {
            Wrap::Clamp => i.clamp(0, n - 1),
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Mirror => {
                let m = i.rem_euclid(2 * n);
                if m < n { m } else { 2 * n - 1 - m }
            }
        }) as usize
    };
    let fetch = |x: i64, y: i64| {
        let [r, g, b, a] = image.pixels[wrap(y, 1) * image.width as usize + wrap(x, 0)];
        Vec4::new(
            SRGB[r as usize],
            SRGB[g as usize],
            SRGB[b as usize],
            f32::from(a) / 255.0,
        )
    };
    let p = uv * Vec2::new(image.width as f32, image.height as f32);
    if !p.is_finite() {
        return Vec4::ONE;
    }
    if texture.nearest {
        return fetch(p.x.floor() as i64, p.y.floor() as i64);
    }
    let p = p - 0.5;
    let (x, y) = (p.x.floor(), p.y.floor());
    let (fx, fy) = (p.x - x, p.y - y);
    // Beyond 2^40 texels the fraction is lost anyway. The clamp keeps the sums below from
    // overflowing.
    let (x, y) = (x.clamp(-1e12, 1e12) as i64, y.clamp(-1e12, 1e12) as i64);
    fetch(x, y)
        .lerp(fetch(x + 1, y), fx)
        .lerp(fetch(x, y + 1).lerp(fetch(x + 1, y + 1), fx), fy)
}

#[cfg(test)]
mod tests {
    use glam::Affine2;

    use super::*;

    fn texture(wrap: Wrap, nearest: bool) -> TextureRef {
        TextureRef {
            image: 0,
            tex_coord: 0,
            transform: Affine2::IDENTITY,
            wrap: [wrap; 2],
            nearest,
        }
    }

    fn image() -> Image {
        Image {
            width: 2,
            height: 1,
            pixels: vec![[255, 0, 0, 255], [0, 188, 0, 0]],
        }
    }

    #[test]
    fn colours_are_decoded_before_they_are_mixed() {
        let mid = sample(&texture(Wrap::Clamp, false), &image(), Vec2::new(0.5, 0.5));
        // sRGB 188 is 0.502886 in linear light; halves of both texels.
        assert!(
            (mid - Vec4::new(0.5, 0.251443, 0.0, 0.5))
                .abs()
                .max_element()
                < 1e-5,
            "{mid}"
        );
    }

    #[test]
    fn wrapping_is_that_of_the_sampler() {
        let at = |wrap, x| sample(&texture(wrap, true), &image(), Vec2::new(x, 0.0)).x;
        // Texel 0 is red, texel 1 is not.
        assert_eq!(
            [-0.2, 1.2, 2.2].map(|x| at(Wrap::Repeat, x)),
            [0.0, 1.0, 1.0]
        );
        assert_eq!(
            [-0.2, 1.2, 2.2].map(|x| at(Wrap::Mirror, x)),
            [1.0, 0.0, 1.0]
        );
        assert_eq!(
            [-0.2, 1.2, 2.2].map(|x| at(Wrap::Clamp, x)),
            [1.0, 0.0, 0.0]
        );
    }
}
