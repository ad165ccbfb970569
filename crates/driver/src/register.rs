//! Algorithm 2 of the thesis for one photo, and Algorithm 1 where parts of the camera are refined as well: from a rough view to
//! the one that maximizes the metric.
//!
//! 1. A search over small renderings finds views that might lie in the right basin.
//! 2. Each climbs on the coarsest level of the photo; the best, and that of the start, climb on the second. From there on the
//!    agreement of the model's edges with the photo's counts as well.
//! 3. The best of these climbs through the finer levels to the full photo, and with it one elsewhere as long as that comes near.
//!    Only on the last two levels are parts of the camera let go.
//!
//! To climb is to render, to take samples, and to maximize the metric over them, until a new rendering changes nothing. Views are
//! compared by the metric over the model and a band of background in a fixed proportion to it, less what chance explains: a
//! small picture in many cells looks well explained by anything.
//!
//! Where the end is in doubt, or far from the start, a wider search follows, and the better end counts. With no start at all, a
//! survey of the model from everywhere takes the place of the search. Inside a scan, and where coarse levels led away from a start
//! that is better than their end, the start itself climbs, from each level down.

mod anywhere;

pub use anywhere::search;

use crate::bounds::Limits;
use crate::channel::channel;
use crate::climb::Batches;
use crate::contour::Silhouette;
use crate::mask::silhouette;
use crate::model::{Model, surrounds};
use crate::objective::{PhotoObjective, Prior};
use crate::outcome::{Event, Outcome, Stage};
use crate::overview::{Evidence, Overview, Workspace};
use crate::parameters::ViewSpace;
use crate::pyramid::{Level, pyramid, spread};
use crate::samples::{Sampler, Sampling, SurfaceSamples};
use crate::search::{Region, Search};
use crate::uncertainty::{Witness, uncertainties};
use crate::verdict::{Findings, verdict};
use crate::{BinsName, Error, MetricName, Options, Photo, Refine, SolverName, Status};
use nalgebra::DVector;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::time::Instant;
use texreg_camera::{Camera, View};
use texreg_mi::{Parzen, ranks};
use texreg_optim::{Objective, Report, Stop};
use texreg_surface::Mesh;

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
    pub(crate) model: &'a Model<'a>,
    pub(crate) photo: &'a Photo,
    pub(crate) options: &'a Options,
    density: Parzen,
    /// The photo, full size first.
    pub(crate) levels: Vec<Level>,
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

/// The number of colours it is reduced to.
const COLOURS: usize = 24;

/// Views that climb on the coarsest level, and of these on the second.
const HYPOTHESES: usize = 10;
const FINALISTS: usize = 5;

/// So many views go on from the second level, and to each finer one, as long as their excess over chance is this share of the best's.
const RIVALS: usize = 2;
const RIVALRY: f64 = 0.9;

/// Views that differ by less than this many pixels of the coarsest level fall into the same basin.
const APART: f64 = 2.0;

/// The renewed rendering of a view that moved by less than this many pixels of a level shows nothing new.
pub(crate) const SETTLED: f64 = 0.05;

/// What the camera's prior weighs against a photo: a thousand of its samples are independent.
pub(crate) const PRIOR: f64 = 1e-3;

/// How much work a level is worth.
#[derive(Clone, Copy)]
pub(crate) struct Effort {
    pub(crate) samples: usize,
    pub(crate) renderings: usize,
    pub(crate) iterations: usize,
    /// The gain, in nats, below which climbing stops.
    pub(crate) gain: f64,
}

/// From the coarsest level to the finest; the last holds for all that follow.
pub(crate) const EFFORTS: [Effort; 3] = [
    Effort { samples: 3_000, renderings: 2, iterations: 10, gain: 1e-4 },
    Effort { samples: 8_000, renderings: 3, iterations: 10, gain: 1e-4 },
    Effort { samples: 30_000, renderings: 4, iterations: 15, gain: 1e-5 },
];

