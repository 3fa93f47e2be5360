//! Flat pieces of surface, each in one plane.

use mesh_ingest::Soup;

use crate::region::{Connected, RegionOptions};

/// Faces within this angle of the largest one are in its plane, radians: one degree, as where
/// meshes are cut.
const FLAT: f32 = 0.017_45;

/// The connected pieces of surface that lie in a plane, numbered by their first triangles. A region
/// may consist of several, as patches need not be as flat.
pub struct FlatPieces {
    of_triangle: Vec<u32>,
    /// Neighbours of each piece, ascending, in compressed rows.
    starts: Vec<u32>,
    beside: Vec<u32>,
}

impl FlatPieces {
    /// Finds them. `two_sided` is as for [`Subdivision::build`](crate::Subdivision::build).
    ///
    /// O(n log n) in triangles.
    pub fn find(soup: &Soup, two_sided: impl Fn(usize) -> bool + Sync) -> Self {
        let connected = Connected::new(soup, two_sided);
        let options = RegionOptions {
            flat_angle: FLAT,
            cluster_angle: FLAT,
        };
        let (mut of_triangle, count) = connected.flood(soup, 0.0, &options);
        // By their first triangles, not by size.
        let mut name = vec![u32::MAX; count as usize];
        let mut named = 0;
        for piece in &mut of_triangle {
            let name = &mut name[*piece as usize];
            if *name == u32::MAX {
                *name = named;
                named += 1;
            }
            *piece = *name;
        }
        let mut pairs: Vec<[u32; 2]> = Vec::new();
        for (t, &own) in (0u32..).zip(&of_triangle) {
            let others = (connected.beside(t).iter()).map(|&m| of_triangle[m as usize]);
            pairs.extend(
                others
                    .filter(|&other| other != own)
                    .map(|other| [own, other]),
            );
        }
        pairs.sort_unstable();
        pairs.dedup();
        let starts = (0..=count).map(|piece| pairs.partition_point(|p| p[0] < piece) as u32);
        FlatPieces {
            of_triangle,
            starts: starts.collect(),
            beside: pairs.iter().map(|p| p[1]).collect(),
        }
    }

    /// The piece of a triangle; `None` for a triangle that rays do not see.
    pub fn of(&self, triangle: u32) -> Option<u32> {
        self.of_triangle.get(triangle as usize).copied()
    }

    /// The pieces that share an edge with a piece.
    pub fn beside(&self, piece: u32) -> &[u32] {
        let [from, to] = [piece, piece + 1].map(|k| self.starts[k as usize] as usize);
        &self.beside[from..to]
    }

    /// Their number.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subdivision::tests::{quad, soup};
    use crate::{Options, Subdivision};
    use glam::Vec3;

    #[test]
    fn a_floor_that_bends_by_two_degrees_is_two_pieces_and_one_region() {
        let bend = 2f32.to_radians();
        let mut triangles = quad(Vec3::ZERO, Vec3::Z, Vec3::X);
        let up = Vec3::new(bend.cos(), bend.sin(), 0.0);
        triangles.extend(quad(Vec3::X, Vec3::Z, up));
        // Apart from both.
        triangles.extend(quad(Vec3::X * 9.0, Vec3::Z, Vec3::X));
        let soup = soup(triangles);
        let cut = Subdivision::build(&soup, |_| false, &Options::default());
        assert_eq!(cut.region_of(0), cut.region_of(2));
        let pieces = FlatPieces::find(&soup, |_| false);
        assert_eq!(pieces.len(), 3);
        let of = |t| pieces.of(t).expect("a triangle that rays see");
        assert!(of(0) == of(1) && of(2) == of(3) && of(4) == of(5));
        assert!(of(0) != of(2));
        assert_eq!(pieces.beside(of(0)), &[of(2)]);
        assert_eq!(pieces.beside(of(2)), &[of(0)]);
        assert!(pieces.beside(of(4)).is_empty());
        assert_eq!(pieces.of(6), None);
    }
}
