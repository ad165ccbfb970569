//! Projected vertices in fixed point.

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

/// Twice the signed area, positive for corners that run clockwise in the picture (y down).
#[inline(always)]
pub(crate) fn twice_area(a: Corner, b: Corner, c: Corner) -> i64 {
    i64::from(b.x - a.x) * i64::from(c.y - a.y) - i64::from(b.y - a.y) * i64::from(c.x - a.x)
}

/// The first pixel whose centre is not before a coordinate.
#[inline(always)]
pub(crate) fn first_pixel(coordinate: i32) -> i32 {
    (coordinate + ((1 << SUBPIXEL_BITS) - 1)) >> SUBPIXEL_BITS
}
