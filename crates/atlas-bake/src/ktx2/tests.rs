use ktx2::{Format, Reader};

use super::*;

/// Smooth light with a highlight and an edge, over a range of 10^4.
fn page(width: u32, height: u32) -> Page {
    let n = width * height;
    let at = |i: u32| {
        let (x, y) = (f64::from(i % width), f64::from(i / width));
        let spot = 40.0 / (1.0 + 0.1 * ((x - 20.0).powi(2) + (y - 12.0).powi(2)));
        let edge = if x > 0.6 * y { 1.0 } else { 0.01 };
        [1.0, 0.8, 0.5].map(|c| (c * edge * (0.1 + 0.01 * x) + spot * c * c) as f32)
    };
    Page {
        width,
        height,
        value: (0..n).map(at).collect(),
        coverage: vec![1.0; n as usize],
        layers: Vec::new(),
    }
}

/// Texels of a file: the container is read by `ktx2`, BC6H by `bcdec_rs`, and rgb9e5 by its
/// definition. crates/lumel/tests/engines.rs checks BC6H on GPUs.
fn read(bytes: &[u8]) -> Vec<[f32; 3]> {
    let file = Reader::new(bytes).unwrap();
    let h = file.header();
    let (w, h, format) = (h.pixel_width as usize, h.pixel_height as usize, h.format);
    let data = file.levels().next().unwrap().data;
    let mut out = vec![[0.0; 3]; w * h];
    if format == Some(Format::BC6H_UFLOAT_BLOCK) {
        assert_eq!(data.len(), 16 * w.div_ceil(4) * h.div_ceil(4));
        for (i, block) in data.chunks_exact(16).enumerate() {
            let (bx, by) = (i % w.div_ceil(4), i / w.div_ceil(4));
            let mut texels = [0.0f32; 48];
            bcdec_rs::bc6h_float(block, &mut texels, 12, false);
            for (j, v) in texels.chunks_exact(3).enumerate() {
                let (x, y) = (4 * bx + j % 4, 4 * by + j / 4);
                if x < w && y < h {
                    out[y * w + x] = [v[0], v[1], v[2]];
                }
            }
        }
    } else {
        assert_eq!(format, Some(Format::E5B9G9R9_UFLOAT_PACK32));
        assert_eq!(data.len(), 4 * w * h);
        for (v, word) in out.iter_mut().zip(data.chunks_exact(4)) {
            // By the definition: bits 0..9 R, 9..18 G, 18..27 B, 27..32 the exponent.
            let word = u32::from_le_bytes(word.try_into().unwrap());
            let e = (word >> 27) as i32 - 24;
            *v = [word & 511, word >> 9 & 511, word >> 18 & 511]
                .map(|m| (f64::from(m) * 2f64.powi(e)) as f32);
        }
    }
    out
}

#[test]
fn what_another_reader_finds_is_what_the_report_says() {
    for (size, format) in [
        ([64, 32], Ktx2Format::Bc6h),
        ([61, 30], Ktx2Format::Bc6h),
        ([61, 30], Ktx2Format::Rgb9e5),
    ] {
        let p = page(size[0], size[1]);
        let (bytes, report) = write_lightmap_ktx2(&p, format).unwrap();
        let back = read(&bytes);
        let again = diff(
            &image(size, &p.value, Some(&p.coverage)),
            &image(size, &back, None),
        );
        assert_eq!(report.error, again.unwrap(), "{format:?}");
        assert_eq!(report.bytes, bytes.len() as u64);
        assert_eq!(report.clamped, ExrStats::default());
        // Both formats preserve smooth light: rgb9e5 to half a step of 2^-8 of the largest channel,
        // BC6H similarly except for blocks at the edge and the highlight. The bound only catches a
        // page that is flipped, shifted or scaled, which gives more than 0.5.
        assert!(report.error.rel_rmse < 0.05, "{format:?}: {report:?}");
        assert!(report.psnr.is_some_and(|x| x > 40.0), "{report:?}");
    }
}

