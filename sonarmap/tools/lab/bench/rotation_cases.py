"""Cases of the correlation over rotations, points against a view, and the correlation over translations."""

from typing import Any

import numpy as np

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.points.visibility import Viewing, agreement, upload_points, upload_viewpoints
from sonarmap.kernels.pomf.correlator import Correlator, Pose
from sonarmap.kernels.so3.correlation import RotationCorrelation, wigner_d
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import BLUR, KernelCase, peak_numbers
from sonarmap.tools.lab.bench.workload import BANDWIDTH, SHIFT, R, Workload

# Rotation angle of the z axis by roll and pitch of 35 degrees [rad]
_LARGEST = float(np.arccos(np.cos(np.deg2rad(35)) ** 2))
_SEGMENTS = 4  # of a row, each with a peak
_REACH = 1.5  # tolerance of ranges at the sensor [voxels]
_SLOPE = 0.03  # its growth per voxel of range
_BORDERS = 1e-3  # tolerance: about ten of a million points on borders of cells fall to the other side


def correlate_rotations_case(w: Workload) -> KernelCase:
    correlation = RotationCorrelation(w.device, BANDWIDTH, _LARGEST)
    wigner, edge = wigner_table(correlation.betas), correlation.edge
    target, source = w.coefficients
    given = w.upload(target), w.upload(source)
    images, degrees = len(correlation.betas) + 1, np.arange(0, BANDWIDTH, 2)
    table = 4 * len(correlation.betas) * int(((2 * degrees + 1) * (degrees + 1)).sum())
    half, volume = 8 * images * edge * (edge // 2 + 1), 4 * images * edge**2
    return KernelCase(
        "RotationCorrelation",
        "matmul, einsum, irfft2",
        2 * target.nbytes + table + 4 * half + volume,
        1e-5,
        run=lambda: correlation.correlate(*given)[0],
        twin=lambda: twins.correlate_rotations(target, source, wigner, edge, w.cores),
    )


def rotation_peaks_case(w: Workload) -> KernelCase:
    correlation = RotationCorrelation(w.device, BANDWIDTH, _LARGEST)
    host = twins.correlate_rotations(*w.coefficients, wigner_table(correlation.betas), correlation.edge, w.cores)
    values = w.upload(host[None])
    return KernelCase(
        "RotationCorrelation.peaks",
        "maximum_filter, np.argmax",
        host.nbytes,
        0.0,
        run=lambda: correlation.peaks(values)[0],
        read=lambda peaks: np.column_stack([peaks.index, peaks.around[:, 13]]),
        twin=lambda: twins.segment_peaks(host, _SEGMENTS, images=len(correlation.betas)),
    )


def agreement_case(w: Workload) -> KernelCase:
    R, t = w.poses
    poses, center = upload_poses(w.device, R, t), upload_viewpoints(w.device, np.zeros((1, 3)))
    viewing = Viewing(w.upload(w.view[None]), center, upload_points(w.device, w.seen))
    return KernelCase(
        "agreement",
        "NumPy, a pose at a time",
        w.view.nbytes + w.seen.nbytes + len(w.poses[0]) * 19 * 4,
        _BORDERS,
        run=lambda: agreement(w.device, [viewing], poses, [(_REACH, _SLOPE)]).read()[0][0, :, 0],
        read=lambda result: result,
        twin=lambda: twins.agreement(w.view, w.seen, *w.poses, _REACH, _SLOPE),
    )


def wigner_table(betas: np.ndarray) -> np.ndarray:
    """(degrees, betas, 2 BANDWIDTH - 1, BANDWIDTH) float32: d[l, m, n](beta) for n >= 0."""
    table = np.zeros((BANDWIDTH // 2, len(betas), 2 * BANDWIDTH - 1, BANDWIDTH), np.float32)
    for half in range(BANDWIDTH // 2):
        orders = slice(BANDWIDTH - 1 - 2 * half, BANDWIDTH + 2 * half)
        table[half, :, orders, : 2 * half + 1] = wigner_d(2 * half, betas)[:, :, 2 * half :]
    return table


_TWICE_TRANSFORMED = 1e-4  # tolerance after two transforms and a whitening in single precision


def find_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    return KernelCase(
        "Correlator.find",
        "scipy.fft, NumPy, np.argmax",
        w.points.nbytes + 5 * w.half_bytes + w.volume_bytes,
        _TWICE_TRANSFORMED,
        run=lambda: correlator.find(points, [Pose(R)], [target], 1, 3.0)[0][0][0],
        read=peak_numbers,
        twin=lambda: twins.peak(_correlation(w)),
    )


def near_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    shift = np.array([SHIFT])
    return KernelCase(
        "Correlator.near",
        "scipy.fft, NumPy, 27 voxels",
        w.points.nbytes + 3 * w.half_bytes,
        _TWICE_TRANSFORMED,
        run=lambda: correlator.near(points, [Pose(R)], [target], shift).read()[0],
        read=peak_numbers,
        twin=lambda: twins.peak(_correlation(w)),
    )


def _given(w: Workload) -> tuple[Correlator, Any, Any]:
    """A correlator, and the points and their target on the device."""
    return Correlator(w.device, w.edge, BLUR), w.upload(w.points), w.upload_half(w.shifted)


def _correlation(w: Workload) -> np.ndarray:
    """The correlation by NumPy and SciPy."""
    source = twins.prepare(twins.voxelize(w.points, R, np.empty_like(w.volume)), w.cores)
    return twins.correlate(w.shifted, source, BLUR, np.empty_like(w.spectrum), w.cores)
