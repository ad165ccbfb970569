//! The halo of a silhouette against a search through all pixels.

use rand::{Rng, SeedableRng, rngs::StdRng};
use texreg_raster::{GBuffer, NO_FACE, outline};

/// A picture with surface where `covered` says so.
fn picture(width: u32, height: u32, mut covered: impl FnMut(i64, i64) -> bool) -> GBuffer {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x.into(), y.into())));
    let face: Vec<u32> = pixels.map(|(x, y)| if covered(x, y) { 0 } else { NO_FACE }).collect();
    let depth = face.iter().map(|&f| if f == 0 { 1.0 } else { f32::INFINITY }).collect();
    GBuffer { width, height, depth, face, barycentric: Vec::new() }
}

fn check(picture: &GBuffer, band: f32) {
    let width = i64::from(picture.width);
    let place = |index: usize| (index as i64 % width, index as i64 / width);
    let squared = |p: usize, q: usize| {
        let ((x, y), (s, t)) = (place(p), place(q));
        (x - s) * (x - s) + (y - t) * (y - t)
    };
    let pixels = 0..picture.face.len();
    let (surface, background): (Vec<usize>, Vec<usize>) = pixels.partition(|&p| picture.face[p] != NO_FACE);
    let nearest = |&p: &usize| surface.iter().map(|&q| squared(p, q)).min();
    let expected: Vec<_> = background
        .iter()
        .filter_map(|p| Some((*p, nearest(p)?)))
        .filter(|&(_, d)| d as f64 <= f64::from(band) * f64::from(band))
        .collect();
    let halo = outline(picture, band);
    assert_eq!(halo.len(), expected.len());
    for (halo, (pixel, distance)) in halo.iter().zip(expected) {
        assert_eq!(halo.pixel as usize, pixel);
        assert_eq!(halo.distance, (distance as f32).sqrt());
        assert_ne!(picture.face[halo.nearest as usize], NO_FACE);
        assert_eq!(squared(pixel, halo.nearest as usize), distance);
    }
}

#[test]
fn agrees_with_a_search() {
    let mut rng = StdRng::seed_from_u64(4);
    for (width, height) in [(1, 1), (1, 40), (40, 1), (23, 31), (48, 36), (4, 540)] {
        for share in [0.0, 0.002, 0.02, 0.3, 0.9, 1.0] {
            let noise = picture(width, height, |_, _| rng.random_bool(share));
            for band in [0.0, 1.0, 1.5, 4.0, 9.3, f32::INFINITY] {
                check(&noise, band);
            }
        }
    }
    let disc = picture(64, 48, |x, y| (x - 30).pow(2) + (y - 20).pow(2) < 150);
    for band in [2.0, 7.7, f32::INFINITY] {
        check(&disc, band);
    }
}

#[test]
fn nonsense_bands_are_empty() {
    let dot = picture(5, 5, |x, y| (x, y) == (2, 2));
    for band in [f32::NAN, 0.99, -3.0] {
        assert!(outline(&dot, band).is_empty());
    }
    assert!(outline(&GBuffer::default(), 3.0).is_empty());
}
