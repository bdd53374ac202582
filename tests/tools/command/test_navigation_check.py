"""Whether `map` sees that scans contradict the navigation; a registrar that knows the truth is the method."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.navigation_check import contradiction_of
from sonarmap.tools.files.readers.instruments import poses_of
from tests.tools.files.readers.navigation.test_contradictions import TIGHT, measured, path, priors, registered, signed


class Truthful:
    """Registers scans by the truth, and fails where it is asked to."""

    def __init__(self, truth: np.ndarray, failing: frozenset[int] = frozenset()) -> None:
        self.poses, self.failing, self.asked = poses_of(truth), failing, 0

    def prepare(self, scan: Scan) -> int:
        assert scan.prior is None
        number = int(scan.stamp)
        if number in self.failing:
            raise InputError("too little structure")
        return number

    def register(self, target: int, source: int) -> Registration:
        self.asked += 1
        T: RigidTransform = self.poses[target].inv() * self.poses[source]
        return Registration(T, TIGHT, psr=9.0, overlap=0.8, accepted=True, seconds=0.0, reason="")


def scans_with(values: np.ndarray) -> list[Scan]:
    points = np.ones((1, 3), np.float32)
    return [Scan(points, stamp=k, prior=prior, name=f"s{k}") for k, prior in enumerate(priors(values))]


def test_a_mistake_is_named_from_few_pairs() -> None:
    rng = np.random.default_rng(1)
    truth = path(rng, 60)
    registrar = Truthful(truth, frozenset({3, 20}))
    values = measured(truth, rng)
    verdict = contradiction_of(scans_with(signed(2)(values)), [0] * 60, registrar, quiet=True)  # type: ignore[arg-type]
    assert verdict is not None
    assert verdict.instead == ("heading_deg with its sign turned",)
    assert registrar.asked <= 16
    assert contradiction_of(scans_with(values), [0] * 60, registrar, quiet=True) is None  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [2, 5])
def test_few_scans_are_not_asked(count: int) -> None:
    rng = np.random.default_rng(2)
    truth = path(rng, count)
    registrar = Truthful(truth)
    assert contradiction_of(scans_with(signed(2)(truth)), [0] * count, registrar, quiet=True) is None  # type: ignore[arg-type]
    assert registrar.asked == 0


def test_scans_without_priors_and_of_other_surveys_are_not_asked() -> None:
    rng = np.random.default_rng(3)
    truth = path(rng, 20)
    registrar, scans = Truthful(truth), scans_with(truth)
    bare = [replace(scan, prior=None) for scan in scans]
    assert contradiction_of(bare, [0] * 20, registrar, quiet=True) is None  # type: ignore[arg-type]
    assert contradiction_of(scans, list(range(20)), registrar, quiet=True) is None  # type: ignore[arg-type]
    assert registrar.asked == 0


def test_the_pairs_of_this_test_are_those_of_the_truth() -> None:
    rng = np.random.default_rng(4)
    truth = path(rng, 8)
    exact = registered(truth, rng)
    T = Truthful(truth).register(0, 1).T_target_source
    np.testing.assert_allclose(T.translation, exact.T_i_j[0].translation, atol=0.2)
