//! Runs the method laboratory and writes its tables.

mod form_factors;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Runs the method laboratory: CSV into a folder, a Markdown table on stdout.
#[derive(Parser)]
#[command(name = "lumel-lab", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Every form-factor method at several settings on the same scenes: error, time, memory, rays.
    FormFactors(form_factors::Options),
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::FormFactors(options) => form_factors::run(&options),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            #[allow(
                clippy::print_stderr,
                reason = "a program says on stderr why it failed"
            )]
            {
                eprintln!("lumel-lab: {error}");
            }
            ExitCode::from(2)
        }
    }
}
