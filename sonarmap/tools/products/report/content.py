"""Content of the report: one value for JSON with the map, its evidence, poses with ellipsoids, pairs, distances from
navigation, ties and control points; and the bytes of points and pictures."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.files.geo import VERTICALS
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.readers.constraints import TRANSFORM
from sonarmap.tools.files.readers.trajectory import rigid_transform
from sonarmap.tools.products.report.points import MOST_CODE, codes, pack
from sonarmap.tools.products.report.provenance import citation, inputs_of, setting_rows, title

PICTURES = (".png",)
_EXTREMES = (0.01, 0.99)  # quantiles of heights at the ends of the color scale
_STRAY = 0.005  # share of the points on either side that may lie outside the initial view
LISTED = 5  # largest number of names in a sentence
_UNSURE = 3.0  # smallest sigma of a map's rotation that is reported [deg]
_FEW = 0.5  # share of voxels seen by several scans below which a concern is reported


@dataclass(frozen=True, slots=True)
class Content:
    """Content of the report.

    shown: what the page shows, for JSON.
    points: gzipped planes of every part of the map, as of `pack`.
    pictures: {file name: content}."""

    shown: dict[str, Any]
    points: tuple[bytes, ...]
    pictures: dict[str, bytes]


def content_of(folder: Map) -> Content:
    """Content of the report on a finished map."""
    summary, graph = folder.summary, folder.graph
    parts, points = zip(*(_part(folder, part) for part in folder.parts), strict=True)
    shown = {
        "title": title(
            inputs_of(summary["settings"]), np.array([pose["stamp"] for pose in graph["poses"]], np.float64)
        ),
        "verdict": verdict(summary, folder.names),
        "names": list(folder.names),
        "surveys": [int(pose["survey"]) for pose in graph["poses"]],
        "parts": list(parts),
        "pairs": pair_rows(graph["pairs"]),
        "sequential": kept_sequential(graph["pairs"]),
        "crossings": summary["crossing_error_m"] | {"rows": crossing_rows(graph)},
        "navigation": {"names": [*ANGLES, *AXES], "units": ["deg"] * 3 + ["m"] * 3, "rows": navigation_rows(graph)},
        "ties": tie_rows(summary, folder.names),
        "control_points": control_rows(summary, folder.parts, folder.names),
        "graph": summary["graph"],
        "settings": setting_rows(summary["settings"]),
        "versions": summary["versions"],
        "device": summary["device"],
        "inputs": summary.get("inputs", []),
        "georeference": summary.get("georeference"),
        "citation": citation(summary["versions"]),
    }
    return Content(shown, points, _pictures(folder))


def _part(folder: Map, part: MapPart) -> tuple[dict[str, Any], bytes]:
    """Row of one part of the map, and its packed points."""
    columns, scales = _columns(part)
    data, layout = pack(part.points, columns, folder.voxel)
    everything = np.concatenate([part.points, part.trajectory.T_world_sensor.translation])
    low, high = np.quantile(part.points[:, 2], _EXTREMES).tolist()
    row = {
        "name": f"map{part.suffix}.ply",
        "count": len(part.points),
        "voxel": folder.voxel,
        "packed": layout,
        "scales": scales,
        "extent": np.quantile(everything, (0, 1), axis=0).tolist(),
        "middle": np.quantile(everything, (_STRAY, 1 - _STRAY), axis=0).tolist(),
        "axes": ["East", "North", "Up"] if part.in_world else ["x", "y", "z"],
        "height": _height(folder, part) | {"range": [low, high]},
        "track": track_of(part, folder.graph),
        "on_earth": folder.on_earth(part),
    }
    return row, data


def _columns(part: MapPart) -> tuple[dict[str, np.ndarray], dict[str, tuple[float, float]]]:
    """Columns of the points as whole numbers, and the extremes of the columns that are codes."""
    columns: dict[str, np.ndarray] = {}
    scales: dict[str, tuple[float, float]] = {}
    for name, column in (("sigma", "sigma"), ("echo", "intensity")):
        if column in part.columns:
            columns[name], scales[name] = codes(part.columns[column])
    columns["seen"] = np.minimum(part.columns["seen"], MOST_CODE)
    columns["scan"], columns["survey"] = part.columns["scan"], part.columns["survey"]
    return columns, scales


def _height(folder: Map, part: MapPart) -> dict[str, Any]:
    """Label of the third coordinate, and the zero that it is subtracted from for a depth; None for a height."""
    here = folder.georeference
    given = here is not None and here.height != 0 and folder.on_earth(part)  # by --origin
    if not (part.knows("up") or given):
        return {"label": "height over the first scan", "zero": None}
    if here is None:
        return {"label": "depth below the zero of the navigation's heights", "zero": 0.0}
    return {"label": f"depth below {VERTICALS[here.vertical]}", "zero": -here.height}


def _pictures(folder: Map) -> dict[str, bytes]:
    files: Sequence[str] = folder.summary.get("files", [])
    paths = [folder.path / Path(name).name for name in files if name.endswith(PICTURES)]
    return {path.name: path.read_bytes() for path in paths if path.is_file()}


def verdict(summary: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Summary of a survey in words: a `sentence` with the result, and `concerns`, one sentence each; `names` are those
    of all scans."""
    unplaced, parts = summary["unplaced"], summary["components"]
    inside = len(names) - len(unplaced)
    place = "one map" if len(parts) == 1 else f"{len(parts)} separate maps"
    scans = f"all {inside} scans" if not unplaced else f"{inside} of {len(names)} scans"
    sentence = f"{scans} lie in {place}".capitalize()
    against = "".join(f"{_capital(each)}. " for each in summary.get("contradictions", []))
    return {
        "sentence": f"{against}{sentence}{_tilt(summary)}; {_loops(summary)}{_crossings(summary)}.",
        "concerns": list(_concerns(summary)),
    }


