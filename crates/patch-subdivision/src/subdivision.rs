//! Patches and elements of a whole scene, and the lookup from surface points.

use glam::{DVec2, Vec3};
use mesh_ingest::Soup;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::grid::{
    Fragment, Frame, choose_frame, clip_to_fine, fine_corners, frame_of_cluster, rasterise,
};
use crate::raster::Polygon;
use crate::region::{Between, Connected, RegionOptions, Regions, gather_regions};
use crate::walls::Walls;

/// Index of a patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PatchId(pub u32);

/// Index of an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ElementId(pub u32);

/// How finely a scene is divided.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Target number of patches; the actual number differs, because every region has at least one.
    pub patches: u32,
    /// Largest fraction of the patches that one region may take. Otherwise a ground plane of
    /// several kilometres would determine the patch size of the town on it.
    pub region_share: f32,
    /// How triangles are grouped into regions.
    pub regions: RegionOptions,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            patches: 8_000,
            region_share: 0.15,
            regions: RegionOptions::default(),
        }
    }
}

/// A piece of surface that exchanges light with others.
#[derive(Debug, Clone, Copy)]
pub struct Patch {
    /// Surface area, m².
    pub area: f32,
    /// Index of the first of its `elements` elements.
    pub first_element: u32,
    /// Number of elements, 1..=16.
    pub elements: u16,
    /// The patch's sub × sub cells that have an element (row-major bits).
    pub mask: u16,
    /// Whether the patch is the back of its surface.
    pub back: bool,
    /// Whether all of it is where no light arrives and from where none is seen; see
    /// [`Subdivision::hide`].
    pub hidden: bool,
    /// Whether it is a single element of a cell whose elements are all separate patches; nothing is
    /// interpolated towards or from it.
    pub fine: bool,
    /// Number for random numbers: patches on one side of a region have successive ones, row by row.
    /// It stays the same when other patches are divided, and so do the random numbers.
    pub name: u32,
}

/// The finest piece of surface. It records direct light at one point, drawn uniformly from it or
/// [moved](Subdivision::move_points).
#[derive(Debug, Clone, Copy)]
pub struct Element {
    /// Triangle of the [`Soup`] under the point.
    pub triangle: u32,
    /// Barycentric of world corner 1.
    pub u: f32,
    /// Barycentric of world corner 2.
    pub v: f32,
    /// Surface area that the point represents, m².
    pub area: f32,
}

/// A patch and its weight in an interpolation.
#[derive(Debug, Clone, Copy)]
pub struct Tap {
    /// The patch.
    pub patch: PatchId,
    /// Weight; those of one point sum to 1.
    pub weight: f32,
}

/// Patch and element of a surface point.
#[derive(Debug, Clone, Copy)]
pub struct Locus {
    /// Its patch.
    pub patch: PatchId,
    /// Its element; `None` if its cell contains too little surface for an element.
    pub element: Option<ElementId>,
}

/// Sizes for the report.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Stats {
    /// Number of regions.
    pub regions: u32,
    /// Number of patches.
    pub patches: u32,
    /// Number of elements.
    pub elements: u32,
    /// Nominal edge of a patch, metres.
    pub patch_size: f32,
    /// Memory in bytes.
    pub bytes: u64,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Region {
    pub(crate) frame: Frame,
    /// Start of its row-major table in `tables`.
    pub(crate) table: usize,
    pub(crate) two_sided: bool,
    /// Whether it consists of disconnected pieces in a single cell.
    pub(crate) loose: bool,
}

impl Region {
    /// Fine cells along each axis.
    pub(crate) fn fine(&self) -> [i32; 2] {
        self.frame.cells.map(|c| (c * self.frame.sub) as i32)
    }
}

impl Patch {
    /// The element in the cell of this bit.
    #[inline]
    pub(crate) fn element_of(&self, bit: u16) -> Option<u32> {
        (self.mask & bit != 0).then(|| self.first_element + (self.mask & (bit - 1)).count_ones())
    }
}

const NONE: u32 = u32::MAX;

