"""Second looks: pairs that scans alone leave in doubt are found where the motion or the estimate expects them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.decide.decision import decide
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.motion.limits import MotionLimits
from sonarmap.slam.motion.reconsider import expected_by
from sonarmap.slam.pair import RegisteredPair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from tests.samples.relative_priors import unexact
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of, step_pair

VOXEL = 0.2
COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)
TWIN = RigidTransform.from_components([9.0, 3.0, 0.0], Rotation.from_euler("Z", np.pi))
COUNT = 20
POSES = ring_poses(COUNT)


class Looking(KnowingRegistrar):
    """Right if an expected pose is given that is near the truth; without one, spoiled."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.looks: list[tuple[int, int]] = []

    def register_expected(self, target: Any, source: Any, expected: ExpectedPose) -> Registration:
        i, j = target.index, source.index
        self.looks.append((i, j))
        truth = self.truth[i].inv() * self.truth[j]
        away = expected.T_target_source.inv() * truth
        near = np.linalg.norm(away.translation) < 4 * expected.sigmas[3:].max()
        given = KnowingRegistrar(self.truth, self.covariance).register(target, source)
        return replace(given, accepted=bool(near), probability=0.97 if near else 0.0)


def mapped(
    spoil: Callable[[int, int, Registration], Registration],
    loops: int = 0,
    kind: type[KnowingRegistrar] = Looking,
    limits: MotionLimits | None = None,
) -> tuple[SurveyResult, Any]:
    registrar = kind(POSES, COVARIANCE, spoil)
    settings = MapperSettings(LoopSettings(per_scan=loops), limits or MotionLimits())
    return Mapper(registrar, VOXEL, settings).run(scans_of(POSES)), registrar


def refused(given: Registration) -> Registration:
    return replace(given, accepted=False, probability=0.1, covariance=np.eye(6))


def twin(given: Registration) -> Registration:
    return replace(given, T_target_source=given.T_target_source * TWIN, accepted=True, probability=0.95)


def largest_step_error(result: SurveyResult) -> float:
    T = result.trajectory.T_world_sensor
    away = (T[:-1].inv() * T[1:]).inv() * (POSES[:-1].inv() * POSES[1:])
    return float(np.linalg.norm(away.translation, axis=1).max())


def test_refused_steps_are_found_where_the_motion_expects_them() -> None:
    unsure = {(4, 5), (5, 6), (12, 13)}
    result, registrar = mapped(lambda i, j, given: refused(given) if (i, j) in unsure else given)
    assert set(registrar.looks) == unsure
    assert len(result.components) == 1
    assert largest_step_error(result) < 0.3
    assert all(pair.expected is not None for pair in result.pairs if pair.scans in unsure)


def test_a_step_to_a_twin_is_corrected() -> None:
    result, registrar = mapped(lambda i, j, given: twin(given) if (i, j) == (7, 8) else given)
    assert (7, 8) in registrar.looks
    assert len(result.components) == 1
    assert largest_step_error(result) < 0.3


@pytest.mark.slow
def test_loops_are_found_where_the_estimate_expects_them() -> None:
    result, registrar = mapped(lambda i, j, given: refused(given) if j > i + 1 else given, loops=2)
    assert registrar.looks
    assert all(j > i + 1 for i, j in registrar.looks)
    loops = [pair for pair in result.pairs if pair.role == "loop"]
    assert sum(pair.kept for pair in loops) > 0.8 * len(loops)


@pytest.mark.slow
def test_motion_limits_find_steps_without_a_learned_motion() -> None:
    result, registrar = mapped(
        lambda i, j, given: twin(given) if j == i + 1 else refused(given), limits=MotionLimits(step=4.0, turn_rate=0.5)
    )
    assert len(registrar.looks) >= COUNT - 1
    assert len(result.components) == 1
    assert largest_step_error(result) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [3, 7])
def test_many_second_looks_do_not_hide_a_gap(wrong: int) -> None:
    """If the second look does not find the step either, the chain stays broken."""

    class Blind(Looking):
        def register_expected(self, target: Any, source: Any, expected: ExpectedPose) -> Registration:
            return refused(super().register_expected(target, source, expected))

    across = {(i, j) for i in range(wrong + 1) for j in range(wrong + 1, COUNT)}
    result, _ = mapped(lambda i, j, given: refused(given) if (i, j) in across else given, kind=Blind)
    assert len(result.components) == 2


@pytest.mark.slow
def test_settling_scans_ends_the_loops_among_them() -> None:
    registrar = KnowingRegistrar(POSES, COVARIANCE)
    mapper = Mapper(registrar, VOXEL, MapperSettings(LoopSettings(per_scan=2)))
    survey = scans_of(POSES)
    loops = [
        [p for p in mapper.decided(survey, np.zeros(COUNT, int), (), n).pairs if p.role == "loop"]
        for n in (0, COUNT // 2)
    ]
    assert any(max(pair.scans) < COUNT // 2 for pair in loops[0])
    assert loops[1]
    assert not any(max(pair.scans) < COUNT // 2 for pair in loops[1])


def test_an_expected_pose_is_as_certain_as_the_instruments_of_both_scans() -> None:
    """An estimate's covariance counts three times, that of instruments once, with correlations of turn and shift."""
    sigmas = np.array([0.01, 0.01, 0.02, 0.8, 0.8, 0.1])
    scans = [replace(scan, prior=PosePrior(T, sigmas)) for scan, T in zip(scans_of(POSES), POSES, strict=True)]
    step = step_pair(0, POSES[0].inv() * POSES[1], COVARIANCE)
    solution = decide([step], Measurements(tuple(scans), np.zeros(COUNT, int)), VOXEL, LoopSettings()).solution
    measured, floor = RegisteredPair(2, 9, "loop"), np.zeros(6)
    (expected,) = expected_by(solution, [measured], floor)
    assert expected.by_instruments
    # by many draws of both scans' errors
    rng = np.random.default_rng(4)
    ends = [solution.trajectory.T_world_sensor[k] for k in measured.scans]
    drawn = [[unexact(T, rng, sigmas).T_world_sensor for _ in range(4000)] for T in ends]
    off = [(expected.T_target_source.inv() * (a.inv() * b)).as_exp_coords() for a, b in zip(*drawn, strict=True)]
    np.testing.assert_allclose(np.cov(np.transpose(off)), expected.covariance, atol=0.05 * expected.covariance.max())
    without = {k: prior for k, prior in solution.graph.priors if k != 9}
    alone = replace(solution, graph=replace(solution.graph, priors=tuple(without.items())))
    (unsure,) = expected_by(alone, [measured], floor)
    assert not unsure.by_instruments
    assert np.trace(unsure.covariance) > np.trace(expected.covariance)
