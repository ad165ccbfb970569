//! The pairs a density is estimated from.

/// Pairs of a model bin and a photo value, as two slices of equal length.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a, T = f32> {
    /// What the model predicts: the index of a bin, `0..model_bins`.
    pub model: &'a [u16],
    /// What the photo shows, in `0.0..=1.0` (values outside are clamped); NaN where the sample fell outside the photo.
    pub photo: &'a [T],
}

impl<T> Samples<'_, T> {
    /// The number of pairs.
    ///
    /// # Panics
    /// If the two slices differ in length.
    #[must_use]
    pub fn len(&self) -> usize {
        assert_eq!(self.model.len(), self.photo.len(), "samples come in pairs");
        self.model.len()
    }

    /// Whether there is no pair at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
