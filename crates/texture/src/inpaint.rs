//! Colours for what no photo sees: spread over the surface from where it ends.

use texreg_surface::{Mesh, weld};

/// Sweeps that smooth the colours found.
const SWEEPS: usize = 40;

/// Colours of all vertices from those of some: unknown ones are ever smoother means of their neighbours (Gauss–Seidel on the
/// Laplace equation, from a first guess that spreads from the known ones). Parts without a known vertex get the mean of all.
pub(crate) fn spread(mesh: &Mesh, known: &[Option<[f32; 3]>]) -> Vec<[f32; 3]> {
    let first = weld(&mesh.positions);
    let count = known.len();
    // Vertices in the same place share what is known of any of them.
    let mut values: Vec<Option<[f32; 3]>> = vec![None; count];
    for (vertex, &place) in first.iter().enumerate() {
        let value = &mut values[place as usize];
        *value = value.or(known[vertex]);
    }
    let (starts, around) = neighbours(mesh, &first);
    let near = |v: usize| &around[starts[v] as usize..starts[v + 1] as usize];
    let mean = |values: &[Option<[f32; 3]>], v: usize| {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for value in near(v).iter().filter_map(|&u| values[u as usize]) {
            (0..3).for_each(|c| sum[c] += value[c]);
            count += 1.0;
        }
        (count > 0.0).then(|| sum.map(|x| x / count))
    };
    let mut front: Vec<u32> = (0..count as u32).filter(|&v| values[v as usize].is_some()).collect();
    let mut order = Vec::new();
    let mut queued: Vec<bool> = values.iter().map(Option::is_some).collect();
    while !front.is_empty() {
        let mut next = Vec::new();
        for &v in &front {
            for &u in near(v as usize) {
                if !std::mem::replace(&mut queued[u as usize], true) {
                    next.push(u);
                }
            }
        }
        let found: Vec<_> = next.iter().map(|&v| mean(&values, v as usize)).collect();
        next.iter().zip(found).for_each(|(&v, value)| values[v as usize] = value);
        order.extend_from_slice(&next);
        front = next;
    }
    for _ in 0..SWEEPS {
        for &v in &order {
            values[v as usize] = mean(&values, v as usize).or(values[v as usize]);
        }
    }
    let (sum, total) = known.iter().flatten().fold(([0.0f64; 3], 0.0f64), |(sum, total), value| {
        (std::array::from_fn(|c| sum[c] + f64::from(value[c])), total + 1.0)
    });
    let rest = if total > 0.0 { sum.map(|x| (x / total) as f32) } else { [128.0; 3] };
    (0..count).map(|v| known[v].or(values[first[v] as usize]).unwrap_or(rest)).collect()
}

/// The vertices that share an edge with each, as one list and where each vertex's part of it starts.
fn neighbours(mesh: &Mesh, first: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let edges = || {
        mesh.triangles.iter().flat_map(|t| (0..3).map(move |k| (first[t[k] as usize], first[t[(k + 1) % 3] as usize])))
    };
    let mut starts = vec![0u32; first.len() + 1];
    for (a, b) in edges() {
        starts[a as usize + 1] += 1;
        starts[b as usize + 1] += 1;
    }
    (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
    let mut next = starts.clone();
    let mut around = vec![0; starts[first.len()] as usize];
    for (a, b) in edges() {
        for (from, to) in [(a, b), (b, a)] {
            around[next[from as usize] as usize] = to;
            next[from as usize] += 1;
        }
    }
    (starts, around)
}

#[cfg(test)]
mod tests {
    use super::spread;
    use texreg_surface::{Attributes, Mesh};

    #[test]
    fn colours_spread_evenly_between_known_ones() {
        // A strip of 20 squares along x, known at both ends.
        let points: Vec<[f64; 3]> = (0..42).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.0]).collect();
        let triangles =
            (0..20u32).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 1], [2 * i + 1, 2 * i + 2, 2 * i + 3]]).collect();
        let mesh = Mesh::new(&points, triangles, Attributes::default()).unwrap();
        let mut known = vec![None; 42];
        (known[0], known[1]) = (Some([0.0, 10.0, 0.0]), Some([0.0, 10.0, 0.0]));
        (known[40], known[41]) = (Some([200.0, 10.0, 0.0]), Some([200.0, 10.0, 0.0]));
        let colours = spread(&mesh, &known);
        for (i, colour) in colours.iter().enumerate() {
            let even = 10.0 * (i / 2) as f32;
            assert!((colour[0] - even).abs() < 40.0 && (colour[1] - 10.0).abs() < 1e-3, "{i}: {colour:?}");
        }
        assert!(colours.windows(3).all(|w| w[2][0] >= w[0][0] - 1e-3));
    }
}
