//! Writes lumels to pages and fills each channel.

use std::f32::consts::{FRAC_1_PI, PI};

use atlas::{Layout, Lumel, Lumels, Rect, UvOrigin};
use gather::{LumelFootprint, Plane, Received, Wanted};
use glam::{Vec2, Vec3};
use radiosity::{MASKS, World, luminance};

use crate::channels::{Channel, MASK, TINT, channels, tinted};
use crate::dilate::dilate;
use crate::earlier::{Earlier, Working, Written, restore};
use crate::manifest::ValueKind;
use crate::options::{BakeOptions, Directional, Layer};
use crate::page::Page;
use crate::seams::{EMPTY, Range, SeamReport, Stitcher, Texels, find_samples, stitch};

/// Pages in the making. Lumels are put into them tile by tile.
pub(crate) struct Pages<'p, 'w, 'a> {
    given: Given<'p, 'w, 'a>,
    channels: Vec<Channel>,
    full: Vec<Page>,
    groups: Vec<Vec<Page>>,
    texels: Texels,
    /// The piece of surface whose bilinear lookups read each texel, by page. Only set for texels
    /// next to lumels that have no value of their own.
    readers: Vec<Vec<u32>>,
    /// Number of the first chart of each instance.
    first_charts: Vec<u32>,
}

/// Inputs that pages are made from.
#[derive(Clone, Copy)]
pub(crate) struct Given<'p, 'w, 'a> {
    pub world: &'w World<'a>,
    pub layout: &'p Layout,
    /// What an earlier bake has.
    pub earlier: Option<&'p Earlier>,
    pub options: &'p BakeOptions,
    pub wanted: Wanted,
}

/// Finished pages.
pub(crate) struct Made {
    /// The lightmap's.
    pub pages: Vec<Page>,
    /// Shadow masks.
    pub masks: Vec<Page>,
    /// Those of each group.
    pub groups: Vec<Vec<Page>>,
    /// Report on seams.
    pub seams: SeamReport,
}

impl<'p, 'w, 'a> Pages<'p, 'w, 'a> {
    /// Empty pages, of the lightmap with its extra channels and of each group.
    pub(crate) fn new(given: Given<'p, 'w, 'a>) -> Self {
        let sizes = &given.layout.pages;
        let channels = channels(given.options, given.wanted.masks);
        let blank = |channels: &[Channel]| -> Vec<Page> {
            sizes.iter().map(|&size| blank(size, channels)).collect()
        };
        let texels = |&[w, h]: &[u32; 2]| w as usize * h as usize;
        let none = || sizes.iter().map(|s| vec![EMPTY; texels(s)]).collect();
        let scene = given.world.scene;
        Pages {
            full: blank(&channels),
            groups: (0..given.wanted.groups).map(|_| blank(&[])).collect(),
            texels: Texels {
                chart: none(),
                hidden: sizes.iter().map(|s| vec![false; texels(s)]).collect(),
                kept: Vec::new(),
            },
            readers: none(),
            first_charts: (scene.instances.iter())
                .scan(0, |next, instance| {
                    let first = *next;
                    *next += given.layout.meshes[instance.mesh].charts;
                    Some(first)
                })
                .collect(),
            channels,
            given,
        }
    }

    /// Puts the lumels of whole instances into the pages, with their light; without any, if an
    /// earlier bake has it.
    pub(crate) fn put(&mut self, lumels: &Lumels, received: Option<&[Received]>) {
        let (given, mut values) = (self.given, Vec::new());
        for (i, l) in lumels.lumels.iter().enumerate() {
            let r = received.map(|all| &all[i]);
            let chart = self.chart(lumels, l);
            let p = l.page as usize;
            let at = l.texel[1] as usize * self.full[p].width as usize + l.texel[0] as usize;
            for page in std::iter::once(&mut self.full).chain(&mut self.groups) {
                page[p].coverage[at] = l.coverage;
            }
            self.texels.chart[p][at] = chart;
            self.texels.hidden[p][at] = r.is_some_and(|r| r.open == 0.0);
            let of = OfLumel {
                given,
                lumels,
                lumel: l,
            };
            values.clear();
            let page = &mut self.full[p];
            let Some(r) = r else {
                of.put_tint(page, at);
                continue;
            };
            page.value[at] = of.light(r, &mut values, self.channels.len()).to_array();
            for ((_, channel), v) in page.layers.iter_mut().zip(&values) {
                channel[at] = *v;
            }
            for (group, pages) in self.groups.iter_mut().enumerate() {
                let scale = FRAC_1_PI * of.occlusion(r);
                pages[p].value[at] = (r.planes[group].sum() * scale).to_array();
            }
        }
        self.find_readers(lumels);
    }

