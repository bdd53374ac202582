"""The folder that `sonarmap map` writes. `summary.json` holds settings, inputs and results of a run; `graph.json` holds
the whole pose graph, with what a g2o file cannot hold."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, get_args

import numpy as np

from sonarmap.kernels.device.device import Device
from sonarmap.slam.execute.runner import Timings
from sonarmap.slam.graph.gauge import MEASURED
from sonarmap.slam.graph.tangent import worst_sigmas
from sonarmap.slam.map.crossing import Crossing, CrossingError
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.motion.straighten import Way
from sonarmap.slam.pair import Pair, Role
from sonarmap.slam.parts import placed, unplaced
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.names import (
    FULL_GRAPH,
    GRAPH,
    JOURNAL,
    OF_ALL,
    OF_EACH,
    PICTURE,
    TIMES,
    checksums,
    earlier_files,
    write_summary,
)
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.files.readers.csv_table import PAIRS, SUMMARY
from sonarmap.tools.files.readers.scans import Unread
from sonarmap.tools.files.readers.trajectory import FORMAT
from sonarmap.tools.files.user_file import package_versions
from sonarmap.tools.files.writers.atomic import all_or_none, discard
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.poses import write_g2o, write_tum
from sonarmap.tools.files.writers.tables import write_json
from sonarmap.tools.products.output.faults import contradictions, faults, odd_rows, systematic_words, understated_rows
from sonarmap.tools.products.output.pairs_file import (
    control_fit,
    control_rows,
    fields_of,
    pair_row,
    registration_of,
    tie_rows,
    write_pairs,
)
from sonarmap.tools.products.report.pictures import draw_map
from sonarmap.tools.products.report.provenance import inputs_of

_LAYER = re.compile(r"_survey_(\d+)$")
_ALL = re.compile(r"map_all(_\d+)?(_survey_\d+)?")


@dataclass(frozen=True, slots=True)
class SurveyRun:
    """How a survey was mapped, for its summary.json.

    names: of the scans, in their order.
    settings: as given by the user or chosen; values may be dataclasses.
    device: on which it ran; None for a method without a device.
    inputs: the files, as `input_rows` describes them.
    georeference: of the map's origin; None where it is not known.
    times: content of times.json, see `survey_times`; None for no such file.
    found: what was wrong with the instruments before the map was made, in words."""

    names: Sequence[str]
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    device: Device | None = None
    unread: Sequence[Unread] = ()
    inputs: Sequence[Mapping[str, Any]] = ()
    georeference: Georeference | None = None
    times: Mapping[str, Any] | None = None
    found: Sequence[str] = ()


def part_files(result: SurveyResult, rank: int) -> list[str]:
    """Names of the files of map number `rank`, 1 for the largest component."""
    c = placed(result.components)[rank - 1]
    layers = [f"{{}}_survey_{number}" for number in result.parts[c].layers]
    names = [*OF_EACH, *(f"map{layer}.ply" for layer in layers)]
    if result.parts[c].doubtful is not None:
        names += [f"map_all{layer}.ply" for layer in ("{}", *layers)]
    return [name.format("" if rank == 1 else f"_{rank}") for name in names]


def write_survey(folder: Path, result: SurveyResult, run: SurveyRun) -> Path:
    """Write a survey's maps, a picture of each, trajectories, graph, pairs and summary, and return the summary's path.

    The largest component is map.ply, map.png and trajectory.tum; the others are map_2 and so on. A scan that nothing
    joins is in no map. If there are several surveys, map_survey_0.ply and so on are the maps of each survey's scans.
    map_all.ply adds to map.ply the points that were left out because too few scans saw them; map_all_survey_0.ply and
    so on do so for each survey. The graph holds all components. All files are written or none; other files and exports
    of an earlier run are removed. The folder is created if it is missing."""
    earlier = earlier_files(folder)
    files = [part_files(result, rank) for rank in range(1, len(placed(result.components)) + 1)]
    summary = survey_summary(result, run)
    with all_or_none() as written:
        _write_files(folder, result, run.names, files)
        known = checksums(written)
        _draw_maps(folder, result, run, files)
        if run.times is not None:
            write_json(folder / TIMES, run.times)
        listed = [*chain.from_iterable(files), *OF_ALL]
        write_summary(folder, summary | {"files": listed, "checksums": known})  # last: it vouches for the others
    for name in earlier.difference(*files, OF_ALL, (TIMES, JOURNAL)):
        discard(folder / name)
    return folder / SUMMARY


def _write_files(folder: Path, result: SurveyResult, names: Sequence[str], files: Sequence[Sequence[str]]) -> None:
    """Write the graph, the pairs, and the `files` of every map but its picture."""
    for c, listed in zip(placed(result.components), files, strict=True):
        for name in (name for name in listed if not name.endswith(PICTURE)):
            _write_part(folder / name, result, c)
    mapped = {scan for c in placed(result.components) for scan in result.components[c]}
    write_pairs(folder / PAIRS, result.pairs)
    write_json(folder / FULL_GRAPH, survey_graph(result, names))
    write_g2o(folder / GRAPH, result.solution.graph, set(range(len(result.trajectory))) - mapped)


def _draw_maps(folder: Path, result: SurveyResult, run: SurveyRun, files: Sequence[Sequence[str]]) -> None:
    """Write the picture among the `files` of every map."""
    for rank, listed in enumerate(files, 1):
        for name in (name for name in listed if name.endswith(PICTURE)):
            draw_map(folder / name, result, rank, inputs_of(run.settings), run.georeference)


def _write_part(path: Path, result: SurveyResult, c: int) -> None:
    """Write the file of component `c` that the name of `path` stands for."""
    maps, trajectory = result.parts[c], result.trajectory.take(result.components[c])
    layer = _LAYER.search(path.stem)
    survey = maps.layers[int(layer[1])] if layer else None
    point_map, doubtful = (survey.clean, survey.doubtful) if survey else (maps.optimized, maps.doubtful)
    match path.suffix:
        case ".tum":
            write_tum(path, trajectory)
        case _ if _ALL.fullmatch(path.stem):
            write_ply(path, *_both_layers(point_map, doubtful))
        case _:
            write_ply(path, point_map.points, _columns(point_map))


def _both_layers(clean: PointMap, doubtful: PointMap | None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points of a map followed by its doubtful points, and their common columns."""
    layers = [layer for layer in (clean, doubtful) if layer is not None]
    of_each = [_columns(layer) | ({} if layer.looked is None else {"looked": layer.looked}) for layer in layers]
    columns = {name: np.concatenate([columns[name] for columns in of_each]) for name in of_each[0]}
    columns["doubtful"] = np.repeat(np.arange(len(layers), dtype=np.uint8), [len(layer.points) for layer in layers])
    return np.concatenate([layer.points for layer in layers]), columns


