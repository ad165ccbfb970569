//! A part of a photo shown at another size, and the camera that sees it so.

use texreg_camera::Camera;

/// A rectangle of a photo, and the pixels it is shown in.
///
/// Its sides are measured from the photo's top left corner, not from a pixel's centre: the whole photo is
/// `0 … width` by `0 … height`. They need not lie within the photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// The left side, in pixels of the photo.
    pub left: f64,
    /// The top.
    pub top: f64,
    /// The width, above zero.
    pub width: f64,
    /// The height, above zero.
    pub height: f64,
    /// The columns and rows it is shown in.
    pub pixels: [u32; 2],
}

impl Window {
    /// The camera of the photo as one that sees the window in its pixels.
    pub fn camera(&self, photo: &Camera) -> Camera {
        let [width, height] = self.pixels;
        let (sx, sy) = (f64::from(width) / self.width, f64::from(height) / self.height);
        let mut camera = Camera { width, height, ..*photo };
        let k = &mut camera.intrinsics;
        (k.fx, k.fy, k.skew) = (k.fx * sx, k.fy * sy, k.skew * sx);
        k.cx = (k.cx + 0.5 - self.left) * sx - 0.5;
        k.cy = (k.cy + 0.5 - self.top) * sy - 0.5;
        camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn a_point_keeps_its_place_in_the_window() {
        let photo = Camera::ideal(640, 480, 500.0);
        let window = Window { left: 100.0, top: 50.5, width: 200.0, height: 120.0, pixels: [600, 240] };
        let point = Point3::new(-0.1, -0.2, 2.0);
        let (whole, part) = (photo.project(&point).unwrap(), window.camera(&photo).project(&point).unwrap());
        assert!((part.x - ((whole.x + 0.5 - 100.0) * 3.0 - 0.5)).abs() < 1e-9, "{whole} {part}");
        assert!((part.y - ((whole.y + 0.5 - 50.5) * 2.0 - 0.5)).abs() < 1e-9, "{whole} {part}");
    }
}
