"""graph.csv beside graph.g2o, as the map wrote that."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.folder import MapFolder
from sonarmap.tools.files.readers.poses.g2o import read_g2o
from sonarmap.tools.files.writers.g2o import write_g2o
from sonarmap.tools.products.export.graph_csv import write_graph
from tests.tools.products.export.poses import dive, with_part


def two_parts(path: Path) -> MapFolder:
    """Scans 1, 3, 4 in the world with times, 0 and 5 apart with counters; nothing placed 2."""
    earth = dive()
    stamps = np.array([0, 1.7e9, 9, 1.7e9 + 2.5, 1.7e9 + 5.0004, 7], dtype=np.float64)
    whole = Trajectory(stamps, earth.part.trajectory.T_world_sensor)
    parts = tuple(
        replace(earth.part, suffix=suffix, scans=scans, trajectory=whole.take(scans), in_world=in_world)
        for suffix, scans, in_world in (("", (1, 3, 4), True), ("_2", (0, 5), False))
    )
    write_g2o(path / "graph.g2o", PoseGraph(whole, ()), {2})
    return replace(with_part(earth, parts[0]).folder, path=path, parts=parts)


def test_a_row_for_each_vertex(tmp_path: Path) -> None:
    folder = two_parts(tmp_path)
    write_graph(tmp_path / "out" / "graph.csv", folder, folder.parts[0], None)
    with (tmp_path / "out" / "graph.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["vertex"], row["name"], row["map"], row["frame"]) for row in rows] == [
        ("0", "scan_0", "2", "first pose"),
        ("1", "scan_1", "1", "East-North-Up"),
        ("3", "scan_3", "1", "East-North-Up"),
        ("4", "scan_4", "1", "East-North-Up"),
        ("5", "scan_5", "2", "first pose"),
    ]
    assert [row["utc"] for row in rows][2:] == ["2023-11-14T22:13:22.500000Z", "2023-11-14T22:13:25.000400Z", ""]
    assert [float(row["stamp"]) for row in rows] == [0, 1.7e9, 1.7e9 + 2.5, 1.7e9 + 5.0004, 7]
    vertices = read_g2o(tmp_path / "out" / "graph.g2o").trajectory.stamps
    assert [int(row["vertex"]) for row in rows] == vertices.tolist()


def test_a_missing_graph_is_refused(tmp_path: Path) -> None:
    folder = replace(two_parts(tmp_path), path=tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"graph\.g2o: .*map again"):
        write_graph(tmp_path / "graph.csv", folder, folder.parts[0], None)
