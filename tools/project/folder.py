"""The folder that `sonarmap map` writes."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from kernels.errors import InputError
from kernels.opencl.device import Device
from slam.graph.pose_graph import PoseGraph
from slam.map.point_map import PointMap
from slam.mapper import SurveyResult
from tools.project.parts import placed
from tools.project.summary import survey_summary
from tools.readers.scans import Unread
from tools.report.loops_picture import draw_loops
from tools.report.map_picture import draw_map
from tools.writers.atomic import all_or_none
from tools.writers.g2o import write_g2o
from tools.writers.json_text import write_json
from tools.writers.kitti import write_kitti
from tools.writers.points import write_points
from tools.writers.tum import write_tum

GRAPH, SUMMARY, TIMES, JOURNAL = "graph.g2o", "summary.json", "times.json", "journal.sqlite"
_ALSO = {"pcd": "map{}.pcd", "kitti": "trajectory{}.kitti"}
_MAP = re.compile(r"map(_\d+)?(_survey_\d+)?\.(ply|pcd)")
_LAYER = re.compile(r"_survey_(\d+)$")
_OF_PART = re.compile(_MAP.pattern + r"|(map|loops)(_\d+)?\.png|trajectory(_\d+)?\.(tum|kitti)")


def part_files(result: SurveyResult, rank: int, also: Iterable[str] = ()) -> list[str]:
    """The files of a component that is a map, 1 for the largest, with those of further formats ("pcd", "kitti")."""
    c = placed(result.components)[rank - 1]
    names = ["map{}.ply", "map{}.png", "trajectory{}.tum", *(_ALSO[name] for name in also)]
    kinds = ("ply", "pcd") if "pcd" in also else ("ply",)
    names += [f"map{{}}_survey_{number}.{kind}" for number in result.parts[c].layers for kind in kinds]
    if any(_loops(result, c)):
        names.append("loops{}.png")
    return [name.format("" if rank == 1 else f"_{rank}") for name in names]


def require_apart(folder: Path, files: Iterable[Path]) -> None:
    """Refuse to take for a scan what an earlier run wrote to `folder`, or to write over a scan.

    Raises:
        InputError: naming the file.
    """
    for path in files:
        if _MAP.fullmatch(path.name) and path.parent.resolve() == folder.resolve():
            raise InputError(
                f"{path} is among the scans, and {folder} is where the map is written: it would be written over, or "
                "is the map of an earlier run. Leave it out, or choose another output folder."
            )


def write_survey(
    folder: Path,
    result: SurveyResult,
    names: Sequence[str],
    settings: Mapping[str, Any],
    device: Device | None,
    unread: Sequence[Unread] = (),
    also: Sequence[str] = (),
    times: Mapping[str, Any] | None = None,
) -> Path:
    """Write a survey's maps, pictures, trajectories, graph and summary.

    The largest component is map.ply, map.png and trajectory.tum; the others follow as map_2 and so on. A scan that
    nothing joined is in no map. Where loops were tried, loops.png compares the map with what it would be without them.
    Where there are several surveys, map_survey_0.ply and so on are the maps of each one's scans alone. The graph holds
    all components. All files appear together or, where one cannot be written, none does; what the folder's earlier run
    had beyond this one's files is removed.

    Args:
        folder: made where it is missing.
        result: the survey, of the scans with these `names`.
        settings, unread: for the summary.
        device: what it ran on; None for a method that takes none.
        also: "pcd" for maps in that format too, "kitti" for trajectories.
        times: what the run took, for times.json, which is not named in the summary; None for no such file.

    Returns:
        The path of summary.json, which is written last.

    Raises:
        InputError: a file cannot be written.
    """
    former = _files_before(folder)
    files = [part_files(result, rank, also) for rank in range(1, len(placed(result.components)) + 1)]
    description = {"name": device.name, "platform": device.platform} if device else None
    summary = survey_summary(result, list(names), settings, description, unread)
    with all_or_none():
        _write_files(folder, result, names, files)
        write_json(folder / SUMMARY, summary | {"files": [*chain.from_iterable(files), GRAPH, SUMMARY]})
        if times is not None:
            write_json(folder / TIMES, times)
    for name in former.difference(*files):
        (folder / name).unlink(missing_ok=True)
    return folder / SUMMARY


def _files_before(folder: Path) -> set[str]:
    """The components' files of the folder's earlier run, by its summary; none where there is none to be read."""
    try:
        names = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["files"]
        return {name for name in names if _OF_PART.fullmatch(name)}
    except (OSError, ValueError, LookupError, TypeError):  # not there, or not ours: then nothing of it is removed
        return set()


def _write_files(folder: Path, result: SurveyResult, names: Sequence[str], files: Sequence[Sequence[str]]) -> None:
    """Write the graph, and every component that is a map as its `files` name it."""
    for c, listed in zip(placed(result.components), files, strict=True):
        for name in listed:
            _write_part(folder / name, result, c, [names[k] for k in result.components[c]])
    write_g2o(folder / GRAPH, PoseGraph(result.trajectory, result.edges))


def _write_part(path: Path, result: SurveyResult, c: int, names: Sequence[str]) -> None:
    """Write one file of a component, whose scans have these names; the file's name says which."""
    maps, trajectory = result.parts[c], result.trajectory.take(result.components[c])
    layer = _LAYER.search(path.stem)
    point_map = maps.layers[int(layer[1])] if layer else maps.optimized
    match path.suffix:
        case ".tum":
            write_tum(path, trajectory)
        case ".kitti":
            write_kitti(path, trajectory)
        case ".png" if path.stem.startswith("loops"):
            draw_loops(path, (maps.chained, maps.chained_poses), (point_map, trajectory), *_loops(result, c))
        case ".png":
            scans = "1 scan" if len(names) == 1 else f"{len(names)} scans"
            title = f"{scans}, {len(point_map.points):,} points, voxel {point_map.voxel:.3g} m"
            draw_map(path, point_map, trajectory, names, title)
        case _:
            write_points(path, point_map.points, _columns(point_map))


def _loops(result: SurveyResult, c: int) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """The loops within a component that were kept, and those that were not, as places among its scans."""
    place = {scan: k for k, scan in enumerate(result.components[c])}
    tried = [p for p in result.pairs if p.role == "loop" and p.i in place and p.j in place]
    kept, refused = ([(place[p.i], place[p.j]) for p in tried if p.kept == wanted] for wanted in (True, False))
    return kept, refused


def _columns(point_map: PointMap) -> dict[str, np.ndarray]:
    """What a map's file tells of every point beside its place."""
    names = ("count", "seen", "sigma", "scan", "survey")
    echo = {} if point_map.strength is None else {"intensity": point_map.strength}
    return {name: getattr(point_map, name) for name in names} | echo
