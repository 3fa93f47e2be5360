//! Lamps and colours of the studies.

use glam::DVec3;

use super::room::{Room, Surface};
use crate::enclosure::Enclosure;

/// A rectangle of the ceiling that emits light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Segments along x: the first, and one past the last.
    pub x: [usize; 2],
    /// Segments along z: the first, and one past the last.
    pub z: [usize; 2],
    /// M_e, W/m².
    pub exitance: DVec3,
}

/// One study.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// For file names.
    pub name: &'static str,
    /// For people.
    pub title: &'static str,
    /// The lamps.
    pub lamps: Vec<Lamp>,
    /// ρ of all surfaces except those in `painted`.
    pub reflectance: f64,
    /// Surfaces with their own ρ.
    pub painted: Vec<(Surface, f64)>,
    /// Numbers of gathers of the baseline; each gives a picture.
    pub iterations: Vec<u32>,
}

/// Number of gathers of the baseline in studies of other subjects.
const USUAL: u32 = 8;

const RED: DVec3 = DVec3::new(1.0, 0.0, 0.0);
const GREEN: DVec3 = DVec3::new(0.0, 1.0, 0.0);
const BLUE: DVec3 = DVec3::new(0.0, 0.0, 1.0);
const YELLOW: DVec3 = DVec3::new(1.0, 1.0, 0.0);

impl Lamp {
    /// 1 × 0.75 m in the middle of the ceiling.
    fn centre(exitance: DVec3) -> Lamp {
        Lamp {
            x: [3, 4],
            z: [2, 3],
            exitance,
        }
    }

    /// 4 × 10 squares of 0.25 m, 2.5 m², lengthwise along the middle of the ceiling.
    fn forty_squares(exitance: DVec3) -> Lamp {
        Lamp {
            x: [3, 4],
            z: [1, 4],
            exitance,
        }
    }
}

impl Case {
    fn grey(name: &'static str, title: &'static str, lamps: Vec<Lamp>, reflectance: f64) -> Case {
        Case {
            name,
            title,
            lamps,
            reflectance,
            painted: Vec::new(),
            iterations: vec![USUAL],
        }
    }

    /// The room's patches with this case's lamps and colours. Lamps reflect like the ceiling around
    /// them.
    pub fn enclosure(&self, room: &Room) -> Enclosure {
        let patches = room
            .patches
            .iter()
            .map(|p| {
                let lamp = self.lamps.iter().find(|l| {
                    p.surface == Surface::Ceiling
                        && (l.x[0]..l.x[1]).contains(&p.segment[0])
                        && (l.z[0]..l.z[1]).contains(&p.segment[1])
                });
                let rho = self
                    .painted
                    .iter()
                    .find(|(s, _)| *s == p.surface)
                    .map_or(self.reflectance, |(_, rho)| *rho);
                p.patch(lamp.map_or(DVec3::ZERO, |l| l.exitance), DVec3::splat(rho))
            })
            .collect();
        Enclosure { patches }
    }
}

/// The studies, in the order of the page.
pub fn cases() -> Vec<Case> {
    let white = DVec3::ONE;
    let shades = [
        (Surface::Floor, 0.3),
        (Surface::LeftWall, 0.5),
        (Surface::RightWall, 0.5),
        (Surface::BackWall, 0.6),
        (Surface::FrontWall, 0.4),
        (Surface::Ceiling, 0.7),
        (Surface::TallBox, 0.2),
        (Surface::LowBox, 0.8),
    ];
    vec![
        Case::grey(
            "yellow",
            "One yellow light over dark patches, ρ 0.5",
            vec![Lamp::centre(100.0 * YELLOW)],
            0.5,
        ),
        Case::grey(
            "orange",
            "Red and yellow lights mix to orange, ρ 0.5",
            vec![
                Lamp {
                    x: [1, 2],
                    z: [2, 3],
                    exitance: 150.0 * RED,
                },
                Lamp {
                    x: [4, 5],
                    z: [2, 3],
                    exitance: 60.0 * YELLOW,
                },
            ],
            0.5,
        ),
        Case {
            painted: shades.to_vec(),
            ..Case::grey(
                "grey",
                "Grey shading: one white light, ρ 0.2 to 0.8",
                vec![Lamp::centre(100.0 * white)],
                0.5,
            )
        },
        Case::grey(
            "cyan",
            "Green and blue lights tint the left wall cyan, ρ 0.5",
            vec![
                Lamp {
                    x: [1, 2],
                    z: [2, 3],
                    exitance: 60.0 * GREEN,
                },
                // A third as wide, and farther from the wall.
                Lamp {
                    x: [2, 3],
                    z: [2, 3],
                    exitance: 240.0 * BLUE,
                },
                Lamp {
                    x: [4, 5],
                    z: [2, 3],
                    exitance: 40.0 * white,
                },
            ],
            0.5,
        ),
        Case::grey(
            "ceiling40",
            "A ceiling light of 40 squares, ρ 0.5",
            vec![Lamp::forty_squares(30.0 * white)],
            0.5,
        ),
        Case::grey(
            "rho03",
            "The same, ρ 0.3",
            vec![Lamp::forty_squares(30.0 * white)],
            0.3,
        ),
        Case {
            iterations: vec![0, 4, USUAL, 16],
            ..Case::grey(
                "rho07",
                "The same, ρ 0.7; 0, 4, 8 and 16 iterations",
                vec![Lamp::forty_squares(30.0 * white)],
                0.7,
            )
        },
    ]
}
