"""Surfaces of points on the default device."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.surface.cells import sort_into_cells
from sonarmap.spectral.prepare.surface import Surface, smooth_surface


@cache
def chosen_device() -> Device:
    return choose_device()


def surface_of(points: np.ndarray, viewpoints: Sequence[np.ndarray] = ()) -> Surface:
    device = chosen_device()
    return smooth_surface(device, sort_into_cells(device, points), viewpoints).read()
