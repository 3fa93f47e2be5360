//! Follows a bake with a closure, and stops a bake from another thread.
//!
//!     cargo run --release -p lumel --example 03_progress_and_cancel
//!
//! Next: `04_results_in_memory`.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::sync::mpsc;

use lumel::{Baker, CancelToken, Error, Phase, Quality};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb");

fn main() -> Result<(), Error> {
    follow()?;
    stop()
}

/// Prints each phase once, although the solve alternates between its parts.
fn follow() -> Result<(), Error> {
    let mut seen: Vec<Phase> = Vec::new();
    // The closure may mutate its captures: calls come one at a time.
    let baker = Baker::new()
        .quality(Quality::Draft)
        .texels_per_unit(0.1)
        .on_progress(|progress| {
            if !seen.contains(&progress.phase) {
                println!("now: {}", progress.phase.name());
                seen.push(progress.phase);
            }
            // A bar would show `progress.share()`.
        });
    baker.bake(SCENE)?;
    drop(baker);
    println!("{} phases", seen.len());
    Ok(())
}

/// Starts a bake that would take minutes, and stops it once it gathers.
fn stop() -> Result<(), Error> {
    let token = CancelToken::new();
    let (gathering, wait) = mpsc::channel();
    let outcome = std::thread::scope(|scope| {
        // The callback of a button would hold a clone like this one.
        let button = token.clone();
        scope.spawn(move || {
            if wait.recv().is_ok() {
                button.cancel();
            }
        });
        Baker::new()
            .quality(Quality::Production)
            .cancel_token(&token)
            .on_progress(move |progress| {
                if progress.phase == Phase::Gather {
                    // The receiver is gone after the first message.
                    let _ = gathering.send(());
                }
            })
            .bake(SCENE)
    });
    match outcome {
        Err(Error::Cancelled) => {
            println!(
                "stopped, as asked for; a command would exit with {}",
                Error::Cancelled.exit_code()
            );
            Ok(())
        }
        Err(other) => Err(other),
        Ok(_) => {
            println!("the bake was faster than the button");
            Ok(())
        }
    }
}
