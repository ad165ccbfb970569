//! Agisoft Metashape's camera XML: *Metashape Professional User Manual*, appendices "Camera models" and "Camera XML".
//!
//! Poses are camera to chunk; the chunk's own transform (scale, rotation, translation) takes the chunk to the world. The principal
//! point is told from the image's middle, the lens is `u = W/2 + cx + x(f + B1) + y B2`, `v = H/2 + cy + y f` with the top-left
//! pixel's centre at (0.5, 0.5), and p1, p2 have changed places against Brown's order.

use crate::rotation::checked_rotation;
use crate::xml::{Element, escaped, parse};
use crate::{CameraEntry, FileError, Lens, Scene};
use nalgebra::{Matrix3, Vector3};
use serde_json::Map;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;
use texreg_camera::{Camera, Distortion};
use texreg_lie::Pose;

/// From the chunk to the world: `X ↦ scale · rotation · X + translation`.
struct Placement {
    scale: f64,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

pub(crate) fn read(path: &Path, text: &str) -> Result<Scene, FileError> {
    parse(path, text, "document", |document| {
        let mut scene = Scene::default();
        let mut chunks = 0;
        for chunk in document.children("chunk").chain(document.children("chunks").flat_map(|all| all.children("chunk")))
        {
            read_chunk(chunk, &mut scene)?;
            chunks += 1;
        }
        if chunks == 0 { Err(document.error("<document> lacks <chunk>")) } else { Ok(scene) }
    })
}

fn read_chunk(chunk: Element, scene: &mut Scene) -> Result<(), FileError> {
    let components = chunk.child("components").into_iter().flat_map(|all| all.children("component"));
    let placements: HashMap<&str, Placement> = components
        .filter_map(|component| Some((component.attribute("id"), component.child("transform")?)))
        .map(|(id, transform)| Ok((id?, placement(transform)?)))
        .collect::<Result<_, FileError>>()?;
    let whole = chunk.child("transform").map(placement).transpose()?;
    let mut lenses = HashMap::new();
    for sensor in chunk.child("sensors").into_iter().flat_map(|all| all.children("sensor")) {
        lenses.insert(sensor.attribute("id")?, sensor);
    }
    let groups = chunk.child("cameras").into_iter();
    let cameras = groups
        .flat_map(|all| all.children("camera").chain(all.children("group").flat_map(|group| group.children("camera"))));
    for camera in cameras {
        let file = camera.attribute("label")?.to_owned();
        let Some(transform) = camera.child("transform") else {
            scene.warnings.push(format!("photo {file}: Metashape did not place it"));
            continue;
        };
        let sensor = camera.attribute("sensor_id")?;
        let sensor =
            lenses.get(sensor).ok_or_else(|| camera.error(format!("photo {file}: there is no sensor {sensor}")))?;
        let placed = camera.node.attribute("component_id").and_then(|id| placements.get(id));
        let pose = pose(transform, whole.as_ref().or(placed))
            .map_err(|cause| transform.error(format!("photo {file}, field transform: {cause}")))?;
        scene.cameras.photos.push(CameraEntry { lens: lens(*sensor)?, pose, file, other: Map::new() });
    }
    Ok(())
}

fn placement(transform: Element) -> Result<Placement, FileError> {
    let rotation = transform.child("rotation").map(|r| r.text_numbers::<9>()).transpose()?;
    let translation = transform.child("translation").map(|t| t.text_numbers::<3>()).transpose()?;
    let [scale] = transform.child("scale").map(|s| s.text_numbers()).transpose()?.unwrap_or([1.0]);
    if scale <= 0.0 {
        return Err(transform.error("field scale: must be positive"));
    }
    let rotation = rotation.map_or(Matrix3::identity(), |r| Matrix3::from_row_slice(&r));
    let rotation = checked_rotation(&rotation).map_err(|cause| transform.error(format!("field rotation: {cause}")))?;
    let translation = translation.unwrap_or_default().into();
    Ok(Placement { scale, rotation: rotation.into_inner(), translation })
}

fn pose(transform: Element, chunk: Option<&Placement>) -> Result<Pose, String> {
    let m: [f64; 16] = transform.text_numbers().map_err(|error| error.cause)?;
    let r = Matrix3::from_fn(|i, j| m[4 * i + j]);
    let centre = Vector3::new(m[3], m[7], m[11]);
    let (r, centre) = match chunk {
        Some(chunk) => (chunk.rotation * r, chunk.scale * (chunk.rotation * centre) + chunk.translation),
        None => (r, centre),
    };
    let camera_from_world = checked_rotation(&r)?.inverse();
    Ok(Pose::new(camera_from_world, -(camera_from_world * centre)))
}

fn lens(sensor: Element) -> Result<Lens, FileError> {
    let kind = sensor.node.attribute("type").unwrap_or("frame");
    if kind != "frame" {
        return Err(sensor.error(format!("field type: a camera of the kind '{kind}' is not supported; frame is")));
    }
    let resolution = sensor.need("resolution")?;
    let ([width], [height]) = (resolution.numbers("width")?, resolution.numbers("height")?);
    let fits = sensor.children("calibration").find(|c| c.node.attribute("class") != Some("initial"));
    let calibration = fits.or_else(|| sensor.child("calibration"));
    let calibration = calibration.ok_or_else(|| sensor.error("<sensor> lacks <calibration>"))?;
    let number = |name: &'static str| -> Result<Option<f64>, FileError> {
        Ok(calibration.child(name).map(|element| element.text_numbers()).transpose()?.map(|[x]| x))
    };
    let or_zero = |name| number(name).map(|x| x.unwrap_or(0.0));
    let f = match number("f")? {
        Some(f) => f,
        None => number("fy")?.ok_or_else(|| calibration.error("<calibration> lacks <f>"))?,
    };
    let fx = number("fx")?.unwrap_or(f + or_zero("b1")?);
    if f <= 0.0 || fx <= 0.0 || width < 1.0 || height < 1.0 {
        return Err(calibration.error("field f: focal lengths and the resolution must be positive"));
    }
    if or_zero("k4")? != 0.0 || or_zero("p3")? != 0.0 || or_zero("p4")? != 0.0 {
        return Err(calibration.error("field k4: a lens with k4, p3 or p4 is not supported"));
    }
    // Before version 1.3 of the files there were fx and fy, and the principal point was told from the corner.
    let origin = if number("fx")?.is_some() { [0.0; 2] } else { [0.5 * width, 0.5 * height] };
    Ok(Lens {
        size: Some([width as u32, height as u32]),
        focal: [fx, f],
        principal: [Some(origin[0] - 0.5 + or_zero("cx")?), Some(origin[1] - 0.5 + or_zero("cy")?)],
        skew: or_zero("b2")?,
        distortion: Distortion::from([or_zero("k1")?, or_zero("k2")?, or_zero("p2")?, or_zero("p1")?, or_zero("k3")?]),
    })
}

