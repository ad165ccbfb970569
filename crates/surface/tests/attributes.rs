//! Curvature and ambient occlusion against shapes where both are known, and normals on degenerate meshes.
mod shapes;

use nalgebra::Vector3;
use shapes::{graph, mesh, soup, sphere};
use texreg_surface::{Attributes, Mesh, weld};

#[test]
fn a_sphere_has_the_curvature_of_its_radius() {
    for radius in [1e-3, 2.5, 1e4] {
        let ball = sphere(4, radius, [0.0; 3]);
        for (i, &h) in ball.mean_curvature().iter().enumerate() {
            assert!((f64::from(h) * radius - 1.0).abs() < 0.02, "vertex {i}: {h} for radius {radius}");
        }
        // Seen from inside it is a hollow.
        let mut hollow = sphere(4, radius, [0.0; 3]);
        hollow.normals.iter_mut().for_each(|n| *n = n.map(|x| -x));
        assert!(hollow.mean_curvature().iter().all(|&h| f64::from(h) * radius < -0.98));
    }
}

#[test]
fn curvature_of_graphs() {
    assert!(graph(20, 1.0, |x, y| 0.3 * x - y).mean_curvature().iter().all(|h| h.abs() < 1e-4));
    // At the apex of z = (a x² + b y²) / 2 the principal curvatures are a and b, and the bowl is hollow from above.
    for (a, b) in [(1.0, 1.0), (1.0, 0.0), (1.0, -1.0), (0.5, 2.0)] {
        let bowl = graph(40, 1.0, |x, y| 0.5 * (a * x * x + b * y * y));
        let apex = 20 * 41 + 20;
        let h = f64::from(bowl.mean_curvature()[apex]);
        assert!((h + 0.5 * (a + b)).abs() < 0.01, "{h} for {a}, {b}");
    }
}

#[test]
fn curvature_is_the_same_for_a_soup() {
    let ball = sphere(3, 1.0, [0.0; 3]);
    let loose = soup(&ball);
    let expected = ball.mean_curvature();
    for (&h, &i) in loose.mean_curvature().iter().zip(ball.triangles.iter().flatten()) {
        assert!((h - expected[i as usize]).abs() < 1e-3);
    }
}

#[test]
fn what_bulges_sees_all_of_the_sky() {
    for shape in [sphere(4, 3.0, [1e6, 2e6, 0.0]), graph(50, 1.0, |x, y| 0.2 * x + y)] {
        let least = shape.ambient_occlusion().iter().copied().fold(1.0, f32::min);
        assert!(least > 0.99, "{least}");
    }
}

#[test]
fn a_bowl_sees_its_opening() {
    // Within a sphere every patch fills the same share of every point's half-space, its share of the sphere's area: so
    // a bowl that is a part f of the sphere leaves each of its points 1 − f of the sky.
    for cut in [0.0, 0.5, -0.4] {
        let ball = sphere(5, 1.0, [0.0; 3]);
        let kept = |t: &&[u32; 3]| t.iter().all(|&i| ball.point(i as usize).z < cut);
        let triangles: Vec<[u32; 3]> = ball.triangles.iter().filter(kept).map(|&[a, b, c]| [a, c, b]).collect();
        let points: Vec<[f64; 3]> = (0..ball.positions.len()).map(|i| ball.point(i).coords.into()).collect();
        let bowl = mesh(&points, triangles);
        let open = 1.0 - 0.5 * (1.0 + cut);
        let seen = bowl.ambient_occlusion();
        for i in (0..seen.len()).filter(|&i| bowl.point(i).z < cut - 0.1) {
            assert!((f64::from(seen[i]) - open).abs() < 0.08, "{} instead of {open} at {}", seen[i], bowl.point(i));
        }
        let (sum, count) = (0..seen.len())
            .filter(|&i| bowl.point(i).z < cut - 0.1)
            .fold((0.0, 0.0), |(s, n), i| (s + f64::from(seen[i]), n + 1.0));
        assert!((sum / count - open).abs() < 0.02, "{} on average instead of {open}", sum / count);
    }
}

