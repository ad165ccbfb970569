//! The corners of J.-Y. Bouguet's first calibration example, and the camera his toolbox made of them.

use nalgebra::Point2;
use std::path::Path;
use texreg_calib::{Board, BoardCorner, Model, Options, calibrate};

/// Calib_Results.m: values and uncertainties, which are three standard deviations.
const PUBLISHED: [(usize, f64, f64); 8] = [
    (0, 657.6437478455, 0.4024282147),
    (1, 658.0411276002, 0.4305644215),
    (2, 303.1923923948, 0.8185994071),
    (3, 242.5556601432, 0.7488044686),
    (5, -0.2560981588, 0.0031420716),
    (6, 0.1308873134, 0.0125082621),
    (7, -0.0001911775, 0.0001693703),
    (8, 0.0000384832, 0.0001675473),
];

#[test]
fn bouguets_corners_give_bouguets_camera() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let file = "shared/cases/real/calib_bouguet/correspondences.json";
    let Some(path) = here.ancestors().map(|up| up.join(file)).find(|path| path.exists()) else {
        println!("skipped: no {file} above the repository");
        return;
    };
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let board = Board { columns: 12, rows: 13, square: 30.0 };
    let list = |value: &serde_json::Value| value.as_array().unwrap().clone();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let photos: Vec<Vec<BoardCorner>> = list(&json["views"])
        .iter()
        .map(|view| {
            let pairs = list(&view["points_3d_mm"]).into_iter().zip(list(&view["points_2d"]));
            let corner = |(xyz, uv): (serde_json::Value, serde_json::Value)| BoardCorner {
                column: (number(&xyz[0]) / 30.0).round() as usize,
                row: (number(&xyz[1]) / 30.0).round() as usize,
                pixel: Point2::new(number(&uv[0]), number(&uv[1])),
            };
            pairs.map(corner).collect()
        })
        .collect();
    let options = Options { model: Some(Model::Brown4), leave_out: false };
    let found = calibrate(&photos, &board, [640, 480], &options).unwrap();
    let (k, c) = (found.camera.intrinsics.to_array(), found.camera.distortion.to_array());
    let values = [k, c].concat();
    for (i, value, uncertainty) in PUBLISHED {
        // The published digits hold to a small part of a standard deviation, and so does the deviation itself.
        assert!((values[i] - value).abs() < 0.02 * uncertainty, "parameter {i}: {}, not {value}", values[i]);
        let ratio = 3.0 * found.deviations[i] / uncertainty;
        assert!((0.97..1.03).contains(&ratio), "deviation of parameter {i}: {ratio}");
    }
}
