//! Scenes whose texture is known: what comes out of photos of them is what went in.

use image::{Rgb, RgbImage};
use nalgebra::{Point3, Rotation3, Vector3};
use texreg_camera::{Camera, Distortion, View};
use texreg_lie::Pose;
use texreg_raster::{Options as RenderOptions, render};
use texreg_surface::{Attributes, Mesh};
use texreg_texture::{Blend, Error, Options, Pixels, Source, Unseen, agreement, draw, texture};

/// The colour that must never show: the background's.
const BACKGROUND: [u8; 3] = [255, 0, 255];

/// A bumpy ball of about two units, with UVs by longitude and latitude if asked for.
fn ball(steps: u32, with_uvs: bool) -> Mesh {
    let (columns, rows) = (2 * steps, steps);
    let angle = |i: u32, j: u32| {
        (
            std::f64::consts::TAU * f64::from(i) / f64::from(columns),
            std::f64::consts::PI * f64::from(j) / f64::from(rows),
        )
    };
    let point = |i: u32, j: u32| {
        let (a, b) = angle(i % columns, j);
        let r = 1.0 + 0.08 * (5.0 * a).sin() * b.sin().powi(2);
        [r * b.sin() * a.cos() + 500_000.0, r * b.sin() * a.sin() - 20.0, r * b.cos() + 3.0]
    };
    let points: Vec<[f64; 3]> = (0..=rows).flat_map(|j| (0..columns).map(move |i| point(i, j))).collect();
    let (mut triangles, mut uvs) = (Vec::new(), Vec::new());
    for j in 0..rows {
        for i in 0..columns {
            let at = |i: u32, j: u32| j * columns + i % columns;
            let uv = |i: u32, j: u32| [0.02 + 0.96 * i as f32 / columns as f32, 0.02 + 0.96 * j as f32 / rows as f32];
            for [a, b, c] in [[(i, j), (i, j + 1), (i + 1, j)], [(i + 1, j), (i, j + 1), (i + 1, j + 1)]] {
                triangles.push([at(a.0, a.1), at(b.0, b.1), at(c.0, c.1)]);
                uvs.push([uv(a.0, a.1), uv(b.0, b.1), uv(c.0, c.1)]);
            }
        }
    }
    Mesh::new(&points, triangles, Attributes { uvs: with_uvs.then_some(uvs), ..Attributes::default() }).unwrap()
}

/// The paint: a smooth pattern with detail, far from the background's colour.
fn paint(p: [f32; 3]) -> [f32; 3] {
    let wave = |x: f32| 0.5 + 0.5 * x.sin();
    let detail = 22.0 * wave(23.0 * p[0] + 9.0 * p[1]) * wave(19.0 * p[2]);
    [
        60.0 + 70.0 * wave(3.0 * p[0]) + detail,
        90.0 + 80.0 * wave(4.0 * p[1] + p[2]) + detail,
        50.0 + 60.0 * wave(5.0 * p[2]),
    ]
}

/// A photo of the painted mesh before the background, averaged over 3 × 3 points a pixel, its light scaled by `gain`.
fn shoot(mesh: &Mesh, view: &View, gain: f32) -> Pixels {
    const FINE: u32 = 3;
    let camera = view.camera.scaled(f64::from(FINE));
    let camera_from_mesh = view.pose * Pose::new(Rotation3::identity(), mesh.origin);
    let options = RenderOptions { barycentric: true, ..RenderOptions::default() };
    let triangles = mesh.shape();
    let fine = render(&triangles, &camera, &camera_from_mesh, &options);
    let points = fine.interpolate(&mesh.triangles, &mesh.positions, [f32::NAN; 3]);
    let (width, height) = (view.camera.width, view.camera.height);
    let pixel = |i: u32| {
        let mut sum = [0.0; 3];
        for k in 0..FINE * FINE {
            let (x, y) = (i % width * FINE + k % FINE, i / width * FINE + k / FINE);
            let p = points[(y * camera.width + x) as usize];
            let value = if p[0].is_nan() { BACKGROUND.map(f32::from) } else { paint(p).map(|v| v * gain) };
            (0..3).for_each(|c| sum[c] += value[c] / (FINE * FINE) as f32);
        }
        sum.map(|v| v.round().clamp(0.0, 255.0) as u8)
    };
    Pixels { width, height, rgb: (0..width * height).map(pixel).collect() }
}

