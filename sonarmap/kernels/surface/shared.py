"""Sums over the points that two surfaces share, under many poses."""

from dataclasses import asdict, dataclass

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.arrays import Pending, Readback
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array
from sonarmap.kernels.surface.cells import Elements

_ITEM = 32  # points that a work-item of a processor adds up
_LANES = 64  # work-items of a group elsewhere, a point each


@dataclass(frozen=True, slots=True)
class WeightedElements:
    elements: Elements  # the points
    weights: cla.Array  # device (d,) float32, by the directions of their normals


@dataclass(frozen=True, slots=True)
class Nearness:
    reach: float  # within which distance it lies on that surface
    covered: float  # within which distance it is covered by it
    alike: float  # least cosine of the normals of points that agree


def shared_sums(
    device: Device, target: WeightedElements, source: WeightedElements, poses: cla.Array, most: int, nearness: Nearness
) -> Pending[np.ndarray]:
    """Queue what at most `most` points of each surface, evenly, have near them on the other's, under k poses.

    Returns (k, 2, 4) float64: of the source's points, then of the target's, the weights of those that agree, of those
    that are covered and of all, and the share of those that lie on the other surface.
    """
    count, _ = require_array(poses, "poses", (None, 16))
    item, lanes = (_ITEM, 1) if device.is_cpu else (1, _LANES)
    thinned = [surface.elements.thinned(most) for surface in (target, source)]
    parts = -(-max(count for count, _ in thinned) // (item * lanes))
    out = device.empty((count, 2, parts, 4))
    ours, theirs = (
        (*surface.elements.cells.arguments, surface.elements.rows, surface.weights, np.int32(few), np.int32(step))
        for surface, (few, step) in zip((target, source), thinned, strict=True)
    )
    size, group = (parts * lanes, count, 2), (lanes, 1, 1)
    defines = {name.upper(): float(limit) for name, limit in asdict(nearness).items()} | {"ITEM": item, "LANES": lanes}
    if count:
        launch(device, "surface/shared", "shared", size, *ours, *theirs, poses, out, group=group, **defines)
    copy, counts = Readback(device, out), (thinned[1][0], thinned[0][0])

    def read() -> np.ndarray:
        sums = copy.read().sum(axis=2, dtype=np.float64)
        sums[:, :, 3] /= counts
        return sums

    return Pending(read)
