//! One colour from all photos that see a point.

use crate::bands::Bands;
use crate::sight::Glimpse;

/// How the photos that see a point make its colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Blend {
    /// Low frequencies from all alike, so that none's light prevails; high ones by weight, so that the sharpest photo does.
    #[default]
    MultiBand,
    /// All from the photo of the greatest weight.
    Best,
    /// The mean of all.
    Mean,
}

/// The least weight; a photo that sees a point always counts.
const LEAST: f32 = 1e-30;

/// A colour that is being blended.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mixture {
    sum: [f32; 3],
    weight: f32,
    high: [f32; 3],
    high_weight: f32,
}

impl Mixture {
    /// Adds what a photo sees. `size` is the width of the texel in model units, `trust` from 0 to 1.
    pub(crate) fn add(&mut self, blend: Blend, glimpse: &Glimpse, bands: &Bands, size: f64, trust: f64) {
        let weight = ((glimpse.weight * trust) as f32).max(LEAST);
        let level = bands.level(size * glimpse.density, glimpse.edge);
        let colour = || bands.sample(&glimpse.pixel, level);
        match blend {
            Blend::MultiBand => {
                let (low, colour) = (bands.low(&glimpse.pixel), colour());
                self.sum(&low, ((glimpse.even * trust) as f32).max(LEAST));
                (0..3).for_each(|c| self.high[c] += weight * (colour[c] - low[c]));
                self.high_weight += weight;
            }
            Blend::Best if weight > self.high_weight => {
                self.high = colour().map(|x| weight * x);
                self.high_weight = weight;
            }
            Blend::Best => {}
            Blend::Mean => self.sum(&colour(), 1.0),
        }
    }

    fn sum(&mut self, colour: &[f32; 3], weight: f32) {
        self.sum.iter_mut().zip(colour).for_each(|(sum, value)| *sum += weight * value);
        self.weight += weight;
    }

    /// The colour, 0 to 255; `None` if no photo sees the point.
    pub(crate) fn colour(&self) -> Option<[f32; 3]> {
        let low = self.low_or_zero();
        let share = if self.high_weight > 0.0 { self.high_weight.recip() } else { 0.0 };
        let seen = self.weight > 0.0 || self.high_weight > 0.0;
        seen.then(|| std::array::from_fn(|c| (low[c] + share * self.high[c]).clamp(0.0, 255.0)))
    }

    /// Its low frequencies, where these are kept apart.
    pub(crate) fn low(&self) -> Option<[f32; 3]> {
        if self.weight > 0.0 { Some(self.low_or_zero()) } else { self.colour() }
    }

    fn low_or_zero(&self) -> [f32; 3] {
        if self.weight > 0.0 { self.sum.map(|x| x / self.weight) } else { [0.0; 3] }
    }
}
