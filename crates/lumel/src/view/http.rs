//! A minimal threaded HTTP/1.1 server: one request per connection.
//!
//! Browsers open connections in advance and leave them idle. Each connection has its own thread, so
//! idle ones delay nobody. Nothing is kept alive, so a page never queues behind a connection that
//! the browser holds open.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::answer::{Answers, Ask, Reply};

/// Most connections at once. Beyond this, the one that has been idle for longest is closed.
/// Browsers open six per host, and some in advance.
const CONNECTIONS: usize = 64;
/// Most bytes of request line and headers. Browsers send about 1 KiB, or up to 8 KiB with cookies
/// from other servers on this host.
const HEAD: usize = 16 << 10;
/// Most headers of a request; browsers send about twenty.
const HEADERS: usize = 100;
/// How long a connection may take to send its request. Browsers reopen idle connections that are
/// closed.
const PATIENCE: Duration = Duration::from_secs(20);
/// How long a client may stop reading, e.g. while a debugger pauses the browser.
const WRITE_PATIENCE: Duration = Duration::from_secs(60);
/// How long to wait for a client to close its end, and how many bytes to read meanwhile: closing a
/// socket with unread bytes makes the system discard the answer.
const LINGER: (Duration, usize) = (Duration::from_secs(1), 1 << 20);

/// Counts connections and tracks those that have not sent a request yet.
#[derive(Default)]
struct Gate {
    state: Mutex<State>,
    freed: Condvar,
}

#[derive(Default)]
struct State {
    open: usize,
    /// Oldest first.
    silent: VecDeque<(u64, TcpStream)>,
    next: u64,
}

/// A connection's slot, released when dropped.
struct Pass {
    gate: Arc<Gate>,
    number: u64,
}

impl Gate {
    /// Waits for a slot. If all are taken, the connection that has been idle for longest is closed,
    /// so that a client that opens many and sends nothing cannot block others.
    fn enter(self: &Arc<Gate>, stream: &TcpStream) -> Pass {
        let mut state = self.lock();
        if state.open >= CONNECTIONS
            && let Some((_, oldest)) = state.silent.pop_front()
        {
            let _ = oldest.shutdown(Shutdown::Both);
        }
        let mut state = (self.freed)
            .wait_while(state, |s| s.open >= CONNECTIONS)
            .unwrap_or_else(PoisonError::into_inner);
        state.open += 1;
        state.next += 1;
        let number = state.next;
        // Without free descriptors it cannot be closed early and will time out.
        state
            .silent
            .extend(stream.try_clone().ok().map(|s| (number, s)));
        Pass {
            gate: self.clone(),
            number,
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pass {
    /// Records that the connection has sent its request.
    fn asked(&self) {
        self.gate.lock().silent.retain(|(n, _)| *n != self.number);
    }
}

impl Drop for Pass {
    fn drop(&mut self) {
        self.asked();
        self.gate.lock().open -= 1;
        self.gate.freed.notify_one();
    }
}

/// Answers connections until `stopping`, which is checked after each.
pub(super) fn serve(listener: &TcpListener, answers: &Arc<Answers>, stopping: &AtomicBool) {
    let gate = Arc::new(Gate::default());
    loop {
        let accepted = listener.accept();
        if stopping.load(Ordering::SeqCst) {
            return;
        }
        let Ok((stream, _)) = accepted else {
            // Either the client has gone, or the process is out of descriptors and must wait for
            // some to close.
            std::thread::sleep(Duration::from_millis(20));
            continue;
        };
        let pass = gate.enter(&stream);
        let answers = answers.clone();
        // If no thread can be started, the connection is dropped and the browser retries.
        let _ = std::thread::Builder::new().spawn(move || {
            // A client that disconnects is not an error.
            let _ = connection(&stream, &answers, &pass);
            drop(pass);
        });
    }
}

/// Handles one request.
fn connection(stream: &TcpStream, answers: &Answers, pass: &Pass) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(WRITE_PATIENCE))?;
    let deadline = Instant::now() + PATIENCE;
    let mut reader = Until { stream, deadline };
    let mut writer = stream;
    exchange(&mut reader, &mut writer, answers, pass)?;
    stream.shutdown(Shutdown::Write)?;
    reader.deadline = Instant::now() + LINGER.0;
    io::copy(&mut reader.take(LINGER.1 as u64), &mut io::sink())?;
    Ok(())
}

/// Reads until a deadline, however slowly bytes arrive.
struct Until<'a> {
    stream: &'a TcpStream,
    deadline: Instant,
}

impl Read for Until<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        let mut stream = self.stream;
        stream.read(bytes)
    }
}

/// Reads a request's head and writes its answer.
fn exchange(
    reader: &mut impl Read,
    writer: &mut impl Write,
    answers: &Answers,
    pass: &Pass,
) -> io::Result<()> {
    let mut head = vec![0; HEAD];
    let mut filled = 0;
    loop {
        let n = reader.read(&mut head[filled..])?;
        if n == 0 {
            // Opened in advance and not needed, or closed halfway.
            return Ok(());
        }
        filled += n;
        let mut headers = [httparse::EMPTY_HEADER; HEADERS];
        let mut request = httparse::Request::new(&mut headers);
        match request.parse(&head[..filled]) {
            Ok(httparse::Status::Complete(_)) => {
                pass.asked();
                let method = request.method.unwrap_or_default();
                return send(writer, method != "HEAD", answer(&request, method, answers));
            }
            Ok(httparse::Status::Partial) if filled < HEAD => {}
            Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
                let reply = Reply::text(431, "refused: the request's headers are too long\n");
                return send(writer, true, reply);
            }
            Err(e) => return send(writer, true, Reply::text(400, format!("refused: {e}\n"))),
        }
    }
}

fn answer(request: &httparse::Request<'_, '_>, method: &str, answers: &Answers) -> Reply {
    let header = |name: &str| {
        let found = (request.headers.iter()).find(|h| h.name.eq_ignore_ascii_case(name))?;
        std::str::from_utf8(found.value).ok()
    };
    answers.answer(&Ask {
        method,
        target: request.path.unwrap_or_default(),
        host: header("Host"),
        range: header("Range"),
        gzip: header("Accept-Encoding").is_some_and(|e| e.contains("gzip")),
    })
}

/// Writes an answer, with its body if `with_body`.
fn send(writer: &mut impl Write, with_body: bool, reply: Reply) -> io::Result<()> {
    let Reply {
        status,
        headers,
        body,
    } = reply;
    let (mut body, length) = body.open();
    let mut head = format!("HTTP/1.1 {status} {}\r\n", reason(status));
    for (name, value) in &headers {
        // A header value must not contain a line break. None does today, but some come from
        // manifests.
        if !value.contains(['\r', '\n']) {
            head.push_str(&format!("{name}: {value}\r\n"));
        }
    }
    head.push_str(&format!(
        "Content-Length: {length}\r\nConnection: close\r\n\r\n"
    ));
    writer.write_all(head.as_bytes())?;
    if with_body {
        io::copy(&mut body, writer)?;
    }
    writer.flush()
}

/// The reason phrase of a status.
fn reason(status: u16) -> &'static str {
    match status {
        200 => "OK",
        206 => "Partial Content",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        416 => "Range Not Satisfiable",
        431 => "Request Header Fields Too Large",
        _ => "Internal Server Error",
    }
}
