//! Levels for which nothing was tuned: a generator of typical levels, drawn from a family and a
//! seed.
//!
//! A level is a `.glb` with three cameras (`view_0` looks around, `view_1` and `view_2` look at
//! corners and contacts from 1.5 to 4 m), and a settings file that `lumel bake` reads with it (its
//! sky). The same family, seed and size give the same bytes on every machine.
//! `cargo run --release -p lumel-tests --bin make-level -- --list` lists the families.

mod archviz;
mod blocks;
mod cave;
mod foliage;
mod furniture;
mod greybox;
mod kit;
mod lamps;
mod lods;
mod maze;
mod modular;
mod nets;
mod plan;
mod random;
mod shapes;
mod sheets;
mod steps;
mod suite;
mod terrain;
#[cfg(test)]
mod tests;
mod uv1;
mod views;

use std::fmt;
use std::str::FromStr;

use kit::Kit;
use random::Random;

/// A style of level construction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Family {
    /// Rooms of wall boxes that overlap, abut or fall short by a millimetre.
    Greybox,
    /// A few pieces on a grid, placed many times, rotated, mirrored, back to back.
    Kit,
    /// White rooms with windows, frames, sills and furniture.
    Archviz,
    /// Tunnels and domes displaced by noise.
    Cave,
    /// Stairs of intersecting boxes, in a room or under a vault.
    Stairs,
    /// A heightfield with houses sunk in it.
    Terrain,
    /// Leaf cards around garden walls.
    Foliage,
    /// A stylised dungeon of stone blocks under torches.
    Blocks,
    /// Furniture that is flush with walls, sunk in them, hovering, or intersecting.
    Furniture,
    /// An office maze of coincident panels.
    Maze,
    /// Three levels of detail in one place, and variants.
    Lods,
    /// Levels with their own lightmap coordinates, good and bad.
    Uv1,
    /// Few and many lamps of all kinds in halls and corridors.
    Lamps,
    /// A hotel suite lit only through its windows.
    Suite,
    /// Rooms whose walls have no thickness, but a face for each side.
    Sheets,
}

impl Family {
    /// All of them.
    pub const ALL: [Family; 15] = [
        Family::Greybox,
        Family::Kit,
        Family::Archviz,
        Family::Cave,
        Family::Stairs,
        Family::Terrain,
        Family::Foliage,
        Family::Blocks,
        Family::Furniture,
        Family::Maze,
        Family::Lods,
        Family::Uv1,
        Family::Lamps,
        Family::Suite,
        Family::Sheets,
    ];

    /// The name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Family::Greybox => "greybox",
            Family::Kit => "kit",
            Family::Archviz => "archviz",
            Family::Cave => "cave",
            Family::Stairs => "stairs",
            Family::Terrain => "terrain",
            Family::Foliage => "foliage",
            Family::Blocks => "blocks",
            Family::Furniture => "furniture",
            Family::Maze => "maze",
            Family::Lods => "lods",
            Family::Uv1 => "uv1",
            Family::Lamps => "lamps",
            Family::Suite => "suite",
            Family::Sheets => "sheets",
        }
    }

    /// Description in a line.
    pub fn what(self) -> &'static str {
        match self {
            Family::Greybox => "rooms of wall boxes that overlap, abut or fall short",
            Family::Kit => "pieces of a kit, instanced, mirrored, back to back",
            Family::Archviz => "white rooms with windows to sky and sun",
            Family::Cave => "tunnels and domes displaced by noise",
            Family::Stairs => "stairs of boxes in each other, in rooms and under vaults",
            Family::Terrain => "a heightfield with houses sunk in it",
            Family::Foliage => "leaf cards around garden walls",
            Family::Blocks => "a dungeon of stone blocks under torches",
            Family::Furniture => "furniture flush, sunk, hovering, in each other",
            Family::Maze => "an office maze of coincident panels",
            Family::Lods => "levels of detail and variants in one place",
            Family::Uv1 => "lightmap coordinates of its own, good and bad",
            Family::Lamps => "few and many lamps in halls and corridors",
            Family::Suite => "a hotel suite lit through its windows alone",
            Family::Sheets => "rooms of walls without thickness, a face for each side",
        }
    }

    fn make(self) -> fn(&mut Kit) {
        match self {
            Family::Greybox => greybox::make,
            Family::Kit => modular::make,
            Family::Archviz => archviz::make,
            Family::Cave => cave::make,
            Family::Stairs => steps::make,
            Family::Terrain => terrain::make,
            Family::Foliage => foliage::make,
            Family::Blocks => blocks::make,
            Family::Furniture => furniture::make,
            Family::Maze => maze::make,
            Family::Lods => lods::make,
            Family::Uv1 => uv1::make,
            Family::Lamps => lamps::make,
            Family::Suite => suite::make,
            Family::Sheets => sheets::make,
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
    /// A room or two with a few hundred triangles and no textures; a draft takes one or two
    /// seconds.
    Small,
    /// A realistic level of up to tens of thousands of triangles.
    Full,
}

/// A finished level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Level {
    /// The binary glTF.
    pub glb: Vec<u8>,
    /// The text of `LEVEL.lumel.toml`; empty if the defaults apply.
    pub settings: String,
}

/// The level that `seed` draws from a family.
pub fn level(family: Family, seed: u64, size: Size) -> Level {
    // Streams depend on names, so a new family changes no other family's levels.
    let stream = (family.name().bytes()).fold(u64::from(size == Size::Small), |h, b| {
        h.wrapping_mul(0x100_0000_01B3) ^ u64::from(b)
    });
    let mut kit = Kit::new(Random::new(seed, stream), size);
    family.make()(&mut kit);
    kit.finish()
}