/// The search that follows where the first one's end is in doubt or farther from the start than this many of its standard
/// deviations.
const WIDER: Search = Search { rounds: 6, views: 200, elite: 25, deviation: 0.25, seed: 0 };
const FAR: f64 = 1.75;

/// Tells of each stage and keeps it.
struct Course<'a, 'b> {
    registration: &'a Registration<'a>,
    stages: Vec<Stage>,
    of: usize,
    observer: &'b mut dyn FnMut(&Event) -> ControlFlow<()>,
}

impl Course<'_, '_> {
    fn tell(&mut self, stage: Stage, view: &View) -> Result<(), Error> {
        let view = self.registration.model.outward(view);
        let event = Event { done: self.stages.len() + 1, of: self.of, stage: stage.clone(), view };
        self.stages.push(stage);
        if (self.observer)(&event).is_break() { Err(Error::Stopped) } else { Ok(()) }
    }
}

/// What a search around a rough view found.
struct Nearby {
    /// That view, and the best in other basins.
    views: Vec<View>,
    /// How many were looked at.
    looked: usize,
    /// The best's evidence.
    best: f64,
}

/// What a race sets out with.
struct Field {
    views: Vec<View>,
    /// Brings the expected camera.
    start: View,
    refine: Refine,
    /// How many go on from the coarsest level to the second.
    finalists: usize,
    /// Whether the first view has climbed already: where it alone is left, nothing is to be gained.
    has_climbed: bool,
    /// What ranks climbs, with the metric: the evidence for a view in the small picture.
    evidence: fn(&Registration, &View) -> f64,
}

/// A view in a race.
#[derive(Clone, Copy)]
struct Runner {
    view: View,
    /// The gain of its climb on the coarsest level.
    coarse: f64,
    /// Why its last climb stopped.
    stop: Stop,
    /// Whether it set out from the first of the views, the one that was hoped for.
    is_first: bool,
}

/// Where a race ended.
struct Finish {
    view: View,
    /// Why the last climb to it stopped.
    stop: Stop,
    /// The metric at full size.
    similarity: Similarity,
    /// The gain of the view's climb on the coarsest level.
    coarse: f64,
    /// The excess of the best view elsewhere as a share of the best's, on the last level that both climbed.
    rival: f64,
}

/// The metric of a view over what it shows itself.
#[derive(Clone, Copy, Default)]
pub(crate) struct Similarity {
    pub(crate) value: f64,
    /// The value over that of a model that tells nothing of the photo.
    pub(crate) gain: f64,
    /// The value over what chance explains of the samples.
    pub(crate) excess: f64,
    /// Pixels of the photo that show the model.
    pub(crate) covered: f64,
}

/// A view that climbed, and how.
#[derive(Clone, Copy)]
pub(crate) struct Climb {
    pub(crate) view: View,
    pub(crate) stop: Stop,
    similarity: (f64, f64),
    /// The metric at the end over that of a model that tells nothing of the photo, and over what chance explains of the samples.
    gain: f64,
    excess: f64,
    evaluations: usize,
    renderings: usize,
}

impl<'a> Registration<'a> {
    /// Makes a photo ready.
    pub fn new(model: &'a Model, photo: &'a Photo, options: &'a Options) -> Self {
        let levels = levels(photo, options);
        let overview = Overview::new(photo, OVERVIEW, COLOURS);
        let density = Parzen { model_bins: model.signal.bins() + 1, photo_bins: PHOTO_BINS };
        Self { model, photo, options, density, levels, overview }
    }

    /// Registers the photo from a rough view of the world, telling `observer` of each stage.
    ///
    /// # Errors
    /// If the model cannot be seen from the start, or the observer says stop.
    pub fn run(&self, start: &View, observer: &mut dyn FnMut(&Event) -> ControlFlow<()>) -> Result<Outcome, Error> {
        let (outcome, _) = self.find(start, self.options.refine, observer)?;
        Ok(self.assured(outcome, &start.camera))
    }

