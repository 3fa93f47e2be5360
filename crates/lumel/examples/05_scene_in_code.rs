//! Bakes several generated scenes with one baker.
//!
//!     cargo run --release -p lumel --example 05_scene_in_code
//!
//! A lamp of I = 10 cd hangs above a black floor at three heights h. The point below the lamp gets
//! E = I/h², so its lumel is R = E/π.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::f32::consts::PI;

use lumel::{Baker, MemoryDocument, Quality, SceneBuilder, Surface};

/// Candela.
const INTENSITY: f32 = 10.0;

fn main() -> Result<(), lumel::Error> {
    let baker = Baker::new().quality(Quality::Draft).texels_per_unit(32.0);
    for height in [0.5, 1.0, 2.0] {
        let bake = baker.bake(&lamp_over_floor(height))?;
        let brightest = bake.pages()[0]
            .value
            .iter()
            .map(|v| v[0])
            .fold(0.0, f32::max);
        println!(
            "h = {height} m: brightest lumel {brightest:.3}, I/(pi h^2) = {:.3}",
            INTENSITY / (PI * height * height)
        );
    }
    Ok(())
}

/// A lamp `height` metres above the centre of a square of 2 m × 2 m.
fn lamp_over_floor(height: f32) -> MemoryDocument {
    let mut scene = SceneBuilder::new();
    let black = scene.material(
        "black",
        Surface {
            reflectance: [0.0; 3],
            ..Surface::default()
        },
    );
    let corners = [
        [-1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, -1.0],
        [-1.0, 0.0, -1.0],
    ];
    let square = scene.mesh("square", &corners, &[[0, 1, 2], [0, 2, 3]], black);
    scene.place("floor", square, [0.0; 3]);
    scene.point_light("lamp", [0.0, height, 0.0], [INTENSITY; 3]);
    scene.finish("lamp.glb")
}
