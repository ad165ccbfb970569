//! Pictures of the corners that were found on a board.

use image::{Rgb, RgbImage};
use nalgebra::Point2;
use texreg::calib::BoardCorner;
use texreg::driver::Photo;

/// The photo with its corners: a ring on each, coloured by row, lines from corner to corner as they are counted, and a
/// larger ring on the first.
pub(crate) fn picture(photo: &Photo, corners: &[BoardCorner]) -> RgbImage {
    let mut picture = RgbImage::from_fn(photo.width, photo.height, |x, y| {
        Rgb(photo.rgb[y as usize * photo.width as usize + x as usize])
    });
    let scale = f64::from(photo.width.max(photo.height)) / 1000.0;
    let thick = scale.max(0.6);
    for pair in corners.windows(2) {
        line(&mut picture, &pair[0].pixel, &pair[1].pixel, 0.8 * thick, colour(pair[0].row));
    }
    for corner in corners {
        ring(&mut picture, &corner.pixel, 6.0 * thick, thick, colour(corner.row));
    }
    if let Some(first) = corners.iter().find(|c| (c.column, c.row) == (0, 0)) {
        ring(&mut picture, &first.pixel, 12.0 * thick, 1.5 * thick, colour(0));
    }
    picture
}

fn colour(row: usize) -> [f64; 3] {
    const COLOURS: [[f64; 3]; 6] = [
        [255.0, 70.0, 70.0],
        [255.0, 160.0, 30.0],
        [225.0, 225.0, 40.0],
        [60.0, 220.0, 90.0],
        [40.0, 200.0, 235.0],
        [190.0, 110.0, 255.0],
    ];
    COLOURS[row % COLOURS.len()]
}

fn line(picture: &mut RgbImage, a: &Point2<f64>, b: &Point2<f64>, thick: f64, colour: [f64; 3]) {
    let gap = b - a;
    let square = gap.norm_squared().max(1e-9);
    let distance = |p: Point2<f64>| {
        let t = ((p - a).dot(&gap) / square).clamp(0.0, 1.0);
        (p - (a + gap * t)).norm()
    };
    let low = Point2::new(a.x.min(b.x), a.y.min(b.y));
    let high = Point2::new(a.x.max(b.x), a.y.max(b.y));
    stroke(picture, &low, &high, thick, colour, distance);
}

fn ring(picture: &mut RgbImage, center: &Point2<f64>, radius: f64, thick: f64, colour: [f64; 3]) {
    let reach = nalgebra::Vector2::repeat(radius);
    stroke(picture, &(center - reach), &(center + reach), thick, colour, |p| ((p - center).norm() - radius).abs());
}

/// Colours the pixels between two corners of a box that are near a curve.
fn stroke(
    picture: &mut RgbImage,
    low: &Point2<f64>,
    high: &Point2<f64>,
    thick: f64,
    colour: [f64; 3],
    distance: impl Fn(Point2<f64>) -> f64,
) {
    let range = |low: f64, high: f64, size: u32| {
        let first = (low - thick - 1.0).max(0.0) as u32;
        let last = (high + thick + 2.0).clamp(0.0, f64::from(size)) as u32;
        first..last
    };
    for y in range(low.y, high.y, picture.height()) {
        for x in range(low.x, high.x, picture.width()) {
            let share = (thick + 0.5 - distance(Point2::new(f64::from(x), f64::from(y)))).clamp(0.0, 1.0);
            for (value, colour) in picture.get_pixel_mut(x, y).0.iter_mut().zip(colour) {
                *value = (f64::from(*value) + share * (colour - f64::from(*value))).round() as u8;
            }
        }
    }
}
