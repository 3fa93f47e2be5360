//! HTTP/1.1 on threads, as little as a page on this machine needs: a request and its answer, then
//! the connection ends.
//!
//! Browsers open connections ahead and leave them idle. Each has a thread of its own here, so none
//! waits for another, and nothing is kept alive, so a page never queues behind a connection that
//! the browser holds open.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::answer::{Answers, Ask, Reply};

/// Connections at once; for a further one, the one that was silent for longest ends. Browsers open
/// six to a host, and some ahead.
const CONNECTIONS: usize = 64;
/// Bytes of request line and headers. Browsers send about one KiB, and up to eight with cookies of
/// other servers on this host.
const HEAD: usize = 16 << 10;
/// Headers of a request; browsers send about twenty.
const HEADERS: usize = 100;
/// How long a connection may take to say what it wants. An idle one ends here; browsers open
/// another when they need it.
const PATIENCE: Duration = Duration::from_secs(20);
/// How long a client may stop reading, as a browser does while a debugger holds it.
const WRITE_PATIENCE: Duration = Duration::from_secs(60);
/// How long a client has to close its end, and how much of what it still sends is read meanwhile:
/// closing with bytes unread makes the system drop the answer too.
const LINGER: (Duration, usize) = (Duration::from_secs(1), 1 << 20);

/// Counts connections, and knows which of them have not asked for anything yet.
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

/// One connection's place, given back when dropped.
struct Pass {
    gate: Arc<Gate>,
    number: u64,
}

impl Gate {
    /// Waits for a place. Where all are taken, the connection that has been silent for longest
    /// ends: whoever opens many and says nothing must not keep others out.
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
        // Without descriptors left it cannot be ended early, and ends by itself.
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
    /// The connection has said what it wants.
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

/// Answers connections until `stopping`, which is looked at after each.
pub(super) fn serve(listener: &TcpListener, answers: &Arc<Answers>, stopping: &AtomicBool) {
    let gate = Arc::new(Gate::default());
    loop {
        let accepted = listener.accept();
        if stopping.load(Ordering::SeqCst) {
            return;
        }
        let Ok((stream, _)) = accepted else {
            // The client is gone again, or this process has no descriptors left: others will close.
            std::thread::sleep(Duration::from_millis(20));
            continue;
        };
        let pass = gate.enter(&stream);
        let answers = answers.clone();
        // Where no thread can be had the connection is dropped, and the browser tries again.
        let _ = std::thread::Builder::new().spawn(move || {
            // A client that went away is no failure of ours.
            let _ = connection(&stream, &answers, &pass);
            drop(pass);
        });
    }
}

/// One request.
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

/// Reads until a point in time, however slowly bytes drip in.
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
            // Opened ahead and not needed, or ended in the middle.
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

/// Writes an answer, its body only if asked for.
fn send(writer: &mut impl Write, with_body: bool, reply: Reply) -> io::Result<()> {
    let Reply {
        status,
        headers,
        body,
    } = reply;
    let (mut body, length) = body.open();
    let mut head = format!("HTTP/1.1 {status} {}\r\n", reason(status));
    for (name, value) in &headers {
        // No value may end its line: none does today, and none shall by a name in some manifest.
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

/// What people read after the number.
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
