"""ITK's Mattes metric and scikit-learn's mutual information on two pictures, evaluation by evaluation: a driver for the mi benchmark.

Arguments: fixed and moving picture (float32, raw), width, height, bins, threads, and two files of labels (uint16, raw).
Each line of input asks for one value with its gradient; the answer is its milliseconds."""
import sys
import time

import numpy as np

fixed, moving, width, height, bins, threads, rows, columns = sys.argv[1:9]
width, height, bins, threads = int(width), int(height), int(bins), int(threads)
try:
    from sklearn.metrics import mutual_info_score
    print("sklearn", repr(float(mutual_info_score(np.fromfile(rows, "<u2"), np.fromfile(columns, "<u2")))), flush=True)
except ImportError:
    print("sklearn", "missing", flush=True)

import itk

itk.MultiThreaderBase.SetGlobalDefaultNumberOfThreads(threads)
f, m = (itk.image_from_array(np.fromfile(n, "<f4").reshape(height, width)) for n in (fixed, moving))
metric = itk.MattesMutualInformationImageToImageMetricv4[type(f), type(m)].New()
transform = itk.AffineTransform[itk.D, 2].New()
parameters = itk.OptimizerParameters[itk.D](6)
for i, v in enumerate([1.001, 0.002, -0.002, 0.999, 0.7, -0.4]):
    parameters[i] = v
transform.SetParameters(parameters)
metric.SetMaximumNumberOfWorkUnits(threads)
metric.SetFixedImage(f)
metric.SetMovingImage(m)
metric.SetNumberOfHistogramBins(bins)
metric.SetVirtualDomainFromImage(f)
metric.SetMovingTransform(transform)
metric.Initialize()
derivative = itk.Array[itk.D](6)
metric.GetDerivative(derivative)
print("ready", metric.GetNumberOfValidPoints(), -metric.GetValue(), flush=True)
for _ in sys.stdin:
    began = time.perf_counter()
    metric.GetDerivative(derivative)
    print((time.perf_counter() - began) * 1e3, flush=True)
