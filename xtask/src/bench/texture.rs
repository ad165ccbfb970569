//! Textures against photos that had no part in them: each photo of a case in turn is left out, the model textured from the
//! others, drawn from the true camera of the one left out, and compared with it.
//!
//! Compared are the pixels that the model covers whole and some other photo sees. The peer is the plain mean of all photos that
//! see a place, with the same visibility, from the same run. The exposure of the photo left out is its own: the drawing's red, green
//! and blue are each scaled to it first. Where the light moves with the photos, no texture can agree well.
//!
//! Pictures of the first photo left out of each case, drawn and taken, are put under `target/texture/`.
//!
//! Without `--quick`, the last rows are the time and the memory for 20 photos of 12 megapixels on the terrain's million triangles.

use super::{Arguments, Report, Row, accuracy};
use anyhow::{Context, Result, ensure};
use image::RgbImage;
use image::imageops::FilterType;
use nalgebra::{Rotation3, Vector3};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;
use texreg::camera::View;
use texreg::driver::{Model, Photo, Registration, read_truth};
use texreg::formats::read_cameras;
use texreg::lie::Pose;
use texreg::surface::Mesh;
use texreg::texture::{Agreement, Blend, Error, Options, Pixels, Source, Texture, Textured, agreement, draw, texture};

/// Photos a case needs, so that two are left.
const FEWEST: usize = 3;
/// Photos left out in turn with `--quick`.
const QUICK: usize = 1;
/// The large texture: photos, and their width.
const MANY: usize = 20;
const WIDE: u32 = 4000;

const BLENDS: [(&str, Blend); 3] = [("multiband", Blend::MultiBand), ("best", Blend::Best), ("mean", Blend::Mean)];

/// Measures every case, and the large texture.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    println!("{:18} {:10} {:>9}  {:^20}  {:^20}", "", "", "", "PSNR dB", "SSIM");
    print!("{:18} {:10} {:>9}", "case", "cameras", "compared");
    for _ in 0..2 {
        BLENDS.iter().for_each(|(name, _)| print!(" {name:>9}"));
    }
    println!();
    let mut rows = Vec::new();
    for folder in accuracy::case_folders(arguments)? {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let found = case(&folder, arguments.quick).with_context(|| folder.display().to_string())?;
        for (cameras, compared, agreements) in found {
            print!("{name:18} {cameras:10} {:8.0}%", 100.0 * compared);
            agreements.iter().for_each(|a| print!(" {:9.2}", a.psnr));
            agreements.iter().for_each(|a| print!(" {:9.4}", a.ssim));
            println!();
            let rms = |a: &Agreement| 255.0 / 10f64.powf(a.psnr / 20.0);
            let (ours, mean) = (rms(&agreements[0]), rms(&agreements[2]));
            rows.push(Row::beside(
                format!("{name}, {cameras} cameras: rms difference"),
                ours,
                mean,
                "plain mean",
                "/255",
            ));
        }
    }
    let mut notes = Vec::new();
    if !arguments.quick {
        match arguments.cases.as_ref().map(|cases| cases.join("terrain_1m")).filter(|folder| folder.is_dir()) {
            Some(folder) => rows.extend(large(&folder)?),
            None => notes.push("the large texture needs the case terrain_1m in --cases DIR".to_owned()),
        }
    }
    Ok(Report { notes, ..Report::new("texture", rows) })
}

