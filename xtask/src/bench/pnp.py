"""Solves the sets of `cargo xtask bench pnp` with OpenCV and PoseLib, whichever can be imported.

usage: pnp.py FOLDER REPEATS

FOLDER/cases.f64 holds a row of four numbers a case: points, planar (0 or 1), threshold in pixels, robust (0 or 1);
FOLDER/points.f64 the points in the same order: X Y Z u v. The camera is f = 1000, principal point (512, 384), 1024 x 768.
FOLDER/results.f64 receives, case by case and method by method, R (row by row), t and the microseconds of the fastest
repeat; not-a-number where a method fails or does not apply. The methods are printed, one a line.
"""
import sys
import time

import numpy as np

folder, repeats = sys.argv[1], int(sys.argv[2])
cases = np.fromfile(folder + "/cases.f64").reshape(-1, 4)
points = np.fromfile(folder + "/points.f64").reshape(-1, 5)
K = np.array([[1000.0, 0, 512], [0, 1000, 384], [0, 0, 1]])
methods = []  # name, for robust cases, usable with (n, planar), solver of (X, uv, threshold) to (R, t)

try:
    import cv2

    cv2.setNumThreads(1)

    def opencv(flag, refined=False):
        def solve(X, uv, _):
            ok, r, t = cv2.solvePnP(X, uv, K, None, flags=flag)
            if ok and refined:
                r, t = cv2.solvePnPRefineLM(X, uv, K, None, r, t)
            return (r, t) if ok else None
        return solve

    def opencv_ransac(flag):
        def solve(X, uv, threshold):
            ok, r, t, _ = cv2.solvePnPRansac(X, uv, K, None, iterationsCount=1000, reprojectionError=threshold,
                                             confidence=0.999, flags=flag)
            return (r, t) if ok else None
        return solve

    def opencv_magsac(X, uv, threshold):
        p = cv2.UsacParams()
        p.threshold, p.confidence, p.maxIterations = threshold, 0.999, 1000
        p.sampler, p.score, p.loMethod = cv2.SAMPLING_UNIFORM, cv2.SCORE_METHOD_MAGSAC, cv2.LOCAL_OPTIM_INNER_LO
        ok, _, r, t, _ = cv2.solvePnPRansac(X, uv, K.copy(), None, params=p)
        return (r, t) if ok else None

    always = lambda n, planar: True
    methods += [
        ("OpenCV SQPnP", False, always, opencv(cv2.SOLVEPNP_SQPNP)),
        ("OpenCV EPnP", False, always, opencv(cv2.SOLVEPNP_EPNP)),
        ("OpenCV iterative", False, lambda n, planar: planar or n >= 6, opencv(cv2.SOLVEPNP_ITERATIVE)),
        ("OpenCV IPPE", False, lambda n, planar: planar, opencv(cv2.SOLVEPNP_IPPE)),
        ("OpenCV SQPnP, LM", False, always, opencv(cv2.SOLVEPNP_SQPNP, True)),
        ("OpenCV RANSAC EPnP", True, lambda n, planar: n >= 5, opencv_ransac(cv2.SOLVEPNP_ITERATIVE)),
        ("OpenCV RANSAC AP3P", True, always, opencv_ransac(cv2.SOLVEPNP_AP3P)),
        ("OpenCV MAGSAC", True, lambda n, planar: n >= 6, opencv_magsac),
    ]
    print("version OpenCV", cv2.__version__)
except ImportError:
    print("missing OpenCV")

try:
    import poselib

    camera = dict(model="PINHOLE", width=1024, height=768, params=[1000, 1000, 512, 384])

    def poselib_ransac(least):
        def solve(X, uv, threshold):
            options = dict(max_reproj_error=threshold, min_iterations=least)
            pose = poselib.estimate_absolute_pose(uv, X, camera, options, {})[0]
            return pose.R, pose.t
        return solve

    def poselib_refine(X, uv, _):
        ok, r, t = cv2.solvePnP(X, uv, K, None, flags=cv2.SOLVEPNP_SQPNP)
        pose = poselib.CameraPose()
        pose.R, pose.t = cv2.Rodrigues(r)[0], t.ravel()
        pose = poselib.refine_absolute_pose(uv, X, pose, camera, dict(loss_type="TRIVIAL"))[0]
        return pose.R, pose.t

    methods += [("PoseLib", True, lambda n, planar: True, poselib_ransac(1000)),
                ("PoseLib, 50 iterations", True, lambda n, planar: True, poselib_ransac(50))]
    if "cv2" in sys.modules:
        methods += [("PoseLib LM from SQPnP", False, lambda n, planar: True, poselib_refine)]
    print("version PoseLib", getattr(poselib, "__version__", "?"))
except ImportError:
    print("missing PoseLib")

results = np.full((len(cases), len(methods), 13), np.nan)
start = 0
for case, (n, planar, threshold, robust) in enumerate(cases):
    X = np.ascontiguousarray(points[start:start + int(n), :3])
    uv = np.ascontiguousarray(points[start:start + int(n), 3:])
    start += int(n)
    for method, (_, for_robust, usable, solve) in enumerate(methods):
        if for_robust != bool(robust) or not usable(n, planar):
            continue
        for _ in range(repeats):
            if "cv2" in sys.modules:
                cv2.setRNGSeed(1)
            try:
                begin = time.perf_counter_ns()
                pose = solve(X, uv, threshold)
                time_us = (time.perf_counter_ns() - begin) / 1e3
                R, t = pose
                R = np.asarray(R)
                R = cv2.Rodrigues(R)[0] if R.size == 3 else R
            except Exception:
                break
            results[case, method, :12] = [*R.ravel(), *np.ravel(t)]
            results[case, method, 12] = np.fmin(results[case, method, 12], time_us)
results.tofile(folder + "/results.f64")
for name, *_ in methods:
    print("method", name)
