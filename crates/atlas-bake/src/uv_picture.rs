//! Pictures of charts: their places on a lightmap, and their faults.

use atlas::{Bleeding, Layout, MeshAtlas, UvFault, for_each_texel};
use glam::{Vec2, Vec3};
use mesh_ingest::{Mesh, Scene, Soup};
use patch_subdivision::raster::cover_triangle;

use crate::error::Result;
use crate::false_color::encode_png;

/// Meaning of the colours of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Paint {
    /// One colour per chart.
    #[default]
    Charts,
    /// Lumels per metre relative to the requested density: blue at a quarter or less, grey at 1,
    /// orange at four times or more.
    Density,
}

/// Target size of the longest side of a picture, pixels: lumels are enlarged by an integer factor
/// up to this.
const SIDE: u32 = 2048;

/// Longest side of any picture, pixels.
const LONGEST: u32 = 4096;

/// Side of the unit square in pixels, for pictures of an asset's own coordinates.
const UNIT: f32 = 512.0;

/// Smallest size of a lumel, pixels, at which the lumel grid is drawn.
const GRID_FROM: f32 = 8.0;

const OUTSIDE: [u8; 3] = [8, 8, 10];
const EMPTY: [u8; 3] = [34, 34, 40];
const FRAME: [u8; 3] = [230, 230, 230];
const OVERLAP: [u8; 3] = [255, 0, 0];
const BLEEDING: [u8; 3] = [255, 150, 0];
const OUT_OF_RANGE: [u8; 3] = [255, 0, 255];
const MARK: [u8; 3] = [255, 255, 255];

/// A triangle to draw.
struct Piece {
    /// Corners in texels.
    corners: [Vec2; 3],
    /// Triangles of one island share a colour and an outline.
    island: u32,
    /// Lumels per metre, relative to the requested density.
    density: f32,
    /// Seen from behind.
    mirrored: bool,
}

/// The lightmap rectangle of one mesh.
///
/// Charts have different colours, darker where lumels extend beyond them, and stripes where they
/// are mirrored. Overlapping triangles are red, and texels where bilinear lookups read another
/// chart's lumels are orange. Cross-hairs mark the worst places of `faults`. `wanted` is in lumels
/// per metre, and `metres` scales lengths of the mesh to world space (see
/// [`shape_of`](atlas::shape_of)).
///
/// # Errors
/// [`Error::Image`](crate::Error::Image) if the PNG cannot be encoded.
pub fn mesh_picture(
    mesh: &Mesh,
    atlas: &MeshAtlas,
    metres: glam::DMat3,
    wanted: f32,
    faults: &[UvFault],
    paint: Paint,
) -> Result<Vec<u8>> {
    let mut pieces = Vec::new();
    for (primitive, charts) in mesh.primitives.iter().zip(&atlas.primitives) {
        let drawn = charts.triangles.iter().zip(&charts.chart);
        for ((flat, &chart), solid) in drawn.zip(&primitive.triangles) {
            let corners = flat.map(|v| charts.uv[v as usize]);
            let [a, b, c] = solid.map(|v| metres * primitive.positions[v as usize].as_dvec3());
            let area = 0.5 * (b - a).cross(c - a).length();
            pieces.push(Piece {
                corners,
                island: chart,
                density: (f64::from(area_of(&corners).abs()) / area).sqrt() as f32 / wanted,
                mirrored: area_of(&corners) < 0.0,
            });
        }
    }
    mirror_least(&mut pieces);
    let [w, h] = atlas.size.map(|s| s as f32);
    let mut canvas = Canvas::of_texels(atlas.size);
    canvas.draw(&pieces, paint);
    canvas.overlaps(&pieces);
    canvas.bleeding(&pieces, atlas.size);
    canvas.grid();
    canvas.outlines(&pieces);
    canvas.frame(Vec2::ZERO, Vec2::new(w, h));
    for fault in faults {
        if let Some([u, v]) = fault.worst.and_then(|w| w.uv) {
            canvas.cross_hairs(Vec2::new(u * w, v * h));
        }
    }
    canvas.finish()
}

