//! Photographs: decoding (JPEG, PNG and TIFF, through the `image` crate), EXIF orientation and focal length
//! (CIPA DC-008, Exif 2.32, through `kamadak-exif`).
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

use exif::{In, Tag};
use image::{DynamicImage, ImageDecoder, ImageError, ImageReader, Limits, RgbImage};
use rayon::prelude::*;
use texreg_camera::{Camera, Samples, rectify};

/// The most pixels a photo may be wide or high.
const MOST_PIXELS: u32 = 65_536;

/// The most bytes its decoder may take: enough for 170 megapixels of 16-bit colour.
const MOST_BYTES: u64 = 1 << 30;

/// The luma of red, green and blue (ITU-R BT.709), applied to the values as they are stored.
const LUMA: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// A photograph, upright: row-major from the top left, rows without gaps.
#[derive(Clone, PartialEq)]
pub struct Photo {
    /// The name of the file without its folder, as `cameras.json` has it.
    pub file: String,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Luma from 0 to 1, one a pixel, from all the bits the file has. The file's gamma is left as it is.
    pub luma: Vec<f32>,
    /// Colour in 8 bits, one a pixel, for overlays and textures.
    pub rgb: Vec<[u8; 3]>,
    /// The focal length in millimetres that gives the same field of view on 36 mm film, if EXIF has it.
    pub focal_35mm: Option<f64>,
    /// Where the photo shows the object, one a pixel, if that is known.
    pub mask: Option<Vec<bool>>,
}

/// A photo that cannot be had. Its message is one line that names the file, the cause and what to do.
#[derive(Debug, thiserror::Error)]
pub enum PhotoError {
    /// The file could not be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file has no bytes.
    #[error("{}: the file is empty; copy the photo again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file is no JPEG, PNG or TIFF image.
    #[error("{}: not a JPEG, PNG or TIFF image; convert the photo to one of these", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// The image is larger than this program handles.
    #[error("{}: the image is too large ({cause}); reduce the photo first", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Which limit it breaks.
        cause: String,
    },
    /// A mask is not of its photo's size.
    #[error("{}: the mask is {}x{} pixels, its photo {}x{}; make them the same size", path.display(), size.0, size.1, photo.0, photo.1)]
    MaskSize {
        /// The mask's file.
        path: PathBuf,
        /// Its width and height.
        size: (u32, u32),
        /// The photo's.
        photo: (u32, u32),
    },
    /// The image is damaged or of a kind that is not supported.
    #[error("{}: {cause}; copy or export the photo again", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        cause: String,
    },
}

impl Photo {
    /// Loads a JPEG, PNG or TIFF file of 8 or 16 bits, grey or colour (transparency is ignored), and turns it upright
    /// as EXIF says.
    ///
    /// # Errors
    /// See [`PhotoError`]. Images beyond 65,536 pixels a side or a gibibyte of pixels are refused.
    pub fn load(path: impl AsRef<Path>) -> Result<Photo, PhotoError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|source| PhotoError::Io { path: path.to_owned(), source })?;
        if bytes.is_empty() {
            return Err(PhotoError::Empty { path: path.to_owned() });
        }
        let (image, focal_35mm) = decode(&bytes).map_err(|error| explain(error, path))?;
        let (luma, rgb) = planes(&image);
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Photo { file, width: image.width(), height: image.height(), luma, rgb, focal_35mm, mask: None })
    }

    /// Takes an image of the photo's size for its mask: the object is where it is brighter than half.
    ///
    /// # Errors
    /// See [`PhotoError`]; a mask of another size is refused.
    pub fn with_mask(self, path: impl AsRef<Path>) -> Result<Photo, PhotoError> {
        let mask = Photo::load(&path)?;
        if (mask.width, mask.height) != (self.width, self.height) {
            let size = (mask.width, mask.height);
            return Err(PhotoError::MaskSize {
                path: path.as_ref().to_owned(),
                size,
                photo: (self.width, self.height),
            });
        }
        Ok(Photo { mask: Some(mask.luma.iter().map(|&value| value > 0.5).collect()), ..self })
    }

    /// The focal length in pixels by EXIF: the longer side of the photo stands for the 36 mm of the film.
    pub fn focal(&self) -> Option<f64> {
        Some(self.focal_35mm? * f64::from(self.width.max(self.height)) / 36.0)
    }

    /// The picture that `target` would have taken from where `source` took this photo, black where the photo shows nothing; `None`
    /// if `source` is for photos of another size.
    pub fn rectified(&self, source: &Camera, target: &Camera) -> Option<RgbImage> {
        let values: Vec<f32> = self.rgb.as_flattened().iter().map(|&v| f32::from(v)).collect();
        let (width, height) = (self.width as usize, self.height as usize);
        let out = rectify(&Samples { width, height, channels: 3, values: &values }, source, target)?;
        // NaN, where nothing is seen, becomes zero.
        RgbImage::from_raw(target.width, target.height, out.into_iter().map(|v| (v + 0.5) as u8).collect())
    }
}

