"""Poses of one scan relative to another, and places, as kernels take them, wherever they come from."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError


def upload_poses(device: Device, R: np.ndarray, t: np.ndarray) -> cla.Array:
    """Device (k, 16) float32, the rows of [R | t] in the first 12, p_target = R p_source + t.

    Args:
        R, t: (k, 3, 3) rotations and (k, 3) shifts [any length unit].
    """
    if R.shape != (len(R), 3, 3) or t.shape != (len(R), 3) or not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise InputError(f"`R` and `t` have shapes {R.shape} and {t.shape}; wanted finite (n, 3, 3) and (n, 3)")
    rows = np.zeros((len(R), 4, 4), np.float32)
    rows[:, :3, :3], rows[:, :3, 3] = R, t
    return device.to_device(rows.reshape(-1, 16))


def upload_places(device: Device, points: np.ndarray) -> cla.Array:
    """Points (n, 3) on the device, to be moved by poses: (n, 4) float32."""
    rows = np.zeros((len(points), 4), np.float32)
    rows[:, :3] = points
    return device.to_device(rows)


def require_places(places: np.ndarray, what: str) -> None:
    """Refuse what is not (n, 3) finite numbers."""
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise InputError(f"`{what}` have shape {places.shape}; wanted (n, 3), all of it finite numbers")
