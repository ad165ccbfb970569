//! One photo of the project: what is known of it, how that came about, and what follows from its pairs.
//!
//! Changing a pair makes the pose of the pairs the camera again, whatever stood there before: that is how a registration is
//! corrected. Undo brings back what was there.

use std::path::PathBuf;

use nalgebra::Point3;
use texreg_camera::{Camera, View};
use texreg_driver::{
    FEWEST_PAIRS, Nudge, Outcome, PairFit, Photo, Uncertainty, fit_of_pairs, pose_and_focal_from_pairs, pose_from_pairs,
};
use texreg_posit::{Correspondence, Solution};

use crate::action::{Action, MOST_PAIRS};
use crate::moment::{Half, Moment, Pair, Placed, Source, Verdict};

/// Steps that can be undone.
const STEPS: usize = 500;

/// What is known of the lens before any pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Optics {
    /// Nothing yet: the photo has not been opened.
    Unread,
    /// From a file of cameras.
    File(Camera),
    /// From the photo's EXIF.
    Exif(Camera),
    /// Nothing but the photo's size.
    Unknown([u32; 2]),
}

/// A photo of the project.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    /// The photo's path.
    pub(crate) path: PathBuf,
    /// Its file name.
    pub(crate) file: String,
    /// What is known of its lens.
    pub(crate) optics: Optics,
    /// Whether the photo has been opened.
    pub(crate) met: bool,
    /// What is known now.
    pub(crate) now: Moment,
    /// Why the pairs make no pose, though they are enough.
    pub(crate) trouble: Option<String>,
    /// The pairs the pose does not rest on, by their place among the pairs.
    pub(crate) left_out: Vec<usize>,
    /// Whether another pose explains the pairs about as well.
    pub(crate) ambiguous: bool,
    /// How each pair goes with the camera; empty without one.
    pub(crate) fits: Vec<PairFit>,
    undo: Vec<Moment>,
    redo: Vec<Moment>,
    gesture: Option<u64>,
    next_id: u32,
}

impl Entry {
    /// A photo of which this is known.
    pub(crate) fn new(path: PathBuf, file: String, optics: Optics, now: Moment) -> Self {
        let next_id = now.pairs.iter().map(|pair| pair.id + 1).max().unwrap_or(0);
        let mut entry = Self {
            path,
            file,
            optics,
            met: false,
            now,
            trouble: None,
            left_out: Vec::new(),
            ambiguous: false,
            fits: Vec::new(),
            undo: Vec::new(),
            redo: Vec::new(),
            gesture: None,
            next_id,
        };
        entry.judge();
        entry
    }

    /// Width and height, once they are known.
    pub(crate) fn size(&self) -> Option<[u32; 2]> {
        match self.optics {
            Optics::File(camera) | Optics::Exif(camera) => Some([camera.width, camera.height]),
            Optics::Unknown(size) => Some(size),
            Optics::Unread => None,
        }
    }

    /// Whether there are steps to undo, and to redo.
    pub(crate) fn steps(&self) -> (bool, bool) {
        (!self.undo.is_empty(), !self.redo.is_empty())
    }

    /// Takes from the photo what it says of its lens, and makes the pose that waited for it.
    pub(crate) fn meet(&mut self, photo: &Photo) -> Result<(), String> {
        let size = [photo.width, photo.height];
        match self.optics {
            Optics::Unread => {
                self.optics = match photo.focal() {
                    Some(focal) => Optics::Exif(Camera::ideal(size[0], size[1], focal)),
                    None => Optics::Unknown(size),
                };
            }
            Optics::File(camera) if [camera.width, camera.height] != size => {
                return Err(format!(
                    "{}: its camera is for {} × {} pixels, but the photo has {} × {}; give the camera of this photo",
                    self.file, camera.width, camera.height, size[0], size[1]
                ));
            }
            Optics::File(_) | Optics::Exif(_) | Optics::Unknown(_) => {}
        }
        self.met = true;
        if self.now.camera.is_none() {
            self.settle();
        } else {
            self.judge();
        }
        Ok(())
    }

