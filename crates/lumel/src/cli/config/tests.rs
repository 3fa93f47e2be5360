use super::*;

fn layered(text: &str) -> Layered {
    let mut out = Layered::default();
    let options = parse(text).unwrap_or_else(|e| panic!("{e}"));
    options.apply(Path::new("folder"), &mut out);
    out
}

/// The template with its examples enabled: lines that begin with `#` and a key or a table.
fn switched_on() -> String {
    let key = |l: &str| l.starts_with(|c: char| c.is_ascii_lowercase() || c == '[' || c == '"');
    let lines = TEMPLATE.lines().filter_map(|l| l.strip_prefix('#'));
    lines.filter(|l| key(l)).map(|l| format!("{l}\n")).collect()
}

#[test]
fn the_template_is_valid_and_names_every_key() {
    assert!(layered(TEMPLATE).provenance.origins.is_empty());
    let text = switched_on();
    parse(&text).unwrap_or_else(|e| panic!("{e}"));
    let known = parse("no-such-key-at-all = 1").expect_err("it is no key");
    let (_, known) = known
        .split_once("expected one of ")
        .expect("all are listed");
    for key in known.split(", ") {
        let is = |l: &str| l.starts_with(&format!("{key} =")) || l.contains(&format!("[{key}]"));
        assert!(text.lines().any(is), "{key} is not in the template");
    }
}

/// Checks the lines without "e.g.".
#[test]
fn the_templates_defaults_are_the_defaults() {
    let text = switched_on();
    let defaults: String = (text.lines())
        .take_while(|l| !l.starts_with('['))
        .filter(|l| !l.contains("e.g.") && !l.starts_with("scene"))
        .map(|l| format!("{l}\n"))
        .collect();
    assert!(defaults.lines().count() > 10, "{defaults}");
    assert_eq!(layered(&defaults).settings, Settings::default());
}

#[test]
fn every_form_of_a_value_is_read() {
    let out = layered(
        "sky = 'a.hdr'\nprobes = 'p.json'\nexclude-light = ['c']\nlayers = ['ao', 'direct', 'ao']\nstitch = false\nvertex-colors = false\n\
         [[light]]\nname = 'z'\nfactor = 2\n[[light]]\nname = 'a'\nfactor = 0.5\n[[group]]\nname = 'z'\nsources = ['x']\n[[group]]\nname = 'a'\nsources = ['y', 'w']\n[[sun]]\ndirection = [0, -1, 0]\nlux = 5\n",
    );
    let s = &out.settings;
    assert_eq!(s.sky, SkySource::File("folder/a.hdr".into()));
    assert_eq!(s.probes, Some(ProbeSource::File("folder/p.json".into())));
    let lights: Vec<_> = s
        .lights
        .iter()
        .map(|l| (l.name.as_str(), l.factor))
        .collect();
    assert_eq!(lights, [("z", 2.0), ("a", 0.5), ("c", 0.0)]);
    let groups: Vec<&str> = s.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(groups, ["z", "a"]);
    assert_eq!(s.suns[0].direction, [0.0, -1.0, 0.0]);
    assert_eq!(
        (s.layers.len(), s.stitch, s.vertex_colors),
        (2, false, false)
    );
    for (text, sky) in [
        ("sky = 2", SkySource::Color([2.0; 3])),
        ("sky = [1, 2.5, 3]", SkySource::Color([1.0, 2.5, 3.0])),
        ("sky = '#ff0000'", SkySource::Color([1.0, 0.0, 0.0])),
    ] {
        assert_eq!(layered(text).settings.sky, sky);
    }
    assert_eq!(
        layered("probes = 3").settings.probes,
        Some(ProbeSource::Spacing(3.0))
    );
}

#[test]
fn errors_say_where_what_and_what_was_expected() {
    for (text, words) in [
        (
            "quality = 'draft'\nqualty = 1\n",
            &[":2:1: ", "`qualty`", "`quality`"][..],
        ),
        ("a = 1", &[":1:1: ", "`a`", "quality", "texels-per-unit"]),
        (
            "\n\nquality = 'best'",
            &[
                ":3:11: ",
                "best",
                "\"draft\", \"quick\", \"preview\", \"production\"",
            ],
        ),
        ("quality = 3", &[":1:11: ", "3", "\"draft\""]),
        (
            "texels-per-unit = 'many'",
            &[":1:19: ", "many", "a number above 0"],
        ),
        (
            "texels-per-unit = -1",
            &[":1:19: ", "-1", "a number above 0"],
        ),
        ("error = nan", &[":1:9: ", "NaN", "above 0"]),
        ("max-page = -4", &[":1:12: ", "-4"]),
        ("max-page = 1.5", &[":1:12: ", "1.5"]),
        ("sky = [1, 2]", &[":1:7: ", "[1.0, 2.0]", "three numbers"]),
        ("sky = true", &[":1:7: ", "true", "[R, G, B]"]),
        ("probes = 0", &[":1:10: ", "0", "a spacing above 0"]),
        ("[[sun]]\ndirection = [0, 1]\nlux = 1", &[":2:13: ", "3"]),
        ("[[sun]]\ndirection = [0, 1, 0]", &["lux"]),
        (
            "[[sun]]\ndirection = [0, 1, 0]\nlux = 1\nangle = 1",
            &[":4:1: ", "angle", "degrees"],
        ),
        (
            "[[light]]\nname = 'a'\nfactor = -1",
            &[":3:10: ", "-1", "at least 0"],
        ),
        (
            "[[light]]\nname = 'a'\nfactor = 'x'",
            &[":3:10: ", "x", "at least 0"],
        ),
        ("[[group]]\nname = 'a'\nsources = 'x'", &[":3:11: ", "x"]),
        ("[light]\nlamp = 1", &[":1:1: "]),
        ("stitch = 'no'", &[":1:10: ", "no"]),
        (
            "quality = 'draft'\nquality = 'draft'",
            &[":2:", "duplicate"],
        ),
        ("quality = \"draft", &[":1:"]),
        ("größe = 'ü' \u{7}", &[":1:"]),
        ("= 1", &[":1:1: "]),
    ] {
        let e = parse(text).expect_err(text);
        for word in words {
            assert!(e.contains(word), "{text}: {word} is not in: {e}");
        }
        assert!(!e.contains('\n'), "{e}");
    }
}
