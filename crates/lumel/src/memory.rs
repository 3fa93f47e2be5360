//! Memory: estimated and measured.

use atlas::LayoutReport;
use atlas_bake::{Counts, Divided, Ktx2Format, extra_bytes};
use gather::TILE;
use mesh_ingest::{Document, ImageSource, Loaded, Scene, Soup};
use radiosity::{Sky, World, count_patches};

use crate::error::Error;
use crate::plan::bake_options;
use crate::probes::reflection_options;
use crate::settings::{BakeMode, GltfExt, Settings};

/// Peak memory in bytes: fixed, per triangle, per triangle of the largest mesh while its charts are
/// made, per lumel of a tile, and per point of a seam. Fitted to bakes at draft: up to 5 million
/// lumels and 500,000 triangles, one made only of chart borders (lab/large_levels.md); the fixed
/// part to small levels (lab/estimate.md), with 3 MB for what the heaps of threads keep: the
/// Cornell box at preview took 62 to 70 MiB in ten bakes. Vertices that `--vertex-error` adds need
/// less than the lumels' light, which is freed before.
const BYTES: [f64; 5] = [33.0e6, 500.0, 400.0, 520.0, 350.0];

/// Bytes of a patch, and of an element: its place, area, reflectance and light, and the light around
/// it.
const PATCH: f64 = 200.0;
const ELEMENT: f64 = 88.0;

/// Bytes of an element for each light group.
const OF_GROUP: f64 = 12.0;

/// Bytes of an element in the tree of lit elements, which lumels are gathered from.
const LIT: f64 = 80.0;

/// Bytes of an element that an attempt leaves behind if the bake starts again with separate sides,
/// because memory that is freed is not all given back.
const AGAIN: f64 = 60.0;

/// Bytes of a ray between patches.
const LINK: f64 = 4.0;

/// Bytes of a patch while links are relaxed: its light and what changes it.
const RELAXED: f64 = 200.0;

/// Bytes of a page's texel while lumels are put into it: light, coverage, chart, reader, whether it
/// is hidden.
const IN_MAKING: f64 = 25.0;

/// Bytes of a page's texel from then on: the same without reader, its number among the texels of
/// seams, and halves in the file.
const OF_PAGE: f64 = 36.0;

/// Bytes that a triangle takes before the bake.
pub(crate) const TRIANGLE: u64 = 1700;

/// Bytes of a decoded texel with its pyramid (`mesh_ingest::Pyramids`), and of a sky's pixel.
const TEXEL: f64 = 4.0 + 8.0 / 3.0;
const SKY: f64 = 12.0;

/// Bytes of a texel of a reflection capture: its radiance, and in the file.
const CAPTURED: f64 = 16.0;

/// Number of copies of a document's bytes: the input, and two results that are written together.
pub(crate) const COPIES: u64 = 3;

/// Fraction of the remaining memory that a suggested density uses, because the estimate may be a
/// quarter too low.
const SPARE: f64 = 0.8;

/// Peak memory that a bake will need, bytes. Terms are for the planned density.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Need {
    /// The part that does not depend on density and is there from the solve to the end.
    fixed: f64,
    /// What only the solve needs; it is freed before light is gathered.
    links: f64,
    /// What only gathering needs, whatever the density.
    lit: f64,
    /// Bytes of a lumel of a tile.
    of_tile: f64,
    counts: Counts,
    /// Pages while light is gathered. Like `pages`, proportional to the square of the density.
    in_making: f64,
    /// Finished pages.
    pages: f64,
    /// What only stitching needs: the part proportional to the density.
    seams: f64,
}