    /// An outcome with how sure its view is; `expected` is the camera it started with.
    fn assured(&self, mut outcome: Outcome, expected: &Camera) -> Outcome {
        if outcome.status != Status::Failed {
            let witness = Witness::new(self, &self.model.inward(&outcome.view), self.options.refine, expected, PRIOR);
            let found = witness.and_then(|witness| uncertainties(&[witness], 0, &DVector::zeros(0)).pop().flatten());
            outcome.attach(found);
        }
        outcome
    }

    /// [`run`](Self::run) with other parts of the camera refined, and what the verdict was built on.
    pub(crate) fn find(
        &self,
        start: &View,
        refine: Refine,
        observer: &mut dyn FnMut(&Event) -> ControlFlow<()>,
    ) -> Result<(Outcome, Findings), Error> {
        let start = self.limits(refine, &start.camera).held(&self.model.inward(start));
        let mut sampler = Sampler::new(self.model.mesh, &*self.model.signal);
        let at_start = self.similarity(&mut sampler, &start).ok_or(Error::NothingVisible)?.value;
        let of = 1 + self.levels.len().max(2);
        let mut course = Course { registration: self, stages: Vec::new(), of, observer };

        if surrounds(self.model.mesh, &start) {
            course.of = self.levels.len();
            // From inside, views elsewhere show other things, and less of them predicts a photo better: they do not compare.
            let finish = self.descend(&mut sampler, &start, refine, &mut course)?;
            let findings = self.findings(&finish, refine, &start, at_start);
            return Ok((self.outcome(&finish, &start, &findings, course.stages), findings));
        }

        let began = Instant::now();
        let Nearby { views, looked, best } = self.nearby(&start).ok_or(Error::NothingVisible)?;
        let evidence = |registration: &Registration, view: &View| {
            registration.evidence(&mut Workspace::default(), view).map_or(0.0, |evidence| evidence.total())
        };
        let before = evidence(self, &start);
        course.tell(stage(self.search_name(), began, 0, looked, (before, best)), &start)?;
        let mut field = Field { views, start, refine, finalists: FINALISTS, has_climbed: false, evidence };
        let mut finish = self.race(&mut sampler, &field, &mut course)?.ok_or(Error::NothingVisible)?;
        if finish.similarity.value <= at_start {
            course.of += self.levels.len();
            finish = self.descend(&mut sampler, &start, refine, &mut course)?;
        }
        let mut findings = self.findings(&finish, refine, &start, at_start);

        let step = self.region(&start).map_or(0.0, |region| region.step(&start, &finish.view));
        let far = step > FAR * Search::default().deviation;
        if far || verdict(&findings).0 != Status::Registered {
            course.of += self.levels.len() + 1;
            let began = Instant::now();
            let wider = Search { seed: self.options.seed, ..WIDER };
            let Model { coarse, .. } = self.model;
            let look = |workspace: &mut Workspace, view: &View| self.peak(&self.overview, coarse, 0.0, workspace, view);
            let [found] = self.around(&start, &wider, look, [|peak| *peak]).ok_or(Error::NothingVisible)?;
            let best = found.first().map_or(0.0, |(score, _)| *score);
            let held = self.prominence(&finish.view, 0.0);
            course.tell(stage(self.search_name(), began, 0, found.len(), (held, best)), &finish.view)?;
            field.views = self.distinct(&finish.view, &[found]);
            field.has_climbed = true;
            field.evidence = |registration, view| registration.prominence(view, 0.0);
            let worth = |finish: &Finish| finish.similarity.excess + self.prominence(&finish.view, 0.0);
            let wide = self.race(&mut sampler, &field, &mut course)?;
            if let Some(wide) = wide.filter(|wide| worth(wide) > worth(&finish)) {
                finish = wide;
                findings = self.findings(&finish, refine, &start, at_start);
            }
        }
        Ok((self.outcome(&finish, &start, &findings, course.stages), findings))
    }