/// Blocks with one region of 4-bit indices (mode 11: bits 00011, 10-bit endpoints, then 63 bits of
/// indices), assembled by hand from the Khronos Data Format Specification 1.3, §16 (BPTC).
#[test]
fn the_decoder_reads_a_block_made_by_hand() {
    let endpoints: [[u32; 3]; 2] = [[480, 100, 0], [600, 100, 1023]];
    let mut bits = 0b00011u128;
    let mut at = 5;
    for e in endpoints.as_flattened() {
        bits |= u128::from(*e) << at;
        at += 10;
    }
    // Texel 0 has a 3-bit index, because its top bit is always 0; the others have four.
    let index = |i: usize| if i == 0 { 0 } else { i as u128 };
    at = 65;
    for i in 0..16 {
        bits |= index(i) << at;
        at += if i == 0 { 3 } else { 4 };
    }
    assert_eq!(at, 128);
    let back = bc6h::decode([4, 4], &bits.to_le_bytes());
    // Endpoints are expanded to 16 bits: 0 and 1023 map to the ends, the rest to (x 2^16 + 2^15) /
    // 2^10. Weights are in 64ths. The result times 31/64 is the bit pattern of a half.
    let wide = |x: u32| match x {
        0 => 0,
        1023 => 0xFFFF,
        x => ((x << 16) + 0x8000) >> 10,
    };
    let weights = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];
    for (i, v) in back.iter().enumerate() {
        let want = [0, 1, 2].map(|c| {
            let w = weights[i];
            let x = (wide(endpoints[0][c]) * (64 - w) + wide(endpoints[1][c]) * w + 32) >> 6;
            half::f16::from_bits(((x * 31) >> 6) as u16).to_f32()
        });
        assert_eq!(*v, want, "texel {i}");
    }
}

#[test]
fn shared_exponents_round_to_the_nearest_step() {
    for x in [
        0.0f32,
        1e-9,
        2f32.powi(-25),
        2f32.powi(-24),
        3e-5,
        0.3,
        0.99805,
        0.999,
        1.0,
        511.4,
        511.5,
        65000.0,
        rgb9e5::MAX,
    ] {
        let word = rgb9e5::encode([x, 0.5 * x, 0.0]);
        let back = rgb9e5::decode(word);
        // Half a step of 9 bits below the largest channel, or of the smallest step.
        let half = (x * 2f32.powi(-9)).max(2f32.powi(-25));
        assert!((back[0] - x).abs() <= half, "{x}: {back:?}");
        assert!((back[1] - 0.5 * x).abs() <= half, "{x}: {back:?}");
        assert_eq!(back[2], 0.0);
        assert_eq!(rgb9e5::encode(back), word, "{x}");
    }
}

#[test]
fn containers_say_what_they_hold() {
    for (format, alignment, bits) in [(Ktx2Format::Bc6h, 16, 8), (Ktx2Format::Rgb9e5, 4, 32)] {
        let (bytes, _) = write_lightmap_ktx2(&page(64, 32), format).unwrap();
        let file = Reader::new(&bytes[..]).unwrap();
        let h = file.header();
        assert_eq!([h.pixel_width, h.pixel_height, h.pixel_depth], [64, 32, 0]);
        assert_eq!([h.layer_count, h.face_count, h.level_count], [0, 1, 1]);
        assert_eq!(h.supercompression_scheme, None);
        assert_eq!(h.type_size, if alignment == 16 { 1 } else { 4 });
        assert_eq!(
            file.transfer_function(),
            Some(ktx2::TransferFunction::Linear)
        );
        assert_eq!(file.color_primaries(), Some(ktx2::ColorPrimaries::BT709));
        let keys: Vec<_> = file.key_value_data().collect();
        assert_eq!(keys[0], ("KTXorientation", &b"rd\0"[..]));
        assert_eq!((keys[1].0, keys.len()), ("KTXwriter", 2));
        let level = u64::from_le_bytes(bytes[80..88].try_into().unwrap());
        assert_eq!(level % alignment, 0);
        assert_eq!(level + 64 * 32 * bits / 8, bytes.len() as u64);
    }
}