impl std::fmt::Debug for Photo {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Photo { file, width, height, focal_35mm, .. } = self;
        write!(f, "Photo({file:?}, {width}x{height}, {focal_35mm:?} mm)")
    }
}

/// The upright image and its focal length.
fn decode(bytes: &[u8]) -> Result<(DynamicImage, Option<f64>), ImageError> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MOST_PIXELS);
    limits.max_image_height = Some(MOST_PIXELS);
    limits.max_alloc = Some(MOST_BYTES);
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format()?;
    reader.limits(limits.clone());
    if reader.format() == Some(image::ImageFormat::Jpeg) && is_cut_short(bytes) {
        return Err(ImageError::IoError(io::ErrorKind::UnexpectedEof.into()));
    }
    let is_tiff = reader.format() == Some(image::ImageFormat::Tiff);
    let mut decoder = reader.into_decoder()?;
    // The decoder bounds what it takes itself, not the image it fills.
    limits.reserve(decoder.total_bytes())?;
    let orientation = decoder.orientation()?;
    let longer_side = decoder.dimensions().0.max(decoder.dimensions().1);
    let chunk = if is_tiff { Some(bytes.to_vec()) } else { decoder.exif_metadata()? };
    let focal = chunk.and_then(|chunk| focal_35mm(chunk, longer_side));
    let mut image = DynamicImage::from_decoder(decoder)?;
    image.apply_orientation(orientation);
    Ok((image, focal))
}

/// Whether a JPEG file ends before its picture does, which its decoder paints over in grey: the marker of the end must
/// follow the segments, each with its length, and the first scan after them.
fn is_cut_short(bytes: &[u8]) -> bool {
    let mut at = 2;
    while let Some(&[0xff, marker, high, low]) = bytes.get(at..at + 4) {
        if marker == 0xda {
            return !bytes[at..].windows(2).any(|pair| pair == [0xff, 0xd9]);
        }
        // Markers may be padded by any number of 0xff.
        at += if marker == 0xff { 1 } else { 2 + usize::from(u16::from_be_bytes([high, low])) };
    }
    // No scan: the decoder says what is wrong.
    false
}