def _columns(point_map: PointMap) -> dict[str, np.ndarray]:
    """Columns of a map's PLY file after the coordinates."""
    names = ("count", "seen", "sigma", "scan", "survey")
    echo = {} if point_map.strength is None else {"intensity": point_map.strength}
    return {name: getattr(point_map, name) for name in names} | echo


def survey_times(timings: Timings, workers: int) -> dict[str, Any]:
    """Content of `times.json`: times and memory, which differ between runs; `workers` is the number of processes."""
    return {
        "workers": workers,
        "pairs_from_journal": timings.from_journal,
        "pairs": timings.pairs,
        "stages_s": timings.stages,
        "peak_memory_bytes": peak_memory(),
    }


def survey_summary(result: SurveyResult, run: SurveyRun) -> dict[str, Any]:
    """Content of summary.json; "gaps" lists pairs that failed, then the neighbors of unread scans, null at an end."""
    solution, graph, names = result.solution, result.solution.graph, list(run.names)
    gaps = [_gap(scan.before, len(names)) for scan in run.unread]
    return {
        "versions": package_versions(),
        "device": {"name": run.device.name, "platform": run.device.platform} if run.device else None,
        "settings": run.settings,
        "inputs": run.inputs,
        "georeference": run.georeference.to_json() if run.georeference else None,
        "scans": [
            {**row, "sigmas": sigmas}
            for row, sigmas in zip(scan_rows(result, names), pose_sigmas(result.covariances), strict=True)
        ],
        "pairs": _pair_counts(result.pairs),
        "gaps": list(dict.fromkeys([*result.gaps, *gaps])),
        "unread": [
            {"name": scan.where, "reason": scan.reason, "gap": gap} for scan, gap in zip(run.unread, gaps, strict=True)
        ],
        "components": [_component_row(result, c, graph.gauge.unmeasured) for c in placed(result.components)],
        "unplaced": unplaced(result.components),
        "odd_scans": odd_rows(result, names),
        "scaled_scans": result.scaled and asdict(result.scaled),
        "key_scans": result.keys,
        "interpolated": result.interpolated,
        "straightened": result.straightened,
        "by_navigation": result.by_navigation,
        "warnings": [*run.found, *faults(result, names)],
        "wrong_fixes": [{"name": names[fix.scan], **asdict(fix)} for fix in result.wrong_fixes],
        "measured": {
            kind: {"used": used, "given": given, "median_sigmas": sigmas}
            for kind, (used, given, sigmas) in result.agreement.items()
        },
        "understated": understated_rows(result),
        "contradictions": contradictions(result),
        "systematic": result.systematic
        and {**asdict(result.systematic), "reason": systematic_words(result.systematic)},
        "ties": tie_rows(result, names),
        "control_points": control_rows(result, names),
        "control": control_fit(result, names),
        "crossing_error_m": crossing_row(CrossingError.of(part.crossings for part in result.parts)),
        "graph": {
            "edges": len(graph.edges),
            "loops": sum(pair.kept and pair.role == "loop" for pair in result.pairs),
            "bridges": sum(pair.kept and pair.role == "bridge" for pair in result.pairs),
            **fields_of(solution, "chi_squared_before", "chi_squared_after"),
            **fields_of(solution, "degrees_of_freedom", "iterations", "converged"),
        },
    }


