"""Seeded random input of the kernels for grids of one size."""

from functools import cached_property
from typing import Any

import numpy as np
import scipy.fft
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.fft.edges import row_pitch

# A rotation about an axis that is none of the grid
R: np.ndarray = Rotation.from_euler("ZYX", [31, -12, 7], degrees=True).as_matrix()
# A small error of a pose, as at the start of a refinement
SMALL_TURN: np.ndarray = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix()
SMALL_SHIFT = np.array([0.4, -0.7, 0.3])  # [voxels]
_LAYERS = (0.2, 0.8)  # range of the layers' radii over N/2 (paper Sect. 2.8), with one layer per frequency bin
SHIFT = (3, -7, 5)  # between a source and its target [voxels]
BANDWIDTH = 48  # of the correlation over rotations in a registration, on any grid
SPHERES = 20  # number of its layers
_CELLS = 128  # per edge of a range image
_SEEN = 1500  # number of points that are compared with it
_POSES = 700  # number of poses at which they are compared
_POINTS = 256 * 192  # number of points of a sensor of 256 x 192 beams


class Workload:
    """Arrays on the host, each computed at its first use, and their upload; N is the number of voxels per edge."""

    def __init__(self, device: Device, edge: int, cores: int, seed: int) -> None:
        self.device, self.edge, self.cores, self._seed = device, edge, cores, seed
        self.volume_bytes, self.half_bytes = 4 * edge**3, 8 * edge**2 * (edge // 2 + 1)

    def rng(self, stream: int) -> np.random.Generator:
        """A random generator that depends only on the seed, the edge and `stream`."""
        return np.random.default_rng([self._seed, self.edge, stream])

    @cached_property
    def volume(self) -> np.ndarray:
        """(N, N, N) float32, standard normal."""
        return self.rng(0).standard_normal((self.edge,) * 3, dtype=np.float32)

    @cached_property
    def spectrum(self) -> np.ndarray:
        """(N, N, N/2 + 1) complex64, the half spectrum of the volume."""
        return np.asarray(scipy.fft.rfftn(self.volume, workers=self.cores))

    @cached_property
    def shifted(self) -> np.ndarray:
        """(N, N, N) float32, the volume shifted by SHIFT, plus noise."""
        noise = self.rng(1).standard_normal(self.volume.shape, dtype=np.float32)
        return np.roll(self.volume, SHIFT, axis=(0, 1, 2)) + noise

    @cached_property
    def radii(self) -> np.ndarray:
        """(L,) float32 [frequency bins]: 0.2..0.8 N/2, one layer per bin."""
        return np.arange(_LAYERS[0] * self.edge / 2, _LAYERS[1] * self.edge / 2, dtype=np.float32)

    @cached_property
    def layers(self) -> np.ndarray:
        """(L, N, N) float32, positive, as magnitudes are."""
        return self.rng(2).random((len(self.radii), self.edge, self.edge), dtype=np.float32) + np.float32(0.5)

    @cached_property
    def points(self) -> np.ndarray:
        """(n, 4) float32: points [voxels from the center] and weights; under `R` all of them lie in the grid."""
        rng = self.rng(3)
        voxels = rng.integers(0, self.edge, (_POINTS, 3)) - self.edge // 2
        turned = voxels + rng.uniform(-0.45, 0.45, (_POINTS, 3))
        return np.column_stack([turned @ R, rng.uniform(0.1, 1.0, _POINTS)]).astype(np.float32)

    @cached_property
    def surface(self) -> np.ndarray:
        """(m, 3) float32: a noisy hilly bed, at most one point per voxel and N^2 / 2 points [voxels]."""
        rng = self.rng(8)
        x, y = rng.uniform(-0.4 * self.edge, 0.4 * self.edge, (2, self.edge**2 // 2))
        waves = 20.0 / self.edge
        z = 0.06 * self.edge * (np.sin(waves * x) + np.cos(0.7 * waves * y)) + rng.normal(0, 0.4, len(x))
        points = np.column_stack([x, y, z])
        first = np.unique(np.floor(points), axis=0, return_index=True)[1]
        return points[np.sort(first)].astype(np.float32)

    @cached_property
    def coefficients(self) -> tuple[np.ndarray, np.ndarray]:
        """(BANDWIDTH / 2, SPHERES, 2 BANDWIDTH - 1) complex64: coefficients of real layers of target and source."""
        rng, orders = self.rng(4), np.arange(1 - BANDWIDTH, BANDWIDTH)
        normal = rng.standard_normal((2, BANDWIDTH // 2, SPHERES, len(orders), 2), dtype=np.float32)
        half = normal @ np.array([1, 1j], np.complex64)
        half *= np.abs(orders) <= 2 * np.arange(BANDWIDTH // 2)[:, None, None]
        # a[l, -m] = (-1)^m conj(a[l, m])
        both = half + (-1.0) ** np.abs(orders).astype(np.float32) * half[..., ::-1].conj()
        target, source = both.astype(np.complex64)
        return target, source

    @cached_property
    def view(self) -> np.ndarray:
        """(cells, cells, 2) float32: nearest and farthest range per cell [voxels]; a third of the cells is unseen."""
        rng = self.rng(5)
        near = rng.uniform(0.2, 0.4, (_CELLS, _CELLS)) * self.edge
        view = np.stack([near, near + rng.uniform(0, 4, near.shape)], axis=-1)
        view[rng.random(near.shape) < 1 / 3] = np.inf, -np.inf
        return view.astype(np.float32)

    @cached_property
    def seen(self) -> np.ndarray:
        """(n, 3) float32: points that are compared with the view [voxels]."""
        return self.rng(6).uniform(-0.4 * self.edge, 0.4 * self.edge, (_SEEN, 3)).astype(np.float32)

    @cached_property
    def poses(self) -> tuple[np.ndarray, np.ndarray]:
        """(m, 3, 3) rotations and (m, 3) shifts [voxels]."""
        rng = self.rng(7)
        return Rotation.random(_POSES, rng=rng).as_matrix(), rng.uniform(-0.2, 0.2, (_POSES, 3)) * self.edge

    def upload(self, array: np.ndarray) -> Any:
        """Copy an array to the device."""
        return self.device.to_device(array)

    def upload_half(self, spectrum: np.ndarray) -> Any:
        """Copy a half spectrum (..., N/2 + 1) to the device, with the padding of the kernels."""
        return self.upload(self.pad(spectrum))

    @staticmethod
    def pad(spectrum: np.ndarray) -> np.ndarray:
        """Pad a half spectrum (..., N/2 + 1) as the kernels do, to (..., `row_pitch(N)`)."""
        valid = spectrum.shape[-1]
        return np.pad(spectrum, [(0, 0)] * (spectrum.ndim - 1) + [(0, row_pitch(2 * valid - 2) - valid)])
