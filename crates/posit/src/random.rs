//! A small generator of random numbers, the same everywhere: SplitMix64 (Steele, Lea & Flood 2014).

/// The state.
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// An index below `n`.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next()) * n as u128) >> 64) as usize
    }

    /// Three different indices below `n` ≥ 3.
    pub(crate) fn triple(&mut self, n: usize) -> [usize; 3] {
        let a = self.below(n);
        let mut b = self.below(n - 1);
        b += usize::from(b >= a);
        let mut c = self.below(n - 2);
        for taken in [a.min(b), a.max(b)] {
            c += usize::from(c >= taken);
        }
        [a, b, c]
    }
}
