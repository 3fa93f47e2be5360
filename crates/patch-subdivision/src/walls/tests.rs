use glam::Vec3;

use super::*;
use crate::Options;
use crate::subdivision::tests::{quad, soup};

/// A floor of 4 m × 4 m in patches of 0.4 m.
fn floor() -> (mesh_ingest::Soup, Subdivision) {
    let s = soup(quad(Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 4.0));
    let options = Options {
        patches: 100,
        region_share: 1.0,
        ..Options::default()
    };
    let cut = Subdivision::build(&s, |_| false, &options);
    assert_eq!(cut.patches().len(), 100);
    (s, cut)
}

/// No patch is crowded.
fn none(cut: &Subdivision) -> Vec<bool> {
    vec![false; cut.patches().len()]
}

fn position(s: &mesh_ingest::Soup, e: &crate::Element) -> Vec3 {
    let [a, b, c] = s.triangles[e.triangle as usize];
    a + (b - a) * e.u + (c - a) * e.v
}

/// An oblique wall through the floor, without thickness.
fn side(p: Vec3) -> bool {
    p.x + 0.13 * p.z > 1.7
}

/// Points all over the floor, none close to a grid line.
fn points() -> impl Iterator<Item = Vec3> {
    (0..97u32).flat_map(|i| {
        (0..89u32).map(move |k| {
            Vec3::new(
                0.02 + 3.96 * i as f32 / 96.0,
                0.0,
                0.02 + 3.96 * k as f32 / 88.0,
            )
        })
    })
}

fn triangle_at(p: Vec3) -> u32 {
    // The quad's first triangle has z ≥ x.
    u32::from(p.x > p.z)
}

#[test]
fn a_wall_parts_patches_and_stops_interpolation() {
    let (s, mut cut) = floor();
    let pairs = cut.neighbours();
    // Number of inner edges of a grid of 40 × 40 fine cells.
    assert_eq!(pairs.len(), 2 * 40 * 39);
    let sides: Vec<bool> = cut
        .elements()
        .iter()
        .map(|e| side(position(&s, e)))
        .collect();
    let blocked: Vec<bool> = pairs
        .iter()
        .map(|p| sides[p[0] as usize] != sides[p[1] as usize])
        .collect();
    let area: f32 = cut.patches().iter().map(|p| p.area).sum();
    cut.separate(&pairs, &blocked, &none(&cut));
    assert!(cut.has_walls());
    assert!(cut.patches().len() > 105, "{}", cut.patches().len());
    let after: f32 = cut.patches().iter().map(|p| p.area).sum();
    assert!((area - after).abs() < 1e-4, "{area} {after}"); // Rounding of sums.
    let side_of = |patch: u32| {
        let sides: Vec<bool> = cut
            .elements_of(PatchId(patch))
            .map(|k| side(position(&s, &cut.elements()[k])))
            .collect();
        assert!(sides.iter().all(|x| *x == sides[0]), "patch {patch}");
        sides[0]
    };
    for p in 0..cut.patches().len() as u32 {
        side_of(p);
    }
    let mut several = 0;
    for p in points() {
        let t = triangle_at(p);
        let at = cut.locate(t, p, false).expect("the floor is whole");
        let at = cut.on_this_side(t, p, at, |e| side(position(&s, e)) == side(p));
        assert_eq!(side_of(at.patch.0), side(p), "{p}");
        let (taps, n) = cut.taps(t, p, at);
        let sum: f32 = taps[..n].iter().map(|t| t.weight).sum();
        assert!((sum - 1.0).abs() < 1e-6);
        for tap in &taps[..n] {
            assert_eq!(side_of(tap.patch.0), side(p), "{p}");
        }
        several += usize::from(n > 1);
    }
    // Interpolation continues where there is no wall.
    assert!(several > 8000, "{several}");
}

