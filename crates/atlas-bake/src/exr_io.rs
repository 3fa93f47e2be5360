//! Writes lightmap pages as OpenEXR, and reads OpenEXR images.
//!
//! The format is one that every tested reader accepts: half floats, scanlines, ZIP in blocks of 16
//! rows, one part, row 0 at the top. The header does not depend on time, place or machine, so equal
//! pages give equal bytes for any number of threads.

use std::collections::BTreeSet;
use std::io::{BufReader, Cursor, Seek};
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, ReadChannels, ReadLayers, SmallVec, Text, WritableImage,
    attribute::AttributeValue, attribute::Chromaticities, read as exr_read,
};
use half::f16;
use mesh_ingest::open_regular;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::page::Page;

/// Largest finite half: 2^16 − 2^5.
pub const HALF_MAX: f32 = 65504.0;

/// Name of the only custom attribute. The `exr` crate keeps custom attributes in a hash map, so two
/// of them would be written in random order.
const ATTRIBUTE: &str = "lumel";

/// Most bytes of `f32` that [`read_exr`] unpacks: 16 channels of 8192².
pub const READ_LIMIT: u64 = 16 * 8192 * 8192 * 4;

/// Upper bound of samples per byte of a file. DEFLATE has the highest compression of EXR's methods:
/// at most 258 bytes in two bits, i.e. 516 halves per byte. Doubled for safety.
const SAMPLES_PER_BYTE: u64 = 1032;

/// Changes that [`write_lightmap_exr`] made to store a page as halves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct ExrStats {
    /// Samples beyond ±65504, stored as ±65504.
    pub clamped: u64,
    /// Samples that were NaN or infinite, stored as 0.
    pub non_finite: u64,
    /// Samples of R, G or B below zero, stored as 0. Light is never negative, but extra layers keep
    /// their sign.
    pub negative: u64,
}

impl std::ops::AddAssign for ExrStats {
    fn add_assign(&mut self, other: Self) {
        self.clamped += other.clamped;
        self.non_finite += other.non_finite;
        self.negative += other.negative;
    }
}

/// Optional contents of the file.
#[derive(Debug, Clone, Default)]
pub struct ExrOptions {
    /// Text of the custom attribute `lumel`, usually JSON; `None` writes no attribute.
    pub metadata: Option<String>,
    /// Write [`Page::coverage`] as channel `coverage.Y`.
    pub coverage: bool,
}

/// Encodes `page` as an OpenEXR file: `R`, `G`, `B`, and [`Page::layers`] as extra channels. All
/// are halves, and sorted by name in the file, as the format requires.
///
/// # Errors
/// [`Error::Inconsistent`] if a channel's length is not `width × height`, the page is empty, or two
/// channels share a name.
pub fn write_lightmap_exr(page: &Page, options: &ExrOptions) -> Result<(Vec<u8>, ExrStats)> {
    let texels = page.width as usize * page.height as usize;
    let expect = |name: &str, got: usize| {
        if got == texels && texels > 0 {
            return Ok(());
        }
        Err(Error::Inconsistent {
            at: format!("lightmap channel {name}"),
            message: format!(
                "expected {} x {} samples and at least one, got {got}",
                page.width, page.height
            ),
        })
    };
    expect("RGB", page.value.len())?;
    let mut stats = ExrStats::default();
    let mut list: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
    let mut names = BTreeSet::new();
    let mut push = |name: &str, (samples, s): (Vec<f16>, ExrStats)| {
        if !names.insert(name.to_owned()) {
            return Err(Error::Inconsistent {
                at: format!("lightmap channel {name}"),
                message: "given twice".into(),
            });
        }
        let Some(text) = Text::new_or_none(name) else {
            return Err(Error::Inconsistent {
                at: format!("lightmap channel {name}"),
                message: "its name is not plain text".into(),
            });
        };
        stats += s;
        list.push(AnyChannel::new(text, FlatSamples::F16(samples)));
        Ok(())
    };
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        push(name, to_half(texels, false, |i| page.value[i][c]))?;
    }
    if options.coverage {
        expect("coverage.Y", page.coverage.len())?;
        push("coverage.Y", to_half(texels, true, |i| page.coverage[i]))?;
    }
    for (name, values) in &page.layers {
        expect(name, values.len())?;
        push(name, to_half(texels, true, |i| values[i]))?;
    }

    let mut attributes = LayerAttributes::default();
    if let Some(json) = &options.metadata {
        let text = Text::new_or_none(json).ok_or_else(|| Error::Inconsistent {
            at: "EXR attribute lumel".into(),
            message: "its text has characters beyond U+00FF".into(),
        })?;
        attributes
            .other
            .insert(Text::from(ATTRIBUTE), AttributeValue::Text(text));
    }
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let size = (page.width as usize, page.height as usize);
    let mut image = Image::from_layer(Layer::new(
        size,
        attributes,
        encoding,
        AnyChannels::sort(list),
    ));
    // Rec. ITU-R BT.709-6, table 1.3 and 1.4: primaries and D65 white.
    image.attributes.chromaticities = Some(Chromaticities {
        red: exr::prelude::Vec2(0.640, 0.330),
        green: exr::prelude::Vec2(0.300, 0.600),
        blue: exr::prelude::Vec2(0.150, 0.060),
        white: exr::prelude::Vec2(0.3127, 0.3290),
    });
    let mut bytes = Vec::new();
    image
        .write()
        .to_buffered(Cursor::new(&mut bytes))
        .map_err(|e| Error::Image {
            what: "lightmap EXR".into(),
            message: e.to_string(),
        })?;
    Ok((bytes, stats))
}

