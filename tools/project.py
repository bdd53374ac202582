"""The folder that `sonarmap map` writes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kernels.device import Device
from slam.pose_graph import PoseGraph
from slam.survey import SurveyResult
from slam.trajectory import Trajectory
from tools.atomic import atomic_path
from tools.report.map_picture import draw_map
from tools.writers import write_ply
from tools.writers.g2o import write_g2o
from tools.writers.summary import survey_summary, write_summary
from tools.writers.tum import write_tum


def require_writable(folder: Path) -> None:
    """Refuse a folder that cannot be written before hours are spent on what should go into it.

    Raises:
        InputError: it cannot.
    """
    with atomic_path(folder / "probe"):
        pass
    (folder / "probe").unlink()


def write_survey(
    folder: Path, result: SurveyResult, names: Sequence[str], settings: Mapping[str, Any], device: Device
) -> Path:
    """Write a survey's maps, pictures, trajectories, graph and summary.

    The largest component is map.ply, map.png and trajectory.tum; the others follow as map_2 and so on. The graph
    holds all of them.

    Returns:
        The path of summary.json, which is written last.

    Raises:
        InputError: a file cannot be written.
    """
    order = sorted(range(len(result.components)), key=lambda c: (-len(result.components[c]), c))
    for rank, c in enumerate(order, start=1):
        suffix = "" if rank == 1 else f"_{rank}"
        members = result.components[c]
        _write_component(folder, suffix, result, c, [names[k] for k in members])
    write_g2o(folder / "graph.g2o", PoseGraph(result.trajectory, result.edges))
    description = {"name": device.name, "platform": device.platform}
    write_summary(folder / "summary.json", survey_summary(result, list(names), settings, description))
    return folder / "summary.json"


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