    fn findings(&self, finish: &Finish, refine: Refine, start: &View, at_start: f64) -> Findings {
        Findings {
            metric: self.options.metric,
            similarity: (at_start, finish.similarity.value),
            moved: self.model.distance(start, &finish.view),
            across_levels: (finish.coarse, finish.similarity.gain),
            rival: finish.rival,
            covered: finish.similarity.covered,
            shared: None,
            at_bound: self.limits(refine, &start.camera).reached(&finish.view),
        }
    }

    /// What to hand back: the finish, or the start where that is no worse.
    fn outcome(&self, finish: &Finish, start: &View, findings: &Findings, stages: Vec<Stage>) -> Outcome {
        let (status, reasons) = verdict(findings);
        let at_start = findings.similarity.0;
        let (view, end) = if finish.similarity.value > at_start {
            (&finish.view, finish.similarity.value)
        } else {
            (start, at_start)
        };
        let view = self.model.outward(view);
        Outcome { view, status, reasons, similarity: (at_start, end), stop: finish.stop, uncertainty: None, stages }
    }

    /// Climbs from a view itself, without looking around: from each level down to the full photo, for what a coarse level
    /// shows can mislead. The best end counts.
    fn descend(
        &self,
        sampler: &mut Sampler,
        start: &View,
        refine: Refine,
        course: &mut Course,
    ) -> Result<Finish, Error> {
        let mut best: Option<(Similarity, Climb)> = None;
        for top in (0..self.levels.len()).rev() {
            let began = Instant::now();
            let climb = self.straight(sampler, top, start, refine).ok_or(Error::NothingVisible)?;
            let end = (self.similarity(sampler, &climb.view).unwrap_or_default(), climb);
            let held = best.unwrap_or(end);
            let now = if end.0.excess > held.0.excess { end } else { held };
            let similarity = (held.0.value, now.0.value);
            let stage = stage(climb_name(top), began, climb.evaluations, climb.renderings, similarity);
            course.tell(stage, &now.1.view)?;
            best = Some(now);
        }
        let (similarity, Climb { view, stop, .. }) = best.ok_or(Error::NothingVisible)?;
        let coarse = self.coarse_similarity(&view).unwrap_or_default().gain;
        Ok(Finish { view, stop, similarity, coarse, rival: 0.0 })
    }

    /// Several views climb, and the best goes on to the full photo, with those elsewhere that come near it. `None` where the first
    /// has climbed already and no other stays in the race.
    fn race(&self, sampler: &mut Sampler, field: &Field, course: &mut Course) -> Result<Option<Finish>, Error> {
        let coarsest = self.levels.len() - 1;
        let second = coarsest.saturating_sub(1);
        let runner = |(i, &view)| Runner { view, coarse: 0.0, stop: Stop::Converged, is_first: i == 0 };
        let mut runners: Vec<Runner> = field.views.iter().enumerate().map(runner).collect();
        let mut rival = 0.0;
        for index in std::iter::once(coarsest).chain((0..=second).rev()) {
            let began = Instant::now();
            let mesh = if index == coarsest { &self.model.coarse } else { self.model.mesh };
            let run = |sampler: &mut Sampler, runner: Runner| {
                let climb = self.climb(sampler, index, &runner.view, &field.start, field.refine)?;
                let evidence = if index < second { 0.0 } else { (field.evidence)(self, &climb.view) };
                let coarse = if index == coarsest { climb.gain } else { runner.coarse };
                Some((climb.excess + evidence, Runner { view: climb.view, coarse, stop: climb.stop, ..runner }, climb))
            };
            let mut ends: Vec<(f64, Runner, Climb)> = if runners.len() == 1 {
                runners.into_iter().filter_map(|runner| run(sampler, runner)).collect()
            } else {
                let own = || Sampler::new(mesh, &*self.model.signal);
                runners.into_par_iter().map_init(own, run).flatten().collect()
            };
            ends.sort_by(|a, b| b.0.total_cmp(&a.0));
            let (_, first, best) = ends.first().ok_or(Error::NothingVisible)?;
            let evaluations = ends.iter().map(|(.., climb)| climb.evaluations).sum();
            let renderings = ends.iter().map(|(.., climb)| climb.renderings).sum();
            course.tell(stage(climb_name(index), began, evaluations, renderings, best.similarity), &best.view)?;
            let scale = self.levels[index.max(second)].scale;
            let apart = |a: &View, b: &View| self.model.distance(a, b) * scale > APART;
            let (most, least) =
                if index == coarsest { (field.finalists, f64::MIN) } else { (RIVALS, RIVALRY * best.excess) };
            runners = vec![*first];
            for (_, runner, climb) in &ends {
                let is_kept = runners.len() < most && climb.excess >= least || index == coarsest && runner.is_first;
                if is_kept && runners.iter().all(|other| apart(&other.view, &runner.view)) {
                    runners.push(*runner);
                }
            }
            if ends.len() > 1 {
                // Rivals that came to the same end are none.
                let elsewhere = ends.iter().find(|(_, runner, _)| apart(&runner.view, &best.view));
                rival = elsewhere.map_or(0.0, |(.., climb)| climb.excess / best.excess);
            }
            if field.has_climbed && index == second && runners.len() == 1 && !apart(&runners[0].view, &field.views[0]) {
                return Ok(None);
            }
        }
        let Runner { view, coarse, stop, .. } = runners[0];
        let similarity = self.similarity(sampler, &view).unwrap_or_default();
        Ok(Some(Finish { view, stop, similarity, coarse, rival }))
    }

