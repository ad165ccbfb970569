//! What meshes do to a rasterizer: shared edges, slivers, doubles, cameras inside, coordinates far away.

mod common;

use common::{Scene, camera, distorting_camera, judge, pose};
use nalgebra::{Point2, Point3, Rotation3, Vector3};
use rand::{Rng, SeedableRng, rngs::StdRng, seq::SliceRandom};
use texreg_camera::Camera;
use texreg_lie::Pose;
use texreg_raster::{GBuffer, Meshlets, NO_FACE, Options, Renderer, Triangles, render};

fn seen(scene: &Scene, camera: &Camera, pose: &Pose) -> GBuffer {
    render(&scene.triangles(), camera, pose, &Options::default())
}

/// A wall of n × n quads at z = 0, much larger than the picture, its inner vertices displaced at random.
fn wall(n: u32, seed: u64) -> Scene {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut scene = Scene::default();
    let step = 8.0 / n as f32;
    for y in 0..=n {
        for x in 0..=n {
            let inner = x > 0 && x < n && y > 0 && y < n;
            let mut shift = || if inner { rng.random_range(-0.4..0.4) * step } else { 0.0 };
            scene.positions.push([x as f32 * step - 4.0 + shift(), y as f32 * step - 4.0 + shift(), shift()]);
        }
    }
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            let [b, c, d] = [a + 1, a + n + 2, a + n + 1];
            scene.indices.extend(if rng.random_bool(0.5) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] });
        }
    }
    scene
}

#[test]
fn no_cracks() {
    // Triangles of all sizes, from far below a pixel to much larger than the picture, straight and through a lens, some
    // behind the camera.
    let ahead = |x, y, z| Pose::new(Rotation3::identity(), Vector3::new(x, y, z));
    let close = Pose::new(Rotation3::new(Vector3::new(1.1, 0.0, 0.0)), Vector3::new(0.0, 0.1, 0.3));
    for n in [1, 4, 16, 30, 200] {
        let scene = wall(n, u64::from(n));
        for camera in [camera(160, 120), distorting_camera(160, 120)] {
            for pose in [ahead(0.0, 0.0, 2.0), ahead(0.31, 0.17, 1.3)] {
                assert_eq!(seen(&scene, &camera, &pose).covered(), 160 * 120, "{n} quads a side");
            }
            // The wall's plane passes behind the camera: everything below its horizon is covered.
            let picture = seen(&scene, &camera, &close);
            for x in 0..160 {
                let column: Vec<bool> = (0..120).map(|y| picture.face[y * 160 + x] != NO_FACE).collect();
                let changes = column.windows(2).filter(|pair| pair[0] != pair[1]).count();
                assert!(changes <= 1, "{n} quads a side: column {x} is seen through");
            }
        }
    }
}

#[test]
fn shared_edges_are_drawn_once() {
    // Vertices on pixel centres, where the fill rule decides everything. Each triangle is drawn alone: together they must
    // cover each centre of the square exactly once. In the second picture large triangles share edges with small ones.
    let mut rng = StdRng::seed_from_u64(5);
    for size in [41, 141] {
        let (middle, end) = (size / 2, size - 6);
        let camera = Camera::ideal(size as u32, size as u32, f64::from(middle));
        let pose = Pose::new(Rotation3::identity(), Vector3::new(0.0, 0.0, 1.0));
        let vertex = |x: i32, y: i32| [(x - middle) as f32 / middle as f32, (y - middle) as f32 / middle as f32, 0.0];
        for _ in 0..40 {
            let (x, y) = (rng.random_range(6..end), rng.random_range(6..end));
            let positions = vec![vertex(5, 5), vertex(end, 5), vertex(end, end), vertex(5, end), vertex(x, y)];
            let mut times = vec![0; (size * size) as usize];
            for k in 0..4 {
                let corners = [k, (k + 1) % 4, 4];
                let turned = [corners[1], corners[0], 4];
                for indices in [corners, turned] {
                    let scene = Scene { positions: positions.clone(), indices: vec![indices] };
                    for (count, face) in times.iter_mut().zip(seen(&scene, &camera, &pose).face) {
                        *count += usize::from(face != NO_FACE);
                    }
                }
            }
            for (index, count) in (0..).zip(times) {
                // The square's own left and top edges belong to it, right and bottom do not.
                let inside = (5..end).contains(&(index % size)) && (5..end).contains(&(index / size));
                assert_eq!(count, if inside { 2 } else { 0 }, "pixel {index} of {size}², inner vertex ({x}, {y})");
            }
        }
    }
}

