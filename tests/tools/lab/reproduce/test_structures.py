"""Experiments on structures seen whole: what counts as reached, and rows that are the same every time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.tools.lab.reproduce.answer import parameters
from sonarmap.tools.lab.reproduce.structures.limits import KINDS, Limits
from sonarmap.tools.lab.reproduce.structures.moved import Translation, Turns
from sonarmap.tools.lab.reproduce.structures.moved_section import (
    deviation,
    reach,
    within_limits,
)
from sonarmap.tools.lab.reproduce.structures.settings import LimitsSettings, RotationSettings, TranslationSettings
from tests.samples.experiments.shown import run_all, show

ONE = TranslationSettings(scenes=("clutter",), noises=("D0", "D6"), seeds=1, first_seed=3, edge=64, steps=(8, 16, 40))


def shifted(distance: float, right: bool, noise: str = "D0", scene: str = "clutter", seed: int = 3) -> dict:
    """A row of the translation experiment."""
    return {
        **{"scene": scene, "noise": noise, "seed": seed, "distance_m": distance, "right": right, "accepted": True},
        **{"psr": 90.0, "rotation_deg": 0.1 if right else 50.0, "translation_voxels": 0.2, "common": 0.5},
    }


def turned(yaw: float, estimated: float, roll: float = 10.0, shift: float = 0.1) -> dict:
    """A row of the rotation experiment."""
    true = {"true_yaw_deg": yaw, "true_roll_deg": 10.0, "true_pitch_deg": 10.0}
    angles = {"found_yaw_deg": estimated, "found_roll_deg": roll, "found_pitch_deg": 10.0}
    place = {"scene": "clutter", "noise": "D0", "seed": 3}
    return {**true, **angles, **place, "translation_voxels": shift, "rotation_deg": 0.5, "psr": 80.0, "accepted": True}


class TestReach:
    def test_it_ends_before_the_first_that_is_wrong(self) -> None:
        rows = [shifted(40, True), shifted(10, True), shifted(30, False), shifted(20, True)]
        assert reach(rows) == 20
        assert reach([shifted(10, False), shifted(20, True)]) == 0


class TestDeviation:
    def test_every_bound_counts_around_the_circle(self) -> None:
        assert deviation(turned(88, -270), "yaw") == pytest.approx(2)
        assert deviation(turned(-80, 275), "yaw") == pytest.approx(-5)
        assert within_limits(turned(40, 44.9))
        for beyond in (turned(40, 45.1), turned(40, 40, roll=13.1), turned(40, 40, shift=2.1)):
            assert not within_limits(beyond)


class TestRun:
    @pytest.mark.slow
    def test_rows_hold_the_truth_and_are_right(self) -> None:
        outcome = Translation(ONE, choose_device()).run("clutter/D6/3")
        assert [row["distance_m"] for row in outcome.rows] == pytest.approx([8 * 14**0.5, 16 * 14**0.5, 40 * 14**0.5])
        assert [row["true_y_m"] for row in outcome.rows] == [16, 32, 80]
        assert outcome.rows[0]["right"]
        assert outcome.rows[0]["found_y_m"] == pytest.approx(16, abs=2)
        common = [float(row["common"]) for row in outcome.rows]
        assert 0 < common[2] < common[1] < common[0] < 1

    def test_rows_are_the_same_whatever_came_before_without_shifts_that_leave_nothing_in_the_frame(self) -> None:
        first, second = (Translation(replace(ONE, steps=(8, 200)), choose_device()) for _ in range(2))
        second.run("clutter/D0/3")
        rows = first.run("clutter/D6/3").rows
        assert rows == second.run("clutter/D6/3").rows
        assert [row["number"] for row in rows] == [0]

    @pytest.mark.slow
    def test_turns_are_found_and_drawn(self, tmp_path: Path) -> None:
        settings = RotationSettings(
            scenes=("clutter",), noises=("D0",), seeds=1, first_seed=3, edge=64, yaws_deg=(8, 64)
        )
        rows, seconds = run_all(experiment := Turns(settings, choose_device()))
        show(experiment, tmp_path, rows, seconds)
        assert all(within_limits(row) for row in rows)

    @pytest.mark.slow
    def test_limits_look_at_each_step(self, tmp_path: Path) -> None:
        settings = LimitsSettings(scenes=("clutter",), seeds=1, edge=64, tilts_deg=(10,), yaws_deg=(-40,))
        rows, seconds = run_all(experiment := Limits(settings, choose_device()))
        show(experiment, tmp_path, rows, seconds)
        assert [row["tilted"] for row in rows] == list(KINDS)
        assert max(abs(float(row["roll_off_deg"])) for row in rows) < 2

    def test_noise_is_new_in_every_volume(self) -> None:
        series = Translation(ONE, choose_device())
        points = series.structure("clutter", 3)
        clouds = [series.prepare(points, "D6", [3, 6, k]).volume.surface for k in (0, 1, 1)]
        assert len(clouds[0]) != len(clouds[1]) or not np.array_equal(clouds[0], clouds[1])
        np.testing.assert_array_equal(clouds[1], clouds[2])


def test_parameters_are_in_the_papers_order() -> None:
    T = RigidTransform.from_components([1, 2, 3], Rotation.from_euler("ZYX", [40, 5, -7], degrees=True))
    assert parameters(T) == pytest.approx([1, 2, 3, 40, -7, 5])