    /// What is climbed on a level: edges count on all but the coarsest.
    pub(crate) fn metric_at(&self, index: usize) -> MetricName {
        let metric = self.options.metric;
        // A cloud's squares have edges of their own.
        let has_edges = index + 1 < self.levels.len() && !self.model.mesh.is_cloud;
        metric.finer().filter(|_| has_edges).unwrap_or(metric)
    }

    /// What might lie in the right basin around a rough view; `None` where the model is not in sight.
    fn nearby(&self, start: &View) -> Option<Nearby> {
        let narrow = Search { seed: self.options.seed, ..Search::default() };
        let look = |workspace: &mut Workspace, view: &View| self.evidence(workspace, view);
        let criteria: [fn(&Evidence) -> f64; 2] = [|evidence| evidence.whole, Evidence::total];
        let found = self.around(start, &narrow, look, criteria)?;
        let [whole, total] = [found[0].len(), found[1].len()];
        let looked = whole + total - narrow.views.min(whole).min(total);
        let best = found[1].first().map_or(0.0, |(score, _)| *score);
        Some(Nearby { views: self.distinct(start, &found), looked, best })
    }

    /// The views that a search around one of them looked at, by each criterion, the best first; `None` where the model is not in
    /// sight.
    fn around<E: Send, const N: usize>(
        &self,
        start: &View,
        search: &Search,
        look: impl Fn(&mut Workspace, &View) -> Option<E> + Sync,
        criteria: [fn(&E) -> f64; N],
    ) -> Option<[Vec<(f64, View)>; N]> {
        let region = self.region(start)?;
        let limits = self.limits(Refine::default(), &start.camera);
        let look = |workspace: &mut Workspace, view: &View| look(workspace, &limits.held(view));
        let mut found = search.around(start, &region, look, criteria);
        found.iter_mut().flatten().for_each(|(_, view)| *view = limits.held(view));
        Some(found)
    }

    /// The part of the model that a view shows.
    fn region(&self, view: &View) -> Option<Region> {
        let level = self.levels.last()?;
        let seen =
            Sampler::new(&self.model.coarse, &*self.model.signal).sample(view, level, &Sampling::surface(2_000))?;
        Region::around(&seen.points)
    }

