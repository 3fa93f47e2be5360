//! Runs an unwrapper in its own thread: a panic there is an ordinary failure, and a cancelled bake
//! abandons the thread at once, even if it cannot be stopped.
//!
//! No clock is involved. The running time of an unwrapper is bounded by the mesh sizes that it
//! accepts.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use super::input::UnwrapInput;
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};

/// How often the waiting thread checks for cancellation.
const POLL: Duration = Duration::from_millis(20);

/// Meshes with fewer triangles are unwrapped on one thread; other meshes occupy the rest of the
/// machine.
const LARGE: usize = 20_000;

/// Runs `unwrapper` until it finishes or `cancel` asks to stop. A panic counts as a failure.
///
/// The work gets its own thread pool: the caller waits inside a pool's thread, and work in the same
/// pool would wait for that thread.
pub(super) fn run(
    unwrapper: &'static dyn Unwrapper,
    mesh: &Arc<UnwrapInput>,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
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
                Err(error) => Err(UnwrapError::Failed(format!(
                    "cannot start threads: {error}"
                ))),
            };
            // If the bake was cancelled, the receiver is gone and the result is not needed.
            let _ = sender.send(result);
        }
    };
    std::thread::Builder::new()
        .name(unwrapper.name().into())
        .spawn(work)
        .map_err(|e| UnwrapError::Failed(format!("cannot start a thread: {e}")))?;
    loop {
        match receiver.recv_timeout(POLL) {
            Ok(result) => return result,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(UnwrapError::Failed("it panicked".into()));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if cancel() {
            stop.store(true, Ordering::Relaxed);
            return Err(UnwrapError::Cancelled);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::super::{BoxProjection, unwrap_with_fallback};
    use super::*;
    use glam::{DMat3, Vec3};
    use mesh_ingest::{Mesh, Primitive};

    /// An unwrapper that never ends, or panics.
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
    fn a_panic_gives_way_to_the_fallback() {
        static BREAKS: Bad = Bad { panics: true };
        let all: [&'static dyn Unwrapper; 2] = [&BREAKS, &BoxProjection];
        let (result, by, failures) =
            unwrap_with_fallback(&all, &Arc::new(triangle()), &OPTIONS, &|| false).expect("charts");
        assert_eq!((by, result.charts), ("box", 1));
        assert!(failures[0].contains("panicked"), "{failures:?}");
    }

    #[test]
    fn a_hang_can_be_cancelled_at_once() {
        static HANGS: Bad = Bad { panics: false };
        let start = Instant::now();
        let cancel = || start.elapsed() > Duration::from_millis(100);
        let result = run(&HANGS, &Arc::new(triangle()), &OPTIONS, &cancel);
        assert_eq!(result.err(), Some(UnwrapError::Cancelled));
        // One polling interval, plus the delay of a busy machine; it would never end by itself.
        assert!(start.elapsed() < Duration::from_secs(30));
    }
}
