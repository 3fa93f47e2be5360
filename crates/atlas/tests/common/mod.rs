//! Small generated meshes and scenes, and the invariants of every layout.

pub mod nasty;

use atlas::{Layout, MeshAtlas};
use glam::{DAffine3, DVec3, Vec2, Vec3, Vec4};
use mesh_ingest::{AlphaMode, Instance, Material, Mesh, Primitive, Scene, Soup};

pub fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        primitives: vec![Primitive {
            positions,
            source_triangles: (0..triangles.len() as u32).collect(),
            triangles,
            ..Primitive::default()
        }],
        ..Mesh::default()
    }
}

pub fn scene(meshes: Vec<Mesh>, instances: Vec<(usize, DAffine3)>) -> (Scene, Soup) {
    let instances = instances
        .into_iter()
        .enumerate()
        .map(|(node, (mesh, transform))| Instance {
            node,
            name: String::new(),
            copy: None,
            mesh,
            transform,
            occluder: false,
            density: 1.0,
            stands_in: None,
            extras: None,
        })
        .collect();
    let scene = Scene {
        meshes,
        instances,
        materials: vec![default_material()],
        ..Scene::default()
    };
    let soup = Soup::build(&scene);
    (scene, soup)
}

fn default_material() -> Material {
    Material {
        name: String::new(),
        gltf_material: None,
        base_color: Vec4::ONE,
        base_texture: None,
        emissive: Vec3::ZERO,
        emissive_texture: None,
        alpha: AlphaMode::Opaque,
        double_sided: false,
        ..Material::default()
    }
}

pub fn lone(mesh: Mesh) -> (Scene, Soup) {
    scene(vec![mesh], vec![(0, DAffine3::IDENTITY)])
}

/// A rectangle in the plane y = 0, facing up.
pub fn plane(width: f32, depth: f32) -> Mesh {
    mesh(
        vec![
            Vec3::ZERO,
            Vec3::new(0.0, 0.0, depth),
            Vec3::new(width, 0.0, depth),
            Vec3::new(width, 0.0, 0.0),
        ],
        vec![[0, 1, 2], [0, 2, 3]],
    )
}

/// A box with eight shared vertices and no normals.
pub fn cuboid(size: Vec3) -> Mesh {
    let positions = (0..8)
        .map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * size)
        .collect();
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = quads
        .iter()
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
        .collect();
    mesh(positions, triangles)
}

/// A latitude-longitude sphere with `n` rings and smooth normals.
pub fn sphere(n: u32, radius: f32) -> Mesh {
    let columns = 2 * n;
    let mut positions = vec![Vec3::Y * radius];
    for ring in 1..n {
        let a = std::f32::consts::PI * ring as f32 / n as f32;
        for column in 0..columns {
            let b = std::f32::consts::TAU * column as f32 / columns as f32;
            positions.push(Vec3::new(a.sin() * b.cos(), a.cos(), a.sin() * b.sin()) * radius);
        }
    }
    positions.push(Vec3::NEG_Y * radius);
    let last = positions.len() as u32 - 1;
    let at = |ring: u32, column: u32| 1 + (ring - 1) * columns + column % columns;
    let mut triangles = Vec::new();
    for c in 0..columns {
        triangles.push([0, at(1, c + 1), at(1, c)]);
        for r in 1..n - 1 {
            triangles.push([at(r, c), at(r, c + 1), at(r + 1, c)]);
            triangles.push([at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)]);
        }
        triangles.push([last, at(n - 1, c), at(n - 1, c + 1)]);
    }
    let mut mesh = mesh(positions, triangles);
    mesh.primitives[0].normals = mesh.primitives[0]
        .positions
        .iter()
        .map(|p| p.normalize())
        .collect();
    mesh
}

