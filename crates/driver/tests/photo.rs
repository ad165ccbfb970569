//! Photos: every kind of file the loader promises, upright and with its focal length, and one line for what is none.
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageBuffer, ImageEncoder, ImageFormat, Rgb};
use texreg_driver::{Photo, PhotoError};

/// Loads bytes as a file of this name.
fn load_bytes(name: &str, bytes: &[u8]) -> Result<Photo, PhotoError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("a file in the temporary folder");
    Photo::load(&path)
}

/// Encodes an image in memory.
fn encode(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).expect("an encoded image");
    bytes.into_inner()
}

/// A field of an EXIF block.
enum Field {
    /// A 16-bit number.
    Short(u16, u16),
    /// A fraction.
    Rational(u16, u32, u32),
}

/// An EXIF block (big-endian TIFF structure) with an orientation and fields of the Exif directory.
fn exif_block(orientation: u16, fields: &[Field]) -> Vec<u8> {
    let mut block = b"MM\0*\0\0\0\x08\0\x02".to_vec();
    let entry = |block: &mut Vec<u8>, tag: u16, kind: u16, value: [u8; 4]| {
        block.extend(tag.to_be_bytes());
        block.extend(kind.to_be_bytes());
        block.extend(1u32.to_be_bytes());
        block.extend(value);
    };
    let short = |v: u16| [v.to_be_bytes(), [0; 2]].concat().try_into().expect("four bytes");
    entry(&mut block, 0x0112, 3, short(orientation));
    entry(&mut block, 0x8769, 4, 38u32.to_be_bytes());
    block.extend(0u32.to_be_bytes());
    block.extend((fields.len() as u16).to_be_bytes());
    let mut tail = Vec::new();
    let tail_start = 38 + 2 + 12 * fields.len() + 4;
    for field in fields {
        match *field {
            Field::Short(tag, value) => entry(&mut block, tag, 3, short(value)),
            Field::Rational(tag, numerator, denominator) => {
                entry(&mut block, tag, 5, ((tail_start + tail.len()) as u32).to_be_bytes());
                tail.extend(numerator.to_be_bytes());
                tail.extend(denominator.to_be_bytes());
            }
        }
    }
    block.extend(0u32.to_be_bytes());
    block.extend(tail);
    block
}

/// A 3×2 photo, red at the top left, with an EXIF block, as PNG or JPEG.
fn with_exif(jpeg: bool, block: Vec<u8>) -> Vec<u8> {
    let mut image = ImageBuffer::from_pixel(3, 2, Rgb([0u8, 0, 255]));
    image.put_pixel(0, 0, Rgb([255, 0, 0]));
    let mut bytes = Vec::new();
    let written = if jpeg {
        let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 100);
        encoder.set_exif_metadata(block).expect("JPEG takes EXIF");
        encoder.write_image(&image, 3, 2, image::ExtendedColorType::Rgb8)
    } else {
        let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
        encoder.set_exif_metadata(block).expect("PNG takes EXIF");
        encoder.write_image(&image, 3, 2, image::ExtendedColorType::Rgb8)
    };
    written.expect("an encoded image");
    bytes
}

#[test]
fn every_depth_and_colour_reads_the_same() {
    let grey: Vec<u16> = (0..12u16).map(|i| i * 5000).collect();
    let grey = ImageBuffer::from_raw(4, 3, grey).expect("twelve pixels");
    let grey = DynamicImage::ImageLuma16(grey);
    let colour = DynamicImage::ImageRgb16(ImageBuffer::from_fn(4, 3, |x, y| {
        Rgb([x as u16 * 20_000, y as u16 * 30_000, 65_535])
    }));
    let luma = |i: usize| {
        (i % 4) as f32 * 20_000.0 / 65_535.0 * 0.2126 + (i / 4) as f32 * 30_000.0 / 65_535.0 * 0.7152 + 0.0722
    };
    for format in [ImageFormat::Png, ImageFormat::Tiff] {
        let photo = load_bytes("grey", &encode(&grey, format)).expect("16-bit grey");
        assert_eq!((photo.width, photo.height, photo.focal()), (4, 3, None));
        for (i, v) in photo.luma.iter().enumerate() {
            assert!((v - i as f32 * 5000.0 / 65_535.0).abs() < 1e-7);
        }
        let photo8 =
            load_bytes("grey", &encode(&DynamicImage::ImageLuma8(grey.to_luma8()), format)).expect("8-bit grey");
        assert_eq!(photo.rgb, photo8.rgb);
        for image in [colour.clone(), DynamicImage::ImageRgba16(colour.to_rgba16())] {
            let photo = load_bytes("colour", &encode(&image, format)).expect("16-bit colour");
            assert!(photo.luma.iter().enumerate().all(|(i, v)| (v - luma(i)).abs() < 1e-6));
        }
        for image in [DynamicImage::ImageRgb8(colour.to_rgb8()), DynamicImage::ImageRgba8(colour.to_rgba8())] {
            let photo = load_bytes("colour", &encode(&image, format)).expect("8-bit colour");
            assert!(photo.luma.iter().enumerate().all(|(i, v)| (v - luma(i)).abs() < 0.5 / 255.0 + 1e-6));
            assert_eq!(photo.rgb[1], [78, 0, 255]);
        }
    }
}

