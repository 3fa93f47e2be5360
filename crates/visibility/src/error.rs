//! Errors of building and validating a tree.

/// Why [`Bvh::build`](crate::Bvh::build) refused its input.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A corner is NaN or infinite.
    #[error("triangle {triangle} has a corner that is not finite")]
    NonFinite {
        /// Index into the slice given to the build.
        triangle: u32,
    },
    /// A coordinate is so large that products of two differences would overflow `f32`.
    #[error("triangle {triangle} has a coordinate beyond ±{limit:e}")]
    TooFar {
        /// Index into the slice given to the build.
        triangle: u32,
        /// Largest allowed magnitude, see [`MAX_COORDINATE`](crate::kernel::MAX_COORDINATE).
        limit: f32,
    },
    /// More triangles than can be indexed.
    #[error("{got} triangles, expected at most {limit}")]
    TooManyTriangles {
        /// Number of triangles.
        got: usize,
        /// Largest number that can be indexed.
        limit: usize,
    },
}

/// A violated invariant found by [`Bvh::validate`](crate::Bvh::validate).
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ValidateError {
    /// A child refers to a node or pack that does not exist.
    #[error("node {node}, child {child}: refers past the end")]
    OutOfRange {
        /// The node that holds the reference.
        node: u32,
        /// Index among its eight children.
        child: u32,
    },
    /// A node or pack is reached more than once (a cycle or a shared subtree).
    #[error("node {node}, child {child}: reached a second time")]
    Shared {
        /// The node that holds the second reference.
        node: u32,
        /// Index among its eight children.
        child: u32,
    },
    /// A child's box does not contain its subtree.
    #[error("node {node}, child {child}: box does not contain its subtree")]
    Box {
        /// The node that holds the box.
        node: u32,
        /// Index among its eight children.
        child: u32,
    },
    /// A box is inverted or NaN although the child exists, or the reverse.
    #[error("node {node}, child {child}: box and reference disagree on whether the child exists")]
    Empty {
        /// The node that holds the box.
        node: u32,
        /// Index among its eight children.
        child: u32,
    },
    /// Some nodes or packs cannot be reached from the root.
    #[error("{unreached} nodes or packs are not reached from the root")]
    Unreached {
        /// Their number.
        unreached: usize,
    },
    /// A triangle is in no leaf, in several, or unknown.
    #[error("triangle {triangle} appears {times} times in the leaves")]
    Triangle {
        /// Index into the slice given to the build.
        triangle: u32,
        /// How often it appears.
        times: u32,
    },
    /// The tree is deeper than the traversal stack was sized for.
    #[error("depth {depth}, recorded {recorded}")]
    Depth {
        /// Actual depth.
        depth: u32,
        /// Recorded depth, which determines the stack's size.
        recorded: u32,
    },
}
