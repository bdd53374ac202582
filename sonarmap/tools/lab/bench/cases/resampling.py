"""Points to volumes, volumes and spectra to other coordinates, layers normalized."""

import numpy as np
import scipy.fft

from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.resample.layers import normalize_layers
from sonarmap.kernels.resample.polar import polar_magnitude
from sonarmap.kernels.resample.sphere import (
    rectangular_unwrap,
    rotational_unwrap,
    sample,
    upload_directions,
    valid_pixels,
)
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import RESAMPLED, KernelCase, volume_bytes
from sonarmap.tools.lab.bench.traffic import Traffic
from sonarmap.tools.lab.bench.workload import R, Workload


def voxelize_case(w: Workload) -> KernelCase:
    points, out = w.upload(w.points), w.device.empty((w.edge,) * 3)
    volume = np.empty((w.edge,) * 3, np.float32)
    return KernelCase(
        "voxelize",
        "np.maximum.at",
        Traffic(w.points.nbytes, volume_bytes(w), 8 * len(w.points)),
        0.0,
        run=lambda: voxelize(w.device, points, w.edge, R, out=out),
        read=out.get,
        twin=lambda: twins.voxelize(w.points, R, volume),
        flops=18 * len(w.points),
    )


def sample_case(w: Workload) -> KernelCase:
    directions = rectangular_unwrap(w.edge, "y")
    volume, table = w.upload(w.magnitude), upload_directions(w.device, directions)
    out = w.device.empty((len(w.radii), w.edge, w.edge))
    first, last = float(w.radii[0]), float(w.radii[-1])
    shell = 4 * round(2 / 3 * np.pi * (last**3 - first**3))
    return KernelCase(
        "sample",
        "map_coordinates",
        Traffic(shell + directions.nbytes, out.nbytes),
        RESAMPLED,
        run=lambda: sample(w.device, volume, table, w.radii, R, out=out),
        read=out.get,
        twin=lambda: twins.sample(w.magnitude, directions, w.radii, R, w.cores),
        flops=30 * out.size,
    )


def normalize_layers_case(w: Workload) -> KernelCase:
    mask = valid_pixels(rotational_unwrap(w.edge))
    window = np.outer(np.hanning(w.edge), np.hanning(w.edge)).astype(np.float32)
    stack, device_window, device_mask = w.upload(w.layers), w.upload(window), w.upload(mask)
    out = w.device.empty(w.layers.shape)
    return KernelCase(
        "normalize_layers",
        "NumPy mean, std",
        Traffic(2 * w.layers.nbytes, w.layers.nbytes),
        1e-5,
        run=lambda: normalize_layers(w.device, stack, device_window, device_mask, out=out),
        read=out.get,
        twin=lambda: twins.normalize_layers(w.layers, window, mask),
        flops=8 * w.layers.size,
    )


def polar_magnitude_case(w: Workload) -> KernelCase:
    host = np.asarray(scipy.fft.rfft2(w.layers, workers=w.cores))
    spectrum = w.upload_half(host)
    radii = np.linspace(0.11, 0.45, w.edge // 2) * (w.edge / 2)
    angles = np.arange(min(2 * w.edge, 512)) * (np.pi / min(2 * w.edge, 512))
    out = w.device.empty((len(host), len(radii), len(angles)))
    ring = 8 * round(np.pi / 2 * (radii[-1] ** 2 - radii[0] ** 2))
    return KernelCase(
        "polar_magnitude",
        "np.abs, map_coordinates",
        Traffic(ring * len(host), out.nbytes),
        RESAMPLED,
        run=lambda: polar_magnitude(w.device, spectrum, (w.edge, w.edge), radii, angles, out=out),
        read=out.get,
        twin=lambda: twins.polar_magnitude(host, radii, angles, w.cores),
        flops=28 * out.size,
    )
