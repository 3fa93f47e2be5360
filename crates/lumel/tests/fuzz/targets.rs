//! Targets of damaged inputs, and the invariants to check.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use lumel::atlas::{KeptCharts, Layout, LayoutOptions, layout_kept};
use lumel::atlas_bake::{parse_points, read_exr};
use lumel::mesh_ingest::{Limits, LoadOptions, Loaded, MemoryDocument, Soup, load_memory};
use lumel::report_page;
use lumel::{
    Bake, BakeFolder, BakeMode, Baker, Directional, Error, GltfExt, Ktx2Format, Layer, NotPhysical,
    PngFormat, Quality, UvMode,
};

use super::compressed;
use super::seeds::{self, Level};
use crate::common;

/// Texels that were baked, 0 where nothing is; or the exit code of the only error.
pub type Outcome = Result<usize, i32>;

/// A folder for the targets' files.
pub struct Place(pub PathBuf);

impl Place {
    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.join(name);
        fs::write(&path, bytes).expect("a folder of our own");
        path
    }
}

/// Limits that a few kilobytes of input can reach.
fn options() -> LoadOptions {
    LoadOptions {
        limits: Limits {
            unbacked_bytes: 1 << 22,
            decoded_bytes: 1 << 22,
            geometry_bytes: 1 << 24,
            triangles: 1 << 14,
            instances: 1 << 10,
            image_bytes: 1 << 22,
            ..Limits::default()
        },
        ..LoadOptions::default()
    }
}

/// Reads a document and checks the guarantees of [`lumel::mesh_ingest::Scene`].
pub fn load(_: &Place, glb: &[u8]) -> Outcome {
    let document = MemoryDocument::new("level.glb", glb);
    let loaded =
        load_memory(&document, &options()).map_err(|e| told(&e.to_string(), e.exit_code()))?;
    sound(&loaded);
    Ok(0)
}

/// Checks an error: a few short lines and a documented exit code.
fn told(message: &str, code: i32) -> i32 {
    assert!(
        !message.is_empty() && message.len() < 40_000,
        "{} bytes",
        message.len()
    );
    assert!((1..=5).contains(&code), "exit code {code}: {message}");
    code
}

fn fails(e: &Error) -> i32 {
    told(&e.to_string(), e.exit_code())
}

fn sound(loaded: &Loaded) {
    let scene = &loaded.scene;
    for p in scene.meshes.iter().flat_map(|m| &m.primitives) {
        let vertices = p.positions.len();
        assert!(
            p.triangles
                .iter()
                .flatten()
                .all(|&i| (i as usize) < vertices)
        );
        assert!(p.positions.iter().all(|x| x.is_finite()));
        assert!(p.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
        assert!(p.material < scene.materials.len());
    }
    let soup = Soup::build(scene);
    assert!(soup.areas.iter().all(|a| *a > 0.0 && a.is_finite()));
    for t in 0..soup.len() as u32 {
        let color = scene.base_color(&soup, t, 0.3, 0.3);
        assert!(
            color.min_element() >= 0.0 && color.max_element() <= 1.0,
            "{color}"
        );
        assert!(scene.emission(&soup, t, 0.3, 0.3).min_element() >= 0.0);
    }
}

/// As [`load`], for an image.
pub fn picture(place: &Place, bytes: &[u8]) -> Outcome {
    load(place, &seeds::with_files(bytes, &seeds::ies()).glb())
}

/// As [`load`], for an IES profile.
pub fn ies(place: &Place, bytes: &[u8]) -> Outcome {
    let picture = seeds::picture(image::ImageFormat::Png);
    load(place, &seeds::with_files(&picture, bytes).glb())
}

/// Charts in a cache, for a grid with as many triangles as are cached.
pub struct Kept {
    loaded: Loaded,
    soup: Soup,
    /// The charts as they are stored.
    pub whole: Vec<u8>,
    /// What comes of them.
    layout: Layout,
}

/// A cache of one mesh.
struct Shelf<'s> {
    stored: &'s [u8],
    saved: Mutex<Vec<u8>>,
    used: AtomicBool,
}

impl KeptCharts for Shelf<'_> {
    fn load(&self, _: &[u8; 32]) -> Option<Vec<u8>> {
        Some(self.stored.to_vec())
    }

    fn used(&self) {
        self.used.store(true, Ordering::Relaxed);
    }

    fn save(&self, _: &[u8; 32], bytes: &[u8]) {
        *self.saved.lock().expect("nobody panicked") = bytes.to_vec();
    }
}

impl Kept {
    /// Length of format and hash.
    pub const HEAD: usize = 14 + 32;

