//! A projected vertex in fixed point.

/// Sub-pixel bits: positions are snapped to 1/4096 pixel.
pub(crate) const SUBPIXEL_BITS: u32 = 12;

/// Fixed-point units in a pixel.
pub(crate) const SUBPIXELS: f64 = (1u32 << SUBPIXEL_BITS) as f64;

/// `Corner::x` of a vertex that must go through the clipper. No projected vertex reaches it: the guard band ends before.
pub(crate) const CLIP: i32 = i32::MIN;

/// A vertex on the image plane: snapped position and reciprocal depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Corner {
    /// Image coordinates in units of 2⁻¹² pixel.
    pub(crate) x: i32,
    pub(crate) y: i32,
    /// 1 / camera z: linear over the picture of a triangle, larger is nearer.
    pub(crate) w: f32,
}
