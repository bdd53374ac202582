"""Pairs registered without priors, and the underestimated sigmas of instruments that they show."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.free_pairs import errors_shown, register_freely
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import unexact
from tests.samples.surveys import ring_poses, step_pair

COUNT = 40
TRUTH = RigidTransform.from_components([300.0, -80.0, -20.0], Rotation.from_euler("Z", 0.7)) * ring_poses(COUNT, 30.0)
SIGMAS = np.array([0.01, 0.01, 0.05, 1.0, 1.0, 0.2])
TIGHT = np.diag(np.repeat([0.001, 0.01], 3) ** 2)


def priors(times: Sequence[float], seed: int = 3, known: Sequence[bool] = (True,) * 6) -> dict[int, PosePrior]:
    """Priors whose errors are `times` as large as their sigmas."""
    rng, sigmas = np.random.default_rng(seed), np.where(known, SIGMAS, np.inf)
    return {k: replace(unexact(TRUTH[k], rng, SIGMAS * times), sigmas=sigmas) for k in range(COUNT)}


PAIRS = [step_pair(k, TRUTH[k].inv() * TRUTH[k + 1], TIGHT) for k in range(COUNT - 1)]


def test_underestimated_sigmas_are_measured() -> None:
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


class Truthful:
    """Registers scans by the truth, and records the pairs."""

    def __init__(self) -> None:
        self.registered: list[tuple[int, int]] = []

    def prepare(self, scan: Scan) -> int:
        assert scan.prior is None
        return int(scan.stamp)

    def register(self, target: int, source: int) -> Registration:
        self.registered.append((target, source))
        T: RigidTransform = TRUTH[target].inv() * TRUTH[source]
        return Registration(T, TIGHT, psr=9.0, overlap=0.8, accepted=source != 20, seconds=0.0, reason="")


def test_kinds_that_say_nothing_do_not_bound_the_search() -> None:
    """Attitudes in radians, read as degrees, are 10 or more of their sigmas off."""
    scans = tuple(Scan(np.ones((1, 3), np.float32), prior=prior) for prior in priors([1] * 6).values())
    measurements = Measurements(scans, np.zeros(COUNT, int))
    scaled = measurements.searched({"attitude": 12.0, "heading": 4.0})[5].prior
    assert scaled is not None
    np.testing.assert_allclose(scaled.sigmas, [np.inf, np.inf, 0.2, np.inf, np.inf, 0.2])


def test_few_pairs_are_registered_and_only_with_priors_within_a_survey() -> None:
    measured, registrar = priors([1] * 6), Truthful()
    points = np.random.default_rng(0).random((COUNT, 1, 3), np.float32)
    scans = [Scan(points[k], stamp=float(k), prior=measured[k], name=f"s{k}") for k in range(COUNT)]
    runner = PairRunner(Execution(Worker(registrar, 2)), scans, 0, None)
    one = np.zeros(COUNT, np.intp)
    pairs = register_freely(runner, scans, one)
    assert 8 <= len(registrar.registered) <= 16
    assert [pair.scans for pair in pairs] == [scans for scans in registrar.registered if scans[1] != 20]
    assert all(j == i + 1 for i, j in registrar.registered)
    bare = [replace(scan, prior=None) for scan in scans]
    registrar.registered.clear()
    for given, surveys in ((scans[:5], one), (bare, one), (scans, np.arange(COUNT))):
        assert register_freely(runner, given, surveys) == []
    assert registrar.registered == []
