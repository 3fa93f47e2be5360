//! The leak suite: scenes whose walls, joints and props are hard for lightmaps, each with the
//! regions of its surfaces that must be dark and those beside them that are lit.
//!
//! Dark regions are dark by construction: solids or single skins with overlapping joints close them
//! off from every light source. So E is exactly 0 there, whatever the bake does. A path tracer
//! gives the light through openings ([`Kind::Dim`]). `tests/tests/leaks.rs` compares dark regions
//! with 0, `tools/leaks.py` compares everything with the truth.

mod kit;
mod outdoors;
mod props;
mod region;
mod walls;

use serde_json::{Value, json};

pub use props::white_room_from;
pub use region::{Hull, Kind, Region};

/// A scene of the suite.
#[derive(Debug, Clone)]
pub struct LeakScene {
    /// File name without ending.
    pub name: &'static str,
    /// What it shows, and what an artist did to cause it, in a line.
    pub what: &'static str,
    /// The scene.
    pub glb: Vec<u8>,
    /// Radiance of the uniform sky that it is baked under, W/(m² sr).
    pub sky: f32,
    /// Lumels per metre of its bake.
    pub texels_per_unit: f32,
    /// Regions of its surfaces and their light. The mean over those that are [`Kind::Lit`] is the
    /// reference brightness.
    pub regions: Vec<Region>,
    /// Whether a face continues behind a wall so thin that bilinear lookups on its dark side reach
    /// lumels with a lit part (some 1.6 lumels, diagonally), or even that one lumel is on both
    /// sides. No value is correct on both.
    pub shared_lumels: bool,
    /// E of every lit point, W/m², if it is the same everywhere (a furnace).
    pub even: Option<f64>,
    /// ∫ E dA over the lit regions, W, if it is known.
    pub received: Option<f64>,
}

/// The scenes, in the order in which they are reported.
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

/// What `tools/leaks.py` needs to know about `scenes`, for `leaks.json`.
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
