//! PlayCanvas in Chromium, with its npm package.

use super::{has_bc6h, installed, look, power, squares};
use crate::common::browser::Browser;
use crate::common::site::Site;

#[test]
fn playcanvas_shows_closed_form_pixels() {
    let test = "PlayCanvas";
    if !installed(test, &["playcanvas"]) {
        return;
    }
    let Some(mut b) = Browser::start(test, [640, 480]) else {
        return;
    };
    let storage = power(1.0 / 512.0);
    for options in ["--ktx2 rgb9e5", "--ktx2 bc6h --block-charts"] {
        let (_t, out) = squares(options);
        let site = Site::start(&out);
        if options.contains("bc6h") && !has_bc6h(&mut b, &site, test) {
            break;
        }
        look(&mut b, &site, "/playcanvas/index.html", "", &storage);
    }
    assert_eq!(b.errors, [""; 0]);
}
