//! Point clouds as surfaces: what a cloud was sampled from is what its squares show, at any scale.
mod scans;

use nalgebra::Vector3;
use rand::{Rng, SeedableRng, rngs::StdRng};
use scans::{ScanPoint, e57, las};
use texreg_surface::{Attributes, Mesh, Scanner, load};

fn cloud(points: &[[f64; 3]], viewpoint: Scanner) -> Mesh {
    Mesh::from_points(points, Attributes::default(), viewpoint).expect("a cloud")
}

/// The area of square `i`.
fn area(mesh: &Mesh, i: usize) -> f64 {
    let [a, b, _, d] = [0, 1, 2, 3].map(|k| mesh.point(4 * i + k));
    (b - a).cross(&(d - a)).norm()
}

/// Whether a vertical line at (x, y) meets a square.
fn is_covered(mesh: &Mesh, x: f64, y: f64) -> bool {
    mesh.triangles.iter().any(|t| {
        let [a, b, c] = t.map(|i| mesh.point(i as usize));
        let side =
            |p: &nalgebra::Point3<f64>, q: &nalgebra::Point3<f64>| (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
        let sides = [side(&a, &b), side(&b, &c), side(&c, &a)];
        sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
    })
}

/// Lines `apart` from each other of points `along` from each other, over a square of side 2.
fn lines(along: f64, apart: f64) -> Vec<[f64; 3]> {
    let steps = |step: f64| (0..(2.0 / step) as i32).map(move |i| f64::from(i) * step);
    steps(apart).flat_map(|y| steps(along).map(move |x| [x, y, 0.001 * (5.0 * x).sin()])).collect()
}

#[test]
fn scan_lines_make_a_surface_without_holes() {
    for (along, apart) in [(0.1, 0.1), (0.04, 0.2), (0.01, 0.25)] {
        let mesh = cloud(&lines(along, apart), Scanner::At([1.0, 1.0, 9.0]));
        let mut random = StdRng::seed_from_u64(3);
        let holes = (0..200).filter(|_| {
            let (x, y) = (random.random_range(0.3..1.5), random.random_range(0.3..1.5));
            !is_covered(&mesh, x, y)
        });
        assert!(holes.count() <= 2, "{along} by {apart}");
        let up = mesh.normals.iter().filter(|n| n[2] > 0.95).count();
        assert!(up as f64 > 0.97 * mesh.normals.len() as f64, "{along} by {apart}: {up} normals look up");
        let total: f64 = (0..mesh.positions.len() / 4).map(|i| area(&mesh, i)).sum();
        assert!(total < 2.0 * 4.0, "{along} by {apart}: squares of {total} on a surface of 4");
    }
}

#[test]
fn a_sphere_has_its_normals_and_its_area() {
    let mut random = StdRng::seed_from_u64(5);
    let mut points = Vec::new();
    while points.len() < 4_000 {
        let p = Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f64));
        if p.norm() > 0.1 && p.norm() < 1.0 {
            points.push((p.normalize() * 7.0 + Vector3::new(1e6, 2e6, 0.0)).into());
        }
    }
    let mesh = cloud(&points, Scanner::At([1e6, 2e6, 0.0]));
    let mut total = 0.0;
    for (i, p) in points.iter().enumerate() {
        let inward = (Vector3::new(1e6, 2e6, 0.0) - Vector3::from(*p)) / 7.0;
        let normal = Vector3::from(mesh.normals[4 * i].map(f64::from));
        assert!(inward.dot(&normal) > 0.9, "{i}: {}", inward.dot(&normal));
        total += area(&mesh, i);
    }
    let true_area = 4.0 * std::f64::consts::PI * 49.0;
    assert!((1.0..2.0).contains(&(total / true_area)), "{}", total / true_area);
    // Normals look inwards: the surface is hollow to them.
    let curvature = mesh.mean_curvature().iter().map(|&x| f64::from(x)).sum::<f64>() / mesh.positions.len() as f64;
    assert!((curvature * -7.0 - 1.0).abs() < 0.1, "{curvature}");
}

#[test]
fn squares_follow_the_scale_of_the_data() {
    let small = cloud(&lines(0.04, 0.2), Scanner::Unknown);
    let scaled: Vec<[f64; 3]> = lines(0.04, 0.2).iter().map(|p| p.map(|x| 1024.0 * x)).collect();
    let large = cloud(&scaled, Scanner::Unknown);
    for (p, q) in small.positions.iter().flatten().zip(large.positions.iter().flatten()) {
        assert!((1024.0 * p - q).abs() <= 1e-3 * q.abs().max(1.0), "{p} {q}");
    }
}

#[test]
fn given_normals_stay() {
    let points = lines(0.1, 0.1);
    let slanted = [0.6, 0.0, 0.8];
    let normals = Some(vec![slanted; points.len()]);
    let mesh = Mesh::from_points(&points, Attributes { normals, ..Attributes::default() }, Scanner::Unknown);
    let mesh = mesh.expect("a cloud");
    assert!(mesh.normals.iter().all(|n| (0..3).all(|k| (n[k] - slanted[k]).abs() < 1e-6)));
}