/// Converts `n` samples to halves and counts the changes. `signed` samples may be negative.
fn to_half(n: usize, signed: bool, sample: impl Fn(usize) -> f32 + Sync) -> (Vec<f16>, ExrStats) {
    // Integer counts do not depend on how rayon splits the work.
    let mut out = vec![f16::ZERO; n];
    let stats = out
        .par_iter_mut()
        .with_min_len(4096)
        .enumerate()
        .map(|(i, h)| {
            let x = sample(i);
            let mut s = ExrStats::default();
            *h = if !x.is_finite() {
                s.non_finite = 1;
                f16::ZERO
            } else if x < 0.0 && !signed {
                s.negative = 1;
                f16::ZERO
            } else {
                s.clamped = u64::from(x.abs() > HALF_MAX);
                // −0, and tiny negatives that round to −0, would make the bytes of equal pages
                // differ.
                let h = f16::from_f32(x.clamp(-HALF_MAX, HALF_MAX));
                if h == f16::ZERO { f16::ZERO } else { h }
            };
            s
        })
        .reduce(ExrStats::default, |mut a, b| {
            a += b;
            a
        });
    (out, stats)
}

/// The sample that a file has for `x`. Other formats start from it, so that they do not change
/// where a bake is continued from its file.
pub(crate) fn as_stored(x: f32) -> f32 {
    f16::from_f32(x.clamp(-HALF_MAX, HALF_MAX)).to_f32()
}

/// An OpenEXR image as numbers.
#[derive(Debug, Clone, Default)]
pub struct ExrImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Name and `width × height` samples of each channel, row 0 at the top, in the file's order
    /// (sorted by name).
    pub channels: Vec<(String, Vec<f32>)>,
}

impl ExrImage {
    /// Samples of the channel called `name`.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels
            .iter()
            .find(|(n, _)| n == name)
            .map(|(_, v)| v.as_slice())
    }
}

/// Reads the first part of an OpenEXR file, with every channel as `f32`.
///
/// # Errors
/// [`Error::Io`] if the file cannot be opened. [`Error::Image`] if it is not an OpenEXR image of
/// flat scanlines or tiles in a supported compression, or would unpack to more than 4 GiB or more
/// than a file of its size can hold.
pub fn read_exr(path: &Path) -> Result<ExrImage> {
    read_exr_within(path, READ_LIMIT)
}

