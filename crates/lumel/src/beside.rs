//! What a bake does beside its result: cache, first picture, remarks.

use std::path::PathBuf;

use crate::cache::Cache;
use crate::error::Error;

/// Optional side effects of a bake that do not change the result.
///
/// ```
/// use lumel::{Beside, Cache};
///
/// let cache = Cache { folder: "cache".into(), limit: Cache::LIMIT };
/// let beside = Beside { cache: Some(&cache), ..Beside::default() };
/// ```
#[derive(Clone, Copy, Default)]
pub struct Beside<'a> {
    /// Where charts of large meshes are cached.
    pub cache: Option<&'a Cache>,
    /// Receives a picture of the level as soon as the solve is done, before lumels are gathered.
    pub first_picture: Option<FirstPicture<'a>>,
    /// Make charts and solve the light one after the other, so that phase times do not overlap.
    pub in_turn: bool,
    /// Files that will be written or deleted ([`output_names`](crate::output_names),
    /// [`outputs_in`](crate::outputs_in)). A bake that would read one of them ends with
    /// [`Error::Overwrite`] before planning.
    pub outputs: &'a [PathBuf],
    /// Receives remarks before the work begins. The report contains them too.
    pub tell: Option<&'a (dyn Fn(Remark<'_>) + Sync)>,
}

impl<'a> Beside<'a> {
    /// For a second attempt, when the first picture and the remarks have been shown already.
    pub(crate) fn again(&self) -> Beside<'a> {
        Beside {
            first_picture: None,
            tell: None,
            ..*self
        }
    }
}

/// A remark that is known before a bake begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remark<'a> {
    /// A decision that the bake made: one of [`Report::notes`](crate::Report::notes).
    Note(&'a str),
    /// A possible problem: one of [`Report::warnings`](crate::Report::warnings).
    Warning(&'a str),
}

/// A picture of the level lit by the solution on patches: coarse, with some noise near lamps and
/// contacts, but available early in a bake.
#[derive(Clone, Copy)]
pub struct FirstPicture<'a> {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Receives the PNG on a worker thread, which waits for it. An error ends the bake.
    pub show: &'a (dyn Fn(Vec<u8>) -> Result<(), Error> + Sync),
}