def counted(count: int, what: str) -> str:
    """A number of things, such as "1 loop" or "no loops"."""
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def _loops(summary: Mapping[str, Any]) -> str:
    loops = summary["pairs"]["by_role"].get("loop", {"tried": 0, "kept": 0})
    if not loops["tried"]:
        return "no loops were tried"
    return f"{loops['kept']} of {counted(loops['tried'], 'loop')} {'was' if loops['kept'] == 1 else 'were'} kept"


def _tilt(summary: Mapping[str, Any]) -> str:
    """Clause about an unknown or uncertain tilt of the largest map; empty otherwise."""
    part = summary["components"][0]
    if {"tilt_x", "tilt_y"}.intersection(part["unmeasured"]):
        return ", whose tilt is not known: navigation does not determine it"
    sigma = min((summary["scans"][k]["sigmas"]["rotation_deg"] for k in part["scans"]), default=0.0)
    return f", whose tilt and heading are known to {sigma:.0f}° alone" if sigma >= _UNSURE else ""


def _capital(sentence: str) -> str:
    return sentence[0].upper() + sentence[1:]


def _crossings(summary: Mapping[str, Any]) -> str:
    error = summary["crossing_error_m"]
    if not error["pairs"]:
        return ""
    after, before = error["after"], error["before"]
    return f"; where the track crosses itself scans lie {after:.2g} m apart ({before:.2g} m before the loops)"


def _concerns(summary: Mapping[str, Any]) -> Iterator[str]:
    """Warnings of the map except contradictions, scans that could not be read, and little overlap."""
    against = summary.get("contradictions", [])
    yield from (f"{_capital(each)}.".replace("`", "") for each in summary.get("warnings", []) if each not in against)
    if unread := [row["name"] for row in summary["unread"]]:
        more = f" and {len(unread) - LISTED} more" if len(unread) > LISTED else ""
        yield f"{counted(len(unread), 'scan')} could not be read: {', '.join(unread[:LISTED])}{more}."
    several = summary["components"][0]["map"]["seen_by_two_or_more"]
    if several < _FEW:
        yield f"Only {several:.0%} of the map was seen by more than one scan; the rest is not confirmed."


ANGLES, AXES = ("roll", "pitch", "heading"), ("East", "North", "Up")  # the order of a prior's numbers
_DIGITS = 5  # decimals of lengths [m]
_TURN_DIGITS = 8  # decimals of a quaternion: a point 100 m away moves by micrometers
_SHORT = 4  # significant digits of numbers that are only read
_PLACES = ("point", "known", "estimated", "sigma")  # of a control point: three numbers each


