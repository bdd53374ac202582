"""The page's rows of poses, navigation, ties and control points, against hand-computed numbers."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.products.report.content import (
    control_rows,
    crossing_rows,
    kept_sequential,
    navigation_rows,
    pair_rows,
    tie_rows,
    track_of,
)
from tests.tools.products.report.known_map import folder_of, known_points


def test_an_ellipsoid_is_turned_with_its_pose() -> None:
    """Sigmas of 1 cm ahead, 2 cm to the left and 5 cm up; at a yaw of 90 degrees, ahead is North."""
    covariance = np.diag([1.0, 1.0, 1.0, 0.01**2, 0.02**2, 0.05**2])
    T = RigidTransform.from_components([[3.0, -4.0, 5.0]], Rotation.from_euler("z", [90.0], degrees=True))
    none = np.zeros((0, 3))
    part = MapPart("", none, {}, (6,), Trajectory(np.array([12.5]), T), covariance[None], False)
    pairs = [
        {"target": 5, "source": 6, "role": "sequential", "kept": True, "overlap": 0.75},
        {"target": 2, "source": 6, "role": "loop", "kept": True, "overlap": 0.25},
    ]
    track = track_of(part, {"pairs": pairs})
    assert (track["scans"], track["places"]) == ([6], [[3.0, -4.0, 5.0]])
    assert track["overlaps"] == [0.75]
    np.testing.assert_allclose(track["turns"], [[0, 0, np.sqrt(0.5), np.sqrt(0.5)]], atol=1e-8)
    half_axes = np.abs(track["half_axes"][0])
    np.testing.assert_allclose(half_axes, [[0, 0.01, 0], [0.02, 0, 0], [0, 0, 0.05]], atol=1e-9)


def prior(pose: int, T: RigidTransform, sigmas: list[float | None]) -> dict[str, Any]:
    return {"pose": pose, "T_world_sensor": T.as_matrix().tolist(), "sigmas": sigmas}


def test_navigation_rows_have_differences_and_sigmas() -> None:
    """Mapped 0.3 m east of the fix, with headings 2 degrees apart across South; no depth was measured."""
    mapped = RigidTransform.from_components([10.3, 20.0, -7.0], Rotation.from_euler("ZYX", [-179, 3, 1], degrees=True))
    measured = RigidTransform.from_components([10.0, 20.5, 0.0], Rotation.from_euler("ZYX", [179, 1, 2], degrees=True))
    degree = float(np.radians(1.0))
    graph = {
        "poses": [{}, {"T_world_sensor": mapped.as_matrix().tolist()}],
        "priors": [
            prior(1, measured, [degree, degree, 2 * degree, 0.5, 0.5, None]),
            prior(0, RigidTransform.identity(), [None] * 6),
        ],
    }
    (row,) = navigation_rows(graph)
    assert (row["scan"], row["apart"][5], row["sigmas"][5]) == (1, None, None)
    np.testing.assert_allclose(row["apart"][:5], [-1, 2, 2, 0.3, -0.5], atol=1e-6)
    np.testing.assert_allclose(row["sigmas"][:5], [1, 1, 2, 0.5, 0.5])


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
def folder(tmp_path: Path) -> Map:
    return folder_of(known_points(), tmp_path / "out")


def test_ties_with_names_or_numbers_of_scans() -> None:
    ties: list[dict[str, Any]] = [
        {"target": "scan1", "source": "scan4", "verdict": "reject", "note": "why", "effect": "left out"},
        {"target": 0, "source": 7, "verdict": "add", "x_m": 1.5, "sigma_deg": 2, "y_m": None},
    ]
    first, second = tie_rows({"ties": ties}, NAMES)
    assert first == ties[0] | {"transform": {}}
    assert (second["target"], second["source"]) == ("scan0", "scan7")
    assert (second["note"], second["effect"], second["transform"]) == ("", "", {"x_m": 1.5, "sigma_deg": 2.0})
    assert tie_rows({}, NAMES) == tie_rows({"ties": None}, NAMES) == []


def test_a_control_point_counts_in_the_world_unless_left_out(folder: Map) -> None:
    part = folder.parts[0]
    for in_world in (True, False):
        (row,) = control_rows({"control_points": [POINT]}, [replace(part, in_world=in_world)], NAMES)
        assert row["residual"] == [0.25, -0.5, 0.0]
        assert (row["counted"], row["left_out"]) == (in_world, False)
    summary = {
        "control_points": [POINT, POINT | {"name": "quay"}],
        "control": {"left_out": [{"name": "pile", "scan": 3}]},
    }
    rows = control_rows(summary, [replace(folder.parts[0], in_world=True)], NAMES)
    assert [(row["counted"], row["left_out"]) for row in rows] == [(False, True), (True, False)]


def test_rows_of_pairs_and_crossings() -> None:
    """Rows of pairs are every loop, and the consecutive pairs that were not kept."""
    common = {"reason": "why", "overlap": 0.123456, "probability": None}
    pairs = [
        {"target": 0, "source": 1, "role": "sequential", "kept": True, **common},
        {"target": 1, "source": 2, "role": "sequential", "kept": False, **common},
        {"target": 0, "source": 2, "role": "loop", "kept": True, **common},
    ]
    rows = pair_rows(pairs)
    assert [(row["target"], row["source"]) for row in rows] == [(1, 2), (0, 2)]
    assert kept_sequential(pairs) == [(0, 1)]
    assert (rows[0]["overlap"], rows[0]["probability"], rows[0]["residual_sigmas"]) == (0.1235, None, None)
    row = {"i": 3, "j": 20, "before_m": 0.5, "before_90_m": 1.25, "after_m": 0.123456, "after_90_m": 0.25}
    (shown,) = crossing_rows({"crossings": [row]})
    assert (shown["target"], shown["source"], shown["after_m"], shown["before_90_m"]) == (3, 20, 0.1235, 1.25)
    assert crossing_rows({}) == []  # a map of an earlier version
