"""The patch test: the biases of a sounder from lines that overlap."""

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

# Mountings and clocks are this good before any line is seen, as standard deviations.
USUAL_MOUNTING = Biases(1.0, *np.radians([5.0, 5.0, 5.0]).tolist())
# A bias is observable where its standard deviation moves soundings by less than these shares of the depth: on the bed
# half the footprint of a beam of about 1.1 degrees, in height a third of what the strictest survey order allows.
_HORIZONTALLY, _VERTICALLY = 0.01, 0.0025
# Lines that overlap in fewer cells are no test.
_FEWEST = 50


@dataclass(frozen=True, slots=True)
class PatchTest:
    """What lines that overlap show of the biases.

    Attributes:
        biases: the likeliest ones. Those that the lines do not show stay near 0, as mountings and clocks are usual.
        deviations: standard deviations of `biases` [s, rad].
        covariance: (4, 4) of latency, roll, pitch and heading [s, rad].
        bounds: standard deviations [s, rad] below which a bias is observable with this depth, swath and speed.
        observable: names of the biases that are.
        usable: what to take out of the lines: the observable biases, as they are likeliest if the others are zero.
        navigation: (L, 3) East, North, Up [m] to add to the places of each line, the mean along it.
        cells: how many cells have soundings of two lines or more.
        before: 95 % of the absolute differences of two lines' heights are below, as recorded [m].
        after: the same with `usable` taken out; navigation errors stay in [m].
        remaining: the same with `biases` and the navigation errors along every line taken out [m].
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
        """What a report needs, in plain numbers, angles in degrees; the covariance in s and rad."""
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
    """The biases by which overlapping lines agree best.

    Least squares over the differences of heights in cells, with weights of Student's t, over the four biases and the
    navigation errors of every line at once; cells begin wide. Roll shows on any bed. Heading, latency and pitch need
    relief in the overlaps; latency needs speeds that vary, and pitch varying depths or navigation to be believed,
    since on a line of steady course and speed both are alike to a constant error of the navigation.

    Args:
        lines: two or more, best some in opposite directions and one across.
        cell: edge of the cells [m]; None chooses one that holds a good handful of soundings of a line.
        mounting: standard deviations of the biases [s, rad], as assumed before; none is looked for beyond twice these.

    Raises:
        InputError: fewer lines or too little overlap, or numbers that are not above 0.
    """
    if len(lines) < 2:
        raise InputError(f"{len(lines)} line: a patch test needs two or more that overlap")
    if not (mounting.array > 0).all():
        raise InputError(f"`mounting` {mounting}: wanted standard deviations above 0")
    cell = checked_cell(cell, lines)
    before = crossings(lines, cell)
    if before.cells < _FEWEST:
        raise InputError(
            f"{len(lines)} lines overlap in {before.cells} cells of {cell:.2g} m; a patch test needs {_FEWEST} or "
            "more: give lines that overlap, or a larger `cell`"
        )
    solution, covariance, errors = fit(lines, cell, mounting)
    biases, deviations, bounds = Biases.of(solution), Biases.of(np.sqrt(np.diag(covariance))), _bounds(lines)
    observable = tuple(
        name for name, own, bound in zip(NAMES, deviations.array, bounds.array, strict=True) if own < bound
    )
    usable = _usable(biases, covariance, observable)
    right = [corrected(line, biases) for line in lines]
    right = [replace(line, places=line.places + own) for line, own in zip(right, errors, strict=True)]
    return PatchTest(
        biases=biases,
        deviations=deviations,
        covariance=covariance,
        bounds=bounds,
        observable=observable,
        usable=usable,
        navigation=np.array([own.mean(axis=0) for own in errors]),
        cells=before.cells,
        before=before.all.p95,
        after=crossings([corrected(line, usable) for line in lines], cell).all.p95,
        remaining=crossings(right, cell).all.p95,
    )


def _usable(biases: Biases, covariance: np.ndarray, observable: Sequence[str]) -> Biases:
    kept = np.array([name in observable for name in NAMES])
    best = np.where(kept, biases.array, 0.0)
    if kept.any() and not kept.all():
        among = np.linalg.solve(covariance[np.ix_(~kept, ~kept)], biases.array[~kept])
        best[kept] -= covariance[np.ix_(kept, ~kept)] @ among
    return Biases.of(best)


def _bounds(lines: Sequence[PingLine]) -> Biases:
    """By the lines' depth below the transducer, their swath's outer parts, and their speed."""
    rays = [line.points - line.sensors[line.pings] for line in lines if len(line.points)]
    depth = float(np.median(-np.concatenate([ray[:, 2] for ray in rays])))
    outer = float(np.percentile(np.abs(np.concatenate([ray[:, 1] for ray in rays])), 95))
    seconds = sum(float(np.ptp(line.stamps)) for line in lines)
    speed = max(sum(line.length for line in lines) / max(seconds, 1e-9), 1e-3)
    horizontally, vertically = _HORIZONTALLY * depth, _VERTICALLY * depth
    bounds = np.array([horizontally / speed, vertically / outer, horizontally / depth, horizontally / outer])
    return Biases.of(np.clip(bounds, 0, [np.inf, 0.1, 0.1, 0.1]))
