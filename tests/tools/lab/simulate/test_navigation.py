"""Simulated navigation: sparse fixes, some of them wrong, and dead reckoning that drifts."""

import numpy as np
import pytest

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.lab.simulate.sensing.navigation import OUTLIER, Fixes, Instruments, dead_reckoning, measure_poses
from tests.samples.refusals import refuses
from tests.samples.surveys import ring_poses

COUNT = 200
TRUTH = Trajectory(2.0 * np.arange(COUNT), ring_poses(COUNT, 40.0))
SHIP = Instruments(attitude=np.inf, heading=np.inf, position=0.5)


def test_positions_are_sparse_and_some_are_wrong() -> None:
    measured = measure_poses(TRUTH.T_world_sensor, SHIP, seed=3)
    fixed = Fixes(every=4, outliers=0.2).of(measured, seed=3)
    off = []
    for k, prior in enumerate(fixed):
        assert prior is not None
        assert prior.knows_depth
        assert prior.knows_position == (k % 4 == 0)
        away = prior.T_world_sensor.translation - TRUTH.T_world_sensor.translation[k]
        off.append(np.linalg.norm(away[:2]))
    wrong = np.array(off) > 10
    assert 0.12 < wrong.mean() < 0.28
    np.testing.assert_allclose(np.array(off)[wrong], OUTLIER, atol=2.5)


def test_a_scan_without_measurements_has_no_prior() -> None:
    positions = Instruments(attitude=np.inf, heading=np.inf, depth=np.inf)
    fixed = Fixes(every=50).of(measure_poses(TRUTH.T_world_sensor, positions, seed=3), seed=3)
    assert [k for k, prior in enumerate(fixed) if prior is not None] == [0, 50, 100, 150]


@pytest.mark.slow
def test_dead_reckoning_drifts_by_its_sigmas() -> None:
    length = np.linalg.norm(np.diff(TRUTH.T_world_sensor.translation, axis=0), axis=1).sum()
    along, turned = [], []
    for seed in range(60):
        reckoned = dead_reckoning(TRUTH, 0.05, 0.001, seed).T_world_sensor
        steps = np.linalg.norm(np.diff(reckoned.translation, axis=0), axis=1).sum()
        along.append(steps / length - 1)
        end = (reckoned[0].inv() * reckoned[-1]).rotation
        true = (TRUTH.T_world_sensor[0].inv() * TRUTH.T_world_sensor[-1]).rotation
        turned.append((true.inv() * end).magnitude())
    assert np.std(along) == pytest.approx(0.05, rel=0.35)
    assert np.sqrt(np.mean(np.square(turned))) == pytest.approx(0.001 * TRUTH.stamps[-1], rel=0.35)


def test_unusable_settings_of_fixes_are_refused() -> None:
    refuses("fix_every", Fixes, every=0)
    refuses("fix_outliers", Fixes, outliers=1.5)
