//! Runs the method laboratory: CSV and scenes into a folder, Markdown tables on stdout.

mod convergence;
mod form_factors;
mod solvers;
mod study;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Classic radiosity methods side by side: tables and scenes for study.
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
    /// Solvers on one system: passes, time, memory and work to each residual (writes CSV, prints
    /// Markdown).
    Solvers {
        /// Folder for the CSV files
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// How the baker's error falls with patches and rays, and the solver's bound beside its error
    /// (writes CSV, prints Markdown).
    Convergence {
        /// Folder for the CSV file
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// The classic studies: rooms as .glb and the baseline's radiosity as CSV (input of
    /// tools/classic_studies.py).
    Studies {
        /// Folder for the files
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::FormFactors(options) => form_factors::run(&options),
        Command::Convergence { out } => convergence::run(&out),
        Command::Solvers { out } => solvers::run(&out),
        Command::Studies { out } => study::run(&out),
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
