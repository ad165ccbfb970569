//! How alike two pictures are: peak signal-to-noise ratio, and structural similarity.
//!
//! Z. Wang, A. Bovik, H. Sheikh and E. Simoncelli, *Image quality assessment: from error visibility to structural similarity*,
//! IEEE Transactions on Image Processing 13, 2004.

use image::RgbImage;

/// How alike two pictures are over some of their pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// 10 log₁₀(255² / mean squared difference over the three channels), dB; infinite for equal pictures.
    pub psnr: f64,
    /// The mean structural similarity of their luma, at most 1.
    pub ssim: f64,
    /// The number of pixels compared.
    pub pixels: usize,
}

/// The window of the structural similarity: 11 × 11 pixels, a Gaussian of this standard deviation.
const SIGMA: f64 = 1.5;
const REACH: i64 = 5;

/// Compares two pictures of the same size over the pixels of a mask. Windows are cut to the mask, so that what lies outside of it
/// has no part in the result.
pub fn agreement(a: &RgbImage, b: &RgbImage, mask: &[bool]) -> Option<Agreement> {
    if a.dimensions() != b.dimensions() || mask.len() as u64 != u64::from(a.width()) * u64::from(a.height()) {
        return None;
    }
    let pixels = mask.iter().filter(|m| **m).count();
    if pixels == 0 {
        return None;
    }
    let (pa, pb) = (a.as_chunks::<3>().0, b.as_chunks::<3>().0);
    let squared = |i: usize| (0..3).map(|c| (f64::from(pa[i][c]) - f64::from(pb[i][c])).powi(2)).sum::<f64>();
    let error = (0..mask.len()).filter(|&i| mask[i]).map(squared).sum::<f64>() / (3 * pixels) as f64;
    let luma = |p: &[u8; 3]| 0.2126 * f64::from(p[0]) + 0.7152 * f64::from(p[1]) + 0.0722 * f64::from(p[2]);
    let width = a.width() as usize;
    // Weight, and weighted sums of a, b, a², b² and ab.
    let moments: Vec<[f64; 6]> = (0..mask.len())
        .map(|i| {
            let (x, y) = (luma(&pa[i]), luma(&pb[i]));
            if mask[i] { [1.0, x, y, x * x, y * y, x * y] } else { [0.0; 6] }
        })
        .collect();
    let kernel: Vec<f64> = (-REACH..=REACH).map(|i| (-0.5 * (i as f64 / SIGMA).powi(2)).exp()).collect();
    let blur = |values: &[[f64; 6]], step: usize, position: &dyn Fn(usize) -> usize, length: usize| {
        let blur = |i: usize| {
            let mut sum = [0.0; 6];
            for (weight, offset) in kernel.iter().zip(-REACH..) {
                if (0..length as i64).contains(&(position(i) as i64 + offset)) {
                    let value = values[(i as i64 + offset * step as i64) as usize];
                    (0..6).for_each(|k| sum[k] += weight * value[k]);
                }
            }
            sum
        };
        (0..values.len()).map(blur).collect::<Vec<_>>()
    };
    let rows = blur(&moments, 1, &|i| i % width, width);
    let both = blur(&rows, width, &|i| i / width, mask.len() / width);
    let (c1, c2) = ((0.01f64 * 255.0).powi(2), (0.03f64 * 255.0).powi(2));
    let similarity = |m: &[f64; 6]| {
        let [x, y, xx, yy, xy] = [m[1] / m[0], m[2] / m[0], m[3] / m[0], m[4] / m[0], m[5] / m[0]];
        let (vx, vy, cov) = (xx - x * x, yy - y * y, xy - x * y);
        ((2.0 * x * y + c1) * (2.0 * cov + c2)) / ((x * x + y * y + c1) * (vx + vy + c2))
    };
    let total: f64 = (0..mask.len()).filter(|&i| mask[i]).map(|i| similarity(&both[i])).sum();
    Some(Agreement { psnr: 10.0 * (255.0 * 255.0 / error).log10(), ssim: total / pixels as f64, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn equal_pictures_agree_and_shifted_ones_as_the_formulas_say() {
        let ramp = RgbImage::from_fn(40, 30, |x, y| Rgb([(3 * x + y) as u8, (5 * y) as u8, (x * y % 200) as u8]));
        let all = vec![true; 1200];
        let same = agreement(&ramp, &ramp, &all).unwrap();
        assert!(same.psnr.is_infinite() && (same.ssim - 1.0).abs() < 1e-12 && same.pixels == 1200);
        // Flat pictures: only the luminance term is left.
        let flat = |v: u8| RgbImage::from_pixel(40, 30, Rgb([v; 3]));
        let found = agreement(&flat(100), &flat(120), &all).unwrap();
        assert!((found.psnr - 10.0 * (255.0f64 / 20.0).powi(2).log10()).abs() < 1e-9);
        let c1 = 2.55f64.powi(2);
        let expected = (2.0 * 100.0 * 120.0 + c1) / (100.0f64.powi(2) + 120.0f64.powi(2) + c1);
        assert!((found.ssim - expected).abs() < 1e-9);
    }

    #[test]
    fn what_is_outside_the_mask_does_not_count() {
        let a = RgbImage::from_fn(40, 30, |x, _| Rgb([(6 * x) as u8; 3]));
        let mut b = a.clone();
        (20..40).for_each(|x| (0..30).for_each(|y| b.put_pixel(x, y, Rgb([7, 200, 9]))));
        let mask: Vec<bool> = (0..1200).map(|i| i % 40 < 20).collect();
        let found = agreement(&a, &b, &mask).unwrap();
        assert!(found.psnr.is_infinite() && (found.ssim - 1.0).abs() < 1e-9);
        assert!(agreement(&a, &b, &[true]).is_none() && agreement(&a, &b, &[false; 1200]).is_none());
    }
}
