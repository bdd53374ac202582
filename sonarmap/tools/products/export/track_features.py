# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""The track, the scans and the loops of a map as features with attributes: the same in every vector format."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.navigation import Navigation


@dataclass(frozen=True, slots=True)
class Feature:
    """A point or a line through scans.

    Attributes:
        layer: track, scans or loops.
        scans: (k,) indices into the part's scans, through which it passes; a point has one.
        attributes: names and values; None where nothing is known. Each feature of a layer has the same names.
    """

    layer: str
    scans: np.ndarray
    attributes: dict[str, Any]


LAYERS = ("track", "scans", "loops")


def features_of(earth: Georeferenced, navigation: Navigation) -> list[Feature]:
    """All features of one part of a map, layer by layer; a track for each survey of two scans or more."""
    heights = {"height_reference": navigation.vertical}
    return [
        *(Feature("track", line, _track(navigation, line) | heights) for line in navigation.lines),
        *(Feature("scans", np.array([k]), _scan(navigation, k) | heights) for k in range(len(navigation.names))),
        *(Feature("loops", ends, attributes) for ends, attributes in _loops(earth, navigation)),
    ]


def _track(navigation: Navigation, line: np.ndarray) -> dict[str, Any]:
    by_time = line[np.argsort(navigation.stamps[line], kind="stable")]
    return {
        "survey": navigation.surveys[int(line[0])],
        "scan_count": len(line),
        "first_utc": navigation.utc[int(by_time[0])] or None,
        "last_utc": navigation.utc[int(by_time[-1])] or None,
    }


def _scan(navigation: Navigation, k: int) -> dict[str, Any]:
    roll, pitch, heading = navigation.attitudes[k].tolist()
    height = float(navigation.geodetic[k, 2])
    sigmas = [sigma if np.isfinite(sigma) else None for sigma in navigation.sigmas[k].tolist()]
    return {
        "name": navigation.names[k],
        "scan": navigation.scans[k],
        "survey": navigation.surveys[k],
        "utc": navigation.utc[k] or None,
        "unix_s": float(navigation.stamps[k]) if navigation.timed else None,
        "depth_m": -height + 0.0,
        "height_m": height,
        "roll_deg": roll,
        "pitch_deg": pitch,
        "heading_deg": heading,
        "heading_grid_deg": float(navigation.grid_headings[k]),
        "east_sigma_m": sigmas[0],
        "north_sigma_m": sigmas[1],
        "up_sigma_m": sigmas[2],
        "roll_sigma_deg": sigmas[3],
        "pitch_sigma_deg": sigmas[4],
        "heading_sigma_deg": sigmas[5],
    }


def _loops(earth: Georeferenced, navigation: Navigation) -> Sequence[tuple[np.ndarray, dict[str, Any]]]:
    """Those between two scans of this part, from the target to the source."""
    index = {scan: k for k, scan in enumerate(navigation.scans)}
    names = earth.folder.names
    return [
        (
            np.array([index[loop.target], index[loop.source]]),
            {"target": names[loop.target], "source": names[loop.source], "kept": loop.kept, "reason": loop.reason},
        )
        for loop in earth.folder.loops
        if loop.target in index and loop.source in index
    ]
