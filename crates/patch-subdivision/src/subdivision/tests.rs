use super::*;

pub(crate) fn soup(triangles: Vec<[Vec3; 3]>) -> Soup {
    let mut s = Soup::default();
    for (i, t) in triangles.iter().enumerate() {
        let g = (t[1] - t[0]).cross(t[2] - t[0]);
        s.normals.push(g.normalize());
        s.areas.push(0.5 * g.length());
        s.sources.push(mesh_ingest::TriangleSource {
            instance: 0,
            primitive: 0,
            triangle: i as u32,
            mirrored: false,
        });
        s.materials.push(0);
    }
    s.instance_ranges.push([0, triangles.len() as u32]);
    s.triangles = triangles;
    s
}

pub(crate) fn quad(o: Vec3, a: Vec3, b: Vec3) -> Vec<[Vec3; 3]> {
    vec![[o, o + a, o + a + b], [o, o + a + b, o + b]]
}

fn cube() -> Vec<[Vec3; 3]> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let mut t = quad(Vec3::ZERO, y, x);
    t.extend(quad(Vec3::ZERO, x, z));
    t.extend(quad(Vec3::ZERO, z, y));
    t.extend(quad(Vec3::ONE, -y, -x));
    t.extend(quad(Vec3::ONE, -x, -z));
    t.extend(quad(Vec3::ONE, -z, -y));
    t
}

/// A sphere of `n × 2n` quads split into triangles.
fn sphere(n: usize) -> Vec<[Vec3; 3]> {
    let p = |i: usize, j: usize| {
        let (a, b) = (
            std::f32::consts::PI * i as f32 / n as f32,
            std::f32::consts::PI * j as f32 / n as f32,
        );
        Vec3::new(a.sin() * b.cos(), a.cos(), a.sin() * b.sin())
    };
    let mut t = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            let (a, b, c, d) = (p(i, j), p(i + 1, j), p(i + 1, j + 1), p(i, j + 1));
            for tri in [[a, b, c], [a, c, d]] {
                if (tri[1] - tri[0]).cross(tri[2] - tri[0]).length() > 1e-9 {
                    t.push(tri);
                }
            }
        }
    }
    t
}

#[test]
fn a_cube_has_six_regions_and_its_patches_cover_it_exactly() {
    let s = soup(cube());
    let d = Subdivision::build(
        &s,
        |_| false,
        &Options {
            patches: 600,
            region_share: 0.5,
            ..Options::default()
        },
    );
    assert_eq!(d.stats().regions, 6);
    assert_eq!(d.patches().len(), 600);
    assert_eq!(d.elements().len(), 16 * 600);
    let area: f64 = d.patches().iter().map(|p| p.area as f64).sum();
    // The tolerance is for f32 areas of 9600 elements, each within 1e-6 of its value.
    assert!((area - 6.0).abs() < 1e-5, "{area}");
    // Square cells, so every patch has the same area.
    for p in d.patches() {
        assert!((p.area - 0.01).abs() < 1e-6, "{p:?}");
    }
}

#[test]
fn patches_follow_the_area_and_not_the_tessellation() {
    let few = |n| {
        let s = soup(sphere(n));
        let d = Subdivision::build(
            &s,
            |_| false,
            &Options {
                patches: 200,
                ..Options::default()
            },
        );
        let area: f64 = d.patches().iter().map(|p| p.area as f64).sum();
        let exact: f64 = s.areas.iter().map(|&a| a as f64).sum();
        assert!((area / exact - 1.0).abs() < 1e-5);
        (s.triangles.len(), d.patches().len())
    };
    let (t, coarse) = few(40);
    let (u, dense) = few(160);
    assert!(u > 15 * t);
    assert!(coarse < 900 && dense < 900, "{coarse} and {dense} patches");
}

#[test]
fn loose_small_triangles_are_clustered() {
    // 20,000 leaves of 1 cm in a cube of 1 m.
    let mut t = Vec::new();
    for i in 0..20_000u32 {
        let r = |k: u32| hash(i * 8 + k) as f32 / 4294967296.0;
        let o = Vec3::new(r(0), r(1), r(2));
        let a = Vec3::new(r(3) - 0.5, r(4) - 0.5, r(5) - 0.5) * 0.01;
        let b = Vec3::new(r(6) - 0.5, r(7) - 0.5, 0.1) * 0.01;
        t.push([o, o + a, o + b]);
    }
    let d = Subdivision::build(
        &soup(t),
        |_| false,
        &Options {
            patches: 100,
            ..Options::default()
        },
    );
    assert!(d.patches().len() < 4_000, "{}", d.patches().len());
}