def track_of(part: MapPart, graph: Mapping[str, Any]) -> dict[str, Any]:
    """Poses of a map: scans, places (positions) [m], turns (quaternions x, y, z, w of R_world_sensor), and
    half axes of their ellipsoids, (3, 3) as rows x, y, z [m]: sigmas along the principal axes, in the map's frame.
    `overlaps` has the overlap of each scan with its predecessor, or null."""
    R = part.trajectory.T_world_sensor.rotation.as_matrix()
    variances, directions = np.linalg.eigh(R @ part.covariances[:, 3:, 3:] @ R.transpose(0, 2, 1))
    half_axes = (directions * np.sqrt(np.maximum(variances, 0.0))[:, None, :]).transpose(0, 2, 1)
    sequential = [pair for pair in graph["pairs"] if pair["role"] == "sequential"]
    overlaps = {int(pair["source"]): _short(pair.get("overlap")) for pair in sequential}
    return {
        "scans": list(part.scans),
        "places": np.round(part.trajectory.T_world_sensor.translation, _DIGITS).tolist(),
        "turns": np.round(part.trajectory.T_world_sensor.rotation.as_quat(), _TURN_DIGITS).tolist(),
        "half_axes": np.round(half_axes, _DIGITS).tolist(),
        "overlaps": [overlaps.get(scan) for scan in part.scans],
    }


def kept_sequential(pairs: Sequence[Mapping[str, Any]]) -> list[tuple[int, int]]:
    """Target and source of the consecutive pairs that were kept, which `pair_rows` leaves out."""
    return [
        (int(pair["target"]), int(pair["source"])) for pair in pairs if pair["role"] == "sequential" and pair["kept"]
    ]


def pair_rows(pairs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of all pairs but the consecutive ones that were kept: verdict, reason and evidence."""
    numbers = ("overlap", "probability", "sigmas_from_estimate", "residual_sigmas")
    return [
        {"target": int(pair["target"]), "source": int(pair["source"]), "role": str(pair["role"])}
        | {"kept": bool(pair["kept"]), "reason": str(pair["reason"])}
        | {name: _short(pair.get(name)) for name in numbers}
        for pair in pairs
        if pair["role"] != "sequential" or not pair["kept"]
    ]


def crossing_rows(graph: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Distances between the scans of each crossing [m]; none for a graph.json of an earlier version."""
    numbers = ("before_m", "before_90_m", "after_m", "after_90_m")
    return [
        {"target": int(row["i"]), "source": int(row["j"])} | {name: _short(row[name]) for name in numbers}
        for row in graph.get("crossings", ())
    ]


def navigation_rows(graph: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Differences between poses and their measurements by instruments, one row per measured scan: for each of ANGLES
    [deg] and AXES [m] the map's value less the measured one, and the measurement's sigma; None where not measured."""
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


def tie_rows(summary: Mapping[str, Any], names: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of the map's ties: names of scans, verdict, note, effect, and the transform if there is one."""
    return [
        {end: _name(tie[end], names) for end in ("target", "source")}
        | {"verdict": str(tie["verdict"])}
        | {text: str(tie.get(text) or "") for text in ("note", "effect")}
        | {"transform": {name: float(tie[name]) for name in TRANSFORM if tie.get(name) is not None}}
        for tie in summary.get("ties") or ()
    ]


def control_rows(summary: Mapping[str, Any], parts: Sequence[MapPart], names: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of the map's control points, from summary.json; residuals are estimated less known [m]. `counted` is whether
    the residual measures the map's error: the point's part is in the world, and the point was not left out."""
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


def _name(scan: Any, names: Sequence[str]) -> str:
    return names[scan] if isinstance(scan, int) else str(scan)


def _poses(matrices: Sequence[Any]) -> RigidTransform:
    return RigidTransform.concatenate([rigid_transform(matrix, "a pose") for matrix in matrices])


def _short(value: Any) -> float | None:
    """A number with few digits; None for one that is missing or not finite."""
    if value is None or not np.isfinite(value):
        return None
    return float(f"{value:.{_SHORT}g}")
