//! Babylon.js in Chromium, with its npm packages.

use super::{installed, look, squares, squares_with_mask, srgb};
use crate::common::browser::Browser;
use crate::common::site::Site;

#[test]
fn babylon_shows_closed_form_pixels() {
    let test = "Babylon.js";
    if !installed(test, &["babylonjs", "babylonjs-loaders", "fflate"]) {
        return;
    }
    let Some(mut b) = Browser::start(test, [640, 480]) else {
        return;
    };
    let (_t, out) = squares("");
    let site = Site::start(&out);
    look(&mut b, &site, "/babylon/index.html", "", &srgb(0.0));
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn babylon_adds_mixed_lamps_through_shadow_masks() {
    let test = "Babylon.js with shadow masks";
    if !installed(test, &["babylonjs", "babylonjs-loaders", "fflate"]) {
        return;
    }
    let Some(mut b) = Browser::start(test, [640, 480]) else {
        return;
    };
    let (_t, out) = squares_with_mask("");
    let site = Site::start(&out);
    // As in three.js.
    look(&mut b, &site, "/babylon/index.html", "", &srgb(1.0 / 128.0));
    assert_eq!(b.errors, [""; 0]);
}
