//! The thesis' Algorithms 1 and 2 with the photos joint: one criterion for all views, and one lens where one camera took them.
//!
//! 1. Each photo is found alone, with its own lens.
//! 2. The photos that were found climb together through the fine levels: [`RigObjective`] adds what pairs of photos tell of
//!    each other, and a shared lens starts at the median of theirs. Where fewer than two were found, those in doubt come along.
//! 3. Photos that were not found are looked for again with the shared lens, and join if they are found now. A photo that the
//!    shared lens explains much worse than its own keeps its own, with the verdict saying so.
//! 4. Together once more, at full size.

use crate::objective::Prior;
use crate::outcome::{Event, Outcome, Stage, Status};
use crate::pair::{DepthMap, Overlap, PairObjective, Sight, overlaps};
use crate::parameters::ViewSpace;
use crate::register::{EFFORTS, PRIOR, Registration, SETTLED, Similarity, stage};
use crate::rig::{RigObjective, RigSpace};
use crate::samples::{Sampler, Sampling, SurfaceSamples};
use crate::uncertainty::{Witness, uncertainties};
use crate::verdict::{Findings, verdict};
use crate::{Error, Options, Refine, Uncertainty};
use nalgebra::DVector;
use std::ops::ControlFlow;
use std::time::Instant;
use texreg_camera::{Camera, View};
use texreg_optim::{Objective, Stop};

/// The coarsest level on which photos climb together; above it each finds its way alone.
const COARSEST: usize = 2;

/// A photo that keeps less than this share of its metric with the shared lens was taken with another.
const SHARING: f64 = 0.9;

/// How often photos that were not found are looked for again.
const ROUNDS: usize = 2;

/// Registers photos jointly, each from a rough view of the world, telling `observer` of each stage. Outcomes are in the photos'
/// order, which changes none of them; with [`share_intrinsics`](Options::share_intrinsics) the cameras of all photos that go with the
/// others are equal.
/// Together they climb by the options' solver; stochastic gradients look at all samples there, for batches are of one photo.
///
/// # Errors
/// If the model cannot be seen from a start, or the observer says stop: the index of the photo, and the cause.
///
/// # Panics
/// If the numbers of photos and starts differ.
pub fn register_jointly(
    photos: &[Registration],
    starts: &[View],
    options: &Options,
    observer: &mut dyn FnMut(&Event) -> ControlFlow<()>,
) -> Result<Vec<Outcome>, (usize, Error)> {
    assert_eq!(photos.len(), starts.len(), "one start a photo");
    // By their names: sums in another order would round otherwise, and lead elsewhere by a little.
    let mut order: Vec<usize> = (0..photos.len()).collect();
    order.sort_by(|&i, &j| photos[i].photo.file.cmp(&photos[j].photo.file));
    let (mut done, mut of) = (0, 0);
    let mut found = Vec::new();
    for (k, &i) in order.iter().enumerate() {
        let photo = &photos[i];
        let mut forward = |event: &Event| {
            (done, of) = (k * event.of + event.done, photos.len() * (event.of + COARSEST + 1));
            observer(&Event { done, of, ..event.clone() })
        };
        let start = photo.limits(options.refine, &starts[i].camera).held(&photo.model.inward(&starts[i]));
        let found_alone = photo.find(&starts[i], options.refine, &mut forward);
        let (outcome, findings) = found_alone.map_err(|error| (i, error))?;
        let view = photo.model.inward(&outcome.view);
        found.push(Found { start, view, outcome, findings, apart: false });
    }
    let lens = median(found.iter().map(|found: &Found| found.start.camera));
    let mut joint = Joint { photos: order.iter().map(|&i| &photos[i]).collect(), options, lens, found };
    let ran = joint.run(&mut |stage, view| {
        done = (done + 1).min(of);
        let event = Event { done, of, stage: stage.clone(), view: *view };
        if observer(&event).is_break() { Err(Error::Stopped) } else { Ok(()) }
    });
    ran.map_err(|(k, error)| (order[k], error))?;
    let mut outcomes: Vec<(usize, Outcome)> =
        order.into_iter().zip(joint.found).map(|(i, found)| (i, found.outcome)).collect();
    outcomes.sort_by_key(|&(i, _)| i);
    Ok(outcomes.into_iter().map(|(_, outcome)| outcome).collect())
}