pub(crate) fn write(path: &Path, scene: &Scene) -> Result<String, FileError> {
    let mut lenses: Vec<Camera> = Vec::new();
    let mut cameras = String::new();
    for (i, (entry, size)) in scene.cameras.photos.iter().zip(scene.sizes(path)?).enumerate() {
        let lens = entry.lens.camera(size);
        let sensor = lenses.iter().position(|other| *other == lens).unwrap_or_else(|| {
            lenses.push(lens);
            lenses.len() - 1
        });
        let inverse = entry.pose.inverse();
        let rows: Vec<String> = (0..3)
            .map(|i| {
                let r = inverse.rotation.matrix().row(i);
                format!("{} {} {} {} ", r[0], r[1], r[2], inverse.translation[i])
            })
            .collect();
        let _ = writeln!(
            cameras,
            "      <camera id=\"{i}\" sensor_id=\"{sensor}\" label=\"{}\">\n        <transform>{}0 0 0 1</transform>\n      </camera>",
            escaped(&entry.file),
            rows.concat()
        );
    }
    let mut sensors = String::new();
    for (i, lens) in lenses.iter().enumerate() {
        let Camera { width, height, intrinsics: k, distortion } = lens;
        let [k1, k2, p1, p2, k3] = distortion.to_array();
        let fields = [
            ("f", k.fy),
            ("cx", k.cx - 0.5 * (f64::from(*width) - 1.0)),
            ("cy", k.cy - 0.5 * (f64::from(*height) - 1.0)),
            ("b1", k.fx - k.fy),
            ("b2", k.skew),
            ("k1", k1),
            ("k2", k2),
            ("k3", k3),
            ("p1", p2),
            ("p2", p1),
        ];
        let fields: Vec<String> = fields.map(|(name, x)| format!("          <{name}>{x}</{name}>\n")).into();
        let resolution = format!("<resolution width=\"{width}\" height=\"{height}\"/>");
        let _ = writeln!(
            sensors,
            "      <sensor id=\"{i}\" label=\"camera {i}\" type=\"frame\">\n        {resolution}\n        <calibration type=\"frame\" \
             class=\"adjusted\">\n          {resolution}\n{}        </calibration>\n      </sensor>",
            fields.concat()
        );
    }
    let counts = (lenses.len(), scene.cameras.photos.len());
    Ok(format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\">\n  <chunk label=\"texreg\" enabled=\"true\">\n    \
         <sensors next_id=\"{}\">\n{sensors}    </sensors>\n    <cameras next_id=\"{}\" next_group_id=\"0\">\n{cameras}    </cameras>\n  \
         </chunk>\n</document>\n",
        counts.0, counts.1
    ))
}
