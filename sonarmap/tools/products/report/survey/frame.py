# pyright: strict, reportUnknownMemberType=false
"""What the coordinates of a map mean to its reader."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sonarmap.slam.parts import placed
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.geo.georeference import EAST, VERTICALS, Georeference


@dataclass(frozen=True, slots=True)
class MapFrame:
    """How a part of a map is drawn, and called."""

    # across, up: what the picture's two axes are
    across: str
    up: str
    note: str  # sentences about the frame, one a line
    height: str  # what the third number is
    sigmas: str = "against the first scan"  # what standard deviations of poses are against
    turn: float = 0.0  # by how much the map is turned for the picture, counterclockwise [deg]
    # height in the map's frame from which depths are measured, positive down [m]; None where heights are shown
    zero: float | None = None
    north: bool = False  # whether the picture's upper edge is North

    def flat(self, points: np.ndarray) -> np.ndarray:
        """(M, 2) places in the picture [m] of points (M, 3) in the map's frame [m]."""
        if self.turn == 0:
            return points[:, :2]
        c, s = np.cos(np.radians(self.turn)), np.sin(np.radians(self.turn))
        return points[:, :2] @ np.array([[c, s], [-s, c]])

    def level(self, z: np.ndarray) -> np.ndarray:
        """Depths or heights [m] of coordinates z in the map's frame [m]."""
        return z if self.zero is None else self.zero - z


def frame_of(result: SurveyResult, c: int, georeference: Georeference | None) -> MapFrame:
    """The frame of component `c`: on the Earth, in the world of the instruments, or that of its first scan.

    As in an export, a map is on the Earth by its instruments, or, where these place no part at all, the largest by the
    user's word.
    """
    missing = _unmeasured(result, c)
    maps = placed(result.components)
    alone = c == maps[0] and all(_unmeasured(result, each) != () for each in maps)
    if georeference is not None and (missing == () or alone):
        return _on_earth(georeference, alone, missing)
    height, zero = _level(missing, georeference, given=False)
    words: Any = {"height": height, "sigmas": _sigmas(missing), "zero": zero}
    if missing is None or "heading" in missing:
        note = "x points where the first scan's sensor looked, y to its left; the direction of North is not known."
        return MapFrame("x [m]", "y [m]", note, **words)
    where = "the first scan's place" if {"east", "north"} & set(missing) else "the origin of the navigation"
    return MapFrame("East [m]", "North [m]", f"East and North count from {where}.", north=True, **words)


def _on_earth(here: Georeference, alone: bool, missing: tuple[str, ...] | None) -> MapFrame:
    sides = [
        f"{abs(degrees):.7f}° {names[degrees < 0]}"
        for degrees, names in ((here.latitude, "NS"), (here.longitude, "EW"))
    ]
    note = f"East and North count from {sides[0]}, {sides[1]} (WGS84)."
    if alone and (missing is None or "heading" in missing):
        ahead = "East" if here.heading == EAST else f"to {here.heading:g}° (clockwise from North)"
        note += f" No instrument measured the heading: the first scan's x axis is taken to point {ahead}."
    height, zero = _level(missing, here, given=here.height != 0)
    turn = EAST - here.heading
    return MapFrame("East [m]", "North [m]", note, height, _sigmas(missing), turn, zero, north=True)


def _sigmas(missing: tuple[str, ...] | None) -> str:
    if not missing:
        return "against the first scan" if missing is None else "in the world"
    return "in the world, and of what no instrument measured against the first scan"


def _level(missing: tuple[str, ...] | None, here: Georeference | None, *, given: bool) -> tuple[str, float | None]:
    """What is told of heights, and the zero of depths; `given` where the user said how high the origin is."""
    if not given and (missing is None or "up" in missing):
        return "height relative to the first scan [m]", None
    if here is None:
        return "depth below the zero of the navigation's heights [m]", 0.0
    return f"depth below {VERTICALS[here.vertical]} [m]", -here.height


def _unmeasured(result: SurveyResult, c: int) -> tuple[str, ...] | None:
    """Names of MEASURED that no instrument measured of a component; None where it is not in the world at all."""
    from sonarmap.slam.graph.gauge import MEASURED

    graph, members = result.solution.graph, result.components[c]
    measured = {pose for pose, _ in graph.priors} | {known.pose for known in graph.known}
    if measured.isdisjoint(members):
        return None
    unconstrained = dict(graph.gauge.unconstrained)
    free = next((unconstrained[pose] for pose in members if pose in unconstrained), np.zeros(len(MEASURED), dtype=bool))
    return tuple(name for name, unknown in zip(MEASURED, free, strict=True) if unknown)
