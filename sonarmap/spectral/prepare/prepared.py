"""A scan on the grid: its voxels and its spectra, computed once for all its pairs."""

from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sonarmap.kernels.device.arrays import recycled
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.pomf.point_spectra import PointSpectra
from sonarmap.kernels.surface.cells import Cells, sort_into_cells
from sonarmap.spectral.grid import Grid, scan_center
from sonarmap.spectral.memory import MemoryPlan, require_memory
from sonarmap.spectral.scan import Scan

_FEWEST_VOXELS = 20  # minimum number of occupied voxels
_LEAST_INSIDE = 0.5  # minimum share of a scan's points inside of the grid
_FLATTEST = 0.3  # minimum standard deviation of points from the best plane, else the scan is a plane [voxels]


@dataclass(frozen=True, slots=True)
class Prepared:
    """A scan on the grid, with its spectrum; its arrays are on the device that prepared it."""

    name: str  # of the scan
    center: np.ndarray  # (3,) the grid's center [m, sensor frame]
    points: Array  # device (n, 4) float32 [voxels from the center; weight]
    surface: np.ndarray  # (m, 3) float64 [voxels from the center], a point per occupied voxel, also outside the grid
    cells: Cells  # the surface on the device, sorted for search
    spectrum: Array  # device (N, N, `row_pitch(N)`) complex64, spectrum of the volume, phase only

    @property
    def spectra(self) -> tuple[Array, ...]:
        """The spectrum, as `Translation` takes it."""
        return (self.spectrum,)


class Preparer:
    """Prepares scans on one device and grid."""

    def __init__(self, device: Device, grid: Grid, use_strength: bool, centered: bool = True) -> None:
        """Plan the transform. Voxels hold echo strength or occupancy; the grid is `centered` on the scan or on the
        sensor."""
        self.device, self.grid, self.use_strength, self.centered = device, grid, use_strength, centered
        self._spectra = PointSpectra(device, grid.edge, magnitudes=True)

    def prepare(self, scan: Scan) -> tuple[Prepared, Array]:
        """Voxelize and transform one scan; the device may still be working on the result.

        The second result is its centered magnitude spectrum, device (N, N, N/2 + 1) float32, a temporary array.

        Raises:
            InputError: the scan has too few occupied voxels, or shows a single plane.
        """
        edge = self.grid.edge
        center = scan_center(scan) if self.centered else np.zeros(3)
        voxels = self.grid.to_voxels(scan.points, center)
        cells = np.floor(voxels + np.float32(edge / 2 + 0.5)).astype(np.int64)
        x, y, z = ((cells >= 0) & (cells < edge)).T
        inside = x & y & z
        if (share := float(inside.mean())) < _LEAST_INSIDE:
            raise InputError(
                f"{scan.name}: the grid of {edge} voxels of {self.grid.voxel:g} m holds {share:.1%} of its points; "
                f"wanted at least {_LEAST_INSIDE:.0%}. Give a larger `voxel`, a larger `edge`, or leave `voxel` out to "
                "have it chosen."
            )
        points = self.device.to_device(self._weighted(scan, voxels, inside))
        spectrum = recycled(self.device, (edge, edge, row_pitch(edge)), np.complex64)
        magnitude = recycled(self.device, (edge, edge, edge // 2 + 1))
        # the device transforms while the host works on the points
        self._spectra.transform(points, [spectrum], magnitude)
        surface = _one_per_voxel(voxels, cells)
        # a plane is useful if its rotation and depth are measured: it refines height and tilt
        prior = scan.prior
        held = prior is not None and prior.knows_attitude and prior.knows_heading and prior.knows_depth
        self._require_structure(scan.name, surface, plane_allowed=held)
        cells_of_surface = sort_into_cells(self.device, surface)
        return Prepared(scan.name, center, points, surface, cells_of_surface, spectrum), magnitude

    def _weighted(self, scan: Scan, voxels: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Points and weights (n, 4) float32: occupancy as in the paper, or echo strength if requested and present."""
        weight = np.ones(len(voxels), np.float32)
        if self.use_strength and scan.strength is not None:
            strongest = scan.strength[inside].max()
            weight = scan.strength / strongest if strongest > 0 else weight
        return np.column_stack([voxels, weight]).astype(np.float32)

    def _require_structure(self, name: str, surface: np.ndarray, plane_allowed: bool) -> None:
        size = f"grid of {self.grid.edge} voxels of {self.grid.voxel:.3g} m"
        if len(surface) < _FEWEST_VOXELS:
            raise InputError(
                f"{name}: its points fill {len(surface)} of the voxels, on a {size}; wanted at least {_FEWEST_VOXELS}. "
                "Give a scan with more structure, or a smaller `voxel`."
            )
        spread = np.sqrt(max(np.linalg.eigvalsh(np.cov(surface.T, bias=True))[0], 0.0))
        if spread < _FLATTEST and not plane_allowed:
            raise InputError(
                f"{name}: all its points lie in one plane (they deviate {spread * self.grid.voxel:.2g} m from it, "
                f"on a {size}): a shift along it cannot be seen. Give a scan with more structure, a smaller `voxel`, "
                "in which a low relief shows, or a prior with attitude, heading and depth."
            )


class GridRegistrar:
    """Base of registrars that prepare scans on a shared grid."""

    _preparer: Preparer

    def __init__(self, device: Device, grid: Grid, plan: MemoryPlan) -> None:
        """Require the memory of the plan; DeviceError if the device cannot hold it."""
        require_memory(device, plan)
        self.device, self.grid = device, grid

    def with_voxel(self, voxel: float) -> Self:
        """A registrar for another voxel [m] that shares tables and memory; only one of the two may work at a time."""
        other = copy(self)
        other.grid = replace(self.grid, voxel=voxel)
        other._preparer = copy(self._preparer)
        other._preparer.grid = other.grid
        return other


def _one_per_voxel(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Mean (m, 3) of the points of each occupied voxel, in the order of the voxels."""
    keys = ((cells[:, 0] << 42) + (cells[:, 1] << 21)) + cells[:, 2]  # cells are within a million of 0
    order = np.argsort(keys, kind="stable")  # points come in rows, whose runs a merge sort uses
    ordered = keys[order]
    voxel = np.empty(len(keys), np.int64)
    voxel[order] = np.cumsum(np.append(False, ordered[1:] != ordered[:-1]))
    sums = [np.bincount(voxel, points[:, axis]) for axis in range(3)]
    return np.column_stack(sums) / np.bincount(voxel)[:, None]
