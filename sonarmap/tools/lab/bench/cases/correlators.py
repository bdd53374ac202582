"""Points under a pose against a target: a whole correlation, and what it holds near one shift."""

from typing import Any

import numpy as np

from sonarmap.kernels.pomf.correlator import Correlator, Pose
from sonarmap.kernels.pomf.peak_fit import Peak
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import BLUR, KernelCase, half_bytes, transform_flops, volume_bytes
from sonarmap.tools.lab.bench.traffic import Traffic
from sonarmap.tools.lab.bench.workload import R, Workload

# Relative L2 difference: two transforms and a whitening, all in single precision on either side.
_TWICE_TRANSFORMED = 1e-4


def find_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    found: list[Peak] = []

    def run() -> None:
        (((peak,),),) = correlator.find(points, [Pose(R)], [target], 1, 3.0)
        found[:] = [peak]

    return KernelCase(
        "Correlator.find",
        "scipy.fft, NumPy, np.argmax",
        Traffic(w.points.nbytes + 2 * half_bytes(w), half_bytes(w) + volume_bytes(w), 2 * half_bytes(w)),
        _TWICE_TRANSFORMED,
        run=run,
        read=lambda: _numbers(found[0]),
        twin=lambda: twins.peak(_correlation(w)),
        flops=2 * transform_flops(w),
    )


def near_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    shift = np.array([w.shift])
    found: list[Peak] = []

    def run() -> None:
        found[:] = correlator.near(points, [Pose(R)], [target], shift).read()

    return KernelCase(
        "Correlator.near",
        "scipy.fft, NumPy, 27 voxels",
        Traffic(w.points.nbytes + 2 * half_bytes(w), half_bytes(w)),
        _TWICE_TRANSFORMED,
        run=run,
        read=lambda: _numbers(found[0]),
        twin=lambda: twins.peak(_correlation(w)),
        flops=transform_flops(w),
    )


def _given(w: Workload) -> tuple[Correlator, Any, Any]:
    """A correlator, the points and their target on the device."""
    return Correlator(w.device, w.edge, BLUR), w.upload(w.points), w.upload_half(w.shifted)


def _correlation(w: Workload) -> np.ndarray:
    """The correlation as NumPy and SciPy make it."""
    source = twins.prepare(twins.voxelize(w.points, R, np.empty_like(w.volume)), w.cores)
    return twins.correlate(w.shifted, source, BLUR, np.empty_like(w.spectrum), w.cores)


def _numbers(peak: Peak) -> np.ndarray:
    """As `twins.peak` has them."""
    return np.concatenate([peak.index, [peak.value, (peak.value - peak.mean) / peak.std], peak.neighborhood.ravel()])