#[test]
fn exif_orientation_is_applied() {
    // Where the stored top left pixel of 3×2 ends up: Exif 2.32, tag 274.
    let places = [(0, 0), (2, 0), (2, 1), (0, 1), (0, 0), (1, 0), (1, 2), (0, 2)];
    for (orientation, (x, y)) in (1..).zip(places) {
        for jpeg in [false, true] {
            let photo = load_bytes("turned", &with_exif(jpeg, exif_block(orientation, &[]))).expect("a photo");
            assert_eq!((photo.width, photo.height), if orientation < 5 { (3, 2) } else { (2, 3) });
            let reddest = (0..6).max_by_key(|&i| i32::from(photo.rgb[i][0]) - i32::from(photo.rgb[i][2]));
            assert_eq!(reddest, Some((y * photo.width + x) as usize), "orientation {orientation}");
        }
    }
}

#[test]
fn focal_length_comes_from_exif() {
    let focal = |orientation, fields: &[Field]| {
        let photo = load_bytes("focal", &with_exif(false, exif_block(orientation, fields))).expect("a photo");
        (photo.focal_35mm, photo.focal())
    };
    // 35 mm on 36 mm film, 3 pixels on the longer side, upright or turned.
    assert_eq!(focal(1, &[Field::Short(0xa405, 35)]), (Some(35.0), Some(35.0 * 3.0 / 36.0)));
    assert_eq!(focal(6, &[Field::Short(0xa405, 35)]), (Some(35.0), Some(35.0 * 3.0 / 36.0)));
    // Zero means unknown.
    assert_eq!(focal(1, &[Field::Short(0xa405, 0)]), (None, None));
    // Canon PowerShot A70 (specimen of the EXIF standard's usual fields): 5.4 mm at 1600 pixels on 0.1968 inch.
    let plane = [
        Field::Rational(0x920a, 54, 10),
        Field::Short(0xa002, 1600),
        Field::Short(0xa003, 1200),
        Field::Rational(0xa20e, 1_600_000, 196),
        Field::Short(0xa210, 2),
    ];
    let (equivalent, _) = focal(1, &plane);
    let sensor = 1600.0 / (1_600_000.0 / 196.0) * 25.4;
    assert!((equivalent.expect("a focal length") - 5.4 * 36.0 / sensor).abs() < 1e-9);
    // In centimetres, without the size the camera recorded: the photo's own counts.
    let plane = [Field::Rational(0x920a, 50, 1), Field::Rational(0xa20e, 30, 1), Field::Short(0xa210, 3)];
    assert_eq!(focal(1, &plane).0, Some(50.0 * 36.0 / 1.0));
}

#[test]
fn damaged_exif_is_no_reason_to_refuse_a_photo() {
    let block = exif_block(1, &[Field::Short(0xa405, 35)]);
    for length in 0..block.len() {
        assert!(load_bytes("exif", &with_exif(false, block[..length].to_vec())).is_ok());
    }
}

#[test]
fn what_is_no_photo_is_refused_in_one_line() {
    let check = |name: &str, bytes: &[u8], part: &str| {
        let message = load_bytes(name, bytes).expect_err("no photo").to_string();
        assert!(message.contains(name) && message.contains(part) && !message.contains('\n'), "{message}");
    };
    let png = encode(&DynamicImage::new_rgb8(40, 30), ImageFormat::Png);
    let jpeg = encode(&DynamicImage::new_rgb8(400, 300), ImageFormat::Jpeg);
    check("empty.jpg", b"", "empty");
    check("text.jpg", b"no photo at all", "not a JPEG, PNG or TIFF image");
    check("photo.gif", b"GIF89a\x01\0\x01\0", "not a JPEG, PNG or TIFF image");
    check("cut.png", &png[..png.len() / 2], "cut short");
    check("cut.jpg", &jpeg[..jpeg.len() / 2], "cut short");
    let mut huge = png.clone();
    huge[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
    let crc = crc32(&huge[12..29]);
    huge[29..33].copy_from_slice(&crc.to_be_bytes());
    check("huge.png", &huge, "too large");
    let missing = Photo::load(Path::new("/absent/photo.jpg")).expect_err("no file").to_string();
    assert!(missing.starts_with("/absent/photo.jpg: No such file"), "{missing}");
}

/// The checksum of PNG chunks.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
    })
}

#[test]
fn cases_have_the_sizes_and_focal_lengths_their_cameras_say() {
    let cases: Option<PathBuf> =
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|a| a.join("shared/cases")).find(|p| p.is_dir());
    let Some(cases) = cases else {
        println!("skipped: no folder shared/cases above the crate");
        return;
    };
    for case in ["nefertiti_soft", "igea_painted", "facade_plain", "maria_wide"] {
        let text = std::fs::read_to_string(cases.join(case).join("initial.json")).expect("initial.json");
        let cameras: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        for camera in cameras["photos"].as_array().expect("photos") {
            let photo = Photo::load(cases.join(case).join(camera["file"].as_str().expect("a name"))).expect("a photo");
            assert_eq!(Some(u64::from(photo.width)), camera["width"].as_u64(), "{case}");
            assert_eq!(Some(u64::from(photo.height)), camera["height"].as_u64(), "{case}");
            let focal = camera["K"]["fx"].as_f64().expect("a focal length");
            assert!(
                photo.focal().is_some_and(|f| (f / focal - 1.0).abs() < 1e-6),
                "{case}: {:?} is not {focal}",
                photo.focal()
            );
        }
    }
}