/// A scene divided into patches and elements.
#[derive(Debug)]
pub struct Subdivision {
    pub(crate) regions: Vec<Region>,
    pub(crate) region_of_triangle: Vec<u32>,
    /// One table of front patches per region, with [`NONE`] for cells without surface.
    pub(crate) tables: Vec<u32>,
    pub(crate) patches: Vec<Patch>,
    pub(crate) elements: Vec<Element>,
    /// Of elements with parts on several triangles, in their order; until some are hidden.
    parts: Vec<Part>,
    pub(crate) walls: Walls,
    patch_size: f32,
}

/// The part of an element on one triangle.
#[derive(Debug, Clone, Copy)]
struct Part {
    element: u32,
    triangle: u32,
    area: f32,
}

/// A point of an element: its triangle, and barycentrics like those of [`Element`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointOn {
    /// The triangle.
    pub triangle: u32,
    /// The barycentrics.
    pub uv: [f32; 2],
}

/// Contribution of one region before numbering.
struct Piece {
    frame: Frame,
    two_sided: bool,
    loose: bool,
    table: Vec<u32>,
    patches: Vec<Patch>,
    elements: Vec<Element>,
    parts: Vec<Part>,
}

impl Subdivision {
    /// Divides the scene. `two_sided` says whether both sides of a triangle reflect or emit; then
    /// both get patches.
    ///
    /// Deterministic for any number of threads; O(n log n) in triangles plus O(elements).
    pub fn build(soup: &Soup, two_sided: impl Fn(usize) -> bool + Sync, options: &Options) -> Self {
        Self::build_among(soup, two_sided, &|_, _, _| false, options)
    }

    /// [`build`](Self::build), but small pieces that face the same way do not become one patch if
    /// something larger than a patch stands between them; up to four places in a patch's size stay
    /// apart. `between` is called at most 156 times for each piece.
    pub fn build_among(
        soup: &Soup,
        two_sided: impl Fn(usize) -> bool + Sync,
        between: &Between,
        options: &Options,
    ) -> Self {
        let connected = Connected::new(soup, &two_sided);
        let size = nominal_size(connected.flat_areas(soup, &options.regions), options);
        let regions = gather_regions(
            soup,
            &connected,
            &two_sided,
            between,
            size,
            &options.regions,
        );
        let cap = options.region_share * options.patches as f32;
        let pieces: Vec<Piece> = (0..regions.len())
            .into_par_iter()
            .map(|r| cut_region(soup, &regions, r, size, cap, &two_sided))
            .collect();
        let mut out = Subdivision {
            regions: Vec::with_capacity(pieces.len()),
            region_of_triangle: regions.of_triangle,
            tables: Vec::new(),
            patches: Vec::new(),
            elements: Vec::new(),
            parts: Vec::new(),
            walls: Walls::default(),
            patch_size: size,
        };
        for piece in pieces {
            out.append(piece);
        }
        out
    }

    fn append(&mut self, piece: Piece) {
        let sides = 1 + piece.two_sided as u32;
        let base = self.patches.len() as u32;
        self.regions.push(Region {
            frame: piece.frame,
            table: self.tables.len(),
            two_sided: piece.two_sided,
            loose: piece.loose,
        });
        self.tables.extend(
            piece
                .table
                .iter()
                .map(|&p| if p == NONE { NONE } else { base + sides * p }),
        );
        let count = piece.patches.len() as u32;
        for (k, patch) in piece.patches.iter().enumerate() {
            let points = patch.first_element as usize
                ..patch.first_element as usize + patch.elements as usize;
            for side in 0..sides {
                self.patches.push(Patch {
                    first_element: self.elements.len() as u32,
                    back: side == 1,
                    name: base + side * count + k as u32,
                    ..*patch
                });
                let first = self.elements.len() as u32;
                let parts = parts_of(&piece.parts, points.start as u32..points.end as u32);
                self.parts.extend(parts.iter().map(|part| Part {
                    element: part.element - patch.first_element + first,
                    ..*part
                }));
                self.elements
                    .extend_from_slice(&piece.elements[points.clone()]);
            }
        }
    }

    /// All patches, by [`PatchId`].
    pub fn patches(&self) -> &[Patch] {
        &self.patches
    }

