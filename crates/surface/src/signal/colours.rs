//! The model's own colours, in a palette of colours that are about equally frequent: P. Heckbert, *Color image quantization for
//! frame buffer display*, SIGGRAPH 1982 (median cut).
use super::{Signal, Surfel};
use crate::mesh::Mesh;

/// About how many vertices the palette is made from.
const SAMPLE: usize = 50_000;

/// How much more a difference of hue counts than one of brightness.
const HUE: f32 = 2.0;

/// The vertex colours, told apart by brightness and hue.
#[derive(Clone, Debug)]
pub struct Colours {
    /// The cuts of the colours' box; the first is the root.
    cuts: Vec<Cut>,
    bins: usize,
}

/// A cut of a box of colours into what is below a value and the rest.
#[derive(Clone, Copy, Debug)]
struct Cut {
    axis: usize,
    value: f32,
    sides: [Side; 2],
}

/// What lies on a side of a cut.
#[derive(Clone, Copy, Debug)]
enum Side {
    Cut(u32),
    Bin(u32),
}

impl Colours {
    /// The colours in so many bins (fewer where there are no more); `None` if the model has none.
    pub fn new(mesh: &Mesh, bins: usize) -> Option<Self> {
        let colours = mesh.colours.as_ref()?;
        let chosen = colours.iter().step_by(colours.len() / SAMPLE + 1);
        let mut samples: Vec<[f32; 3]> = chosen.map(|colour| opponent(colour.map(f32::from))).collect();
        let mut palette = Self { cuts: Vec::new(), bins: 1 };
        // Each box: how widely it spreads and along which axis, its part of the samples, and the side of the cut it is.
        let mut boxes = vec![(spread(&samples), 0..samples.len(), None)];
        while boxes.len() < bins {
            let Some(widest) = (0..boxes.len()).max_by(|&a, &b| boxes[a].0.0.total_cmp(&boxes[b].0.0)) else { break };
            let ((deviation, axis), range, parent) = boxes[widest].clone();
            if deviation <= 0.0 {
                break;
            }
            let part = &mut samples[range.clone()];
            part.sort_unstable_by(|a, b| a[axis].total_cmp(&b[axis]));
            // At the median, or at the next value where many are equal.
            let median = part[part.len() / 2][axis];
            let mut middle = part.partition_point(|colour| colour[axis] < median);
            if middle == 0 {
                middle = part.partition_point(|colour| colour[axis] <= median);
            }
            let Some(value) = part.get(middle).map(|colour| colour[axis]) else { break };
            let new = palette.cuts.len() as u32;
            let bin = boxes.len() as u32;
            palette.cuts.push(Cut { axis, value, sides: [Side::Bin(widest as u32), Side::Bin(bin)] });
            if let Some((cut, side)) = parent {
                let parent: &mut Cut = &mut palette.cuts[cut as usize];
                parent.sides[side] = Side::Cut(new);
            }
            let middle = range.start + middle;
            boxes[widest] = (spread(&samples[range.start..middle]), range.start..middle, Some((new, 0)));
            boxes.push((spread(&samples[middle..range.end]), middle..range.end, Some((new, 1))));
        }
        palette.bins = boxes.len();
        Some(palette)
    }
}

/// Brightness, and how much redder and how much bluer than that.
#[inline]
fn opponent([red, green, blue]: [f32; 3]) -> [f32; 3] {
    let grey = (red + green + blue) / 3.0;
    [grey, HUE * (red - grey), HUE * (blue - grey)]
}

/// The sum of squared deviations along the axis where it is greatest, and that axis.
fn spread(colours: &[[f32; 3]]) -> (f64, usize) {
    let mut best = (0.0, 0);
    for axis in 0..3 {
        let values = || colours.iter().map(|colour| f64::from(colour[axis]));
        let mean = values().sum::<f64>() / colours.len() as f64;
        let deviation = values().map(|value| (value - mean) * (value - mean)).sum::<f64>();
        if deviation > best.0 {
            best = (deviation, axis);
        }
    }
    best
}

/// The interpolated colour, 0 to 255 each.
#[inline]
fn interpolated(point: &Surfel) -> [f32; 3] {
    let mut sum = [0.0; 3];
    if let Some(colours) = &point.mesh.colours {
        for (corner, weight) in point.corners.into_iter().zip(point.weights) {
            let colour = colours[corner as usize];
            for k in 0..3 {
                sum[k] += weight * f32::from(colour[k]);
            }
        }
    }
    sum
}

impl Signal for Colours {
    fn bins(&self) -> usize {
        self.bins
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        let colour = opponent(interpolated(point));
        let mut at = if self.cuts.is_empty() { Side::Bin(0) } else { Side::Cut(0) };
        loop {
            match at {
                Side::Bin(bin) => return bin as usize,
                Side::Cut(cut) => {
                    let cut = &self.cuts[cut as usize];
                    at = cut.sides[usize::from(colour[cut.axis] >= cut.value)];
                }
            }
        }
    }

    fn colour(&self, point: &Surfel) -> [f32; 3] {
        interpolated(point).map(|x| x / 255.0)
    }
}