    /// Makes the pages, once all lumels are in them.
    pub(crate) fn finish(mut self) -> Made {
        let given = self.given;
        let (world, layout) = (given.world, given.layout);
        // Groups are dilated like the whole.
        for pages in &mut self.groups {
            let mut charts = self.texels.chart.clone();
            given.dilate(pages, &mut charts, &self.readers);
        }
        given.dilate(&mut self.full, &mut self.texels.chart, &self.readers);
        let Pages {
            channels,
            mut full,
            mut groups,
            mut texels,
            readers,
            ..
        } = self;
        drop(readers);
        if let Some(earlier) = given.earlier {
            texels.kept = given.kept_texels(&earlier.anew);
            given.put_earlier(earlier, &channels, &texels.kept, (&mut full, &mut groups));
        }
        let corners = Lumels::corners(world.scene, world.soup, layout);
        let samples = find_samples(world, layout, &corners);
        drop(corners);
        let mut stitcher = Stitcher::new(&samples, &full, &texels);
        drop(samples);
        if given.options.stitch {
            let ranges: Vec<Range> = channels.iter().map(|c| c.range).collect();
            stitch(&mut stitcher, &mut full, &mut groups, &ranges);
        }
        given.apply_floor(&mut full, &texels);
        given.apply_tint(&channels, &mut full, &mut groups);
        given.apply_unit(&channels, &mut full, &mut groups);
        let mut masks = given.split_masks(&mut full);
        if let Some(earlier) = given.earlier {
            let pairs = (earlier.pages.iter().zip(&mut full))
                .chain(earlier.masks.iter().zip(&mut masks))
                .chain((earlier.groups.iter().flatten()).zip(groups.iter_mut().flatten()));
            for ((from, to), kept) in pairs.zip(texels.kept.iter().cycle()) {
                restore(from, to, kept);
            }
        }
        Made {
            masks,
            pages: full,
            groups,
            seams: stitcher.report(),
        }
    }

    /// Number of a lumel's chart, which is that of its first triangle.
    fn chart(&self, lumels: &Lumels, l: &Lumel) -> u32 {
        let Given { world, layout, .. } = self.given;
        let source = world.soup.source(lumels.first_face(l));
        let atlas = &layout.meshes[world.scene.instances[l.instance as usize].mesh];
        let primitive = &atlas.primitives[source.primitive as usize];
        self.first_charts[l.instance as usize] + primitive.chart[source.triangle as usize]
    }

    /// Finds the texels that lookups on these lumels' surfaces read.
    ///
    /// Packing ensures that there is at most one such piece of surface. Its lumels need not be the
    /// texel's only neighbours.
    fn find_readers(&mut self, lumels: &Lumels) {
        for l in &lumels.lumels {
            let page = l.page as usize;
            let (charts, readers) = (&self.texels.chart[page], &mut self.readers[page]);
            let [w, h] = self.given.layout.pages[page].map(i64::from);
            let [x, y] = l.texel.map(i64::from);
            let own = charts[(y * w + x) as usize];
            for (nx, ny) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))) {
                if nx < 0 || ny < 0 || nx >= w || ny >= h {
                    continue;
                }
                let at = (ny * w + nx) as usize;
                if charts[at] != EMPTY || readers[at] == own {
                    continue;
                }
                let middle = Vec2::new(nx as f32 + 0.5, ny as f32 + 0.5);
                if (lumels.fragments(l)).any(|f| within(&f.corners, middle, READ)) {
                    readers[at] = own;
                }
            }
        }
    }
}

/// A page without light, with these extra channels.
fn blank([width, height]: [u32; 2], channels: &[Channel]) -> Page {
    let n = width as usize * height as usize;
    Page {
        width,
        height,
        value: vec![[0.0; 3]; n],
        coverage: vec![0.0; n],
        layers: (channels.iter())
            .map(|channel| (channel.name.clone(), vec![0.0; n]))
            .collect(),
    }
}

