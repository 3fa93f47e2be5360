//! A grid of probes as a volume texture of ambient cubes, as Bevy's irradiance volumes are.
//!
//! A voxel has six colours: R = E/π of surfaces that face +X, −X, +Y and so on. An engine mixes
//! three of them by the squares of the normal's components. Grids of (Rx, Ry, Rz) probes are textures of
//! (Rx, 2 Ry, 3 Rz): sides X, Y and Z follow each other along z; along y, negative sides follow
//! positive ones. Bevy's shader reads it so; its documentation says the signs the other way round.
//!
//! Based on: Mitchell, McTaggart, Green, *Shading in Valve's Source Engine*, 2006; Bevy 0.16,
//! `irradiance_volume.wgsl`.

use ktx2::Format;

use super::container::assemble;
use super::rgb9e5;
use crate::error::{Error, Result};
use crate::probe_file::ProbeFile;

/// Encodes the grid of `probes` as `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32`. Negative values, which
/// harmonics may have, become 0; values beyond the format's are clamped.
///
/// # Errors
/// [`Error::Inconsistent`] if the probes form no grid.
pub fn write_probe_volume(probes: &ProbeFile) -> Result<Vec<u8>> {
    let none = || Error::Inconsistent {
        at: "probe volume".into(),
        message: "expected a grid of probes".into(),
    };
    let grid = probes.grid.as_ref().ok_or_else(none)?;
    let [rx, ry, rz] = grid.dims.map(|n| n as usize);
    if probes.probes.len() != rx * ry * rz || probes.probes.is_empty() {
        return Err(none());
    }
    let mut data = Vec::with_capacity(24 * probes.probes.len());
    for axis in 0..3 {
        for z in 0..rz {
            for sign in [1.0, -1.0] {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                for at in rx * ry * z..rx * ry * (z + 1) {
                    let light = probes.probes[at].diffuse(normal);
                    let light = light.map(|x| if x > 0.0 { x.min(rgb9e5::MAX) } else { 0.0 });
                    data.extend(rgb9e5::encode(light).to_le_bytes());
                }
            }
        }
    }
    let size = [grid.dims[0], 2 * grid.dims[1], 3 * grid.dims[2]];
    assemble((Format::E5B9G9R9_UFLOAT_PACK32, 4), size, &data)
}

#[cfg(test)]
mod tests {
    use gather::probes::{Probe, ProbeGrid};
    use glam::{DVec3, Vec3};

    use super::*;

    /// What Bevy's shader shows at the centre of a voxel.
    fn shown(texels: &[u32], [rx, ry, rz]: [usize; 3], at: [usize; 3], n: Vec3) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for axis in 0..3 {
            let y = at[1] + if n[axis] < 0.0 { ry } else { 0 };
            let z = at[2] + axis * rz;
            let word = texels[at[0] + rx * (y + 2 * ry * z)];
            sum += Vec3::from(rgb9e5::decode(word)) * n[axis] * n[axis];
        }
        sum
    }

    #[test]
    fn each_side_of_each_voxel_has_the_light_of_its_probe() {
        let grid = ProbeGrid::over(DVec3::ZERO, DVec3::new(3.0, 2.0, 2.0), 1.0).expect("a grid");
        let count = (0..3).map(|k| grid.dims[k] as usize).product();
        let probes: Vec<Probe> = (0..count)
            .map(|i| {
                let mut probe = Probe::default();
                let x = 1.0 + i as f32;
                probe.sh.0[0] = Vec3::new(8.0, 4.0, 2.0) * x;
                probe.sh.0[1] = Vec3::splat(0.5 * x);
                probe.sh.0[3] = Vec3::new(-1.0, 0.0, 1.0) * x;
                probe
            })
            .collect();
        let at: Vec<DVec3> = (0..count).map(|i| grid.position(i)).collect();
        let file = ProbeFile::new(&at, &probes, Some(&grid));
        let bytes = write_probe_volume(&file).expect("a volume");
        let reader = ktx2::Reader::new(&bytes[..]).expect("KTX2");
        let header = reader.header();
        let dims = grid.dims.map(|n| n as usize);
        assert_eq!(
            [header.pixel_width, header.pixel_height, header.pixel_depth],
            [grid.dims[0], 2 * grid.dims[1], 3 * grid.dims[2]]
        );
        let level = reader.levels().next().expect("a level").data;
        let texels: Vec<u32> = (level.chunks_exact(4))
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        let sides = [
            Vec3::X,
            Vec3::NEG_X,
            Vec3::Y,
            Vec3::NEG_Y,
            Vec3::Z,
            Vec3::NEG_Z,
        ];
        for (i, probe) in file.probes.iter().enumerate() {
            let place = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
            for n in sides {
                let found = shown(&texels, dims, place, n);
                let exact = Vec3::from(probe.diffuse(n.to_array()));
                // A step of the format is a 256th of the largest channel.
                let off = (found - exact).abs().max_element() / exact.max_element();
                assert!(off < 1.0 / 256.0, "{i} {n}: {found} {exact}");
            }
        }
        let list = ProbeFile::new(&at, &probes, None);
        assert!(write_probe_volume(&list).is_err());
    }
}
