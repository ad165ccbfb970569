//! `cameras.bin` and `images.bin`, little-endian.

use super::{Camera, Cameras, Image, MODELS};
use crate::FileError;
use crate::file;
use std::path::Path;

/// Bytes that are taken one after the other.
struct Reader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], FileError> {
        let left = &self.bytes[self.at..];
        let taken =
            left.get(..count).ok_or_else(|| self.error(format!("the file ends here, {count} bytes too early")))?;
        self.at += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], FileError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, FileError> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, FileError> {
        self.array().map(u64::from_le_bytes)
    }

    fn numbers<const N: usize>(&mut self) -> Result<[f64; N], FileError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.array().map(f64::from_le_bytes)?;
            if !number.is_finite() {
                return Err(self.error("a number is not finite"));
            }
        }
        Ok(numbers)
    }

    fn error(&self, cause: impl std::fmt::Display) -> FileError {
        FileError::new(self.path, format!("byte {}: {cause}", self.at))
    }
}

pub(super) fn read_cameras(path: &Path) -> Result<Cameras, FileError> {
    let bytes = file::read(path)?;
    let mut reader = Reader { path, bytes: &bytes, at: 0 };
    let mut cameras = Cameras::new();
    for _ in 0..reader.u64()? {
        let id = reader.u32()?;
        let model = reader.u32()? as i32;
        let size = [reader.u64()?, reader.u64()?];
        let count = MODELS.iter().find(|(number, ..)| *number == model).map_or(0, |(.., count)| *count);
        let parameters = (0..count).map(|_| Ok(reader.numbers::<1>()?[0])).collect::<Result<_, _>>()?;
        let camera = Camera::checked(Some(model), size, parameters);
        cameras.insert(id, camera.map_err(|cause| reader.error(format!("camera {id}, {cause}")))?);
    }
    Ok(cameras)
}

/// The images, each with the byte at which it begins.
pub(super) fn read_images(path: &Path) -> Result<Vec<(usize, Image)>, FileError> {
    let bytes = file::read(path)?;
    let mut reader = Reader { path, bytes: &bytes, at: 0 };
    let mut images = Vec::new();
    for _ in 0..reader.u64()? {
        let start = reader.at;
        let _id = reader.u32()?;
        let rotation = reader.numbers()?;
        let translation = reader.numbers()?;
        let camera = reader.u32()?;
        let length = reader.bytes[reader.at..].iter().position(|&byte| byte == 0);
        let length = length.ok_or_else(|| reader.error("the name of an image does not end"))?;
        let name = String::from_utf8_lossy(reader.take(length)?).into_owned();
        reader.take(1)?;
        // Each point: x, y and the number of what it shows.
        let points = usize::try_from(reader.u64()?).ok().and_then(|points| points.checked_mul(24));
        let points = points.ok_or_else(|| reader.error("the number of points is absurd"))?;
        reader.take(points)?;
        images.push((start, Image { rotation, translation, camera, name }));
    }
    Ok(images)
}

pub(super) fn cameras(cameras: &[Camera]) -> Vec<u8> {
    let mut out = (cameras.len() as u64).to_le_bytes().to_vec();
    for (i, camera) in cameras.iter().enumerate() {
        out.extend((i as u32 + 1).to_le_bytes());
        out.extend(camera.model.to_le_bytes());
        camera.size.iter().for_each(|n| out.extend(n.to_le_bytes()));
        camera.parameters.iter().for_each(|p| out.extend(p.to_le_bytes()));
    }
    out
}

pub(super) fn images(images: &[Image]) -> Vec<u8> {
    let mut out = (images.len() as u64).to_le_bytes().to_vec();
    for (i, image) in images.iter().enumerate() {
        out.extend((i as u32 + 1).to_le_bytes());
        image.rotation.iter().chain(&image.translation).for_each(|x| out.extend(x.to_le_bytes()));
        out.extend(image.camera.to_le_bytes());
        out.extend(image.name.as_bytes());
        out.push(0);
        out.extend(0u64.to_le_bytes());
    }
    out
}
