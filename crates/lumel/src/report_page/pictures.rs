//! The lightmap and its estimated error as pictures in the page.

use atlas_bake::{ExrImage, Page, heat_png, lightmap_png, read_exr};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::Inputs;
use super::html::{escape, note};
use super::svg::{histogram, percent_mark};
use crate::error::Error;

/// Most texels that all pictures may have together. PNG takes about two bytes per texel, so the
/// page stays within about 10 MB.
const BUDGET: f64 = 4e6;

/// Largest side of a picture, and the least that it is scaled down to, texels.
const SIDE: [f64; 2] = [1024.0, 128.0];

/// Most pages shown of each kind.
const PAGES: usize = 12;

/// Relative errors at the ends of the colour scale, as in `lumel diff --picture` and the viewer.
const RANGE: [f64; 2] = [1e-3, 1.0];

/// Bins of the histogram of errors, over [`RANGE`].
const BINS: usize = 48;

/// The sections with pictures.
pub(super) struct Maps {
    pub lightmaps: String,
    pub error: String,
}

/// Draws the pictures that the bake has data for.
pub(super) fn maps(source: &Inputs<'_>) -> Result<Maps, Error> {
    let pages = &source.manifest.pages;
    let shown = pages.len().min(PAGES);
    // The lightmap, the error and the groups share the budget.
    let kinds = 2 + source.manifest.groups.len();
    let side = (BUDGET / (shown.max(1) * kinds) as f64)
        .sqrt()
        .clamp(SIDE[1], SIDE[0]);
    let (mut lightmaps, mut errors) = (String::new(), String::new());
    let (mut bins, mut lumels) = (vec![0.0; BINS], 0.0);
    for (i, page) in pages.iter().enumerate() {
        let image = read_exr(&source.folder.expect_file(&page.uri)?)?;
        count_errors(&image, &mut bins, &mut lumels);
        if i < PAGES {
            let small = shrink(&image, side as usize);
            lightmaps += &figure(&lightmap_png(&small)?, &size_of(&page.uri, &image));
            if let Some(t) = relative_error(&small) {
                errors += &figure(
                    &heat_png(&small, &t, [0.0, 1.0])?,
                    &size_of(&page.uri, &image),
                );
            }
        }
    }
    let mut groups = String::new();
    for group in &source.manifest.groups {
        for uri in group.pages.iter().take(PAGES) {
            let image = read_exr(&source.folder.expect_file(uri)?)?;
            groups += &figure(
                &lightmap_png(&shrink(&image, side as usize))?,
                &format!("group {}: {}", group.name, size_of(uri, &image)),
            );
        }
    }
    let mut text = note("Tone-mapped with separate exposures. Row 0 is at the top.");
    text += &wall(&lightmaps);
    if pages.len() > PAGES {
        text += &note(&format!(
            "{} more pages are not shown.",
            pages.len() - PAGES
        ));
    }
    if pages.is_empty() {
        text += &note("This bake has no pages because no mesh receives light.");
    }
    if !groups.is_empty() {
        text += &format!("<h3>Light groups</h3>\n{}", wall(&groups));
    }
    Ok(Maps {
        lightmaps: text,
        error: error_section(&errors, &bins, lumels)?,
    })
}

fn error_section(pictures: &str, bins: &[f64], lumels: f64) -> Result<String, Error> {
    if pictures.is_empty() {
        return Ok(note(
            "This bake has no error layer. lumel bake … --layers error writes one.",
        ));
    }
    let shares: Vec<f64> = bins.iter().map(|b| b / f64::max(lumels, 1.0)).collect();
    let decades = (RANGE[1] / RANGE[0]).log10();
    let labels: Vec<(usize, String)> = (0..=3)
        .map(|k| {
            let at = f64::from(k) / decades;
            (
                (at * BINS as f64).round() as usize,
                percent_mark(RANGE[0] * 10f64.powi(k)),
            )
        })
        .collect();
    let mut out = note(
        "Estimated standard error of each lumel's luminance, relative to that luminance. Texels without a lumel are black.",
    );
    out += &scale()?;
    out += &wall(pictures);
    out += "<h3>Lumels by estimated error</h3>\n";
    out += &histogram(
        "Lumels by estimated relative error",
        &shares,
        &labels,
        "estimated relative error",
    );
    Ok(out)
}

/// The colour scale over [`RANGE`], with labels.
fn scale() -> Result<String, Error> {
    const STEPS: u32 = 240;
    let bar = Page {
        width: STEPS,
        height: 1,
        ..Page::default()
    };
    let values: Vec<f32> = (0..STEPS).map(|i| i as f32).collect();
    let png = STANDARD.encode(heat_png(&bar, &values, [0.0, (STEPS - 1) as f32])?);
    let [low, high] = RANGE.map(percent_mark);
    Ok(format!(
        "<div class=\"scale\"><img alt=\"scale from {low} to {high}\" src=\"data:image/png;base64,{png}\"><span>≤ {low}</span><span>1 %</span><span>10 %</span><span>≥ {high}</span></div>\n"
    ))
}

fn wall(figures: &str) -> String {
    format!("<div class=\"maps\">\n{figures}</div>\n")
}

fn size_of(uri: &str, image: &ExrImage) -> String {
    format!("{uri}, {} × {}", image.width, image.height)
}

fn figure(png: &[u8], caption: &str) -> String {
    let caption = escape(caption);
    format!(
        "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{}\"><figcaption>{caption}</figcaption></figure>\n",
        STANDARD.encode(png)
    )
}

