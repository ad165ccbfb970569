//! One colour from all photos that see a point.

use crate::bands::Bands;
use crate::sight::Glimpse;

/// How the photos that see a point make its colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Blend {
    /// Low frequencies from all, by weight; high ones from the photo of the greatest weight. Light changes gradually from photo to
    /// photo, and what is off by a pixel or two makes no ghosts.
    #[default]
    MultiBand,
    /// All from the photo of the greatest weight.
    Best,
    /// The mean of all.
    Mean,
}

/// A colour that is being blended.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mixture {
    sum: [f32; 3],
    weight: f32,
    greatest: f32,
    high: [f32; 3],
}

impl Mixture {
    /// Adds what a photo sees. `size` is the width of the texel in model units, `trust` from 0 to 1.
    pub(crate) fn add(&mut self, blend: Blend, glimpse: &Glimpse, bands: &Bands, size: f64, trust: f64) {
        let weight = ((glimpse.weight * trust) as f32).max(f32::MIN_POSITIVE);
        let leads = weight > self.greatest;
        let level = bands.level(size * glimpse.density, glimpse.edge);
        let colour = || bands.sample(&glimpse.pixel, level);
        match blend {
            Blend::MultiBand => {
                let low = bands.low(&glimpse.pixel);
                self.sum(&low, weight);
                if leads {
                    let colour = colour();
                    self.high = std::array::from_fn(|c| colour[c] - low[c]);
                }
            }
            Blend::Best if leads => self.high = colour(),
            Blend::Best => {}
            Blend::Mean => self.sum(&colour(), 1.0),
        }
        self.greatest = self.greatest.max(weight);
    }

    fn sum(&mut self, colour: &[f32; 3], weight: f32) {
        self.sum.iter_mut().zip(colour).for_each(|(sum, value)| *sum += weight * value);
        self.weight += weight;
    }

    /// The colour, 0 to 255; `None` if no photo sees the point.
    pub(crate) fn colour(&self) -> Option<[f32; 3]> {
        let low = self.low_or_zero();
        (self.greatest > 0.0).then(|| std::array::from_fn(|c| (low[c] + self.high[c]).clamp(0.0, 255.0)))
    }

    /// Its low frequencies, where these are kept apart.
    pub(crate) fn low(&self) -> Option<[f32; 3]> {
        if self.weight > 0.0 { Some(self.low_or_zero()) } else { self.colour() }
    }

    fn low_or_zero(&self) -> [f32; 3] {
        if self.weight > 0.0 { self.sum.map(|x| x / self.weight) } else { [0.0; 3] }
    }
}
