# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The track, the scans and the loops of a map as features with attributes: the same in every vector format."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sonarmap.tools.products.export.georeferenced import Georeferenced


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
ANGLES = ("roll_deg", "pitch_deg", "heading_deg")
SIGMAS = ("east_sigma_m", "north_sigma_m", "up_sigma_m", "roll_sigma_deg", "pitch_sigma_deg", "heading_sigma_deg")


def features_of(earth: Georeferenced) -> list[Feature]:
    """All features of one part of a map, layer by layer; a track for each survey of two scans or more."""
    heights = {"height_reference": earth.georeference.vertical}
    return [
        *(Feature("track", line, _track(earth, line) | heights) for line in earth.lines),
        *(Feature("scans", np.array([k]), _scan(earth, k) | heights) for k in range(len(earth.part.scans))),
        *_loops(earth),
    ]


def _track(earth: Georeferenced, line: np.ndarray) -> dict[str, Any]:
    by_time = line[np.argsort(earth.stamps[line], kind="stable")]
    return {
        "survey": earth.surveys[int(line[0])],
        "scan_count": len(line),
        "first_utc": earth.utc[int(by_time[0])] or None,
        "last_utc": earth.utc[int(by_time[-1])] or None,
    }


def _scan(earth: Georeferenced, k: int) -> dict[str, Any]:
    height = float(earth.poses[k, 2])
    sigmas = [sigma if np.isfinite(sigma) else None for sigma in earth.sigmas[k].tolist()]
    return {
        "name": earth.names[k],
        "scan": earth.part.scans[k],
        "survey": earth.surveys[k],
        "utc": earth.utc[k] or None,
        "unix_s": float(earth.stamps[k]) if earth.timed else None,
        "depth_m": -height + 0.0,
        "height_m": height,
        **dict(zip(ANGLES, earth.attitudes[k].tolist(), strict=True)),
        "heading_grid_deg": float(earth.grid_headings[k]),
        **dict(zip(SIGMAS, sigmas, strict=True)),
    }


def _loops(earth: Georeferenced) -> Iterator[Feature]:
    """Those between two scans of this part, from the target to the source."""
    index, names = {scan: k for k, scan in enumerate(earth.part.scans)}, earth.folder.names
    for loop in earth.folder.loops:
        if loop.target in index and loop.source in index:
            ends = {"target": names[loop.target], "source": names[loop.source]}
            attributes = {**ends, "kept": loop.kept, "reason": loop.reason}
            yield Feature("loops", np.array([index[loop.target], index[loop.source]]), attributes)
