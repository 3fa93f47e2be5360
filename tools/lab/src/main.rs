//! Runs the method laboratory and writes its tables.

mod solvers;
mod study;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Classic radiosity methods side by side: tables and scenes for study.
#[derive(Parser)]
#[command(name = "lumel-lab", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Solvers on one system: passes, time, memory and work to each residual (writes CSV, prints Markdown)
    Solvers {
        /// Folder for the CSV files
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// The classic studies: rooms as .glb and the baseline's radiosity as CSV (tools/classic_studies.py goes on from there)
    Studies {
        /// Folder for the files
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Solvers { out } => solvers::run(&out),
        Command::Studies { out } => study::run(&out),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln_error(&*e);
            ExitCode::FAILURE
        }
    }
}

#[allow(clippy::print_stderr, reason = "the program's one place for errors")]
fn eprintln_error(e: &dyn std::error::Error) {
    eprintln!("lumel-lab: {e}");
}
