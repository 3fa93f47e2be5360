//! The bright part of a sky map, such as the sun in a photographed sky or a window in a studio.

use std::f32::consts::TAU;

use glam::Vec3;

use super::Sky;
use crate::world::luminance;

/// Radiance above this multiple of the mean is sampled. Gathering rays hit darker parts often
/// enough; above it, a rare ray would contribute more light than all others. The threshold for
/// emissive surfaces is the same.
const BORDER: f64 = 4.0;

/// Maximum number of cells. Each is a separate light to every receiver.
const CELLS: usize = 32;

/// Cells narrower than this are not split, because the cosine at a receiver varies little over
/// them. The width is half the diagonal of the bounding box of their directions, in approximate
/// radians.
const NARROW: f32 = 0.08;

/// The radiance above [`BORDER`] times the mean, in cells of neighbouring pixels.
#[derive(Debug, Clone)]
pub(crate) struct BrightSky {
    width: u32,
    /// Cosine of the polar angle at each row's upper edge, with one more entry than rows.
    cosines: Vec<f32>,
    /// Pixel index and excess radiance, cell by cell, row-major within a cell.
    pixels: Vec<(u32, Vec3)>,
    /// Luminous flux per perpendicular area (Σ L Ω) up to each pixel, starting at 0 in each cell.
    cumulative: Vec<f64>,
    pub cells: Vec<SkyCell>,
}

/// A group of pixels of the bright sky.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SkyCell {
    start: usize,
    end: usize,
    /// Unit direction towards its centre.
    pub direction: Vec3,
    /// Σ luminance × solid angle.
    pub power: f32,
}

/// The pixels of a cell during construction, their power, and the size of the bounding box of their
/// directions.
type Part = (Vec<(u32, Vec3)>, f64, Vec3);

/// Direction to pixel coordinates (x in columns, cosine of the polar angle).
fn direction(x: f32, width: u32, cos: f32) -> Vec3 {
    // u = ½ + atan2(z, x)/2π, as in `Sky::radiance`.
    let phi = (x / width as f32 - 0.5) * TAU;
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    Vec3::new(sin * libm::cosf(phi), cos, sin * libm::sinf(phi))
}

impl BrightSky {
    /// Removes the bright part from a map and returns both. If there is none, returns the sky
    /// unchanged and `None`.
    pub(crate) fn split(sky: Sky) -> (Sky, Option<BrightSky>) {
        let Sky::Map {
            width,
            height,
            mut pixels,
        } = sky
        else {
            return (sky, None);
        };
        let cosines: Vec<f32> = (0..=height)
            .map(|y| libm::cos(std::f64::consts::PI * y as f64 / height as f64) as f32)
            .collect();
        let solid_angle = |y: usize| (cosines[y] - cosines[y + 1]) * (TAU / width as f32);
        let mut flux = 0f64;
        for (y, row) in pixels.chunks(width as usize).enumerate() {
            let sum: f64 = row.iter().map(|p| luminance(*p) as f64).sum();
            flux += sum * solid_angle(y) as f64;
        }
        let border = (BORDER * flux / (4.0 * std::f64::consts::PI)) as f32;
        let mut bright: Vec<(u32, Vec3)> = Vec::new();
        for (i, p) in pixels.iter_mut().enumerate() {
            let l = luminance(*p);
            if l > border {
                let kept = *p * (border / l);
                bright.push((i as u32, *p - kept));
                *p = kept;
            }
        }
        let found = (!bright.is_empty()).then(|| Self::cut(width, cosines, bright));
        let sky = Sky::Map {
            width,
            height,
            pixels,
        };
        (sky, found)
    }

    /// Adds the bright part to the map that it was removed from.
    pub(crate) fn add_to(&self, map: &mut [Vec3]) {
        for (i, excess) in &self.pixels {
            map[*i as usize] += *excess;
        }
    }

