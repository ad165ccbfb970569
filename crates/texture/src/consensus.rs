//! What the photos agree on: gains that match their exposure and white balance, and how far to trust each photo where.
//!
//! Both come from cells, blocks of texels, at whose middle every photo that sees it is asked for its colour.

use crate::atlas::{Atlas, clamped};
use crate::inpaint::spread;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use texreg_raster::NO_FACE;
use texreg_surface::Mesh;

/// Texels along the side of a cell.
pub(crate) const CELL: u32 = 8;
/// Values outside of this range are clipped or noise, and say nothing about exposure.
const USABLE: std::ops::RangeInclusive<u8> = 12..=243;
/// Cells that are compared between two photos, at most.
const COMPARED: usize = 20_000;
/// Cells two photos must share to be compared.
const FEWEST: usize = 30;
/// The pull of gains towards 1, as a share of the weight of one comparison.
const PULL: f64 = 1e-3;
/// The difference from what most photos show at which trust is down to a quarter, of 255; it grows with their own spread.
const TOLERANCE: f32 = 40.0;
/// Photos that differ by no more in a cell, of 255, agree there.
const AGREED: f32 = 24.0;

/// The colours of a photo by cell; the fourth number is 0 where it sees nothing.
pub(crate) type Observations = Vec<[u8; 4]>;

/// Cells of an atlas.
pub(crate) struct Cells {
    /// Cells in a row.
    width: u32,
    atlas_width: u32,
    /// The texel in the middle of each cell, `u32::MAX` where it is empty.
    pub(crate) texels: Vec<u32>,
}

impl Cells {
    pub(crate) fn new(atlas: &Atlas) -> Self {
        let width = atlas.width.div_ceil(CELL);
        let height = atlas.height.div_ceil(CELL);
        let middle = |cell: u32| {
            let (x0, y0) = (cell % width * CELL, cell / width * CELL);
            let rows = y0..(y0 + CELL).min(atlas.height);
            let texels = rows.flat_map(|y| (x0..(x0 + CELL).min(atlas.width)).map(move |x| y * atlas.width + x));
            let covered: Vec<u32> = texels.filter(|&t| atlas.face[t as usize] != NO_FACE).collect();
            covered.get(covered.len() / 2).copied().unwrap_or(u32::MAX)
        };
        let texels = (0..width * height).into_par_iter().map(middle).collect();
        Self { width, atlas_width: atlas.width, texels }
    }

    /// The cell of a texel.
    pub(crate) fn of(&self, texel: u32) -> usize {
        let (x, y) = (texel % self.atlas_width, texel / self.atlas_width);
        (y / CELL * self.width + x / CELL) as usize
    }

    /// By cell, the least value of it and of the eight around it.
    fn least_around(&self, values: &[u8]) -> Vec<u8> {
        let width = self.width as usize;
        let least = |i: usize| {
            let (x, y) = (i % width, i / width);
            let rows = (y.saturating_sub(1)..(y + 2).min(values.len() / width)).map(|y| y * width);
            let row = |start: usize| values[start + x.saturating_sub(1)..start + (x + 2).min(width)].iter();
            rows.flat_map(row).copied().min().unwrap_or(values[i])
        };
        (0..values.len()).map(least).collect()
    }
}

/// The gain of each photo and channel in linear light, so that photos agree where they overlap; their logarithms have mean zero.
///
/// Two photos are compared by the median of the logarithms of their ratios; the gains fit these medians best in the sense of
/// least squares, each weighted by the root of the number of cells it comes from.
pub(crate) fn gains(observations: &[Observations]) -> Vec<[f64; 3]> {
    let n = observations.len();
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    let compared: Vec<_> = pairs.par_iter().map(|&(i, j)| compare(&observations[i], &observations[j])).collect();
    let mut gains = vec![[1.0; 3]; n];
    for channel in 0..3 {
        let (mut matrix, mut right) = (DMatrix::<f64>::identity(n, n) * PULL, DVector::<f64>::zeros(n));
        for (&(i, j), comparison) in pairs.iter().zip(&compared) {
            let Some((ratios, cells)) = comparison else { continue };
            let weight = (*cells as f64 / COMPARED as f64).sqrt();
            matrix[(i, i)] += weight;
            matrix[(j, j)] += weight;
            matrix[(i, j)] -= weight;
            matrix[(j, i)] -= weight;
            // log g_i + log v_i = log g_j + log v_j
            right[i] -= weight * ratios[channel];
            right[j] += weight * ratios[channel];
        }
        let Some(logs) = matrix.cholesky().map(|c| c.solve(&right)) else { continue };
        let mean = logs.mean();
        gains.iter_mut().zip(logs.iter()).for_each(|(gain, log)| gain[channel] = (log - mean).exp());
    }
    gains
}

