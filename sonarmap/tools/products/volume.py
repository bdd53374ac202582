"""The volume between a map's surface and a plane, or that of another map, with its standard deviation.

Both surfaces are grids of one lattice, whose cells have heights as `products.export.grid` has them. Cut is what lies
above the target, plane or other map, and fill what is missing below it. Only cells that both have count; the area that
one alone has is said beside.

The error is that of the poses, and the scatter of the cells. A pose's error, small turn and shift, moves all points of
its scan together: its part of the volume is J C J', with J the sum over the points of the area they stand for, times
how the pose moves them upward. How the errors of two poses go together a map's folder does not say; their standard
deviations are added, which is the largest that they can be together. A cell's own sigma counts whole as scatter that
cells do not share, and so does how far all of its points are from its height: a wall or a stray echo makes a cell
unsure. For these errors sigma is too large rather than too small; docs/measured has what it was measured to be.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import upward
from sonarmap.tools.products.export.grid import Cells, cells_of, check_size, weight_of
from sonarmap.tools.products.section import PlacedMap

_MOST = 1e12  # cells along an edge: more than any grid may have


@dataclass(frozen=True, slots=True)
class Volume:
    """What has to be taken away and added to come from a map to its target."""

    # cut, fill, net (fill less cut): volume and its standard deviation [m^3]
    cut: tuple[float, float]
    fill: tuple[float, float]
    net: tuple[float, float]
    cell: float  # edge of a cell [m]
    # area that was compared, that the map alone has, and the target alone [m^2]
    compared: float
    map_only: float
    target_only: float

    @property
    def as_json(self) -> Mapping[str, float]:
        pairs = {"cut": self.cut, "fill": self.fill, "net": self.net}
        volumes = {f"{name}_m3": volume for name, (volume, _) in pairs.items()}
        volumes |= {f"{name}_sigma_m3": sigma for name, (_, sigma) in pairs.items()}
        areas = {"compared": self.compared, "map_only": self.map_only, "target_only": self.target_only}
        return volumes | {"cell_m": self.cell} | {f"area_{name}_m2": area for name, area in areas.items()}


def volume_to_level(placed: PlacedMap, level: float, cell: float, kind: str = "top") -> Volume:
    """From a map to the plane at a height [m], as `PlacedMap.heights` counts; `cell` is the edge of cells [m], `kind`
    what the height of a cell is, a name of `formats.HEIGHTS`."""
    lattice = _lattice(cell, placed.part.points)
    surface = _Surface.of(placed, placed.part.points[:, :2], cell, lattice, kind)
    area = cell**2 * len(surface.key)
    return _summed(level - surface.cells.height, [(surface, np.arange(len(surface.key)))], cell, (area, 0.0, 0.0))


def volume_between(first: PlacedMap, second: PlacedMap, cell: float, kind: str = "top") -> Volume:
    """From one map to another: cut is what was lost, fill what was gained. Where both lie on the Earth the second is
    brought to the first one's frame; otherwise both are in one."""
    points = second.part.points
    if first.georeference is not None and second.georeference is not None:
        one, other = first.georeference.vertical, second.georeference.vertical
        if one != other:
            raise InputError(
                f"heights of {first.path} count from {one!r}, those of {second.path} from {other!r}; wanted both from "
                "the same: map one again with --vertical"
            )
        points = first.georeference.local(second.georeference.geodetic(points))
    lattice = _lattice(cell, first.part.points, points)
    surfaces = (
        _Surface.of(first, first.part.points[:, :2], cell, lattice, kind),
        _Surface.of(second, points[:, :2], cell, lattice, kind),
    )
    _, *both = np.intersect1d(*(surface.key for surface in surfaces), assume_unique=True, return_indices=True)
    common = len(both[0])
    if not common:
        raise InputError(
            f"{first.path} and {second.path} have no cell of {cell:g} m in common; wanted maps of one place in one "
            "frame: check them, or give larger cells with --cell"
        )
    change = surfaces[1].cells.height[both[1]] - surfaces[0].cells.height[both[0]]
    areas = (common, *(len(surface.key) - common for surface in surfaces))
    chosen = list(zip(surfaces, both, strict=True))
    return _summed(change, chosen, cell, (cell**2 * areas[0], cell**2 * areas[1], cell**2 * areas[2]))


