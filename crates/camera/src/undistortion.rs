//! Points and images as a camera without distortion would have taken them.

use crate::{Camera, Distortion};
use nalgebra::{Point2, Point3};

impl Camera {
    /// The same camera with a perfect lens.
    pub fn without_distortion(&self) -> Self {
        Self { distortion: Distortion::default(), ..*self }
    }

    /// The pixel at which the perfect lens would show what is seen at `pixel`; `None` where nothing is.
    pub fn undistort(&self, pixel: &Point2<f64>) -> Option<Point2<f64>> {
        let ray = self.unproject(pixel)?;
        Some(self.intrinsics.apply(&ray.xy()))
    }

    /// The inverse of [`undistort`](Self::undistort).
    pub fn distort(&self, pixel: &Point2<f64>) -> Option<Point2<f64>> {
        self.project(&Point3::from(self.intrinsics.invert(pixel).push(1.0)))
    }
}

/// An image with interleaved channels, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Samples<'a> {
    /// In pixels.
    pub width: usize,
    /// In pixels.
    pub height: usize,
    /// Samples a pixel.
    pub channels: usize,
    /// `width · height · channels` samples.
    pub values: &'a [f32],
}

/// The image that `target` would have taken from where `source` took `image`, bilinearly interpolated; NaN where `source`
/// shows nothing. With `target = source.without_distortion()` it is the undistorted image. `None` if the image's size is
/// not its camera's or its values are not as many as it says.
pub fn rectify(image: &Samples, source: &Camera, target: &Camera) -> Option<Vec<f32>> {
    let Samples { width, height, channels, values } = *image;
    if (width, height) != (source.width as usize, source.height as usize) || values.len() != width * height * channels {
        return None;
    }
    let mut out = vec![f32::NAN; target.width as usize * target.height as usize * channels];
    let pixels = (0..target.height).flat_map(|v| (0..target.width).map(move |u| (u, v)));
    for (slot, (u, v)) in out.chunks_exact_mut(channels.max(1)).zip(pixels) {
        let at = target
            .unproject(&Point2::new(f64::from(u), f64::from(v)))
            .and_then(|ray| source.project(&Point3::from(ray)))
            .filter(|p| source.contains(p));
        let Some(at) = at else { continue };
        let (x, y) = (at.x.clamp(0.0, (width - 1) as f64), at.y.clamp(0.0, (height - 1) as f64));
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (fx, fy) = ((x - left as f64) as f32, (y - top as f64) as f32);
        for (channel, value) in slot.iter_mut().enumerate() {
            let sample = |x: usize, y: usize| values[(y * width + x) * channels + channel];
            let upper = sample(left, top) * (1.0 - fx) + sample(right, top) * fx;
            let lower = sample(left, bottom) * (1.0 - fx) + sample(right, bottom) * fx;
            *value = upper * (1.0 - fy) + lower * fy;
        }
    }
    Some(out)
}
