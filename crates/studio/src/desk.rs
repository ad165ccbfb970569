//! The registrations: one at a time, in a thread of its own.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use texreg_camera::View;
use texreg_driver::{Error, FocalSource, MetricName, Model, Options, Refine, Registration, SolverName, Stage};
use texreg_surface::SignalName;

use crate::entry::Optics;
use crate::studio::Studio;

/// What waits and what runs.
#[derive(Debug, Default)]
pub(crate) struct Desk {
    papers: Mutex<Papers>,
    filled: Condvar,
    stop: AtomicBool,
}

/// How a photo is registered; `Default` is for photos of which nothing is known.
#[derive(Clone, Debug, Default)]
pub(crate) struct Choice {
    pub(crate) metric: MetricName,
    pub(crate) solver: SolverName,
    /// What the model predicts; none for what was measured.
    pub(crate) signals: Vec<SignalName>,
}

#[derive(Debug, Default)]
struct Papers {
    queue: VecDeque<(usize, Choice)>,
    running: Option<Running>,
}

/// A registration at work.
#[derive(Clone, Debug, Default)]
pub(crate) struct Running {
    pub(crate) photo: usize,
    /// Stages done, and all of them once they are known.
    pub(crate) done: usize,
    pub(crate) of: usize,
    /// The stages that are done.
    pub(crate) stages: Vec<Stage>,
    /// The best view so far, once there is one.
    pub(crate) view: Option<View>,
}

impl Desk {
    /// Puts photos at the end of the queue, each once: what is chosen last counts.
    pub(crate) fn put(&self, photos: &[usize], choice: &Choice) {
        let mut papers = self.papers();
        for &photo in photos {
            let running = papers.running.as_ref().is_some_and(|running| running.photo == photo);
            match papers.queue.iter_mut().find(|(waiting, _)| *waiting == photo) {
                Some((_, chosen)) => chosen.clone_from(choice),
                None if !running => papers.queue.push_back((photo, choice.clone())),
                None => {}
            }
        }
        self.filled.notify_one();
    }

    /// Empties the queue and stops what runs.
    pub(crate) fn cancel(&self) {
        self.papers().queue.clear();
        self.stop.store(true, Ordering::Relaxed);
    }

    /// What runs, and what waits.
    pub(crate) fn state(&self) -> (Option<Running>, Vec<usize>) {
        let papers = self.papers();
        (papers.running.clone(), papers.queue.iter().map(|(photo, _)| *photo).collect())
    }

    fn papers(&self) -> MutexGuard<'_, Papers> {
        self.papers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn next(&self) -> (usize, Choice) {
        let mut papers = self.papers();
        loop {
            if let Some((photo, choice)) = papers.queue.pop_front() {
                papers.running = Some(Running { photo, ..Running::default() });
                self.stop.store(false, Ordering::Relaxed);
                return (photo, choice);
            }
            papers = self.filled.wait(papers).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Works for as long as the program runs.
pub(crate) fn work(studio: &Studio) {
    let mut ready: Option<(Vec<SignalName>, Model)> = None;
    loop {
        let (photo, choice) = studio.desk.next();
        studio.tell();
        let done = catch_unwind(AssertUnwindSafe(|| {
            if ready.as_ref().is_none_or(|(signals, _)| *signals != choice.signals) {
                let model = Model::new(&studio.mesh, &choice.signals).map_err(|error| error.to_string())?;
                ready = Some((choice.signals.clone(), model));
            }
            ready.as_ref().map_or(Ok(()), |(_, model)| register(studio, model, photo, &choice))
        }));
        studio.desk.papers().running = None;
        match done {
            Ok(Ok(())) => studio.tell(),
            Ok(Err(words)) => studio.notice(words),
            Err(_) => {
                studio
                    .notice("the registration broke off by a mistake of this program; nothing else is touched".into());
            }
        }
    }
}

fn register(studio: &Studio, model: &Model<'_>, number: usize, choice: &Choice) -> Result<(), String> {
    let photo = studio.photo(number)?;
    let (file, start, before, unknown) = {
        let project = studio.project();
        let entry = project.entries.get(number).ok_or("there is no such photo")?;
        let camera = entry.now.camera.as_ref().ok_or_else(|| format!("{}: pick four pairs first", entry.file))?;
        (entry.file.clone(), camera.view, entry.now.camera.clone(), matches!(entry.optics, Optics::Unknown(_)))
    };
    let desk = &studio.desk;
    let refine = Refine { focal: unknown, ..Refine::default() };
    let focal_from = if unknown { FocalSource::Guessed } else { FocalSource::Stated };
    let Choice { metric, solver, .. } = *choice;
    let options = Options { metric, solver, refine, focal_from, ..Options::default() };
    let outcome = Registration::new(model, &photo, &options).run(&start, &mut |event| {
        if let Some(running) = &mut desk.papers().running {
            (running.done, running.of, running.view) = (event.done, event.of, Some(event.view));
            running.stages.push(event.stage.clone());
        }
        studio.tell();
        if desk.stop.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    match outcome {
        Ok(outcome) => studio.project().change(number, |entry| {
            // Whoever moved the camera meanwhile knows better.
            if entry.now.camera != before {
                return Err(format!("{file}: its camera changed while it was registered; register it again"));
            }
            entry.registered(&outcome);
            Ok(())
        }),
        Err(Error::Stopped) => Err(format!("{file}: stopped; its camera is as it was")),
        Err(error) => Err(format!("{file}: {error}")),
    }
}
