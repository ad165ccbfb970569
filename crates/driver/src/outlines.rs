//! How well the outline of a rendering lies on the edges of a small picture: what tells a thing from its surroundings where
//! colours do not.
//!
//! The edges are the picture's structure tensor (W. Förstner and E. Gülch, *A fast operator for detection and precise location of
//! distinct points, corners and centres of circular features*, 1987), of the same strength where contrast is strong or weak, and
//! blurred: an outline a little beside an edge, and a little turned, lies on it still.

use texreg_raster::{GBuffer, NO_FACE, outline};

/// How far edges are blurred, in pixels: a standard deviation.
const BLUR: f32 = 1.5;

/// The side of the square around a pixel of the outline in which its direction is measured, in pixels from the middle.
const REACH: isize = 2;

/// Pixels beside the outline of a rendering.
#[derive(Default)]
pub(crate) struct Outline {
    /// Column, row, and what a tensor's components count: nx², 2 nx ny and ny² of the normal.
    pub(crate) pixels: Vec<(isize, isize, [f32; 3])>,
}

/// The edges of a picture of three channels: xx, xy and yy of the tensor at each pixel, row by row.
pub(crate) fn edges(width: usize, height: usize, pixels: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let at = |x: usize, y: usize| pixels[y * width + x];
    let tensor = |i: usize| {
        let (x, y) = (i % width, i / width);
        let across = at((x + 1).min(width - 1), y).into_iter().zip(at(x.saturating_sub(1), y));
        let down = at(x, (y + 1).min(height - 1)).into_iter().zip(at(x, y.saturating_sub(1)));
        across.zip(down).fold([0.0; 3], |[xx, xy, yy], ((right, left), (below, above))| {
            let (dx, dy) = (right - left, below - above);
            [xx + dx * dx, xy + dx * dy, yy + dy * dy]
        })
    };
    let mut tensors: Vec<[f32; 3]> = (0..width * height).map(tensor).collect();
    let strength = |[xx, _, yy]: &[f32; 3]| (xx + yy).sqrt();
    let mean = tensors.iter().map(strength).sum::<f32>() / tensors.len().max(1) as f32;
    for tensor in &mut tensors {
        let strength = strength(tensor);
        let unit = 1.0 / (strength * (strength + mean)).max(f32::MIN_POSITIVE);
        *tensor = tensor.map(|x| x * unit);
    }
    blur(&blur(&tensors, width, height, (1, 0)), width, height, (0, 1))
}

/// Blurred along one axis; beyond its border a picture goes on as it ends.
fn blur(tensors: &[[f32; 3]], width: usize, height: usize, (dx, dy): (isize, isize)) -> Vec<[f32; 3]> {
    let reach = (2.5 * BLUR).ceil() as isize;
    let kernel: Vec<(isize, f32)> = (-reach..=reach).map(|r| (r, (-0.5 * (r as f32 / BLUR).powi(2)).exp())).collect();
    let whole: f32 = kernel.iter().map(|(_, weight)| weight).sum();
    let at = |i: usize, r: isize| {
        let clamped = |x: usize, d: isize, length: usize| (x as isize + d).clamp(0, length as isize - 1) as usize;
        tensors[clamped(i / width, r * dy, height) * width + clamped(i % width, r * dx, width)]
    };
    let mean = |i: usize| {
        let sum = kernel.iter().fold([0.0; 3], |mut sum: [f32; 3], &(r, weight)| {
            sum.iter_mut().zip(at(i, r)).for_each(|(sum, x)| *sum += weight * x);
            sum
        });
        sum.map(|sum| sum / whole)
    };
    (0..tensors.len()).map(mean).collect()
}

impl Outline {
    /// The background pixels beside what a rendering shows.
    pub(crate) fn of(picture: &GBuffer) -> Self {
        let (width, height) = (picture.width as isize, picture.height as isize);
        let is_shown = |x: isize, y: isize| {
            (0..width).contains(&x) && (0..height).contains(&y) && picture.face[(y * width + x) as usize] != NO_FACE
        };
        let pixels = outline(picture, 1.0).into_iter().filter_map(|halo| {
            let (x, y) = (halo.pixel as isize % width, halo.pixel as isize / width);
            let around = (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx, dy)));
            let inside = around.filter(|(dx, dy)| is_shown(x + dx, y + dy));
            let [nx, ny] = inside.fold([0.0; 2], |[nx, ny]: [f32; 2], (dx, dy)| [nx + dx as f32, ny + dy as f32]);
            let square = nx * nx + ny * ny;
            let counts = [nx * nx, 2.0 * nx * ny, ny * ny].map(|x| x / square);
            (square > 0.0).then_some((x, y, counts))
        });
        Self { pixels: pixels.collect() }
    }

    /// How much of the outline lies on edges, from 0 to 1, where these are their tensors.
    pub(crate) fn on<'a>(&self, tensor: impl Fn(isize, isize) -> Option<&'a [f32; 3]>) -> f64 {
        let mut sum = 0.0;
        for (x, y, counts) in &self.pixels {
            if let Some(tensor) = tensor(*x, *y) {
                sum += tensor.iter().zip(counts).map(|(a, b)| a * b).sum::<f32>();
            }
        }
        f64::from(sum) / self.pixels.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outline_lies_on_the_edges_of_what_it_surrounds() {
        let (width, height) = (40, 30);
        let is_inside = |x: usize, y: usize| (12..26).contains(&x) && (8..20).contains(&y);
        let face = vec![NO_FACE; width * height];
        let mut picture = GBuffer { width: width as u32, height: height as u32, face, ..GBuffer::default() };
        let mut pixels = vec![[0.2, 0.0, 0.0]; width * height];
        for (x, y) in (0..width).flat_map(|x| (0..height).map(move |y| (x, y))).filter(|&(x, y)| is_inside(x, y)) {
            picture.face[y * width + x] = 0;
            pixels[y * width + x] = [0.2, 0.3, 0.0];
        }
        let outline = Outline::of(&picture);
        assert_eq!(outline.pixels.len(), 2 * (14 + 12));
        let on = |tensors: &[[f32; 3]], dx: isize, dy: isize| {
            outline.on(|x, y| {
                let (x, y) = (usize::try_from(x + dx).ok()?, usize::try_from(y + dy).ok()?);
                (x < width && y < height).then(|| &tensors[y * width + x])
            })
        };
        let tensors = edges(width, height, &pixels);
        let there = on(&tensors, 0, 0);
        assert!(there > 0.3 && there <= 1.0, "{there}");
        // Its upper and lower sides still lie on those of the square, then none does.
        assert!(on(&tensors, 6, 0) < 0.7 * there && on(&tensors, 6, 0) > 0.2 * there);
        assert!(on(&tensors, 6, 6) < 0.2 * there);
        let faint: Vec<[f32; 3]> = pixels.iter().map(|pixel| pixel.map(|x| 0.01 * x)).collect();
        assert!((on(&edges(width, height, &faint), 0, 0) - there).abs() < 1e-4, "contrast does not count");
        assert_eq!(on(&edges(width, height, &vec![[0.5; 3]; width * height]), 0, 0), 0.0);
    }
}
