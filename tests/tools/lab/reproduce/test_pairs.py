"""Pairs of the evaluation, and a registration compared with navigation alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.lab.reproduce.experiments import Request, create
from sonarmap.tools.lab.reproduce.pairs import NAVIGATION, PRIORS, navigation_cells, navigation_covariance
from sonarmap.tools.lab.reproduce.registrations import refused
from sonarmap.tools.lab.simulate.kinds.kind import KindPair

SCAN = Scan(np.zeros((1, 3), np.float32))
PAIR = KindPair(
    kind="swath",
    number=0,
    seed=1,
    scene="seabed",
    target=SCAN,
    source=SCAN,
    T_world_target=RigidTransform.from_components([5.0, -3.0, -8.0], Rotation.from_euler("ZYX", [2.0, 0.1, -0.05])),
    T_world_source=RigidTransform.from_components([25.0, 22.0, -7.0], Rotation.from_euler("ZYX", [-1.0, 0.02, 0.1])),
    shared=0.3,
)


def navigated(pair: KindPair) -> tuple[PosePrior, PosePrior]:
    """Navigation priors of target and source."""
    instruments = PRIORS[NAVIGATION]
    assert instruments is not None
    given = pair.with_priors(instruments)
    assert given.target.prior is not None
    assert given.source.prior is not None
    return given.target.prior, given.source.prior


def registration(error: np.ndarray, sigmas: np.ndarray) -> Registration:
    """Registration off by `error` with standard deviations `sigmas`, both along the source's axes [m]."""
    T = PAIR.T_target_source * RigidTransform.from_translation(error)
    return Registration(T, np.diag(np.concatenate([np.full(3, 1e-6), sigmas**2])), 20.0, 0.3, True, 1.0)


class TestNavigation:
    def test_directions_are_those_of_the_covariance_in_the_targets_axes(self) -> None:
        priors = navigated(PAIR)
        error = np.array([0.3, -2.0, 0.1])
        answer = registration(error, np.array([0.5, 3.0, 0.02]))
        cells = navigation_cells(answer, PAIR.T_target_source, *priors)
        sigmas, errors, navigation = (
            np.array([float(cells[f"direction{k}_{name}_m"]) for k in (1, 2, 3)])
            for name in ("sigma", "error", "navigation_error")
        )
        assert sigmas == pytest.approx([0.02, 0.5, 3.0])
        assert np.abs(errors) == pytest.approx([0.1, 0.3, 2.0], abs=1e-6)
        T = priors[0].T_world_sensor.inv() * priors[1].T_world_sensor
        off = T.translation - PAIR.T_target_source.translation
        assert np.linalg.norm(navigation) == pytest.approx(np.linalg.norm(off))

    def test_the_covariance_of_navigation_is_that_of_its_errors(self) -> None:
        """Errors of roll, pitch and heading rotate the vector to the source; those of position and depth add to it."""
        draws = []
        for number in range(100):
            target, source = navigated(replace(PAIR, number=number))
            off = (target.T_world_sensor.inv() * source.T_world_sensor).translation - PAIR.T_target_source.translation
            draws.append(off @ np.linalg.solve(navigation_covariance(target, source), off))
        assert np.mean(draws) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 100))

    def test_a_refused_registration_has_no_cells(self) -> None:
        assert navigation_cells(refused("why"), PAIR.T_target_source, *navigated(PAIR)) == {}


class TestPairs:
    def test_jobs_do_not_depend_on_the_number_of_pairs(self) -> None:
        few, many = (create("pairs", Request(set=("overlap",), pairs=n, method=("icp",))).jobs for n in (6, 20))
        assert set(few) < set(many)
        assert few == ["yaw/000/icp", "yaw/001/icp", "any/000/icp"]
