"""Fourier transforms of three-dimensional arrays on a device, in single precision."""

from typing import Literal

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from kernels import fft_cpu, fft_gpu
from kernels.device import Device
from kernels.errors import InputError
from kernels.fft_plan import Layout

Flavor = Literal["cpu", "gpu"]


class _Transform:
    """The kernels of one direction, built once."""

    def __init__(self, device: Device, layout: Layout, inverse: bool, flavor: Flavor | None) -> None:
        cpu = device.is_cpu if flavor is None else flavor == "cpu"
        plan = (fft_cpu if cpu else fft_gpu).emit(layout, inverse)
        program = device.build(plan.source, name="fft")
        self._queue = device.queue
        self._launches = [
            (cl.Kernel(program, step.kernel), (step.groups * step.group_size,), (step.group_size,))
            for step in plan.passes
        ]

    def __call__(self, *arrays: cla.Array) -> None:
        buffers: list = [array.data for array in arrays]
        for kernel, size, group in self._launches:
            kernel.set_args(*buffers)
            cl.enqueue_nd_range_kernel(self._queue, kernel, size, group)


class RealFFT:
    """Real to complex transforms, over all three axes or, batched, over the last two.

    Signs and scales are NumPy's (`rfftn`, `irfftn`): forward is unscaled, inverse divides by the number of
    transformed points. Work is queued in order; nothing waits.

    Attributes:
        shape: of the real array, float32, dense.
        half_shape: of its spectrum, complex64, (n0, n1, n2 / 2 + 8): [..., :n2 / 2 + 1] is valid and the
            rest of each row padding.
    """

    def __init__(
        self,
        device: Device,
        shape: tuple[int, int, int],
        batched: bool = False,
        flavor: Flavor | None = None,
    ) -> None:
        """Build the kernels.

        Args:
            device: what to run on.
            shape: edges; a transformed one is a power of two from 16 to 512.
            batched: transform axes 1 and 2 only; axis 0 may then have any length.
            flavor: how the kernels are written; None: as suits the device.

        Raises:
            InputError: an edge has no transform.
        """
        layout = Layout(shape, real=True, batched=batched)
        self.shape, self.half_shape = layout.shape, layout.spectrum_shape
        self._device = device
        self._forward = _Transform(device, layout, False, flavor)
        self._inverse = _Transform(device, layout, True, flavor)

    def forward(self, volume: cla.Array, out: cla.Array | None = None) -> cla.Array:
        """The half spectrum of a real array, which is left untouched.

        Args:
            volume: float32 of `shape`.
            out: complex64 of `half_shape` to write to; None: a new one, whose first touch can take
                longer than the transform.

        Raises:
            InputError: an array is not of that shape and type, or not dense.
            DeviceError: the device cannot hold the result.
        """
        _check("volume", volume, self.shape, np.float32)
        spectrum = self._device.empty(self.half_shape, np.complex64) if out is None else out
        _check("out", spectrum, self.half_shape, np.complex64)
        self._forward(volume, spectrum)
        return spectrum

    def inverse(self, spectrum: cla.Array, out: cla.Array | None = None) -> cla.Array:
        """The real array of a half spectrum, which is overwritten.

        Args:
            spectrum: complex64 of `half_shape`.
            out: float32 of `shape` to write to; None: a new one, as in `forward`.

        Raises:
            InputError: an array is not of that shape and type, or not dense.
            DeviceError: the device cannot hold the result.
        """
        _check("spectrum", spectrum, self.half_shape, np.complex64)
        volume = self._device.empty(self.shape, np.float32) if out is None else out
        _check("out", volume, self.shape, np.float32)
        self._inverse(volume, spectrum)
        return volume


class ComplexFFT:
    """Complex transforms in place, over all three axes or, batched, over the last two; see `RealFFT`.

    Attributes:
        shape: of the points transformed.
        padded_shape: of the array, complex64, (n0, n1, n2 + 8): [..., :n2] is valid and the rest padding.
    """

    def __init__(
        self,
        device: Device,
        shape: tuple[int, int, int],
        batched: bool = False,
        flavor: Flavor | None = None,
    ) -> None:
        """Build the kernels; arguments and errors are those of `RealFFT`."""
        layout = Layout(shape, real=False, batched=batched)
        self.shape, self.padded_shape = layout.shape, layout.spectrum_shape
        self._forward = _Transform(device, layout, False, flavor)
        self._inverse = _Transform(device, layout, True, flavor)

    def forward(self, array: cla.Array) -> cla.Array:
        """Replace an array, complex64 of `padded_shape`, by its spectrum, and return it."""
        _check("array", array, self.padded_shape, np.complex64)
        self._forward(array)
        return array

    def inverse(self, array: cla.Array) -> cla.Array:
        """Replace a spectrum, complex64 of `padded_shape`, by its array, and return it."""
        _check("array", array, self.padded_shape, np.complex64)
        self._inverse(array)
        return array


def _check(name: str, array: cla.Array, shape: tuple[int, ...], dtype: type) -> None:
    dense = array.flags.c_contiguous and array.offset == 0
    if array.shape != shape or array.dtype != dtype or not dense:
        given = f"{array.dtype} of shape {array.shape}" + (
            "" if dense else ", not dense from its buffer's start"
        )
        raise InputError(
            f"{name} is {given}; this transform takes a dense {np.dtype(dtype)} array of shape {shape}. "
            "Make one with Device.empty or Device.to_device."
        )