/// A photo on its way; views are of the model's frame.
struct Found {
    start: View,
    view: View,
    outcome: Outcome,
    findings: Findings,
    /// Whether it was taken with another lens.
    apart: bool,
}

struct Joint<'a> {
    photos: Vec<&'a Registration<'a>>,
    options: &'a Options,
    /// What photos of one camera are expected to have: the median of the starts'.
    lens: Camera,
    found: Vec<Found>,
}

/// Tells of a stage and one of its views.
type Tell<'a> = dyn FnMut(&Stage, &View) -> Result<(), Error> + 'a;

impl Joint<'_> {
    fn run(&mut self, tell: &mut Tell) -> Result<(), (usize, Error)> {
        let statuses: Vec<Status> = self.found.iter().map(|found| found.outcome.status).collect();
        let mut together = company(&statuses);
        if self.shared() {
            let lens = median(together.iter().map(|&i| self.found[i].view.camera));
            (0..self.found.len())
                .for_each(|i| self.found[i].view = self.held(i, &with_lens(&self.found[i].view, lens)));
        }
        for index in (1..=COARSEST).rev() {
            self.climb(&together, index, tell)?;
        }
        for _ in 0..ROUNDS {
            let members = self.regroup(&together);
            if members == together {
                break;
            }
            together = members;
            self.climb(&together, 1, tell)?;
        }
        self.climb(&together, 0, tell)?;
        for i in 0..self.found.len() {
            if !together.contains(&i) && self.shared() && !self.found[i].apart {
                let lens = self.found[together[0]].view.camera;
                self.found[i].view = self.held(i, &with_lens(&self.found[i].view, lens));
                self.settle(i);
            }
            self.judge(i);
        }
        self.doubt(&together);
        Ok(())
    }

    /// The camera that a photo is expected to have.
    fn expected(&self, i: usize) -> Camera {
        if self.shared() && !self.found[i].apart { self.lens } else { self.found[i].start.camera }
    }

    /// A photo's view within the bounds.
    fn held(&self, i: usize, view: &View) -> View {
        self.photos[i].limits(self.options.refine, &self.expected(i)).held(view)
    }

    fn shared(&self) -> bool {
        self.options.share_intrinsics && self.options.refine != Refine::default()
    }

    /// Looks again for the photos that do not climb with the others, and at those that do: who goes with the shared lens.
    fn regroup(&mut self, together: &[usize]) -> Vec<usize> {
        if !self.shared() {
            return together.to_vec();
        }
        let lens = self.found[together[0]].view.camera;
        let now: Vec<f64> = together.iter().map(|&i| self.similarity(i).value).collect();
        let alone = |i: usize| self.found[i].findings.similarity.1;
        let worse: Vec<(usize, f64)> =
            together.iter().copied().zip(now).filter(|&(i, now)| now < SHARING * alone(i)).collect();
        let mut members = together.to_vec();
        // A lens that most photos are worse with is not theirs.
        if 2 * worse.len() < together.len() {
            for (i, now) in worse {
                let found = &mut self.found[i];
                found.findings.shared = Some((now, found.findings.similarity.1));
                found.apart = true;
                found.view = self.photos[i].model.inward(&found.outcome.view);
                members.retain(|&member| member != i);
            }
        }
        for i in 0..self.found.len() {
            if !members.contains(&i) && !self.found[i].apart && self.find_again(i, lens) {
                members.push(i);
            }
        }
        members.sort_unstable();
        members
    }

    /// Looks for a photo with a given lens; whether it is found now.
    fn find_again(&mut self, i: usize, lens: Camera) -> bool {
        let (photo, found) = (self.photos[i], &mut self.found[i]);
        // The start's distance may go with its own lens or be right as it is.
        let starts = [with_lens(&found.start, lens), View { camera: lens, pose: found.start.pose }];
        let mut best: Option<(Outcome, Findings)> = None;
        for start in &starts {
            let found = photo.find(&photo.model.outward(start), Refine::default(), &mut |_| ControlFlow::Continue(()));
            let better = |(_, findings): &(Outcome, Findings)| {
                best.as_ref().is_none_or(|(_, before)| findings.similarity.1 > before.similarity.1)
            };
            best = found.ok().filter(better).or(best);
            if best.as_ref().is_some_and(|(outcome, _)| outcome.status == Status::Registered) {
                break;
            }
        }
        let Some((outcome, findings)) = best else { return false };
        let start = found.findings.similarity.0;
        found.findings = Findings { similarity: (start, findings.similarity.1), ..findings };
        found.view = photo.model.inward(&outcome.view);
        let mut stages = std::mem::take(&mut found.outcome.stages);
        stages.extend(outcome.stages);
        found.outcome = Outcome { stages, ..outcome };
        found.outcome.status == Status::Registered
    }

    /// Climbs with some of the photos at one level.
    fn climb(&mut self, together: &[usize], index: usize, tell: &mut Tell) -> Result<(), (usize, Error)> {
        let began = Instant::now();
        let level = |i: usize| index.min(self.photos[i].levels.len() - 1);
        let effort = EFFORTS[EFFORTS.len() - 1];
        let count = together.len();
        let spaces: Vec<ViewSpace> =
            together.iter().map(|&i| self.photos[i].space(self.options.refine, &self.expected(i))).collect();
        let space = RigSpace { views: &spaces, shared: self.shared() };
        let solver = self.options.solver.solver(count, effort.iterations, effort.gain * count as f64);
        let mut views: Vec<View> = together.iter().map(|&i| self.found[i].view).collect();
        let mut tally: Vec<Stage> = Vec::new();
        let mut stop = Stop::Converged;
        for rendering in 0..effort.renderings {
            let Some(sampled) = self.sample(together, &views, index) else { break };
            let overlaps = self.overlaps(together, &views, &sampled);
            let photos = together.iter().zip(&sampled).zip(&spaces).map(|((&i, samples), space)| {
                let prior = if self.shared() { 0.0 } else { PRIOR };
                self.photos[i].objective(level(i), samples, space, &self.expected(i), prior)
            });
            let pairs = overlaps.iter().map(|overlap| {
                let levels = overlap.photos.map(|k| &self.photos[together[k]].levels[level(together[k])]);
                PairObjective::new(overlap, levels)
            });
            let prior =
                Prior { camera: self.expected(together[0]), focal_from: self.options.focal_from, weight: PRIOR };
            let mut objective = RigObjective {
                space: &space,
                photos: photos.collect(),
                pairs: pairs.collect(),
                prior: self.shared().then_some(prior),
            };
            let values = |objective: &mut RigObjective, views: &[View]| -> Vec<f64> {
                objective
                    .photos
                    .iter_mut()
                    .zip(views)
                    .map(|(photo, view)| photo.value(view).unwrap_or_default())
                    .collect()
            };
            let before = values(&mut objective, &views);
            let Some(report) = solver.maximize(&space, &mut objective, views.clone(), &mut |_| ()) else { break };
            let after = values(&mut objective, &report.point);
            if rendering == 0 {
                let name = format!("joint 1/{}", 1 << index);
                tally = before.iter().map(|&value| stage(name.clone(), began, 0, 0, (value, value))).collect();
            }
            for (k, stage) in tally.iter_mut().enumerate() {
                stage.evaluations += objective.photos[k].evaluations;
                stage.renderings += 1;
                stage.similarity.1 = after[k];
            }
            let moved = |(k, &i): (usize, &usize)| {
                self.photos[i].model.distance(&views[k], &report.point[k]) * self.photos[i].levels[level(i)].scale
            };
            let most = together.iter().enumerate().map(moved).fold(0.0, f64::max);
            (views, stop) = (report.point, report.stop);
            if most < SETTLED {
                break;
            }
        }
        let milliseconds = began.elapsed().as_secs_f64() * 1e3 / count as f64;
        for ((&i, view), mut stage) in together.iter().zip(views).zip(tally) {
            stage.milliseconds = milliseconds;
            tell(&stage, &self.photos[i].model.outward(&view)).map_err(|error| (i, error))?;
            self.found[i].view = view;
            self.found[i].outcome.stop = stop;
            self.found[i].outcome.stages.push(stage);
        }
        Ok(())
    }

    /// What each view sees at a level; `None` where one sees nothing.
    fn sample(&self, together: &[usize], views: &[View], index: usize) -> Option<Vec<SurfaceSamples>> {
        let of = |(&i, view): (&usize, &View)| {
            let photo = &self.photos[i];
            let level = &photo.levels[index.min(photo.levels.len() - 1)];
            let sampling = Sampling::with_halo(EFFORTS[EFFORTS.len() - 1].samples, photo.metric_at(index));
            Sampler::new(photo.model.mesh, &*photo.model.signal).sample(view, level, &sampling)
        };
        together.iter().zip(views).map(of).collect()
    }

    /// The pairs of photos that see the same surface, by their place in `together`.
    fn overlaps(&self, together: &[usize], views: &[View], sampled: &[SurfaceSamples]) -> Vec<Overlap> {
        let sights: Vec<Sight> = (0..together.len())
            .map(|k| {
                let photo = &self.photos[together[k]];
                let small = &photo.levels[COARSEST.min(photo.levels.len() - 1)];
                Sight { samples: &sampled[k], depth: DepthMap::new(photo.model.mesh, &views[k], small) }
            })
            .collect();
        let background = self.photos[together[0]].model.signal.bins() as u16;
        overlaps(&sights, background)
    }

    /// Climbs with one photo at full size, its lens fixed.
    fn settle(&mut self, i: usize) {
        let (photo, found) = (self.photos[i], &mut self.found[i]);
        let mut sampler = Sampler::new(photo.model.mesh, &*photo.model.signal);
        if let Some(climb) = photo.climb(&mut sampler, 0, &found.view, &found.start, Refine::default()) {
            (found.view, found.outcome.stop) = (climb.view, climb.stop);
        }
    }

    /// The metric of a photo's view at full size.
    fn similarity(&self, i: usize) -> Similarity {
        let photo = &self.photos[i];
        let mut sampler = Sampler::new(photo.model.mesh, &*photo.model.signal);
        photo.similarity(&mut sampler, &self.found[i].view).unwrap_or_default()
    }

    /// The verdict on where a photo came to; the start is handed back where that is better.
    fn judge(&mut self, i: usize) {
        let Similarity { value: similarity, gain, covered, .. } = self.similarity(i);
        let limits = self.photos[i].limits(self.options.refine, &self.expected(i));
        let (photo, found) = (self.photos[i], &mut self.found[i]);
        let model = photo.model;
        let coarse = photo.coarse_similarity(&found.view).unwrap_or_default();
        let findings = &mut found.findings;
        let start = findings.similarity.0;
        findings.similarity = (start, similarity);
        findings.covered = covered;
        findings.at_bound = limits.reached(&found.view);
        findings.across_levels = (coarse.gain, gain);
        findings.moved = model.distance(&found.start, &found.view);
        (found.outcome.status, found.outcome.reasons) = verdict(findings);
        let (view, end) = if similarity > start { (found.view, similarity) } else { (found.start, start) };
        found.view = view;
        found.outcome.view = model.outward(&view);
        found.outcome.similarity = (start, end);
    }

    /// How sure the views are: those with a shared lens by all their photos, the others by their own, the lens being given where
    /// others share it.
    fn doubt(&mut self, together: &[usize]) {
        let refine = self.options.refine;
        let witness = |i: usize, refine: Refine, prior: f64| {
            let found = &self.found[i];
            (found.outcome.status != Status::Failed)
                .then(|| Witness::new(self.photos[i], &found.view, refine, &self.expected(i), prior))
                .flatten()
        };
        let mut sure: Vec<Option<Uncertainty>> = vec![None; self.found.len()];
        let alone: Vec<usize> = (0..self.found.len()).filter(|i| !self.shared() || !together.contains(i)).collect();
        for i in alone {
            let refine = if self.shared() && !self.found[i].apart { Refine::default() } else { refine };
            let found = witness(i, refine, PRIOR).map(|witness| uncertainties(&[witness], 0, &DVector::zeros(0)));
            sure[i] = found.and_then(|mut found| found.pop().flatten());
        }
        if self.shared() {
            let members: Vec<(usize, Witness)> =
                together.iter().filter_map(|&i| Some((i, witness(i, refine, 0.0)?))).collect();
            let (members, witnesses): (Vec<usize>, Vec<Witness>) = members.into_iter().unzip();
            let deviations = refine.deviations(&self.found[together[0]].start.camera, self.options.focal_from);
            let precision = DVector::from_vec(deviations).map(|d| PRIOR / (d * d));
            for (i, found) in members.into_iter().zip(uncertainties(&witnesses, refine.camera(), &precision)) {
                sure[i] = found;
            }
        }
        for (found, sure) in self.found.iter_mut().zip(sure) {
            if found.outcome.status != Status::Failed {
                found.outcome.attach(sure);
            }
        }
    }
}

