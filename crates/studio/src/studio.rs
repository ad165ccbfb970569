//! What all requests share.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use nalgebra::{Point2, Point3};
use texreg_camera::View;
use texreg_driver::{Photo, Projected, Shading, Skin, Viewer, pick};
use texreg_surface::Mesh;
use tokio::sync::watch;

use crate::Error;
use crate::desk::{Desk, work};
use crate::gallery::Gallery;
use crate::project::{Project, Sources};

/// A studio: a model, its photos, and what is known of them.
///
/// One project behind one lock; every change raises the revision, and every tab is told.
#[derive(Debug)]
pub struct Studio {
    pub(crate) mesh: Mesh,
    /// The model's file name.
    pub(crate) name: String,
    pub(crate) desk: Desk,
    project: Mutex<Project>,
    gallery: Gallery,
    revision: watch::Sender<u64>,
    notice: Mutex<(u64, String)>,
    viewers: Mutex<Vec<Viewer>>,
    skins: [OnceLock<Option<Arc<Skin>>>; Shading::ALL.len()],
    /// The photo that was laid on the model last, and by which view.
    projected: Mutex<Option<(usize, View, Arc<Skin>)>>,
}

impl Studio {
    /// Opens a project: a model called `name`, its photos and its folder.
    ///
    /// # Errors
    /// If a file is broken, a photo missing, or the folder cannot be written to or is in use.
    pub fn open(mesh: Mesh, name: &str, sources: &Sources) -> Result<Arc<Self>, Error> {
        let studio = Arc::new(Self {
            mesh,
            name: name.to_owned(),
            desk: Desk::default(),
            project: Mutex::new(Project::open(sources)?),
            gallery: Gallery::default(),
            revision: watch::Sender::new(1),
            notice: Mutex::default(),
            viewers: Mutex::default(),
            skins: Default::default(),
            projected: Mutex::default(),
        });
        let worker = Arc::clone(&studio);
        let thread = std::thread::Builder::new().name("registration".into()).spawn(move || work(&worker));
        thread.map_err(|error| Error::System(error.to_string()))?;
        Ok(studio)
    }

    /// The project, whatever became of those who had it before: a change is made on a copy, so it is whole.
    pub(crate) fn project(&self) -> MutexGuard<'_, Project> {
        self.project.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells every tab that something changed.
    pub(crate) fn tell(&self) {
        self.revision.send_modify(|revision| *revision += 1);
    }

    /// The number of the last change, to wait for the next.
    pub(crate) fn revisions(&self) -> watch::Receiver<u64> {
        self.revision.subscribe()
    }

    /// Says something to every tab.
    pub(crate) fn notice(&self, words: String) {
        {
            let mut notice = self.notice.lock().unwrap_or_else(PoisonError::into_inner);
            *notice = (notice.0 + 1, words);
        }
        self.tell();
    }

    /// What was said last, and its number.
    pub(crate) fn last_notice(&self) -> (u64, String) {
        self.notice.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// A photo; its lens is known from then on.
    pub(crate) fn photo(&self, number: usize) -> Result<Arc<Photo>, String> {
        let path = self.project().entries.get(number).ok_or("there is no such photo")?.path.clone();
        let photo = self.gallery.photo(number, &path).map_err(|error| error.to_string())?;
        let mut project = self.project();
        let unread = project.entries.get(number).is_some_and(|entry| !entry.met);
        if unread {
            project.change(number, |entry| entry.meet(&photo))?;
            drop(project);
            self.tell();
        }
        Ok(photo)
    }

    /// The camera of a photo: its own, or the one of the registration at work.
    pub(crate) fn view(&self, photo: usize, at_work: bool) -> Result<View, String> {
        let (running, _) = self.desk.state();
        let found = running.filter(|running| at_work && running.photo == photo).and_then(|running| running.view);
        if let Some(view) = found {
            return Ok(view);
        }
        let project = self.project();
        let entry = project.entries.get(photo).ok_or("there is no such photo")?;
        Ok(entry.now.camera.as_ref().ok_or("the photo has no camera yet")?.view)
    }

    /// Draws with a viewer, of which there are as many as people draw at a time.
    pub(crate) fn draw<T>(&self, with: impl FnOnce(&mut Viewer) -> T) -> T {
        let free = || self.viewers.lock().unwrap_or_else(PoisonError::into_inner);
        let mut viewer = free().pop().unwrap_or_default();
        let result = with(&mut viewer);
        free().push(viewer);
        result
    }

    /// The skin of a shading; `photo` is what a textured model wears.
    pub(crate) fn skin(&self, shading: Shading, photo: Option<usize>) -> Result<Arc<Skin>, String> {
        if shading == Shading::Textured {
            return self.textured(photo.ok_or("no photo is chosen")?);
        }
        let place = Shading::ALL.iter().position(|other| *other == shading).and_then(|i| self.skins.get(i));
        let skin = place.and_then(|place| place.get_or_init(|| Skin::new(&self.mesh, shading).map(Arc::new)).clone());
        skin.ok_or_else(|| format!("the model has no {shading}"))
    }

    fn textured(&self, number: usize) -> Result<Arc<Skin>, String> {
        let view = self.view(number, false)?;
        let mut last = self.projected.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((photo, by, skin)) = &*last
            && (*photo, *by) == (number, view)
        {
            return Ok(Arc::clone(skin));
        }
        let skin = Arc::new(Skin::Photo(Box::new(Projected::new(&self.mesh, self.photo(number)?, &view))));
        *last = Some((number, view, Arc::clone(&skin)));
        Ok(skin)
    }

    /// The point of the model that a view sees at a pixel.
    pub(crate) fn pick(&self, view: &View, pixel: [f64; 2]) -> Option<Point3<f64>> {
        pick(&self.mesh, view, &Point2::from(pixel))
    }
}
