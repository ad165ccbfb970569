//! Rotations and rigid motions: exponential and logarithm, Jacobians, and the charts optimizers step through.
