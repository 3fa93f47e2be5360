//! `level.probes.json`.

use gather::probes::{Probe, ProbeGrid};
use glam::DVec3;
use serde::Serialize;

/// Probes with everything that a program needs to use them. The order of fields is that of the
/// file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ProbeFile {
    /// Format version; raised when readers of the old version would misread the file.
    pub version: u32,
    /// Program and version.
    pub generator: String,
    /// Axes and unit of positions and directions.
    pub axes: &'static str,
    /// Quantity of the coefficients.
    pub value: &'static str,
    /// Unit of the radiance: photometric or radiometric, depending on the scene's lights. glTF
    /// files do not say which.
    pub units: &'static str,
    /// Always `linear Rec.709`.
    pub color_space: &'static str,
    /// Order of each probe's nine coefficients.
    pub basis: [&'static str; 9],
    /// Arrangement of the probes; absent for a list of points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid: Option<FilledGrid>,
    /// The grid as a volume texture, if that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<ProbeVolume>,
    /// The probes. In a grid, x varies fastest, then y; points of a list keep their order.
    pub probes: Vec<FileProbe>,
}

/// A [`ProbeGrid`] in a [`ProbeFile`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct FilledGrid {
    /// Position of the first probe, metres.
    pub origin: [f64; 3],
    /// Distance between neighbours along x, y, z, metres.
    pub spacing: [f64; 3],
    /// Probes along x, y, z.
    pub dims: [u32; 3],
}

/// A volume texture of a grid ([`write_probe_volume`](crate::write_probe_volume)): voxels are boxes
/// around the probes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ProbeVolume {
    /// File name, next to the probe file.
    pub uri: String,
    /// Centre of the box that the texture fills, metres.
    pub center: [f64; 3],
    /// Size of the box, metres.
    pub size: [f64; 3],
}

impl FilledGrid {
    /// The box of all voxels, for a texture with this name.
    pub fn volume(&self, uri: &str) -> ProbeVolume {
        let size = [0, 1, 2].map(|k| self.spacing[k] * f64::from(self.dims[k]));
        ProbeVolume {
            uri: uri.into(),
            center: [0, 1, 2].map(|k| self.origin[k] + 0.5 * (size[k] - self.spacing[k])),
            size,
        }
    }
}

/// A [`Probe`] in a [`ProbeFile`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FileProbe {
    /// Metres, the glTF's world space.
    pub position: [f64; 3],
    /// Whether the probe is in the open. An invalid probe of a grid has the light of its
    /// neighbours.
    pub valid: bool,
    /// Fraction of rays that hit backfaces of single-sided materials.
    pub backfaces: f32,
    /// Estimated standard error of the luminance of the first coefficient.
    pub error: f32,
    /// Nine coefficients, RGB.
    pub sh: [[f32; 3]; 9],
}

impl FileProbe {
    /// R = E/π of a surface with this unit normal (Ramamoorthi & Hanrahan, 2001).
    pub fn diffuse(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let basis = [
            0.282_095,
            0.325_735 * y,
            0.325_735 * z,
            0.325_735 * x,
            0.273_137 * x * y,
            0.273_137 * y * z,
            0.078_848 * (3.0 * z * z - 1.0),
            0.273_137 * x * z,
            0.136_569 * (x * x - y * y),
        ];
        std::array::from_fn(|c| (self.sh.iter().zip(basis)).map(|(sh, y)| sh[c] * y).sum())
    }
}

impl ProbeFile {
    /// `probes` at `positions` (in the glTF's world space, metres); `grid` if they form one.
    pub fn new(positions: &[DVec3], probes: &[Probe], grid: Option<&ProbeGrid>) -> ProbeFile {
        let both = positions.iter().zip(probes);
        ProbeFile {
            version: 1,
            generator: concat!("lumel ", env!("CARGO_PKG_VERSION")).into(),
            axes: "right-handed, +Y up, metres, as in the glTF",
            value: "radiance by the direction it arrives from",
            units: "nit or W/(m2 sr)",
            color_space: "linear Rec.709",
            basis: [
                "L0,0", "L1,-1", "L1,0", "L1,1", "L2,-2", "L2,-1", "L2,0", "L2,1", "L2,2",
            ],
            grid: grid.map(|g| FilledGrid {
                origin: g.origin.to_array(),
                spacing: [g.spacing; 3],
                dims: g.dims,
            }),
            volume: None,
            probes: both
                .map(|(at, p)| FileProbe {
                    position: at.to_array(),
                    valid: p.valid,
                    backfaces: p.backfaces,
                    error: p.error,
                    sh: p.sh.0.map(|c| c.to_array()),
                })
                .collect(),
        }
    }

    /// The file's bytes: JSON with one line per member and per probe, and a final newline.
    pub fn to_json(&self) -> Vec<u8> {
        // Serialising plain structs to memory cannot fail: no map has non-string keys.
        let head = ProbeFile {
            generator: self.generator.clone(),
            volume: self.volume.clone(),
            probes: Vec::new(),
            ..*self
        };
        let mut head = serde_json::to_value(&head).unwrap_or_default();
        let mut out = Vec::with_capacity(512 + 400 * self.probes.len());
        out.extend(b"{\n");
        if let Some(members) = head.as_object_mut() {
            members.shift_remove("probes");
            for (key, value) in members {
                out.extend(format!("  \"{key}\": {value},\n").bytes());
            }
        }
        out.extend(b"  \"probes\": [");
        for (i, p) in self.probes.iter().enumerate() {
            out.extend(if i == 0 { &b"\n    "[..] } else { b",\n    " });
            out.extend(serde_json::to_vec(p).unwrap_or_default());
        }
        out.extend(b"\n  ]\n}\n");
        out
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn the_file_holds_what_was_baked() {
        let grid = ProbeGrid::over(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0), 1.0).unwrap();
        let mut probe = Probe {
            error: 0.1,
            backfaces: 0.25,
            valid: false,
            ..Probe::default()
        };
        for (i, c) in probe.sh.0.iter_mut().enumerate() {
            *c = Vec3::new(0.1, 1e-20, 3e20) * (i as f32 + 1.0);
        }
        let probes = [Probe::default(), probe];
        let at: Vec<DVec3> = (0..2).map(|i| grid.position(i)).collect();
        let bytes = ProbeFile::new(&at, &probes, Some(&grid)).to_json();
        assert!(bytes.ends_with(b"}\n"));
        let json: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!(json["version"], 1);
        assert_eq!(json["basis"].as_array().unwrap().len(), 9);
        assert_eq!(
            json["grid"],
            serde_json::json!({"origin": [0.5, 0.5, 0.5], "spacing": [1.0, 1.0, 1.0], "dims": [2, 1, 1]})
        );
        let p = &json["probes"][1];
        assert_eq!(p["position"], serde_json::json!([1.5, 0.5, 0.5]));
        assert_eq!(
            (&p["valid"], &p["backfaces"]),
            (&false.into(), &0.25.into())
        );
        for (i, c) in probe.sh.0.iter().enumerate() {
            for k in 0..3 {
                // Every f32 survives the round trip.
                let x = p["sh"][i][k].as_f64().unwrap() as f32;
                assert_eq!(x, c[k]);
            }
        }
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains("\"error\":0.1,"), "shortest decimals: {text}");
        let list = ProbeFile::new(&at, &probes, None).to_json();
        let json: serde_json::Value = serde_json::from_slice(&list).unwrap();
        assert!(json.get("grid").is_none());
        let none = ProbeFile::new(&[], &[], None).to_json();
        assert!(serde_json::from_slice::<serde_json::Value>(&none).is_ok());
    }
}
