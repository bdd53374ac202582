"""Cases of voxelization, resampling of volumes and spectra, normalizing layers, nearest points and planes."""

import numpy as np
import scipy.fft

from sonarmap.kernels.device.arrays import upload_places
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.spectrum import magnitude
from sonarmap.kernels.resample.layers import (
    normalize_layers,
    polar_magnitude,
    rectangular_unwrap,
    rotational_unwrap,
    sample,
    upload_directions,
    valid_pixels,
)
from sonarmap.kernels.surface.cells import find_nearest, fit_planes, sort_into_cells
from sonarmap.tools.lab.bench.case import KernelCase
from sonarmap.tools.lab.bench.workload import SMALL_SHIFT, SMALL_TURN, R, Workload


def voxelize_case(w: Workload) -> KernelCase:
    points, out = w.upload(w.points), w.device.empty((w.edge,) * 3)
    return KernelCase(
        "voxelize",
        w.points.nbytes + w.volume_bytes + 8 * len(w.points),
        run=lambda: voxelize(w.device, points, w.edge, R, out=out),
    )


def sample_case(w: Workload) -> KernelCase:
    directions = rectangular_unwrap(w.edge, "y")
    volume = magnitude(w.device, w.upload_half(w.spectrum), w.edge)
    table = upload_directions(w.device, directions)
    out = w.device.empty((len(w.radii), w.edge, w.edge))
    first, last = float(w.radii[0]), float(w.radii[-1])
    shell = 4 * round(2 / 3 * np.pi * (last**3 - first**3))
    return KernelCase(
        "sample",
        shell + directions.nbytes + out.nbytes,
        run=lambda: sample(w.device, volume, table, w.radii, R, out=out),
    )


def normalize_layers_case(w: Workload) -> KernelCase:
    mask = valid_pixels(rotational_unwrap(w.edge))
    window = np.outer(np.hanning(w.edge), np.hanning(w.edge)).astype(np.float32)
    stack, device_window, device_mask = w.upload(w.layers), w.upload(window), w.upload(mask)
    out = w.device.empty(w.layers.shape)
    return KernelCase(
        "normalize_layers",
        2 * w.layers.nbytes + w.layers.nbytes,
        run=lambda: normalize_layers(w.device, stack, device_window, device_mask, out=out),
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
        ring * len(host) + out.nbytes,
        run=lambda: polar_magnitude(w.device, spectrum, (w.edge, w.edge), radii, angles, out=out),
    )


_FARTHEST = 2.0  # largest distance of a point from its plane [voxels]
_POINT_BYTES = 16  # of a point among its cells
_ELEMENT_BYTES = 48  # of a surface element


def nearest_case(w: Workload) -> KernelCase:
    cells, places = sort_into_cells(w.device, w.surface), upload_places(w.device, w.surface)
    return KernelCase(
        "find_nearest",
        2 * _POINT_BYTES * len(w.surface) + 8 * len(w.surface),
        run=lambda: find_nearest(w.device, cells, places, SMALL_TURN[None], SMALL_SHIFT[None], w.edge),
    )


def planes_case(w: Workload) -> KernelCase:
    cells = sort_into_cells(w.device, w.surface)
    return KernelCase(
        "fit_planes",
        (_POINT_BYTES + _ELEMENT_BYTES) * len(w.surface),
        run=lambda: fit_planes(w.device, cells, np.eye(3), np.empty((0, 3)), farthest=_FARTHEST, aside=1.0),
    )
