//! Algorithm 2 of the thesis for one photo, and Algorithm 1 where parts of the camera are refined as well: from a rough view to
//! the one that maximizes the metric.
//!
//! 1. A search over small renderings finds views that might lie in the right basin.
//! 2. Each climbs on the coarsest level of the photo; the best climb on the next, and the one that explains the whole
//!    picture best goes on.
//! 3. It climbs through the finer levels to the full photo. Only there are focal length and distortion let go.
//!
//! To climb is to render, to take samples, and to maximize the metric over them by Levenberg–Marquardt, until a new rendering
//! changes nothing.

use crate::objective::{PhotoObjective, Prior};
use crate::overview::{Overview, Workspace};
use crate::pyramid::{Level, pyramid, spread};
use crate::samples::{Sampler, Sampling};
use crate::search::Search;
use crate::signal::{Both, Normals, Ranked, Signal};
use crate::{Error, Options, Photo, Refine, SignalName};
use nalgebra::Point3;
use rayon::prelude::*;
use std::time::Instant;
use texreg_camera::View;
use texreg_mi::Parzen;
use texreg_optim::{LevenbergMarquardt, Solver};
use texreg_surface::Mesh;

/// The verdict on a registration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The view explains the photo.
    Registered,
    /// There are reasons for doubt.
    Uncertain,
    /// No view better than the start was found; the start is handed back.
    Failed,
}

/// What one stage of a registration did.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// What the stage did, and at which size of the photo: `search 1/8`, `climb 1/2`.
    pub name: String,
    /// How often the metric was evaluated.
    pub evaluations: usize,
    /// How often the model was rendered.
    pub renderings: usize,
    /// The metric before and after, over the stage's own samples.
    pub similarity: (f64, f64),
    /// Wall-clock time.
    pub milliseconds: f64,
}

/// The result of a registration.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The camera that was found; its pose takes the world to the camera frame.
    pub view: View,
    /// The verdict.
    pub status: Status,
    /// The verdict's reasons, in words.
    pub reasons: Vec<String>,
    /// The metric between the whole photo and the model in front of a background, at the start and at the end.
    pub similarity: (f64, f64),
    /// The stages, in order.
    pub stages: Vec<Stage>,
}

impl Outcome {
    /// How often the metric was evaluated.
    #[must_use]
    pub fn evaluations(&self) -> usize {
        self.stages.iter().map(|stage| stage.evaluations).sum()
    }
}

/// What a registration tells while it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Stages done.
    pub done: usize,
    /// All stages.
    pub of: usize,
    /// The best view so far.
    pub view: View,
}

/// Registers one photo, starting from a rough view.
///
/// # Errors
/// If the model cannot be seen from the start, or does not carry the signal asked for.
pub fn register(
    mesh: &Mesh,
    photo: &Photo,
    start: &View,
    options: &Options,
    observer: &mut dyn FnMut(&Event),
) -> Result<Outcome, Error> {
    Registration::new(mesh, photo, options)?.run(start, observer)
}

/// A photo and a model made ready, for one registration or many.
pub struct Registration<'a> {
    mesh: &'a Mesh,
    signal: Box<dyn Signal + 'a>,
    /// Full size first.
    levels: Vec<Level>,
    options: Options,
    density: Parzen,
    /// A few points of the model, to measure how far apart two views are.
    probes: Vec<Point3<f64>>,
}

/// Bins of the photo's values.
const PHOTO_BINS: usize = 32;

/// The longer side of the coarsest level is below twice this many pixels.
const COARSEST: usize = 150;

/// Views that climb on the coarsest level.
const HYPOTHESES: usize = 8;

/// Views that climb on the second level.
const FINALISTS: usize = 2;

impl<'a> Registration<'a> {
    /// Makes a photo and a model ready.
    ///
    /// # Errors
    /// If the model does not carry the signal asked for.
    pub fn new(mesh: &'a Mesh, photo: &Photo, options: &Options) -> Result<Self, Error> {
        let mut values = photo.luma.clone();
        spread(&mut values, 0.005);
        let levels = pyramid(photo.width as usize, photo.height as usize, &values, COARSEST);
        let signal = signal(mesh, &options.signal)?;
        let density = Parzen { model_bins: signal.bins() + 1, photo_bins: PHOTO_BINS };
        let probes = mesh.positions.iter().step_by(mesh.positions.len() / 200 + 1);
        let probes = probes.map(|p| p.map(f64::from).into()).collect();
        Ok(Self { mesh, signal, levels, options: options.clone(), density, probes })
    }