const WEIGHTS: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// The channels that the pictures are made from.
struct Channels<'a> {
    rgb: [&'a [f32]; 3],
    coverage: Option<&'a [f32]>,
    error: Option<&'a [f32]>,
}

fn channels(image: &ExrImage) -> Option<Channels<'_>> {
    let [Some(r), Some(g), Some(b)] = ["R", "G", "B"].map(|c| image.channel(c)) else {
        return None;
    };
    Some(Channels {
        rgb: [r, g, b],
        coverage: image.channel("coverage.Y"),
        error: image.channel("error.Y"),
    })
}

/// The page scaled down to at most `side` texels. Each texel is the mean over a block, weighted by
/// coverage if the bake has it. Its only layer, if any, is the error.
fn shrink(image: &ExrImage, side: usize) -> Page {
    let (w, h) = (image.width as usize, image.height as usize);
    let Some(c) = channels(image) else {
        return Page::default();
    };
    let step = w.max(h).div_ceil(side).max(1);
    let (nw, nh) = (w.div_ceil(step), h.div_ceil(step));
    let mut page = Page {
        width: nw as u32,
        height: nh as u32,
        value: vec![[0.0; 3]; nw * nh],
        coverage: vec![0.0; nw * nh],
        layers: Vec::new(),
    };
    let mut error = vec![0.0; nw * nh];
    for (i, value) in page.value.iter_mut().enumerate() {
        let (x0, y0) = (i % nw * step, i / nw * step);
        let (mut n, mut light, mut wrong) = (0.0f64, [0.0f64; 3], 0.0f64);
        for y in y0..(y0 + step).min(h) {
            for at in y * w + x0..y * w + (x0 + step).min(w) {
                let rgb = c.rgb.map(|channel| channel[at]);
                let lit = rgb.iter().any(|x| *x != 0.0);
                if !rgb.iter().all(|x| x.is_finite()) || !c.coverage.map_or(lit, |c| c[at] > 0.0) {
                    continue;
                }
                n += 1.0;
                for (sum, x) in light.iter_mut().zip(rgb) {
                    *sum += f64::from(x);
                }
                wrong += c.error.map_or(0.0, |e| f64::from(e[at]));
            }
        }
        if n > 0.0 {
            *value = light.map(|x| (x / n) as f32);
            page.coverage[i] = 1.0;
            error[i] = (wrong / n) as f32;
        }
    }
    if c.error.is_some() {
        page.layers.push(("error.Y".into(), error));
    }
    page
}

/// Position of a relative error on the scale, 0..=1.
fn on_scale(error: f64, luminance: f64) -> f64 {
    let relative = if error > 0.0 {
        error / luminance.max(1e-30)
    } else {
        0.0
    };
    ((relative / RANGE[0]).log10() / (RANGE[1] / RANGE[0]).log10()).clamp(0.0, 1.0)
}

fn luminance(rgb: [f32; 3]) -> f64 {
    rgb.iter()
        .zip(WEIGHTS)
        .map(|(x, w)| f64::from(*x) * f64::from(w))
        .sum()
}

fn relative_error(page: &Page) -> Option<Vec<f32>> {
    let (_, error) = page.layers.first()?;
    let values = page.value.iter().zip(error);
    Some(
        values
            .map(|(v, e)| on_scale(f64::from(*e), luminance(*v)) as f32)
            .collect(),
    )
}

/// Adds a page's lumels to the bins, weighted by coverage if it is known.
fn count_errors(image: &ExrImage, bins: &mut [f64], lumels: &mut f64) {
    let Some(c) = channels(image) else { return };
    let Some(error) = c.error else { return };
    for (at, &e) in error.iter().enumerate() {
        let rgb = c.rgb.map(|channel| channel[at]);
        let weight = match c.coverage {
            Some(coverage) => f64::from(coverage[at]),
            None => f64::from(u8::from(rgb.iter().any(|x| *x != 0.0))),
        };
        if weight > 0.0 && e.is_finite() {
            let place = on_scale(f64::from(e), luminance(rgb)) * bins.len() as f64;
            let last = bins.len() - 1;
            bins[(place as usize).min(last)] += weight;
            *lumels += weight;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_means_over_what_is_covered() {
        let image = ExrImage {
            width: 3,
            height: 1,
            channels: vec![
                ("B".into(), vec![1.0, 9.0, 5.0]),
                ("G".into(), vec![1.0, 9.0, 5.0]),
                ("R".into(), vec![1.0, 9.0, 5.0]),
                ("coverage.Y".into(), vec![1.0, 0.0, 0.5]),
                ("error.Y".into(), vec![0.1, 7.0, 0.05]),
            ],
        };
        let page = shrink(&image, 2);
        assert_eq!((page.width, page.height), (2, 1));
        assert_eq!((page.value[0], page.value[1]), ([1.0; 3], [5.0; 3]));
        // On the scale from 0.1 % to 100 %, 1 % lies at one third and 10 % at two thirds. f32
        // errors are 1e-7.
        let t = relative_error(&page).unwrap();
        assert!(
            (t[0] - 2.0 / 3.0).abs() < 1e-5 && (t[1] - 1.0 / 3.0).abs() < 1e-5,
            "{t:?}"
        );
        let (mut bins, mut lumels) = (vec![0.0; 3], 0.0);
        count_errors(&image, &mut bins, &mut lumels);
        assert_eq!(lumels, 1.5);
        assert_eq!(bins.iter().sum::<f64>(), 1.5);
    }
}
