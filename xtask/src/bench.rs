//! What the benchmarks share: their arguments, and a report as a table or as JSON.

mod accuracy;
mod ba;
mod calibrate;
mod charts;
mod joint;
mod load;
mod mi;
mod pnp;
mod raster;
mod register;
mod signals;
mod studio;
mod texture;

use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use texreg::driver::{ChannelName, MetricName};
use texreg::surface::SignalName;

/// The arguments of a benchmark.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The benchmark.
    #[arg(value_enum)]
    name: Name,
    /// Finish within a minute.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Print one JSON object to standard output.
    #[arg(long)]
    json: bool,
    /// The folder with the cases; the repository's fixtures without it.
    #[arg(long, value_name = "DIR")]
    pub(crate) cases: Option<PathBuf>,
    /// Only the starts whose kind begins with this (accuracy).
    #[arg(long, value_name = "KIND")]
    pub(crate) only: Option<String>,
    /// What accuracy registers by, several for their joint signal; the program's own choice without it.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub(crate) signal: Vec<SignalName>,
    /// The metric that `accuracy` climbs.
    #[arg(long, value_name = "NAME", default_value_t)]
    pub(crate) metric: MetricName,
    /// What of the photos it compares.
    #[arg(long, value_name = "NAME", default_value_t)]
    pub(crate) channel: ChannelName,
    /// The folder with the installed peers.
    #[arg(long, value_name = "DIR")]
    pub(crate) peers: Option<PathBuf>,
}

/// One module a benchmark, one line here and one in [`run`].
#[derive(Clone, Copy, clap::ValueEnum)]
enum Name {
    Accuracy,
    Ba,
    Calibrate,
    Charts,
    Joint,
    Load,
    Mi,
    Pnp,
    Raster,
    Register,
    Signals,
    Studio,
    Texture,
}

/// Runs a benchmark and prints its report.
pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let report: Report = match arguments.name {
        Name::Accuracy => accuracy::run(arguments)?,
        Name::Ba => ba::run(arguments)?,
        Name::Calibrate => calibrate::run(arguments)?,
        Name::Charts => charts::run(arguments)?,
        Name::Joint => joint::run(arguments)?,
        Name::Load => load::run(arguments)?,
        Name::Mi => mi::run(arguments)?,
        Name::Pnp => pnp::run(arguments)?,
        Name::Raster => raster::run(arguments)?,
        Name::Register => register::run(arguments)?,
        Name::Signals => signals::run(arguments)?,
        Name::Studio => studio::run(arguments)?,
        Name::Texture => texture::run(arguments)?,
    };
    report.print(arguments.json)
}

/// The Python of the peers' folder, or else the system's, to talk with through pipes.
fn python(peers: &Path) -> Command {
    let own = Some(peers.join("venv/bin/python")).filter(|python| python.is_file());
    let mut command = Command::new(own.unwrap_or_else(|| "python3".into()));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    command
}

/// What a benchmark measured.
#[derive(Serialize)]
pub(crate) struct Report {
    /// The benchmark's name.
    pub(crate) bench: &'static str,
    /// What it ran on.
    pub(crate) machine: String,
    /// The figures.
    pub(crate) rows: Vec<Row>,
    /// Whether every row with a goal met it.
    pub(crate) met: bool,
    /// Peers that are missing, and other remarks.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) notes: Vec<String>,
}

/// One figure, beside a peer's or a limit's from the same run.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Row {
    pub(crate) name: String,
    pub(crate) ours: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) peer: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) peer_name: Option<String>,
    pub(crate) unit: &'static str,
    /// Ours over the peer's: below 1 is better.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) ratio: Option<f64>,
    /// The ratio aimed at, or the figure itself where there is no peer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) goal: Option<f64>,
}

impl Row {
    /// A figure of ours alone.
    pub(crate) fn alone(name: impl Into<String>, ours: f64, unit: &'static str) -> Self {
        Self { name: name.into(), ours, unit, ..Self::default() }
    }

    /// A figure of ours beside a peer's.
    pub(crate) fn beside(
        name: impl Into<String>,
        ours: f64,
        peer: f64,
        peer_name: impl Into<String>,
        unit: &'static str,
    ) -> Self {
        let peer_name = Some(peer_name.into());
        Self { name: name.into(), ours, peer: Some(peer), peer_name, unit, ratio: Some(ours / peer), goal: None }
    }

    /// The ratio (or, without a peer, the figure) aimed at.
    pub(crate) fn goal(mut self, goal: f64) -> Self {
        self.goal = Some(goal);
        self
    }

    fn met(&self) -> bool {
        self.goal.is_none_or(|goal| self.ratio.unwrap_or(self.ours) <= goal)
    }
}

impl Report {
    /// A report of the machine this runs on.
    pub(crate) fn new(bench: &'static str, rows: Vec<Row>) -> Self {
        let met = rows.iter().all(Row::met);
        Self { bench, machine: machine(), rows, met, notes: Vec::new() }
    }

    fn print(&self, json: bool) -> anyhow::Result<()> {
        if json {
            println!("{}", serde_json::to_string(self)?);
            return Ok(());
        }
        println!("{} on {}", self.bench, self.machine);
        let width = self.rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0);
        for row in &self.rows {
            print!("{:width$}  {:>10} {:4}", row.name, figure(row.ours), row.unit);
            if let (Some(peer), Some(name), Some(ratio)) = (row.peer, &row.peer_name, row.ratio) {
                print!("  {:>10} {name}  ratio {}", figure(peer), figure(ratio));
            }
            if let Some(goal) = row.goal {
                print!("  goal {}{}", figure(goal), if row.met() { "" } else { "  MISSED" });
            }
            println!();
        }
        for note in &self.notes {
            println!("{note}");
        }
        Ok(())
    }
}

/// A figure with three significant digits or none after the point.
fn figure(value: f64) -> String {
    let digits =
        if value == 0.0 || !value.is_finite() { 0 } else { (2 - value.abs().log10().floor() as i32).clamp(0, 4) };
    format!("{value:.*}", digits as usize)
}

/// The processor and its number of threads.
fn machine() -> String {
    let model = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_string())
    });
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {threads} threads", model.unwrap_or_else(|| std::env::consts::ARCH.to_string()))
}
