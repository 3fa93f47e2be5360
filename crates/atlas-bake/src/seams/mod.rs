//! Seams: where a surface goes on but its lightmap does not, bilinear lookups on both sides are
//! made to agree.
//!
//! A chart's border cuts through texels, differently on its two sides, so that two lookups at one
//! point of the surface mix differing lumels: one sees a line. This module finds the places
//! ([`border`], [`pairs`]), measures how far lookups differ ([`measure`]), and changes texels as
//! little as it can until they agree ([`solve`]), less where two grids cannot ([`contrast`]), and
//! not beyond the values at hand ([`bounds`]). Equations are summed up in one sparse matrix
//! ([`matrix`]), and a fixed number of steps goes towards their least ([`least`]): stitching's
//! share of a bake is known before.
//!
//! Based on: Ray, Nivoliers, Lefebvre, Lévy, *Invisible seams*, 2010 (agreement of bilinear lookups
//! as linear constraints on texels); Iwanicki, *Lighting technology of The Last of Us*, 2013 (least
//! squares over samples of lightmap seams). Ours: corrections that are relative to the light and
//! die out within a chart, seams between instances and across T-junctions, and a test whether light
//! may jump.

mod apply;
mod border;
mod bounds;
mod contrast;
mod least;
mod matrix;
mod measure;
mod pairs;
mod rows;
mod solve;
mod tree;

pub(crate) use apply::{Range, stitch};
pub use measure::{SeamError, SeamReport};
pub(crate) use pairs::find_samples;
pub(crate) use rows::{EMPTY, Texels};
pub(crate) use solve::Stitcher;
