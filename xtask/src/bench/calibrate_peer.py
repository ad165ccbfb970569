"""OpenCV's calibration, driven line by line on standard input; answers are one JSON object a line on standard output.

  load COLUMNS ROWS FILE…   reads grey images            -> {"version": …, "images": n}
  detect                    finds and refines corners     -> {"ms": …}
  corners                   the last detection's          -> {"boards": [null | [[u, v], …], …], "sector_based": n}
  calibrate                 on those, five coefficients   -> {"ms": …, "rms": …, "values": [9], "deviations": [9]}
"""
import json
import sys
import time

import cv2
import numpy as np

FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-4)
HALF_WINDOW = 5
size, images, boards = (0, 0), [], []


def find(image):
    found, corners = cv2.findChessboardCorners(image, size, flags=FLAGS)
    if not found:
        return None
    return cv2.cornerSubPix(image, corners, (HALF_WINDOW, HALF_WINDOW), (-1, -1), STOP).reshape(-1, 2)


def answer(words):
    global size, images, boards
    if words[0] == "load":
        size = int(words[1]), int(words[2])
        images = [cv2.imread(file, cv2.IMREAD_GRAYSCALE) for file in words[3:]]
        return {"version": cv2.__version__, "images": sum(image is not None for image in images)}
    if words[0] == "detect":
        start = time.perf_counter()
        boards = [find(image) for image in images]
        return {"ms": 1e3 * (time.perf_counter() - start)}
    if words[0] == "corners":
        sector_based = sum(bool(cv2.findChessboardCornersSB(image, size)[0]) for image in images)
        return {"boards": [None if b is None else b.tolist() for b in boards], "sector_based": sector_based}
    grid = np.zeros((size[0] * size[1], 3), np.float32)
    grid[:, :2] = np.mgrid[: size[0], : size[1]].T.reshape(-1, 2)
    seen = [b.reshape(-1, 1, 2).astype(np.float32) for b in boards if b is not None]
    shape = images[0].shape[::-1]
    start = time.perf_counter()
    rms, k, d, *_ = cv2.calibrateCamera([grid] * len(seen), seen, shape, None, None)
    ms = 1e3 * (time.perf_counter() - start)
    deviations = cv2.calibrateCameraExtended([grid] * len(seen), seen, shape, None, None)[5].ravel()[:9]
    values = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], *d.ravel()[:5]]
    return {"ms": ms, "rms": rms, "values": list(map(float, values)), "deviations": list(map(float, deviations))}


for line in sys.stdin:
    print(json.dumps(answer(line.rstrip("\n").split("\t"))), flush=True)