    fn cut(width: u32, cosines: Vec<f32>, pixels: Vec<(u32, Vec3)>) -> Self {
        let middle = |pixel: u32| {
            let y = (pixel / width) as usize;
            let x = (pixel % width) as f32 + 0.5;
            direction(x, width, 0.5 * (cosines[y] + cosines[y + 1]))
        };
        let power = |p: &(u32, Vec3)| {
            let y = (p.0 / width) as usize;
            let solid_angle = (cosines[y] - cosines[y + 1]) * (TAU / width as f32);
            luminance(p.1) as f64 * solid_angle as f64
        };
        // Repeatedly splits the cell with the largest spread into two halves of equal power.
        let mut parts: Vec<Part> = Vec::new();
        let judge = |part: Vec<(u32, Vec3)>| -> Part {
            let (mut low, mut high, mut sum) = (Vec3::INFINITY, Vec3::NEG_INFINITY, 0f64);
            for p in &part {
                let d = middle(p.0);
                (low, high) = (low.min(d), high.max(d));
                sum += power(p);
            }
            (part, sum, high - low)
        };
        parts.push(judge(pixels));
        while parts.len() < CELLS {
            let gain = |p: &Part| {
                let wide = 0.5 * p.2.length();
                if wide > NARROW {
                    p.1 * (wide * wide) as f64
                } else {
                    0.0
                }
            };
            let widest =
                (0..parts.len()).max_by(|&a, &b| gain(&parts[a]).total_cmp(&gain(&parts[b])));
            let Some(at) = widest.filter(|&at| gain(&parts[at]) > 0.0) else {
                break;
            };
            let (mut part, sum, size) = parts.swap_remove(at);
            let axis = size.max_position();
            part.sort_by(|a, b| {
                let key = |p: &(u32, Vec3)| middle(p.0)[axis];
                key(a).total_cmp(&key(b)).then(a.0.cmp(&b.0))
            });
            let mut half = 0f64;
            let cut = part.iter().position(|p| {
                half += power(p);
                half >= 0.5 * sum
            });
            // Both halves have a pixel, because a cell of one pixel has no width.
            let cut = cut.unwrap_or(0).clamp(1, part.len() - 1);
            let rest = part.split_off(cut);
            parts.push(judge(part));
            parts.push(judge(rest));
        }
        let mut out = BrightSky {
            width,
            pixels: Vec::new(),
            cumulative: Vec::new(),
            cells: Vec::new(),
            cosines: Vec::new(),
        };
        for (mut part, sum, _) in parts {
            part.sort_by_key(|p| p.0);
            let start = out.pixels.len();
            let (mut running, mut mean) = (0f64, Vec3::ZERO);
            for p in &part {
                running += power(p);
                mean += middle(p.0) * power(p) as f32;
                out.cumulative.push(running);
            }
            out.pixels.extend(part);
            out.cells.push(SkyCell {
                start,
                end: out.pixels.len(),
                direction: mean.normalize_or(Vec3::Y),
                power: sum as f32,
            });
        }
        out.cosines = cosines;
        out
    }

