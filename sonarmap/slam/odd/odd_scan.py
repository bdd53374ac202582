"""A faulty scan, and the changes with which it may fit its neighbors."""

from dataclasses import dataclass, replace

import numpy as np

from sonarmap.spectral.scan import Scan

FOOT = 0.3048  # [m]


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a scan's points and viewpoints: mirrored along axes, and scaled."""

    axes: str = ""  # of "xyz", whose signs change
    factor: float = 1.0  # of all lengths

    def of(self, scan: Scan) -> Scan:
        """The changed scan; its prior, which is the vehicle's, stays."""
        by = np.array([-self.factor if axis in self.axes else self.factor for axis in "xyz"], np.float32)
        seen_from = None if scan.viewpoints is None else scan.viewpoints * by
        return replace(scan, points=scan.points * by, viewpoints=seen_from)


@dataclass(frozen=True, slots=True)
class OddScan:
    """A faulty scan, which was left out.

    Attributes:
        scan: its number.
        change: with which it fits its neighbors.
    """

    scan: int
    change: Change

    @property
    def kind(self) -> str:
        """ "mirrored", "feet", or "meters" among scans in feet."""
        if self.change.axes:
            return "mirrored"
        return "feet" if self.change.factor < 1 else "meters"
