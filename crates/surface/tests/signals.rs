//! Laws of the signals: bins cover their range and nothing else, joint signals are products, directions mirror.
mod shapes;

use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;
use shapes::{graph, mesh, sphere};
use texreg_surface::{
    Attributes, Colours, Components, Frame, Headlight, Mesh, Normals, Ranked, Signal, SignalName, Specular, Surfel,
    Viewpoint, joint_signal, load,
};

/// A viewpoint turned somehow, `distance` before the mesh's origin.
fn viewpoint(distance: f64) -> Viewpoint {
    let rotation = Rotation3::from_euler_angles(0.3, -1.1, 2.0);
    Viewpoint::new(rotation.matrix(), &Vector3::new(0.0, 0.0, distance))
}

/// Every vertex of the mesh as a surfel, and every triangle's middle.
fn surfels<'a>(mesh: &'a Mesh, viewpoint: &'a Viewpoint) -> impl Iterator<Item = Surfel<'a>> {
    mesh.triangles.iter().flat_map(move |&corners| {
        let weights = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0 / 3.0; 3]];
        weights.map(|weights| Surfel { mesh, corners, weights, viewpoint })
    })
}

/// How many surfels fall into each bin.
fn counts(signal: &dyn Signal, mesh: &Mesh, viewpoint: &Viewpoint) -> Vec<usize> {
    let mut counts = vec![0; signal.bins()];
    for point in surfels(mesh, viewpoint) {
        counts[signal.bin(&point)] += 1;
    }
    counts
}

/// A ball with everything a scanner can measure.
fn painted_ball(levels: usize) -> Mesh {
    let plain = sphere(levels, 1.0, [0.0; 3]);
    let points: Vec<[f64; 3]> = (0..plain.positions.len()).map(|i| plain.point(i).coords.into()).collect();
    let attributes = Attributes {
        reflectance: Some(points.iter().map(|p| (40.0 * p[0]).sin() as f32).collect()),
        colours: Some(points.iter().map(|p| p.map(|x| (127.0 + 127.0 * x) as u8)).collect()),
        ..Attributes::default()
    };
    Mesh::new(&points, plain.triangles, attributes).expect("a valid mesh")
}

#[test]
fn names_are_read_as_they_are_written() {
    for name in SignalName::ALL {
        assert_eq!(name.to_string().parse(), Ok(*name));
    }
    assert!("glow".parse::<SignalName>().is_err_and(|e| e.contains("'glow'") && e.contains("ambient-occlusion")));
}

#[test]
fn every_bin_is_in_range_and_most_are_used() {
    let (ball, seen) = (painted_ball(4), viewpoint(4.0));
    for &name in SignalName::ALL {
        let signal = joint_signal(&ball, &[name]).unwrap();
        let used = counts(&*signal, &ball, &seen).iter().filter(|&&count| count > 0).count();
        // The corners of the square around a disc of normals stay empty, and a ball bends and shades all over alike.
        let expected = match name {
            SignalName::Normals => 0.75,
            // Nor does it fill its box.
            SignalName::Depth => 0.7,
            SignalName::AmbientOcclusion | SignalName::Curvature => 0.0,
            _ => 0.99,
        };
        assert!(used as f64 >= expected * signal.bins() as f64, "{name}: {used} of {}", signal.bins());
        for point in surfels(&ball, &seen) {
            assert!(signal.colour(&point).iter().all(|c| (0.0..=1.0).contains(c)), "{name}");
        }
    }
}

#[test]
fn cells_of_the_sphere_are_of_about_the_same_size() {
    let ball = sphere(6, 1.0, [0.0; 3]);
    for steps in [3, 6, 14] {
        let signal = Normals { components: Components::Three, frame: Frame::Model, steps };
        let counts = counts(&signal, &ball, &viewpoint(4.0));
        let mean = counts.iter().sum::<usize>() as f64 / counts.len() as f64;
        for count in counts {
            assert!((0.3..2.2).contains(&(count as f64 / mean)), "{count} of {mean} for {steps}");
        }
    }
}

