# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
"""Sums over the points that two surfaces share, under many poses."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, require_array
from sonarmap.kernels.device.readback import Pending, Readback
from sonarmap.kernels.surface.cells import Elements

# Points that a work-item of a processor adds up; items of a group elsewhere, a point each.
_ITEM, _LANES = 32, 64


def shared_sums(
    device: Device,
    target: Elements,
    source: Elements,
    weights: tuple[cla.Array, cla.Array],
    poses: cla.Array,
    most: int,
    *,
    reach: float,
    covered: float,
    alike: float,
) -> Pending[np.ndarray]:
    """Queue what the points of each surface have near them on the other's.

    Args:
        weights: device (d,) float32 each, the target's and the source's, by the directions of their normals.
        poses: device (k, 16) float32, as `upload_poses` makes them.
        most: how many points of each are looked at, evenly.
        reach, covered: within which distances a point lies on the other surface, and is covered by it.
        alike: least cosine of the normals of points that agree.

    Returns:
        (k, 2, 4) float64: of the source's points, then of the target's, the weights of those that agree, of those that
        are covered and of all, and the share of those that lie on the other surface.

    Raises:
        InputError: the poses have another shape.
    """
    count, _ = require_array(poses, "poses", (None, 16))
    item, lanes = (_ITEM, 1) if device.is_cpu else (1, _LANES)
    thinned = [surface.thinned(most) for surface in (target, source)]
    parts = -(-max(count for count, _ in thinned) // (item * lanes))
    out = device.empty((count, 2, parts, 4))
    ours, theirs = (
        (*surface.cells.arguments, surface.rows, weight, np.int32(few), np.int32(step))
        for surface, weight, (few, step) in zip((target, source), weights, thinned, strict=True)
    )
    size, group = (parts * lanes, count, 2), (lanes, 1, 1)
    defines = {"ITEM": item, "LANES": lanes, "REACH": float(reach), "COVERED": float(covered), "ALIKE": float(alike)}
    if count:
        launch(device, "surface/shared", "shared", size, *ours, *theirs, poses, out, group=group, **defines)
    copy, counts = Readback(device, out), (thinned[1][0], thinned[0][0])

    def read() -> np.ndarray:
        sums = copy.read().sum(axis=2, dtype=np.float64)
        sums[:, :, 3] /= counts
        return sums

    return Pending(read)
