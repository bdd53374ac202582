# pyright: strict
"""What users decided of a map before: ties and control points, as rows for the page, and what the browser keeps its
next decisions under."""

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

from sonarmap.tools.files.map_folder.folder import MapPart

# A transform that a person measured, as the columns of a file of ties.
TRANSFORM = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg", "sigma_m", "sigma_deg")
_PLACES = ("point", "known", "estimated", "sigma")  # of a control point: three numbers each


def tie_rows(summary: Mapping[str, Any], names: Sequence[str]) -> list[dict[str, Any]]:
    """The ties that the map was made with, their scans by name, and their transforms where they have one."""
    return [
        {end: _name(tie[end], names) for end in ("target", "source")}
        | {"verdict": str(tie["verdict"])}
        | {text: str(tie.get(text) or "") for text in ("note", "effect")}
        | {"transform": {name: float(tie[name]) for name in TRANSFORM if tie.get(name) is not None}}
        for tie in summary.get("ties") or ()
    ]


def control_rows(summary: Mapping[str, Any], parts: Sequence[MapPart], names: Sequence[str]) -> list[dict[str, Any]]:
    """The control points of the map, as summary.json has them; residuals are estimated less known [m].

    `counted` says whether a point's residual tells of the map: whether its part is in the world, and others do not
    contradict it.
    """
    in_world = {names[scan] for part in parts if part.in_world for scan in part.scans}
    fit: Mapping[str, Any] = summary.get("control") or {}
    left_out = {(row["name"], _name(row["scan"], names)) for row in fit.get("left_out", ())}
    rows: list[dict[str, Any]] = []
    for row in summary.get("control_points") or ():
        name, scan = str(row["name"]), _name(row["scan"], names)
        places = {place: _three(row[place]) for place in _PLACES}
        residual = [e - k for e, k in zip(places["estimated"], places["known"], strict=True)]
        wrong = (name, scan) in left_out
        judged = {"left_out": wrong, "counted": scan in in_world and not wrong, "in_sigmas": float(row["in_sigmas"])}
        rows.append({"name": name, "scan": scan, "use": str(row["use"]), **places, "residual": residual, **judged})
    return rows


def map_key(summary: Mapping[str, Any], names: Sequence[str]) -> str:
    """What tells this map from others: of what scans, with what settings and decisions it was made."""
    made = [summary.get(name) for name in ("inputs", "settings", "ties", "control_points", "versions")]
    return sha256(json.dumps([made, list(names)], sort_keys=True, default=str).encode()).hexdigest()[:24]


def _name(scan: Any, names: Sequence[str]) -> str:
    return names[scan] if isinstance(scan, int) else str(scan)


def _three(place: Any) -> list[float]:
    x, y, z = (float(value) for value in place)
    return [x, y, z]
