//! Photometric files: IES LM-63, editions 1986, 1991, 1995, 2002 and 2019, type C.
//!
//! Based on: ANSI/IES LM-63-19 and its predecessors, "Approved Method: IES Standard File Format for
//! the Electronic Transfer of Photometric Data"; `EXT_lights_ies` for what a renderer may ignore.
//! There is no crate for this under a suitable licence (`eulumdat` reads the format but is AGPL).

use crate::error::{Fault, Outcome};
use crate::scene::Profile;

/// A profile from a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Measured {
    /// Values relative to `candela`: the largest is 1 (or all are 0).
    pub profile: Profile,
    /// The largest intensity, candela.
    pub candela: f64,
    /// Descriptions of what was ignored or repaired.
    pub remarks: Vec<String>,
}

/// Largest file, bytes: 1° × 2° over the sphere takes a third of it, at ten characters per number.
pub(crate) const MAX_BYTES: u64 = 1 << 20;

/// Parses the file `bytes`, which the document references at `path`.
///
/// Memory stays within about forty bytes per byte of the file, whatever counts it claims.
pub(crate) fn parse(bytes: &[u8], path: &str) -> Outcome<Measured> {
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Fault::limit(
            path,
            format!("a photometric file of {} bytes", bytes.len()),
            format!("at most {MAX_BYTES}"),
        ));
    }
    // Keywords may use any 8-bit encoding; the relevant parts are ASCII.
    let text = String::from_utf8_lossy(bytes);
    let mut remarks = Vec::new();
    let (tilt, old, body) = split(&text, path)?;
    let mut numbers = Numbers {
        path,
        tokens: body
            .split(|c: char| c.is_whitespace() || c == ',' || c == '\u{1a}' || c == '\0')
            .filter(|t| !t.is_empty()),
    };
    if !tilt.eq_ignore_ascii_case("NONE") {
        remarks.push(format!(
            "TILT={}: the lamp's tilt is not applied",
            shown(tilt)
        ));
    }
    if tilt.eq_ignore_ascii_case("INCLUDE") {
        numbers.next("TILT's lamp-to-luminaire geometry")?;
        let pairs = numbers.count("TILT's number of angles", 0, body.len())?;
        for _ in 0..2 * pairs {
            numbers.next("TILT's angles and factors")?;
        }
    }
    numbers.next("the number of lamps")?;
    numbers.next("the lumens per lamp")?;
    let multiplier = numbers.factor("the candela multiplier")?;
    let vertical_count = numbers.count("the number of vertical angles", 2, body.len())?;
    let horizontal_count = numbers.count("the number of horizontal angles", 1, body.len())?;
    let kind = numbers.next("the photometric type")?;
    for what in ["the units", "the width", "the length", "the height"] {
        numbers.next(what)?;
    }
    let ballast = numbers.factor("the ballast factor")?;
    // Ballast-lamp photometric factor until 1991; then reserved (1), and a code from 2019 on.
    let lamp = numbers.next("the ballast-lamp photometric factor")?;
    numbers.next("the input watts")?;
    if kind != 1.0 {
        let found = match kind {
            2.0 => "type B photometry".to_string(),
            3.0 => "type A photometry".to_string(),
            other => format!("photometric type {other}"),
        };
        return Err(Fault::unsupported(
            path,
            found,
            "type C (1), as architectural and street luminaires have",
        ));
    }
    let values_count = vertical_count.saturating_mul(horizontal_count);
    // A number takes at least a character and a separator.
    if values_count > body.len() {
        return Err(Fault::invalid(
            path,
            format!(
                "{vertical_count} × {horizontal_count} angles in {} bytes",
                bytes.len()
            ),
            "as many intensities",
        ));
    }
    let vertical = numbers.angles("a vertical angle", vertical_count, 180.0)?;
    let horizontal = numbers.angles("a horizontal angle", horizontal_count, 360.0)?;
    let mut scale = multiplier * ballast;
    if old {
        if lamp < 0.0 {
            return Err(Fault::invalid(
                path,
                format!("a ballast-lamp photometric factor of {lamp}"),
                "a number of at least 0",
            ));
        }
        scale *= lamp;
    }
    let mut candela = Vec::with_capacity(values_count);
    let mut negative = 0;
    for _ in 0..values_count {
        let value = numbers.next("an intensity")? * scale;
        negative += usize::from(value < 0.0);
        candela.push(value.max(0.0));
    }
    if negative > 0 {
        remarks.push(format!("{negative} negative intensities count as 0"));
    }
    if numbers.tokens.next().is_some() {
        remarks.push("text after the last intensity is ignored".to_string());
    }
    let most = candela.iter().fold(0.0f64, |m, &x| m.max(x));
    if most > f64::from(f32::MAX) {
        return Err(Fault::invalid(
            path,
            format!("an intensity of {most:e} candela"),
            "at most 3.4e38",
        ));
    }
    let relative: Vec<f32> = candela
        .iter()
        .map(|&x| if most > 0.0 { (x / most) as f32 } else { 0.0 })
        .collect();
    let planes = unfold(&horizontal, path)?;
    let profile = Profile {
        horizontal: planes.iter().map(|&(angle, _)| angle).collect(),
        values: planes
            .iter()
            .flat_map(|&(_, k)| &relative[k * vertical_count..(k + 1) * vertical_count])
            .copied()
            .collect(),
        vertical,
    };
    Ok(Measured {
        profile,
        candela: most,
        remarks,
    })
}