impl Given<'_, '_, '_> {
    /// The texels that keep their values, by page: all but those of the instances `anew`.
    fn kept_texels(&self, anew: &[usize]) -> Vec<Vec<bool>> {
        let mut kept: Vec<Vec<bool>> = (self.layout.pages.iter())
            .map(|&[w, h]| vec![true; w as usize * h as usize])
            .collect();
        let mut mark = |instance: usize, keep: bool| {
            let page = self.layout.placements[instance].page as usize;
            let rect = self.own_rect(instance);
            let width = self.layout.pages[page][0] as usize;
            for y in rect.y as usize..(rect.y + rect.h) as usize {
                let row = y * width + rect.x as usize;
                kept[page][row..row + rect.w as usize].fill(keep);
            }
        };
        anew.iter().for_each(|&i| mark(i, false));
        // Rectangles do not overlap. If they did, the earlier bake would keep its texels.
        let mut others: Vec<bool> = vec![true; self.layout.placements.len()];
        anew.iter().for_each(|&i| others[i] = false);
        (0..others.len())
            .filter(|&i| others[i] && self.world.scene.has_lumels(i))
            .for_each(|i| mark(i, true));
        kept
    }

    /// Puts the earlier bake's light into the texels that it keeps.
    fn put_earlier(
        &self,
        earlier: &Earlier,
        channels: &[Channel],
        kept: &[Vec<bool>],
        (full, groups): (&mut [Page], &mut [Vec<Page>]),
    ) {
        let written: Vec<Written> = (channels.iter())
            .map(|channel| Written {
                tint: channel.tint,
                in_unit: channel.in_unit,
            })
            .collect();
        for (p, (page, kept)) in full.iter_mut().zip(kept).enumerate() {
            let tints: Option<[Vec<f32>; 3]> = tinted(self.options).then(|| {
                let first = page.layers.len() - TINT.len();
                std::array::from_fn(|c| page.layers[first + c].1.clone())
            });
            let working = Working {
                value: self.options.value,
                tints: tints.as_ref(),
            };
            working.put(&earlier.pages[p], page, &written, kept);
            for (from, to) in earlier.groups.iter().zip(groups.iter_mut()) {
                working.put(&from[p], &mut to[p], &[], kept);
            }
            if let Some(mask) = earlier.masks.get(p) {
                put_mask(mask, page, kept);
            }
        }
    }

    /// Takes the shadow masks out of the pages.
    fn split_masks(&self, full: &mut [Page]) -> Vec<Page> {
        if !self.wanted.masks {
            return Vec::new();
        }
        let take = |page: &mut Page| {
            let at = page.layers.iter().position(|(name, _)| name == MASK[0]);
            let at = at.unwrap_or(page.layers.len());
            let mut parts: Vec<Vec<f32>> = (page.layers.drain(at..at + MASKS))
                .map(|(_, values)| values)
                .collect();
            let alpha = parts.pop().unwrap_or_default();
            let value = (0..page.value.len())
                .map(|i| std::array::from_fn(|c| parts[c][i]))
                .collect();
            Page {
                width: page.width,
                height: page.height,
                value,
                coverage: page.coverage.clone(),
                layers: vec![("A".into(), alpha)],
            }
        };
        full.iter_mut().map(take).collect()
    }

    /// Raises light to [`BakeOptions::ambient_floor`]. This comes after stitching, because the same
    /// floor on both sides of a seam does not open it.
    fn apply_floor(&self, full: &mut [Page], texels: &Texels) {
        let floor = self.options.ambient_floor;
        if floor == [0.0; 3] {
            return;
        }
        for (page, charts) in full.iter_mut().zip(&texels.chart) {
            for (c, part) in ["L0.R", "L0.G", "L0.B"].into_iter().enumerate() {
                let mut layers = page.layers.iter_mut();
                let mut flat = layers.find(|(name, _)| name == part).map(|l| &mut l.1);
                for (at, v) in page.value.iter_mut().enumerate() {
                    let lacking = (floor[c] - v[c]).max(0.0);
                    if charts[at] == EMPTY || lacking == 0.0 {
                        continue;
                    }
                    v[c] = floor[c];
                    if let Some(flat) = &mut flat {
                        flat[at] += lacking;
                    }
                }
            }
        }
    }

    /// Multiplies channels of reflected light with the surface's reflectance, and removes the tint
    /// channels.
    fn apply_tint(&self, channels: &[Channel], full: &mut [Page], groups: &mut [Vec<Page>]) {
        if !tinted(self.options) {
            return;
        }
        let all = self.options.value == ValueKind::Radiosity;
        for (p, page) in full.iter_mut().enumerate() {
            let tints = page.layers.split_off(page.layers.len() - TINT.len());
            for (layer, channel) in page.layers.iter_mut().zip(channels) {
                let Some(c) = channel.tint else { continue };
                for (v, tint) in layer.1.iter_mut().zip(&tints[c].1) {
                    *v *= tint;
                }
            }
            let groups = groups.iter_mut().map(|pages| &mut pages[p].value);
            for value in std::iter::once(&mut page.value).chain(groups) {
                for (at, v) in value.iter_mut().enumerate().filter(|_| all) {
                    for (v, tint) in v.iter_mut().zip(&tints) {
                        *v *= tint.1[at];
                    }
                }
            }
        }
    }

    /// Converts light from E/π to the pages' unit. This comes last, so that nothing before it
    /// depends on the unit.
    fn apply_unit(&self, channels: &[Channel], full: &mut [Page], groups: &mut [Vec<Page>]) {
        if self.options.value == ValueKind::Radiance {
            return;
        }
        for page in full.iter_mut() {
            for (layer, _) in (page.layers.iter_mut().zip(channels)).filter(|x| x.1.in_unit) {
                layer.1.iter_mut().for_each(|v| *v *= PI);
            }
        }
        for page in full.iter_mut().chain(groups.iter_mut().flatten()) {
            let values = page.value.iter_mut().flatten();
            values.for_each(|v| *v *= PI);
        }
    }

    /// Dilates light beyond chart borders.
    fn dilate(&self, pages: &mut [Page], charts: &mut [Vec<u32>], readers: &[Vec<u32>]) {
        let scene = self.world.scene;
        for (instance, placement) in self.layout.placements.iter().enumerate() {
            let mesh = &scene.meshes[scene.instances[instance].mesh];
            if !mesh.primitives.is_empty() {
                let p = placement.page as usize;
                let rings = self.options.padding + 1;
                let rect = self.own_rect(instance);
                dilate(&mut pages[p], &mut charts[p], &readers[p], rect, rings);
            }
        }
    }

    /// The texels that belong to an instance alone. An asset's own charts may touch their
    /// rectangle's border, so half of the padding around it is included.
    fn own_rect(&self, instance: usize) -> Rect {
        let placement = &self.layout.placements[instance];
        let rect = placement.rect;
        let mesh = self.world.scene.instances[instance].mesh;
        let around = match self.layout.meshes[mesh].origin {
            UvOrigin::Kept if rect.w > 0 && rect.h > 0 => self.options.padding.div_ceil(2),
            _ => return rect,
        };
        let [width, height] = self.layout.pages[placement.page as usize];
        let (x, y) = (rect.x.saturating_sub(around), rect.y.saturating_sub(around));
        Rect {
            x,
            y,
            w: (rect.x + rect.w + around).min(width) - x,
            h: (rect.y + rect.h + around).min(height) - y,
        }
    }
}

