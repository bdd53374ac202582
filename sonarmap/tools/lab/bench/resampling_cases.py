"""Cases of voxelization, resampling of volumes and spectra, normalizing layers, nearest points and planes."""

import numpy as np
import scipy.fft
from scipy.spatial import KDTree

from sonarmap.kernels.device.arrays import upload_places
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.resample.layers import (
    normalize_layers,
    polar_magnitude,
    rectangular_unwrap,
    rotational_unwrap,
    sample,
    upload_directions,
    valid_pixels,
)
from sonarmap.kernels.surface.cells import NEIGHBORS, find_nearest, fit_planes, sort_into_cells
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import RESAMPLED, KernelCase
from sonarmap.tools.lab.bench.workload import SMALL_SHIFT, SMALL_TURN, R, Workload


def voxelize_case(w: Workload) -> KernelCase:
    points, out = w.upload(w.points), w.device.empty((w.edge,) * 3)
    volume = np.empty((w.edge,) * 3, np.float32)
    return KernelCase(
        "voxelize",
        "np.maximum.at",
        w.points.nbytes + w.volume_bytes + 8 * len(w.points),
        0.0,
        run=lambda: voxelize(w.device, points, w.edge, R, out=out),
        twin=lambda: twins.voxelize(w.points, R, volume),
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
        shell + directions.nbytes + out.nbytes,
        RESAMPLED,
        run=lambda: sample(w.device, volume, table, w.radii, R, out=out),
        twin=lambda: twins.sample(w.magnitude, directions, w.radii, R, w.cores),
    )


def normalize_layers_case(w: Workload) -> KernelCase:
    mask = valid_pixels(rotational_unwrap(w.edge))
    window = np.outer(np.hanning(w.edge), np.hanning(w.edge)).astype(np.float32)
    stack, device_window, device_mask = w.upload(w.layers), w.upload(window), w.upload(mask)
    out = w.device.empty(w.layers.shape)
    return KernelCase(
        "normalize_layers",
        "NumPy mean, std",
        2 * w.layers.nbytes + w.layers.nbytes,
        1e-5,
        run=lambda: normalize_layers(w.device, stack, device_window, device_mask, out=out),
        twin=lambda: twins.normalize_layers(w.layers, window, mask),
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
        ring * len(host) + out.nbytes,
        RESAMPLED,
        run=lambda: polar_magnitude(w.device, spectrum, (w.edge, w.edge), radii, angles, out=out),
        twin=lambda: twins.polar_magnitude(host, radii, angles, w.cores),
    )


_EQUALLY_FAR = 1e-4  # tolerance: of two neighbors at equal distance, either may be used for the plane
_FARTHEST = 2.0  # largest distance of a point from its plane [voxels]
_DISTANCE = 1e-5  # tolerance of distances of about a voxel between coordinates of about a hundred
_POINT_BYTES = 16  # of a point among its cells
_ELEMENT_BYTES = 48  # of a surface element


def nearest_case(w: Workload) -> KernelCase:
    cells, places = sort_into_cells(w.device, w.surface), upload_places(w.device, w.surface)
    tree = KDTree(w.surface)
    return KernelCase(
        "find_nearest",
        "scipy.spatial.KDTree",
        2 * _POINT_BYTES * len(w.surface) + 8 * len(w.surface),
        _DISTANCE,
        run=lambda: find_nearest(w.device, cells, places, SMALL_TURN[None], SMALL_SHIFT[None], w.edge)[0],
        read=lambda result: result[0],
        twin=lambda: twins.nearest(tree, w.surface, SMALL_TURN, SMALL_SHIFT, w.cores),
    )


def planes_case(w: Workload) -> KernelCase:
    cells, tree = sort_into_cells(w.device, w.surface), KDTree(w.surface)
    return KernelCase(
        "fit_planes",
        "scipy.spatial.KDTree, eigh",
        (_POINT_BYTES + _ELEMENT_BYTES) * len(w.surface),
        _EQUALLY_FAR,
        run=lambda: fit_planes(w.device, cells, np.eye(3), np.empty((0, 3)), farthest=_FARTHEST, aside=1.0),
        read=lambda result: result.get()[:, :3],
        twin=lambda: twins.on_planes(tree, w.surface, NEIGHBORS, _FARTHEST, w.cores),
    )
