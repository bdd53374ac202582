"""Tables of an export: the graph, EIVA's poses, and the scales of their times."""

import csv
import re
from dataclasses import replace
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.folder import MapFolder
from sonarmap.tools.files.readers.poses.g2o import read_g2o
from sonarmap.tools.files.time_scales import GPS_EPOCH, are_times, gps_of_utc, utc_text
from sonarmap.tools.files.writers.g2o import write_g2o
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.tables import write_eiva_attitude, write_eiva_position, write_graph
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
    apart, world = ("2", "first pose"), ("1", "East-North-Up")
    assert [(row["vertex"], row["name"], row["map"], row["frame"]) for row in rows] == [
        (str(k), f"scan_{k}", *where) for k, where in ((0, apart), (1, world), (3, world), (4, world), (5, apart))
    ]
    assert [row["utc"] for row in rows][2:] == ["2023-11-14T22:13:22.500000Z", "2023-11-14T22:13:25.000400Z", ""]
    assert [float(row["stamp"]) for row in rows] == [0, 1.7e9, 1.7e9 + 2.5, 1.7e9 + 5.0004, 7]
    vertices = read_g2o(tmp_path / "out" / "graph.g2o").trajectory.stamps
    assert [int(row["vertex"]) for row in rows] == vertices.tolist()


def test_a_missing_graph_is_refused(tmp_path: Path) -> None:
    folder = replace(two_parts(tmp_path), path=tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"graph\.g2o: .*map again"):
        write_graph(tmp_path / "graph.csv", folder, folder.parts[0], None)


def texts(path: Path, earth: Georeferenced) -> tuple[str, str]:
    write_eiva_position(path / "position.txt", earth)
    write_eiva_attitude(path / "attitude.txt", earth)
    return (path / "position.txt").read_text(), (path / "attitude.txt").read_text()


def test_the_layout_is_that_of_the_page(tmp_path: Path) -> None:
    """1179179101.202228 1.134059548584164 0.1130091400934067 349.1989770603225"""
    for text, columns in zip(texts(tmp_path, dive()), (4, 4), strict=True):
        for line in text.splitlines():
            assert re.fullmatch(r"\d{10}\.\d{6}" + r" -?\d+\.\d{5,}" * (columns - 1), line)


def test_lines_ascend_in_time(tmp_path: Path) -> None:
    stamps = 1.7e9 + np.array([30.0, 31, 32, 0, 1, 2])
    for text, first in zip(texts(tmp_path, dive(stamps=stamps)), (29.75, None), strict=True):
        table = np.loadtxt(text.splitlines())
        np.testing.assert_array_equal(table[:, 0], np.sort(stamps))
        assert first is None or table[0, 3] == first  # the depth of scan 3


def iana_leaps() -> list[float]:
    """The times since 1970 at which a leap second has just ended."""
    text = (resources.files("tzdata") / "zoneinfo" / "leapseconds").read_text()
    rows = re.findall(r"^Leap\s+(\d+)\s+(\w+)\s+(\d+)\s+23:59:60\s+\+", text, re.MULTILINE)
    days = [datetime.strptime(" ".join(row), "%Y %b %d").replace(tzinfo=UTC).timestamp() + 86_400 for row in rows]
    return [day for day in days if day > GPS_EPOCH]


def test_gps_time_counts_every_leap_second() -> None:
    leaps = iana_leaps()
    assert len(leaps) == 18
    times = np.array([*(leap - 0.5 for leap in leaps), *leaps, 1.8e9])
    ahead = [sum(time >= leap for leap in leaps) for time in times.tolist()]
    np.testing.assert_array_equal(gps_of_utc(times) - (times - GPS_EPOCH), ahead)


@pytest.mark.parametrize(
    ("stamps", "times"),
    [([1.7e9, 1.7e9 + 3], True), ([0.0, 1.0], False), ([1.7e9, 3.0], False), ([1.7e18], False), ([np.nan], False)],
)
def test_which_stamps_are_times(stamps: list[float], times: bool) -> None:
    assert are_times(np.array(stamps)) == times


def test_text() -> None:
    assert utc_text(1_483_228_790.25) == "2016-12-31T23:59:50.250000Z"