    /// All elements, by [`ElementId`].
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// The elements of a patch.
    pub fn elements_of(&self, patch: PatchId) -> std::ops::Range<usize> {
        let p = &self.patches[patch.0 as usize];
        p.first_element as usize..p.first_element as usize + p.elements as usize
    }

    /// The region of a triangle; `None` for a triangle that rays do not see.
    pub fn region_of(&self, triangle: u32) -> Option<usize> {
        (self.region_of_triangle.get(triangle as usize)).map(|&region| region as usize)
    }

    /// Nominal edge length of the patches around `triangle`, metres.
    pub fn patch_edge(&self, triangle: u32) -> f32 {
        let region = &self.regions[self.region_of_triangle[triangle as usize] as usize];
        // A surface hardly wider than a line has cells along one axis only.
        let edges = (region.frame.axes.into_iter())
            .filter(|axis| *axis != Vec3::ZERO)
            .map(|axis| 1.0 / axis.length());
        edges.fold(0.0, f32::max)
    }

    /// Patch and element of the point `p` on `triangle`, on its back if `back`. `None` on the back
    /// of a single-sided face, which has no light, and on a triangle that rays do not see.
    #[inline]
    pub fn locate(&self, triangle: u32, p: Vec3, back: bool) -> Option<Locus> {
        let region = &self.regions[self.region_of(triangle)?];
        if back && !region.two_sided {
            return None;
        }
        let f = &region.frame;
        let q = f.project(p);
        let c = q[0].max(0.0).min(f.cells[0] as f32 - 0.5) as u32;
        let r = q[1].max(0.0).min(f.cells[1] as f32 - 0.5) as u32;
        let mut front = self.tables[region.table + (r * f.cells[0] + c) as usize];
        if front == NONE {
            front = self.nearest_patch(region, c, r)?;
        }
        let s = f.sub as f32;
        let sc = (((q[0] - c as f32) * s).max(0.0) as u32).min(f.sub - 1);
        let sr = (((q[1] - r as f32) * s).max(0.0) as u32).min(f.sub - 1);
        let bit = 1u16 << (sr * f.sub + sc);
        let id = self.of_chain(front + (back as u32), bit, f.sub);
        Some(Locus {
            patch: PatchId(id),
            element: self.patches[id as usize].element_of(bit).map(ElementId),
        })
    }

    /// Bilinear weights over the patches around `p` that exist in its region, are not hidden and
    /// not behind a wall; at least one. The arguments are those of a successful
    /// [`locate`](Self::locate).
    #[inline]
    pub fn taps(&self, triangle: u32, p: Vec3, at: Locus) -> ([Tap; 4], usize) {
        let region = &self.regions[self.region_of_triangle[triangle as usize] as usize];
        self.taps_in(region, region.frame.project(p), at)
    }

    /// Position of a point on its region's grid, for [`taps_at`](Self::taps_at).
    pub fn project(&self, triangle: u32, p: Vec3) -> [f32; 2] {
        let region = &self.regions[self.region_of_triangle[triangle as usize] as usize];
        region.frame.project(p)
    }

    /// Centre of an element's cell on the region's grid, like [`project`](Self::project).
    pub fn middle(&self, element: ElementId, soup: &Soup) -> [f32; 2] {
        let e = &self.elements[element.0 as usize];
        let [a, b, c] = soup.triangles[e.triangle as usize];
        let q = self.project(e.triangle, a + (b - a) * e.u + (c - a) * e.v);
        let region = &self.regions[self.region_of_triangle[e.triangle as usize] as usize];
        let sub = region.frame.sub as f32;
        q.map(|x| ((x * sub).floor() + 0.5) / sub)
    }

    /// Further points of an element.
    pub fn points_of<'s>(&'s self, element: ElementId, soup: &'s Soup) -> ElementPoints<'s> {
        let e = &self.elements[element.0 as usize];
        let region = &self.regions[self.region_of_triangle[e.triangle as usize] as usize];
        let (sub, [columns, rows]) = (region.frame.sub as f32, region.fine());
        let [x, y] = self.middle(element, soup).map(|x| (x * sub) as i32);
        ElementPoints {
            soup,
            frame: &region.frame,
            fine: (y.clamp(0, rows - 1) * columns + x.clamp(0, columns - 1)) as u32,
            element,
            triangle: e.triangle,
            parts: parts_of(&self.parts, element.0..element.0 + 1),
            last: None,
        }
    }

