"""One rasterizer of the peers folder, one frame a line: prints "ready" for each size and then, for every line "frame" on standard
input, the frame's milliseconds; "save PATH" finishes a size and writes its depth (f32) and face (i32, -1 background)."""
import sys
import time

sys.path.insert(0, ".")
import numpy as np
import raster
from common import DATA, read_camera, read_ply

name, mesh, threads, sizes = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4:]
sizes = [tuple(map(int, s.split("x"))) for s in sizes]
target = None


def serve(frame, reps):
    """Stands in for the peers' own timer: takes the place of its repetitions, on demand."""
    global target
    if target is not None:  # a second variant of the same frame
        return {}
    frame()
    print("ready", flush=True)
    for line in sys.stdin:
        command, *path = line.split(maxsplit=1)
        if command == "save":
            target = path[0].strip()
            return {}
        start = time.perf_counter()
        frame()
        print((time.perf_counter() - start) * 1e3, flush=True)


raster.timeit = serve
V, F = read_ply(DATA / f"mesh/statue_{mesh}.ply")
cameras = [(s, read_camera(DATA / "mesh/camera.json", *s)) for s in sizes]
for (w, h), _, z, ids in raster.PEERS[name](V, F, cameras, threads, 1):
    ids = np.full(z.shape, -1) if ids is None else np.where(np.isfinite(z), ids, -1)
    with open(target, "wb") as f:
        f.write(z.astype("<f4").tobytes())
        f.write(ids.astype("<i4").tobytes())
    target = None
    print("saved", flush=True)
