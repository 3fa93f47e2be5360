use std::path::Path;

use atlas_bake::{ExrOptions, Page, write_lightmap_exr};
use tempfile::TempDir;

use super::*;

/// A folder with a bake of one page of 2 × 1 texels and a group, next to a file that must stay
/// unreachable.
fn folder() -> (TempDir, Answers) {
    let t = tempfile::tempdir().unwrap();
    let dir = t.path().join("out");
    std::fs::create_dir(&dir).unwrap();
    let page = |x: f32| Page {
        width: 2,
        height: 1,
        value: vec![[x, 0.0, 0.0], [0.0, x, 0.0]],
        coverage: vec![1.0; 2],
        layers: vec![("error.Y".into(), vec![0.5; 2])],
    };
    let exr = |x| {
        write_lightmap_exr(&page(x), &ExrOptions::default())
            .unwrap()
            .0
    };
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.join(name), bytes).unwrap();
    let manifest = json!({
        "version": 1, "scene": "a b.glb", "value": "radiance", "pages": [{"uri": "a b.exr", "width": 2, "height": 1}],
        "channels": ["error.Y"], "groups": [{"name": "l", "pages": ["l.exr"]}, {"name": "out", "pages": ["../secret"]}],
    });
    write("a b.lightmap.json", manifest.to_string().as_bytes());
    write("a b.report.json", b"{\"scene\": \"a\"}");
    write("a b.glb", b"0123456789");
    write("a b.exr", &exr(1.0));
    write("l.exr", &exr(0.25));
    std::fs::write(t.path().join("secret"), "secret").unwrap();
    let folder = BakeFolder::open(&dir).unwrap();
    let planes = Planes::default();
    let answers = Answers {
        folder,
        planes,
        status: Mutex::default(),
    };
    (t, answers)
}

fn ask(target: &str) -> Ask<'_> {
    Ask {
        method: "GET",
        target,
        host: Some("127.0.0.1:1234"),
        ..Ask::default()
    }
}

fn read(reply: Reply) -> (u16, Vec<u8>) {
    let (mut reader, length) = reply.body.open();
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes).unwrap();
    assert_eq!(bytes.len() as u64, length);
    (reply.status, bytes)
}

fn header<'r>(reply: &'r Reply, name: &str) -> Option<&'r str> {
    let found = reply.headers.iter().find(|h| h.0 == name);
    found.map(|h| h.1.as_str())
}

fn get(answers: &Answers, target: &str) -> (u16, Vec<u8>) {
    read(answers.answer(&ask(target)))
}

#[test]
fn own_files_come_packed_or_plain_and_nothing_else_does() {
    let (_t, a) = folder();
    let packed = a.answer(&Ask {
        gzip: true,
        ..ask("/")
    });
    assert_eq!(header(&packed, "Content-Encoding"), Some("gzip"));
    let (status, page) = get(&a, "/");
    assert_eq!(status, 200);
    assert_eq!(plain(&read(packed).1), page);
    assert_eq!(get(&a, "/static/viewer.js").0, 200);
    for none in [
        "/static/",
        "/static/../Cargo.toml",
        "/static/none.js",
        "/index.html",
        "/api",
        "",
        "*",
        "//",
    ] {
        assert_eq!(get(&a, none).0, 404, "{none}");
    }
}

#[test]
fn nothing_outside_of_the_folder_is_served() {
    let (t, a) = folder();
    assert_eq!(get(&a, "/files/a%20b.glb"), (200, b"0123456789".to_vec()));
    let absolute = Path::new("/files/").join(t.path().join("secret").to_str().unwrap());
    for path in [
        "/files/../secret",
        "/files/..%2fsecret",
        "/files/%2e%2e/secret",
        "/files/%2e%2e%2fsecret",
        "/files/..\\secret",
        "/files/..%5csecret",
        "/files/out/../../secret",
        "/files/a%20b.glb%00",
        "/files/",
        "/files/%ff",
        "/secret",
        "/../secret",
        absolute.to_str().unwrap(),
    ] {
        let (status, body) = get(&a, path);
        assert_eq!(status, 404, "{path}");
        assert!(!body.starts_with(b"secret"), "{path}");
    }
    // A manifest may come from an untrusted source.
    let (status, body) = get(&a, "/api/plane?bake=a%20b&page=0&group=out");
    assert_eq!(status, 500, "{}", String::from_utf8_lossy(&body));
    assert!(!body.starts_with(b"secret"));
}

