//! Stores charts for later layouts, by content.
//!
//! A mesh's charts depend only on its [`UnwrapInput`] and the options, so they can be stored for
//! the next bake. Corrupted data is ignored.

use glam::Vec2;

use super::input::UnwrapInput;
use super::unwrapper::{UnwrapOptions, UnwrappedMesh, Unwrapper, check};

/// A store of charts that persists between layouts.
pub trait KeptCharts: Sync {
    /// The data saved under `key`; `None` if there is none or it is corrupted.
    fn load(&self, key: &[u8; 32]) -> Option<Vec<u8>>;
    /// Called when the data last returned by [`load`](Self::load) is intact and used.
    fn used(&self) {}
    /// Saves data, if possible.
    fn save(&self, key: &[u8; 32], bytes: &[u8]);
}

/// Least number of triangles of a stored mesh; unwrapping smaller ones takes milliseconds.
pub(crate) const LEAST_TRIANGLES: usize = 1000;

/// Identifies the format.
const FORM: &[u8] = b"lumel charts 1";

/// Hash of everything that `mesh`'s charts depend on.
pub(crate) fn key(
    mesh: &UnwrapInput,
    options: &UnwrapOptions,
    unwrappers: &[&'static dyn Unwrapper],
) -> [u8; 32] {
    let UnwrapInput {
        positions,
        triangles,
        primitive,
        seams,
        neighbors,
    } = mesh;
    let mut h = blake3::Hasher::new();
    h.update(FORM);
    // The debug format prints floats with enough digits to distinguish all values.
    let names: Vec<&str> = unwrappers.iter().map(|u| u.name()).collect();
    h.update(format!("{options:?} {names:?} {}", positions.len()).as_bytes());
    let mut buffer = Vec::with_capacity(1 << 16);
    let words = (positions
        .iter()
        .flat_map(|p| p.to_array())
        .map(f32::to_bits))
    .chain(triangles.iter().flatten().copied())
    .chain(primitive.iter().copied())
    .chain(neighbors.iter().flatten().copied())
    .chain(seams.iter().flatten().map(|s| u32::from(*s)));
    for word in words {
        buffer.extend_from_slice(&word.to_le_bytes());
        if buffer.len() >= 1 << 16 {
            h.update(&buffer);
            buffer.clear();
        }
    }
    h.update(&buffer);
    *h.finalize().as_bytes()
}

/// Serialises `mesh` as unwrapped by `unwrapper`: format, hash of the rest, index of the unwrapper,
/// numbers.
pub(crate) fn to_bytes(mesh: &UnwrappedMesh, unwrapper: usize) -> Vec<u8> {
    let head = [
        unwrapper as u32,
        mesh.size[0],
        mesh.size[1],
        mesh.texels_per_unit.to_bits(),
        mesh.charts,
    ];
    let corners = mesh.corners.iter().flatten().flat_map(|c| c.to_array());
    let words = (head.into_iter())
        .chain(corners.map(f32::to_bits))
        .chain(mesh.chart.iter().copied());
    let body: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
    [FORM, blake3::hash(&body).as_bytes(), &body].concat()
}

/// Deserialises the result of [`to_bytes`], if it is intact and belongs to this mesh.
pub(crate) fn from_bytes(
    bytes: &[u8],
    mesh: &UnwrapInput,
    options: &UnwrapOptions,
) -> Option<(UnwrappedMesh, usize)> {
    let (hash, body) = bytes.strip_prefix(FORM)?.split_first_chunk::<32>()?;
    if blake3::hash(body).as_bytes() != hash {
        return None;
    }
    let words: Vec<u32> = (body.as_chunks::<4>().0.iter())
        .map(|w| u32::from_le_bytes(*w))
        .collect();
    let (&[unwrapper, width, height, density, charts], rest) = words.split_first_chunk::<5>()?;
    let n = mesh.triangles.len();
    let (corners, chart) = rest.split_at_checked(6 * n)?;
    let corners = corners.as_chunks::<6>().0.iter().map(|c| {
        let x = c.map(f32::from_bits);
        [0, 2, 4].map(|k| Vec2::new(x[k], x[k + 1]))
    });
    let flat = UnwrappedMesh {
        size: [width, height],
        texels_per_unit: f32::from_bits(density),
        corners: corners.collect(),
        chart: chart.to_vec(),
        charts,
    };
    let flat = check(mesh, options, flat).ok()?;
    flat.chart
        .iter()
        .all(|c| *c < charts)
        .then_some((flat, unwrapper as usize))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unwrap::BoxProjection;
    use glam::Vec3;

    fn square() -> UnwrapInput {
        UnwrapInput {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            primitive: vec![0; 2],
            seams: vec![[false; 3]; 2],
            neighbors: vec![[super::super::input::NONE; 3]; 2],
        }
    }

    const OPTIONS: UnwrapOptions = UnwrapOptions {
        texels_per_unit: 8.0,
        padding: 2,
        block: 4,
        block_charts: false,
        max_size: 64,
    };

    #[test]
    fn what_is_kept_comes_back_whole_or_not_at_all() {
        let mesh = square();
        let flat = BoxProjection
            .unwrap(&mesh, &OPTIONS, &|| false)
            .expect("charts");
        let bytes = to_bytes(&flat, 1);
        let (again, unwrapper) = from_bytes(&bytes, &mesh, &OPTIONS).expect("whole");
        assert_eq!(
            (
                &again.corners,
                &again.chart,
                again.size,
                again.charts,
                unwrapper
            ),
            (&flat.corners, &flat.chart, flat.size, flat.charts, 1)
        );
        for length in 0..bytes.len() {
            assert!(
                from_bytes(&bytes[..length], &mesh, &OPTIONS).is_none(),
                "{length}"
            );
        }
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x20;
            assert!(from_bytes(&damaged, &mesh, &OPTIONS).is_none(), "{at}");
        }
        // Intact, but of a mesh with one triangle less.
        let mut other = mesh.clone();
        other.triangles.pop();
        assert!(from_bytes(&bytes, &other, &OPTIONS).is_none());
    }

    #[test]
    fn every_part_of_the_question_is_in_its_key() {
        let own = key(&square(), &OPTIONS, &[&BoxProjection]);
        assert_eq!(own, key(&square(), &OPTIONS, &[&BoxProjection]));
        let changes: [fn(&mut UnwrapInput); 5] = [
            |m| m.positions[1].x = 1.5,
            |m| m.triangles[0] = [1, 2, 0],
            |m| m.primitive[1] = 1,
            |m| m.seams[0][2] = true,
            |m| m.neighbors[0][2] = 1,
        ];
        for (k, change) in changes.into_iter().enumerate() {
            let mut mesh = square();
            change(&mut mesh);
            assert_ne!(own, key(&mesh, &OPTIONS, &[&BoxProjection]), "{k}");
        }
        let padded = UnwrapOptions {
            padding: 3,
            ..OPTIONS
        };
        assert_ne!(own, key(&square(), &padded, &[&BoxProjection]));
        assert_ne!(own, key(&square(), &OPTIONS, &[&super::super::Unroll]));
    }
}
