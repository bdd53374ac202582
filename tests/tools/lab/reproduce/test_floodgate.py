"""The maps of the flood gate: chains, tables, times, pictures, and the experiment as a whole."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import choose_device
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.floodgate.chain import (
    DISPLACED_90,
    MAP_90,
    MAP_MEDIAN,
    FloodgateSurvey,
    chain_poses,
    pair_row,
    pose_rows,
    transform,
)
from sonarmap.tools.lab.reproduce.floodgate.run import (
    Floodgate,
    FloodgateSettings,
)
from tests.samples.experiments.floodgate_survey import POSES, SCANS, STEPS, flat_survey, off, turn
from tests.samples.experiments.shown import run_all, show


@pytest.fixture(scope="module")
def now() -> FloodgateSurvey:
    return flat_survey()


class TestChain:
    def test_one_wrong_step_moves_all_that_follow_alike(self, now: FloodgateSurvey) -> None:
        """The true motion after it hides nothing: each later pose is off by the same motion of the world."""
        assert np.allclose(chain_poses(POSES[0], STEPS).as_matrix(), POSES.as_matrix(), atol=1e-12)
        moved = (chain_poses(POSES[0], off(9.0)) * POSES.inv()).as_matrix()
        assert np.allclose(moved[:2], np.eye(4), atol=1e-12)
        assert np.allclose(moved[2:], moved[2], atol=1e-12)
        rows = pose_rows(now, off(9.0))
        assert [round(float(row["translation_m"]), 9) for row in rows] == [0, 0, 9, 9, 9]

    def test_a_rows_parameters_are_its_transform(self, now: FloodgateSurvey) -> None:
        expected = STEPS[2] * RigidTransform.from_components([1, -2, 0.5], turn(3, -7, 5))
        row = pair_row(now, 3, expected, accepted=False)
        assert np.allclose(transform(row, "found").as_matrix(), expected.as_matrix(), atol=1e-12)
        assert np.allclose(transform(row, "true").as_matrix(), STEPS[2].as_matrix(), atol=1e-12)
        assert row["translation_m"] == pytest.approx(np.sqrt(1 + 4 + 0.25))
        assert (row["right"], row["accepted"]) == (False, False)
        assert row["rotation_deg"] == pytest.approx(np.rad2deg(turn(3, -7, 5).magnitude()))
        assert [pair_row(now, 2, off(meters)[1], accepted=True)["right"] for meters in (5.99, 6.01)] == [True, False]


class TestMapError:
    def test_true_poses_leave_what_the_scans_have(self, now: FloodgateSurvey) -> None:
        """The first scan lies 0.25 m off, the others on the surface: the map so far is the mixture."""
        rows = pose_rows(now, None)
        medians, highs = ([float(row[name]) for row in rows] for name in (MAP_MEDIAN, MAP_90))
        assert [medians[0], *medians[2:]] == pytest.approx([0.25, 0, 0, 0], abs=1e-5)
        assert highs == pytest.approx([0.25] * SCANS, abs=1e-5)  # a fifth of the points, so beyond the 90th percentile

    def test_points_moved_along_the_surface_are_displaced_all_the_same(self, now: FloodgateSurvey) -> None:
        """The world is moved by 2 m along the lid after the first two scans; no distance tells of it."""
        moved = RigidTransform.from_translation([0, 2, 0]) * POSES
        rows = pose_rows(now, [STEPS[0], POSES[1].inv() * moved[2], *STEPS[2:]])
        assert [round(float(row[DISPLACED_90]), 6) for row in rows] == [0, 0, 2, 2, 2]
        assert rows[-1][MAP_90] == pytest.approx(0.25, abs=1e-5)


class TestExperiment:
    @pytest.mark.slow
    def test_two_runs_give_the_same_rows_and_pictures(self, tmp_path: Path) -> None:
        """A map whose pairs were registered in an earlier run is the same as well."""
        settings = FloodgateSettings(methods=("icp", "hemisphere"), edges=(32,), seeds=1, first_seed=3, scans=2)
        made: list[tuple[list[Row], dict[str, bytes]]] = []
        for name in "ab":
            rows, seconds = run_all(experiment := Floodgate(settings, choose_device(None)))
            alone = Floodgate(settings, choose_device(None)).run("3/hemisphere/32/map")
            assert list(alone.rows) == rows[-len(alone.rows) :]
            show(experiment, tmp_path / name, rows, seconds)
            pictures = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
            assert all(len(content) < 300_000 for content in pictures.values())
            made.append((rows, pictures))
        assert made[0] == made[1]
