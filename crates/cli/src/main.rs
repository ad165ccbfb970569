//! The command line of texreg: it reads arguments and files, calls the driver and writes what comes back.
//!
//! Exit statuses: 0 when all photos are registered, 1 for an error told in one line, 2 for wrong usage (clap's),
//! 3 when the run finished but a photo is uncertain or failed.

mod args;
mod calibrate;
mod calibration_report;
mod convert;
mod corners;
mod evaluate;
mod handover;
mod inputs;
mod output;
mod pose;
mod register;
mod render;
mod report;
mod signals;
mod studio;
mod texture;

use std::process::ExitCode;

use clap::Parser as _;

use crate::args::{Args, Command};

/// How a run that met no error ended.
enum Ending {
    /// Every photo is as it should be.
    Good,
    /// Some photo is uncertain, failed or off.
    Doubtful,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(Ending::Good) => ExitCode::SUCCESS,
        Ok(Ending::Doubtful) => ExitCode::from(3),
        Err(error) => {
            eprintln!("error: {}", format!("{error:#}").replace('\n', " "));
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> anyhow::Result<Ending> {
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.get()).build_global()?;
    }
    match &args.command {
        Command::Register(register) => register::run(register, args.json),
        Command::Pose(pose) => pose::run(pose, args.json),
        Command::Render(render) => render::run(render, args.json),
        Command::Signals(signals) => signals::run(signals, args.json),
        Command::Texture(texture) => texture::run(texture, args.json),
        Command::Calibrate(calibrate) => calibrate::run(calibrate, args.json),
        Command::Evaluate(evaluate) => evaluate::run(evaluate, args.json),
        Command::Convert(convert) => convert::run(convert, args.json),
        Command::Studio(studio) => studio::run(studio, args.json),
    }
}
