//! Shared-exponent texels: three 9-bit mantissas and one 5-bit exponent.
//!
//! Based on: Khronos, EXT_texture_shared_exponent, "Additions to Chapter 3"; Vulkan 1.3,
//! "Conversion to and from shared exponent". A texel is mantissa × 2^(e − 24), e in 0..=31, so the
//! step of all three channels is between 1/256 and 1/512 of the largest.

/// 511/512 × 2^16, the largest representable value.
pub(super) const MAX: f32 = 65408.0;

/// Bits of a mantissa, and the exponent's bias.
const BITS: i32 = 9;
const BIAS: i32 = 15;

/// Encodes `v`, whose components are in 0..=[`MAX`], to the nearest texel.
pub(super) fn encode(v: [f32; 3]) -> u32 {
    let largest = v[0].max(v[1]).max(v[2]);
    // ⌊lb x⌋ is the exponent of a normal float; subnormals are below the smallest step, 2^-24,
    // anyway.
    let lb = ((largest.to_bits() >> 23) & 255) as i32 - 127;
    let mut e = lb.max(-BIAS - 1) + 1 + BIAS;
    let step = |e: i32| libm::exp2(f64::from(e - BIAS - BITS));
    let mantissa = |x: f32, e: i32| (f64::from(x) / step(e) + 0.5).floor() as u32;
    // Rounding up may overflow the mantissa.
    if mantissa(largest, e) == 1 << BITS {
        e += 1;
    }
    let [r, g, b] = v.map(|x| mantissa(x, e));
    r | g << 9 | b << 18 | (e as u32) << 27
}

/// Decodes a texel.
pub(super) fn decode(word: u32) -> [f32; 3] {
    let step = libm::exp2(f64::from((word >> 27) as i32 - BIAS - BITS));
    [0, 9, 18].map(|shift| (f64::from(word >> shift & 511) * step) as f32)
}
