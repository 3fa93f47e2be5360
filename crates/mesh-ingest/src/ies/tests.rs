//! Damaged files. The meaning of valid ones is tested with whole documents in
//! `tests/ingest/ies.rs`.

use std::f64::consts::PI;

use glam::Vec3;

use super::{Measured, parse};
use crate::error::Kind;
use crate::scene::Profile;

/// A quadrant; a half in the edition of 1995; and planes that stop short of the turn, with an
/// included tilt.
const FILES: [&str; 3] = [
    "IESNA:LM-63-2002\n[TEST] 1\nTILT=NONE\n1 1000 2.0 4 3 1 2 0.1 0.1 0\n1.0 1.0 50\n0 30 60 90\n0 45 90\n\
     100 90 70 1\n100 95 75 2\n100 99 80 3\n",
    "IESNA:LM-63-1995\nTILT=NONE\n1,-1,1,3,3,1,1,0,0,0\n0.9 1 50\n0 45 180\n90 180 270\n1 2 3\n1 4 5\n1 6 7\n",
    "A lamp\nTILT=INCLUDE\n1\n2\n0 90\n1 1\n1 1000 1 2 4 1 1 0 0 0 1 0.5 9\n0 90\n0 90 180 270\n\
     8.5 1e1 8.5 2e1 8.5 .3 8.5 4.\n",
];

/// A linear congruential generator (Knuth's MMIX constants), so that every run has the same damage.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        let next = self.0.wrapping_mul(6364136223846793005);
        self.0 = next.wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n
    }
}

/// Checks the guarantees of [`Profile`], and that every direction gives a number in its range.
fn check(measured: &Measured, bytes: usize) {
    let Profile {
        vertical,
        horizontal,
        values,
    } = &measured.profile;
    assert!(vertical.len() >= 2 && vertical.is_sorted_by(|a, b| a < b));
    assert!(horizontal.is_sorted_by(|a, b| a < b));
    let turn = (horizontal[0], horizontal[horizontal.len() - 1]);
    assert_eq!(turn, (0.0, 360.0));
    assert_eq!(values.len(), vertical.len() * horizontal.len());
    // Each measured value takes a character and a separator, and has at most four images.
    assert!(values.len() <= 2 * bytes);
    assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
    assert!((0.0..=f64::from(f32::MAX)).contains(&measured.candela));
    let tilted = Vec3::new(-1.0, 1e-9, -1e-9);
    let directions = [Vec3::X, Vec3::Y, Vec3::NEG_Y, Vec3::NEG_Z, Vec3::ONE];
    for d in directions.into_iter().chain([tilted, Vec3::ZERO]) {
        // The tolerance is for the rounding of interpolation.
        let value = measured.profile.value(d);
        assert!((0.0..=1.0 + 1e-6).contains(&value), "{d}: {value}");
    }
    // For a sphere of 1; 1e-5 because of 180° in f32.
    let flux = measured.profile.flux();
    assert!((-1e-9..=4.0 * PI + 1e-5).contains(&flux), "{flux}");
}

#[test]
fn thousands_of_damaged_files_end_in_an_answer() {
    let pieces: [&[u8]; 14] = [
        b"0",
        b"9",
        b"-",
        b".",
        b"e9",
        b" ",
        b"\n",
        b"\r",
        b"nan",
        b"1e308",
        b"99999999",
        b"\xff",
        b"TILT=",
        b"\0",
    ];
    let mut random = Random(4);
    let (mut sound, mut broken) = (0, 0);
    for round in 0..20_000 {
        let mut bytes = FILES[round % FILES.len()].as_bytes().to_vec();
        for _ in 0..1 + random.below(3) {
            let at = random.below(bytes.len());
            match random.below(5) {
                0 => bytes.truncate(at.max(1)),
                1 => drop(bytes.splice(at..at + 1, [b' '])),
                2 => bytes[at] = random.below(256) as u8,
                3 => bytes[at] = b'0' + random.below(10) as u8,
                _ => {
                    let piece = pieces[random.below(pieces.len())];
                    drop(bytes.splice(at..at, piece.iter().copied()));
                }
            }
        }
        match parse(&bytes, "a.ies") {
            Ok(measured) => {
                sound += 1;
                check(&measured, bytes.len());
            }
            Err(fault) => {
                broken += 1;
                assert!(matches!(fault.kind, Kind::Invalid | Kind::Unsupported));
                assert_eq!(fault.problem.path, "a.ies");
                assert!(fault.problem.found.len() < 200, "{}", fault.problem);
            }
        }
    }
    // Damage to words and digits is harmless, damage to the structure is not; both must occur
    // often.
    assert!(
        sound > 2000 && broken > 2000,
        "{sound} sound, {broken} broken"
    );
}

#[test]
fn cuts_and_odd_bytes_anywhere_end_in_an_answer() {
    for file in FILES {
        let whole = file.as_bytes();
        let measured = parse(whole, "").map_err(|f| f.problem).unwrap();
        check(&measured, whole.len());
        for end in 0..whole.len() {
            let _ = parse(&whole[..end], "");
        }
        for at in 0..whole.len() {
            for byte in 0..=255 {
                let mut bytes = whole.to_vec();
                bytes[at] = byte;
                if let Ok(measured) = parse(&bytes, "") {
                    check(&measured, bytes.len());
                }
            }
        }
    }
}