    /// Does what a person wants done. `centre` is the middle of the model.
    pub(crate) fn act(&mut self, action: &Action, centre: &Point3<f64>) -> Result<(), String> {
        action.check()?;
        match action {
            Action::Undo => return self.step_back(),
            Action::Redo => return self.step_forth(),
            _ => {}
        }
        let before = self.now.clone();
        self.apply(action, centre)?;
        if self.now != before {
            self.remember(before, action.gesture());
        }
        Ok(())
    }

    /// Takes over the result of a registration.
    pub(crate) fn registered(&mut self, outcome: &Outcome) {
        let before = self.now.clone();
        let verdict = Verdict {
            status: outcome.status,
            reasons: outcome.reasons.clone(),
            similarity: outcome.similarity,
            uncertainty: outcome.uncertainty.as_ref().map(Uncertainty::json).into(),
        };
        self.now.camera = Some(Placed { verdict: Some(verdict), ..Placed::new(outcome.view, Source::Registration) });
        self.fit();
        self.remember(before, None);
    }

    fn remember(&mut self, before: Moment, gesture: Option<u64>) {
        if gesture.is_none() || gesture != self.gesture {
            self.undo.push(before);
            if self.undo.len() > STEPS {
                self.undo.remove(0);
            }
        }
        self.gesture = gesture;
        self.redo.clear();
    }

    fn step_back(&mut self) -> Result<(), String> {
        let before = self.undo.pop().ok_or("there is nothing to undo")?;
        self.redo.push(std::mem::replace(&mut self.now, before));
        self.gesture = None;
        self.judge();
        Ok(())
    }

    fn step_forth(&mut self) -> Result<(), String> {
        let after = self.redo.pop().ok_or("there is nothing to redo")?;
        self.undo.push(std::mem::replace(&mut self.now, after));
        self.gesture = None;
        self.judge();
        Ok(())
    }

    fn apply(&mut self, action: &Action, centre: &Point3<f64>) -> Result<(), String> {
        match action {
            Action::Photo { uv } => match self.now.pending {
                Some(Half::Model(point)) => self.add(Correspondence::new(point, (*uv).into()))?,
                _ => self.now.pending = Some(Half::Photo((*uv).into())),
            },
            Action::Model { xyz } => match self.now.pending {
                Some(Half::Photo(pixel)) => self.add(Correspondence::new((*xyz).into(), pixel))?,
                _ => self.now.pending = Some(Half::Model((*xyz).into())),
            },
            Action::Drop => self.now.pending = None,
            Action::Move { pair, uv, xyz, .. } => {
                let ends = &mut self.pair(*pair)?.ends;
                ends.pixel = uv.map_or(ends.pixel, Into::into);
                ends.point = xyz.map_or(ends.point, Into::into);
                self.settle();
            }
            Action::Delete { pair } => {
                self.pair(*pair)?;
                self.now.pairs.retain(|other| other.id != *pair);
                self.settle();
            }
            Action::Rename { pair, name } => name.trim().clone_into(&mut self.pair(*pair)?.name),
            Action::Nudge { shift, turn, distance, .. } => {
                let camera = self.now.camera.as_ref().ok_or("there is no camera to move yet; pick four pairs first")?;
                let nudge = Nudge { shift: *shift, turn: *turn, distance: *distance };
                let view = nudge.apply(&camera.view, centre).ok_or("the model would leave the picture")?;
                self.now.camera = Some(Placed::new(view, Source::Hand));
                self.fit();
            }
            Action::Pairs => {
                if self.now.pairs.len() < FEWEST_PAIRS {
                    return Err("four pairs make a pose; pick more".to_owned());
                }
                self.settle();
            }
            Action::Accept => {
                self.now.camera.as_mut().ok_or("there is no camera to accept yet; pick four pairs first")?.accepted =
                    true;
            }
            Action::Reopen => {
                self.now.camera.as_mut().ok_or("there is no camera yet")?.accepted = false;
            }
            Action::Undo | Action::Redo => {}
        }
        Ok(())
    }

    fn pair(&mut self, id: u32) -> Result<&mut Pair, String> {
        let found = self.now.pairs.iter_mut().find(|pair| pair.id == id);
        found.ok_or_else(|| "this pair is gone: another tab took it away".to_owned())
    }

