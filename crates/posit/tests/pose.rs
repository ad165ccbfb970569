//! The entry point: exact on exact data, robust on wrong data, honest on degenerate data.

use nalgebra::{Point2, Point3, Vector3, Vector6};
use proptest::prelude::*;
use texreg_camera::{Camera, Distortion, Intrinsics, View};
use texreg_lie::{Pose, se3, so3};
use texreg_posit::{Correspondence, NoSolution, Options, Refinement, pose, refine};

/// A camera four to ten units from a set of points in [−1, 1]³, shifted away from the origin.
#[derive(Clone, Debug)]
struct Scene {
    camera: Camera,
    pose: Pose,
    points: Vec<Point3<f64>>,
}

impl Scene {
    fn correspondences(&self) -> Option<Vec<Correspondence>> {
        self.points
            .iter()
            .map(|p| Some(Correspondence::new(*p, self.camera.project(&self.pose.transform_point(p))?)))
            .collect()
    }
}

prop_compose! {
    fn scene(least: usize, most: usize)(
        points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), least..=most),
        flat in any::<bool>(),
        omega in prop::array::uniform3(-3.0..3.0_f64),
        place in prop::array::uniform3(0.0..1.0_f64),
        world in prop::array::uniform6(-5.0..5.0_f64),
        f in 600.0..2000.0_f64,
        k in prop::array::uniform3(-0.1..0.1_f64),
    ) -> Scene {
        let depth = 4.0 + 6.0 * place[2];
        let local = Pose::new(so3::exp(&omega.into()), Vector3::new((place[0] - 0.5) * 0.3 * depth, (place[1] - 0.5) * 0.3 * depth, depth));
        let world = se3::exp(&(Vector6::from(world) * 0.5));
        let camera = Camera {
            width: 1024,
            height: 768,
            intrinsics: Intrinsics { fx: f, fy: 1.02 * f, cx: 500.0, cy: 390.0, skew: 1.5 },
            distortion: Distortion { k1: k[0], k2: k[1], p1: 1e-3 * k[2], p2: -2e-3 * k[2], k3: 0.0 },
        };
        let points = points.into_iter().map(|[x, y, z]| world.transform_point(&Point3::new(x, y, if flat { 0.0 } else { z })));
        Scene { camera, pose: local * world.inverse(), points: points.collect() }
    }
}

fn difference(a: &Pose, b: &Pose) -> f64 {
    (a.matrix() - b.matrix()).norm()
}

proptest! {
    /// Without noise the residuals vanish, whatever the number of points and whether they have depth.
    #[test]
    fn exact_data_are_fitted_exactly(scene in scene(4, 30)) {
        let Some(c) = scene.correspondences() else { return Ok(()) };
        let found = pose(&c, &scene.camera, &Options::default()).unwrap();
        prop_assert!(found.rms < 1e-8, "{found:?}");
        prop_assert!(found.rejected.is_empty());
    }

    /// Ten points have one pose.
    #[test]
    fn pose_is_recovered(scene in scene(10, 30)) {
        let Some(c) = scene.correspondences() else { return Ok(()) };
        let found = pose(&c, &scene.camera, &Options::default()).unwrap();
        prop_assert!(difference(&found.view.pose, &scene.pose) < 1e-7, "{:e}", difference(&found.view.pose, &scene.pose));
    }

    /// Wrong pixels are named, all of them and no others, and do no harm.
    #[test]
    fn outliers_are_named(scene in scene(12, 40), wrong in prop::collection::vec((0..40usize, 0.0..1024.0_f64, 0.0..768.0_f64), 1..4)) {
        let Some(mut c) = scene.correspondences() else { return Ok(()) };
        let mut bad = Vec::new();
        for (i, u, v) in wrong {
            let i = i % c.len();
            let pixel = Point2::new(u, v);
            if (pixel - c[i].pixel).norm() > 40.0 {
                c[i].pixel = pixel;
                bad.push(i);
            }
        }
        bad.sort_unstable();
        bad.dedup();
        let found = pose(&c, &scene.camera, &Options { threshold: Some(3.0), ..Options::default() }).unwrap();
        prop_assert_eq!(found.rejected, bad);
        prop_assert!(difference(&found.view.pose, &scene.pose) < 1e-6);
    }

    /// A focal length 20 % off is found with the pose, where the points have depth.
    #[test]
    fn focal_length_is_recovered(scene in scene(15, 30), factor in 0.85..1.2_f64) {
        let Some(c) = scene.correspondences() else { return Ok(()) };
        let flatness = scene.points.iter().map(|p| scene.pose.transform_point(p).z).fold((f64::MAX, f64::MIN), |(a, b), z| (a.min(z), b.max(z)));
        if flatness.1 - flatness.0 < 1.0 {
            return Ok(());
        }
        let mut camera = Camera { distortion: Distortion::default(), ..scene.camera };
        let c: Vec<_> = c.iter().map(|c| Correspondence::new(c.point, camera.project(&scene.pose.transform_point(&c.point)).unwrap())).collect();
        camera.intrinsics.fx *= factor;
        camera.intrinsics.fy *= factor;
        camera.intrinsics.skew *= factor;
        let found = pose(&c, &camera, &Options { focal: true, ..Options::default() }).unwrap();
        prop_assert!(found.rms < 1e-6, "{} {:?}", found.rms, found.view);
    }
}

