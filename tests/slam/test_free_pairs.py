"""Which pairs are registered without priors, and what they show of instruments that err more than they say."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.free_pairs import errors_shown
from sonarmap.spectral.scan import PosePrior
from tests.samples.surveys import ring_poses, step_pair

COUNT = 40
TRUTH = RigidTransform.from_components([300.0, -80.0, -20.0], Rotation.from_euler("Z", 0.7)) * ring_poses(COUNT, 30.0)
SIGMAS = np.array([0.01, 0.01, 0.05, 1.0, 1.0, 0.2])
TIGHT = np.diag(np.repeat([0.001, 0.01], 3) ** 2)


def priors(times: Sequence[float], seed: int = 3, known: Sequence[bool] = (True,) * 6) -> dict[int, PosePrior]:
    """That err so many times as much as they say."""
    rng = np.random.default_rng(seed)
    measured = {}
    for k in range(COUNT):
        error = SIGMAS * np.array(times) * rng.standard_normal(6)
        T = TRUTH[k]
        moved = RigidTransform.from_components(T.translation + error[3:], Rotation.from_rotvec(error[:3]) * T.rotation)
        measured[k] = PosePrior(moved, np.where(known, SIGMAS, np.inf))
    return measured


PAIRS = [step_pair(k, TRUTH[k].inv() * TRUTH[k + 1], TIGHT) for k in range(COUNT - 1)]


def test_instruments_that_err_more_than_they_say_are_measured() -> None:
    seed = 0
    assert errors_shown(PAIRS, priors([1] * 6, seed)) == {}
    shown = errors_shown(PAIRS, priors([5, 5, 4, 9, 9, 6], seed))
    assert shown == {
        key: pytest.approx(times, rel=0.35) for key, times in (("attitude", 5), ("heading", 4), ("depth", 6))
    }
    without_heading = errors_shown(PAIRS, priors([5, 5, 4, 9, 9, 6], seed, [True, True, False, False, False, True]))
    assert list(without_heading) == ["attitude", "depth"]
    assert errors_shown(PAIRS[:5], priors([5] * 6, seed)) == {}
    assert errors_shown(PAIRS, priors([5] * 6, seed, [False, False, True, True, True, True])) == {}
