//! `transforms.json` of nerfstudio and instant-ngp: nerfstudio's documentation, *Data conventions*.
//!
//! Poses are camera to world, cameras look along −z with y up, the top-left pixel's centre is (0.5, 0.5). What a frame does not say
//! of its lens stands at the top of the file.

use crate::json::Fields;
use crate::rotation::{FLIP, checked_rotation};
use crate::{CameraEntry, FileError, Lens, Scene};
use nalgebra::{Matrix3, Vector3};
use serde_json::{Map, Value, json};
use std::path::Path;
use texreg_camera::Distortion;
use texreg_lie::Pose;

pub(crate) fn read(path: &Path) -> Result<Scene, FileError> {
    let mut top = Fields::open(path)?;
    if let Some(model) = top.take_optional::<String>("camera_model")?
        && !["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "perspective"].contains(&model.as_str())
    {
        return Err(top.error("camera_model", &format!("a camera of the kind '{model}' is not supported; OPENCV is")));
    }
    let frames: Vec<Map<String, Value>> = top.take("frames")?;
    let mut scene = Scene::default();
    // nerfstudio turns and moves the world of the program before it, and says how.
    let applied: Option<Vec<[f64; 4]>> = top.take_optional("applied_transform")?;
    let applied = match applied.as_deref() {
        None => None,
        Some([a, b, c, ..]) => {
            let r = Matrix3::from_fn(|i, j| [a, b, c][i][j]);
            let r = checked_rotation(&r).map_err(|cause| top.error("applied_transform", cause))?;
            scene.warnings.push("its applied_transform was taken back: the cameras are in the world before it".into());
            Some((r.inverse(), Vector3::new(a[3], b[3], c[3])))
        }
        Some(_) => return Err(top.error("applied_transform", "is not a matrix of 3 × 4 numbers")),
    };
    let shared = std::mem::take(&mut top.map);
    for (i, mut map) in frames.into_iter().enumerate() {
        for (key, value) in &shared {
            map.entry(key).or_insert_with(|| value.clone());
        }
        let mut fields = top.item("frames", i, map);
        let file: String = fields.take("file_path")?;
        fields.photo = Some(file.clone());
        let lens = lens(&mut fields)?;
        let m: Vec<[f64; 4]> = fields.take("transform_matrix")?;
        let [a, b, c, ..] = m.as_slice() else {
            return Err(fields.error("transform_matrix", "is not a matrix of 4 × 4 numbers"));
        };
        let mut r = Matrix3::from_fn(|i, j| [a, b, c][i][j]);
        let mut centre = Vector3::new(a[3], b[3], c[3]);
        if let Some((rotation, translation)) = &applied {
            r = rotation * r;
            centre = rotation * (centre - translation);
        }
        let r = checked_rotation(&(FLIP * r.transpose())).map_err(|cause| fields.error("transform_matrix", cause))?;
        let pose = Pose::new(r, -(r * centre));
        scene.cameras.photos.push(CameraEntry { file, lens, pose, other: Map::new() });
    }
    Ok(scene)
}

fn lens(fields: &mut Fields) -> Result<Lens, FileError> {
    let mut number = |key: &str| -> Result<Option<f64>, FileError> { fields.take_optional(key) };
    let size = (number("w")?, number("h")?);
    let focal = (number("fl_x")?, number("fl_y")?);
    let angle = number("camera_angle_x")?;
    let principal = [number("cx")?.map(|x| x - 0.5), number("cy")?.map(|x| x - 0.5)];
    let mut distortion = [0.0; 5];
    for (slot, key) in distortion.iter_mut().zip(["k1", "k2", "p1", "p2", "k3"]) {
        *slot = number(key)?.unwrap_or(0.0);
    }
    if number("k4")?.is_some_and(|k4| k4 != 0.0) {
        return Err(fields.error("k4", "is not supported"));
    }
    let size = match size {
        (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 => Some([w as u32, h as u32]),
        (None, None) => None,
        _ => return Err(fields.error("w, h", "must both be positive")),
    };
    let from_angle = || Some(0.5 * f64::from(size?[0]) / (0.5 * angle?).tan());
    let fx = focal.0.or_else(from_angle).ok_or_else(|| fields.error("fl_x", "is missing"))?;
    let focal = [fx, focal.1.unwrap_or(fx)];
    if focal.iter().any(|f| *f <= 0.0) {
        return Err(fields.error("fl_x", "focal lengths must be positive"));
    }
    Ok(Lens { size, focal, principal, skew: 0.0, distortion: Distortion::from(distortion) })
}

pub(crate) fn write(path: &Path, scene: &Scene) -> Result<String, FileError> {
    let mut frames = Vec::new();
    for (entry, size) in scene.cameras.photos.iter().zip(scene.sizes(path)?) {
        let k = entry.lens.camera(size).intrinsics;
        let inverse = entry.pose.inverse();
        let r = inverse.rotation.matrix() * FLIP;
        let t = inverse.translation;
        let row = |i: usize| json!([r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]]);
        let [k1, k2, p1, p2, k3] = entry.lens.distortion.to_array();
        let mut frame = json!({
            "file_path": entry.file,
            "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            "w": size[0], "h": size[1],
            "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx + 0.5, "cy": k.cy + 0.5,
            "k1": k1, "k2": k2, "p1": p1, "p2": p2,
        });
        if k3 != 0.0 {
            frame["k3"] = json!(k3);
        }
        frames.push(frame);
    }
    Ok(format!("{:#}\n", json!({"camera_model": "OPENCV", "frames": frames})))
}
