"""Passes from sparse volumes to correlations and the maxima of their rows: fused on a CPU, one by one on a GPU.

Arrays: volumes (count, n, n, n) float32 with marks (count, n^2 / 8) int32, as `voxelize_poses` fills them; spectra
(exponents, count, n, n, `row_pitch(n)`) complex64, of which `forward` fills the first exponent's; correlations
(exponents, count, n, n, n) float32.
"""

from collections.abc import Sequence

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import enqueue, launch, table
from sonarmap.kernels.fft import fused
from sonarmap.kernels.fft.edges import Layout, row_pitch
from sonarmap.kernels.fft.fused import emit_planes, sheet_width
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.pomf.spectrum import full_gain, half_gain, half_weights

_WIDTH = 64  # work-items of a group on a GPU


class _Tables:
    """Gains, weights and roots of unity on the device, and a buffer for the sums of near.cl."""

    def __init__(self, device: Device, edge: int, blur: float, most: int) -> None:
        self._device, self._edge, self._pitch = device, edge, row_pitch(edge)
        along = full_gain(edge, blur)
        across = along[:, None] * half_gain(edge, blur)
        weights = np.broadcast_to(half_weights(edge), across.shape)
        turns = 2j * np.pi * np.arange(edge) / edge
        gains = table(device, np.stack([across, weights]).astype(np.float32)), table(device, along)
        self._gains, self._roots = gains, table(device, np.exp(turns).astype(np.complex64))
        self._sums = device.empty((most, 6, edge, self._pitch), np.complex64)

    def _sum_rows(self, place: np.ndarray, out: cla.Array, index: int, lanes: int, width: int) -> None:
        """Queue the sums along the second axis near a voxel (3,), from those along the first, into out[index]."""
        numbers = np.int32(place[1]), np.int32(self._edge), np.int32(self._pitch), np.int32(index)
        size, group = (-(-self._pitch // lanes // width) * width, 6), (width, 1) if width > 1 else None
        arrays = self._sums, self._roots, out
        launch(self._device, "pomf/near", "sum_rows", size, *arrays, *numbers, group=group, LANES=lanes)


class FusedPasses(_Tables):
    """Passes for a CPU: a work-item per plane or sheet; see `kernels.fft.fused`.

    Attributes:
        parts: number of partial sums of a correlation's power; energies are (exponents, count, parts + 1).
        clears: whether `forward` resets the volumes and the marks to 0.
    """

    clears = True

    def __init__(self, device: Device, edge: int, blur: float, exponents: tuple[float, ...], most: int) -> None:
        super().__init__(device, edge, blur, most)
        layout = Layout((edge, edge, edge))
        self._exponents, self.parts = len(exponents), edge // sheet_width(layout)
        # which planes of the volumes hold points
        self._filled = device.empty((most, edge), np.int32)
        program = device.build(fused.emit_correlation(layout, exponents), name="fused")
        self._planes = cl.Kernel(device.build(emit_planes(layout), name="sparse"), "planes")
        self._correlate, self._near = cl.Kernel(program, "correlate"), cl.Kernel(program, "near")
        self._back = cl.Kernel(program, "planes")

    def forward(self, volumes: cla.Array, marks: cla.Array, spectra: cla.Array, count: int) -> None:
        """Transform the volumes; fused passes leave the first axis to `correlate` or `near`."""
        self._launch(self._planes, count * self._edge, volumes, marks, self._filled, spectra)

    def correlate(self, spectra: cla.Array, targets: Sequence[cla.Array], energies: cla.Array, count: int) -> None:
        """Whiten, multiply by the targets and the gains; fused passes also transform the first axis back."""
        arrays = spectra, self._filled, *targets, *self._gains, energies
        self._launch(self._correlate, count * self.parts, *arrays, np.int32(count))

    def inverse(
        self, correlations: cla.Array, spectra: cla.Array, tops: cla.Array, poses: cla.Array, count: int, first: int
    ) -> None:
        """Transform the correlations back as far as the poses' limits require, and store the maxima of their rows."""
        planes = count * self._edge * self._exponents
        self._launch(self._back, planes, correlations, spectra, tops, poses, np.int32(count), np.int32(first))

    def near(
        self, spectra: cla.Array, number: int, target: cla.Array, place: np.ndarray, out: cla.Array, index: int
    ) -> None:
        """Queue near.cl's sums for the correlation of spectrum `number` near a voxel (3,), into out[index]."""
        arrays = spectra, self._filled, target, *self._gains, self._roots
        self._launch(self._near, self.parts, *arrays, np.int32(place[0]), np.int32(number), self._sums)
        self._sum_rows(place, out, index, 8, 1)

    def _launch(self, kernel: cl.Kernel, items: int, *arguments: cla.Array | np.generic) -> None:
        enqueue(self._device, kernel, (items,), *arguments, group=(1,))


class SinglePasses(_Tables):
    """Passes for a GPU: a work-item per number or column, so that adjacent work-items read adjacent memory."""

    clears = False

    def __init__(self, device: Device, edge: int, blur: float, exponents: tuple[float, ...], most: int) -> None:
        super().__init__(device, edge, blur, most)
        self._exponents, self.parts = exponents, edge * edge
        self._fft = RealFFT(device, (edge, edge, edge))

    def forward(self, volumes: cla.Array, marks: cla.Array, spectra: cla.Array, count: int) -> None:
        for n in range(count):
            self._fft.forward(volumes[n], out=spectra[n])

    def correlate(self, spectra: cla.Array, targets: Sequence[cla.Array], energies: cla.Array, count: int) -> None:
        # in reverse, because the first exponent's product overwrites the source's spectrum
        for e in reversed(range(len(self._exponents))):
            for n in range(count):
                arrays = spectra, targets[e], spectra, *self._gains, energies
                numbers = np.int32(self._edge), np.int32(self._pitch), np.float32(self._exponents[e])
                launch(
                    self._device, "pomf/product", "product", (self._edge**2 * _WIDTH,), *arrays, *numbers,
                    np.int32(n), np.int32(e * count + n), group=(_WIDTH,), WIDTH=_WIDTH,
                )  # fmt: skip

    def inverse(
        self, correlations: cla.Array, spectra: cla.Array, tops: cla.Array, poses: cla.Array, count: int, first: int
    ) -> None:
        cubes, edge = len(self._exponents) * count, self._edge
        for c in range(cubes):
            self._fft.inverse(spectra[c], out=correlations[c])
        launch(
            self._device, "pomf/choose", "row_maxima", (cubes * edge**2 * _WIDTH,), correlations, tops, poses,
            np.int32(count), np.int32(first), np.int32(edge), group=(_WIDTH,), WIDTH=_WIDTH,
        )  # fmt: skip

    def near(
        self, spectra: cla.Array, number: int, target: cla.Array, place: np.ndarray, out: cla.Array, index: int
    ) -> None:
        columns = self._edge * self._pitch
        groups = -(-columns // _WIDTH)
        launch(
            self._device, "pomf/near", "sum_columns", (groups * _WIDTH,), spectra, target, *self._gains, self._roots,
            np.int32(place[0]), self._sums, np.int32(self._edge), np.int32(columns),
            np.float32(self._exponents[0]), np.int32(number), group=(_WIDTH,), LANES=1,
        )  # fmt: skip
        self._sum_rows(place, out, index, 1, _WIDTH)


Passes = FusedPasses | SinglePasses


def make_passes(device: Device, edge: int, blur: float, exponents: tuple[float, ...], most: int) -> Passes:
    """Passes for this device and batches of `most` volumes; fused ones need an edge that is a multiple of 8."""
    passes = FusedPasses if device.is_cpu and edge % 8 == 0 else SinglePasses
    return passes(device, edge, blur, exponents, most)
