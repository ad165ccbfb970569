//! Level of detail: the coarse mesh has about the triangles asked for and looks like the fine one.
mod shapes;

use nalgebra::Vector3;
use shapes::{graph, sphere};
use texreg_surface::{Attributes, Mesh};

#[test]
fn a_sphere_stays_round() {
    let fine = sphere(6, 2.0, [1e6, -2e6, 300.0]);
    for target in [20_000, 5_000, 1_000] {
        let coarse = fine.simplified(target);
        let share = coarse.triangles.len() as f64 / target as f64;
        assert!((0.66..1.34).contains(&share), "{} triangles instead of {target}", coarse.triangles.len());
        // A triangle of side s cuts at most s²/6R off a sphere of radius R.
        let side2 = 16.0 * std::f64::consts::PI / target as f64 * 4.0 / 3f64.sqrt();
        let radius = |i: usize| (coarse.point(i) - Vector3::new(1e6, -2e6, 300.0)).coords.norm();
        let radii: Vec<f64> = (0..coarse.positions.len()).map(radius).collect();
        let mean = radii.iter().sum::<f64>() / radii.len() as f64;
        assert!((mean - 2.0).abs() < side2 / 12.0, "mean radius {mean} with {target} triangles");
        for (i, normal) in coarse.normals.iter().enumerate() {
            let outward = (coarse.point(i).coords - Vector3::new(1e6, -2e6, 300.0)) / radii[i];
            assert!(outward.dot(&Vector3::from(normal.map(f64::from))) > 0.98);
        }
    }
}

#[test]
fn a_plane_stays_flat_and_keeps_its_means() {
    let fine = graph(200, 1.0, |x, y| 0.5 * x + y);
    let points: Vec<[f64; 3]> = (0..fine.positions.len()).map(|i| fine.point(i).coords.into()).collect();
    let attributes = Attributes {
        reflectance: Some(points.iter().map(|p| p[0] as f32).collect()),
        colours: Some(points.iter().map(|p| [(100.0 + 100.0 * p[1]) as u8, 7, 255]).collect()),
        ..Attributes::default()
    };
    let fine = Mesh::new(&points, fine.triangles.clone(), attributes).expect("a plane");
    let coarse = fine.simplified(2_000);
    let (low, high) = coarse.bounds();
    assert!(low.x < -0.94 && low.y < -0.94 && high.x > 0.94 && high.y > 0.94);
    let (reflectance, colours) =
        (coarse.reflectance.as_ref().expect("reflectance"), coarse.colours.as_ref().expect("colours"));
    for i in 0..coarse.positions.len() {
        let p = coarse.point(i);
        assert!((p.z - 0.5 * p.x - p.y).abs() < 1e-5);
        assert!((f64::from(reflectance[i]) - p.x).abs() < 0.02);
        assert!((f64::from(colours[i][0]) - 100.0 - 100.0 * p.y).abs() < 3.0);
        assert_eq!(colours[i][1..], [7, 255]);
    }
}

#[test]
fn a_mesh_that_is_coarse_enough_is_left_alone() {
    let ball = sphere(2, 1.0, [0.0; 3]);
    assert_eq!(ball.simplified(ball.triangles.len()), ball);
    assert_eq!(ball.simplified(0), ball);
    assert!(!ball.simplified(1).triangles.is_empty());
}

#[test]
fn far_outliers_do_not_swallow_the_model() {
    let ball = sphere(5, 1.0, [0.0; 3]);
    let mut points: Vec<[f64; 3]> = (0..ball.positions.len()).map(|i| ball.point(i).coords.into()).collect();
    points.push([1e4, 0.0, 0.0]);
    let outlying = Mesh::new(&points, ball.triangles.clone(), Attributes::default()).expect("a ball and a point");
    let coarse = outlying.simplified(2_000);
    assert!((1_300..2_700).contains(&coarse.triangles.len()), "{}", coarse.triangles.len());
}
