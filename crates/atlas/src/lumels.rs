//! Finds lumels, i.e. texels with a surface, and the triangles under each.

use glam::{DVec2, Vec2};
use mesh_ingest::{Scene, Soup};
use patch_subdivision::raster::cover_triangle;
use rayon::prelude::*;

use crate::atlas::{Layout, MeshAtlas};

/// A texel that is at least partly covered by a surface.
#[derive(Debug, Clone, Copy)]
pub struct Lumel {
    /// Page index.
    pub page: u32,
    /// Column and row on the page.
    pub texel: [u32; 2],
    /// Instance of the scene.
    pub instance: u32,
    /// First of its `count` fragments.
    pub first: u32,
    /// Number of triangles that it touches.
    pub count: u32,
    /// Fraction of the texel covered by the surface, 0..=1.
    pub coverage: f32,
}

/// A soup triangle with its corners on the page, in texels.
#[derive(Debug, Clone, Copy)]
pub struct Fragment {
    /// Index into the [`Soup`].
    pub triangle: u32,
    /// Page positions of the triangle's world corners 0, 1, 2.
    pub corners: [Vec2; 3],
    /// Whether the lumel is on the triangle's back.
    pub back: bool,
    /// The face that the lumel belongs to: `triangle`, or a duplicate of it (see
    /// [`mesh_ingest::Duplicate`]).
    pub face: u32,
}

/// All lumels of a layout, in the order of instances, rows, columns.
///
/// ```
/// use atlas::{LayoutOptions, Lumels, layout};
/// use mesh_ingest::{LoadOptions, Soup, load};
///
/// let cube = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
/// let scene = load(cube.as_ref(), &LoadOptions::default())?.scene;
/// let soup = Soup::build(&scene);
/// let options = LayoutOptions { texels_per_unit: Some(4.0), ..LayoutOptions::default() };
/// let (layout, _) = layout(&scene, &soup, &options, &|_| true)?;
/// let lumels = Lumels::find(&scene, &soup, &layout);
/// for lumel in &lumels.lumels {
///     assert!(lumel.coverage > 0.0 && lumels.fragments(lumel).count() == lumel.count as usize);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Default)]
pub struct Lumels {
    /// The lumels.
    pub lumels: Vec<Lumel>,
    /// Faces under the lumels, indexed by [`Lumel::first`] and [`Lumel::count`].
    faces: Vec<u32>,
    /// Page corners of each face, NaN if unused. Corners of a duplicate are in the order of its
    /// original triangle.
    corners: Vec<[Vec2; 3]>,
    /// For each face, whether its lumels are on its back; empty until [`turn`](Self::turn) is
    /// called.
    turned: Vec<bool>,
    /// For each duplicate: its original triangle, and whether it faces the other way.
    duplicates: Vec<(u32, bool)>,
}

impl Lumels {
    /// Rasterises every instance's charts. Memory: 24 bytes per face, 32 per lumel, 4 per fragment.
    pub fn find(scene: &Scene, soup: &Soup, layout: &Layout) -> Self {
        Lumels::find_of(scene, soup, layout, 0..scene.instances.len())
    }

    /// As [`find`](Self::find), of these instances only, in rising order.
    pub fn find_of(
        scene: &Scene,
        soup: &Soup,
        layout: &Layout,
        instances: impl IntoIterator<Item = usize>,
    ) -> Self {
        let instances: Vec<usize> = instances.into_iter().collect();
        let parts: Vec<InstanceLumels> = (instances.par_iter())
            .map(|&i| rasterise_instance(scene, soup, layout, i))
            .collect();
        let mut all = Lumels::empty(soup);
        for (i, part) in instances.into_iter().zip(parts) {
            let base = all.faces.len() as u32;
            all.lumels.extend(part.lumels.into_iter().map(|l| Lumel {
                first: l.first + base,
                ..l
            }));
            all.faces.extend(part.faces);
            for (face, corners) in faces_of(soup, i).zip(part.corners) {
                all.corners[face as usize] = corners;
            }
        }
        all
    }

