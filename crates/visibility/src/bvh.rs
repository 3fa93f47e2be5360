//! The tree and its public interface.

use glam::Vec3;

use crate::binary;
use crate::collapse::collapse;
use crate::error::BuildError;
use crate::kernel::{Isa, MAX_COORDINATE};
use crate::node::{MAX_PACKS, Node, Pack};

/// Build time against ray speed. All but `Fast` build two trees and keep the one that should be
/// faster.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Quality {
    /// Fastest build.
    Fast,
    /// Balanced for a bake.
    #[default]
    Balanced,
    /// A few per cent faster rays for several times the build time.
    High,
}

/// Options of [`Bvh::build`].
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct BuildOptions {
    /// Build time against ray speed.
    pub quality: Quality,
}

impl BuildOptions {
    /// Options with the given quality, and defaults otherwise.
    pub fn with_quality(quality: Quality) -> BuildOptions {
        BuildOptions { quality }
    }
}

/// Size of a tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BvhStats {
    /// Triangles given to the build.
    pub triangles: usize,
    /// Eight-wide nodes.
    pub nodes: usize,
    /// Leaves, each of one or more packs.
    pub leaves: usize,
    /// Packs of four triangles; the last of a leaf may be partly filled.
    pub packs: usize,
    /// Heap memory in bytes.
    pub bytes: usize,
    /// Levels of nodes; 0 for an empty tree.
    pub depth: u32,
}

/// An eight-wide bounding volume hierarchy with its own copy of the triangles.
#[derive(Debug, Clone)]
pub struct Bvh {
    pub(crate) nodes: Vec<Node>,
    pub(crate) packs: Vec<Pack>,
    pub(crate) depth: u32,
    pub(crate) triangles: usize,
    pub(crate) bounds: Option<(Vec3, Vec3)>,
    pub(crate) isa: Isa,
}

impl Bvh {
    /// Builds the tree over world-space `triangles` with corners counter-clockwise seen from the
    /// front. Hits on triangles for which `filtered` returns true are passed to the
    /// [`HitFilter`](crate::HitFilter).
    ///
    /// Any finite triangles are allowed, including degenerate ones, duplicates, or none. The build
    /// is serial and depends only on its input.
    ///
    /// # Errors
    /// [`BuildError`] if a corner is not finite or beyond ±[`MAX_COORDINATE`], or if there are too
    /// many triangles.
    pub fn build(
        triangles: &[[Vec3; 3]],
        filtered: impl Fn(u32) -> bool,
        options: &BuildOptions,
    ) -> Result<Bvh, BuildError> {
        // In the worst case each triangle takes its own pack.
        if triangles.len() > MAX_PACKS {
            return Err(BuildError::TooManyTriangles {
                got: triangles.len(),
                limit: MAX_PACKS,
            });
        }
        for (index, triangle) in triangles.iter().enumerate() {
            if !triangle.iter().all(|c| c.is_finite()) {
                return Err(BuildError::NonFinite {
                    triangle: index as u32,
                });
            }
            if triangle
                .iter()
                .any(|c| c.abs().max_element() > MAX_COORDINATE)
            {
                return Err(BuildError::TooFar {
                    triangle: index as u32,
                    limit: MAX_COORDINATE,
                });
            }
        }
        let mut bvh = Bvh {
            nodes: vec![],
            packs: vec![],
            depth: 0,
            triangles: 0,
            bounds: None,
            isa: Isa::detect(),
        };
        if triangles.is_empty() {
            return Ok(bvh);
        }
        let boxes = binary::boxes(triangles);
        let mut tree = collapse(&boxes.clustered(options.quality), triangles, &filtered);
        // Neither tree is always better: Sponza's rays, among small triangles across large ones, are
        // 1.3 times as fast in the clustered one, those of 16 copies of the demo level in the other.
        if options.quality != Quality::Fast {
            let other = collapse(&boxes.divided(options.quality), triangles, &filtered);
            if other.cost < tree.cost {
                tree = other;
            }
        }
        bvh.nodes = tree.nodes;
        bvh.packs = tree.packs;
        bvh.depth = tree.depth;
        bvh.triangles = triangles.len();
        bvh.bounds = Some(tree.bounds);
        Ok(bvh)
    }

    /// Corners of the box around all triangles; `None` for an empty tree.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.bounds
    }

    /// Size of the tree.
    pub fn stats(&self) -> BvhStats {
        let leaves = self.nodes.iter().flat_map(|n| n.children).filter(|&c| {
            let child = crate::node::Child(c);
            child != crate::node::Child::EMPTY && child.is_leaf()
        });
        BvhStats {
            triangles: self.triangles,
            nodes: self.nodes.len(),
            leaves: leaves.count(),
            packs: self.packs.len(),
            bytes: self.nodes.capacity() * size_of::<Node>()
                + self.packs.capacity() * size_of::<Pack>(),
            depth: self.depth,
        }
    }

    /// Name of the instruction set used on this machine. It only affects speed.
    pub fn instruction_set(&self) -> &'static str {
        self.isa.name()
    }

    /// The same tree, traversed without machine-specific instructions; for tests that compare
    /// results.
    #[doc(hidden)]
    pub fn into_portable(mut self) -> Bvh {
        self.isa = Isa::Portable;
        self
    }
}