/// An asset's own `TEXCOORD_1` of a mesh as in the file, including faults.
///
/// The light frame is the unit square, with up to one unit around it. Triangles outside the square
/// are magenta, overlaps red.
///
/// # Errors
/// As [`mesh_picture`].
pub fn own_uv_picture(mesh: &Mesh, faults: &[UvFault]) -> Result<Vec<u8>> {
    let mut pieces = Vec::new();
    for primitive in &mesh.primitives {
        let uv = primitive.tex_coords.get(1);
        for triangle in uv.map_or(&[][..], |_| &primitive.triangles) {
            let corners = triangle.map(|v| uv.and_then(|uv| uv.get(v as usize)).copied());
            let [Some(a), Some(b), Some(c)] = corners else {
                continue;
            };
            let corners = [a, b, c].map(|p| p * UNIT);
            if corners.iter().all(|p| p.is_finite()) {
                pieces.push(Piece {
                    corners,
                    island: 0,
                    density: 1.0,
                    mirrored: area_of(&corners) < 0.0,
                });
            }
        }
    }
    mirror_least(&mut pieces);
    join_islands(&mut pieces);
    let slack = 0.01 * UNIT;
    let (mut low, mut high) = (Vec2::splat(-slack), Vec2::splat(UNIT + slack));
    for p in pieces.iter().flat_map(|p| &p.corners) {
        low = low.min(*p - slack);
        high = high.max(*p + slack);
    }
    low = low.max(Vec2::splat(-UNIT));
    high = high.min(Vec2::splat(2.0 * UNIT));
    let mut canvas = Canvas::new(low, high, 1.0);
    canvas.draw(&pieces, Paint::Charts);
    canvas.overlaps(&pieces);
    canvas.out_of_range(&pieces);
    canvas.outlines(&pieces);
    canvas.frame(Vec2::ZERO, Vec2::splat(UNIT));
    for fault in faults {
        if let Some([u, v]) = fault.worst.and_then(|w| w.uv) {
            let at = Vec2::new(u, v) * UNIT;
            canvas.cross_hairs(at.clamp(low + slack, high - slack));
        }
    }
    canvas.finish()
}

/// One page of the lightmap with all its charts, and frames around the rectangles.
///
/// # Errors
/// As [`mesh_picture`].
pub fn page_picture(
    scene: &Scene,
    soup: &Soup,
    layout: &Layout,
    page: usize,
    paint: Paint,
) -> Result<Vec<u8>> {
    let mut pieces = Vec::new();
    let placements = || {
        let all = layout.placements.iter().enumerate();
        all.filter(|(_, p)| p.page as usize == page && p.rect.w > 0)
    };
    for (i, place) in placements() {
        let atlas = &layout.meshes[scene.instances[i].mesh];
        let corner = Vec2::new(place.rect.x as f32, place.rect.y as f32);
        let [first, end] = soup.instance_ranges[i];
        for t in first as usize..end as usize {
            let source = soup.sources[t];
            let charts = &atlas.primitives[source.primitive as usize];
            let Some(flat) = charts.triangles.get(source.triangle as usize) else {
                continue;
            };
            let corners = flat.map(|v| charts.uv[v as usize] + corner);
            let density = (area_of(&corners).abs() / soup.areas[t]).sqrt();
            let chart = charts.chart[source.triangle as usize];
            pieces.push(Piece {
                corners,
                // Gives instances of the same mesh different colours; the charts are disjoint
                // anyway.
                island: chart.wrapping_add((i as u32).wrapping_mul(100_003)),
                density: density / layout.texels_per_unit,
                mirrored: false,
            });
        }
    }
    let mut canvas = Canvas::of_texels(layout.pages[page]);
    canvas.draw(&pieces, paint);
    canvas.overlaps(&pieces);
    canvas.outlines(&pieces);
    for (_, place) in placements() {
        let r = place.rect;
        let low = Vec2::new(r.x as f32, r.y as f32);
        canvas.frame(low, low + Vec2::new(r.w as f32, r.h as f32));
    }
    canvas.finish()
}