/// A lumel, as its values are found.
struct OfLumel<'o, 'p, 'w, 'a> {
    given: Given<'p, 'w, 'a>,
    lumels: &'o Lumels,
    lumel: &'o Lumel,
}

impl OfLumel<'_, '_, '_, '_> {
    /// R without tint; the values of extra channels, of which there are `channels`, go to `values`.
    fn light(&self, r: &Received, values: &mut Vec<f32>, channels: usize) -> Vec3 {
        let Given {
            options, wanted, ..
        } = self.given;
        let scale = FRAC_1_PI * self.occlusion(r);
        for layer in &options.layers {
            self.layer(*layer, r, values);
        }
        if let Some(directional) = options.directional {
            let moments = &r.planes[wanted.moments_plane()..];
            directions(directional, moments, scale, values);
        }
        if wanted.masks {
            values.extend(self.masks(r));
        }
        if channels > values.len() {
            values.extend(self.reflectance().to_array());
        }
        (self.direct(r) + r.indirect) * scale
    }

    /// The reflectance of a lumel that an earlier bake has.
    fn put_tint(&self, page: &mut Page, at: usize) {
        if tinted(self.given.options) {
            let first = page.layers.len() - TINT.len();
            let tints = self.reflectance().to_array();
            for ((_, channel), tint) in page.layers[first..].iter_mut().zip(tints) {
                channel[at] = tint;
            }
        }
    }

    /// Direct light, without lamps that the engine adds.
    fn direct(&self, r: &Received) -> Vec3 {
        let wanted = &self.given.wanted;
        match wanted.kept {
            true => r.planes[wanted.kept_plane()].direct,
            false => r.direct,
        }
    }

    /// The lumel's shadow mask: the share of each lamp's irradiance that arrives. 0 in channels
    /// without a lamp on this instance. 1 where the surface faces away from the lamp: a lookup next
    /// to the terminator would otherwise darken the lit side.
    fn masks(&self, r: &Received) -> [f32; MASKS] {
        let lamps = self.given.world.mask_lamps(self.lumel.instance as usize);
        let found = self.given.wanted.masks_of(&r.planes);
        std::array::from_fn(|c| match (lamps[c], found[c]) {
            (None, _) => 0.0,
            (Some(_), [seen, all]) if all > 0.0 => (seen / all).clamp(0.0, 1.0),
            (Some(_), _) => 1.0,
        })
    }