#[test]
fn slivers_and_nothings() {
    let mut scene = Scene::soup(150, 0.4, 11);
    let mut rng = StdRng::seed_from_u64(12);
    for triangle in scene.indices.clone() {
        let [a, b, c] = triangle.map(|i| scene.positions[i as usize]);
        let at = scene.positions.len() as u32;
        // A sliver along the side ab, a point, and a line with a doubled vertex.
        let t = rng.random_range(0.0..1.0_f32);
        scene.positions.push(std::array::from_fn(|k| a[k] + t * (b[k] - a[k]) + 1e-4 * (c[k] - a[k])));
        scene.positions.push(a);
        scene.indices.extend([[triangle[0], triangle[1], at], [triangle[0]; 3], [triangle[0], triangle[1], at + 1]]);
    }
    let (camera, pose) = (camera(120, 90), pose(4.0));
    judge(&scene, &camera, &pose, &seen(&scene, &camera, &pose), 1.0 / 4096.0);
}

#[test]
fn bad_data_is_left_out() {
    let good = Scene::soup(50, 0.5, 21);
    let (camera, pose) = (camera(80, 60), pose(4.0));
    let expected = seen(&good, &camera, &pose);
    let mut bad = good.clone();
    let first = bad.positions.len() as u32;
    bad.positions.extend([[f32::NAN, 0.0, 0.0], [f32::INFINITY, 0.0, 0.0], [0.0, -1.0, f32::NEG_INFINITY]]);
    bad.indices.extend([[0, 1, first], [first + 1, 0, 2], [2, first + 2, 1], [0, 1, u32::MAX], [first + 3, 0, 1]]);
    assert_eq!(seen(&bad, &camera, &pose), expected);
    let nothing = GBuffer {
        width: 80,
        height: 60,
        depth: vec![f32::INFINITY; 4800],
        face: vec![NO_FACE; 4800],
        barycentric: Vec::new(),
    };
    assert_eq!(seen(&Scene::default(), &camera, &pose), nothing);
    let no_vertices = Scene { positions: Vec::new(), indices: vec![[0, 1, 2]] };
    assert_eq!(seen(&no_vertices, &camera, &pose), nothing);
    let broken = Pose::new(Rotation3::identity(), Vector3::new(f64::NAN, 0.0, 1.0));
    assert_eq!(seen(&good, &camera, &broken), nothing);
    let empty = Camera { width: 0, ..camera };
    assert!(seen(&good, &empty, &pose).depth.is_empty());
}

#[test]
fn doubles_show_the_lower_face() {
    let mut scene = Scene::bumpy_sphere(20);
    let (camera, pose) = (camera(120, 90), pose(3.0));
    let once = seen(&scene, &camera, &pose);
    let (vertices, faces) = (scene.positions.len() as u32, scene.indices.len());
    scene.positions.extend(scene.positions.clone());
    for k in 0..faces {
        scene.indices.push(scene.indices[k].map(|i| i + vertices));
    }
    assert_eq!(seen(&scene, &camera, &pose), once);
}

#[test]
fn inside_a_closed_surface_everything_is_covered() {
    let scene = Scene::bumpy_sphere(30);
    let here = Pose::new(Rotation3::new(Vector3::new(0.4, 1.0, -0.3)), Vector3::new(0.1, -0.2, 0.15));
    for camera in [camera(120, 90), distorting_camera(120, 90)] {
        let picture = seen(&scene, &camera, &here);
        assert_eq!(picture.covered(), 120 * 90);
        judge(&scene, &camera, &here, &picture, 1.0 / 20.0);
        let culled = Options { cull_back_faces: true, ..Options::default() };
        assert_eq!(render(&scene.triangles(), &camera, &here, &culled).covered(), 0);
    }
}

