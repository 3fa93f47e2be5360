//! Levels that nobody tuned for: a generator of levels as people build them, drawn from a family and a seed.
//!
//! A level is a `.glb` with three cameras (`view_0` looks around, `view_1` and `view_2` look at corners and contacts from 1.5 to 4 m)
//! and the settings that `lumel bake` reads beside it (its sky). The same family, seed and size give the same bytes on every
//! machine. `cargo run --release -p lumel-tests --bin make-level -- --list` names the families.

mod archviz;
mod greybox;
mod kit;
mod maze;
mod plan;
mod random;
mod shapes;
mod suite;
#[cfg(test)]
mod tests;
mod views;

use std::fmt;
use std::str::FromStr;

use kit::Kit;
use random::Random;

/// A way in which people build levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Family {
    /// Rooms of wall boxes that overlap, abut or fall short by a millimetre.
    Greybox,
    /// White rooms with windows, frames, sills and furniture.
    Archviz,
    /// An office maze of coincident panels.
    Maze,
    /// A hotel suite lit through its windows alone.
    Suite,
}

impl Family {
    /// All of them.
    pub const ALL: [Family; 4] = [
        Family::Greybox,
        Family::Archviz,
        Family::Maze,
        Family::Suite,
    ];

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Family::Greybox => "greybox",
            Family::Archviz => "archviz",
            Family::Maze => "maze",
            Family::Suite => "suite",
        }
    }

    /// What is built, in a line.
    pub fn what(self) -> &'static str {
        match self {
            Family::Greybox => "rooms of wall boxes that overlap, abut or fall short",
            Family::Archviz => "white rooms with windows to sky and sun",
            Family::Maze => "an office maze of coincident panels",
            Family::Suite => "a hotel suite lit through its windows alone",
        }
    }

    fn make(self) -> fn(&mut Kit) {
        match self {
            Family::Greybox => greybox::make,
            Family::Archviz => archviz::make,
            Family::Maze => maze::make,
            Family::Suite => suite::make,
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Family {
    type Err = String;

    fn from_str(s: &str) -> Result<Family, String> {
        let found = Family::ALL.into_iter().find(|f| f.name() == s);
        found.ok_or_else(|| format!("no family is called {s}"))
    }
}

/// How large a level is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Size {
    /// A room or two, some hundred triangles, no textures: a draft takes a second or two.
    Small,
    /// A level as people have it, up to some ten thousand triangles.
    Full,
}

/// A finished level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Level {
    /// The binary glTF.
    pub glb: Vec<u8>,
    /// The text of `LEVEL.lumel.toml`; empty where the defaults do.
    pub settings: String,
}

/// The level of a family that `seed` draws.
pub fn level(family: Family, seed: u64, size: Size) -> Level {
    // Streams by name, so that a new family changes no other one's levels.
    let stream = (family.name().bytes()).fold(u64::from(size == Size::Small), |h, b| {
        h.wrapping_mul(0x100_0000_01B3) ^ u64::from(b)
    });
    let mut kit = Kit::new(Random::new(seed, stream), size);
    family.make()(&mut kit);
    kit.finish()
}
