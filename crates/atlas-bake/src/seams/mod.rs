//! Seams: where a surface continues across a chart border, bilinear lookups on both sides are made
//! to agree.
//!
//! A chart border cuts through texels differently on its two sides, so two lookups at the same
//! point of the surface mix different lumels, and a line becomes visible. This module finds such
//! places ([`border`], [`pairs`]), measures the differences ([`measure`]), and changes texels as
//! little as possible until the lookups agree ([`solve`]). It demands less agreement where the two
//! grids cannot represent the same light ([`contrast`]), and stays within the range of nearby
//! values ([`bounds`]). The equations form one sparse matrix ([`matrix`]), which is minimised with
//! a fixed number of steps ([`least`]), so that the time for stitching is predictable.
//!
//! Based on: Ray, Nivoliers, Lefebvre, Lévy, *Invisible seams*, 2010 (agreement of bilinear lookups
//! as linear constraints on texels); Iwanicki, *Lighting technology of The Last of Us*, 2013 (least
//! squares over samples of lightmap seams). Additions: corrections that are relative to the light
//! and fade out within a chart, seams between instances and across T-junctions, and a test whether
//! light may be discontinuous.

mod apply;
mod border;
mod bounds;
mod contrast;
mod least;
mod matrix;
mod measure;
mod pairs;
mod parted;
mod rows;
mod solve;
mod tree;

pub(crate) use apply::{Range, stitch};
pub use measure::{SeamError, SeamReport};
pub(crate) use pairs::find_samples;
pub(crate) use rows::{EMPTY, Texels};
pub(crate) use solve::Stitcher;