#[test]
fn the_frame_decides_what_turns_with_the_camera() {
    let ball = sphere(3, 1.0, [0.0; 3]);
    let (a, b) = (viewpoint(4.0), Viewpoint::new(&Matrix3::identity(), &Vector3::new(0.0, 0.0, 4.0)));
    let bins = |signal: &Normals, viewpoint: &Viewpoint| -> Vec<usize> {
        surfels(&ball, viewpoint).map(|point| signal.bin(&point)).collect()
    };
    let model = Normals { components: Components::Three, frame: Frame::Model, steps: 8 };
    let camera = Normals { frame: Frame::Camera, ..model };
    assert_eq!(bins(&model, &a), bins(&model, &b));
    assert_ne!(bins(&camera, &a), bins(&camera, &b));
    // Seen along the model's own axes the two are one.
    assert_eq!(bins(&camera, &b), bins(&model, &b));
}

#[test]
fn a_joint_signal_is_the_product() {
    let (ball, seen) = (painted_ball(4), viewpoint(3.0));
    let normals = Normals { components: Components::Two, frame: Frame::Camera, steps: 6 };
    let reflectance = Ranked::reflectance(&ball, 5).unwrap();
    let joint = joint_signal(&ball, &[SignalName::Reflectance, SignalName::Normals]).unwrap();
    assert_eq!(joint.bins(), 5 * 36);
    for point in surfels(&ball, &seen) {
        assert_eq!(joint.bin(&point), reflectance.bin(&point) * 36 + normals.bin(&point));
    }
}

#[test]
fn joint_signals_stay_small() {
    let ball = painted_ball(2);
    for &a in SignalName::ALL {
        for &b in SignalName::ALL {
            for &c in SignalName::ALL {
                // At most half of the sphere's cells are seen at a time.
                let whole = [SignalName::Normals3, SignalName::ModelNormals, SignalName::Specular];
                let halves = whole.iter().filter(|name| [a, b, c].contains(name)).count();
                let bins = joint_signal(&ball, &[a, b, c]).unwrap().bins() >> halves;
                assert!(bins <= 225, "{a}, {b}, {c}: {bins}");
            }
            let once = joint_signal(&ball, &[a, b]).unwrap().bins();
            assert_eq!(once, joint_signal(&ball, &[a, b, a]).unwrap().bins(), "{a}, {b}");
        }
    }
}

#[test]
fn what_a_model_does_not_carry_is_named() {
    let plain = sphere(1, 1.0, [0.0; 3]);
    for name in [SignalName::Reflectance, SignalName::Colours] {
        assert!(!name.is_in(&plain));
        let error = joint_signal(&plain, &[SignalName::Normals, name]).err().unwrap();
        assert_eq!(error.to_string(), format!("the model has no {name}; leave out the signal '{name}'"));
    }
}

#[test]
fn ranks_are_of_about_equal_frequency() {
    let ball = painted_ball(4);
    for signal in [Ranked::reflectance(&ball, 8).unwrap(), Ranked::reflectance(&ball, 3).unwrap()] {
        let mut counts = vec![0usize; signal.bins()];
        for i in 0..ball.positions.len() as u32 {
            let viewpoint = viewpoint(3.0);
            counts[signal.bin(&Surfel {
                mesh: &ball,
                corners: [i; 3],
                weights: [1.0, 0.0, 0.0],
                viewpoint: &viewpoint,
            })] += 1;
        }
        let share = ball.positions.len() / counts.len();
        assert!(counts.iter().all(|count| count.abs_diff(share) <= share / 8), "{counts:?}");
    }
}

#[test]
fn a_palette_tells_colours_apart() {
    // Four patches of a square, each of one colour; twice as many bins are of no use.
    let flat = graph(10, 1.0, |_, _| 0.0);
    let points: Vec<[f64; 3]> = (0..flat.positions.len()).map(|i| flat.point(i).coords.into()).collect();
    let paint = |p: &[f64; 3]| match (p[0] > 0.01, p[1] > 0.01) {
        (false, false) => [200, 40, 40],
        (true, false) => [40, 200, 40],
        (false, true) => [90, 90, 100],
        (true, true) => [90, 90, 90],
    };
    let colours: Vec<[u8; 3]> = points.iter().map(paint).collect();
    let attributes = Attributes { colours: Some(colours.clone()), ..Attributes::default() };
    let flat = Mesh::new(&points, flat.triangles, attributes).unwrap();
    let signal = Colours::new(&flat, 8).unwrap();
    assert_eq!(signal.bins(), 4);
    let viewpoint = viewpoint(3.0);
    let bin =
        |i: u32| signal.bin(&Surfel { mesh: &flat, corners: [i; 3], weights: [0.2, 0.3, 0.5], viewpoint: &viewpoint });
    for i in 0..colours.len() {
        for j in 0..colours.len() {
            assert_eq!(bin(i as u32) == bin(j as u32), colours[i] == colours[j]);
        }
    }
    assert_eq!(Colours::new(&mesh(&[[0.0; 3]; 3], vec![[0, 1, 2]]), 4).map(|c| c.bins()), None);
}

