"""How much device memory a registration needs, by either method, known before anything is allocated.

A plan is a sum of terms, each named for what holds it: whoever changes an array changes its term, and
tests/spectral/test_memory.py, which counts what is really allocated, says by how much a plan is off, and where.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import DeviceError
from sonarmap.kernels.fft.edges import EDGES, row_pitch
from sonarmap.kernels.pomf.correlator import at_once
from sonarmap.spectral.grid import coarse_edge, image_edge, second_edge

Method = Literal["spectral", "hemisphere"]

# Points of a scan that are reckoned with, of 16 bytes each.
POINTS = 200_000
# Of the search over all rotations, as `spectral.so3` and `kernels.so3.correlation` have them.
_BANDWIDTH, _SPHERES, _ROTATION_EDGE = 48, 20, 128
# Parts of the layers that are searched by, and layers of them and of the whole together.
_BANDS, _LAYERS = 3, 49
# The cells along each edge of a scan's range image.
_VIEW = 128
# Bytes that a point of a surface takes among the cells that it is searched in, and all pairs of a refinement.
_CELLS, _REFINEMENT = 24, 2**21


@dataclass(frozen=True, slots=True)
class MemoryPlan:
    """The arrays of one method on one grid."""

    edge: int  # voxels along each edge of the grid
    prepared: Mapping[str, int]  # of one prepared scan, by what they are [bytes]
    shared: Mapping[str, int]  # what all pairs of one registrar share, likewise
    # what exists only while a scan is prepared, likewise
    preparing: Mapping[str, int] = field(default_factory=dict[str, int])
    # what exists only while a pair is registered, likewise
    registering: Mapping[str, int] = field(default_factory=dict[str, int])
    largest: int = 0  # the largest single array [bytes]

    @property
    def scan(self) -> int:
        """One prepared scan [bytes]."""
        return sum(self.prepared.values())

    @property
    def scratch(self) -> int:
        """All that is needed beside prepared scans [bytes]."""
        return sum(self.shared.values()) + max(sum(self.preparing.values()), sum(self.registering.values()))

    @property
    def pair(self) -> int:
        """All arrays that exist at once while a pair is prepared and registered [bytes]."""
        return 2 * self.scan + self.scratch

    def terms(self) -> dict[str, int]:
        """What a pair takes, by what it is [bytes]; the terms' sum is `pair`."""
        passing = max((self.preparing, self.registering), key=lambda terms: sum(terms.values()))
        scans = {f"two scans: {name}": 2 * size for name, size in self.prepared.items()}
        return {**scans, **self.shared, **passing}


def memory_plan(edge: int, method: Method = "spectral", points: int = POINTS, max_tilt: float = np.pi) -> MemoryPlan:
    """What a method allocates on a grid of `edge` voxels along each edge, for scans of so many points.

    Its tables of rotations grow with the largest roll and pitch [rad]; "hemisphere", the paper's own, has none.
    """
    if method == "hemisphere":
        return _hemisphere(edge, points)
    plan = _spectral(edge, points, max_tilt)
    if (second := second_edge(edge)) is None:
        return plan
    other = memory_plan(second, method, points, max_tilt)
    return replace(
        plan,
        prepared={**plan.prepared, "second look, on a coarser grid": other.scan},
        shared={**plan.shared, "second look: all that is shared": sum(other.shared.values())},
    )


def memory_plans(edge: int) -> tuple[MemoryPlan, MemoryPlan]:
    """Of both methods."""
    return memory_plan(edge, "spectral"), memory_plan(edge, "hemisphere")


def require_memory(device: Device, plan: MemoryPlan) -> None:
    """Refuse a grid that the device cannot hold together with two prepared scans.

    Raises:
        DeviceError: saying how much is needed, and which grid would fit by the method that needs more.
    """
    smaller = [edge for edge in reversed(EDGES) if edge < plan.edge and edge % 8 == 0]
    fitting = next((edge for edge in smaller if _fits(device, edge)), None)
    device.require(plan.largest, plan.pair, hint=f"`edge={fitting}`" if fitting else "another device")


def largest_edge(device: Device) -> int | None:
    """The largest grid that the device can hold with two prepared scans, by either method; None where none fits."""
    return next((edge for edge in reversed(EDGES) if _fits(device, edge)), None)