    /// Registers the photo from a rough view.
    ///
    /// # Errors
    /// If the model cannot be seen from the start.
    pub fn run(&self, start: &View, observer: &mut dyn FnMut(&Event)) -> Result<Outcome, Error> {
        // Inside, poses are relative to the model's origin: its coordinates are small and it turns about its middle.
        let origin = self.mesh.origin;
        let outward = |mut view: View| {
            view.pose.translation -= view.pose.rotation * origin;
            view
        };
        let mut first = *start;
        first.pose.translation += first.pose.rotation * origin;

        let coarsest = self.levels.len() - 1;
        let second = coarsest.saturating_sub(1);
        let mut stages: Vec<Stage> = Vec::new();
        let mut tell = |stage: Stage, view: &View| {
            stages.push(stage);
            observer(&Event { done: stages.len(), of: self.levels.len() + 1, view: outward(*view) });
        };

        let judge = self.overview(second);
        let score = |view: &View| judge.score(&mut Workspace::default(), view);
        let start_score = score(&first).ok_or(Error::NothingVisible)?;

        let started = Instant::now();
        let found = self.search(coarsest).around(&first, self.mesh.diagonal(), &self.overview(coarsest));
        let hypotheses = self.apart(&first, &found);
        let name = format!("search 1/{}", 1 << coarsest);
        let before = found.iter().find(|(_, view)| *view == first).map_or(0.0, |(score, _)| *score);
        tell(Stage::new(name, started, found.len(), found.len(), (before, found[0].0)), &first);

        let started = Instant::now();
        let climbed = self.climb_all(coarsest, hypotheses, &first);
        let mut ranked: Vec<(f64, View, Stage)> =
            climbed.into_par_iter().filter_map(|(view, stage)| Some((score(&view)?, view, stage))).collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (evaluations, renderings) =
            ranked.iter().fold((0, 0), |(e, r), (_, _, s)| (e + s.evaluations, r + s.renderings));
        let Some((_, mut view, best)) = ranked.first().cloned() else { return Err(Error::NothingVisible) };
        tell(Stage::new(best.name, started, evaluations, renderings, best.similarity), &view);

        if second < coarsest {
            let started = Instant::now();
            let finalists = ranked.into_iter().take(FINALISTS).map(|(_, view, _)| view).collect();
            let climbed = self.climb_all(second, finalists, &first);
            let mut ranked: Vec<(f64, View, Stage)> =
                climbed.into_iter().filter_map(|(view, stage)| Some((score(&view)?, view, stage))).collect();
            ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
            let (evaluations, renderings) =
                ranked.iter().fold((0, 0), |(e, r), (_, _, s)| (e + s.evaluations, r + s.renderings));
            let Some((_, best_view, best)) = ranked.into_iter().next() else { return Err(Error::NothingVisible) };
            view = best_view;
            tell(Stage::new(best.name, started, evaluations, renderings, best.similarity), &view);
        }

        for index in (0..second).rev() {
            let started = Instant::now();
            let (climbed, stage) = self.climb(index, &view, &first)?;
            view = climbed;
            tell(Stage { milliseconds: milliseconds(started), ..stage }, &view);
        }

        let end_score = score(&view).unwrap_or(0.0);
        let (view, status, reasons) = if end_score > start_score {
            (view, Status::Registered, Vec::new())
        } else {
            (first, Status::Failed, vec!["no view explains the photo better than the start".to_string()])
        };
        Ok(Outcome {
            view: outward(view),
            status,
            reasons,
            similarity: (start_score, end_score.max(start_score)),
            stages,
        })
    }