/// Random numbers in 0..1 (xorshift64*), the same in every run.
pub fn random(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// `n` scattered triangles, none touching another.
pub fn loose_triangles(n: u32) -> Mesh {
    let mut r = random(7);
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..n {
        let at = Vec3::new(r(), r(), r()) * 100.0;
        for _ in 0..3 {
            positions.push(at + Vec3::new(r(), r(), r()) * 0.5);
        }
        triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh(positions, triangles)
}

/// A Möbius strip of `n` quads: non-orientable, so windings clash at one edge.
pub fn moebius(n: u32) -> Mesh {
    let mut positions = Vec::new();
    for i in 0..n {
        let a = std::f32::consts::TAU * i as f32 / n as f32;
        for side in [-0.3f32, 0.3] {
            let r = 1.0 + side * (a / 2.0).cos();
            positions.push(Vec3::new(r * a.cos(), side * (a / 2.0).sin(), r * a.sin()));
        }
    }
    let mut triangles = Vec::new();
    for i in 0..n {
        let [a, b] = [2 * i, 2 * i + 1];
        let next = 2 * ((i + 1) % n);
        let [c, d] = if i + 1 == n {
            [next + 1, next]
        } else {
            [next, next + 1]
        };
        triangles.push([a, b, c]);
        triangles.push([b, d, c]);
    }
    mesh(positions, triangles)
}

pub fn at(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}

/// All corners of a mesh's triangles in texels, with their charts.
pub fn corners(atlas: &MeshAtlas) -> Vec<([Vec2; 3], u32)> {
    atlas
        .primitives
        .iter()
        .flat_map(|p| {
            p.triangles
                .iter()
                .zip(&p.chart)
                .map(|(t, &c)| (t.map(|v| p.uv[v as usize]), c))
        })
        .collect()
}

pub fn signed_area(c: &[Vec2; 3]) -> f64 {
    let [a, b, c] = c.map(|p| p.as_dvec2());
    0.5 * (b - a).perp_dot(c - a)
}

/// Every texel for which the open square of half-width `reach` around its centre intersects the
/// triangle, by separating axes. 0.5 gives the texels that it touches, 1 those to which a bilinear
/// lookup on it gives any weight. `f(column, row)`.
fn covered(c: &[Vec2; 3], reach: f64, mut f: impl FnMut(i64, i64)) {
    // Rounding of texel coordinates stored as f32 0..1: a weight of 0.002 counts as zero.
    const SLACK: f64 = 2e-3;
    let p = c.map(|v| v.as_dvec2());
    let low = p[0].min(p[1]).min(p[2]) - reach;
    let high = p[0].max(p[1]).max(p[2]) + reach;
    for y in low.y.floor() as i64..=high.y.floor() as i64 {
        for x in low.x.floor() as i64..=high.x.floor() as i64 {
            let middle = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let half = reach - SLACK;
            let apart = |axis: glam::DVec2| {
                let d = p.map(|v| (v - middle).dot(axis));
                let r = half * (axis.x.abs() + axis.y.abs());
                d[0].min(d[1]).min(d[2]) >= r || d[0].max(d[1]).max(d[2]) <= -r
            };
            let edges = [0, 1, 2].map(|k| (p[(k + 1) % 3] - p[k]).perp());
            if !apart(glam::DVec2::X) && !apart(glam::DVec2::Y) && !edges.into_iter().any(apart) {
                f(x, y);
            }
        }
    }
}

/// The guarantee of `padding`: the reach for [`covered`], and the free texels between the areas
/// that two charts cover with it.
fn promise(padding: u32) -> (f64, i64) {
    match padding {
        0 => (0.5, 0),
        1 => (0.5, 1),
        n => (1.0, i64::from(n) - 2),
    }
}

/// Checks one generated atlas: finite and inside, not inverted, no overlap, charts separated by
/// `padding` and from the border by half of that. Returns the number of covered texels.
pub fn check_generated(atlas: &MeshAtlas, padding: u32) -> usize {
    check_blocks(atlas, padding, 1)
}

/// As [`check_generated`], and no block of `block` × `block` texels is read by lookups in two
/// charts.
pub fn check_blocks(atlas: &MeshAtlas, padding: u32, block: i64) -> usize {
    let [w, h] = atlas.size.map(i64::from);
    let all = corners(atlas);
    let mut owner = vec![u32::MAX; (w * h) as usize];
    let (reach, gap) = promise(padding);
    let border = (gap + 1) / 2;
    for (c, chart) in &all {
        assert!(*chart < atlas.charts, "chart {chart} of {}", atlas.charts);
        assert!(c.iter().all(|p| p.is_finite()));
        assert!(signed_area(c) >= 0.0, "flipped: {c:?} {}", signed_area(c));
        covered(c, reach, |x, y| {
            assert!(
                x >= border && y >= border && x < w - border && y < h - border,
                "chart {chart} reads {x} {y}, within {border} of the border of {w} x {h}: {c:?}"
            );
            let cell = &mut owner[(y * w + x) as usize];
            assert!(
                *cell == u32::MAX || *cell == *chart,
                "texel {x} {y} belongs to charts {} and {chart}",
                *cell
            );
            *cell = *chart;
        });
    }
    let flat: Vec<[Vec2; 3]> = all.iter().map(|x| x.0).collect();
    let overlap = atlas::overlap_share(&flat, atlas.size);
    assert!(overlap == 0.0, "overlap {overlap}");
    for y in 0..h {
        for x in 0..w {
            let here = owner[(y * w + x) as usize];
            if here == u32::MAX {
                continue;
            }
            let (bx, by) = (x / block * block, y / block * block);
            let rows = (y - gap).min(by).max(0)..=(y + gap).max(by + block - 1).min(h - 1);
            for v in rows {
                let columns = (x - gap).min(bx).max(0)..=(x + gap).max(bx + block - 1).min(w - 1);
                for u in columns {
                    let there = owner[(v * w + u) as usize];
                    assert!(
                        there == here || there == u32::MAX,
                        "charts {here} and {there} are too close at {x} {y} for padding {padding}"
                    );
                }
            }
        }
    }
    owner.iter().filter(|&&o| o != u32::MAX).count()
}

/// Rectangles are on their pages, disjoint, and have their mesh's size.
pub fn check_placements(scene: &Scene, layout: &Layout) {
    assert_eq!(layout.placements.len(), scene.instances.len());
    let mut taken: Vec<Vec<bool>> = layout
        .pages
        .iter()
        .map(|p| vec![false; (p[0] * p[1]) as usize])
        .collect();
    for (instance, place) in scene.instances.iter().zip(&layout.placements) {
        let page = layout.pages[place.page as usize];
        let r = place.rect;
        assert_eq!([r.w, r.h], layout.meshes[instance.mesh].size);
        assert!(r.x + r.w <= page[0] && r.y + r.h <= page[1]);
        for y in r.y..r.y + r.h {
            for x in r.x..r.x + r.w {
                let cell = &mut taken[place.page as usize][(y * page[0] + x) as usize];
                assert!(!*cell, "two rectangles at {x} {y}");
                *cell = true;
            }
        }
    }
}
