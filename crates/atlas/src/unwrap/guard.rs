//! The last defence against an unwrapper that never ends: it works in a thread of its own, which is left behind if it must be.
//!
//! This alone depends on the clock, and nothing that ends is near it: [`patience`] is thirty times what meshes took. Which unwrapper gets a
//! mesh is otherwise decided by counting triangles (each refuses what is too much for it).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use super::input::UnwrapInput;
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};

/// How often the waiting thread looks whether it is to stop.
const POLL: Duration = Duration::from_millis(20);

/// Meshes of fewer triangles are unwrapped by one thread; there are others to keep the rest of the machine busy with.
const LARGE: usize = 20_000;

/// When to give up on a mesh of so many triangles. Half a millisecond each is thirty times what uvunwrap takes (16 µs), and a minute more than
/// anything small needs on a machine that does ten other things.
pub(super) fn patience(triangles: usize) -> Duration {
    Duration::from_secs(60)
        + Duration::from_micros(500) * u32::try_from(triangles).unwrap_or(u32::MAX)
}

/// Runs `unwrapper` until it is done, `cancel` says so, or `patience` ends. A panic inside counts as a failure.
///
/// The work gets threads of its own as well: callers wait inside a pool's threads, and work that shares the pool
/// would wait for them.
pub(super) fn run(
    unwrapper: &'static dyn Unwrapper,
    mesh: &Arc<UnwrapInput>,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
    patience: Duration,
) -> Result<UnwrappedMesh, UnwrapError> {
    if cancel() {
        return Err(UnwrapError::Cancelled);
    }
    let stop = Arc::new(AtomicBool::new(false));
    let (sender, receiver) = channel();
    let threads = if mesh.triangles.len() < LARGE {
        1
    } else {
        rayon::current_num_threads()
    };
    let work = {
        let (stop, mesh, options) = (Arc::clone(&stop), Arc::clone(mesh), *options);
        move || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let polled = || stop.load(Ordering::Relaxed);
            let result = match pool {
                Ok(pool) => pool.install(|| unwrapper.unwrap(&mesh, &options, &polled)),
                Err(error) => Err(UnwrapError::Failed(format!("no threads: {error}"))),
            };
            // The receiver is gone if the wait was given up; nobody misses the result then.
            let _ = sender.send(result);
        }
    };
    std::thread::Builder::new()
        .name(unwrapper.name().into())
        .spawn(work)
        .map_err(|e| UnwrapError::Failed(format!("no thread: {e}")))?;
    let start = Instant::now();
    loop {
        match receiver.recv_timeout(POLL) {
            Ok(result) => return result,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(UnwrapError::Failed("it broke down".into()));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        let late = start.elapsed() > patience;
        if late || cancel() {
            stop.store(true, Ordering::Relaxed);
            return Err(if late {
                UnwrapError::Failed(format!(
                    "no result after {} s, given up (this depends on the machine's speed)",
                    patience.as_secs()
                ))
            } else {
                UnwrapError::Cancelled
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BoxProjection, unwrap_within};
    use super::*;
    use glam::{DMat3, Vec3};
    use mesh_ingest::{Mesh, Primitive};

    /// Never ends, or breaks down.
    struct Bad {
        panics: bool,
    }

    impl Unwrapper for Bad {
        fn name(&self) -> &'static str {
            "bad"
        }

        fn unwrap(
            &self,
            _: &UnwrapInput,
            _: &UnwrapOptions,
            _: Cancel<'_>,
        ) -> Result<UnwrappedMesh, UnwrapError> {
            assert!(!self.panics, "as it should");
            loop {
                std::thread::park();
            }
        }
    }

    fn triangle() -> UnwrapInput {
        let mesh = Mesh {
            primitives: vec![Primitive {
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                triangles: vec![[0, 1, 2]],
                ..Primitive::default()
            }],
            ..Mesh::default()
        };
        UnwrapInput::from_mesh(&mesh, DMat3::IDENTITY)
    }

    const OPTIONS: UnwrapOptions = UnwrapOptions {
        texels_per_unit: 8.0,
        padding: 2,
        block: 4,
        block_charts: false,
        max_size: 64,
    };

    #[test]
    fn a_hang_and_a_panic_both_give_way_to_the_fallback() {
        static HANGS: Bad = Bad { panics: false };
        static BREAKS: Bad = Bad { panics: true };
        // A panic is known at once, however long its backtrace takes to print.
        for (bad, why, patience) in [(&HANGS, "no result", 200), (&BREAKS, "broke down", 600_000)] {
            let patience = |_: usize| Duration::from_millis(patience);
            let (result, by, failures) = unwrap_within(
                &[bad, &BoxProjection],
                &Arc::new(triangle()),
                &OPTIONS,
                &|| false,
                patience,
            )
            .expect("charts");
            assert_eq!((by, result.charts), ("box", 1));
            assert!(failures[0].contains(why), "{failures:?}");
        }
    }

    #[test]
    fn a_hang_can_be_cancelled_at_once() {
        static HANGS: Bad = Bad { panics: false };
        let start = Instant::now();
        let cancel = || start.elapsed() > Duration::from_millis(100);
        let result = run(
            &HANGS,
            &Arc::new(triangle()),
            &OPTIONS,
            &cancel,
            Duration::from_secs(600),
        );
        assert_eq!(result.err(), Some(UnwrapError::Cancelled));
        // A poll and what a busy machine adds; a minute would be patience running out.
        assert!(start.elapsed() < Duration::from_secs(30));
    }
}
