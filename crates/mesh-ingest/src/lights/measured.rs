//! `EXT_lights_ies`: lights with a measured distribution.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::document::Document;
use crate::error::{Fault, Outcome};
use crate::ies;
use crate::input::Input;
use crate::json::Item;
use crate::nodes::Placed;
use crate::options::MAX_COORDINATE;
use crate::report::IngestReport;
use crate::scene::{Light, LightKind, PlacedProfile, Profile};
use crate::uri::Target;

/// The profiles read so far, each file once.
#[derive(Debug, Default)]
pub(super) struct Profiles {
    profiles: Vec<Profile>,
    /// By key: a URI, or `bufferViews[i]`, which cannot be a valid relative path of a document.
    known: BTreeMap<String, (usize, f64)>,
    files: Vec<Input>,
}

impl Profiles {
    /// The profile of the file at `uri`, which the document references at `path`, and its largest
    /// intensity, candela.
    pub fn of_uri(
        &mut self,
        document: &Document,
        uri: &str,
        path: &str,
        report: &mut IngestReport,
    ) -> Outcome<(usize, f64)> {
        if let Some(&known) = self.known.get(uri) {
            return Ok(known);
        }
        let limit = document.limits().file_bytes.min(ies::MAX_BYTES);
        match document.files.resolve(uri, path)? {
            Target::Data(bytes) => self.keep(uri, &bytes, path, report),
            Target::File(file) => {
                let bytes = document.files.read(&file, path, limit)?;
                self.files.push(Input::new(file, uri.to_string(), &bytes));
                self.keep(uri, &bytes, path, report)
            }
        }
    }

    fn of_view(
        &mut self,
        document: &Document,
        view: usize,
        path: &str,
        report: &mut IngestReport,
    ) -> Outcome<(usize, f64)> {
        let key = format!("bufferViews[{view}]");
        if let Some(&known) = self.known.get(&key) {
            return Ok(known);
        }
        let bytes = document.view_bytes(view, &document.view_at(view)?)?;
        self.keep(&key, bytes, path, report)
    }

    fn keep(
        &mut self,
        key: &str,
        bytes: &[u8],
        path: &str,
        report: &mut IngestReport,
    ) -> Outcome<(usize, f64)> {
        let measured = ies::parse(bytes, path)?;
        for remark in measured.remarks {
            report.warn(path, remark);
        }
        let entry = (self.profiles.len(), measured.candela);
        self.profiles.push(measured.profile);
        self.known.insert(key.to_string(), entry);
        Ok(entry)
    }

    /// The profiles in the order of first use; records their files in the document.
    pub fn finish(self, document: &mut Document) -> Vec<Profile> {
        self.files.into_iter().for_each(|f| document.note_input(f));
        self.profiles
    }
}

/// Reads the light at `placed`; `None` if its transform gives it no position or direction.
pub(super) fn read(
    document: &Document,
    placed: &Placed,
    origin: DVec3,
    profiles: &mut Profiles,
    report: &mut IngestReport,
) -> Outcome<Option<Light>> {
    let root = document.root();
    let node = root.element("nodes", placed.node)?;
    let (Some(ext), Some(worn)) = (
        root.extension("EXT_lights_ies")?,
        node.extension("EXT_lights_ies")?,
    ) else {
        return Ok(None);
    };
    let item = ext.element("lights", placed.index)?;
    let (profile, candela) = match item.opt_str("uri")? {
        Some(uri) => profiles.of_uri(document, uri, &item.path_of("uri"), report)?,
        None => {
            let views = root.len_of("bufferViews")?;
            match item.opt_index("bufferView", "bufferViews", views)? {
                Some(view) => {
                    let path = item.path_of("bufferView");
                    profiles.of_view(document, view, &path, report)?
                }
                None => {
                    return Err(Fault::invalid(
                        item.path,
                        "neither uri nor bufferView",
                        "one of the two",
                    ));
                }
            }
        }
    };
    let position = placed.transform.translation - origin;
    let placeable = position.is_finite() && position.abs().max_element() <= MAX_COORDINATE;
    let Some(placed_profile) = wear(profile, &placed.transform).filter(|_| placeable) else {
        report.count("lights.unplaceable", 1);
        report.warn(
            node.path,
            "its transform gives the light no position or direction; the light is dropped",
        );
        return Ok(None);
    };
    let factor = super::intensity_of(&worn, "multiplier", 1.0, report)?.as_dvec3() * candela;
    let most = f64::from(f32::MAX);
    Ok(Some(Light {
        name: super::name_of(&item, &node),
        node: Some(placed.node),
        intensity: factor.min(DVec3::splat(most)).as_vec3(),
        kind: LightKind::Point {
            position: position.as_vec3(),
            range: None,
            radius: super::extras::radius([&node, &item as &Item<'_>], report),
        },
        profile: Some(placed_profile),
        cookie: None,
    }))
}

/// A profile on a node with this world transform; `None` if that gives no direction.
///
/// The extension aims nadir, the zero of both angles, along −Z of the node, and X/Y is its
/// horizontal plane. Horizontal angle 0 is +X and increases towards +Y, counter-clockwise about the
/// zenith. Of the scale only the signs matter.
pub(super) fn wear(profile: usize, transform: &DAffine3) -> Option<PlacedProfile> {
    let m = transform.matrix3;
    let z = m.z_axis.try_normalize()?;
    let x = (m.x_axis - z * m.x_axis.dot(z))
        .try_normalize()
        .unwrap_or_else(|| z.any_orthonormal_vector());
    let y = z.cross(x);
    let y = if m.y_axis.dot(y) < 0.0 { -y } else { y };
    // Rows: the profile's X, Y and Z axes are the node's X, Z and −Y.
    let rows = DMat3::from_cols(x, z, -y).transpose();
    let from_world = rows.as_mat3();
    debug_assert!((from_world * -z.as_vec3()).distance(Vec3::NEG_Y) < 1e-5);
    Some(PlacedProfile {
        profile,
        from_world,
    })
}