/// Assigns the same number to pieces that are connected by edges.
fn join_islands(pieces: &mut [Piece]) {
    let mut edges: Vec<([[u32; 2]; 2], usize)> = Vec::with_capacity(pieces.len() * 3);
    for (i, piece) in pieces.iter().enumerate() {
        edges.extend(piece.edges().map(|e| (e, i)));
    }
    edges.sort_unstable();
    let mut parent: Vec<usize> = (0..pieces.len()).collect();
    let root = |parent: &mut [usize], mut i: usize| {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    };
    for pair in edges.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let (a, b) = (root(&mut parent, pair[0].1), root(&mut parent, pair[1].1));
        parent[a.max(b)] = a.min(b);
    }
    let mut number = vec![u32::MAX; pieces.len()];
    let mut next = 0;
    for (i, piece) in pieces.iter_mut().enumerate() {
        let r = root(&mut parent, i);
        if number[r] == u32::MAX {
            number[r] = next;
            next += 1;
        }
        piece.island = number[r];
    }
}

impl Piece {
    /// Its edges as the bits of their ends, independent of direction.
    fn edges(&self) -> [[[u32; 2]; 2]; 3] {
        let end = |k: usize| {
            (self.corners[k % 3] + Vec2::ZERO)
                .to_array()
                .map(f32::to_bits)
        };
        [0, 1, 2].map(|k| {
            let (a, b) = (end(k), end(k + 1));
            if a < b { [a, b] } else { [b, a] }
        })
    }
}

/// Signed area, with x right and y down.
fn area_of(c: &[Vec2; 3]) -> f32 {
    0.5 * (c[1] - c[0]).perp_dot(c[2] - c[0])
}

/// Treats the smaller part as mirrored, because modelling programs differ in the direction of v.
fn mirror_least(pieces: &mut [Piece]) {
    let sum: f64 = pieces.iter().map(|p| f64::from(area_of(&p.corners))).sum();
    if sum < 0.0 {
        for piece in pieces {
            piece.mirrored = area_of(&piece.corners) > 0.0;
        }
    }
}

/// A picture being drawn.
struct Canvas {
    width: u32,
    height: u32,
    pixels: Vec<[u8; 3]>,
    /// Position of the top left corner, texels.
    low: Vec2,
    /// Pixels per texel.
    scale: f32,
}

impl Canvas {
    /// A canvas for a rectangle of lumels.
    fn of_texels(size: [u32; 2]) -> Canvas {
        let longest = size[0].max(size[1]).max(1);
        let scale = if longest > LONGEST {
            LONGEST as f32 / longest as f32
        } else {
            (SIDE / longest).max(1) as f32
        };
        Canvas::new(Vec2::ZERO, Vec2::new(size[0] as f32, size[1] as f32), scale)
    }

    fn new(low: Vec2, high: Vec2, scale: f32) -> Canvas {
        let size = ((high - low) * scale).ceil().max(Vec2::ONE);
        let (width, height) = (size.x as u32, size.y as u32);
        Canvas {
            width,
            height,
            pixels: vec![EMPTY; width as usize * height as usize],
            low,
            scale,
        }
    }

    fn to_pixels(&self, p: Vec2) -> Vec2 {
        (p - self.low) * self.scale
    }

    fn put(&mut self, x: i64, y: i64, color: [u8; 3]) {
        if (0..i64::from(self.width)).contains(&x) && (0..i64::from(self.height)).contains(&y) {
            self.pixels[y as usize * self.width as usize + x as usize] = color;
        }
    }

    fn at(&self, x: i64, y: i64) -> Option<[u8; 3]> {
        let inside = x >= 0 && y >= 0 && x < self.width.into() && y < self.height.into();
        inside.then(|| self.pixels[y as usize * self.width as usize + x as usize])
    }

