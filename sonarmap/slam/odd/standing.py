"""Parts of the vehicle in the sensor's view, as skids, rails or a taut tether: they stand still in the sensor's frame
while what surrounds them changes from scan to scan.

The bed below a level vehicle stands still too. A part of the vehicle is near, and its outline is sharp: beside it the
sensor sees far beyond it, or nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from sonarmap.kernels.counted import counted
from sonarmap.kernels.points.visibility import octahedral_cells
from sonarmap.spectral.scan import Scan

_EDGE = 64  # of a range image [cells], 3 degrees each
_REACH = 2.5  # distance from the sensor at which a vehicle's own parts are [m]
_MOST_SCANS = 128  # that are kept; of longer surveys every second, fourth, ... scan
_MIN_SCANS = 8
_SHARE = 0.8  # of the scans that see a part
_STILL = (0.08, 0.02)  # largest spread of a part's ranges over the scans [m; share of the range]
_CHANGES = 0.06  # smallest distance of the quartiles of the ranges around it [share of the range], in the median
_LEAST_POINTS = 0.005  # share of all points; smaller parts do no harm
_BEYOND = 1.5  # ratio of the ranges beside a part to its own
_CONTINUED = 0.25  # largest share of its outline along which a surface continues
# Quantiles of the ranges in a cell, and of the coordinates of a part's points without strays
_SPREAD, _WHOLE = (0.05, 0.25, 0.5, 0.75, 0.95), (0.02, 0.98)
_JOINED, _BESIDE = 1.6, 2.6  # largest distances between cells of one part, and of its outline [cells]
_MARGIN = 0.05  # of a box about a part, and what its corners are rounded to [m]


@dataclass(frozen=True, slots=True)
class StandingPart:
    box: tuple[float, ...]  # x, y, z of the lower and the upper corner, sensor frame [m]
    nearest: float  # range [m]
    share: float  # of the points of the scans that see it

    @property
    def corners(self) -> str:
        """The box as --exclude-box takes it."""
        return ",".join(f"{corner:g}" for corner in self.box)


@dataclass(slots=True)
class StandingParts:
    """Range images of a survey's scans, added one by one, and the parts of the vehicle in them."""

    near: list[np.ndarray] = field(default_factory=list[np.ndarray])  # (_EDGE^2,) nearest ranges [m], inf without any
    close: list[np.ndarray] = field(default_factory=list[np.ndarray])  # (n, 3) points within _REACH [m]
    counts: list[int] = field(default_factory=list[int])  # points of these scans
    added: int = 0
    step: int = 1  # every how many scans one is kept
    viewpoint: np.ndarray = field(default_factory=lambda: np.zeros(3))  # of the sensor in the frame of the points [m]

    def add(self, scan: Scan) -> None:
        self.added += 1
        if (self.added - 1) % self.step:
            return
        viewpoints = np.zeros((1, 3)) if scan.viewpoints is None else scan.viewpoints.astype(np.float64)
        if np.ptp(viewpoints, axis=0).any():  # a sweep put together from several places
            return
        self.viewpoint = viewpoints[0]
        points = scan.points - self.viewpoint
        ranges = np.linalg.norm(points, axis=1)
        image = np.full(_EDGE * _EDGE, np.inf)
        np.minimum.at(image, octahedral_cells(points, _EDGE), ranges)
        self.near.append(image)
        self.close.append(points[ranges < _REACH].astype(np.float32))
        self.counts.append(len(points))
        if len(self.near) > _MOST_SCANS:
            self.step *= 2
            for kept in (self.near, self.close, self.counts):
                del kept[1::2]

    def found(self) -> list[StandingPart]:
        """The parts of the vehicle, the nearest first."""
        if len(self.near) < _MIN_SCANS:
            return []
        near = np.stack(self.near)
        share = np.isfinite(near).mean(axis=0)
        seen = np.flatnonzero(share >= 0.5)
        if not len(seen):
            return []
        ranges = np.where(np.isfinite(near), near, np.nan)[:, seen]
        low, lower, middle, upper, high = np.nanquantile(ranges, _SPREAD, axis=0)
        still = (share[seen] >= _SHARE) & (high - low <= _STILL[0] + _STILL[1] * middle)
        part = still & (middle <= _REACH)
        rest = np.flatnonzero(~part)
        if not part.any() or len(rest) < part.sum() or np.median(((upper - lower) / middle)[rest]) < _CHANGES:
            return []
        members, directions = np.flatnonzero(part), _directions()[seen]
        cell = np.sqrt(4 * np.pi) / _EDGE
        near_by = KDTree(directions[members])
        pairs = near_by.query_pairs(_JOINED * cell, output_type="ndarray")
        joined = coo_array((np.ones(len(pairs), bool), pairs.T), (len(members),) * 2)
        count, labels = connected_components(joined, directed=False)
        # the part beside which each other cell lies, and whether a surface continues from the part to there
        away, nearest = near_by.query(directions[rest])
        continues = high[rest] < _BEYOND * middle[members[nearest]]
        parts = []
        for label in range(count):
            outline = continues[(away <= _BESIDE * cell) & (labels[nearest] == label)]
            if not len(outline) or outline.mean() <= _CONTINUED:
                cells = members[labels == label]
                parts.append(self._part(seen[cells], float(_BEYOND * middle[cells].max())))
        return sorted((part for part in parts if part.share >= _LEAST_POINTS), key=lambda part: part.nearest)

    def _part(self, cells: np.ndarray, reach: float) -> StandingPart:
        """The part that the scans see in these cells up to this range [m]."""
        points = np.concatenate(self.close).astype(np.float64)
        ranges = np.linalg.norm(points, axis=1)
        own = points[(ranges < reach) & np.isin(octahedral_cells(points, _EDGE), cells)]
        low, high = np.quantile(own, _WHOLE, axis=0) + self.viewpoint
        corners = np.concatenate([np.floor(low / _MARGIN) - 1, np.ceil(high / _MARGIN) + 1]) * _MARGIN
        box = tuple((np.round(corners, 2) + 0.0).tolist())  # without negative zeros
        return StandingPart(box, float(np.quantile(ranges[ranges < reach], _WHOLE[0])), len(own) / sum(self.counts))


def in_words(parts: Sequence[StandingPart]) -> str:
    """A warning of parts, with the options that leave them out."""
    options = " ".join(f"--exclude-box {part.corners}" for part in parts)
    share, nearest = sum(part.share for part in parts), parts[0].nearest
    return (
        f"{counted(len(parts), 'object')} from {nearest:.2g} m on, with {100 * share:.0f} % of the points, "
        f"{'stands' if len(parts) == 1 else 'stand'} still in the sensor's frame while all else changes. If they are "
        f"parts of the vehicle, as skids or a tether, leave them out with {options}"
    )


def _directions() -> np.ndarray:
    """(_EDGE^2, 3) unit vectors to the centers of the cells of `octahedral_cells`."""
    side = (np.arange(_EDGE) + 0.5) * 2 / _EDGE - 1
    u, v = (each.ravel() for each in np.meshgrid(side, side, indexing="ij"))
    z = 1 - np.abs(u) - np.abs(v)
    x = np.where(z < 0, (1 - np.abs(v)) * np.where(u < 0, -1, 1), u)
    y = np.where(z < 0, (1 - np.abs(u)) * np.where(v < 0, -1, 1), v)
    directions = np.column_stack([x, y, z])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
