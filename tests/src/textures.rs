//! Procedural textures: sRGB, tileable, deterministic.

use image::{Rgba, RgbaImage};

/// Hash of a cell to 0..=255: an integer mix (the finaliser of MurmurHash3), so that no random
/// state is kept.
fn hash(x: u32, y: u32) -> u32 {
    let mut h = x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA6B);
    h ^= h >> 16;
    h = h.wrapping_mul(0x85EB_CA6B);
    h ^= h >> 13;
    h = h.wrapping_mul(0xC2B2_AE35);
    (h ^ (h >> 16)) & 255
}

/// `base`, brightened or darkened by up to `spread` of 255 according to `noise` (0..=255).
fn shade(base: [u8; 3], spread: i32, noise: u32) -> Rgba<u8> {
    let d = (noise as i32 - 128) * spread / 128;
    let [r, g, b] = base.map(|c| (i32::from(c) + d).clamp(0, 255) as u8);
    Rgba([r, g, b, 255])
}

/// Four by four stone tiles in two colours with darker joints; `size` pixels, a multiple of 16.
pub fn tiles(size: u32, light: [u8; 3], dark: [u8; 3], joint: [u8; 3]) -> RgbaImage {
    let cell = size / 4;
    RgbaImage::from_fn(size, size, |x, y| {
        let (i, j) = (x / cell, y / cell);
        if x % cell == 0 || y % cell == 0 {
            return shade(joint, 0, 128);
        }
        shade(
            if (i + j) % 2 == 0 { light } else { dark },
            14,
            hash(i, j + 7),
        )
    })
}

/// Courses of bricks, every other one shifted by half a brick; four courses of two bricks.
pub fn bricks(size: u32, brick: [u8; 3], mortar: [u8; 3]) -> RgbaImage {
    let (h, w) = (size / 4, size / 2);
    RgbaImage::from_fn(size, size, |x, y| {
        let row = y / h;
        let along = (x + (row % 2) * w / 2) % size;
        if y.is_multiple_of(h) || along.is_multiple_of(w) {
            return shade(mortar, 0, 128);
        }
        shade(brick, 18, hash(along / w, row + 31))
    })
}

/// A floor of boards along x: eight boards with one joint each.
pub fn boards(size: u32, wood: [u8; 3]) -> RgbaImage {
    let h = size / 8;
    RgbaImage::from_fn(size, size, |x, y| {
        let row = y / h;
        let end = hash(row, 3) * size / 256;
        if y % h == 0 || x == end {
            return shade(wood, 60, 0);
        }
        let half = u32::from(x > end);
        shade(wood, 22, hash(row * 2 + half, 91))
    })
}

/// The face of a crate: a frame, a diagonal and boards behind.
pub fn crate_face(size: u32, wood: [u8; 3]) -> RgbaImage {
    let edge = size / 8;
    RgbaImage::from_fn(size, size, |x, y| {
        let border = x.min(y).min(size - 1 - x).min(size - 1 - y);
        let diagonal = x.abs_diff(y) < size / 11;
        if border < edge || diagonal {
            let seam = border + 1 == edge || (border >= edge && x.abs_diff(y) + 1 == size / 11);
            return shade(wood, if seam { 50 } else { 10 }, if seam { 0 } else { 220 });
        }
        let board = y * 5 / size;
        if y * 5 % size < 5 {
            shade(wood, 70, 0)
        } else {
            shade(wood, 30, hash(board, 5) / 2)
        }
    })
}

/// Bars of an iron grate around one opening: alpha 0 in the opening. Repeats in both directions.
pub fn grate(size: u32, iron: [u8; 3]) -> RgbaImage {
    let bar = size / 8;
    RgbaImage::from_fn(size, size, |x, y| {
        let border = x.min(y).min(size - 1 - x).min(size - 1 - y);
        let Rgba([r, g, b, _]) = shade(iron, 0, 128);
        Rgba([r, g, b, if border < bar { 255 } else { 0 }])
    })
}

/// Grass or gravel: patches of one colour in three brightnesses.
pub fn ground(size: u32, colour: [u8; 3]) -> RgbaImage {
    let n = 4;
    RgbaImage::from_fn(size, size, |x, y| {
        shade(colour, 16, hash(x / n, y / n) / 86 * 110)
    })
}

/// A checker of opaque and transparent squares, `cells` by `cells` (even), for shadows that can be
/// computed.
pub fn masked_checker(size: u32, cells: u32) -> RgbaImage {
    let cell = size / cells;
    RgbaImage::from_fn(size, size, |x, y| {
        Rgba([
            255,
            255,
            255,
            if (x / cell + y / cell).is_multiple_of(2) {
                255
            } else {
                0
            },
        ])
    })
}