/// Splits a file at its TILT line: the line's value, whether the edition is 1986 or 1991, and the
/// rest.
fn split<'a>(text: &'a str, path: &str) -> Outcome<(&'a str, bool, &'a str)> {
    let first = text
        .trim_start_matches('\u{feff}')
        .lines()
        .next()
        .unwrap_or("")
        .trim();
    let edition = first
        .strip_prefix("IESNA:")
        .or_else(|| first.strip_prefix("IES:"))
        .map(|e| e.trim());
    let old = match edition {
        Some(e) => e.contains("1986") || e.contains("1991"),
        // 1991 writes IESNA91, 1986 nothing.
        None => true,
    };
    let mut rest = text;
    while !rest.is_empty() {
        // Any line end: files from old machines use CR alone.
        let end = rest.find(['\n', '\r']).unwrap_or(rest.len());
        let line = rest[..end].trim();
        let next = rest.get(end + 1..).unwrap_or("");
        if let Some(head) = line.get(..5)
            && head.eq_ignore_ascii_case("TILT=")
        {
            return Ok((line[5..].trim(), old, next));
        }
        rest = next;
    }
    Err(Fault::invalid(
        path,
        "no line that begins with TILT=",
        "an IES LM-63 file",
    ))
}

/// The numbers of a file, with line breaks anywhere.
struct Numbers<'p, I> {
    path: &'p str,
    tokens: I,
}

impl<'a, I: Iterator<Item = &'a str>> Numbers<'_, I> {
    fn next(&mut self, what: &str) -> Outcome<f64> {
        let Some(token) = self.tokens.next() else {
            return Err(Fault::invalid(
                self.path,
                format!("the end of the file instead of {what}"),
                "a number",
            ));
        };
        match token.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(Fault::invalid(
                self.path,
                format!("\"{}\" instead of {what}", shown(token)),
                "a number",
            )),
        }
    }

    fn factor(&mut self, what: &str) -> Outcome<f64> {
        let x = self.next(what)?;
        if x >= 0.0 {
            return Ok(x);
        }
        Err(Fault::invalid(
            self.path,
            format!("{what} {x}"),
            "a number of at least 0",
        ))
    }

    fn count(&mut self, what: &str, least: usize, most: usize) -> Outcome<usize> {
        let x = self.next(what)?;
        if x.fract() == 0.0 && x >= least as f64 && x <= most as f64 {
            return Ok(x as usize);
        }
        Err(Fault::invalid(
            self.path,
            format!("{what} {x}"),
            format!("a whole number of at least {least}, and no more than the file has room for"),
        ))
    }

    /// `count` angles in degrees, ascending within 0..=`most`.
    fn angles(&mut self, what: &str, count: usize, most: f32) -> Outcome<Vec<f32>> {
        let mut angles: Vec<f32> = Vec::with_capacity(count);
        for _ in 0..count {
            let angle = self.next(what)? as f32;
            let after = angles.last().is_none_or(|&last| angle > last);
            if !(0.0..=most).contains(&angle) || !after {
                return Err(Fault::invalid(
                    self.path,
                    format!("{what} of {angle}° after {:?}", angles.last()),
                    format!("angles that ascend within 0..={most}"),
                ));
            }
            angles.push(angle);
        }
        Ok(angles)
    }
}

