//! Algorithm 2 of the thesis for one photo, and Algorithm 1 where parts of the camera are refined as well: from a rough view to
//! the one that maximizes the metric.
//!
//! 1. A search over small renderings finds views that might lie in the right basin.
//! 2. Each climbs on the coarsest level of the photo; the best climb on the second, and the best of these goes on.
//! 3. It climbs through the finer levels to the full photo. Only on the last two are parts of the camera let go.
//!
//! To climb is to render, to take samples, and to maximize the metric over them, until a new rendering changes nothing. Views are
//! compared by the metric over the model and a band of background in a fixed proportion to it.

use crate::climb::Batches;
use crate::model::Model;
use crate::objective::{PhotoObjective, Prior};
use crate::outcome::{Event, Outcome, Stage};
use crate::overview::{Evidence, Overview, Workspace};
use crate::parameters::ViewSpace;
use crate::pyramid::{Level, pyramid, spread};
use crate::samples::{Sampler, Sampling, SurfaceSamples};
use crate::search::{Region, Search};
use crate::verdict::{Findings, verdict};
use crate::{Error, Options, Photo, Refine, SolverName};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::time::Instant;
use texreg_camera::View;
use texreg_mi::Parzen;
use texreg_optim::{Objective, Report};

/// Registers one photo, starting from a rough view of the world.
///
/// # Errors
/// If the model cannot be seen from the start, or the observer says stop.
pub fn register(
    model: &Model,
    photo: &Photo,
    start: &View,
    options: &Options,
    observer: &mut dyn FnMut(&Event) -> ControlFlow<()>,
) -> Result<Outcome, Error> {
    Registration::new(model, photo, options).run(start, observer)
}

/// A photo made ready for a model: for registrations from several starts.
pub struct Registration<'a> {
    model: &'a Model<'a>,
    options: &'a Options,
    density: Parzen,
    /// The photo, full size first.
    levels: Vec<Level>,
    overview: Overview,
}

/// Bins of the photo's values.
const PHOTO_BINS: usize = 20;

/// The share of a photo's values at each end of their range that is not told apart.
const TAIL: f64 = 0.005;

/// The longer side of the coarsest level is below twice this many pixels.
const COARSEST: usize = 150;

/// The longer side of the picture that is searched is at most this many pixels.
const OVERVIEW: u32 = 100;

/// Views that climb on the coarsest level, and of these on the second.
const HYPOTHESES: usize = 10;
const FINALISTS: usize = 3;

/// Views that differ by less than this many pixels of the coarsest level fall into the same basin.
const APART: f64 = 2.0;

/// The renewed rendering of a view that moved by less than this many pixels of a level shows nothing new.
const SETTLED: f64 = 0.05;

/// What the camera's prior weighs against a photo: a thousand of its samples are independent.
const PRIOR: f64 = 1e-3;

/// How much work a level is worth.
#[derive(Clone, Copy)]
struct Effort {
    samples: usize,
    renderings: usize,
    iterations: usize,
    /// The gain, in nats, below which climbing stops.
    gain: f64,
}

/// From the coarsest level to the finest; the last holds for all that follow.
const EFFORTS: [Effort; 3] = [
    Effort { samples: 3_000, renderings: 2, iterations: 10, gain: 1e-4 },
    Effort { samples: 8_000, renderings: 3, iterations: 10, gain: 1e-4 },
    Effort { samples: 30_000, renderings: 4, iterations: 15, gain: 1e-5 },
];

/// A view that climbed, and how.
struct Climb {
    view: View,
    similarity: (f64, f64),
    evaluations: usize,
    renderings: usize,
}

impl<'a> Registration<'a> {
    /// Makes a photo ready.
    pub fn new(model: &'a Model, photo: &Photo, options: &'a Options) -> Self {
        let mut values = photo.luma.clone();
        spread(&mut values, TAIL);
        let levels = pyramid(photo.width as usize, photo.height as usize, &values, COARSEST);
        let overview = Overview::new(photo, photo.width.max(photo.height).div_ceil(OVERVIEW) as usize);
        let density = Parzen { model_bins: model.signal.bins() + 1, photo_bins: PHOTO_BINS };
        Self { model, options, density, levels, overview }
    }

    /// Registers the photo from a rough view of the world, telling `observer` of each stage.
    ///
    /// # Errors
    /// If the model cannot be seen from the start, or the observer says stop.
    pub fn run(&self, start: &View, observer: &mut dyn FnMut(&Event) -> ControlFlow<()>) -> Result<Outcome, Error> {
        Ok(self.find(start, self.options.refine, observer)?.0)
    }

