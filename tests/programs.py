"""Camera files as the programs they are for understand them: python3 programs.py TEXREG FOLDER

Writes a scene in every format that one of the installed programs reads, and compares where that program projects points with where
texreg's conventions put them. What is not installed (pymeshlab, pycolmap, trimesh, bpy, cv2) is said to be skipped. Exit status 1 if a
program disagrees.
"""

import base64
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

texreg, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
failed = False
R = np.array([[0.8, 0.36, 0.48], [0.0, -0.8, 0.6], [0.6, -0.48, -0.64]])
T = np.array([0.1, -0.2, 4.0])
PINHOLE = {"fx": 260.0, "fy": 240.0, "cx": 125.25, "cy": 80.5}
BROWN = [-0.21, 0.08, 1.5e-3, -7e-4, 0.02]
POINTS = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))


def scene(name, distortion, k=PINHOLE):
    photo = {"file": "photo.png", "width": 240, "height": 180, "K": k, "distortion": distortion}
    photo |= {"R": R.tolist(), "T": T.tolist()}
    (folder / name).write_text(json.dumps({"photos": [photo]}))
    return name


def project(points, distortion):
    """The contract's projection: Brown-Conrady, pixel centres at integers."""
    x, y, z = (points @ R.T + T).T
    x, y = x / z, y / z
    k1, k2, p1, p2, k3 = distortion
    s = x * x + y * y
    g = 1 + s * (k1 + s * (k2 + s * k3))
    xd = x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    yd = y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    return np.c_[PINHOLE["fx"] * xd + PINHOLE["cx"], PINHOLE["fy"] * yd + PINHOLE["cy"]]


def convert(source, target, *options):
    subprocess.run([texreg, "convert", source, "-o", target, *options], cwd=folder, check=True, capture_output=True)
    return str(folder / target)


def check(program, theirs, ours, tolerance):
    global failed
    worst = np.abs(np.asarray(theirs) - np.asarray(ours)).max()
    good = worst <= tolerance
    failed |= not good
    print(f"{program}: {'agrees' if good else 'DISAGREES'}, at most {worst:.1e} off")


def installed(name):
    try:
        return importlib.import_module(name)
    except ImportError:
        print(f"{name}: skipped, not installed")
        return None


MESH = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
PLACE = np.array([[0, -1, 0, 0.25], [1, 0, 0, -0.5], [0, 0, 1, 2], [0, 0, 0, 1]])
ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
ply += "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
(folder / "model.ply").write_text(ply)

pinhole, brown = scene("pinhole.json", [0] * 5), scene("brown.json", BROWN)

if cv2 := installed("cv2"):
    storage = cv2.FileStorage(convert(brown, "camera.yml"), cv2.FILE_STORAGE_READ)
    k, d = (storage.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients"))
    pixels, _ = cv2.projectPoints(POINTS, cv2.Rodrigues(R)[0], T, k, d)
    check("OpenCV, YAML, px", pixels[:, 0], project(POINTS, BROWN), 1e-9)

if pycolmap := installed("pycolmap"):
    for target in ("colmap", "colmap-binary"):
        (folder / target).mkdir(exist_ok=True)
        model = pycolmap.Reconstruction(convert(brown, target, "--to", target))
        (image,) = model.images.values()
        pixels = np.array([image.project_point(point) for point in POINTS])
        check(f"COLMAP, {target}, px", pixels - 0.5, project(POINTS, BROWN), 1e-9)

if trimesh := installed("trimesh"):
    loaded = trimesh.load_scene(convert(pinhole, "cameras.glb"))
    pose = loaded.graph.get("photo.png")[0]
    check("trimesh, GLB, camera's place", pose[:3, 3], -R.T @ T, 1e-6)
    check("trimesh, GLB, camera's axes", pose[:3, :3], R.T @ np.diag([1, -1, -1]), 1e-6)

if bpy := installed("bpy"):
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    # Blender's pixels are square here.
    square = scene("square.json", [0] * 5, PINHOLE | {"fy": PINHOLE["fx"]})
    project_file = Path(convert(square, "moved.mlp", "--model", "model.ply"))
    rows = "\n".join(" ".join(str(x) for x in row) for row in PLACE)
    project_file.write_text(project_file.read_text().replace("1 0 0 0 \n0 1 0 0 \n0 0 1 0 \n0 0 0 1 ", rows))
    script = Path(convert("moved.mlp", "cameras.py"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    exec(compile(script.read_text(), script, "exec"), {"__file__": str(script)})
    camera = bpy.data.objects["photo.png"]
    bpy.context.view_layer.update()
    seen = np.array([world_to_camera_view(bpy.context.scene, camera, Vector(point)) for point in POINTS])
    pixels = np.c_[240 * seen[:, 0], 180 * (1 - seen[:, 1])] - 0.5
    expected = project(POINTS, [0] * 5)
    expected[:, 1] = PINHOLE["cy"] + (expected[:, 1] - PINHOLE["cy"]) * PINHOLE["fx"] / PINHOLE["fy"]
    check("Blender, script, px", pixels, expected, 1e-3)


    def corners():
        (mesh,) = (part for part in bpy.data.objects if part.type == "MESH")
        return np.array([mesh.matrix_world @ corner.co for corner in mesh.data.vertices])

    check("Blender, script, mesh's place", corners(), MESH @ PLACE[:3, :3].T + PLACE[:3, 3], 1e-6)
    # The importer of glTF turns models; the script turns them back.
    bpy.ops.export_scene.gltf(filepath=str(folder / "model.glb"), export_yup=False)
    moved = corners()
    script = Path(convert(square, "cameras.py", "--model", "model.glb"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    exec(compile(script.read_text(), script, "exec"), {"__file__": str(script)})
    check("Blender, script, a GLB's place", corners(), moved, 1e-6)

# Last, for it holds on to the interpreter: what MeshLab understood, by its own Bundler export (six digits, the middle of the image).
if pymeshlab := installed("pymeshlab"):
    # 240 × 180 pixels of black.
    PNG = "iVBORw0KGgoAAAANSUhEUgAAAPAAAAC0AQAAAACC55xFAAAAHElEQVR42u3BMQEAAADCoPVPbQ0PoAAAAAAAeDcVzAABoB36CwAAAABJRU5ErkJggg=="
    (folder / "photo.png").write_bytes(base64.b64decode(PNG))
    meshes = pymeshlab.MeshSet()
    meshes.load_project(convert(pinhole, "project.mlp", "--model", "model.ply"))
    os.chdir(folder)
    meshes.apply_filter("save_active_raster_cameras", exportfile="Bundler .out", newname="meshlab")
    lines = (folder / "meshlab.out").read_text().splitlines()
    numbers = [np.array(line.split(), float) for line in lines[2:7]]
    f, r, t = numbers[0][0], np.array(numbers[1:4]), numbers[4]
    x, y, z = (POINTS @ r.T + t).T
    theirs = np.c_[-f * x / z, f * y / z * PINHOLE["fy"] / PINHOLE["fx"]]
    check("MeshLab, .mlp, px", theirs, project(POINTS, [0] * 5) - [PINHOLE["cx"], PINHOLE["cy"]], 1e-3)

sys.exit(failed)