/// A camera on a circle around the mesh, with a lens that distorts.
fn view(mesh: &Mesh, degrees: f64) -> View {
    let camera =
        Camera { distortion: Distortion::from([-0.12, 0.05, 1e-3, -1e-3, 0.0]), ..Camera::ideal(480, 360, 500.0) };
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), degrees.to_radians());
    let centre: Point3<f64> = mesh.centre();
    View { camera, pose: Pose::new(turn, Vector3::new(0.05, 0.02, 4.2) - turn * centre.coords) }
}

fn around(mesh: &Mesh, count: u32) -> Vec<View> {
    (0..count).map(|i| view(mesh, 360.0 * f64::from(i) / f64::from(count))).collect()
}

fn sources(views: &[View]) -> Vec<Source> {
    views.iter().map(|&view| Source { view, trust: 1.0, uncertainty: 0.0 }).collect()
}

/// PSNR and share of the model's whole pixels in a view between photos, against a photo from there.
fn check(mesh: &Mesh, options: &Options, gains: &[f32]) -> f64 {
    let views = around(mesh, 6);
    let photos: Vec<Pixels> = views.iter().zip(gains.iter().cycle()).map(|(v, &gain)| shoot(mesh, v, gain)).collect();
    let textured = texture(mesh, &sources(&views), |i| Ok::<_, Error>(photos[i].clone()), options).unwrap();
    assert!(textured.seen_share > 0.65, "{}", textured.seen_share);
    let between = view(mesh, 30.0);
    let (drawn, shares) = draw(mesh, &textured.texture, &between, 3);
    let photo = shoot(mesh, &between, 1.0);
    let photo = RgbImage::from_raw(photo.width, photo.height, photo.rgb.concat()).unwrap();
    let mask: Vec<bool> = shares.iter().map(|share| *share == 1.0).collect();
    agreement(&drawn, &photo, &mask).unwrap().psnr
}

#[test]
fn a_known_texture_comes_back() {
    let mesh = ball(60, false);
    for (blend, least) in [(Blend::MultiBand, 37.0), (Blend::Best, 37.0), (Blend::Mean, 34.0)] {
        let psnr = check(&mesh, &Options { blend, ..Options::default() }, &[1.0]);
        assert!(psnr > least, "{blend:?}: {psnr:.2} dB");
    }
}

#[test]
fn own_texture_coordinates_are_kept() {
    let mesh = ball(60, true);
    let psnr = check(&mesh, &Options::default(), &[1.0]);
    assert!(psnr > 33.0, "{psnr:.2} dB");
    let views = around(&mesh, 4);
    let load = |i: usize| Ok::<_, Error>(shoot(&mesh, &views[i], 1.0));
    let textured = texture(&mesh, &sources(&views), load, &Options { size: Some(256), ..Options::default() }).unwrap();
    assert_eq!((textured.charts, textured.texture.image.dimensions()), (0, (256, 256)));
    let given = mesh.uvs.as_ref().unwrap();
    let apart = given.as_flattened().iter().zip(textured.texture.uvs.as_flattened());
    assert!(apart.map(|(a, b)| (a[0] - b[0]).abs().max((a[1] - b[1]).abs())).fold(0.0, f32::max) < 1e-5);
}

#[test]
fn texture_coordinates_that_overlap_do_not_serve() {
    let mut mesh = ball(20, true);
    mesh.uvs.iter_mut().flatten().for_each(|uvs| uvs.iter_mut().for_each(|uv| uv[0] = (2.0 * uv[0]).fract()));
    let views = around(&mesh, 3);
    let load = |i: usize| Ok::<_, Error>(shoot(&mesh, &views[i], 1.0));
    assert!(texture(&mesh, &sources(&views), load, &Options::default()).unwrap().charts > 0);
}

#[test]
fn exposures_are_matched() {
    let mesh = ball(60, false);
    let gains = [1.0, 0.8, 1.1];
    let matched = check(&mesh, &Options::default(), &gains);
    let left = check(&mesh, &Options { balance: false, ..Options::default() }, &gains);
    assert!(matched > left + 2.0, "{matched:.2} against {left:.2} dB");
}

