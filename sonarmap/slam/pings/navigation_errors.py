"""How wrong the navigation of a line may be, and how it varies along the line: knots with straight lines between."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.slam.pings.line import PingLine

_INTERVAL = 10.0  # between knots [s]
_MOST_INTERVALS = 24  # of a line
_CONSTANT = (1.0, 1.0, 0.2)  # standard deviations of East, North and Up at the beginning of a line [m]
_DRIFT = (0.3, 0.3, 0.03)  # by which they change in a minute, as a random walk [m]


@dataclass(frozen=True, slots=True)
class Knots:
    """At which times a line's errors are unknowns, K times.

    Attributes:
        first: number of its first unknown among all; three per knot, East, North, Up.
        stamps: (K,) [s], ascending.
    """

    first: int
    stamps: np.ndarray

    @classmethod
    def of(cls, lines: Sequence[PingLine], first: int) -> "list[Knots]":
        """Of each line, the first unknown of the first one given."""
        knots: list[Knots] = []
        for line in lines:
            begin, end = float(line.stamps[0]), float(line.stamps[-1])
            count = int(np.clip(np.ceil((end - begin) / _INTERVAL), 1, _MOST_INTERVALS)) + 1
            knots.append(cls(first, np.linspace(begin, max(end, begin + 1.0), count)))
            first = knots[-1].end
        return knots

    @property
    def end(self) -> int:
        """Number behind its last unknown."""
        return self.first + 3 * len(self.stamps)

    def at(self, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For (m,) stamps [s]: the unknowns of East at the knots before and behind, (m, 2) int64, and their shares."""
        k = np.clip(np.searchsorted(self.stamps, stamps, side="right") - 1, 0, len(self.stamps) - 2)
        share = (stamps - self.stamps[k]) / (self.stamps[k + 1] - self.stamps[k])
        unknowns = self.first + 3 * np.column_stack([k, k + 1])
        return unknowns, np.column_stack([1 - share, share])

    def errors(self, stamps: np.ndarray, solution: np.ndarray) -> np.ndarray:
        """(m, 3) East, North, Up to add to places [m] at (m,) stamps [s]."""
        knots = solution[self.first : self.end].reshape(-1, 3)
        return np.column_stack([np.interp(stamps, self.stamps, axis) for axis in knots.T])

    def information(self) -> np.ndarray:
        """(3 K, 3 K) of its unknowns [m^-2]: a constant, from which the errors wander off as a random walk does."""
        count = len(self.stamps)
        steps = np.diff(np.eye(count), axis=0)
        information = np.zeros((3 * count, 3 * count))
        for axis, (constant, drift) in enumerate(zip(_CONSTANT, _DRIFT, strict=True)):
            own = steps.T @ np.diag(60.0 / (np.diff(self.stamps) * drift**2)) @ steps
            own[0, 0] += 1 / constant**2
            information[axis::3, axis::3] = own
        return information
