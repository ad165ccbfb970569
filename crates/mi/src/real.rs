//! The precision of sampled values.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Mul, Sub};

/// A number of single or double precision. Kernels are written once for both: `f32` for speed, `f64` where derivatives shall agree
/// with differences to the last digits.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Into<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + AddAssign
    + sealed::Sealed
    + 'static
{
    /// The nearest number of this precision.
    fn of(value: f64) -> Self;

    /// The whole part of a number from zero to below 2³¹; zero for NaN.
    fn whole(self) -> usize;

    /// The number brought into `0..=1`; NaN becomes 0.
    fn unit(self) -> Self;

    /// Whether it is no number.
    fn is_missing(self) -> bool;

    /// A whole number and the rest, from 0 to 1, of a number from zero to below 2²². (A whole number may come out as one less
    /// and a rest of 1.)
    fn split(self) -> (u32, Self);
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// A precision whose mantissa has so many bits after the leading one.
macro_rules! real {
    ($precision:ident, $mantissa:expr) => {
        impl Real for $precision {
            #[inline]
            fn of(value: f64) -> Self {
                value as $precision
            }

            #[inline]
            fn whole(self) -> usize {
                self as i32 as usize
            }

            #[inline]
            fn unit(self) -> Self {
                // In this order each is one instruction.
                let above = if self > 0.0 { self } else { 0.0 };
                if above < 1.0 { above } else { 1.0 }
            }

            #[inline]
            fn is_missing(self) -> bool {
                self.is_nan()
            }

            #[inline]
            fn split(self) -> (u32, Self) {
                // Above this numbers are whole, and their last bits count.
                const WHOLE: $precision = (1u64 << $mantissa) as $precision;
                let half = self - 0.5;
                let shifted = if half > 0.0 { half } else { 0.0 } + WHOLE;
                let bits = shifted.to_bits() & ((1 << $mantissa) - 1);
                (bits as u32, self - (shifted - WHOLE))
            }
        }
    };
}

real!(f32, 23);
real!(f64, 52);