/// The 35-mm focal length of an EXIF block (which has the form of a TIFF file). Where the camera left it out it follows
/// from the focal length and the resolution of the focal plane, whose longer side is `longer_side` pixels unless EXIF
/// says that the photo had more before it was reduced.
fn focal_35mm(chunk: Vec<u8>, longer_side: u32) -> Option<f64> {
    let exif = exif::Reader::new().continue_on_error(true).read_raw(chunk);
    let exif = exif.or_else(|error| error.distill_partial_result(|_| {})).ok()?;
    let number = |tag| match exif.get_field(tag, In::PRIMARY)?.value {
        exif::Value::Rational(ref v) => v.first().map(exif::Rational::to_f64),
        ref value => value.get_uint(0).map(f64::from),
    };
    let positive = |tag| number(tag).filter(|v| v.is_finite() && *v > 0.0);
    positive(Tag::FocalLengthIn35mmFilm).or_else(|| {
        let millimetres = match number(Tag::FocalPlaneResolutionUnit) {
            Some(3.0) => 10.0,
            Some(4.0) => 1.0,
            Some(5.0) => 1e-3,
            _ => 25.4,
        };
        let recorded = positive(Tag::PixelXDimension).into_iter().chain(positive(Tag::PixelYDimension));
        let side = recorded.fold(0.0, f64::max);
        let side = if side > 0.0 { side } else { f64::from(longer_side) };
        let sensor = side * millimetres / positive(Tag::FocalPlaneXResolution)?;
        Some(positive(Tag::FocalLength)? * 36.0 / sensor)
    })
}

/// Luma from 0 to 1, and 8-bit colour.
fn planes(image: &DynamicImage) -> (Vec<f32>, Vec<[u8; 3]>) {
    /// Converts the pixels of `N` values each.
    fn convert<const N: usize, T: Copy + Sync>(
        values: &[T],
        pixel: impl Fn([T; N]) -> (f32, [u8; 3]) + Sync,
    ) -> (Vec<f32>, Vec<[u8; 3]>) {
        values.as_chunks().0.par_iter().with_min_len(1 << 14).map(|&p| pixel(p)).unzip()
    }
    let luma = |c: [f32; 3]| c[0] * LUMA[0] + c[1] * LUMA[1] + c[2] * LUMA[2];
    let luma8 = |c: [u8; 3]| luma(c.map(f32::from)) / 255.0;
    let luma16 = |c: [u16; 3]| luma(c.map(f32::from)) / 65535.0;
    let high = |v: u16| ((u32::from(v) * 255 + 32767) / 65535) as u8;
    match image {
        DynamicImage::ImageLuma8(i) => convert(i, |[v]| (f32::from(v) / 255.0, [v; 3])),
        DynamicImage::ImageLumaA8(i) => convert(i, |[v, _]| (f32::from(v) / 255.0, [v; 3])),
        DynamicImage::ImageRgb8(i) => convert(i, |c| (luma8(c), c)),
        DynamicImage::ImageRgba8(i) => convert(i, |[r, g, b, _]| (luma8([r, g, b]), [r, g, b])),
        DynamicImage::ImageLuma16(i) => convert(i, |[v]| (f32::from(v) / 65535.0, [high(v); 3])),
        DynamicImage::ImageLumaA16(i) => convert(i, |[v, _]| (f32::from(v) / 65535.0, [high(v); 3])),
        DynamicImage::ImageRgb16(i) => convert(i, |c| (luma16(c), c.map(high))),
        DynamicImage::ImageRgba16(i) => convert(i, |[r, g, b, _]| (luma16([r, g, b]), [r, g, b].map(high))),
        other => {
            let finite = |v: f32| if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.0 };
            convert(&other.to_rgb32f(), |c: [f32; 3]| {
                let c = c.map(finite);
                (luma(c), c.map(|v| (v * 255.0 + 0.5) as u8))
            })
        }
    }
}

/// Puts the file's name to what the decoder said, in one line.
fn explain(error: ImageError, path: &Path) -> PhotoError {
    let path = path.to_owned();
    let line = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    match error {
        ImageError::IoError(source) if source.kind() == io::ErrorKind::UnexpectedEof => {
            PhotoError::Decode { path, cause: "the image is cut short".into() }
        }
        ImageError::IoError(source) => PhotoError::Decode { path, cause: line(source.to_string()) },
        ImageError::Limits(limit) => PhotoError::TooLarge { path, cause: line(limit.to_string()) },
        ImageError::Unsupported(cause) if matches!(cause.kind(), image::error::UnsupportedErrorKind::Format(_)) => {
            PhotoError::Format { path }
        }
        other => PhotoError::Decode { path, cause: line(other.to_string()) },
    }
}