    /// The same patches on triangles that those of `from` were divided into. `parents` gives, for
    /// each triangle of `to` that rays see, the one of `from` that it is a part of. `None` if the
    /// parts of a triangle with an element are not there.
    pub fn carried(mut self, from: &Soup, to: &Soup, parents: &[u32]) -> Option<Self> {
        let mut parts: Vec<(u32, u32)> = (parents.iter().zip(0..))
            .map(|(parent, part)| (*parent, part))
            .collect();
        parts.sort_unstable();
        for e in &mut self.elements {
            let first = parts.partition_point(|part| part.0 < e.triangle);
            let own = parts[first..].iter().take_while(|p| p.0 == e.triangle);
            let corners = from.triangles[e.triangle as usize];
            let [a, b, c] = corners;
            let at = a + (b - a) * e.u + (c - a) * e.v;
            let inside = |uv: &[f32; 2]| uv[0].min(uv[1]).min(1.0 - uv[0] - uv[1]);
            (e.triangle, [e.u, e.v]) = own
                .map(|&(_, part)| match to.triangles[part as usize] {
                    same if same == corners => (part, [e.u, e.v]),
                    other => (part, weights(other, at)),
                })
                .max_by(|x, y| inside(&x.1).total_cmp(&inside(&y.1)))
                .map(|(part, uv)| (part, within(uv)))?;
        }
        let regions = parents
            .iter()
            .map(|&parent| self.region_of_triangle[parent as usize]);
        self.region_of_triangle = regions.collect();
        self.parts.clear();
        Some(self)
    }

    /// Moves points of elements.
    pub fn move_points(&mut self, moved: &[(ElementId, PointOn)]) {
        for (element, to) in moved {
            let e = &mut self.elements[element.0 as usize];
            (e.triangle, [e.u, e.v]) = (to.triangle, to.uv);
        }
    }

    /// Reduces the areas of elements to the given shares: the rest is covered by something, and
    /// neither sends light nor receives any. For [`hide`](Self::hide) to count them, first.
    pub fn keep_shares(&mut self, shares: &[(ElementId, f32)]) {
        for (element, share) in shares {
            self.elements[element.0 as usize].area *= share;
        }
    }

    /// [`taps`](Self::taps) of a point given by its position on the region's grid; `None` for an
    /// invalid patch.
    #[inline]
    pub fn taps_at(&self, q: [f32; 2], at: Locus) -> Option<([Tap; 4], usize)> {
        let patch = self.patches.get(at.patch.0 as usize)?;
        let triangle = self.elements.get(patch.first_element as usize)?.triangle;
        let region = &self.regions[self.region_of_triangle[triangle as usize] as usize];
        Some(self.taps_in(region, q, at))
    }

