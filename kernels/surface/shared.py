# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
"""Sums over the points that two surfaces share, under many poses."""

import numpy as np
import pyopencl.array as cla

from kernels.device.device import Device
from kernels.device.launch import launch
from kernels.surface.elements import Elements
from kernels.surface.nearest import pose_rows

# Points that a work-item of a processor adds up; items of a group elsewhere, a point each.
_ITEM, _LANES = 32, 64


def shared_sums(
    device: Device,
    target: Elements,
    source: Elements,
    weights: tuple[cla.Array, cla.Array],
    R: np.ndarray,
    t: np.ndarray,
    most: int,
    *,
    reach: float,
    covered: float,
    alike: float,
) -> np.ndarray:
    """What the points of each surface have near them on the other's.

    Args:
        weights: device (d,) float32 each, the target's and the source's, by the directions of their normals.
        R, t: (k, 3, 3) and (k, 3), p_target = R p_source + t.
        most: how many points of each are looked at, evenly.
        reach, covered: within which distances a point lies on the other surface, and is covered by it.
        alike: least cosine of the normals of points that agree.

    Returns:
        (k, 2, 4) float64: of the source's points, then of the target's, the weights of those that agree, of those that
        are covered and of all, and the share of those that lie on the other surface.

    Raises:
        InputError: a pose is not finite, or has another shape.
    """
    rows = pose_rows(R, t)
    if not len(rows):
        return np.zeros((0, 2, 4))
    item, lanes = (_ITEM, 1) if device.is_cpu else (1, _LANES)
    thinned = [surface.thinned(most) for surface in (target, source)]
    parts = -(-max(count for count, _ in thinned) // (item * lanes))
    out = device.empty((len(rows), 2, parts, 4))
    ours, theirs = (
        (*surface.cells.arguments, surface.rows, weight, np.int32(count), np.int32(step))
        for surface, weight, (count, step) in zip((target, source), weights, thinned, strict=True)
    )
    size, group = (parts * lanes, len(rows), 2), (lanes, 1, 1)
    defines = {"ITEM": item, "LANES": lanes, "REACH": float(reach), "COVERED": float(covered), "ALIKE": float(alike)}
    arguments = *ours, *theirs, device.to_device(rows), out
    launch(device, "surface/shared", "shared", size, *arguments, group=group, **defines)
    sums = out.get().sum(axis=2, dtype=np.float64)
    sums[:, :, 3] /= [thinned[1][0], thinned[0][0]]
    return sums