    /// [`run`](Self::run) with other parts of the camera refined, and what the verdict was built on.
    pub(crate) fn find(
        &self,
        start: &View,
        refine: Refine,
        observer: &mut dyn FnMut(&Event) -> ControlFlow<()>,
    ) -> Result<(Outcome, Findings), Error> {
        let start = self.model.inward(start);
        let coarsest = self.levels.len() - 1;
        let second = coarsest.saturating_sub(1);
        let mut sampler = Sampler::new(self.model.mesh, &*self.model.signal);
        let (start_similarity, _) = self.similarity(&mut sampler, &start).ok_or(Error::NothingVisible)?;
        let mut stages = Vec::new();
        let mut tell = |stage: Stage, view: &View| {
            let view = self.model.outward(view);
            let event = Event { done: stages.len() + 1, of: 3 + second, stage: stage.clone(), view };
            stages.push(stage);
            if observer(&event).is_break() { Err(Error::Stopped) } else { Ok(()) }
        };

        let began = Instant::now();
        let (mut views, renderings, evidence) = self.hypotheses(&start).ok_or(Error::NothingVisible)?;
        let name = format!("search 1/{}", self.overview.factor);
        tell(stage(name, began, 0, renderings, evidence), &start)?;

        let independent = self.options.metric.independent();
        let mut rival = 0.0;
        let mut across_levels = (0.0, 0.0);
        for (index, keep) in [(coarsest, FINALISTS), (second, 1)] {
            let began = Instant::now();
            let mut climbs: Vec<(f64, Climb)> = views
                .into_par_iter()
                .map_init(
                    || self.sampler(index),
                    |sampler, view| {
                        let climb = self.climb(sampler, index, &view, &start, refine)?;
                        let evidence = self.evidence(&mut Workspace::default(), &climb.view);
                        Some((climb.similarity.1 + evidence.map_or(0.0, Evidence::total), climb))
                    },
                )
                .flatten()
                .collect();
            climbs.sort_by(|a, b| b.0.total_cmp(&a.0));
            let climbs: Vec<Climb> = climbs.into_iter().map(|(_, climb)| climb).collect();
            let best = climbs.first().ok_or(Error::NothingVisible)?;
            let evaluations = climbs.iter().map(|climb| climb.evaluations).sum();
            let renderings = climbs.iter().map(|climb| climb.renderings).sum();
            tell(stage(climb_name(index), began, evaluations, renderings, best.similarity), &best.view)?;
            if index == coarsest {
                across_levels.0 = best.similarity.1 - independent;
            }
            let elsewhere =
                |climb: &&Climb| self.model.distance(&climb.view, &best.view) * self.levels[index].scale > APART;
            rival = climbs
                .iter()
                .find(elsewhere)
                .map_or(0.0, |climb| (climb.similarity.1 - independent) / (best.similarity.1 - independent));
            views = climbs.into_iter().take(keep).map(|climb| climb.view).collect();
        }

        let mut view = views[0];
        for index in (0..second).rev() {
            let began = Instant::now();
            let climb = self.climb(&mut sampler, index, &view, &start, refine).ok_or(Error::NothingVisible)?;
            view = climb.view;
            tell(stage(climb_name(index), began, climb.evaluations, climb.renderings, climb.similarity), &view)?;
        }

        let (similarity, covered) = self.similarity(&mut sampler, &view).unwrap_or_default();
        across_levels.1 = similarity - independent;
        let moved = self.model.distance(&start, &view);
        let findings = Findings { similarity: (start_similarity, similarity), moved, across_levels, rival, covered };
        let (status, reasons) = verdict(&findings);
        let (view, similarity) =
            if similarity > start_similarity { (view, similarity) } else { (start, start_similarity) };
        let similarity = (start_similarity, similarity);
        Ok((Outcome { view: self.model.outward(&view), status, reasons, similarity, stages }, findings))
    }

    /// The start and other views that might lie in the right basin; how many were looked at, and the evidence for the start
    /// and for the best.
    fn hypotheses(&self, start: &View) -> Option<(Vec<View>, usize, (f64, f64))> {
        let criteria: [fn(Evidence) -> f64; 2] = [|evidence| evidence.whole, Evidence::total];
        let search = Search { seed: self.options.seed, ..Search::default() };
        let level = self.levels.last()?;
        let seen =
            Sampler::new(&self.model.coarse, &*self.model.signal).sample(start, level, &Sampling::surface(2_000))?;
        let region = Region::around(&seen.points)?;
        let mut views = vec![*start];
        let mut looked = 0;
        let mut best = 0.0;
        for (k, criterion) in criteria.into_iter().enumerate() {
            let score = |workspace: &mut Workspace, view: &View| self.evidence(workspace, view).map(criterion);
            let found = search.around(start, &region, score);
            looked += found.len();
            best = found.first().map_or(best, |(score, _)| *score);
            for (_, view) in found {
                if views.len() == HYPOTHESES * (k + 1) / criteria.len() {
                    break;
                }
                if views.iter().all(|other| self.model.distance(other, &view) * level.scale > APART) {
                    views.push(view);
                }
            }
        }
        let before = self.evidence(&mut Workspace::default(), start).map_or(0.0, Evidence::total);
        Some((views, looked, (before, best)))
    }

