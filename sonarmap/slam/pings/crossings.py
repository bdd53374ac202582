"""Differences of lines' heights where they cross or overlap."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sonarmap.slam.pings.cells import Overlaps, checked_cell
from sonarmap.slam.pings.line import PingLine

_BIN = float(np.radians(10.0))  # width of the bins by beam angle [rad]


@dataclass(frozen=True, slots=True)
class Differences:
    """Statistics of height differences in cells; NaN if there are no differences.

    Attributes:
        count: number of differences.
        mean: their mean [m].
        spread: their standard deviation [m].
        p95: 95th percentile of their absolute values [m].
    """

    count: int
    mean: float
    spread: float
    p95: float

    @classmethod
    def of(cls, differences: np.ndarray) -> "Differences":
        """Statistics of (D,) differences [m]."""
        if not len(differences):
            return cls(0, np.nan, np.nan, np.nan)
        p95 = float(np.percentile(np.abs(differences), 95))
        return cls(len(differences), float(differences.mean()), float(differences.std()), p95)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, None for NaN."""
        numbers = {"mean_m": self.mean, "std_m": self.spread, "p95_m": self.p95}
        return {"count": self.count} | {name: value if np.isfinite(value) else None for name, value in numbers.items()}


@dataclass(frozen=True, slots=True)
class Crossings:
    """Differences of two lines' heights (Up) in the cells where both have soundings.

    A difference is the first line's height less the second's: positive if the first line has the bed shallower. Heights
    are those at the cell's center, by the common slope of all lines there.

    Attributes:
        cell: edge of the cells [m].
        cells: number of cells with soundings of two lines or more.
        all: differences of every two lines in every cell.
        by_lines: names of the first and the second line, and their differences.
        by_angle: limits of each bin of beam angles from straight down, to either side [rad], and the differences
            between a line's heights with such beams and the mean of the other lines' heights.
    """

    cell: float
    cells: int
    all: Differences
    by_lines: tuple[tuple[str, str, Differences], ...]
    by_angle: tuple[tuple[float, float, Differences], ...]

    def to_json(self) -> dict[str, Any]:
        """Numbers for a report, angles in degrees."""
        return {
            "sign": "height of the first line less that of the second; positive: the first is shallower",
            "cell_m": self.cell,
            "cells": self.cells,
            "all": self.all.to_json(),
            "by_lines": [{"first": a, "second": b} | some.to_json() for a, b, some in self.by_lines],
            "by_angle": [
                {"from_deg": round(np.degrees(a)), "to_deg": round(np.degrees(b))} | some.to_json()
                for a, b, some in self.by_angle
            ],
        }


def crossings(lines: Sequence[PingLine], cell: float | None = None) -> Crossings:
    """Height differences of lines where they cross or overlap; a line is not compared with itself.

    Args:
        cell: edge of the cells [m]; None chooses one that holds about 16 soundings of a line.

    Raises:
        InputError: an edge that is not above 0, or None with too few soundings to choose one.
    """
    cell = checked_cell(cell, lines)
    angles = [np.abs(line.beam_angles())[:, None] for line in lines]
    overlaps = Overlaps.of([line.world_points() for line in lines], angles, cell)
    first, second = overlaps.pairs()
    differences = overlaps.heights[first] - overlaps.heights[second]
    pairs = np.column_stack([overlaps.lines[first], overlaps.lines[second]])
    by_lines = tuple(
        (lines[i].name, lines[j].name, Differences.of(differences[(pairs == (i, j)).all(axis=1)]))
        for i, j in np.unique(pairs, axis=0)
    )
    return Crossings(cell, len(overlaps.centers), Differences.of(differences), by_lines, _by_angle(overlaps))


def _by_angle(overlaps: Overlaps) -> tuple[tuple[float, float, Differences], ...]:
    """Differences of each patch from the mean of its cell's others, in bins of its mean |angle|, without empty bins."""
    count = np.bincount(overlaps.cells)[overlaps.cells]
    total = np.bincount(overlaps.cells, weights=overlaps.heights)[overlaps.cells]
    higher = overlaps.heights - (total - overlaps.heights) / (count - 1)
    bins = (overlaps.columns[:, 0] / _BIN).astype(int)
    return tuple((k * _BIN, (k + 1) * _BIN, Differences.of(higher[bins == k])) for k in np.unique(bins).tolist())