def scan_rows(result: SurveyResult, names: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of summary.json for the scans: name, stamp, survey, and the covariance of the pose."""
    columns = zip(result.trajectory.stamps, result.surveys, result.covariances, strict=True)
    return [
        {"index": k, "name": name, "stamp": stamp, "survey": survey, "covariance": covariance}
        for k, (name, (stamp, survey, covariance)) in enumerate(zip(names, columns, strict=True))
    ]


def _gap(before: int, count: int) -> tuple[int | None, int | None]:
    return before - 1 if before > 0 else None, before if before < count else None


def _pair_counts(pairs: Sequence[Pair]) -> dict[str, Any]:
    """Numbers of pairs tried and kept, in total and by role, and the name of the file that lists them."""
    tried, kept = Counter(pair.role for pair in pairs), Counter(pair.role for pair in pairs if pair.kept)
    by_role = {role: {"tried": tried[role], "kept": kept[role]} for role in get_args(Role) if tried[role]}
    return {"file": PAIRS, "tried": len(pairs), "kept": kept.total(), "by_role": by_role}


def pose_sigmas(covariances: np.ndarray) -> list[dict[str, float]]:
    """Standard deviations of each pose along its worst directions, from covariances (N, 6, 6)."""
    sigmas = np.transpose(worst_sigmas(covariances)).tolist()
    return [{"rotation_deg": math.degrees(r), "translation_m": t} for r, t in sigmas]


def _component_row(result: SurveyResult, c: int, unmeasured: Mapping[int, np.ndarray]) -> dict[str, Any]:
    """Row of a map, with statistics of the layer of each survey; `unmeasured` is that of the graph's gauge."""
    members = result.components[c]
    free = next((unmeasured[pose] for pose in members if pose in unmeasured), np.zeros(6, dtype=bool))
    row = {
        "scans": members,
        "unmeasured": [name for name, unknown in zip(MEASURED, free, strict=True) if unknown],
        "map": map_statistics(result.maps[c]),
    }
    layers = {number: map_statistics(layer.clean) for number, layer in result.parts[c].layers.items()}
    return row | ({"surveys": layers} if layers else {})


def crossing_row(error: CrossingError) -> dict[str, Any]:
    """Distance between scans where the track crosses itself, before and after the loops; null without crossings."""
    row: dict[str, Any] = {"pairs": len(error.crossings)}
    for name, spread in (("before", error.before), ("after", error.after)):
        row[name] = spread.median if spread else None
        row[f"{name}_90"] = spread.most if spread else None
    return row


def map_statistics(point_map: PointMap) -> dict[str, Any]:
    """Size and extent of a map, and the share of its points that more than one scan saw."""
    return {
        "points": len(point_map.points),
        "voxel_m": point_map.voxel,
        "lower_m": point_map.points.min(axis=0),
        "upper_m": point_map.points.max(axis=0),
        "measured_points": point_map.count.sum(),
        "points_left_out": point_map.left_out,
        "contradicted_by_free_space": point_map.removed,
        "seen_by_too_few": point_map.doubted,
        "median_sigma_m": np.median(point_map.sigma),
        "seen_by_two_or_more": (point_map.seen >= 2).mean(),
        "most_scans_on_a_voxel": point_map.seen.max(),
    }


# Meaning of the numbers, for readers of the file without the documentation.
CONVENTIONS = {
    "T_world_sensor": "p_world = T p_sensor, 4x4 [m]; the world is East-North-Up where 'in_world', else the frame of "
    "the component's first pose; before_loops: from consecutive registrations and navigation alone",
    "T_i_j": "p_i = T p_j, 4x4 [m]; T_target_source likewise",
    "covariance": "6x6, rotation first [rad, m], of xi in T_true = T Exp(xi): body tangent of the pose, of j, or of "
    "the source",
    "crossings": "scans where the track crosses itself: their distance before and after the loops, median and 90th "
    "percentile [m]",
    "control_points": "points that the map is fitted to, in their pose's sensor frame, and known East, North, Up [m]",
    "straightened_by": "trajectory by which scans whose points have times were straightened, from the map before that",
    "prior": "sigmas of roll, pitch, heading [rad], East, North, Up [m]; null where not measured",
}


def survey_graph(result: SurveyResult, names: Sequence[str]) -> dict[str, Any]:
    """Content of graph.json: poses, edges with their covariances, every pair with its verdict, and priors."""
    graph = result.solution.graph
    component = {scan: number for number, members in enumerate(graph.components) for scan in members}
    measured = {pose for pose, _ in graph.priors} | {known.pose for known in graph.known}
    measured |= {point.scan for point in graph.control}
    in_world = [not measured.isdisjoint(members) for members in graph.components]
    keys = None if result.keys is None else set(result.keys)
    return {
        "format": FORMAT,
        "conventions": CONVENTIONS,
        "poses": [
            {
                **row,
                "component": component[k],
                "in_world": in_world[component[k]],
                "key_scan": keys is None or k in keys,
                "T_world_sensor": result.trajectory.T_world_sensor[k].as_matrix(),
                "T_world_sensor_before_loops": result.chained.T_world_sensor[k].as_matrix(),
            }
            for k, row in enumerate(scan_rows(result, names))
        ],
        "edges": [
            fields_of(edge, "i", "j", "kind")
            | {"T_i_j": edge.registration.T_target_source.as_matrix()}
            | fields_of(edge.registration, "covariance", "probability", "reason")
            for edge in graph.edges
        ],
        "pairs": [_pair_row(pair) for pair in result.pairs],
        "priors": [_prior_row(pose, prior) for pose, prior in graph.priors],
        "control_points": [
            {"name": point.name, "pose": point.scan, **fields_of(point, "point", "known", "sigmas")}
            for point in graph.control
        ],
        "wrong_fixes": [{"pose": fix.scan} | fields_of(fix, "kind", "sigmas", "place") for fix in result.wrong_fixes],
        "anchors": graph.anchors,
        "straightened_by": None if result.way is None else _way_row(result.way),
        "crossings": [_crossing_row(crossing) for part in result.parts for crossing in part.crossings.crossings],
    }


def _way_row(way: Way) -> Mapping[str, Any]:
    return {**fields_of(way, "runs", "bent", "turned"), "T_world_sensor": way.trajectory.T_world_sensor.as_matrix()}


def _pair_row(pair: Pair) -> Mapping[str, Any]:
    """Row of a pair with its verdict and, unless it failed, its transform and covariance."""
    registration = registration_of(pair)
    row = pair_row(pair) | ({"by_hand": pair.by_hand, "note": pair.note} if pair.by_hand else {})
    if registration is None:
        return row
    return {
        **row,
        "T_target_source": registration.T_target_source.as_matrix(),
        "covariance": registration.covariance,
        "step_psr": dict(registration.step_psr),
    }


def _crossing_row(crossing: Crossing) -> Mapping[str, Any]:
    before, after = crossing.before, crossing.after
    apart = {"before_m": before.median, "before_90_m": before.most, "after_m": after.median, "after_90_m": after.most}
    return {"i": crossing.i, "j": crossing.j, **apart}


def _prior_row(pose: int, prior: PosePrior) -> Mapping[str, Any]:
    sigmas = [sigma if np.isfinite(sigma) else None for sigma in prior.sigmas.tolist()]
    return {"pose": pose, "T_world_sensor": prior.T_world_sensor.as_matrix(), "sigmas": sigmas}