/// As [`read_exr`], for an image that unpacks to at most `limit` bytes.
///
/// # Errors
/// As [`read_exr`].
pub fn read_exr_within(path: &Path, limit: u64) -> Result<ExrImage> {
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    let bad = |e: exr::error::Error| Error::Image {
        what: path.display().to_string(),
        message: e.to_string(),
    };
    // The header is read first, so that a small file that claims huge dimensions is refused before
    // memory is allocated.
    let file = open_regular(path).map_err(io)?;
    let stored = file.metadata().map_err(io)?.len();
    let mut file = BufReader::new(file);
    let meta = MetaData::read_from_buffered(&mut file, false).map_err(bad)?;
    // The product of sizes from the file may overflow.
    for header in &meta.headers {
        let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
        let channels = header.channels.list.len() as u64;
        let samples = width.saturating_mul(height).saturating_mul(channels);
        let most = stored.saturating_mul(SAMPLES_PER_BYTE);
        let why = if samples > limit / 4 {
            format!("at most {} samples", limit / 4)
        } else if samples > most {
            format!("at most the {most} samples that {stored} bytes can hold")
        } else {
            continue;
        };
        return Err(Error::Image {
            what: path.display().to_string(),
            message: format!(
                "found {width} x {height} pixels of {channels} channels, expected {why}"
            ),
        });
    }
    let image = exr_read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes();
    file.rewind().map_err(io)?;
    let image = image.from_buffered(file).map_err(bad)?;
    let layer = image.layer_data;
    let n = layer.size.0 * layer.size.1;
    let mut channels = Vec::with_capacity(layer.channel_data.list.len());
    for c in layer.channel_data.list {
        let values: Vec<f32> = c.sample_data.values_as_f32().collect();
        if values.len() != n {
            return Err(Error::Image {
                what: path.display().to_string(),
                message: format!("channel {} is subsampled", c.name),
            });
        }
        channels.push((c.name.to_string(), values));
    }
    Ok(ExrImage {
        width: layer.size.0 as u32,
        height: layer.size.1 as u32,
        channels,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(width: u32, height: u32) -> Page {
        let n = (width * height) as usize;
        // A cheap integer hash: values over the whole half range, incompressible.
        let x =
            |i: usize| (((i as u32).wrapping_mul(2_654_435_761) >> 8) as f32 / 1e4).min(60000.0);
        Page {
            width,
            height,
            value: (0..n)
                .map(|i| [x(3 * i), x(3 * i + 1), x(3 * i + 2)])
                .collect(),
            coverage: (0..n).map(|i| (i % 3) as f32 / 2.0).collect(),
            layers: vec![
                ("error.Y".into(), vec![-0.25; n]),
                ("direct.R".into(), vec![1.0; n]),
            ],
        }
    }

    fn write_to(dir: &tempfile::TempDir, bytes: &[u8]) -> std::path::PathBuf {
        let path = dir.path().join("x.exr");
        std::fs::write(&path, bytes).unwrap();
        path
    }

    #[test]
    fn reads_back_every_channel_to_half_precision() {
        let p = page(67, 41);
        let options = ExrOptions {
            metadata: Some("{\"value\":\"radiance\"}".into()),
            coverage: true,
        };
        let (bytes, stats) = write_lightmap_exr(&p, &options).unwrap();
        assert_eq!(stats, ExrStats::default());
        let dir = tempfile::tempdir().unwrap();
        let back = read_exr(&write_to(&dir, &bytes)).unwrap();
        assert_eq!([back.width, back.height], [67, 41]);
        let names: Vec<_> = back.channels.iter().map(|c| c.0.as_str()).collect();
        assert_eq!(names, ["B", "G", "R", "coverage.Y", "direct.R", "error.Y"]);
        for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
            for (got, want) in back.channel(name).unwrap().iter().zip(&p.value) {
                // A half has 11 significant bits, so rounding to nearest errs by at most 2^-11 of
                // the value (2^-25 below 2^-14).
                assert!(
                    (got - want[c]).abs() <= want[c] * 2f32.powi(-11) + 2f32.powi(-25),
                    "{name}: {got} for {}",
                    want[c]
                );
            }
        }
        assert_eq!(back.channel("coverage.Y").unwrap(), p.coverage);
        assert!(back.channel("error.Y").unwrap().iter().all(|x| *x == -0.25));
    }

    #[test]
    fn row_0_is_the_top_row_of_the_file() {
        let mut p = Page {
            width: 1,
            height: 2,
            value: vec![[1.0; 3], [2.0; 3]],
            ..Page::default()
        };
        p.coverage = vec![1.0; 2];
        let (bytes, _) = write_lightmap_exr(&p, &ExrOptions::default()).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let back = read_exr(&write_to(&dir, &bytes)).unwrap();
        assert_eq!(back.channel("R").unwrap(), [1.0, 2.0]);
    }

    #[test]
    fn same_bytes_for_one_and_many_threads_and_from_run_to_run() {
        let p = page(300, 200);
        let options = ExrOptions {
            metadata: Some("{}".into()),
            coverage: true,
        };
        let write = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| write_lightmap_exr(&p, &options).unwrap().0)
        };
        let one = write(1);
        assert!(one == write(4) && one == write(2) && one == write(1));
        for word in ["capDate", "owner", "software"] {
            assert!(
                !one.windows(word.len()).any(|w| w == word.as_bytes()),
                "{word} in the header"
            );
        }
    }

    #[test]
    fn values_beyond_half_are_clamped_and_counted() {
        let value = vec![
            [f32::NAN, 1e6, -1.0],
            [f32::INFINITY, 65504.0, 65519.0],
            [f32::NEG_INFINITY, -0.0, 1e-30],
        ];
        let p = Page {
            width: 3,
            height: 1,
            value,
            coverage: vec![1.0; 3],
            layers: vec![("error.Y".into(), vec![-1e9, f32::NAN, 0.5])],
        };
        let (bytes, stats) = write_lightmap_exr(&p, &ExrOptions::default()).unwrap();
        assert_eq!(
            stats,
            ExrStats {
                clamped: 3,
                non_finite: 4,
                negative: 1
            }
        );
        let dir = tempfile::tempdir().unwrap();
        let back = read_exr(&write_to(&dir, &bytes)).unwrap();
        assert_eq!(back.channel("R").unwrap(), [0.0, 0.0, 0.0]);
        assert_eq!(back.channel("G").unwrap(), [HALF_MAX, HALF_MAX, 0.0]);
        assert_eq!(back.channel("B").unwrap(), [0.0, HALF_MAX, 0.0]);
        assert_eq!(back.channel("error.Y").unwrap(), [-HALF_MAX, 0.0, 0.5]);
    }

    #[test]
    fn wrong_lengths_and_doubled_names_are_errors() {
        let mut p = page(2, 2);
        p.value.pop();
        assert!(matches!(
            write_lightmap_exr(&p, &ExrOptions::default()),
            Err(Error::Inconsistent { .. })
        ));
        let mut p = page(2, 2);
        p.layers.push(("error.Y".into(), vec![0.0; 4]));
        assert!(matches!(
            write_lightmap_exr(&p, &ExrOptions::default()),
            Err(Error::Inconsistent { .. })
        ));
        assert!(matches!(
            write_lightmap_exr(&Page::default(), &ExrOptions::default()),
            Err(Error::Inconsistent { .. })
        ));
    }

    /// A product of sizes that wrapped to 0 used to abort the process, and a size that a short file
    /// only claimed used to allocate gigabytes.
    #[test]
    fn sizes_that_the_file_cannot_hold_are_refused_unallocated() {
        let dir = tempfile::tempdir().unwrap();
        let options = ExrOptions {
            coverage: true,
            ..ExrOptions::default()
        };
        let mut small = page(16, 16);
        small.layers.clear();
        let (bytes, _) = write_lightmap_exr(&small, &options).unwrap();
        let name = b"dataWindow\0box2i\0\x10\0\0\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len();
        let claim = |[left, top, right, bottom]: [i32; 4]| {
            let mut bytes = bytes.clone();
            for (i, x) in [left, top, right, bottom].into_iter().enumerate() {
                bytes[at + 4 * i..][..4].copy_from_slice(&x.to_le_bytes());
            }
            read_exr(&write_to(&dir, &bytes)).unwrap_err().to_string()
        };
        // 2^30 × 2^30 pixels of four 4-byte channels: 2^64 bytes.
        let wraps = claim([-(1 << 29), -(1 << 29), (1 << 29) - 1, (1 << 29) - 1]);
        assert!(
            wraps.contains("1073741824 x 1073741824 pixels of 4 channels"),
            "{wraps}"
        );
        let long = claim([0, 0, 8191, 4095]);
        assert!(long.contains("8192 x 4096 pixels"), "{long}");
        assert!(
            long.contains(&format!("{} bytes can hold", bytes.len())),
            "{long}"
        );
    }

    #[test]
    fn files_that_are_no_exr_are_typed_errors() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(
            read_exr(&dir.path().join("absent.exr")),
            Err(Error::Io { .. })
        ));
        let junk = write_to(&dir, b"not an image at all");
        assert!(matches!(read_exr(&junk), Err(Error::Image { .. })));
        let (bytes, _) = write_lightmap_exr(&page(64, 64), &ExrOptions::default()).unwrap();
        let cut = write_to(&dir, &bytes[..bytes.len() / 2]);
        assert!(matches!(read_exr(&cut), Err(Error::Image { .. })));
    }
}