@dataclass(frozen=True, slots=True)
class _Surface:
    """A map's surface on the lattice, of K cells."""

    key: np.ndarray  # (K,) int64, the cell's number on the lattice, ascending
    cells: Cells
    spread: np.ndarray  # (K,) [m^2], mean square of how far all points of the cell are from its height
    # of the m points of the surface. cell: which; scan: which pose, as covariances has them; lever: (m, 6) what a small
    # (turn, shift) of the pose [rad, m] does to the cell's height [m]
    cell: np.ndarray
    scan: np.ndarray
    lever: np.ndarray
    covariances: np.ndarray  # (n, 6, 6)

    @classmethod
    def of(
        cls, placed: PlacedMap, flat: np.ndarray, cell: float, lattice: tuple[np.ndarray, int], kind: str
    ) -> "_Surface":
        """Of a map's points at x, y (M, 2) [m]; the lattice as `_lattice` has it."""
        column, row = (np.floor(flat / cell).astype(np.int64) - lattice[0]).T
        height, columns = placed.heights, placed.part.columns
        key, index, count = np.unique(row * lattice[1] + column, return_inverse=True, return_counts=True)
        highest = np.full(len(key), -np.inf)
        np.maximum.at(highest, index, height)
        below = {"top": placed.voxel, "mean": np.inf, "shoalest": 0.0}[kind]
        used = height >= highest[index] - below
        sure = columns["sigma"][used]
        cells = cells_of(kind, row[used], column[used], height[used], sure, columns["count"][used], placed.voxel)
        spread = np.bincount(index, (height - cells.height[index]) ** 2) / count
        own, weight = index[used], weight_of(sure)
        scan = np.searchsorted(placed.part.scans, columns["scan"][used])
        lever = upward(placed.part.trajectory.T_world_sensor[scan], placed.part.points[used])
        lever *= (weight / np.bincount(own, weight)[own])[:, None]
        return cls(key, cells, spread, own, scan, lever, placed.part.covariances)

    def variance(self, chosen: np.ndarray) -> float:
        """Of the sum of the heights of these cells, (k,) [m^2]."""
        used = np.zeros(len(self.key), bool)
        used[chosen] = True
        points = used[self.cell]
        J = np.zeros((len(self.covariances), 6))
        np.add.at(J, self.scan[points], self.lever[points])
        by_poses = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", J, self.covariances, J), 0.0)).sum()
        return float(by_poses**2 + (self.cells.sigma[chosen] ** 2 + self.spread[chosen]).sum())


def _lattice(cell: float, *points: np.ndarray) -> tuple[np.ndarray, int]:
    """The lowest cell (2,) and the number of columns of a lattice about all points; its edges are at multiples of a
    cell."""
    flat = np.concatenate([each[:, :2] for each in points])
    lower, upper = flat.min(axis=0), flat.max(axis=0)
    columns, rows = (int(min(extent / cell, _MOST)) + 1 for extent in (upper - lower).tolist())
    check_size(rows, columns, cell)
    low = np.floor(lower / cell).astype(np.int64)
    return low, int(np.floor(upper[0] / cell)) - int(low[0]) + 1


def _summed(
    change: np.ndarray, surfaces: list[tuple[_Surface, np.ndarray]], cell: float, areas: tuple[float, float, float]
) -> Volume:
    """Of the cells' changes of height (k,) [m], with the place (k,) of each in every surface."""

    def volume(chosen: np.ndarray) -> tuple[float, float]:
        variance = sum(surface.variance(places[chosen]) for surface, places in surfaces)
        return cell**2 * float(np.abs(change[chosen].sum())), cell**2 * float(np.sqrt(variance))

    cut, fill, every = volume(change < 0), volume(change > 0), volume(np.ones(len(change), bool))
    return Volume(cut, fill, (fill[0] - cut[0], every[1]), cell, *areas)