/// The agreement of one case by cameras: their name, the share of the model's pixels compared, and the mean over the photos left
/// out for each blend.
fn case(folder: &Path, quick: bool) -> Result<Vec<(&'static str, f64, [Agreement; 3])>> {
    let truth = read_truth(&folder.join("truth.json"))?;
    if truth.photos.len() < FEWEST {
        return Ok(Vec::new());
    }
    let mesh = texreg::surface::load(folder.join("model.ply"))?;
    let photos = truth.photos.iter().map(|photo| Photo::load(folder.join(&photo.file)));
    let photos: Vec<Photo> = photos.collect::<Result<_, _>>()?;
    let true_views: Vec<View> = truth.photos.iter().map(|photo| photo.view).collect();
    let initial = read_cameras(&folder.join("initial.json"))?;
    let model = Model::new(&mesh, &[])?;
    let register = |(photo, view): (&Photo, &View)| {
        let entry = initial.entry(&photo.file).context("initial.json does not name the photo")?;
        let start = View { camera: view.camera, pose: entry.pose };
        let options = texreg::driver::Options::default();
        Ok(Registration::new(&model, photo, &options).run(&start, &mut |_| ControlFlow::Continue(()))?.view)
    };
    let registered: Vec<View> = photos.iter().zip(&true_views).map(register).collect::<Result<_>>()?;
    let count = if quick { QUICK } else { photos.len() };
    let mut found = Vec::new();
    for (name, views) in [("true", &true_views), ("registered", &registered)] {
        let (mut sums, mut compared) = ([(0.0, 0.0); 3], 0.0);
        for out in 0..count {
            for (k, (_, blend)) in BLENDS.into_iter().enumerate() {
                let textured = without(&mesh, &photos, views, out, blend)?;
                let (drawn, shares) = draw(&mesh, &textured.texture, &true_views[out], 2);
                let seen = RgbImage::from_fn(textured.seen.width(), textured.seen.height(), |x, y| {
                    image::Rgb([textured.seen.get_pixel(x, y)[0]; 3])
                });
                let seen = Texture { image: seen, uvs: textured.texture.uvs };
                let (seen, _) = draw(&mesh, &seen, &true_views[out], 2);
                let mask: Vec<bool> =
                    shares.iter().zip(seen.pixels()).map(|(s, p)| *s == 1.0 && p[0] == u8::MAX).collect();
                let photo = &photos[out];
                let photo = RgbImage::from_raw(photo.width, photo.height, photo.rgb.concat()).context("size")?;
                let drawn = exposed_like(&photo, &drawn, &mask);
                let found = agreement(&drawn, &photo, &mask).context("nothing to compare")?;
                if k == 0 && out == 0 {
                    let case = folder.file_name().unwrap_or_default().to_string_lossy();
                    save(&format!("{case}_{name}.jpg"), &drawn, &photo)?;
                }
                sums[k].0 += found.psnr / count as f64;
                sums[k].1 += found.ssim / count as f64;
                if k == 0 {
                    let whole = shares.iter().filter(|s| **s == 1.0).count();
                    compared += found.pixels as f64 / whole as f64 / count as f64;
                }
            }
        }
        found.push((name, compared, sums.map(|(psnr, ssim)| Agreement { psnr, ssim, pixels: 0 })));
    }
    Ok(found)
}

/// A drawing with each channel scaled so that it differs least from the photo where they are compared.
fn exposed_like(photo: &RgbImage, drawn: &RgbImage, mask: &[bool]) -> RgbImage {
    let gain: [f64; 3] = std::array::from_fn(|c| {
        let pairs = photo.pixels().zip(drawn.pixels()).zip(mask).filter(|(_, mask)| **mask);
        let sums = pairs.fold((0.0, 0.0), |(ab, bb), ((a, b), _)| {
            let (a, b) = (f64::from(a[c]), f64::from(b[c]));
            (ab + a * b, bb + b * b)
        });
        sums.0 / sums.1.max(1.0)
    });
    let mut drawn = drawn.clone();
    for pixel in drawn.pixels_mut() {
        (0..3).for_each(|c| pixel[c] = (f64::from(pixel[c]) * gain[c]).round().clamp(0.0, 255.0) as u8);
    }
    drawn
}

