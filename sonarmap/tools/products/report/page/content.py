# pyright: strict, reportUnknownMemberType=false
"""All that the page shows, as one value for JSON; the bytes of points and pictures apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.geo.georeference import VERTICALS
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.products.report.naming import inputs_of
from sonarmap.tools.products.report.page import evidence
from sonarmap.tools.products.report.page.command import map_command
from sonarmap.tools.products.report.page.points import MOST_CODE, codes, doubtful_of, pack
from sonarmap.tools.products.report.page.provenance import citation, setting_rows, title
from sonarmap.tools.products.report.page.verdict import verdict

PICTURES = (".png",)
_EXTREMES = (0.01, 0.99)  # quantiles of heights between which the colors change
_STRAY = 0.005  # share of the points on either side that may lie out of sight at first


@dataclass(frozen=True, slots=True)
class Content:
    """shown: what the page says, for JSON.
    points: gzipped planes of every part of the map.
    doubtful: the same of the points that the map left out; None where there are none.
    pictures: {file's name: content}."""

    shown: dict[str, Any]
    points: tuple[bytes, ...]
    doubtful: tuple[bytes | None, ...]
    pictures: dict[str, bytes]


def content_of(folder: Map) -> Content:
    """What to show of a finished map."""
    summary, graph = folder.summary, folder.graph
    parts, points, doubtful = zip(*(_part(folder, part) for part in folder.parts), strict=True)
    shown = {
        "title": title(
            inputs_of(summary["settings"]), np.array([pose["stamp"] for pose in graph["poses"]], np.float64)
        ),
        "verdict": verdict(summary, folder.names),
        "names": list(folder.names),
        "surveys": [int(pose["survey"]) for pose in graph["poses"]],
        "parts": list(parts),
        "pairs": evidence.pair_rows(graph["pairs"]),
        "sequential": evidence.kept_sequential(graph["pairs"]),
        "crossings": summary["crossing_error_m"] | {"rows": evidence.crossing_rows(graph)},
        "navigation": {
            "names": [*evidence.ANGLES, *evidence.AXES],
            "units": ["deg"] * 3 + ["m"] * 3,
            "rows": evidence.navigation_rows(graph),
        },
        "wrong_fixes": evidence.wrong_places(graph),
        "ties": evidence.tie_rows(summary, folder.names),
        "control_points": evidence.control_rows(summary, folder.parts, folder.names),
        "key": evidence.map_key(summary, folder.names),
        "command": map_command(summary["settings"], folder.georeference),
        "graph": summary["graph"],
        "settings": setting_rows(summary["settings"]),
        "versions": summary["versions"],
        "device": summary["device"],
        "inputs": summary.get("inputs", []),
        "georeference": summary.get("georeference"),
        "citation": citation(summary["versions"]),
    }
    return Content(shown, points, doubtful, _pictures(folder))


def _part(folder: Map, part: MapPart) -> tuple[dict[str, Any], bytes, bytes | None]:
    """A map of the folder, its points as bytes, and so those that it left out."""
    columns, scales = _columns(part)
    data, layout = pack(part.points, columns, folder.voxel)
    doubtful_data, doubtful = doubtful_of(folder, part)
    everything = np.concatenate([part.points, part.trajectory.T_world_sensor.translation])
    low, high = np.quantile(part.points[:, 2], _EXTREMES).tolist()
    row = {
        "name": f"map{part.suffix}.ply",
        "count": len(part.points),
        "voxel": folder.voxel,
        "packed": layout,
        "doubtful": doubtful,
        "scales": scales,
        "extent": np.quantile(everything, (0, 1), axis=0).tolist(),
        "middle": np.quantile(everything, (_STRAY, 1 - _STRAY), axis=0).tolist(),
        "axes": ["East", "North", "Up"] if part.in_world else ["x", "y", "z"],
        "height": _height(folder, part) | {"range": [low, high]},
        "track": evidence.track_of(part, folder.graph),
        "on_earth": folder.on_earth(part),
        "unmeasured": list(part.unmeasured) if part.in_world else [],
    }
    return row, data, doubtful_data


def _columns(part: MapPart) -> tuple[dict[str, np.ndarray], dict[str, tuple[float, float]]]:
    """The points' columns as whole numbers, and the extremes of those that are codes."""
    columns: dict[str, np.ndarray] = {}
    scales: dict[str, tuple[float, float]] = {}
    for name, column in (("sigma", "sigma"), ("echo", "intensity")):
        if column in part.columns:
            columns[name], scales[name] = codes(part.columns[column])
    columns["seen"] = np.minimum(part.columns["seen"], MOST_CODE)
    columns["scan"], columns["survey"] = part.columns["scan"], part.columns["survey"]
    return columns, scales


def _height(folder: Map, part: MapPart) -> dict[str, Any]:
    """What the third coordinate means: how to call it, and what to subtract it from for a depth; null for a height."""
    here = folder.georeference
    given = here is not None and here.height != 0 and folder.on_earth(part)  # by --origin
    if not (part.knows("up") or given):
        return {"label": "height over the first scan", "zero": None}
    if here is None:
        return {"label": "depth below the zero of the navigation's heights", "zero": 0.0}
    return {"label": f"depth below {VERTICALS[here.vertical]}", "zero": -here.height}


def _pictures(folder: Map) -> dict[str, bytes]:
    """The map's pictures, in the order of its files."""
    files: Sequence[str] = folder.summary.get("files", [])
    paths = [folder.path / Path(name).name for name in files if name.endswith(PICTURES)]
    return {path.name: path.read_bytes() for path in paths if path.is_file()}
