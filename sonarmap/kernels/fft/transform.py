"""Fourier transforms of three-dimensional arrays on a device, in single precision."""

from functools import cached_property
from typing import Any

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import begin_of, memory_of, output, require_array, table
from sonarmap.kernels.fft import cpu as fft_cpu
from sonarmap.kernels.fft import gpu as fft_gpu
from sonarmap.kernels.fft.edges import Layout


class _Transform:
    def __init__(self, device: Device, layout: Layout, inverse: bool) -> None:
        plan = fft_cpu.emit(layout, inverse, column_lanes(device)) if device.is_cpu else fft_gpu.emit(layout, inverse)
        program = device.build(plan.source, name="fft")
        self._device = device
        self._tables = () if plan.table is None else (table(device, plan.table),)
        # declared types save PyOpenCL an inspection of each argument
        types = [None, None, np.uint64, np.uint64, *(None for _ in self._tables)]
        self._launches = [
            (cl.Kernel(program, step.kernel), (step.groups * step.group_size,), (step.group_size,))
            for step in plan.passes
        ]
        for kernel, _, _ in self._launches:
            kernel.set_scalar_arg_dtypes(types)

    def __call__(self, *arrays: cla.Array) -> None:
        begins = map(begin_of, arrays)
        buffers: list[Any] = [*map(memory_of, arrays), *begins, *map(memory_of, self._tables)]
        with self._device.explain_full_memory():
            for kernel, size, group in self._launches:
                kernel.set_args(*buffers)
                cl.enqueue_nd_range_kernel(self._device.queue, kernel, size, group)


def column_lanes(device: Device) -> int:
    """Vector width along the first axis, as of a register: 8 or 16."""
    return 16 if device.cl_device.native_vector_width_float >= 16 else 8


class RealFFT:
    """Real to complex transforms, over all three axes or, batched, over the last two.

    Signs and scales are NumPy's (`rfftn`, `irfftn`): forward is unscaled, inverse divides by the number of
    transformed points. Calls queue work in order and do not wait for it.

    Attributes:
        shape: of the real array, float32.
        half_shape: of its spectrum, complex64, (n0, n1, `row_pitch(n2)`): [..., :n2 / 2 + 1] is valid and the
            rest of each row padding.
    """

    def __init__(self, device: Device, shape: tuple[int, int, int], batched: bool = False) -> None:
        """Plan the transforms; programs are built at first use. Edges have to be even products of 2, 3 and 5 from 16 to
        512; batched, axis 0 may have any length."""
        layout = Layout(shape, batched)
        self.shape, self.half_shape = layout.shape, layout.spectrum_shape
        self._device, self._layout = device, layout

    @cached_property
    def _forward(self) -> _Transform:
        return _Transform(self._device, self._layout, False)

    @cached_property
    def _inverse(self) -> _Transform:
        return _Transform(self._device, self._layout, True)

    def forward(self, volume: cla.Array, out: cla.Array | None = None) -> cla.Array:
        """The half spectrum of a real array, which is unchanged; in `out`, complex64 of `half_shape`, or a new array,
        whose first use can take longer than the transform."""
        require_array(volume, "volume", self.shape)
        spectrum = output(self._device, out, "out", self.half_shape, np.complex64)
        self._forward(volume, spectrum)
        return spectrum

    def inverse(self, spectrum: cla.Array, out: cla.Array | None = None) -> cla.Array:
        """The real array of a half spectrum, which is overwritten; in `out`, float32 of `shape`, or a new array."""
        require_array(spectrum, "spectrum", self.half_shape, np.complex64)
        volume = output(self._device, out, "out", self.shape)
        self._inverse(volume, spectrum)
        return volume
