//! Scenes, cameras and an exact ray caster to judge pictures by.
#![allow(dead_code, unreachable_pub)] // each test binary uses a part

use nalgebra::{Point2, Rotation3, Vector2, Vector3};
use rand::{Rng, SeedableRng, rngs::StdRng};
use texreg_camera::{Camera, Distortion};
use texreg_lie::Pose;
use texreg_raster::{GBuffer, NO_FACE, Triangles};

/// A mesh that owns its arrays.
#[derive(Clone, Default)]
pub struct Scene {
    pub positions: Vec<[f32; 3]>,
    pub indices: Vec<[u32; 3]>,
}

impl Scene {
    pub fn triangles(&self) -> Triangles<'_> {
        Triangles::new(&self.positions, &self.indices)
    }

    /// The corners of a face in the camera frame and its normal there, not of unit length.
    pub fn plane(&self, pose: &Pose, face: u32) -> ([Vector3<f64>; 3], Vector3<f64>) {
        let corners = self.indices[face as usize].map(|i| {
            let p = self.positions[i as usize].map(f64::from);
            pose.rotation * Vector3::from(p) + pose.translation
        });
        (corners, (corners[1] - corners[0]).cross(&(corners[2] - corners[0])))
    }

    /// Unconnected random triangles in front of the camera, some through its plane.
    pub fn soup(count: u32, size: f32, seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut scene = Self::default();
        for k in 0..count {
            let mut random = |scale: f32| [(); 3].map(|()| rng.random_range(-scale..scale));
            let centre = random(1.5);
            for _ in 0..3 {
                let offset = random(size);
                scene.positions.push(std::array::from_fn(|i| centre[i] + offset[i]));
            }
            scene.indices.push([3 * k, 3 * k + 1, 3 * k + 2]);
        }
        scene
    }

    /// A closed bumpy sphere of about unit radius, wound outwards: 4·n² triangles.
    pub fn bumpy_sphere(n: u32) -> Self {
        let mut scene = Self::default();
        let (rows, columns) = (n, 2 * n);
        let point = |row: u32, column: u32| {
            let theta = std::f64::consts::PI * f64::from(row) / f64::from(rows);
            let phi = std::f64::consts::TAU * f64::from(column % columns) / f64::from(columns);
            let r = 1.0 + 0.08 * (5.0 * theta).sin() * (4.0 * phi).sin() * theta.sin();
            [theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin()].map(|x| (r * x) as f32)
        };
        for row in 0..=rows {
            for column in 0..columns {
                scene.positions.push(point(row, column));
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let at = |r: u32, c: u32| r * columns + c % columns;
                let [a, b] = [at(row, column), at(row + 1, column)];
                let [c, d] = [at(row + 1, column + 1), at(row, column + 1)];
                scene.indices.extend([[a, b, c], [a, c, d]]);
            }
        }
        scene
    }
}

/// A camera with a little of everything but distortion.
pub fn camera(width: u32, height: u32) -> Camera {
    let mut camera = Camera::ideal(width, height, 0.9 * f64::from(width));
    camera.intrinsics.fy *= 1.05;
    camera.intrinsics.cx += 3.3;
    camera.intrinsics.cy -= 1.7;
    camera.intrinsics.skew = 2.5;
    camera
}

/// The same seen through a lens with strong barrel distortion and some of the rest.
pub fn distorting_camera(width: u32, height: u32) -> Camera {
    let distortion = Distortion { k1: -0.25, k2: 0.08, p1: 0.004, p2: -0.003, k3: -0.01 };
    Camera { distortion, ..camera(width, height) }
}

/// A general view from a distance.
pub fn pose(distance: f64) -> Pose {
    Pose::new(Rotation3::new(Vector3::new(0.3, -0.5, 0.2)), Vector3::new(0.02, -0.05, distance))
}

/// What an exact ray caster sees at image coordinates: camera z and face, nearest first, then the lower face.
pub fn cast(scene: &Scene, camera: &Camera, pose: &Pose, pixel: Point2<f64>) -> Option<(f64, u32)> {
    let ray = camera.unproject(&pixel)?;
    let mut nearest: Option<(f64, u32)> = None;
    for face in 0..scene.indices.len() as u32 {
        let (corners, normal) = scene.plane(pose, face);
        let depth = normal.dot(&corners[0]) / normal.dot(&ray);
        let inside = |k: usize| {
            let edge = corners[(k + 1) % 3] - corners[k];
            edge.cross(&(ray * depth - corners[k])).dot(&normal) >= 0.0
        };
        if depth > 0.0 && depth.is_finite() && (0..3).all(inside) && nearest.is_none_or(|(d, _)| depth < d) {
            nearest = Some((depth, face));
        }
    }
    nearest
}

/// Asserts that every pixel of a picture shows a face that an exact ray at most `tolerance` pixels from its centre sees, at
/// a depth within 1e-5 of those such rays find in that face's plane, and returns the number of pixels where the ray through
/// the centre itself sees another face.
pub fn judge(scene: &Scene, camera: &Camera, pose: &Pose, picture: &GBuffer, tolerance: f64) -> usize {
    let see = |pixel| cast(scene, camera, pose, pixel).unwrap_or((f64::INFINITY, NO_FACE));
    let mut moved = 0;
    for (index, (&depth, &face)) in picture.depth.iter().zip(&picture.face).enumerate() {
        let (x, y) = (index as u32 % picture.width, index as u32 / picture.width);
        let depth = f64::from(depth);
        let centre = Point2::new(f64::from(x), f64::from(y));
        let exact = see(centre);
        moved += usize::from(exact.1 != face);
        if face == exact.1 && (depth == exact.0 || (depth / exact.0 - 1.0).abs() < 1e-5) {
            continue;
        }
        let around = (0..32).map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 16.0).sin_cos();
            centre + Vector2::new(cos, sin) * if k < 16 { tolerance } else { 0.5 * tolerance }
        });
        let around: Vec<_> = around.collect();
        let seen = face == exact.1 || around.iter().any(|&pixel| see(pixel).1 == face);
        assert!(seen, "pixel ({x}, {y}): rendered face {face} at {depth}, but the ray sees {exact:?}");
        if face == NO_FACE {
            assert_eq!(depth, f64::INFINITY);
            continue;
        }
        let (corners, normal) = scene.plane(pose, face);
        let depths = around.iter().filter_map(|pixel| {
            Some(normal.dot(&corners[0]) / normal.dot(&camera.unproject(pixel)?)).filter(|&z| z > 0.0)
        });
        let (nearest, farthest) = depths.fold((f64::INFINITY, 0.0_f64), |(n, f), z| (n.min(z), f.max(z)));
        let good = depth >= nearest * (1.0 - 1e-5) && depth <= farthest * (1.0 + 1e-5);
        assert!(good, "pixel ({x}, {y}): face {face} at {depth}, not {exact:?} or {nearest} to {farthest}");
    }
    moved
}
