//! Memory layout of the tree: eight-wide nodes and packs of four triangles.

use glam::Vec3;

/// Children per node.
pub(crate) const WIDTH: usize = 8;
/// Triangles per pack.
pub(crate) const PACK: usize = 4;
/// Most packs in one leaf; the count shares the child word with the pack's index.
pub(crate) const MAX_LEAF_PACKS: usize = 8;
/// Set in a pack's id if hits on the triangle go through the filter.
pub(crate) const FILTERED: u32 = 1 << 31;
/// Id of an unused lane.
pub(crate) const NO_TRIANGLE: u32 = FILTERED - 1;

const LEAF: u32 = 1 << 31;
const COUNT_SHIFT: u32 = 28;
const FIRST_MASK: u32 = (1 << COUNT_SHIFT) - 1;

/// Reference to a child of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Child(pub u32);

impl Child {
    /// No child; its box is inverted, so that no ray enters it.
    pub const EMPTY: Child = Child(u32::MAX);

    pub fn node(index: u32) -> Child {
        debug_assert!(
            index < LEAF,
            "node index {index} collides with the leaf flag"
        );
        Child(index)
    }

    /// `count` packs from `first`; `count` in 1..=8.
    pub fn leaf(first: u32, count: u32) -> Child {
        debug_assert!(
            first < FIRST_MASK && (1..=MAX_LEAF_PACKS as u32).contains(&count),
            "leaf {first} + {count}"
        );
        Child(LEAF | (count - 1) << COUNT_SHIFT | first)
    }

    #[inline(always)]
    pub fn is_leaf(self) -> bool {
        self.0 & LEAF != 0
    }

    /// Pack range of a leaf.
    #[inline(always)]
    pub fn packs(self) -> std::ops::Range<usize> {
        let first = (self.0 & FIRST_MASK) as usize;
        first..first + ((self.0 & !LEAF) >> COUNT_SHIFT) as usize + 1
    }
}

/// Largest number of packs that child words can address.
pub(crate) const MAX_PACKS: usize = FIRST_MASK as usize;

/// Eight child boxes as structure of arrays, and references to the children: 224 bytes of 256.
///
/// The alignment makes each row of eight one aligned vector and minimises the number of cache lines
/// per node.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// `[axis][0 = lower, 1 = upper][child]`.
    pub bounds: [[[f32; WIDTH]; 2]; 3],
    pub children: [u32; WIDTH],
}

impl Node {
    pub const EMPTY: Node = Node {
        bounds: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
        children: [Child::EMPTY.0; WIDTH],
    };

    pub fn set(&mut self, slot: usize, lo: Vec3, hi: Vec3, child: Child) {
        for axis in 0..3 {
            self.bounds[axis][0][slot] = lo[axis];
            self.bounds[axis][1][slot] = hi[axis];
        }
        self.children[slot] = child.0;
    }

    pub fn child(&self, slot: usize) -> Child {
        Child(self.children[slot])
    }

    pub fn child_box(&self, slot: usize) -> (Vec3, Vec3) {
        let side =
            |s: usize| Vec3::from_array([0, 1, 2].map(|axis: usize| self.bounds[axis][s][slot]));
        (side(0), side(1))
    }
}

/// Four triangles, structure of arrays.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Pack {
    /// `[axis][corner][lane]`. Unused lanes are NaN, which no test passes.
    pub corners: [[[f32; PACK]; 3]; 3],
    /// Index of each triangle, with [`FILTERED`] if its hits go through the filter; [`NO_TRIANGLE`]
    /// in unused lanes.
    pub ids: [u32; PACK],
}

impl Pack {
    pub const EMPTY: Pack = Pack {
        corners: [[[f32::NAN; PACK]; 3]; 3],
        ids: [NO_TRIANGLE; PACK],
    };

    pub fn set(&mut self, lane: usize, triangle: &[Vec3; 3], id: u32) {
        for (corner, point) in triangle.iter().enumerate() {
            for (axis, x) in point.to_array().into_iter().enumerate() {
                self.corners[axis][corner][lane] = x;
            }
        }
        self.ids[lane] = id;
    }

    /// Corners of the triangle in `lane`.
    pub fn triangle(&self, lane: usize) -> [Vec3; 3] {
        let [x, y, z] = &self.corners;
        let corner = |k: usize| Vec3::new(x[k][lane], y[k][lane], z[k][lane]);
        [corner(0), corner(1), corner(2)]
    }
}