/// The medians of `log(a / b)` in linear light, by channel, and the number of cells they come from.
fn compare(a: &Observations, b: &Observations) -> Option<([f64; 3], usize)> {
    let usable = |v: &[u8; 4]| v[3] > 0 && v[..3].iter().all(|x| USABLE.contains(x));
    let shared: Vec<usize> = (0..a.len()).filter(|&k| usable(&a[k]) && usable(&b[k])).collect();
    if shared.len() < FEWEST {
        return None;
    }
    let step = shared.len().div_ceil(COMPARED);
    let taken: Vec<usize> = shared.into_iter().step_by(step).collect();
    let median = |channel: usize| {
        let ratio = |&k: &usize| (linear(a[k][channel]) / linear(b[k][channel])).ln();
        let mut ratios: Vec<f64> = taken.iter().map(ratio).collect();
        let middle = ratios.len() / 2;
        *ratios.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    Some(([median(0), median(1), median(2)], taken.len()))
}

/// The values of a channel, 0 to 255, after a gain in linear light; beyond 255 where the gain takes them there.
pub(crate) fn table(gain: f64) -> [f32; 256] {
    std::array::from_fn(|v| (255.0 * encoded(gain * linear(v as u8))) as f32)
}

/// Linear light of an sRGB value (IEC 61966-2-1).
fn linear(value: u8) -> f64 {
    let v = f64::from(value) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The inverse, on 0 to 1 and beyond.
fn encoded(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// The photos that see a cell, and the colours they show there after their `tables`.
fn shown(observations: &[Observations], tables: &[[[f32; 256]; 3]], cell: usize) -> Vec<(usize, [f32; 3])> {
    let seeing = (0..observations.len()).filter(|&i| observations[i][cell][3] > 0);
    let colour = |i: usize| std::array::from_fn(|c| tables[i][c][usize::from(observations[i][cell][c])]);
    seeing.map(|i| (i, colour(i))).collect()
}

/// What the surface around each cell looks like: colours spread over it from the cells in which two or more photos agree. Empty if
/// there is none.
pub(crate) fn surroundings(
    mesh: &Mesh,
    atlas: &Atlas,
    cells: &Cells,
    observations: &[Observations],
    tables: &[[[f32; 256]; 3]],
) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0f32; 4]; mesh.positions.len()];
    for (cell, &texel) in cells.texels.iter().enumerate() {
        let colours = shown(observations, tables, cell);
        let [low, high] = [f32::min, f32::max].map(|extreme| {
            let first = colours.first().map_or([0.0; 3], |(_, colour)| *colour);
            colours.iter().fold(first, |all, (_, colour)| std::array::from_fn(|c| extreme(all[c], colour[c])))
        });
        if colours.len() < 2 || (0..3).any(|c| high[c] - low[c] > AGREED) {
            continue;
        }
        let (face, weights) = atlas.weights(texel);
        for (&vertex, weight) in mesh.triangles[face as usize].iter().zip(clamped(weights)) {
            let (sum, weight) = (&mut sums[vertex as usize], weight as f32);
            (0..3).for_each(|c| sum[c] += weight * 0.5 * (low[c] + high[c]));
            sum[3] += weight;
        }
    }
    let known = |s: &[f32; 4]| (s[3] > 0.0).then(|| [s[0] / s[3], s[1] / s[3], s[2] / s[3]]);
    let known: Vec<Option<[f32; 3]>> = sums.iter().map(known).collect();
    if known.iter().all(Option::is_none) {
        return Vec::new();
    }
    let colours = spread(mesh, &known);
    let at = |&texel: &u32| if texel == u32::MAX { [0.0; 3] } else { atlas.interpolated(mesh, texel, &colours) };
    cells.texels.par_iter().with_min_len(1 << 10).map(at).collect()
}