#[test]
fn a_sphere_is_white_from_inside_out() {
    // All of the inside of a closed surface is dark, all of the outside open.
    let ball = sphere(4, 1.0, [0.0; 3]);
    let points: Vec<[f64; 3]> = (0..ball.positions.len()).map(|i| ball.point(i).coords.into()).collect();
    let inside = mesh(&points, ball.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect());
    assert!(inside.ambient_occlusion().iter().all(|&seen| seen < 0.01));
    assert!(ball.ambient_occlusion().iter().all(|&seen| seen > 0.99));
}

#[test]
fn what_was_computed_comes_along_to_the_coarse_copy() {
    let bumpy = graph(120, 1.0, |x, y| 0.1 * (9.0 * x).sin() * (9.0 * y).cos());
    let (sky, bulge) = (bumpy.ambient_occlusion().to_vec(), bumpy.mean_curvature().to_vec());
    let coarse = bumpy.simplified(2_000);
    let within = |values: &[f32], of: &[f32]| {
        let range = |values: &[f32]| values.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        let ((l, h), (low, high)) = (range(values), range(of));
        l >= low && h <= high && h - l > 0.5 * (high - low)
    };
    assert!(within(coarse.ambient_occlusion(), &sky) && within(coarse.mean_curvature(), &bulge));
    // It is what it was made from, not what the coarse shape would have.
    let mean = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
    assert!((mean(coarse.ambient_occlusion()) - mean(&sky)).abs() < 0.02);
}

#[test]
fn a_written_mesh_is_read_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ply");
    let save = |mesh: &Mesh| {
        let mut bytes = Vec::new();
        mesh.write_ply(&mut bytes).unwrap();
        std::fs::write(&path, bytes).unwrap();
        load(&path).unwrap()
    };
    // With all attributes near the world's zero, and at survey coordinates with a millimetre's detail.
    let ball = painted_ball(3);
    assert_eq!(save(&ball), ball);
    let _computed = (ball.ambient_occlusion(), ball.mean_curvature());
    assert_ne!(painted_ball(3), ball, "what was computed is part of the mesh");
    assert_eq!(save(&ball), ball);
    let far = sphere(3, 2.0, [4.5e6, 5.1e5, 120.001]);
    assert_ne!(far.origin, Vector3::zeros());
    assert_eq!(save(&far), far);
}

proptest! {
    /// A surface seen at any angle mirrors the direction that the law of reflection says.
    #[test]
    fn reflection_obeys_its_law(tilt in -1.2..1.2f64, turn in -3.0..3.0f64) {
        // A triangle whose normal leans by `tilt` from the camera's direction, straight ahead.
        let normal = Vector3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), -tilt.cos());
        let rotation = Rotation3::rotation_between(&Vector3::z(), &normal).unwrap();
        let corners = [[0.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]].map(|p| (rotation * Vector3::from(p)).into());
        let leaf = mesh(&corners, vec![[0, 1, 2]]);
        let viewpoint = Viewpoint::new(&Matrix3::identity(), &(leaf.origin + Vector3::new(0.0, 0.0, 10.0)));
        // The middle of the sides: the world's origin, up to a shift along the surface.
        let weights = [0.5, 0.25, 0.25];
        let point = Surfel { mesh: &leaf, corners: [0, 1, 2], weights, viewpoint: &viewpoint };
        let expected = 2.0 * normal * -normal.z - Vector3::new(0.0, 0.0, -1.0);
        // A colour is the direction: x, −y and −z over −1..=1.
        let colour = Specular { steps: 9 }.colour(&point).map(|c| 2.0 * f64::from(c) - 1.0);
        let mirrored = Vector3::new(colour[0], -colour[1], -colour[2]);
        prop_assert!((mirrored - expected).norm() < 1e-3, "{mirrored} instead of {expected}");
        let steps = 1000;
        let cosine = Headlight { steps }.bin(&point) as f64 / steps as f64;
        prop_assert!((cosine - tilt.cos()).abs() < 2.0 / steps as f64, "{cosine} instead of {}", tilt.cos());
    }
}
