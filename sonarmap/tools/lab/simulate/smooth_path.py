"""Smooth paths of a sensor: splines through positions with headings, and lanes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d

from sonarmap.tools.lab.simulate.scenes.solids import rounded

FINE = 200  # points per corner on which a path's length is measured
TURNING = 5.0  # ratio of the length over which a heading is averaged to the bend of a lane path


@dataclass(frozen=True, slots=True)
class Path:
    """A sensor's position and heading as functions of the distance along its path."""

    length: float  # of the path, once round if it is closed [m]
    closed: bool  # whether it ends where it begins
    # maps distances (N,) [m] to positions (N, 3) [m, scene] and headings (N,) [rad, from x toward y]; a closed path is
    # periodic
    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    pitch: float = 0.0  # of the sensor on the whole path, positive nose down [rad]


def spline_path(corners: np.ndarray, closed: bool = True, pitch: float = 0.0) -> Path:
    """A smooth path through `corners` (K, 4): x, y, z [m] and heading [degrees], with a smooth heading."""
    heading = np.deg2rad(corners[:, 3])
    knots = np.column_stack([corners[:, :3], np.cos(heading), np.sin(heading)])
    if closed:
        knots = np.concatenate([knots, knots[:1]])
    last = len(knots) - 1
    curve = CubicSpline(np.arange(len(knots)), knots, bc_type="periodic" if closed else "not-a-knot")
    fine = np.linspace(0, last, FINE * last + 1)
    step = np.linalg.norm(np.diff(curve(fine)[:, :3], axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(step)])

    def at(distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        placed = curve(np.interp(distance % length[-1] if closed else distance, length, fine))
        return placed[:, :3], np.arctan2(placed[:, 4], placed[:, 3])

    return Path(float(length[-1]), closed, at, pitch)


def lane_path(corners: np.ndarray, bend: float, pitch: float = 0.0) -> Path:
    """A closed path of straight legs between `corners` (K, 3) [m, scene], rounded from `bend` [m] before each corner.

    The heading is the direction of travel, averaged over TURNING * bend, so that views on a sharp turn overlap.
    """
    # start in the middle of a leg, so that every corner is an inner one
    start = (corners[-1] + corners[0]) / 2
    line = rounded(np.concatenate([[start], corners, [start]]), bend, pieces=24)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    fine = np.linspace(0, length[-1], FINE * len(corners) + 1)
    places = _between(fine, length, line)
    along = np.diff(places, axis=0)
    heading = _smooth(np.unwrap(np.arctan2(along[:, 1], along[:, 0])), round(TURNING * bend / (fine[1] - fine[0])))
    middles = (fine[1:] + fine[:-1]) / 2

    def at(distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gone = distance % length[-1]
        return _between(gone, length, line), np.interp(gone, middles, heading)

    return Path(float(length[-1]), True, at, pitch)


def _smooth(heading: np.ndarray, count: int) -> np.ndarray:
    """Moving average over `count` of the headings (N,) [rad] of a closed path."""
    # once round the path adds whole turns
    turns = 2 * np.pi * np.round((heading[-1] - heading[0]) / (2 * np.pi))
    around = np.concatenate([heading - turns, heading, heading + turns])
    return uniform_filter1d(around, max(count, 1))[len(heading) : 2 * len(heading)]


def lanes(low: tuple[float, float], high: tuple[float, float], count: int, ties: int, *, east: bool) -> np.ndarray:
    """Corners (K, 2) of `count` lanes to and fro over a rectangle, along x or y, then of `ties` lines across them [m].

    Give at least 2 of each; and, in a closed path whose last tie line would lead straight back to the start, an even
    number of tie lines, so that no leg is passed twice.
    """
    long, wide = (0, 1) if east else (1, 0)
    corners = _to_and_fro((low[long], high[long]), np.linspace(low[wide], high[wide], count))
    # the tie lines begin at the corner where the last lane ended
    ended = corners[-1]
    near = corners[0][0] if ended[0] != corners[0][0] else low[long] + high[long] - ended[0]
    across = np.linspace(ended[0], near, ties + 1)[:-1]
    tied = _to_and_fro((high[wide], low[wide]), across)[:, ::-1]
    both = np.concatenate([corners, tied[1:]])
    return both if east else both[:, ::-1]


def _to_and_fro(ends: tuple[float, float], sideways: np.ndarray) -> np.ndarray:
    there, back = ends
    return np.array(
        [
            (end, side)
            for number, side in enumerate(sideways)
            for end in ((there, back) if number % 2 == 0 else (back, there))
        ]
    )


def _between(distance: np.ndarray, length: np.ndarray, line: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(distance, length, line[:, axis]) for axis in range(line.shape[1])])
