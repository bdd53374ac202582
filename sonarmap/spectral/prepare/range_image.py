"""Range images of a scan from its viewpoints, in which points in front of the surface contradict it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.device.arrays import Pending
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.points.visibility import Viewing, agreement, octahedral_cells, upload_points, upload_viewpoints

# Cells along an edge of a range image: 1.6 degrees, a voxel at a range of 36 voxels. Finer cells would have gaps.
_EDGE = 128
# Quantiles of the ranges of a cell for nearest and farthest, to leave out stray echoes.
_NEAR = 0.15
_FAR = 0.85
# A scan has a single viewpoint if this share of its points is near the median range of their cell.
SINGLE = 0.8
SPREAD = 2.0  # largest difference to the median [voxels]
SLOPE = 0.03  # increase of this difference, as a share of the range
_PLACES = 12  # largest number of viewpoints to use
_SAMPLE = 1500  # points of a scan that are compared with another's view
# Largest distance of a point from the surface [voxels; share of the range].
COARSE = (1.5, 0.03)  # while the rotation is 2 degrees off
FINE = (1.0, 0.01)  # after the refinement


@dataclass(frozen=True, slots=True)
class View:
    """Range images of a scan, and a sample of its points to compare with other views."""

    # (k, 3) float64 known positions of the sensor, relative to the grid's center [voxels]; none for a scan merged from
    # unknown viewpoints
    places: np.ndarray
    # device (k, _EDGE, _EDGE, 2) float32, nearest and farthest range of each cell of an octahedral map from each place
    # [voxels]; None without any
    ranges: Array | None
    viewpoints: Array | None  # device (k, 4) float32, the places in the layout of `upload_viewpoints`; None without any
    repeats: float  # mean number of places that a point of the scan is seen from
    sample: tuple[Array, int]  # points about the grid's center, on the device [voxels], and their number


def scan_view(device: Device, points: np.ndarray, surface: np.ndarray, viewpoints: np.ndarray) -> View:
    """The view of a scan with `points` (n, 3) and `surface` (m, 3), one per voxel, about the grid center [voxels].

    Viewpoints are (n, 3), the sensor's position for each point [voxels], or (3,), one for all. A single one is ignored
    if the points do not form a single layer as seen from it: the scan was then merged from several viewpoints.
    """
    if viewpoints.ndim == 1:
        ranges = _Ranges.of(points - viewpoints)
        images, repeats = [(viewpoints, ranges)] if ranges.are_single else [], 1.0
    else:
        images, repeats = _images(points, viewpoints)
    places = np.array([place for place, _ in images]).reshape(-1, 3)
    return View(
        places=places,
        ranges=device.to_device(np.stack([ranges.image() for _, ranges in images])) if images else None,
        viewpoints=upload_viewpoints(device, places) if images else None,
        repeats=repeats,
        sample=upload_points(device, surface[:: max(1, len(surface) // _SAMPLE)]),
    )


def _images(points: np.ndarray, viewpoints: np.ndarray) -> tuple[list[tuple[np.ndarray, "_Ranges"]], float]:
    """Places and ranges from some viewpoints, evenly along the path, and `View.repeats`."""
    cells = np.floor(viewpoints).astype(np.int64)
    _, first, place = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    along = np.argsort(first, kind="stable")
    chosen = along[np.linspace(0, len(along) - 1, min(len(along), _PLACES)).round().astype(np.int64)]
    images, seen = [], 0.0
    for number in chosen:
        from_here = place.ravel() == number
        viewpoint = viewpoints[from_here].mean(axis=0)
        ranges = _Ranges.of(points[from_here] - viewpoint)
        images.append((viewpoint, ranges))
        filled = np.zeros(_EDGE * _EDGE, dtype=bool)
        filled[ranges.cells] = True
        seen += float(filled[octahedral_cells(points - viewpoint, _EDGE)].mean())
    return images, max(seen, 1e-3)


@dataclass(frozen=True, slots=True)
class _Ranges:
    """Nearest and farthest range of (k,) cells, and whether the ranges form a single layer."""

    cells: np.ndarray
    near: np.ndarray
    far: np.ndarray
    are_single: bool

    @classmethod
    def of(cls, beams: np.ndarray) -> "_Ranges":
        """Ranges of beams (n, 3) [voxels]."""
        x, y, z = beams.T
        ranges = np.sqrt(x * x + y * y + z * z).astype(np.float32)
        # cell and range in one sort key, as the bits of positive floats have the order of the floats
        keys = octahedral_cells(beams, _EDGE).astype(np.uint64) << np.uint64(32)
        keys = np.sort(keys | ranges.view(np.uint32))
        cells, ranges = keys >> np.uint64(32), keys.astype(np.uint32).view(np.float32)
        first = np.append(0, np.flatnonzero(cells[1:] != cells[:-1]) + 1)
        count = np.diff(first, append=len(cells))
        near = ranges[first + np.floor(_NEAR * (count - 1)).astype(np.int64)]
        far = ranges[first + np.ceil(_FAR * (count - 1)).astype(np.int64)]
        median = np.repeat(ranges[first + count // 2], count)
        agreeing = np.abs(ranges - median) <= SPREAD + SLOPE * ranges
        # leave out single points in a cell, which always agree with the median
        alone = first[count == 1]
        shared = len(cells) - len(alone)
        single = shared == 0 or (np.count_nonzero(agreeing) - len(alone)) / shared >= SINGLE
        return cls(cells[first].astype(np.int64), near, far, bool(single))

    def image(self) -> np.ndarray:
        """(_EDGE, _EDGE, 2) float32, (inf, -inf) in empty cells."""
        view = np.empty((_EDGE * _EDGE, 2), np.float32)
        view[:] = np.inf, -np.inf
        view[self.cells] = np.column_stack([self.near, self.far])
        return view.reshape(_EDGE, _EDGE, 2)


@dataclass(frozen=True, slots=True)
class Visibility:
    """Agreement of two scans' views under n poses: shares of the sampled points, (n,) each; NaN if neither scan has a
    view."""

    agree: np.ndarray  # on the other scan's surface, mean of both directions
    contradict: np.ndarray  # in front of the other scan's surface
    seen: np.ndarray  # in cells where the other scan saw something


def visibility(
    device: Device, target: View, source: View, poses: Array, tolerances: Sequence[tuple[float, float]]
) -> Pending[list[Visibility]]:
    """Queue the agreement of both views under n poses, p_target = R p_source + t about the grid centers [voxels].

    The result has an entry for each tolerance (reach, slope): a range within reach [voxels] + slope * range of the
    surface agrees. A scan without a view is left out.
    """
    ways = (target, source), (source, target)
    viewings = [Viewing(view.ranges, view.viewpoints, other.sample) for view, other in ways]
    queued = agreement(device, viewings, poses, tolerances)

    def read() -> list[Visibility]:
        counts = queued.read()
        shares = [
            count.sum(axis=0) / (other.sample[1] * view.repeats)
            for count, (view, other) in zip(counts, ways, strict=True)
            if view.ranges is not None
        ]
        mean = np.mean(shares, axis=0) if shares else np.full(counts[0].shape[1:], np.nan)
        return [Visibility(*of_one.T) for of_one in np.moveaxis(mean, 1, 0)]

    return Pending(read)
