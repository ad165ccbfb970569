//! What signals cost: ambient occlusion beside parry's rays, curvature, and the bins of samples.
//!
//! parry casts one ray from each vertex along each of as many directions, over all threads. It does so for a part of the vertices,
//! spread over the model, and its figure is scaled to all of them; building its tree is counted. What both find is compared with
//! the rays of ten times as many directions.

use super::{Arguments, Report, Row, raster};
use anyhow::{Context, Result};
use nalgebra::Vector3;
use parry3d::math::Vector;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;
use rayon::prelude::*;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;
use texreg::surface::{Attributes, Mesh, SignalName, Surfel, Viewpoint, joint_signal};

/// As many directions as the maps look along.
const DIRECTIONS: usize = 192;

/// Seconds that the occlusion of a million triangles may take.
const OCCLUSION: f64 = 5.0;

/// The samples of a rendering, and milliseconds their bins may take on one thread.
const SAMPLES: usize = 30_000;
const BINS: f64 = 2.0;

/// Measures the fixture's bust, and a bumpy sphere of a million triangles.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let bust = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/nefertiti/model.ply");
    let bust = texreg::surface::load(bust)?;
    let model = raster::Model::bumpy_sphere("1m", 500);
    let points: Vec<[f64; 3]> = model.positions.iter().map(|p| p.map(f64::from)).collect();
    let sphere = Mesh::new(&points, model.indices, Attributes::default())?;
    let vertices = if arguments.quick { 2_000 } else { 10_000 };
    let mut rows = Vec::new();
    for (name, mesh) in [("bust", &bust), ("bumpy sphere", &sphere)] {
        println!("{name}: {} triangles", mesh.triangles.len());
        occlusion(name, mesh, vertices, &mut rows)?;
    }
    let began = Instant::now();
    black_box(sphere.mean_curvature());
    rows.push(Row::alone("bumpy sphere: mean curvature", began.elapsed().as_secs_f64(), "s"));
    bins(&bust, &mut rows)?;
    Ok(Report::new("signals", rows))
}

/// Ambient occlusion by maps and by rays.
fn occlusion(name: &str, mesh: &Mesh, vertices: usize, rows: &mut Vec<Row>) -> Result<()> {
    let began = Instant::now();
    let maps = mesh.ambient_occlusion();
    let ours = began.elapsed().as_secs_f64();
    let began = Instant::now();
    let positions = mesh.positions.iter().map(|&p| Vector::from(p)).collect();
    let tree = TriMesh::new(positions, mesh.triangles.clone())?;
    let build = began.elapsed().as_secs_f64();
    let chosen: Vec<usize> = (0..mesh.positions.len()).step_by(mesh.positions.len().div_ceil(vertices)).collect();
    let reach = mesh.diagonal() as f32;
    let by_rays = |directions: usize| -> Vec<f32> {
        let sky: Vec<Vector3<f32>> = (0..directions).map(|i| direction(i, directions)).collect();
        chosen.par_iter().map(|&i| seen(&tree, mesh, i, &sky, reach)).collect()
    };
    let began = Instant::now();
    let rays = by_rays(DIRECTIONS);
    let part = mesh.positions.len() as f64 / chosen.len() as f64;
    let peer = build + part * began.elapsed().as_secs_f64();
    let row = Row::beside(format!("{name}: ambient occlusion"), ours, peer, "parry's rays", "s");
    rows.push(row.goal(1.0));
    if mesh.triangles.len() >= 900_000 {
        rows.push(Row::alone(format!("{name}: ambient occlusion, a million triangles"), ours, "s").goal(OCCLUSION));
    }
    let truth = by_rays(10 * DIRECTIONS);
    let error = |values: &mut dyn Iterator<Item = f32>| {
        let sum: f64 = values.zip(&truth).map(|(value, truth)| f64::from((value - truth).abs())).sum();
        sum / truth.len() as f64
    };
    let (maps, rays) = (error(&mut chosen.iter().map(|&i| maps[i])), error(&mut rays.iter().copied()));
    rows.push(Row::beside(format!("{name}: mean error of 0..1"), maps, rays, "parry's rays", ""));
    Ok(())
}

/// Directions spread evenly over the sphere (spherical Fibonacci points).
fn direction(i: usize, of: usize) -> Vector3<f32> {
    let z = 1.0 - 2.0 * (i as f64 + 0.5) / of as f64;
    let (sin, cos) = (2.399_963_229_728_653 * i as f64).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    Vector3::new(radius * cos, radius * sin, z).cast()
}

/// The share of the sky that a vertex sees, weighted by the cosine to its normal.
fn seen(tree: &TriMesh, mesh: &Mesh, vertex: usize, sky: &[Vector3<f32>], reach: f32) -> f32 {
    let normal = Vector3::from(mesh.normals[vertex]);
    // Off the surface, or every ray would meet the triangles that it starts from.
    let origin = Vector3::from(mesh.positions[vertex]) + normal * (1e-4 * reach);
    let above = sky.iter().map(|direction| (direction, direction.dot(&normal))).filter(|(_, cosine)| *cosine > 0.05);
    let (open, all) = above.fold((0.0, 0.0), |(open, all), (direction, cosine)| {
        let ray = Ray::new(Vector::from(<[f32; 3]>::from(origin)), Vector::from(<[f32; 3]>::from(*direction)));
        let blocked = tree.cast_local_ray(&ray, reach, false).is_some();
        (if blocked { open } else { open + cosine }, all + cosine)
    });
    if all > 0.0 { open / all } else { 1.0 }
}

/// What the bins of a rendering's samples take, by signal, on one thread.
fn bins(mesh: &Mesh, rows: &mut Vec<Row>) -> Result<()> {
    let viewpoint = Viewpoint::new(&nalgebra::Matrix3::identity(), &Vector3::new(0.0, 0.0, 3.0 * mesh.diagonal()));
    let step = (mesh.triangles.len() / SAMPLES).max(1);
    let chosen: Vec<[u32; 3]> = mesh.triangles.iter().step_by(step).cycle().take(SAMPLES).copied().collect();
    let names: Vec<&[SignalName]> =
        SignalName::ALL.iter().filter(|name| name.is_in(mesh)).map(std::slice::from_ref).collect();
    let joint: [&[SignalName]; 2] =
        [&[SignalName::Reflectance, SignalName::Normals], &[SignalName::Normals, SignalName::AmbientOcclusion]];
    for names in names.into_iter().chain(joint) {
        let signal = joint_signal(mesh, names).context("the fixture's bust lacks a signal")?;
        let pass = || {
            let began = Instant::now();
            for &corners in &chosen {
                let surfel = Surfel { mesh, corners, weights: [0.2, 0.3, 0.5], viewpoint: &viewpoint };
                black_box(signal.bin(&surfel));
            }
            began.elapsed().as_secs_f64() * 1e3
        };
        let least = (0..15).map(|_| pass()).fold(f64::INFINITY, f64::min);
        let name: Vec<String> = names.iter().map(ToString::to_string).collect();
        let name = format!("{} × {}: {} bins", SAMPLES, name.join(","), signal.bins());
        rows.push(Row::alone(name, least, "ms").goal(BINS));
    }
    Ok(())
}