fn shown(token: &str) -> String {
    token.chars().take(40).collect()
}

/// Planes over the full turn, 0 to 360 degrees, each with the index of its measured plane.
///
/// LM-63 measures one plane for rotational symmetry, a quadrant (0 to 90) for symmetry about both
/// axes, and a half for symmetry about one: 0 to 180, or 90 to 270 in the edition of 1995.
fn unfold(measured: &[f32], path: &str) -> Outcome<Vec<(f32, usize)>> {
    let n = measured.len();
    let (first, last) = (measured[0], measured[n - 1]);
    if n == 1 {
        return Ok(vec![(0.0, 0), (360.0, 0)]);
    }
    let planes = || measured.iter().copied().zip(0..n);
    // `planes` and their mirror image about `axis`, with common planes once.
    let mirror = |mut planes: Vec<(f32, usize)>, axis: f32| {
        let image: Vec<(f32, usize)> = planes
            .iter()
            .rev()
            .filter(|&&(angle, _)| angle < axis)
            .map(|&(angle, k)| (2.0 * axis - angle, k))
            .collect();
        planes.extend(image);
        planes
    };
    match (first, last) {
        (0.0, 90.0) => Ok(mirror(mirror(planes().collect(), 90.0), 180.0)),
        (0.0, 180.0) => Ok(mirror(planes().collect(), 180.0)),
        (90.0, 270.0) => {
            // The other half is the mirror image about the axis from 90 to 270: angle a maps to 180
            // − a, modulo the turn.
            let mut all: Vec<(f32, usize)> = planes().collect();
            let image = |(angle, k): (f32, usize)| ((540.0 - angle).rem_euclid(360.0), k);
            let between = planes().filter(|&(angle, _)| angle > 90.0 && angle < 270.0);
            all.extend(between.map(image));
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            if all[0].0 != 0.0 {
                return Err(Fault::invalid(
                    path,
                    "horizontal angles from 90 to 270° without 180",
                    "a plane at 180°, whose mirror image is the plane at 0°",
                ));
            }
            Ok(close(all))
        }
        (0.0, 360.0) => Ok(planes().collect()),
        // The plane at 360 equals that at 0 and is often omitted.
        (0.0, last) if last > 180.0 => {
            // The gap may not exceed the distance between planes (angles are rounded).
            let widest = measured.windows(2).map(|w| w[1] - w[0]).fold(0.0, f32::max);
            if 360.0 - last > (1.01 * widest).min(90.0) {
                return Err(Fault::invalid(
                    path,
                    format!("horizontal angles from 0 to {last}°"),
                    "angles up to 90, 180 or 360",
                ));
            }
            Ok(close(planes().collect()))
        }
        (first, last) => Err(Fault::invalid(
            path,
            format!("horizontal angles from {first} to {last}°"),
            "angles from 0 to 0, 90, 180 or 360, or from 90 to 270",
        )),
    }
}

/// Appends the plane at 0 to planes that begin at 0 and stop short of 360.
fn close(mut planes: Vec<(f32, usize)>) -> Vec<(f32, usize)> {
    planes.push((360.0, planes[0].1));
    planes
}

#[cfg(test)]
mod tests;
