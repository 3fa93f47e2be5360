//! Controls a headless Chromium by its DevTools protocol over pipes: no driver, no Node, no port.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use serde_json::{Value, json};
use tempfile::TempDir;

/// Most time that a test may spend on its browser. A test needs about ten seconds, and more with
/// software rendering on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(45);
/// Most time for one answer after that, so that a page's errors can still be read.
const GRACE: Duration = Duration::from_secs(10);

/// A page in its own browser.
pub struct Browser {
    child: Child,
    input: ChildStdin,
    messages: Receiver<Value>,
    last: u64,
    deadline: Instant,
    session: Option<String>,
    /// Faults of the page: console errors, exceptions, refused or missing files.
    pub errors: Vec<String>,
    _profile: TempDir,
}

/// The browser: `LUMEL_CHROMIUM`, or a usual name on the path.
fn find() -> Option<PathBuf> {
    if let Some(path) = std::env::var_os("LUMEL_CHROMIUM") {
        return Some(path.into());
    }
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = [
        "chromium",
        "chromium-browser",
        "google-chrome",
        "google-chrome-stable",
    ];
    let all = names
        .iter()
        .flat_map(|n| folders.iter().map(move |f| f.join(n)));
    all.into_iter().find(|p| p.is_file())
}

impl Browser {
    /// Starts a browser with a window of this size; prints a message and returns `None` if none is
    /// installed.
    pub fn start(test: &str, [width, height]: [u32; 2]) -> Option<Browser> {
        let Some(program) = find().filter(|_| cfg!(unix)) else {
            eprintln!("SKIPPED {test}: no Chromium on the path (LUMEL_CHROMIUM names one)");
            return None;
        };
        let profile = tempfile::tempdir().expect("a temporary folder");
        // The protocol uses descriptors 3 and 4; a shell redirects our pipes to them.
        let mut child = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 0</dev/null 1>/dev/null"])
            .arg(program)
            .args([
                "--headless=new",
                "--no-sandbox",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--disable-quic",
                "--no-first-run",
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
                "--disable-dev-shm-usage",
                "--hide-scrollbars",
                "--force-device-scale-factor=1",
                "--force-color-profile=srgb",
                "--remote-debugging-pipe",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("--window-size={width},{height}"))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the browser starts");
        let input = child.stdin.take().expect("a pipe");
        let output = child.stdout.take().expect("a pipe");
        let (send, messages) = channel();
        std::thread::spawn(move || {
            let mut reader = BufReader::new(output);
            let mut bytes = Vec::new();
            while reader.read_until(0, &mut bytes).is_ok_and(|n| n > 0) {
                bytes.pop();
                if let Ok(message) = serde_json::from_slice(&bytes)
                    && send.send(message).is_err()
                {
                    break;
                }
                bytes.clear();
            }
        });
        let mut browser = Browser {
            child,
            input,
            messages,
            last: 0,
            deadline: Instant::now() + PATIENCE,
            session: None,
            errors: Vec::new(),
            _profile: profile,
        };
        let target = browser.call("Target.createTarget", json!({"url": "about:blank"}));
        let attached = browser.call(
            "Target.attachToTarget",
            json!({"targetId": target["targetId"], "flatten": true}),
        );
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page.enable", "Runtime.enable", "Log.enable"] {
            browser.call(domain, json!({}));
        }
        browser.resize([width, height]);
        Some(browser)
    }

    /// Sets the size of the page.
    pub fn resize(&mut self, [width, height]: [u32; 2]) {
        self.call(
            "Emulation.setDeviceMetricsOverride",
            json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": false}),
        );
    }

    /// Loads a URL.
    pub fn open(&mut self, url: &str) {
        self.call("Page.navigate", json!({"url": url}));
    }

    /// Evaluates an expression in the page, awaiting a promise.
    #[track_caller]
    pub fn eval(&mut self, expression: &str) -> Value {
        let answer = self.call(
            "Runtime.evaluate",
            json!({"expression": expression, "awaitPromise": true, "returnByValue": true}),
        );
        assert!(
            answer.get("exceptionDetails").is_none(),
            "{expression}: {answer}"
        );
        answer["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    #[track_caller]
    pub fn wait(&mut self, expression: &str) {
        while self.eval(&format!("Boolean({expression})")) != json!(true) {
            let text = self.eval("document.body?.innerText ?? ''");
            assert!(
                Instant::now() < self.deadline,
                "{expression} does not come true: {text}; {:?}",
                self.errors
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// A screenshot of the page.
    pub fn screenshot(&mut self) -> RgbImage {
        let answer = self.call("Page.captureScreenshot", json!({"format": "png"}));
        let png = STANDARD
            .decode(answer["data"].as_str().expect("a picture"))
            .expect("base64");
        image::load_from_memory(&png).expect("PNG").to_rgb8()
    }

    /// Clicks at a point of the page.
    pub fn click(&mut self, x: f64, y: f64) {
        for kind in ["mousePressed", "mouseReleased"] {
            self.call(
                "Input.dispatchMouseEvent",
                json!({"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1}),
            );
        }
    }

    /// Presses (`down`) or releases a key, e.g. `("g", "KeyG")`.
    pub fn key(&mut self, key: &str, code: &str, down: bool) {
        let kind = if down { "keyDown" } else { "keyUp" };
        self.call(
            "Input.dispatchKeyEvent",
            json!({"type": kind, "key": key, "code": code}),
        );
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.last += 1;
        let mut message = json!({"id": self.last, "method": method, "params": params});
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.input.write_all(&bytes).expect("the browser listens");
        loop {
            let answer = self
                .messages
                .recv_timeout((self.deadline + GRACE).saturating_duration_since(Instant::now()))
                .unwrap_or_else(|e| panic!("{method}: {e}"));
            if answer["id"] == self.last {
                assert!(
                    answer.get("error").is_none(),
                    "{method}: {}",
                    answer["error"]
                );
                return answer["result"].clone();
            }
            self.note(&answer);
        }
    }

    /// Records an event that reports a fault.
    fn note(&mut self, event: &Value) {
        let params = &event["params"];
        match event["method"].as_str() {
            Some("Runtime.consoleAPICalled")
                if matches!(
                    params["type"].as_str(),
                    Some("error" | "warning" | "assert")
                ) =>
            {
                self.errors.push(params["args"].to_string());
            }
            Some("Runtime.exceptionThrown") => {
                self.errors.push(params["exceptionDetails"].to_string())
            }
            // The browser's own remarks about drivers are not faults of the page.
            Some("Log.entryAdded") if params["entry"]["level"] == "error" => {
                // The browser requests the favicon of a bare script at any time.
                let url = params["entry"]["url"].as_str().unwrap_or_default();
                if !url.ends_with("/favicon.ico") {
                    self.errors.push(params["entry"].to_string())
                }
            }
            _ => {}
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
