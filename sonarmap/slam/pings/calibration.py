"""Patch test: estimate the biases of a sounder from overlapping lines."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.bias_fit import fit
from sonarmap.slam.pings.biases import NAMES, Biases, corrected
from sonarmap.slam.pings.cells import checked_cell
from sonarmap.slam.pings.crossings import crossings
from sonarmap.slam.pings.line import PingLine

# Prior standard deviations of the biases, those of usual mountings and clocks.
USUAL_MOUNTING = Biases(1.0, *np.radians([5.0, 5.0, 5.0]).tolist())
# A bias is observable if its standard deviation moves soundings by less than these shares of the depth: half the
# footprint of a beam of about 1.1 degrees, and a third of the height error that the strictest survey order allows.
_HORIZONTAL_SHARE = 0.01
_VERTICAL_SHARE = 0.0025
_MIN_CELLS = 50  # in which lines overlap


@dataclass(frozen=True, slots=True)
class PatchTest:
    """Result of a patch test.

    Attributes:
        biases: the most likely biases; those that the lines do not show stay near 0.
        deviations: standard deviations of `biases` [s, rad].
        covariance: (4, 4) of latency, roll, pitch and heading [s, rad].
        bounds: standard deviations [s, rad] below which a bias is observable with this depth, swath and speed.
        observable: names of the observable biases.
        usable: biases to correct lines by: the observable ones, at their most likely values given that others are 0.
        navigation: (L, 3) East, North, Up correction of the places of each line, the mean along it [m].
        cells: number of cells with soundings of two lines or more.
        before: 95th percentile of the absolute differences of two lines' heights, as recorded [m].
        after: the same after correction for `usable`, with navigation errors left in [m].
        remaining: the same after correction for `biases` and the navigation errors along every line [m].
    """

    biases: Biases
    deviations: Biases
    covariance: np.ndarray
    bounds: Biases
    observable: tuple[str, ...]
    usable: Biases
    navigation: np.ndarray
    cells: int
    before: float
    after: float
    remaining: float

    def to_json(self) -> dict[str, Any]:
        """Numbers for a report, angles in degrees; the covariance in s and rad."""
        return {
            "biases": self.biases.to_json(),
            "standard_deviations": self.deviations.to_json(),
            "covariance_s_rad": self.covariance.tolist(),
            "observable_below": self.bounds.to_json(),
            "observable": list(self.observable),
            "usable": self.usable.to_json(),
            "navigation_m": self.navigation.tolist(),
            "cells": self.cells,
            "p95_before_m": self.before,
            "p95_after_m": self.after,
            "p95_remaining_m": self.remaining,
        }


def estimate_biases(
    lines: Sequence[PingLine],
    cell: float | None = None,
    mounting: Biases = USUAL_MOUNTING,
) -> PatchTest:
    """Biases with which overlapping lines agree best.

    A joint least-squares fit of the four biases and the navigation errors of every line to the differences of heights
    in cells, with Student's t weights; the first rounds use wider cells. Roll shows on any bed; heading, latency and
    pitch need relief in the overlaps. Latency also needs varying speeds, and pitch varying depths or accurate
    navigation, because both look like a constant navigation error on a line of steady course and speed.

    Args:
        lines: two or more, best some in opposite directions and one across.
        cell: edge of the cells [m]; None chooses one that holds about 16 soundings of a line.
        mounting: prior standard deviations of the biases [s, rad].

    Raises:
        InputError: fewer than two lines, too little overlap, or a cell or standard deviation that is not above 0.
    """
    if len(lines) < 2:
        raise InputError(f"{len(lines)} line: a patch test needs two or more that overlap")
    if not (mounting.array > 0).all():
        raise InputError(f"`mounting` {mounting}: wanted standard deviations above 0")
    cell = checked_cell(cell, lines)
    before = crossings(lines, cell)
    if before.cells < _MIN_CELLS:
        raise InputError(
            f"{len(lines)} lines overlap in {before.cells} cells of {cell:.2g} m; a patch test needs {_MIN_CELLS} or "
            "more: give lines that overlap, or a larger `cell`"
        )
    solution, covariance, errors = fit(lines, cell, mounting)
    biases, deviations, bounds = Biases.of(solution), Biases.of(np.sqrt(np.diag(covariance))), _bounds(lines)
    observable = tuple(
        name for name, sigma, bound in zip(NAMES, deviations.array, bounds.array, strict=True) if sigma < bound
    )
    usable = _usable(biases, covariance, observable)
    right = [corrected(line, biases) for line in lines]
    right = [replace(line, places=line.places + shifts) for line, shifts in zip(right, errors, strict=True)]
    return PatchTest(
        biases=biases,
        deviations=deviations,
        covariance=covariance,
        bounds=bounds,
        observable=observable,
        usable=usable,
        navigation=np.array([shifts.mean(axis=0) for shifts in errors]),
        cells=before.cells,
        before=before.all.p95,
        after=crossings([corrected(line, usable) for line in lines], cell).all.p95,
        remaining=crossings(right, cell).all.p95,
    )


def _usable(biases: Biases, covariance: np.ndarray, observable: Sequence[str]) -> Biases:
    kept = np.array([name in observable for name in NAMES])
    best = np.where(kept, biases.array, 0.0)
    if kept.any() and not kept.all():
        dropped = np.linalg.solve(covariance[np.ix_(~kept, ~kept)], biases.array[~kept])
        best[kept] -= covariance[np.ix_(kept, ~kept)] @ dropped
    return Biases.of(best)


def _bounds(lines: Sequence[PingLine]) -> Biases:
    """Bounds of `PatchTest` by the depth below the transducer, the half width of the swath, and the speed."""
    rays = [line.points - line.sensors[line.pings] for line in lines if len(line.points)]
    depth = float(np.median(-np.concatenate([ray[:, 2] for ray in rays])))
    outer = float(np.percentile(np.abs(np.concatenate([ray[:, 1] for ray in rays])), 95))
    seconds = sum(float(np.ptp(line.stamps)) for line in lines)
    speed = max(sum(line.length for line in lines) / max(seconds, 1e-9), 1e-3)
    horizontally, vertically = _HORIZONTAL_SHARE * depth, _VERTICAL_SHARE * depth
    bounds = np.array([horizontally / speed, vertically / outer, horizontally / depth, horizontally / outer])
    return Biases.of(np.clip(bounds, 0, [np.inf, 0.1, 0.1, 0.1]))