    fn overview(&self, index: usize) -> Overview<'_> {
        Overview::new(self.mesh, &*self.signal, &self.levels[index], &self.density, self.options.metric.metric())
    }

    fn search(&self, _index: usize) -> Search {
        Search { rounds: 5, views: 64, elite: 12, deviation: 0.08, seed: self.options.seed }
    }

    /// The start and the best views that differ visibly from it and from each other.
    fn apart(&self, start: &View, found: &[(f64, View)]) -> Vec<View> {
        let coarsest = self.levels.last().map_or(1.0, |level| level.scale);
        let mut kept = vec![*start];
        for (_, view) in found {
            if kept.len() == HYPOTHESES {
                break;
            }
            if kept.iter().all(|other| self.distance(other, view) * coarsest > 2.0) {
                kept.push(*view);
            }
        }
        kept
    }

    /// The mean distance between the pictures of the model's points in two views, in pixels of the photo.
    fn distance(&self, a: &View, b: &View) -> f64 {
        let distances: Vec<f64> =
            self.probes.iter().filter_map(|p| Some((a.project(p)? - b.project(p)?).norm())).collect();
        if distances.is_empty() { f64::INFINITY } else { distances.iter().sum::<f64>() / distances.len() as f64 }
    }

    /// Climbs from several views; those that lose the model are dropped.
    fn climb_all(&self, index: usize, views: Vec<View>, start: &View) -> Vec<(View, Stage)> {
        views.into_par_iter().filter_map(|view| self.climb(index, &view, start).ok()).collect()
    }

    /// Climbs at one level of the photo. `start` brings the expected camera.
    fn climb(&self, index: usize, from: &View, start: &View) -> Result<(View, Stage), Error> {
        let started = Instant::now();
        let level = &self.levels[index];
        let sampling = Sampling { surface: 20_000, halo: 10_000, band: 12.0 };
        let refine = if index <= 1 { self.options.refine } else { Refine::default() };
        let prior = Prior { camera: start.camera, weight: 1e-3 };
        let solver = LevenbergMarquardt { iterations: 20, damping: 1e-2, gain_tolerance: 1e-5 };
        let mut sampler = Sampler::new(self.mesh, &*self.signal);
        let mut view = *from;
        let (mut evaluations, mut renderings) = (0, 0);
        let mut similarity: Option<(f64, f64)> = None;
        for _ in 0..4 {
            let samples = sampler.sample(&view, level, &sampling);
            renderings += 1;
            if samples.points.is_empty() {
                return Err(Error::NothingVisible);
            }
            let metric = self.options.metric.metric();
            let mut objective = PhotoObjective::new(&samples, level, &self.density, metric, refine, prior);
            let report = solver.maximize(&refine, &mut objective, view, &mut |_| ());
            evaluations += objective.evaluations;
            let Some(report) = report else { break };
            let moved = self.distance(&view, &report.point) * level.scale;
            view = report.point;
            similarity = Some((similarity.map_or(report.start, |s| s.0), report.value));
            if moved < 0.05 {
                break;
            }
        }
        let name = format!("climb 1/{}", 1 << index);
        Ok((view, Stage::new(name, started, evaluations, renderings, similarity.unwrap_or_default())))
    }
}

impl Stage {
    fn new(name: String, started: Instant, evaluations: usize, renderings: usize, similarity: (f64, f64)) -> Self {
        Self { name, evaluations, renderings, similarity, milliseconds: milliseconds(started) }
    }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// The signal of these names for a model; the model decides where there is no name.
fn signal<'a>(mesh: &'a Mesh, names: &[SignalName]) -> Result<Box<dyn Signal + 'a>, Error> {
    let has = |name| names.contains(&name);
    Ok(match (has(SignalName::Normals), has(SignalName::Reflectance), mesh.reflectance.as_deref()) {
        (_, true, None) => return Err(Error::NoReflectance),
        (false, true, Some(reflectance)) => Box::new(Ranked::new(reflectance, 16)),
        (true, true, Some(reflectance)) | (false, false, Some(reflectance)) => {
            Box::new(Both(Ranked::new(reflectance, 5), Normals { steps: 4 }))
        }
        (_, false, _) => Box::new(Normals { steps: 5 }),
    })
}
