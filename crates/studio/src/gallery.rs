//! The photos themselves: opened when they are looked at, the last few kept.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use texreg_driver::{Photo, PhotoError};

/// Photos kept open.
const KEPT: usize = 3;

/// The photos looked at last, by number.
#[derive(Debug, Default)]
pub(crate) struct Gallery(Mutex<Vec<(usize, Arc<Photo>)>>);

impl Gallery {
    /// The photo of this number, which is at this path.
    pub(crate) fn photo(&self, number: usize, path: &Path) -> Result<Arc<Photo>, PhotoError> {
        // Held while a photo is read, so that two requests do not read it twice.
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = kept.iter().position(|(other, _)| *other == number);
        let photo = match found {
            Some(i) => kept.remove(i),
            None => (number, Arc::new(Photo::load(path)?)),
        };
        kept.insert(0, photo.clone());
        kept.truncate(KEPT);
        Ok(photo.1)
    }
}
