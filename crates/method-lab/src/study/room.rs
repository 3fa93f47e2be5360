//! The room of the studies, divided into patches at two densities.

use glam::DVec3;

use crate::enclosure::Patch;

/// Metres per coarse cell.
const CELL: f64 = 0.25;

/// Coarse cells of each segment along x, y, z. Borders of boxes and lamps coincide with segment
/// borders, so that they are the same at both densities. The room is 14 × 9 × 14 cells.
const COARSE: [&[u32]; 3] = [&[1, 3, 1, 4, 4, 1], &[2, 4, 3], &[2, 3, 3, 4, 2]];

/// Fine cells of the same segments: about 2.4 times as many (5760 = 2.4² · 1000), rounded so that
/// the total is 5760.
const FINE: [&[u32]; 3] = [&[2, 7, 2, 10, 10, 3], &[5, 9, 7], &[5, 7, 7, 10, 5]];

/// The boxes: surface, and by axis the first segment inside and one past the last.
const BOXES: [(Surface, [[usize; 2]; 3]); 2] = [
    (Surface::TallBox, [[1, 2], [0, 2], [1, 2]]),
    (Surface::LowBox, [[4, 5], [0, 1], [3, 4]]),
];

/// Patch density of the room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// 1000 patches, squares of 0.25 m.
    Coarse,
    /// 5760 patches of about 0.1 m; the sides of a patch differ by up to a quarter.
    Fine,
}

/// The surface that a patch belongs to. y is up; x = 0 is the left wall, z = 0 the back wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Surface {
    /// x = 0.
    LeftWall,
    /// x = 3.5 m.
    RightWall,
    /// y = 0.
    Floor,
    /// y = 2.25 m.
    Ceiling,
    /// z = 0.
    BackWall,
    /// z = 3.5 m.
    FrontWall,
    /// 0.75 × 1.5 × 0.75 m, at the back on the left.
    TallBox,
    /// 1 × 0.5 × 1 m, at the front on the right.
    LowBox,
}

impl Surface {
    /// Name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Surface::LeftWall => "left_wall",
            Surface::RightWall => "right_wall",
            Surface::Floor => "floor",
            Surface::Ceiling => "ceiling",
            Surface::BackWall => "back_wall",
            Surface::FrontWall => "front_wall",
            Surface::TallBox => "tall_box",
            Surface::LowBox => "low_box",
        }
    }
}

/// A rectangle of the room's inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoomPatch {
    /// Corners, counter-clockwise seen from inside the room, metres.
    pub corners: [DVec3; 4],
    /// Unit normal, into the room.
    pub normal: DVec3,
    /// Its surface.
    pub surface: Surface,
    /// Segment along x and z of the cell in front of it, which determines its lamp on the ceiling.
    pub segment: [usize; 2],
}

/// The room.
#[derive(Debug, Clone, PartialEq)]
pub struct Room {
    /// All patches.
    pub patches: Vec<RoomPatch>,
    boxes: Vec<[DVec3; 2]>,
}

impl Room {
    /// The room at one density.
    pub fn new(detail: Detail) -> Room {
        let cells = match detail {
            Detail::Coarse => COARSE,
            Detail::Fine => FINE,
        };
        let axes: [Axis; 3] = std::array::from_fn(|k| Axis::new(COARSE[k], cells[k]));
        let n: [usize; 3] = std::array::from_fn(|k| axes[k].segment.len());
        let mut patches = Vec::new();
        for x in 0..n[0] {
            for y in 0..n[1] {
                for z in 0..n[2] {
                    let cell = [x, y, z];
                    if box_in(&axes, cell).is_some() {
                        continue;
                    }
                    for face in FACES {
                        if let Some(surface) = behind(&axes, cell, face) {
                            patches.push(rectangle(&axes, cell, face, surface));
                        }
                    }
                }
            }
        }
        let boxes = BOXES
            .iter()
            .map(|(_, spans)| {
                [0, 1].map(|side| {
                    DVec3::from(std::array::from_fn(|k| axes[k].border(spans[k][side])))
                })
            })
            .collect();
        Room { patches, boxes }
    }

