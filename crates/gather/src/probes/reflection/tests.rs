use super::*;

#[test]
fn directions_and_faces_are_inverse() {
    let size = 8;
    for texel in 0..6 * size * size {
        let within = Vec2::new(0.25, 0.75);
        let (face, uv) = face_of(direction(size, texel, within));
        assert_eq!(face as u32, texel / (size * size));
        let at = texel % (size * size);
        let place = Vec2::new((at % size) as f32, (at / size) as f32) + within;
        assert!(
            (uv * size as f32 - place).abs().max_element() < 1e-5,
            "{texel}"
        );
    }
    // KTX2's left-handed cube: glTF's −Z, straight ahead, is its +Z.
    assert_eq!(face_of(Vec3::NEG_Z).0, 4);
    assert_eq!(face_of(Vec3::X).0, 0);
}

#[test]
fn an_even_light_stays_even_on_all_levels() {
    let size = 32;
    let even = vec![Vec3::new(2.0, 1.0, 0.5); 6 * 32 * 32];
    let all = levels(size, even.clone());
    assert_eq!(all.len(), 4);
    for (k, level) in all.iter().enumerate() {
        let n = (size >> k) as usize;
        assert_eq!(level.len(), 6 * n * n);
        let off = level.iter().map(|t| (*t - even[0]).abs().max_element());
        assert!(off.fold(0.0, f32::max) < 1e-5, "level {k}");
    }
}

/// For light L = ½ (1 + cos θ) around an axis, the lobe's mean along that axis is ½ (1 + m) with m
/// the lobe's mean cosine, weighted by n·l. At roughness 1, D is constant over half vectors, and with
/// c = n·l = 2 h² − 1 the density of c is (uniform in cos² of h, density D cos / 4 …) constant: m =
/// ∫ c² dc / ∫ c dc = ⅔.
#[test]
fn the_roughest_level_has_the_mean_of_its_lobe() {
    let size = 64;
    let light: Vec<Vec3> = (0..6 * size * size)
        .map(|t| Vec3::splat(0.5 * (1.0 + direction(size, t, Vec2::splat(0.5)).y)))
        .collect();
    let all = levels(size, light);
    let rough = all.last().expect("levels");
    let n = SMALLEST;
    let mut worst = 0f32;
    for texel in 0..6 * n * n {
        let y = direction(n, texel, Vec2::splat(0.5)).y;
        let exact = 0.5 * (1.0 + y * 2.0 / 3.0);
        let found = rough[texel as usize].x;
        // 256 samples of a smooth function.
        worst = worst.max((found - exact).abs());
    }
    assert!(worst < 0.01, "{worst}");
}
