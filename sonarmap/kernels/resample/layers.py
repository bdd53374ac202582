"""Layers of samples brought to zero mean and unit variance, so that each counts alike, then windowed."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.groups import along, team
from sonarmap.kernels.device.launch import launch, output, require_array, table
from sonarmap.kernels.errors import InputError


def normalize_layers(
    device: Device,
    stack: cla.Array,
    window: cla.Array | None,
    mask: cla.Array | None = None,
    out: cla.Array | None = None,
) -> cla.Array:
    """Every layer less its mean, over its standard deviation, times the window.

    Args:
        stack: (L, H, W) float32, finite where the mask is 1; W a multiple of 8.
        window: (H, W) float32, what the normalized layers are multiplied with; None for none.
        mask: (H, W) float32, 1 for the pixels that mean and deviation are taken over, 0 for those that
            become 0 (the zero vectors of an unwrap, `sphere.valid_pixels`); None: all count.
        out: (L, H, W) float32 to write to; may be the stack itself.

    Returns:
        (L, H, W) float32. A constant layer gives zeros.
    """
    layers, height, width = require_array(stack, "stack", (None, None, None))
    if width % 8:
        raise InputError(f"`stack` has layers {width} pixels wide; wanted a multiple of 8")
    if window is None or mask is None:
        ones = table(device, np.ones((height, width), np.float32))
        window, mask = ones if window is None else window, ones if mask is None else mask
    require_array(window, "window", (height, width))
    require_array(mask, "mask", (height, width))
    result = output(device, out, "out", (layers, height, width))
    rows, scales = device.empty((layers * height, 3)), device.empty((layers, 2))
    sizes = np.int32(height), np.int32(width)
    together = team(device)
    moments = (layers * height * together,), stack, mask, rows, *sizes
    launch(device, "resample/layers", "row_moments", *moments, group="sums")
    launch(device, "resample/layers", "layer_moments", (layers * together,), rows, scales, sizes[0], group="sums")
    size, arguments = (along(device, width), height, layers), (stack, mask, window, scales, result)
    launch(device, "resample/layers", "apply", size, *arguments, np.int32(layers), *sizes, group="rows")
    return result