#[test]
fn a_floor_under_a_square_roof() {
    // The floor's middle under a parallel square of half side a at height h: the roof hides 4/π a/√(a²+h²) atan(a/√(a²+h²))
    // of the sky (Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-4).
    let (a, h) = (0.5, 0.4);
    let floor = graph(40, 1.0, |_, _| 0.0);
    let roof = graph(40, a, |_, _| h);
    let points: Vec<[f64; 3]> =
        [&floor, &roof].into_iter().flat_map(|m| (0..m.positions.len()).map(|i| m.point(i).coords.into())).collect();
    let offset = floor.positions.len() as u32;
    let above = roof.triangles.iter().map(|t| t.map(|i| i + offset));
    let both = mesh(&points, floor.triangles.iter().copied().chain(above).collect());
    let slant = a / f64::hypot(a, h);
    let hidden = 4.0 / std::f64::consts::PI * slant * slant.atan();
    let seen = f64::from(both.ambient_occlusion()[20 * 41 + 20]);
    assert!((seen - (1.0 - hidden)).abs() < 0.03, "{seen} instead of {}", 1.0 - hidden);
}

#[test]
fn occlusion_does_not_depend_on_threads() {
    let with = |threads| {
        let wavy = graph(60, 1.0, |x, y| 0.2 * (9.0 * x).sin() * (7.0 * y).cos());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| {
            (wavy.ambient_occlusion().to_vec(), texreg_surface::area_weighted_normals(&wavy.positions, &wavy.triangles))
        })
    };
    assert_eq!(with(1), with(5));
}

#[test]
fn degenerate_triangles_count_for_nothing() {
    // A square with a triangle without area, one of no more than a line, a sliver, and a vertex of its own.
    let points = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.5, 0.0, 0.0],
        [0.5, 1e-9, 3e-9],
        [7.0, 7.0, 7.0],
    ];
    let broken = mesh(&points, vec![[0, 1, 2], [0, 2, 3], [1, 1, 2], [0, 4, 1], [0, 5, 1]]);
    for i in 0..4 {
        assert!(broken.normals[i][2] > 0.999);
    }
    assert_eq!(broken.normals[6], [0.0, 0.0, 1.0]);
    let lengths = broken.normals.iter().map(|n| Vector3::from(*n).norm());
    assert!(lengths.into_iter().all(|l| (l - 1.0).abs() < 1e-5));
    assert!(broken.mean_curvature().iter().all(|h| h.is_finite()));
    assert!(broken.ambient_occlusion().iter().all(|a| (0.0..=1.0).contains(a)));
    // Nothing but points in one place: no direction, no extent.
    let nothing = mesh(&[[5.0; 3]; 3], vec![[0, 1, 2]]);
    assert_eq!(nothing.mean_curvature(), [0.0; 3]);
    assert_eq!(nothing.ambient_occlusion(), [1.0; 3]);
    assert_eq!((nothing.point(0).x, nothing.diagonal()), (5.0, 0.0));
    assert_eq!(nothing.simplified(1).triangles, nothing.triangles);
}

#[test]
fn tiny_and_huge_models_have_normals() {
    for size in [1e-18, 1e18] {
        let tilted = mesh(&[[0.0; 3], [size, 0.0, size], [0.0, size, 0.0]], vec![[0, 1, 2]]);
        for n in &tilted.normals {
            assert!((n[0] + 0.5f32.sqrt()).abs() < 1e-6 && (n[2] - 0.5f32.sqrt()).abs() < 1e-6, "{n:?}");
        }
    }
}

#[test]
fn soups_and_seams_are_smooth() {
    let ball = sphere(3, 1.0, [0.0; 3]);
    let loose = soup(&ball);
    let smooth = |mesh: &Mesh| {
        (0..mesh.positions.len())
            .all(|i| mesh.point(i).coords.dot(&Vector3::from(mesh.normals[i].map(f64::from))) > 0.999)
    };
    assert!(smooth(&loose));
    assert_eq!(
        weld(&loose.positions).iter().enumerate().filter(|&(i, &first)| i == first as usize).count(),
        ball.positions.len()
    );
    assert_eq!(weld(&[[0.0, 1.0, -0.0], [-0.0, 1.0, 0.0], [0.0, 1.0, 1.0]]), [0, 0, 2]);
    // Two halves of a sphere that meet at a seam: few duplicates, so they are welded on demand only.
    let half = |keep: bool| ball.triangles.iter().copied().filter(move |t| (t[0] % 2 == 0) == keep);
    let points: Vec<[f64; 3]> = (0..ball.positions.len()).map(|i| ball.point(i).coords.into()).collect();
    let shift = points.len() as u32;
    let triangles = half(true).chain(half(false).map(|t| t.map(|i| i + shift))).collect();
    let attributes = Attributes { normals: Some(vec![[1.0, 0.0, 0.0]; 2 * points.len()]), ..Attributes::default() };
    let mut seamed = Mesh::new(&[&points[..], &points[..]].concat(), triangles, attributes).expect("a valid mesh");
    assert!(!smooth(&seamed));
    seamed.weld_normals();
    assert!(smooth(&seamed));
}