fn some() -> (Vec<Correspondence>, Camera) {
    let camera = Camera::ideal(640, 480, 500.0);
    let points =
        [(-1.0, -1.0, 0.2), (1.0, -0.8, -0.3), (0.9, 1.0, 0.4), (-0.7, 0.8, -0.5), (0.1, 0.2, 0.6), (0.4, -0.3, -0.8)];
    let pose = Pose::new(so3::exp(&Vector3::new(0.3, -0.4, 0.2)), Vector3::new(0.1, -0.2, 6.0));
    let c = points.map(|(x, y, z)| {
        let point = Point3::new(x, y, z);
        Correspondence::new(point, camera.project(&pose.transform_point(&point)).unwrap())
    });
    (c.to_vec(), camera)
}

#[test]
fn degenerate_input_has_no_pose() {
    let (good, camera) = some();
    let change = |f: &dyn Fn(usize, Correspondence) -> Correspondence| -> Vec<Correspondence> {
        good.iter().enumerate().map(|(i, c)| f(i, *c)).collect()
    };
    let nan = Point3::new(f64::NAN, 0.0, 0.0);
    let cases = [
        (vec![], NoSolution::TooFew { usable: 0, needed: 4 }),
        (good[..3].to_vec(), NoSolution::TooFew { usable: 3, needed: 4 }),
        (change(&|i, c| Correspondence::new(Point3::new(1.0, 1.0, 2.0) * i as f64, c.pixel)), NoSolution::Collinear),
        (change(&|_, c| Correspondence::new(good[0].point, c.pixel)), NoSolution::Collinear),
        (change(&|_, c| Correspondence::new(c.point, good[0].pixel)), NoSolution::OnePixel),
        (change(&|i, c| Correspondence::new(if i < 3 { nan } else { c.point }, c.pixel)), NoSolution::NotFinite),
        (change(&|i, c| Correspondence::new(c.point, if i < 3 { nan.xy() } else { c.pixel })), NoSolution::NotFinite),
    ];
    for (correspondences, reason) in cases {
        assert_eq!(pose(&correspondences, &camera, &Options::default()), Err(reason), "{correspondences:?}");
    }
}

/// One bad number among enough good ones is an outlier with a name.
#[test]
fn unusable_points_are_rejected_by_name() {
    let (mut c, camera) = some();
    c[2].pixel.x = f64::NAN;
    let found = pose(&c, &camera, &Options::default()).unwrap();
    assert_eq!(found.rejected, [2]);
    assert!(found.rms < 1e-9);
}

/// Random pixels agree on nothing.
#[test]
fn noise_has_no_consensus() {
    let (c, camera) = some();
    let wrong: Vec<_> = c
        .iter()
        .enumerate()
        .map(|(i, c)| {
            Correspondence::new(c.point, Point2::new((i * 7919 % 640) as f64, (i * i * 104_729 % 480) as f64))
        })
        .collect();
    let options = Options { threshold: Some(0.01), ..Options::default() };
    assert_eq!(pose(&wrong, &camera, &options), Err(NoSolution::NoConsensus));
}

/// At survey coordinates the pose is as good as at the origin, to the rounding of the coordinates.
#[test]
fn survey_coordinates_keep_their_millimetres() {
    let (c, camera) = some();
    let here = pose(&c, &camera, &Options::default()).unwrap().view.pose;
    let offset = Vector3::new(500_000.0, 4_100_000.0, 300.0);
    let moved: Vec<_> = c.iter().map(|c| Correspondence::new(c.point + offset, c.pixel)).collect();
    let there = pose(&moved, &camera, &Options::default()).unwrap().view.pose;
    assert!((there.center() - offset - here.center()).norm() < 1e-6);
}

/// Of small, flat and noisy sets, with several minima, the least is found: refinement from the truth finds no lesser one.
#[test]
fn no_better_minimum_is_missed() {
    let camera = Camera::ideal(1024, 768, 1000.0);
    let mut state = 7u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    for round in 0..600 {
        let n = 4 + round % 9;
        let thickness = [0.0, 0.02, 1.0][round % 3];
        let omega = Vector3::new(uniform(), uniform(), uniform()) * 2.0;
        let truth = Pose::new(so3::exp(&omega), Vector3::new(uniform(), uniform(), 7.0 + 3.0 * uniform()));
        let correspondences: Vec<_> = (0..n)
            .map(|_| {
                let point = Point3::new(uniform(), uniform(), thickness * uniform());
                let pixel = camera.project(&truth.transform_point(&point)).unwrap();
                Correspondence::new(point, Point2::new(pixel.x + 3.0 * uniform(), pixel.y + 3.0 * uniform()))
            })
            .collect();
        let found = pose(&correspondences, &camera, &Options::default()).unwrap();
        let start = View { camera, pose: truth };
        let Ok(near) = refine(&correspondences, &start, &Refinement::default()) else { continue };
        let cost = found.rms * found.rms * n as f64;
        assert!(cost <= near.cost * (1.0 + 1e-6), "set {round}: {cost} and {}", near.cost);
    }
}
