"""What speaks for a map, as rows for the page: poses with their ellipsoids, pairs, distances from navigation,
and what users decided of it before."""

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.files.map_folder.folder import MapPart
from sonarmap.tools.files.readers.poses.pose_rows import rigid_transform
from sonarmap.tools.files.readers.ties import TRANSFORM

ANGLES, AXES = ("roll", "pitch", "heading"), ("East", "North", "Up")  # the order of a prior's numbers
_DIGITS = 5  # behind the point, of meters
_TURN_DIGITS = 8  # of a quaternion: a point 100 m away is off by micrometers
_SAME = 1e-3  # poses that differ by less were not moved [m]
_SHORT = 4  # valid digits of what is only read
_PLACES = ("point", "known", "estimated", "sigma")  # of a control point: three numbers each


def track_of(part: MapPart, graph: Mapping[str, Any]) -> dict[str, Any]:
    """The poses of a map: scans, stamps [s], places [m], turns, and the half axes of their ellipsoids.

    An ellipsoid's three half axes, (3, 3) as rows x, y, z [m], are standard deviations of the place along the
    directions in which they are independent, in the map's frame. A turn is the quaternion x, y, z, w of R_world_sensor.
    `before` has the places before the loops, or null where graph.json does not say them, or where they are the same;
    `overlaps` each scan's overlap with the scan that it was registered with consecutively, or null.
    """
    R = part.trajectory.T_world_sensor.rotation.as_matrix()
    variances, directions = np.linalg.eigh(R @ part.covariances[:, 3:, 3:] @ R.transpose(0, 2, 1))
    half_axes = (directions * np.sqrt(np.maximum(variances, 0.0))[:, None, :]).transpose(0, 2, 1)
    sequential = [pair for pair in graph["pairs"] if pair["role"] == "sequential"]
    overlaps = {int(pair["source"]): _short(pair.get("overlap")) for pair in sequential}
    return {
        "scans": list(part.scans),
        "stamps": part.trajectory.stamps.tolist(),
        "places": np.round(part.trajectory.T_world_sensor.translation, _DIGITS).tolist(),
        "turns": np.round(part.trajectory.T_world_sensor.rotation.as_quat(), _TURN_DIGITS).tolist(),
        "half_axes": np.round(half_axes, _DIGITS).tolist(),
        "before": _before(part, graph["poses"]),
        "overlaps": [overlaps.get(scan) for scan in part.scans],
    }


def _before(part: MapPart, poses: Sequence[Mapping[str, Any]]) -> list[list[float]] | None:
    """The places of a part's scans before the loops [m]."""
    matrices = [poses[scan].get("T_world_sensor_before_loops") for scan in part.scans]
    if any(matrix is None for matrix in matrices):
        return None
    places = _poses(matrices).translation
    apart = np.abs(places - part.trajectory.T_world_sensor.translation).max()
    return np.round(places, _DIGITS).tolist() if apart > _SAME else None


def kept_sequential(pairs: Sequence[Mapping[str, Any]]) -> list[tuple[int, int]]:
    """The consecutive pairs that were kept, which `pair_rows` leaves out: target and source."""
    return [
        (int(pair["target"]), int(pair["source"])) for pair in pairs if pair["role"] == "sequential" and pair["kept"]
    ]


def pair_rows(pairs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What became of every loop and bridge, and of consecutive pairs that were not kept."""
    numbers = ("overlap", "probability", "sigmas_from_estimate", "residual_sigmas")
    return [
        {"target": int(pair["target"]), "source": int(pair["source"]), "role": str(pair["role"])}
        | {"kept": bool(pair["kept"]), "reason": str(pair["reason"])}
        | {name: _short(pair.get(name)) for name in numbers}
        for pair in pairs
        if pair["role"] != "sequential" or not pair["kept"]
    ]


def crossing_rows(graph: Mapping[str, Any]) -> list[dict[str, Any]]:
    """How far apart each two scans at a crossing lie [m]; none in a graph.json of an earlier version."""
    numbers = ("before_m", "before_90_m", "after_m", "after_90_m")
    return [
        {"target": int(row["i"]), "source": int(row["j"])} | {name: _short(row[name]) for name in numbers}
        for row in graph.get("crossings", ())
    ]


def navigation_rows(graph: Mapping[str, Any]) -> list[dict[str, Any]]:
    """How far the poses lie from what instruments measured of them.

    A row has the scan's number, and for each of ANGLES [deg] and AXES [m] the map's value less the instruments', and
    the instruments' standard deviation; None where they did not measure it.
    """
    priors = [prior for prior in graph["priors"] if any(sigma is not None for sigma in prior["sigmas"])]
    if not priors:
        return []
    scans = [int(prior["pose"]) for prior in priors]
    measured = _poses([prior["T_world_sensor"] for prior in priors])
    mapped = _poses([graph["poses"][scan]["T_world_sensor"] for scan in scans])
    # roll, pitch, and the heading as a turn about Up, counterclockwise from East [deg]
    ours, theirs = (T.rotation.as_euler("ZYX", degrees=True)[:, ::-1] for T in (mapped, measured))
    angles = (ours - theirs + 180.0) % 360.0 - 180.0
    apart = np.column_stack([angles, mapped.translation - measured.translation])
    sigmas = np.array([prior["sigmas"] for prior in priors], np.float64)
    sigmas[:, :3] = np.degrees(sigmas[:, :3])
    return [
        {"scan": scan, "apart": [_short(a) if np.isfinite(s) else None for a, s in zip(away, sigma, strict=True)]}
        | {"sigmas": [_short(s) for s in sigma]}
        for scan, away, sigma in zip(scans, apart.tolist(), sigmas.tolist(), strict=True)
    ]


def wrong_places(graph: Mapping[str, Any]) -> dict[int, list[float]]:
    """By scan, where a position that was left out said that it was, East and North [m]; none in graphs of before."""
    fixes = graph.get("wrong_fixes", ())
    return {int(fix["pose"]): [float(number) for number in fix["place"]] for fix in fixes if fix.get("place")}


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
        places = {place: [float(value) for value in row[place]] for place in _PLACES}
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


def _poses(matrices: Sequence[Any]) -> RigidTransform:
    return RigidTransform.concatenate([rigid_transform(matrix, "a pose") for matrix in matrices])


def _short(value: Any) -> float | None:
    """A number with few digits; None for what is none."""
    if value is None or not np.isfinite(value):
        return None
    return float(f"{value:.{_SHORT}g}")
