"""A scan that goes with its neighbors only once it is changed, and the changes that are tried."""

from dataclasses import dataclass, replace

import numpy as np

from sonarmap.spectral.scan import Scan

FOOT = 0.3048  # [m]


@dataclass(frozen=True, slots=True)
class Change:
    """What is done to a scan's points, and to where they were seen from: mirrored along axes, and multiplied."""

    axes: str = ""  # those of "xyz" whose signs are changed
    factor: float = 1.0  # of all lengths

    def of(self, scan: Scan) -> Scan:
        """The scan, changed; its prior is of the vehicle, and stays."""
        by = np.array([-self.factor if axis in self.axes else self.factor for axis in "xyz"], np.float32)
        seen_from = None if scan.viewpoints is None else scan.viewpoints * by
        return replace(scan, points=scan.points * by, viewpoints=seen_from)


@dataclass(frozen=True, slots=True)
class OddScan:
    """A scan that no other fits, and that was left out.

    Attributes:
        scan: its number.
        change: with which it fits its neighbors.
    """

    scan: int
    change: Change

    @property
    def kind(self) -> str:
        """What it seems to be: "mirrored", "feet", or "meters" where the others are in feet."""
        if self.change.axes:
            return "mirrored"
        return "feet" if self.change.factor < 1 else "meters"
