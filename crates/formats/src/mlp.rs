//! MeshLab's project file `.mlp`, read and written as MeshLab and vcglib do.
//!
//! A camera there has rows right, up, backward, minus its centre for a translation, and its pixels' origin in the bottom-left
//! corner of the image: `q = R (X − C)`, `u = cx + f/sx · q.x / −q.z`, and the same upward. Principal points are carried, though many
//! filters of MeshLab take the middle of the image; distortion is not.

use crate::rotation::{FLIP, checked_rotation};
use crate::xml::{Element, escaped, parse};
use crate::{CameraEntry, FileError, Lens, PlacedMesh, Scene};
use nalgebra::{Matrix3, Matrix4, Vector3};
use serde_json::Map;
use std::fmt::Write as _;
use std::path::Path;
use texreg_camera::Distortion;
use texreg_lie::Pose;

pub(crate) fn read(path: &Path, text: &str) -> Result<Scene, FileError> {
    parse(path, text, "MeshLabProject", |project| {
        let mut scene = Scene::default();
        for mesh in project.children("MeshGroup").flat_map(|group| group.children("MLMesh")) {
            let file = path.with_file_name(mesh.attribute("filename")?);
            let matrix = mesh.child("MLMatrix44").map(|matrix| matrix.text_numbers::<16>()).transpose()?;
            let world_from_mesh = matrix.map_or_else(Matrix4::identity, |m| Matrix4::from_row_slice(&m));
            scene.meshes.push(PlacedMesh { file, world_from_mesh });
        }
        for raster in project.children("RasterGroup").flat_map(|group| group.children("MLRaster")) {
            let (entry, warning) = photo(raster)?;
            scene.cameras.photos.push(entry);
            scene.warnings.extend(warning);
        }
        Ok(scene)
    })
}

fn photo(raster: Element) -> Result<(CameraEntry, Option<String>), FileError> {
    let plane = raster.need("Plane")?;
    let file = plane.attribute("fileName")?.to_owned();
    let camera = raster.need("VCGCamera")?;
    if camera.node.attribute("CameraType").is_some_and(|kind| kind.trim() != "0") {
        return Err(camera.error(format!("photo {file}, field CameraType: only perspective cameras (0) are supported")));
    }
    let r = Matrix3::from_row_slice(&rotation_rows(&camera.numbers("RotationMatrix")?));
    let r = checked_rotation(&(FLIP * r))
        .map_err(|cause| camera.error(format!("photo {file}, field RotationMatrix: {cause}")))?;
    let [x, y, z, _] = camera.numbers("TranslationVector")?;
    let [focal] = camera.numbers("FocalMm")?;
    let [sx, sy] = camera.numbers("PixelSizeMm")?;
    let [cx, cy] = camera.numbers("CenterPx")?;
    let [width, height] = camera.numbers("ViewportPx")?;
    if focal <= 0.0 || sx <= 0.0 || sy <= 0.0 || width < 1.0 || height < 1.0 {
        return Err(camera.error(format!("photo {file}: FocalMm, PixelSizeMm and ViewportPx must be positive")));
    }
    let distorted = camera.node.attribute("LensDistortion").is_some_and(|k| k.split_whitespace().any(|k| k != "0"));
    let warning = distorted.then(|| format!("photo {file}: MeshLab's LensDistortion is not used, by MeshLab either"));
    let lens = Lens {
        size: Some([width as u32, height as u32]),
        focal: [focal / sx, focal / sy],
        principal: [Some(cx - 0.5), Some(height - cy - 0.5)],
        skew: 0.0,
        distortion: Distortion::default(),
    };
    let pose = Pose::new(r, r * Vector3::new(x, y, z));
    Ok((CameraEntry { file, lens, pose, other: Map::new() }, warning))
}

/// The upper left 3 × 3 of a 4 × 4 matrix by rows.
fn rotation_rows(m: &[f64; 16]) -> [f64; 9] {
    std::array::from_fn(|i| m[4 * (i / 3) + i % 3])
}

/// A pixel's size in millimetres: only its ratio to the focal length means anything.
const PIXEL_MM: f64 = 0.0078125;

pub(crate) fn write(path: &Path, scene: &Scene) -> Result<String, FileError> {
    let sizes = scene.sizes(path)?;
    let mut out = String::from("<!DOCTYPE MeshLabDocument>\n<MeshLabProject>\n <MeshGroup>\n");
    for mesh in &scene.meshes {
        let file = escaped(&mesh.file.to_string_lossy());
        let label = escaped(&mesh.file.file_name().unwrap_or_default().to_string_lossy());
        let rows = mesh.world_from_mesh.row_iter().map(|m| format!("{} {} {} {} \n", m[0], m[1], m[2], m[3]));
        let matrix: String = rows.collect();
        let _ = write!(
            out,
            "  <MLMesh label=\"{label}\" filename=\"{file}\" visible=\"1\">\n   <MLMatrix44>\n{matrix}</MLMatrix44>\n  \
             </MLMesh>\n"
        );
    }
    out += " </MeshGroup>\n <RasterGroup>\n";
    for (entry, [width, height]) in scene.cameras.photos.iter().zip(sizes) {
        let k = entry.lens.camera([width, height]).intrinsics;
        let r = FLIP * entry.pose.rotation.matrix();
        let rows: Vec<String> = (0..3).map(|i| format!("{} {} {} 0 ", r[(i, 0)], r[(i, 1)], r[(i, 2)])).collect();
        let c = entry.pose.center();
        let file = escaped(&entry.file);
        let _ = write!(
            out,
            "  <MLRaster label=\"{}\">\n   <VCGCamera TranslationVector=\"{} {} {} 1\" RotationMatrix=\"{}0 0 0 1 \" \
             LensDistortion=\"0 0\" ViewportPx=\"{width} {height}\" PixelSizeMm=\"{} {}\" CenterPx=\"{} {}\" \
             FocalMm=\"{}\" CameraType=\"0\" BinaryData=\"0\"/>\n   <Plane semantic=\"1\" fileName=\"{file}\"/>\n  </MLRaster>\n",
            escaped(crate::base_name(&entry.file)),
            -c.x,
            -c.y,
            -c.z,
            rows.concat(),
            PIXEL_MM,
            PIXEL_MM * k.fx / k.fy,
            k.cx + 0.5,
            f64::from(height) - k.cy - 0.5,
            k.fx * PIXEL_MM,
        );
    }
    out += " </RasterGroup>\n</MeshLabProject>\n";
    Ok(out)
}
