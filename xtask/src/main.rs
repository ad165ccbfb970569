//! Benchmarks and experiments of the workspace: `cargo xtask bench NAME`.

mod bench;

use clap::{Parser, Subcommand};

/// Benchmarks and experiments of the workspace.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Measures one part of the program beside a peer or a limit.
    Bench(bench::Arguments),
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().command {
        Command::Bench(arguments) => bench::run(&arguments),
    }
}