    #[inline]
    fn taps_in(&self, region: &Region, q: [f32; 2], at: Locus) -> ([Tap; 4], usize) {
        let f = &region.frame;
        let own = Tap {
            patch: at.patch,
            weight: 1.0,
        };
        let mut taps = [own; 4];
        if f.cells == [1, 1] || self.patches[at.patch.0 as usize].fine {
            return (taps, 1);
        }
        let back = self.patches[at.patch.0 as usize].back as u32;
        let mut n = 0;
        let mut sum = 0.0;
        let (x, y) = (q[0] - 0.5, q[1] - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        for (k, w) in [
            (1.0 - fx) * (1.0 - fy),
            fx * (1.0 - fy),
            (1.0 - fx) * fy,
            fx * fy,
        ]
        .into_iter()
        .enumerate()
        {
            let c = x0 as i32 + (k & 1) as i32;
            let r = y0 as i32 + (k >> 1) as i32;
            if w <= 0.0 || c < 0 || r < 0 || c >= f.cells[0] as i32 || r >= f.cells[1] as i32 {
                continue;
            }
            let front = self.tables[region.table + (r as u32 * f.cells[0] + c as u32) as usize];
            if front == NONE {
                continue;
            }
            if let Some(patch) = self.reached(at.patch.0, front + back)
                && !self.patches[patch as usize].hidden
                && !self.patches[patch as usize].fine
            {
                taps[n] = Tap {
                    patch: PatchId(patch),
                    weight: w,
                };
                sum += w;
                n += 1;
            }
        }
        if n == 0 || sum < 1e-4 {
            return ([own; 4], 1);
        }
        for t in &mut taps[..n] {
            t.weight /= sum;
        }
        (taps, n)
    }

    /// A point on a cell's border may round into a cell without surface; then a neighbouring cell
    /// contains it.
    #[cold]
    fn nearest_patch(&self, region: &Region, c: u32, r: u32) -> Option<u32> {
        let f = &region.frame;
        for reach in 1..=2i32 {
            for dr in -reach..=reach {
                for dc in -reach..=reach {
                    let (c, r) = (c as i32 + dc, r as i32 + dr);
                    if c >= 0 && r >= 0 && c < f.cells[0] as i32 && r < f.cells[1] as i32 {
                        let p =
                            self.tables[region.table + (r as u32 * f.cells[0] + c as u32) as usize];
                        if p != NONE {
                            return Some(p);
                        }
                    }
                }
            }
        }
        None
    }

    /// Removes the elements flagged in `hidden`: parts of surfaces inside other objects. Light
    /// falls on, and is seen from, only the rest of their patch, and a mean over both would darken
    /// it. Patches that are hidden completely keep their elements, but other patches no longer
    /// interpolate towards them.
    ///
    /// # Panics
    /// If `hidden` does not have one flag per element.
    pub fn hide(&mut self, hidden: &[bool]) {
        assert_eq!(hidden.len(), self.elements.len(), "one flag per element");
        let mut kept = Vec::with_capacity(self.elements.len());
        self.walls.buried = vec![0; self.patches.len()];
        for (patch, buried) in self.patches.iter_mut().zip(&mut self.walls.buried) {
            let first = patch.first_element as usize;
            let range = first..first + patch.elements as usize;
            patch.first_element = kept.len() as u32;
            patch.hidden = hidden[range.clone()].iter().all(|h| *h);
            if patch.hidden {
                *buried = patch.mask;
                kept.extend_from_slice(&self.elements[range]);
                continue;
            }
            // Element k of the patch is its mask's k-th set bit.
            let mut cells = (0..16u16).filter(|b| patch.mask >> b & 1 == 1);
            let (mut mask, mut area) = (0u16, 0.0f32);
            for k in range {
                let cell = cells.next().unwrap_or(0);
                if !hidden[k] {
                    mask |= 1 << cell;
                    area += self.elements[k].area;
                    kept.push(self.elements[k]);
                }
            }
            *buried = patch.mask & !mask;
            (patch.mask, patch.area) = (mask, area);
            patch.elements = (kept.len() - patch.first_element as usize) as u16;
        }
        self.elements = kept;
        // They are numbered anew.
        self.parts = Vec::new();
    }

    /// Sizes for the report.
    pub fn stats(&self) -> Stats {
        Stats {
            regions: self.regions.len() as u32,
            patches: self.patches.len() as u32,
            elements: self.elements.len() as u32,
            patch_size: self.patch_size,
            bytes: (self.regions.len() * size_of::<Region>()
                + (self.region_of_triangle.len() + self.tables.len()) * 4
                + self.patches.len() * size_of::<Patch>()
                + self.elements.len() * size_of::<Element>()
                + self.walls.bytes()) as u64,
        }
    }
}

/// Patch edge length for which about `options.patches` patches cover the scene, with each flat
/// piece of surface limited to its allowed fraction.
fn nominal_size(mut areas: Vec<f64>, options: &Options) -> f32 {
    areas.sort_unstable_by(f64::total_cmp);
    let mut total: f64 = areas.iter().sum();
    // Excludes pieces from the largest on, while they exceed their fraction of the remaining total.
    let share = f64::from(options.region_share);
    let mut capped = 0usize;
    let mut rest = total;
    for &a in areas.iter().rev() {
        let counted = rest / (1.0 - share * capped as f64).max(0.1);
        if a <= share * counted || (capped + 1) as f64 * share >= 0.9 {
            break;
        }
        rest -= a;
        capped += 1;
        total = rest / (1.0 - share * capped as f64);
    }
    let total = total.max(areas.last().copied().unwrap_or(1.0) * 1e-9);
    ((total / options.patches.max(1) as f64).sqrt() as f32).max(f32::MIN_POSITIVE)
}

fn cut_region(
    soup: &Soup,
    regions: &Regions,
    region: usize,
    size: f32,
    cap: f32,
    two_sided: &(impl Fn(usize) -> bool + Sync),
) -> Piece {
    let triangles = regions.triangles(region);
    let area: f32 = triangles.iter().map(|&t| soup.areas[t as usize]).sum();
    let frame = if regions.cluster[region] {
        frame_of_cluster(soup, triangles)
    } else {
        choose_frame(soup, triangles, size.max((area / cap).sqrt()))
    };
    let mut fragments = Vec::new();
    for &t in triangles {
        rasterise(soup, &frame, t, &mut fragments);
    }
    fragments.sort_by_key(|f| f.fine); // Stable, so triangles stay in order.
    let fine_width = frame.cells[0] * frame.sub;
    let cell_of = |fine: u32| {
        let (r, c) = (fine / fine_width / frame.sub, fine % fine_width / frame.sub);
        r * frame.cells[0] + c
    };
    // Elements of one patch must be contiguous: sort fine cells by cell, then by position in the
    // cell.
    let mut runs: Vec<&[Fragment]> = fragments.chunk_by(|a, b| a.fine == b.fine).collect();
    runs.sort_by_key(|run| (cell_of(run[0].fine), run[0].fine));
    let mut piece = Piece {
        frame,
        two_sided: two_sided(triangles[0] as usize),
        loose: regions.cluster[region],
        table: vec![NONE; (frame.cells[0] * frame.cells[1]) as usize],
        patches: Vec::new(),
        elements: Vec::with_capacity(runs.len()),
        parts: Vec::new(),
    };
    for run in runs {
        let fine = run[0].fine;
        let cell = cell_of(fine) as usize;
        if piece.table[cell] == NONE {
            piece.table[cell] = piece.patches.len() as u32;
            piece.patches.push(Patch {
                area: 0.0,
                first_element: piece.elements.len() as u32,
                elements: 0,
                mask: 0,
                back: false,
                hidden: false,
                fine: false,
                name: 0,
            });
        }
        let patch = &mut piece.patches[piece.table[cell] as usize];
        let (r, c) = (fine / fine_width % frame.sub, fine % fine_width % frame.sub);
        patch.mask |= 1 << (r * frame.sub + c);
        patch.elements += 1;
        let number = piece.elements.len() as u32;
        if run.len() > 1 {
            piece.parts.extend(run.iter().map(|f| Part {
                element: number,
                triangle: f.triangle,
                area: f.area,
            }));
        }
        let element = draw_element(soup, &frame, run);
        patch.area += element.area;
        piece.elements.push(element);
    }
    piece
}

/// Draws the element's point uniformly from its surface.
fn draw_element(soup: &Soup, frame: &Frame, run: &[Fragment]) -> Element {
    let area: f32 = run.iter().map(|f| f.area).sum();
    // The random numbers depend only on the first triangle and the cell, so they are the same in
    // every run.
    let seed = hash(run[0].triangle ^ run[0].fine.wrapping_mul(0x9e37_79b9));
    let random = |k: u32| hash(seed.wrapping_add(k)) as f64 / 4294967296.0;
    let areas = run.iter().map(|f| (f.triangle, f.area));
    let triangle = draw_triangle(areas, random(1)).unwrap_or(run[0].triangle);
    let part = Fragmented::new(soup, frame, triangle, run[0].fine);
    let [u, v] = part.draw([random(2), random(3)]);
    Element {
        triangle,
        u,
        v,
        area,
    }
}

/// The parts of a range of elements.
fn parts_of(parts: &[Part], elements: std::ops::Range<u32>) -> &[Part] {
    let from = parts.partition_point(|part| part.element < elements.start);
    let len = parts[from..].partition_point(|part| part.element < elements.end);
    &parts[from..from + len]
}

/// One of triangles, in proportion to the areas of their parts; `None` of none. `x` ∈ [0, 1).
fn draw_triangle(parts: impl Iterator<Item = (u32, f32)> + Clone, x: f64) -> Option<u32> {
    let area: f32 = parts.clone().map(|(_, area)| area).sum();
    let mut left = x as f32 * area;
    let mut chosen = None;
    for (triangle, area) in parts {
        chosen = Some(triangle);
        if left < area {
            break;
        }
        left -= area;
    }
    chosen
}

/// The part of a triangle in a fine cell.
struct Fragmented {
    corners: [DVec2; 3],
    part: Polygon,
}

impl Fragmented {
    fn new(soup: &Soup, frame: &Frame, triangle: u32, fine: u32) -> Self {
        Fragmented {
            corners: fine_corners(soup, frame, triangle),
            part: clip_to_fine(soup, frame, triangle, fine),
        }
    }

