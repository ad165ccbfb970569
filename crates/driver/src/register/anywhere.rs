//! Registration with nothing to start from: a survey from everywhere, and a closer look around the best it finds.

use super::{Course, FINALISTS, Field, Registration, stage};
use crate::model::Model;
use crate::outcome::{Event, Outcome};
use crate::overview::{Overview, Workspace};
use crate::samples::Sampler;
use crate::search::{Region, Search};
use crate::survey::survey;
use crate::{Error, Options, Photo, Refine};
use nalgebra::Point3;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::time::Instant;
use texreg_camera::{Camera, View};
use texreg_surface::Mesh;

/// Triangles of the copy that is looked at from everywhere, the longer side of the picture it is
/// compared with, and the number of the picture's colours.
const ROUGH: usize = 3_000;
const TINY: u32 = 64;
const FEW_COLOURS: usize = 12;

/// What it counts that an outline as long as the picture's border lies on edges, in nats.
const EDGES: f64 = 3.0;

/// How many views are looked around: those of the survey in the tiny picture, the best of these in the one that is searched, and of
/// these again; and how many climb.
const SHORTLIST: usize = 150;
const CLOSER: usize = 40;
const BEST: usize = 12;
const CLIMBING: usize = 40;

/// How: orientations and sizes of the survey lie about so far apart.
const AROUND: Search = Search { rounds: 5, views: 48, elite: 8, deviation: 0.12, seed: 0 };
const LONGER: Search = Search { rounds: 10, views: 60, elite: 10, deviation: 0.1, seed: 0 };

/// Registers one photo with nothing to start from but its camera.
///
/// # Errors
/// If no view shows the model, or the observer says stop.
pub fn search(
    model: &Model,
    photo: &Photo,
    camera: &Camera,
    options: &Options,
    observer: &mut dyn FnMut(&Event) -> ControlFlow<()>,
) -> Result<Outcome, Error> {
    Registration::new(model, photo, options).search(camera, observer)
}

impl Registration<'_> {
    /// Registers the photo with nothing to start from but its camera, telling `observer` of each stage.
    ///
    /// # Errors
    /// If no view shows the model, or the observer says stop.
    pub fn search(
        &self,
        camera: &Camera,
        observer: &mut dyn FnMut(&Event) -> ControlFlow<()>,
    ) -> Result<Outcome, Error> {
        let of = 1 + self.levels.len().max(2) + self.polishings();
        let mut course = Course { registration: self, stages: Vec::new(), of, observer };
        let mut sampler = Sampler::new(self.model.mesh, &*self.model.signal);
        let began = Instant::now();
        let (views, renderings, evidence) = self.anywhere(camera);
        let limits = self.limits(self.options.refine, camera);
        let views: Vec<View> = views.iter().map(|view| limits.held(view)).collect();
        let start = *views.first().ok_or(Error::NothingVisible)?;
        course.tell(stage(self.search_name(), began, 0, renderings, evidence), &start)?;
        let at_start = self.similarity(&mut sampler, &start).ok_or(Error::NothingVisible)?.value;
        let field = Field {
            views,
            start,
            refine: self.options.refine,
            finalists: 2 * FINALISTS,
            has_climbed: false,
            evidence: |registration, view| registration.prominence(view, EDGES),
        };
        let refine = self.options.refine;
        let finish = self.race(&mut sampler, &field, &mut course)?.ok_or(Error::NothingVisible)?;
        let findings = self.findings(&finish, refine, &start, at_start);
        let finish = self.polished(&mut sampler, finish, &start, at_start, refine, &mut course)?;
        Ok(self.assured(self.outcome(&finish, &start, &findings, course.stages), camera))
    }

    /// The best views of a camera that might lie in the right basin, with nothing to start from; how many were looked at, and
    /// how far the best stands out before and after a closer look.
    fn anywhere(&self, camera: &Camera) -> (Vec<View>, usize, (f64, f64)) {
        let model = self.model;
        let rough = model.coarse.simplified(ROUGH);
        let tiny = Overview::new(self.photo, TINY, FEW_COLOURS);
        let mut found = survey(&rough, &*model.rough, &tiny, EDGES, camera);
        let mut looked = found.len();
        let before = found.first().map_or(0.0, |(score, _)| *score);
        let limits = self.limits(Refine::default(), camera);
        let pixel = f64::from(self.photo.width.max(self.photo.height)) / f64::from(TINY);
        let rounds: [(f64, usize, Search, &Overview, &Mesh); 3] = [
            (3.0, SHORTLIST, AROUND, &tiny, &rough),
            (2.0, CLOSER, AROUND, &self.overview, &model.coarse),
            (2.0, BEST, LONGER, &self.overview, &model.coarse),
        ];
        let mut closer = Vec::new();
        for (apart, most, search, overview, mesh) in rounds {
            let search = Search { seed: self.options.seed, ..search };
            let mut views = Vec::new();
            self.extend(&mut views, &found, apart * pixel, most);
            let nearest = |view: &View| {
                let seen = mesh.positions.iter().map(|p| Point3::from(p.map(f64::from)));
                let seen: Vec<Point3<f64>> = seen.filter(|p| model.shows(view, p)).collect();
                let region = Region::around(&seen)?.by_size(view);
                let look = |workspace: &mut Workspace, view: &View| {
                    self.peak(overview, mesh, EDGES, workspace, &limits.held(view))
                };
                let [found] = search.around(view, &region, look, [|peak| *peak]);
                found.into_iter().next()
            };
            looked += views.len() * search.rounds * search.views;
            closer = std::mem::replace(&mut found, views.par_iter().filter_map(nearest).collect());
            found.sort_by(|a, b| b.0.total_cmp(&a.0));
        }
        let best = found.first().map_or(before, |(score, _)| *score);
        let mut views = Vec::new();
        for found in [found, closer] {
            self.extend(&mut views, &found, pixel, CLIMBING);
        }
        (views, looked, (before, best))
    }
}
