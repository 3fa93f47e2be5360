//! Channels of a lightmap in the form that WebGL takes.
//!
//! The server decodes the EXR itself. WebGL needs four halves per texel, and each request asks for
//! one layer. three.js's EXR loader would decode every channel for each layer.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::SystemTime;

use atlas_bake::{ExrImage, read_exr};
use half::f16;
use rayon::prelude::*;

use crate::error::Error;

/// A decoded file is kept for requests of its other layers until another file is requested, unless
/// it is larger than this, bytes.
const KEEP: usize = 512 << 20;

/// The file decoded last.
#[derive(Debug, Default)]
pub(super) struct Planes {
    last: Mutex<Option<(Key, Arc<ExrImage>)>>,
}

type Key = (PathBuf, Option<SystemTime>, u64);

/// One layer of a page.
#[derive(Debug)]
pub(super) struct Plane {
    pub width: u32,
    pub height: u32,
    /// RGBA halves, little-endian, row 0 at the top; A is 1. Single-channel layers are grey.
    pub bytes: Vec<u8>,
}

impl Planes {
    /// A layer of the file at `path`: `""` for R, G, B, else the channel names' part before the
    /// dot. `None` if the file has no such layer.
    ///
    /// # Errors
    /// [`Error::Output`] if the file cannot be read.
    pub fn read(&self, path: &Path, layer: &str) -> Result<Option<Plane>, Error> {
        let image = self.image(path)?;
        Ok(plane(&image, layer))
    }

    fn image(&self, path: &Path) -> Result<Arc<ExrImage>, Error> {
        let meta = std::fs::metadata(path).ok();
        let key = (
            path.to_owned(),
            meta.as_ref().and_then(|m| m.modified().ok()),
            meta.map_or(0, |m| m.len()),
        );
        // Held while reading, so that a page that requests six layers at once does not decode the
        // file six times. A panic inside leaves a consistent state.
        let mut last = self.last.lock().unwrap_or_else(|e| e.into_inner());
        if let Some((_, image)) = last.as_ref().filter(|(k, _)| *k == key) {
            return Ok(image.clone());
        }
        // Freed before the next file is read, to halve the peak.
        *last = None;
        let image = Arc::new(read_exr(path)?);
        let bytes = image.channels.len() * image.width as usize * image.height as usize * 4;
        if bytes <= KEEP {
            *last = Some((key, image.clone()));
        }
        Ok(image)
    }
}

fn plane(image: &ExrImage, layer: &str) -> Option<Plane> {
    let channel = |end: &str| match layer {
        "" => image.channel(end),
        _ => image.channel(&format!("{layer}.{end}")),
    };
    let all = |ends: [&str; 3]| match ends.map(channel) {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    };
    let [r, g, b] = all(["R", "G", "B"])
        .or_else(|| all(["X", "Y", "Z"]))
        .or_else(|| channel("Y").map(|y| [y; 3]))?;
    let mut bytes = vec![0; 8 * r.len()];
    bytes
        .par_chunks_mut(8)
        .with_min_len(4096)
        .enumerate()
        .for_each(|(i, texel)| {
            let halves = [r[i], g[i], b[i], 1.0].map(|x| f16::from_f32(x).to_le_bytes());
            texel.copy_from_slice(halves.as_flattened());
        });
    Some(Plane {
        width: image.width,
        height: image.height,
        bytes,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(names: &[(&str, f32)]) -> ExrImage {
        ExrImage {
            width: 1,
            height: 2,
            channels: names
                .iter()
                .map(|(n, x)| ((*n).to_owned(), vec![*x, 2.0 * *x]))
                .collect(),
        }
    }

    #[track_caller]
    fn texels(image: &ExrImage, layer: &str) -> Vec<f32> {
        let plane = plane(image, layer).unwrap();
        assert_eq!((plane.width, plane.height), (1, 2));
        let halves = plane
            .bytes
            .chunks(2)
            .map(|b| f16::from_le_bytes([b[0], b[1]]));
        halves.map(f16::to_f32).collect()
    }

    #[test]
    fn layers_are_found_by_their_names_and_rows_stay_in_order() {
        let names = [
            ("B", 3.0),
            ("G", 2.0),
            ("R", 1.0),
            ("d.X", 0.25),
            ("d.Y", 0.5),
            ("d.Z", -1.0),
            ("error.Y", 0.125),
        ];
        let i = image(&names);
        assert_eq!(texels(&i, ""), [1.0, 2.0, 3.0, 1.0, 2.0, 4.0, 6.0, 1.0]);
        assert_eq!(texels(&i, "d"), [0.25, 0.5, -1.0, 1.0, 0.5, 1.0, -2.0, 1.0]);
        assert_eq!(
            texels(&i, "error"),
            [0.125, 0.125, 0.125, 1.0, 0.25, 0.25, 0.25, 1.0]
        );
        for none in ["direct", "error.Y", "R", "."] {
            assert!(plane(&i, none).is_none(), "{none}");
        }
    }
}