    /// Page corners of all faces, without any lumels.
    pub fn corners(scene: &Scene, soup: &Soup, layout: &Layout) -> Self {
        let mut all = Lumels::empty(soup);
        for i in 0..scene.instances.len() {
            for face in faces_of(soup, i) {
                let corners = page_corners(scene, soup, layout, i, face);
                all.corners[face as usize] = corners.unwrap_or([Vec2::NAN; 3]);
            }
        }
        all
    }

    /// No lumels, and no corners.
    fn empty(soup: &Soup) -> Self {
        Lumels {
            corners: vec![[Vec2::NAN; 3]; soup.len() + soup.duplicates.len()],
            duplicates: (soup.duplicates.iter())
                .map(|d| (d.kept, d.turned))
                .collect(),
            ..Lumels::default()
        }
    }

    /// The number of lumels of each instance.
    pub fn count(scene: &Scene, soup: &Soup, layout: &Layout) -> Vec<u32> {
        (0..scene.instances.len())
            .into_par_iter()
            .map(|i| rasterise_instance(scene, soup, layout, i).lumels.len() as u32)
            .collect()
    }

    /// The triangles under a lumel.
    pub fn fragments(&self, lumel: &Lumel) -> impl Iterator<Item = Fragment> + '_ {
        self.faces[lumel.first as usize..(lumel.first + lumel.count) as usize]
            .iter()
            .map(|&face| {
                let own = self.corners.len() - self.duplicates.len();
                let duplicate = (face as usize).checked_sub(own);
                let (triangle, back) = duplicate.map_or((face, false), |d| self.duplicates[d]);
                let turned = self.turned.get(face as usize).is_some_and(|t| *t);
                Fragment {
                    triangle,
                    corners: self.corners[face as usize],
                    back: back != turned,
                    face,
                }
            })
    }

    /// Turns faces over: their lumels move from the front to the back, or vice versa.
    pub fn turn(&mut self, faces: &[u32]) {
        self.turned.resize(self.corners.len(), false);
        for &face in faces {
            self.turned[face as usize] ^= true;
        }
    }

    /// Turns the same faces over as were turned in `other` lumels of the same scene.
    pub fn turn_like(&mut self, other: &Lumels) {
        self.turned.clone_from(&other.turned);
    }

    /// The first face under a lumel.
    pub fn first_face(&self, lumel: &Lumel) -> u32 {
        self.faces[lumel.first as usize]
    }

    /// Page corners of a face, in the order of the world corners of its original triangle; NaN if
    /// it has none.
    pub fn page_corners(&self, face: u32) -> [Vec2; 3] {
        self.corners[face as usize]
    }

    /// Memory in bytes.
    pub fn bytes(&self) -> u64 {
        (self.lumels.len() * size_of::<Lumel>()
            + self.faces.len() * 4
            + self.corners.len() * 24
            + self.turned.len()
            + self.duplicates.len() * 8) as u64
    }
}

/// The lumel of each texel.
pub struct TexelIndex {
    /// Width, height, and lumel index or `u32::MAX` by texel, for each page.
    pages: Vec<(i64, i64, Vec<u32>)>,
}

impl TexelIndex {
    /// The lumels of a layout's pages.
    pub fn build(lumels: &[Lumel], layout: &Layout) -> Self {
        let mut pages: Vec<(i64, i64, Vec<u32>)> = layout
            .pages
            .iter()
            .map(|&[w, h]| (w as i64, h as i64, vec![u32::MAX; w as usize * h as usize]))
            .collect();
        for (i, l) in lumels.iter().enumerate() {
            let (w, _, texels) = &mut pages[l.page as usize];
            texels[l.texel[1] as usize * *w as usize + l.texel[0] as usize] = i as u32;
        }
        TexelIndex { pages }
    }

    /// The lumel at a texel, if there is one; the texel may be outside the page.
    pub fn at(&self, page: u32, x: i64, y: i64) -> Option<usize> {
        let (w, h, texels) = &self.pages[page as usize];
        if x < 0 || y < 0 || x >= *w || y >= *h {
            return None;
        }
        let i = texels[(y * w + x) as usize];
        (i != u32::MAX).then_some(i as usize)
    }
}

struct InstanceLumels {
    lumels: Vec<Lumel>,
    faces: Vec<u32>,
    /// Corners of each face of the instance, in the order of [`faces_of`].
    corners: Vec<[Vec2; 3]>,
}

