//! A camera as OpenCV's `FileStorage` writes it, YAML or JSON: `camera_matrix`, `distortion_coefficients` (k1, k2, p1, p2, k3),
//! `image_width`, `image_height`. One camera without a place; also what ROS' camera_calibration writes.

use crate::json::Fields;
use crate::{FileError, Lens, file};
use serde_json::{Value, json};
use std::path::Path;
use texreg_camera::{Camera, Distortion};

/// Reads a calibration in YAML.
pub(crate) fn read_yaml(path: &Path) -> Result<Lens, FileError> {
    let text = file::read_text(path)?;
    // OpenCV's first line is no YAML directive.
    match serde_saphyr::from_str(text.strip_prefix("%YAML:1.0").unwrap_or(&text)) {
        Ok(Value::Object(map)) => lens(Fields::top(path, text, map)),
        Ok(_) => Err(FileError::new(path, "holds no calibration: its top is not a list of named fields")),
        Err(error) => {
            let text = error.to_string();
            let cause = text.lines().next().unwrap_or_default().trim_start_matches("error: ");
            Err(FileError::new(path, format!("is not YAML ({cause})")))
        }
    }
}

/// The lens that the fields of a calibration state.
pub(crate) fn lens(mut fields: Fields) -> Result<Lens, FileError> {
    let width: Option<f64> = fields.take_optional("image_width")?;
    let height: Option<f64> = fields.take_optional("image_height")?;
    let size = match (width, height) {
        (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 => Some([w as u32, h as u32]),
        (None, None) => None,
        _ => return Err(fields.error("image_width, image_height", "must both be positive")),
    };
    let k = matrix(&mut fields, "camera_matrix")?;
    let k: [f64; 9] = k.try_into().map_err(|_| fields.error("camera_matrix", "has not 3 × 3 numbers"))?;
    let key = ["distortion_coefficients", "dist_coeffs", "distortion_coeffs"]
        .into_iter()
        .find(|key| fields.map.contains_key(*key));
    let given = key.map(|key| matrix(&mut fields, key)).transpose()?.unwrap_or_default();
    if given.iter().skip(5).any(|c| *c != 0.0) {
        return Err(
            fields.error("distortion_coefficients", "a lens with more than k1, k2, p1, p2, k3 is not supported")
        );
    }
    if k[0] <= 0.0 || k[4] <= 0.0 {
        return Err(fields.error("camera_matrix", "focal lengths must be positive"));
    }
    let mut coefficients = [0.0; 5];
    coefficients.iter_mut().zip(&given).for_each(|(slot, c)| *slot = *c);
    Ok(Lens {
        size,
        focal: [k[0], k[4]],
        principal: [Some(k[2]), Some(k[5])],
        skew: k[1],
        distortion: Distortion::from(coefficients),
    })
}

/// The numbers of a matrix, by rows.
fn matrix(fields: &mut Fields, key: &str) -> Result<Vec<f64>, FileError> {
    let value: Value = fields.take(key)?;
    let data = value.get("data").cloned().unwrap_or(value);
    let rows = data.as_array().is_some_and(|rows| rows.iter().all(Value::is_array));
    let numbers = if rows { fields.parse::<Vec<Vec<f64>>>(key, data)?.concat() } else { fields.parse(key, data)? };
    if numbers.iter().all(|x: &f64| x.is_finite()) {
        Ok(numbers)
    } else {
        Err(fields.error(key, "has numbers that are not finite"))
    }
}

fn camera_matrix(camera: &Camera) -> [f64; 9] {
    let k = &camera.intrinsics;
    [k.fx, k.skew, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0]
}

pub(crate) fn json(camera: &Camera) -> String {
    let matrix = |rows: usize, cols: usize, data: &[f64]| json!({"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data});
    let value = json!({
        "image_width": camera.width, "image_height": camera.height,
        "camera_matrix": matrix(3, 3, &camera_matrix(camera)),
        "distortion_coefficients": matrix(5, 1, &camera.distortion.to_array()),
    });
    format!("{value:#}\n")
}

pub(crate) fn yaml(camera: &Camera) -> String {
    let matrix = |name: &str, rows: usize, cols: usize, data: &[f64]| {
        let numbers: Vec<String> = data.iter().map(|x| format!("{x:?}")).collect();
        let numbers = numbers.join(", ");
        format!("{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {numbers} ]\n")
    };
    format!(
        "%YAML:1.0\n---\nimage_width: {}\nimage_height: {}\n{}{}",
        camera.width,
        camera.height,
        matrix("camera_matrix", 3, 3, &camera_matrix(camera)),
        matrix("distortion_coefficients", 5, 1, &camera.distortion.to_array())
    )
}
