//! CIE 171:2006, *Test cases to assess the accuracy of lighting computer programs*, cases 5.7 and
//! 5.8.

use glam::DVec3;
use lumel_tests::scenes::closed_form as scenes;

use super::SMOOTH;
use crate::common::{Seen, at, bake, lumels_of, mean};

#[test]
fn case_5_7_diffuse_reflection_with_and_without_an_obstruction() {
    let (lux, rho) = (100.0, 0.6f32);
    for screen in [0.0, 0.5, 1.0, 2.0] {
        let b = bake(&scenes::cie_171_5_7(lux, rho, screen as f32), &at(8.0));
        for l in lumels_of(&b, "s2") {
            // The sun passes the screen edge on; lumels under the screen are left out.
            if l.all(|p| (p.x - 2.0).abs() > 1e-3) {
                assert!((l.red() / f64::from(lux) - 1.0).abs() < 1e-3, "{}", l.red());
            }
        }
        for name in ["s1_v", "s1_hz"] {
            let lumels = lumels_of(&b, name);
            let exact = |l: &Seen| {
                l.mean(|p| {
                    scenes::cie_171_5_7_seen(screen, p.x, p.y)
                        .iter()
                        .map(|&[from, to]| {
                            let corners = [(from, -2.0), (to, -2.0), (to, 2.0), (from, 2.0)]
                                .map(|(x, z)| DVec3::new(x, 0.0, z));
                            let radiance = f64::from(rho * lux) / std::f64::consts::PI;
                            scenes::polygon_irradiance(radiance, &corners, p, l.normal)
                        })
                        .sum()
                })
            };
            let (mut off, mut all) = (0.0, 0.0);
            let mut squares = 0.0;
            for l in &lumels {
                let e = exact(l);
                // On the line of an edge of the floor, the form has no value.
                if e.is_finite() {
                    off += l.red() - e;
                    all += e;
                    squares += (l.red() - e).powi(2);
                }
            }
            let n = lumels.len() as f64;
            // The mean of hundreds of lumels of 128 rays and more, a fifth of which hit:
            // 2/√(128·400) = 0.9 % unstratified.
            assert!(
                (off / all).abs() < SMOOTH,
                "screen {screen}, {name}: {}",
                off / all
            );
            // One lumel: preview's own estimate is some per cent of its gathered light.
            let rms = (squares / n).sqrt() / (all / n);
            assert!(rms < 0.04, "screen {screen}, {name}: {rms}");
        }
    }
}

#[test]
fn case_5_8_internal_reflected_component() {
    // Table 20 of the report: Φ/S_T × ρ/(1 − ρ) with Φ = 10,000 lm and S_T = 96 m².
    for (rho, indirect) in [
        (0.0, 0.0),
        (0.05, 5.48),
        (0.2, 26.04),
        (0.5, 104.17),
        (0.8, 416.67),
        (0.95, 1979.2),
    ] {
        let b = bake(&scenes::cie_171_5_8(rho), &at(6.0));
        let m = mean(&lumels_of(&b, "room"));
        let direct = 10_000.0 / 96.0;
        // Direct light has only the footprint's error; reflected light has that of the solve's
        // reciprocity, some 1e-3 at this quality.
        let exact = direct + indirect;
        assert!((m / exact - 1.0).abs() < 4e-3, "ρ {rho}: {m} {exact}");
        let audit = &b.report.solve.audit;
        assert!(audit.within_bound, "{audit:?}");
        assert_eq!(audit.flux_escaped, [0.0; 3]);
        assert!((audit.flux_emitted[1] / 10_000.0 - 1.0).abs() < 1e-6);
    }
}
