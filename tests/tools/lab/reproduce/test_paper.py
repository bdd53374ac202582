"""The paper's experiments: contents and reproducibility of their rows."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.experiments import Request, Row, Value, create
from sonarmap.tools.lab.reproduce.paper_scans import (
    DISPLACED_90,
    MAP_90,
    MAP_MEDIAN,
    FloodgateSurvey,
    about_center,
    chain_poses,
    pair_row,
    pose_rows,
    row_of,
)
from sonarmap.tools.lab.reproduce.registrations import parameter_cells, transform
from sonarmap.tools.lab.simulate.plan import table1_pair
from sonarmap.tools.lab.simulate.scenes.solids import box, merge
from sonarmap.tools.lab.simulate.trajectories import table1_transform


class TestStructures:
    def shifted(self, *steps: int) -> Request:
        settings = {"scenes": ("clutter",), "noises": ("D0", "D6"), "seeds": 1, "first_seed": 3, "edge": 64}
        return Request(choose_device(), settings=settings | {"steps": steps})

    def test_rows_do_not_depend_on_earlier_jobs_and_skip_shifts_out_of_the_frame(self) -> None:
        first, second = (create("translation", self.shifted(8, 200)) for _ in range(2))
        second.run("clutter/D0/3")
        rows = first.run("clutter/D6/3").rows
        assert rows == second.run("clutter/D6/3").rows
        assert [row["number"] for row in rows] == [0]


GRID = 128
TRUTH = RigidTransform.from_components([20, -7, 3], Rotation.from_euler("ZYX", [170, 4, -9], degrees=True))
CENTER = np.array([40.0, 15.0, -12.0])


def scored(yaw: float = 0, pitch: float = 0, shift: float = 0, roll: float = 0, **pair: Value) -> Row:
    """Row of a registration off by `yaw`, `pitch`, `roll` [deg] about the scan's center and by `shift` [m] in x."""
    angles = TRUTH.rotation.as_euler("ZYX", degrees=True) + np.array([yaw, pitch, roll])
    R = Rotation.from_euler("ZYX", angles, degrees=True)
    translation = TRUTH.apply(CENTER) - R.apply(CENTER) + np.array([shift, 0, 0])
    steps = (("yaw", 9.0), ("tilt", 8.0), ("translation", 50.0), ("rival", 7.0))
    found = RigidTransform.from_components(translation, R)
    registration = Registration(found, np.eye(6), 50.0, 0.5, True, 0.25, step_psr=steps)
    usual: dict[str, Value] = {"scene": "floodgate", "grid": GRID, "voxel_m": 2.0, "sigma2": 1.0, "seed": 4, "scan": 0}
    return row_of(registration, TRUTH, CENTER, usual | pair)


class TestGaussian:
    @pytest.mark.parametrize(
        ("off", "step"),
        [
            ({}, ""),
            ({"shift": 5.99}, ""),
            ({"shift": 6.01}, "translation"),
            ({"shift": 3.1, "voxel_m": 1.0}, "translation"),
            ({"yaw": 12, "pitch": 20}, "yaw"),
            ({"yaw": 359}, ""),
            ({"pitch": -20}, "tilt"),
        ],
    )
    def test_errors_beyond_the_bounds_name_the_first_wrong_step(self, off: dict[str, float], step: str) -> None:
        row = scored(**off)
        assert (row["right"], row["wrong_step"]) == (not step, step)

    def test_the_error_at_the_sensor_decides(self) -> None:
        """A yaw of 5.9 degrees about the scan's center moves the sensor on a lever of 43 m."""
        turned, lever = scored(yaw=5.9, voxel_m=1.0), np.linalg.norm(CENTER[:2])
        assert turned["center_m"] == pytest.approx(0, abs=1e-12)
        assert turned["translation_m"] == pytest.approx(2 * lever * np.sin(np.deg2rad(5.9 / 2)), rel=0.05)
        assert (turned["right"], turned["right_at_center"]) == (False, True)

    def test_transforms_about_the_grids_center_equal_the_papers_rows(self) -> None:
        """Row 8 of Table 1, as printed: x y z 36 72 108, yaw roll pitch 54 18 9."""
        truth = about_center(table1_pair(8, seed=0, sigma2=1.0)[2])
        assert list(parameter_cells(truth, "true").values()) == pytest.approx([36, 72, 108, 54, 18, 9], abs=1e-9)
        assert np.allclose(truth.as_matrix(), table1_transform(8).as_matrix())

    def test_scenes_that_do_not_fit_the_papers_steps_are_refused(self, tmp_path: Path) -> None:
        result = CliRunner().invoke(app, ["reproduce", "gaussian", "--scene", "pool", "-o", str(tmp_path / "out")])
        assert (result.exit_code, (tmp_path / "out").exists()) == (2, False)


