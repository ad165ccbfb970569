//! A Python script that builds the cameras in Blender, each with its photo behind it: `blender --python cameras.py`.
//!
//! A script and not a file of Blender's own format, because that format is Blender's memory and changes with it; and not glTF,
//! which carries no principal point. Blender's lens is `lens / sensor_width = fx / W`, its shifts are in units of the longer side.

use crate::rotation::FLIP;
use crate::{FileError, PlacedMesh, Scene};
use serde_json::{Value, json};
use std::path::Path;

const SCRIPT: &str = r#"
import os
import bpy
from mathutils import Matrix

here = os.path.dirname(os.path.abspath(__file__))
IMPORTERS = {".ply": "ply_import", ".obj": "obj_import", ".stl": "stl_import"}

for m in MESHES:
    path = os.path.join(here, m["file"])
    suffix = os.path.splitext(path)[1].lower()
    turn = Matrix()
    if suffix in (".glb", ".gltf"):
        bpy.ops.import_scene.gltf(filepath=path)
        # It took y for up; the cameras are in the file's own axes.
        turn = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
    elif suffix == ".obj":
        bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z")
    elif suffix in IMPORTERS:
        getattr(bpy.ops.wm, IMPORTERS[suffix])(filepath=path)
    else:
        print(path + ": Blender does not read such files; import the model another way")
        continue
    for part in bpy.context.selected_objects:
        if part.parent is None:
            part.matrix_world = Matrix(m["world_from_mesh"]) @ turn @ part.matrix_world

for c in CAMERAS:
    data = bpy.data.cameras.new(c["name"])
    width, height = c["size"]
    longer = max(width, height)
    data.sensor_fit = "HORIZONTAL" if width >= height else "VERTICAL"
    data.sensor_width = data.sensor_height = 36.0
    data.lens = c["focal"] * 36.0 / longer
    data.shift_x = ((width - 1) / 2 - c["principal"][0]) / longer
    data.shift_y = (c["principal"][1] - (height - 1) / 2) / longer
    data.clip_start, data.clip_end = c["distance"] / 100, c["distance"] * 100
    path = os.path.join(here, c["photo"])
    if os.path.exists(path):
        data.show_background_images = True
        background = data.background_images.new()
        background.image = bpy.data.images.load(path, check_existing=True)
        background.frame_method = "FIT"
    camera = bpy.data.objects.new(c["name"], data)
    camera.matrix_world = Matrix(c["world_from_camera"])
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = bpy.context.scene.camera or camera
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = width, height
"#;

pub(crate) fn write(path: &Path, scene: &Scene) -> Result<String, FileError> {
    let mut cameras = Vec::new();
    for (entry, size) in scene.cameras.photos.iter().zip(scene.sizes(path)?) {
        let k = entry.lens.camera(size).intrinsics;
        let inverse = entry.pose.inverse();
        let r = inverse.rotation.matrix() * FLIP;
        let row = |i: usize| [r[(i, 0)], r[(i, 1)], r[(i, 2)], inverse.translation[i]];
        cameras.push(json!({
            "name": crate::base_name(&entry.file), "photo": entry.file, "size": size, "focal": k.fx, "principal": [k.cx, k.cy],
            "distance": entry.pose.translation.norm().max(1e-9),
            "world_from_camera": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        }));
    }
    let mesh = |mesh: &PlacedMesh| {
        let rows: Vec<Vec<f64>> = mesh.world_from_mesh.row_iter().map(|row| row.iter().copied().collect()).collect();
        json!({"file": mesh.file.to_string_lossy(), "world_from_mesh": rows})
    };
    let meshes: Vec<Value> = scene.meshes.iter().map(mesh).collect();
    Ok(format!(
        "# Builds these cameras in Blender: blender --python {}\nMESHES = {:#}\nCAMERAS = {:#}\n{SCRIPT}",
        path.file_name().unwrap_or_default().to_string_lossy(),
        json!(meshes),
        json!(cameras)
    ))
}
