//! A finished page of the lightmap.

/// One finished lightmap page, row 0 at the top.
///
/// ```
/// use atlas_bake::Page;
///
/// let layers = vec![("error.Y".into(), vec![0.1])];
/// let page = Page { width: 1, height: 1, layers, ..Page::default() };
/// assert_eq!(page.channel("error.Y"), Some(&[0.1][..]));
/// ```
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// R = E/π per texel, linear Rec.709.
    pub value: Vec<[f32; 3]>,
    /// Fraction of each texel covered by surface, 0..=1; 0 for padding and dilated texels.
    pub coverage: Vec<f32>,
    /// Extra channels in the order in which they are written: full channel name (`"direct.R"`) and
    /// one value per texel.
    pub layers: Vec<(String, Vec<f32>)>,
}

impl Page {
    /// The extra channel called `name`, e.g. `"direct.R"` or `"error.Y"`: one value per texel.
    /// `None` if it was not requested.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        let layer = self.layers.iter().find(|(n, _)| n == name)?;
        Some(&layer.1)
    }

    /// Width and height in texels.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (self.value.len() * (16 + 4 * self.layers.len())) as u64
    }
}