    fn add(&mut self, ends: Correspondence) -> Result<(), String> {
        if self.now.pairs.len() >= MOST_PAIRS {
            return Err(format!("a photo has at most {MOST_PAIRS} pairs"));
        }
        self.now.pairs.push(Pair { id: self.next_id, name: String::new(), ends });
        self.next_id += 1;
        self.now.pending = None;
        self.settle();
        Ok(())
    }

    /// Makes the pose of the pairs the camera, if they have one. A camera from elsewhere stays while they are too few.
    fn settle(&mut self) {
        match self.solve() {
            Some(view) => self.now.camera = Some(Placed::new(view, Source::Pairs)),
            None if self.now.camera.as_ref().is_some_and(|camera| camera.source == Source::Pairs) => {
                self.now.camera = None;
            }
            None => {}
        }
        self.fit();
    }

    /// Finds out again what the pairs say, and leaves the camera.
    fn judge(&mut self) {
        self.solve();
        self.fit();
    }

    fn fit(&mut self) {
        let pairs = self.now.correspondences();
        let view = self.now.camera.as_ref().map(|camera| camera.view);
        self.fits = view.map_or_else(Vec::new, |view| fit_of_pairs(&pairs, &view, &self.left_out));
    }

    /// Solves for the pose of the pairs and keeps what it says of them.
    fn solve(&mut self) -> Option<View> {
        (self.trouble, self.ambiguous) = (None, false);
        self.left_out.clear();
        let pairs = self.now.correspondences();
        if pairs.len() < FEWEST_PAIRS {
            return None;
        }
        let solution = match self.optics {
            Optics::Unread => return None,
            Optics::File(camera) | Optics::Exif(camera) => pose_from_pairs(&pairs, &camera),
            Optics::Unknown(size) => pose_and_focal_from_pairs(&pairs, size),
        };
        match solution {
            Ok(Solution { view, rejected, alternative, .. }) => {
                self.left_out = rejected;
                self.ambiguous = alternative.is_some();
                Some(view)
            }
            Err(cause) => {
                self.trouble = Some(format!("no pose fits the pairs: {cause}"));
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};
    use texreg_driver::{Status, Stop};
    use texreg_lie::Pose;

    fn view() -> View {
        let pose = Pose::new(Rotation3::from_euler_angles(0.1, -0.2, 0.3), Vector3::new(0.1, -0.1, 6.0));
        View { camera: Camera::ideal(800, 600, 900.0), pose }
    }

    const POINTS: [[f64; 3]; 8] = [
        [1.0, 0.3, 0.2],
        [-1.0, 0.4, -0.3],
        [0.2, 1.0, 0.5],
        [0.1, -1.0, -0.6],
        [0.7, 0.8, -0.4],
        [-0.6, -0.7, 0.9],
        [0.4, -0.5, 1.0],
        [-0.9, 0.9, 0.1],
    ];

    fn entry() -> Entry {
        Entry::new("p.jpg".into(), "p.jpg".into(), Optics::File(view().camera), Moment::default())
    }

    fn act(entry: &mut Entry, action: &Action) {
        entry.act(action, &Point3::origin()).unwrap();
    }

    fn pick(entry: &mut Entry, count: usize) {
        for (i, xyz) in POINTS.into_iter().take(count).enumerate() {
            let uv = view().project(&xyz.into()).unwrap().into();
            // Either end may come first.
            let mut clicks = [Action::Photo { uv }, Action::Model { xyz }];
            clicks.rotate_left(i % 2);
            clicks.into_iter().for_each(|click| act(entry, &click));
        }
    }

    fn off(entry: &Entry) -> f64 {
        let found = entry.now.camera.as_ref().unwrap().view;
        (found.pose.translation - view().pose.translation).norm()
    }

    #[test]
    fn four_pairs_make_a_pose_and_fewer_take_it_away() {
        let mut entry = entry();
        pick(&mut entry, 3);
        assert_eq!((entry.now.pairs.len(), entry.now.status()), (3, "todo"));
        entry.now = Moment::default();
        pick(&mut entry, 6);
        assert_eq!(entry.now.status(), "picked");
        assert!(off(&entry) < 1e-6, "{}", off(&entry));
        let ids: Vec<u32> = entry.now.pairs.iter().map(|pair| pair.id).collect();
        for pair in &ids[..3] {
            act(&mut entry, &Action::Delete { pair: *pair });
        }
        assert_eq!(entry.now.status(), "todo");
        assert!(entry.act(&Action::Delete { pair: ids[0] }, &Point3::origin()).is_err());
    }

    #[test]
    fn every_step_is_undone_and_redone() {
        let mut entry = entry();
        let mut moments = vec![entry.now.clone()];
        for count in [1, 2] {
            pick(&mut entry, 4 * count);
            moments.push(entry.now.clone());
        }
        act(&mut entry, &Action::Rename { pair: 2, name: " nose ".into() });
        assert_eq!(entry.now.pairs[2].name, "nose");
        for i in 0..40 {
            let uv = Some([400.0 + f64::from(i), 300.0]);
            act(&mut entry, &Action::Move { pair: 1, uv, xyz: None, gesture: 7 });
        }
        let last = entry.now.clone();
        let mut steps = 0;
        while entry.steps().0 {
            act(&mut entry, &Action::Undo);
            steps += 1;
        }
        // Two clicks a pair, a name, and one drag.
        assert_eq!((steps, &entry.now), (2 * 12 + 2, &moments[0]));
        while entry.steps().1 {
            act(&mut entry, &Action::Redo);
        }
        assert_eq!(entry.now, last);
        assert!(entry.act(&Action::Redo, &Point3::origin()).is_err());
    }

    #[test]
    fn a_registration_stands_until_a_pair_corrects_it() {
        let mut entry = entry();
        pick(&mut entry, 6);
        let outcome = Outcome {
            view: view(),
            status: Status::Uncertain,
            reasons: vec!["small".into()],
            similarity: (0.1, 0.2),
            stop: Stop::Converged,
            uncertainty: None,
            stages: vec![],
        };
        entry.registered(&outcome);
        assert_eq!(entry.now.status(), "uncertain");
        act(&mut entry, &Action::Accept);
        assert_eq!(entry.now.status(), "accepted");
        act(&mut entry, &Action::Move { pair: 0, uv: Some([1.0, 2.0]), xyz: None, gesture: 1 });
        assert_eq!(entry.now.status(), "picked");
        act(&mut entry, &Action::Undo);
        assert_eq!(entry.now.status(), "accepted");
        act(&mut entry, &Action::Nudge { shift: [3.0, 0.0], turn: [0.0; 3], distance: 1.0, gesture: 2 });
        let camera = entry.now.camera.as_ref().unwrap();
        assert_eq!((camera.source, camera.accepted), (Source::Hand, false));
        let moved = camera.view.project(&Point3::origin()).unwrap() - view().project(&Point3::origin()).unwrap();
        assert!((moved.x - 3.0).abs() < 1e-9 && moved.y.abs() < 1e-9, "{moved}");
    }

    #[test]
    fn an_unknown_focal_length_is_found_from_six_pairs() {
        let mut entry = entry();
        entry.optics = Optics::Unknown([800, 600]);
        pick(&mut entry, 8);
        let focal = entry.now.camera.as_ref().unwrap().view.camera.intrinsics.fx;
        assert!((focal - 900.0).abs() < 1.0, "{focal}");
    }

    #[test]
    fn nonsense_is_refused_and_changes_nothing() {
        let mut entry = entry();
        pick(&mut entry, 4);
        let before = entry.now.clone();
        for action in [
            Action::Photo { uv: [f64::NAN, 0.0] },
            Action::Model { xyz: [0.0, f64::INFINITY, 0.0] },
            Action::Rename { pair: 0, name: "x".repeat(1000) },
            Action::Nudge { shift: [0.0; 2], turn: [0.0; 3], distance: -1.0, gesture: 0 },
            Action::Move { pair: 99, uv: None, xyz: None, gesture: 0 },
        ] {
            assert!(entry.act(&action, &Point3::origin()).is_err(), "{action:?}");
        }
        assert_eq!(entry.now, before);
    }
}
