"""Whitened spectra and magnitudes of a volume of points: the first step of preparing a scan."""

from collections.abc import Sequence

import numpy as np
import pyopencl as cl
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import affine_rows, enqueue, table, zero
from sonarmap.kernels.fft.edges import Layout
from sonarmap.kernels.fft.fused import emit_planes, emit_spectra, sheet_width
from sonarmap.kernels.fft.transform import RealFFT, column_lanes
from sonarmap.kernels.points.voxelize import voxelize, voxelize_poses
from sonarmap.kernels.pomf.spectrum import magnitude, whiten


class PointSpectra:
    """Transform of points to spectra, whitened with each of `exponents`; a CPU skips rows without points."""

    def __init__(
        self, device: Device, edge: int, exponents: tuple[float, ...] = (1.0,), magnitudes: bool = False
    ) -> None:
        """Build the kernels for volumes of `edge` voxels; with `magnitudes`, `transform` fills an array of them too."""
        self._device, self._edge, self.exponents, self._with_magnitudes = device, edge, exponents, magnitudes
        self._volume = device.to_device(np.zeros((1, edge, edge, edge), np.float32))
        # the fused passes need an edge that is a multiple of 8
        self._fft = None if device.is_cpu and edge % 8 == 0 else RealFFT(device, (edge, edge, edge))
        if self._fft is None:
            self._plan_sparse(Layout((edge, edge, edge)))

    def _plan_sparse(self, layout: Layout) -> None:
        """Plan the fused passes for a CPU, a work-item per plane or sheet; see `kernels.fft.fused`."""
        device, edge = self._device, self._edge
        self._sheet_count = edge // sheet_width(layout)
        self._marks = device.to_device(np.zeros((1, edge**2 // 8), np.int32))
        self._filled = device.empty((edge,), np.int32)
        pose = np.append(affine_rows(None, np.full(3, edge / 2 + 0.5)).ravel(), np.zeros(4))
        self._pose = table(device, pose[None].astype(np.float32))
        source = emit_spectra(layout, self.exponents, self._with_magnitudes, column_lanes(device))
        self._planes = cl.Kernel(device.build(emit_planes(layout), name="sparse"), "planes")
        self._sheets = cl.Kernel(device.build(source, name="spectra"), "sheets")
        self._clean = True  # so that a CPU needs no kernel to clear the volume

    def transform(self, points: cla.Array, out: Sequence[cla.Array], magnitudes: cla.Array | None = None) -> None:
        """Queue the transform of the points' volume.

        Args:
            points: (n, 4) float32, as in `voxelize`.
            out: (edge, edge, `row_pitch(edge)`) complex64 for each exponent, filled with the whitened half spectrum.
            magnitudes: (edge, edge, edge/2 + 1) float32, filled as by `magnitude`; only if planned.
        """
        if self._fft is None:
            self._transform_sparse(points, out, magnitudes)
            return
        spectrum = self._fft.forward(voxelize(self._device, points, self._edge, out=self._volume[0]), out=out[0])
        if magnitudes is not None:
            magnitude(self._device, spectrum, self._edge, out=magnitudes)
        # in reverse, because the first exponent's result overwrites the spectrum
        for exponent, whitened in reversed(list(zip(self.exponents, out, strict=True))):
            whiten(self._device, spectrum, exponent, out=whitened)

    def _transform_sparse(self, points: cla.Array, out: Sequence[cla.Array], magnitudes: cla.Array | None) -> None:
        """Queue the fused passes, which leave the volume empty."""
        if not self._clean:
            zero(self._device, self._volume)
            zero(self._device, self._marks)
        self._clean = False
        voxelize_poses(self._device, points, self._volume, self._marks, self._pose, 0, 1)
        arrays = self._volume, self._marks, self._filled, out[0]
        enqueue(self._device, self._planes, (self._edge,), *arrays, group=(1,))
        arrays = out[0], self._filled, *out[1:], *(() if magnitudes is None else (magnitudes,))
        enqueue(self._device, self._sheets, (self._sheet_count,), *arrays, group=(1,))
        self._clean = True
