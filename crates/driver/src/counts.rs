//! Mutual information from counts, for renderings that are compared with a picture of few colours.

/// `n ln n` for counts: what an entropy is made of.
pub(crate) struct Counts {
    logarithms: Vec<f64>,
}

impl Counts {
    /// For pictures of at most so many pixels.
    pub(crate) fn up_to(pixels: usize) -> Self {
        Self { logarithms: (0..=pixels).map(|n| if n == 0 { 0.0 } else { n as f64 * (n as f64).ln() }).collect() }
    }

    /// The mutual information of a table of counts with the sums of its columns, in nats, less what chance alone would show:
    /// G. Miller, *Note on the bias of information estimates*, in Information Theory in Psychology, 1955. `None` without a count.
    pub(crate) fn information<'a>(&self, rows: impl Iterator<Item = &'a [u32]>, columns: &[u32]) -> Option<f64> {
        let (mut sum, mut freedom) = (0.0, 1i32);
        for row in rows {
            let mass: u32 = row.iter().sum();
            if mass > 0 {
                let mut row_sum = 0.0;
                for &n in row {
                    row_sum += self.logarithms[n as usize];
                    freedom += i32::from(n > 0);
                }
                sum += row_sum - self.logarithms[mass as usize];
                freedom -= 1;
            }
        }
        for &n in columns {
            sum -= self.logarithms[n as usize];
            freedom -= i32::from(n > 0);
        }
        let total: u32 = columns.iter().sum();
        (total > 0).then(|| (sum + self.logarithms[total as usize] - 0.5 * f64::from(freedom)) / f64::from(total))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use texreg_mi::{Joint, Metric, MutualInformation};

    #[test]
    fn information_agrees_with_the_joint_density() {
        let counts = [5, 0, 2, 1, 7, 3, 0, 0, 0, 10, 2, 10];
        let value = Counts::up_to(40).information(counts.chunks_exact(3), &[16, 9, 15]).unwrap();
        let joint = Joint::from_masses(4, counts.map(f64::from).to_vec());
        let chance = 0.5 * (8.0 - 3.0 - 3.0 + 1.0) / 40.0;
        assert!((value - (MutualInformation.value(&joint) - chance)).abs() < 1e-12);
        assert_eq!(Counts::up_to(0).information([0; 3].chunks_exact(3), &[0; 3]), None);
    }
}
