"""The overlap of two surfaces under many poses."""

from dataclasses import asdict, dataclass

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.arrays import Pending, Readback
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array
from sonarmap.kernels.surface.cells import Elements

_ITEM = 32  # points of a work-item on a CPU
_LANES = 64  # work-items of a group on a GPU, each of one point


@dataclass(frozen=True, slots=True)
class WeightedElements:
    elements: Elements
    weights: cla.Array  # device (d,) float32, weight of a point by the direction of its normal


@dataclass(frozen=True, slots=True)
class Nearness:
    reach: float  # largest distance of a point that lies on the other surface
    covered: float  # largest distance of a point that the other surface covers
    alike: float  # least cosine between the normals of points that agree


def shared_sums(
    device: Device, target: WeightedElements, source: WeightedElements, poses: cla.Array, most: int, nearness: Nearness
) -> Pending[np.ndarray]:
    """Queue the overlap of two surfaces under k poses, by at most `most` points of each, evenly thinned.

    Returns (k, 2, 4) float64 of the source's points, then of the target's: total weight of those that agree, of those
    that are covered and of all, and the share of the points that lie on the other surface.
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
