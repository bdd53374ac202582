"""Baseline mapping methods on small surveys that suit them."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.names import CHAIN
from sonarmap.tools.lab.baselines.surveys import run_kiss_slam, run_multiway
from sonarmap.tools.lab.evaluate.survey import score_pairs
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.simulation import Simulation, simulate

VOXEL = 1.5
NOTHING = Scan(np.array([[3.0, 0, 0], [0, 5, 1]], np.float32), None, stamp=99.0, name="nothing")


def small_survey(spacing: float, count: int) -> Simulation:
    """Survey of a harbor with few beams and little noise."""
    settings = plan("harbor", "survey", seed=3)
    few = replace(settings.sensor, columns=128, rows=96)
    return simulate(replace(settings, count=count, spacing=spacing, sensor=few, noise=Noise(sigma2=0.5)))


@pytest.mark.slow
def test_multiway_maps_scans_that_are_meters_apart() -> None:
    survey = small_survey(6.0, 4)
    scans = [*survey.scans[:2], NOTHING, *survey.scans[2:]]
    run = run_multiway(scans, VOXEL, key_every=3)
    assert run.trajectory.stamps.tolist() == [0.0, 1.0, 2.0, 3.0]
    result = evaluate(run.trajectory, survey.truth)
    assert result.ate_m < VOXEL / 2
    assert result.rotation_deg.max() < 2
    # scan 2 is empty: its neighbors are consecutive, and the key scans are 0 and 4
    assert [(pair.target, pair.source) for pair in run.pairs] == [(0, 1), (1, 3), (3, 4), (0, 4)]
    poses = {scan: survey.truth.T_world_sensor[row] for row, scan in enumerate((0, 1, 3, 4))}
    assert score_pairs([pair for pair in run.pairs if pair.role == CHAIN], poses, VOXEL).kept_right == 3
    assert run.loops == sum(pair.kept for pair in run.pairs if pair.role != CHAIN)


@pytest.mark.slow
def test_multiway_is_reproducible() -> None:
    scans = small_survey(6.0, 3).scans
    once, again = (run_multiway(scans, VOXEL, seed=5, key_every=2).trajectory for _ in range(2))
    assert_array_equal(once.T_world_sensor.as_matrix(), again.T_world_sensor.as_matrix())


@pytest.mark.skipif(importlib.util.find_spec("kiss_slam") is None, reason="kiss-slam is not installed")
def test_kiss_slam_maps_small_motions() -> None:
    survey = small_survey(1.0, 6)
    run = run_kiss_slam(survey.scans, VOXEL)
    assert_array_equal(run.trajectory.stamps, survey.truth.stamps)
    result = evaluate(run.trajectory, survey.truth)
    assert result.ate_m < VOXEL / 2
    assert result.rotation_deg.max() < 3
    assert (run.pairs, run.loops) == ((), 0)
