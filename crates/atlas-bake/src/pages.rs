//! Lumels into pages, and what each channel holds.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use radiosity::{World, luminance};

use crate::atlas::{Layout, Page};
use crate::bake::{BakeOptions, Directional, Layer};
use crate::dilate::dilate;
use crate::footprint::LumelFootprint;
use crate::gather::Received;
use crate::lumels::{Lumel, Lumels};
use crate::manifest::ValueKind;
use crate::planes::{Plane, Wanted};

/// What pages are made of.
pub(crate) struct Pages<'p, 'w, 'a> {
    pub world: &'w World<'a>,
    pub layout: &'p Layout,
    pub lumels: &'p Lumels,
    pub received: &'p [Received],
    pub options: &'p BakeOptions,
    pub wanted: Wanted,
}

impl Pages<'_, '_, '_> {
    /// The lightmap with its extra channels.
    pub(crate) fn full(&self) -> Vec<Page> {
        let names = self.channel_names();
        let mut values = Vec::new();
        self.fill(&names, |l, r, page, at| {
            let tint = self.tint(l);
            let scale = self.scale();
            page.value[at] = ((r.direct + r.indirect) * tint * scale).to_array();
            values.clear();
            for layer in &self.options.layers {
                self.layer(*layer, l, r, tint, &mut values);
            }
            if let Some(directional) = self.options.directional {
                let moments = &r.planes[self.wanted.moments_plane()..];
                directions(directional, moments, tint * scale, &mut values);
            }
            for ((_, channel), v) in page.layers.iter_mut().zip(&values) {
                channel[at] = *v;
            }
        })
    }

    /// The light of one group alone.
    pub(crate) fn group(&self, group: usize) -> Vec<Page> {
        self.fill(&[], |l, r, page, at| {
            let light = r.planes[group].sum() * self.tint(l) * self.scale();
            page.value[at] = light.to_array();
        })
    }

    /// What irradiance is multiplied with for the pages' values.
    fn scale(&self) -> f32 {
        match self.options.value {
            ValueKind::Radiance => FRAC_1_PI,
            ValueKind::Irradiance | ValueKind::Radiosity => 1.0,
        }
    }

    fn tint(&self, lumel: &Lumel) -> Vec3 {
        match self.options.value {
            ValueKind::Radiosity => self.reflectance(lumel),
            ValueKind::Radiance | ValueKind::Irradiance => Vec3::ONE,
        }
    }

    fn reflectance(&self, lumel: &Lumel) -> Vec3 {
        LumelFootprint::new(self.world, self.lumels, *lumel, 0).mean_reflectance()
    }

    fn layer(&self, layer: Layer, l: &Lumel, r: &Received, tint: Vec3, out: &mut Vec<f32>) {
        let scale = self.scale();
        match layer {
            Layer::Direct => out.extend((r.direct * tint * scale).to_array()),
            Layer::Indirect => out.extend((r.indirect * tint * scale).to_array()),
            Layer::Radiosity => {
                let sent = self.reflectance(l) * (r.direct + r.indirect) * FRAC_1_PI;
                out.extend(sent.to_array());
            }
            Layer::Error => out.push(r.error * luminance(tint) * scale),
            Layer::Coverage => out.push(l.coverage),
            Layer::Ao => {
                let open = r.planes[self.wanted.openness_plane()].sum().x;
                out.push(open.clamp(0.0, 1.0));
            }
            Layer::SunMask => {
                let sun = r.planes[self.wanted.sun_plane()].sum();
                let share = if sun.y > 0.0 { sun.x / sun.y } else { 0.0 };
                out.push(share.clamp(0.0, 1.0));
            }
        }
    }

    fn channel_names(&self) -> Vec<String> {
        let layers = self.options.layers.iter().map(|layer| match layer {
            Layer::Direct => ("direct", "RGB"),
            Layer::Indirect => ("indirect", "RGB"),
            Layer::Radiosity => ("radiosity", "RGB"),
            Layer::Error => ("error", "Y"),
            Layer::Coverage => ("coverage", "Y"),
            Layer::Ao => ("ao", "Y"),
            Layer::SunMask => ("sun_mask", "Y"),
        });
        let directional: &[(&str, &str)] = match self.options.directional {
            None => &[],
            Some(Directional::Sh1) => &[
                ("L0", "RGB"),
                ("L1x", "RGB"),
                ("L1y", "RGB"),
                ("L1z", "RGB"),
            ],
            Some(Directional::Dominant) => &[("dominant", "XYZ")],
        };
        layers
            .chain(directional.iter().copied())
            .flat_map(|(name, parts)| parts.chars().map(move |p| format!("{name}.{p}")))
            .collect()
    }

    /// Pages with these extra channels, to which `put` gives each lumel's values, dilated beyond the charts' borders.
    fn fill(
        &self,
        channels: &[String],
        mut put: impl FnMut(&Lumel, &Received, &mut Page, usize),
    ) -> Vec<Page> {
        let mut pages: Vec<Page> = (self.layout.pages.iter())
            .map(|&[width, height]| {
                let n = width as usize * height as usize;
                Page {
                    width,
                    height,
                    value: vec![[0.0; 3]; n],
                    coverage: vec![0.0; n],
                    layers: (channels.iter())
                        .map(|name| (name.clone(), vec![0.0; n]))
                        .collect(),
                }
            })
            .collect();
        // Which texels hold a value of their own.
        let mut own: Vec<Vec<bool>> = pages.iter().map(|p| vec![false; p.value.len()]).collect();
        for (l, r) in self.lumels.lumels.iter().zip(self.received) {
            let page = &mut pages[l.page as usize];
            let at = l.texel[1] as usize * page.width as usize + l.texel[0] as usize;
            page.coverage[at] = l.coverage;
            own[l.page as usize][at] = true;
            put(l, r, page, at);
        }
        let scene = self.world.scene;
        for (instance, placement) in self.layout.placements.iter().enumerate() {
            let mesh = &scene.meshes[scene.instances[instance].mesh];
            if !mesh.primitives.is_empty() {
                let p = placement.page as usize;
                let rings = self.options.padding + 1;
                dilate(&mut pages[p], &mut own[p], placement.rect, rings);
            }
        }
        pages
    }
}

/// Directional channels from ∫ L dω and ∫ L ω dω; `scale` takes irradiance to the pages' unit.
///
/// Truncated after the first order, radiance gives E(n) = ¼ ∫ L dω + ½ n · ∫ L ω dω (Ramamoorthi & Hanrahan, *An efficient
/// representation for irradiance environment maps*, 2001, with A0 = π and A1 = 2π/3).
fn directions(kind: Directional, moments: &[Plane], scale: Vec3, out: &mut Vec<f32>) {
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
