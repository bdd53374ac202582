"""The folder that `sonarmap map` writes."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from kernels.device import Device
from kernels.errors import InputError
from slam.pose_graph import PoseGraph
from slam.survey import SurveyResult
from slam.trajectory import Trajectory
from tools.atomic import all_or_none
from tools.readers import Unread
from tools.report.map_picture import draw_map
from tools.writers import write_points
from tools.writers.g2o import write_g2o
from tools.writers.kitti import write_kitti
from tools.writers.summary import survey_summary, write_summary
from tools.writers.tum import write_tum

GRAPH, SUMMARY = "graph.g2o", "summary.json"
_ALSO = {"pcd": "map{}.pcd", "kitti": "trajectory{}.kitti"}
_MAP = re.compile(r"map(_\d+)?\.(ply|pcd)")
_OF_PART = re.compile(r"map(_\d+)?\.(ply|png|pcd)|trajectory(_\d+)?\.(tum|kitti)")


def part_files(rank: int, also: Iterable[str] = ()) -> list[str]:
    """The files of a component, 1 for the largest, with those of further formats ("pcd", "kitti")."""
    names = ["map{}.ply", "map{}.png", "trajectory{}.tum", *(_ALSO[name] for name in also)]
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
) -> Path:
    """Write a survey's maps, pictures, trajectories, graph and summary.

    The largest component is map.ply, map.png and trajectory.tum; the others follow as map_2 and so on. The graph
    holds all of them. All files appear together or, where one cannot be written, none does; what the folder's earlier
    run had beyond this one's files is removed.

    Args:
        folder: made where it is missing.
        result: the survey, of the scans with these `names`.
        settings, unread: for the summary.
        device: what it ran on; None for a method that takes none.
        also: "pcd" for maps in that format too, "kitti" for trajectories.

    Returns:
        The path of summary.json, which is written last.

    Raises:
        InputError: a file cannot be written.
    """
    former = _files_before(folder)
    written = [name for rank in range(1, len(result.components) + 1) for name in part_files(rank, also)]
    description = {"name": device.name, "platform": device.platform} if device else None
    summary = survey_summary(result, list(names), settings, description, unread)
    with all_or_none():
        _write_files(folder, result, names, also)
        write_summary(folder / SUMMARY, summary | {"files": [*written, GRAPH, SUMMARY]})
    for name in former.difference(written):
        (folder / name).unlink(missing_ok=True)
    return folder / SUMMARY


def _files_before(folder: Path) -> set[str]:
    """The components' files of the folder's earlier run, by its summary; none where there is none to be read."""
    try:
        names = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["files"]
        return {name for name in names if _OF_PART.fullmatch(name)}
    except (OSError, ValueError, LookupError, TypeError):  # not there, or not ours: then nothing of it is removed
        return set()


def _write_files(folder: Path, result: SurveyResult, names: Sequence[str], also: Sequence[str]) -> None:
    order = sorted(range(len(result.components)), key=lambda c: (-len(result.components[c]), c))
    for rank, c in enumerate(order, start=1):
        _write_component(folder, part_files(rank, also), result, c, [names[k] for k in result.components[c]])
    write_g2o(folder / GRAPH, PoseGraph(result.trajectory, result.edges))


def _write_component(folder: Path, files: Sequence[str], result: SurveyResult, c: int, names: Sequence[str]) -> None:
    """Write one component in every format that `files` name by their suffixes."""
    point_map, members = result.maps[c], result.components[c]
    trajectory: Trajectory = result.trajectory.take(members)
    columns = {
        "scan": point_map.scan,
        "seen": point_map.seen,
        "count": point_map.count,
        "sigma": point_map.sigma,
        "survey": point_map.survey,
    }
    if point_map.strength is not None:
        columns["intensity"] = point_map.strength
    title = f"{len(members)} scans, {len(point_map.points):,} points, voxel {point_map.voxel:.3g} m"
    for path in (folder / name for name in files):
        match path.suffix:
            case ".tum":
                write_tum(path, trajectory)
            case ".kitti":
                write_kitti(path, trajectory)
            case ".png":
                draw_map(path, point_map, trajectory, names, title)
            case _:
                write_points(path, point_map.points, columns)