    /// Openness of a lumel; it must be among the quantities that are recorded.
    fn openness(&self, r: &Received) -> f32 {
        let open = r.planes[self.given.wanted.openness_plane()].sum().x;
        open.clamp(0.0, 1.0)
    }

    /// Factor of [`BakeOptions::ao_multiply`].
    fn occlusion(&self, r: &Received) -> f32 {
        match self.given.options.ao_multiply {
            0.0 => 1.0,
            share => 1.0 - share * (1.0 - self.openness(r)),
        }
    }

    fn reflectance(&self) -> Vec3 {
        LumelFootprint::new(self.given.world, self.lumels, *self.lumel, 0).mean_reflectance()
    }

    fn layer(&self, layer: Layer, r: &Received, out: &mut Vec<f32>) {
        let scale = FRAC_1_PI;
        match layer {
            Layer::Direct => out.extend((self.direct(r) * scale).to_array()),
            Layer::Indirect => out.extend((r.indirect * scale).to_array()),
            // Multiplied by the reflectance at the end.
            Layer::Radiosity => out.extend(((self.direct(r) + r.indirect) * FRAC_1_PI).to_array()),
            Layer::Error => {
                let tint = match self.given.options.value {
                    ValueKind::Radiosity => luminance(self.reflectance()),
                    ValueKind::Radiance | ValueKind::Irradiance => 1.0,
                };
                out.push(r.error() * tint * scale);
            }
            Layer::Coverage => out.push(self.lumel.coverage),
            Layer::Ao => out.push(self.openness(r)),
            Layer::SunMask => {
                let sun = r.planes[self.given.wanted.sun_plane()].sum();
                let share = if sun.y > 0.0 { sun.x / sun.y } else { 0.0 };
                out.push(share.clamp(0.0, 1.0));
            }
        }
    }
}

/// Puts a shadow mask into the texels of a page that `kept` marks.
fn put_mask(mask: &Page, page: &mut Page, kept: &[bool]) {
    for (c, name) in MASK.iter().enumerate() {
        let Some((_, values)) = page.layers.iter_mut().find(|(own, _)| own == name) else {
            continue;
        };
        for at in (0..kept.len()).filter(|&at| kept[at]) {
            values[at] = match (mask.value[at].get(c), mask.channel("A")) {
                (Some(x), _) => *x,
                (None, Some(alpha)) => alpha[at],
                (None, None) => 0.0,
            };
        }
    }
}

/// A bilinear lookup reads a texel if it is less than this far from the texel's centre along both
/// axes: one texel, less the rounding of coordinates (packing allows twice as much).
const READ: f32 = 1.0 - 1e-3;

/// Whether a triangle comes within `reach` of `middle` along both axes, by the separating axis test
/// between the triangle and that square.
fn within(corners: &[Vec2; 3], middle: Vec2, reach: f32) -> bool {
    let p = corners.map(|c| c - middle);
    let parted = |axis: Vec2| {
        let d = p.map(|p| p.dot(axis));
        let low = d[0].min(d[1]).min(d[2]);
        let high = d[0].max(d[1]).max(d[2]);
        let square = reach * (axis.x.abs() + axis.y.abs());
        low >= square || high <= -square
    };
    let sides = [p[1] - p[0], p[2] - p[1], p[0] - p[2]];
    !(parted(Vec2::X) || parted(Vec2::Y) || sides.iter().any(|s| parted(s.perp())))
}

/// Directional channels from ∫ L dω and ∫ L ω dω; `scale` converts irradiance to the pages' unit.
///
/// Truncated after the first order, radiance gives E(n) = ¼ ∫ L dω + ½ n · ∫ L ω dω (Ramamoorthi &
/// Hanrahan, *An efficient representation for irradiance environment maps*, 2001, with A0 = π and
/// A1 = 2π/3).
fn directions(kind: Directional, moments: &[Plane], scale: f32, out: &mut Vec<f32>) {
    match kind {
        Directional::Sh1 => {
            out.extend((moments[0].sum() * scale * 0.25).to_array());
            for m in &moments[1..4] {
                out.extend((m.sum() * scale * 0.5).to_array());
            }
        }
        Directional::Dominant => {
            let all = luminance(moments[0].sum());
            for m in &moments[1..4] {
                let part = luminance(m.sum());
                out.push(if all > 0.0 { part / all } else { 0.0 });
            }
        }
    }
}