    /// A view and the best found ones, the same number from each list, that might lie in different basins.
    fn distinct(&self, first: &View, found: &[Vec<(f64, View)>]) -> Vec<View> {
        let apart = APART / self.levels[self.levels.len() - 1].scale;
        let mut views = vec![*first];
        for (k, list) in found.iter().enumerate() {
            self.extend(&mut views, list, apart, HYPOTHESES * (k + 1) / found.len());
        }
        views
    }

    /// Adds to views the best found that are each `apart` pixels of the photo from all before, up to `most`.
    fn extend(&self, views: &mut Vec<View>, found: &[(f64, View)], apart: f64, most: usize) {
        for (_, view) in found {
            if views.len() >= most {
                break;
            }
            if views.iter().all(|other| self.model.distance(other, view) > apart) {
                views.push(*view);
            }
        }
    }

    fn search_name(&self) -> String {
        format!("search 1/{}", self.overview.factor)
    }

    fn evidence(&self, workspace: &mut Workspace, view: &View) -> Option<Evidence> {
        self.overview.evidence(&self.model.coarse, &*self.model.signal, workspace, view)
    }

    /// How far a view stands out from the same picture in other places, times the share of the model that lies in the photo; an
    /// outline's edges count as much as `edges` nats.
    fn peak(
        &self,
        overview: &Overview,
        mesh: &Mesh,
        edges: f64,
        workspace: &mut Workspace,
        view: &View,
    ) -> Option<f64> {
        Some(overview.peak(mesh, &*self.model.rough, edges, workspace, view)? * self.model.inside(view))
    }

    /// [`peak`](Self::peak) in the picture that is searched, and zero for a view that shows nothing.
    fn prominence(&self, view: &View, edges: f64) -> f64 {
        self.peak(&self.overview, &self.model.coarse, edges, &mut Workspace::default(), view).unwrap_or(0.0)
    }

    /// Climbs through the levels from a view that is near already, without looking around: for comparisons of solvers and
    /// charts. The view, and how often the metric was evaluated; `None` where the view shows nothing of the model.
    pub fn climb_from(&self, start: &View) -> Option<(View, usize)> {
        let start = self.limits(self.options.refine, &start.camera).held(&self.model.inward(start));
        let mut sampler = Sampler::new(self.model.mesh, &*self.model.signal);
        let top = self.levels.len() - 1;
        let climb = self.straight(&mut sampler, top, &start, self.options.refine)?;
        Some((self.model.outward(&climb.view), climb.evaluations))
    }

    /// Climbs from a view through the levels from `top` down to the full photo: the last climb, with the evaluations and renderings
    /// of all; `None` where a view on the way shows nothing of the model.
    fn straight(&self, sampler: &mut Sampler, top: usize, start: &View, refine: Refine) -> Option<Climb> {
        let mut last = self.climb(sampler, top, start, start, refine)?;
        for index in (0..top).rev() {
            let Climb { view, evaluations, renderings, .. } = last;
            last = self.climb(sampler, index, &view, start, refine)?;
            last.evaluations += evaluations;
            last.renderings += renderings;
        }
        Some(last)
    }

    /// The metric of a view at full size; `None` where it shows nothing of the model.
    pub(crate) fn similarity(&self, sampler: &mut Sampler, view: &View) -> Option<Similarity> {
        self.similarity_at(0, EFFORTS[EFFORTS.len() - 1].samples, sampler, view)
    }

    /// The metric of a view on the coarsest level; `None` where it shows nothing of the model.
    pub(crate) fn coarse_similarity(&self, view: &View) -> Option<Similarity> {
        let mut sampler = Sampler::new(&self.model.coarse, &*self.model.signal);
        self.similarity_at(self.levels.len() - 1, EFFORTS[0].samples, &mut sampler, view)
    }

    fn similarity_at(&self, index: usize, samples: usize, sampler: &mut Sampler, view: &View) -> Option<Similarity> {
        let sampling = Sampling::with_halo(samples, self.options.metric);
        let samples = sampler.sample(view, &self.levels[index], &sampling)?;
        let space = self.space(Refine::default(), &view.camera);
        let mut objective = self.objective(index, &samples, &space, &view.camera, 0.0);
        let value = objective.value(view)?;
        let [gain, excess] = objective.independent(view)?.map(|none| value - none);
        Some(Similarity { value, gain, excess, covered: samples.covered as f64 })
    }