#[test]
fn few_and_equal_points_are_no_harm() {
    let line: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    let plane: Vec<[f64; 3]> = (0..5_000).map(|i| [f64::from(i % 70), f64::from(i / 70), 0.0]).collect();
    for points in [vec![[1.0; 3]], vec![[1.0; 3]; 1000], vec![[0.0; 3], [1.0; 3]], line, plane] {
        let mesh = cloud(&points, Scanner::Unknown);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (4 * points.len(), 2 * points.len()));
        assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
        let unit = |n: &[f32; 3]| (Vector3::from(*n).norm() - 1.0).abs() < 1e-5;
        assert!(mesh.normals.iter().all(unit));
    }
    assert!(Mesh::from_points(&[], Attributes::default(), Scanner::Unknown).is_err());
}

#[test]
fn a_coarse_copy_is_a_cloud_of_fewer_points() {
    let mesh = cloud(&lines(0.02, 0.02), Scanner::At([1.0, 1.0, 9.0]));
    let coarse = mesh.simplified(1_000);
    assert!(coarse.is_cloud);
    assert!((600..1_500).contains(&coarse.triangles.len()), "{}", coarse.triangles.len());
    assert!(coarse.normals.iter().all(|n| n[2] > 0.99));
    assert!(is_covered(&coarse, 0.9, 1.1) && is_covered(&coarse, 1.03, 0.77));
}

#[test]
fn scanners_files_come_in_with_intensity_and_colour() {
    // Survey coordinates, millimetres kept.
    let far = |i| {
        let point = ScanPoint::grid(i, 20);
        let [x, y, z] = point.place;
        ScanPoint { place: [x + 453_217.125, y + 5_211_906.25, z + 412.5], ..point }
    };
    let points: Vec<ScanPoint> = (0..200).map(far).collect();
    let scanner = [453_220.0, 5_211_908.0, 420.0];
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in
        [("a.las", las(&points, false)), ("b.laz", las(&points, true)), ("c.e57", e57(&points, scanner))]
    {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a file in the temporary folder");
        let mesh = load(&path).unwrap_or_else(|error| panic!("{error}"));
        assert!(mesh.is_cloud);
        assert_eq!(mesh.triangles.len(), 400, "{name}");
        let reflectance = mesh.reflectance.as_ref().expect("intensities");
        let colours = mesh.colours.as_ref().expect("colours");
        for (i, point) in points.iter().enumerate() {
            let corners = [0, 1, 2, 3].map(|k| mesh.point(4 * i + k).coords);
            let reach = (corners[0] - corners[2]).norm();
            let centre = corners.iter().sum::<Vector3<f64>>() / 4.0;
            assert!((centre - Vector3::from(point.place)).norm() < 0.5 * reach + 1e-3, "{name}: point {i}");
            assert_eq!(colours[4 * i], point.colour, "{name}: point {i}");
        }
        // Intensities keep their order and their steps, whatever the scale.
        let step = (reflectance[4 * 199] - reflectance[0]) / 199.0;
        assert!(
            step > 0.0 && (reflectance[4 * 50] - reflectance[0] - 50.0 * step).abs() < 1e-3 * step.max(1.0),
            "{name}"
        );
    }
}

#[test]
fn cut_scans_are_refused_in_one_line() {
    let points: Vec<ScanPoint> = (0..200).map(|i| ScanPoint::grid(i, 20)).collect();
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in
        [("a.las", las(&points, false)), ("b.laz", las(&points, true)), ("c.e57", e57(&points, [0.0; 3]))]
    {
        let path = folder.path().join(name);
        for kept in [8, 100, bytes.len() / 2] {
            std::fs::write(&path, &bytes[..kept]).expect("a file in the temporary folder");
            let message = load(&path).expect_err("a cut file").to_string();
            assert!(message.contains(name) && !message.contains('\n'), "{message:?}");
        }
    }
}

#[test]
fn a_cloud_is_written_as_its_points() {
    let points = lines(0.01, 0.1);
    let reflectance = (0..points.len()).map(|i| i as f32).collect();
    let attributes = Attributes { reflectance: Some(reflectance), ..Attributes::default() };
    let cloud = Mesh::from_points(&points, attributes, Scanner::At([0.0, 0.0, 5.0])).unwrap();
    let mut bytes = Vec::new();
    cloud.write_ply(&mut bytes).unwrap();
    let header = String::from_utf8_lossy(&bytes[..200]);
    assert!(header.contains(&format!("element vertex {}\n", points.len())) && !header.contains("element face"));
    let path = tempfile::tempdir().unwrap();
    let path = path.path().join("cloud.ply");
    std::fs::write(&path, bytes).unwrap();
    let again = load(&path).unwrap();
    assert!(again.is_cloud);
    assert_eq!((again.positions.len(), &again.reflectance), (cloud.positions.len(), &cloud.reflectance));
    for i in 0..cloud.positions.len() {
        assert!((again.point(i) - cloud.point(i)).norm() < 1e-6);
    }
}
