//! Bundle adjustment beside Ceres on BAL problems: the same cost in how much of the time, with the same number of threads.
//!
//! The problems are the cases' (`real/ba`) and the two that the peers' generator makes. Ceres runs as in its own program, with
//! the faster of its two direct solvers and its default tolerances; both solve from memory, and reading is not timed.

use super::{Arguments, Report, Row};
use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;
use texreg::bundle::{Bundle, BundleAdjustment, Columns, Snavely, SnavelyCamera, read_bal};

/// Our time over Ceres', and our cost.
const TIME: f64 = 0.5;
const COST: f64 = 1.0 + 1e-6;

/// What Ceres' program prints.
#[derive(Deserialize)]
struct Ceres {
    ceres: String,
    final_cost: f64,
    seconds: f64,
    iterations: usize,
}

/// Measures every problem with one thread and with two.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let scratch = tempfile::tempdir()?;
    let mut notes = Vec::new();
    let problems = problems(arguments, scratch.path(), &mut notes)?;
    ensure!(!problems.is_empty(), "no BAL problem: name the cases or the peers");
    let ceres = arguments.peers.as_ref().map(|peers| peers.join("build/ba_ceres")).filter(|path| path.exists());
    if ceres.is_none() {
        notes.push("Ceres is missing: --peers DIR with build/ba_ceres".to_string());
    }
    let rounds = if arguments.quick { 3 } else { 7 };
    let mut rows = Vec::new();
    for path in &problems {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        let bundle = read_bal(&text).with_context(|| path.display().to_string())?;
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let solver = match &ceres {
                Some(program) => Some((program, faster(program, path, threads)?)),
                None => None,
            };
            let (mut ours, mut theirs) = (Vec::new(), Vec::new());
            let (mut cost, mut their_cost) = (0.0, f64::INFINITY);
            let mut described = String::new();
            // By turns, so that what else the machine does falls on both.
            for _ in 0..rounds {
                let began = Instant::now();
                let (end, iterations) = pool.install(|| adjust(&bundle));
                ours.push(began.elapsed().as_secs_f64() * 1e3);
                cost = end;
                if let Some((program, solver)) = solver {
                    let run = run_ceres(program, path, solver, threads)?;
                    theirs.push(run.seconds * 1e3);
                    their_cost = run.final_cost;
                    described = format!("Ceres {} {solver}", run.ceres);
                    if theirs.len() == 1 {
                        notes.push(format!(
                            "{name}, {threads} threads: {iterations} steps to {cost:.6}, Ceres {} to {their_cost:.6}",
                            run.iterations
                        ));
                    }
                }
            }
            let label = format!("{name}, {threads} thread{}", if threads == 1 { "" } else { "s" });
            let time = median(ours);
            if theirs.is_empty() {
                rows.push(Row::alone(label, time, "ms"));
            } else {
                rows.push(Row::beside(label.clone(), time, median(theirs), described.clone(), "ms").goal(TIME));
                rows.push(Row::beside(format!("{label}, cost"), cost, their_cost, described, "px²").goal(COST));
            }
        }
    }
    let mut report = Report::new("ba", rows);
    report.notes = notes;
    Ok(report)
}

/// The cost that is reached, and in how many steps.
fn adjust(bundle: &Bundle<SnavelyCamera>) -> (f64, usize) {
    let columns = Columns::own(bundle.cameras.len());
    let report = BundleAdjustment::default().adjust(&Snavely, bundle.clone(), &columns, &mut |_| ());
    report.map_or((f64::INFINITY, 0), |report| (-report.value, report.iterations.len()))
}

/// The BAL files of the cases, and those the peers' generator makes.
fn problems(arguments: &Arguments, scratch: &Path, notes: &mut Vec<String>) -> Result<Vec<PathBuf>> {
    let mut problems = Vec::new();
    if let Some(cases) = &arguments.cases {
        let folder = cases.join("real/ba");
        for entry in std::fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
            let path = entry?.path();
            let is_problem = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("problem-"));
            if is_problem && path.extension().is_some_and(|extension| extension == "txt") {
                problems.push(path);
            }
        }
        problems.sort();
    }
    if let Some(peers) = &arguments.peers {
        // From copies: the generator writes beside itself.
        for file in ["gen.py", "common.py"] {
            std::fs::copy(peers.join(file), scratch.join(file))
                .with_context(|| peers.join(file).display().to_string())?;
        }
        let generated =
            Command::new(peers.join("venv/bin/python")).arg("gen.py").arg("bal").current_dir(scratch).output();
        match generated {
            Ok(output) if output.status.success() => {
                problems.extend(["ring", "corridor"].map(|name| scratch.join(format!("data/ba/{name}.txt"))));
            }
            _ => notes.push("the peers' generator does not run: no ring, no corridor".to_string()),
        }
    }
    Ok(problems)
}

/// The direct solver of Ceres that takes less time.
fn faster(program: &Path, path: &Path, threads: usize) -> Result<&'static str> {
    let dense = run_ceres(program, path, "dense_schur", threads)?.seconds;
    let sparse = run_ceres(program, path, "sparse_schur", threads)?.seconds;
    Ok(if dense <= sparse { "dense_schur" } else { "sparse_schur" })
}

fn run_ceres(program: &Path, path: &Path, solver: &str, threads: usize) -> Result<Ceres> {
    let output = Command::new(program)
        .arg(path)
        .args([solver, &threads.to_string(), "1e-6", "0"])
        .env("OPENBLAS_NUM_THREADS", threads.to_string())
        .output()?;
    ensure!(output.status.success(), "{}: {}", program.display(), String::from_utf8_lossy(&output.stderr).trim());
    serde_json::from_slice(&output.stdout).with_context(|| program.display().to_string())
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