    /// Calls `f` with the index, column and row of each pixel whose centre lies in the triangle.
    fn fill(&mut self, corners: &[Vec2; 3], mut f: impl FnMut(&mut [u8; 3], u32, u32)) {
        let c = corners.map(|p| self.to_pixels(p));
        let (size, w) = ([self.width, self.height], self.width as usize);
        for_each_texel(&c, size, |x, y| {
            f(&mut self.pixels[y as usize * w + x as usize], x, y);
        });
    }

    /// Draws the lumels, then the charts on top.
    fn draw(&mut self, pieces: &[Piece], paint: Paint) {
        if self.scale >= 1.0 && self.low == Vec2::ZERO {
            for piece in pieces {
                self.lumels(piece, dim(color_of(piece, paint)));
            }
        }
        for piece in pieces {
            let color = color_of(piece, paint);
            let striped = piece.mirrored && paint == Paint::Charts;
            self.fill(&piece.corners, |pixel, x, y| {
                *pixel = if striped && (x + y) / 4 % 2 == 0 {
                    dim(color)
                } else {
                    color
                };
            });
        }
    }

    /// Fills the texels that a triangle touches.
    fn lumels(&mut self, piece: &Piece, color: [u8; 3]) {
        let s = self.scale as i64;
        let size = [self.width / s as u32, self.height / s as u32].map(|x| x.max(1));
        let corners = piece.corners.map(|p| p.as_dvec2());
        let area = f64::from(area_of(&piece.corners).abs());
        let mut touched = Vec::new();
        cover_triangle(corners, size, |x, y, share| {
            if share * area > 1e-4 {
                touched.push((i64::from(x) * s, i64::from(y) * s));
            }
        });
        for (x, y) in touched {
            for dy in 0..s {
                for dx in 0..s {
                    self.put(x + dx, y + dy, color);
                }
            }
        }
    }

    /// Marks areas that are covered twice.
    fn overlaps(&mut self, pieces: &[Piece]) {
        let mut taken = vec![false; self.pixels.len()];
        let w = self.width as usize;
        for piece in pieces {
            self.fill(&piece.corners, |pixel, x, y| {
                let taken = &mut taken[y as usize * w + x as usize];
                if std::mem::replace(taken, true) {
                    *pixel = OVERLAP;
                }
            });
        }
    }

    /// Marks triangles that leave the unit square.
    fn out_of_range(&mut self, pieces: &[Piece]) {
        let beyond = |p: &Vec2| p.min_element() < -0.05 || p.max_element() > UNIT + 0.05;
        for piece in pieces.iter().filter(|p| p.corners.iter().any(beyond)) {
            self.fill(&piece.corners, |pixel, _, _| {
                if *pixel != OVERLAP {
                    *pixel = OUT_OF_RANGE;
                }
            });
        }
    }

    /// Marks the quarters of texels where lookups read another chart.
    fn bleeding(&mut self, pieces: &[Piece], size: [u32; 2]) {
        if self.scale < 2.0 {
            return;
        }
        let corners: Vec<[Vec2; 3]> = pieces.iter().map(|p| p.corners).collect();
        let chart: Vec<u32> = pieces.iter().map(|p| p.island).collect();
        let mut quarters = Vec::new();
        Bleeding::find(&corners, &chart, size, |x, y| quarters.push((x, y)));
        let half = self.scale * 0.5;
        for (x, y) in quarters {
            let (x0, y0) = (x as f32 * half, y as f32 * half);
            for py in y0 as i64..(y0 + half) as i64 {
                for px in x0 as i64..(x0 + half) as i64 {
                    // Only every other pixel, so that the chart stays visible.
                    if (px + py) % 2 == 0 && self.at(px, py) != Some(OVERLAP) {
                        self.put(px, py, BLEEDING);
                    }
                }
            }
        }
    }

    /// Draws the borders of lumels that are large enough.
    fn grid(&mut self) {
        if self.scale < GRID_FROM {
            return;
        }
        let s = self.scale as u32;
        for (i, pixel) in self.pixels.iter_mut().enumerate() {
            let (x, y) = (i as u32 % self.width, i as u32 / self.width);
            if x % s == 0 || y % s == 0 {
                *pixel = pixel.map(|c| (u16::from(c) * 4 / 5) as u8);
            }
        }
    }