    /// Whether no box is between two points of the room's surface.
    ///
    /// Boxes are shrunk by a nanometre, so that a point is not hidden by the face that it is on.
    pub fn sees(&self, a: DVec3, b: DVec3) -> bool {
        let d = b - a;
        self.boxes.iter().all(|[low, high]| {
            let (mut from, mut to) = (0.0f64, 1.0f64);
            for k in 0..3 {
                let (low, high) = (low[k] + 1e-9, high[k] - 1e-9);
                if d[k] == 0.0 {
                    if a[k] <= low || a[k] >= high {
                        return true;
                    }
                } else {
                    let (s, t) = ((low - a[k]) / d[k], (high - a[k]) / d[k]);
                    from = from.max(s.min(t));
                    to = to.min(s.max(t));
                }
            }
            from >= to
        })
    }
}

impl RoomPatch {
    /// The patch with its emission and colour.
    pub fn patch(&self, exitance: DVec3, reflectance: DVec3) -> Patch {
        Patch {
            corners: self.corners.to_vec(),
            exitance,
            reflectance,
        }
    }
}

/// The cells along one axis.
struct Axis {
    /// Borders of cells, metres.
    lines: Vec<f64>,
    /// Which segment each cell is in.
    segment: Vec<usize>,
}

impl Axis {
    fn new(coarse: &[u32], cells: &[u32]) -> Axis {
        let mut axis = Axis {
            lines: vec![0.0],
            segment: Vec::new(),
        };
        let mut from = 0.0;
        for (s, (&length, &count)) in coarse.iter().zip(cells).enumerate() {
            let length = f64::from(length) * CELL;
            for k in 1..=count {
                axis.lines
                    .push(from + length * f64::from(k) / f64::from(count));
                axis.segment.push(s);
            }
            from += length;
        }
        axis
    }

    /// Where `segment` begins, metres.
    fn border(&self, segment: usize) -> f64 {
        self.lines[self.segment.iter().take_while(|s| **s < segment).count()]
    }
}

/// A face of a cell: the axis that it is perpendicular to, whether it is at the high end, and the
/// wall that it touches at the room's border.
type Face = (usize, bool, Surface);

const FACES: [Face; 6] = [
    (0, false, Surface::LeftWall),
    (0, true, Surface::RightWall),
    (1, false, Surface::Floor),
    (1, true, Surface::Ceiling),
    (2, false, Surface::BackWall),
    (2, true, Surface::FrontWall),
];

/// The box that fills a cell.
fn box_in(axes: &[Axis; 3], cell: [usize; 3]) -> Option<Surface> {
    let holds = |spans: &[[usize; 2]; 3]| {
        (0..3).all(|k| (spans[k][0]..spans[k][1]).contains(&axes[k].segment[cell[k]]))
    };
    BOXES
        .iter()
        .find(|(_, spans)| holds(spans))
        .map(|(surface, _)| *surface)
}

/// What is on the other side of a face of an air cell, if it is solid.
fn behind(axes: &[Axis; 3], cell: [usize; 3], (axis, high, wall): Face) -> Option<Surface> {
    let mut next = cell;
    next[axis] = if high {
        cell[axis] + 1
    } else {
        match cell[axis].checked_sub(1) {
            Some(k) => k,
            None => return Some(wall),
        }
    };
    if next[axis] == axes[axis].segment.len() {
        return Some(wall);
    }
    box_in(axes, next)
}

/// A face of an air cell as a patch.
fn rectangle(
    axes: &[Axis; 3],
    cell: [usize; 3],
    (axis, high, _): Face,
    surface: Surface,
) -> RoomPatch {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let corner = |du: usize, dv: usize| {
        let mut p = DVec3::ZERO;
        p[axis] = axes[axis].lines[cell[axis] + usize::from(high)];
        p[u] = axes[u].lines[cell[u] + du];
        p[v] = axes[v].lines[cell[v] + dv];
        p
    };
    let mut normal = DVec3::ZERO;
    normal[axis] = if high { -1.0 } else { 1.0 };
    // u × v is the axis: counter-clockwise seen from its high end.
    let mut corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
    if high {
        corners.swap(1, 3);
    }
    RoomPatch {
        corners,
        normal,
        surface,
        segment: [axes[0].segment[cell[0]], axes[2].segment[cell[2]]],
    }
}
