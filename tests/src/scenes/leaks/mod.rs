//! The leak suite: scenes whose walls, joints and props defeat lightmaps, each with the parts of
//! its surfaces that must be dark and those that are lit beside them.
//!
//! What is dark is so by construction: it lies in a space that solids or single skins close off
//! from every source of light, with joints that overlap. So E is exactly 0 there, whatever the
//! bake. What light reaches through an opening is for a path tracer to say ([`Kind::Dim`]).
//! `tests/tests/leaks.rs` holds the dark parts against 0, `tools/leaks.py` everything against
//! truth; `lab/leaks.md` has the tables.

mod kit;
mod outdoors;
mod props;
mod region;
mod walls;

use serde_json::{Value, json};

pub use region::{Hull, Kind, Region};

/// A scene of the suite.
#[derive(Debug, Clone)]
pub struct LeakScene {
    /// File name without ending.
    pub name: &'static str,
    /// What it is, and what an artist did to get it, in a line.
    pub what: &'static str,
    /// The scene.
    pub glb: Vec<u8>,
    /// Radiance of the uniform sky that it is baked under, W/(m² sr).
    pub sky: f32,
    /// Lumels a metre that it is baked with.
    pub texels_per_unit: f32,
    /// Parts of its surfaces, and what light they get. The mean over those that are [`Kind::Lit`]
    /// is the yardstick.
    pub regions: Vec<Region>,
    /// A face goes on behind a wall so thin that bilinear lookups on its dark side reach lumels
    /// with a part on the lit side (some 1.6 lumels, askew), or even that one lumel is on both
    /// sides. No value is right on both.
    pub shared_lumels: bool,
    /// E of every lit point, W/m², where it is the same for all (a furnace).
    pub even: Option<f64>,
    /// ∫ E dA over the lit regions, W, where it is known.
    pub received: Option<f64>,
}

/// The scenes, in the order of `lab/leaks.md`.
pub const LEAKS: &[fn() -> LeakScene] = &[
    walls::sealed_box,
    walls::box_on_floor,
    walls::wall_1mm,
    walls::wall_20cm,
    walls::sheet_wall,
    walls::three_rooms,
    walls::door_ajar,
    walls::storeys,
    outdoors::corner_normals,
    outdoors::inward_room,
    outdoors::house_on_ground,
    outdoors::barn_on_terrain,
    outdoors::modular,
    outdoors::vault,
    outdoors::roof_gap,
    props::stairs,
    props::cabinet,
    props::overlapping_props,
    props::crates,
    props::furnace,
    props::white_room,
];

/// What `tools/leaks.py` needs to know of `scenes`, for `leaks.json`.
pub fn description(scenes: &[LeakScene]) -> Value {
    let hull = |h: &Hull| json!(h);
    let region = |r: &Region| {
        json!({"node": r.node, "kind": r.kind.name(), "facing": r.facing.map(|f| f.to_array()), "within": hull(&r.within),
            "without": r.without.iter().map(hull).collect::<Vec<_>>()})
    };
    let scene = |s: &LeakScene| {
        json!({"name": s.name, "what": s.what, "sky": s.sky, "texels_per_unit": s.texels_per_unit, "shared_lumels": s.shared_lumels, "even": s.even, "received": s.received,
            "regions": s.regions.iter().map(region).collect::<Vec<_>>()})
    };
    Value::Array(scenes.iter().map(scene).collect())
}