def scans_that_fit(device: Device, edge: int) -> int:
    """How many prepared scans the device can hold beside what a pair needs, by the method that needs more."""
    return min(max(0, device.memory - plan.scratch) // plan.scan for plan in memory_plans(edge))


def prepared_size(edge: int) -> int:
    """What a prepared scan takes, by the method that needs more [bytes]."""
    return max(plan.scan for plan in memory_plans(edge))


def _fits(device: Device, edge: int) -> bool:
    try:
        for plan in memory_plans(edge):
            device.require(plan.largest, plan.pair, hint="")
    except DeviceError:
        return False
    return True


def _spectral(edge: int, points: int, max_tilt: float) -> MemoryPlan:
    coarse, surface = coarse_edge(edge), min(points, edge**2)
    prepared = {
        "points, on both grids": 2 * 16 * points,
        "spectrum": _half_spectrum(edge),
        "coarse spectra, two whitenings": 2 * _half_spectrum(coarse),
        "layers' harmonics": 8 * (_BANDWIDTH // 2) * _LAYERS * (2 * _BANDWIDTH - 1),
        "range image": 8 * _VIEW**2,
        "surface, its points and its cells": surface * (48 + 2 * (16 + _CELLS)),
    }
    shared = {
        "preparing: volume": _volume(edge),
        "preparing: coarse volume": _volume(coarse),
        "translation": _correlator(edge, 1),
        "coarse translation": _correlator(coarse, 2),
    } | _rotation_tables(edge, max_tilt)
    preparing = {
        "preparing: magnitudes": _magnitude(edge),
        "preparing: waves on the sphere": 4 * 2 * _SPHERES * _latitudes(edge) * _BANDWIDTH,
    }
    registering = {"refinement: pairs of points": _REFINEMENT}
    correlations = (exponents * at_once(n) * _half_spectrum(n) for n, exponents in ((edge, 1), (coarse, 2)))
    largest = max(shared["rotations: d-matrices"], *correlations)
    return MemoryPlan(edge, prepared, shared, preparing=preparing, registering=registering, largest=largest)


def _rotation_tables(edge: int, max_tilt: float) -> dict[str, int]:
    """The search over all rotations up to a tilt: its time and memory grow with the angles that the z axis reaches."""
    farthest = np.arccos(np.cos(max_tilt) ** 2) if max_tilt < np.pi / 2 else max_tilt
    betas = min(int(np.ceil(farthest * 2 * _BANDWIDTH / np.pi - 0.5)) + 1, 2 * _BANDWIDTH)
    orders, n = 2 * _BANDWIDTH - 1, _ROTATION_EDGE
    return {
        "rotations: d-matrices": 4 * (_BANDWIDTH // 2) * betas * orders * _BANDWIDTH,
        "rotations: products": 8 * _BANDS * orders * _BANDWIDTH * (_BANDWIDTH // 2),
        "rotations: spectra": 8 * _BANDS * (betas + 1) * n * row_pitch(n),
        "rotations: correlations": 4 * _BANDS * (betas + 1) * n * n,
        "rotations: peaks": 4 * _BANDS * 32 * (1 + 4 * n * betas),
        "rotations: Legendre functions": 4 * _BANDWIDTH * (_BANDWIDTH // 2) * _latitudes(edge),
    }


def _correlator(edge: int, exponents: int) -> int:
    """Volumes, spectra and correlations of a `Correlator`; maxima of rows, powers, and sums near a shift."""
    poses = at_once(edge)
    cubes = exponents * poses  # correlations that exist at once
    large = (poses + cubes) * _volume(edge) + cubes * _half_spectrum(edge)
    return large + 4 * cubes * edge**2 + poses * edge**2 // 2 + poses * 6 * _half_spectrum(edge) // edge


def _hemisphere(edge: int, points: int) -> MemoryPlan:
    layers, image = int(0.6 * edge / 2) + 1, image_edge(edge)
    wide, high = min(2 * image, 512), max(image // 2, 16)
    yaw = 8 * layers * high * row_pitch(wide)
    tilt = 8 * 2 * layers * image * row_pitch(image)
    heading = 8 * layers * max(image // 4, 16) * row_pitch(wide)
    prepared = {
        "points": 16 * points,
        "spectrum": _half_spectrum(edge),
        "magnitudes": _magnitude(edge),
        "layers' spectra: yaw": yaw,
        "layers' spectra: tilt": tilt,
        "layers' spectra: heading": heading,
    }
    shared = {
        "preparing: volume": _volume(edge),
        "translation": _correlator(edge, 1),
        "directions, masks": 12 * 3 * image**2 + 12 * image // 4 * wide + 4 * 2 * image**2,
    }
    stack = 4 * 2 * layers * image**2
    registering = {"tilt: turned layers, their spectra": stack + tilt}
    largest = max(at_once(edge) * _half_spectrum(edge), tilt)
    return MemoryPlan(edge, prepared, shared, registering=registering, largest=largest)


def _volume(edge: int) -> int:
    return 4 * edge**3


def _magnitude(edge: int) -> int:
    return 4 * edge**2 * (edge // 2 + 1)


def _half_spectrum(edge: int) -> int:
    return 8 * edge**2 * row_pitch(edge)


def _latitudes(edge: int) -> int:
    """That the layers are sampled at."""
    return max(2 * _BANDWIDTH, -(-3 * edge // 64) * 16)