    pub fn new() -> Kept {
        let glb = compressed::flat_grid().glb();
        let document = MemoryDocument::new("grid.glb", glb);
        let loaded = load_memory(&document, &LoadOptions::default()).expect("sound");
        let soup = Soup::build(&loaded.scene);
        let (layout, whole, _) = plan(&loaded, &soup, &[]).expect("a sound grid");
        Kept {
            loaded,
            soup,
            whole,
            layout,
        }
    }

    /// `body` with a right hash.
    pub fn sealed(whole: &[u8], body: &[u8]) -> Vec<u8> {
        let hash = blake3::hash(body);
        [&whole[..Self::HEAD - 32], hash.as_bytes(), body].concat()
    }

    /// Lays the grid out with damaged charts: they are taken, or made anew and stored.
    pub fn layout(&self, bytes: &[u8]) -> Outcome {
        let (layout, saved, used) =
            plan(&self.loaded, &self.soup, bytes).map_err(|e| told(&e, 3))?;
        for mesh in &layout.meshes {
            let uvs = mesh.primitives.iter().flat_map(|p| &p.uv);
            assert!(uvs.clone().all(|uv| uv.is_finite()));
        }
        if used {
            return Ok(0);
        }
        assert!(saved == self.whole && layout.pages == self.layout.pages);
        Err(3)
    }
}

/// A layout with these stored charts, what it stored, and whether it took them.
fn plan(loaded: &Loaded, soup: &Soup, stored: &[u8]) -> Result<(Layout, Vec<u8>, bool), String> {
    let shelf = Shelf {
        stored,
        saved: Mutex::new(Vec::new()),
        used: AtomicBool::new(false),
    };
    let options = LayoutOptions {
        texels_per_unit: Some(2.0),
        ..LayoutOptions::default()
    };
    let go = |_| true;
    let (layout, _) =
        layout_kept(&loaded.scene, soup, &options, Some(&shelf), &go).map_err(|e| e.to_string())?;
    let saved = shelf.saved.into_inner().expect("nobody panicked");
    Ok((layout, saved, shelf.used.into_inner()))
}

pub fn exr(place: &Place, bytes: &[u8]) -> Outcome {
    let image = read_exr(&place.write("a.exr", bytes)).map_err(|e| told(&e.to_string(), 3))?;
    let n = image.width as usize * image.height as usize;
    assert!(image.channels.iter().all(|(_, values)| values.len() == n));
    Ok(0)
}

pub fn points(_: &Place, bytes: &[u8]) -> Outcome {
    let points = parse_points(bytes).map_err(|e| told(&e.to_string(), 3))?;
    assert!(points.iter().all(|p| p.is_finite()));
    Ok(0)
}

/// The cheapest baker: with the preset's patches, a bake takes ten times as long.
fn baker<'a>() -> Baker<'a> {
    let baker = Baker::new().quality(Quality::Draft).texels_per_unit(1.5);
    let baker = baker.patches(200);
    baker.threads(1).memory(256 << 20).max_image(1 << 22)
}

/// A sky for a level with few triangles.
pub fn hdr(place: &Place, bytes: &[u8]) -> Outcome {
    let sky = place.write("a.hdr", bytes);
    let level = MemoryDocument::new("level.glb", bare().glb());
    let baker = baker().sky_file(sky).vertex_colors(false);
    checked(&baker.bake(&level).map_err(|e| fails(&e))?)
}

/// A single square.
fn bare() -> Level {
    let mut level = seeds::level();
    level.json["scenes"][0]["nodes"] = serde_json::json!([0]);
    level
}