#[test]
fn the_background_never_bleeds() {
    let mesh = ball(60, false);
    // A pixel off, as registrations are: the background is then where the outline should be.
    let mut shifted = sources(&around(&mesh, 5));
    let photos: Vec<Pixels> = shifted.iter().map(|source| shoot(&mesh, &source.view, 1.0)).collect();
    shifted.iter_mut().for_each(|source| {
        source.view.camera.intrinsics.cx += 1.0;
        source.uncertainty = 1.5;
    });
    for blend in [Blend::MultiBand, Blend::Best, Blend::Mean] {
        let options = Options { blend, ..Options::default() };
        let textured = texture(&mesh, &shifted, |i| Ok::<_, Error>(photos[i].clone()), &options).unwrap();
        let is_tinted = |p: &Rgb<u8>| i32::from(p[2]) > i32::from(p[1]) + 40;
        let tinted = textured.texture.image.pixels().filter(|p| is_tinted(p)).count();
        assert_eq!(tinted, 0, "{blend:?}");
        let colours = textured.colours.iter().filter(|c| is_tinted(&Rgb(**c))).count();
        assert_eq!(colours, 0, "{blend:?}");
    }
}

#[test]
fn a_nearer_surface_does_not_print_through() {
    // A red square before a large grey one: what it hides is not painted red.
    let square = |z: f64, r: f64| [[-r, -r, z], [r, -r, z], [r, r, z], [-r, r, z]];
    let points = [square(0.0, 2.0), square(1.0, 0.5)].concat();
    let mesh = Mesh::new(&points, vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], Attributes::default()).unwrap();
    let camera = Camera::ideal(400, 300, 300.0);
    let look = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let views: Vec<View> =
        [-0.3, 0.3].map(|x| View { camera, pose: Pose::new(look, Vector3::new(x, 0.0, 6.0)) }).to_vec();
    let shot = |view: &View| {
        let triangles = mesh.shape();
        let pose = view.pose * Pose::new(Rotation3::identity(), mesh.origin);
        let picture = render(&triangles, &camera, &pose, &RenderOptions::default());
        let colour = |face: &u32| match face {
            0 | 1 => [120, 120, 120],
            2 | 3 => [220, 20, 20],
            _ => [0; 3],
        };
        Pixels { width: 400, height: 300, rgb: picture.face.iter().map(colour).collect() }
    };
    let options = Options { unseen: Unseen::Mark, ..Options::default() };
    let textured = texture(&mesh, &sources(&views), |i| Ok::<_, Error>(shot(&views[i])), &options).unwrap();
    // The large square's texels, by its texture coordinates.
    let texture = &textured.texture;
    let (mut grey, mut marked) = (0, 0);
    for i in 0..100 {
        for j in 0..100 {
            let (v, w) = ((f64::from(i) + 0.5) / 100.0, (f64::from(j) + 0.5) / 100.0);
            if v + w < 1.0 {
                let [a, b, c] = texture.uvs[0].map(|uv| uv.map(f64::from));
                let at = |k: usize| (1.0 - v - w) * a[k] + v * b[k] + w * c[k];
                let colour = texture.sample([at(0) as f32, at(1) as f32]);
                assert!(colour[1] > 110.0 || colour[2] > 110.0, "red at {v:.2} {w:.2}: {colour:?}");
                grey += i32::from((colour[1] - 120.0).abs() < 2.0);
                marked += i32::from(colour == [255.0, 0.0, 255.0]);
            }
        }
    }
    assert!(grey > 4000 && marked > 50, "{grey} grey, {marked} unseen");
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let mesh = ball(40, false);
    let views = around(&mesh, 4);
    let photos: Vec<Pixels> = views.iter().map(|view| shoot(&mesh, view, 1.0)).collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let run =
            || texture(&mesh, &sources(&views), |i| Ok::<_, Error>(photos[i].clone()), &Options::default()).unwrap();
        let textured = pool.install(run);
        (textured.texture, textured.colours, textured.gains)
    };
    assert!(run(1) == run(3));
}

#[test]
fn wrong_input_is_said() {
    let mesh = ball(10, false);
    let views = around(&mesh, 2);
    let small = |_| Ok::<_, Error>(Pixels { width: 3, height: 2, rgb: vec![[0; 3]; 6] });
    let error = texture(&mesh, &sources(&views), small, &Options::default()).unwrap_err();
    assert_eq!(error, Error::Size { index: 0, expected: [480, 360], found: [3, 2] });
    let mut away = sources(&views);
    away.iter_mut().for_each(|source| source.view.pose.translation.z = -50.0);
    assert_eq!(texture(&mesh, &away, small, &Options::default()).unwrap_err(), Error::NothingSeen);
    assert_eq!(texture(&mesh, &[], small, &Options::default()).unwrap_err(), Error::NothingSeen);
}
