"""All that the page shows, as one value for JSON; the bytes of points and pictures apart."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.tools.files.geo.georeference import VERTICALS
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.products.report import evidence
from sonarmap.tools.products.report.points import MOST_CODE, codes, doubtful_of, pack
from sonarmap.tools.products.report.provenance import citation, inputs_of, map_command, setting_rows, title

PICTURES = (".png",)
_EXTREMES = (0.01, 0.99)  # quantiles of heights between which the colors change
_STRAY = 0.005  # share of the points on either side that may lie out of sight at first
LISTED = 5  # names in a sentence
_UNSURE = 3.0  # standard deviation of a map's rotation that is said [deg]
_FEW = 0.5  # share of the voxels that several scans should have seen


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
    files: Sequence[str] = folder.summary.get("files", [])
    paths = [folder.path / Path(name).name for name in files if name.endswith(PICTURES)]
    return {path.name: path.read_bytes() for path in paths if path.is_file()}


def verdict(summary: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """What summary.json says, in words: a `sentence` about what came of the survey, and `concerns`, what its user
    should look at, a sentence each; names are of all the survey's scans."""
    unplaced, parts = summary["unplaced"], summary["components"]
    inside = len(names) - len(unplaced)
    place = "one map" if len(parts) == 1 else f"{len(parts)} separate maps"
    scans = f"all {inside} scans" if not unplaced else f"{inside} of {len(names)} scans"
    sentence = f"{scans} lie in {place}".capitalize()
    against = "".join(f"{_capital(each)}. " for each in summary.get("contradictions", []))
    return {
        "sentence": f"{against}{sentence}{_tilt(summary)}; {_loops(summary)}{_crossings(summary)}.",
        "concerns": list(_concerns(summary, names)),
    }


def counted(count: int, what: str) -> str:
    """A number of things, such as "1 loop" or "no loops"."""
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def listed(names: Sequence[str]) -> str:
    return ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")


def _named(scans: Sequence[int | None], names: Sequence[str]) -> list[str]:
    return ["?" if scan is None else names[scan] for scan in scans]


def _loops(summary: Mapping[str, Any]) -> str:
    loops = summary["pairs"]["by_role"].get("loop", {"tried": 0, "kept": 0})
    if not loops["tried"]:
        return "no loops were tried"
    return f"{loops['kept']} of {counted(loops['tried'], 'loop')} {'was' if loops['kept'] == 1 else 'were'} kept"


def _tilt(summary: Mapping[str, Any]) -> str:
    """That the tilt of the largest map is not known, or not well, where navigation places it."""
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


def _concerns(summary: Mapping[str, Any], names: Sequence[str]) -> Iterator[str]:
    parts = summary["components"]
    if len(parts) > 1:
        separate = f"there are {len(parts)} separate maps, each in a frame of its own"
        yield f"No reliable registration joins all scans: {separate}."
    odd = summary.get("odd_scans", [])  # which earlier maps do not have
    yield from (f"{row['reason']}." for row in odd)
    outside = [scan for scan in summary["unplaced"] if scan not in {row["index"] for row in odd}]
    lost, alone = _named(outside, names), _named(summary["by_navigation"], names)
    for what, words, listing in (
        ("scan", "in no map: no reliable registration joins them to the others", lost),
        ("scan", "placed by navigation alone: no reliable registration joins them", alone),
        ("scan", "could not be read", [row["name"] for row in summary["unread"]]),
        ("gap", "between consecutive scans", [" to ".join(_named(gap, names)) for gap in summary["gaps"]]),
    ):
        if listing:
            yield f"{counted(len(listing), what)} {words}: {listed(listing)}."
    # which earlier maps do not have either
    rows = [*summary.get("understated", []), *([summary["systematic"]] if summary.get("systematic") else [])]
    reasons = [row["reason"] for row in rows if row["reason"] not in summary.get("contradictions", [])]
    yield from (f"{_capital(reason)}." for reason in reasons)
    for fix in summary["wrong_fixes"]:
        away = f"{fix['sigmas']:.1f} standard deviations from everything else"
        yield f"The {fix['kind']} of {fix['name']} is {away}; it is left out."
    if not summary["graph"]["converged"]:
        yield "The optimization of the poses stopped before it converged."
    several = parts[0]["map"]["seen_by_two_or_more"]
    if several < _FEW:
        yield f"Only {several:.0%} of the map was seen by more than one scan; the rest is not confirmed."
