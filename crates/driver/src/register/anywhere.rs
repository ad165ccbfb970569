//! Registration with nothing to start from: a survey from everywhere, a closer look around the best it finds, and another around
//! where the best of these climb to.

use super::{APART, Course, FINALISTS, Field, Nearby, Registration, stage};
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

/// How many of those that climbed are looked around as a rough view would be.
const AGAIN: usize = 8;

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
        let of = 1 + self.levels.len().max(2);
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
        let (views, more) = self.climbed(&views, AGAIN);
        (views, looked + more, (before, best))
    }

    /// Views climb on the coarsest level, and the best of their ends are looked around by the full signal, for a climb from afar stops
    /// short of the truth: what might lie in the right basin there, and how many views were looked at.
    fn climbed(&self, views: &[View], most: usize) -> (Vec<View>, usize) {
        let coarsest = self.levels.len() - 1;
        let own = || Sampler::new(&self.model.coarse, &*self.model.signal);
        let run = |sampler: &mut Sampler, view: &View| {
            let climb = self.climb(sampler, coarsest, view, view, Refine::default())?;
            Some((climb.excess + self.prominence(&climb.view, EDGES), climb.view))
        };
        let mut ends: Vec<(f64, View)> = views.par_iter().map_init(own, run).flatten().collect();
        ends.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best = Vec::new();
        self.extend(&mut best, &ends, APART / self.levels[coarsest].scale, most);
        let found: Vec<Nearby> = best.par_iter().filter_map(|view| self.nearby(view)).collect();
        let looked = found.iter().map(|nearby| nearby.looked).sum();
        (found.into_iter().flat_map(|nearby| nearby.views).collect(), looked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};
    use texreg_lie::Pose;

    #[test]
    fn around_the_end_of_a_climb_from_afar_lie_views_nearer_the_truth() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti");
        let mesh = texreg_surface::load(folder.join("model.ply")).unwrap();
        let truth = crate::read_truth(&folder.join("truth.json")).unwrap();
        let (model, options) = (Model::new(&mesh, &[]).unwrap(), Options::default());
        let photo = Photo::load(folder.join(&truth.photos[0].file)).unwrap();
        let registration = Registration::new(&model, &photo, &options);
        let right = model.inward(&truth.photos[0].view);
        let turn = Rotation3::from_scaled_axis(Vector3::y() * 40f64.to_radians());
        let shift = right.pose.rotation * (model.centre - turn * model.centre);
        let pose = Pose::new(right.pose.rotation * turn, right.pose.translation + shift);
        let from = View { pose, ..right };
        let mut sampler = Sampler::new(&model.coarse, &*model.signal);
        let coarsest = registration.levels.len() - 1;
        let climb = registration.climb(&mut sampler, coarsest, &from, &from, Refine::default());
        let end = model.distance(&climb.unwrap().view, &right);
        let (views, _) = registration.climbed(&[from], 1);
        let nearest = views.iter().map(|view| model.distance(view, &right)).fold(f64::INFINITY, f64::min);
        assert!(end > 10.0 && nearest < 0.7 * end, "{end} {nearest}");
    }
}
