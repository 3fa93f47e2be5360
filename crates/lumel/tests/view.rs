//! The commands `lumel view` and `lumel report`: output, served files and failures.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::Stdio;

use crate::common::{asset, bake, command, files, lumel, names, outputs, temp};

/// Sends a handwritten request; returns status line and headers, and body.
fn request(address: &str, text: &str) -> (String, Vec<u8>) {
    let mut stream = TcpStream::connect(address).expect("the server listens");
    stream.write_all(text.as_bytes()).expect("it reads");
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).expect("it answers");
    let end = bytes
        .windows(4)
        .position(|w| w == b"\r\n\r\n")
        .expect("headers end")
        + 4;
    let body = bytes.split_off(end);
    (String::from_utf8(bytes).expect("headers are text"), body)
}

#[test]
fn view_prints_its_address_and_serves_the_bake() {
    let t = temp();
    bake(&asset("cornell_box.glb"), t.path(), "").ok();
    let mut child = command()
        .arg("view")
        .arg(t.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary starts");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("a pipe"))
        .read_line(&mut line)
        .expect("a line");
    let address = (line
        .trim()
        .strip_prefix("http://")
        .and_then(|l| l.strip_suffix('/')))
    .expect("an address")
    .to_owned();
    assert!(address.starts_with("127.0.0.1:"), "{address}");
    let get = |path: &str, host: &str, more: &str| {
        request(
            &address,
            &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{more}\r\n"),
        )
    };
    let (head, page) = get("/", &address, "");
    assert!(
        head.starts_with("HTTP/1.1 200")
            && head.contains("Content-Security-Policy: default-src 'none'"),
        "{head}"
    );
    assert!(page.starts_with(b"<!doctype html>"));
    let (head, part) = get("/files/cornell_box.glb", &address, "Range: bytes=0-3\r\n");
    assert!(head.starts_with("HTTP/1.1 206"), "{head}");
    assert_eq!(part, b"glTF");
    let (head, _) = get("/files/../../etc/passwd", &address, "");
    assert!(head.starts_with("HTTP/1.1 404"), "{head}");
    let (head, _) = get("/", "evil.example", "");
    assert!(head.starts_with("HTTP/1.1 403"), "{head}");
    let (head, body) = request(
        &address,
        &format!("HEAD / HTTP/1.1\r\nHost: {address}\r\n\r\n"),
    );
    let length = head
        .lines()
        .find_map(|l| l.strip_prefix("Content-Length: "));
    assert_eq!(length, Some(page.len().to_string().as_str()), "{head}");
    assert!(
        head.contains("\r\nConnection: close\r\n") && body.is_empty(),
        "{head}"
    );
    // An unread request body must not cost the answer.
    let text = format!("POST / HTTP/1.1\r\nHost: {address}\r\nContent-Length: 65536\r\n\r\n");
    let (head, _) = request(&address, &(text + &"x".repeat(65536)));
    assert!(
        head.starts_with("HTTP/1.1 405") && head.contains("Allow: GET, HEAD"),
        "{head}"
    );
    for (text, status) in [
        ("nonsense\r\n\r\n".to_owned(), 400),
        (
            format!("GET / HTTP/1.1\r\nA: {}\r\n\r\n", "x".repeat(17 << 10)),
            431,
        ),
    ] {
        let (head, _) = request(&address, &text);
        assert!(head.starts_with(&format!("HTTP/1.1 {status} ")), "{head}");
    }
    // Idle connections, which browsers open in advance, and half-finished requests must not block
    // others.
    let mut idle: Vec<TcpStream> = (0..100)
        .map(|_| TcpStream::connect(&address).expect("the server listens"))
        .collect();
    for stream in &mut idle[..50] {
        stream.write_all(b"GET / HTTP/1.1\r\nHo").expect("it reads");
    }
    let start = std::time::Instant::now();
    for _ in 0..20 {
        assert!(get("/", &address, "").0.starts_with("HTTP/1.1 200"));
    }
    // Idle connections end after 20 s; waiting for one would take that long.
    let took = start.elapsed();
    assert!(took < std::time::Duration::from_secs(10), "{took:?}");
    drop(idle);
    child.kill().expect("it can be ended");
    child.wait().expect("it ends");
    assert_eq!(
        names(t.path()),
        outputs("cornell_box"),
        "nothing is written"
    );
}

#[test]
fn folders_without_a_bake_are_one_clear_error() {
    let t = temp();
    let dir = t.path().as_os_str();
    for verb in ["view", "report"] {
        lumel([verb.as_ref(), dir]).fails(3, &["no bake", "lumel bake"]);
        lumel([verb.as_ref(), t.path().join("none").as_os_str()]).fails(2, &["none"]);
    }
    std::fs::write(t.path().join("a.lightmap.json"), "{\"version\": 7}").expect("write");
    lumel(["report".as_ref(), dir])
        .fails(3, &["a.lightmap.json", "version 7", "expected at most 1"]);
    assert_eq!(names(t.path()), ["a.lightmap.json"]);
}

#[test]
fn a_port_that_is_taken_is_an_error() {
    let t = temp();
    bake(&asset("furnace_cube_50.glb"), t.path(), "").ok();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("it has one").port().to_string();
    lumel([
        "view".as_ref(),
        t.path().as_os_str(),
        "--port".as_ref(),
        port.as_ref(),
    ])
    .fails(2, &[&port]);
}

#[test]
fn report_writes_the_same_page_every_time() {
    let t = temp();
    let out = t.path().join("out");
    bake(&asset("cornell_box.glb"), &out, "--layers error,coverage").ok();
    let dir = out.as_os_str();
    lumel(["report".as_ref(), dir]).ok();
    let page = files(&out)["cornell_box.report.html"].clone();
    let text = String::from_utf8(page).expect("UTF-8");
    for words in [
        "<polyline",
        "data:image/png;base64,",
        "Area by lumels per metre",
        "Lumels by estimated relative error",
    ] {
        assert!(text.contains(words), "{words}");
    }
    assert!(!text.contains("<script"));
    let again = lumel(["report".as_ref(), dir, "-o".as_ref(), "-".as_ref()]).ok();
    assert!(again.stdout == text);
    let other = t.path().join("page.html");
    lumel(["report".as_ref(), dir, "-o".as_ref(), other.as_os_str()]).ok();
    assert_eq!(std::fs::read_to_string(other).expect("written"), text);
}
