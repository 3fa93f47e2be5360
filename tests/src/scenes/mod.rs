//! Scenes with parameters; each states the source of its data or of its solution.

mod classic;
pub mod closed_form;
mod cornell;
mod demo;
mod dense;
mod furnace;
pub mod leaks;
mod sealed;
pub mod second_method;
pub mod smooth;

use glam::Vec3;

pub use classic::classic_room;
pub use cornell::{cornell_box, lamp_radiance, reflectances};
pub use demo::demo_level;
pub use dense::dense_room;
pub use furnace::{FurnaceShape, furnace};
pub use sealed::sealed_dark_box;

use crate::gltf::{GltfBuilder, Node, look_along};

/// Adds a 16:9 camera at `eye` that looks at `target`; vertical field of view in degrees. The first
/// is the preview's.
fn add_camera(b: &mut GltfBuilder, eye: Vec3, target: Vec3, degrees: f32) {
    let camera = b.camera("camera", degrees.to_radians(), 16.0 / 9.0);
    b.node(Node {
        name: "camera".into(),
        translation: eye,
        rotation: look_along(target - eye, Vec3::Y),
        camera: Some(camera),
        ..Node::default()
    });
}