#[test]
fn what_cannot_be_stored_is_clamped_and_counted() {
    let mut p = page(4, 4);
    p.value = vec![[1.0; 3]; 16];
    p.value[0] = [f32::NAN, -1.0, 1e6];
    p.value[5] = [f32::INFINITY, f32::NEG_INFINITY, -0.0];
    for (format, max) in [(Ktx2Format::Bc6h, 65504.0), (Ktx2Format::Rgb9e5, 65408.0)] {
        assert_eq!(format.max(), max);
        let (bytes, report) = write_lightmap_ktx2(&p, format).unwrap();
        let stats = ExrStats {
            clamped: 1,
            non_finite: 3,
            negative: 1,
        };
        assert_eq!(report.clamped, stats, "{format:?}");
        let back = read(&bytes);
        assert!(
            back.as_flattened()
                .iter()
                .all(|x| x.is_finite() && *x >= 0.0),
            "{back:?}"
        );
        if format == Ktx2Format::Rgb9e5 {
            assert_eq!(back[0], [0.0, 0.0, max]);
            assert_eq!(back[1], [1.0; 3]);
        }
    }
    // A page of only the largest value is exact.
    p.value = vec![[f32::MAX; 3]; 16];
    for format in [Ktx2Format::Bc6h, Ktx2Format::Rgb9e5] {
        let (bytes, _) = write_lightmap_ktx2(&p, format).unwrap();
        assert_eq!(read(&bytes), vec![[format.max(); 3]; 16]);
    }
}

#[test]
fn texels_that_nobody_sees_cost_their_block_nothing() {
    // A chequerboard, which matches none of the format's partitions. The dark fields are free at
    // first, then black surfaces.
    let mut p = page(32, 32);
    let lit = |i: usize| (i % 32 + i / 32).is_multiple_of(2);
    for i in 0..p.value.len() {
        p.value[i] = [if lit(i) {
            2.0 + 0.01 * (i % 32) as f32
        } else {
            0.0
        }; 3];
        p.coverage[i] = if lit(i) { 1.0 } else { 0.0 };
    }
    let store = |p: &Page| read(&write_lightmap_ktx2(p, Ktx2Format::Bc6h).unwrap().0);
    let error = |back: &[[f32; 3]]| -> f32 {
        let fields = (0..p.value.len()).filter(|i| lit(*i));
        fields
            .map(|i| (back[i][0] / p.value[i][0] - 1.0).abs())
            .sum()
    };
    let free = store(&p);
    let held = store(&Page {
        coverage: vec![1.0; p.value.len()],
        ..p.clone()
    });
    assert!(
        held[1][0] < 0.05,
        "black surfaces stay black: {:?}",
        held[1]
    );
    assert!(
        error(&free) < 0.5 * error(&held),
        "{} and {}",
        error(&free),
        error(&held)
    );
}

#[test]
fn same_bytes_for_any_number_of_threads() {
    let p = page(100, 60);
    for format in [Ktx2Format::Bc6h, Ktx2Format::Rgb9e5] {
        let write = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build()
                .unwrap()
                .install(|| write_lightmap_ktx2(&p, format).unwrap().0)
        };
        assert!(write(1) == write(3), "{format:?}");
    }
}

#[test]
fn pages_of_a_wrong_size_are_errors() {
    let mut p = page(8, 8);
    p.coverage.pop();
    for p in [p, Page::default()] {
        assert!(matches!(
            write_lightmap_ktx2(&p, Ktx2Format::Bc6h),
            Err(Error::Inconsistent { .. })
        ));
    }
}
