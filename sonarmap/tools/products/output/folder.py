"""The folder that `sonarmap map` writes."""

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.parts import placed
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.map_folder.names import (
    FULL_GRAPH,
    GRAPH,
    JOURNAL,
    OF_ALL,
    OF_EACH,
    PICTURE,
    SUMMARY,
    TIMES,
    checksums,
    earlier_files,
    write_summary,
)
from sonarmap.tools.files.readers.csv_table import PAIRS
from sonarmap.tools.files.writers.atomic import all_or_none, discard
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.poses import write_g2o, write_tum
from sonarmap.tools.files.writers.tables import write_json
from sonarmap.tools.products.output.pairs_file import write_pairs
from sonarmap.tools.products.output.summary import SurveyRun, survey_graph, survey_summary
from sonarmap.tools.products.report.pictures import draw_map
from sonarmap.tools.products.report.provenance import inputs_of

_LAYER = re.compile(r"_survey_(\d+)$")
_ALL = re.compile(r"map_all(_\d+)?(_survey_\d+)?")


def part_files(result: SurveyResult, rank: int) -> list[str]:
    """The files of the component that is map number `rank`, 1 for the largest."""
    c = placed(result.components)[rank - 1]
    layers = [f"{{}}_survey_{number}" for number in result.parts[c].layers]
    names = [*OF_EACH, *(f"map{layer}.ply" for layer in layers)]
    if result.parts[c].doubtful is not None:
        names += [f"map_all{layer}.ply" for layer in ("{}", *layers)]
    return [name.format("" if rank == 1 else f"_{rank}") for name in names]


def write_survey(folder: Path, result: SurveyResult, run: SurveyRun) -> Path:
    """Write a survey's maps, a picture of each, trajectories, graph, pairs and summary, and return the summary's path.

    The largest component is map.ply, map.png and trajectory.tum; the others follow as map_2 and so on. A scan that
    nothing joined is in no map. Where there are several surveys, map_survey_0.ply and so on are the maps of each one's
    scans alone. map_all.ply has what map.ply has and the points that were left out of it, as too few scans saw them;
    map_all_survey_0.ply and so on have the same of the maps of each survey. The graph holds all components. All files
    appear together or, where one cannot be written, none does; what the folder's earlier run had beyond this one's
    files is removed, and so is what was exported of it.

    The folder is made where it is missing."""
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
    """Write the graph, the pairs, and the `files` of every component that is a map."""
    for c, listed in zip(placed(result.components), files, strict=True):
        for name in (name for name in listed if not name.endswith(PICTURE)):
            _write_part(folder / name, result, c)
    mapped = {scan for c in placed(result.components) for scan in result.components[c]}
    write_pairs(folder / PAIRS, result.pairs)
    write_json(folder / FULL_GRAPH, survey_graph(result, names))
    write_g2o(folder / GRAPH, result.solution.graph, set(range(len(result.trajectory))) - mapped)


def _draw_maps(folder: Path, result: SurveyResult, run: SurveyRun, files: Sequence[Sequence[str]]) -> None:
    """Draw every component: the picture that is among its `files`."""
    for rank, listed in enumerate(files, 1):
        for name in (name for name in listed if name.endswith(PICTURE)):
            draw_map(folder / name, result, rank, inputs_of(run.settings), run.georeference)


def _write_part(path: Path, result: SurveyResult, c: int) -> None:
    """Write one file of a component; its name says which."""
    maps, trajectory = result.parts[c], result.trajectory.take(result.components[c])
    layer = _LAYER.search(path.stem)
    own = maps.layers[int(layer[1])] if layer else None
    point_map, doubtful = (own.clean, own.doubtful) if own else (maps.optimized, maps.doubtful)
    match path.suffix:
        case ".tum":
            write_tum(path, trajectory)
        case _ if _ALL.fullmatch(path.stem):
            write_ply(path, *_both_layers(point_map, doubtful))
        case _:
            write_ply(path, point_map.points, _columns(point_map))


def _both_layers(clean: PointMap, doubtful: PointMap | None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The points of a map and, behind them, those that were left out of it, with the columns of both."""
    layers = [layer for layer in (clean, doubtful) if layer is not None]
    of_each = [_columns(layer) | ({} if layer.looked is None else {"looked": layer.looked}) for layer in layers]
    columns = {name: np.concatenate([columns[name] for columns in of_each]) for name in of_each[0]}
    columns["doubtful"] = np.repeat(np.arange(len(layers), dtype=np.uint8), [len(layer.points) for layer in layers])
    return np.concatenate([layer.points for layer in layers]), columns


def _columns(point_map: PointMap) -> dict[str, np.ndarray]:
    """The columns of a map's file besides the coordinates."""
    names = ("count", "seen", "sigma", "scan", "survey")
    echo = {} if point_map.strength is None else {"intensity": point_map.strength}
    return {name: getattr(point_map, name) for name in names} | echo
