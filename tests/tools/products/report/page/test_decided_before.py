"""Ties and control points that a map was made with, as rows of the page, by hand."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sonarmap.tools.files.map_folder.folder import MapFolder
from sonarmap.tools.products.report.page.byhand import control_rows, map_key, tie_rows
from tests.tools.products.report.page.known_map import folder_of, known_points

NAMES = tuple(f"scan{k}" for k in range(8))
POINT = {
    "name": "pile",
    "scan": "scan3",
    "point": [1, 2, 3],
    "known": [10.0, 20.0, -5.0],
    "estimated": [10.25, 19.5, -5.0],
    "sigma": [0.05, 0.05, 0.1],
    "use": "control",
    "in_sigmas": 11.2,
}


@pytest.fixture
def folder(tmp_path: Path) -> MapFolder:
    return folder_of(known_points(), tmp_path / "out")


def test_ties_of_names_and_of_numbers() -> None:
    ties: list[dict[str, Any]] = [
        {"target": "scan1", "source": "scan4", "verdict": "reject", "note": "why", "effect": "left out"},
        {"target": 0, "source": 7, "verdict": "add", "x_m": 1.5, "sigma_deg": 2, "y_m": None},
    ]
    first, second = tie_rows({"ties": ties}, NAMES)
    assert first == ties[0] | {"transform": {}}
    assert (second["target"], second["source"]) == ("scan0", "scan7")
    assert (second["note"], second["effect"], second["transform"]) == ("", "", {"x_m": 1.5, "sigma_deg": 2.0})
    assert tie_rows({}, NAMES) == tie_rows({"ties": None}, NAMES) == []


def test_a_control_point_counts_where_its_part_is_in_the_world(folder: MapFolder) -> None:
    part = folder.parts[0]
    for in_world in (True, False):
        (row,) = control_rows({"control_points": [POINT]}, [replace(part, in_world=in_world)], NAMES)
        assert row["residual"] == [0.25, -0.5, 0.0]
        assert (row["counted"], row["left_out"]) == (in_world, False)


def test_a_control_point_that_others_contradict_does_not_count(folder: MapFolder) -> None:
    summary = {
        "control_points": [POINT, POINT | {"name": "quay"}],
        "control": {"left_out": [{"name": "pile", "scan": 3}]},
    }
    rows = control_rows(summary, [replace(folder.parts[0], in_world=True)], NAMES)
    assert [(row["counted"], row["left_out"]) for row in rows] == [(False, True), (True, False)]


def test_the_key_tells_maps_apart(folder: MapFolder) -> None:
    summary = dict(folder.summary)
    key = map_key(summary, NAMES)
    assert key == map_key(summary | {"files": ["another"]}, NAMES)
    changes = ({"settings": {"voxel": 0.25}}, {"ties": [{"target": "a"}]}, {"inputs": []})
    others = [map_key(summary | change, NAMES) for change in changes]
    assert len({key, map_key(summary, NAMES[::-1]), *others}) == 5