    /// Barycentrics in the triangle of a point of the part, given two random numbers.
    fn draw(&self, random: [f64; 2]) -> [f32; 2] {
        let corners = &self.corners;
        let det = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
        let uv = if self.part.n >= 3 && det.abs() > 1e-12 {
            let d: DVec2 = self.part.sample(random[0], random[1]) - corners[0];
            [
                d.perp_dot(corners[2] - corners[0]) / det,
                (corners[1] - corners[0]).perp_dot(d) / det,
            ]
        } else {
            let s = random[0].sqrt();
            [s * (1.0 - random[1]), s * random[1]]
        };
        // Away from the triangle's edges, where a ray could hit an adjacent face.
        uv.map(|x| (x.clamp(0.0, 1.0) * (1.0 - 3e-4) + MARGIN) as f32)
    }
}

/// Least barycentric of an element's point.
const MARGIN: f64 = 1e-4;

/// Barycentrics 1 and 2 in a triangle of the point nearest to `p` in its plane.
pub fn weights([a, b, c]: [Vec3; 3], p: Vec3) -> [f32; 2] {
    let [b, c, p] = [b, c, p].map(|q| (q - a).as_dvec3());
    let normal = b.cross(c);
    let double = normal.length_squared().max(f64::MIN_POSITIVE);
    [p.cross(c), b.cross(p)].map(|part| (normal.dot(part) / double) as f32)
}

/// The nearest barycentrics that are at least [`MARGIN`] inside.
fn within(uv: [f32; 2]) -> [f32; 2] {
    let margin = MARGIN as f32;
    let [u, v] = uv.map(|x| x.max(margin));
    let over = (u + v) / (1.0 - margin);
    if over > 1.0 {
        [u / over, v / over]
    } else {
        [u, v]
    }
}

/// Draws points uniformly from an element.
pub struct ElementPoints<'s> {
    soup: &'s Soup,
    frame: &'s Frame,
    /// Its fine cell.
    fine: u32,
    element: ElementId,
    /// The triangle of its own point.
    triangle: u32,
    /// Its parts, if it has several.
    parts: &'s [Part],
    /// The triangle of the last point, and its part of the element.
    last: Option<(u32, Fragmented)>,
}

impl ElementPoints<'_> {
    /// A point of the element; `number` tells its points apart.
    pub fn draw(&mut self, number: u32) -> PointOn {
        let seed = hash(hash(self.element.0).wrapping_add(number));
        let random = |k: u32| hash(seed.wrapping_add(k)) as f64 / 4294967296.0;
        let areas = (self.parts.iter()).map(|part| (part.triangle, part.area));
        let triangle = draw_triangle(areas, random(3)).unwrap_or(self.triangle);
        let last = self.last.take().filter(|last| last.0 == triangle);
        let (_, part) = self.last.insert(last.unwrap_or_else(|| {
            let part = Fragmented::new(self.soup, self.frame, triangle, self.fine);
            (triangle, part)
        }));
        PointOn {
            triangle,
            uv: part.draw([random(1), random(2)]),
        }
    }
}

/// A 32-bit integer hash (Wellons' `lowbias32`, 2018).
fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

#[cfg(test)]
pub(crate) mod tests;
