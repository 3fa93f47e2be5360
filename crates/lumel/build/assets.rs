//! Compresses the files that `lumel view` serves and lists them for `src/view/assets.rs`.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use flate2::{Compression, write::GzEncoder};

/// Names under `/static/` and their files. The names are flat, whatever folders the files are in.
const FILES: &[(&str, &str)] = &[
    ("index.html", "web/index.html"),
    ("style.css", "web/style.css"),
    ("viewer.js", "web/viewer.js"),
    ("bake.js", "web/bake.js"),
    ("stage.js", "web/stage.js"),
    ("shading.js", "web/shading.js"),
    ("light.js", "web/light.js"),
    ("controls.js", "web/controls.js"),
    ("panel.js", "web/panel.js"),
    ("pick.js", "web/pick.js"),
    // A copy of the loader in tools/engines/three: a published crate contains only its own folder.
    ("lumel-lightmap.js", "web/lumel-lightmap.js"),
    ("three.core.js", "vendor/three/build/three.core.js"),
    ("three.module.js", "vendor/three/build/three.module.js"),
    ("GLTFLoader.js", "vendor/three/addons/loaders/GLTFLoader.js"),
    (
        "OrbitControls.js",
        "vendor/three/addons/controls/OrbitControls.js",
    ),
    (
        "BufferGeometryUtils.js",
        "vendor/three/addons/utils/BufferGeometryUtils.js",
    ),
    (
        "SkeletonUtils.js",
        "vendor/three/addons/utils/SkeletonUtils.js",
    ),
    ("THREE-LICENSE.txt", "vendor/three/LICENSE"),
];

/// npm module names and the paths that replace them in a browser without an import map. An import
/// map would have to be an inline script, which the page's content security policy forbids.
const IMPORTS: &[(&str, &str)] = &[
    ("from 'three'", "from './three.module.js'"),
    ("from '../utils/", "from './"),
    ("from 'three/addons/loaders/", "from './"),
    ("from 'three/addons/controls/", "from './"),
];

pub(crate) fn write() {
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets it"));
    let mut table = String::from("&[\n");
    for (name, file) in FILES {
        let path = root.join(file);
        println!("cargo::rerun-if-changed={}", path.display());
        let mut text =
            fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        if name.ends_with(".js") {
            for (from, to) in IMPORTS {
                text = text.replace(from, to);
            }
        }
        let packed = out.join(format!("{name}.gz"));
        compress(text.as_bytes(), &packed);
        let _ = writeln!(
            table,
            "    ({name:?}, include_bytes!({:?})),",
            packed.display().to_string()
        );
    }
    table.push_str("]\n");
    fs::write(out.join("assets.rs"), table).expect("OUT_DIR can be written");
}

/// The encoder's default header has no time and no name, so equal files give equal bytes.
fn compress(bytes: &[u8], to: &Path) {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).expect("memory takes all");
    let packed = encoder.finish().expect("memory takes all");
    fs::write(to, packed).expect("OUT_DIR can be written");
}
