# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
"""Poses of one scan relative to another as kernels take them, wherever they come from."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError


def upload_poses(device: Device, R: np.ndarray, t: np.ndarray) -> cla.Array:
    """Device (k, 16) float32, the rows of [R | t] in the first 12, p_target = R p_source + t.

    Args:
        R, t: (k, 3, 3) rotations and (k, 3) shifts [any length unit].

    Raises:
        InputError: a shape is another, or a number is not finite.
    """
    if R.shape != (len(R), 3, 3) or t.shape != (len(R), 3) or not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise InputError(f"`R` and `t` have shapes {R.shape} and {t.shape}; wanted finite (n, 3, 3) and (n, 3)")
    rows = np.zeros((len(R), 4, 4), np.float32)
    rows[:, :3, :3], rows[:, :3, 3] = R, t
    return device.to_device(rows.reshape(-1, 16))