#[test]
fn small_pieces_on_two_sides_of_something_large_stay_apart() {
    // Two leaves face up, one below the other. What is between them is an opaque sheet as wide as
    // the leaves, or one that ends beside them, or another leaf.
    let leaf = |y: f32| quad(Vec3::new(0.1, y, 0.1), 0.1 * Vec3::Z, 0.1 * Vec3::X);
    let sheet = |y: f32, to: f32| {
        let corner = Vec3::new(-10.0, y, -10.0);
        quad(corner, (to + 10.0) * Vec3::X, 20.0 * Vec3::Z)
    };
    let patches = |between: Vec<[Vec3; 3]>| {
        let mut all = leaf(0.6);
        all.extend(leaf(0.2));
        all.extend(&between);
        let s = soup(all);
        // The pieces between lie in planes of one height.
        let crossed = |a: Vec3, b: Vec3, counts: &dyn Fn(u32) -> bool| {
            let Some(corners) = s.triangles.get(4) else {
                return false;
            };
            let t = (corners[0].y - a.y) / (b.y - a.y);
            let at = a + t * (b - a);
            let (low, high) = (s.triangles[4..].iter().flatten())
                .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| {
                    (low.min(*p), high.max(*p))
                });
            let inside = (low.x..high.x).contains(&at.x) && (low.z..high.z).contains(&at.z);
            (0.0..1.0).contains(&t) && inside && counts(4)
        };
        let options = Options {
            patches: 400,
            region_share: 1.0,
            ..Options::default()
        };
        let d = Subdivision::build_among(&s, |_| false, &crossed, &options);
        // Of nominally a metre, so that both leaves are in one voxel.
        let of = |t: u32| {
            let [a, b, c] = s.triangles[t as usize];
            d.locate(t, (a + b + c) / 3.0, false).unwrap().patch
        };
        (of(0) == of(2), d.patch_edge(4).max(d.patch_edge(0)))
    };
    let (together, edge) = patches(sheet(0.4, 10.0));
    assert!(!together && (0.9..1.3).contains(&edge), "{edge}");
    // Both see a point half a metre beside them.
    assert!(patches(sheet(0.4, 0.4)).0);
    let mut small = leaf(0.4);
    small.extend(quad(
        Vec3::new(-10.0, -5.0, -10.0),
        20.0 * Vec3::Z,
        20.0 * Vec3::X,
    ));
    assert!(patches(small).0);
}

#[test]
fn a_cell_has_at_most_four_places_for_small_pieces() {
    // Ten leaves above each other in one voxel; nothing sees anything.
    let mut all = Vec::new();
    for k in 0..10 {
        let corner = Vec3::new(0.1, 0.1 + 0.05 * k as f32, 0.1);
        all.extend(quad(corner, 0.1 * Vec3::Z, 0.1 * Vec3::X));
    }
    let large = all.len() as u32;
    let corner = Vec3::new(-10.0, -5.0, -10.0);
    all.extend(quad(corner, 20.0 * Vec3::Z, 20.0 * Vec3::X));
    let s = soup(all);
    let options = Options {
        patches: 400,
        region_share: 1.0,
        ..Options::default()
    };
    let d = Subdivision::build_among(&s, |_| false, &|_, _, counts| counts(large), &options);
    // The ground's and four of leaves.
    assert_eq!(d.stats().regions, 5);
}

#[test]
fn every_surface_point_finds_its_patch_and_taps_that_sum_to_one() {
    for (s, two) in [
        (soup(cube()), false),
        (soup(sphere(24)), true),
        (
            soup(quad(Vec3::ZERO, Vec3::X * 100.0, Vec3::Y * 0.01)),
            false,
        ),
    ] {
        let d = Subdivision::build(&s, |_| two, &Options::default());
        for i in 0..20_000u32 {
            let t = hash(i) as usize % s.triangles.len();
            let (a, b) = (
                (hash(i ^ 77) as f64 / 4294967296.0).sqrt() as f32,
                hash(i ^ 99) as f32 / 4294967296.0,
            );
            let tri = s.triangles[t];
            let p = tri[0] * (1.0 - a) + tri[1] * (a * (1.0 - b)) + tri[2] * (a * b);
            let at = d.locate(t as u32, p, false).expect("front has a patch");
            assert!(!d.patches()[at.patch.0 as usize].back);
            if let Some(e) = at.element {
                assert!(d.elements_of(at.patch).contains(&(e.0 as usize)));
            }
            let (taps, n) = d.taps(t as u32, p, at);
            let sum: f32 = taps[..n].iter().map(|t| t.weight).sum();
            assert!((sum - 1.0).abs() < 1e-5);
            let behind = d.locate(t as u32, p, true);
            assert_eq!(behind.is_some(), two);
            if let Some(b) = behind {
                assert!(d.patches()[b.patch.0 as usize].back);
            }
        }
    }
}

