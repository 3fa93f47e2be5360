//! The files under `assets/`, and what makes each.

use crate::scenes::{self, FurnaceShape};

/// One file of `assets/`.
#[derive(Debug)]
pub struct Asset {
    /// File name.
    pub name: &'static str,
    /// Makes the file's bytes; the same every time.
    pub make: fn() -> Vec<u8>,
}

/// Every committed asset, in the order of `assets/README.md`.
pub const ASSETS: &[Asset] = &[
    Asset {
        name: "cornell_box.glb",
        make: scenes::cornell_box,
    },
    Asset {
        name: "classic_room_1014.glb",
        make: || scenes::classic_room(13),
    },
    Asset {
        name: "classic_room_5766.glb",
        make: || scenes::classic_room(31),
    },
    Asset {
        name: "furnace_cube_50.glb",
        make: || scenes::furnace(0.5, 1.0, FurnaceShape::Cube),
    },
    Asset {
        name: "furnace_cube_90.glb",
        make: || scenes::furnace(0.9, 1.0, FurnaceShape::Cube),
    },
    Asset {
        name: "furnace_sphere_50.glb",
        make: || scenes::furnace(0.5, 1.0, FurnaceShape::Sphere),
    },
    Asset {
        name: "furnace_nonconvex_90.glb",
        make: || scenes::furnace(0.9, 1.0, FurnaceShape::NonConvex),
    },
    Asset {
        name: "sealed_dark_box.glb",
        make: || scenes::sealed_dark_box(0.05),
    },
    Asset {
        name: "sealed_dark_box_thin.glb",
        make: || scenes::sealed_dark_box(0.001),
    },
    Asset {
        name: "demo_level.glb",
        make: scenes::demo_level,
    },
];
