//! A photo in two bands: low frequencies, which are blended over all photos that see a point alike, and the rest, which the
//! sharper ones prevail in.
//!
//! The bands are split in the photo, not in the atlas: no chart's border shows, and no photo needs another to be split
//! (A. Baumberg, *Blending images for texturing 3D models*, BMVC 2002).

use crate::sight::Sight;
use nalgebra::Point2;
use rayon::prelude::*;

/// Pixels of a photo in a pixel of its low band.
const BLOCK: usize = 8;
/// The standard deviation of the low band's blur, as a share of the photo's longer side.
const BLUR: f64 = 0.012;

/// A photo's pixels.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Red, green and blue (sRGB), row by row from the top left.
    pub rgb: Vec<[u8; 3]>,
}

/// A photo, each level half as large as the one before, and its low band. Values are those of the file after `table`.
pub(crate) struct Bands {
    levels: Vec<Pixels>,
    low: Vec<[f32; 3]>,
    low_size: [usize; 2],
    table: [[f32; 256]; 3],
}

impl Bands {
    /// Splits a photo whose values are corrected by `table`, from 0 to 255 by channel. Only what it sees of the surface, away
    /// from edges, goes into the low band.
    pub(crate) fn new(photo: Pixels, sight: &Sight, table: [[f32; 256]; 3]) -> Self {
        let (width, height) = (photo.width as usize, photo.height as usize);
        let (w, h) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        let block = |i: usize| {
            let (x0, y0) = (i % w * BLOCK, i / w * BLOCK);
            let mut sum = [0.0f32; 4];
            for y in y0..(y0 + BLOCK).min(height) {
                for x in x0..(x0 + BLOCK).min(width) {
                    if sight.is_inside(y * width + x) {
                        let value = photo.rgb[y * width + x];
                        (0..3).for_each(|c| sum[c] += table[c][usize::from(value[c])]);
                        sum[3] += 1.0;
                    }
                }
            }
            sum
        };
        let blocks: Vec<[f32; 4]> = (0..w * h).into_par_iter().map(block).collect();
        let sigma = BLUR * width.max(height) as f64 / BLOCK as f64;
        let low = blurred(&blocks, w, h, sigma.max(0.5));
        let mut levels = vec![photo];
        while let Some(half) = levels.last().and_then(halved) {
            levels.push(half);
        }
        Self { levels, low, low_size: [w, h], table }
    }

    /// The finest level at which a pixel is about `footprint` pixels of the photo wide and stays `edge` pixels away from
    /// what is not to be seen.
    pub(crate) fn level(&self, footprint: f64, edge: f64) -> usize {
        let level = (footprint / 1.2).min(edge / 2.0).max(1.0).log2().floor() as usize;
        level.min(self.levels.len() - 1)
    }

    /// The colour at a pixel of the photo, from a level: Catmull–Rom interpolation.
    pub(crate) fn sample(&self, pixel: &Point2<f64>, level: usize) -> [f32; 3] {
        let Pixels { width, height, rgb } = &self.levels[level];
        let scale = 0.5f64.powi(level as i32);
        let (u, v) = ((pixel.x + 0.5) * scale - 0.5, (pixel.y + 0.5) * scale - 0.5);
        let (x, y) = (u.floor(), v.floor());
        let (wx, wy) = (catmull_rom((u - x) as f32), catmull_rom((v - y) as f32));
        let clamp = |i: i64, n: u32| i.clamp(0, i64::from(n) - 1) as usize;
        let mut sum = [0.0; 3];
        for (j, wy) in wy.iter().enumerate() {
            let row = clamp(y as i64 + j as i64 - 1, *height) * *width as usize;
            for (i, wx) in wx.iter().enumerate() {
                let value = rgb[row + clamp(x as i64 + i as i64 - 1, *width)];
                (0..3).for_each(|c| sum[c] += wx * wy * self.table[c][usize::from(value[c])]);
            }
        }
        sum
    }

    /// The low band at a pixel of the photo.
    pub(crate) fn low(&self, pixel: &Point2<f64>) -> [f32; 3] {
        let [w, h] = self.low_size;
        let at = |x: f64, n: usize| ((x + 0.5) / BLOCK as f64 - 0.5).clamp(0.0, (n - 1) as f64) as f32;
        let (u, v) = (at(pixel.x, w), at(pixel.y, h));
        let (x, y) = (u as usize, v as usize);
        let (right, below) = ((x + 1).min(w - 1), (y + 1).min(h - 1));
        let (fx, fy) = (u - x as f32, v - y as f32);
        let value = |x: usize, y: usize| self.low[y * w + x];
        let (a, b, c, d) = (value(x, y), value(right, y), value(x, below), value(right, below));
        std::array::from_fn(|k| (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy)
    }
}

/// The weights of the four pixels around a fraction of one.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

/// Sums with their weights, blurred and divided: means over what has weight.
fn blurred(sums: &[[f32; 4]], width: usize, height: usize, sigma: f64) -> Vec<[f32; 3]> {
    let reach = (3.0 * sigma).ceil() as i64;
    let kernel: Vec<f32> = (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32).collect();
    let pass = |values: &[[f32; 4]], step: usize, length: usize, position: &(dyn Fn(usize) -> usize + Sync)| {
        let blur = |i: usize| {
            let mut sum = [0.0f32; 4];
            for (weight, offset) in kernel.iter().zip(-reach..) {
                let moved = position(i) as i64 + offset;
                if (0..length as i64).contains(&moved) {
                    let value = values[(i as i64 + offset * step as i64) as usize];
                    (0..4).for_each(|c| sum[c] += weight * value[c]);
                }
            }
            sum
        };
        (0..values.len()).into_par_iter().map(blur).collect::<Vec<[f32; 4]>>()
    };
    let rows = pass(sums, 1, width, &|i| i % width);
    let both = pass(&rows, width, height, &|i| i / width);
    let (total, count) = sums.iter().fold(([0.0f64; 3], 0.0f64), |(total, count), s| {
        (std::array::from_fn(|c| total[c] + f64::from(s[c])), count + f64::from(s[3]))
    });
    let mean: [f32; 3] = total.map(|t| (t / count.max(1.0)) as f32);
    both.iter().map(|s| if s[3] > 1e-3 { [s[0] / s[3], s[1] / s[3], s[2] / s[3]] } else { mean }).collect()
}

/// A photo of half the size; `None` for one that is small already.
fn halved(photo: &Pixels) -> Option<Pixels> {
    let (width, height) = (photo.width as usize, photo.height as usize);
    if width.min(height) < 32 {
        return None;
    }
    let (w, h) = (width / 2, height / 2);
    let pixel = |i: usize| {
        let at = 2 * (i / w) * width + 2 * (i % w);
        let four = [at, at + 1, at + width, at + width + 1].map(|i| photo.rgb[i].map(u16::from));
        std::array::from_fn(|c| ((four[0][c] + four[1][c] + four[2][c] + four[3][c] + 2) / 4) as u8)
    };
    Some(Pixels {
        width: w as u32,
        height: h as u32,
        rgb: (0..w * h).into_par_iter().with_min_len(1 << 12).map(pixel).collect(),
    })
}