    /// Climbs at one level; `None` where the view shows nothing of the model. `start` brings the expected camera.
    pub(crate) fn climb(
        &self,
        sampler: &mut Sampler,
        index: usize,
        from: &View,
        start: &View,
        refine: Refine,
    ) -> Option<Climb> {
        let level = &self.levels[index];
        let effort = EFFORTS[(self.levels.len() - 1 - index).min(EFFORTS.len() - 1)];
        let sampling = Sampling::with_halo(effort.samples, self.metric_at(index));
        let space = self.space(if index < 2 { refine } else { Refine::default() }, &start.camera);
        let solver = self.options.solver.solver(1, effort.iterations, effort.gain);
        let mut climb = Climb {
            view: *from,
            stop: Stop::Converged,
            similarity: (0.0, 0.0),
            gain: 0.0,
            excess: 0.0,
            evaluations: 0,
            renderings: 0,
        };
        for rendering in 0..effort.renderings {
            let samples = sampler.sample(&climb.view, level, &sampling)?;
            let mut objective = self.objective(index, &samples, &space, &start.camera, PRIOR);
            let report = if self.options.solver == SolverName::StochasticGradient {
                let mut batches = Batches {
                    samples: &samples,
                    level,
                    density: &self.density,
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
            (climb.view, climb.stop) = (report.point, report.stop);
            if moved < SETTLED || rendering + 1 == effort.renderings {
                [climb.gain, climb.excess] = objective.independent(&report.point)?.map(|none| report.value - none);
                break;
            }
        }
        Some(climb)
    }

    /// What views are kept to: `expected` is the camera they start with.
    pub(crate) fn limits(&self, refine: Refine, expected: &Camera) -> Limits {
        Limits::new(&self.options.bounds, refine, expected, self.model.centre)
    }

    pub(crate) fn space(&self, refine: Refine, expected: &Camera) -> ViewSpace<'_> {
        ViewSpace { rotation: self.options.rotation.chart(), refine, limits: self.limits(refine, expected) }
    }

    pub(crate) fn objective<'b>(
        &'b self,
        index: usize,
        samples: &'b SurfaceSamples,
        space: &'b ViewSpace<'b>,
        expected: &Camera,
        weight: f64,
    ) -> PhotoObjective<'b> {
        let prior = Prior { camera: *expected, focal_from: self.options.focal_from, weight };
        PhotoObjective::new(samples, &self.levels[index], &self.density, space, prior)
    }
}

/// The photo as the metric reads it.
fn levels(photo: &Photo, options: &Options) -> Vec<Level> {
    let (width, height) = (photo.width as usize, photo.height as usize);
    let mut values = channel(photo, options.channel);
    match options.bins {
        BinsName::Width => spread(&mut values, TAIL),
        BinsName::Rank => ranks(&mut values),
    }
    let mut levels = pyramid(width, height, &values, COARSEST);
    if options.metric.has_silhouettes() {
        for (level, mask) in levels.iter_mut().zip(pyramid(width, height, &silhouette(photo), COARSEST)) {
            let mask: Vec<f32> = (0..level.height).flat_map(|y| mask.row(y).iter().copied()).collect();
            level.silhouette = Some(Silhouette::new(level.width, level.height, &mask));
        }
    }
    levels
}

fn climb_name(index: usize) -> String {
    format!("climb 1/{}", 1 << index)
}

pub(crate) fn stage(
    name: String,
    began: Instant,
    evaluations: usize,
    renderings: usize,
    similarity: (f64, f64),
) -> Stage {
    Stage { name, evaluations, renderings, similarity, milliseconds: began.elapsed().as_secs_f64() * 1e3 }
}