/// All faces of an instance: its triangles in the soup, and its duplicates of others.
pub fn faces_of(soup: &Soup, instance: usize) -> impl Iterator<Item = u32> + use<> {
    let [start, end] = soup.instance_ranges[instance];
    let [first, last] = soup.duplicate_ranges[instance];
    let n = soup.len() as u32;
    (start..end).chain(n + first..n + last)
}

/// A texel with less coverage is not a lumel: it is hardly visible, and dilation gives it a value.
const LEAST_COVERAGE: f64 = 1e-4;

fn rasterise_instance(
    scene: &Scene,
    soup: &Soup,
    layout: &Layout,
    instance: usize,
) -> InstanceLumels {
    let placement = layout.placements[instance];
    let size = [placement.rect.w, placement.rect.h];
    let mut corners = Vec::new();
    // (Texel in the rectangle, face, covered area in texels.)
    let mut covered: Vec<(u32, u32, f32)> = Vec::new();
    for t in faces_of(soup, instance) {
        let Some(on_page) = page_corners(scene, soup, layout, instance, t) else {
            corners.push([Vec2::NAN; 3]);
            continue;
        };
        corners.push(on_page);
        let own = corners_of(soup, &layout.meshes[scene.instances[instance].mesh], t);
        let d = own.map(|p| DVec2::new(f64::from(p.x), f64::from(p.y)));
        let area = 0.5 * (d[1] - d[0]).perp_dot(d[2] - d[0]).abs();
        if d.iter().all(|p| p.is_finite()) {
            cover_triangle(d, size, |c, r, share| {
                covered.push((r * size[0] + c, t, (share * area) as f32));
            });
        }
    }
    covered.sort_by_key(|c| c.0); // Stable, so triangles stay in order.
    let mut out = InstanceLumels {
        lumels: Vec::new(),
        faces: Vec::with_capacity(covered.len()),
        corners,
    };
    for run in covered.chunk_by(|a, b| a.0 == b.0) {
        let coverage: f64 = run.iter().map(|c| c.2 as f64).sum();
        if coverage < LEAST_COVERAGE {
            continue;
        }
        let first = out.faces.len() as u32;
        out.faces.extend(run.iter().map(|c| c.1));
        out.lumels.push(Lumel {
            page: placement.page,
            texel: [
                placement.rect.x + run[0].0 % size[0],
                placement.rect.y + run[0].0 / size[0],
            ],
            instance: instance as u32,
            first,
            count: run.len() as u32,
            coverage: coverage.min(1.0) as f32,
        });
    }
    out
}

/// Page corners of a face of an instance; `None` if it has no lumels.
fn page_corners(
    scene: &Scene,
    soup: &Soup,
    layout: &Layout,
    instance: usize,
    face: u32,
) -> Option<[Vec2; 3]> {
    let rect = layout.placements[instance].rect;
    let atlas = &layout.meshes[scene.instances[instance].mesh];
    let source = soup.source(face);
    let culled = atlas.primitives.get(source.primitive as usize);
    let culled = culled.and_then(|p| p.culled.get(source.triangle as usize));
    let nobody = culled.copied().unwrap_or(false);
    let receives = scene.receives(instance, source.primitive as usize);
    if rect.w == 0 || rect.h == 0 || nobody || !receives {
        return None;
    }
    let offset = Vec2::new(rect.x as f32, rect.y as f32);
    Some(corners_of(soup, atlas, face).map(|p| p + offset))
}

/// Positions of a face's world corners 0, 1, 2 in the mesh's rectangle; for a duplicate, in the
/// order of its original triangle.
fn corners_of(soup: &Soup, atlas: &MeshAtlas, face: u32) -> [Vec2; 3] {
    let source = soup.source(face);
    let primitive = &atlas.primitives[source.primitive as usize];
    let [a, b, c] = primitive.triangles[source.triangle as usize].map(|v| primitive.uv[v as usize]);
    let own = if source.mirrored {
        [a, c, b]
    } else {
        [a, b, c]
    };
    match soup.duplicate(face) {
        None => own,
        Some(duplicate) => {
            let mut out = own;
            for (place, p) in duplicate.corners.into_iter().zip(own) {
                out[usize::from(place)] = p;
            }
            out
        }
    }
}