/// Two pictures side by side, under `target/texture/`.
fn save(name: &str, left: &RgbImage, right: &RgbImage) -> Result<()> {
    let mut both = RgbImage::new(2 * left.width(), left.height());
    image::imageops::replace(&mut both, left, 0, 0);
    image::imageops::replace(&mut both, right, i64::from(left.width()), 0);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/texture");
    std::fs::create_dir_all(&folder)?;
    Ok(both.save(folder.join(name))?)
}

/// The texture from all photos but one.
fn without(mesh: &Mesh, photos: &[Photo], views: &[View], out: usize, blend: Blend) -> Result<Textured> {
    let others: Vec<usize> = (0..photos.len()).filter(|&i| i != out).collect();
    let sources: Vec<Source> =
        others.iter().map(|&i| Source { view: views[i], trust: 1.0, uncertainty: 0.0 }).collect();
    let load = |i: usize| Ok::<_, Error>(pixels(&photos[others[i]]));
    Ok(texture(mesh, &sources, load, &Options { blend, ..Options::default() })?)
}

fn pixels(photo: &Photo) -> Pixels {
    Pixels { width: photo.width, height: photo.height, rgb: photo.rgb.clone() }
}

/// Time and memory of a large texture: the terrain's photos enlarged, from places around theirs.
fn large(folder: &Path) -> Result<[Row; 2]> {
    let packed = std::process::Command::new("xz").arg("-dkc").arg(folder.join("model.ply.xz")).output()?;
    ensure!(packed.status.success(), "{}: xz cannot unpack the model", folder.display());
    let scratch = tempfile::tempdir()?;
    let path = scratch.path().join("model.ply");
    std::fs::write(&path, packed.stdout)?;
    let mesh = texreg::surface::load(&path)?;
    let truth = read_truth(&folder.join("truth.json"))?;
    let mut views = Vec::new();
    for (i, photo) in truth.photos.iter().enumerate() {
        let factor = f64::from(WIDE) / f64::from(photo.view.camera.width);
        let camera = photo.view.camera.scaled(factor);
        let picture = image::open(folder.join(&photo.file))?;
        let enlarged = picture.resize_exact(camera.width, camera.height, FilterType::CatmullRom).to_rgb8();
        enlarged.save(scratch.path().join(format!("{i}.jpg")))?;
        views.push(View { camera, pose: photo.view.pose });
    }
    let source = |i: usize| {
        // A few degrees to the side around the model's middle.
        let view = &views[i % views.len()];
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.01 * i as f64);
        let centre = mesh.centre().coords;
        let world = Pose::new(turn, centre - turn * centre);
        Source { view: View { camera: view.camera, pose: view.pose * world }, trust: 1.0, uncertainty: 0.0 }
    };
    let sources: Vec<Source> = (0..MANY).map(source).collect();
    let load = |i: usize| {
        let photo = Photo::load(scratch.path().join(format!("{}.jpg", i % views.len())))?;
        Ok::<_, anyhow::Error>(Pixels { width: photo.width, height: photo.height, rgb: photo.rgb })
    };
    let began = Instant::now();
    let textured = texture(&mesh, &sources, load, &Options::default())?;
    let seconds = began.elapsed().as_secs_f64();
    let (width, height) = textured.texture.image.dimensions();
    println!(
        "{MANY} photos of {:.0} megapixels, {} triangles: {width} × {height} texels, {} charts, {:.0} % seen",
        f64::from(views[0].camera.width) * f64::from(views[0].camera.height) / 1e6,
        mesh.triangles.len(),
        textured.charts,
        100.0 * textured.seen_share
    );
    Ok([
        Row::alone("large texture: time", seconds, "s"),
        Row::alone("large texture: peak memory of this process", peak()?, "GiB"),
    ])
}

/// The most memory this process ever had.
fn peak() -> Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .context("the system does not tell the peak memory")?;
    let kibibytes: f64 = line.trim().trim_end_matches(" kB").trim().parse()?;
    Ok(kibibytes / (1024.0 * 1024.0))
}
