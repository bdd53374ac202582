"""Cases of the correlation over rotations, points against a view, and the correlation over translations."""

from typing import Any

import numpy as np

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.points.visibility import Viewing, agreement, upload_points, upload_viewpoints
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.correlator import Correlator, Pose
from sonarmap.kernels.pomf.spectrum import Pomf
from sonarmap.kernels.so3.correlation import RotationCorrelation
from sonarmap.tools.lab.bench.case import BLUR, KernelCase
from sonarmap.tools.lab.bench.workload import BANDWIDTH, R, Workload

# Rotation angle of the z axis by roll and pitch of 35 degrees [rad]
_LARGEST = float(np.arccos(np.cos(np.deg2rad(35)) ** 2))
_REACH = 1.5  # tolerance of ranges at the sensor [voxels]
_SLOPE = 0.03  # its growth per voxel of range


def correlate_rotations_case(w: Workload) -> KernelCase:
    correlation = RotationCorrelation(w.device, BANDWIDTH, _LARGEST)
    edge = correlation.edge
    target, source = (w.upload(coefficients) for coefficients in w.coefficients)
    images, degrees = len(correlation.betas) + 1, np.arange(0, BANDWIDTH, 2)
    table = 4 * len(correlation.betas) * int(((2 * degrees + 1) * (degrees + 1)).sum())
    half, volume = 8 * images * edge * (edge // 2 + 1), 4 * images * edge**2
    return KernelCase(
        "RotationCorrelation",
        2 * target.nbytes + table + 4 * half + volume,
        run=lambda: correlation.correlate(target, source),
    )


def rotation_peaks_case(w: Workload) -> KernelCase:
    correlation = RotationCorrelation(w.device, BANDWIDTH, _LARGEST)
    target, source = (w.upload(coefficients) for coefficients in w.coefficients)
    values = correlation.correlate(target, source)
    return KernelCase("RotationCorrelation.peaks", values.nbytes, run=lambda: correlation.peaks(values))


def agreement_case(w: Workload) -> KernelCase:
    R, t = w.poses
    poses, center = upload_poses(w.device, R, t), upload_viewpoints(w.device, np.zeros((1, 3)))
    viewing = Viewing(w.upload(w.view[None]), center, upload_points(w.device, w.seen))
    return KernelCase(
        "agreement",
        w.view.nbytes + w.seen.nbytes + len(w.poses[0]) * 19 * 4,
        run=lambda: agreement(w.device, [viewing], poses, [(_REACH, _SLOPE)]).read(),
    )


def find_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    return KernelCase(
        "Correlator.find",
        w.points.nbytes + 5 * w.half_bytes + w.volume_bytes,
        run=lambda: correlator.find(points, [Pose(R)], [target], 1, 3.0),
    )


def near_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    shift = np.zeros((1, 3), np.int64)
    return KernelCase(
        "Correlator.near",
        w.points.nbytes + 3 * w.half_bytes,
        run=lambda: correlator.near(points, [Pose(R)], [target], shift).read(),
    )


def _given(w: Workload) -> tuple[Correlator, Any, Any]:
    """A correlator, and the points and their whitened spectrum under `R` on the device."""
    points = w.upload(w.points)
    target = Pomf(w.device, (w.edge,) * 3).prepare(voxelize(w.device, points, w.edge, R))
    return Correlator(w.device, w.edge, BLUR), points, target