def turn(yaw: float, pitch: float, roll: float) -> Rotation:
    return Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)


SCANS = 5
# p_world = T p_sensor; every pose has a turn about every axis
POSES = RigidTransform.concatenate(
    [
        RigidTransform.from_components([4.0 * k, -3 + k * k, 1.5 * k], turn(20 - 30 * k, 4 * k, -3 * k))
        for k in range(SCANS)
    ]
)
STEPS = [POSES[k - 1].inv() * POSES[k] for k in range(1, SCANS)]


@pytest.fixture(scope="module")
def survey() -> FloodgateSurvey:
    """Five scans of two boxes whose points lie exactly on the surface, except the first scan's, 0.25 m above it."""
    rng = np.random.default_rng(7)
    places = rng.uniform(-20, 20, (SCANS, 400, 3)) * [1, 1, 0] + [0, 0, 2]  # on the lid of a flat box
    places[0, :, 2] += 0.25
    mesh = merge([box((0, 0, 1), (60, 60, 2)), box((15, 3, -9), (2, 4, 6))])
    scans = [
        Scan(POSES[k].inv().apply(places[k]).astype(np.float32), stamp=float(k), name=f"s{k}") for k in range(SCANS)
    ]
    return FloodgateSurvey(tuple(scans), POSES, mesh, shared=(0.9, 0.8, 0.7, 0.6))


def off(meters: float) -> list[RigidTransform]:
    """The true steps, the second one off by `meters` along its z axis."""
    return [step * RigidTransform.from_translation([0, 0, meters * (k == 1)]) for k, step in enumerate(STEPS)]


class TestFloodgate:
    def test_one_wrong_step_moves_all_later_poses_equally(self, survey: FloodgateSurvey) -> None:
        """Each later pose is off by the same motion of the world."""
        assert np.allclose(chain_poses(POSES[0], STEPS).as_matrix(), POSES.as_matrix(), atol=1e-12)
        moved = (chain_poses(POSES[0], off(9.0)) * POSES.inv()).as_matrix()
        assert np.allclose(moved[:2], np.eye(4), atol=1e-12)
        assert np.allclose(moved[2:], moved[2], atol=1e-12)
        rows = pose_rows(survey, off(9.0))
        assert [round(float(row["translation_m"]), 9) for row in rows] == [0, 0, 9, 9, 9]

    def test_a_rows_parameters_are_its_transform(self, survey: FloodgateSurvey) -> None:
        expected = STEPS[2] * RigidTransform.from_components([1, -2, 0.5], turn(3, -7, 5))
        row = pair_row(survey, 3, expected, accepted=False)
        assert np.allclose(transform(row, "found").as_matrix(), expected.as_matrix(), atol=1e-12)
        assert np.allclose(transform(row, "true").as_matrix(), STEPS[2].as_matrix(), atol=1e-12)
        assert row["translation_m"] == pytest.approx(np.sqrt(1 + 4 + 0.25))
        assert (row["right"], row["accepted"]) == (False, False)
        assert [pair_row(survey, 2, off(meters)[1], accepted=True)["right"] for meters in (5.99, 6.01)] == [True, False]

    def test_true_poses_leave_only_the_errors_of_the_scans(self, survey: FloodgateSurvey) -> None:
        """The first scan is 0.25 m off, the others are exact; each row evaluates the map so far."""
        rows = pose_rows(survey, None)
        medians, highs = ([float(row[name]) for row in rows] for name in (MAP_MEDIAN, MAP_90))
        assert [medians[0], *medians[2:]] == pytest.approx([0.25, 0, 0, 0], abs=1e-5)
        assert highs == pytest.approx([0.25] * SCANS, abs=1e-5)  # a fifth of the points, so beyond the 90th percentile

    def test_points_moved_along_the_surface_count_as_displaced(self, survey: FloodgateSurvey) -> None:
        """After the first two scans the poses move 2 m along the lid, which no distance to the surface shows."""
        moved = RigidTransform.from_translation([0, 2, 0]) * POSES
        rows = pose_rows(survey, [STEPS[0], POSES[1].inv() * moved[2], *STEPS[2:]])
        assert [round(float(row[DISPLACED_90]), 6) for row in rows] == [0, 0, 2, 2, 2]
        assert rows[-1][MAP_90] == pytest.approx(0.25, abs=1e-5)
