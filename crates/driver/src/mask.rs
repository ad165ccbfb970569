//! Where a photo shows the object: from a mask, or from colours that the photo's border has and its middle does not.

use crate::Photo;
use crate::palette::palette;

/// Colours told apart.
const COLOURS: usize = 96;

/// The border that is taken for background, as a share of the shorter side.
const BORDER: f64 = 0.04;

/// How much of each pixel shows the object, 0 to 1, row by row: the photo's mask if it has one, else a guess.
///
/// The guess takes the photo's border for background. With `b(c)` a colour's frequency there and `a(c)` in the whole photo, a pixel
/// shows background with the probability `min(1, π b(c)/a(c))`; `π`, the background's share, is the largest for which the colours do not
/// contradict it. With a uniform background that is the backdrop's colour; elsewhere it is as good as the colours differ.
pub(crate) fn silhouette(photo: &Photo) -> Vec<f32> {
    let (width, height) = (photo.width as usize, photo.height as usize);
    if let Some(mask) = &photo.mask {
        return mask.iter().map(|&shown| f32::from(u8::from(shown))).collect();
    }
    let pixels: Vec<[f32; 3]> = photo.rgb.iter().map(|pixel| pixel.map(f32::from)).collect();
    let colours = palette(&pixels, COLOURS);
    let border = ((BORDER * width.min(height) as f64) as usize).max(1);
    let is_border = |i: usize| {
        let (x, y) = (i % width, i / width);
        x < border || y < border || x + border >= width || y + border >= height
    };
    let mut counts = [[0.0f64; 2]; COLOURS];
    for (i, &colour) in colours.iter().enumerate() {
        let count = &mut counts[usize::from(colour)];
        count[0] += 1.0;
        count[1] += f64::from(u8::from(is_border(i)));
    }
    let total: [f64; 2] = std::array::from_fn(|k| counts.iter().map(|count| count[k]).sum::<f64>().max(1.0));
    let ratio = |count: &[f64; 2]| (count[1] / total[1]) / (count[0] / total[0]).max(1e-12);
    // Half of the border's pixels have colours of at least this ratio: these are nowhere but in the background.
    let mut ratios: Vec<(f64, f64)> = counts.iter().map(|count| (ratio(count), count[1])).collect();
    ratios.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut seen = 0.0;
    let typical = ratios.iter().find(|(_, count)| {
        seen += count;
        2.0 * seen >= total[1]
    });
    let typical = typical.map_or(1.0, |(ratio, _)| ratio.max(1e-6));
    let object = counts.map(|count| 1.0 - (ratio(&count) / typical).min(1.0));
    let guess: Vec<f32> = colours.iter().map(|&colour| object[usize::from(colour)] as f32).collect();
    smoothed(&guess, width, height)
}

/// Means over windows of a hundredth of the longer side, twice, and what is above one half.
fn smoothed(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let reach = (width.max(height) / 200).max(1);
    let mut current = values.to_vec();
    let mut next = vec![0.0; values.len()];
    for _ in 0..2 {
        for row in 0..height {
            box_mean(&current[row * width..], &mut next[row * width..], width, 1, reach);
        }
        for column in 0..width {
            box_mean(&next[column..], &mut current[column..], height, width, reach);
        }
    }
    current.iter().map(|&value| f32::from(u8::from(value > 0.5))).collect()
}

/// Running means of `count` values that are `stride` apart.
fn box_mean(from: &[f32], to: &mut [f32], count: usize, stride: usize, reach: usize) {
    let mut sum: f32 = (0..reach.min(count)).map(|i| from[i * stride]).sum();
    let mut window = reach.min(count);
    for i in 0..count {
        if i + reach < count {
            sum += from[(i + reach) * stride];
            window += 1;
        }
        if i > reach {
            sum -= from[(i - reach - 1) * stride];
            window -= 1;
        }
        to[i * stride] = sum / window as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_before_a_plain_backdrop_is_found() {
        let (width, height) = (200u32, 150u32);
        let inside = |i: u32| {
            let (x, y) = (f64::from(i % width) - 110.0, f64::from(i / width) - 70.0);
            x.hypot(y) < 45.0
        };
        let noise = |i: u32| ((i * 7919) % 13) as u8;
        let rgb: Vec<[u8; 3]> = (0..width * height)
            .map(|i| {
                if inside(i) { [90 + noise(i), 60, 40 + (i % 90) as u8] } else { [150 + noise(i), 150 + noise(i), 160] }
            })
            .collect();
        let luma = vec![0.5; rgb.len()];
        let mut photo = Photo { file: "disc.png".into(), width, height, luma, rgb, focal_35mm: None, mask: None };
        let guess = silhouette(&photo);
        let wrong = (0..width * height).filter(|&i| (guess[i as usize] > 0.5) != inside(i)).count();
        assert!(wrong < 200, "{wrong} of 30000 pixels");
        photo.mask = Some((0..width * height).map(|i| i % 2 == 0).collect());
        assert_eq!(silhouette(&photo)[..3], [1.0, 0.0, 1.0]);
    }
}