/// How far to trust each photo in each cell, 0 to 255: those that differ from what most show are not trusted there, nor in the
/// cells next to it. Such is what stands between camera and surface, and a highlight. Where the number of photos is even, what is
/// around the cell has a vote as well, or two photos that differ could not be decided between.
pub(crate) fn trust(
    observations: &[Observations],
    tables: &[[[f32; 256]; 3]],
    surroundings: &[[f32; 3]],
    cells: &Cells,
) -> Vec<Vec<u8>> {
    let by_cell: Vec<Vec<(usize, u8)>> = (0..cells.texels.len())
        .into_par_iter()
        .with_min_len(1 << 10)
        .map(|cell| {
            let colours = shown(observations, tables, cell);
            let vote = surroundings.get(cell).filter(|_| colours.len().is_multiple_of(2));
            if colours.len() + usize::from(vote.is_some()) < 3 {
                return Vec::new();
            }
            let median = |mut values: Vec<f32>| {
                let middle = (values.len() - 1) / 2;
                *values.select_nth_unstable_by(middle, f32::total_cmp).1
            };
            let votes = || colours.iter().map(|(_, colour)| colour).chain(vote);
            let centre: [f32; 3] = std::array::from_fn(|c| median(votes().map(|v| v[c]).collect()));
            let distance = |v: &[f32; 3]| (0..3).map(|c| (v[c] - centre[c]).abs()).fold(0.0, f32::max);
            let spread = median(colours.iter().map(|(_, v)| distance(v)).collect());
            let tolerance = TOLERANCE + 2.0 * spread;
            let trusted = |v: &[f32; 3]| (255.0 / (1.0 + (distance(v) / tolerance).powi(2)).powi(2)).max(1.0) as u8;
            colours.iter().map(|(i, v)| (*i, trusted(v))).collect()
        })
        .collect();
    let mut trust = vec![vec![u8::MAX; cells.texels.len()]; observations.len()];
    for (cell, values) in by_cell.iter().enumerate() {
        values.iter().for_each(|&(i, value)| trust[i][cell] = value);
    }
    trust.par_iter().map(|trust| cells.least_around(trust)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_undo_exposure_and_white_balance() {
        let scene: Vec<[f64; 3]> =
            (0..4000).map(|i| [0.1, 0.2, 0.15].map(|base| base + 0.2 * f64::from(i % 97) / 97.0)).collect();
        let shot = |gain: [f64; 3], seen: fn(usize) -> bool| -> Observations {
            let value = |light: f64| (255.0 * encoded(light)).round() as u8;
            let cell = |(i, c): (usize, &[f64; 3])| {
                if seen(i) {
                    [value(c[0] * gain[0]), value(c[1] * gain[1]), value(c[2] * gain[2]), 255]
                } else {
                    [0; 4]
                }
            };
            scene.iter().enumerate().map(cell).collect()
        };
        // The first and the last photo share nothing but the second.
        let photos =
            [shot([1.0; 3], |i| i < 2000), shot([1.5, 1.2, 1.0], |_| true), shot([0.7, 0.9, 1.3], |i| i >= 2000)];
        let found = gains(&photos);
        for channel in 0..3 {
            let balanced = [1.0, [1.5, 1.2, 1.0][channel], [0.7, 0.9, 1.3][channel]];
            let product: Vec<f64> = (0..3).map(|i| found[i][channel] * balanced[i]).collect();
            assert!(
                (product[0] / product[1] - 1.0).abs() < 0.01 && (product[2] / product[1] - 1.0).abs() < 0.01,
                "{product:?}"
            );
        }
    }

    #[test]
    fn what_most_photos_do_not_see_is_not_trusted() {
        let photos =
            [[100u8, 100, 100, 255], [104, 99, 101, 255], [20, 20, 20, 255], [97, 100, 99, 255]].map(|v| vec![v; 5]);
        let trust = trust(&photos, &[[table(1.0); 3]; 4], &[], &row(5));
        assert!(trust[0][0] > 200 && trust[1][0] > 200 && trust[3][0] > 200 && trust[2][0] < 60, "{trust:?}");
    }

    #[test]
    fn what_is_around_decides_between_two_photos() {
        // In the third of five cells, something dark stands before one of them.
        let mut dark = vec![[180u8, 150, 120, 255]; 5];
        let photos = [dark.clone(), {
            dark[2] = [30, 30, 30, 255];
            dark
        }];
        let tables = [[table(1.0); 3]; 2];
        let undecided = trust(&photos, &tables, &[], &row(5));
        assert!(undecided.iter().flatten().all(|t| *t == 255), "{undecided:?}");
        let found = trust(&photos, &tables, &[[170.0, 150.0, 130.0]; 5], &row(5));
        assert!(found[0].iter().all(|t| *t > 200), "{found:?}");
        assert!(found[1][1..4].iter().all(|t| *t < 20) && found[1][0] > 200 && found[1][4] > 200, "{found:?}");
    }

    /// Cells in a row.
    fn row(count: u32) -> Cells {
        Cells { width: count, atlas_width: count * CELL, texels: (0..count).map(|i| i * CELL).collect() }
    }
}