impl Need {
    /// Estimates a level whose charts are planned.
    pub(crate) fn of(
        loaded: &Loaded,
        (world, sky): (&World, &Sky),
        settings: &Settings,
        layout: &LayoutReport,
        counts: Counts,
    ) -> Need {
        let (scene, soup) = (world.scene, world.soup);
        let texels: usize = (scene.images.iter().flatten())
            .map(|image| image.pixels.len())
            .sum();
        let sky = match sky {
            Sky::Map { pixels, .. } => pixels.len(),
            _ => 0,
        };
        let texels_of_pages: f64 = (layout.pages.iter())
            .map(|[w, h]| f64::from(*w) * f64::from(*h))
            .sum();
        let divided = divided(settings);
        let [of_tile, of_texel] =
            extra_bytes(&bake_options(settings), divided).map(|bytes| bytes as f64);
        let in_making = IN_MAKING + of_texel;
        let of_texel = OF_PAGE + of_texel + files(settings, divided);
        // Patches of lumels that cannot fit are not counted, because counting takes memory too.
        let fits =
            (settings.bounds.allowed()).map_or(f64::INFINITY, |allowed| allowed as f64 / OF_PAGE);
        let solve = settings.solve_options_of(settings.patched_lumels(soup).min(fits));
        let stats = count_patches(world, &solve);
        let [patches, elements] = [stats.patches, stats.elements].map(f64::from);
        // Fewer rays are cast where they need more than is allowed.
        let links = (LINK * patches * f64::from(solve.rays)).min(solve.link_bytes as f64);
        let two_sided = (0..soup.triangles.len() as u32).any(|t| world.two_sided(t));
        let again = if settings.split_sides && two_sided {
            AGAIN
        } else {
            0.0
        };
        Need {
            fixed: BYTES[0]
                + BYTES[1] * soup.triangles.len() as f64
                + BYTES[2] * largest_mesh(soup)
                + PATCH * patches
                + (ELEMENT + again + OF_GROUP * divided.groups as f64) * elements
                + TEXEL * texels as f64
                + SKY * sky as f64
                + CAPTURED * captured(scene, settings)
                + (COPIES * stored(&loaded.document)) as f64,
            links: links + RELAXED * patches,
            lit: LIT * elements,
            of_tile: BYTES[3] + of_tile,
            counts,
            in_making: in_making * texels_of_pages,
            pages: of_texel * texels_of_pages,
            seams: BYTES[4] * counts.seam_samples as f64,
        }
    }

    /// Whether a level might need more memory than allowed, before its charts are made: whether twice
    /// the memory of its triangles and lumels does, because seams and pictures are not known yet.
    pub(crate) fn might_exceed(soup: &Soup, settings: &Settings) -> bool {
        let lumels = settings.lumels(soup);
        let tile = BYTES[3] * lumels.min(TILE as f64);
        let triangles = BYTES[1] * soup.triangles.len() as f64 + BYTES[2] * largest_mesh(soup);
        let known = triangles + tile + OF_PAGE * lumels;
        (settings.bounds.allowed()).is_some_and(|allowed| 2.0 * known > allowed as f64)
    }

    /// Whether the pages of the estimated lumels of a layout need more memory than allowed.
    pub(crate) fn exceeds_by_far(layout: &LayoutReport, settings: &Settings) -> bool {
        let known = OF_PAGE * layout.lumels;
        (settings.bounds.allowed()).is_some_and(|allowed| known > allowed as f64)
    }

    /// The total.
    pub(crate) fn bytes(&self) -> f64 {
        self.at(1.0)
    }

    /// The total if the density is multiplied with `x`.
    fn at(&self, x: f64) -> f64 {
        let Counts {
            lumels,
            in_tile,
            in_instance,
            ..
        } = self.counts;
        let [all, tile, largest] = [lumels, in_tile, in_instance].map(|n| n as f64);
        // A single tile grows until it is full; an instance is never divided.
        let full = if tile < all {
            tile
        } else {
            tile.max(TILE as f64)
        };
        let tile = (all * x * x).min(full).max(largest * x * x);
        let gather = self.lit + self.of_tile * tile + self.in_making * x * x;
        let finish = self.pages * x * x + self.seams * x;
        self.fixed + self.links.max(gather).max(finish)
    }

    /// Refuses bakes that need more memory than the settings allow.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn check(&self, settings: &Settings, layout: &LayoutReport) -> Result<(), Error> {
        let Some(allowed) = settings.bounds.allowed() else {
            return Ok(());
        };
        if self.bytes() <= allowed as f64 {
            return Ok(());
        }
        let least = self.at(0.0);
        let fits = self.share_that_fits(least + SPARE * (allowed as f64 - least));
        Err(Error::Memory {
            needed: self.bytes() as u64,
            allowed,
            fits: fits.map(|share| share * f64::from(layout.texels_per_unit)),
        })
    }

    /// Largest factor below 1 on the density at which the bake needs at most `bytes`; `None` if
    /// there is none.
    fn share_that_fits(&self, bytes: f64) -> Option<f64> {
        if bytes <= self.at(0.0) || self.pages <= 0.0 {
            return None;
        }
        let (mut fits, mut exceeds) = (0.0, 1.0);
        // As precise as a float.
        for _ in 0..53 {
            let x = 0.5 * (fits + exceeds);
            *(if self.at(x) <= bytes {
                &mut fits
            } else {
                &mut exceeds
            }) = x;
        }
        Some(fits)
    }
}

/// Triangles of the largest mesh.
fn largest_mesh(soup: &Soup) -> f64 {
    let sizes = soup.instance_ranges.iter().map(|[first, end]| end - first);
    f64::from(sizes.max().unwrap_or(0))
}

