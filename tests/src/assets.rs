//! The files under `assets/` and the functions that generate them.

use glam::Vec3;

use crate::scenes::{self, FurnaceShape, closed_form};

/// One file of `assets/`.
#[derive(Debug)]
pub struct Asset {
    /// File name.
    pub name: &'static str,
    /// Generates the file's bytes, which are the same every time.
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

/// Closed-form scenes with parameters suited to viewing or measuring. They are not committed;
/// `make-assets --closed-form DIR` writes them.
pub const CLOSED_FORM: &[Asset] = &[
    Asset {
        name: "point_over_floor.glb",
        make: || closed_form::point_over_floor(2.0, 1.0),
    },
    Asset {
        name: "spot_over_floor.glb",
        make: || closed_form::spot_over_floor(2.0, 1.0, 0.4, 0.8),
    },
    Asset {
        name: "sun_over_floor.glb",
        make: || closed_form::sun_over_floor(3.0, Vec3::new(0.6, -0.8, 0.0)),
    },
    Asset {
        name: "rectangle_over_floor.glb",
        make: || closed_form::rectangle_over_floor(2.0, 1.0, 1.0),
    },
    Asset {
        name: "sky_over_open_box.glb",
        make: || closed_form::sky_over_open_box(2.0, 1.0),
    },
    Asset {
        name: "facing_plates_1.glb",
        make: || closed_form::facing_plates(1.0, 1.0),
    },
    Asset {
        name: "facing_plates_1e-3.glb",
        make: || closed_form::facing_plates(1.0, 1e-3),
    },
    Asset {
        name: "sphere_interior.glb",
        make: || closed_form::sphere_interior(1.0, 0.7, 0.5, 4).0,
    },
    Asset {
        name: "masked_checker_screen.glb",
        make: || closed_form::masked_checker_screen(1.0),
    },
    Asset {
        name: "one_triangle.glb",
        make: closed_form::one_triangle,
    },
    Asset {
        name: "two_rooms_1mm.glb",
        make: || closed_form::two_rooms(0.001),
    },
    Asset {
        name: "many_triangles_1m.glb",
        make: || closed_form::many_triangles(708),
    },
];

/// Scenes with many triangles, for measurements. They are too large to commit;
/// `make-assets --dense DIR` writes them.
pub const DENSE: &[Asset] = &[Asset {
    name: "dense_room.glb",
    make: scenes::dense_room,
}];