/// The photos that climb together first: those that were found. One alone has nothing to go with: then the doubtful come along, and
/// the lost where there are no others.
fn company(statuses: &[Status]) -> Vec<usize> {
    let up_to = |worst| (0..statuses.len()).filter(|&i| statuses[i] <= worst).collect::<Vec<_>>();
    let mut company = up_to(Status::Registered);
    for (worst, fewer_than) in [(Status::Uncertain, 2), (Status::Failed, 1)] {
        if company.len() < fewer_than {
            company = up_to(worst);
        }
    }
    company
}

/// A view with another lens: the distance follows the focal length, so that the model stays as large in the photo.
fn with_lens(view: &View, lens: Camera) -> View {
    let mut pose = view.pose;
    pose.translation *= lens.intrinsics.fx / view.camera.intrinsics.fx;
    View { camera: lens, pose }
}

/// The camera whose every number is the median of those of others.
///
/// # Panics
/// If there is none.
fn median(cameras: impl Iterator<Item = Camera>) -> Camera {
    let cameras: Vec<Camera> = cameras.collect();
    let of = |number: &dyn Fn(&Camera) -> f64| {
        let mut numbers: Vec<f64> = cameras.iter().map(number).collect();
        numbers.sort_by(f64::total_cmp);
        let (low, high) = (numbers[(numbers.len() - 1) / 2], numbers[numbers.len() / 2]);
        0.5 * (low + high)
    };
    let mut camera = cameras[0];
    let k = &mut camera.intrinsics;
    k.fx = of(&|camera| camera.intrinsics.fx);
    k.fy = of(&|camera| camera.intrinsics.fy);
    k.cx = of(&|camera| camera.intrinsics.cx);
    k.cy = of(&|camera| camera.intrinsics.cy);
    k.skew = of(&|camera| camera.intrinsics.skew);
    camera.distortion = std::array::from_fn(|i| of(&|camera| camera.distortion.to_array()[i])).into();
    camera
}

#[cfg(test)]
mod tests {
    use super::*;
    use Status::{Failed, Registered, Uncertain};

    #[test]
    fn a_photo_that_was_found_alone_takes_the_doubtful_along() {
        let cases: [(&[Status], &[usize]); 6] = [
            (&[Uncertain, Registered, Failed, Registered], &[1, 3]),
            (&[Uncertain, Registered, Failed, Uncertain], &[0, 1, 3]),
            (&[Failed, Registered], &[1]),
            (&[Uncertain, Failed], &[0]),
            (&[Failed, Failed], &[0, 1]),
            (&[], &[]),
        ];
        for (statuses, expected) in cases {
            assert_eq!(company(statuses), expected, "{statuses:?}");
        }
    }
}