/// Texels of all reflection captures: six faces each, and a third more in smaller levels.
fn captured(scene: &Scene, settings: &Settings) -> f64 {
    let face = f64::from(reflection_options(settings.quality).size).powi(2);
    8.0 * face * scene.reflections.len() as f64
}

/// How the light of a bake with these settings is divided.
fn divided(settings: &Settings) -> Divided {
    let groups = settings.groups.len();
    Divided {
        // Sources in no group have one of their own.
        groups: groups + usize::from(groups > 0),
        left_out: settings.mode != BakeMode::Full,
        masks: settings.mode == BakeMode::Shadowmask,
    }
}

/// Files that options add, bytes per texel of a page before compression. All files exist together,
/// because they are written together.
fn files(settings: &Settings, divided: Divided) -> f64 {
    let ktx2 = match settings.ktx2 {
        None => 0.0,
        Some(Ktx2Format::Bc6h) => 1.0,
        Some(Ktx2Format::Rgb9e5) => 4.0,
    };
    let mask = if settings.ktx2.is_some() && divided.masks {
        4.0
    } else {
        0.0
    };
    let png = if settings.png.is_some() { 4.0 } else { 0.0 };
    // Two pictures, in the .glb and in what it is made from.
    let moz = if settings.ext.contains(&GltfExt::Moz) {
        16.0
    } else {
        0.0
    };
    (1 + divided.groups) as f64 * ktx2 + mask + png + moz
}

/// Stored bytes of the document's buffers and images.
fn stored(document: &Document) -> u64 {
    let buffers = (0..document.buffer_count()).map(|i| document.buffer(i).len() as u64);
    let images = document.json()["images"].as_array().map_or(0, Vec::len);
    let linked = (0..images).filter_map(|i| match document.image_source(i) {
        Ok(ImageSource::File(file)) => Some(std::fs::metadata(file).ok()?.len()),
        _ => None,
    });
    buffers.chain(linked).sum()
}

/// The machine's memory in bytes, or less if the container or the process (`ulimit -v`) may have
/// less; `None` elsewhere than on Linux.
pub(crate) fn machine_bytes() -> Option<u64> {
    let info = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = info.lines().find(|l| l.starts_with("MemTotal:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    // The limits of control groups, versions 2 and 1.
    let limits = [
        "/sys/fs/cgroup/memory.max",
        "/sys/fs/cgroup/memory/memory.limit_in_bytes",
    ];
    let limits = limits.iter().filter_map(|path| {
        let text = std::fs::read_to_string(path).ok()?;
        text.trim().parse::<u64>().ok()
    });
    let own = std::fs::read_to_string("/proc/self/limits").ok();
    let own = own.iter().flat_map(|text| text.lines()).find_map(|line| {
        let soft = line.strip_prefix("Max address space")?;
        soft.split_whitespace().next()?.parse().ok()
    });
    Some(limits.chain(own).fold(kib * 1024, u64::min))
}

/// Peak resident set in bytes on Linux; `None` elsewhere.
pub(crate) fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_fit_needs_as_much_as_is_there() {
        let need = Need {
            fixed: 15.0,
            links: 5.0,
            lit: 2.0,
            of_tile: 5.0,
            counts: Counts {
                lumels: 400,
                in_tile: 50,
                in_instance: 30,
                seam_samples: 0,
            },
            in_making: 300.0,
            pages: 500.0,
            seams: 30.0,
        };
        assert_eq!(need.at(0.5), 15.0 + 2.0 + 250.0 + 75.0);
        assert_eq!(need.bytes(), 15.0 + 2.0 + 250.0 + 300.0);
        for bytes in [21.0, 100.0, 342.0, 566.0] {
            let x = need.share_that_fits(bytes).expect("more than is fixed");
            let then = need.at(x);
            assert!((then / bytes - 1.0).abs() < 1e-12, "{then} for {bytes}");
        }
        assert_eq!(need.share_that_fits(20.0), None);
    }

    #[test]
    fn more_tiles_need_no_more_memory_but_for_pages() {
        let need = |copies: usize| Need {
            fixed: 0.0,
            links: 0.0,
            lit: 0.0,
            of_tile: 500.0,
            counts: Counts {
                lumels: copies << 20,
                in_tile: 1 << 20,
                in_instance: 1 << 18,
                seam_samples: 0,
            },
            in_making: 0.0,
            pages: 0.0,
            seams: 0.0,
        };
        assert_eq!(need(1).bytes(), need(64).bytes());
        // With twice the density, an instance fills a tile alone; with four times, it is larger.
        assert_eq!(need(64).at(2.0), need(64).bytes());
        assert_eq!(need(64).at(4.0), 4.0 * need(64).bytes());
    }
}
