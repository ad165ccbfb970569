//! Pictures as the browser wants them.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use jpeg_encoder::{ColorType, Encoder, EncodingError, SamplingFactor};

/// A picture of opaque pixels as JPEG, quickly.
pub(crate) fn jpeg(pixels: &[[u8; 4]], [width, height]: [u32; 2], quality: u8) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let size = [width, height].map(|n| u16::try_from(n).unwrap_or(u16::MAX));
    let mut encoder = Encoder::new(&mut bytes, quality);
    encoder.set_sampling_factor(if quality > 90 { SamplingFactor::R_4_4_4 } else { SamplingFactor::R_4_2_0 });
    encoder
        .encode(pixels.as_flattened(), size[0], size[1], ColorType::Rgba)
        .map_err(|e: EncodingError| e.to_string())?;
    Ok(bytes)
}

/// A photo's pixels as JPEG.
pub(crate) fn photo_jpeg(pixels: &[[u8; 3]], [width, height]: [u32; 2], quality: u8) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let size = [width, height].map(|n| u16::try_from(n).unwrap_or(u16::MAX));
    let mut encoder = Encoder::new(&mut bytes, quality);
    encoder.set_sampling_factor(SamplingFactor::R_4_4_4);
    encoder.encode(pixels.as_flattened(), size[0], size[1], ColorType::Rgb).map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// A picture with opacity as PNG.
pub(crate) fn png(pixels: &[[u8; 4]], [width, height]: [u32; 2]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Up);
    let written = encoder.write_image(pixels.as_flattened(), width, height, ExtendedColorType::Rgba8);
    written.map_err(|e| e.to_string())?;
    Ok(bytes)
}