    fn evidence(&self, workspace: &mut Workspace, view: &View) -> Option<Evidence> {
        self.overview.evidence(&self.model.coarse, &*self.model.signal, workspace, view)
    }

    /// The metric of a view at full size, over what it shows itself, and how many pixels show the model; `None` where none
    /// does.
    fn similarity(&self, sampler: &mut Sampler, view: &View) -> Option<(f64, f64)> {
        let samples = EFFORTS[EFFORTS.len() - 1].samples;
        let sampling = Sampling::with_halo(samples);
        let samples = sampler.sample(view, &self.levels[0], &sampling)?;
        let space = self.space(Refine::default());
        let value = self.objective(0, &samples, &space, view).value(view)?;
        Some((value, samples.covered as f64))
    }

    /// Climbs at one level; `None` where the view shows nothing of the model. `start` brings the expected camera.
    fn climb(&self, sampler: &mut Sampler, index: usize, from: &View, start: &View, refine: Refine) -> Option<Climb> {
        let level = &self.levels[index];
        let coarseness = self.levels.len() - 1 - index;
        let effort = EFFORTS[coarseness.min(EFFORTS.len() - 1)];
        let sampling = Sampling::with_halo(effort.samples);
        let space = self.space(if index < 2 { refine } else { Refine::default() });
        let solver = self.options.solver.solver(effort.iterations, effort.gain);
        let mut climb = Climb { view: *from, similarity: (0.0, 0.0), evaluations: 0, renderings: 0 };
        for rendering in 0..effort.renderings {
            let samples = sampler.sample(&climb.view, level, &sampling)?;
            let mut objective = self.objective(index, &samples, &space, start);
            let report = if self.options.solver == SolverName::StochasticGradient {
                let mut batches = Batches {
                    samples: &samples,
                    level,
                    density: &self.density,
                    metric: objective.metric,
                    space: &space,
                    prior: objective.prior,
                    seed: self.options.seed,
                    batch: samples.clone(),
                };
                let before = objective.value(&climb.view)?;
                let report = solver.maximize(&space, &mut batches, climb.view, &mut |_| ())?;
                // What counts is the whole; a batch's maximum may be none of its.
                let after = objective.value(&report.point).filter(|after| *after > before);
                let point = if after.is_some() { report.point } else { climb.view };
                climb.evaluations += report.iterations.len();
                Report { point, start: before, value: after.unwrap_or(before), ..report }
            } else {
                solver.maximize(&space, &mut objective, climb.view, &mut |_| ())?
            };
            climb.evaluations += objective.evaluations;
            climb.renderings += 1;
            if rendering == 0 {
                climb.similarity.0 = report.start;
            }
            climb.similarity.1 = report.value;
            let moved = self.model.distance(&climb.view, &report.point) * level.scale;
            climb.view = report.point;
            if moved < SETTLED {
                break;
            }
        }
        Some(climb)
    }

    /// A sampler of the model as a level shows it: the coarse copy on the coarsest.
    fn sampler(&self, index: usize) -> Sampler<'_> {
        let coarsest = index + 1 == self.levels.len();
        Sampler::new(if coarsest { &self.model.coarse } else { self.model.mesh }, &*self.model.signal)
    }

    fn space(&self, refine: Refine) -> ViewSpace<'_> {
        ViewSpace { rotation: self.options.rotation.chart(), refine }
    }

    fn objective<'b>(
        &'b self,
        index: usize,
        samples: &'b SurfaceSamples,
        space: &'b ViewSpace<'b>,
        expected: &View,
    ) -> PhotoObjective<'b> {
        let prior = Prior { camera: expected.camera, weight: PRIOR };
        PhotoObjective::new(samples, &self.levels[index], &self.density, self.options.metric.metric(), space, prior)
    }
}

fn climb_name(index: usize) -> String {
    format!("climb 1/{}", 1 << index)
}

fn stage(name: String, began: Instant, evaluations: usize, renderings: usize, similarity: (f64, f64)) -> Stage {
    Stage { name, evaluations, renderings, similarity, milliseconds: began.elapsed().as_secs_f64() * 1e3 }
}
