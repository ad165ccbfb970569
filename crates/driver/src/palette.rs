//! A photo's colours, reduced to a few that are about equally frequent: P. Heckbert, *Color image quantization for frame buffer
//! display*, SIGGRAPH 1982 (median cut).

/// For each pixel the index of its colour among about `colours`.
///
/// The box of colours that spreads widest is cut at its median along its longest side, again and again.
pub(crate) fn palette(pixels: &[[f32; 3]], colours: usize) -> Vec<u16> {
    let mut order: Vec<u32> = (0..pixels.len() as u32).collect();
    let mut boxes: Vec<(f32, usize, std::ops::Range<usize>)> = Vec::new();
    let spread = |order: &[u32], range: std::ops::Range<usize>| {
        let (mut sum, mut squares) = ([0.0f64; 3], [0.0f64; 3]);
        for &i in &order[range.clone()] {
            for k in 0..3 {
                let value = f64::from(pixels[i as usize][k]);
                sum[k] += value;
                squares[k] += value * value;
            }
        }
        let count = range.len() as f64;
        // The sum of squared deviations along each side.
        let deviations: [f64; 3] = std::array::from_fn(|k| squares[k] - sum[k] * sum[k] / count);
        let side = (0..3).max_by(|&a, &b| deviations[a].total_cmp(&deviations[b])).unwrap_or(0);
        (deviations[side] as f32, side, range)
    };
    boxes.push(spread(&order, 0..pixels.len()));
    while boxes.len() < colours {
        let Some(widest) = (0..boxes.len()).max_by(|&a, &b| boxes[a].0.total_cmp(&boxes[b].0)) else { break };
        let (deviation, side, range) = boxes[widest].clone();
        if range.len() < 2 || deviation <= 0.0 {
            break;
        }
        let middle = range.len() / 2;
        order[range.clone()].select_nth_unstable_by(middle, |&a, &b| {
            pixels[a as usize][side].total_cmp(&pixels[b as usize][side]).then(a.cmp(&b))
        });
        let cut = range.start + middle;
        boxes[widest] = spread(&order, range.start..cut);
        boxes.push(spread(&order, cut..range.end));
    }
    let mut colour = vec![0; pixels.len()];
    for (index, (_, _, range)) in boxes.into_iter().enumerate() {
        for &i in &order[range] {
            colour[i as usize] = index as u16;
        }
    }
    colour
}
