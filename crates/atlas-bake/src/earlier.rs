//! The results of an earlier bake, into which a part of a level is baked anew.

use std::f32::consts::PI;

use gather::VertexLight;

use crate::manifest::ValueKind;
use crate::page::Page;

/// Results of an earlier bake of the same level, in the same layout and with the same options.
#[derive(Debug, Default)]
pub struct Earlier {
    /// Lightmap pages as they were written, with their extra channels.
    pub pages: Vec<Page>,
    /// Pages of each light group.
    pub groups: Vec<Vec<Page>>,
    /// Shadow masks.
    pub masks: Vec<Page>,
    /// Irradiance at vertices; of instances that are baked anew, nothing is taken.
    pub vertices: VertexLight,
    /// Instances that are baked anew, in rising order.
    pub anew: Vec<usize>,
}

/// What turns a written page into E/π.
pub(crate) struct Working<'t> {
    /// Quantity in the pages.
    pub value: ValueKind,
    /// Reflectance of each texel, by colour channel, if pages are multiplied with it.
    pub tints: Option<&'t [Vec<f32>; 3]>,
}

/// An extra channel: whether it is multiplied with the reflectance, in which colour channel, and
/// whether it is in the pages' unit.
#[derive(Clone, Copy)]
pub(crate) struct Written {
    pub tint: Option<usize>,
    pub in_unit: bool,
}

impl Working<'_> {
    /// Puts a written page into texels that `kept` marks, as E/π without reflectance, for seams.
    /// The result is as precise as halves are; [`restore`] puts the written values back.
    pub(crate) fn put(&self, from: &Page, to: &mut Page, channels: &[Written], kept: &[bool]) {
        let unit = match self.value {
            ValueKind::Radiance => 1.0,
            ValueKind::Irradiance | ValueKind::Radiosity => 1.0 / PI,
        };
        let without = |c: usize, at: usize, x: f32| match self.tints {
            Some(tints) if tints[c][at] > 0.0 => x / tints[c][at],
            Some(_) => 0.0,
            None => x,
        };
        let all = self.value == ValueKind::Radiosity;
        for at in (0..kept.len()).filter(|&at| kept[at]) {
            for c in 0..3 {
                let x = from.value[at][c] * unit;
                to.value[at][c] = if all { without(c, at, x) } else { x };
            }
            for (k, written) in channels.iter().enumerate() {
                let (name, _) = &to.layers[k];
                let Some(x) = from.channel(name).map(|values| values[at]) else {
                    continue;
                };
                let x = if written.in_unit { x * unit } else { x };
                to.layers[k].1[at] = written.tint.map_or(x, |c| without(c, at, x));
            }
        }
    }
}

/// Puts the written values of a page into texels that `kept` marks.
pub(crate) fn restore(from: &Page, to: &mut Page, kept: &[bool]) {
    for at in (0..kept.len()).filter(|&at| kept[at]) {
        to.value[at] = from.value[at];
    }
    for (name, values) in &mut to.layers {
        let Some(written) = from.channel(name) else {
            continue;
        };
        for at in (0..kept.len()).filter(|&at| kept[at]) {
            values[at] = written[at];
        }
    }
}

impl Earlier {
    /// Takes the light at vertices of instances that are not baked anew.
    pub(crate) fn restore_vertices(&self, light: &mut VertexLight) {
        for (i, of) in self.vertices.instances.iter().enumerate() {
            if self.anew.binary_search(&i).is_err() && !of.is_empty() {
                light.instances[i].clone_from(of);
            }
        }
    }
}