/// One of a few sets of options, those of plain bakes for half of the `choice`s.
fn with_options(baker: Baker<'_>, choice: u8) -> Baker<'_> {
    let knobs = NotPhysical {
        indirect_boost: 2.0,
        ao_multiply: 0.5,
        ..NotPhysical::default()
    };
    match choice % 16 {
        0 => baker.mode(BakeMode::Indirect),
        1 => baker.mode(BakeMode::Shadowmask).ktx2(Ktx2Format::Rgb9e5),
        2 => baker.page_by("*").group("lamps", ["lamp*", "panel"]),
        3 => baker
            .directional(Directional::Sh1)
            .layers([Layer::Direct, Layer::Ao]),
        4 => baker.vertex_error(0.01),
        5 => baker.cull_unseen(true).walkable("*floor*").uv(UvMode::Keep),
        6 => baker.probe_spacing(0.7).probe_volume(true),
        7 => baker
            .ktx2(Ktx2Format::Bc6h)
            .png(PngFormat::Rgbm)
            .ext([GltfExt::Moz])
            .not_physical(knobs),
        _ => baker,
    }
}

/// A whole bake of about a hundred lumels. The folder `LUMEL_FUZZ_BAKED` gets input and output, for
/// `tools/validate.mjs --pairs`.
pub fn bake(_: &Place, glb: &[u8]) -> Outcome {
    let level = MemoryDocument::new("level.glb", glb);
    let baker = with_options(baker().sky([0.5; 3]), blake3::hash(glb).as_bytes()[0]);
    let bake = baker.bake(&level).map_err(|e| fails(&e))?;
    if let Some(folder) = std::env::var_os("LUMEL_FUZZ_BAKED") {
        let folder = Path::new(&folder).join(&*blake3::hash(glb).to_hex());
        bake.write(folder.join("out")).expect("a writable folder");
        fs::write(folder.join("in.glb"), glb).expect("a writable folder");
    }
    checked(&bake)
}

/// Checks that light is finite and not negative, that energy balances or the report says otherwise,
/// and that the output can be read back.
fn checked(bake: &Bake) -> Outcome {
    let mut texels = 0;
    for page in bake.pages() {
        texels += page.value.len();
        let values = page.value.iter().flatten();
        assert!(values.clone().all(|x| x.is_finite() && *x >= 0.0));
    }
    let audit = &bake.report.solve.audit;
    assert!(audit.imbalance.is_finite(), "{audit:?}");
    let warned = bake.report.warnings.iter().any(|w| w.contains("energy"));
    assert!(audit.within_bound || warned, "{audit:?}");
    let (files, _) = bake
        .files()
        .unwrap_or_else(|e| panic!("after the bake: {e}"));
    for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with(".glb")) {
        let written = MemoryDocument::new(name.as_str(), bytes.clone());
        if let Err(e) = load_memory(&written, &LoadOptions::default()) {
            // The missing image may be one that light does not need.
            assert_eq!(e.exit_code(), 2, "{name}: {e}");
        }
    }
    Ok(texels)
}

/// A finished bake of [`bare`] in the place's folder; targets damage one of its files.
pub fn finished(place: &Place) -> Vec<(String, Vec<u8>)> {
    let level = MemoryDocument::new("level.glb", bare().glb());
    let baker = baker().sky([0.5; 3]).layers([Layer::Direct]);
    let bake = baker.bake(&level).expect("it is sound");
    let (files, _) = bake.files().expect("it is sound");
    for (name, bytes) in &files {
        place.write(name, bytes);
    }
    files
}

/// A damaged manifest.
pub fn manifest(place: &Place, bytes: &[u8]) -> Outcome {
    folder(&place.write("level.lightmap.json", bytes))
}

/// A damaged report.
pub fn report(place: &Place, bytes: &[u8]) -> Outcome {
    place.write("level.report.json", bytes);
    folder(&place.0.join("level.lightmap.json"))
}

fn folder(manifest: &Path) -> Outcome {
    let folder = BakeFolder::open(manifest).map_err(|e| fails(&e))?;
    let _ = folder.disagreement("level");
    let page = report_page(&folder, "level").map_err(|e| fails(&e))?;
    // Whatever names contain, the page has no script and no tags from them.
    assert!(!page.contains("<script") && page.ends_with("</html>\n"));
    Ok(0)
}

/// A request to a viewer at `address`, which must answer or close the connection.
pub fn request(address: &str, bytes: &[u8]) -> Outcome {
    let mut stream = TcpStream::connect(address).expect("the server listens");
    let patience = Some(Duration::from_secs(5));
    stream.set_read_timeout(patience).expect("supported");
    // The server may answer and close before everything is sent.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(std::net::Shutdown::Write);
    let mut answer = Vec::new();
    let read = stream.take(1 << 24).read_to_end(&mut answer);
    if read.is_err_and(|e| e.kind() == std::io::ErrorKind::WouldBlock) {
        panic!("no answer and no end");
    }
    let status = answer.get(9..12).and_then(|s| std::str::from_utf8(s).ok());
    match status {
        Some("200" | "206") => Ok(0),
        Some(other) => Err(other.parse().expect("a status")),
        None => Err(0),
    }
}

/// The real binary with a damaged settings file.
pub fn settings(place: &Place, bytes: &[u8]) -> Outcome {
    let file = place.write("a.toml", bytes);
    let scene = place.0.join("bare.glb");
    if !scene.exists() {
        place.write("bare.glb", &bare().glb());
    }
    let arguments = [
        "inspect".as_ref(),
        scene.as_os_str(),
        "--config".as_ref(),
        file.as_os_str(),
    ];
    let run = common::lumel(arguments);
    match run.code {
        Some(0) => Ok(0),
        Some(code) => {
            assert_eq!(
                run.stderr
                    .lines()
                    .filter(|l| l.starts_with("error: "))
                    .count(),
                1
            );
            Err(told(&run.stderr, code))
        }
        None => panic!("{}", run.stderr),
    }
}
