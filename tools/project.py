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
from tools.writers import write_ply
from tools.writers.g2o import write_g2o
from tools.writers.summary import survey_summary, write_summary
from tools.writers.tum import write_tum

SUMMARY = "summary.json"
_MAP = re.compile(r"map(_\d+)?\.ply")


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
    device: Device,
    unread: Sequence[Unread] = (),
) -> Path:
    """Write a survey's maps, pictures, trajectories, graph and summary.

    The largest component is map.ply, map.png and trajectory.tum; the others follow as map_2 and so on. The graph
    holds all of them. All files appear together or, where one cannot be written, none does; parts that the folder's
    earlier run had beyond this one's are removed.

    Returns:
        The path of summary.json, which is written last.

    Raises:
        InputError: a file cannot be written.
    """
    former = _parts_before(folder)
    with all_or_none():
        _write_files(folder, result, names, settings, device, unread)
    for rank in range(len(result.components) + 1, former + 1):
        for name in (f"map_{rank}.ply", f"map_{rank}.png", f"trajectory_{rank}.tum"):
            (folder / name).unlink(missing_ok=True)
    return folder / SUMMARY


def _parts_before(folder: Path) -> int:
    """How many components the folder's earlier run wrote, by its summary; 0 where there is none to be read."""
    try:
        return len(json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["components"])
    except (OSError, ValueError, LookupError, TypeError):  # not there, or not ours: then nothing of it is removed
        return 0


def _write_files(
    folder: Path,
    result: SurveyResult,
    names: Sequence[str],
    settings: Mapping[str, Any],
    device: Device,
    unread: Sequence[Unread],
) -> None:
    order = sorted(range(len(result.components)), key=lambda c: (-len(result.components[c]), c))
    for rank, c in enumerate(order, start=1):
        suffix = "" if rank == 1 else f"_{rank}"
        members = result.components[c]
        _write_component(folder, suffix, result, c, [names[k] for k in members])
    write_g2o(folder / "graph.g2o", PoseGraph(result.trajectory, result.edges))
    description = {"name": device.name, "platform": device.platform}
    write_summary(folder / SUMMARY, survey_summary(result, list(names), settings, description, unread))


def _write_component(folder: Path, suffix: str, result: SurveyResult, c: int, names: Sequence[str]) -> None:
    point_map, members = result.maps[c], result.components[c]
    trajectory: Trajectory = result.trajectory.take(members)
    columns = {"scan": point_map.scan, "seen": point_map.seen, "hits": point_map.hits}
    if point_map.strength is not None:
        columns["intensity"] = point_map.strength
    write_ply(folder / f"map{suffix}.ply", point_map.points, columns)
    write_tum(folder / f"trajectory{suffix}.tum", trajectory)
    title = f"{len(members)} scans, {len(point_map.points):,} points, voxel {point_map.voxel:.3g} m"
    draw_map(folder / f"map{suffix}.png", point_map, trajectory, names, title)
