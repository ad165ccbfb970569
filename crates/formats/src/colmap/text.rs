//! `cameras.txt` and `images.txt`.

use super::{Camera, Cameras, Image, MODELS};
use crate::FileError;
use crate::file::read_text;
use std::fmt::Write as _;
use std::path::Path;
use std::str::FromStr;

/// The lines of a file that are no comments, with their numbers from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).filter(|(_, line)| !line.starts_with('#'))
}

fn word<'a, T: FromStr>(words: &mut impl Iterator<Item = &'a str>, field: &str) -> Result<T, String> {
    let word = words.next().ok_or_else(|| format!("field {field} is missing"))?;
    word.parse().map_err(|_| format!("field {field}: '{word}' is not a number of the kind it takes"))
}

pub(super) fn read_cameras(path: &Path) -> Result<Cameras, FileError> {
    let text = read_text(path)?;
    let camera = |line: &str| -> Result<(u32, Camera), String> {
        let mut words = line.split_whitespace();
        let id = word(&mut words, "CAMERA_ID")?;
        let name = words.next().ok_or("field MODEL is missing")?;
        let model = MODELS.iter().find(|(_, known, _)| *known == name).map(|(number, ..)| *number);
        let size = [word(&mut words, "WIDTH")?, word(&mut words, "HEIGHT")?];
        let mut parameters = Vec::new();
        for parameter in words {
            parameters.push(word(&mut std::iter::once(parameter), "PARAMS")?);
        }
        Ok((id, Camera::checked(model, size, parameters)?))
    };
    let cameras = lines(&text).filter(|(_, line)| !line.is_empty());
    cameras.map(|(number, line)| camera(line).map_err(|cause| FileError::at(path, number, cause))).collect()
}

/// The images, each with its line.
pub(super) fn read_images(path: &Path) -> Result<Vec<(usize, Image)>, FileError> {
    let text = read_text(path)?;
    let image = |line: &str| -> Result<Image, String> {
        let mut words = line.split_whitespace();
        let _id: u32 = word(&mut words, "IMAGE_ID")?;
        let mut numbers = [0.0f64; 7];
        for (number, field) in numbers.iter_mut().zip(["QW", "QX", "QY", "QZ", "TX", "TY", "TZ"]) {
            *number = word(&mut words, field)?;
            if !number.is_finite() {
                return Err(format!("field {field}: is not finite"));
            }
        }
        let [w, x, y, z, translation @ ..] = numbers;
        let camera = word(&mut words, "CAMERA_ID")?;
        let name = words.collect::<Vec<_>>().join(" ");
        if name.is_empty() {
            return Err("field NAME is missing".into());
        }
        Ok(Image { rotation: [w, x, y, z], translation, camera, name })
    };
    // Behind the line of an image comes a line of its points, which may be empty.
    let mut images = Vec::new();
    let mut lines = lines(&text).skip_while(|(_, line)| line.is_empty());
    while let Some((number, line)) = lines.next() {
        if line.is_empty() {
            continue;
        }
        images.push((number, image(line).map_err(|cause| FileError::at(path, number, cause))?));
        lines.next();
    }
    Ok(images)
}

pub(super) fn cameras(cameras: &[Camera]) -> String {
    let mut out = String::from(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n",
    );
    for (i, Camera { model, size: [width, height], parameters }) in cameras.iter().enumerate() {
        let name = MODELS.iter().find(|(number, ..)| number == model).map_or("", |(_, name, _)| name);
        let _ = write!(out, "{} {name} {width} {height} ", i + 1);
        let _ = writeln!(out, "{}", joined(parameters));
    }
    out
}

pub(super) fn images(images: &[Image]) -> String {
    let mut out = String::from(
        "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   \
         POINTS2D[] as (X, Y, POINT3D_ID)\n",
    );
    for (i, Image { rotation, translation, camera, name }) in images.iter().enumerate() {
        let (rotation, translation) = (joined(rotation), joined(translation));
        let _ = write!(out, "{} {rotation} {translation} {camera} {name}\n\n", i + 1);
    }
    out
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}