#[test]
fn what_is_buried_under_a_thick_wall_parts_patches_too() {
    // Half a patch thick, so no two elements of different sides are neighbours, and two patches and
    // more, so that whole patches are hidden, some of which reach beyond the wall.
    for half in [0.15, 0.4, 0.45, 0.5, 0.55, 0.6] {
        let (s, mut cut) = floor();
        let place = |p: Vec3| p.x + 0.13 * p.z - 1.7;
        let hidden: Vec<bool> = (cut.elements().iter())
            .map(|e| place(position(&s, e)).abs() < half)
            .collect();
        assert!(hidden.contains(&true));
        cut.hide(&hidden);
        assert_eq!(cut.patches().iter().any(|p| p.hidden), half > 0.3);
        let pairs = cut.neighbours();
        let free = vec![false; pairs.len()];
        cut.separate(&pairs, &free, &none(&cut));
        for p in points().filter(|p| place(*p).abs() > half) {
            let t = triangle_at(p);
            let at = cut.locate(t, p, false).expect("the floor is whole");
            let at = cut.on_this_side(t, p, at, |e| side(position(&s, e)) == side(p));
            assert!(!cut.patches()[at.patch.0 as usize].hidden, "{p}");
            let (taps, n) = cut.taps(t, p, at);
            for tap in &taps[..n] {
                for k in cut.elements_of(tap.patch) {
                    assert_eq!(side(position(&s, &cut.elements()[k])), side(p), "{p}");
                }
            }
        }
    }
}

#[test]
fn without_walls_nothing_changes() {
    let (_, mut cut) = floor();
    let before: Vec<_> = cut
        .patches()
        .iter()
        .map(|p| (p.first_element, p.mask))
        .collect();
    let pairs = cut.neighbours();
    cut.separate(&pairs, &vec![false; pairs.len()], &none(&cut));
    assert!(!cut.has_walls());
    let after: Vec<_> = cut
        .patches()
        .iter()
        .map(|p| (p.first_element, p.mask))
        .collect();
    assert_eq!(before, after);
}

#[test]
fn what_is_crowded_is_cut_into_its_elements() {
    let (s, mut cut) = floor();
    let pairs = cut.neighbours();
    let area: f64 = cut.patches().iter().map(|p| f64::from(p.area)).sum();
    let crowded: Vec<bool> = (0..100).map(|p| p % 10 < 4).collect();
    cut.separate(&pairs, &vec![false; pairs.len()], &crowded);
    assert!(!cut.has_walls());
    assert_eq!(cut.patches().len(), 60 + 40 * 16);
    let after: f64 = cut.patches().iter().map(|p| f64::from(p.area)).sum();
    // The areas of patches are sums of 16 in single precision.
    assert!((area / after - 1.0).abs() < 1e-6, "{area} {after}");
    let mut found = 0;
    for (id, p) in cut.patches().iter().enumerate() {
        assert_eq!(p.elements, if p.fine { 1 } else { 16 });
        for k in cut.elements_of(PatchId(id as u32)) {
            let e = &cut.elements()[k];
            let at = cut.locate(e.triangle, position(&s, e), false).unwrap();
            found += usize::from((at.patch.0, at.element.unwrap().0) == (id as u32, k as u32));
        }
    }
    // A point on a cell's border may round into the next cell.
    assert!(found >= 1590, "{found} of 1600");
    let mut kinds = [0; 2];
    for p in points() {
        let t = triangle_at(p);
        let at = cut.locate(t, p, false).expect("the floor is whole");
        let own = cut.patches()[at.patch.0 as usize].fine;
        let (taps, n) = cut.taps(t, p, at);
        let sum: f32 = taps[..n].iter().map(|t| t.weight).sum();
        assert!((sum - 1.0).abs() < 1e-6);
        if own {
            assert_eq!((n, taps[0].patch.0), (1, at.patch.0), "{p}");
        } else {
            let other = |t: &crate::Tap| cut.patches()[t.patch.0 as usize].fine;
            assert!(!taps[..n].iter().any(other), "{p}");
        }
        kinds[usize::from(own)] += 1;
    }
    assert!(kinds.iter().all(|k| *k > 3000), "{kinds:?}");
}