#[test]
fn the_near_plane_cuts() {
    let scene = Scene::bumpy_sphere(30);
    let (camera, pose) = (camera(120, 90), pose(3.0));
    let cut = Options { near: 3.0, ..Options::default() };
    let picture = render(&scene.triangles(), &camera, &pose, &cut);
    assert!(picture.covered() > 2000);
    assert!(picture.depth.iter().all(|&z| z >= 3.0 * (1.0 - 1e-6)));
    let whole = seen(&scene, &camera, &pose);
    for (cut, whole) in picture.depth.iter().zip(&whole.depth).filter(|(_, whole)| **whole > 3.01) {
        assert_eq!(cut, whole);
    }
}

#[test]
fn survey_coordinates_keep_millimetres() {
    // Steps of a millimetre on a wall at 1e6 metres: the mesh keeps them relative to an origin, the pose takes that in.
    let origin = Vector3::new(4.5e5, 5.2e6, 310.0);
    let mut scene = Scene::default();
    for k in 0..10_u32 {
        let (left, z) = (0.1 * k as f32 - 0.5, 0.001 * k as f32);
        for (x, y) in [(left, -0.5), (left + 0.1, -0.5), (left + 0.1, 0.5), (left, 0.5)] {
            scene.positions.push([x, y, z]);
        }
        scene.indices.extend([[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]);
    }
    let rotation = Rotation3::identity();
    let camera_from_world = Pose::new(rotation, -(rotation * (origin - Vector3::new(0.0, 0.0, 2.0))));
    let camera_from_mesh = camera_from_world * Pose::new(Rotation3::identity(), origin);
    let camera = Camera::ideal(200, 200, 300.0);
    let picture = seen(&scene, &camera, &camera_from_mesh);
    for k in 0..10 {
        let (x, z) = (0.1 * f64::from(k) - 0.45, 0.001 * f64::from(k));
        let world = Point3::from(origin + Vector3::new(x, 0.0, z));
        let pixel: Point2<f64> =
            camera.project(&(camera_from_world * Pose::identity()).transform_point(&world)).unwrap();
        let index = pixel.y.round() as usize * 200 + pixel.x.round() as usize;
        assert_eq!(picture.face[index] / 2, k as u32);
        assert!((f64::from(picture.depth[index]) - 2.0 - z).abs() < 1e-6);
    }
}

#[test]
fn the_same_picture_on_any_number_of_threads() {
    // Large enough to be spread; triangles of all sizes, with and without a lens.
    let mut scene = Scene::bumpy_sphere(150);
    let soup = Scene::soup(300, 2.0, 31);
    let first = scene.positions.len() as u32;
    scene.positions.extend(&soup.positions);
    scene.indices.extend(soup.indices.iter().map(|t| t.map(|i| i + first)));
    let options = Options { barycentric: true, ..Options::default() };
    for camera in [camera(421, 307), distorting_camera(421, 307)] {
        let single = Options { parallel: false, ..options };
        let expected = render(&scene.triangles(), &camera, &pose(2.5), &single);
        for threads in [1, 2, 3, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let picture = pool.install(|| render(&scene.triangles(), &camera, &pose(2.5), &options));
            assert_eq!(picture, expected, "{threads} threads");
        }
    }
}

#[test]
fn a_renderer_forgets() {
    let mut renderer = Renderer::new();
    let mut picture = GBuffer::default();
    let scenes = [Scene::bumpy_sphere(60), Scene::soup(40, 1.0, 41), Scene::default(), Scene::bumpy_sphere(9)];
    for (scene, size) in scenes.iter().zip([(300, 200), (64, 64), (31, 17), (400, 300)]) {
        for camera in [camera(size.0, size.1), distorting_camera(size.0, size.1)] {
            let options = Options { barycentric: size.0 > 64, ..Options::default() };
            renderer.render(&scene.triangles(), &camera, &pose(3.0), &options, &mut picture);
            assert_eq!(picture, render(&scene.triangles(), &camera, &pose(3.0), &options));
        }
    }
}

#[test]
fn a_region_is_part_of_the_whole() {
    let scene = Scene::bumpy_sphere(40);
    for whole in [camera(160, 120), distorting_camera(160, 120)] {
        let mut part = Camera { width: 50, height: 40, ..whole };
        part.intrinsics.cx -= 60.0;
        part.intrinsics.cy -= 30.0;
        let (whole, part) = (seen(&scene, &whole, &pose(3.0)), seen(&scene, &part, &pose(3.0)));
        let other = (0..50 * 40).filter(|k| part.face[*k] != whole.face[(k / 50 + 30) * 160 + k % 50 + 60]).count();
        // A lens is followed as closely as the image it is asked for allows.
        assert!(other <= 4, "{other} pixels differ");
    }
}

#[test]
fn narrow_pictures() {
    let scene = Scene::bumpy_sphere(16);
    for (width, height) in [(1, 1), (3, 50), (7, 7), (50, 2), (9, 9)] {
        let camera = Camera::ideal(width, height, 20.0);
        let picture = seen(&scene, &camera, &pose(3.0));
        judge(&scene, &camera, &pose(3.0), &picture, 1.0 / 4096.0);
        assert!(picture.covered() > 0);
    }
}

/// Two shells in one another with large triangles all over: most of it is hidden.
fn shells() -> Scene {
    let mut scene = Scene::bumpy_sphere(60);
    let outer = scene.positions.len() as u32;
    scene.positions.extend(scene.positions.clone().into_iter().map(|p| p.map(|x| 0.8 * x)));
    scene.indices.extend(scene.indices.clone().into_iter().map(|t| t.map(|i| i + outer)));
    let soup = Scene::soup(100, 1.0, 51);
    let first = scene.positions.len() as u32;
    scene.positions.extend(&soup.positions);
    scene.indices.extend(soup.indices.iter().map(|t| t.map(|i| i + first)));
    scene
}

#[test]
fn what_is_left_out_is_hidden() {
    // Fifty triangles at a time hide nothing of one another that is not drawn; the nearest of all these pictures is the whole.
    let scene = shells();
    for camera in [camera(200, 150), distorting_camera(200, 150)] {
        let mut nearest: Vec<(f32, u32)> = vec![(f32::INFINITY, NO_FACE); 200 * 150];
        for (k, indices) in scene.indices.chunks(50).enumerate() {
            let part = Scene { positions: scene.positions.clone(), indices: indices.to_vec() };
            let picture = seen(&part, &camera, &pose(2.0));
            for (nearest, (&depth, &face)) in nearest.iter_mut().zip(picture.depth.iter().zip(&picture.face)) {
                if depth < nearest.0 {
                    *nearest = (depth, 50 * k as u32 + face);
                }
            }
        }
        let whole = seen(&scene, &camera, &pose(2.0));
        let whole: Vec<(f32, u32)> = whole.depth.into_iter().zip(whole.face).collect();
        assert!(whole == nearest);
    }
}

#[test]
fn the_order_of_triangles_does_not_matter() {
    let scene = shells();
    let mut rng = StdRng::seed_from_u64(61);
    let mut order: Vec<usize> = (0..scene.indices.len()).collect();
    order.shuffle(&mut rng);
    let mut shuffled = scene.clone();
    shuffled.indices = order.iter().map(|&face| scene.indices[face]).collect();
    let (camera, pose) = (camera(200, 150), pose(2.0));
    let expected = seen(&scene, &camera, &pose);
    let picture = seen(&shuffled, &camera, &pose);
    assert_eq!(picture.depth, expected.depth);
    let original = picture.face.iter().map(|&face| order.get(face as usize).map_or(NO_FACE, |&face| face as u32));
    // Doubled depths, on shared edges, show the lower face of each order.
    let other = original.zip(&expected.face).filter(|(face, expected)| face != *expected).count();
    assert!(other <= 3, "{other} pixels");
}

#[test]
fn meshlets_serve_many_renderings() {
    let scene = shells();
    let meshlets = Meshlets::new(&scene.triangles());
    let kept = Triangles { meshlets: Some(&meshlets), ..scene.triangles() };
    for distance in [0.3, 2.0, 6.0] {
        let picture = render(&kept, &camera(200, 150), &pose(distance), &Options::default());
        assert_eq!(picture, seen(&scene, &camera(200, 150), &pose(distance)));
    }
}
