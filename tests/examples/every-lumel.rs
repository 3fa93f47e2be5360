//! Compares every lumel of four rooms with the path tracer, for the record in
//! `lab/second_method.md`; minutes:
//! `[QUALITY=draft|preview] cargo run --release -p lumel-tests --example every-lumel`.

#[path = "../tests/second_method/written.rs"]
mod written;

use lumel::{Quality, Settings, SkySource};
use lumel_tests::path_tracer::Effort;
use lumel_tests::scenes::{cornell_box, second_method as scenes};

use written::{BIAS, Written, production};

#[allow(clippy::print_stdout, reason = "its table is what it is for")]
fn main() {
    let sky = SkySource::Color(scenes::SKY);
    let none = SkySource::None;
    let quality = match std::env::var("QUALITY").as_deref() {
        Ok("draft") => Quality::Draft,
        Ok("preview") => Quality::Preview,
        _ => Quality::Production,
    };
    for (name, glb, settings) in [
        ("Cornell box", cornell_box(), production(8.0, none.clone())),
        ("skylit room", scenes::skylit_room(), production(10.0, sky)),
        (
            "coloured room",
            scenes::coloured_room(),
            production(10.0, none.clone()),
        ),
        (
            "two rooms with a door",
            scenes::two_rooms_with_a_door(),
            production(10.0, none),
        ),
    ] {
        let settings = Settings {
            quality,
            ..settings
        };
        let written = Written::new(&glb, &settings);
        let c = written.compare(&written.lumels, Effort::new(2_000, 3));
        let table = c.to_string();
        let head: Vec<&str> = table.lines().take(24).collect();
        println!(
            "== {name}, {quality:?}\n{}\n{:#?}",
            head.join("\n"),
            c.objections(BIAS)
        );
    }
}