    /// Draws edges that belong to only one triangle of an island.
    fn outlines(&mut self, pieces: &[Piece]) {
        let mut edges: Vec<(u32, [[u32; 2]; 2])> = Vec::with_capacity(pieces.len() * 3);
        for piece in pieces {
            edges.extend(piece.edges().map(|e| (piece.island, e)));
        }
        edges.sort_unstable();
        for run in edges.chunk_by(|a, b| a == b).filter(|run| run.len() == 1) {
            let [a, b] = run[0].1.map(|p| Vec2::from(p.map(f32::from_bits)));
            self.line(a, b, |old| old.map(|c| c / 3));
        }
    }

    fn frame(&mut self, low: Vec2, high: Vec2) {
        // Through the centres of the pixels inside.
        let half = 0.5 / self.scale;
        let (low, inner) = (low + half, high - half);
        let (b, d) = (Vec2::new(inner.x, low.y), Vec2::new(low.x, inner.y));
        for (from, to) in [(low, b), (b, inner), (d, inner), (low, d)] {
            self.line(from, to, |_| FRAME);
        }
    }

    /// Changes the pixels along a line.
    fn line(&mut self, from: Vec2, to: Vec2, change: impl Fn([u8; 3]) -> [u8; 3]) {
        let (a, b) = (self.to_pixels(from), self.to_pixels(to));
        let steps = (b - a).abs().max_element().ceil().clamp(1.0, 1e5) as u32;
        let mut last = (i64::MIN, i64::MIN);
        for i in 0..=steps {
            let p = a.lerp(b, i as f32 / steps as f32).floor();
            let (x, y) = (p.x as i64, p.y as i64);
            let inside = x >= 0 && y >= 0 && x < self.width.into() && y < self.height.into();
            if inside && (x, y) != last {
                let pixel = &mut self.pixels[y as usize * self.width as usize + x as usize];
                *pixel = change(*pixel);
                last = (x, y);
            }
        }
    }

    /// A ring with four ticks.
    fn cross_hairs(&mut self, at: Vec2) {
        let p = self.to_pixels(at).floor();
        let (x, y) = (p.x as i64, p.y as i64);
        for i in 8..20 {
            for (dx, dy) in [(i, 0), (-i, 0), (0, i), (0, -i)] {
                for side in -1..=1 {
                    let color = if side == 0 { MARK } else { OUTSIDE };
                    let (sx, sy) = if dx == 0 { (side, 0) } else { (0, side) };
                    self.put(x + dx + sx, y + dy + sy, color);
                }
            }
        }
    }

    fn finish(self) -> Result<Vec<u8>> {
        encode_png(self.width, self.height, &self.pixels)
    }
}

fn dim(color: [u8; 3]) -> [u8; 3] {
    color.map(|c| c / 2)
}

fn color_of(piece: &Piece, paint: Paint) -> [u8; 3] {
    let color = match paint {
        // Steps near the golden angle give consecutive islands very different hues. Red is reserved
        // for faults.
        Paint::Charts => hue((30 + piece.island.wrapping_mul(137) % 300) as f32),
        Paint::Density => {
            let t = (piece.density.log2() / 2.0).clamp(-1.0, 1.0);
            let (low, middle, high) = (
                Vec3::new(30.0, 80.0, 255.0),
                Vec3::splat(190.0),
                Vec3::new(255.0, 130.0, 0.0),
            );
            match t {
                // No area in space, or none in the chart.
                t if t.is_nan() => Vec3::ZERO,
                t if t < 0.0 => middle.lerp(low, -t),
                t => middle.lerp(high, t),
            }
        }
    };
    color.to_array().map(|c| c.round() as u8)
}

/// A pale colour with this hue in degrees.
fn hue(degrees: f32) -> Vec3 {
    let part = |offset: f32| {
        let k = (offset + degrees / 60.0) % 6.0;
        1.0 - 0.55 * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    Vec3::new(part(5.0), part(3.0), part(1.0)) * 235.0
}
