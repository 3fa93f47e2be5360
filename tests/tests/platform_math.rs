//! What a bake writes depends on no function whose last digits differ between platforms.

use std::fs;
use std::path::Path;

/// Methods of floats that the standard library takes from the platform's C library.
const PLATFORM: [&str; 20] = [
    "sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2", "exp", "exp2", "exp_m1", "ln",
    "ln_1p", "log2", "log10", "powf", "cbrt", "hypot", "sinh", "tanh",
];

/// Experiments, and files of pictures, pages and messages, which nobody compares byte by byte.
const FREE: [&str; 10] = [
    "method-lab/",
    "atlas-bake/src/preview/",
    "atlas-bake/src/uv_picture.rs",
    "atlas-bake/src/compare.rs",
    "lumel/src/report_page/",
    "lumel/src/estimate.rs",
    "lumel/src/units.rs",
    "radiosity/src/fixtures.rs",
    "/tests.rs",
    "/tests/",
];

fn rust_files(folder: &Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn light_uses_no_function_of_the_platform() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut files = Vec::new();
    for entry in fs::read_dir(&crates).expect("a folder") {
        rust_files(&entry.expect("an entry").path().join("src"), &mut files);
    }
    let mut wrong = Vec::new();
    for path in files {
        let name = path.to_string_lossy().replace('\\', "/");
        if FREE.iter().any(|free| name.contains(free)) {
            continue;
        }
        let text = fs::read_to_string(&path).expect("a source file");
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for (n, line) in code.lines().enumerate() {
            let line = line.split("//").next().unwrap_or_default();
            if PLATFORM.iter().any(|f| line.contains(&format!(".{f}("))) {
                wrong.push(format!("{name}:{}: {}", n + 1, line.trim()));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "use the crate libm:\n{}",
        wrong.join("\n")
    );
}
