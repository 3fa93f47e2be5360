//! `extras.lumel.cookie`: pictures that spots and suns project. No extension of glTF has them.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3, Vec2};

use super::extras::{ignore, member, number};
use crate::document::Document;
use crate::error::Outcome;
use crate::images::{self, Budget};
use crate::input::Input;
use crate::json::Item;
use crate::material;
use crate::nodes::Placed;
use crate::options::MAX_COORDINATE;
use crate::report::IngestReport;
use crate::scene::{Image, LightKind, PlacedCookie};
use crate::uri::Target;

/// Width of a sun's tile in metres, if the file does not say. Unity's default.
const TILE: f64 = 10.0;

/// Smallest width of a sun's tile in metres. Smaller ones would only be noise.
const LEAST_TILE: f64 = 1e-3;

/// Widest half-angle of a spot that can project a picture, radians: 89°. At 90° its square is
/// infinitely large.
const WIDEST: f32 = 1.5533;

/// The pictures read so far, each once.
#[derive(Debug)]
pub(super) struct Cookies {
    pictures: Vec<Image>,
    /// By key: a URI, or `images[i]`, which is no valid name of a file beside the document.
    known: BTreeMap<String, usize>,
    files: Vec<Input>,
    budget: Budget,
}

impl Cookies {
    pub fn new(document: &Document) -> Cookies {
        Cookies {
            pictures: Vec::new(),
            known: BTreeMap::new(),
            files: Vec::new(),
            budget: Budget::new(document, 0),
        }
    }

    /// The pictures in the order of first use; records their files in the document.
    pub fn finish(self, document: &mut Document) -> Vec<Image> {
        self.files.into_iter().for_each(|f| document.note_input(f));
        self.pictures
    }

    /// The picture of `item`: an index of a texture, or the URI of a picture. `None` if it is
    /// neither.
    fn of(
        &mut self,
        document: &Document,
        item: &Item<'_>,
        report: &mut IngestReport,
    ) -> Outcome<Option<usize>> {
        let expected = "the index of a texture, or the URI of a picture";
        if let Some(uri) = item.value.as_str() {
            return self.of_uri(document, uri, &item.path).map(Some);
        }
        let root = document.root();
        let textures = root.len_of("textures")?;
        let index = item.value.as_u64().filter(|&i| i < textures as u64);
        let Some(index) = index else {
            ignore(item, expected, report);
            return Ok(None);
        };
        let texture = root.element("textures", index as usize)?;
        let mut faults = Vec::new();
        let image = material::choose_image(document, &texture, report, &mut faults)?;
        if let Some(fault) = faults.pop() {
            return Err(fault);
        }
        let Some(i) = image else {
            return Ok(None);
        };
        let path = format!("images[{i}]");
        if let Some(&known) = self.known.get(&path) {
            return Ok(Some(known));
        }
        let (bytes, file) = images::open(document, i)?;
        self.files.extend(file);
        self.keep(path.clone(), &bytes, &path).map(Some)
    }

    fn of_uri(&mut self, document: &Document, uri: &str, path: &str) -> Outcome<usize> {
        if let Some(&known) = self.known.get(uri) {
            return Ok(known);
        }
        let bytes = match document.files.resolve(uri, path)? {
            Target::Data(bytes) => bytes,
            Target::File(file) => {
                let limit = document.limits().file_bytes;
                let bytes = document.files.read(&file, path, limit)?;
                self.files.push(Input::new(file, uri.to_string(), &bytes));
                bytes
            }
        };
        self.keep(uri.to_string(), &bytes, path)
    }

    fn keep(&mut self, key: String, bytes: &[u8], path: &str) -> Outcome<usize> {
        let size = images::dimensions(path, bytes)?;
        self.budget.claim(path, size, bytes)?;
        let index = self.pictures.len();
        self.pictures.push(images::decode_one(path, bytes)?);
        self.known.insert(key, index);
        Ok(index)
    }
}

/// The cookie of a light; `None` if it has none or cannot project one.
///
/// # Errors
/// The picture cannot be read or decoded.
pub(super) fn read(
    document: &Document,
    places: [&Item<'_>; 2],
    placed: &Placed,
    kind: &LightKind,
    origin: DVec3,
    cookies: &mut Cookies,
    report: &mut IngestReport,
) -> Outcome<Option<PlacedCookie>> {
    let Some(item) = places.into_iter().find_map(|p| member(p, "cookie")) else {
        return Ok(None);
    };
    let Some(cookie) = cookies.of(document, &item, report)? else {
        return Ok(None);
    };
    let picture = &cookies.pictures[cookie];
    let scale = match *kind {
        LightKind::Spot { outer, .. } if outer <= WIDEST => Vec2::splat(0.5 / libm::tanf(outer)),
        LightKind::Directional { .. } => {
            let expected = "the width of the tile in metres, above 0";
            let width = number(places, "cookieSize", MAX_COORDINATE, expected, report);
            let width = width.unwrap_or(TILE).max(LEAST_TILE);
            let height = width * f64::from(picture.height) / f64::from(picture.width);
            Vec2::new((1.0 / width) as f32, (1.0 / height) as f32)
        }
        _ => {
            report.count("lights.extras_ignored", 1);
            report.warn(
                &item.path,
                "the cone is wider than 89 degrees on each side; the cookie is ignored",
            );
            return Ok(None);
        }
    };
    let position = placed.transform.translation - origin;
    let Some(axes) = axes(&placed.transform).filter(|_| position.is_finite()) else {
        report.count("lights.extras_ignored", 1);
        report.warn(
            &item.path,
            "the node's transform gives the cookie no direction; the cookie is ignored",
        );
        return Ok(None);
    };
    Ok(Some(PlacedCookie {
        cookie,
        from_world: axes.transpose().as_mat3(),
        position: position.as_vec3(),
        scale,
    }))
}

/// The node's axes as unit vectors at right angles; a mirrored node mirrors the picture. Of the
/// scale only the signs matter, as for the light's direction.
fn axes(transform: &DAffine3) -> Option<DMat3> {
    let m = transform.matrix3;
    let z = m.z_axis.try_normalize()?;
    let x = (m.x_axis - z * m.x_axis.dot(z)).try_normalize()?;
    let y = z.cross(x);
    let y = if m.y_axis.dot(y) < 0.0 { -y } else { y };
    Some(DMat3::from_cols(x, y, z))
}
