//! Unsigned BC6H: blocks of 4×4 texels, 16 bytes each.

use block_compression::{BC6HSettings, CompressionVariant, encode};
use half::f16;
use rayon::prelude::*;

/// Side of a block, texels.
const SIDE: usize = 4;

/// Measured on bakes of the Cornell box and the demo level (356 × 580 and 536 × 536 texels), one
/// core: `basic` takes 0.31 and 0.44 s for a relative error of 0.48 and 2.33 %; `very_slow` takes
/// eight times as long for 0.46 and 2.16 %; `fast` takes 0.13 and 0.19 s for 0.64 and 2.66 %.
const VARIANT: CompressionVariant = CompressionVariant::BC6H(BC6HSettings::basic());

/// Encodes an image in rows of blocks, row 0 first. Blocks that extend beyond the right or lower
/// border repeat the last texels.
///
/// `value` is in 0..=65504. Black texels without coverage are free: dilation has filled everything
/// that lookups read. They take the mean of the rest of their block, so that the block spends its
/// bits on the others.
pub(super) fn encode([width, height]: [u32; 2], value: &[[f32; 3]], coverage: &[f32]) -> Vec<u8> {
    let (w, h) = (width as usize, height as usize);
    let blocks = [w.div_ceil(SIDE), h.div_ceil(SIDE)];
    let mut out = vec![0; 16 * blocks[0] * blocks[1]];
    let stride = 4 * SIDE * blocks[0];
    out.par_chunks_exact_mut(16 * blocks[0])
        .enumerate()
        .for_each(|(by, out)| {
            let mut rows = vec![f16::ZERO; SIDE * stride];
            for bx in 0..blocks[0] {
                let texel = |i: usize| {
                    let x = (SIDE * bx + i % SIDE).min(w - 1);
                    let y = (SIDE * by + i / SIDE).min(h - 1);
                    y * w + x
                };
                let free = |i: usize| coverage[texel(i)] <= 0.0 && value[texel(i)] == [0.0; 3];
                let mut mean = [0.0; 3];
                let mut n = 0.0;
                for i in (0..SIDE * SIDE).filter(|i| !free(*i)) {
                    mean = std::array::from_fn(|c| mean[c] + value[texel(i)][c]);
                    n += 1.0;
                }
                for i in 0..SIDE * SIDE {
                    let v = if free(i) && n > 0.0 {
                        mean.map(|m| m / n)
                    } else {
                        value[texel(i)]
                    };
                    let at = i / SIDE * stride + 4 * (SIDE * bx + i % SIDE);
                    for c in 0..3 {
                        rows[at + c] = f16::from_f32(v[c]);
                    }
                }
            }
            encode::compress_rgba16(
                VARIANT,
                &rows,
                out,
                (SIDE * blocks[0]) as u32,
                SIDE as u32,
                stride as u32,
            );
        });
    out
}

/// Decodes the blocks of [`encode`] with a decoder of another crate. The encoder crate's own
/// decoder (version 0.11.0) returned wrong values for blocks that this one and GPUs read correctly.
pub(super) fn decode([width, height]: [u32; 2], data: &[u8]) -> Vec<[f32; 3]> {
    let (w, h) = (width as usize, height as usize);
    let blocks = w.div_ceil(SIDE);
    let mut out = vec![[0.0; 3]; w * h];
    out.par_chunks_mut(SIDE * w)
        .zip(data.par_chunks_exact(16 * blocks))
        .for_each(|(out, data)| {
            let mut texels = [0u16; 3 * SIDE * SIDE];
            for (bx, block) in data.chunks_exact(16).enumerate() {
                bcdec_rs::bc6h_half(block, &mut texels, 3 * SIDE, false);
                for (y, row) in out.chunks_exact_mut(w).enumerate() {
                    let part = &mut row[SIDE * bx..(SIDE * (bx + 1)).min(w)];
                    for (x, v) in part.iter_mut().enumerate() {
                        let at = 3 * (SIDE * y + x);
                        *v = std::array::from_fn(|c| f16::from_bits(texels[at + c]).to_f32());
                    }
                }
            }
        });
    out
}