#[test]
fn other_names_for_this_machine_and_other_methods_are_refused() {
    let (_t, a) = folder();
    for host in [
        "127.0.0.1",
        "127.0.0.1:80",
        "localhost:9",
        "LocalHost",
        "[::1]:7",
    ] {
        assert_eq!(
            a.answer(&Ask {
                host: Some(host),
                ..ask("/")
            })
            .status,
            200,
            "{host}"
        );
    }
    for host in [
        "evil.example",
        "evil.example:1234",
        "127.0.0.1.evil.example",
        "localhost.evil.example:80",
        "",
        ":80",
        "10.0.0.1",
    ] {
        assert_eq!(
            a.answer(&Ask {
                host: Some(host),
                ..ask("/")
            })
            .status,
            403,
            "{host}"
        );
    }
    assert_eq!(
        a.answer(&Ask {
            host: None,
            ..ask("/")
        })
        .status,
        403
    );
    let post = a.answer(&Ask {
        method: "POST",
        ..ask("/api/bakes")
    });
    assert_eq!(
        (post.status, header(&post, "Allow")),
        (405, Some("GET, HEAD"))
    );
    assert_eq!(
        a.answer(&Ask {
            method: "HEAD",
            ..ask("/")
        })
        .status,
        200
    );
}

#[test]
fn parts_of_files() {
    let (_t, a) = folder();
    let part = |range: &str| {
        let reply = a.answer(&Ask {
            range: Some(range),
            ..ask("/files/a%20b.glb")
        });
        let place = header(&reply, "Content-Range").map(str::to_owned);
        let (status, bytes) = read(reply);
        (status, place, String::from_utf8(bytes).unwrap())
    };
    let some = |s: &str| Some(s.to_owned());
    assert_eq!(part("bytes=2-4"), (206, some("bytes 2-4/10"), "234".into()));
    assert_eq!(part("bytes=7-"), (206, some("bytes 7-9/10"), "789".into()));
    assert_eq!(part("bytes=-3"), (206, some("bytes 7-9/10"), "789".into()));
    assert_eq!(
        part("bytes=-30"),
        (206, some("bytes 0-9/10"), "0123456789".into())
    );
    assert_eq!(
        part("bytes=5-99"),
        (206, some("bytes 5-9/10"), "56789".into())
    );
    for beyond in ["bytes=10-", "bytes=-0"] {
        let (status, place, _) = part(beyond);
        assert_eq!((status, place), (416, some("bytes */10")), "{beyond}");
    }
    for ignored in [
        "bytes=4-2",
        "bytes=0-1,3-4",
        "lines=1-2",
        "bytes=x-",
        "bytes",
        "",
    ] {
        assert_eq!(part(ignored), (200, None, "0123456789".into()), "{ignored}");
    }
}

#[test]
fn planes_are_halves_with_their_size() {
    let (_t, a) = folder();
    let reply = a.answer(&ask("/api/plane?bake=a%20b&page=0"));
    assert_eq!(
        (header(&reply, "X-Width"), header(&reply, "X-Height")),
        (Some("2"), Some("1"))
    );
    // 1.0 is 0x3C00.
    let (one, zero) = ([0x00, 0x3C], [0, 0]);
    assert_eq!(
        read(reply),
        (200, [one, zero, zero, one, zero, one, zero, one].concat())
    );
    let (status, group) = get(&a, "/api/plane?bake=a+b&page=0&group=l");
    assert_eq!((status, &group[..2]), (200, &[0x00, 0x34][..]));
    let (status, error) = get(&a, "/api/plane?page=0&layer=error&bake=a%20b");
    assert_eq!((status, &error[..2]), (200, &[0x00, 0x38][..]));
    for none in [
        "bake=b&page=0",
        "page=0",
        "bake=a%20b",
        "bake=a%20b&page=1",
        "bake=a%20b&page=-1",
        "bake=a%20b&page=0&group=x",
        "bake=a%20b&page=0&layer=direct",
    ] {
        assert_eq!(get(&a, &format!("/api/plane?{none}")).0, 404, "{none}");
    }
}

#[test]
fn bakes_are_listed_and_a_stamp_says_that_one_changed() {
    let (t, a) = folder();
    let list = || serde_json::from_slice::<Value>(&get(&a, "/api/bakes").1).unwrap();
    let before = list();
    assert_eq!(before["bakes"][0]["name"], "a b");
    assert_eq!(list(), before);
    let file = File::options()
        .write(true)
        .open(t.path().join("out/l.exr"))
        .unwrap();
    file.set_modified(std::time::SystemTime::now() + std::time::Duration::from_secs(5))
        .unwrap();
    assert_ne!(list()["bakes"][0]["stamp"], before["bakes"][0]["stamp"]);
    assert_eq!(
        get(&a, "/api/report?bake=a%20b"),
        (200, b"{\"scene\":\"a\"}".to_vec())
    );
    assert_eq!(get(&a, "/api/manifest?bake=a%20b").0, 200);
    assert_eq!(get(&a, "/api/report?bake=..%2fa").0, 404);
}