#[test]
fn element_points_lie_in_their_own_element() {
    let s = soup(cube());
    let d = Subdivision::build(&s, |_| false, &Options::default());
    let mut strays = 0;
    for p in 0..d.patches().len() as u32 {
        for e in d.elements_of(PatchId(p)) {
            let x = d.elements()[e];
            let t = s.triangles[x.triangle as usize];
            let at = t[0] + (t[1] - t[0]) * x.u + (t[2] - t[0]) * x.v;
            let found = d.locate(x.triangle, at, false).unwrap();
            strays += (found.element != Some(ElementId(e as u32))) as u32;
        }
    }
    // Moving points away from edges shifts them by up to 0.1 % of the triangle, a few hundredths of
    // an element.
    assert!(strays as usize * 10 < d.elements().len(), "{strays}");
}

#[test]
fn one_huge_plane_does_not_set_the_size_for_the_rest() {
    let mut t = quad(Vec3::ZERO, Vec3::X * 2000.0, Vec3::Z * -2000.0);
    t.extend(cube());
    let d = Subdivision::build(&soup(t), |_| false, &Options::default());
    assert!(d.stats().patch_size < 0.2, "{}", d.stats().patch_size);
    assert!(d.patches().len() < 20_000, "{}", d.patches().len());
}

/// However many triangles the plane is made of: charts are cut, and grounds are tessellated.
#[test]
fn a_plane_of_many_triangles_counts_as_one() {
    let size = |n: u32| {
        let strip = 2000.0 / n as f32;
        let mut t = Vec::new();
        for k in 0..n {
            let from = Vec3::X * (strip * k as f32);
            t.extend(quad(from, Vec3::X * strip, Vec3::Z * -2000.0));
        }
        t.extend(cube());
        let d = Subdivision::build(&soup(t), |_| false, &Options::default());
        d.stats().patch_size
    };
    assert_eq!(size(1), size(32));
}

#[test]
fn hidden_elements_leave_their_patch_and_hidden_patches_the_interpolation() {
    let soup = soup(quad(Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0));
    let options = Options {
        patches: 16,
        region_share: 1.0,
        ..Options::default()
    };
    let mut cut = Subdivision::build(&soup, |_| false, &options);
    let place = |e: &Element| {
        let [a, b, c] = soup.triangles[e.triangle as usize];
        a + (b - a) * e.u + (c - a) * e.v
    };
    let (patches, before) = (cut.patches().len(), cut.elements().to_vec());
    // x < 1.25 covers one row of patches completely and the next one in part.
    let hidden: Vec<bool> = before.iter().map(|e| place(e).x < 1.25).collect();
    cut.hide(&hidden);
    assert_eq!(cut.patches().len(), patches);
    let (mut whole, mut partly) = (0, 0);
    for (k, patch) in cut.patches().iter().enumerate() {
        let elements = &cut.elements()[cut.elements_of(PatchId(k as u32))];
        assert_eq!(patch.mask.count_ones(), u32::from(patch.elements));
        let area: f32 = elements.iter().map(|e| e.area).sum();
        assert!((area - patch.area).abs() < 1e-5 * area, "{area}"); // f32 sums of sixteen areas.
        if patch.hidden {
            whole += 1;
            assert!(elements.iter().all(|e| place(e).x < 1.25));
            continue;
        }
        partly += u32::from(patch.elements < 16);
        for (n, e) in elements.iter().enumerate() {
            let p = place(e);
            assert!(p.x >= 1.25);
            // The mask still gives the cell of an element.
            let at = cut.locate(e.triangle, p, false).expect("on the quad");
            assert_eq!(at.patch, PatchId(k as u32));
            assert_eq!(at.element, Some(ElementId(patch.first_element + n as u32)));
            let (taps, count) = cut.taps(e.triangle, p, at);
            assert!(
                taps[..count]
                    .iter()
                    .all(|t| !cut.patches()[t.patch.0 as usize].hidden)
            );
        }
    }
    assert!(whole > 0 && partly > 0, "{whole} {partly}");
}