    /// Samples a direction in the cell in proportion to its radiance. Also returns the light of the
    /// whole cell as if all of it came from there: Σ L Ω, in W/m² or lx on a surface that faces it.
    pub(crate) fn sample(&self, cell: &SkyCell, x: f32, y: f32) -> (Vec3, Vec3) {
        let running = &self.cumulative[cell.start..cell.end];
        let total = running[running.len() - 1];
        let at = x as f64 * total;
        let k = running.partition_point(|&s| s <= at).min(running.len() - 1);
        let before = if k == 0 { 0.0 } else { running[k - 1] };
        let own = running[k] - before;
        // The remainder of the random number places the point within the pixel.
        let inner = (((at - before) / own.max(1e-300)) as f32).clamp(0.0, 1.0);
        let (pixel, radiance) = self.pixels[cell.start + k];
        let row = (pixel / self.width) as usize;
        let (top, bottom) = (self.cosines[row], self.cosines[row + 1]);
        let column = (pixel % self.width) as f32 + inner;
        let direction = direction(column, self.width, top + (bottom - top) * y);
        (direction, radiance * (cell.power / luminance(radiance)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::sample_2d;

    fn map(width: u32, height: u32, f: impl Fn(u32, u32) -> f32) -> Sky {
        let pixels = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| Vec3::new(1.0, 0.5, 0.25) * f(x, y))
            .collect();
        Sky::Map {
            width,
            height,
            pixels,
        }
    }

    #[test]
    fn even_skies_have_no_bright_part() {
        assert!(BrightSky::split(map(8, 4, |_, _| 3.0)).1.is_none());
        assert!(
            BrightSky::split(map(8, 4, |x, _| 1.0 + (x % 2) as f32))
                .1
                .is_none()
        );
        assert!(BrightSky::split(map(8, 4, |_, _| 0.0)).1.is_none());
    }

    #[test]
    fn the_two_parts_are_the_whole() {
        // A sun of one pixel and a band of brighter sky, on a gradient.
        let f = |x: u32, y: u32| match (x, y) {
            (5, 6) => 5000.0,
            (_, 8) => 60.0,
            _ => 0.1 * (1 + y) as f32,
        };
        let whole = map(32, 16, f);
        let (base, bright) = BrightSky::split(whole.clone());
        let bright = bright.expect("a sun");
        let (Sky::Map { pixels: a, .. }, Sky::Map { pixels: b, .. }) = (&whole, &base) else {
            panic!("maps stay maps");
        };
        let mut sum = b.clone();
        for (i, excess) in &bright.pixels {
            sum[*i as usize] += *excess;
        }
        for (s, a) in sum.iter().zip(a) {
            // Two f32 roundings.
            assert!((*s - *a).abs().max_element() <= 2e-7 * a.max_element());
        }
        // Every pixel is in one cell, and cells are narrow unless their number is at its limit.
        let mut seen: Vec<u32> = bright.pixels.iter().map(|p| p.0).collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), bright.pixels.len());
        assert!(bright.cells.len() <= CELLS);
    }

    #[test]
    fn samples_carry_what_the_pixels_hold() {
        let f = |x: u32, y: u32| {
            if y == 3 && (9..14).contains(&x) {
                100.0 * x as f32
            } else {
                0.01
            }
        };
        let (_, bright) = BrightSky::split(map(32, 16, f));
        let bright = bright.expect("a band");
        // ∫ L ω dω over the bright pixels, from the samples and from the pixels; 4096 samples of a
        // smooth function.
        let (mut sampled, mut exact) = (Vec3::ZERO, Vec3::ZERO);
        for cell in &bright.cells {
            for i in 0..4096 {
                let [x, y] = sample_2d(i, 0, 9);
                let (direction, light) = bright.sample(cell, x, y);
                sampled += direction * (luminance(light) / 4096.0);
            }
        }
        for (pixel, l) in &bright.pixels {
            let (x, y) = ((pixel % 32) as f32, (pixel / 32) as usize);
            let n = 64;
            for i in 0..n * n {
                let (s, t) = (
                    ((i % n) as f32 + 0.5) / n as f32,
                    ((i / n) as f32 + 0.5) / n as f32,
                );
                let cos = bright.cosines[y] + (bright.cosines[y + 1] - bright.cosines[y]) * t;
                let omega = (bright.cosines[y] - bright.cosines[y + 1]) * TAU / 32.0;
                exact += direction(x + s, 32, cos) * (luminance(*l) * omega / (n * n) as f32);
            }
        }
        assert!(
            (sampled - exact).length() < 1e-3 * exact.length(),
            "{sampled} {exact}"
        );
    }

    #[test]
    fn samples_point_where_the_map_is_bright() {
        let sun = |x: u32, y: u32| if (x, y) == (21, 4) { 1e4 } else { 1.0 };
        let sky = map(32, 16, sun);
        let (_, bright) = BrightSky::split(sky.clone());
        let bright = bright.expect("a sun");
        let (d, _) = bright.sample(&bright.cells[0], 0.5, 0.5);
        // The centre of the pixel by solid angle is 2 % of a row away from its centre by angle, and
        // the lookup is bilinear.
        assert!(luminance(sky.radiance(d)) > 0.97 * luminance(Vec3::new(1.0, 0.5, 0.25)) * 1e4);
    }
}
