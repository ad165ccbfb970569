//! What of a photo is compared with the model: one number a pixel.

use crate::Photo;
use crate::options::ChannelName;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// The window of the local contrast, as a share of the photo's longer side.
const NEIGHBOURHOOD: f64 = 0.05;

/// Deviations of the local contrast below this are noise, in the range of the photo.
const NOISE: f64 = 0.02;

/// The values of a channel, in any range, row by row.
pub(crate) fn channel(photo: &Photo, name: ChannelName) -> Vec<f32> {
    let colour = |k: usize| photo.rgb.par_iter().map(|pixel| f32::from(pixel[k]) / 255.0).collect();
    let (width, height) = (photo.width as usize, photo.height as usize);
    match name {
        ChannelName::Luma => photo.luma.clone(),
        ChannelName::Red => colour(0),
        ChannelName::Green => colour(1),
        ChannelName::Blue => colour(2),
        ChannelName::Principal => principal(&photo.rgb),
        ChannelName::Contrast => contrast(&photo.luma, width, height),
        ChannelName::Gradient => magnitude(&photo.luma, width, height),
    }
}

/// The first principal component of the colours.
fn principal(pixels: &[[u8; 3]]) -> Vec<f32> {
    let vector = |pixel: &[u8; 3]| Vector3::from(pixel.map(|v| f64::from(v) / 255.0));
    let some = || pixels.iter().step_by(pixels.len() / 50_000 + 1).map(vector);
    let count = some().count().max(1) as f64;
    let mean = some().sum::<Vector3<f64>>() / count;
    let covariance = some().map(|v| (v - mean) * (v - mean).transpose()).sum::<Matrix3<f64>>() / count;
    let eigen = covariance.symmetric_eigen();
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    // Brighter is larger.
    let axis = axis * if axis.sum() < 0.0 { -1.0 } else { 1.0 };
    pixels.par_iter().map(|pixel| axis.dot(&vector(pixel)) as f32).collect()
}

/// The deviation from the mean around a pixel, by the standard deviation there.
fn contrast(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let reach = ((0.5 * NEIGHBOURHOOD * width.max(height) as f64) as usize).max(1);
    // Sums of values and of their squares over everything above and to the left (F. Crow, *Summed-area tables*, 1984).
    let mut sums = vec![[0.0f64; 2]; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = [0.0; 2];
        for x in 0..width {
            let value = f64::from(values[y * width + x]);
            row[0] += value;
            row[1] += value * value;
            let above = sums[y * (width + 1) + x + 1];
            sums[(y + 1) * (width + 1) + x + 1] = [above[0] + row[0], above[1] + row[1]];
        }
    }
    let local = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (left, right) = (x.saturating_sub(reach), (x + reach + 1).min(width));
        let (top, bottom) = (y.saturating_sub(reach), (y + reach + 1).min(height));
        let corner = |x: usize, y: usize| sums[y * (width + 1) + x];
        let count = ((right - left) * (bottom - top)) as f64;
        let [mean, square] = [0, 1].map(|k| {
            (corner(right, bottom)[k] - corner(left, bottom)[k] - corner(right, top)[k] + corner(left, top)[k]) / count
        });
        let deviation = (square - mean * mean).max(0.0).sqrt();
        ((f64::from(values[i]) - mean) / (deviation + NOISE)) as f32
    };
    (0..values.len()).into_par_iter().with_min_len(4096).map(local).collect()
}

/// The magnitude of the gradient.
fn magnitude(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let at = |x: usize, y: usize| values[y * width + x];
    let slope = |i: usize| {
        let (x, y) = (i % width, i / width);
        let dx = at((x + 1).min(width - 1), y) - at(x.saturating_sub(1), y);
        let dy = at(x, (y + 1).min(height - 1)) - at(x, y.saturating_sub(1));
        dx.hypot(dy)
    };
    (0..values.len()).into_par_iter().with_min_len(4096).map(slope).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reddish ramp.
    fn photo() -> Photo {
        let (width, height) = (60u32, 40u32);
        let rgb: Vec<[u8; 3]> = (0..width * height).map(|i| [(4 * (i % width)) as u8, (i % width) as u8, 20]).collect();
        let luma = rgb.iter().map(|p| f32::from(p[0]) / 255.0).collect();
        Photo { file: "ramp.png".into(), width, height, luma, rgb, focal_35mm: None, mask: None }
    }

    #[test]
    fn every_channel_reads_the_ramp() {
        let photo = photo();
        for &name in ChannelName::ALL {
            let values = channel(&photo, name);
            assert_eq!(values.len(), 2400, "{name}");
            assert!(values.iter().all(|v| v.is_finite()), "{name}");
        }
        let row = |name| channel(&photo, name)[20 * 60..21 * 60].to_vec();
        let rises = |row: &[f32]| row.windows(2).all(|pair| pair[1] > pair[0]);
        assert!(rises(&row(ChannelName::Principal)) && rises(&row(ChannelName::Red)));
        assert!(row(ChannelName::Blue).iter().all(|&v| v == 20.0 / 255.0));
        // Far from the border the neighbourhood of a ramp is balanced, and its slope everywhere the same.
        assert!(row(ChannelName::Contrast)[10..50].iter().all(|v| v.abs() < 1e-3));
        let slopes = row(ChannelName::Gradient);
        assert!(slopes[1..59].iter().all(|v| (v - 8.0 / 255.0).abs() < 1e-6));
    }
}
